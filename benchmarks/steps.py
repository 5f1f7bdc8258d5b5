"""Steps of LAMMPS's scheme by LAMMPS, NumPy and JAX, over the number of spheres; and what a gradient costs.

    python -m benchmarks.steps [--spheres N ...] [--repeats N]

The scene is a TR wave in a perfect periodic sheet, whose steps all three take to the same motion. Times are processor
seconds of all threads, over contacts and steps: of LAMMPS, on one rank, the time loop without the writing of snapshots;
of JAX, on the device that it chooses, a run that is compiled. The gradient is that of the amplitude of one sphere by
the densities of 600. What came out is in RESULTS.md.
"""

import argparse
import resource
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from jax import numpy as jnp

from benchmarks.network import processor_seconds, sized
from benchmarks.timing import both_ratios, interleave, machine, ratio, spread, table
from granular_analysis.measure.snapshot import FirstSnapshot, first_snapshot
from granular_analysis.theory import network_traced, network_verlet
from granular_analysis.theory.network_factors import Run
from granular_analysis.theory.network_gradient import Record, gradient, record
from granular_lmp import Scene, run
from granular_lmp.lammps.outputs import LOG

STEP = 0.1  # τ
SPHERE_STEPS = 3_000_000  # of LAMMPS and JAX; NumPy takes a tenth
FEWEST = 20  # steps
HEAD = ["spheres", "LAMMPS, ns", "NumPy, ns", "JAX, ns", "NumPy over LAMMPS", "JAX over LAMMPS"]
Nanoseconds = tuple[float, float, float]


def perfect(spheres: int) -> tuple[Scene, int]:
    """Return the scene with about as many equal spheres, and its number of steps."""
    scene = sized(spheres).with_values({"disorder.density": 0.0, "disorder.radius": 0.0})
    count = 2 * max(FEWEST, round(SPHERE_STEPS / scene.shape.spheres / 2))
    times = {"time.timestep": STEP, "time.duration": count * STEP}
    return scene.with_values({**times, "time.sample": count / 2 * STEP, "output.particles": count / 2 * STEP}), count


def compared(spheres: int, folder: Path) -> Nanoseconds:
    """Return ns a contact and step of LAMMPS, NumPy and JAX."""
    scene, count = perfect(spheres)
    first = first_snapshot(run(scene, folder / "run", kernel=False))
    loop, _ = processor_seconds(folder / "run" / LOG)
    pairs = 3 * scene.shape.spheres
    few = max(FEWEST, count // 10)
    numpy = timed(partial(marched, network_verlet.march, first, few))
    marched(network_traced.march, first, count)  # compiles
    jax = timed(partial(marched, network_traced.march, first, count))
    return 1e9 * loop / pairs / count, 1e9 * numpy / pairs / few, 1e9 * jax / pairs / count


def marched(march: Callable[..., Any], first: FirstSnapshot, count: int) -> None:
    """Take steps of a run from its first snapshot."""
    for _ in march(first.network, first.state, STEP * first.time, count, count):
        pass


def timed(job: Callable[[], object]) -> float:
    """Return the processor seconds of a job."""
    began = process_time()
    job()
    return process_time() - began


def slope(repeats: int, folder: Path) -> str:
    """Return what a gradient costs of 600 spheres and 2000 steps: over a run, and in memory."""
    first = first_snapshot(run(perfect(600)[0], folder / "run", kernel=False))
    whole = Run(first.network, first.state, STEP * first.time, 200, 10, np.array([0]))
    ones = whole.neutral("density")
    forward = partial(_recorded, whole, ones)
    back = partial(gradient, whole, _size, ones)
    peaks = []
    for job in (forward, back):
        job()  # compiles
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    one, other = zip(*((timed(forward), timed(back)) for _ in range(repeats)), strict=True)
    return (
        f"A gradient of {len(first.network.position)} spheres × 2000 steps takes {spread(other)} s, a run "
        f"{spread(one)} s: {ratio(other, one):.2g} runs. The process has {peaks[0]:.0f} MB after the run, "
        f"{peaks[1]:.0f} MB after the gradient."
    )


def _recorded(whole: Run, factors: dict[str, Any]) -> Any:
    return record(whole, factors)


def _size(found: Record) -> Any:
    return jnp.sum(found.motion[:, 0] ** 2)


def line(spheres: int, rounds: Sequence[Nanoseconds]) -> list[str]:
    """Return one line of the table; ratios are within rounds, and of the smallest times."""
    lammps, numpy, jax = zip(*rounds, strict=True)
    spreads = [spread(each) for each in (lammps, numpy, jax)]
    return [str(spheres), *spreads, both_ratios(numpy, lammps), both_ratios(jax, lammps)]


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.steps", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--spheres", type=int, nargs="+", default=[600, 10_000, 100_000], metavar="N")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="rounds (default 3)")
    options = parser.parse_args(argv)
    repeats = max(options.repeats, 1)
    print(machine() + "\n")
    ((_, said),) = interleave({"gradient": partial(slope, repeats)}, 1)["gradient"]
    jobs = {str(spheres): partial(compared, spheres) for spheres in options.spheres}
    done = interleave(jobs, repeats)
    rows = [line(perfect(int(name))[0].shape.spheres, [each for _, each in done[name]]) for name in jobs]
    print(table(HEAD, rows) + "\n\n" + said)
    return 0


if __name__ == "__main__":
    sys.exit(main())
