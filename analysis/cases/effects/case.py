"""Second harmonic with each effect on or off: its amplitude over wave number, from LAMMPS and from theory.

    granular-analysis effects SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep of one scene over the wave number (``granular-lmp sweep``). Its runs may lack
rotation, use the incremental law, or be held by compression or damped; they are named accordingly. Marks are LAMMPS.
Top: amplitude of the generated wave, by least squares, and the closed form (lines) if it holds the physics of the runs.
Middle, for damped runs, which have no closed form, and for the first sweep: root mean square of p over the run, without
a fit, and the same of the exact lattice (lines). Bottom: relative difference of p from the exact lattice. This is the
error of the time step, of second order, or of first order with the incremental law and dashpots.
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

# Marker and dashes distinguish the sweeps without colour
STYLES: tuple[dict[str, Any], ...] = (
    {"color": "black", "marker": "o", "linestyle": "-"},
    {"color": "C3", "marker": "s", "linestyle": "--"},
    {"color": "C0", "marker": "^", "linestyle": "-."},
    {"color": "C2", "marker": "x", "linestyle": ":"},
    {"color": "C1", "marker": "v", "linestyle": (0, (5, 1, 1, 1))},
)


def name(contact: Contact) -> str:
    """Return the differences of a contact from that of the paper, in words."""
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
    """Return the root mean square of p, in |ε| D0."""
    return float(np.sqrt(np.mean(p**2)) / abs(nonlinearity(wave.contact, wave.amplitude)))


def amplitudes(records: Sequence[Record]) -> tuple[list[float], list[float]]:
    """Return wave numbers and amplitudes of the generated wave, in |ε| D0, of the runs in which it is measurable."""
    found = []
    for record in records:
        with suppress(TheoryError):
            wave = wave_of(record)
            size = measured_amplitude(record, wave)[0] / nonlinearity(wave.contact, wave.amplitude)
            found.append((wave.mode.wavenumber, abs(size)))
    return [xi for xi, _ in found], [size for _, size in found]


def curve(wave: Wave) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return wave numbers over the zone and amplitudes |P̃1|/2 of theory, with the physics of one wave."""
    xis = np.linspace(0.02, np.pi - 0.02, 1500)
    return xis, np.abs(generated(wave.mode.name, xis, wave.contact) / nonlinearity(wave.contact, 1.0))


def deviations(records: Sequence[Record]) -> list[float]:
    """Return the relative L2 difference |p − p_lattice|/|p_lattice| of each run from the exact lattice."""
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
    """Return the figure of all sweeps, three panels over the wave number."""
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

    Raises ValueError for more sweeps than there are marks, and for runs that the exact lattice along y leaves out.
    """
    if len(folders) > len(STYLES):
        raise ValueError(f"{len(folders)} sweeps; at most {len(STYLES)} fit into one figure")
    sweeps = [sweep(folder) for folder in folders]
    for record in (record for records in sweeps for record in records):
        if left_out := missing("exact-lattice", traits_of(record)):
            raise ValueError(f"{record.folder}: the exact lattice leaves out {', '.join(left_out)}")
        if OBLIQUE in traits_of(record):
            raise ValueError(f"{record.folder}: the wave must run along y")
    return sweeps


main = script(__name__, measure, table, draw, ("folders", f"sweeps, at most {len(STYLES)}"))
