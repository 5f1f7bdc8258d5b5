"""Frequencies over wave numbers of an unnamed crystal, from an adopted run of any deck.

    granular-analysis branches RUN [--direction WAY] [--harmonics HZ] [-o FILE]

RUN is a folder made by ``granular-lmp adopt DUMP``. The lattice is found from the places of the spheres alone; without
one, wave numbers are along a line. The table holds the peaks of the spectral density of the velocities, with the share
of the power that moves along the wave: 1 for a longitudinal wave, 0 for a transverse one. ``--harmonics`` fits a
frequency, its double and its triple to the displacements. If the box is periodic along the direction, wave numbers are
those that fit the box; otherwise a Hann window over the spheres resolves wave numbers 4π/L apart, with L the length of
the crystal.
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
FEWEST = 8  # fewest snapshots; with fewer the window leaves hardly any
MOST = 200  # largest number of wave numbers
_DIGITS = 6  # decimals of radius and mass, over the largest, that decide whether spheres are of one kind
_SHOWN = 20  # lines of the table
_SILENT = 1e-6  # share of the largest power of all wave numbers below which power is rounding
_WHOLE = 1e-6  # a wave fits the box if its number of periods is whole to this


@dataclass(frozen=True)
class Branches:
    """Waves of a crystal along one direction, in SI units; for a dump in units lj, in lj.

    Attributes
    ----------
    lattice : FoundLattice
        Lattice; without vectors if none was found.
    way : (3,) array
        Unit vector of the wave vectors.
    wavenumbers, frequencies : (K,) and (F,) arrays
        Wave numbers (rad/m) and angular frequencies (rad/s).
    power : (K, F) array
        Spectral density, over its largest value.
    rows : (P, 4) array
        Peaks: wave number (rad/m), frequency (Hz), share of the power along the wave, and power over the largest.
    resolution : float
        Frequencies that differ by more than this, Hz, are resolved.
    fits : bool
        True if the wave numbers fit a periodic box; otherwise a window over the spheres broadens them.
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
        Direction of the wave vectors, of any length.

    Raises
    ------
    ValueError
        If there are fewer than 8 snapshots, if their times are not equally spaced, or if all spheres lie in a plane
        across the direction.
    """
    steps = np.diff(crystal.time)
    if len(crystal) < FEWEST:
        raise ValueError(f"{len(crystal)} snapshots; a spectrum needs at least {FEWEST}")
    if not np.allclose(steps, steps[0], rtol=1e-6, atol=0.0):
        raise ValueError(f"snapshots are {steps.min():.6g} to {steps.max():.6g} apart; must be equally spaced in time")
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
    # Sites of a cell move against one another in optical branches, so each site is transformed separately
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
    """Return the kind of each sphere, from 0: spheres of one kind share type, radius and, if known, mass."""
    traits = [crystal.types, np.round(crystal.radius / crystal.radius.max(), _DIGITS)]
    if crystal.has_mass:
        traits.append(np.round(crystal.mass / crystal.mass.max(), _DIGITS))
    kinds: NDArray[np.intp] = np.unique(np.stack(traits), axis=1, return_inverse=True)[1].ravel()
    return kinds


def _frame(ahead: Floats) -> Floats:
    """Return three orthogonal unit vectors as rows, `ahead` first."""
    axis = np.eye(3)[np.argmin(np.abs(ahead))]
    across = np.cross(axis, ahead)
    across /= np.linalg.norm(across)
    frame = np.empty((3, 3))
    frame[:] = ahead, across, np.cross(ahead, across)
    return frame


def _wavenumbers(
    places: Floats, lattice: FoundLattice, ahead: Floats, cell: Floats, periodic: NDArray[np.bool_]
) -> tuple[Floats, Floats, bool]:
    """Return wave numbers up to the edge of the zone, a weight for each sphere, and whether the waves fit the box."""
    along = places @ ahead
    edge = lattice.zone_edge(ahead)
    if not np.ptp(along):
        raise ValueError("all spheres lie in one plane across the direction; choose another direction")
    if not np.isfinite(edge):  # no lattice along the direction: half a wavelength between two spheres
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
    """Return the multiples of the smallest wave number up to the edge; if there are more than 200, every n-th."""
    count = max(int(edge / smallest * (1 + _WHOLE)), 1)
    return np.asarray(smallest * np.arange(1, count + 1)[:: -(-count // MOST)], dtype=np.float64)


def table(found: Branches, in_si: bool) -> str:
    """Return the lattice, the resolution and the strongest waves as text."""
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
    """Return the figure of the spectral density, over the largest value at each wave number."""
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
    axes.set_title(f"{title}: dots red if motion is along the wave, blue if across")
    figure.colorbar(mesh, label="spectral density / its maximum at each wave number")
    return figure


def _way(text: str) -> Floats:
    """Return the unit vector along "x", "y" or "z", or at an angle in degrees from x towards y."""
    if text in ("x", "y", "z"):
        return np.eye(3)["xyz".index(text)]
    degrees = radians(float(text))
    return np.array([cos(degrees), sin(degrees), 0.0])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write figure and CSV."""
    command = parser(__doc__, "branches.png")
    command.add_argument("run", metavar="RUN", help="folder of adopted dumps")
    command.add_argument(
        "--direction", metavar="WAY", help="x, y, z, or degrees from x towards y (default: the longest side)"
    )
    command.add_argument(
        "--harmonics", type=float, metavar="HZ", help="print harmonics of a wave of this frequency in the displacements"
    )
    options = command.parse_args(arguments)
    with in_one_line(options.run):
        crystal = Unnamed.load(options.run)
        found = branches(crystal, None if options.direction is None else _way(options.direction))
        harmonics = crystal.harmonics(options.harmonics, found.way) if options.harmonics else {}
    print(table(found, crystal.in_si))
    for name, each in harmonics.items():
        said = ", ".join(f"{number} {value:.4e} ({error:.0e})" for number, (value, error) in each.items())
        print(f"{name:6} rms over all spheres (error): {said}")
    save(draw(found, crystal.name, crystal.in_si), options.output)
    write_csv(Path(options.output).with_suffix(".csv"), FIELDS, found.rows.tolist())
