"""The guard: a number that LAMMPS measures to prove that an effect left out of a deck did not occur.

Each guard is defined in the file of its effect. `granular_lmp.lammps.guards` writes it into the deck and judges its
result.
"""

from dataclasses import dataclass
from math import cos, pi

from granular_lmp.scene.resolution import farthest_rounding
from granular_lmp.scene.scene import Scene

LOOKS = 40  # looks in a period of the fastest motion that matters
BETWEEN = 1 - cos(pi / LOOKS)  # share of an oscillation's amplitude that may lie beyond two looks, 0.31 %
TOP = 1.0  # rad/tau, top of the branches that carry displacements: L and TR at the edge of the zone
NEVER = 1e20  # tau of a limit that was not passed; LAMMPS's minimum of an empty set

# A quantity that a symmetry forbids stays at the rounding of the farthest position: 0.5 times (spread), 25 times
# (torque) that. For a = 0.2 and 201 rows that is 2e-10 D0. A millionth of the wave is far above it, yet harmless.
BROKEN_SYMMETRY = 1e-6
ROUNDINGS = 100.0


def contact_lines(group: str, of: str, *, equal: bool) -> list[str]:
    """Return the lines that measure the contacts of a group at a look: shear forces, and the smallest overlap.

    Parameters
    ----------
    group : str
        Spheres that are looked at.
    of : str
        "now" for the spheres that are judged, "all" for all.
    equal : bool
        True if all spheres are equal: the overlap of a contact is then 2R less its length. Otherwise the smallest
        normal force is measured, and `v_overlap` is the overlap of two spheres of the lattice with that force.
    """
    tag = "" if of == "now" else f"_{of}"
    extreme = f"compute      extreme{tag} {group} reduce max c_contact{tag}[1] c_contact{tag}[2] inputs local"
    if equal:
        return [
            f"compute      contact{tag} {group} pair/local dist p4",
            extreme,
            f"variable     overlap_{of} equal (2*v_R-c_extreme{tag}[1])/v_Delta0"
            "  # the smallest, in Delta0, of contacts that touch",
        ]
    least = f"c_weakest{tag}+<adhesive_force>"
    return [
        f"compute      contact{tag} {group} pair/local dist p4 force cutoff radius",
        extreme,
        f"compute      weakest{tag} {group} reduce min c_contact{tag}[3] inputs local",
        f"variable     overlap_{of} equal (({least}>0)*({least})/<holding_force>)^(2/3)"
        "  # of the smallest normal force, in Delta0",
    ]


@dataclass(frozen=True)
class Guard:
    """One guard.

    Attributes
    ----------
    title : str
        Name in ``run.json``.
    name : str
        Prefix of the variables in the deck: NAME_now at a look, NAME the largest since the last line of the table,
        NAME_at the first time (tau) at which it was above the limit, `NEVER` if it was not.
    lines : tuple of str
        Lines of the deck that compute NAME_now; ``<name>`` stands for a number of the scene.
    limit : float
        Value above which the guard triggers.
    meaning : str
        Meaning of a larger value, for the message.
    cure : str
        Advice for the user, for the message.
    roundings : float
        Multiple of the rounding of positions (`farthest_rounding`) that is added to the limit.
    of_contacts : bool
        True if the lines read `contact_lines`.
    per_contact : bool
        True if NAME is only an upper bound, and contacts are dumped while it is above the limit.
    """

    title: str
    name: str
    lines: tuple[str, ...]
    limit: float
    meaning: str
    cure: str
    roundings: float = 0.0
    of_contacts: bool = False
    per_contact: bool = False

    @property
    def column(self) -> str:
        """Name of the thermo column of the extreme."""
        return f"v_{self.name}"

    def limit_in(self, scene: Scene) -> float:
        """Return the limit above which the guard triggers in a scene, with the rounding of positions."""
        return self.limit + self.roundings * farthest_rounding(scene)
