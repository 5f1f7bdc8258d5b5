"""Common parts of the periodic cells: the scene of a periodic cell, its exact lattice, and the amplitudes of modes."""

from math import pi

import numpy as np
from numpy.typing import ArrayLike

from granular_analysis.second_harmonic import Mode, ModeName, ratios
from granular_analysis.second_harmonic import mode as linear_mode
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from granular_lmp import Scene
from granular_lmp.accuracy.rounding import noise_floor
from tests.hard.cell import Floats

PERIODIC = Scene.load("tr_periodic")
NU, ETA = PERIODIC.sphere.poisson_ratio, PERIODIC.sphere.overlap_ratio
RATIOS = ratios(NU, overlap_ratio=ETA)


def scene(
    mode: ModeName, cycles: int, rows: int, amplitude: float, step: float, duration: float, sample: float = 0.5
) -> Scene:
    """A periodic cell with ξ = 2π·cycles/rows, which is the infinite lattice without an error."""
    return PERIODIC.with_values(
        {
            "packing.rows": rows,
            "wave.mode": mode,
            "wave.wavenumber": 2 * pi * cycles / rows,
            "wave.amplitude": float(amplitude),
            "time.timestep": step,
            "time.sample": sample,
            "time.duration": float(duration),
        }
    )


def verlet_bound(scene: Scene, frequency: float) -> float:
    """How far Verlet and rounding may move a displacement in D0 until the end of a run.

        1.5 (ΩΔτ)² (Ωτ/24 + 1/8) + 9 noise

    Phase (ΩΔτ)²Ωτ/24 and amplitude (ΩΔτ)²/8 of Verlet, half as much again for harmonics; the law of the noise is good
    to a factor of 3, and the largest of 700 samples is 3 standard deviations.
    """
    lag = (frequency * scene.time.step) ** 2
    return 1.5 * lag * (frequency * scene.time.duration / 24 + 1 / 8) + 9 * noise_floor(scene)


def phases(scene: Scene) -> Floats:
    """ξn of the rows, n = 0 at the centre row."""
    return scene.wavenumber * (np.arange(scene.shape.rows, dtype=np.float64) - scene.shape.centre_row)


def exact(scene: Scene, tau: ArrayLike, overlap_ratio: float = ETA, points: int = 31, rtol: float = 1e-10) -> Floats:
    """States (T, 6, K) of the phase torus, displacements in Δ0, in the contact geometry of an overlap ratio."""
    mode = linear_mode(scene.wave.mode, scene.wavenumber, ratios(NU, overlap_ratio=overlap_ratio))
    contact = Contact(NU, overlap_ratio=overlap_ratio)
    neighbours = lattice.torus_neighbours(scene.wavenumber, points)
    amplitude = scene.wave.amplitude
    start = lattice.initial_state(mode, amplitude, lattice.torus_phases(points), contact, neighbours)
    states = lattice.motion(start, contact, neighbours, tau, rtol, amplitude)
    return states[:, :6]


def amplitude(states: Floats, angles: Floats, order: int, mode: Mode) -> Floats:
    """|A| of the forward wave of a mode in harmonic `order` of rows (…, 6, K) at the phases `angles` (K,).

    A = v†M(û + iû'/Ω)/(2 v†Mv), û the Fourier coefficient, v = (P, Q, if), M = diag(1, 1, Ĩ).
    """
    coefficient = 2 * (states @ np.exp(-1j * order * angles)) / len(angles)
    shape, mass = np.array([mode.p, mode.q, 1j * mode.f]), np.array([1, 1, RATIOS.inertia])
    both = (coefficient[..., :3] + 1j * coefficient[..., 3:] / mode.frequency) / 2
    return np.abs(both @ (shape.conj() * mass)) / (np.abs(shape) ** 2 @ mass)
