"""Second harmonic of a plane wave of any direction and any branch, from the contact springs themselves.

A sphere touches six neighbours, at d_l = n_l (unit: the lattice constant), with tangent t_l = ẑ × n_l. A contact
stretches and shears by

    δN = n·(u_l − u_0),    δS = t·(u_l − u_0) − (φ_l + φ_0),    φ = Rθ,

pulls sphere 0 with n f_N + t f_S and turns it with the torque R f_S, where, to second order,
f_N = k1 δN + k2 δN² and f_S = g1 δS + g2 δS δN (paper, springN and springS; δS as in its appendix).

**Everything is real.** Inversion together with time reversal maps the wave exp i(k·r − Ωτ) on itself, so a mode has
real (u, v) and an imaginary φ = i f. In the gauge W = (u, v, f) a contact of phase θ = k·d carries δ = i e exp(iθ/2)
with the real elongations

    e_N = 2 sin(θ/2) n·u,    e_S = 2 sin(θ/2) t·u − 2 cos(θ/2) f,

and the Bloch matrix is the real sum of e eᵀ over the three bonds of a cell. No mode is left with a phase to choose,
only with a sign.

Units: displacements and φ in D0 (the amplitude of the fundamental), time in √(m/(2(g1+3k1))), wave vectors in
1/lattice constant. Then all depends on κ = g1/k1 = 2(1−ν)/(2−ν) and on Ĩ = I/(mR²) alone. x lies along a close-packed
row. **The paper's variables** are those of a wave along y: p = v, q = −u, φ = φ, ξ = (√3/2) k_y; in any direction p
is the component along k and q the one along ẑ × k.

Branches are sorted by frequency: 0, 1, 2 are lower and middle (acoustic) and upper (optical, a pure rotation at Γ; at
K it is the lower that only rotates). L, TR, RT name modes only where a mirror holds k (Γ–M, the paper's direction,
and Γ–K); elsewhere each moves in u, v and φ.

When it breaks: fixed contact normals (the paper's geometry) are assumed, that no contact opens, and that the second
harmonic stays small against the fundamental, which it does not for long on a resonance. Where two branches touch
(middle and upper at K) a single mode is not defined.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SOLID_SPHERE = 0.4  # Ĩ = I/(mR²) of a homogeneous sphere

# One bond of each ± pair: the contact at −d repeats the elongations of the one at d, up to a phase.
BONDS = np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)], [-0.5, np.sqrt(0.75)]])
TANGENTS = np.stack([-BONDS[:, 1], BONDS[:, 0]], axis=-1)

_GAUGE = np.array([1.0, 1.0, 1j])  # (u, v, φ) = _GAUGE · (u, v, f)


def stiffness_ratio(poisson_ratio: float) -> float:
    """Return κ = g1/k1 = 2(1−ν)/(2−ν), shear over normal stiffness of a Hertz–Mindlin contact.

    Raises ValueError unless −1 ≤ ν ≤ 0.5, the range of an isotropic solid.
    """
    if not -1.0 <= poisson_ratio <= 0.5:
        raise ValueError(f"poisson_ratio is {poisson_ratio!r}; allowed: -1 to 0.5")
    return 2.0 * (1.0 - poisson_ratio) / (2.0 - poisson_ratio)


def nonlinearity(amplitude: float, poisson_ratio: float) -> float:
    """Return ε = √3 D0 (g2+3k2)/(g1+3k1) = −√3 a(2κ+3)/(4(κ+3)) for the amplitude a = D0/Δ0.

    The paper prints 3/2 for √3; its equations hold with √3.
    """
    kappa = stiffness_ratio(poisson_ratio)
    return -np.sqrt(3.0) * amplitude * (2.0 * kappa + 3.0) / (4.0 * (kappa + 3.0))


def bloch_matrix(wavevector: ArrayLike, poisson_ratio: float) -> Complexes:
    """Return the Hermitian D(k) of M U″ = −D U, M = diag(1, 1, Ĩ), on U = (u, v, φ).

    Parameters
    ----------
    wavevector : (..., 2), in 1/lattice constant
    poisson_ratio : −1 to 0.5

    Returns
    -------
    (..., 3, 3)
    """
    matrix = _stiffness(*_elongations(wavevector), stiffness_ratio(poisson_ratio))
    return _GAUGE[:, None] * matrix * _GAUGE.conj()


def modes(wavevector: ArrayLike, poisson_ratio: float, inertia: float = SOLID_SPHERE) -> tuple[Floats, Complexes]:
    """Return the three modes of D(k) U = Ω² M U in ascending frequency.

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
    frequencies, shapes = _real_modes(wavevector, poisson_ratio, inertia)
    return frequencies, shapes * _GAUGE


