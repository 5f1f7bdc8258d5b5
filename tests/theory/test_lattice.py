"""The integrated lattice against the paper's appendix, against finite lattices, and against the closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import DOP853

from benchmarks import paper_rows
from granular_analysis import second_harmonic as sh
from granular_analysis.theory import bloch, lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from tests.conftest import members
from tests.manual import Mutant, off, verifies

NU = 0.17
SILICA = sh.ratios(NU)
ETA = 2.498514361612e-10 / 1e-6  # Δ0/2R of the paper's spheres
WAVES = [("TR", 0.802), ("TR", 1.475), ("TR", 2.127), ("RT", 0.802), ("RT", 2.0), ("L", 0.802), ("L", 2.0)]
TAU = np.linspace(0, 120, 241)
SMALL, SHORT = 2e-3, np.linspace(0, 30, 31)


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def six_contacts(u, v, theta, kappa, eta):
    """Force (k1Δ0) and torque (k1Δ0R) on the middle of three rows from its six neighbours, as in the appendix."""
    total = np.zeros(3)
    # row of the neighbour, and its direction, counter-clockwise numbering 1..6 of the paper: 1 up right, 2 right, …
    angles = {1: 60, 2: 0, 3: -60, 4: 240, 5: 180, 6: 120}
    row_of = {1: 2, 2: 1, 3: 0, 4: 0, 5: 1, 6: 2}
    for label, degrees in angles.items():
        row, n0 = row_of[label], np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        d = np.array([u[row] - u[1], v[row] - v[1]])
        if eta:
            r = (1 / eta - 1) * n0 + d
            n, x = r / np.linalg.norm(r), np.linalg.norm(r) - (1 / eta - 1)
        else:
            n, x = n0, n0 @ d
        t = np.array([-n[1], n[0]])
        slip = t @ d - theta[row] - theta[1]
        overlap = 1 - x
        shear = kappa * slip * np.sqrt(overlap)
        total[:2] += (2 / 3) * (1 - overlap**1.5) * n + shear * t
        total[2] += shear * (1 - eta * overlap)
    return total


@pytest.mark.parametrize("eta", [0.0, 0.01])
def test_equations_of_motion_are_the_sum_over_six_contacts(eta):
    p, q, phi = np.random.default_rng(1).uniform(-0.1, 0.1, (3, 3))
    contact = Contact(NU, overlap_ratio=eta)
    neighbours = paper_rows.ring_neighbours()
    moving = np.zeros((6, 3))
    moving[:3] = p, q, phi
    rate = lattice.rhs(lattice.with_shear(moving, contact, neighbours), contact, neighbours)[3:6, 1]
    force = six_contacts(-q, p, phi, contact.kappa, eta) / (2 * (contact.kappa + 3))
    # Rounding of |r| − ℓ in the plain form here, 1e-16/η.
    assert rate == pytest.approx([force[1], -force[0], force[2] / 0.4], rel=0, abs=1e-13)


def test_a_pair_turned_rigidly_slips_by_its_overlap():
    # Centres 2R − Δ0 apart orbit at rate `spin`, spheres turn along: with lever arm R the slip rate is −spin·Δ0.
    contact = Contact(NU, overlap_ratio=0.01)
    length, angle, spin = 1 / 0.01 - 1, 0.3, 0.7
    turned = length * np.array([np.cos(angle), np.sin(angle)])  # along and across the contact at rest
    turning = spin * (length + 1)  # Rθ' of both together
    apart = np.array([turned - [length, 0.0], [-spin * turned[1], spin * turned[0]]])
    apart = np.concatenate([apart, [[0.0], [turning]]], axis=1)[..., None, None]  # one contact, one sphere
    pair = lattice.Neighbours(lambda _: apart, lambda forces: forces[..., 0, :])
    state = np.zeros((7, 1))  # with the slip of its one contact
    assert lattice.touching(state, contact, pair).stretch[0, 0] == pytest.approx(0, abs=1e-12)
    rate = lattice.rhs(state, contact, pair)[6]
    assert rate[0] == pytest.approx(-spin, abs=1e-11)  # rounding of numbers of order 70


@pytest.mark.parametrize(
    ("name", "xi"),
    members(
        [("TR", 0.802), ("TR", 1.475), ("TR", 2.127), ("RT", 0.802), ("L", 0.802)],
        ("TR", 1.475),
        ("TR", 2.127),
        ("RT", 0.802),
        ("L", 0.802),
    ),
)
@verifies(
    "Exact lattice as one period of the phase, TR, RT and L to τ = 120, in D0",
    reference="other code: the centre of 201 rows, the paper's set-up",
    tolerance=1e-10,
    reason="fifty times rtol = 1e-12, the error of either integration",
    mutant=Mutant(
        "analysis/granular_analysis/theory/lattice.py", "row + wave.phase - torus_phases", "row - torus_phases"
    ),
)
def test_torus_is_the_centre_of_201_rows_before_the_walls_are_heard(name, xi, measured):
    mode = sh.mode(name, xi, SILICA)
    wave, tau = Wave(mode, 0.2, Contact(NU), 0.3), np.linspace(0, 120, 25)
    infinite, finite = lattice.torus(wave, tau, rtol=1e-12), paper_rows.rows(wave, tau, rtol=1e-12)
    measured(off(infinite, finite, size=1))


def test_walls_are_heard_in_the_end():
    mode, tau = sh.mode("L", 0.802, SILICA), np.linspace(0, 80, 81)
    infinite, finite = (
        lattice.torus(Wave(mode, 0.2, Contact(NU)), tau, rtol=1e-10)[0],
        paper_rows.rows(Wave(mode, 0.2, Contact(NU)), tau, rows=51, rtol=1e-10)[0],
    )
    difference = np.abs(infinite - finite)
    assert np.max(difference[tau <= 20]) < 1e-8
    # Group velocity cos(ξ/2)/2 = 0.46 rows per τ: the walls, 25 rows off, silence the wave from τ = 54.
    assert np.max(difference[tau >= 60]) > 0.1


def test_both_end_rows_are_held_at_zero():
    # Seven rows written out: the two ends are rows of their own, the contact between them carries nothing.
    mode, tau, ends = sh.mode("TR", 0.802, SILICA), np.linspace(0, 20, 21), [0, 6]
    contact, neighbours = Contact(NU), paper_rows.ring_neighbours()
    start = lattice.initial_state(mode, 0.2, mode.wavenumber * np.arange(-3.0, 4.0), contact, neighbours)
    start[:, ends] = 0

    def held(state):
        rate = lattice.rhs(state, contact, neighbours)
        rate[:, ends] = 0
        return rate

    expected = lattice.integrate(held, start, tau, 1e-11, 0.2, lattice.longest_step(contact))[:, :3, 3].T / 0.2
    assert np.allclose(paper_rows.rows(Wave(mode, 0.2, Contact(NU)), tau, rows=7), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("k", "n"), members([(5, 40), (5, 16)], (5, 16)))
def test_torus_is_the_periodic_lattice_for_a_long_time(k, n):
    mode, tau, amplitude = sh.mode("TR", 2 * np.pi * k / n, SILICA), np.linspace(0, 500, 26), 0.1
    contact, neighbours = Contact(NU), paper_rows.ring_neighbours()
    start = lattice.initial_state(mode, amplitude, mode.wavenumber * np.arange(n), contact, neighbours)
    states = lattice.motion(start, contact, neighbours, tau, 1e-8, amplitude)
    infinite = lattice.torus(Wave(mode, amplitude, Contact(NU)), tau, row=3, rtol=1e-8)
    assert np.allclose(states[:, :3, 3].T / amplitude, infinite, rtol=0, atol=1e-6)  # a hundred times rtol


@pytest.mark.parametrize("points", [21, 31])
def test_harmonics_are_resolved(points):
    mode, tau = sh.mode("L", 0.802, SILICA), np.linspace(0, 60, 61)
    coarse, fine = (lattice.torus(Wave(mode, 0.2, Contact(NU)), tau, points=k, rtol=1e-12)[0] for k in (points, 61))
    # Harmonics fall off by an order each: 21 points keep 10 of them, 31 keep 15.
    assert coarse == pytest.approx(fine, rel=0, abs=1e-9)


def test_a_row_is_a_phase_of_the_torus():
    mode, tau = sh.mode("TR", 0.9, SILICA), np.linspace(0, 30, 31)
    by_row = lattice.torus(Wave(mode, 0.2, Contact(NU)), tau, row=7)
    by_phase = lattice.torus(Wave(mode, 0.2, Contact(NU), 7 * 0.9), tau)
    assert np.allclose(by_row, by_phase, rtol=0, atol=1e-13)


def relative_errors(mode, ratios, amplitude, exact):
    """Rms error of second_order over all rows of the torus relative to its own size, for p, q, φ at τ = 0, 1, …, 30."""
    phases = lattice.torus_phases(21)
    theory = np.stack([sh.second_order(mode, ratios, amplitude, SHORT, phase=phase) for phase in phases], axis=-1)
    moves = [0] if mode.name == "L" else [0, 1, 2]
    return np.array([rms(exact[:, i] - theory[i]) / rms(theory[i]) for i in moves])


def slopes(mode, ratios):
    amplitudes = (0.1, 0.05, 0.025)
    exact = lattice.torus_trajectories(mode, amplitudes, Contact(NU), SHORT, points=21, rtol=1e-12)
    errors = [relative_errors(mode, ratios, a, states / a) for a, states in zip(amplitudes, exact, strict=True)]
    return np.log2([errors[0] / errors[1], errors[1] / errors[2]])


@pytest.mark.parametrize(("name", "xi"), WAVES)
@verifies(
    "Second order in closed form: the power of a in what it leaves, less 2",
    reference="other integrator: the exact lattice, DOP853",
    tolerance=0.02,
    reason="the fourth order still left at a = 0.1 bends the slope by up to 0.01",
    mutant=Mutant(
        "analysis/granular_analysis/second_harmonic.py",
        "alpha=(2 * kappa - 1 + 2 * h",
        "alpha=(2 * kappa - 0.99 + 2 * h",
    ),
)
def test_relative_error_of_second_order_falls_as_amplitude_squared(name, xi, measured):
    # 0.02: the fourth order still left at a=0.1 bends the slope by up to 0.01 (L at ξ=2).
    measured(np.abs(slopes(sh.mode(name, xi, SILICA), SILICA) - 2).max())


def test_a_slope_sees_a_coefficient_wrong_by_a_percent():
    mode = sh.mode("TR", 0.802, SILICA)
    assert np.all(slopes(mode, replace(SILICA, alpha=1.01 * SILICA.alpha))[:, 0] < 1)


def test_at_the_zone_edge_a_transverse_wave_makes_no_second_harmonic():
    p, q, phi = lattice.torus(Wave(sh.mode("TR", np.pi, SILICA), 0.1, Contact(NU)), np.linspace(0, 30, 31))
    # Forces of order 1 rounded by 1e-16 a few times over, all one way for τ²/2 = 450 and per a = 0.1, would make 5e-12.
    assert np.max(np.abs([p, phi])) < 1e-11
    assert np.max(np.abs(q)) > 0.9


@pytest.mark.parametrize("law", ["secant", "incremental"])
def test_geometry_fades_with_the_overlap_ratio(law):
    # With η → 0 the integrated slip must become the paper's function of the configuration.
    mode, tau = sh.mode("TR", 1.475, SILICA), np.linspace(0, 60, 61)
    plain, nearly = (
        lattice.torus(Wave(mode, 0.2, Contact(NU, law=law, overlap_ratio=eta)), tau) for eta in (0.0, 1e-8)
    )
    # The geometry changes p by 1e-3 at η = 2.5e-4, so by 1e-7 of it here at most.
    assert np.allclose(plain, nearly, rtol=0, atol=1e-7)


def test_geometry_changes_p_by_a_fifth_at_the_antiresonance():
    mode = sh.mode("TR", 2.127, sh.ratios(NU, overlap_ratio=ETA))
    # An error of 5e-8 beside 3e-5
    with_geometry = lattice.torus(Wave(mode, 0.2, Contact(NU, overlap_ratio=ETA)), TAU, rtol=1e-9)[0]
    without = lattice.torus(Wave(sh.mode("TR", 2.127, SILICA), 0.2, Contact(NU)), TAU, rtol=1e-9)[0]
    error = np.max(np.abs(without - with_geometry)) / np.max(np.abs(with_geometry))
    assert error == pytest.approx(0.20, abs=0.02)  # "20 %": two digits


# --- any direction ---


def test_contacts_within_the_row_stretch_where_the_wave_runs_along_it():
    # L along x: for k·d = ξ·2/√3 and its half, the frequency of central and shear springs written out.
    mode, kappa = bloch.mode("L", 0.9, 0.0, Contact(NU)), Contact(NU).kappa
    whole, half = (4 * np.sin(c * 0.9 / np.sqrt(3)) ** 2 for c in (1, 0.5))
    expected = (whole + 2 * half * (1 / 4 + 3 / 4 * kappa)) / (2 * (kappa + 3))
    assert mode.frequency**2 == pytest.approx(expected, rel=1e-12)
    tau = np.linspace(0, 20, 21)
    p, q, phi = lattice.torus(Wave(mode, 1e-4, Contact(NU)), tau)
    assert p == pytest.approx(np.cos(mode.frequency * tau), abs=2e-4)  # the second harmonic is of order a
    assert np.max(np.abs([q, phi])) < 1e-9


# --- the longest step ---


def rates_at_rest(contact, wavenumber, direction):
    """Eigenvalues of the equations of motion at rest, from complex steps: exact to rounding, the law is analytic."""
    points, rows = 5, 9 if contact.has_history else 6
    neighbours = lattice.torus_neighbours(wavenumber, points, direction)
    steps = 1e-30j * np.eye(rows * points).reshape(-1, rows, points)
    jacobian = lattice.rhs(steps, contact, neighbours).imag.reshape(len(steps), -1) / 1e-30
    return np.abs(np.linalg.eigvals(jacobian))


CONTACTS = [
    {},
    {"poisson_ratio": 0.5},
    {"poisson_ratio": -1.0},
    {"inertia": 2.0},
    {"shear": False},
    {"rotation": False},
    {"overlap_ratio": 0.05, "prestress": 1.0},
    {"viscosity": 0.5},
    {"viscosity": 0.5, "shear": False},
    {"viscosity": 0.5, "rotation": False},
    {"law": "incremental", "viscosity": 2.0},
    {"restitution": 0.5, "prestress": 1.0},
]


@pytest.mark.parametrize("effects", CONTACTS, ids=str)
def test_no_rate_of_the_lattice_is_beyond_the_reach_of_the_longest_step(effects):
    contact = Contact(**{"poisson_ratio": NU} | effects)
    rates = [rates_at_rest(contact, xi, d) for xi in (0.05, 0.8, 1.6, 2.4, np.pi) for d in (0.0, 17.0, 90.0)]
    # 1e-6: eigenvalues of L and of translations, double at rest, are found to the root of rounding only.
    assert np.max(rates) * lattice.longest_step(contact) < lattice.REACH * (1 + 1e-6)


def test_the_bound_is_reached_by_rotations_of_long_waves():
    contact = Contact(NU)
    assert np.max(rates_at_rest(contact, 0.01, 90.0)) == pytest.approx(lattice.REACH / lattice.longest_step(contact))


def test_the_integrator_damps_every_rate_within_reach():
    A, B = DOP853.A[: len(DOP853.B), : len(DOP853.B)], DOP853.B

    def growth(z):
        # A is strictly lower triangular, so (1 − zA)⁻¹ is a sum of twelve terms
        terms = [B @ np.linalg.matrix_power(A, power) @ np.ones(len(B)) for power in range(len(B))]
        return abs(1 + z * np.polynomial.polynomial.polyval(z, terms))

    half_plane = np.exp(1j * np.linspace(np.pi / 2, np.pi, 61))
    within = growth(np.multiply.outer(np.linspace(0, 5.96, 150), half_plane))
    assert np.max(within) < 1 + 1e-12  # rounding of a polynomial of degree 12 whose terms are 2e3 at most
    assert growth(6j) > 1.05
    assert lattice.REACH < 5.96


def disturbed(longest):
    """q, φ of a long L wave (T, 2, K) that starts with too little RT to guide the steps, per amplitude of that."""
    mode, contact = sh.mode("L", 0.01, SILICA), Contact(NU)
    neighbours, phases = lattice.torus_neighbours(0.01, 5), lattice.torus_phases(5)
    start = lattice.initial_state(mode, 0.2, phases, contact, neighbours)
    start[2] += 2e-14
    states = lattice.integrate(
        lambda y: lattice.rhs(y, contact, neighbours), start, np.linspace(0, 60, 61), 1e-9, 0.2, longest
    )
    return states[:, 1:3] / 2e-14


def test_the_integrator_lets_nothing_grow_on_a_long_wave():
    # RT turns as cos Ωτ, which long L does not feed; between steps of Ωh = 5 the interpolation is coarse.
    assert np.max(np.abs(disturbed(lattice.longest_step(Contact(NU))))) < 3


def test_without_a_longest_step_what_is_small_grows_on_a_long_wave():
    assert np.max(np.abs(disturbed(np.inf))) > 1e3


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("xi", [0.01, 0.1])
def test_a_long_wave_along_stays_free_of_shear_and_rotation(xi, rtol):
    mode = sh.mode("L", xi, sh.ratios(NU, overlap_ratio=ETA))
    p, q, phi = lattice.torus(Wave(mode, 0.2, Contact(NU, overlap_ratio=ETA)), np.linspace(0, 20, 41), rtol=rtol)
    # A force, of order 1, is rounded by 1e-16 a few times over; if all of that pushed one way, for τ²/2 = 200 and per
    # a = 0.2, it would make 1e-12; the error control of a step of 17 τ made 6e-9.
    assert np.max(np.abs([q, phi])) < 1e-12
    assert np.max(np.abs(p)) > 0.9
