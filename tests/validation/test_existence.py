"""The sentences of the paper: where resonance and antiresonance exist, and which harmonics q and φ hold.

Each verdict and number of the second table of docs/errata.md.
"""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import brentq

from tests.validation import paper_equations as paper
from tests.validation.paper_equations import CORRECT, PRINTED

KAPPA = float(paper.stiffness_ratio(0.17))  # the silica spheres of the paper
POISSON_GRID = np.linspace(-1, 0.5, 301)
XI_GRID = np.linspace(0, np.pi, 2003)[1:-1]
RESONANT = 1.475  # ξ2 of Fig. 3

# ---------------------------------------------------------------- existence of resonance and antiresonance


def crossings(gap: np.ndarray) -> np.ndarray:
    """Number of sign changes along the last axis."""
    return np.count_nonzero(np.diff(np.signbit(gap), axis=-1), axis=-1)


def test_crossings_are_counted() -> None:
    assert crossings(np.array([[1.0, -1, 1], [1, 2, 3]])).tolist() == [2, 0]


def tr_resonance(ratio: float, inertia: float = 0.4) -> float:
    def gap(xi: float) -> float:
        return float(2 * paper.transverse_branches(xi, ratio, inertia)[0] - np.sin(xi))

    return float(brentq(gap, 1e-2, np.pi - 1e-9))


def antiresonance_gap(wavenumber: np.ndarray | float, ratio: np.ndarray | float, branch: int) -> np.ndarray:
    """Ω² − `AntiRes`², with μ1 − 3μ2α/β = 5/(2(κ+3))."""
    return paper.transverse_branches(wavenumber, ratio)[branch] ** 2 - np.sin(wavenumber / 2) ** 2 * 2.5 / (ratio + 3)


@cache
def long_wave_slope_squared() -> sp.Expr:
    """(dΩ/dξ)² of TR at ξ=0: det M = 0 to order ξ², with I standing for Ĩ."""
    xi, slope2 = sp.symbols("xi slope2")
    mu1, mu2 = (3 * paper.kappa + 1) / (paper.kappa + 3), paper.kappa / (paper.kappa + 3)
    determinant = (mu1 / 2 * (1 - sp.cos(xi)) - slope2 * xi**2) * (
        2 * mu2 * (2 + sp.cos(xi)) - paper.inertia * slope2 * xi**2
    ) - 3 * mu2**2 * sp.sin(xi) ** 2
    return sp.solve(sp.diff(determinant, xi, 2).subs(xi, 0), slope2)[0]


def test_resonance_exists_for_every_stiffness_ratio() -> None:
    """2Ω starts below sin ξ, as (κ+1)/(κ+3) < 1, and ends above it, as Ω(π) > 0: they cross in 0<ξ<π for any κ, Ĩ."""
    assert sp.simplify(4 * long_wave_slope_squared() - (paper.kappa + 1) / (paper.kappa + 3)) == 0
    ratio = paper.stiffness_ratio(POISSON_GRID)[:, None]
    gap = 2 * paper.transverse_branches(XI_GRID, ratio)[0] - np.sin(XI_GRID)
    assert set(crossings(gap)) == {1}


def test_resonance_stays_in_the_first_zone() -> None:
    """ξ_res runs from 1.351 (ν=−1) to 1.568 (ν=½), so even 2ξ_res < π; and ξ_res = 1.4763 at ν = 0.17."""
    found = np.array([tr_resonance(ratio) for ratio in paper.stiffness_ratio(POISSON_GRID)])
    assert np.all(np.diff(found) > 0)
    assert found[[0, -1]] == pytest.approx([1.351158, 1.567672], abs=1e-6)
    assert 2 * found.max() < np.pi
    assert tr_resonance(KAPPA) == pytest.approx(1.476255, abs=1e-6)


