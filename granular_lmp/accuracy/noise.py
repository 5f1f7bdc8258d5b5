"""Signals of a run that count for its tolerance: they neither vanish by symmetry nor are lost in rounding."""

from collections.abc import Mapping, Sequence
from math import inf, prod

import numpy as np

from granular_lmp.accuracy.extrapolation import Signals
from granular_lmp.accuracy.rounding import grain, judged, moving, noise_floor
from granular_lmp.errors import ToleranceError
from granular_lmp.problem import Problem
from granular_lmp.rest.held import largest_step
from granular_lmp.runs.components import FORCES, NAMES, RATES
from granular_lmp.scene.monitor_kinds import OF_ROWS

# Noise of one run that the estimate sees: twice the distance of the sums of three runs and of two holds 2.6 times that
# of steps as 2, 3, 4 and 2.8 times that of 4, 5, 8, if it is independent; 0.3 times that of 1, 2, 4
_SEEN = 3.0
# The law for one run gives noise within a factor of three, and sums of uneven steps raise the noise
_WITHIN, _LAW = 3.0, 5.0
_KINDS = (NAMES, RATES, FORCES, *((name,) for name in OF_ROWS))


def counted(problem: Problem, signals: Signals) -> list[str]:
    """Return the names of the signals that do not vanish by symmetry; monitors are compared within a kind."""
    centre = {name: values for name, values in signals.items() if "." not in name}
    names = judged(problem, centre)
    for monitor in dict.fromkeys(name.rpartition(".")[0] for name in signals if name not in centre):
        for kind in _KINDS:
            there = [f"{monitor}.{name}" for name in kind]
            names += moving({name: signals[name] for name in there if name in signals})
    return names


def noise_of(problem: Problem, signals: Signals) -> dict[str, float]:
    """Return the relative rounding noise of each signal in a run with the step of the problem.

    For displacements and forces it is the larger of `noise_floor` and `grain`. For rates it is larger by the highest
    frequency of the crystal, and for a sum over a row it follows from the factors.
    """
    scene = problem.scene
    noise, fastest = max(noise_floor(scene), grain(scene)), 2 / largest_step(scene)
    sizes = {name: _rms(values) for name, values in signals.items()}

    def level(name: str) -> float:
        monitor, _, column = name.rpartition(".")
        if column not in OF_ROWS:
            return noise * (fastest if column in RATES else 1.0)
        factors = OF_ROWS[column].product
        parts = {"rate": [each for each in RATES if not each.startswith("phi")], "force": FORCES}
        size = {kind: max(sizes.get(f"{monitor}.{each}", 0.0) for each in parts[kind]) for kind in factors}
        noisy = {"rate": fastest, "force": 1.0}
        others = (factors[:k] + factors[k + 1 :] for k in range(len(factors)))
        terms = [noisy[kind] * prod(size[each] for each in rest) for kind, rest in zip(factors, others, strict=True)]
        return noise * sum(terms) * float(np.sqrt(scene.shape.columns))

    return {name: level(name) / size if size else inf for name, size in sizes.items()}


def lost(problem: Problem, signals: Signals, finest: Problem) -> dict[str, float]:
    """Return the noise of signals whose noise exceeds ``time.tolerance``, from the signals of the first run.

    They include signals that vanish by symmetry.

    Parameters
    ----------
    problem : Problem
        Problem with the tolerance.
    signals : dict
        Signals of the first run.
    finest : Problem
        Problem with the shortest planned step.

    Raises
    ------
    ToleranceError
        If no counted signal remains.
    """
    tolerance = problem.scene.time.clock.tolerance
    found = {name: n for name, n in noise_of(finest, signals).items() if _SEEN * n > tolerance}
    refuse_noise(tolerance, found, counted(problem, signals))
    return found


def refuse_noise(tolerance: float, noise: Mapping[str, float], names: Sequence[str]) -> None:
    """Raise ToleranceError if all counted signals, by name, are lost in noise."""
    if noise.keys() >= {*names}:
        least = min((_SEEN * noise[name] for name in names), default=inf)
        bound = f"; must be at least {least:.2g}, or" if least < inf else ": nothing moves;"
        raise ToleranceError(
            f"time.tolerance = {tolerance!r}: rounding alone makes larger errors in all recorded signals{bound} use a "
            "larger wave.amplitude or fewer packing.rows, or record where and when there is a wave"
        )


def out_of_reach(
    tolerance: float,
    run: Problem,
    signals: Signals,
    before: Mapping[str, float],
    now: Mapping[str, tuple[float, Problem]],
) -> dict[str, float]:
    """Return the noise of the signals that shorter steps cannot bring below the tolerance.

    Either rounding exceeds the tolerance at the step that they need, or their errors stop decreasing, possibly because
    of noise.

    Parameters
    ----------
    tolerance : float
    run : Problem
        Problem of the last run, with its step.
    signals : dict
        Signals of that run.
    before : dict
        Estimated errors without this run.
    now : dict
        Estimated errors above the tolerance, and the problem with the step that should meet it.
    """
    here, found = noise_of(run, signals), {}
    for name, (error, finer) in now.items():
        there = noise_of(finer, signals)[name]
        if there > _WITHIN * tolerance:
            found[name] = there
        elif error >= before.get(name, inf) and _LAW * _SEEN * here[name] > tolerance:
            found[name] = here[name]
    return found


def said(noise: Mapping[str, float], tolerance: float) -> str:
    """Return the sentence on lost signals."""
    names = ", ".join(f"{name} ({value:.1g})" for name, value in noise.items())
    return (
        f"{names}: at the step that it needs this share is rounding, so it cannot meet the tolerance of {tolerance:g} "
        "and is not counted; use a larger wave.amplitude or fewer packing.rows"
    )


def _rms(values: Sequence[float] | np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else 0.0
