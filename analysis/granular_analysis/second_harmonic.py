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

Contacts are those of the paper, in its geometry or that of LAMMPS (`ratios`). For any other law, lattice or direction,
for compression, and for spheres that do not turn, use `granular_analysis.theory.second_order`; this module is a test of
it.
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

    longitudinal multiplies ε where the L mode acts on itself; it is 1 in the geometry of the paper, where η is 0.
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
    """Constants of the lattice for Hertz–Mindlin contacts, κ = 2(1−ν)/(2−ν), by `of_stiffness`.

    ν is in [−1, 0.5], inertia I/(mR²) > 0, and overlap_ratio in [0, 0.1]: 0 in the paper's geometry, 2.5e-4 of its
    silica spheres. Raises ValueError for values outside these ranges.

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
    """Constants of the lattice for a ratio κ = g1/k1 > 0 of stiffnesses, of a material or as measured.

        μ1 = (3κ+1)/(κ+3),  μ2 = κ/(κ+3),  α = (2κ−1)/(2κ+3),  β = 2κ/(2κ+3),  γ = (2κ+1)/(2κ+3)

    The overlap ratio η = Δ0/2R adds the effect of the true length and direction of contacts, with h = η/(1−η):

        Ĩ → Ĩ/(1−η),  α → α + 2h(1−5κ)/(2κ+3),  β → β(1−6h),  ε of the L mode → ε[1 − 6h(1−κ)/(2κ+3)]

    These are exact in η: to second order in the displacements the geometry enters only through 1/(2R−Δ0). No second
    harmonic depends on γ. Definitions below Eq. 10, right as printed; geometry is not in the paper.

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
    """ε = √3 D0(g2+3k2)/(g1+3k1) = −√3 a(2κ+3)/(4(κ+3)) of the amplitude a = D0/Δ0; the paper prints 3/2 for √3.

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

    L has p=1, q=f=0. TR (lower) and RT (upper) have p=0, q=Q>0 and Q²+f²=1; in the paper's notation Q̃=Q, Φ̃=if, whose
    "sum of squares" must be that of moduli. Other directions than y are those of `granular_analysis.theory.bloch.mode`.

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
    """Frequency Ω(ξ) of a mode at wavenumbers (...), rad per row in (0, π]; ValueError for others, and another name.

    L:       Ω = sin(ξ/2)                                     Eq. 11, right as printed
    TR, RT:  (b − ĨΩ²)(A − Ω²) = c0², lower and upper root    Eq. 12, right as printed

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> dispersion([1.0, np.pi], "L", constants).round(4).tolist()
    [0.4794, 1.0]
    """
    return _branch(wavenumbers, name, ratios)[0]


def mode(name: ModeName, wavenumber: float, ratios: Ratios) -> Mode:
    """One plane-wave mode at wavenumber ξ, frequency and real amplitudes; raises what `dispersion` raises.

        f/Q = (A − Ω²)/c0 = c0/(b − ĨΩ²)        Eq. 28, which has Ω² in place of 2Ω²

    At ξ=π the limit ξ→π⁻ is returned: of TR and RT one has f=0, the other Q=0⁺ (rounding leaves ~1e-16) and |f|=1, f>0
    if it is the lower root and f<0 if it is the upper.

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> round(mode("TR", 1.475, constants).frequency, 4)
    0.4974
    """
    frequency, q, f = (float(value) for value in _branch(wavenumber, name, ratios))
    return Mode(name, float(wavenumber), frequency, 1.0 if name == "L" else 0.0, q, f)


def _branch(wavenumbers: ArrayLike, name: ModeName, ratios: Ratios) -> tuple[Floats, Floats, Floats]:
    """Ω, Q, f of a mode, free of cancellation: with 2d = b − ĨA and r² = d² + Ĩc0² the roots have b − ĨΩ² = d ± r."""
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
        # Product of the roots over the upper one; Ab − c0² with its factor s² taken out, which a difference would lose.
        determinant = 2 * mu2 * s**2 * (mu1 * (2 + c) - 3 * mu2 * (1 + c))
        squared = determinant / (half_trace + r)
        q, f = np.where(d >= 0, d + r, inertia * c0), np.where(d >= 0, c0, r - d)
    norm = np.hypot(q, f)
    return np.sqrt(squared), q / norm, f / norm


def source(mode: Mode, ratios: Ratios) -> float:
    """Strength g of the drive in P1'' + w̃² P1 = i sin ξ · g e^{2iϑ} for complex fields, from D[…] in Eq. 8.

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
    """w̃ = Ω_L(2ξ) = sin ξ, the frequency of the free waves at twice the wavenumber, in rad per unit of τ."""
    refuse_oblique(mode)  # checked here, since every closed form of a second harmonic calls this function
    return float(np.sin(mode.wavenumber))


