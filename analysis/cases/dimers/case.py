"""Front of an impact on a chain of heavy and light spheres: its decay, and the motion of the light spheres behind it.

    granular-analysis dimers RUN [RUN ...] [-o FILE]

RUN is a run folder of the shipped ``dimer_chain`` with any density of its light spheres, and with ``time.sample`` at
most 0.15. Lines are the theory of `cases.dimers.front`, points LAMMPS. The table has the resonances and antiresonances
of the theory, and a line for each run.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from cases.dimers.front import (
    CELLS,
    STEP,
    antiresonance,
    decay_of,
    rattle_of,
    resonance,
    struck,
)
from cases.runner import script
from cases.strikes import recorded, require
from granular_analysis.measure.strikes import Sites, densities
from granular_analysis.plotting import letter, page
from granular_lmp.runs.record import Record

RATIOS = np.sort(
    np.concatenate(
        # Includes the first three resonances, because the line must reach its lowest points
        [
            np.arange(0.04, 0.1, 0.002),
            np.arange(0.1, 0.2, 0.005),
            np.linspace(0.2, 1.0, 65),
            (0.09013, 0.15475, 0.34285),
        ]
    )
)
RESONANCES = ((0.34, 0.35), (0.15, 0.16), (0.088, 0.092), (0.06, 0.063))  # an interval around each
ANTIRESONANCES = ((0.5, 0.65), (0.2, 0.28), (0.11, 0.14), (0.07, 0.085))
SMALLEST = 1e-7  # least λ in the figure; at a resonance λ of a run is an error of the step, of either sign


def measured(record: Record) -> tuple[float, float, float]:
    """Return ε, λ and r of a run.

    Raises ValueError unless heavy and light spheres alternate in the chain and its first, a heavy one, is the only
    striker; and for a record that lacks spheres or is too coarse in time.
    """
    scene, sites = record.scene, Sites.of(record.scene)
    name, struck = scene.name, [sites.chosen(each).tolist() for each in scene.striker]
    wanted = f"{name}: must be a chain of heavy and light spheres in turn that its first, heavy one strikes"
    try:
        mass = densities(scene) / scene.sphere.density
    except ValueError as error:
        raise ValueError(f"{wanted}; {error}") from error
    ratio = float(mass[1] / mass[0])
    in_turn = np.allclose(mass, np.where(np.arange(len(mass)) % 2, ratio, 1.0), rtol=1e-12)
    if not in_turn or ratio > 1 or struck != [[0]]:
        raise ValueError(wanted)
    require(record, "inclusion")
    spacing = float(record.tau[1] - record.tau[0])
    if spacing > STEP * (1 + 1e-9):
        raise ValueError(f"{name}: time.sample = {spacing:g}: must be at most {STEP}")
    velocity = np.full((len(record.tau), len(mass)), np.nan)
    velocity[:, recorded(scene)] = record.velocity[..., 1]
    measured = slice(2 * CELLS[0], 2 * (CELLS[1] + 3) + 1)
    if np.isnan(velocity[:, measured]).any():
        raise ValueError(f"{name}: output.rows: must hold the rows {measured.start} to {measured.stop - 1}")
    return ratio, decay_of(velocity), rattle_of(velocity)


def draw(runs: Sequence[tuple[float, float, float]]) -> Figure:
    """Return the figure: decay per cell, and velocity of a light sphere behind the front, over the mass ratio."""
    figure = page(3.4)
    decays, rattles = figure.subplots(1, 2)
    chains = [struck(float(ratio)) for ratio in RATIOS]
    decays.semilogy(RATIOS, [max(decay_of(each), SMALLEST) for each in chains], color="black", label="theory")
    rattles.plot(RATIOS, [rattle_of(each) for each in chains], color="black")
    ratio, decay, rattle = np.array(runs).T
    decays.semilogy(ratio, np.maximum(decay, SMALLEST), "o", color="C3", markersize=4, label="LAMMPS")
    rattles.plot(ratio, rattle, "o", color="C3", markersize=4)
    decays.set(xlabel="mass of a light sphere /\nmass of a heavy sphere", ylabel=r"share $\lambda$ lost in a cell")
    rattles.set(
        xlabel="mass of a light sphere /\nmass of a heavy sphere",
        ylabel="velocity of a light sphere /\nheight of the front",
    )
    rattles.axhline(0.0, color="grey", linewidth=0.8)
    letter((decays, rattles))
    for axes in (decays, rattles):
        axes.grid(alpha=0.3)
    figure.legend(*decays.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def table(runs: Sequence[tuple[float, float, float]]) -> str:
    """Return the resonances and the antiresonances of the theory, and a line for each run."""
    lines = ["resonances      " + "".join(f"{resonance(*each):10.5f}" for each in RESONANCES)]
    found = [antiresonance(*each) for each in ANTIRESONANCES]
    lines += ["antiresonances  " + "".join(f"{ratio:10.4f}" for ratio, _ in found)]
    lines += ["decay there     " + "".join(f"{decay:10.2e}" for _, decay in found)]
    lines += [f"{'ratio':>8}{'decay':>12}{'theory':>12}{'rattle':>10}{'theory':>10}"]
    for ratio, decay, rattle in sorted(runs):
        exact = struck(ratio)
        lines += [f"{ratio:8.5f}{decay:12.3e}{decay_of(exact):12.3e}{rattle:10.5f}{rattle_of(exact):10.5f}"]
    return "\n".join(lines)


def measure(records: Sequence[Record]) -> list[tuple[float, float, float]]:
    """Return ε, λ and r of each run."""
    return [measured(record) for record in records]


main = script(__name__, measure, table, draw, ("runs", "runs of chains of heavy and light spheres"))
