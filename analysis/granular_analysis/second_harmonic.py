"""Second-harmonic generation by plane waves in a hexagonal granular crystal, in closed form.

One wave cos ϑ, ϑ = ξn − Ωτ + phase, runs along y through rows n of adhesive micro-spheres. To first order it is a mode
of the linear lattice (L, TR or RT); to second order it drives a longitudinal wave at (2ξ, 2Ω), and the initial
condition launches two free waves at 2ξ that cancel it at τ=0. Everything is dimensionless, as in the paper

    S. P. Wallen and N. Boechler, "Shear to longitudinal mode conversion via second harmonic generation in a
    two-dimensional microscale granular crystal", arXiv:1602.04587 ("Eq." below is an equation of the preprint),

p = v/D0 (along the wave), q = −u/D0, φ = Rθ/D0, a = D0/Δ0, τ = t/√(m/(2(g1+3k1))) so that p'' = ¼∇²p. (The paper prints
τ = t/√(2m/(g1+3k1)), but its dispersion relation Ω_L = sin(ξ/2) needs the τ used here.)

To second order, dp = p₊−p, dq = q₊−q, σ = φ₊+φ, D X = X_n − X_{n−1}, S X = X_n + X_{n−1} (Eqs. 8–10):

    p''  = ¼ D dp + (ε/8) D[dp² − α dq² + (2/√3) β σ dq]
    q''  = (μ1/4) D dq − (√3μ2/2) D σ + (ε/4) D[γ dp dq − √3 β σ dp]
    Ĩφ'' = (μ2/2)(√3 S dq − 2 S σ − 4φ) + (εβ/2) S[dp dq/√3 − σ dp]

where the paper prints α/6 for α/8 and β/(3√3) for β/(4√3) in the first line.

The contacts have the laws of the paper, in the geometry of the paper or of LAMMPS (`ratios`). For any other law,
lattice or direction, for compression, and for spheres that do not turn, use `granular_analysis.theory.second_order`,
which this module tests.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Mode",
    "antiresonance",
    "dispersion",
    "generated_amplitude",
    "mode",
    "nonlinearity",
    "ratios",
    "resonance",
    "second_harmonic",
    "second_harmonic_terms",
    "second_order",
]

Floats = NDArray[np.float64]
ModeName = Literal["L", "TR", "RT"]
MODES: tuple[ModeName, ...] = ("L", "TR", "RT")

SOLID_SPHERE = 0.4  # I/(mR²) of a homogeneous sphere
ALONG_Y = 90.0  # degrees from a close-packed row


@dataclass(frozen=True)
class Ratios:
    """Dimensionless constants of the lattice, from κ = g1/k1, Ĩ = I/(mR²) and η = Δ0/2R.

    longitudinal multiplies ε where the L mode acts on itself; it is 1 in the geometry of the paper, where η = 0.
    """

    kappa: float
    mu1: float
    mu2: float
    alpha: float
    beta: float
    gamma: float
    inertia: float
    longitudinal: float = 1.0
    overlap_ratio: float = 0.0


def ratios(poisson_ratio: float, inertia: float = SOLID_SPHERE, overlap_ratio: float = 0.0) -> Ratios:
    """Return the constants of the lattice for Hertz–Mindlin contacts, κ = 2(1−ν)/(2−ν), by `of_stiffness`.

    Parameters
    ----------
    poisson_ratio : ν in [−1, 0.5]
    inertia : I/(mR²) > 0
    overlap_ratio : η in [0, 0.1]; 0 is the paper's geometry, 2.5e-4 the true geometry of its silica spheres

    Raises
    ------
    ValueError
        For values outside these ranges.

    Examples
    --------
    >>> constants = ratios(0.17)  # silica, in the paper's geometry
    >>> round(constants.kappa, 4), round(constants.alpha, 4)
    (0.9071, 0.1691)
    """
    if not -1 <= poisson_ratio <= 0.5:
        raise ValueError(f"poisson_ratio = {poisson_ratio} is outside [-1, 0.5]")
    return of_stiffness(2 * (1 - poisson_ratio) / (2 - poisson_ratio), inertia, overlap_ratio)


def of_stiffness(kappa: float, inertia: float = SOLID_SPHERE, overlap_ratio: float = 0.0) -> Ratios:
    """Return the constants of the lattice for a ratio κ = g1/k1 > 0 of stiffnesses, from a material or measured.

        μ1 = (3κ+1)/(κ+3),  μ2 = κ/(κ+3),  α = (2κ−1)/(2κ+3),  β = 2κ/(2κ+3),  γ = (2κ+1)/(2κ+3)

    The overlap ratio η = Δ0/2R adds the effect of the true length and direction of contacts, with h = η/(1−η):

        Ĩ → Ĩ/(1−η),  α → α + 2h(1−5κ)/(2κ+3),  β → β(1−6h),  ε of the L mode → ε[1 − 6h(1−κ)/(2κ+3)]

    These are exact in η: to second order in the displacements the geometry enters only through 1/(2R−Δ0). No second
    harmonic depends on γ. The definitions stand below Eq. 10 and are right as printed; the geometry is not in the
    paper.

    Raises ValueError for values outside the ranges of `ratios`.
    """
    if not 0 <= overlap_ratio <= 0.1:
        raise ValueError(f"overlap_ratio = {overlap_ratio} is outside [0, 0.1]")
    for name, value in (("kappa", kappa), ("inertia", inertia)):
        if not 0.0 < value < np.inf:
            raise ValueError(f"{name} = {value} must be positive and finite")
    h, unit = overlap_ratio / (1 - overlap_ratio), 2 * kappa + 3
    return Ratios(
        kappa=kappa,
        mu1=(3 * kappa + 1) / (kappa + 3),
        mu2=kappa / (kappa + 3),
        alpha=(2 * kappa - 1 + 2 * h * (1 - 5 * kappa)) / unit,
        beta=2 * kappa * (1 - 6 * h) / unit,
        gamma=(2 * kappa + 1) / unit,
        inertia=inertia / (1 - overlap_ratio),
        longitudinal=1 - 6 * h * (1 - kappa) / unit,
        overlap_ratio=overlap_ratio,
    )


def nonlinearity(ratios: Ratios, amplitude: float) -> float:
    """Return ε = √3 D0(g2+3k2)/(g1+3k1) = −√3 a(2κ+3)/(4(κ+3)) at the amplitude a = D0/Δ0; the paper prints 3/2 for √3.

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> print(round(nonlinearity(constants, 0.2), 4))
    -0.1067
    """
    return -np.sqrt(3) * amplitude * (2 * ratios.kappa + 3) / (4 * (ratios.kappa + 3))


@dataclass(frozen=True)
class Mode:
    """Plane wave of the linear lattice: p = P cos ϑ, q = Q cos ϑ, φ = −f sin ϑ, with ϑ = ξn − Ωτ + phase.

    L has p=1, q=f=0. TR (lower) and RT (upper) have p=0, q=Q>0 and Q²+f²=1. In the paper's notation Q̃=Q and Φ̃=if, so
    the "sum of squares" of the paper must be the sum of squared moduli. `granular_analysis.theory.bloch.mode` makes
    modes in other directions than y.

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> wave = mode("TR", 0.802, constants)
    >>> round(wave.q**2 + wave.f**2, 12)
    1.0
    """

    name: str
    wavenumber: float
    frequency: float
    p: float
    q: float
    f: float
    direction: float = ALONG_Y

    @property
    def along_y(self) -> bool:
        """True if the wave runs along y."""
        return self.direction == ALONG_Y


def dispersion(wavenumbers: ArrayLike, name: ModeName, ratios: Ratios) -> Floats:
    """Return the frequency Ω(ξ) of a mode, in rad per τ, at wavenumbers (...) in (0, π], in rad per row.

    L:       Ω = sin(ξ/2)                                     Eq. 11, right as printed
    TR, RT:  (b − ĨΩ²)(A − Ω²) = c0², lower and upper root    Eq. 12, right as printed

    Raises ValueError for a wavenumber out of range, and for another name than "L", "TR" or "RT".

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> dispersion([1.0, np.pi], "L", constants).round(4).tolist()
    [0.4794, 1.0]
    """
    return _branch(wavenumbers, name, ratios)[0]


def mode(name: ModeName, wavenumber: float, ratios: Ratios) -> Mode:
    """Return a plane-wave mode at wavenumber ξ, with its frequency and real amplitudes.

        f/Q = (A − Ω²)/c0 = c0/(b − ĨΩ²)        Eq. 28, in which Ω² stands in place of 2Ω²

    At ξ=π the limit ξ→π⁻ is returned: one of TR and RT has f=0, the other has Q=0⁺ (rounding leaves ~1e-16) and |f|=1,
    with f>0 if it is the lower root (TR) and f<0 if it is the upper (RT). Raises the errors of `dispersion`.

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> round(mode("TR", 1.475, constants).frequency, 4)
    0.4974
    """
    frequency, q, f = (float(value) for value in _branch(wavenumber, name, ratios))
    return Mode(name, float(wavenumber), frequency, 1.0 if name == "L" else 0.0, q, f)


def _branch(wavenumbers: ArrayLike, name: ModeName, ratios: Ratios) -> tuple[Floats, Floats, Floats]:
    """Return Ω, Q, f of a mode without cancellation: b − ĨΩ² = d ± r at the roots, 2d = b − ĨA, r² = d² + Ĩc0²."""
    xi = np.asarray(wavenumbers, dtype=float)
    if not np.all((xi > 0) & (xi <= np.pi)):
        raise ValueError(f"wavenumber = {wavenumbers!r} is outside (0, pi]")
    s, c = np.sin(xi / 2), np.cos(xi)
    if name == "L":
        return s, np.zeros_like(xi), np.zeros_like(xi)
    if name not in ("TR", "RT"):
        raise ValueError(f"mode name = {name!r} is not one of 'L', 'TR', 'RT'")
    mu1, mu2, inertia = ratios.mu1, ratios.mu2, ratios.inertia
    A, b, c0 = mu1 * s**2, 2 * mu2 * (2 + c), np.sqrt(3) * mu2 * np.sin(xi)
    d, half_trace = (b - inertia * A) / 2, (b + inertia * A) / 2
    r = np.hypot(d, np.sqrt(inertia) * c0)
    if name == "RT":
        squared = (half_trace + r) / inertia
        q, f = np.where(d >= 0, inertia * c0, r - d), -np.where(d >= 0, d + r, c0)
    else:
        # Product of the roots over the upper root. The factor s² is taken out of Ab − c0² against cancellation.
        determinant = 2 * mu2 * s**2 * (mu1 * (2 + c) - 3 * mu2 * (1 + c))
        squared = determinant / (half_trace + r)
        q, f = np.where(d >= 0, d + r, inertia * c0), np.where(d >= 0, c0, r - d)
    norm = np.hypot(q, f)
    return np.sqrt(squared), q / norm, f / norm


def source(mode: Mode, ratios: Ratios) -> float:
    """Return the strength g of the drive in P1'' + w̃² P1 = i sin ξ · g e^{2iϑ} for complex fields, from D[…] in Eq. 8.

    TR, RT: g = Q[α sin²(ξ/2) Q − (β/√3) sin ξ f];  L: g = −sin²(ξ/2), times `Ratios.longitudinal`.
    """
    s = np.sin(mode.wavenumber / 2)
    if mode.name == "L":
        return float(-ratios.longitudinal * s**2)
    turned = ratios.beta / np.sqrt(3) * np.sin(mode.wavenumber) * mode.f
    return float(mode.q * (ratios.alpha * s**2 * mode.q - turned))


def refuse_oblique(mode: Mode) -> None:
    """Raise ValueError for a mode along another direction than y."""
    if not mode.along_y:
        raise ValueError(f"direction = {mode.direction} of the mode is not 90; the closed forms hold only along y")


def doubled_frequency(mode: Mode) -> float:
    """Return w̃ = Ω_L(2ξ) = sin ξ, the frequency of the free waves at twice the wavenumber, in rad per τ."""
    refuse_oblique(mode)  # here, because every closed form of a second harmonic calls this function
    return float(np.sin(mode.wavenumber))


def generated_amplitude(mode: Mode, ratios: Ratios) -> float:
    """Return the amplitude P̃1/i of the generated wave per ε, with prefactor 1 (complex fields); real fields have half.

        TR, RT:  P̃1/i = sin ξ g/(w̃² − 4Ω²)      Eq. 26, in which 4/3 stands in place of 1
        L:       P̃1/i = ½ cot(ξ/2)                (times `Ratios.longitudinal`)

    with g from `source` and w̃ = sin ξ = Ω_L(2ξ). The result is ±inf, never nan, if the denominator rounds to 0.

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> wave = mode("TR", 0.802, constants)
    >>> print(round(abs(nonlinearity(constants, 0.2) * generated_amplitude(wave, constants)) / 2, 5))  # of D0
    0.00195
    """
    w = doubled_frequency(mode)
    if mode.name == "L":  # w̃² − 4Ω² = −4 sin⁴(ξ/2) cancels at small ξ
        return float(ratios.longitudinal / np.tan(mode.wavenumber / 2) / 2)
    strength = float(w * source(mode, ratios))
    denominator = float((w - 2 * mode.frequency) * (w + 2 * mode.frequency))
    return strength / denominator if denominator else float(np.copysign(np.inf, strength))


def second_harmonic_terms(
    mode: Mode, ratios: Ratios, amplitude: float, tau: ArrayLike, row: float = 0, phase: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Return the three waves of the second harmonic, real fields (...) in D0: generated, free forward, free backward.

        p_SH = (ε/2) Re {P̃1 e^{2iϑ} + P̃₊ e^{i(2ξn − w̃τ)} + P̃₋ e^{i(2ξn + w̃τ)}},  w̃ = Ω_L(2ξ)           Eq. 25
        P̃₊ = −(w̃ + 2Ω)/(2w̃) P̃1,  P̃₋ = −(w̃ − 2Ω)/(2w̃) P̃1                               Eqs. 30, 31, right as printed

    A phase replaces 2ξn by 2ξn + 2·phase. The term that a start at η > 0 adds is left out. Arguments are those of
    `second_harmonic`.

    When it breaks: on resonance the generated and the forward wave are infinite; their sum is finite, and
    `second_harmonic` returns it.

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> wave = mode("TR", 0.802, constants)
    >>> [round(float(each), 4) for each in second_harmonic_terms(wave, constants, 0.2, 20.0)]
    [-0.0019, -0.0017, 0.0002]
    """
    tau, half = np.asarray(tau, dtype=float), nonlinearity(ratios, amplitude) / 2
    w, twice = doubled_frequency(mode), 2 * mode.frequency
    angle, g = 2 * (mode.wavenumber * row + phase), source(mode, ratios)
    # P̃₊ and P̃₋ with the common factor sin ξ of numerator and denominator taken out: regular at ξ=π.
    generated = -half * generated_amplitude(mode, ratios) * np.sin(angle - twice * tau)
    forward, backward = (half * g / (2 * (w + sign * twice)) * np.sin(angle + sign * w * tau) for sign in (-1, 1))
    return generated, forward, backward


