"""Modes and second harmonic of a plane wave of any direction and any branch, from the contact springs themselves.

The springs, and the gauge W = (u, v, f), φ = i f, in which everything is real, are those of `analysis.theory.springs`:
a mode has no phase to choose, only a sign, and the Bloch matrix is a real sum over the three bonds of a cell.

Units: displacements and φ in D0 (the amplitude of the fundamental), time in √(m/(2(g1+3k1))), wave vectors in
1/lattice constant. Then all depends on κ = g1/k1 = 2(1−ν)/(2−ν) and on Ĩ = I/(mR²) alone, in the paper's geometry;
what LAMMPS's adds (η = Δ0/2R), compression, the incremental law, no shear and no rotation are options of every function
here (`springs.Contacts`). x lies along a close-packed row. **The paper's variables** are those of a wave along y:
p = v, q = −u, φ = φ, ξ = (√3/2) k_y; in any direction p is the component along k, q the one along ẑ × k and
ξ = (√3/2)|k|. `mode` and `trajectory` speak them.

Branches are sorted by frequency: 0, 1, 2 are lower and middle (acoustic) and upper (optical, a pure rotation at Γ; at
K it is the lower that only rotates; there is no optical one where spheres do not turn). L, TR, RT name modes only where
a mirror holds k (Γ–M, the paper's direction, and Γ–K); elsewhere each moves in u, v and φ.

When it breaks: where a contact opens; where the second harmonic is not small against the fundamental, as it is not for
long on a resonance. Where two branches touch (middle and upper at K) a single mode is not defined.
"""

from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.second_harmonic import Mode, ModeName
from analysis.theory.bloch import real_modes, select, unit
from analysis.theory.springs import (
    BONDS,
    SOLID_SPHERE,
    Contacts,
    Elongations,
    Springs,
    drive,
    elongations,
    quadratic_forces,
    springs,
    stiffness,
    stiffness_ratio,
)

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_GAUGE = np.array([1.0, 1.0, 1j])  # (u, v, φ) = _GAUGE · (u, v, f)


def nonlinearity(amplitude: float, poisson_ratio: float) -> float:
    """Return ε = √3 D0 (g2+3k2)/(g1+3k1) = −√3 a(2κ+3)/(4(κ+3)) for the amplitude a = D0/Δ0.

    The paper prints 3/2 for √3; its equations hold with √3.
    """
    kappa = stiffness_ratio(poisson_ratio)
    return -np.sqrt(3.0) * amplitude * (2.0 * kappa + 3.0) / (4.0 * (kappa + 3.0))


def wavevector_of(wavenumber: float, direction: float) -> Floats:
    """Return k (2,) in 1/lattice constant from ξ = (√3/2)|k| and the direction in degrees from x towards y.

    Raises ValueError unless ξ is positive and both are finite.
    """
    if not 0.0 < wavenumber < np.inf:
        raise ValueError(f"wavenumber is {wavenumber!r}; allowed: above 0, finite")
    if not np.isfinite(direction):
        raise ValueError(f"direction is {direction!r}; allowed: degrees, finite")
    return 2.0 / np.sqrt(3.0) * wavenumber * _frame(direction)[0]


def _frame(direction: float) -> Floats:
    """Return the unit vectors along k and along ẑ × k as rows: (p, q) = frame @ (u, v)."""
    cosine, sine = np.cos(np.radians(direction)), np.sin(np.radians(direction))
    return np.array([[cosine, sine], [-sine, cosine]])


def bloch_matrix(wavevector: ArrayLike, poisson_ratio: float, **contacts: Unpack[Contacts]) -> Complexes:
    """Return the Hermitian D(k) of M U″ = −D U, M = diag(1, 1, Ĩ/(1−η)), on U = (u, v, φ).

    Parameters
    ----------
    wavevector : (..., 2), in 1/lattice constant
    poisson_ratio : −1 to 0.5

    Returns
    -------
    (..., 3, 3)
    """
    matrix = stiffness(elongations(wavevector), springs(poisson_ratio, **contacts))
    return _GAUGE[:, None] * matrix * _GAUGE.conj()


