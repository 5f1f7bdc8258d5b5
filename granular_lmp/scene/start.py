"""State in which a run begins: displacements from rest and velocities of single spheres, and noise on all.

A scene has the state in a CSV file or as numbers. A file is read together with its scene; afterwards the scene and its
run folder hold the numbers. Its columns are those of ``granular-lmp export``, so the export of one time of a run is a
state, but without the shear of contacts with friction.
"""

from collections.abc import Iterable, Sequence
from dataclasses import field
from math import isfinite, isnan, sqrt
from pathlib import Path
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import CHAIN
from granular_lmp.crystal.scale import LARGEST_OVERLAP_RATIO
from granular_lmp.crystal.search import overlapping
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.places import AtPlaces, place_of, spheres_at
from granular_lmp.scene.schema import Rule, count, flag, number, shown
from granular_lmp.scene.spreadsheets import LENGTHS, TIMES, read, say_understood, value_of

State = Sequence[
    tuple[float, ...]
]  # for each sphere the numbers of COLUMNS, of which two are whole, and perhaps those of IN_SPACE
COLUMNS = ("row", "column", "ux_m", "uy_m", "vx_m_s", "vy_m_s", "spin_rad_s")
IN_SPACE = ("uz_m", "vz_m_s", "spinx_rad_s", "spiny_rad_s")  # further columns for spheres that leave the plane
# Places, behind row and column, of the components of a motion: ux uy uz, vx vy vz, spins about x, y, z
_PARTS = (0, 1, 5, 2, 3, 6, 7, 8, 4)
_OUT_OF_PLANE = [2, 5, 6, 7]
_SPATIAL = {each.partition("_")[0] for each in IN_SPACE}
# Quantities that a file may hold; a time is allowed too, as each sphere stands in the file once
_UNITS: dict[str, dict[str, float]] = {
    **{"row": {"": 1.0}, "column": {"": 1.0}, "t": TIMES, "u": LENGTHS, "spin": {"rad/s": 1.0}},
    "v": {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6},
}
_QUANTITIES = {name: _UNITS[name.rstrip("xyz")] for name in ["t", *(e.partition("_")[0] for e in COLUMNS + IN_SPACE)]}
MOST = 5000  # spheres: the scene file then stays below `granular_lmp.scene.files.LARGEST_FILE`
FARTHEST = (
    1e6  # largest displacement of a state, in radii; LAMMPS sorts the whole box into bins of the size of a sphere
)
SMALLEST, LARGEST = 1e-30, 1e12  # size of any number except 0, in SI: its powers neither overflow nor vanish


