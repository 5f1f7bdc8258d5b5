"""The three resonant waves against the exact lattice, against second order, and their own limits."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from granular_analysis import second_harmonic as sh
from granular_analysis.theory import lattice, resonance
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from tests.conftest import latin, members

NU = 0.17
SILICA = sh.ratios(NU)
LONG = np.arange(0, 701.0)


def wave(mode, amplitude=0.2, contact=Contact(NU)):  # noqa: B008 (frozen)
    return Wave(mode, amplitude, contact)


def errors(theory, exact):
    """Relative L2 error over τ of p, q, φ."""
    return [float(np.linalg.norm(y - z) / np.linalg.norm(z)) for y, z in zip(theory, exact, strict=True)]


@cache
def everywhere(nu, xi, until):
    """Return the exact lattice (T, 3, K) of TR at a = 0.2, τ = 0, 1, …, until."""
    # Off by 1e-5 at τ = 700 and 1e-4 at 1800, a fiftieth of any bound
    wave = Wave(sh.mode("TR", xi, sh.ratios(nu)), 0.2, Contact(nu))
    return lattice.torus_trajectory(wave, np.arange(0, until + 1.0), rtol=1e-8)


def resonant(tau, xi=1.475, *, nu=NU, row=0, phase=0.0):
    """p, q, φ (3, T) of one sphere of it at τ = 0, 1, …"""
    states = everywhere(nu, xi, 1800 if (nu, xi) == (NU, 1.475) else 700)[: len(tau)]
    return (states @ lattice.periodic_kernel(xi * row + phase - lattice.torus_phases(31), 31)).T


def compared(xi, tau, *, nu=NU, name="TR", amplitude=0.2, row=0, phase=0.0, exact=None):
    """Errors of three_mode and of second_order against the exact lattice, or what is given for it."""
    ratios = sh.ratios(nu)
    one = Wave(sh.mode(name, xi, ratios), amplitude, Contact(nu), phase)
    if exact is None:
        exact = lattice.torus(one, tau, row=row, rtol=1e-9)
    second = sh.second_order(one.mode, ratios, amplitude, tau, row, phase)
    return errors(resonance.three_mode(one, tau, row), exact), errors(second, exact)


@pytest.mark.parametrize(("xi", "row", "phase"), [(1.475, 0, 0.0), (1.4763, 0, 0.0), (1.475, 3, 0.4)])
def test_p_q_and_phi_hold_within_one_percent_where_second_order_has_failed(xi, row, phase):
    three, second = compared(xi, LONG, row=row, phase=phase, exact=resonant(LONG, xi, row=row, phase=phase))
    # Measured: p 1.3e-3, q 1.3e-3, φ 2.6e-3 at most; second order is off by 0.08–0.10, 0.68–0.69, 0.75–0.76.
    assert max(three) < 3e-3
    assert second[0] > 0.07
    assert min(second[1:]) > 0.6


def test_an_error_of_one_percent_would_be_seen():
    mode = sh.mode("TR", 1.475, SILICA)
    p, q, phi = resonance.three_mode(wave(mode), LONG)
    assert errors((p, 1.01 * q, phi), (p, q, phi)) == pytest.approx([0, 0.01, 0], rel=0, abs=1e-12)


@pytest.mark.parametrize("nu", members([0.0, 0.3, 0.5], 0.3))
def test_exactly_on_the_resonance_of_other_spheres(nu):
    xi = sh.resonance(sh.ratios(nu))
    three, second = compared(xi, LONG, nu=nu, exact=resonant(LONG, xi, nu=nu))
    assert max(three) < 6e-3  # measured 5.8e-3 (p, ν=0), where second order is off by 0.3
    assert min(second) > 0.29


def test_first_harmonics_hold_to_half_a_percent_in_the_long_run():
    mode, tau = sh.mode("TR", 1.475, SILICA), np.arange(0, 1801.0)
    trajectory = everywhere(NU, 1.475, 1800)
    waves = resonance.amplitudes(resonance.normal_form(wave(mode)), 0.2, tau) / 0.2
    for harmonic, field, size in ((1, 1, mode.q), (2, 0, 1.0)):
        projected = 2 / (31 * size) * trajectory[:, field] @ np.exp(-1j * harmonic * lattice.torus_phases(31))
        predicted = waves[harmonic - 1] * np.exp(-1j * harmonic * mode.frequency * tau)
        # Measured 4.2e-3 (A) and 4.6e-3 (B), phase included.
        assert np.linalg.norm(predicted - projected) < 5e-3 * np.linalg.norm(projected)


@pytest.mark.parametrize(
    ("xi", "name"),
    members(
        [(0.3, "TR"), (0.802, "TR"), (1.2, "TR"), (1.9, "TR"), (2.5, "TR"), (0.802, "RT"), (2.0, "RT")],
        (0.3, "TR"),
        (1.2, "TR"),
        (1.9, "TR"),
        (2.0, "RT"),
    ),
)
def test_off_resonance_it_is_second_order_with_less_error(xi, name):
    three, second = compared(xi, np.linspace(0, 120, 241), name=name)
    assert all(new < old for new, old in zip(three, second, strict=True))


@pytest.mark.parametrize(
    ("name", "xi", "factor"),
    members([("TR", 0.1, 4), ("RT", 0.1, 2), ("RT", 1.5, 1), ("RT", 3.0, 25)], ("RT", 0.1, 2), ("RT", 1.5, 1)),
)
def test_near_the_ends_of_the_zone_three_waves_are_worse_in_p_than_second_order(name, xi, factor):
    # Measured: 3.3, 1.7, 0.86 and 19 times the error of second order; that it falls as a² is the integrator's test
    mode, tau = sh.mode(name, xi, SILICA), np.arange(0, 120.0, 0.5)
    found = []
    for a in (0.2, 0.05):
        exact = lattice.torus(Wave(mode, a, Contact(NU)), tau, points=17, rtol=1e-11)[:1]  # 1e-3 of the smallest error
        three = errors(resonance.three_mode(wave(mode, a), tau)[:1], exact)[0]
        assert three < factor * errors(sh.second_order(mode, SILICA, a, tau)[:1], exact)[0]
        found.append(three)
    assert found[0] / found[1] == pytest.approx(16, rel=0.25)


@pytest.mark.parametrize("xi", members([0.4, 0.802, 2.0], 2.0))
def test_longitudinal_waves_lose_most_of_their_error(xi):
    mode, tau = sh.mode("L", xi, SILICA), np.linspace(0, 120, 241)
    exact = lattice.torus(Wave(mode, 0.2, Contact(NU)), tau, points=61, rtol=1e-9)[:1]
    (three,), (second,) = (
        errors(theory[:1], exact)
        for theory in (resonance.three_mode(wave(mode), tau), sh.second_order(mode, SILICA, 0.2, tau))
    )
    assert three < second / 7  # measured 23, 79 and 7.9 times less


@pytest.mark.parametrize(("xi", "until"), [(1.475, (200, 400)), (0.802, (120, 120))])
def test_error_falls_as_the_square_of_the_amplitude(xi, until):
    """On resonance at fixed aτ, a fixed part of the exchange; off resonance at fixed τ."""
    coarse, fine = (
        compared(xi, np.linspace(0, end, 400), amplitude=a)[0] for a, end in zip((0.1, 0.05), until, strict=True)
    )
    assert np.log2(np.divide(coarse, fine)) == pytest.approx([2, 2, 2], abs=0.05)  # measured 1.99 to 2.02


def test_couplings_have_the_tabulated_numbers():
    """c_A, c_B, c_C of TR(ξ) + L(2ξ) ↔ RT(3ξ) at ξ=1.475, derived by projecting the equations of motion."""
    form = resonance.normal_form(wave(sh.mode("TR", 1.475, SILICA)))
    found = [2 * form.quadratic[0, 4, 2], 2 * form.quadratic[1, 3, 2], 2 * form.quadratic[2, 0, 1]]
    assert found == pytest.approx([0.0826617, -0.0224653, -0.0200917], rel=0, abs=0.51e-7)


@pytest.mark.parametrize(("xi", "name"), [(0.802, "TR"), (1.475, "TR"), (2.5, "TR"), (0.802, "RT"), (0.802, "L")])
def test_coupling_to_the_second_harmonic_is_the_drive_of_the_closed_form(xi, name):
    """g = −N = P̃1/i·(w̃² − 4Ω²) ε̂/(4w̃)."""
    mode = sh.mode(name, xi, SILICA)
    form = resonance.normal_form(wave(mode))
    w = np.sin(xi)
    drive = sh.generated_amplitude(mode, SILICA) * (w**2 - 4 * mode.frequency**2)
    expected = sh.nonlinearity(SILICA, 1.0) * drive / (4 * w)
    assert -form.quadratic[1, 0, 0] == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("name", ["L", "TR", "RT"])
def test_contacts_give_every_wave_its_frequency(name):
    """ω²|v|² = C Σ_c(|x|² + κ|t|²): what N and S of the three contacts of a sphere do to first order."""
    waves = resonance.waves(wave(sh.mode(name, 1.1, SILICA)))
    inertia = np.abs(waves.shape) ** 2 @ [1, 1, SILICA.inertia]
    strain = waves.strain(np.arange(len(waves.harmonic)), 0, 1)
    slip = np.sum(np.abs(strain.slip) ** 2, axis=-1)
    work = np.sum(np.abs(strain.stretch) ** 2 + SILICA.kappa * slip, axis=-1)
    assert waves.frequency**2 * inertia == pytest.approx(work / (2 * (SILICA.kappa + 3)), rel=1e-12)


@pytest.mark.parametrize(
    ("amplitude", "xi"),
    latin([0.2, -0.2], [sh.resonance(SILICA), 1.475, 1.5, 1.44, 0.802]),
)
def test_elliptic_functions_solve_the_two_amplitude_equations(xi, amplitude):
    mode = sh.mode("TR", xi, SILICA)
    g, h = resonance.exchange(resonance.normal_form(wave(mode)))
    detuning = 2 * mode.frequency - np.sin(xi)

    def rate(tau, y):
        turn = np.exp(1j * detuning * tau)
        return [-amplitude * h * np.conj(y[0]) * y[1] * turn, -amplitude * g * y[0] ** 2 / turn]

    start = np.array([1, 0], dtype=complex)
    solved = solve_ivp(rate, (0, LONG[-1]), start, method="DOP853", t_eval=LONG, rtol=1e-11, atol=1e-13).y
    found = resonance.two_mode_amplitudes(wave(mode, amplitude), LONG)
    assert np.abs(np.array(found) - solved).max() < 1e-10  # the integrator's error is 2e-11


def test_two_waves_alone_are_right_only_until_the_third_has_grown():
    mode = sh.mode("TR", 1.475, SILICA)
    early, late = (
        errors(resonance.two_mode(wave(mode), tau)[1:2], resonant(tau)[1:2])[0] for tau in (np.arange(0, 285.0), LONG)
    )
    assert early < 0.03  # measured 0.028
    assert late > 0.2


def test_where_the_exchange_is_explosive_the_two_waves_are_refused_and_the_three_are_not():
    ratios = sh.ratios(-0.7)
    xi = sh.resonance(ratios)
    with pytest.raises(ValueError, match="explosive"):
        resonance.two_mode(wave(sh.mode("TR", xi, ratios), contact=Contact(-0.7)), LONG)
    three, _ = compared(xi, np.linspace(0, 200, 401), nu=-0.7)
    assert max(three[1:]) < 1e-3


def test_the_geometry_of_silica_spheres_changes_nothing_visible_but_the_frequencies():
    eta = 2.498514361612e-10 / 1e-6  # Δ0/2R of the paper's spheres
    one = Wave.of_mode("TR", 1.475, 0.2, Contact(NU, overlap_ratio=eta))
    exact = lattice.torus(one, LONG, rtol=1e-8)
    # Measured 1.2e-3, 1.5e-3, 2.7e-3: η of the coefficients costs 3e-4 in q.
    assert max(errors(resonance.three_mode(one, LONG), exact)) < 3e-3


def test_wavenumbers_whose_harmonics_are_translations_are_no_exception():
    three, second = compared(2 * np.pi / 3, np.linspace(0, 120, 241))
    assert max(three[1:]) < 3e-3 < 1e-2 < min(second[1:])


def test_times_keep_their_shape_and_must_not_be_negative():
    mode = sh.mode("TR", 1.475, SILICA)
    square = np.array([[3.0, 1.0], [0.0, 3.0]])
    for grid, flat in zip(
        resonance.three_mode(wave(mode), square), resonance.three_mode(wave(mode), [0, 1, 3]), strict=True
    ):
        assert grid == pytest.approx(flat[[[2, 1], [0, 2]]], rel=0, abs=1e-9)  # error of the integration
    with pytest.raises(ValueError, match="negative"):
        resonance.three_mode(wave(mode), [-1.0])