def modes(
    wavevector: ArrayLike, poisson_ratio: float, inertia: float = SOLID_SPHERE, **contacts: Unpack[Contacts]
) -> tuple[Floats, Complexes]:
    """Return the three modes of D(k) U = Ω² M U in ascending frequency, or two with φ = 0 if spheres do not turn.

    Normalised to |u|² + |v|² + |φ|² = 1, without the weight Ĩ (so Q² + f² = 1 along y). Phase: u and v real, φ
    imaginary, and the larger of the components along k and along ẑ × k positive (so p = 1 for L, Q > 0 for TR and RT
    along y); f < 0 where a mode only rotates.

    Parameters
    ----------
    wavevector : (..., 2), in 1/lattice constant; at k = 0 the direction is taken as y
    poisson_ratio : −1 to 0.5
    inertia : Ĩ = I/(mR²) > 0

    Returns
    -------
    frequencies : (..., 3)
    polarisations : (..., 3, 3), the branch before the component: polarisations[..., j, :] is (u, v, φ) of branch j
    """
    frequencies, shapes = real_modes(wavevector, springs(poisson_ratio, inertia, **contacts))
    return frequencies, shapes * _GAUGE


def branch_index(
    name: str, wavevector: ArrayLike, poisson_ratio: float, inertia: float = SOLID_SPHERE, **contacts: Unpack[Contacts]
) -> NDArray[np.intp]:
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
    contact = springs(poisson_ratio, inertia, **contacts)
    names = ("L", "TR", "RT")[: contact.coordinates]
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
    poisson_ratio: float,
    inertia: float = SOLID_SPHERE,
    **contacts: Unpack[Contacts],
) -> Mode:
    """Return one mode in the paper's variables, p = P cos ϑ, q = Q cos ϑ, φ = −f sin ϑ, with ϑ = k·r − Ωτ + phase.

    Named as by `branch_index`, normalised and signed as by `modes`: along y this is `second_harmonic.mode`, to rounding
    and but for the sign where a mode only rotates.

    Parameters
    ----------
    name : "L", "TR" or "RT"
    wavenumber : ξ = (√3/2)|k| > 0, rad per row for a wave along y
    direction : of k, in degrees from x (a close-packed row) towards y
    poisson_ratio, inertia, contacts : as in `springs.springs`; inertia is the sphere's, without the factor of η

    Raises
    ------
    ValueError
        For a value out of range, and for RT of spheres that do not turn.
    """
    k = wavevector_of(wavenumber, direction)
    branch = int(branch_index(name, k, poisson_ratio, inertia, **contacts))
    frequencies, shapes = real_modes(k, springs(poisson_ratio, inertia, **contacts))
    p, q = _frame(direction) @ shapes[branch, :2]
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
    poisson_ratio: float,
    inertia: float = SOLID_SPHERE,
    **contacts: Unpack[Contacts],
) -> Complexes:
    """Return the forced second harmonic U₂ = [D(2k) − 4Ω²M]⁻¹ N(U, U) of U exp i(k·r − Ωτ), per unit ε.

        N(U, U) = Σ_l [n δN² + 2κ(t, 1) δN δS] / (2√3(2κ+3))        (all six contacts; η = 0)

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
    numpy.linalg.LinAlgError
        On a resonance met to the last bit, as for the acoustic branches at k = 0. Nearby the amplitude is large and
        true, but see `second_order`.
    """
    contact = springs(poisson_ratio, inertia, **contacts)
    frequency, shape = select(*real_modes(wavevector, contact), branch)
    doubled = elongations(2.0 * np.asarray(wavevector, dtype=float))
    running, _ = quadratic_forces(elongations(wavevector).of(shape), contact)
    dynamic = stiffness(doubled, contact) - 4.0 * frequency[..., None, None] ** 2 * np.diag(contact.mass)
    moving = contact.coordinates
    response = np.zeros_like(shape)
    force = _per_epsilon(contact) * drive(doubled, running)
    response[..., :moving] = np.linalg.solve(dynamic[..., :moving, :moving], force[..., :moving, None])[..., 0]
    return -1j * _GAUGE * response


