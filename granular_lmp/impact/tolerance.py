"""An impact to a tolerance: which steps are tried, the extrapolation of their runs, and the estimate of its error.

The error of every velocity and of R times every spin, over the unit v of the impact (`ImpactScene.scale`: the velocity
of the fastest striker), is at most ``time.tolerance``, as estimated. Three runs a, b, c, each with half the step of the
one before, show the order p of their error by the L2 norms of their differences,

    |a − b|/|b − c| = 2^p,

2 for spheres that slide on nothing, and 1 with damping or with friction and the law "incremental", whose forces LAMMPS
takes at half steps. The answer is (2^p c − b)/(2^p − 1), and its estimated error the largest difference from the same
answer of a and b, times `SAFETY`. Contacts that close and open inside a step leave an error of order 5/2 at no fixed
phase of the step, which no extrapolation removes; the difference holds it, but may be small by chance. So the error is
at least a `GAIN`-th of that of the last run, |b − c|/(2^p − 1). Runs that do not converge are not extrapolated: their
error is not known, and counts as infinite.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice, pairwise
from math import ceil, inf, isclose, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.accuracy.halving import Plan, extrapolated
from granular_lmp.errors import SceneError
from granular_lmp.impact.problem import ImpactProblem
from granular_lmp.impact.record import ImpactRecord
from granular_lmp.lammps.outputs import SNAPSHOTS

# The difference was at least 0.5 of the true error in 48 answers of a compressed chain whose contacts barely open,
# and 0.97 in 82 of other chains and of sheets (docs/impacts.md)
SAFETY = 3.0
GAIN = 10.0
RUNS = 3  # the fewest that show an order
MOST_STEPS = 10**9
# Steps in the shortest collision of the first run: at a tolerance of 1e-4, and the fewest. The answer of three runs is
# then estimated to err by 2e-5 to 2e-4 after 12 collision times
_STEPS_AT = (48.0, 1e-4)
_FEWEST = 16.0
_SHARE = 0.7  # of the longest step that a rule allows: spheres may come to press each other deeper on their way
_POWER = 2.5  # power of the step in the error of the answer
_MOVED = ("x", "y", "z", "Displacement.X", "Displacement.Y", "vx", "vy", "vz", "omegaz")  # columns of a dump
_HEAD = 9  # lines of a snapshot before its spheres


def plan(problem: ImpactProblem) -> Plan:
    """Return the steps of a scene with a tolerance.

    Raises
    ------
    SceneError
        If they are more than 1e9.
    """
    time = problem.scene.time
    assert time.tolerance is not None
    steps = max(_FEWEST, _STEPS_AT[0] * (_STEPS_AT[1] / time.tolerance) ** (1 / _POWER))
    longest = min(problem.shortest_collision / steps, *(each * _SHARE for each, _ in problem.step_rules))
    found = Plan(max(1, ceil(time.sample / longest)), RUNS)
    if found.steps_per_sample * time.samples > MOST_STEPS:
        raise SceneError(f"time.tolerance = {time.tolerance!r}: would take more than {MOST_STEPS} steps in this scene")
    return found


def planned(problem: ImpactProblem) -> ImpactProblem:
    """Return the problem of the last planned run, with its time step: the problem itself if it has no tolerance."""
    scene = problem.scene
    if scene.time.tolerance is None:
        return problem
    step = scene.time.sample / (plan(problem).per_sample << RUNS - 1)
    return replace(problem, scene=scene.with_values({"time.timestep": step}))


def planned_steps(problem: ImpactProblem) -> int:
    """Return the number of time steps of all planned runs."""
    time = problem.scene.time
    return time.steps if time.tolerance is None else plan(problem).steps_per_sample * time.samples


def order(runs: Sequence[ImpactRecord]) -> int | None:
    """Return the order of the error in the step, by the last three runs: 2, 1, or None if they do not converge.

    Raises ValueError if a run has not half the step of the one before.
    """
    if len(runs) < RUNS:
        return None
    steps = [each.scene.time.step for each in runs[-RUNS:]]
    if not all(isclose(longer, 2 * shorter, rel_tol=1e-9) for longer, shorter in pairwise(steps)):
        raise ValueError(f"the steps {steps} must each be half of the one before")
    coarse, middle, fine = map(_signals, runs[-RUNS:])
    first, second = (
        sqrt(sum(float(np.sum((b[name] - a[name]) ** 2)) for name in a)) for a, b in ((coarse, middle), (middle, fine))
    )
    if second == 0 or first >= 2**1.5 * second:
        return 2
    return 1 if first >= 2**0.5 * second else None


def estimate(runs: Sequence[ImpactRecord]) -> dict[str, float]:
    """Return the largest errors of velocities and spins, in the unit v of the impact, of the answer.

    inf where the order of the error is not known.
    """
    p = order(runs)
    names = _signals(runs[-1])
    if p is None:
        return dict.fromkeys(names, inf)
    a, b, c = map(_signals, runs[-RUNS:])
    older, newer = _combined(a, b, p), _combined(b, c, p)

    def largest(name: str) -> float:
        apart, of_run = newer[name] - older[name], (c[name] - b[name]) / (2**p - 1)
        return float(max(SAFETY * np.max(np.abs(apart)), np.max(np.abs(of_run)) / GAIN))

    return {name: largest(name) for name in names}


def answer(runs: Sequence[ImpactRecord]) -> ImpactRecord:
    """Return the extrapolation of the last two runs, of the order that the last three show."""
    p, (coarse, fine) = order(runs), runs[-2:]
    assert p is not None
    names = ("displacement", "velocity", "spin")
    a, b = ({name: getattr(each, name) for name in names} for each in (coarse, fine))
    return replace(fine, **_combined(a, b, p))


def _signals(record: ImpactRecord) -> dict[str, Any]:
    return {"velocity": record.velocity} | ({"spin": record.spin} if record.problem.on["rotation"] else {})


def _combined(coarse: dict[str, Any], fine: dict[str, Any], p: int) -> dict[str, Any]:
    return {name: extrapolated(coarse[name], fine[name], p) for name in coarse}


def write_dump(folder: Path, coarse: Path, fine: Path, p: int) -> None:
    """Write ``dump.particles`` of an answer into a folder, from those in the run folders of two runs.

    What does not move, and the steps, are those of the finer run.
    """
    with ExitStack() as files:
        one, two = (files.enter_context((each / SNAPSHOTS).open(encoding="utf-8")) for each in (coarse, fine))
        out = files.enter_context((folder / SNAPSHOTS).open("w", encoding="utf-8"))
        while head := list(islice(two, _HEAD)):
            list(islice(one, _HEAD))
            out.writelines(head)
            names = head[-1].split()[2:]
            moved = [name in _MOVED for name in names]
            for a, b in zip(islice(one, int(head[3])), islice(two, int(head[3])), strict=True):
                words = [
                    repr(extrapolated(float(x), float(y), p)) if moves else y
                    for x, y, moves in zip(a.split(), b.split(), moved, strict=True)
                ]
                out.write(" ".join(words) + "\n")
