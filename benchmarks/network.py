"""The network beside LAMMPS in an imperfect crystal, over the number of spheres: seconds, error and their ratio.

    python -m benchmarks.network [--spheres N ...] [--repeats N]

The scene is a TR wave in a sheet of spheres of unequal densities and radii, τ ≤ 6. LAMMPS takes a pair of steps, 0.1
and 0.05, and its seconds are those of both time loops on one rank. The network takes the fastest tolerance that is no
less accurate, and its seconds are processor time. Errors are those of `analysis.figures.witness`: root mean square over
all spheres, in D0, from the network with rtol = 1e-11. What came out is in RESULTS.md.
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from analysis.figures.witness import NETWORK, PAIR, Point, measure
from benchmarks.timing import interleave, machine, ratio, spread, table
from granular_lmp import Scene, run

STEPS = (0.1, 0.05)
HEAD = ["spheres", "LAMMPS, s", "error", "network, s", "error", "rtol", "network over LAMMPS", "network, µs per sphere"]


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


def solve(scene: Scene, folder: Path) -> list[Point]:
    """Return the ways to the answer: two runs of LAMMPS, their pair, and the network at several tolerances."""
    return measure([run(scene.with_values({"time.timestep": step}), folder / str(step)) for step in STEPS])


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


def line(scene: Scene, rounds: Sequence[Sequence[Point]]) -> list[str]:
    """Return one line of the table."""
    pairs, networks = zip(*map(matched, rounds), strict=True)
    slow, fast = [point.seconds for point in pairs], [point.seconds for point in networks]
    return [
        str(scene.shape.spheres),
        spread(slow),
        f"{pairs[-1].error:.1e}",
        spread(fast),
        f"{networks[-1].error:.1e}",
        f"{networks[-1].setting:.0e}",
        f"{ratio(fast, slow):.2g}",
        f"{min(fast) / scene.shape.spheres / scene.time.duration * 1e6:.2g}",
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
    print(table(HEAD, [line(scene, [points for _, points in done[name]]) for name, scene in scenes.items()]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