def _per_epsilon(contact: Springs) -> float:
    """Return 2a/ε · ½C, C = 1/(2(κ+3)): the force −½iCa·`drive` of real fields is (ε/2)(−i) times this and `drive`."""
    return -2.0 / (np.sqrt(3.0) * (2.0 * contact.kappa + 3.0))


def mean_rotation(
    wavevector: ArrayLike,
    branch: ArrayLike,
    poisson_ratio: float,
    inertia: float = SOLID_SPHERE,
    **contacts: Unpack[Contacts],
) -> Floats:
    """Return the steady rotation φ̄ = N_φ(U, U*)/D_φφ(0) that every sphere gains, per unit ε; real fields hold (ε/2) φ̄.

        N_φ(U, U*) = κ Σ_l Re(δN δS*) / (√3(2κ+3)),    D_φφ(0) = 6κ/(κ+3)        (all six contacts; η = 0)

    A wave rectifies on itself: the quadratic springs also push at zero wave number. No net force results (momentum:
    the two ends of a contact cancel), but a net torque does, since both ends of a sheared contact turn the same way.
    δN δS changes sign under a mirror, so φ̄ vanishes for the modes on Γ–M (the paper's direction) and Γ–K; in a general
    direction it does not.

    Parameters and shapes as in `second_harmonic_amplitude`; returns (...), in units of ε D0.
    """
    contact = springs(poisson_ratio, inertia, **contacts)
    _, shape = select(*real_modes(wavevector, contact), branch)
    running, left = quadratic_forces(elongations(wavevector).of(shape), contact)
    if not contact.turns:
        return np.zeros(shape.shape[:-1])
    torque = 2.0 * _per_epsilon(contact) * (running.turning + left.turning).sum(axis=-1)
    return torque * (contact.kappa + 3.0) / (6.0 * contact.kappa)


def doubled_wave(
    wavevector: ArrayLike,
    branch: int,
    amplitude: float,
    tau: ArrayLike,
    *,
    poisson_ratio: float,
    inertia: float = SOLID_SPHERE,
    phase: float = 0.0,
    **contacts: Unpack[Contacts],
) -> Complexes:
    """Return the factor X(τ) of the field Re[X exp(2ik·r)] that a wave drives at 2k, in a lattice without any at τ = 0.

        X = (ε/2) e^{2i·phase} Σ_j U_j [(U_j†N) Z_j(2Ω) + (U_j†N₀) Z_j(0)]/(U_j†MU_j)
        Z_j(ω) = ∫₀^τ sin(w_j(τ−s))/w_j e^{−iωs} ds,    w_j the frequencies at 2k

    Each of the modes at 2k answers with a forced and a free part; Z_j is regular on resonance, where it grows as τ. N₀
    is what the start leaves in the contacts (`analysis.theory.springs`), 0 in the paper's geometry and law. In a
    simulated sheet of N spheres X is (2/N) Σ u(r) exp(−2ik·r), unless 2k and −2k are one wave vector.

    Parameters
    ----------
    wavevector : (2,), in 1/lattice constant
    branch : 0, 1 or 2
    amplitude : D0/Δ0
    tau : (...), dimensionless time
    phase : of the fundamental, Re U exp i(k·r − Ωτ + phase)
    poisson_ratio, inertia, contacts : as in `springs.springs`

    Returns
    -------
    (..., 3), the complex amplitudes of (u, v, φ) in units of D0
    """
    k, contact = np.asarray(wavevector, dtype=float), springs(poisson_ratio, inertia, **contacts)
    frequency, shape = select(*real_modes(k, contact), branch)
    targets, shapes = real_modes(2.0 * k, contact)
    time = np.asarray(tau, dtype=float)[..., None]
    doubled, norms = elongations(2.0 * k), shapes**2 @ contact.mass

    def response(forces: Elongations, forcing: ArrayLike) -> Complexes:
        share = shapes @ drive(doubled, forces) / norms
        return (share * _duhamel(targets, forcing, time)) @ shapes

    running, left = quadratic_forces(elongations(k).of(shape), contact)
    field = _per_epsilon(contact) * (response(running, 2.0 * frequency) + response(left, 0.0))
    return -0.5j * nonlinearity(amplitude, poisson_ratio) * np.exp(2j * phase) * _GAUGE * field


