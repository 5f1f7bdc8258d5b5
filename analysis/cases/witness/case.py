"""Accuracy over time in a crystal that is not perfect: runs of one scene beside the network that judges them.

    granular-lmp sweep SCENE --over time.timestep=0.2,0.1,0.05,0.025 -o sweeps/witness
    granular-analysis witness sweeps/witness [-o FILE] [--json FILE]

The runs differ in their time step only, and hold snapshots of all spheres. Their error is the root mean square over all
spheres and snapshots of the displacement's distance from the network with rtol = 1e-11, in D0. Pairs of steps h and h/2
are extrapolated too. Times are seconds of LAMMPS's loop, and processor seconds of the network at each rtol.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.measure.swept import Swept
from granular_analysis.plotting import parser, save, start, write
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network_motion import integrate
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
EXACT = 1e-11
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)
LAMMPS, PAIR, NETWORK = "LAMMPS", "LAMMPS, pair of steps", "network"


@dataclass(frozen=True)
class Point:
    """One way to the answer: its kind, the step in τ or the tolerance, seconds, and the error in D0."""

    kind: str
    setting: float
    seconds: float
    error: float


def distance(field: Floats, exact: Floats) -> float:
    """Root mean square over times and spheres of |u − u_exact|, of fields (T, N, 2)."""
    return float(np.sqrt(np.mean(np.sum((field - exact) ** 2, axis=-1))))


def measure(records: Sequence[Record]) -> list[Point]:
    """Return the points of runs that differ in the time step only, and of the network of their first snapshot.

    Raises TheoryError for runs that differ in more, have other spheres, or hold no snapshots.
    """
    if len({_without_step(record) for record in records}) != 1:
        raise TheoryError("the runs differ in more than time.timestep: their errors are not of one crystal")
    records = sorted(records, key=lambda record: record.scene.time.step)
    first = first_snapshot(records[0])
    snapshots = records[0].snapshots()
    times = snapshots.tau[1:] * first.time

    def network(rtol: float) -> tuple[Floats, float]:
        began = process_time()
        run = integrate(first.network, first.state, times, rtol=rtol)
        return run.displacement / first.length, process_time() - began

    exact, _ = network(EXACT)
    points = []
    for rtol in TOLERANCES:
        field, seconds = network(rtol)
        points.append(Point(NETWORK, rtol, seconds, distance(field, exact)))
    runs = {record.scene.time.step: record for record in records}
    fields = {step: record.snapshots().stack("displacement")[1:] for step, record in runs.items()}
    spent = {step: record.info["wall_seconds"]["loop"] for step, record in runs.items()}
    points += [Point(LAMMPS, step, spent[step], distance(fields[step], exact)) for step in runs]
    for step in runs:
        coarse = next((each for each in runs if np.isclose(each, 2 * step)), None)
        if coarse is not None:
            pair = (4 * fields[step] - fields[coarse]) / 3
            points.append(Point(PAIR, step, spent[step] + spent[coarse], distance(pair, exact)))
    return points


def _without_step(record: Record) -> str:
    return record.scene.with_values({"time.timestep": 0.01, "name": "any"}).to_toml()


def table(points: Sequence[Point]) -> str:
    """Return the points as text, a line each."""
    lines = [f"{'':22}{'step or rtol':>14}{'seconds':>10}{'error, D0':>12}"]
    lines += [f"{p.kind:22}{p.setting:14.4g}{p.seconds:10.3g}{p.error:12.2e}" for p in points]
    return "\n".join(lines)


def draw(points: Sequence[Point], record: Record) -> Figure:
    """Return the figure: error over seconds, a line for each kind."""
    figure = Figure(figsize=(6.5, 4.2), layout="constrained")
    axes = figure.subplots()
    for kind, style in ((LAMMPS, "o-"), (PAIR, "s--"), (NETWORK, "^:")):
        own = sorted((p for p in points if p.kind == kind), key=lambda p: p.seconds)
        axes.loglog([p.seconds for p in own], [p.error for p in own], style, color="black", markersize=5, label=kind)
        for p in own:
            axes.annotate(f"{p.setting:.3g}", (p.seconds, p.error), (4, 4), textcoords="offset points", fontsize=8)
    scene = record.scene
    axes.set(xlabel="seconds", ylabel=r"root mean square error of all spheres ($D_0$)")
    axes.set_title(
        f"{record.info['particles']} spheres, {scene.imperfections}\n{scene.label}, "
        rf"$\tau \leq {scene.time.duration:g}$; numbers: step or rtol",
        fontsize="medium",
    )
    axes.legend(frameon=False)
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table and draw the figure into a file."""
    options = parser(__doc__, "witness.png", sweeps="sweep over time.timestep of a scene with output.particles")
    options.add_argument("--json", metavar="FILE", help="write the points as JSON")
    chosen = options.parse_args(arguments)
    records = []
    for folder in chosen.sweeps:
        swept = Swept.load(folder)
        if swept is None:
            raise SystemExit(f"{folder}: is no sweep; granular-lmp sweep SCENE --over time.timestep=... makes one")
        records += [Record.load(each) for each in swept.folders]
    try:
        points = measure(records)
    except ValueError as error:
        raise SystemExit(f"{chosen.sweeps[0]}: {error}") from error
    print(table(points))
    save(draw(points, records[0]), chosen.output)
    if chosen.json:
        write(Path(chosen.json), json.dumps([asdict(p) for p in points], indent=2) + "\n")


if __name__ == "__main__":
    start(main)
