"""Patterns of densities that double the frequency of sound or focus it, in LAMMPS, and the resonance that doubles it.

    granular-analysis doubling FOLDER [-o FILE]

FOLDER holds the runs of the case: designed and uniform crystals, each wave with both signs; and in both crystals a weak
longitudinal wave with the wave vector 2k. The spectrum of that wave gives the frequencies of the crystal at 2k. The
uniform crystal has the frequency of the longitudinal branch, far from 2Ω; the pattern moves it to 2Ω.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.runner import script
from granular_analysis.measure.designs import read_off
from granular_analysis.measure.runs import load
from granular_analysis.plotting import legend_above, letter, page

Floats = NDArray[np.float64]
NAMES = {"doubler": "second-harmonic", "second": "second-harmonic", "focus": "motion:right/left"}
SOUND = "sound", "sound-uniform"
FINER = 8  # points of a spectrum per 2π/T


@dataclass(frozen=True)
class Found:
    """Results of the runs.

    Attributes
    ----------
    values : objective of the designed and of the uniform crystal, by name.
    places, densities : places (N, 2) in radii and densities (N,) over the mean, of the first pattern.
    spectra : frequencies in rad/t0, and amplitudes over the largest, of the designed and the uniform crystal.
    doubled : 2Ω, rad/t0.
    wavenumber : wave number of the wave, rad per row.
    """

    values: dict[str, tuple[float, float]]
    places: Floats
    densities: Floats
    spectra: list[tuple[Floats, Floats]]
    doubled: float
    wavenumber: float


def measured(folder: str) -> Found:
    """Return the results of the runs in a folder."""
    there = Path(folder)
    values = {}
    for name, objective in NAMES.items():
        ends = ["", "-opposite"] if objective == "second-harmonic" else [""]
        both = [read_off([load(there / f"{name}{kind}{end}") for end in ends], objective) for kind in ("", "-uniform")]
        values[name] = both[0], both[1]
    first = load(there / "doubler")
    densities = first.scene.packing.table.columns["density"] / first.scene.sphere.density
    spectra = [spectrum(there / each) for each in SOUND]
    return Found(
        values, first.snapshots().rest, densities, spectra, 2 * float(first.info["frequency"]), first.scene.wavenumber
    )


def spectrum(folder: Path) -> tuple[Floats, Floats]:
    """Return the spectrum of the part of a run with the wave vector of its wave: frequencies, relative amplitudes."""
    record = load(folder)
    snapshots = record.snapshots()
    spacing = np.ptp(snapshots.rest[:, 1]) / (record.scene.shape.rows - 1)
    phase = snapshots.rest[:, 1] * record.scene.wavenumber / spacing
    along = np.mean(snapshots.stack("displacement")[:, :, 1] * np.exp(-1j * phase), axis=1)
    count = FINER * len(along)
    sizes = np.abs(np.fft.fft(along * np.hanning(len(along)), count))
    sizes = sizes + sizes[-np.arange(count)]  # waves that run either way
    half = slice(count // 2)
    step = snapshots.tau[1] - snapshots.tau[0]
    return 2 * np.pi * np.fft.fftfreq(count, step)[half], sizes[half] / sizes[half].max()


def table(found: Found) -> str:
    """Return the results as text."""
    lines = []
    for name, (designed, uniform) in found.values.items():
        lines.append(f"{name:10}{designed:10.5g} designed{uniform:12.5g} uniform{designed / uniform:10.4g} times")
    (at, sizes), (other, others) = found.spectra
    lines.append(
        f"2 Omega is {found.doubled:.4f} rad/t0; the frequency at 2k is {at[sizes.argmax()]:.3f} in the pattern, "
        f"{other[others.argmax()]:.3f} in the uniform crystal"
    )
    return "\n".join(lines)


def components(found: Found) -> tuple[Floats, Floats]:
    """Return the largest Fourier components of the density: wave vectors (K, 2) that fit the cell, and |ρ̂| (K,).

    Wave vectors are in rad per lattice constant (two radii) and rad per row (√3 radii); one of each pair ±k is
    returned, as ρ is real.
    """
    x, y = found.places.T
    row = np.rint((y - y.min()) / np.sqrt(3))
    rows, columns = int(row.max()) + 1, int(np.count_nonzero(row == 0))
    across, along = np.meshgrid(
        2 * np.pi * np.arange(-columns // 2, columns // 2 + 1) / columns, 2 * np.pi * np.arange(rows // 2 + 1) / rows
    )
    vectors = np.stack([across.ravel(), along.ravel()], axis=1)
    phases = vectors @ np.stack([x / 2, row])
    return vectors, np.abs(np.exp(-1j * phases) @ (found.densities - found.densities.mean())) / len(x)


def draw(found: Found) -> Figure:
    """Return the figure: the pattern, its Fourier components, and the spectra at 2k."""
    figure = page(5.6)
    grid = figure.add_gridspec(2, 2)
    left, middle = (figure.add_subplot(grid[0, place]) for place in (0, 1))
    right = figure.add_subplot(grid[1, :])
    x, y = found.places.T
    shown = left.scatter(x, y, c=found.densities, s=5, cmap="viridis")
    figure.colorbar(shown, ax=left, label="density / uniform density")
    left.set(aspect="equal", xlabel="$x/R$", ylabel="$y/R$")
    vectors, sizes = components(found)
    middle.scatter(vectors[:, 0], vectors[:, 1], s=500 * sizes, color="black", linewidth=0)
    doubled = 2 * found.wavenumber
    middle.scatter([0, 0], [doubled / 2, doubled], s=40, facecolor="none", edgecolor="C3", label="$k$ and $2k$")
    middle.set(xlabel="$k_x$ (rad per lattice constant)", ylabel="$k_y$ (rad per row)", ylim=(-0.15, 3.6))
    letter((left, middle, right))
    legend_above(middle)
    for (at, sizes), colour, label in zip(found.spectra, ("C3", "black"), ("pattern", "uniform"), strict=True):
        right.plot(at, sizes, color=colour, linewidth=1, label=label)
    right.axvline(found.doubled, color="C0", linestyle="--", linewidth=1, label=r"$2\Omega$")
    right.set(xlim=(0, 1.2), ylim=(0, 1.05), xlabel=r"frequency (rad per $t_0$)", ylabel="longitudinal motion at $2k$")
    right.legend()
    return figure


main = script(__name__, measured, table, draw, ("folder", "folder of the runs of the case"))
