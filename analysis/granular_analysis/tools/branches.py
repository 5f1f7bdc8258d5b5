"""Frequencies over wave numbers of an unnamed crystal, from a run of anybody's deck that was adopted.

    granular-analysis branches RUN [--direction WAY] [-o FILE]

RUN is what ``granular-lmp adopt DUMP`` made. The lattice is found from the places of the spheres alone; where there is
none, wave numbers are along a line. The table holds the peaks of the spectral density of the velocities, with the share
of the power that moves along the wave: 1 of a longitudinal wave, 0 of a transverse one. ``--harmonics`` fits a
frequency, twice and three times it to the displacements. In a box that is periodic along
the way wave numbers are those that fit; elsewhere a Hann window over the spheres tells apart wave numbers 4π/L apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, radians, sin
from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_analysis.measure.found_lattice import FoundLattice, found_lattice
from granular_analysis.measure.spectral_density import density, peaks, projected
from granular_analysis.plotting import in_one_line, page, parser, save, write_csv
from granular_lmp.runs.unnamed import Unnamed

Floats = NDArray[np.float64]
FIELDS = ("wavenumber", "frequency", "along", "power")
FEWEST = 8  # snapshots: below, the window leaves next to nothing
MOST = 200  # wave numbers
_DIGITS = 6  # of radii and masses, of the largest, by which spheres are of one kind
_SHOWN = 20  # lines of the table
_SILENT = 1e-6  # of the largest power of all wave numbers: less is rounding
_WHOLE = 1e-6  # a number of periods that is whole to this fits into the box


@dataclass(frozen=True)
class Branches:
    """Waves of a crystal along one direction, in SI units (of units lj in these).

    Attributes
    ----------
    lattice : FoundLattice
        Its vectors (d, 3), none where no lattice was found.
    way : (3,) array
        Unit vector of the wave vectors.
    wavenumbers, frequencies : (K,) and (F,) arrays
        rad/m and rad/s.
    power : (K, F) array
        Spectral density, of the largest.
    rows : (P, 4) array
        Peaks: wave number (rad/m), frequency (Hz), share of the power along the wave, and power, of the largest.
    resolution : float
        Two frequencies that differ by more than this, Hz, are told apart.
    fits : bool
        Whether the wave numbers fit into a periodic box; if not, a window over the spheres blurs them.
    """

    lattice: FoundLattice
    way: Floats
    wavenumbers: Floats
    frequencies: Floats
    power: Floats
    rows: Floats
    resolution: float
    fits: bool


def branches(crystal: Unnamed, way: Sequence[float] | Floats | None = None) -> Branches:
    """Return the waves of an unnamed crystal along a direction, by default along its longest side.

    Parameters
    ----------
    crystal : Unnamed
    way : (3,) array, optional

    Raises
    ------
    ValueError
        If there are fewer than 8 snapshots, uneven times, or spheres that all lie in a plane across the way.
    """
    steps = np.diff(crystal.time)
    if len(crystal) < FEWEST:
        raise ValueError(f"{len(crystal)} snapshots; a spectrum takes at least {FEWEST}")
    if not np.allclose(steps, steps[0], rtol=1e-6, atol=0.0):
        raise ValueError(f"snapshots are {steps.min():.6g} to {steps.max():.6g} apart; they must be at even times")
    _, cell, periodic = crystal.cell
    places = crystal.rest
    kinds = _kinds(crystal)
    lattice = found_lattice(places, kinds, cell, periodic)
    ahead = np.eye(3)[np.argmax(np.ptp(places, axis=0))] if way is None else np.array(way, dtype=float)
    ahead /= np.linalg.norm(ahead)
    numbers, weights, fits = _wavenumbers(places, lattice, ahead, cell, periodic)
    phases = np.exp(-1j * np.outer(numbers, places @ ahead)) * weights
    sites = [phases * (lattice.site == each) for each in np.unique(lattice.site)]
    frames = _frame(ahead)
    # Sites of a cell move against one another in optical branches: each is transformed by itself
    parts = [
        density(crystal.time, projected((crystal[k].velocity @ frames.T for k in range(len(crystal))), each))
        for each in sites
    ]
    frequencies = parts[0][0]
    power = np.sum([each for _, each in parts], axis=0)  # (K, 3, F)
    total = power.sum(axis=1)
    largest = float(total.max()) or 1.0
    rows = []
    for number, spectrum, along in zip(numbers, total, power[:, 0], strict=True):
        if spectrum.max() <= _SILENT * largest:
            continue
        for frequency in peaks(frequencies, spectrum):
            at = int(np.argmin(np.abs(frequencies - frequency)))
            rows.append((number, frequency / (2 * pi), along[at] / spectrum[at], spectrum[at] / largest))
    resolution = 2 / float(crystal.time[-1] - crystal.time[0])
    table = np.array(rows).reshape(-1, 4)
    return Branches(lattice, ahead, numbers, frequencies, total / largest, table, resolution, fits)


def _kinds(crystal: Unnamed) -> NDArray[np.intp]:
    """Return the kind of each sphere, counted from 0: its type, radius and, where it is known, its mass."""
    traits = [crystal.types, np.round(crystal.radius / crystal.radius.max(), _DIGITS)]
    if crystal.has_mass:
        traits.append(np.round(crystal.mass / crystal.mass.max(), _DIGITS))
    kinds: NDArray[np.intp] = np.unique(np.stack(traits), axis=1, return_inverse=True)[1].ravel()
    return kinds


def _frame(ahead: Floats) -> Floats:
    """Return three orthogonal unit vectors, the first of them ahead."""
    axis = np.eye(3)[np.argmin(np.abs(ahead))]
    across = np.cross(axis, ahead)
    across /= np.linalg.norm(across)
    frame = np.empty((3, 3))
    frame[:] = ahead, across, np.cross(ahead, across)
    return frame


def _wavenumbers(
    places: Floats, lattice: FoundLattice, ahead: Floats, cell: Floats, periodic: NDArray[np.bool_]
) -> tuple[Floats, Floats, bool]:
    """Return wave numbers up to the edge of the zone, a weight for each sphere, and whether they fit into the box."""
    along = places @ ahead
    edge = lattice.zone_edge(ahead)
    if not np.ptp(along):
        raise ValueError("all spheres lie in one plane across the direction; choose one along which places differ")
    if not np.isfinite(edge):  # no lattice along the way: half a wave between two spheres
        edge = pi * (len(along) - 1) / float(np.ptp(along))
    sides = np.abs(cell @ ahead)[periodic]
    if sides.any():
        smallest = 2 * pi / float(sides.max())
        turns = smallest * sides / (2 * pi)
        if np.abs(turns - np.round(turns)).max() < _WHOLE:
            return _up_to(edge, smallest), np.full(len(along), 1 / len(along)), True
    length = float(np.ptp(along)) * (1 + 1 / max(len(np.unique(np.round(along / np.ptp(along), 6))) - 1, 1))
    weights = 1 - np.cos(2 * pi * (along - along.min() + (length - np.ptp(along)) / 2) / length)
    return _up_to(edge, 2 * pi / length), weights / weights.sum(), False


def _up_to(edge: float, smallest: float) -> Floats:
    """Return the multiples of the smallest wave number up to the edge, every n-th of them where they are many."""
    count = max(int(edge / smallest * (1 + _WHOLE)), 1)
    return np.asarray(smallest * np.arange(1, count + 1)[:: -(-count // MOST)], dtype=np.float64)


def table(found: Branches, in_si: bool) -> str:
    """Return what was found, as text: the lattice, what is resolved, and the strongest waves."""
    units = ("rad/m", "Hz", "m") if in_si else ("rad", "1/time", "length")
    vectors = ["(" + ", ".join(f"{x + 0.0:.6g}" for x in each) + ")" for each in found.lattice.vectors]
    sites = len(np.unique(found.lattice.site))
    lines = [f"lattice of {', '.join(vectors)} {units[2]}, sites in a cell: {sites}" if vectors else "no lattice found"]
    apart = found.wavenumbers[0] * (1 if found.fits else 2)
    lines.append(f"resolution {found.resolution:.4g} {units[1]}, {apart:.4g} {units[0]}")
    lines.append(f"{units[0]:>12} {units[1]:>14} {'along':>7} {'power':>9}")
    strongest = np.sort(np.argsort(-found.rows[:, 3], kind="stable")[:_SHOWN])
    lines += [f"{k:12.6g} {f:14.8g} {share:7.3f} {power:9.2e}" for k, f, share, power in found.rows[strongest]]
    if len(found.rows) > _SHOWN:
        lines.append(f"the strongest {_SHOWN} of {len(found.rows)} waves; the others are in the CSV")
    return "\n".join(lines)


def draw(found: Branches, title: str, in_si: bool) -> Figure:
    """Return the figure of the spectral density, each wave number in units of its largest."""
    figure = page(4.4)
    axes = figure.subplots()
    shown = found.power / found.power.max(axis=1, keepdims=True).clip(_SILENT)
    mesh = axes.pcolormesh(
        found.wavenumbers, found.frequencies / (2 * pi), shown.T, norm=LogNorm(1e-4, 1), cmap="Greys",
        shading="nearest", rasterized=True,
    )  # fmt: skip
    axes.scatter(found.rows[:, 0], found.rows[:, 1], 14, found.rows[:, 2], cmap="coolwarm", vmin=0, vmax=1, zorder=3)
    top = float(found.rows[:, 1].max(initial=found.resolution))
    axes.set(xlabel=f"wave number ({'rad/m' if in_si else 'lj'})", ylabel=f"frequency ({'Hz' if in_si else 'lj'})")
    axes.set(ylim=(0, 1.15 * top))
    axes.set_title(f"{title}: red moves along the wave, blue across it")
    figure.colorbar(mesh, label="spectral density, of the largest at each wave number")
    return figure


def _way(text: str) -> Floats:
    """Return the unit vector of "x", "y", "z" or degrees."""
    if text in ("x", "y", "z"):
        return np.eye(3)["xyz".index(text)]
    degrees = radians(float(text))
    return np.array([cos(degrees), sin(degrees), 0.0])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write figure and CSV."""
    command = parser(__doc__, "branches.png")
    command.add_argument("run", metavar="RUN", help="the folder of adopted dumps")
    command.add_argument(
        "--direction", metavar="WAY", help="x, y, z, or degrees from x towards y (default: the longest side)"
    )
    command.add_argument(
        "--harmonics", type=float, metavar="HZ", help="of a wave of this frequency: its harmonics in the displacements"
    )
    options = command.parse_args(arguments)
    with in_one_line(options.run):
        crystal = Unnamed.load(options.run)
        found = branches(crystal, None if options.direction is None else _way(options.direction))
        harmonics = crystal.harmonics(options.harmonics, found.way) if options.harmonics else {}
    print(table(found, crystal.in_si))
    for name, each in harmonics.items():
        said = ", ".join(f"{number} {value:.4e} ({error:.0e})" for number, (value, error) in each.items())
        print(f"{name:6} rms of all spheres and its error: {said}")
    save(draw(found, crystal.name, crystal.in_si), options.output)
    write_csv(Path(options.output).with_suffix(".csv"), FIELDS, found.rows.tolist())
