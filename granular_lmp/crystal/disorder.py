"""Imperfect crystals: spheres of unequal size, density or material, and empty places.

The functions here leave every sphere at its place in the lattice, where it is no longer at rest;
`granular_lmp.crystal.equilibrium` relaxes the crystal.

Sphere s has the radius R (1 + σ g_s) with a Gaussian deviate g_s, which is drawn again if |g_s| > 3. Densities have
separate deviates. The deviates depend only on the seed and the number of spheres: with the same seed, another σ scales
the same deviations, and a larger share of vacancies leaves out the same spheres and more. The deviates come from
NumPy's legacy generator, whose streams are frozen, so a seed gives the same crystal with every version of NumPy.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import FACTORS
from granular_lmp.crystal.search import overlapping
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.sphere_table import NO_TABLE, SphereTable
from granular_lmp.crystal.stiffnesses import CLASSES, WIDEST, Pair, by_level, factors_of, spread
from granular_lmp.errors import CrystalError
from granular_lmp.frozen import dataclass

__all__ = ["Disorder", "Inclusion", "imperfect"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
BOXES = ("box", "fixed")  # boxes in which unequal spheres come to rest
WHOLE, AVALANCHES = WAYS = "whole", "avalanches"  # spheres that each of the last steps to rest moves together
CUT = 3.0  # larger deviates are drawn again
_MATERIAL = ("youngs_modulus", "poisson_ratio", "work_of_adhesion")
# One stream of the generator for each random quantity, so that the quantities are independent
_RADIUS, _DENSITY, _VACANCIES, _INCLUSIONS = range(4)
_STIFFNESS = 2**31  # beyond the streams of all inclusions, which are numbered from _INCLUSIONS on
# Largest overlap at the places in the lattice, in radii of the smaller sphere. With a larger overlap, spheres come to
# rest far from their places, with other neighbours.
LARGEST_OVERLAP = 0.25
_SAME_PLACE = 1e-6  # in radii
# LAMMPS has one stiffness per pair of types, so a deck has a line of 0.3 kB for each pair of materials
MOST_MATERIALS = 100


@dataclass(frozen=True)
class Disorder:
    """Random differences of the spheres of a crystal.

    Attributes
    ----------
    radius, density : float
        Relative standard deviations σ, in [0, 1/3), so that no sphere vanishes. `LARGEST_OVERLAP` limits σ of radii
        further, to about 0.04. Good values: radii of microspheres spread by 0.01 to 0.03.
    vacancies : float
        Share of the free spheres that are left out, in [0, 1).
    seed : int
        0 to 2^32 − 1.
    stiffness : float
        Relative standard deviation of the contact stiffnesses (`granular_lmp.crystal.stiffnesses`).

    Raises
    ------
    CrystalError
        For a value outside these ranges.
    """

    radius: float = 0.0
    density: float = 0.0
    vacancies: float = 0.0
    seed: int = 1
    stiffness: float = 0.0

    def __post_init__(self) -> None:
        limits = {"radius": 1 / CUT, "density": 1 / CUT, "vacancies": 1.0, "stiffness": WIDEST}
        for name, most in limits.items():
            value = getattr(self, name)
            if not 0 <= value < most:
                raise CrystalError(f"disorder.{name} = {value!r}: must be at least 0 and below {most:.4g}")
        if not 0 <= self.seed < 2**32:
            raise CrystalError(f"disorder.seed = {self.seed!r}: must be an integer from 0 to 2^32 - 1")


@dataclass(frozen=True)
class Inclusion:
    """Spheres that differ from the others in a given way, or are missing.

    Attributes
    ----------
    rows : (first, last)
        All spheres in the rows from first to last, counted from 0.
    every : int
        Every n-th of these rows, starting with the first: 2 makes alternating layers of two kinds.
    spheres : sequence of (row, column)
        Single spheres.
    disc : (row, column, radius)
        All spheres whose places are within this radius, in lattice constants, of the place of a sphere.
    half_plane : (row, column, degrees)
        All spheres on a line or left of it. The line runs through the place of a sphere, in this direction from x
        towards y: with 0 degrees, the half-plane is this row and all rows above. The line ends at the sides of a
        periodic cell.
    share : float
        Share of the free spheres, in [0, 1], selected at random by the seed of the disorder.
    layers : (first, last)
        Layers along z, counted from 0, to which the selection is restricted; without other keys, all spheres in them.
        Single spheres and discs need one layer in a crystal of several layers.
    radius, density, youngs_modulus, poisson_ratio, work_of_adhesion : float, optional
        Values that differ, in SI units.
    vacancy : bool
        True if the places are empty.
    """

    rows: Sequence[int] = ()
    every: int = 1
    spheres: Sequence[tuple[int, int]] = ()
    disc: Sequence[float] = ()
    half_plane: Sequence[float] = ()
    share: float = 0.0
    layers: Sequence[int] = ()
    radius: float | None = None
    density: float | None = None
    youngs_modulus: float | None = None
    poisson_ratio: float | None = None
    work_of_adhesion: float | None = None
    vacancy: bool = False

    @property
    def whole_rows(self) -> bool:
        """True if the inclusion contains either all spheres or no sphere of each row in a layer."""
        return not (self.spheres or self.disc or self.half_plane or self.share)

    @property
    def of_material(self) -> dict[str, float]:
        """Elastic constants and work of adhesion that differ, by name."""
        return {name: getattr(self, name) for name in _MATERIAL if getattr(self, name) is not None}


def imperfect(
    lattice: ase.Atoms,
    sphere: Sphere,
    disorder: Disorder | None = None,
    inclusions: Sequence[Inclusion] = (),
    pairs: Sequence[Pair] = (),
    *,
    table: SphereTable = NO_TABLE,
    recorded: int | None = None,
) -> tuple[ase.Atoms, tuple[Sphere, ...]]:
    """Return a lattice with unequal spheres and empty places, with each sphere at its place, and its materials.

    Parameters
    ----------
    lattice : ase.Atoms
        Equal spheres with the arrays ``radius`` (1), ``row``, ``column`` and ``fixed`` (held spheres).
    sphere : Sphere
        The spheres of the lattice.
    disorder : Disorder, optional
        Random differences; by default none.
    inclusions : sequence of Inclusion
        A later inclusion replaces an earlier one. A radius or a density of an inclusion is the mean from which its
        spheres deviate.
    table : SphereTable, optional
        Values at single places. Inclusions replace the values that they declare; random deviations multiply the result.
    pairs : sequence of Pair
        Measured stiffnesses between two kinds. Spheres of a kind in a pair have a separate material.
    recorded : int, optional
        Index of a sphere that must be present: no random vacancy is at its place, and an inclusion must not leave it
        out.

    Returns
    -------
    crystal : ase.Atoms
        Has the arrays of the lattice, and ``density`` (kg/m³), ``material`` and ``site``, the index in the lattice.
        Free spheres that vacancies leave without a neighbour are left out too, because nothing would hold them.
        ``crystal.info["isolated"]`` is their number, ``crystal.info["disorder"]`` has the spreads and the seed, and
        ``crystal.info["factors"]`` has the factors of contacts, if pairs, a table or a spread of stiffnesses need them.
    materials : tuple of Sphere
        Materials by index; the first is the sphere of the lattice.

    Raises
    ------
    CrystalError
        If an inclusion names a place outside the lattice, or changes nothing; if a share is less than half a sphere; if
        a held sphere, the recorded sphere or every free sphere is left out; if two spheres have the same place, or
        overlap by more than `LARGEST_OVERLAP`; if there are more than `MOST_MATERIALS` materials.
    """
    disorder = disorder or Disorder()
    held = np.asarray(lattice.arrays["fixed"], dtype=bool)
    own_radius = table.values("radius", len(lattice), sphere.radius) / sphere.radius
    own_density = table.values("density", len(lattice), float(sphere.density))
    radius, density = own_radius.copy(), own_density.copy()
    material, missing = np.zeros(len(lattice), dtype=int), np.zeros(len(lattice), dtype=bool)
    free = ~held
    if recorded is not None:
        free[recorded] = False
    missing[_drawn(free, disorder.vacancies, disorder.seed, _VACANCIES, "disorder.vacancies")] = True
    kinds, named = [(sphere, 0)], {kind for pair in pairs for kind in pair.of}
    for number, inclusion in enumerate(inclusions):
        _check(inclusion, number)
        chosen = chosen_of(lattice, inclusion, number, disorder.seed)
        if inclusion.vacancy and held[chosen].any():
            raise CrystalError(f"inclusion {number + 1}: leaves out a held sphere; only free ones can be vacancies")
        if inclusion.vacancy and recorded in chosen:
            raise CrystalError(f"inclusion {number + 1}: leaves out the centre sphere, which is recorded")
        missing[chosen] = inclusion.vacancy
        radius[chosen] = own_radius[chosen] if inclusion.radius is None else inclusion.radius / sphere.radius
        density[chosen] = own_density[chosen] if inclusion.density is None else inclusion.density
        other = replace(sphere, **inclusion.of_material)  # type: ignore[arg-type]  # the names are of numbers
        kind = other, number + 1 if number + 1 in named else -(other != sphere)
        if kind not in kinds:
            kinds.append(kind)
        material[chosen] = kinds.index(kind)

    crystal = lattice.copy()
    crystal.set_array("site", np.arange(len(lattice)))
    crystal.arrays["radius"] = radius * _spread(len(lattice), disorder.radius, disorder.seed, _RADIUS)
    density = density * _spread(len(lattice), disorder.density, disorder.seed, _DENSITY)
    crystal.set_array("density", density)
    crystal.set_array("material", material)
    isolated = ~missing & ~held & _alone(lattice, missing) if missing.any() else np.zeros_like(missing)
    if (missing | isolated | held).all() and missing.any():
        raise CrystalError(
            f"disorder.vacancies = {disorder.vacancies!r}: together with the inclusions, no free sphere keeps a "
            "neighbour; leave out fewer spheres"
        )
    crystal = crystal[~(missing | isolated)]
    # Drop unused materials: later inclusions may replace all spheres of an earlier one
    used, place = np.unique(np.append(0, crystal.arrays["material"]), return_inverse=True)
    crystal.arrays["material"] = place[1:]
    crystal.info |= {"disorder": asdict(disorder), "isolated": int(isolated.sum())}
    require_places(crystal)
    materials, numbers = zip(*(kinds[each] for each in used), strict=True)
    if not (pairs or disorder.stiffness or table.factors):
        return crystal, materials
    radii = [sphere.radius, *(sphere.radius if each.radius is None else each.radius for each in inclusions)]
    crystal.info[FACTORS] = factors_of(materials, numbers, radii, pairs)
    levels, level = table.levels(len(lattice))
    _refuse_many(table, len(levels), len(materials), disorder)
    if table.factors:
        crystal.arrays["material"] = len(levels) * crystal.arrays["material"] + level[~(missing | isolated)]
        crystal.info[FACTORS] = by_level(crystal.info[FACTORS], levels)
        materials = tuple(each for each in materials for _ in levels)
    if not disorder.stiffness:
        return crystal, materials
    rank = _stream(disorder.seed, _STIFFNESS).permutation(len(lattice))[~(missing | isolated)]
    crystal.arrays["material"] = CLASSES * crystal.arrays["material"] + rank * CLASSES // len(lattice)
    crystal.info[FACTORS] = spread(crystal.info[FACTORS], disorder.stiffness)
    return crystal, tuple(each for each in materials for _ in range(CLASSES))


def _refuse_many(table: SphereTable, levels: int, kinds: int, disorder: Disorder) -> None:
    """Raise a CrystalError if the stiffness factors of a table make more materials than a deck should have."""
    count = levels * kinds * (CLASSES if disorder.stiffness else 1)
    if table.factors and count > MOST_MATERIALS:
        beside = f" in {CLASSES} classes of disorder.stiffness" if disorder.stiffness else ""
        raise CrystalError(
            f"packing.table = {table.said!r}: {levels} different factors of stiffness, 1 among them, of {kinds} "
            f"material{'s' * (kinds > 1)}{beside} make {count} types of spheres; must be at most {MOST_MATERIALS}: "
            "round the factors"
        )


def _check(inclusion: Inclusion, number: int) -> None:
    """Raise a CrystalError unless an inclusion states which spheres differ and how."""
    name = f"inclusion {number + 1}"
    if not 0 <= inclusion.share <= 1:
        raise CrystalError(f"{name}: share = {inclusion.share!r}: must be from 0 to 1")
    places = (inclusion.rows, inclusion.spheres, inclusion.disc, inclusion.half_plane)
    given = sum((*(len(each) > 0 for each in places), inclusion.share > 0))
    if given > 1 or not given and not len(inclusion.layers):
        raise CrystalError(
            f"{name}: give one of rows, spheres, disc, half_plane and share, or layers, to select the spheres"
        )
    if inclusion.every < 1 or inclusion.every > 1 and not inclusion.rows:
        raise CrystalError(f"{name}: every = {inclusion.every!r}: must be 1 or more, and 1 without rows")
    changes = inclusion.of_material | {
        key: getattr(inclusion, key) for key in ("radius", "density") if getattr(inclusion, key) is not None
    }
    if bool(changes) == inclusion.vacancy:
        allowed = f"radius, density, {', '.join(_MATERIAL)}"
        raise CrystalError(f"{name}: give either vacancy or the values that differ: {allowed}")
    for key, value in changes.items():
        low, high = (-1.0, 0.5) if key == "poisson_ratio" else (0.0, np.inf)
        inside = low <= value < high if key == "work_of_adhesion" else low < value <= high and value < np.inf
        if not inside:
            raise CrystalError(f"{name}: {key} = {value!r}: must be between {low!r} and {high!r}")


def chosen_of(lattice: ase.Atoms, inclusion: Inclusion, number: int, seed: int) -> Integers:
    """Return the indices of the spheres of an inclusion in a lattice; `number` counts inclusions of a scene from 0."""
    within = _of_layers(lattice, inclusion, number)
    if inclusion.share:
        free = within & ~np.asarray(lattice.arrays["fixed"], dtype=bool)
        return _drawn(free, inclusion.share, seed, _INCLUSIONS + number, f"inclusion {number + 1}: share")
    row, column = lattice.arrays["row"], lattice.arrays["column"]
    if inclusion.whole_rows and not len(inclusion.rows):
        return np.flatnonzero(within)
    if len(inclusion.rows):
        in_rows = _in_range(row, inclusion.rows, f"inclusion {number + 1}: rows")
        return np.flatnonzero(within & in_rows & ((row - inclusion.rows[0]) % inclusion.every == 0))
    own = np.flatnonzero(within)
    index = dict(zip(zip(row[own].tolist(), column[own].tolist(), strict=True), own.tolist(), strict=True))
    if len(index) < len(own) and not inclusion.half_plane:
        raise CrystalError(
            f"inclusion {number + 1}: layers = {list(inclusion.layers)}: must be a single layer, [layer, layer], as "
            "each of several layers has a sphere at this row and column"
        )
    named: Sequence[Sequence[float]] = inclusion.spheres or [(inclusion.disc or inclusion.half_plane)[:2]]
    for at_row, at_column in named:
        if (at_row, at_column) not in index:
            raise CrystalError(
                f"inclusion {number + 1}: sphere [{at_row:g}, {at_column:g}]: must be [row, column], from [0, 0] to "
                f"[{row.max()}, {column.max()}]"
            )
    spheres = np.array([index[at_row, at_column] for at_row, at_column in named])
    if inclusion.half_plane:
        angle = np.radians(inclusion.half_plane[2])
        x, y = (lattice.positions - lattice.positions[spheres[0]])[:, :2].T
        return np.flatnonzero(within & (y * np.cos(angle) - x * np.sin(angle) >= -_SAME_PLACE))
    if not inclusion.disc:
        return spheres
    apart = lattice.get_distances(spheres[0], np.arange(len(lattice)), mic=True)
    return np.flatnonzero(within & (apart <= inclusion.disc[2] * np.sort(apart)[1] * (1 + _SAME_PLACE)))


def _of_layers(lattice: ase.Atoms, inclusion: Inclusion, number: int) -> NDArray[np.bool_]:
    """Return which spheres are in the layers of an inclusion, (N,); all spheres if it has no layers."""
    layer = lattice.arrays.get("layer", np.zeros(len(lattice), dtype=int))
    if not len(inclusion.layers):
        return np.ones(len(lattice), dtype=bool)
    return _in_range(layer, inclusion.layers, f"inclusion {number + 1}: layers")


def _in_range(numbers: Integers, ends: Sequence[int], key: str) -> NDArray[np.bool_]:
    """Return which numbers lie between `ends`, inclusive; CrystalError if the ends are not a range of these numbers."""
    first, last = ends
    if not 0 <= first <= last <= numbers.max():
        raise CrystalError(f"{key} = [{first}, {last}]: must be [first, last], from 0 to {numbers.max()}")
    return np.asarray((first <= numbers) & (numbers <= last))


def _stream(seed: int, stream: int) -> "np.random.RandomState":
    """Return a generator with the same numbers in every version of NumPy."""
    return np.random.RandomState([seed, stream])  # because the streams of Generator may change


def _spread(count: int, deviation: float, seed: int, stream: int) -> Floats | float:
    """Return numbers (N,) of mean 1 with a Gaussian deviation; deviates beyond `CUT` are drawn again."""
    if not deviation:
        return 1.0
    random = _stream(seed, stream)
    deviates = random.standard_normal(count)
    while (beyond := np.abs(deviates) > CUT).any():
        deviates[beyond] = random.standard_normal(beyond.sum())
    return 1 + deviation * deviates


def _drawn(free: NDArray[np.bool_], share: float, seed: int, stream: int, name: str) -> Integers:
    """Return a random share of the free spheres; a larger share contains the spheres of a smaller share."""
    if not share:
        return np.empty(0, dtype=int)
    order = _stream(seed, stream).permutation(np.flatnonzero(free))
    count = round(share * len(order))
    if not count:
        raise CrystalError(
            f"{name} = {share!r}: is less than one of {len(order)} free spheres; must be 0, or at least one sphere"
        )
    return order[:count]


def _alone(lattice: ase.Atoms, missing: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which spheres have only missing neighbours in the lattice."""
    i, j, _ = overlapping(lattice)
    there = ~missing[i] & ~missing[j]
    neighbours = np.bincount(i[there], minlength=len(missing)) + np.bincount(j[there], minlength=len(missing))
    return neighbours == 0


def require_places(crystal: ase.Atoms) -> None:
    """Raise a CrystalError if two spheres have the same place, or overlap by more than `LARGEST_OVERLAP`."""
    i, j, vector = overlapping(crystal)
    radius = crystal.arrays["radius"]
    distance = np.linalg.norm(vector, axis=1)
    overlap = (radius[i] + radius[j] - distance) / np.minimum(radius[i], radius[j])
    if not len(i):
        return
    nearest, worst = int(np.argmin(distance)), int(np.argmax(overlap))
    if distance[nearest] < _SAME_PLACE:
        raise CrystalError(f"spheres {i[nearest]} and {j[nearest]}: have the same place; leave one of them out")
    if overlap[worst] > LARGEST_OVERLAP:
        raise CrystalError(
            f"spheres {i[worst]} and {j[worst]}: overlap by {overlap[worst]:.3g} radii at their places in the lattice; "
            f"allowed are at most {LARGEST_OVERLAP}; let radii differ less"
        )