@dataclass(frozen=True)
class StateRule(Rule):
    """Rule for a state: the name of a CSV file, or a list of seven or eleven numbers for each sphere."""

    @property
    def allowed(self) -> str:
        """Allowed values in words."""
        return (
            f'a file "NAME.csv" with the columns {",".join(COLUMNS)}, or a list of [{", ".join(COLUMNS)}]; in space '
            f"{', '.join(IN_SPACE)} may follow"
        )

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a state."""
        places = [{"type": "integer", "minimum": 0}] * 2
        numbers = [{"type": "number", "minimum": -LARGEST, "maximum": LARGEST}] * (len(COLUMNS + IN_SPACE) - 2)
        sphere = {"type": "array", "prefixItems": [*places, *numbers], "minItems": 7, "maxItems": 11, "items": False}
        return {
            "anyOf": [{"type": "string", "pattern": r"\.csv$"}, {"type": "array", "items": sphere, "maxItems": MOST}]
        }

    def value(self, value: Any, key: str) -> State:
        """Return a file or a list as tuples of numbers, one for each sphere.

        Raises
        ------
        SceneError
            If the file cannot be read or lacks a column, a value is not a number, or a sphere is listed twice.
        """
        if isinstance(value, str) and value.endswith(".csv"):
            rows: Iterable[tuple[str, Any]] = _read(value, key)
        elif isinstance(value, list | tuple):
            rows = ((f"{key}[{number}]", each) for number, each in enumerate(value))
        else:
            raise SceneError(f"{key} = {shown(value)}: must be {self.allowed}")
        state = [_checked(each, where) for where, each in rows]
        if len(state) > MOST:
            raise SceneError(f"{key}: {len(state)} spheres: must be at most {MOST}")
        found = set()
        for row, column, *_ in state:
            if (row, column) in found:
                raise SceneError(f"{key}: sphere [{row}, {column}]: is there twice; must be there once")
            found.add((row, column))
        return tuple(state)


@dataclass(frozen=True)
class Start:
    """Displacements and velocities of spheres at the start; all other spheres are at rest in their places.

    With ``noise`` v every sphere that is free to move has an additional random velocity along x, along y and, if it
    turns, of its surface. Each component is uniform in ±v; its mean is subtracted, so the total momentum is 0. In a
    chain the velocity is only along y; in space it is also along z and of the surface about x and y.

    With ``touching``, adhering spheres begin with overlap 0, as bodies that meet, and not at rest under their adhesion.
    Their contacts snap in as soon as they close.
    """

    state: State = field(
        default=(), metadata={"rule": StateRule(str, "SI units", "state of single spheres; all others are at rest")}
    )
    noise: float = number("m/s", "largest random velocity of all spheres along each axis", 0, 1e4, default=0.0)
    seed: int = count("seed of the random velocities", 0, 2**32 - 1, default=0)
    touching: bool = flag(
        "true: adhering spheres begin with overlap 0 in place of their overlap at rest", default=False
    )

    @property
    def places(self) -> list[tuple[int, int]]:
        """Row and column of each sphere."""
        return [(int(row), int(column)) for row, column, *_ in self.state]

    def at(self) -> tuple[AtPlaces, ...]:
        """Return the places of the spheres; () if there are none."""
        return (AtPlaces(spheres=tuple(self.places)),) if self.state else ()

    @property
    def motion(self) -> NDArray[np.float64]:
        """Displacements (m), velocities (m/s) and spins (rad/s) of each sphere, (n, 9)."""
        every = len(COLUMNS + IN_SPACE)
        return np.array([each + (0.0,) * (every - len(each)) for each in self.state]).reshape(-1, every)[:, 2:][
            :, _PARTS
        ]

    @property
    def moves(self) -> bool:
        """True if spheres are displaced or move at the beginning."""
        return bool(self.noise or (self.state and self.motion.any()))

    def fastest(self, radius: float) -> float:
        """Return the largest velocity, m/s, including the surface velocity of a turning sphere of this radius."""
        moving, turning = (np.linalg.norm(self.motion[:, part], axis=1) for part in (slice(3, 6), slice(6, 9)))
        own = max(moving.max(initial=0.0), radius * turning.max(initial=0.0))
        return float(own) + 2 * sqrt(2) * self.noise  # minus the mean velocity, which is below the noise

    def random(self, count: int, space: int = 2) -> NDArray[np.float64]:
        """Return random velocities and surface velocities, m/s, of spheres in the order of a crystal, (count, 6)."""
        random, found = np.random.default_rng(self.seed), np.zeros((count, 6))
        moving = [0, 1, 5] if space == 2 else [*range(6)]
        found[:, moving] = random.uniform(-self.noise, self.noise, (count, len(moving)))
        return found

    @property
    def farthest(self) -> float:
        """Largest displacement, m."""
        return float(np.linalg.norm(self.motion[:, :3], axis=1).max(initial=0.0))


def state_in(
    start: Start, crystal: ase.Atoms, radius: float, struck: Sequence[NDArray[np.int64]], *, turns: bool, space: int
) -> NDArray[np.float64]:
    """Return displacements (m), velocities (m/s) and spins (rad/s) of the spheres of a crystal, (N, 9), along x, y, z.

    Parameters
    ----------
    start : Start
    crystal : ase.Atoms
        Spheres at rest, in radii R of the declared sphere.
    radius : float
        R, m.
    struck : sequence of arrays
        Indices of the spheres that have velocities of their own (`granular_lmp.scene.strikers.struck`).
    turns : bool
        True if spheres turn.
    space : int
        Dimensions in which spheres move.

    Raises
    ------
    SceneError
        If the state moves a vacancy or a sphere that cannot move, or presses spheres together too deeply.
    """
    motion = np.zeros((len(crystal), 9))
    if start.noise:
        motion += _noise(start, crystal, radius, struck, turns=turns, space=space)
    return motion + _declared(start, crystal, radius, struck, turns=turns, space=space) if start.state else motion


def _noise(
    start: Start, crystal: ase.Atoms, radius: float, struck: Sequence[NDArray[np.int64]], *, turns: bool, space: int
) -> NDArray[np.float64]:
    """Return the random part of `state_in`, without momentum."""
    free = ~crystal.arrays["fixed"]
    free[np.concatenate([np.empty(0, dtype=int), *struck])] = False
    random = start.random(len(crystal), space) * free[:, None]
    if crystal.info["lattice_name"] == CHAIN.name:
        random[:, 0] = 0.0
    size, density = (crystal.arrays.get(name, np.ones(len(crystal))) for name in ("radius", "density"))
    mass = density * size**3 * free
    random[free, :3] -= mass @ random[:, :3] / mass.sum()
    spins = random[:, 3:] / (radius * size)[:, None] * turns
    return np.column_stack([np.zeros((len(crystal), 3)), random[:, :3], spins])


def _declared(
    start: Start, crystal: ase.Atoms, radius: float, struck: Sequence[NDArray[np.int64]], *, turns: bool, space: int
) -> NDArray[np.float64]:
    """Return the declared part of `state_in`."""
    motion = np.zeros((len(crystal), 9))
    row, column = np.array(start.places).T
    ascending = np.lexsort((column, row))  # in the order of the spheres in the crystal
    try:
        motion[spheres_at((), start.places, crystal, "sphere that moves")] = start.motion[ascending]
    except SceneError as error:
        raise SceneError(f"start.state: {error}", because=error.because) from error
    own, everything = np.isin(np.arange(len(crystal)), np.concatenate([np.empty(0), *struck])), [*range(9)]
    chain = crystal.info["lattice_name"] == CHAIN.name
    refuse_motion(motion, everything, crystal, crystal.arrays["fixed"], "in a held row, which does not move")
    refuse_motion(motion, everything, crystal, own, "in a [[striker]], which has its own velocity")
    if chain:
        refuse_motion(motion, [0, 3], crystal, ~own | own, "in a chain, which nothing holds sideways")
    if space == 2:
        refuse_motion(motion, _OUT_OF_PLANE, crystal, ~own | own, "in the plane; only with a [substrate] can it leave")
    if not turns:
        refuse_motion(
            motion, [6, 7, 8], crystal, ~own | own, "where nothing turns it (effects.friction, effects.rotation)"
        )
    if start.farthest > FARTHEST * radius:
        raise SceneError(
            f"start.state: a displacement of {start.farthest:.4g} m: must be at most {FARTHEST:g} times "
            f"sphere.radius = {radius!r}"
        )
    moved = crystal.copy()
    moved.positions += motion[:, :3] / radius
    i, j, vector = overlapping(moved)
    radii = crystal.arrays["radius"]
    overlap = (radii[i] + radii[j] - np.linalg.norm(vector, axis=1)) / (2 * np.minimum(radii[i], radii[j]))
    if overlap.max(initial=0.0) > LARGEST_OVERLAP_RATIO:
        worst = int(overlap.argmax())
        raise SceneError(
            f"start.state: spheres {place_of(crystal, i[worst])} and {place_of(crystal, j[worst])}: overlap by "
            f"{overlap[worst]:.3g} of the diameter; at most {LARGEST_OVERLAP_RATIO} is allowed"
        )
    return motion


def refuse_motion(
    motion: NDArray[np.float64], columns: list[int], crystal: ase.Atoms, who: NDArray[np.bool_], why: str
) -> None:
    """Raise SceneError if spheres move in a way that they cannot."""
    for sphere, column in np.argwhere(motion[:, columns] * who[:, None] != 0)[:1]:
        name, value = (COLUMNS + IN_SPACE)[2:][_PARTS[columns[column]]], motion[sphere, columns[column]]
        at = place_of(crystal, sphere)
        raise SceneError(
            f"start.state: sphere {at}: {name} = {value:g}: must be 0 for a sphere {why}", because="physics"
        )


def located(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the tables of a scene; the name of the file of its state becomes relative to the current folder."""
    start = tables.get("start")
    if not isinstance(start, dict) or not isinstance(start.get("state"), str):
        return tables
    return tables | {"start": {**start, "state": str(folder / start["state"])}}


