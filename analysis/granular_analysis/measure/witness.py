"""The witness of an unnamed crystal: its contacts integrated from the first snapshot, and where the deck parts from it.

The witness starts with the places, velocities and spins of the first snapshot, and with contacts without slip. It takes
the velocity Verlet steps of the deck, and once more a quarter of them. What separates the deck from the finer one is

    the step        deck's steps beside a quarter of them
    the digits      a start whose places are moved by up to half of the last digit of the dump
    the rest        what neither the law nor the dump says: slip at the first snapshot, other forces, another law

each as the norm of the differences of all velocities over that of the velocities. Lengths, times and masses are those
of the dump in SI units (of units lj in these).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory import network_compiled, network_verlet
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.loops import library
from granular_analysis.theory.network import Law, Material, Network
from granular_analysis.theory.network_laws import Adhesion
from granular_analysis.theory.network_outside import Drive
from granular_analysis.theory.network_state import start
from granular_lmp.runs.unnamed import Moment, Unnamed

Floats = NDArray[np.float64]

FINER = 4  # steps of the finer witness in one of the deck
PARTED = 0.01  # of the largest speed: where a sphere is off by this, deck and witness have parted
EXPLAINED = 3.0  # times step and digits: a difference of which this is more has another cause
_NORMAL: dict[str, Adhesion] = {"hertz/material": "dmt", "dmt": "dmt", "jkr": "jkr"}
_SHEAR: dict[str, Law] = {"mindlin": "secant", "mindlin/force": "incremental"}
_MATERIAL = ("young", "poisson", "gamma")
_ELASTIC = {"none", "linear_nohistory"}


@dataclass(frozen=True)
class Witness:
    """Departure of a deck from its witness, and its reasons.

    Attributes
    ----------
    steps, timestep : steps that were taken, and the time of one.
    error : relative error of the velocities against the finer witness.
    step, digits : shares of it, from the step of the deck and from the digits of the dump; their likely size.
    largest : largest difference of a velocity, of the largest speed.
    sphere, time : the sphere that is off by most, by its number, and when it is.
    parted : the first time at which a sphere is off by `PARTED`, and its number; None if none is.
    reasons : sentences on what the witness cannot know.
    """

    steps: int
    timestep: float
    error: float
    step: float
    digits: float
    largest: float
    sphere: int
    time: float
    parted: tuple[float, int] | None
    reasons: tuple[str, ...]

    @property
    def explained(self) -> bool:
        """True if step and digits are enough to explain the difference."""
        return self.error <= EXPLAINED * (self.step + self.digits) + 1e-9


def witness(crystal: Unnamed) -> Witness:
    """Return what separates the deck of an unnamed crystal from its witness.

    Raises
    ------
    TheoryError
        If no law is known, or one that the network does not hold, or snapshots are not at even steps.
    RunFolderError
        If no masses are known.
    """
    apart = np.diff(crystal.steps)
    if not len(apart) or np.ptp(apart):
        raise TheoryError("snapshots must be at least two, at even numbers of steps")
    timestep = float((crystal.time[-1] - crystal.time[0]) / (crystal.steps[-1] - crystal.steps[0]))
    first = crystal[0]
    network = network_of(crystal, first)
    axes = network.dimension
    deck = crystal.stack("velocity")[..., :axes]
    free = ~np.asarray(network.held)

    def run(places: Floats, finer: int) -> Floats:
        """Return velocities (T, N, d) of a witness that starts from these places."""
        from_here = replace(network, position=places)
        spin = np.zeros((len(places), 3)) if first.spin is None else first.spin
        state = start(from_here, 0.0, first.velocity[:, :axes], 0.0, spin[:, 2] if axes == 2 else spin)
        every, count = int(apart[0]) * finer, int(apart.sum()) * finer
        march = network_verlet.march if library() is None else network_compiled.march
        rows = march(from_here, state, timestep / finer, count, every)
        return np.array([motion[network.freedoms : network.freedoms + axes].T for motion in rows])

    fine = run(network.position, FINER)
    size = float(np.linalg.norm(deck)) or 1.0
    coarse, resolution = run(network.position, 1), crystal.known["resolution"]
    noise = np.random.default_rng(0).uniform(-0.5, 0.5, network.position.shape) * resolution
    noise[:, np.ptp(network.position, axis=0) == 0] = 0.0
    rounded = run(network.position + noise, 1) if resolution else coarse
    off = np.linalg.norm(deck - fine, axis=2) * free
    fastest = float(np.linalg.norm(deck, axis=2).max()) or 1.0
    late = np.flatnonzero(off.max(axis=1) > PARTED * fastest)
    parted = (float(crystal.time[late[0]]), int(crystal.spheres[off[late[0]].argmax()])) if len(late) else None
    moment, sphere = np.unravel_index(off.argmax(), off.shape)
    return Witness(
        steps=int(apart.sum()),
        timestep=timestep,
        error=float(np.linalg.norm(off)) / size,
        step=float(np.linalg.norm(coarse - fine)) / size,
        digits=float(np.linalg.norm(rounded - coarse)) / size,
        largest=float(off.max()) / fastest,
        sphere=int(crystal.spheres[sphere]),
        time=float(crystal.time[moment]),
        parted=parted,
        reasons=tuple(_reasons(crystal, first)),
    )


def network_of(crystal: Unnamed, first: Moment) -> Network:
    """Return the network of an unnamed crystal at its first snapshot.

    Raises
    ------
    TheoryError
        As `witness`.
    """
    laws = {tuple(each["types"]): each for each in crystal.known["laws"]}
    if not laws:
        raise TheoryError("no contact law is known; adopt the dump together with its deck, or with --law")
    kinds = np.unique(crystal.types)
    own = [laws[kind, kind] for kind in kinds.tolist() if (kind, kind) in laws]
    if len(own) < len(kinds):
        raise TheoryError(f"the law of two spheres of one type is known for {len(own)} of {len(kinds)} types")
    there = {pair: law for pair, law in laws.items() if {*pair} <= {*kinds.tolist()}}
    _refuse_others(own, there)
    law = own[0]
    _, cell, periodic = crystal.cell
    if periodic.any() and not np.array_equal(cell, np.diag(np.diag(cell))):
        raise TheoryError("a tilted box is not built")
    flat = {*crystal.axes} <= {0, 1} and not first.velocity[:, 2].any()
    spins = first.spin if first.spin is not None else np.zeros((1, 3))
    axes = 2 if flat and not spins[:, :2].any() else 3
    still = _still(crystal) | np.isin(crystal.spheres, crystal.known["held"])
    sheared = law["tangential"] not in _ELASTIC and law["friction"] != 0  # LAMMPS bounds the shear force by it
    return Network(
        crystal.rest[:, :axes],
        crystal.radius,
        crystal.mass / (4 / 3 * np.pi * crystal.radius**3),
        tuple(Material(each["young"], each["poisson"], 2 * each["gamma"]) for each in own),
        np.searchsorted(kinds, crystal.types),
        still,
        tuple(np.where(periodic, np.diag(cell), np.inf)[:axes]),
        law=_SHEAR[law["tangential"]] if sheared else "secant",
        friction=law["friction"] if sheared else np.inf,
        shear=sheared,
        viscosity=law["viscosity"] if law["damping_law"] == "velocity" else 0.0,
        restitution=_restitution(law),
        adhesion=_NORMAL[law["normal"]],
        shear_mixing="lammps" if any(each["mixed"] for each in there.values()) else "mindlin",
        drives=_pushes(crystal, axes),
    )


def _pushes(crystal: Unnamed, axes: int) -> tuple[Drive, ...]:
    """Return the constant forces of the deck."""
    rows = np.array(crystal.known["pushes"]).reshape(-1, 4)
    there = np.isin(rows[:, 0], crystal.spheres)
    spheres = np.searchsorted(crystal.spheres, rows[there, 0])
    return tuple(
        Drive(spheres, axis, np.ones_like, size=float(np.abs(forces).max()), share=forces)
        for axis, forces in enumerate(rows[there, 1 : 1 + axes].T)
        if forces.any()
    )


def _restitution(law: dict[str, Any]) -> float | None:
    dissipates = law["damping_law"] == "coeff_restitution" and 0 < law["damping"] < 1
    return law["damping"] if dissipates else None


def _refuse_others(own: list[dict[str, Any]], laws: dict[tuple[int, ...], dict[str, Any]]) -> None:
    """Raise TheoryError for laws that the network does not hold."""
    for law in laws.values():
        if law["normal"] not in _NORMAL:
            raise TheoryError(f"the normal law {law['normal']} is not built; the witness knows {', '.join(_NORMAL)}")
        if law["tangential"] not in {*_SHEAR, *_ELASTIC}:
            raise TheoryError(f"the tangential law {law['tangential']} is not built; the witness knows {[*_SHEAR]}")
        if law["shear_stiffness"] is not None and law["tangential"] in _SHEAR:
            raise TheoryError("a shear stiffness of its own is not built; the witness knows NULL")
        if law["tangential"] == "linear_nohistory" and law["damping"] * law["shear_damping"] * law["friction"]:
            raise TheoryError("a damping of shear without a spring is not built; the witness knows mindlin")
        if law["damping"] and law["damping_law"] not in ("velocity", "coeff_restitution"):
            raise TheoryError(f"damping {law['damping_law']} is not built; the witness knows velocity")
        if law["damping"] and law["tangential"] in _SHEAR and law["shear_damping"] != 1:
            raise TheoryError("a damping of shear of its own is not built; the witness knows 1")
    for pair, law in laws.items():
        if not law["mixed"] and any(law[name] != laws[one, one][name] for name in _MATERIAL for one in pair):
            raise TheoryError(f"a law of their own of types {pair[0]} and {pair[1]} is not built; the witness mixes")
    same = ("normal", "tangential", "friction", "damping_law", "damping")
    if any(each[name] != own[0][name] for each in laws.values() for name in same):
        raise TheoryError("the types differ in more than their material, which is not built")


def _still(crystal: Unnamed) -> NDArray[np.bool_]:
    """Return the spheres that do not move in any snapshot: whether something holds them is not seen."""
    still = np.ones(len(crystal.spheres), dtype=bool)
    for number in range(len(crystal)):
        moment = crystal[number]
        still &= np.all(moment.place == crystal.rest, axis=1) & ~moment.velocity.any(axis=1)
    return still


def _reasons(crystal: Unnamed, first: Moment) -> Iterator[str]:
    """Yield what the witness cannot know of the deck."""
    known = crystal.known
    sheared = any(each["tangential"] not in _ELASTIC for each in known["laws"])
    if crystal.steps[0] and sheared:
        yield f"the first snapshot is of step {crystal.steps[0]}: the slip of its contacts is in no dump"
    if first.spin is None and sheared:
        yield "the dump holds no spins (omegax, omegay, omegaz); the witness begins without"
    if any("differences" in each for each in crystal.info["remarks"]):
        yield "the dump holds no velocities; they are differences of places"
    for command in known["acting"]:
        yield f"the witness leaves out '{command}'"


def table(crystal: Unnamed, found: Witness) -> str:
    """Return what separates the deck from its witness, as text."""
    time = "s" if crystal.in_si else "units of time"
    span = ceil(found.steps)
    lines = [
        f"{crystal.name}: {len(crystal.spheres)} spheres, {span} steps of {found.timestep:.6g} {time}, "
        f"witness with {FINER} times as many",
        f"relative error of all velocities {found.error:.1e}; the step explains {found.step:.1e}, "
        f"the digits of the dump up to {found.digits:.1e}",
        f"farthest apart: sphere {found.sphere} at {found.time:.6g} {time}, "
        f"by {found.largest:.1e} of the largest speed",
    ]
    if found.parted is None:
        lines.append(f"they do not part by {PARTED:.0%} of the largest speed")
    else:
        when, sphere = found.parted
        lines.append(f"they part by {PARTED:.0%} of the largest speed at {when:.6g} {time}, first at sphere {sphere}")
    if not found.explained:
        lines.append("neither step nor digits explain this: the deck does something that law and dump do not say")
    return "\n".join([*lines, *(f"note: {each}" for each in found.reasons)])
