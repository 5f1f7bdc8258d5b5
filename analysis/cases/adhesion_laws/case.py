"""The same crystal with the adhesion laws DMT and JKR: forces, second harmonic, resonance and antiresonance.

    granular-analysis adhesion_laws SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep of TR waves over ``sphere.adhesion_law`` and wave number, and over two time steps h
and h/2 for Richardson's extrapolation; ``make adhesion`` makes them. The table compares the second harmonic of the runs
with theory, and gives the wave numbers of resonance and antiresonance from the runs (`cases.spectrum.points`) and from
theory. The two lower panels are theory alone, in the paper's geometry.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.runner import script
from cases.spectrum.case import refuse
from cases.spectrum.points import Point, extrapolated, locate_antiresonance, locate_resonance, point
from granular_analysis.plotting import SILICA, legend_above, letter, page
from granular_analysis.theory.adhesion import Adhesion
from granular_analysis.theory.choice import wave_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import antiresonance, generated, nonlinearity, resonance
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
COLOURS: Final[dict[Adhesion, str]] = {"dmt": "black", "jkr": "C3"}
POINTS = 50  # points on each line of theory in the lower panels
# k1 Δ0 of a contact without a load, in πwRc; and its Δ0, over that of the DMT law
UNITS: Final[dict[Adhesion, tuple[float, float]]] = {"dmt": (3.0, 1.0), "jkr": (1.8, 3 ** (-1 / 3))}


def force(law: Adhesion, overlap: Floats) -> Floats:
    """Return the repulsive force, in πwRc, of two spheres at overlaps in Δ0 of the DMT law; nan without a contact."""
    adhesion = Contact(SILICA, adhesion_law=law).adhesion
    size, length = UNITS[law]
    own = overlap / length
    inside = np.maximum(own, adhesion.least_overlap)
    return np.where(own < adhesion.least_overlap, np.nan, -size * adhesion.pull(inside, adhesion.radius(inside)))


def by_law(records: Sequence[Record]) -> dict[Adhesion, list[Record]]:
    """Return the runs of each law by wave number, with pairs of steps extrapolated.

    If two cells have the same wave, the last is taken.

    Raises
    ------
    ValueError
        If runs of one law have different contacts, waves are not TR, or `cases.spectrum.points` refuses a run.
    """
    groups: dict[Adhesion, list[Record]] = {}
    for record in records:
        if record.scene.require_wave().mode != "TR":
            raise ValueError(f"{record.folder}: wave.mode = {record.scene.require_wave().mode!r}: must be 'TR'")
        groups.setdefault(wave_of(record).contact.adhesion_law, []).append(record)
    for runs in groups.values():
        refuse(runs)
    return {
        law: sorted({round(each.scene.wavenumber, 9): each for each in extrapolated(runs)}.values(), key=_wavenumber)
        for law, runs in sorted(groups.items())
    }


def _wavenumber(record: Record) -> float:
    return record.scene.wavenumber


def table(groups: Mapping[Adhesion, Sequence[Record]]) -> str:
    """Return the deviation of the runs from theory for each law, and both wave numbers from runs and theory."""
    lines = [f"{'law':5}{'kappa':>10}{'runs':>6}{'deviation, median':>19}{'largest':>10}"]
    for law, records in groups.items():
        off = np.abs([point(record).deviation for record in records])
        kappa = wave_of(records[0]).contact.kappa
        lines.append(f"{law:5}{kappa:10.6f}{len(off):6}{np.median(off):19.1e}{off.max():10.1e}")
    lines.append(f"\n{'law':5}{'':15}{'from the runs':>21}{'theory':>12}{'difference':>12}")
    for law, records in groups.items():
        contact = wave_of(records[0]).contact
        found = {
            "resonance": (locate_resonance(records), resonance(contact) or np.nan),
            "antiresonance": (locate_antiresonance(map(point, records)), antiresonance(contact) or np.nan),
        }
        for name, ((place, error), expected) in found.items():
            lines.append(f"{law:5}{name:15}{place:11.6f} ±{error:8.1e}{expected:12.6f}{place - expected:12.1e}")
    return "\n".join(lines)


def draw(groups: Mapping[Adhesion, Sequence[Record]]) -> Figure:
    """Return the figure: forces, spectrum of runs and theory, and resonance and antiresonance of theory."""
    figure = page(6.4)
    (forces, spectrum), (ratios, pressed) = figure.subplots(2, 2)
    _draw_forces(forces)
    for law, records in groups.items():
        _draw_spectrum(spectrum, law, [point(record) for record in records], wave_of(records[0]).contact)
    spectrum.set(xlabel=r"wave number $\xi$ (rad per row)", xlim=(0, np.pi), ylim=(3e-6, 300))
    spectrum.set(ylabel=r"generated wave $|\tilde P_1|/2$  ($|\epsilon| D_0$)")

    nu = np.linspace(-0.99, 0.5, POINTS)
    _draw_places(ratios, nu, {law: [Contact(each, adhesion_law=law) for each in nu] for law in COLOURS})
    ratios.set(xlabel=r"Poisson's ratio $\nu$")
    share = np.linspace(0, 0.9999, POINTS)
    contacts = {law: [Contact(SILICA, adhesion_law=law, prestress=each) for each in share] for law in COLOURS}
    _draw_places(pressed, share, contacts)
    pressed.set(xlabel=r"share $F_0/(F_0+F)$ of an outer force")
    letter((forces, spectrum, ratios, pressed))
    for axes in (forces, spectrum, ratios):
        legend_above(axes, 2)
    return figure


def _draw_forces(axes: Axes) -> None:
    overlap = np.linspace(-0.45, 2.0, 2001)
    for law, colour in COLOURS.items():
        axes.plot(overlap, force(law, overlap), color=colour, label=law.upper())
        axes.plot(UNITS[law][1], 0.0, "o", color=colour)
    axes.axhline(0, color="0.7", linewidth=0.8, zorder=0)
    axes.set(xlabel=r"overlap, in $\Delta_0$ of DMT", ylabel=r"force ($\pi w R_c$)")


def _draw_spectrum(axes: Axes, law: Adhesion, points: Sequence[Point], contact: Contact) -> None:
    grid = np.linspace(0.02, np.pi - 0.02, 4000)
    curve = np.abs(generated("TR", grid, contact) / nonlinearity(contact, 1.0))
    axes.semilogy(grid, curve, color=COLOURS[law], linewidth=1, label=f"{law.upper()}, theory")
    marks = {"markersize": 4, "color": COLOURS[law], "markerfacecolor": "white", "label": f"{law.upper()}, LAMMPS"}
    axes.semilogy([each.wavenumber for each in points], [abs(each.value) for each in points], "o", **marks)


def _draw_places(axes: Axes, over: Floats, contacts: Mapping[Adhesion, Sequence[Contact]]) -> None:
    for law, these in contacts.items():
        places = {
            ("resonance", "-"): [resonance(each) or np.nan for each in these],
            ("antiresonance", "--"): [antiresonance(each) or np.nan for each in these],
        }
        for (name, dashes), values in places.items():
            axes.plot(over, values, dashes, color=COLOURS[law], label=f"{law.upper()}, {name}")
    axes.set(ylabel=r"$\xi$ (rad per row)", ylim=(1, np.pi))


main = script(__name__, by_law, table, draw, ("sweeps", "sweeps over sphere.adhesion_law"))
