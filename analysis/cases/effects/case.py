"""The second harmonic under each effect: its amplitude over wave number, from LAMMPS and from theory.

    granular-analysis effects SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep of one scene over the wave number (``granular-lmp sweep``); its runs may lack
rotation, follow the incremental law, be held by compression or damped, and are named by that. Marks are LAMMPS. Above,
the amplitude of the generated wave, by least squares, over the closed form (lines), where that holds the physics of
the runs. In the middle, for damped runs, which have no closed form, and for the first sweep, the root mean square of p
over the run, which has no fit in it, over the exact lattice. Below, the relative difference of p from that lattice: the
error of the time step, of second order but for the incremental law and dashpots, where LAMMPS's is of first order.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.runner import script
from granular_analysis.measure.runs import sweep
from granular_analysis.measure.signals import measured_amplitude
from granular_analysis.plotting import page
from granular_analysis.theory.catalogue import OBLIQUE, missing
from granular_analysis.theory.choice import holding, traits_of, trajectory, wave_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.wave import Wave, generated, nonlinearity
from granular_lmp.runs.record import Record

# Told apart by marker and dashes without colour.
STYLES: tuple[dict[str, Any], ...] = (
    {"color": "black", "marker": "o", "linestyle": "-"},
    {"color": "C3", "marker": "s", "linestyle": "--"},
    {"color": "C0", "marker": "^", "linestyle": "-."},
    {"color": "C2", "marker": "x", "linestyle": ":"},
    {"color": "C1", "marker": "v", "linestyle": (0, (5, 1, 1, 1))},
)


def name(contact: Contact) -> str:
    """Return the departures of a contact from that of the paper, in words."""
    parts = {
        "without rotation": not contact.rotation,
        "without shear": not contact.shear,
        "incremental law": contact.law == "incremental",
        "compression for adhesion": contact.prestress == 1,
        "JKR adhesion": contact.adhesion_law == "jkr",
        "viscous damping": contact.viscosity > 0,
        "restitution": contact.restitution is not None,
    }
    return ", ".join(part for part, there in parts.items() if there) or "as the paper"


def strength(p: NDArray[np.float64], wave: Wave) -> float:
    """Root mean square of p, in |ε| D0."""
    return float(np.sqrt(np.mean(p**2)) / abs(nonlinearity(wave.contact, wave.amplitude)))


def amplitudes(records: Sequence[Record]) -> tuple[list[float], list[float]]:
    """Wave numbers and amplitudes of the generated wave in |ε| D0, of the runs where it can be measured."""
    found = []
    for record in records:
        with suppress(TheoryError):
            wave = wave_of(record)
            size = measured_amplitude(record, wave)[0] / nonlinearity(wave.contact, wave.amplitude)
            found.append((wave.mode.wavenumber, abs(size)))
    return [xi for xi, _ in found], [size for _, size in found]


def curve(wave: Wave) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return `amplitudes` by theory, |P̃1|/2 over the zone, in the physics of one wave."""
    xis = np.linspace(0.02, np.pi - 0.02, 1500)
    return xis, np.abs(generated(wave.mode.name, xis, wave.contact) / nonlinearity(wave.contact, 1.0))


def deviations(records: Sequence[Record]) -> list[float]:
    """Return |p − p_lattice|/|p_lattice| over each run, by the exact lattice."""
    exact = [trajectory("exact-lattice", wave_of(record), record.tau)[0] for record in records]
    return [float(np.linalg.norm(r.p - p) / np.linalg.norm(p)) for r, p in zip(records, exact, strict=True)]


def table(sweeps: Sequence[Sequence[Record]]) -> str:
    """Return a line for each sweep: median and largest deviation of p from the exact lattice."""
    lines = [f"{'contact':28}{'runs':>6}{'median':>10}{'largest':>10}"]
    for records in sweeps:
        off = deviations(records)
        lines.append(f"{name(wave_of(records[0]).contact):28}{len(off):6d}{np.median(off):10.2e}{max(off):10.2e}")
    return "\n".join(lines)


def draw(sweeps: Sequence[Sequence[Record]]) -> Figure:
    """All sweeps in three panels over the wave number."""
    figure = page(7.6)
    above, middle, below = figure.subplots(3, 1, sharex=True, height_ratios=(3, 1.5, 1.2))
    for number, (records, style) in enumerate(zip(sweeps, STYLES, strict=False)):
        wave = wave_of(records[0])
        line = {key: style[key] for key in ("color", "linestyle")}
        marks = {"color": style["color"], "marker": style["marker"], "linestyle": "none", "markersize": 4.5}
        label = name(wave.contact)
        xis = [record.scene.wavenumber for record in records]
        exact = [trajectory("exact-lattice", wave_of(record), record.tau)[0] for record in records]
        closed = "second-order" in holding(wave)
        if closed:
            above.semilogy(*curve(wave), **line, linewidth=1.2, label=label)
            above.semilogy(*amplitudes(records), **marks, markerfacecolor="white")
        if number == 0 or not closed:
            middle.semilogy(xis, [strength(p, wave) for p in exact], **line, linewidth=1.2, label=label)
            middle.semilogy(xis, [strength(record.p, wave) for record in records], **marks, markerfacecolor="white")
        below.semilogy(xis, deviations(records), **{**marks, "markersize": 3.5})
    first = sweeps[0][0]
    wave, end = wave_of(first), first.tau[-1]
    above.set(
        ylim=(1e-5, 1e3),
        ylabel=r"generated wave $|\tilde P_1|/2$  ($|\epsilon| D_0$)",
        title=rf"{wave.mode.name} wave, $D_0$ = {wave.amplitude:g} $\Delta_0$: marks LAMMPS, lines theory",
    )
    above.legend()
    middle.set(ylabel=rf"rms of $p$, $\tau \leq {end:g}$" + "\n" + r"($|\epsilon| D_0$)")
    middle.legend()
    below.set(xlim=(0, np.pi), xlabel=r"wave number $\xi$ (rad per row)", ylabel="difference of $p$\nfrom the lattice")
    return figure


def measure(folders: Sequence[str]) -> list[list[Record]]:
    """Return the runs of each sweep.

    Raises ValueError for more than can be told apart, and for runs that the exact lattice along y leaves out.
    """
    if len(folders) > len(STYLES):
        raise ValueError(f"{len(folders)} sweeps; at most {len(STYLES)} can be told apart")
    sweeps = [sweep(folder) for folder in folders]
    for record in (record for records in sweeps for record in records):
        if left_out := missing("exact-lattice", traits_of(record)):
            raise ValueError(f"{record.folder}: the exact lattice leaves out {', '.join(left_out)}")
        if OBLIQUE in traits_of(record):
            raise ValueError(f"{record.folder}: its wave is not along y, as those drawn are")
    return sweeps


main = script(__name__, measure, table, draw, ("folders", f"sweeps, at most {len(STYLES)}"))
