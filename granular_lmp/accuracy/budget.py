"""What a run knows of its own errors: the time step, the walls, and rounding.

All are relative L2 errors over the run, against the infinite lattice with the same contacts. Of the time step one run
knows the error of phase that velocity Verlet makes of the linear wave, (ΩΔτ)²Ωτ/(24√3), which is the error of the
signals that a running plane wave along y has by linear theory; of all else it takes more runs to see the error, as a
tolerance makes them. How far a theory is from the run is no business of the run: `analysis.measure.budget`.
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
    """Return the sources of error of a run that knows them, as ``run.json`` holds them.

    Parameters
    ----------
    scene : Scene
        With a time step, or with the tolerance that the estimate belongs to.
    signals : mapping
        p, q, φ of the record.
    estimate : dict, optional
        Relative errors of an extrapolated record (`granular_lmp.accuracy.richardson.estimate`).

    Returns
    -------
    list of dict
        ``name``; ``p``, ``q``, ``phi``, None where the signal vanishes by symmetry and where one run cannot tell;
        ``to_halve``, what it would take to halve the error.
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
