"""Two runs that differ in the time step alone: a better answer, and the error of the finer one.

Velocity Verlet's error is C Δτ² + O(Δτ⁴). Of two runs with steps Δτ and Δτ/2 the combination (4·fine − coarse)/3 is
free of the first term, and |fine − coarse|/3 is what is left in the finer run (Richardson extrapolation).

Below all that lies the rounding of positions, which no time step cures: `noise_floor`.
"""

from dataclasses import replace
from math import isclose

import numpy as np

from granular_lmp.deck import build
from granular_lmp.record import Record
from granular_lmp.scene import Scene
from granular_lmp.shape import FASTEST_ROWS_PER_TAU
from granular_lmp.units import units_for


def halved_step(scene: Scene) -> Scene:
    """The same scene with half the time step that it uses: the second run of a Richardson pair."""
    return scene.with_values({"time.timestep": scene.time.step / 2})


def richardson(coarse: Record, fine: Record) -> Record:
    """The extrapolated record of two runs of one scene, the second with half the step of the first.

    Returns
    -------
    Record
        With the scene of the finer run; ``info["error_estimate"]`` is the relative L2 error of its p, q and phi that
        the pair estimates (None where a component is zero). The extrapolated record itself is better than that.

    Raises
    ------
    ValueError
        When the records have other times, or steps whose ratio is not 2.

    Notes
    -----
    Breaks where the error is not of second order in the step: contacts that open and close, an incremental law, and
    below the rounding of the positions.
    """
    if coarse.tau.shape != fine.tau.shape or not np.allclose(coarse.tau, fine.tau, rtol=1e-12, atol=0):
        raise ValueError("the two records have different times")
    ratio = coarse.scene.time.step / fine.scene.time.step
    if not isclose(ratio, 2, rel_tol=1e-9):
        raise ValueError(f"the steps {coarse.scene.time.step!r} and {fine.scene.time.step!r} must have the ratio 2")
    signals, estimates = {}, {}
    for name in ("p", "q", "phi"):
        a, b = getattr(coarse, name), getattr(fine, name)
        signals[name] = (4 * b - a) / 3
        norm = np.linalg.norm(signals[name])
        estimates[name] = float(np.linalg.norm(b - a) / 3 / norm) if norm > 0 else None
    return replace(fine, **signals, info=fine.info | {"error_estimate": estimates}, folder=None)


def noise_floor(scene: Scene) -> float:
    """Rounding noise of p at the end of a run, standard deviation in units of D0.

        noise = √(steps/2) · ulp/√12 / D0,    ulp² = mean of the squared spacing of doubles at the y of the spheres

    Each step rounds each position to that spacing, 2^{−52}|y| or down to half of it: a kick of variance ulp²/12, of
    which the lattice, as it carries it away, keeps half in the displacements. So the floor rises as the root of the
    number of steps and in proportion to the length of the cell or its distance from the origin, and as 1/D0.

    Parameters
    ----------
    scene : Scene

    Notes
    -----
    A law of magnitudes, good to a factor of 3: with smaller steps at one duration the noise rises more slowly than the
    root (measured: 1.8-fold for sixteen times the steps, where the root says 4). q and φ are a few times quieter.
    Breaks for signals below `grain`, where roundings are not random: the noise is then smaller, and the signal lost.
    """
    return float(np.sqrt(scene.time.steps / 2) * _spacing(scene) / np.sqrt(12))


def grain(scene: Scene) -> float:
    """Smallest p, in units of D0, that moves positions at all: ulp/(4ΩΔτ D0), ulp as in `noise_floor`.

    A second harmonic p cos 2Ωτ moves a sphere by at most 2ΩΔτ p in a step. Where that is less than half the spacing of
    doubles at its position, the sum rounds back to where it was and p is not simulated: its error is p itself. Small
    steps make it worse.
    """
    return _spacing(scene) / (4 * build(scene).mode.frequency * scene.time.step)


def _spacing(scene: Scene) -> float:
    """Root mean square of the spacing of doubles at the y of the spheres that the centre hears, in D0."""
    packing, units = build(scene).packing, units_for(scene.sphere.radius)
    # What arrives at the centre left, on average, half-way through the run
    reach = max(FASTEST_ROWS_PER_TAU * scene.time.duration / 2, 1)
    near = np.abs(packing.arrays["row"] - scene.shape.centre_row) <= reach
    # The spacing jumps in twos, so the numbers of the deck count, not metres
    y = units.number(scene.sphere.radius, length=1) * packing.positions[near, 1]
    size = scene.wave.amplitude * units.number(scene.sphere.static_overlap, length=1)
    return float(np.sqrt(np.mean(np.spacing(np.abs(y)) ** 2)) / size)
