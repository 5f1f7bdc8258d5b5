"""Signals of a run that count for its tolerance: not those that vanish by symmetry, nor those lost in rounding."""

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
# The law of one run gives noise to within a factor of three, and sums of uneven steps raise it
_WITHIN, _LAW = 3.0, 5.0
_KINDS = (NAMES, RATES, FORCES, *((name,) for name in OF_ROWS))


def counted(problem: Problem, signals: Signals) -> list[str]:
    """Return the names of the signals that do not vanish by symmetry, those of monitors beside others of their kind."""
    centre = {name: values for name, values in signals.items() if "." not in name}
    names = judged(problem, centre)
    for monitor in dict.fromkeys(name.rpartition(".")[0] for name in signals if name not in centre):
        for kind in _KINDS:
            there = [f"{monitor}.{name}" for name in kind]
            names += moving({name: signals[name] for name in there if name in signals})
    return names


def noise_of(problem: Problem, signals: Signals) -> dict[str, float]:
    """Return the rounding noise of each signal relative to it, in a run with the step of the problem.

    That of displacements and forces is `noise_floor` or `grain`, whichever is larger; that of their rates is higher by
    the highest frequency of the crystal, and the one of a sum over a row follows from its factors.
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
    """Return the noise of the signals that it keeps above ``time.tolerance``, from those of the first run.

    Signals that vanish by symmetry are among them.

    Parameters
    ----------
    problem : Problem
        Problem with the tolerance.
    signals : dict
        Signals of the first run.
    finest : Problem
        The same with the shortest step that is planned.

    Raises
    ------
    ToleranceError
        If no signal is left that counts.
    """
    tolerance = problem.scene.time.clock.tolerance
    found = {name: n for name, n in noise_of(finest, signals).items() if _SEEN * n > tolerance}
    refuse_noise(tolerance, found, counted(problem, signals))
    return found


def refuse_noise(tolerance: float, noise: Mapping[str, float], names: Sequence[str]) -> None:
    """Raise ToleranceError if all signals that count, by name, are lost in noise."""
    if noise.keys() >= {*names}:
        least = min((_SEEN * noise[name] for name in names), default=inf)
        bound = f"; must be at least {least:.2g}, or" if least < inf else ": nothing moves;"
        raise ToleranceError(
            f"time.tolerance = {tolerance!r}: rounding alone makes larger errors in all that is recorded{bound} take a "
            "larger wave.amplitude or fewer packing.rows, or record where and when the wave is there"
        )


def out_of_reach(
    tolerance: float,
    run: Problem,
    signals: Signals,
    before: Mapping[str, float],
    now: Mapping[str, tuple[float, Problem]],
) -> dict[str, float]:
    """Return the noise of the signals that shorter steps do not bring below the tolerance.

    Rounding surely drowns them at the step that they need, or they do not come closer and noise may be the reason.

    Parameters
    ----------
    tolerance : float
    run : Problem
        Problem of the last run, with its step.
    signals : dict
        Signals of that run.
    before : dict
        Estimated errors without that run.
    now : dict
        Estimated errors above the tolerance, and the problem with the step that is expected to meet it.
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
    """Return the sentence about signals that are lost."""
    names = ", ".join(f"{name} ({value:.1g})" for name, value in noise.items())
    return (
        f"{names}: this share of it is rounding at the step that it needs, so that it cannot meet the tolerance of "
        f"{tolerance:g} and is not counted; take a larger wave.amplitude or fewer packing.rows"
    )


def _rms(values: Sequence[float] | np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else 0.0
