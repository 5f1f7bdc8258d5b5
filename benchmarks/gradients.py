"""What the gradient of a run costs: time over the number of parameters, and memory over the number of steps.

    python -m benchmarks.gradients [--repeats N] [--largest N]

Packings are the unequal sheets of `benchmarks.device`, and the number is the energy of one sphere's motion. Times are
processor seconds on one core, or those of the clock on a GPU, of programs that are compiled; their unit is a run
without gradients. Memory is what the compiled program says that it takes beside its arguments. What came out is in
RESULTS.md.
"""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from time import perf_counter, process_time
from typing import Any

import jax
import numpy as np
from jax import numpy as jnp

from benchmarks.device import STEP, unequal
from benchmarks.timing import machine, ratio, table
from granular_analysis.theory import network_traced
from granular_analysis.theory.network_factors import Run
from granular_analysis.theory.network_gradient import Record, bytes_of_gradient, derivative, gradient, hessian_product

# Factors, spheres and steps
SIZES: list[tuple[list[str], int, int]] = [
    (["amplitude"], 600, 1000),
    (["density"], 100, 2000),
    (["density", "normal_stiffness"], 2500, 400),
    (["density", "normal_stiffness"], 250_000, 16),
]
HEAD = ["parameters", "of", "spheres", "steps", "run, s", "gradient, runs", "along one, runs", "Hessian product, runs"]
SPANS = (64, 256, 1024, 4096)  # steps whose memory is compared
HELD = 2500  # spheres


def run_of(spheres: int, steps: int, every: int) -> Run:
    """Return a run that records one sphere."""
    network, state, time = unequal(spheres)
    return Run(network, state, STEP * time, steps // every, every, np.array([0]))


def energy(found: Record) -> Any:
    """Return a sum over a record, as a number that is differentiated."""
    return jnp.sum(found.motion[:, 0] ** 2)


def clock() -> float:
    """Return the processor time on a CPU, and that of the clock elsewhere."""
    return process_time() if jax.devices()[0].platform == "cpu" else perf_counter()


def plain(run: Run) -> float:
    """Return the seconds of a run's steps without gradients."""
    count = run.samples * run.every
    motions = network_traced.march(run.network, run.state, run.step, count, count)
    next(motions)
    began = clock()
    next(motions)
    return clock() - began


def timed(job: Callable[[], object]) -> float:
    """Return the seconds of a job."""
    began = clock()
    jax.block_until_ready(job())
    return clock() - began


def line(names: list[str], spheres: int, steps: int, repeats: int) -> list[str]:
    """Return one line of the table of times; ratios are the medians of those within rounds."""
    print(f"{', '.join(names)} of {spheres} spheres", file=sys.stderr, flush=True)
    run = run_of(spheres, steps, every=4)
    ones = run.neutral(*names)
    rng = np.random.default_rng(1)
    way = {name: rng.normal(size=each.shape) for name, each in ones.items()}
    others: list[Callable[[], object]] = [
        partial(gradient, run, energy, ones),
        partial(derivative, run, energy, ones, way),
        partial(hessian_product, run, energy, ones, way),
    ]
    jobs = [partial(plain, run), *(partial(timed, each) for each in others)]
    for job in jobs:
        job()  # compiles
    first, *spent = zip(*([job() for job in jobs] for _ in range(repeats)), strict=True)
    runs = [f"{ratio(each, first):.2g}" for each in spent]
    numbers = sum(each.size for each in ones.values()), len(run.network.position), steps
    parameters, count, taken = map(str, numbers)
    return [parameters, ", ".join(names), count, taken, f"{min(first):.3g}", *runs]


def memory() -> str:
    """Return the table of memory."""
    rows = []
    for steps in SPANS:
        runs = [run_of(HELD, steps, every) for every in (4, steps // 4)]
        found = [bytes_of_gradient(run, energy, run.neutral("density")) for run in runs]
        rows.append([str(steps), *(f"{each / 1e6:.3g}" for each in found)])
    return table(["steps", "a record each 4 steps, MB", "4 records, MB"], rows)


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.gradients", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--largest", type=int, default=SIZES[-1][1], metavar="N", help="spheres at most")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="rounds (default 3)")
    options = parser.parse_args(argv)
    if hasattr(os, "sched_setaffinity"):  # before JAX starts its threads, as they wait at the price of the processor
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    print(f"{machine()}\nJAX {jax.__version__} on {jax.devices()[0].device_kind}\n")
    rows = [line(*each, options.repeats) for each in SIZES if each[1] <= options.largest]
    print(f"{table(HEAD, rows)}\n\n{memory()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