def second_order(
    wavevector: ArrayLike,
    branch: int,
    amplitude: float,
    tau: ArrayLike,
    site: tuple[int, int] = (0, 0),
    *,
    poisson_ratio: float,
    inertia: float = SOLID_SPHERE,
    phase: float = 0.0,
    **contacts: Unpack[Contacts],
) -> Floats:
    """Return the second-order field of the real fundamental Re U exp i(k·r − Ωτ + phase), if there is none at τ = 0.

        Re[X exp(2ik·r)] + (ε/2)(0, 0, φ̄)(1 − cos Ω₀τ),    Ω₀² = 6κ(1−η)/((κ+3)Ĩ)

    X is `doubled_wave`; the last term is `mean_rotation`, switched on with the wave. To be added to the fundamental,
    `modes(...)[1][branch]`.

    Parameters
    ----------
    wavevector, branch, amplitude, tau, poisson_ratio, inertia, phase, contacts : as in `doubled_wave`
    site : (i, j) for the sphere at i(1, 0) + j(1/2, √3/2); for k along y, j is the paper's row n

    Returns
    -------
    (..., 3), (u, v, φ) in units of D0: the paper's p = v, q = −u
    """
    k, contact = np.asarray(wavevector, dtype=float), springs(poisson_ratio, inertia, **contacts)
    place = phase + float(k @ (np.array(site, dtype=float) @ BONDS[:2]))
    field = np.real(
        doubled_wave(k, branch, amplitude, tau, poisson_ratio=poisson_ratio, inertia=inertia, phase=place, **contacts)
    )
    optical = np.sqrt(6.0 * contact.kappa / ((contact.kappa + 3.0) * contact.inertia))
    mean = 0.5 * nonlinearity(amplitude, poisson_ratio) * mean_rotation(k, branch, poisson_ratio, inertia, **contacts)
    field[..., 2] += mean * (1.0 - np.cos(optical * np.asarray(tau, dtype=float)))
    return field


def trajectory(
    mode: Mode,
    amplitude: float,
    tau: ArrayLike,
    poisson_ratio: float,
    *,
    inertia: float = SOLID_SPHERE,
    phase: float = 0.0,
    **contacts: Unpack[Contacts],
) -> tuple[Floats, Floats, Floats]:
    """Return p, q, φ (...) in units of D0 to second order, the mode and `second_order`, of the sphere at r = 0.

    mode : of the function `mode`, with the same ν, Ĩ and contacts; the others as in `doubled_wave`.
    """
    k, time = wavevector_of(mode.wavenumber, mode.direction), np.asarray(tau, dtype=float)
    branch = int(branch_index(mode.name, k, poisson_ratio, inertia, **contacts))
    field = second_order(
        k, branch, amplitude, time, poisson_ratio=poisson_ratio, inertia=inertia, phase=phase, **contacts
    )
    p, q = np.moveaxis(field[..., :2] @ _frame(mode.direction).T, -1, 0)
    theta = phase - mode.frequency * time
    return mode.p * np.cos(theta) + p, mode.q * np.cos(theta) + q, -mode.f * np.sin(theta) + field[..., 2]


def _duhamel(natural: Floats, forcing: ArrayLike, tau: Floats) -> Complexes:
    """Return Z = ∫₀^τ sin(w(τ−s))/w e^{−iωs} ds for w = natural, ω = forcing, regular at ω = ±w and for w → 0.

    Z = [e^{iwτ}E(−ω−w) − e^{−iwτ}E(w−ω)]/(2iw),    E(x) = ∫₀^τ e^{ixs} ds = τ e^{ixτ/2} sin(xτ/2)/(xτ/2).
    """
    # Z is even and smooth in w, so a small w in place of 0 (a translation of the whole lattice) changes it by O(w²τ²).
    w, omega = np.maximum(natural, 1e-8), np.asarray(forcing, dtype=float)

    def window(x: Floats) -> Complexes:
        return tau * np.exp(0.5j * x * tau) * np.sinc(x * tau / (2.0 * np.pi))

    return (np.exp(1j * w * tau) * window(-omega - w) - np.exp(-1j * w * tau) * window(w - omega)) / (2j * w)
