"""The network beside LAMMPS in an imperfect crystal, over the number of spheres: seconds, error and their ratio.

    python -m benchmarks.network [--spheres N ...] [--repeats N]

The scene is a TR wave in a sheet of spheres of unequal densities and radii, τ ≤ 6. LAMMPS takes a pair of steps, 0.1
and 0.05, on one rank, without and with the kernel. Its seconds are the processor time of both time loops without the
writing of snapshots. The network takes the fastest tolerance that is no less accurate, and its seconds are processor
time. Errors are root mean squares over all spheres, in D0, from the network with rtol = 1e-11. What came out is in
RESULTS.md.
"""

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import nan
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from benchmarks.ours import missing_kernel
from benchmarks.timing import both_ratios, interleave, machine, spread, table
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network_motion import integrate
from granular_lmp import Record, Scene, run
from granular_lmp.lammps.outputs import LOG, read_log

Floats = NDArray[np.float64]
EXACT = 1e-11
TOLERANCES = (1e-3, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
LAMMPS, PAIR, NETWORK = "LAMMPS", "LAMMPS, pair of steps", "network"
STEPS = (0.1, 0.05)
HEAD = [
    *("spheres", "LAMMPS, s", "with the kernel, s", "error", "network, s", "error", "rtol"),
    *("network over LAMMPS", "over the kernel"),
]


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


@dataclass(frozen=True)
class Outcome:
    """Processor seconds of LAMMPS without and with the kernel, its error, and the network at no larger one."""

    loop: float
    kernel: float
    error: float
    network: Point


def sized(spheres: int) -> Scene:
    """Return the scene with about as many spheres, in a cell that is about square."""
    columns = max(4, round(spheres**0.5))
    rows = max(8, 2 * round(spheres / columns / 2))
    return Scene.load("tr_periodic").with_values(
        {
            "packing.rows": rows,
            "packing.columns": columns,
            "wave.wavenumber": 2 * np.pi * max(1, round(rows / 8)) / rows,
            "wave.amplitude": 0.02,
            "disorder.density": 0.1,
            "disorder.radius": 2e-5,
            "time.duration": 6.0,
            "time.sample": 3.0,
            "output.particles": 3.0,
        }
    )


def solve(scene: Scene, folder: Path) -> Outcome:
    """Run LAMMPS with both steps, without and with the kernel, and the network at several tolerances."""
    records, loop = _runs(scene, folder / "run", kernel=False)
    kernel = nan if missing_kernel() else _runs(scene, folder / "kernel", kernel=True)[1]
    pair, network = matched(measure(records))
    return Outcome(loop, kernel, pair.error, network)


def _runs(scene: Scene, folder: Path, *, kernel: bool) -> tuple[list[Record], float]:
    """Return the runs with both steps, and the processor seconds of their loops."""
    records = [run(scene.with_values({"time.timestep": each}), folder / str(each), kernel=kernel) for each in STEPS]
    return records, sum(processor_seconds(folder / str(each) / LOG) for each in STEPS)


def processor_seconds(log: Path) -> float:
    """Return the processor time of the last time loop of a log without its output."""
    found = read_log(log)
    used = float(re.findall(r"([\d.]+)% CPU use", log.read_text(encoding="utf-8"))[-1]) / 100 or 1.0  # 0: below a tick
    return used * (found.loop - found.sections["loop.output"])


def matched(points: Sequence[Point]) -> tuple[Point, Point]:
    """Return the pair of LAMMPS, and the fastest network that is no less accurate.

    Raises
    ------
    ValueError
        If no tolerance of the network is as accurate as the pair.
    """
    (pair,) = (point for point in points if point.kind == PAIR)
    as_good = [point for point in points if point.kind == NETWORK and point.error <= pair.error]
    if not as_good:
        raise ValueError(f"no tolerance of the network is as accurate as the pair of steps, {pair.error:.1e} of D0")
    return pair, min(as_good, key=lambda point: point.seconds)


def line(scene: Scene, rounds: Sequence[Outcome]) -> list[str]:
    """Return one line of the table; ratios are within rounds, and of the smallest times."""
    loops, kernels = [each.loop for each in rounds], [each.kernel for each in rounds]
    seconds, last = [each.network.seconds for each in rounds], rounds[-1]
    return [
        str(scene.shape.spheres),
        spread(loops),
        spread(kernels),
        f"{last.error:.1e}",
        spread(seconds),
        f"{last.network.error:.1e}",
        f"{last.network.setting:.0e}",
        both_ratios(seconds, loops),
        both_ratios(seconds, kernels),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.network", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--spheres", type=int, nargs="+", default=[100, 600, 10_000, 100_000], metavar="N")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="rounds (default 3)")
    options = parser.parse_args(argv)
    scenes = {f"{spheres} spheres": sized(spheres) for spheres in options.spheres}
    jobs = {name: partial(solve, scene) for name, scene in scenes.items()}
    done = interleave(jobs, max(options.repeats, 1))
    print(machine() + "\n")
    print(table(HEAD, [line(scene, [outcome for _, outcome in done[name]]) for name, scene in scenes.items()]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
