"""Names in a deck for the freedoms of its spheres: ux, uy and one angle in the plane, all six in space."""

from granular_lmp.effects.guard import Prepared
from granular_lmp.scene.sources import TORQUES


def axes(problem: Prepared) -> str:
    """Return the axes along which spheres move: "xy", or "xyz" in space."""
    return "xyz"[: problem.scene.space]


def turns(problem: Prepared) -> tuple[str, ...]:
    """Return the suffixes of the names of angles and spins: one for z, or three."""
    return ("",) if problem.scene.space == 2 else ("x", "y", "z")


def along(problem: Prepared, name: str, none: str) -> str:
    """Return the three words of a vector of variables NAMEx, NAMEy, NAMEz, with `none` for z in the plane."""
    return " ".join(f"v_{name}{axis}" if axis in axes(problem) else none for axis in "xyz")


def about(problem: Prepared, name: str) -> str:
    """Return the three words of a spin: the variable NAME about z, or NAMEx, NAMEy, NAMEz in space."""
    own = [f"v_{name}{axis}" for axis in turns(problem)]
    return " ".join(["0.0"] * (3 - len(own)) + own)


def style(problem: Prepared) -> str:
    """Return the atom style: a dipole tracks angles in the plane, a quaternion in space.

    In space the torques of sources act on a dipole.
    """
    if not problem.on["tracking"]:
        return "sphere"
    if problem.scene.space == 2:
        return "hybrid sphere dipole"
    pushed = any(each.force in TORQUES for each in problem.scene.source)
    return "hybrid bpm/sphere dipole" if pushed else "bpm/sphere"
