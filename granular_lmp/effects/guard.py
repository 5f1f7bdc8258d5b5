"""The guard: a number that LAMMPS measures to prove that an effect left out of a deck did not occur.

Each guard is defined in the file of its effect. `granular_lmp.lammps.guards` writes it into the deck and judges its
result.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi

import numpy as np

from granular_lmp.effects.law_formulas import FORMULAS, Formulas
from granular_lmp.scene.at_rest import crystal_of
from granular_lmp.scene.resolution import gathered_rounding
from granular_lmp.scene.scene import Scene

LOOKS = 40  # looks in a period of the fastest motion that matters
BETWEEN = 1 - cos(pi / LOOKS)  # share of an oscillation's amplitude that may lie beyond two looks, 0.31 %
TOP = 1.0  # rad/tau, top of the branches that carry displacements: L and TR at the edge of the zone
NEVER = 1e20  # tau of a limit that was not passed; LAMMPS's minimum of an empty set

# A quantity that a symmetry forbids stays at the `gathered_rounding` of its run, up to 2 times that. For a = 0.2, 201
# rows and 2400 steps that is 1e-10 D0. A millionth of the wave is far above it, yet harmless.
BROKEN_SYMMETRY = 1e-6
ROUNDINGS = 20.0


# A quantity that is kept at every look, in the lines of a guard: a vector of its values since the last line
_LOOK = re.compile(r"look\(([^()]+)\)")


@dataclass(frozen=True)
class Reading:
    """What guards read of the contacts of a scene.

    LAMMPS gives lengths and forces of contacts, and no radii. Dashpots are in the forces, which may then pull although
    the spheres are pressed, or press although they are about to part.

    Attributes
    ----------
    lengths : bool
        True if overlaps are those of lengths, as all contacts are alike. Otherwise they follow from normal forces.
    dashpots : bool
        True if these forces hold dashpots. Overlaps are then lower bounds: the fastest two spheres may part.
    whole : bool
        True if contacts slide at μ times the whole normal force, with its dashpot: LAMMPS's Hertz contacts.
    formulas : Formulas
        Of the adhesion law.
    """

    lengths: bool
    formulas: Formulas
    dashpots: bool = False
    whole: bool = False

    @classmethod
    def of(cls, scene: Scene) -> "Reading":
        """Return the reading of a scene with every "auto" decided."""
        formulas = FORMULAS[scene.sphere.adhesion_law]
        if scene.effects.damping is not True:
            return cls(scene.perfect, formulas)
        same = alike(scene)
        return cls(same, formulas, dashpots=not same, whole=scene.effects.adhesion is not True)

    @property
    def forces(self) -> bool:
        """True if normal forces are read."""
        return not self.lengths or self.whole


def alike(scene: Scene) -> bool:
    """Return whether all contacts of a crystal are between spheres of one radius and material."""
    crystal = crystal_of(scene)
    return len(crystal.materials) == 1 and bool(np.ptp(crystal.atoms.arrays["radius"]) == 0)


def bounded(scene: Scene) -> bool:
    """Return whether the smallest overlap that the guards of a scene know is only a lower bound."""
    return Reading.of(scene).dashpots


def contact_lines(group: str, tag: str, how: Reading) -> list[str]:
    """Return the lines that measure the contacts of a group: shear forces, lengths, and normal forces if they are read.

    Parameters
    ----------
    group : str
        Spheres that are looked at.
    tag : str
        End of the names of the computes: "" for the spheres that are judged, "_all" for all.
    how : Reading
    """
    forces = f" force{how.formulas.mark} cutoff {how.formulas.cutoff}" if how.forces else ""
    lines = [
        f"compute      contact{tag} {group} pair/local dist p4{forces}",
        f"compute      extreme{tag} {group} reduce max c_contact{tag}[1] c_contact{tag}[2] inputs local",
    ]
    if how.forces:
        lines.append(f"compute      weakest{tag} {group} reduce min c_contact{tag}[3] inputs local")
    if how.dashpots:
        lines.append(f"compute      swift{tag} {group} reduce maxabs vx vy")
    return lines


def overlap_lines(of: str, how: Reading) -> list[str]:
    """Return the lines of the variable ``overlap_OF``, the smallest overlap of contacts that touch, in Δ0.

    Parameters
    ----------
    of : str
        "looks" for all looks since the last line of the thermo table, "now" for the present one, "all" for the present
        one and all spheres.
    how : Reading
        With `lengths` the overlap of a contact is 2R less its length. Otherwise it is that of two spheres of the
        lattice that have the smallest normal force; with `dashpots` of that force less the most that a dashpot adds.
    """
    style, longest, weakest = "vector" if of == "looks" else "equal", read("extreme", of, 1), read("weakest", of)
    if how.lengths:
        return [
            f"variable     overlap_{of} {style} (2*v_R-{longest})/v_Delta0"
            "  # the smallest, in Delta0, of contacts that touch"
        ]
    least, overlap = f"{weakest}+<adhesive_force>", how.formulas.overlap
    if not how.dashpots:
        return [
            f"variable     overlap_{of} {style} {overlap.format(u=f'(({least}>0)*({least})/<holding_force>)')}"
            "  # of the smallest normal force, in Delta0"
        ]
    swift, spring = f"sqrt({read('swift', of, 1)}^2+{read('swift', of, 2)}^2)", f"v_spring_{of}"
    share = f"(1e-9+({spring}>0)*(({spring}<1)*{spring}+({spring}>=1)))"
    # The dashpot of a restitution grows with the force: its bound, and so that of the overlap, are of the force at rest
    return [
        f"variable     spring_{of} {style} ({least}-2*<dashpot>*{swift})/<holding_force>"
        "  # the smallest normal force, as if the strongest dashpot added the most to it",
        f"variable     overlap_{of} {style} {overlap.format(u=share)}"
        "  # of that force, in Delta0: never above the truth",
    ]


def read(compute: str, of: str, column: int = 0) -> str:
    """Return an extreme of `contact_lines` as it stands in the line of a variable; `of` as of `overlap_lines`."""
    name = f"c_{compute}{'_all' if of == 'all' else ''}" + (f"[{column}]" if column else "")
    return f"look({name})" if of == "looks" else name


def kept_at_looks(lines: list[str], first: str) -> tuple[list[str], list[str]]:
    """Return the quantities to be kept at every look, and lines in which ``look(QUANTITY)`` is their column.

    Formulas are parsed anew at each evaluation, which takes LAMMPS as long as ten contacts. So a look keeps plain
    numbers, and formulas of whole vectors are evaluated once a line of the thermo table.

    Parameters
    ----------
    lines : list of str
        Lines of guards.
    first : str
        Quantity of the first column.
    """
    kept = list(dict.fromkeys([first, *(name for line in lines for name in _LOOK.findall(line))]))
    return kept, [_LOOK.sub(lambda match: f"f_looks[{kept.index(match[1]) + 1}]", line) for line in lines]


@dataclass(frozen=True)
class Guard:
    """One guard.

    Attributes
    ----------
    title : str
        Name in ``run.json``.
    name : str
        Prefix of the variables in the deck: NAME_looks at all looks since the last line of the table, NAME the largest
        of them, NAME_at the first time (tau) at which it was above the limit, `NEVER` if it was not.
    lines : tuple of str
        Lines of the deck that compute NAME_looks; ``look(QUANTITY)`` stands for the values of a quantity at those
        looks, ``<name>`` for a number of the scene.
    limit : float
        Value above which the guard triggers.
    meaning : str
        Meaning of a larger value, for the message.
    cure : str
        Advice for the user, for the message.
    roundings : float
        Multiple of the `gathered_rounding` of positions that is added to the limit.
    of_contacts : bool
        True if the lines read `contact_lines` or `overlap_lines`.
    per_contact : callable
        Scene → True if what LAMMPS measures does not always decide, and contacts are dumped while it does not.
    """

    title: str
    name: str
    lines: tuple[str, ...]
    limit: float
    meaning: str
    cure: str
    roundings: float = 0.0
    of_contacts: bool = False
    per_contact: Callable[[Scene], bool] = lambda scene: False

    @property
    def column(self) -> str:
        """Name of the thermo column of the extreme."""
        return f"v_{self.name}"

    def limit_in(self, scene: Scene) -> float:
        """Return the limit above which the guard triggers in a scene, with the rounding of positions."""
        return self.limit + self.roundings * gathered_rounding(scene)
