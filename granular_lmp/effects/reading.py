"""Lines of a deck with which guards read contacts in LAMMPS."""

import numpy as np

from granular_lmp.crystal.adhesion_laws import AdhesionLaw
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.effects.case import Case
from granular_lmp.effects.guard import Prepared
from granular_lmp.effects.on_walls import OnWall
from granular_lmp.frozen import dataclass
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.scene import Scene


@dataclass(frozen=True)
class Reading:
    """Settings for guards that read the contacts of a scene.

    LAMMPS returns lengths and forces of contacts, but no radii. The forces include dashpots, so they may pull although
    the spheres are compressed, or push although they are about to separate.

    Attributes
    ----------
    lengths : bool
        True if overlaps follow from lengths, because all contacts are alike. Otherwise they follow from normal forces.
    dashpots : bool
        True if these forces include dashpots. Overlaps are then lower bounds, since the fastest two spheres may
        separate.
    whole : bool
        True if contacts slide at μ times the whole normal force including its dashpot, as Hertz contacts in LAMMPS do.
    sphere : Sphere
        Sphere of the lattice, which has the law.
    holding_force, adhesive_force, dashpot : float
        F + F0 of the sphere, adhesion of the weakest contact, and strongest dashpot, in units of the deck.
    walls : tuple of OnWall
        Contacts with walls.
    axes : int
        Dimensions in which spheres move.
    """

    lengths: bool
    sphere: Sphere
    holding_force: float
    dashpots: bool = False
    whole: bool = False
    adhesive_force: float = 0.0
    dashpot: float = 0.0
    walls: tuple[OnWall, ...] = ()
    axes: int = 2

    @classmethod
    def of(cls, problem: Prepared) -> "Reading":
        """Return the reading of a problem."""
        scene, units, sphere = problem.scene, problem.units, problem.scene.sphere
        holding = units.number(sphere.holding_force, mass=1, length=1, time=-2)
        case = Case(scene, problem.on)
        spheres = case.contacts.adhesive_force[~case.contacts.on_wall]
        weakest = sphere.pull_off_force if scene.perfect else float(spheres.min())
        adhesive, walls = units.number(weakest, mass=1, length=1, time=-2), OnWall.all_of(problem)
        if scene.effects.damping is not True:
            return cls(scene.perfect, sphere, holding, adhesive_force=adhesive, walls=walls, axes=scene.space)
        same, whole = alike(scene), scene.effects.adhesion is not True
        dashpot = units.number(case.strongest_dashpot, mass=1, time=-1)
        return cls(same, sphere, holding, not same, whole, adhesive, dashpot, walls, scene.space)

    @property
    def law(self) -> AdhesionLaw:
        """Law of two spheres of the lattice."""
        return self.sphere.contact_law

    def overlap_of_share(self, share: str) -> str:
        """Return the overlap, in Δ0, of two spheres of the lattice whose f_N + F is this share of the value at rest."""
        return self.law.overlap_of_share(share, self.sphere.contact_force)

    @property
    def forces(self) -> bool:
        """True if guards read normal forces."""
        return not self.lengths or self.whole


def alike(scene: Scene) -> bool:
    """Return whether all contacts of a crystal are between spheres of one radius and material."""
    crystal = crystal_of(scene)
    return len(crystal.materials) == 1 and bool(np.ptp(crystal.atoms.arrays["radius"]) == 0)


def judged_singly(scene: Scene) -> bool:
    """Return whether openings are judged contact by contact, because the smallest overlap is only a lower bound.

    Contacts that hold beyond overlap 0 are counted instead.
    """
    return scene.effects.damping is True and not alike(scene) and not scene.sphere.pull_off_distance


def contact_lines(how: Reading) -> list[str]:
    """Return the lines that measure contacts in the group inside: lengths, shear forces, perhaps normal forces."""
    forces = f" force{how.law.mark(how.axes)} cutoff {how.law.cutoff}" if how.forces else ""
    lines = [
        f"compute      contact inside pair/local dist p4{forces}",
        "compute      extreme inside reduce max c_contact[1] c_contact[2] inputs local",
    ]
    if how.forces:
        lines.append("compute      weakest inside reduce min c_contact[3] inputs local")
    if how.dashpots:
        velocity = " ".join(f"v{axis}" for axis in "xyz"[: how.axes])
        lines.append(f"compute      swift inside reduce maxabs {velocity}")
    return lines + [line for each in how.walls for line in each.lines()]


def overlap_lines(how: Reading) -> list[str]:
    """Return the lines of the variable ``overlap``, the smallest overlap of touching contacts, in Δ0.

    An overlap with a wall is relative to that at rest. `between` is the smallest overlap between spheres.

    Parameters
    ----------
    how : Reading
        With `lengths` the overlap of a contact is 2R minus its length. Otherwise it is that of two spheres of the
        lattice under the smallest normal force; with `dashpots` the largest dashpot force is subtracted first.
    """
    lines, smallest = _between(how), between(how)
    for each in how.walls:
        left = f"v_left_{each.name}"
        lines.append(f"variable     {left[2:]} equal {each.overlap()}  # at the wall, over its overlap at rest")
        smallest = f"ternary({left}<{smallest},{left},{smallest})"
    return lines + ([f"variable     overlap equal {smallest}"] if how.walls else [])


def between(how: Reading) -> str:
    """Return the variable of the smallest overlap between spheres."""
    return "v_between" if how.walls else "v_overlap"


def _between(how: Reading) -> list[str]:
    """Return the lines of the variable `between`."""
    name = between(how)[2:]
    if how.lengths:
        return [
            f"variable     {name} equal ($(2*v_R:%.17g)-c_extreme[1])/$(v_Delta0:%.17g)"
            "  # smallest overlap of all contacts, in Delta0"
        ]
    least, holding = f"c_weakest+{how.adhesive_force!r}", repr(how.holding_force)
    if not how.dashpots:
        overlap = how.overlap_of_share(f"(({least}>0)*({least})/{holding})")
        return [f"variable     {name} equal {overlap}  # overlap under the smallest normal force, in Delta0"]
    squares = (f"c_swift[{axis}]^2" for axis in range(1, how.axes + 1))
    swift = f"sqrt({'+'.join(squares)})"
    share = "(1e-9+(v_spring>0)*((v_spring<1)*v_spring+(v_spring>=1)))"
    # The dashpot of a restitution grows with the force; its bound, and so that of the overlap, assume the force at rest
    return [
        f"variable     spring equal ({least}-2*{how.dashpot!r}*{swift})/{holding}"
        "  # smallest normal force minus the largest dashpot force",
        f"variable     {name} equal {how.overlap_of_share(share)}"
        "  # overlap under that force, in Delta0: a lower bound",
    ]