def generated_amplitude(mode: Mode, ratios: Ratios) -> float:
    """Amplitude P̃1/i of the generated wave per ε, with prefactor 1 (complex fields); real fields take half of it.

        TR, RT:  P̃1/i = sin ξ g/(w̃² − 4Ω²)      Eq. 26, which has 4/3 in place of 1
        L:       P̃1/i = ½ cot(ξ/2)                (times `Ratios.longitudinal`)

    with g of `source` and w̃ = sin ξ = Ω_L(2ξ). Where the denominator rounds to 0 it is ±inf, never nan.

    Examples
    --------
    >>> constants = ratios(0.17)
    >>> wave = mode("TR", 0.802, constants)
    >>> print(round(abs(nonlinearity(constants, 0.2) * generated_amplitude(wave, constants)) / 2, 5))  # of D0
    0.00195
    """
    w = doubled_frequency(mode)
    if mode.name == "L":  # w̃² − 4Ω² = −4 sin⁴(ξ/2), which a difference loses at small ξ
        return float(ratios.longitudinal / np.tan(mode.wavenumber / 2) / 2)
    strength = float(w * source(mode, ratios))
    denominator = float((w - 2 * mode.frequency) * (w + 2 * mode.frequency))
    return strength / denominator if denominator else float(np.copysign(np.inf, strength))


def second_harmonic_terms(
    mode: Mode, ratios: Ratios, amplitude: float, tau: ArrayLike, row: float = 0, phase: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Return the second harmonic's waves, real fields: generated, free forward, free backward, shaped like tau.

        p_SH = (ε/2) Re {P̃1 e^{2iϑ} + P̃₊ e^{i(2ξn − w̃τ)} + P̃₋ e^{i(2ξn + w̃τ)}},  w̃ = Ω_L(2ξ)           Eq. 25
        P̃₊ = −(w̃ + 2Ω)/(2w̃) P̃1,  P̃₋ = −(w̃ − 2Ω)/(2w̃) P̃1                               Eqs. 30, 31, right as printed

    (with phase, 2ξn + 2·phase for 2ξn), without what a start at η > 0 adds. Breaks on resonance: generated and forward
    wave are infinite with a finite sum, which `second_harmonic` gives. Arguments as there.

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
    """Second-harmonic displacement p_SH(τ) in units of D0, the sum of `second_harmonic_terms`, regular on resonance.

        p_SH = (εg/4) Re e^{2i(ξn+phase)} [e^{iw̃τ} E(−w̃−2Ω) − e^{−iw̃τ} E(w̃−2Ω)],   E(x) = ∫₀^τ e^{ixt} dt

    with the drive g of `source`; the second term grows as τ when w̃ = 2Ω. With η > 0, h = η/(1−η), it has in addition

        a μ2 h(√3/4) sin²(ξ/2)(Q² − P²) sin ξ sin 2(ξn+phase) (1 − cos w̃τ)/w̃²

    since the shear springs are loaded in one step along the tangents of the displaced lattice (the rule of LAMMPS), not
    along the path there: the difference stays in the contacts as a static force at 2ξ.

    mode and ratios are the fundamental and the constants it was made with, amplitude is a = D0/Δ0, tau any times, row n
    counts from the row where ϑ = −Ωτ + phase.

    Breaks when p_SH is no longer small (near the resonance for τ ≳ 1/|ε|) and where g ≈ 0 (the antiresonance): there p
    is of order a⁴. Away from both, the relative error of p, q and φ falls as a². Source: Eqs. 22 and 35 with the
    initial conditions 17 and 18, solved by Duhamel's integral.

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
    """E(x) = ∫₀^τ e^{ixt} dt = τ e^{ixτ/2} sin(xτ/2)/(xτ/2), which is τ at x=0."""
    return tau * np.exp(0.5j * x * tau) * np.sinc(x * tau / (2 * np.pi))


def second_order(
    mode: Mode, ratios: Ratios, amplitude: float, tau: ArrayLike, row: float = 0, phase: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Displacements p, q, φ in units of D0 to second order: the mode, and `second_harmonic` in p. Arguments as there.

    q and φ have no second-order term, because by symmetry they contain only odd harmonics. The simulated signals of the
    paper at the resonance show the third harmonic.

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
    """Wavenumber where the TR mode's second harmonic is a free L wave, 2Ω_TR(ξ) = sin ξ, in the first zone for any ν.

    Put Ω² = (1−C²)/4, C = cos ξ, into Eq. 12 and divide by 1−C: what remains is a cubic in C,

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
    """Wavenumber in (0, π) where TR generates no p at order ε: Ω = sin(ξ/2)√(μ1 − 3μ2 α/β) (Eq. 29).

    In Eq. 12, with ρ = α/β, λ = μ1 − 3μ2ρ and C = cos ξ, a factor 1−C cancels and the rest is linear in C:

        C = [2μ2(1−2ρ) + Ĩλρ/2]/[2μ2(ρ−1) + Ĩλρ/2]

    None if TR has no such wavenumber.

    Examples
    --------
    >>> round(antiresonance(ratios(0.17)), 4)
    2.1281
    """
    mu2, rho = ratios.mu2, ratios.alpha / ratios.beta
    rate = ratios.mu1 - 3 * mu2 * rho
    inertial = ratios.inertia * rate * rho / 2
    numerator, denominator = 2 * mu2 * (1 - 2 * rho) + inertial, 2 * mu2 * (rho - 1) + inertial
    # ρ > 0 is f > 0 at the crossing, which is TR; a crossing with f < 0 is on RT.
    if rate <= 0 or rho <= 0 or abs(numerator) >= abs(denominator):
        return None
    return float(np.arccos(numerator / denominator))
