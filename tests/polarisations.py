"""Modes as complex polarisations (u, v, φ) and wrong second harmonics, with which tests compare theory."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bloch import BONDS, GAUGE, hexagonal, in_plane, real_modes
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.second_order import Mixed, branch_of, duhamel, second_order
from granular_analysis.theory.wave import Wave, nonlinearity


def bloch_matrix(wavevector: ArrayLike, contact: Contact) -> NDArray[np.complex128]:
    """Return D(k) (..., 3, 3) of M U″ = −D U, M = diag(1, 1, Ĩ/(1−η)), on U = (u, v, φ), 0 where nothing turns."""
    crystal = hexagonal(contact)
    result = np.zeros((*np.shape(wavevector)[:-1], 3, 3), dtype=complex)
    moving = len(crystal.freedoms)
    result[..., :moving, :moving] = crystal.stiffness(wavevector) / crystal.mass[0, 0]
    return result


def modes(wavevector: ArrayLike, contact: Contact) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Return frequencies (..., J) and polarisations (..., J, 3), u and v real, φ imaginary."""
    frequencies, shapes = real_modes(wavevector, contact)
    return frequencies, shapes * GAUGE


def spoilt(wave: Wave, tau: ArrayLike, **factors: float) -> NDArray[np.float64]:
    """Return p of the second harmonic, in D0, of contacts whose laws have parts that are wrong by factors."""
    bonds = wave.crystal.bonds
    law = bonds.law._replace(**{name: factor * getattr(bonds.law, name) for name, factor in factors.items()})
    crystal = replace(wave.crystal, bonds=replace(bonds, law=law))
    _, field = second_order(crystal, [wave.linear.times(wave.amplitude * np.exp(1j * wave.phase))], tau)
    return np.real(wave.framed(field))[..., 0] / wave.amplitude


def forgetful(wave: Wave, tau: ArrayLike) -> NDArray[np.float64]:
    """Return p of the second harmonic, in D0, without what the start leaves in the contacts."""
    running = wave.doubled.shares.running[wave.longitudinal]
    answer = running * duhamel(wave.free_frequency, 2 * wave.mode.frequency, tau)
    shape = wave.framed(wave.doubled.targets.shapes[wave.longitudinal])[0]
    return np.asarray(np.real(0.5 * wave.amplitude * np.exp(2j * wave.phase) * answer * shape))


def second_harmonic_amplitude(wavevector: ArrayLike, branch: ArrayLike, contact: Contact) -> NDArray[np.complex128]:
    """Return the forced second harmonic (..., 3) of complex fields, in units of ε D0."""
    one = branch_of(hexagonal(contact), wavevector, branch)
    if np.any(one.frequency < 1e-9):
        raise ValueError("a rigid motion makes no waves")
    return in_plane(Mixed(hexagonal(contact), one, one).forced()) / nonlinearity(contact, 1.0)


def mean_rotation(wavevector: ArrayLike, branch: ArrayLike, contact: Contact) -> NDArray[np.float64]:
    """Return the steady rotation (...) that every sphere gains, in units of ε D0; real fields hold half of it."""
    one = branch_of(hexagonal(contact), wavevector, branch)
    still = Mixed(hexagonal(contact), one, one.reversed).static()
    return np.real(in_plane(still))[..., 2] / nonlinearity(contact, 1.0)


def second_order_at(
    wavevector: ArrayLike,
    branch: int,
    amplitude: float,
    tau: ArrayLike,
    contact: Contact,
    *,
    site: ArrayLike = (0, 0),
    phase: float = 0.0,
) -> NDArray[np.float64]:
    """Return the fields (..., T, 3) of second order of a wave, in D0, at i(1, 0) + j(1/2, √3/2), sites (..., 2)."""
    crystal, time = hexagonal(contact), np.asarray(tau, dtype=float)
    one = branch_of(crystal, wavevector, branch).times(amplitude * np.exp(1j * phase))
    _, field = second_order(crystal, [one], time.ravel(), np.asarray(site, dtype=float) @ BONDS[:2])
    return np.real(in_plane(field)).reshape(*np.shape(site)[:-1], *time.shape, 3) / amplitude