def test_resonance_without_rotation_needs_positive_poisson_ratio() -> None:
    """φ=0: Ω=√μ1 sin(ξ/2), 2Ω=sin ξ only at cos(ξ/2)=√μ1, and μ1<1 only for κ<1, that is ν>0."""
    ratio = paper.stiffness_ratio(POISSON_GRID)
    mu1 = (3 * ratio + 1) / (ratio + 3)
    gap = 2 * np.sqrt(mu1)[:, None] * np.sin(XI_GRID / 2) - np.sin(XI_GRID)
    found = 2 * np.arccos(np.sqrt(np.minimum(mu1, 1)))
    visible = found > XI_GRID[1]  # a crossing below the first grid points is not resolved
    assert np.array_equal(found > 0, POISSON_GRID > 1e-12)
    assert np.array_equal(crossings(gap)[visible], np.ones(visible.sum()))
    assert not crossings(gap)[POISSON_GRID < 0].any()
    mu1_silica = (3 * KAPPA + 1) / (KAPPA + 3)
    assert 2 * np.arccos(np.sqrt(mu1_silica)) == pytest.approx(0.43966, abs=5e-6)
    assert found[-1] == pytest.approx(2 * np.arccos(3 / np.sqrt(11)))  # κ = ⅔


def test_resonance_of_the_lower_branch_leaves_for_the_zone_edge() -> None:
    """Large but finite Ĩ: the lower branch becomes the slow rotation, and its resonance goes to ξ=π with Q → 0."""
    found = [tr_resonance(KAPPA, inertia) for inertia in (1e2, 1e4)]
    shapes = [
        paper.transverse_shape(xi, KAPPA, float(paper.transverse_branches(xi, KAPPA, i)[0]), i)[0]
        for xi, i in zip(found, (1e2, 1e4), strict=True)
    ]
    assert np.pi - found[1] < 0.02
    assert shapes[1] < 0.01


def test_resonance_without_shear_exists() -> None:
    """g → 0: μ1=⅓, μ2=0, 2 sin(ξ/2)/√3 = sin ξ at ξ = 2 arccos(1/√3) = 1.91063, whatever ν."""
    xi = 2 * np.arccos(np.sqrt(1 / 3))
    assert xi == pytest.approx(1.91063, abs=5e-6)
    rotation, transverse = paper.transverse_branches(xi, 0.0)
    assert rotation == 0
    assert 2 * transverse == pytest.approx(np.sin(xi))


def test_rt_waves_have_neither_resonance_nor_antiresonance() -> None:
    ratio = paper.stiffness_ratio(POISSON_GRID)[:, None]
    upper = paper.transverse_branches(XI_GRID, ratio)[1]
    assert np.min(2 * upper - np.sin(XI_GRID)) > 1.6
    assert np.min(antiresonance_gap(XI_GRID, ratio, 1)) > 0.2


def test_antiresonance_exists_for_every_admissible_poisson_ratio() -> None:
    """AntiRes² = 5/(2(κ+3)) sin²(ξ/2): below TR at π for κ>½, above it at 0 for κ<3/2; −1≤ν≤½ is ⅔≤κ≤4/3."""
    kappa = paper.kappa
    curve = sp.Rational(5, 2) / (kappa + 3)
    alpha_over_beta, mu2 = (2 * kappa - 1) / (2 * kappa), kappa / (kappa + 3)
    mu1 = (3 * kappa + 1) / (kappa + 3)
    assert sp.simplify(mu1 - 3 * mu2 * alpha_over_beta - curve) == 0
    assert sp.simplify((mu1 - curve) * (kappa + 3) - 3 * (kappa - sp.Rational(1, 2))) == 0  # cut-off: Ω²(π) = μ1 there
    assert sp.simplify((curve - 4 * long_wave_slope_squared()) * (kappa + 3) - (sp.Rational(3, 2) - kappa)) == 0
    ratio = paper.stiffness_ratio(POISSON_GRID)
    assert set(crossings(antiresonance_gap(XI_GRID, ratio[:, None], 0))) == {1}
    ends = (ratio[0], KAPPA, ratio[-1])
    found = [brentq(lambda xi, k=k: antiresonance_gap(xi, k, 0), 0.1, np.pi - 1e-6) for k in ends]
    assert found == pytest.approx([1.029612, 2.128060, 2.701617], abs=1e-6)


def test_antiresonance_needs_rotation() -> None:
    """Φ̃=0 leaves α sin ξ sin²(ξ/2): zero only where α=0, κ=½, ν=⅔, outside −1≤ν≤½."""
    ratio = paper.stiffness_ratio(POISSON_GRID)
    assert np.min((2 * ratio - 1) / (2 * ratio + 3)) == pytest.approx(1 / 13)
    assert paper.stiffness_ratio(2 / 3) == pytest.approx(0.5)


