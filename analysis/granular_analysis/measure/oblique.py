"""The second harmonic of plane waves of any direction, read off snapshots, beside the general formula.

The displacements of all spheres are projected on twice the wave vector of the run, which leaves nothing of the
fundamental:

    X(τ) = (2/N) Σ u(r, τ) e^{−2ik·r}        of the field Re[X e^{2ik·r}]

Theory is `granular_analysis.theory.second_order`, in LAMMPS's contact geometry. Where a mirror holds the wave (along y
and x) only the component along k is driven; in between a wave of any mode drives all three, p and q along and across k,
and φ.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.measure.norms import relative_error
from granular_analysis.measure.runs import by_wave
from granular_analysis.measure.sheets import component, fields_of, in_frame, rest_of
from granular_analysis.theory.bloch import branch_index, in_plane, wavevector_of
from granular_analysis.theory.catalogue import missing
from granular_analysis.theory.choice import traits_of, wave_of
from granular_analysis.theory.second_order import Mixed, branch_of
from granular_analysis.theory.wave import Wave
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
SILENT = 1e-3  # less than this share of the largest component is zero by symmetry


@dataclass(frozen=True)
class Point:
    """One wave: X(τ) of the run and of theory, (T, 3) complex, components p, q, φ, in D0."""

    mode: str
    wavenumber: float
    direction: float
    tau: Floats
    run: Complexes
    theory: Complexes

    @property
    def error(self) -> float:
        """Relative L2 error of all components together."""
        return relative_error(_reals(self.run), _reals(self.theory))

    @property
    def strength(self) -> Floats:
        """Root mean square over the run of |X| of p, q, φ in the run, (3,)."""
        return strength(self.run)


def _reals(wave: Complexes) -> Floats:
    """Real and imaginary parts of (T, 3), (T, 3, 2)."""
    return np.stack([wave.real, wave.imag], axis=-1)


def strength(wave: Complexes) -> Floats:
    """Root mean square over time of the magnitudes of (..., T, 3)."""
    return np.sqrt(np.mean(np.abs(wave) ** 2, axis=-2))


def second_harmonic(record: Record) -> tuple[Floats, Complexes]:
    """Times (T,) and X(τ) (T, 3) of p, q, φ of a run, from its snapshots.

    Raises ValueError where 2k and −2k are one wave vector of the lattice: X is then not told from its conjugate.
    """
    particles, scene = record.snapshots(), record.scene
    k = wavevector_of(scene.wavenumber, scene.direction)
    rest = rest_of(particles)
    rest = rest - rest[scene.shape.centre_row * scene.shape.columns + scene.shape.columns // 2]
    if np.allclose(np.exp(4j * rest @ k), 1, atol=1e-6):
        raise ValueError("2k is half a wave vector of the reciprocal lattice: its wave has no direction")
    return particles.tau, in_frame(component(fields_of(particles), rest, 2 * k), k)


def predicted(wave: Wave, tau: Floats) -> Complexes:
    """X(τ) (T, 3) of p, q, φ by theory."""
    mode = wave.mode
    return predicted_along([mode.direction], mode.wavenumber, wave, tau)[0]


def predicted_along(angles: ArrayLike, wavenumber: float, wave: Wave, tau: Floats) -> Complexes:
    """X(τ) (A, T, 3) of p, q, φ by theory, with another wave number and other directions (A,), in degrees."""
    k = np.array([[wavevector_of(wavenumber, angle)] for angle in np.asarray(angles, dtype=float)])
    one = branch_of(wave.crystal, k, branch_index(wave.mode.name, k, wave.contact))
    field = in_plane(Mixed(wave.crystal, one, one).signal(tau))
    return in_frame(0.5 * wave.amplitude * np.exp(2j * wave.phase) * field, k)


def refusal(record: Record) -> str | None:
    """Return the reason why a run is not one of these, or None."""
    left_out = missing("granular-analysis oblique", traits_of(record))
    return f"the general formula leaves out {', '.join(left_out)}" if left_out else None


def points(records: Iterable[Record]) -> list[Point]:
    """One point a wave, of two runs with steps h and h/2 the extrapolation (4·fine − coarse)/3.

    Raises ValueError for a run that is none of these (`refusal`), and for other runs of one wave.
    """
    runs = list(records)
    for record in runs:
        if reason := refusal(record):
            raise ValueError(f"{record.folder}: {reason}")
    return sorted(map(_point, by_wave(runs)), key=lambda each: (each.mode, each.direction))


def _point(runs: list[Record]) -> Point:
    scene = runs[0].scene
    mode, wavenumber, direction = scene.wave.mode, scene.wavenumber, scene.direction
    (tau, wave), *coarse = (second_harmonic(record) for record in runs)
    for times, rougher in coarse:
        if len(times) != len(tau):
            raise ValueError(f"{mode} at {direction:.5g} degrees: {len(times)} and {len(tau)} snapshots are no pair")
        wave = (4 * wave - rougher) / 3
    return Point(mode, wavenumber, direction, tau, wave, predicted(wave_of(runs[0]), tau))
