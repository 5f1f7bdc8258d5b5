"""A deck that this package did not write: frequencies over wave numbers of its chain, and its front, and theory.

    granular-analysis own_deck [-o FILE]

LAMMPS runs the deck of the page, with both corrections that ``granular-lmp lint`` suggests. Theory is a chain of equal
beads with a static overlap δ, for waves that are small against δ:

    ω = 2 √(K/m) |sin(ka/2)|,    K = 2 E* √(Rc δ),    c = a √(K/m)
"""

from contextlib import chdir
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.runner import script
from granular_analysis.measure.witness import Witness, witness
from granular_analysis.plotting import letter, page
from granular_analysis.tools.branches import Branches, branches
from granular_lmp.foreign.adopt_dump import adopt_dump
from granular_lmp.foreign.conversion import Known
from granular_lmp.foreign.known import dumps_of, known_of
from granular_lmp.foreign.reading import read
from granular_lmp.lammps.installation import lammps_module
from granular_lmp.runs.front import Front, front
from granular_lmp.runs.unnamed import Unnamed

Floats = NDArray[np.float64]
DECK = Path(__file__).with_name("chain.lmp")
RADIUS, DENSITY, YOUNG, POISSON, SPACING = 4.75e-3, 7800.0, 2e11, 0.3, 9.498e-3  # values in the deck, SI
MASS = 4 / 3 * pi * RADIUS**3 * DENSITY
STIFFNESS = YOUNG / (1 - POISSON**2) * sqrt(RADIUS / 2 * (2 * RADIUS - SPACING))
SOUND = SPACING * sqrt(STIFFNESS / MASS)  # m/s
FAR = 0.4, 0.85  # range of the fit of the front, m: from where it hardly spreads to before the held end reflects it
STRONG = 0.1  # share of the largest power above which peaks are compared


@dataclass(frozen=True)
class Found:
    """Results for the deck: its waves, the arrivals of its front, and its difference from the witness."""

    waves: Branches
    front: Front
    witness: Witness


def adopted(folder: Path) -> Unnamed:
    """Run the deck in a folder, and adopt its output."""
    deck = folder / DECK.name
    deck.write_text(DECK.read_text(encoding="utf-8"), encoding="utf-8")
    reading = read(deck)
    with chdir(folder):
        lmp = lammps_module().lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
        lmp.file(str(deck))
        lmp.close()
    known, _ = known_of(reading, Known())
    return adopt_dump(dumps_of(reading), folder / "run", known)


def measure() -> Found:
    """Run the deck, and return the results."""
    with TemporaryDirectory(prefix="granular-lmp-") as folder:
        crystal = adopted(Path(folder))
        return Found(branches(crystal), front(crystal, origin=2, direction=0.0), witness(crystal))


def frequency(wavenumber: Floats) -> Floats:
    """Return the frequency in Hz at a wave number in rad/m."""
    return np.asarray(SOUND / SPACING / pi * np.abs(np.sin(wavenumber * SPACING / 2)))


def table(found: Found) -> str:
    """Return the lattice, the deviation of frequencies, the speed of the front, and the error of the time step."""
    numbers, peaks, _, power = found.waves.rows[found.waves.rows[:, 3] > STRONG].T
    off, resolution = float(np.sqrt(np.mean((peaks - frequency(numbers)) ** 2))), found.waves.resolution
    far = found.front.between(*FAR)
    speed = np.polyfit(far.arrival, far.distance, 1)[0]
    return "\n".join(
        [
            f"lattice constant       {np.linalg.norm(found.waves.lattice.vectors[0]):.6f} m",
            f"waves, rms deviation   {len(power):4} {off:8.1f} Hz, resolution {resolution:.1f} Hz",
            f"front, sound           {speed:8.2f} {SOUND:8.2f} m/s",
            f"witness, step          {found.witness.error:8.4f} {found.witness.step:8.4f}",
        ]
    )


def draw(found: Found) -> Figure:
    """Return the figure: spectral density and its peaks over wave number, and the front."""
    figure = page(2.9)
    waves, arrivals = figure.subplots(1, 2)
    numbers, rows = found.waves.wavenumbers, found.waves.rows
    shown = found.waves.power / found.waves.power.max(axis=1, keepdims=True)
    waves.pcolormesh(
        numbers * SPACING / pi, found.waves.frequencies / (2e3 * pi), np.log10(shown.clip(1e-4)).T, cmap="Greys",
        shading="nearest", rasterized=True,
    )  # fmt: skip
    waves.plot(numbers * SPACING / pi, frequency(numbers) / 1e3, color="C0", linewidth=1.0, label="theory")
    strong = rows[rows[:, 3] > STRONG]
    waves.plot(strong[:, 0] * SPACING / pi, strong[:, 1] / 1e3, ".", color="C3", label="deck")
    waves.set(xlabel=r"wave number $ka/\pi$", ylabel="frequency (kHz)", ylim=(0, 1.2e-3 * frequency(numbers).max()))
    near = found.front.between(0.0, FAR[1])
    times = near.arrival * 1e3
    arrivals.plot(times, near.distance, ".", color="C3", label="deck")
    arrivals.plot(times, SOUND * near.arrival, color="C0", linewidth=1.0, label="sound")
    arrivals.set(xlabel="arrival (ms)", ylabel="distance (m)")
    letter((waves, arrivals))
    for axes in (waves, arrivals):
        axes.legend(loc="upper left")
    return figure


main = script(__name__, measure, table, draw)
