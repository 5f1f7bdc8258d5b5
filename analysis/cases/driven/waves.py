"""Waves that a driven row sends into a crystal at rest, and their second harmonic over the distance.

The motion of row 0 of a strip along y is prescribed; its spheres move alike and do not turn (lengths in D0):

    L:       p_0 = r(τ) cos(Ωτ − phase),  q_0 = φ_0 = 0
    TR, RT:  q_0 = r(τ) cos(Ωτ − phase),  p_0 = φ_0 = 0,        Ω that of the mode at ξ

r rises once, from 0 to 1. In an endless strip the state behind the front is steady: fields Re[X_n e^{−iΩτ}].

**Linear.** X_n = Σ_m X_m e^{iκ_m n} over the waves of frequency Ω that leave the row: group velocity > 0, or Im κ > 0
(`granular_analysis.theory.transfer`). L has one such wave, e^{iξn}. TR and RT have two at each frequency. One has ±ξ:
−ξ where Ω falls with ξ, as for all RT waves of solid spheres, whose crests run *towards* the row. The other decays
within a row or two (κ = π + 2.2i for TR of solid spheres); with Ĩ ≥ 1.5 it can propagate too. q_0 = 1 and φ_0 = 0
determine the amplitudes of both.

**Second order.** Each pair of waves a, b makes forces B_ab e^{i(κ_a + κ_b)n} in the bonds between two rows
(`granular_analysis.theory.bonds`), and so a forced wave with K = κ_a + κ_b. A free L wave with k2 starts with it and
cancels it at row 0, whose motion has no second harmonic:

    P_n = (1 − e^{−iK}) B_ab [e^{iKn} − e^{ik2 n}]/(speed² sin²(K/2) − 4Ω²),    speed sin(k2/2) = 2Ω

The two waves beat over 2π/|2κ_1 − k2| rows, and P_n grows as n if K = k2 (TR at the resonance). Above the cutoff,
2Ω > speed, the wave with k2 = π + i·(…) stays near row 0, and |P_n| soon is constant. The same bonds also push
steadily: see `static`.

When it breaks: if |P| is not small, or a²n, as the wave number shifts by order a². Measured relative errors fall as a²
down to a floor: the ramp also excites waves at the edges of the bands, which have no group velocity and leave slowly.
These waves are linear, so the floor does not depend on a; only in the second harmonic of L, which shares their
component, it rises as 1/a. The floor is high if the steady waves themselves are slow: at TR's resonance k2 runs 0.05
rows per τ, and 8 rows reach their steady amplitude at 2Ω to 2.5 % only at τ = 1900.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bloch import real_modes, wavevector_of
from granular_analysis.theory.bonds import Strain
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.transfer import lattice_waves
from granular_analysis.theory.wave import Wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
_NOT_DRIVEN = 1e-12  # share below which the row does not excite a wave


@dataclass(frozen=True)
class RowWaves:
    """Linear waves that a driven row sends out.

    Attributes
    ----------
    wavenumbers : (m,) complex
        κ, rad per row.
    shapes : (3, m) complex
        p, q, φ of each wave at row 0; their sum is 1 in the driven component.
    velocities : (m,)
        Group velocities, rows per τ; 0 for a wave that decays.
    """

    wavenumbers: Complexes
    shapes: Complexes
    velocities: Floats


def linear_waves(wave: Wave) -> RowWaves:
    """Return the waves that a driven row sends out: one for L and for spheres that do not turn, otherwise two.

    Raises ValueError if the mode has no group velocity, as at ξ = π: no energy leaves the row.
    """
    mode, crystal = wave.mode, wave.crystal
    # D(κ) = D₀ + D₊e^{iκ} + D₊†e^{−iκ}, from three wave numbers
    zero, quarter, half = (crystal.stiffness(xi * wavevector_of(1.0, 90.0)) for xi in (0.0, np.pi / 2, np.pi))
    on_site = (zero + half) / 2
    ahead = ((zero - half) / 2 - 1j * (quarter - on_site)) / 2
    mass = crystal.moving(crystal.mass)
    try:
        factors, shapes, flux = lattice_waves(mass, on_site, ahead, mode.frequency)
    except ValueError:
        raise ValueError(
            f"{mode.name} at wavenumber = {mode.wavenumber} has no group velocity, so no energy leaves the row"
        ) from None
    count = len(mass)
    factors, shapes, flux = factors[:count], shapes[:, :count], flux[:count]
    driven = np.eye(count)[1 if mode.name == "L" else 0] * (1.0 if mode.name == "L" else -1.0)  # q = −u
    shares = np.linalg.solve(shapes, driven)
    velocity = flux / (mode.frequency * (mass @ np.abs(shapes) ** 2))
    sent = np.flatnonzero(np.abs(shares) > _NOT_DRIVEN)
    sent = sent[np.argsort(np.abs(np.abs(np.angle(factors[sent])) - mode.wavenumber) + (flux[sent] == 0))]
    motion = np.zeros((3, len(sent)), dtype=complex)
    motion[:count] = shapes[:, sent] * shares[sent]
    p_q_phi = np.stack([motion[1], -motion[0], motion[2]])
    wavenumbers = -1j * np.log(factors[sent])
    wavenumbers[0] = np.copysign(mode.wavenumber, wavenumbers[0].real)  # exactly the wave number of the mode
    return RowWaves(wavenumbers, p_q_phi, velocity[sent])


def free_wavenumber(frequency: float, contact: Contact) -> complex:
    """Return k of the L wave with speed·sin(k/2) = Ω: in (0, π], or π + 2i·arcosh(Ω/speed) above the cutoff."""
    ratio = frequency / _speed(contact)
    return complex(2 * np.arcsin(ratio)) if ratio <= 1 else complex(np.pi, 2 * np.arccosh(ratio))


@lru_cache(maxsize=16)
def _speed(contact: Contact) -> float:
    """Return the frequency of L at ξ = π, the "speed" in Ω = speed·sin(ξ/2)."""
    frequencies, shapes = real_modes(wavevector_of(np.pi, 90.0), contact)
    return float(frequencies[np.argmax(np.abs(shapes[:, 1]))])


def beat_length(wave: Wave) -> float:
    """Return the beat length 2π/|2κ − k2| of the second harmonic, rows; inf on resonance, nan above the cutoff."""
    free = free_wavenumber(2 * wave.mode.frequency, wave.contact)
    if free.imag:
        return float("nan")
    mismatch = abs(2 * linear_waves(wave).wavenumbers[0].real - free.real)
    return float(2 * np.pi / mismatch) if mismatch else float("inf")


def slowest(wave: Wave) -> float:
    """Return the lower group velocity of fundamental and free L wave at 2Ω, rows per τ."""
    free = free_wavenumber(2 * wave.mode.frequency, wave.contact)
    velocities = linear_waves(wave).velocities
    own = [] if free.imag else [_speed(wave.contact) * np.cos(free.real / 2) / 2]
    return float(min([*velocities[velocities > 0], *own]))


def driven_amplitudes(wave: Wave, rows: ArrayLike) -> tuple[Complexes, Complexes]:
    """Return the complex amplitudes X of p, q, φ, Re[X e^{−iΩτ}], and P of p at 2Ω, Re[P e^{−2iΩτ}], over the rows.

    Parameters
    ----------
    wave : wave along y; the row has its frequency, amplitude and phase.
    rows : (N,) whole numbers n ≥ 0.

    Returns
    -------
    (3, N) in D0, and (N,) in D0

    Raises
    ------
    ValueError
        For rows that are not such numbers, and as `linear_waves` raises it.

    Source: Eqs. 8–10 of the paper with the boundary at row 0; not in the paper.
    """
    n, contact = _counted(rows), wave.contact
    waves, free = linear_waves(wave), free_wavenumber(2 * wave.mode.frequency, contact)
    fundamental = waves.shapes @ np.exp(1j * np.multiply.outer(waves.wavenumbers, n))
    forces = _bond_force(wave, waves, difference=False)
    second = np.zeros(n.shape, dtype=complex)
    for force, forced in zip(forces.ravel(), np.add.outer(waves.wavenumbers, waves.wavenumbers).ravel(), strict=True):
        # speed² sin²(K/2) − 4Ω² is −(speed²/4)(z − z2)(1 − 1/(z z2)), z = e^{iK}, z2 = e^{ik2}
        z = np.exp(1j * forced)
        second += -4 / _speed(contact) ** 2 * force * (z - 1) / (z - np.exp(-1j * free)) * _beat(forced, free, n)
    return fundamental * np.exp(1j * wave.phase), second * np.exp(2j * wave.phase)


def static(wave: Wave, rows: ArrayLike) -> Floats:
    """Return the mean displacement p (N,), in D0, of the rows that the waves have reached; it grows with n.

        (c² dp + B)_n = B_∞ v/(c + v),    B_n = Σ_ab B_ab e^{i(κ_a − κ_b*)n},  p_0 = 0,  c = speed/2

    Bonds soften when stretched, so the wave pushes the crystal apart. The mean force in the bonds is uniform behind the
    front, but not zero: the front, which moves at v, pushes a long L wave ahead of itself, which needs a force. B_∞ is
    B of the propagating waves, each with its own v. Rows are as in `driven_amplitudes`. Breaks once the second harmonic
    has grown large anywhere behind the front, as on resonance, because it contributes to the force.

    Raises ValueError for TR and RT with a shear law with memory: near the row stretch and slip of a contact are not in
    phase, ∫x ds grows by the area of their ellipse in each period, and p creeps without a steady state.
    """
    n = _counted(rows)
    if wave.contact.incremental and wave.mode.name != "L":
        raise ValueError(f"{wave.mode.name} has no steady mean displacement under a shear law with memory")
    waves = linear_waves(wave)
    forces = _bond_force(wave, waves, difference=True)
    c = _speed(wave.contact) / 2
    uniform = np.sum(np.diag(forces).real * waves.velocities / (c + waves.velocities))
    decay = np.exp(
        1j * np.multiply.outer(np.arange(np.max(n)), np.subtract.outer(waves.wavenumbers, waves.wavenumbers.conj()))
    )
    stretch = (uniform - np.sum(decay * forces, axis=(1, 2)).real) / c**2
    return np.concatenate([[0.0], np.cumsum(stretch)])[n]


def _bond_force(wave: Wave, waves: RowWaves, *, difference: bool) -> Complexes:
    """Return B_ab (m, m), the force of the bonds to row 1 on a sphere of row 0 over its mass, in D0 per t0²."""
    bonds, frequency = wave.crystal.bonds, wave.mode.frequency
    k = np.multiply.outer(waves.wavenumbers, [*wavevector_of(1.0, 90.0), 0.0])
    p, q, phi = waves.shapes
    field = np.zeros((len(k), 1, 6), dtype=complex)
    field[:, 0, [0, 1, 5]] = np.stack([-q, p, phi], axis=-1)
    one = bonds.strain(field, k)
    other = Strain(*(part.conj() for part in one)) if difference else one
    pair = Strain(*(part[:, None] for part in one)), Strain(*(part[None] for part in other))
    forces = bonds.quadratic(*pair, (frequency, -frequency if difference else frequency)).running[..., 0, 1]
    total = k[:, None] + (-k.conj() if difference else k)
    at_row = forces * np.exp(0.5j * (total @ bonds.apart.T))
    scale = 0.5 * wave.amplitude / wave.crystal.mass[0, 1]
    return np.asarray(scale * np.sum(at_row[..., bonds.apart[:, 1] > 0], axis=-1))


def _beat(one: complex, other: complex, n: NDArray[np.intp]) -> Complexes:
    """Return (e^{ikn} − e^{ik'n})/(e^{ik} − e^{ik'}) for two wave numbers; n e^{ik(n−1)} if they are equal."""
    # Factors out the wave that decays least, so that no exponential overflows
    slow, fast = sorted((one, other), key=lambda k: k.imag)
    mismatch = 1j * (fast - slow)
    growth = np.expm1(mismatch * n) / np.expm1(mismatch) if mismatch else n
    return np.asarray(np.exp(1j * slow * (n - 1)) * growth)


def _counted(rows: ArrayLike) -> NDArray[np.intp]:
    n = np.asarray(rows)
    if n.ndim != 1 or n.size == 0 or not np.issubdtype(n.dtype, np.integer) or np.min(n) < 0:
        raise ValueError(f"rows = {rows!r} must be one-dimensional, whole numbers, not negative")
    return n.astype(np.intp)
