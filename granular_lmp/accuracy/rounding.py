"""What the rounding of positions does to a wave: the error that no time step cures.

LAMMPS adds displacements of a fraction of the static overlap, 1e-10 m, to positions of up to 1e-4 m: of 16 digits, ten
are left for the displacement of the farthest sphere.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.modes import mode_of
from granular_lmp.crystal.wavevector import ROW_SPACING
from granular_lmp.lammps.units import units_for
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.shape import FASTEST_ROWS_PER_TAU

# Of the largest signal. What a symmetry makes zero is rounding, 1e-9 of it
_STILL = 1e-7


def moving(signals: Mapping[str, NDArray[np.float64]]) -> list[str]:
    """Names of the signals that are known and not zero by symmetry."""
    sizes = {name: float(np.max(np.abs(values), initial=0.0)) for name, values in signals.items()}
    largest = max(size for size in sizes.values() if np.isfinite(size))
    return [name for name, size in sizes.items() if size > _STILL * largest]


def position_rounding(scene: Scene, lattice_constants: float) -> float:
    """Rounding of a position so many lattice constants from the origin, in D0: ½ eps of it."""
    distance = lattice_constants * scene.sphere.lattice_constant
    return float(np.finfo(float).eps / 2 * distance / (scene.wave.amplitude * scene.sphere.static_overlap))


def farthest_rounding(scene: Scene) -> float:
    """`position_rounding` of the farthest row."""
    return position_rounding(scene, scene.shape.rows / 2 * ROW_SPACING)


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
    return _spacing(scene) / (4 * mode_of(scene).frequency * scene.time.step)


def _spacing(scene: Scene) -> float:
    """Root mean square of the spacing of doubles at the y of the rows that the centre hears, in D0."""
    # What arrives at the centre left, on average, half-way through the run
    reach = max(FASTEST_ROWS_PER_TAU * scene.time.duration / 2, 1)
    n = np.arange(scene.shape.rows) - scene.shape.centre_row
    # The spacing jumps in twos, so the numbers of the deck count, not metres
    units = units_for(scene.sphere.radius)
    y = units.number(scene.sphere.lattice_constant, length=1) * ROW_SPACING * n[np.abs(n) <= reach]
    size = scene.wave.amplitude * units.number(scene.sphere.static_overlap, length=1)
    return float(np.sqrt(np.mean(np.spacing(np.abs(y)) ** 2)) / size)
