"""Errors that no time step removes: the rounding of positions, and the held ends.

LAMMPS adds displacements of a fraction of the static overlap, 1e-10 m, to positions of up to 1e-4 m, so 10 of 16 digits
remain for the displacement of the farthest sphere.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.mode import Mode
from granular_lmp.errors import SceneError
from granular_lmp.problem import Problem
from granular_lmp.rest.linear import mode_of, plane_along_y
from granular_lmp.rest.resolution import farthest_rounding, position_rounding
from granular_lmp.rest.scene import Scene

# Share of the largest signal below which a signal counts as zero; rounding of a vanishing signal is 1e-9
_STILL = 1e-7
# Relative error due to the walls before their echo arrives (`granular_lmp.rest.shape.echo_time`)
WALL_ERROR = 1e-6


def moving(signals: Mapping[str, NDArray[np.float64]]) -> list[str]:
    """Return the names of the signals that are known and not zero by symmetry.

    A signal that is nan throughout was not tracked and is left out; one with some numbers that are not finite is
    included.
    """
    known = {name: values for name, values in signals.items() if not np.isnan(values).all()}
    sizes = {name: float(np.max(np.abs(values))) for name, values in known.items()}
    largest = max((size for size in sizes.values() if np.isfinite(size)), default=0.0)
    return [name for name, size in sizes.items() if not size <= _STILL * largest]


def judged(problem: Problem, signals: Mapping[str, NDArray[np.float64]]) -> list[str]:
    """Return the names of the signals whose error counts: those of `moving`, but only p of an L wave along y.

    A mirror symmetry makes q and φ of that wave zero, and at small amplitudes their rounding exceeds the threshold.
    """
    mirrored = plane_along_y(problem.scene) and problem.scene.require_wave().mode == "L"
    return [name for name in moving(signals) if name == "p" or not mirrored]


def linear_signals(problem: Problem) -> dict[str, NDArray[np.float64]]:
    """Return p, q, φ of a running plane wave along y by linear theory, in D0, at 16 phases of one period.

    A signal that vanishes in linear theory is left out, because only a run shows its size. The dictionary is empty for
    all other waves, whose amplitude at the centre sphere depends on place and time.
    """
    if problem.wave is None or not plane_along_y(problem.scene):
        return {}
    wave = np.exp(2j * np.pi * np.arange(16) / 16)
    return {name: share * wave.real for name, share in _shares(problem.wave.mode).items()}


def _shares(mode: Mode) -> dict[str, complex]:
    """Return the amplitudes of p, q, φ in a mode, in D0, of those that do not vanish."""
    shares = {"p": mode.p, "q": mode.q, "phi": mode.f}
    return {name: share for name, share in shares.items() if abs(share) > _STILL}


def rounding(problem: Problem, signals: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Return the relative error that the rounding of positions leaves in signals (in D0): ½ eps L/(their size).

    L is half the height of the packing for p and its width for q and φ. The law gives the magnitude: measured against
    the same steps without LAMMPS, the error was 0.4 to 1.3 times that for 201 rows and 500 to 5000 steps. It grows
    with the number of steps, which the law leaves out. Signals that vanish by symmetry are left out.
    """
    scene = problem.scene
    far, near = farthest_rounding(scene), position_rounding(scene, scene.shape.columns)
    if not plane_along_y(scene):  # no signal lies along the rows
        near = far = max(far, near)
    sizes = {name: float(np.sqrt(np.mean(signals[name] ** 2))) for name in judged(problem, signals)}
    return {name: (far if name == "p" else near) / size for name, size in sizes.items()}


def walls(problem: Problem) -> float:
    """Return the error by the faces at the centre, relative to the wave: 1e-6, or 0 in a periodic cell.

    It is also 0 for a scene that runs on after the echo (``time.allow_echo``), where the walls are part of the scene.
    """
    scene = problem.scene
    return WALL_ERROR if scene.shape.faces and scene.time.duration <= scene.echo_time else 0.0


def floor(problem: Problem, signals: Mapping[str, NDArray[np.float64]]) -> dict[str, float]:
    """Return the relative errors of rounding and walls, which no time step removes, for the worst signal."""
    return {"rounding": max(rounding(problem, signals).values(), default=0.0), "walls": walls(problem)}