def test_antiresonance_needs_shear() -> None:
    """g → 0: β=0, α=−⅓, so the numerator has no zero in 0<ξ<π."""
    no_shear = {paper.g2: 0}
    assert (paper.ALPHA.subs(no_shear), paper.BETA.subs(no_shear)) == (-sp.Rational(1, 3), 0)


# ---------------------------------------------------------------- harmonics of q and φ


@cache
def resonant_run() -> tuple[np.ndarray, np.ndarray]:
    times = np.arange(0, 300.01, 0.5)
    return times, paper.integrate_wave(RESONANT, KAPPA, 0.2, times, tolerance=1e-7)  # the numbers have four digits


def test_exact_law_is_odd_in_q_and_phi() -> None:
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(3, 3, 5))
    mirror = np.array([1, -1, -1])[:, None]
    seen = paper.exact_acceleration(*(mirror * row for row in rows), 0.2, KAPPA)
    assert seen == pytest.approx(mirror * paper.exact_acceleration(*rows, 0.2, KAPPA), abs=1e-14)
    assert seen != pytest.approx(paper.exact_acceleration(*rows, 0.2, KAPPA), abs=1e-2)


def test_q_and_phi_hold_odd_harmonics_only() -> None:
    _, fields = resonant_run()
    harmonic = 2 * abs(np.fft.fft(fields, axis=-1)).max(axis=0) / fields.shape[-1]
    p, q, phi = harmonic
    assert max(q[0:14:2].max(), phi[0:14:2].max(), p[1:14:2].max()) < 1e-10  # round-off
    assert [q[3] / q[1], phi[3] / phi[1]] == pytest.approx([0.0225, 0.2056], abs=5e-5)
    assert p[2] > 0.1


def test_what_shows_in_q_and_phi_is_the_third_harmonic() -> None:
    """Amplitudes of q and φ at one particle, over that of the fundamental."""
    times, fields = resonant_run()
    omega, window = float(paper.transverse_branches(RESONANT, KAPPA)[0]), np.hanning(len(times))

    # Least squares over the times of the paper's figure; half a unit of time more or less changes them by 1e-4
    early = times <= 165
    waves = np.exp(1j * omega * np.multiply.outer(times[early], [1, 2, 3]))
    columns = np.concatenate([waves.real, waves.imag], axis=1)
    fitted = np.linalg.lstsq(columns, fields[early, 1:, 0], rcond=None)[0]
    amplitudes = np.hypot(fitted[:3], fitted[3:])
    assert amplitudes[2] / amplitudes[0] == pytest.approx([0.0024, 0.0252], abs=5e-5)

    # A Hann window over τ ≤ 300, where it has grown

    def relative(component: int, order: int) -> float:
        at = [abs(np.sum(window * fields[:, component, 0] * np.exp(1j * m * omega * times))) for m in (order, 1)]
        return float(at[0] / at[1])

    assert [relative(1, 3), relative(2, 3)] == pytest.approx([0.0074, 0.0680], abs=5e-5)
    assert max(relative(1, 2), relative(2, 2)) < 1e-4  # leakage of the window


def test_third_harmonic_is_nearly_resonant_with_rt() -> None:
    """At ξ=1.475: 3Ω−Ω_RT(3ξ) = 0.00105 and Ω+Ω_L(2ξ)−Ω_RT(3ξ) = 0.00172."""
    omega, upper = paper.transverse_branches(RESONANT, KAPPA)[0], paper.transverse_branches(3 * RESONANT, KAPPA)[1]
    assert 3 * omega - upper == pytest.approx(0.00105, abs=5e-6)
    assert omega + np.sin(RESONANT) - upper == pytest.approx(0.00172, abs=5e-6)


def test_nonlinearity_parameter_of_the_simulations() -> None:
    """The paper's ε ≈ −0.1 fits both forms: −0.1067 with √3, −0.0924 with 3/2."""
    silica = {paper.kappa: KAPPA, paper.D0: 0.2}
    values = [float(c.epsilon.subs(paper.HERTZ_MINDLIN).subs(silica)) for c in (CORRECT, PRINTED)]
    assert values == pytest.approx([-0.1067, -0.0924], abs=5e-5)
