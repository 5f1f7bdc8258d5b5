"""Spheres of a scene and the bodies they touch: ranges of constants, ``[contact]``, ``[[pair]]``, ``[substrate]``.

The records of spheres and imperfections belong to other rooms, so their rules stand here.
"""

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, words_of_laws
from granular_lmp.crystal.walls import BELOW, BOTH
from granular_lmp.frozen import dataclass
from granular_lmp.scene.places import rows_rule, spheres_rule
from granular_lmp.scene.schema import ArrayRule, Interval, Rule, Rules, choice, number

_MEASURED, _STIFFEST = "measured at rest; left out: computed from the moduli", (1e-6, 1e12)
_STIFFNESS = ("N/m", _MEASURED, *_STIFFEST)


@dataclass(frozen=True)
class Contact:
    """Measured stiffnesses of a contact at rest between two spheres of the lattice; they replace the computed ones.

    The force law is scaled at a fixed overlap, so the overlap at rest and the share of adhesion do not change.
    """

    normal_stiffness: float | None = number(*_STIFFNESS, default=None)
    shear_stiffness: float | None = number(*_STIFFNESS, default=None)


@dataclass(frozen=True)
class Substrate:
    """A rigid half-space under a crystal; its face is normal to z, and the spheres of the first layer adhere to it.

    A contact with a sphere follows the law between two spheres (`granular_lmp.crystal.walls`), with E* and w of both
    materials. Measured stiffnesses replace the computed ones. With ``sides = "both"`` a second half-space lies on the
    last layer.
    """

    youngs_modulus: float = number("Pa", "of the half-space", 1e3, 1e13)
    poisson_ratio: float = number("", "of the half-space", -1, 0.5, open_low=True)
    work_of_adhesion: float = number(
        "J/m2", "between two bodies of its material; with a sphere: the geometric mean", 1e-6, 100
    )
    normal_stiffness: float | None = number(*_STIFFNESS, default=None)
    shear_stiffness: float | None = number(*_STIFFNESS, default=None)
    sides: str = choice("under the crystal, or on both sides of it", (BELOW, BOTH), default=BELOW)
    density: float | None = number(
        "kg/m3",
        "of the half-space, for surface waves (a run has it rigid); left out: density of the spheres",
        1,
        1e5,
        default=None,
    )


# The ranges stand here because `Sphere` is plain physics, which `analysis` uses too. Within them the numbers of the
# deck stay far from underflow and overflow.
_ADHESION = Rule(float, "J/m2", "of two spheres; 0: Hertz contacts", Interval(1e-6, 100, or_zero=True))
SPHERE_RULES = Rules(
    radius=Rule(float, "m", "", Interval(1e-9, 1)),
    youngs_modulus=Rule(float, "Pa", "", Interval(1e3, 1e13)),
    poisson_ratio=Rule(float, "", "", Interval(-1, 0.5, open_low=True)),
    work_of_adhesion=_ADHESION,
    density=Rule(float, "kg/m3", "", Interval(1, 1e5)),
)
LATTICE_SPHERE_RULES = Rules(
    **SPHERE_RULES,
    adhesion_law=Rule(str, "", words_of_laws(), words=tuple(ADHESION_LAWS)),
)
PAIR_RULES = Rules(
    of=ArrayRule(
        int,
        "",
        "two kinds of spheres: 0 for the lattice, n for the n-th [[inclusion]]",
        Interval(0, 10_000_000),
        entries=("kind", "kind"),
    ),
    normal_stiffness=Rule(float, "N/m", _MEASURED, Interval(*_STIFFEST)),
    shear_stiffness=Rule(float, "N/m", _MEASURED, Interval(*_STIFFEST)),
)
DISORDER_RULES = Rules(
    radius=Rule(
        float, "", "relative standard deviation, Gaussian, cut at 3; one-sided in a struck sheet", Interval(0, 0.1)
    ),
    density=Rule(float, "", "relative standard deviation, Gaussian, cut at 3", Interval(0, 0.33)),
    vacancies=Rule(float, "", "share of the free spheres that are left out", Interval(0, 0.99)),
    seed=Rule(int, "", "seed of the random numbers", Interval(0, 2**32 - 1)),
    stiffness=Rule(float, "", "relative standard deviation of contacts, eight classes of spheres", Interval(0, 0.3)),
)
INCLUSION_RULES = Rules(
    rows=rows_rule(),
    every=Rule(int, "", "every n-th of these rows, starting with the first", Interval(1, 10_000_000)),
    spheres=spheres_rule(),
    disc=ArrayRule(
        float,
        "",
        "[row, column, radius in lattice constants]",
        Interval(0, 10_000_000),
        entries=("row", "column", "radius"),
    ),
    half_plane=ArrayRule(
        float,
        "",
        "[row, column, degrees]: spheres left of this line, or on it",
        Interval(-180, 10_000_000),
        entries=("row", "column", "degrees"),
    ),
    share=Rule(float, "", "of the free spheres, at random by disorder.seed", Interval(0, 1)),
    layers=rows_rule("first and last layer along z, counted from 0"),
    **SPHERE_RULES,
    vacancy=Rule(bool, "", "true: these places are empty"),
)
