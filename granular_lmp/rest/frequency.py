"""Wave number of a scene from a wave vector, or from the frequency of the wave in hertz.

The Bloch modes of the lattice turn a frequency into wave numbers, for the mode and direction of the wave. The branch is
sampled over the zone and each extremum is refined, so the branch is monotonic between neighbouring points. There each
sign change of Ω(ξ) − Ω is enclosed.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from itertools import pairwise
from math import pi
from typing import Any

from granular_lmp.crystal.lattice import LATTICES, orientations_of
from granular_lmp.crystal.lattices import HEXAGONAL, Lattice, unit_lattice
from granular_lmp.crystal.mode import Physics
from granular_lmp.crystal.modes import bloch_mode, branches, modes_at, named_in_space, restored
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.walls import Wall
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import SceneError
from granular_lmp.scene.forms import STILL
from granular_lmp.scene.schema import AUTO, shown
from granular_lmp.scene.signals import SIGNALS
from granular_lmp.scene.sources import Source

_POINTS = 60  # points on a branch; its extrema are much farther apart than a sixtieth of the zone
_LOWEST = 1e-9  # rad per row, the smallest wave number of a scene
_HALVINGS = 54  # as many as a double has digits
_THIRDS = 45  # to 1e-8 of the width of a peak, where differences in height are rounding
_SAME = 1e-9  # relative: a zero is found far closer than this, and a jump between branches is far larger


@lru_cache(maxsize=32)
def wavenumbers_at(
    hertz: float,
    sphere: Sphere,
    physics: Physics,
    mode: str,
    degrees: float,
    kind: Lattice = HEXAGONAL,
    wall: Wall | None = None,
) -> tuple[float, ...]:
    """Return the wave numbers at which a mode has a frequency, ascending, in rad per row.

    Parameters
    ----------
    hertz : float
    sphere : Sphere
        Sphere of the lattice at rest.
    physics : Physics
    mode : str
        "L", "TR" or "RT".
    degrees : float
        Direction of the wave, from x towards y.
    kind : Lattice
    wall : Wall, optional
        Wall on which the crystal lies.

    Raises
    ------
    SceneError
        If the frequency lies outside the band of the mode in this direction (the text names the band), or between two
        branches that have the name of the mode.
    """

    def above(wavenumber: float) -> float:
        return hertz_of(kind.vector(wavenumber, degrees), sphere, physics, mode, kind, wall) - hertz

    grid, band = _band(sphere, physics, mode, degrees, kind, wall)
    heights = [each - hertz for each in band]
    if not min(heights) <= 0 <= max(heights):
        low, high = (hertz + extreme for extreme in (min(heights), max(heights)))
        raise SceneError(
            f"wave.frequency = {hertz!r}: must be in the band of {mode} at {degrees:g} degrees from x, "
            f"[{low:.6g}, {high:.6g}] Hz in this lattice"
        )
    found = {at for at, height in zip(grid, heights, strict=True) if height == 0}
    ends = pairwise(zip(grid, heights, strict=True))
    found |= {_zero(above, a, b) for (a, low), (b, high) in ends if low * high < 0}
    # In an oblique direction a name may change from branch to branch, where Ω(ξ) jumps over the frequency
    there = sorted(each for each in found if abs(above(each)) <= _SAME * hertz)
    if not there:
        raise SceneError(
            f"wave.frequency = {hertz!r}: no {mode} wave at {degrees:g} degrees from x has it, as it lies between "
            "branches of this name; give wave.wavenumber"
        )
    return tuple(there)


@lru_cache(maxsize=32)
def _band(
    sphere: Sphere, physics: Physics, mode: str, degrees: float, kind: Lattice, wall: Wall | None
) -> tuple[list[float], list[float]]:
    """Return ascending wave numbers, rad per row, that include the extrema, and their frequencies in hertz."""
    edge, lattice = kind.zone_edge(degrees), unit_lattice(sphere, kind, wall)
    grid = [_LOWEST, *(edge * k / _POINTS for k in range(1, _POINTS + 1))]
    known: dict[float, float] = {}
    if mode in restored(lattice, physics):  # all points at once, except for names by mirror symmetry
        found = branches(lattice, sphere, [kind.vector(each, degrees) for each in grid], physics)
        if mode in found:  # branches in oblique directions are numbered
            known |= zip(grid, (found[mode] / (2 * pi * sphere.time_scale)).tolist(), strict=True)

    def at(wavenumber: float) -> float:
        if wavenumber not in known:
            known[wavenumber] = hertz_of(kind.vector(wavenumber, degrees), sphere, physics, mode, kind, wall)
        return known[wavenumber]

    grid = sorted({*grid, *_extrema(at, grid)})
    return grid, [at(wavenumber) for wavenumber in grid]


def hertz_of(
    vector: WaveVector,
    sphere: Sphere,
    physics: Physics,
    mode: str,
    kind: Lattice = HEXAGONAL,
    wall: Wall | None = None,
) -> float:
    """Return the frequency of a mode in hertz; arguments as of `wavenumbers_at`."""
    lattice = unit_lattice(sphere, kind, wall)
    named = named_in_space(lattice, sphere, vector, physics) if physics.space else {}  # one may be 0 at Γ
    if mode in named:
        return named[mode][0] / (2 * pi * sphere.time_scale)
    several = kind.cell_size > 1 or physics.space
    branches = modes_at(lattice, sphere, vector, physics) if several else []  # one may be 0 at Γ
    found = [each for each in branches if each.name == mode] or [bloch_mode(lattice, sphere, vector, mode, physics)]
    return found[0].frequency / (2 * pi * sphere.time_scale)


def _extrema(function: Callable[[float], float], grid: list[float]) -> list[float]:
    """Return the places of the extrema of a function between the points of a grid."""
    heights = [function(x) for x in grid]
    found = []
    for k in range(1, len(grid) - 1):
        before, after = heights[k] - heights[k - 1], heights[k + 1] - heights[k]
        if before * after < 0:
            found.append(_highest(function, 1 if before > 0 else -1, grid[k - 1], grid[k + 1]))
    return found


def _highest(function: Callable[[float], float], sign: int, low: float, high: float) -> float:
    """Return where sign × function is largest, if it has one peak: each iteration drops a third of the interval."""
    for _ in range(_THIRDS):
        third = (high - low) / 3
        if sign * function(low + third) > sign * function(high - third):
            high -= third
        else:
            low += third
    return (low + high) / 2


def _zero(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function changes its sign between two points, at a zero or a jump, by bisection."""
    rises = function(low) < 0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if (function(middle) < 0) == rises:
            low = middle
        else:
            high = middle
    return (low + high) / 2


