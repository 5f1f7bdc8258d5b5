"""Scattering of a wave by one defect: scattered field and scattering width in LAMMPS, in the network and in theory.

    granular-analysis defects PERFECT DEFECT... [-o FILE]

PERFECT and each DEFECT are run folders of one scene. The crystal of PERFECT is perfect; that of a DEFECT has one
inclusion of one sphere, a vacancy or another density. All runs have snapshots of all spheres (``output.particles``);
``make disorder`` makes them. The scattered field is the difference of the two runs. Its energy E grows with the
incident flux through the scattering width W, the cross-section in two dimensions:

    E(τ) = W v_g ε (τ − τ0),    ε: energy of the incident wave per area, v_g: its group speed.

E is twice the kinetic energy. W is the slope of a line, with oscillations at 2Ω, fitted to E from `SETTLED` on. The
network (`granular_analysis.theory.network`), started from the first snapshots of the same runs, gives a second W; for
a heavy sphere a closed form, `cases.defects.born.impurity_width`, gives a third.

Breaks when scattered waves have passed around the periodic cell and meet the defect again: runs must be shorter than
the width of the cell over the speed of L waves, 0.43 lattice constants per t0. The wave must be weak (D0 = 0.01 Δ0).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.defects.born import CELL, group_speed, impurity_width
from cases.fields import Sheet, fields_of
from cases.oblique.case import HELD as OF_A_WAVE
from cases.runner import script
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.plotting import legend_above, page
from granular_analysis.theory.catalogue import OBLIQUE
from granular_analysis.theory.choice import contact_of, traits_of
from granular_analysis.theory.network_motion import integrate
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]

HELD = OF_A_WAVE - {OBLIQUE} | {f"inclusion.{name}" for name in ("spheres", "vacancy", "density")}
SETTLED = 20.0  # τ after which the defect and its neighbours move steadily
RTOL = 1e-9  # of the network


@dataclass(frozen=True)
class Scattering:
    """Scattering of one defect.

    Attributes
    ----------
    name : the defect, in words.
    tau : (T,).
    places : (N, 2) places without the defect, lattice constants.
    field : (T, N, 2) scattered displacement over the incident amplitude, in LAMMPS.
    widths : (T,) scattered energy over the incident flux, E/(v_g ε), in LAMMPS and in the network.
    width, width_of_network : W, lattice constants.
    theory : W in closed form; None for a vacancy.
    difference : largest difference between the scattered fields of LAMMPS and the network, over the largest
        displacement.
    """

    name: str
    tau: Floats
    places: Floats
    field: Floats
    widths: Floats
    widths_of_network: Floats
    width: float
    width_of_network: float
    theory: float | None
    difference: float


def defect_of(record: Record) -> tuple[int, float]:
    """Return the index of the defect, row by row, and its density over that of the others; 0 for a vacancy.

    Raises ValueError for a run with any other imperfection.
    """
    if left := sorted(traits_of(record) - HELD):
        raise ValueError(f"{record.folder}: the figure of defects leaves out {', '.join(left)}")
    inclusions = record.scene.inclusion
    if len(inclusions) != 1 or len(inclusions[0].spheres) != 1 or inclusions[0].rows or len(inclusions[0].disc):
        raise ValueError(f"{record.folder}: needs one [[inclusion]] with one sphere, spheres = [[row, column]]")
    (each,) = inclusions
    if not each.vacancy and set(each.of_material) != set() or each.radius is not None:
        raise ValueError(f"{record.folder}: the sphere must be missing, or differ only in density")
    (row, column), sphere = each.spheres[0], record.scene.sphere
    ratio = 0.0 if each.vacancy else (each.density or sphere.density) / sphere.density
    return row * record.scene.shape.columns + column, ratio


def witness(record: Record, tau: Floats) -> tuple[Floats, Floats]:
    """Return u, v, Rθ and their rates (T, N, 3), in D0, of the network started from a run's first snapshot."""
    first = first_snapshot(record)
    motion = integrate(first.network, first.state, tau * first.time, rtol=RTOL).motion
    scale = np.array([1.0, 1.0, first.radius])[:, None] / first.length
    return np.moveaxis(motion[:, :3] * scale, 1, 2), np.moveaxis(motion[:, 3:] * scale * first.time, 1, 2)


def width_of(tau: Floats, energy: Floats, frequency: float) -> float:
    """Return the slope of E(τ), (T,), from `SETTLED` on, fitted together with oscillations at 2Ω.

    Raises ValueError for fewer than six samples.
    """
    late = tau >= SETTLED
    if np.count_nonzero(late) < 6:
        raise ValueError(f"{np.count_nonzero(late)} snapshots from tau = {SETTLED:g} on; at least six are needed")
    x = tau[late]
    basis = np.stack([x, np.ones_like(x), np.cos(2 * frequency * x), np.sin(2 * frequency * x)], axis=1)
    return float(np.linalg.lstsq(basis, energy[late], rcond=None)[0][0])


