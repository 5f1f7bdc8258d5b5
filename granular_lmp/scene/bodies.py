"""Spheres of a scene and the bodies they touch: ranges of constants, ``[contact]``, ``[[pair]]``, ``[substrate]``.

The records of spheres and imperfections belong to other rooms, so that their rules stand here.
"""

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, words_of_laws
from granular_lmp.crystal.walls import BELOW, BOTH
from granular_lmp.frozen import dataclass
from granular_lmp.scene.places import rows_rule, spheres_rule
from granular_lmp.scene.schema import ArrayRule, Interval, Rule, Rules, choice, number

_MEASURED, _STIFFEST = "measured, at rest; left out: from the moduli", (1e-6, 1e12)
_STIFFNESS = ("N/m", _MEASURED, *_STIFFEST)


@dataclass(frozen=True)
class Contact:
    """Measured stiffnesses of the contact at rest of two spheres of the lattice, in place of those of their moduli.

    The law's force is scaled at the same overlap: a contact at rest keeps its overlap, and adhesion its share.
    """

    normal_stiffness: float | None = number(*_STIFFNESS, default=None)
    shear_stiffness: float | None = number(*_STIFFNESS, default=None)


@dataclass(frozen=True)
class Substrate:
    """A rigid half-space under a crystal, its face across z, on which the spheres of the first layer adhere.

    Its contact with a sphere has the law of two spheres (`granular_lmp.crystal.walls`), E* and w of both materials, and
    measured stiffnesses in place of computed ones. With ``sides = "both"`` another one lies on the last layer.
    """

    youngs_modulus: float = number("Pa", "of the half-space", 1e3, 1e13)
    poisson_ratio: float = number("", "of the half-space", -1, 0.5, open_low=True)
    work_of_adhesion: float = number("J/m2", "of two bodies of its material; to spheres the geometric mean", 1e-6, 100)
    normal_stiffness: float | None = number(*_STIFFNESS, default=None)
    shear_stiffness: float | None = number(*_STIFFNESS, default=None)
    sides: str = choice("under the crystal, or on both sides of it", (BELOW, BOTH), default=BELOW)
    density: float | None = number(
        "kg/m3",
        "of the half-space, for surface waves; rigid in a run; left out: that of the spheres",
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
        "two kinds of spheres: 0 those of the lattice, n those of the n-th [[inclusion]]",
        Interval(0, 10_000_000),
        entries=("kind", "kind"),
    ),
    normal_stiffness=Rule(float, "N/m", _MEASURED, Interval(*_STIFFEST)),
    shear_stiffness=Rule(float, "N/m", _MEASURED, Interval(*_STIFFEST)),
)
DISORDER_RULES = Rules(
    radius=Rule(
        float, "", "relative standard deviation, Gaussian, cut at 3; of a struck sheet: one-sided", Interval(0, 0.1)
    ),
    density=Rule(float, "", "relative standard deviation, Gaussian, cut at 3", Interval(0, 0.33)),
    vacancies=Rule(float, "", "share of the free spheres that is left out", Interval(0, 0.99)),
    seed=Rule(int, "", "of the random numbers", Interval(0, 2**32 - 1)),
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
        "[row, column, degrees]: left of a line, or on it",
        Interval(-180, 10_000_000),
        entries=("row", "column", "degrees"),
    ),
    share=Rule(float, "", "of the free spheres, at random by disorder.seed", Interval(0, 1)),
    layers=rows_rule("first and last layer along z, counted from 0"),
    **SPHERE_RULES,
    vacancy=Rule(bool, "", "the places are empty"),
)