def second_harmonic(
    mode: Mode, ratios: Ratios, amplitude: float, tau: ArrayLike, row: float = 0, phase: float = 0.0
) -> Floats:
    """Return the second harmonic p_SH(τ) (...) in D0, the sum of `second_harmonic_terms`, regular on resonance.

        p_SH = (εg/4) Re e^{2i(ξn+phase)} [e^{iw̃τ} E(−w̃−2Ω) − e^{−iw̃τ} E(w̃−2Ω)],   E(x) = ∫₀^τ e^{ixt} dt

    with the drive g from `source`; the second term grows as τ if w̃ = 2Ω. For η > 0, with h = η/(1−η), the second
    harmonic also contains

        a μ2 h(√3/4) sin²(ξ/2)(Q² − P²) sin ξ sin 2(ξn+phase) (1 − cos w̃τ)/w̃²

    because the start loads the shear springs in one step along the tangents of the displaced lattice (the rule of
    LAMMPS) instead of along a path to it: the difference stays in the contacts as a static force at 2ξ.

    When it breaks: once p_SH is no longer small (near the resonance for τ ≳ 1/|ε|), and where g ≈ 0 (the
    antiresonance), because p is of order a⁴ there. Away from both, the relative error of p, q and φ falls as a².

    Source: Eqs. 22 and 35 with the initial conditions 17 and 18, solved by Duhamel's integral.

    Parameters
    ----------
    mode : fundamental along y
    ratios : constants with which the mode was made
    amplitude : a = D0/Δ0
    tau : any times (...)
    row : n, counted from the row where ϑ = −Ωτ + phase
    phase : rad

    Raises
    ------
    ValueError
        For a mode in another direction than y.

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> wave = mode("TR", 0.802, constants)
    >>> second_harmonic(wave, constants, 0.2, [0.0, 20.0]).round(4).tolist()
    [0.0, -0.0034]
    """
    tau = np.asarray(tau, dtype=float)
    w, twice = doubled_frequency(mode), 2 * mode.frequency
    start = np.exp(2j * (mode.wavenumber * row + phase))
    backward = np.exp(1j * w * tau) * _phase_integral(-w - twice, tau)
    forward = np.exp(-1j * w * tau) * _phase_integral(w - twice, tau)
    driven = nonlinearity(ratios, amplitude) / 4 * source(mode, ratios) * np.real(start * (backward - forward))
    h = ratios.overlap_ratio / (1 - ratios.overlap_ratio)
    left = amplitude * ratios.mu2 * h * np.sqrt(3) / 4 * np.sin(mode.wavenumber / 2) ** 2 * (mode.q**2 - mode.p**2)
    still = tau**2 / 2 * np.sinc(w * tau / (2 * np.pi)) ** 2  # (1 − cos w̃τ)/w̃², regular at w̃ = 0
    return np.asarray(driven + left * w * start.imag * still)