def compare(perfect: Record, record: Record) -> Scattering:
    """Return the scattering of a run's defect, in LAMMPS and in the network.

    Raises ValueError if the two runs differ in more than the inclusion, or the run does not have a single defect.
    """
    index, ratio = defect_of(record)
    scene, contact = record.scene, contact_of(record)
    same = {key: value for key, value in scene.departures().items() if key not in ("name", "inclusion")}
    other = {key: value for key, value in perfect.scene.departures().items() if key != "name"}
    if different := sorted(key for key in same.keys() | other.keys() if same.get(key) != other.get(key)):
        raise ValueError(
            f"{record.folder} and {perfect.folder} differ in {', '.join(different)}; they must differ in a defect only"
        )
    shape = scene.shape
    count = shape.rows * shape.columns
    there = np.arange(count) != index if ratio == 0 else np.ones(count, bool)
    mass = np.where(np.arange(count) == index, ratio, 1.0)
    runs = record.snapshots(), perfect.snapshots()
    tau = runs[0].tau
    if len(tau) != len(runs[1].tau) or not np.allclose(tau, runs[1].tau):
        raise ValueError(f"{record.folder} and {perfect.folder}: their snapshots have different times")
    lammps = [tuple(fields_of(each, *names) for names in _FIELDS) for each in runs]
    network = [witness(each, tau) for each in (record, perfect)]
    inertia = np.array([1.0, 1.0, contact.inertia])
    incident = np.mean(lammps[1][1] ** 2 @ inertia)  # twice the kinetic energy of a sphere, averaged
    speed = group_speed(scene.require_wave().mode, scene.wavenumber, contact)
    apart, energies = [], []
    for (fields, rates), (fields_without, rates_without) in (lammps, network):
        apart.append((fields - fields_without[:, there])[..., :2])
        twice_kinetic = ((rates - rates_without[:, there]) ** 2 @ inertia) @ mass[there]
        energies.append(twice_kinetic * CELL / (speed * incident))
    frequency = float(record.info["frequency"])
    places = Sheet(shape.rows, shape.columns).rest
    return Scattering(
        "vacancy" if ratio == 0 else f"sphere {ratio:g} times as heavy",
        tau,
        (places - places[index])[there],
        apart[0],
        energies[0],
        energies[1],
        width_of(tau, energies[0], frequency),
        width_of(tau, energies[1], frequency),
        None if ratio == 0 else impurity_width(scene.require_wave().mode, scene.wavenumber, ratio, contact),
        float(np.abs(apart[0] - apart[1]).max() / np.abs(apart[1]).max()),
    )


_FIELDS = (("displacement", "rotation"), ("velocity", "spin"))


def table(found: Sequence[Scattering]) -> str:
    """Return the scattering widths in lattice constants."""
    lines = [
        f"{'scattering width in lattice constants':40}{'LAMMPS':>9}{'network':>9}{'theory':>9}{'fields differ by':>18}"
    ]
    for each in found:
        theory = "" if each.theory is None else f"{each.theory:.3f}"
        lines.append(f"{each.name:40}{each.width:9.3f}{each.width_of_network:9.3f}{theory:>9}{each.difference:18.1e}")
    return "\n".join(lines)


def draw(found: Sequence[Scattering]) -> Figure:
    """Return the figure: for each defect the scattered displacement across and along k, and its energy over time."""
    figure = page(2.6 * len(found))
    panels = figure.subplots(len(found), 3, squeeze=False, width_ratios=[1, 1, 1.1])
    for row, each in zip(panels, found, strict=True):
        shown = int(np.argmin(np.abs(each.tau - 0.75 * each.tau[-1])))
        largest = np.percentile(np.abs(each.field[shown]), 99.5)
        for axes, component, label in ((row[0], 0, "across $k$"), (row[1], 1, "along $k$")):
            image = axes.scatter(
                *each.places.T, c=each.field[shown, :, component], s=2.4, cmap="RdBu", vmin=-largest, vmax=largest,
                marker="h", linewidths=0, rasterized=True,
            )  # fmt: skip
            axes.plot(0, 0, "k.", markersize=3)
            axes.set(aspect="equal", xlabel="x (lattice constants)")
            axes.set_title(label)
        row[0].set_ylabel(f"{each.name}\ny (lattice constants)")
        figure.colorbar(image, ax=list(row[:2]), label=rf"scattered / $D_0$, $\tau$ = {each.tau[shown]:g}", shrink=0.7)
        _energy(row[2], each)
    return figure


def _energy(axes: Axes, each: Scattering) -> None:
    axes.plot(each.tau, each.widths, "o", markersize=3.5, color="C0", label="LAMMPS")
    axes.plot(
        each.tau,
        each.widths_of_network,
        color="black",
        linewidth=1,
        label="network",
    )
    if each.theory is not None:
        middle = each.tau >= SETTLED
        offset = np.mean(each.widths[middle] - each.theory * each.tau[middle])
        line = each.tau[middle]
        axes.plot(line, offset + each.theory * line, "--", color="C3", label="theory")
    axes.set(xlabel=r"time $\tau$", ylabel="scattered energy / incident flux\n($t_0$ × lattice constant)")
    axes.set(xlim=(0, None), ylim=(0, None))
    axes.set_title(f"width $W$ = {each.width:.3f}", loc="left")
    legend_above(axes)


def measure(records: Sequence[Record]) -> list[Scattering]:
    """Return the scattering of each defect; the first run is the perfect crystal."""
    perfect, *others = records
    return [compare(perfect, each) for each in others]


main = script(__name__, measure, table, draw, ("runs", "run of the perfect crystal, then runs with a defect"))
