"""What the same error costs in LAMMPS, with its kernel, and in the network by compiled loops, NumPy and JAX.

    python -m benchmarks.same_error [--repeats N] [SCENE ...]

All take LAMMPS's steps, so that one step has one error in each: the largest of the relative L2 errors of the recorded
signals, against two fine runs of LAMMPS that are extrapolated. Of each error the longest step is sought that reaches
it. Seconds are those of the processor for a whole run, on one core; JAX compiles its loop in a first run, which is told
apart. What came out is in docs/accuracy.md.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from itertools import count
from math import ceil, sqrt
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks.timing import interleave, machine, table
from granular_analysis.measure.stepping import NetworkEngine
from granular_lmp import Scene, run

SCENES = ("tr_resonant", "fcc_transverse")
TARGETS = (1e-1, 1e-2, 1e-3, 1e-4)
FINE, FIRST = 32, 2  # times the steps of the first run, and steps to a sample in that
SMALL = 1e-6  # of the largest signal: what is below it vanishes by symmetry
HEAD = [
    *("scene", "spheres", "error", "step, t0", "steps", "LAMMPS, s", "with the kernel, s", "C, s", "NumPy, s"),
    *("JAX, s", "compilation, s"),
]


def stepped(scene: Scene, per_sample: int) -> Scene:
    """Return a scene with a number of steps to each sample."""
    return scene.with_values({"time.timestep": scene.time.sample / per_sample})


def errors(scene: Scene, folder: Path) -> Callable[[int], float]:
    """Return the error as a function of the steps to a sample."""

    def signals(per_sample: int) -> Any:
        record = run(stepped(scene, per_sample), folder / str(per_sample), kernel=True, force=True)
        return np.array([*record.signals.values()])

    coarse, fine = signals(FIRST * FINE // 2), signals(FIRST * FINE)
    exact = (4 * fine - coarse) / 3
    sizes = np.linalg.norm(exact, axis=1)
    there = sizes > SMALL * sizes.max()

    def error(per_sample: int) -> float:
        off = np.linalg.norm(signals(per_sample) - exact, axis=1)
        return float(np.max(off[there] / sizes[there]))

    return error


def longest(error: Callable[[int], float], target: float) -> tuple[int, float]:
    """Return the fewest steps to a sample that reach an error, of those from a guess on, and their error."""
    guess = max(FIRST, ceil(0.9 * FIRST * sqrt(error(FIRST) / target)))
    return next((steps, found) for steps in count(guess) if (found := error(steps)) <= target)


def seconds(scene: Scene, folder: Path, **by: Any) -> float:
    """Return the processor seconds of a run."""
    began = process_time()
    run(scene, folder / "run", **by)
    return process_time() - began


def lines(name: str, repeats: int) -> list[list[str]]:
    """Return the lines of the table for a scene; seconds are the least of all rounds."""
    declared = Scene.load(name)
    scene = declared.with_values({"time.timestep": declared.time.sample / FIRST})
    engines = {each: NetworkEngine.on(device) for each, device in (("C", "cpu"), ("NumPy", "numpy"), ("JAX", "jax"))}
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        error = errors(scene, Path(folder))
        found = [longest(error, target) for target in TARGETS]
    for per_sample, reached in found:
        fine = stepped(scene, per_sample)
        jobs = {"LAMMPS": partial(seconds, fine, kernel=False), "kernel": partial(seconds, fine, kernel=True)}
        for each, engine in engines.items():
            jobs[each] = partial(seconds, fine, engine=engine)
        done = {each: [spent for _, spent in rounds] for each, rounds in interleave(jobs, repeats + 1).items()}
        least = [min(spent[1:]) for spent in done.values()]
        compiling = f"{done['JAX'][0] - least[-1]:.2g}" if per_sample == found[0][0] else ""
        rows.append(
            [name, str(scene.shape.spheres), f"{reached:.1e}", f"{fine.time.step:.3g}", str(fine.time.steps)]
            + [f"{each:.2g}" for each in least]
            + [compiling]
        )
    return rows


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.same_error", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE", help="waves (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="rounds after the first (default 3)")
    options = parser.parse_args(argv)
    if hasattr(os, "sched_setaffinity"):  # before JAX starts its threads, as they wait at the price of the processor
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    print(machine() + "\n")
    with tempfile.TemporaryDirectory() as cache:  # so that JAX compiles
        os.environ["JAX_COMPILATION_CACHE_DIR"] = cache
        print(table(HEAD, [row for name in options.scenes for row in lines(name, options.repeats)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
