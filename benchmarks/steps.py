"""Steps of LAMMPS's scheme by LAMMPS and by the network in compiled loops, JAX and NumPy, over packings and their size.

    python -m benchmarks.steps [--spheres N ...] [--repeats N]

All take the same steps of a wave to the same motion. Times are processor seconds of all threads, over contacts at rest
and steps: of LAMMPS, on one rank without and with the kernel, the time loop without the writing of snapshots; of JAX,
on the device that it chooses, a run that is compiled. The error is that of the step at 10 t0: the change of all
displacements when the step is halved, times 4/3, as the scheme is of second order, over the displacements; both as root
mean squares. What came out is in RESULTS.md.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmarks.network import processor_seconds, sized
from benchmarks.timing import both_ratios, interleave, machine, spread, table
from granular_analysis.measure.snapshot import FirstSnapshot, first_snapshot
from granular_analysis.theory import network_compiled, network_traced, network_verlet
from granular_lmp import Scene, run
from granular_lmp.lammps.outputs import LOG

STEP = 0.1  # τ
SPHERE_STEPS = 1_000_000  # of all but NumPy, which takes a tenth
FEWEST = 20  # steps
SPAN = 100  # steps that are compared with those of half the length
HEAD = [
    *("packing", "spheres", "LAMMPS, ns", "with the kernel, ns", "C, ns", "JAX, ns", "NumPy, ns"),
    *("C over the kernel", "JAX over the kernel", "NumPy over LAMMPS", "error of the step"),
]
PERFECT = {"disorder.density": 0.0, "disorder.radius": 0.0}


def perfect(spheres: int) -> Scene:
    """Return a sheet of equal spheres."""
    return sized(spheres).with_values(PERFECT)


def sliding(spheres: int) -> Scene:
    """Return a sheet with a wave that is large for its friction, so that contacts slide."""
    return sized(spheres).with_values({**PERFECT, "wave.amplitude": 0.2, "effects.friction": 0.04})


def in_space(spheres: int) -> Scene:
    """Return an fcc crystal, with six freedoms a sphere."""
    rows = 8 * max(1, round(spheres ** (1 / 3) / 8))
    edge = max(3, round((spheres / rows) ** 0.5))
    return Scene.load("fcc_transverse").with_values(
        {"packing.rows": rows, "packing.columns": edge, "packing.layers": edge}
    )


def layer(spheres: int) -> Scene:
    """Return a layer on a substrate, with six freedoms a sphere."""
    rows = 32 * max(1, round(spheres**0.5 / 32))
    columns = max(3, round(spheres / rows))
    return Scene.load("monolayer_rocking").with_values({"packing.rows": rows, "packing.columns": columns})


KINDS = {
    "perfect sheet": perfect,
    "unequal spheres": sized,
    "sliding": sliding,
    "fcc": in_space,
    "layer on a substrate": layer,
}


def stepped(scene: Scene) -> tuple[Scene, int]:
    """Return a scene with the step, and its number of steps."""
    count = 2 * max(FEWEST, round(SPHERE_STEPS / scene.shape.spheres / 2))
    times = {"time.timestep": STEP, "time.duration": count * STEP}
    return scene.with_values({**times, "time.sample": count / 2 * STEP, "output.particles": count / 2 * STEP}), count


def compared(scene: Scene, folder: Path) -> tuple[float, ...]:
    """Return ns a contact and step in the order of `HEAD`, and the error of the step."""
    scene, count = stepped(scene)
    first = first_snapshot(run(scene, folder / "run", kernel=False))
    run(scene, folder / "kernel", kernel=True)
    loop, kernel = (processor_seconds(folder / each / LOG) for each in ("run", "kernel"))
    contacts = np.count_nonzero(first.state.pairs.overlap > 0)
    few = max(FEWEST, count // 10)
    numpy = timed(partial(marched, network_verlet.march, first, few))
    marched(network_traced.march, first, count)  # compiles
    jax = timed(partial(marched, network_traced.march, first, count))
    compiled = timed(partial(marched, network_compiled.march, first, count))
    coarse = marched(network_compiled.march, first, SPAN)
    fine = marched(network_compiled.march, first, 2 * SPAN, STEP / 2)
    error = 4 / 3 * float(np.sqrt(np.mean((coarse - fine) ** 2) / np.mean(fine**2)))
    per_step = loop / count, kernel / count, compiled / count, jax / count, numpy / few
    return *(1e9 / contacts * each for each in per_step), error


def marched(march: Callable[..., Any], first: FirstSnapshot, count: int, step: float = STEP) -> Any:
    """Return the displacements after some steps of a run from its first snapshot."""
    *_, last = march(first.network, first.state, step * first.time, count, count)
    return last[: first.network.dimension]


def timed(job: Callable[[], object]) -> float:
    """Return the processor seconds of a job."""
    began = process_time()
    job()
    return process_time() - began


def line(kind: str, spheres: int, rounds: Sequence[tuple[float, ...]]) -> list[str]:
    """Return one line of the table; ratios are within rounds, and of the smallest times."""
    lammps, kernel, compiled, jax, numpy, errors = zip(*rounds, strict=True)
    spreads = [spread(each) for each in (lammps, kernel, compiled, jax, numpy)]
    ratios = [both_ratios(compiled, kernel), both_ratios(jax, kernel), both_ratios(numpy, lammps)]
    return [kind, str(spheres), *spreads, *ratios, f"{errors[0]:.1e}"]


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.steps", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--spheres", type=int, nargs="+", default=[600, 10_000, 100_000], metavar="N")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="rounds (default 3)")
    options = parser.parse_args(argv)
    repeats = max(options.repeats, 1)
    print(machine() + "\n")
    scenes = {(kind, count): scene(count) for kind, scene in KINDS.items() for count in options.spheres}
    jobs = {f"{kind}, {count}": partial(compared, scene) for (kind, count), scene in scenes.items()}
    done = interleave(jobs, repeats)
    rows = [
        line(kind, scene.shape.spheres, [each for _, each in done[f"{kind}, {count}"]])
        for (kind, count), scene in scenes.items()
    ]
    print(table(HEAD, rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