def check_floor(problem: Problem) -> None:
    """Raise a SceneError if no time step can meet the tolerance of a problem for the signals of linear theory."""
    scene = problem.scene
    remedies = {
        "rounding": "a larger wave.amplitude or fewer packing.rows",
        "walls": 'packing.ends = "periodic"' + ("" if scene.shape.infinite else ' and packing.sides = "periodic"'),
    }
    for source, value in floor(problem, linear_signals(problem)).items():
        if scene.time.clock.tolerance < value:
            raise SceneError(
                f"time.tolerance = {scene.time.tolerance!r}: must be at least {value:.2g}, the error from {source} in "
                f"this scene; or use {remedies[source]}"
            )


def below_rounding(scene: Scene, signals: Mapping[str, NDArray[np.float64]]) -> list[str]:
    """Return a warning if the second harmonic p of a run is less than 3 times its rounding, else an empty list.

    The rounding is `noise_floor` or `grain`, whichever is larger. The list is empty for L, whose p is the wave itself,
    and for waves that are not plane and along y, for which the laws do not hold.
    """
    if not plane_along_y(scene) or "p" in _shares(mode_of(scene)) or "p" not in moving(signals):
        return []
    size, least = float(np.sqrt(np.mean(signals["p"] ** 2))), max(noise_floor(scene), grain(scene))
    if size >= 3 * least:
        return []
    return [
        f"wave.amplitude = {scene.amplitude!r}: p is {size:.2g} D0, and the rounding of positions leaves "
        f"{least:.2g} D0 by itself; use a larger amplitude or fewer packing.rows"
    ]


def noise_floor(scene: Scene) -> float:
    """Return the standard deviation of the rounding noise of p at the end of a run, in D0.

        noise = √(steps/2) · ulp/√12 / D0,    ulp² = mean of the squared spacing of doubles at the y of the spheres

    Each step rounds each position to that spacing, 2^{−52}|y| or down to half of it. The rounding acts as a kick of
    variance ulp²/12, half of which remains in the displacements as the lattice carries it away. So the floor grows with
    the root of the number of steps, in proportion to the length of the cell or its distance from the origin, and as
    1/D0.

    Parameters
    ----------
    scene : Scene
        Scene with a time step.

    Notes
    -----
    The law holds to a factor of 3: with smaller steps at one duration the noise rises more slowly than the root
    (measured: 1.8-fold for sixteen times the steps instead of 4-fold). The noise of q and φ is a few times smaller. The
    law breaks down for signals below `grain`, where roundings are not random: the noise is smaller and the signal lost.
    """
    return float(np.sqrt(scene.time.steps / 2) * _spacing(scene) / np.sqrt(12))


def grain(scene: Scene) -> float:
    """Return the smallest p, in D0, that changes positions: ulp/(4ΩΔτ D0), ulp as in `noise_floor`.

    A second harmonic p cos 2Ωτ moves a sphere by at most 2ΩΔτ p in a step. If that is less than half the spacing of
    doubles at its position, the sum rounds back to the old position and p is not simulated: its error is p itself. The
    bound grows as the steps become smaller.
    """
    return _spacing(scene) / (4 * mode_of(scene).frequency * scene.time.step)


def _spacing(scene: Scene) -> float:
    """Return the root mean square, in D0, of the spacing of doubles at the places that reach the centre."""
    # Noise that arrives at the centre left its row, on average, half-way through the run
    reach = max(scene.lattice.fastest * scene.time.duration / 2, 1)
    # The spacing jumps by factors of two, so it depends on the units of the deck
    units = scene.units
    row = scene.lattice.row_distance(units.number(scene.sphere.lattice_constant, length=1))
    n = np.arange(scene.shape.rows) - scene.shape.centre_row
    square = float(np.mean(np.spacing(np.abs(row * n[np.abs(n) <= reach])) ** 2))
    if not plane_along_y(scene):  # what is recorded moves along the rows too
        x = np.arange(scene.shape.columns) - scene.shape.columns / 2
        square += float(np.mean(np.spacing(np.abs(row * x[np.abs(x) <= reach])) ** 2))
    return float(np.sqrt(square) / units.number(scene.displacement_amplitude, length=1))
