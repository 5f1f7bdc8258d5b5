"""The cost of accuracy in an impact: a sweep over its time step, with the error and the seconds of each run.

The longest step is a 16th of the shortest collision T, rounded down to fit a sample, and each other half of the one
before. Errors are the largest of all velocities, over the velocity of the fastest striker, against the answer of the
last three runs (`granular_lmp.impact.tolerance`), whose own error is estimated.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.halving import extrapolated
from granular_lmp.errors import ToleranceError
from granular_lmp.impact.problem import prepare
from granular_lmp.impact.record import ImpactRecord
from granular_lmp.impact.scene import ImpactScene
from granular_lmp.impact.tolerance import answer, estimate, signals
from granular_lmp.lammps.outputs import csv_text, replace_text, writable
from granular_lmp.studies.sweep import Progress, sweep

LONGEST = 16  # steps in the shortest collision
RUNS = 6
TABLE = "cost.csv"
_ANY = 1e-3


@dataclass(frozen=True)
class ImpactCost:
    """Cost of the steps of an impact.

    Attributes
    ----------
    rows : list of dict
        For each step, the longest first: ``steps_in_collision``, ``timestep`` (t0), ``steps``, ``seconds``, ``error``
        of its run, and ``error_extrapolated`` of its run and the one before, None of the first.
    order : int
        Order of the error in the step, 2 or 1.
    reference : float
        Estimated error of what errors are measured against.
    """

    rows: list[dict[str, Any]]
    order: int
    reference: float

    def to_csv(self) -> str:
        """Return the table as CSV."""
        return csv_text(self.rows[0], (row.values() for row in self.rows))

    def text(self) -> str:
        """Return the table for a terminal; errors below that of the reference are marked with <."""
        lines = [f"{'step':>8}{'in t0':>12}{'steps':>9}{'seconds':>10}{'error':>11}{'with the one before':>21}"]
        for row in self.rows:
            lines.append(
                f"{'T/' + format(row['steps_in_collision'], '.4g'):>8}{row['timestep']:12.4g}{row['steps']:9d}"
                f"{row['seconds']:10.3g}{self._cell(row['error']):>11}{self._cell(row['error_extrapolated']):>21}"
            )
        said = (
            f"the error is of order {self.order} in the step; that of the reference is estimated: {self.reference:.1e}"
        )
        return "\n".join([*lines, said])

    def _cell(self, error: float | None) -> str:
        if error is None:
            return "-"
        return f"<{self.reference:.1e}" if error < self.reference else f"{error:.1e}"


def cost_of_impact(
    scene: ImpactScene,
    folder: str | Path,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> ImpactCost:
    """Run an impact with six steps and return what each costs; ``cost.csv`` in the folder of the sweep holds it.

    Parameters
    ----------
    scene : ImpactScene
        Its step or tolerance is replaced, and may be any.
    folder, executor, progress
        As in `granular_lmp.studies.sweep.sweep`; a study that was stopped goes on.

    Raises
    ------
    ToleranceError
        If a run fails, or the runs do not converge, so that no error is known.
    SceneError, RunFolderError, RunInterrupted
        As `granular_lmp.studies.sweep.sweep`.
    """
    # With a tolerance a scene has no step that could be too long, or tell apart two studies of one impact
    scene = scene.with_values({"time.tolerance": _ANY})
    collision, sample = prepare(scene).shortest_collision, scene.time.sample
    per_sample = ceil(sample * LONGEST / collision)
    steps = [sample / (per_sample << halvings) for halvings in range(RUNS)]
    done = sweep(scene, {"time.timestep": steps}, folder, executor=executor, progress=progress)
    for row in done.having("failed"):
        raise ToleranceError(f"time.timestep = {row['time.timestep']!r}: {row['message']}")
    records = [record for record in map(done.record, done.rows) if isinstance(record, ImpactRecord)]
    p = shown_order(records)
    if p is None:
        raise ToleranceError(f"{done.folder}: the runs do not converge with the step, so that no error is known")
    best = answer(records).velocity
    found = []
    for number, (row, record) in enumerate(zip(done.rows, records, strict=True)):
        pair = extrapolated(records[number - 1].velocity, record.velocity, p) if number else None
        step = record.scene.time.step
        found.append(
            {
                "steps_in_collision": collision / step,
                "timestep": step,
                "steps": row["steps"],
                "seconds": row["seconds"],
                "error": _largest(record.velocity - best),
                "error_extrapolated": None if pair is None else _largest(pair - best),
            }
        )
    cost = ImpactCost(found, p, estimate(records).errors["velocity"])
    with writable(done.folder):
        replace_text(done.folder / TABLE, cost.to_csv())
    return cost


def shown_order(runs: Sequence[ImpactRecord]) -> int | None:
    """Return the order of the error in the step that the last three runs show: 2, 1, or None if they do not converge.

    Each has half the step of the one before; their differences have L2 norms of the ratio 2^order.
    """
    made = [{name: values for name, values in signals(run).items() if name != "displacement"} for run in runs[-3:]]
    first, second = (sqrt(sum(float(np.sum((b[name] - a[name]) ** 2)) for name in a)) for a, b in pairwise(made))
    if second == 0 or first >= 2**1.5 * second:
        return 2
    return 1 if first >= 2**0.5 * second else None


def _largest(difference: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(difference)))
