"""Forecast of a run, made without doing it: its size, seconds on this machine, and memory.

The seconds are those of a short run of the same deck just now, in proportion. Of a large crystal that is a run of a
cell of the same spheres and effects, for a few steps of it would take as long as many runs.
"""

from dataclasses import dataclass
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory

from granular_lmp.accuracy.ladder import RUNGS, build, planned_steps
from granular_lmp.accuracy.tolerance import run
from granular_lmp.errors import GranularError
from granular_lmp.lammps.checkpoints import minutes_between
from granular_lmp.problem import Problem
from granular_lmp.scene.scene import Scene

_WARM_UP = 2e5  # sphere-steps of the short run: 50 ms
_LARGEST = 20_000  # spheres of a crystal that is measured itself: two runs of it start in half a second
_CELL = 100  # rows and columns of the cell that stands for a larger one
# Measured, the most that a process held: 71 MB for 48 spheres, 170 MB for 90 000, 279 MB for 180 000
_PROCESS = 71e6
_SPHERE = 1160.0
# Share of the loop that more ranks do not shorten, at most: 2 ranks took 0.52 to 0.55 of it, 4 ranks 0.30
SERIAL = 0.1


@dataclass(frozen=True)
class Forecast:
    """Size, time and memory of a run of a scene.

    Attributes
    ----------
    spheres, steps, records, runs : int
        Steps of all runs together; more than one run where the scene has a tolerance.
    snapshots : int
        Of all spheres.
    start : float or None
        Seconds beside the time loop, which more ranks do not shorten; None where LAMMPS cannot be asked.
    seconds : float or None
        Of a run on one rank, with `start`; None where LAMMPS cannot be asked.
    basis : str
        What the seconds were made of, or why there are none.
    memory : float
        Bytes.
    checkpoint : float or None
        Minutes between two checkpoints; None for a single column, which is not continued.
    """

    spheres: int
    steps: int
    records: int
    runs: int
    snapshots: int
    start: float | None
    seconds: float | None
    basis: str
    memory: float
    checkpoint: float | None

    def on(self, ranks: int) -> tuple[float, float] | None:
        """Return the least and the most seconds on some MPI ranks; None where those on one are unknown.

            start + loop/R  to  start + loop (1/R + s (1 − 1/R)),    s = `SERIAL`

        On 2 and 4 ranks of one machine sheets of 1e4 to 1e6 spheres lie between the two; more ranks are extrapolated.
        Less than a thousand spheres a rank gain less.
        """
        if self.start is None or self.seconds is None:
            return None
        loop = self.seconds - self.start
        return self.start + loop / ranks, self.start + loop * (1 / ranks + SERIAL * (1 - 1 / ranks))


def forecast(problem: Problem) -> Forecast:
    """Return what a run of the problem's scene would take; a short run is made in a temporary folder.

    The seconds break down where the steps grow dearer on the way, as they do with opening contacts, and where the
    machine has other work now than later: take them for a factor of two.
    """
    scene, declared = problem.scene, problem.declared
    spheres, steps = scene.shape.spheres, planned_steps(declared)
    every = scene.output.particles
    try:
        rate, start, basis = _measured(scene)
    except GranularError as error:
        rate, start, basis = None, None, f"unknown: {error}"
    return Forecast(
        spheres=spheres,
        steps=steps,
        records=scene.time.samples + 1,
        runs=1 if declared.time.tolerance is None else RUNGS,
        snapshots=int(scene.time.duration / every + 1e-9) + 1 if every else 0,
        start=start,
        seconds=None if rate is None or start is None else start + spheres * steps / rate,
        basis=basis,
        memory=_PROCESS + _SPHERE * spheres,
        checkpoint=None if scene.shape.single_column else minutes_between(scene.output.checkpoint, scene.shape.spheres),
    )


def _measured(scene: Scene) -> tuple[float | None, float | None, str]:
    """Return sphere-steps a second, seconds beside the loop, and what they were made of."""
    spheres, small = scene.shape.spheres, scene
    if spheres > _LARGEST:
        columns = _CELL if scene.lattice.endless_rows else 1
        small = scene.with_values(
            {
                **{"packing.rows": _CELL**2 // columns, "packing.columns": columns, "packing.ends": "periodic"},
                **{"wave.form": "running", "output.particles": 0.0, "time.allow_echo": True},
                **{"source": [], "monitor": []},
                **{f"envelope.{key}": 0.0 for key in ("length", "width", "offset")},
            }
        )
    rate, overhead = speed(small)
    cell = "this scene" if small is scene else f"a cell of {small.shape.words}"
    start = overhead * spheres / small.shape.spheres
    return rate, start, f"a short run of {cell} just now, {rate:.2g} sphere-steps a second"


def speed(scene: Scene) -> tuple[float, float]:
    """Return sphere-steps a second and the seconds beside the time loop, of a short run in a warm process."""
    per_sample = scene.shape.spheres * scene.time.steps_per_sample
    duration = scene.time.sample * min(ceil(_WARM_UP / per_sample), scene.time.samples)
    short = scene.with_values({"time.duration": duration, "packing.rows": scene.shape.rows})
    with TemporaryDirectory(prefix="granular-lmp-") as folder:
        for name in ("cold", "warm"):  # the first run starts LAMMPS
            info = run(build(short), Path(folder) / name).info
    return info["particles"] * info["steps"] / info["wall_seconds"]["loop"], info["wall_seconds"]["other"]