def _checked(values: Any, where: str) -> tuple[float, ...]:
    """Return the seven or eleven numbers of a sphere, with row and column as whole numbers."""
    every = COLUMNS + IN_SPACE
    if not isinstance(values, list | tuple) or len(values) not in (len(COLUMNS), len(every)):
        raise SceneError(
            f"{where} = {shown(values)}: must be [{', '.join(COLUMNS)}]; in space {', '.join(IN_SPACE)} too"
        )
    for name, value in zip(every, values, strict=False):
        number = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
        if not number or abs(value) > LARGEST or 0 < abs(value) < SMALLEST:
            raise SceneError(
                f"{where}: {name} = {shown(value)}: must be 0, or from {SMALLEST:g} to {LARGEST:g} in size"
            )
        if name in ("row", "column") and (value < 0 or value != int(value)):
            raise SceneError(f"{where}: {name} = {shown(value)}: must be a whole number, counted from 0")
    return (int(values[0]), int(values[1]), *map(float, values[2:]))


def _read(name: str, key: str) -> Iterable[tuple[str, list[Any]]]:
    """Yield the place of each line in a file, and its numbers in the order of COLUMNS; missing columns are 0."""
    file = f"{key} = {shown(name)}"
    table = read(Path(name), _QUANTITIES, {}, file)
    say_understood(table)
    names = [each.quantity for each in table.columns]
    for needed in COLUMNS[:2]:
        if needed not in names:
            raise SceneError(f"{file}: column {needed}: missing; must have row, column and any of {COLUMNS[2:]}")
    ways = [each.partition("_")[0] for each in (COLUMNS + IN_SPACE if set(names) & _SPATIAL else COLUMNS)]
    if not set(names) & set(ways[2:]):
        raise SceneError(f"{file}: must have one of the columns {', '.join(COLUMNS[2:])}: without them nothing moves")
    for line, cells in table.rows:
        said = {
            each.quantity: cell if isnan(value_of(cell)) else value_of(cell) * _QUANTITIES[each.quantity][each.unit]
            for each, cell in zip(table.columns, cells, strict=True)
        }
        yield f"{file}: line {line}", [said.get(each, 0.0) for each in ways]
