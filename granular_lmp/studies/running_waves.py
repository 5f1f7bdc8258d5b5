"""Waves that run up and down along y in some rows of a run, from its snapshots of all spheres.

The mean velocity of a row X_n = d(u, v, φ)/dτ, φ = Rθ, is taken at a frequency,

    burst   X_n(Ω) = ∫ X_n(τ) e^{iΩτ} dτ                  over the whole run, from rest to rest
    tone    X_n(τ) = Re[X_n(Ω) e^{−iΩτ}] + constant       by least squares over whole periods at the end

Velocities are used because they contain little of the long waves that a source makes at its start and that no quiet end
absorbs.

and X_n(Ω) = Σ_j a_j s_j λ_jⁿ is solved for the amplitudes of all waves of the perfect lattice of the rows, including
evanescent waves (`granular_lmp.crystal.row_waves`). This is exact for small amplitudes, whatever lies beyond the rows.
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.row_waves import RowWaves
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.runs.snapshots import Snapshots

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating]
LEFT = 2e-3  # largest relative change of the spectrum of a burst due to the last tenth of a run
STEADY = 5e-3  # largest relative change of a tone between the last two groups of periods
PERIODS = 5  # periods in each of the two groups at the end of a run


@dataclass(frozen=True)
class Amplitudes:
    """Waves in some rows, at one frequency.

    Attributes
    ----------
    up, down : dict of str to complex
        Amplitude, by name, of the waves whose energy runs to +y and to −y. Its squared modulus is the energy flux, up
        to a factor that is equal for all rows, lattices and runs with one source.
    residual : float
        Part of the motion that is not waves: its root mean square over that of the motion.
    """

    up: dict[str, complex]
    down: dict[str, complex]
    residual: float


def row_motion(snapshots: Snapshots) -> Floats:
    """Return the mean velocities (T, rows, 3) of u, v and φ of the spheres in each row, in D0/t0."""
    row = snapshots.crystal.arrays["row"]
    count = np.bincount(row)
    motion = np.empty((len(snapshots), len(count), 3))
    for number, spheres in enumerate(map(snapshots.__getitem__, range(len(snapshots)))):
        for freedom, values in enumerate((*spheres.velocity.T, spheres.spin)):
            motion[number, :, freedom] = np.bincount(row, values) / count
    return motion


def burst_spectrum(tau: Floats, motion: Floats, frequencies: Floats) -> Complexes:
    """Return X_n(Ω) of a burst that has passed, (F, rows, 3), of a motion (T, rows, 3) at equidistant times.

    The motion is faded out over the last tenth of the run, where only long waves remain.

    Raises
    ------
    SceneError
        If fading one tenth earlier changes the spectrum at a frequency by more than `LEFT`.
    """
    phases = np.exp(1j * np.multiply.outer(frequencies, tau)) * (tau[1] - tau[0])
    shorter, spectrum = (np.tensordot(phases * _fade(tau / end), motion, axes=1) for end in (0.9 * tau[-1], tau[-1]))
    left = float(np.max(np.linalg.norm(spectrum - shorter, axis=(1, 2)) / np.linalg.norm(spectrum, axis=(1, 2))))
    if left > LEFT:
        raise SceneError(
            f"time.duration = {tau[-1]:.6g}: the burst has not passed; the last tenth of the run still changes its "
            f"spectrum by {left:.2g}, and must change it by at most {LEFT:g}; use a longer duration"
        )
    return np.asarray(spectrum)


def _fade(share: Floats) -> Floats:
    """Return 1 − r(10 share − 9), r(s) = s³(10 − 15s + 6s²) on [0, 1]: 1 until 0.9, and 0 from 1 on."""
    s = np.clip(10 * share - 9, 0.0, 1.0)
    return np.asarray(1 - s**3 * (10 - 15 * s + 6 * s**2))


def tone_amplitude(tau: Floats, motion: Floats, frequency: float) -> Complexes:
    """Return X_n(Ω) of a steady tone, (rows, 3), of a motion (T, rows, 3).

    Raises
    ------
    SceneError
        If the run holds too few periods, or the tone is not steady to `STEADY`.
    """
    length = PERIODS * 2 * np.pi / frequency
    if tau[-1] < 3 * length:
        raise SceneError(
            f"time.duration = {tau[-1]:.6g}: must be at least {3 * length:.4g}, {3 * PERIODS} periods of the tone"
        )
    found = []
    for end in (tau[-1] - length, tau[-1]):
        chosen = (tau > end - length) & (tau <= end + 1e-9 * length)
        angle = frequency * tau[chosen]
        basis = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(angle)])
        cosine, sine, _ = np.linalg.lstsq(basis, motion[chosen].reshape(len(angle), -1), rcond=None)[0]
        found.append((cosine + 1j * sine).reshape(motion.shape[1:]))
    before, last = found
    change = np.linalg.norm(last - before) / np.linalg.norm(last)
    if change > STEADY:
        raise SceneError(
            f"time.duration = {tau[-1]:.6g}: the tone is not steady; its relative change is still {change:.2g}, and "
            f"must be at most {STEADY:g}; use a longer duration"
        )
    return np.asarray(last)


def amplitudes(waves: RowWaves, field: Complexes) -> Amplitudes:
    """Return the waves in X_n(Ω), (rows, 3), of neighbouring rows of their lattice, from below to above."""
    count, half = len(field), len(waves.factor) // 2
    # The amplitude of each wave is taken at the end where it comes from, so that none grows
    here, start = np.arange(count)[:, None], np.repeat([0, count - 1], half)
    basis = (waves.shape.T * (waves.factor ** (here - start))[..., None]).transpose(0, 2, 1).reshape(-1, 2 * half)
    found = np.linalg.lstsq(basis, field.ravel(), rcond=None)[0]
    residual = np.linalg.norm(basis @ found - field.ravel()) / np.linalg.norm(field)
    up, down = ({name: complex(found[k]) for name, k in waves.running(onward=way).items()} for way in (True, False))
    return Amplitudes(up, down, float(residual))
