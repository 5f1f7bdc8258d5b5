"""Modes and second harmonic of a plane wave of any direction and any branch of the paper's crystal.

`analysis.theory.second_order` has the theory, for any crystal; here it speaks of the paper's, in its units and
variables. Units: displacements and φ in D0 (the amplitude of the fundamental), time in √(m/(2(g1+3k1))), wave vectors
in 1/lattice constant. What LAMMPS's geometry adds (η = Δ0/2R), compression, other laws, no shear and no rotation stand
in the `analysis.theory.contact.Contact` that every function here takes. x lies along a close-packed row. **The paper's
variables** are those of a wave along y: p = v, q = −u, φ = φ, ξ = (√3/2) k_y; in any direction p is the component along
k, q the one along ẑ × k and ξ = (√3/2)|k|. `mode` and `trajectory` speak them.

A mode has no phase to choose, only a sign (`analysis.theory.bloch`). Branches are sorted by frequency: 0, 1, 2 are
lower and middle (acoustic) and upper (optical, a pure rotation at Γ; at K it is the lower that only rotates; there is
no optical one where spheres do not turn). L, TR, RT name modes only where a mirror holds k (Γ–M, the paper's direction,
and Γ–K); elsewhere each moves in u, v and φ.

When it breaks: where a contact opens; where the second harmonic is not small against the fundamental, as it is not for
long on a resonance. Where two branches touch (middle and upper at K) a single mode is not defined.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.second_harmonic import Mode, ModeName
from analysis.theory.bloch import BONDS, GAUGE, frame, hexagonal, in_plane, real_modes, unit, wavevector_of
from analysis.theory.contact import Contact
from analysis.theory.mixing import Pair, Tone, forced_amplitude, mixed_wave
from analysis.theory.second_order import second_order as second_order_of
from analysis.theory.second_order import wave as wave_of
from analysis.theory.wave import Wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def nonlinearity(amplitude: float, contact: Contact) -> float:
    """Return ε = √3 D0 (g2+3k2)/(g1+3k1) = −√3 a(κm+3n)/(κ+3) for the amplitude a = D0/Δ0.

    n = ¼ and m = ½ of the paper's contacts. The paper prints 3/2 for √3; its equations hold with √3.
    """
    law, kappa = contact.adhesion.expansion, contact.kappa
    return -np.sqrt(3.0) * amplitude * (law.shear * kappa + 3.0 * law.normal) / (kappa + 3.0)


def bloch_matrix(wavevector: ArrayLike, contact: Contact) -> Complexes:
    """Return the Hermitian D(k) of M U″ = −D U, M = diag(1, 1, Ĩ/(1−η)), on U = (u, v, φ).

    Parameters
    ----------
    wavevector : (..., 2), in 1/lattice constant
    contact : any law; the matrix does not depend on it

    Returns
    -------
    (..., 3, 3)
    """
    crystal = hexagonal(contact)
    result = np.zeros((*np.shape(wavevector)[:-1], 3, 3), dtype=complex)
    moving = len(crystal.freedoms)
    result[..., :moving, :moving] = crystal.stiffness(wavevector) / crystal.mass[0, 0]
    return result


def modes(wavevector: ArrayLike, contact: Contact) -> tuple[Floats, Complexes]:
    """Return the three modes of D(k) U = Ω² M U in ascending frequency, or two with φ = 0 if spheres do not turn.

    Normalised to |u|² + |v|² + |φ|² = 1, without the weight Ĩ (so Q² + f² = 1 along y). Phase: u and v real, φ
    imaginary, and the larger of the components along k and along ẑ × k positive (so p = 1 for L, Q > 0 for TR and RT
    along y); f < 0 where a mode only rotates.

    Parameters
    ----------
    wavevector : (..., 2), in 1/lattice constant; at k = 0 the direction is taken as y
    contact : any law; the modes do not depend on it

    Returns
    -------
    frequencies : (..., 3)
    polarisations : (..., 3, 3), the branch before the component: polarisations[..., j, :] is (u, v, φ) of branch j
    """
    frequencies, shapes = real_modes(wavevector, contact)
    return frequencies, shapes * GAUGE


def branch_index(name: str, wavevector: ArrayLike, contact: Contact) -> NDArray[np.intp]:
    """Return which branch is L, TR or RT: L has the largest component along k; of the other two, TR is the lower.

    That is exact where a mirror holds k (along y: the paper's modes). Elsewhere it labels quasi-modes, and jumps
    where they exchange roles.

    Parameters
    ----------
    name : "L", "TR" or "RT"
    wavevector : (..., 2), in 1/lattice constant

    Returns
    -------
    (...), each 0, 1 or 2

    Raises
    ------
    ValueError
        For another name, and for RT of spheres that do not turn.
    """
    names = ("L", "TR", "RT")[: 3 if contact.turns else 2]
    if name not in names:
        raise ValueError(f"name is {name!r}; allowed: {', '.join(names)}")
    _, shapes = real_modes(wavevector, contact)
    along = np.einsum("...jc,...c->...j", shapes[..., :2], unit(wavevector))
    longitudinal = np.argmax(np.abs(along), axis=-1)
    lower, upper = np.where(longitudinal == 0, 1, 0), np.where(longitudinal == 2, 1, 2)
    return (longitudinal, lower, upper)[names.index(name)]


def mode(
    name: ModeName,
    wavenumber: float,
    direction: float,
    contact: Contact,
) -> Mode:
    """Return one mode in the paper's variables, p = P cos ϑ, q = Q cos ϑ, φ = −f sin ϑ, with ϑ = k·r − Ωτ + phase.

    Named as by `branch_index`, normalised and signed as by `modes`: along y this is `second_harmonic.mode`, to rounding
    and but for the sign where a mode only rotates.

    Parameters
    ----------
    name : "L", "TR" or "RT"
    wavenumber : ξ = (√3/2)|k| > 0, rad per row for a wave along y
    direction : of k, in degrees from x (a close-packed row) towards y
    contact : any law; the modes do not depend on it

    Raises
    ------
    ValueError
        For a value out of range, and for RT of spheres that do not turn.
    """
    k = wavevector_of(wavenumber, direction)
    branch = int(branch_index(name, k, contact))
    frequencies, shapes = real_modes(k, contact)
    p, q = frame(direction) @ shapes[branch, :2]
    return Mode(
        name,
        float(wavenumber),
        float(frequencies[branch]),
        float(p),
        float(q),
        float(shapes[branch, 2]),
        float(direction),
    )


def second_harmonic_amplitude(
    wavevector: ArrayLike,
    branch: ArrayLike,
    contact: Contact,
) -> Complexes:
    """Return the forced second harmonic U₂ = [D(2k) − 4Ω²M]⁻¹ N(U, U) of U exp i(k·r − Ωτ), per unit ε.

        N(U, U) = Σ_l [n δN² + 2κ(t, 1) δN δS] / (2√3(2κ+3))        (all six contacts; η = 0)

    It is the amplitude of `analysis.theory.mixing` for the wave and itself as a pair, over ε per a.

    For complex fields, the paper's convention: along y its v is P̃1 = iG/(w̃² − 4Ω²), and P̃1 = (i/2) cot(ξ/2) for L.
    A real fundamental Re U exp(iϑ) gives half of it, (ε/2) Re U₂ exp(2iϑ). (Paper: P1TR, whose printed prefactor is
    wrong.) u and v are imaginary, φ is real.

    Parameters
    ----------
    wavevector : (..., 2), in 1/lattice constant
    branch : (...), 0, 1 or 2 (`branch_index` finds it by name)

    Returns
    -------
    (..., 3), the complex amplitudes of (u, v, φ) in units of ε D0

    Raises
    ------
    ValueError
        Where branches have one frequency, as the acoustic ones at k = 0. Next to a resonance the amplitude is large and
        true, but see `second_order`.
    """
    wave = Tone(wavevector, branch)
    return forced_amplitude(Pair(wave, wave, 1, contact)) / nonlinearity(1.0, contact)


def mean_rotation(
    wavevector: ArrayLike,
    branch: ArrayLike,
    contact: Contact,
) -> Floats:
    """Return the steady rotation φ̄ = N_φ(U, U*)/D_φφ(0) that every sphere gains, per unit ε; real fields hold (ε/2) φ̄.

        N_φ(U, U*) = κ Σ_l Re(δN δS*) / (√3(2κ+3)),    D_φφ(0) = 6κ/(κ+3)        (all six contacts; η = 0)

    A wave rectifies on itself: the quadratic springs also push at zero wave number. No net force results (momentum:
    the two ends of a contact cancel), but a net torque does, since both ends of a sheared contact turn the same way.
    δN δS changes sign under a mirror, so φ̄ vanishes for the modes on Γ–M (the paper's direction) and Γ–K; in a general
    direction it does not.

    Parameters and shapes as in `second_harmonic_amplitude`; returns (...), in units of ε D0.
    """
    wave = Tone(wavevector, branch)
    return np.real(in_plane(Pair(wave, wave, -1, contact).mixed.static())[..., 2]) / nonlinearity(1.0, contact)


def doubled_wave(
    wavevector: ArrayLike,
    branch: ArrayLike,
    amplitude: float,
    tau: ArrayLike,
    contact: Contact,
    *,
    phase: float = 0.0,
) -> Complexes:
    """Return the factor X(τ) of the field Re[X exp(2ik·r)] that a wave drives at 2k, in a lattice without any at τ = 0.

    Each of the modes at 2k answers with a forced and a free part, regular on resonance, where it grows as τ, and with
    what the start leaves in the contacts, 0 in the paper's geometry and law. In a simulated sheet of N spheres X is
    (2/N) Σ u(r) exp(−2ik·r), unless 2k and −2k are one wave vector.

    Parameters
    ----------
    wavevector : (..., 2), in 1/lattice constant
    branch : (...), 0, 1 or 2
    amplitude : D0/Δ0
    tau : (...), dimensionless time; broadcasts against the wave vectors, as in `analysis.theory.mixing.mixed_wave`
    phase : of the fundamental, Re U exp i(k·r − Ωτ + phase)
    contact : any law; its dashpots are left out

    Returns
    -------
    (..., 3), the complex amplitudes of (u, v, φ) in units of D0
    """
    wave = Tone(wavevector, branch)
    field = mixed_wave(Pair(wave, wave, 1, contact), tau)
    return 0.5 * amplitude * np.exp(2j * phase) * field


def second_order(
    wavevector: ArrayLike,
    branch: int,
    amplitude: float,
    tau: ArrayLike,
    contact: Contact,
    *,
    site: tuple[int, int] = (0, 0),
    phase: float = 0.0,
) -> Floats:
    """Return the second-order field of the real fundamental Re U exp i(k·r − Ωτ + phase), if there is none at τ = 0.

        Re[X exp(2ik·r)] + (ε/2)(0, 0, φ̄)(1 − cos Ω₀τ),    Ω₀² = 6κ(1−η)/((κ+3)Ĩ)

    X is `doubled_wave`; the last term is `mean_rotation`, switched on with the wave. To be added to the fundamental,
    `modes(...)[1][branch]`.

    Parameters
    ----------
    wavevector, branch, amplitude, tau, contact, phase : as in `doubled_wave`
    site : (i, j) for the sphere at i(1, 0) + j(1/2, √3/2); for k along y, j is the paper's row n

    Returns
    -------
    (..., 3), (u, v, φ) in units of D0: the paper's p = v, q = −u
    """
    crystal = hexagonal(contact)
    one = wave_of(crystal, wavevector, branch).times(amplitude * np.exp(1j * phase))
    time = np.asarray(tau, dtype=float)
    _, field = second_order_of(crystal, [one], time.ravel(), np.array(site, dtype=float) @ BONDS[:2])
    return np.real(in_plane(field)).reshape(*time.shape, 3) / amplitude


def trajectory(wave: Wave, tau: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return p, q, φ (...) in units of D0 to second order, the mode and `second_order`, of the sphere at r = 0."""
    mode, time = wave.mode, np.asarray(tau, dtype=float)
    k = wavevector_of(mode.wavenumber, mode.direction)
    branch = int(branch_index(mode.name, k, wave.contact))
    field = second_order(k, branch, wave.amplitude, time, wave.contact, phase=wave.phase)
    p, q = np.moveaxis(field[..., :2] @ frame(mode.direction).T, -1, 0)
    theta = wave.phase - mode.frequency * time
    return mode.p * np.cos(theta) + p, mode.q * np.cos(theta) + q, -mode.f * np.sin(theta) + field[..., 2]
