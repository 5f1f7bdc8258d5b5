"""The error budget of a run: the time step, the walls, and rounding.

All are relative L2 errors over the run, against the infinite lattice with the same contacts. From one run the error of
the time step is known only for the signals that a running plane wave along y has by linear theory: it is the phase
error of velocity Verlet, (ΩΔτ)²Ωτ/(24√3). A wave that decays as e^{−Γτ} has an error of first order in addition,
because LAMMPS's dashpots have the velocity of half a step before:

    u_{n+1} − 2u_n + u_{n−1} = −(ΩΔτ)² u_n − 2ΓΔτ (u_n − u_{n−1})

The error of all other signals takes the several runs of a tolerance. The distance between theory and run is the subject
of `analysis.measure.budget`.
"""

from collections.abc import Mapping
from math import ceil, log2, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.ladder import phase_error
from granular_lmp.accuracy.rounding import judged, linear_signals, rounding, walls
from granular_lmp.effects.effect import Case
from granular_lmp.effects.selection import order
from granular_lmp.scene.linear import mode_of
from granular_lmp.scene.scene import Scene

Errors = dict[str, float]


def error_budget(
    scene: Scene, signals: Mapping[str, NDArray[np.float64]], estimate: Errors | None = None
) -> list[dict[str, Any]]:
    """Return the sources of error of a run, as ``run.json`` holds them.

    Parameters
    ----------
    scene : Scene
        Scene with a time step, or with the tolerance that the estimate belongs to.
    signals : mapping
        Signals p, q, φ of the record, (T,) each, in D0.
    estimate : dict, optional
        Relative errors of an extrapolated record (`granular_lmp.accuracy.richardson.estimate`).

    Returns
    -------
    list of dict
        ``name``; ``p``, ``q``, ``phi``, which are None if the signal vanishes by symmetry or one run does not show its
        error; ``to_halve``, the change that halves the error; of the time step also ``order``, that of the error of a
        run in the step, 0 if it is no series (`granular_lmp.effects.selection.order`).
    """
    stepped, remedy = _time_step(scene) if estimate is None else (estimate, _tighter(estimate))
    more = 2 * ceil(0.35 * scene.shape.centre_row ** (1 / 3))  # Ai halves in 0.35 of its width, d^{1/3} rows
    farther = f"packing.rows = {scene.shape.rows + more}"
    farther += f", packing.columns = {scene.shape.columns + more}" if "sides" in scene.shape.faces else ""
    table: list[tuple[str, Errors, str]] = [
        ("time step", stepped, remedy),
        (
            "walls",
            dict.fromkeys(judged(scene, signals), walls(scene)),
            farther if scene.shape.faces else "nothing to halve: a periodic cell",
        ),
        ("rounding", rounding(scene, signals), "wave.amplitude x 2 (p of TR, RT: x 1.41), or half the packing.rows"),
    ]
    lines: list[dict[str, Any]] = [
        {"name": name, **{signal: errors.get(signal) for signal in ("p", "q", "phi")}, "to_halve": to_halve}
        for name, errors, to_halve in table
    ]
    lines[0]["order"] = order(scene)
    return lines


def _time_step(scene: Scene) -> tuple[Errors, str]:
    step = scene.time.step
    names = linear_signals(scene)
    if not names:
        return {}, f"time.timestep = {step * 0.5 ** (1 / max(order(scene), 1)):.3g}"
    frequency = mode_of(scene).frequency
    decay = Case(scene).decay_rate if scene.effects.damping is True else 0.0
    error, finer = (wave_error(frequency, decay, each, scene.time.duration) for each in (step, step / 2))
    return dict.fromkeys(names, error), f"time.timestep = {step * 0.5 ** (1 / log2(error / finer)):.3g}"


def wave_error(frequency: float, decay: float, step: float, duration: float) -> float:
    """Return the relative L2 error of a wave that decays, of frequency Ω without its decay (1/t0), by the step (τ)."""
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
