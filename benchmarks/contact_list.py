"""The lower bound of particle codes: the contacts of the strip in one C loop, which knows this one problem only.

``contact_list.c`` is compiled by ``cc``, for this processor, when it first takes part.
"""

import ctypes
import shutil
import subprocess
import time
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.problem import Contestant, Solution, Start, base_scene, centre_signals
from granular_lmp import Scene

SOURCE = Path(__file__).with_suffix(".c")


@cache
def library() -> ctypes.CDLL:
    """Compile and load the loop."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "contact_list.so"
        subprocess.run(["cc", "-O3", "-march=native", "-shared", "-fPIC", SOURCE, "-lm", "-o", path], check=True)
        return ctypes.CDLL(str(path))


def solve(scene: Scene, folder: Path) -> Solution:
    """Compile the loop and run the strip of a scene with a time step and equal spheres."""
    start, sphere, steps = Start.of(scene), scene.sphere, scene.time.steps
    around = [start.size[0], 0.0]  # periodic along x only
    touching = cKDTree(start.position, boxsize=around).query_pairs(2 * sphere.radius, output_type="ndarray")
    pair = touching.astype(np.int32)
    apart = start.position[pair[:, 1]] - start.position[pair[:, 0]]
    apart[:, 0] -= around[0] * np.round(apart[:, 0] / around[0])
    moved, rates = start.displacement.copy(), start.velocity.copy()
    force, slip = np.zeros_like(moved), np.zeros(len(pair))
    inertia = 0.4 * sphere.mass * sphere.radius**2
    numbers = [sphere.radius, sphere.normal_coefficient, sphere.shear_coefficient, sphere.pull_off_force]
    constants = np.array([*numbers, sphere.mass, inertia])
    record = np.zeros((scene.time.samples + 1, 2))
    arrays = (pair, apart, moved, rates, force, slip, np.where(start.held, 0.0, 1.0))
    started = time.perf_counter()
    library().run(
        len(moved),
        len(pair),
        *(array.ctypes.data_as(ctypes.c_void_p) for array in arrays),
        ctypes.c_double(scene.time.step * sphere.time_scale),
        steps,
        scene.time.steps_per_sample,
        start.centre,
        *(array.ctypes.data_as(ctypes.c_void_p) for array in (constants, record)),
    )
    seconds = time.perf_counter() - started
    p, q = centre_signals(scene, record)
    return Solution(p, q, seconds, len(moved), steps)


def solve_pair(scene: Scene, folder: Path) -> Solution:
    """Extrapolate the runs with the step of the scene and with half of it, as a tolerance does."""
    one, two = (solve(scene.with_values({"time.timestep": scene.time.step / n}), folder) for n in (1, 2))
    assert one.steps is not None
    assert two.steps is not None
    p, q = ((4 * fine - coarse) / 3 for coarse, fine in ((one.p, two.p), (one.q, two.q)))
    return Solution(p, q, one.loop + two.loop, one.spheres, one.steps + two.steps)


def missing() -> str:
    """Why it cannot take part."""
    return "" if shutil.which("cc") else "no C compiler cc"


CONTESTANTS = [
    Contestant(
        f"list-{step:g}",
        f"contacts in C, 201 × 3, step {step:g}",
        partial(solve, base_scene().with_values({"time.timestep": step})),
        missing,
        series="contact list in C",
    )
    for step in (0.2, 0.1, 0.05, 0.025)
] + [
    Contestant(
        f"list-pair-{step:g}",
        f"contacts in C, 201 × 3, steps {step:g} and {step / 2:g} extrapolated",
        partial(solve_pair, base_scene().with_values({"time.timestep": step})),
        missing,
        series="contact list in C, pairs of steps",
    )
    for step in (0.5, 0.25, 0.125, 0.0625)
]
