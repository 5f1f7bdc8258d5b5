"""Power series in the amplitude against the lattice at a finite amplitude and the closed form."""

from functools import cache

import numpy as np
import pytest

from granular_analysis import second_harmonic as sh
from granular_analysis.measure.norms import relative_error, slope
from granular_analysis.theory import hierarchy, lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from tests.manual import Mutant, off, verifies

NU = 0.17
SILICA = sh.ratios(NU)
ETA = 2.498514361612e-10 / 1e-6  # Δ0/2R of the paper's spheres
TAU = np.linspace(0, 60, 61)
LONG = np.linspace(0, 120, 241)
SHORT = np.linspace(0, 20, 21)
AMPLITUDES = (0.2, 0.14, 0.1)


@cache
def orders_and_exact(name, xi):
    """Orders 1 to 6 of a wave at row 0, (6, T, 3), and the exact lattice at each of AMPLITUDES, (T, 3) each."""
    mode = sh.mode(name, xi, SILICA)
    weights = lattice.periodic_kernel(-lattice.torus_phases(13), 13)
    # Order 6 leaves 9e-9 of p at a = 0.1: with an rtol of 1e-11 the integrations leave as much, and the slope is chance
    orders = hierarchy.hierarchy_orders(mode, Contact(NU), TAU, rtol=1e-13) @ weights
    states = lattice.torus_trajectories(mode, AMPLITUDES, Contact(NU), TAU, points=21, rtol=1e-12)
    at_row = states @ lattice.periodic_kernel(-lattice.torus_phases(21), 21)
    return orders, [each / a for each, a in zip(at_row, AMPLITUDES, strict=True)]


def error_slope(name, xi, order, component):
    """Exponent of a in the relative error of one displacement (0 p, 1 q, 2 φ) to the given order."""
    orders, exact = orders_and_exact(name, xi)
    sums = [np.tensordot(a ** np.arange(order), orders[:order], axes=1) for a in AMPLITUDES]
    errors = [relative_error(s[:, component], e[:, component]) for s, e in zip(sums, exact, strict=True)]
    return slope(AMPLITUDES, errors)


@pytest.mark.parametrize(
    ("name", "xi", "orders"), [("TR", 1.475, (2, 4, 6)), ("RT", 0.802, (2, 4, 6)), ("L", 0.802, (2, 3, 4, 5, 6))]
)
def test_relative_error_of_p_falls_with_the_order(name, xi, orders):
    # 0.1: the orders above bend the slopes by up to 0.05 (order 6 of TR).
    assert [error_slope(name, xi, n, 0) for n in orders] == pytest.approx(orders, abs=0.1)


@pytest.mark.parametrize("component", [1, 2])
def test_relative_error_of_q_and_phi_falls_with_one_order_more(component):
    assert [error_slope("TR", 1.475, n, component) for n in (3, 5)] == pytest.approx([4, 6], abs=0.1)  # as for p


def test_a_fourth_order_wrong_by_a_tenth_would_be_seen():
    orders, exact = orders_and_exact("L", 0.802)
    wrong = orders[:4, :, 0] * np.array([1.0, 1.0, 1.0, 1.1])[:, None]
    errors = [relative_error(a ** np.arange(4) @ wrong, e[:, 0]) for a, e in zip(AMPLITUDES, exact, strict=True)]
    assert slope(AMPLITUDES, errors) < 3.9  # outside what the tests above allow


@cache
def resonant_terms():
    """Terms aⁿ of orders 1 to 6 of TR next to its resonance at a = 0.2, (6, T, 3, K)."""
    orders = hierarchy.hierarchy_orders(sh.mode("TR", 1.475, SILICA), Contact(NU), TAU, rtol=1e-12)
    return 0.2 ** np.arange(6)[:, None, None, None] * orders


@pytest.mark.parametrize("change", [{"RADIUS": 0.05}, {"RADIUS": 0.2, "FEWEST": 17}, {"FEWEST": 16}], ids=str)
def test_the_orders_do_not_depend_on_the_circle(change, monkeypatch):
    usual = resonant_terms()
    for name, value in change.items():
        monkeypatch.setattr(hierarchy, name, value)
    other = resonant_terms.__wrapped__()
    # Aliasing is RADIUS¹¹ = 1e-11 of orders that grow up to twofold each, 2¹¹; the integration is good to 160 rtol/a.
    assert np.allclose(usual, other, rtol=0, atol=2e-8)
    assert np.all(np.max(np.abs(usual), axis=(1, 2, 3)) > 1e-6)  # every order is seen


def test_too_few_points_on_too_large_a_circle_are_seen(monkeypatch):
    mode, terms = sh.mode("TR", 1.475, SILICA), 0.2 ** np.arange(6)[:, None, None, None]
    usual = terms * hierarchy.hierarchy_orders(mode, Contact(NU), TAU)
    monkeypatch.setattr(hierarchy, "RADIUS", 0.4)
    monkeypatch.setattr(hierarchy, "FEWEST", 7)
    assert (
        np.max(np.abs(terms * hierarchy.hierarchy_orders(mode, Contact(NU), TAU) - usual)) > 4e-7
    )  # twenty times that


