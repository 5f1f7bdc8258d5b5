"""Steps of LAMMPS's scheme by LAMMPS and by the network in compiled loops, JAX and NumPy, over the number of spheres.

    python -m benchmarks.steps [--spheres N ...] [--repeats N]

The scene is a TR wave in a perfect periodic sheet, whose steps all take to the same motion. Times are processor
seconds of all threads, over contacts and steps: of LAMMPS, on one rank without and with the kernel, the time loop
without the writing of snapshots; of JAX, on the device that it chooses, a run that is compiled. What came out is in
RESULTS.md.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from benchmarks.network import processor_seconds, sized
from benchmarks.timing import both_ratios, interleave, machine, spread, table
from granular_analysis.measure.snapshot import FirstSnapshot, first_snapshot
from granular_analysis.theory import network_compiled, network_traced, network_verlet
from granular_lmp import Scene, run
from granular_lmp.lammps.outputs import LOG

STEP = 0.1  # τ
SPHERE_STEPS = 3_000_000  # of LAMMPS and JAX; NumPy takes a tenth
FEWEST = 20  # steps
HEAD = [
    *("spheres", "LAMMPS, ns", "with the kernel, ns", "C, ns", "JAX, ns", "NumPy, ns"),
    *("C over the kernel", "JAX over the kernel", "NumPy over LAMMPS"),
]
Nanoseconds = tuple[float, ...]


def perfect(spheres: int) -> tuple[Scene, int]:
    """Return the scene with about as many equal spheres, and its number of steps."""
    scene = sized(spheres).with_values({"disorder.density": 0.0, "disorder.radius": 0.0})
    count = 2 * max(FEWEST, round(SPHERE_STEPS / scene.shape.spheres / 2))
    times = {"time.timestep": STEP, "time.duration": count * STEP}
    return scene.with_values({**times, "time.sample": count / 2 * STEP, "output.particles": count / 2 * STEP}), count


def compared(spheres: int, folder: Path) -> Nanoseconds:
    """Return ns a contact and step of LAMMPS without and with the kernel, compiled loops, JAX and NumPy."""
    scene, count = perfect(spheres)
    first = first_snapshot(run(scene, folder / "run", kernel=False))
    run(scene, folder / "kernel", kernel=True)
    loop, kernel = (processor_seconds(folder / each / LOG) for each in ("run", "kernel"))
    pairs = 3 * scene.shape.spheres
    few = max(FEWEST, count // 10)
    numpy = timed(partial(marched, network_verlet.march, first, few))
    marched(network_traced.march, first, count)  # compiles
    jax = timed(partial(marched, network_traced.march, first, count))
    compiled = timed(partial(marched, network_compiled.march, first, count))
    per_step = loop / count, kernel / count, compiled / count, jax / count, numpy / few
    return tuple(1e9 / pairs * each for each in per_step)


def marched(march: Callable[..., Any], first: FirstSnapshot, count: int) -> None:
    """Take steps of a run from its first snapshot."""
    for _ in march(first.network, first.state, STEP * first.time, count, count):
        pass


def timed(job: Callable[[], object]) -> float:
    """Return the processor seconds of a job."""
    began = process_time()
    job()
    return process_time() - began


def line(spheres: int, rounds: Sequence[Nanoseconds]) -> list[str]:
    """Return one line of the table; ratios are within rounds, and of the smallest times."""
    lammps, kernel, compiled, jax, numpy = zip(*rounds, strict=True)
    spreads = [spread(each) for each in (lammps, kernel, compiled, jax, numpy)]
    ratios = [both_ratios(compiled, kernel), both_ratios(jax, kernel), both_ratios(numpy, lammps)]
    return [str(spheres), *spreads, *ratios]


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.steps", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--spheres", type=int, nargs="+", default=[600, 10_000, 100_000], metavar="N")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="rounds (default 3)")
    options = parser.parse_args(argv)
    repeats = max(options.repeats, 1)
    print(machine() + "\n")
    jobs = {str(spheres): partial(compared, spheres) for spheres in options.spheres}
    done = interleave(jobs, repeats)
    rows = [line(perfect(int(name))[0].shape.spheres, [each for _, each in done[name]]) for name in jobs]
    print(table(HEAD, rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
