"""The network beside LAMMPS in an imperfect crystal, over the number of spheres: seconds, error and their ratio.

    python -m benchmarks.network [--spheres N ...] [--repeats N]

The scene is a TR wave in a sheet of spheres of unequal densities and radii, τ ≤ 6. LAMMPS takes a pair of steps, 0.1
and 0.05, on one rank. Its seconds are the processor time of both time loops without the writing of snapshots, and of
these the contacts (LAMMPS's section Pair), without guards and integration. The network takes the fastest tolerance
that is no less accurate, and its seconds are processor time. Errors are those of `granular-analysis witness`: root mean
square over all spheres, in D0, from the network with rtol = 1e-11. What came out is in RESULTS.md.
"""

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.timing import both_ratios, interleave, machine, spread, table
from cases.witness.case import NETWORK, PAIR, Point, measure
from granular_lmp import Scene, run
from granular_lmp.lammps.outputs import LOG, read_log

STEPS = (0.1, 0.05)
HEAD = [
    *("spheres", "LAMMPS, s", "its contacts, s", "error", "network, s", "error", "rtol"),
    *("network over LAMMPS", "over its contacts"),
]


@dataclass(frozen=True)
class Outcome:
    """Both at errors that are comparable: processor seconds of LAMMPS and of its contacts, its error, the network."""

    loop: float
    contacts: float
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
    """Run LAMMPS with both steps and the network at several tolerances."""
    records = [run(scene.with_values({"time.timestep": step}), folder / str(step), kernel=False) for step in STEPS]
    loops, contacts = zip(*(processor_seconds(folder / str(step) / LOG) for step in STEPS), strict=True)
    pair, network = matched(measure(records))
    return Outcome(sum(loops), sum(contacts), pair.error, network)


def processor_seconds(log: Path) -> tuple[float, float]:
    """Return the processor time of the last time loop of a log without its output, and that of its contacts."""
    found = read_log(log)
    used = float(re.findall(r"([\d.]+)% CPU use", log.read_text(encoding="utf-8"))[-1]) / 100 or 1.0  # 0: below a tick
    return used * (found.loop - found.sections["loop.output"]), used * found.sections["loop.pair"]


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
    loops, contacts = [each.loop for each in rounds], [each.contacts for each in rounds]
    seconds, last = [each.network.seconds for each in rounds], rounds[-1]
    return [
        str(scene.shape.spheres),
        spread(loops),
        spread(contacts),
        f"{last.error:.1e}",
        spread(seconds),
        f"{last.network.error:.1e}",
        f"{last.network.setting:.0e}",
        both_ratios(seconds, loops),
        both_ratios(seconds, contacts),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.network", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--spheres", type=int, nargs="+", default=[100, 1_000, 10_000, 100_000], metavar="N")
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
