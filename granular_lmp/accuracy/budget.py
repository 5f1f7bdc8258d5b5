"""The error budget of a run: the time step, the walls, and rounding.

All are relative L2 errors over the run, against the infinite lattice with the same contacts. From one run the error of
the time step is known only for the signals that a running plane wave along y has by linear theory: it is the phase
error of velocity Verlet, (ΩΔτ)²Ωτ/(24√3). The error of all other signals takes the several runs of a tolerance. The
distance between theory and run is the subject of `analysis.measure.budget`.
"""

from collections.abc import Mapping
from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.ladder import phase_error
from granular_lmp.accuracy.rounding import judged, linear_signals, rounding, walls
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
        error; ``to_halve``, the change that halves the error.
    """
    stepped, remedy = _time_step(scene) if estimate is None else (estimate, _tighter(estimate))
    held = scene.shape.ends == "fixed"
    more = 2 * ceil(0.35 * scene.shape.centre_row ** (1 / 3))  # Ai halves in 0.35 of its width, d^{1/3} rows
    table: list[tuple[str, Errors, str]] = [
        ("time step", stepped, remedy),
        (
            "walls",
            dict.fromkeys(judged(scene, signals), walls(scene)),
            f"packing.rows = {scene.shape.rows + more}" if held else "nothing to halve: a periodic cell",
        ),
        ("rounding", rounding(scene, signals), "wave.amplitude x 2 (p of TR, RT: x 1.41), or half the packing.rows"),
    ]
    return [
        {"name": name, **{signal: errors.get(signal) for signal in ("p", "q", "phi")}, "to_halve": to_halve}
        for name, errors, to_halve in table
    ]


def _time_step(scene: Scene) -> tuple[Errors, str]:
    step = scene.time.step
    error = phase_error(mode_of(scene).frequency, step, scene.time.duration)
    return dict.fromkeys(linear_signals(scene), error), f"time.timestep = {step / sqrt(2):.3g}"


def _tighter(estimate: Errors) -> str:
    return f"time.tolerance = {max(estimate.values(), default=0.0) / 2:.2g}"