def branch_index(
    name: str, wavevector: ArrayLike, poisson_ratio: float, inertia: float = SOLID_SPHERE
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
        For another name.
    """
    names = ("L", "TR", "RT")
    if name not in names:
        raise ValueError(f"name is {name!r}; allowed: {', '.join(names)}")
    _, shapes = _real_modes(wavevector, poisson_ratio, inertia)
    along = np.einsum("...jc,...c->...j", shapes[..., :2], _unit(wavevector))
    longitudinal = np.argmax(np.abs(along), axis=-1)
    lower, upper = np.where(longitudinal == 0, 1, 0), np.where(longitudinal == 2, 1, 2)
    return (longitudinal, lower, upper)[names.index(name)]


def second_harmonic_amplitude(
    wavevector: ArrayLike, branch: ArrayLike, poisson_ratio: float, inertia: float = SOLID_SPHERE
) -> Complexes:
    """Return the forced second harmonic U₂ = [D(2k) − 4Ω²M]⁻¹ N(U, U) of U exp i(k·r − Ωτ), per unit ε.

        N(U, U) = Σ_l [n δN² + 2κ(t, 1) δN δS] / (2√3(2κ+3))        (all six contacts)

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
    frequency, shape = _select(*_real_modes(wavevector, poisson_ratio, inertia), branch)
    doubled = _elongations(2.0 * np.asarray(wavevector, dtype=float))
    kappa = stiffness_ratio(poisson_ratio)
    dynamic = _stiffness(*doubled, kappa) - 4.0 * frequency[..., None, None] ** 2 * np.diag([1.0, 1.0, inertia])
    force = _quadratic_force(*_stretch(wavevector, shape), *doubled, kappa)
    return -1j * _GAUGE * np.linalg.solve(dynamic, force[..., None])[..., 0]


def mean_rotation(
    wavevector: ArrayLike, branch: ArrayLike, poisson_ratio: float, inertia: float = SOLID_SPHERE
) -> Floats:
    """Return the steady rotation φ̄ = N_φ(U, U*)/D_φφ(0) that every sphere gains, per unit ε; real fields hold (ε/2) φ̄.

        N_φ(U, U*) = κ Σ_l Re(δN δS*) / (√3(2κ+3)),    D_φφ(0) = 6κ/(κ+3)        (all six contacts)

    A wave rectifies on itself: the quadratic springs also push at zero wave number. No net force results (momentum:
    the two ends of a contact cancel), but a net torque does, since both ends of a sheared contact turn the same way.
    δN δS changes sign under a mirror, so φ̄ vanishes for the modes on Γ–M (the paper's direction) and Γ–K; in a general
    direction it does not.

    Parameters and shapes as in `second_harmonic_amplitude`; returns (...), in units of ε D0.
    """
    _, shape = _select(*_real_modes(wavevector, poisson_ratio, inertia), branch)
    normal, shear = _stretch(wavevector, shape)
    kappa = stiffness_ratio(poisson_ratio)
    torque = 2.0 * kappa * np.sum(normal * shear, axis=-1) / (np.sqrt(3.0) * (2.0 * kappa + 3.0))
    return torque * (kappa + 3.0) / (6.0 * kappa)


def second_order(
    wavevector: ArrayLike,
    branch: int,
    amplitude: float,
    tau: ArrayLike,
    site: tuple[int, int] = (0, 0),
    *,
    poisson_ratio: float,
    inertia: float = SOLID_SPHERE,
) -> Floats:
    """Return the second-order field of the real fundamental Re U exp i(k·r − Ωτ), in a lattice without any at τ = 0.

        (ε/2) Re[ e^{2ik·r} Σ_j U_j (U_j†N)/(U_j†MU_j) Z_j(τ) ] + (ε/2)(0, 0, φ̄)(1 − cos Ω₀τ)
        Z_j = ∫₀^τ sin(w_j(τ−s))/w_j e^{−2iΩs} ds,    w_j the frequencies at 2k,    Ω₀² = 6κ/((κ+3)Ĩ)

    Each of the three modes at 2k answers with a forced and a free part; Z_j is regular on resonance, where it grows
    as τ. The last term is `mean_rotation`, switched on with the wave. To be added to the fundamental,
    `modes(...)[1][branch]`.

    Parameters
    ----------
    wavevector : (2,), in 1/lattice constant
    branch : 0, 1 or 2
    amplitude : D0/Δ0
    tau : (...), dimensionless time
    site : (i, j) for the sphere at i(1, 0) + j(1/2, √3/2); for k along y, j is the paper's row n
    poisson_ratio : −1 to 0.5
    inertia : Ĩ = I/(mR²)

    Returns
    -------
    (..., 3), (u, v, φ) in units of D0: the paper's p = v, q = −u
    """
    k = np.asarray(wavevector, dtype=float)
    frequency, shape = _select(*_real_modes(k, poisson_ratio, inertia), branch)
    kappa = stiffness_ratio(poisson_ratio)
    force = _quadratic_force(*_stretch(k, shape), *_elongations(2.0 * k), kappa)
    targets, shapes = _real_modes(2.0 * k, poisson_ratio, inertia)
    share = shapes @ force / (shapes**2 @ [1.0, 1.0, inertia])
    time = np.asarray(tau, dtype=float)
    response = (share * _duhamel(targets, 2.0 * frequency, time[..., None])) @ shapes
    phase = 2.0 * k @ (np.array(site, dtype=float) @ BONDS[:2])
    field = np.real(-1j * np.exp(1j * phase) * _GAUGE * response)
    optical = np.sqrt(6.0 * kappa / ((kappa + 3.0) * inertia))
    field[..., 2] += mean_rotation(k, branch, poisson_ratio, inertia) * (1.0 - np.cos(optical * time))
    return 0.5 * nonlinearity(amplitude, poisson_ratio) * field


def _elongations(wavevector: ArrayLike) -> tuple[Floats, Floats]:
    """Return the real rows (e_N, e_S) of the three bonds on W = (u, v, f), each (..., bond, 3)."""
    half = 0.5 * np.asarray(wavevector, dtype=float) @ BONDS.T
    sine, cosine = 2.0 * np.sin(half)[..., None], 2.0 * np.cos(half)[..., None]
    normal = np.concatenate([sine * BONDS, np.zeros_like(cosine)], axis=-1)
    shear = np.concatenate([sine * TANGENTS, -cosine], axis=-1)
    return normal, shear


def _stretch(wavevector: ArrayLike, shape: Floats) -> tuple[Floats, Floats]:
    """Return e_N and e_S of the three bonds in the mode W, each (..., bond)."""
    normal, shear = _elongations(wavevector)
    return (normal @ shape[..., None])[..., 0], (shear @ shape[..., None])[..., 0]


def _stiffness(normal: Floats, shear: Floats, kappa: float) -> Floats:
    """Return D = Σ_bonds (e_N e_Nᵀ + κ e_S e_Sᵀ)/(2(κ+3)), real, in the gauge (u, v, f)."""
    return (np.swapaxes(normal, -1, -2) @ normal + kappa * np.swapaxes(shear, -1, -2) @ shear) / (2.0 * (kappa + 3.0))


def _quadratic_force(stretch: Floats, slide: Floats, normal: Floats, shear: Floats, kappa: float) -> Floats:
    """Return the real F of N(U, U) = −i F per unit ε, in the gauge (u, v, f).

        F = Σ_bonds [e_N(2k) e_N² + 2κ e_S(2k) e_N e_S]/(2√3(2κ+3))

    `stretch`, `slide` (..., bond) are those of the mode at k; `normal`, `shear` (..., bond, 3) the rows at 2k.
    """
    springs = (stretch**2)[..., None] * normal + 2.0 * kappa * (stretch * slide)[..., None] * shear
    return springs.sum(axis=-2) / (2.0 * np.sqrt(3.0) * (2.0 * kappa + 3.0))


def _real_modes(wavevector: ArrayLike, poisson_ratio: float, inertia: float) -> tuple[Floats, Floats]:
    """Return frequencies (..., 3) and shapes (..., branch, 3), normalised and signed as in `modes`, gauge (u, v, f)."""
    if not 0.0 < inertia < np.inf:
        raise ValueError(f"inertia is {inertia!r}; allowed: above 0, finite")
    kappa = stiffness_ratio(poisson_ratio)
    normal, shear = _elongations(wavevector)
    root = np.sqrt([1.0, 1.0, inertia])
    _, vectors = np.linalg.eigh(_stiffness(normal, shear, kappa) / (root[:, None] * root))
    shapes = np.swapaxes(vectors, -1, -2) / root
    shapes /= np.linalg.norm(shapes, axis=-1, keepdims=True)
    # The energy of a mode keeps the digits of a low frequency, which eigh rounds to those of the highest, and
    # is never negative.
    columns = np.swapaxes(shapes, -1, -2)
    stiffness = np.sum((normal @ columns) ** 2 + kappa * (shear @ columns) ** 2, axis=-2) / (2.0 * (kappa + 3.0))
    squares = stiffness / (shapes**2 @ [1.0, 1.0, inertia])
    along = _unit(wavevector)
    frame = np.stack([along, np.stack([-along[..., 1], along[..., 0]], axis=-1)], axis=-1)
    translation = shapes[..., :2] @ frame
    leading = np.take_along_axis(translation, np.argmax(np.abs(translation), axis=-1)[..., None], axis=-1)
    # Below the rounding of the eigenvectors a translation has no sign of its own.
    leading = np.where(np.abs(leading) > 1e-12, leading, -shapes[..., 2:])
    return np.sqrt(squares), shapes * np.where(leading < 0.0, -1.0, 1.0)


def _select(frequencies: Floats, shapes: Floats, branch: ArrayLike) -> tuple[Floats, Floats]:
    """Return the frequency (...) and shape (..., 3) of one branch per wave vector."""
    index = np.broadcast_to(np.asarray(branch), frequencies.shape[:-1])
    if not np.isin(index, (0, 1, 2)).all():
        raise ValueError(f"branch is {branch!r}; allowed: 0, 1, 2 in ascending frequency")
    return (
        np.take_along_axis(frequencies, index[..., None], axis=-1)[..., 0],
        np.take_along_axis(shapes, index[..., None, None], axis=-2)[..., 0, :],
    )


def _unit(wavevector: ArrayLike) -> Floats:
    """Return k/|k|, and y at k = 0."""
    k = np.asarray(wavevector, dtype=float)
    length = np.linalg.norm(k, axis=-1, keepdims=True)
    return np.where(length > 0.0, k / np.where(length > 0.0, length, 1.0), [0.0, 1.0])


def _duhamel(natural: Floats, forcing: Floats, tau: Floats) -> Complexes:
    """Return Z = ∫₀^τ sin(w(τ−s))/w e^{−iωs} ds for w = natural, ω = forcing, regular at ω = ±w and for w → 0.

    Z = [e^{iwτ}E(−ω−w) − e^{−iwτ}E(w−ω)]/(2iw),    E(x) = ∫₀^τ e^{ixs} ds = τ e^{ixτ/2} sin(xτ/2)/(xτ/2).
    """
    # Z is even and smooth in w, so a small w in place of 0 (a translation of the whole lattice) changes it by O(w²τ²).
    w = np.maximum(natural, 1e-8)

    def window(x: Floats) -> Complexes:
        return tau * np.exp(0.5j * x * tau) * np.sinc(x * tau / (2.0 * np.pi))

    return (np.exp(1j * w * tau) * window(-forcing - w) - np.exp(-1j * w * tau) * window(w - forcing)) / (2j * w)
