"""Error budget of a run: time step, walls, and rounding.

All are relative L2 errors over the run, against the infinite lattice with the same contacts. One run gives the error of
the time step only for a running plane wave along y. In the signals of linear theory it is the phase error of velocity
Verlet, (ΩΔτ)²Ωτ/(24√3). In p it is the change of the second harmonic by the step (`granular_lmp.accuracy.oscillator`),
unless p is something else, as near an antiresonance. A wave that decays as e^{−Γτ} also has an error of first order,
because dashpots in LAMMPS use the velocity of half a step earlier:

    u_{n+1} − 2u_n + u_{n−1} = −(ΩΔτ)² u_n − 2ΓΔτ (u_n − u_{n−1})

The error of all other signals needs the several runs of a tolerance. For the difference between theory and run see
`granular_analysis.measure.budget`.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import ceil, hypot, log2, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.oscillator import late_shear, oscillator_of
from granular_lmp.accuracy.rounding import judged, linear_signals, rounding, walls
from granular_lmp.accuracy.verlet import phase_error
from granular_lmp.effects.case import Case
from granular_lmp.effects.selection import order
from granular_lmp.problem import Problem

Floats = NDArray[np.float64]
Errors = dict[str, float]
Signals = Mapping[str, Floats]

_OTHER = 0.5  # share of p that is not the second harmonic, above which the error of p is unknown


def error_budget(problem: Problem, signals: Signals, estimate: Errors | None = None) -> list[dict[str, Any]]:
    """Return the sources of error of a run, for ``run.json``.

    Parameters
    ----------
    problem : Problem
        Problem of a scene with a time step, or with the tolerance of the estimate.
    signals : mapping
        Signals p, q, φ of the record, (T,) each, in D0.
    estimate : dict, optional
        Relative errors of an extrapolated record (`granular_lmp.accuracy.estimates.Estimate`).

    Returns
    -------
    list of dict
        ``name``; ``p``, ``q``, ``phi``, which are None if the signal vanishes by symmetry or one run does not show its
        error; ``to_halve``, the change that halves the error. The time step also has ``order``, the order of the error
        in the step, 0 if there is no expansion (`granular_lmp.effects.selection.order`).
    """
    scene = problem.scene
    stepped, remedy = _time_step(problem, signals) if estimate is None else (estimate, _tighter(estimate))
    more = 2 * ceil(0.35 * scene.shape.centre_row ** (1 / 3))  # Ai halves in 0.35 of its width, d^{1/3} rows
    farther = f"packing.rows = {scene.shape.rows + more}"
    farther += f", packing.columns = {scene.shape.columns + more}" if "sides" in scene.shape.faces else ""
    table: list[tuple[str, Errors, str]] = [
        ("time step", stepped, remedy),
        (
            "walls",
            dict.fromkeys(judged(problem, signals), walls(problem)),
            farther if scene.shape.faces else "nothing to halve: a periodic cell",
        ),
        ("rounding", rounding(problem, signals), "wave.amplitude x 2 (p of TR, RT: x 1.41), or half the packing.rows"),
    ]
    lines: list[dict[str, Any]] = [
        {"name": name, **{signal: errors.get(signal) for signal in ("p", "q", "phi")}, "to_halve": to_halve}
        for name, errors, to_halve in table
    ]
    lines[0]["order"] = order(scene)
    return lines


def _time_step(problem: Problem, signals: Signals) -> tuple[Errors, str]:
    """Return the known errors of the signals due to the step, and a step that halves the largest."""
    step, of_step = problem.scene.time.step, _errors_by_step(problem, signals)
    errors = of_step(step)
    if not errors:
        return {}, f"time.timestep = {step * 0.5 ** (1 / max(order(problem.scene), 1)):.3g}"
    aim, longer = max(errors.values()) / 2, step
    while (below := max(of_step(longer / 2).values())) > aim:
        longer /= 2
    above = max(of_step(longer).values())
    return errors, f"time.timestep = {longer * 0.5 ** (log2(above / aim) / log2(above / below)):.3g}"


def _errors_by_step(problem: Problem, signals: Signals) -> Callable[[float], Errors]:
    """Return the errors of the signals of a run as functions of its step (τ)."""
    names, scene = linear_signals(problem), problem.scene
    if not names:
        return lambda _: {}
    decay = Case(scene, problem.on).decay_rate if scene.effects.damping is True else 0.0
    alike = not decay and order(scene) and "p" in judged(problem, signals)
    harmonic = _harmonic_error(problem, signals["p"], "p" in names) if alike else None

    def errors(step: float) -> Errors:
        found = dict.fromkeys(names, wave_error(problem.rest.frequency, decay, step, scene.time.duration))
        return found if harmonic is None else found | {"p": hypot(found.get("p", 0.0), harmonic(step))}

    return errors


def _harmonic_error(problem: Problem, p: Floats, linear: bool) -> Callable[[float], float] | None:
    """Return the error of the second harmonic relative to p as a function of the step (τ); None if p is something else.

    For L, whose p is `linear`, it is only the part of late shear forces; all other changes are small.
    """
    scene = problem.scene
    tau: Floats = scene.time.sample * np.arange(len(p), dtype=float)
    exact = oscillator_of(scene)
    shapes, without = exact.shapes(tau), p - late_shear(scene, replace(exact, step=scene.time.step), tau)
    factors = np.zeros(shapes.shape[1]) if linear else np.linalg.lstsq(shapes, without)[0]
    size = float(np.linalg.norm(without))
    if not linear and np.linalg.norm(without - shapes @ factors) > _OTHER * size:
        return None

    def error(step: float) -> float:
        stepped = replace(exact, step=step)
        changed = (stepped.shapes(tau) - shapes) @ factors + late_shear(scene, stepped, tau)
        return float(np.linalg.norm(changed)) / size

    return error


def wave_error(frequency: float, decay: float, step: float, duration: float) -> float:
    """Return the relative L2 error of a decaying wave of undamped frequency Ω (1/t0), as a function of the step (τ)."""
    if decay == 0:
        return phase_error(frequency, step, duration)
    kept = 1 - 2 * decay * step
    exact = complex(-decay, sqrt(max(frequency**2 - decay**2, 0.0)))
    half = (1 + kept - (frequency * step) ** 2) / 2
    stepped = np.log(complex(half, sqrt(max(kept - half**2, 0.0)))) / step
    tau = np.linspace(0, duration, 1000)
    wave = np.exp(exact * tau)
    return float(np.linalg.norm(np.exp(stepped * tau) - wave) / np.linalg.norm(wave))


def _tighter(estimate: Errors) -> str:
    return f"time.tolerance = {max(estimate.values(), default=0.0) / 2:.2g}"
