"""Amplitude equations of the waves that exchange energy near the resonance 2Ω_TR(ξ) ≈ Ω_L(2ξ).

Second order breaks where it generates a free wave, because it leaves the fundamental unchanged. Here the amplitudes
follow the exchange of energy. A wave of harmonic m on one branch, in the infinite lattice and in units of Δ0, is

    (p, q, φ) = Re A v e^{imξn},    A' = −iωA + (forces of the other waves),    v = (P, Q, if),

with ω > 0 for a forward and ω < 0 for a backward wave. The forces between the waves are the second- and third-order
forces N(v_i, v_j) and C(v_i, v_j, v_l) of `granular_analysis.theory.bonds`, for the given contact and fundamental:

    A_k' = −iω_k A_k + (i/2ω_k v_k†Mv_k) v_k†[½ N(v_i, v_j) A_i A_j + ¼ C(v_i, v_j, v_l) A_i A_j A_l]

The sum is over all waves and their conjugates (m, ω, A, v → −m, −ω, Ā, v̄) with m_k = m_i + m_j (+ m_l). `quadratic`
and `cubic` return the coefficients.

Three of the waves can resonate: in harmonics 1, 2 and 3, the waves that run with the fundamental and are nearest to 1Ω,
2Ω and 3Ω. For TR near the resonance they are TR(ξ), L(2ξ) and RT(3ξ), and *two* exchanges feed them:

    TR(ξ) + TR(ξ) ↔ L(2ξ)   and   TR(ξ) + L(2ξ) ↔ RT(3ξ)     (detuned by −6.77e-4 and 1.72e-3 at ξ=1.475, ν=0.17)

`two_mode` has only the first exchange, in closed form. It is good until L(2ξ) has grown (τ ≈ 300 at a = 0.2), and it
lacks RT(3ξ), which φ shows. `three_mode` has both exchanges. All other waves (harmonics up to 6 = 3+3, other branches,
backward waves) never grow: they are slaved to products of the three, A_k = Z_k + Σ W_kij Z_i Z_j, and the start
launches each once as a free wave. The slaved waves act back on the three at third order, like the cubic springs, which
shifts the frequencies of the three:

    Z_k' = −iω_k Z_k + Σ N_kij Z_i Z_j + Σ [N_kijl + 2Σ_s N_kis W_sjl] Z_i Z_j Z_l
    W_kij = N_kij/(i(ω_k − ω_i − ω_j))

Here i, j, l are among the three and their conjugates, k is one of the three, and s is any other wave. This is
Poincaré's normal form, with exactly the terms that stay constant if the three run at Ω, 2Ω and 3Ω. Keeping a term that
is not constant causes no error in the long run, so no threshold defines "near". Off resonance the same equations
contain second order and the frequency shift. Their error of p is of order a² too: it is mostly smaller than the error
of second order, but larger near the ends of the zone
(test_near_the_ends_of_the_zone_three_waves_are_worse_in_p_than_second_order).

Left out are slaved waves of third order, whose error a² dominates at early τ, and the fourth order, which detunes the
exchange and dominates at late τ, as a³τ on resonance and a⁴τ off resonance.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.second_harmonic import ModeName, refuse_oblique
from granular_analysis.theory import second_order
from granular_analysis.theory.bloch import branch_among, in_plane
from granular_analysis.theory.bonds import Strain
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.second_order import chosen
from granular_analysis.theory.wave import Wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Indices = NDArray[np.intp]

HARMONICS = 6  # highest harmonic of a product of two of the three waves
TRANSLATION = 1e-9  # rad; replaces wavenumber 0, where Ω = 0 and no force acts on the mode


@dataclass(frozen=True)
class Waves:
    """Linear waves of harmonics 1 … 6 of a fundamental, followed by their conjugates in the same order: K in all.

    Attributes
    ----------
    crystal : crystal of the fundamental.
    harmonic : (K,) m.
    linear : waves of the crystal, with ω (K,) and U of amplitude 1.
    shape : (K, 3) v = (P, Q, if).
    """

    crystal: Crystal
    harmonic: Indices
    linear: second_order.Wave
    shape: Complexes

    @property
    def frequency(self) -> Floats:
        """Return ω (K,)."""
        return self.linear.frequency

    def strain(self, which: Indices, axis: int, axes: int) -> Strain:
        """Return the deformation of the contacts in chosen waves, placed along one axis of a product of waves."""
        strain = self.crystal.bonds.strain(self.linear.shape[which], self.linear.wavevector[which])
        place = tuple(slice(None) if each == axis else None for each in range(axes))
        return Strain(*(part[place] for part in strain))

    def rates(self, k: Indices, ends: Complexes, harmonic: Indices) -> Complexes:
        """Return the rates (k, ...) of the waves k, from forces at the ends of contacts at these harmonics (...)."""
        first = self.linear.wavevector[0]
        force = self.crystal.bonds.gather(ends, np.multiply.outer(harmonic, first), 1)
        shape = self.linear.shape[k]
        norm = np.sum(self.crystal.mass * np.abs(shape) ** 2, axis=(-2, -1))
        work = np.einsum("kbc,...bc->k...", shape.conj(), force)
        apart = (slice(None), *(None,) * harmonic.ndim)
        response = (0.5j / (self.frequency[k] * norm))[apart]
        return np.where(self.harmonic[k][apart] == harmonic, response * work, 0)


def waves(fundamental: Wave) -> Waves:
    """Return all waves that symmetry allows a fundamental to drive.

    An L wave drives L waves. TR and RT waves drive L in even harmonics, and TR and RT in odd harmonics; there is no RT
    if spheres do not turn.

    Raises ValueError for a wave that does not run along y, for dashpots, and for every shear law except "secant".
    """
    refuse_oblique(fundamental.mode)
    contact, xi = fundamental.contact, fundamental.mode.wavenumber
    contact.refuse_dashpots()
    if contact.law != "secant":
        raise ValueError(f"law = {contact.law!r} is not in the cubic forces; allowed: 'secant'")
    even: tuple[ModeName, ...] = ("L",)
    odd: tuple[ModeName, ...] = even if fundamental.mode.name == "L" else ("TR", "RT") if contact.turns else ("TR",)
    labels = [(harmonic, name) for harmonic in range(1, HARMONICS + 1) for name in (odd if harmonic % 2 else even)]
    m = np.array([harmonic for harmonic, _ in labels])
    folded = np.remainder(m * xi + np.pi, 2 * np.pi) - np.pi
    still = np.where(np.abs(folded) < TRANSLATION, TRANSLATION, 0.0)
    k = np.multiply.outer(m * xi + still, fundamental.linear.wavevector[:2] / xi)
    modes = fundamental.crystal.modes(k)
    found = zip(labels, in_plane(modes.shapes), k, strict=True)
    onward = chosen(modes, k, [int(branch_among(name, shapes, each)) for (_, name), shapes, each in found])
    both = [onward, onward._replace(frequency=-onward.frequency)]  # backward at the same wave vector
    every = [*both, *(each.reversed for each in both)]
    linear = second_order.Wave(*(np.concatenate(parts) for parts in zip(*every, strict=True)))
    return Waves(fundamental.crystal, np.concatenate([m, m, -m, -m]), linear, fundamental.framed(linear.shape))


def quadratic(waves: Waves, k: Indices, i: Indices, j: Indices) -> Complexes:
    """Return N_kij, (k, i, j), symmetric in i, j: the rate of A_k is Σ_ij N_kij A_i A_j; 0 unless m_k = m_i + m_j."""
    one, two = waves.strain(i, 0, 2), waves.strain(j, 1, 2)
    frequencies = waves.frequency[i][:, None], waves.frequency[j]
    running = waves.crystal.bonds.quadratic(one, two, frequencies).running
    return 0.5 * waves.rates(k, running, np.add.outer(waves.harmonic[i], waves.harmonic[j]))


def cubic(waves: Waves, k: Indices, i: Indices, j: Indices, l: Indices) -> Complexes:  # noqa: E741 (of N_kijl)
    """Return N_kijl, (k, i, j, l), from the springs alone: the rate of A_k is Σ_ijl N_kijl A_i A_j A_l."""
    ends = waves.crystal.bonds.cubic(*(waves.strain(each, axis, 3) for axis, each in enumerate((i, j, l))))
    harmonic = np.add.outer(waves.harmonic[i], np.add.outer(waves.harmonic[j], waves.harmonic[l]))
    return 0.25 * waves.rates(k, ends, harmonic)


@dataclass(frozen=True)
class NormalForm:
    """Equations of the three resonant waves, written for (Z_1, Z_2, Z_3, Z̄_1, Z̄_2, Z̄_3), and of the slaved waves.

    Attributes
    ----------
    waves : all waves.
    three : (3,) indices of the resonant waves in harmonics 1, 2, 3.
    quadratic : (3, 6, 6) coefficients of the products of two in the rate of Z_k.
    cubic : (3, 6, 6, 6) coefficients of the products of three in the rate of Z_k.
    slaved : (K/2, 6, 6) W_kij, coefficients of the products of two in A_k; zero for the three.
    """

    waves: Waves
    three: Indices
    quadratic: Complexes
    cubic: Complexes
    slaved: Complexes


def normal_form(wave: Wave) -> NormalForm:
    """Return the equations of the module for a fundamental at any ξ; they are regular on its resonance.

    When it breaks: if a wave outside the three happens to resonate too, W is large.
    """
    every, mode = waves(wave), wave.mode
    m, omega = every.harmonic, every.frequency
    everyone = np.arange(m.size)
    detuning = np.abs(omega - m * mode.frequency)
    three = np.array([min(np.flatnonzero(m == harmonic), key=lambda k: detuning[k]) for harmonic in (1, 2, 3)])
    six = np.concatenate([three, three + m.size // 2])
    driven = quadratic(every, everyone, six, six)
    others = driven.copy()
    others[six] = 0
    denominator = 1j * (omega[:, None, None] - np.add.outer(omega[six], omega[six]))
    slaved = np.divide(others, denominator, out=others, where=others != 0)
    back = 2 * np.einsum("kis,sjl->kijl", quadratic(every, three, six, everyone), slaved)
    return NormalForm(every, three, driven[three], cubic(every, three, six, six, six) + back, slaved[: m.size // 2])


def amplitudes(form: NormalForm, amplitude: float, tau: ArrayLike) -> Complexes:
    """Return Z_1, Z_2, Z_3 in Δ0 at times τ (...), as (3, ...), without the factors e^{−imΩτ}; Z = (a, 0, 0) at τ = 0.

    In this frame the equations are autonomous, because every kept term has m_k = m_i + m_j (+ m_l); near the resonance
    they are also slow.

    Raises ValueError for a negative time, RuntimeError if the waves grow without bound (gh > 0, see `two_mode`).
    """
    from scipy.integrate import solve_ivp  # slow to import, and only motions need it

    times, position = np.unique(np.asarray(tau, dtype=float), return_inverse=True)
    if times.size and times[0] < 0:
        raise ValueError(f"tau = {times[0]} is negative")
    three, every = form.three, form.waves
    frame = every.harmonic[three] * every.frequency[three[0]]
    linear = -1j * (every.frequency[three] - frame)
    second, third = form.quadratic.reshape(3, -1), form.cubic.reshape(3, -1)

    def rate(_: float, z: Complexes) -> Complexes:
        six = np.concatenate([z, z.conj()])
        pairs = (six[:, None] * six).ravel()
        return linear * z + second @ pairs + third @ (six[:, None] * pairs).ravel()

    start = np.array([amplitude, 0, 0], dtype=complex)
    # Z_m is of order a^m. Off resonance Z_2 and Z_3 rotate fast and stay small, so their tolerances must be relative to
    # themselves, not to the fundamental.
    tolerance = 1e-12
    scale = abs(amplitude) ** np.array([1, 2, 3])
    solution = solve_ivp(
        rate, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=tolerance, atol=tolerance * scale
    )
    if not solution.success:
        raise RuntimeError(f"integration of the three amplitudes failed: {solution.message}")
    return solution.y[:, position.reshape(np.shape(tau))]


def three_mode(wave: Wave, tau: ArrayLike, row: float = 0) -> tuple[Floats, Floats, Floats]:
    """Return p, q, φ in units of D0 at times τ (...): the three resonant, the slaved, and the launched free waves.

    At the start A_1 = a and all other waves are at rest, so Z = (a, 0, 0), and each slaved wave launches a free wave:

        A_k(τ) = Σ W_kij Z_i Z_j − e^{−iω_kτ} [Σ W_kij Z_i Z_j]_{τ=0}

    Raises the errors of `waves` and `amplitudes`. For an overlap ratio η > 0 the coefficients lack corrections of
    relative order η (2.5e-4 for the paper's spheres), which matters only near the antiresonance.

    When it breaks: in p near the antiresonance, where p is of order a⁴, and for L waves that steepen into more than
    three harmonics.
    """
    form, mode, amplitude = normal_form(wave), wave.mode, wave.amplitude
    every, count = form.waves, len(form.slaved)
    times = np.ravel(np.asarray(tau, dtype=float))

    def turning(k: Indices | slice) -> Complexes:
        return np.exp(-1j * np.multiply.outer(every.frequency[k], times))

    frame = np.exp(-1j * mode.frequency * np.multiply.outer(every.harmonic[form.three], times))
    Z = amplitudes(form, amplitude, times) * frame
    six = np.concatenate([Z, Z.conj()])
    A = np.einsum("kij,it,jt->kt", form.slaved, six, six)
    start = amplitude * np.array([1, 0, 0, 1, 0, 0])
    A -= (form.slaved @ start @ start)[:, None] * turning(slice(count))
    A[form.three] = Z
    A *= np.exp(1j * every.harmonic[:count] * (mode.wavenumber * row + wave.phase))[:, None]
    p, q, phi = (every.shape[:count].T @ A).real.reshape(3, *np.shape(tau)) / amplitude
    return p, q, phi


def two_mode_amplitudes(wave: Wave, tau: ArrayLike) -> tuple[Complexes, Complexes]:
    """Return A and B (...), in D0, of the fundamental A e^{−iΩτ} and of the L wave B e^{−iw̃τ} at 2ξ that it feeds.

        A' = −ah ĀB e^{iδτ},   B' = −ag A²e^{−iδτ},   δ = 2Ω − w̃,   A(0) = 1, B(0) = 0

        B = sgn(ah) √(−g/h) v sn(rτ/v | v⁴) e^{−iδτ/2},   A² = −B' e^{iδτ}/(ag)
        r = |a|√(−gh),   v = √(1+S²/4) − |S|/2,   S = δ/2r

    On resonance v = 1, B ∝ tanh rτ and A = sech rτ: the fundamental vanishes. Off resonance it returns. Errors raised
    and limits are those of `two_mode`.
    """
    from scipy.special import ellipj  # slow to import, and only the closed form needs it

    g, h = exchange(normal_form(wave))
    amplitude, mode = wave.amplitude, wave.mode
    if g * h >= 0:
        raise ValueError(f"the exchange at wavenumber = {mode.wavenumber} is explosive: g h = {g * h:.3g} >= 0")
    tau = np.asarray(tau, dtype=float)
    delta = 2 * mode.frequency - wave.free_frequency
    rate = abs(amplitude) * np.sqrt(-g * h)
    S = delta / (2 * rate)
    v = 1 / (np.hypot(1, S / 2) + abs(S) / 2)
    sn, cn, dn, turn = ellipj(rate * tau / v, v**4)
    peak = np.sqrt(-g / h) * v
    B = np.sign(h) * peak * sn * np.exp(-0.5j * delta * tau) * np.sign(amplitude)
    # A² e^{−iδτ/2}. Its argument without jumps of 2π advances by 2π with every period of sn, as `turn` does.
    square = peak / abs(g * amplitude) * (rate / v * cn * dn - 0.5j * abs(delta) * sn)
    angle = np.angle(square)
    angle -= 2 * np.pi * np.round((angle + turn) / (2 * np.pi))
    A = np.sqrt(np.abs(square)) * np.exp(0.5j * np.copysign(1, delta) * angle + 0.25j * delta * tau)
    return A, B


def exchange(form: NormalForm) -> tuple[float, float]:
    """Return g and h of `two_mode_amplitudes`: the rates of gain of the wave at 2ξ and of loss of the fundamental."""
    return -float(form.quadratic[1, 0, 0].real), -2 * float(form.quadratic[0, 3, 1].real)


def two_mode(wave: Wave, tau: ArrayLike, row: float = 0) -> tuple[Floats, Floats, Floats]:
    """Return p, q, φ in D0 at times τ (...): the fundamental and the L wave that it feeds, by `two_mode_amplitudes`.

    Raises ValueError where gh ≥ 0 (TR at its resonance for ν < −0.541): A and B then grow together, which no elliptic
    function of a real modulus describes. `three_mode` integrates that case.

    When it breaks: once RT(3ξ), which this form lacks, has grown. At ξ=1.475, a = 0.2, ν=0.17, |A| is right within 5 %
    until τ=304 and within 10 % until τ=361. p lacks the backward free wave, which matters while B is small. Off
    resonance the form is no better than second order, and in p it is worse.
    """
    tau, mode = np.asarray(tau, dtype=float), wave.mode
    A, B = two_mode_amplitudes(wave, tau)
    start = np.exp(1j * (mode.wavenumber * row + wave.phase))
    A = A * start * np.exp(-1j * mode.frequency * tau)
    B = B * start**2 * np.exp(-1j * wave.free_frequency * tau)
    return (mode.p * A + B).real, mode.q * A.real, -mode.f * A.imag