def with_placeholder(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the tables with a placeholder for the wave number that later follows from ``wave.frequency``.

    With ``form = "none"`` and sources that have their own frequencies, no wave number is needed.

    Raises
    ------
    SceneError
        If both are given, or if none is given and a source takes its frequency from the wave.
    """
    wave = tables.get("wave")
    if not isinstance(wave, Mapping):
        return tables
    if wave.get("form") in STILL and wave.keys().isdisjoint(("wavenumber", "frequency")):
        _refuse_without_frequency(tables.get("source"))
        return {**tables, "wave": {**wave, "wavenumber": 1.0}}
    if "frequency" not in wave:
        return tables
    if "wavenumber" in wave:
        raise SceneError(
            f"wave.frequency = {shown(wave['frequency'])}: excludes wave.wavenumber = {shown(wave['wavenumber'])}; "
            "give one of the two"
        )
    return {**tables, "wave": {**wave, "wavenumber": 1.0}}


def _refuse_without_frequency(sources: object) -> None:
    """Raise SceneError if, in unchecked tables, a source needs a frequency that nothing declares."""
    for number, each in enumerate(sources if isinstance(sources, list | tuple) else (), 1):
        signal = each.get("signal", Source.signal) if isinstance(each, Mapping) else None
        periodic = isinstance(signal, str) and signal in SIGNALS and "frequency" in SIGNALS[signal].keys
        if periodic and each.keys().isdisjoint(("frequency", "hertz")):
            raise SceneError(
                f"source {number}: frequency: missing; give it, or hertz, or the wave.wavenumber of a mode with its "
                "frequency"
            )


def without_wavevector(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return tables with ``wave.wavevector``, [kx, ky] in rad per lattice constant, as number and direction.

    The lattice constant is the distance between two spheres that touch.

    Raises
    ------
    SceneError
        If the wave vector lies outside the zone, or is given together with a key that it replaces.
    """
    wave = tables.get("wave")
    if not isinstance(wave, Mapping) or "wavevector" not in wave:
        return tables
    pair, rest = wave["wavevector"], {key: value for key, value in wave.items() if key != "wavevector"}
    for key in ("wavenumber", "frequency", "direction"):
        if key in rest:
            raise SceneError(f"wave.wavevector = {shown(pair)}: excludes wave.{key} = {shown(rest[key])}; give one")
    numbers = isinstance(pair, list | tuple) and [
        isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < 1e3 for x in pair
    ]
    if numbers != [True, True] or not any(pair):
        raise SceneError(
            f"wave.wavevector = {shown(pair)}: must be two numbers [kx, ky], not both 0, rad per lattice constant"
        )
    lattice = _lattice_in(tables)
    unit = lattice.column_spacing
    advance = (
        unit * float(pair[0]) + 0.0,
        unit * lattice.row_spacing * float(pair[1]) + 0.0,
    )  # + 0.0 turns -0.0 into 0.0
    vector = WaveVector(*advance, lattice.row_spacing, unit)
    edge = lattice.zone_edge(vector.direction)
    if vector.wavenumber > edge * (1 + 1e-12):
        raise SceneError(
            f"wave.wavevector = {shown(pair)}: must be in the Brillouin zone, which ends at "
            f"{edge / lattice.row_spacing / unit:.6g} in its direction, rad per lattice constant"
        )
    return {**tables, "wave": rest | {"wavenumber": vector.wavenumber, "direction": vector.direction}}


def _lattice_in(tables: Mapping[str, Any]) -> Lattice:
    """Return the lattice that the tables of a scene name; the hexagonal one if the name is missing or unknown."""
    packing = tables.get("packing")
    names = packing if isinstance(packing, Mapping) else {}
    name, orientation = (
        str(names.get(key, other)) for key, other in (("lattice", HEXAGONAL.name), ("orientation", AUTO))
    )
    if known := orientations_of(name):
        name = f"{name} {known[0] if orientation == AUTO else orientation}"
    return LATTICES.get(name, HEXAGONAL)
