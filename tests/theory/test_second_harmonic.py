"""The closed-form theory against reference numbers, high precision, and its own limits."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest

from granular_analysis import second_harmonic as sh
from tests.manual import Mutant, off, verifies

pytestmark = pytest.mark.rounding  # matrices of an eigenvalue problem, sines and cosines

SILICA = sh.ratios(0.17)
SILICA_ETA = 2.498514361612e-10 / 1e-6  # Δ0/2R of the paper's spheres

# ξ, mode, Ω, Q, f, P̃1/i: derived with computer algebra, independently of this module.
TABLE = [
    (0.802, "TR", 0.276935327978, 0.973101202335, 0.230378058881, -0.0365016850),
    (0.802, "RT", 1.788072111095, 0.094276715198, -0.995546031568, -0.0008730171),
    (0.802, "L", 0.390339208440, 0.0, 0.0, 1.1793218504),
    (1.475, "TR", 0.497369073475, 0.909207489850, 0.416343296332, -13.8651197840),
    (2.127, "TR", 0.699055989569, 0.819326692835, 0.573326931521, 4.07540e-5),
]
HALF_DIGIT_12 = 0.51e-12
EVERY_MODE = ("L", "TR", "RT")


@pytest.mark.parametrize(("xi", "name", "frequency", "q", "f", "generated"), TABLE)
def test_modes_have_the_tabulated_numbers(xi, name, frequency, q, f, generated):
    mode = sh.mode(name, xi, SILICA)
    assert [mode.frequency, mode.q, mode.f] == pytest.approx([frequency, q, f], rel=0, abs=HALF_DIGIT_12)
    # Half a unit of the last digit given: 1e-10, and 1e-10 of 4.07540e-5.
    assert sh.generated_amplitude(mode, SILICA) == pytest.approx(generated, rel=0, abs=0.51e-10)


def test_a_wrong_last_digit_of_the_table_would_be_seen():
    mode = sh.mode("TR", 0.802, SILICA)
    assert mode.frequency != pytest.approx(0.276935327979, rel=0, abs=HALF_DIGIT_12)


def test_ratios_of_silica():
    # All digits given; half a unit of the last.
    expected = [0.9071038251366, 0.9524475524476, 0.2321678321678, 0.1691259931896, 0.3768444948922, 0.5845629965948]
    r = SILICA
    assert [r.kappa, r.mu1, r.mu2, r.alpha, r.beta, r.gamma] == pytest.approx(expected, rel=0, abs=1e-13)
    assert sh.nonlinearity(r, 0.2) == pytest.approx(-0.106708864438, rel=0, abs=HALF_DIGIT_12)


@pytest.mark.parametrize(
    ("eta", "at_resonance", "at_antiresonance", "digits"),
    [(0.0, 1.476255486117, 2.128060480170, HALF_DIGIT_12), (SILICA_ETA, 1.476273354, 2.129233691, 0.51e-9)],
)
def test_resonance_and_antiresonance_of_silica(eta, at_resonance, at_antiresonance, digits):
    r = sh.ratios(0.17, overlap_ratio=eta)
    assert [sh.resonance(r), sh.antiresonance(r)] == pytest.approx([at_resonance, at_antiresonance], rel=0, abs=digits)


GRID = np.linspace(0.005, np.pi - 0.0049, 1501)  # no member near π/2, the exact resonance of ν=0, Ĩ=1


def sign_changes(values):
    return GRID[:-1][values[1:] * values[:-1] < 0]


@pytest.mark.parametrize("inertia", [0.01, 0.4, 2 / 3, 1.0, 5.0, 100.0])
@pytest.mark.parametrize("nu", [-1.0, -0.541, 0.0, 0.17, 0.5])
@verifies(
    "Resonance of TR with L, any ν and inertia, rad per row",
    reference="other method: change of sign of 2Ω − sin ξ on a grid",
    tolerance=0.0021,
    reason="the spacing of the grid",
    mutant=Mutant(
        "analysis/granular_analysis/second_harmonic.py",
        "b = 2 * mu2 * (2 + C) - ratios.inertia * (1 - C**2) / 4",
        "b = 2 * mu2 * (2 + C) - ratios.inertia * (1 - C**2) / 2",
    ),
)
def test_scanning_finds_one_resonance_where_the_cubic_has_it(nu, inertia, measured):
    r = sh.ratios(nu, inertia)
    found = sign_changes(2 * sh.dispersion(GRID, "TR", r) - np.sin(GRID))
    measured(off(found, [sh.resonance(r)], size=1))


@pytest.mark.parametrize("inertia", [0.01, 0.4, 2 / 3, 1.0, 5.0])
@pytest.mark.parametrize("nu", [-1.0, 0.0, 0.17, 0.5])
def test_scanning_finds_an_antiresonance_only_where_the_formula_has_one(nu, inertia):
    r = sh.ratios(nu, inertia)
    modes = [sh.mode("TR", xi, r) for xi in GRID]
    q, f = np.array([(m.q, m.f) for m in modes]).T
    strength = r.alpha * np.sin(GRID / 2) ** 2 * q - r.beta / np.sqrt(3) * np.sin(GRID) * f
    expected = sh.antiresonance(r)
    assert sign_changes(strength) == pytest.approx([] if expected is None else [expected], abs=GRID[1] - GRID[0])


@pytest.mark.parametrize("nu", np.linspace(-1, 0.5, 13))
def test_solid_spheres_have_both_for_every_poisson_ratio(nu):
    r = sh.ratios(nu)
    assert 1.351 <= sh.resonance(r) <= 1.568
    assert sh.antiresonance(r) is not None


def test_second_harmonic_of_tr_vanishes_at_the_antiresonance():
    mode = sh.mode("TR", sh.antiresonance(SILICA), SILICA)
    assert abs(sh.generated_amplitude(mode, SILICA)) < 1e-14  # rounding of terms of order 0.1


def exact_branch(name, xi, r):
    """Ω, Q, f of TR or RT in 60 digits from the textbook quadratic, κ and Ĩ taken as the doubles they are."""
    with mpmath.workdps(60):
        xi, mu1, mu2, inertia = (mpmath.mpf(float(v)) for v in (xi, r.mu1, r.mu2, r.inertia))
        A, b, c0 = mu1 * (1 - mpmath.cos(xi)) / 2, 2 * mu2 * (2 + mpmath.cos(xi)), mpmath.sqrt(3) * mu2 * mpmath.sin(xi)
        root = mpmath.sqrt((b + inertia * A) ** 2 - 4 * inertia * (A * b - c0**2))
        x = (b + inertia * A + (root if name == "RT" else -root)) / (2 * inertia)
        ratio = c0 / (b - inertia * x)
        q = 1 / mpmath.sqrt(1 + ratio**2)
        return [float(mpmath.sqrt(x)), float(q), float(ratio * q)]


@pytest.mark.parametrize("inertia", [0.4, 5.0])
@pytest.mark.parametrize("name", ["TR", "RT"])
@pytest.mark.parametrize("xi", [1e-12, 1e-8, 1e-4, 0.1, 1.0, 2.0, 3.0, np.pi - 1e-8, np.pi])
@verifies(
    "TR and RT, frequency and shape, ξ from 1e-12 to π, relative",
    reference="other code: the quadratic equation in 60 digits (mpmath)",
    tolerance=1e-13,
    reason="some ten roundings in each component, also where it is as small as 1e-16",
    mutant=Mutant(
        "analysis/granular_analysis/second_harmonic.py", "determinant / (half_trace + r)", "(half_trace - r) / inertia"
    ),
)
def test_modes_are_accurate_from_long_waves_to_the_zone_edge(xi, name, inertia, measured):
    r = sh.ratios(0.17, inertia)
    mode = sh.mode(name, xi, r)
    # 1e-13 relative in each component: also in Q or f where it is as small as 1e-16.
    for found, exact in zip([mode.frequency, mode.q, mode.f], exact_branch(name, xi, r), strict=True):
        measured(found / exact - 1)


def test_modes_at_the_zone_edge_are_pure():
    tr, rt = (sh.mode(name, np.pi, SILICA) for name in ("TR", "RT"))
    assert [tr.q, tr.f, rt.q, rt.f] == pytest.approx([1, 0, 0, -1], abs=1e-15)
    assert rt.q >= 0


@pytest.mark.parametrize("name", EVERY_MODE)
def test_dispersion_is_the_mode_frequency(name):
    xi = np.linspace(0.1, np.pi, 7)
    expected = [sh.mode(name, x, SILICA).frequency for x in xi]
    # A sine of many numbers at once may be rounded otherwise than that of one.
    assert sh.dispersion(xi, name, SILICA) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("name", EVERY_MODE)
@pytest.mark.parametrize("xi", [0.1, 0.802, 2.127, 3.0, np.pi])
def test_three_waves_add_up_to_the_second_harmonic(name, xi):
    mode, tau = sh.mode(name, xi, SILICA), np.linspace(0, 50, 101)
    total = sh.second_harmonic(mode, SILICA, 0.2, tau, row=3, phase=0.4)
    terms = sh.second_harmonic_terms(mode, SILICA, 0.2, tau, row=3, phase=0.4)
    # Rounding only; at ξ=0.1 the L mode's terms are 10³ times their sum.
    assert np.sum(terms, axis=0) == pytest.approx(total, rel=0, abs=1e-13)


def driven(mode, r, amplitude, tau):
    """p_SH at row 0 from eqP1TR itself, by Simpson's rule on Duhamel's integral of the quadratic terms of two bonds."""
    n, grid = np.array([-1, 0, 1])[:, None], np.linspace(0, tau, 4001)
    theta = mode.wavenumber * n - mode.frequency * grid
    p, q, phi = mode.p * np.cos(theta), mode.q * np.cos(theta), -mode.f * np.sin(theta)
    dp, dq, sigma = np.diff(p, axis=0), np.diff(q, axis=0), phi[1:] + phi[:-1]
    bond = r.longitudinal * dp**2 - r.alpha * dq**2 + 2 / np.sqrt(3) * r.beta * sigma * dq
    source = sh.nonlinearity(r, amplitude) / 8 * (bond[1] - bond[0])
    w = np.sin(mode.wavenumber)
    weights = np.tile([2.0, 4.0], 2001)[:4001] * (grid[1] - grid[0]) / 3
    weights[0] = weights[-1] = (grid[1] - grid[0]) / 3
    return np.sum(weights * source * np.sin(w * (tau - grid)) / w)


@pytest.mark.parametrize("name", EVERY_MODE)
@pytest.mark.parametrize("r", [SILICA, sh.ratios(-0.5, 1.0, 0.05)], ids=["paper", "wide"])
@pytest.mark.parametrize("xi", [0.3, 1.475, 2.127])
@verifies(
    "Second harmonic of L, TR and RT in closed form at τ = 40",
    reference="other integrator: Simpson's rule on Duhamel's integral of two bonds, in D0",
    tolerance=3e-08,
    reason="Simpson's error h⁴ω⁴/180 · τ · source with h = 0.01, ω < 4.5, source < 0.03",
    mutant=Mutant(
        "analysis/granular_analysis/second_harmonic.py",
        "ratios.beta / np.sqrt(3) * np.sin(mode.wavenumber) * mode.f",
        "ratios.beta / np.sqrt(3) * np.sin(mode.wavenumber) * mode.q",
    ),
)
def test_second_harmonic_solves_the_equation_of_motion(name, r, xi, measured):
    mode = sh.mode(name, xi, r)
    measured(sh.second_harmonic(mode, r, 0.2, 40.0) - driven(mode, r, 0.2, 40.0))


def test_a_wrong_coefficient_in_the_equation_of_motion_would_be_seen():
    mode = sh.mode("TR", 0.802, SILICA)
    printed = replace(SILICA, alpha=SILICA.alpha * 8 / 6)  # the paper's α/6
    assert abs(sh.second_harmonic(mode, printed, 0.2, 40.0) - driven(mode, SILICA, 0.2, 40.0)) > 1e-4


def test_second_harmonic_is_regular_across_the_resonance():
    at, tau = sh.resonance(SILICA), np.linspace(0, 200, 401)
    p = [sh.second_harmonic(sh.mode("TR", xi, SILICA), SILICA, 0.2, tau) for xi in (at - 1e-7, at, at + 1e-7)]
    # A curvature of order τ² times the square of the offset, 1e-14·4e4.
    assert p[1] == pytest.approx((p[0] + p[2]) / 2, rel=0, abs=1e-9)


def test_second_harmonic_grows_linearly_on_resonance():
    mode = sh.mode("TR", sh.resonance(SILICA), SILICA)
    w, tau = np.sin(mode.wavenumber), np.linspace(0, 200, 401)
    shape = tau * np.cos(w * tau) - np.sin(w * tau) / w
    p = sh.second_harmonic(mode, SILICA, 0.2, tau)
    scale = p @ shape / (shape @ shape)
    # Duhamel's integral at 2Ω = w̃; the root is good to 1e-15, which τ² = 4e4 enlarges.
    assert p == pytest.approx(scale * shape, rel=0, abs=1e-10)


def test_generated_amplitude_at_an_exact_resonance_is_infinite():
    mode = sh.mode("TR", np.pi / 2, sh.ratios(0.0, 1.0))  # Ω = ½ here but for rounding
    exact = replace(mode, frequency=0.5)
    assert sh.resonance(sh.ratios(0.0, 1.0)) == pytest.approx(np.pi / 2, abs=1e-14)
    assert np.isinf(sh.generated_amplitude(exact, SILICA))


@pytest.mark.parametrize("name", EVERY_MODE)
def test_initial_condition_is_the_mode_alone(name):
    mode = sh.mode(name, 0.9, SILICA)
    p, q, phi = sh.second_order(mode, SILICA, 0.2, 0.0, row=2, phase=0.3)
    theta = 0.9 * 2 + 0.3
    assert [p, q, phi] == [mode.p * np.cos(theta), mode.q * np.cos(theta), -mode.f * np.sin(theta)]


@pytest.mark.parametrize("name", EVERY_MODE)
def test_a_row_is_a_phase(name):
    mode, tau = sh.mode(name, 0.9, SILICA), np.linspace(0, 30, 31)
    by_row = sh.second_order(mode, SILICA, 0.2, tau, row=7)
    by_phase = sh.second_order(mode, SILICA, 0.2, tau, phase=7 * 0.9)
    assert np.allclose(by_row, by_phase, rtol=0, atol=1e-13)