@cache
def antiresonant(eta):
    mode = sh.mode("TR", 2.127, sh.ratios(NU, overlap_ratio=eta))
    exact = lattice.torus(Wave(mode, 0.2, Contact(NU, overlap_ratio=eta)), LONG, points=21)[0]
    weights = lattice.periodic_kernel(-lattice.torus_phases(13), 13)
    return hierarchy.hierarchy_orders(mode, Contact(NU, overlap_ratio=eta), LONG, rtol=1e-9)[:, :, 0] @ weights, exact


def antiresonant_error(order, eta, eta_of_exact):
    """Relative error of p at ξ=2.127, a=0.2."""
    return relative_error(0.2 ** np.arange(order) @ antiresonant(eta)[0][:order], antiresonant(eta_of_exact)[1])


@pytest.mark.parametrize("eta", [0.0, ETA])
def test_antiresonant_p_is_reached_at_order_four(eta):
    # Measured at η=0: 1.13, 4.2e-2, 1.6e-3; with the geometry of LAMMPS 1.27, 4.7e-2, 1.8e-3.
    errors = [antiresonant_error(order, eta, eta) for order in (2, 4, 6)]
    assert errors[0] > 1
    assert errors[1] < 0.05
    assert errors[2] < 0.003


def test_leaving_out_the_geometry_is_seen_at_the_antiresonance():
    assert antiresonant_error(6, 0.0, ETA) == pytest.approx(0.26, abs=0.01)  # in the maximum it is 0.21


@pytest.mark.parametrize(("name", "xi"), [("TR", 0.802), ("TR", 1.475), ("RT", 0.802), ("L", 2.0)])
@verifies(
    "Hierarchy of orders from a circle of complex amplitudes, order 2",
    reference="analytic: second order in closed form, a = 1",
    tolerance=5e-09,
    reason="the integration leaves 160 rtol, the circle 1e-11 of order 13, a few 100 of L at ξ = 2",
    mutant=Mutant(
        "analysis/granular_analysis/theory/hierarchy.py",
        "np.fft.irfft(waves.conj(), circle, axis=0)",
        "np.fft.irfft(waves, circle, axis=0)",
    ),
)
def test_second_order_is_the_closed_form(name, xi, measured):
    mode = sh.mode(name, xi, SILICA)
    # In units of D0 with a=1: the second order is not hidden behind the first.
    numerical = hierarchy.hierarchy(Wave(mode, 1.0, Contact(NU), 0.4), TAU, order=2, row=7, rtol=1e-11)
    closed = sh.second_order(mode, SILICA, 1.0, TAU, row=7, phase=0.4)
    measured(off(numerical, closed, size=1))


@pytest.mark.parametrize("name", ["TR", "L"])
def test_geometry_is_right_at_any_row_and_phase(name):
    wave = Wave.of_mode(name, 0.802, 0.02, Contact(NU, overlap_ratio=0.01), phase=0.4)
    estimate, exact = (f(wave, SHORT, row=7)[0] for f in (hierarchy.hierarchy, lattice.torus))
    # a⁶ = 6e-11: nothing is left but the integration, 50 rtol.
    assert np.allclose(estimate, exact, rtol=0, atol=5e-9)


def test_an_order_knows_nothing_of_those_above():
    mode, phases = sh.mode("TR", 0.9, SILICA), np.array([0.0, 0.3, 2.0])
    low, high = (
        hierarchy.hierarchy_orders(mode, Contact(NU), SHORT, order=n)[:3]
        @ lattice.periodic_kernel(phases - lattice.torus_phases(2 * n + 1)[:, None], 2 * n + 1)
        for n in (3, 5)
    )
    # 50 rtol, as above. 7 points of phase give the same as 11: order 3 has no harmonic above the third.
    assert np.allclose(low, high, rtol=0, atol=5e-9)


def test_p_of_a_transverse_wave_is_even_in_the_amplitude_and_q_and_phi_odd():
    orders = hierarchy.hierarchy_orders(sh.mode("TR", 0.9, SILICA), Contact(NU), SHORT, order=4)
    # Rounding: 1e-16 of the waves of the circle, a few hundred steps that add up, and RADIUS^(1−k) of it in order k.
    none = 1e-13 * hierarchy.RADIUS ** -np.arange(4.0)
    assert np.all(np.max(np.abs(orders[:, :, 0]), axis=(1, 2))[::2] < none[::2])
    assert np.all(np.max(np.abs(orders[:, :, 1:]), axis=(1, 2, 3))[1::2] < none[1::2])
    assert np.all(np.max(np.abs(orders[1::2, :, 0]), axis=(1, 2)) > 1e-3)


def test_the_mode_is_all_there_is_at_the_start():
    mode = sh.mode("RT", 0.9, SILICA)
    orders = hierarchy.hierarchy_orders(mode, Contact(NU), [0.0, 1.0], order=3)
    phases = lattice.torus_phases(7)
    start = [0 * phases, mode.q * np.cos(phases), -mode.f * np.sin(phases)]
    # Rounding of a transform of 11 numbers, and RADIUS^(1−k) of it in order k.
    assert np.allclose(orders[0, 0], start, rtol=0, atol=1e-14)
    assert np.max(np.abs(orders[1:, 0])) < 1e-14 * hierarchy.RADIUS**-2