def _phase_integral(x: float, tau: Floats) -> NDArray[np.complex128]:
    """Return E(x) = ∫₀^τ e^{ixt} dt = τ e^{ixτ/2} sin(xτ/2)/(xτ/2), which is τ at x=0."""
    return tau * np.exp(0.5j * x * tau) * np.sinc(x * tau / (2 * np.pi))


def second_order(
    mode: Mode, ratios: Ratios, amplitude: float, tau: ArrayLike, row: float = 0, phase: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Return the displacements p, q, φ (...) in D0 to second order: the mode, plus `second_harmonic` in p.

    Arguments and limits are those of `second_harmonic`. q and φ have no second-order term, because by symmetry they
    contain only odd harmonics: the simulated q and φ of the paper at the resonance show the third harmonic.

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> wave = mode("TR", 0.802, constants)
    >>> p, q, phi = second_order(wave, constants, 0.2, [0.0, 20.0])
    >>> q.round(4).tolist()
    [0.9731, 0.7157]
    """
    tau = np.asarray(tau, dtype=float)
    theta = mode.wavenumber * row - mode.frequency * tau + phase
    p = mode.p * np.cos(theta) + second_harmonic(mode, ratios, amplitude, tau, row, phase)
    return p, mode.q * np.cos(theta), -mode.f * np.sin(theta)


def resonance(ratios: Ratios) -> float:
    """Return ξ where the second harmonic of TR is a free L wave, 2Ω_TR(ξ) = sin ξ; it is in the first zone for any ν.

    With Ω² = (1−C²)/4 and C = cos ξ, Eq. 12 divided by 1−C is a cubic equation in C,

        [2μ2(2+C) − Ĩ(1−C²)/4][μ1 − (1+C)/2]/2 = 3μ2²(1+C).

    Left minus right is μ1μ2 > 0 at C=−1, and negative at C=1 and wherever the first bracket, which is b − ĨΩ², crosses
    zero. So the least root in (−1, 1) has b − ĨΩ² > 0, the sign of the lower branch, for any inertia.

    Examples
    --------
    >>> round(resonance(ratios(0.17)), 4)
    1.4763
    """
    mu1, mu2 = ratios.mu1, ratios.mu2
    C = np.polynomial.Polynomial([0, 1])
    b = 2 * mu2 * (2 + C) - ratios.inertia * (1 - C**2) / 4
    roots = (b * (mu1 - (1 + C) / 2) / 2 - 3 * mu2**2 * (1 + C)).roots()
    inside = roots.real[(np.abs(roots.imag) < 1e-12) & (np.abs(roots) < 1)]
    return float(np.arccos(np.min(inside)))


def antiresonance(ratios: Ratios) -> float | None:
    """Return ξ in (0, π) where TR generates no p at order ε: Ω = sin(ξ/2)√(μ1 − 3μ2 α/β) (Eq. 29); None without such ξ.

    In Eq. 12, with ρ = α/β, λ = μ1 − 3μ2ρ and C = cos ξ, a factor 1−C cancels and the rest is linear in C:

        C = [2μ2(1−2ρ) + Ĩλρ/2]/[2μ2(ρ−1) + Ĩλρ/2]

    Examples
    --------
    >>> round(antiresonance(ratios(0.17)), 4)
    2.1281
    """
    mu2, rho = ratios.mu2, ratios.alpha / ratios.beta
    rate = ratios.mu1 - 3 * mu2 * rho
    inertial = ratios.inertia * rate * rho / 2
    numerator, denominator = 2 * mu2 * (1 - 2 * rho) + inertial, 2 * mu2 * (rho - 1) + inertial
    # At the crossing ρ > 0 means f > 0, which is TR; a crossing with f < 0 is on RT.
    if rate <= 0 or rho <= 0 or abs(numerator) >= abs(denominator):
        return None
    return float(np.arccos(numerator / denominator))
