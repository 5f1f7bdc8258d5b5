"""Contacts by the JKR law: its constants, theory, and what is refused. LAMMPS: `test_adhesion_laws_in_lammps`."""

from dataclasses import replace
from math import cbrt, pi
from typing import Any

import numpy as np
import pytest

from cases.adhesion_laws import case as figure
from cases.effects import case as effects_figure
from granular_analysis.measure.norms import relative_error, slope
from granular_analysis.theory import bloch, network_laws
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.hierarchy import hierarchy
from granular_analysis.theory.lattice import torus
from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.network_state import forces, start
from granular_analysis.theory.resonance import three_mode
from granular_analysis.theory.wave import Wave, antiresonance, nonlinearity, resonance, shifted_second_order, trajectory
from granular_lmp import Scene
from granular_lmp.crystal.contacts import find_contacts
from granular_lmp.crystal.disorder import Disorder, imperfect
from granular_lmp.crystal.equilibrium import relax
from granular_lmp.crystal.lattices import Shape, packed, unit_cell
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.effects.reading import Reading
from granular_lmp.effects.sliding import sliding_force
from tests.conftest import latin
from tests.theory.energy import ledger, opening_time

PERIODIC = Scene.load("tr_periodic")
DMT = PERIODIC.sphere
JKR = replace(DMT, adhesion_law="jkr")
LAW = JKR.contact_law
PRESSED = [replace(JKR, contact_force=force) for force in (0.0, 0.1 * JKR.pull_off_force, 30 * JKR.pull_off_force)]
ROUNDED = 1e-13  # a thousand roundings of 1e-16: a dozen operations, of which Newton's rule is well conditioned


def as_printed(sphere: Sphere, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force and overlap of a contact of these radii, from the two equations of Johnson, Kendall & Roberts."""
    E, R, w = sphere.effective_modulus, sphere.effective_radius, sphere.work_of_adhesion
    force = 4 * E * radius**3 / (3 * R) - np.sqrt(8 * pi * w * E * radius**3)
    return force, radius**2 / R - np.sqrt(2 * pi * w * radius / E)


def at_rest(sphere: Sphere) -> float:
    """Contact radius at zero force."""
    return cbrt(9 * pi * sphere.work_of_adhesion * sphere.effective_radius**2 / (2 * sphere.effective_modulus))


# --- the law ---


def test_forces_and_shear_stiffness_are_those_of_the_printed_equations() -> None:
    radius = at_rest(JKR) * np.linspace(0.5 ** (2 / 3), 5, 50)
    force, overlap = as_printed(JKR, radius)
    np.testing.assert_allclose(LAW.force(overlap), force, rtol=0, atol=ROUNDED * np.abs(force).max())
    np.testing.assert_allclose(LAW.shear_stiffness(overlap), 8 * JKR.effective_shear_modulus * radius, rtol=ROUNDED)
    np.testing.assert_allclose(LAW.overlap_under(force[1:]), overlap[1:], rtol=0, atol=1e-10 * JKR.static_overlap)
    another = replace(JKR, work_of_adhesion=1.01 * JKR.work_of_adhesion).contact_law
    assert np.abs(another.force(overlap) - force).max() > 0.005 * JKR.pull_off_force  # a share of it is seen


@pytest.mark.parametrize("sphere", PRESSED)
def test_stiffnesses_and_their_changes_are_derivatives_of_the_force(sphere: Sphere) -> None:
    rest, law = sphere.static_overlap, sphere.contact_law
    # Differences of order h⁴ and roundings of 1e-16/h²: 1e-9 of the second derivative at h = 1e-2... of the overlap
    h = 3e-3 * rest
    f = [float(law.force(rest + k * h)) for k in (-2, -1, 0, 1, 2)]
    first = (f[0] - 8 * f[1] + 8 * f[3] - f[4]) / (12 * h)
    second = (-f[0] + 16 * f[1] - 30 * f[2] + 16 * f[3] - f[4]) / (12 * h * h)
    g = [float(law.shear_stiffness(rest + k * h)) for k in (-2, -1, 1, 2)]
    change = (g[0] - 8 * g[1] + 8 * g[2] - g[3]) / (12 * h)
    n, m = law.softening(rest)
    assert sphere.normal_stiffness == pytest.approx(first, rel=1e-8)
    assert n == pytest.approx(second * rest / (2 * first), rel=1e-6)
    assert m == pytest.approx(change * rest / sphere.shear_stiffness, rel=1e-8)
    assert law.force(rest) == pytest.approx(sphere.contact_force, rel=1e-12, abs=1e-12 * sphere.pull_off_force)


@pytest.mark.parametrize("sphere", [JKR, DMT])
def test_the_push_is_the_slope_of_the_energy_and_both_end_with_the_contact(sphere: Sphere) -> None:
    unit, force = sphere.static_overlap, sphere.pull_off_force
    law = sphere.contact_law.scaled(unit, force)  # lengths in Δ0, forces in F
    end = float(law.pull_off_overlap)
    assert end == pytest.approx(-sphere.pull_off_distance / unit, rel=ROUNDED)
    x, h = np.linspace(end + 0.05, 3, 200), 1e-3
    energy = [law.energy(x + k * h) for k in (-2, -1, 1, 2)]
    slope = (energy[0] - 8 * energy[1] + 8 * energy[2] - energy[3]) / (12 * h)
    push = law.push(x)
    # The difference leaves h⁴/30 of the fifth derivative of the energy, which is below 1e3 from 0.05 Δ0 on
    np.testing.assert_allclose(push, slope, rtol=0, atol=1e-9)
    np.testing.assert_allclose(push, sphere.contact_law.force(x * unit) / force, rtol=0, atol=1e-12 * push.max())
    beyond = np.array([end - 1.0, end - 1e-6])
    assert not np.any([law.push(beyond), law.energy(beyond)])
    assert not np.any(law.closed(beyond))
    just = np.array([end + 1e-9])
    assert law.push(just) == pytest.approx(-1, abs=1e-6)  # the force sets in at the pull-off
    assert law.energy(just) == pytest.approx(0, abs=1e-8)  # the energy does not jump there


def test_unequal_spheres_come_to_rest_by_the_law_and_the_network_finds_no_force_on_them() -> None:
    lattice = packed(JKR, Shape(16, 14, "periodic"))
    crystal, materials = imperfect(lattice, JKR, Disorder(radius=JKR.overlap_ratio, vacancies=0.02, seed=1))
    rest = relax(crystal, materials)
    assert rest.residual < 1e-10
    overlap = rest.contacts.overlap / JKR.static_overlap
    assert overlap.min() < -0.2  # contacts that are stretched hold it, too
    like = imperfect(packed(DMT, Shape(16, 14, "periodic")), DMT, Disorder(DMT.overlap_ratio, vacancies=0.02, seed=1))
    assert rest.contacts_per_sphere > relax(*like).contacts_per_sphere + 0.1
    at = rest.crystal
    network = Network(
        at.positions[:, :2] * JKR.radius,
        at.arrays["radius"] * JKR.radius,
        np.full(len(at), JKR.density),
        (Material(JKR.youngs_modulus, JKR.poisson_ratio, JKR.work_of_adhesion),),
        cell=tuple(at.cell.lengths()[:2] * JKR.radius),
        adhesion="jkr",
    )
    state = start(network, 0.0, 0.0)
    assert np.count_nonzero(state.begun) == len(rest.contacts)
    # Places of some 30 R are rounded to 1e-15 R, and a force to 1e-11 k1 Δ0 by it
    unit = JKR.normal_stiffness * JKR.static_overlap
    assert np.abs(forces(network, state)[:2]).max() < 1e-9 * unit
    assert np.abs(forces(replace(network, adhesion="dmt"), start(replace(network, adhesion="dmt"), 0.0, 0.0))).max() > (
        0.1 * unit
    )


def test_at_rest_the_constants_over_those_of_the_dmt_law_are_numbers() -> None:
    assert JKR.static_overlap / DMT.static_overlap == pytest.approx(3 ** (-1 / 3), rel=ROUNDED)
    assert JKR.normal_stiffness / DMT.normal_stiffness == pytest.approx(0.6 * 3 ** (1 / 3), rel=ROUNDED)
    assert JKR.shear_stiffness / DMT.shear_stiffness == pytest.approx(3 ** (1 / 3), rel=ROUNDED)
    assert JKR.stiffness_ratio / DMT.stiffness_ratio == pytest.approx(5 / 3, rel=ROUNDED)
    assert JKR.pull_off_force / DMT.pull_off_force == pytest.approx(0.75, rel=ROUNDED)
    assert LAW.softening(JKR.static_overlap) == pytest.approx((0.22, 0.2), rel=ROUNDED)
    per_metre = [sphere.nonlinearity(1.0) / sphere.static_overlap for sphere in (JKR, DMT)]
    # At ν = 0.17, to the last digit
    assert per_metre[0] / per_metre[1] == pytest.approx(0.9987, abs=5e-5)
    assert JKR.time_scale / DMT.time_scale == pytest.approx(1.0004, abs=5e-5)
    assert JKR.pull_off_distance / JKR.static_overlap == pytest.approx(2 ** (-1 / 3) / 2, rel=ROUNDED)


@pytest.mark.parametrize("name", network_laws.LAWS)
def test_the_energy_of_a_network_s_contact_is_that_of_its_push_from_where_it_ends(name: network_laws.Adhesion) -> None:
    law = network_laws.LAWS[name](np.array([2.0]), np.array([0.3]))
    overlap, closed, step = np.array([0.05, 0.3]), np.ones(2, dtype=bool), 1e-6

    def energy(at: np.ndarray) -> np.ndarray:
        return law.energy(at, law.radius(at, closed))

    assert np.abs(energy(law.end + np.zeros(2))).max() < 1e-12
    found = (energy(overlap + step) - energy(overlap - step)) / (2 * step)
    # Differences err by the third derivative times 1e-12, and by rounding over the step
    assert found == pytest.approx(law.repulsion(overlap, law.radius(overlap, closed), closed), abs=1e-8)


def test_a_contact_that_is_pressed_hard_is_one_of_hertz() -> None:
    hard = replace(JKR, contact_force=1e8 * JKR.pull_off_force)
    bare = replace(hard, adhesion_law="dmt", work_of_adhesion=0.0)
    # Adhesion adds a share √(F/F0) = 1e-4 to the contact radius
    for name in ("static_overlap", "normal_stiffness", "shear_stiffness", "stiffness_ratio"):
        assert getattr(hard, name) == pytest.approx(getattr(bare, name), rel=1e-3), name


def test_the_tabor_parameter_of_the_papers_spheres_is_between_the_two_laws() -> None:
    # Rc w² / E*² = 7.0e-31 m³, of which the cube root is 0.0888 nm
    assert DMT.tabor_parameter(1.6e-10) == pytest.approx(0.5553, rel=1e-3)
    assert JKR.tabor_parameter(1.6e-10) == DMT.tabor_parameter(1.6e-10)


# Polystyrene, silica and PDMS of 1 mm; μ grows with the cube root of the radius
@pytest.mark.parametrize(
    ("sphere", "said"),
    [
        (Sphere(0.5e-6, 4.0e9, 0.34, 0.06, 1050.0), '1.4 to 3.5 {}: JKR is nearer; set sphere.adhesion_law = "jkr"'),
        (replace(DMT, radius=0.5e-3), '2.2 to 5.6 {}: JKR is nearer; set sphere.adhesion_law = "jkr"'),
        (replace(DMT, radius=0.5), '22 to 56 {}: JKR holds; set sphere.adhesion_law = "jkr"'),
        (Sphere(0.5e-3, 2.5e6, 0.49, 0.05, 970.0), '1500 to 3800 {}: JKR holds; set sphere.adhesion_law = "jkr"'),
        (DMT, "0.22 to 0.56 {}: DMT is nearer, and is in use"),
        (JKR, '0.22 to 0.56 {}: DMT is nearer; set sphere.adhesion_law = "dmt"'),
        (replace(DMT, radius=0.5e-9), "0.022 to 0.056 {}: DMT holds, and is in use"),
    ],
)
def test_the_law_that_holds_by_tabors_parameter_is_named_with_its_key(sphere: Sphere, said: str) -> None:
    assert sphere.law_words == "Tabor's parameter is " + said.format("(DMT holds below 0.1, JKR above 5)")


def test_contacts_of_a_crystal_found_from_its_places_have_the_constants_of_the_sphere() -> None:
    found = find_contacts(unit_cell(JKR), [JKR])
    # Positions of 500 nm are rounded to 1e-16 of it, 1e-12 of the overlap, and a few times that is left
    for name in ("normal_stiffness", "shear_stiffness"):
        np.testing.assert_allclose(getattr(found, name), getattr(JKR, name), rtol=1e-10)
    np.testing.assert_allclose(found.contact_force, 0, atol=1e-10 * JKR.pull_off_force)


def test_the_bound_of_the_sliding_force_is_below_it_for_all_overlaps_up_to_rest() -> None:
    for sphere in PRESSED:
        law, hold = sphere.contact_law, sphere.pull_off_distance / sphere.static_overlap
        reading = Reading(True, sphere, sphere.holding_force, adhesive_force=sphere.pull_off_force)
        text = sliding_force(reading).replace("^", "**")
        filled = text.replace("v_overlap", "x")
        x = np.linspace(-hold, 1, 1001)
        ratio = eval(filled, {"x": x}) / law.sliding_force(np.maximum(x * sphere.static_overlap, law.pull_off_overlap))
        assert ratio.max() < 1 + ROUNDED
        assert ratio[[0, -1]] == pytest.approx(1, rel=1e-9)  # and no lower than needed at both ends


def test_the_forces_of_the_figure_are_those_of_the_laws() -> None:
    overlap = np.linspace(0.0, 2.0, 21)
    unit = pi * JKR.work_of_adhesion * JKR.effective_radius
    for law, sphere in (("dmt", DMT), ("jkr", JKR)):
        expected = sphere.contact_law.force(overlap * DMT.static_overlap) / unit
        np.testing.assert_allclose(figure.force(law, overlap), expected, rtol=0, atol=ROUNDED * 10)


# --- theory ---


def test_the_constants_of_theory_are_those_of_the_sphere_that_it_does_not_know() -> None:
    for sphere in PRESSED:
        share = sphere.contact_force / sphere.holding_force
        theory = Contact(sphere.poisson_ratio, prestress=share, overlap_ratio=sphere.overlap_ratio, adhesion_law="jkr")
        law, rest = sphere.contact_law, sphere.static_overlap
        assert theory.kappa == pytest.approx(sphere.stiffness_ratio, rel=ROUNDED)
        own = theory.adhesion.law(1.0)
        assert (own.curvature / 2, own.shear_growth) == pytest.approx(law.softening(rest), rel=ROUNDED)
        assert theory.adhesion.least_overlap == pytest.approx(law.pull_off_overlap / rest, rel=ROUNDED)
        d = np.linspace(0.01, 3, 30)
        radius = theory.adhesion.radius(d)
        np.testing.assert_allclose(radius, law.shear_stiffness(d * rest) / sphere.shear_stiffness, rtol=ROUNDED)
        force = law.force(d * rest) / (sphere.normal_stiffness * rest)
        np.testing.assert_allclose(-theory.adhesion.pull(d, radius), force, rtol=0, atol=ROUNDED * np.abs(force).max())
        assert nonlinearity(theory, 0.2) == pytest.approx(sphere.nonlinearity(0.2), rel=ROUNDED)
        compression = theory.adhesion.load / 1.5 * sphere.overlap_ratio / (1 - sphere.overlap_ratio)
        assert compression == pytest.approx(sphere.prestress, rel=1e-12, abs=1e-18)


def test_second_order_in_another_direction_and_the_hierarchy_meet_the_lattice() -> None:
    contact, tau = Contact(0.17, overlap_ratio=2e-3, prestress=0.3, adhesion_law="jkr"), np.linspace(0.5, 30, 60)
    mode = bloch.mode("TR", 0.8, 63.7, contact)
    errors = []
    for amplitude in (0.04, 0.02):
        wave = Wave(mode, amplitude, contact)
        exact = np.array(torus(wave, tau))
        errors.append(float(np.linalg.norm(np.array(trajectory(wave, tau)) - exact)))
    assert slope((0.04, 0.02), errors) == pytest.approx(2, abs=0.1)
    orders = np.array(hierarchy(wave, tau))
    # Six orders leave out a⁶ of the signal; the circle is integrated to 1e-10, a hundred times that at the end
    assert np.linalg.norm(orders - exact) < 1e-7 * np.linalg.norm(exact)


def test_resonance_and_antiresonance_move_by_a_sixth() -> None:
    dmt, jkr = (Contact(0.17, adhesion_law=law) for law in ("dmt", "jkr"))
    # Numbers of docs/contact-laws.md, to their last digit
    assert [resonance(dmt), antiresonance(dmt)] == pytest.approx([1.476255, 2.128060], abs=5e-7)
    assert [resonance(jkr), antiresonance(jkr)] == pytest.approx([1.308278, 2.531049], abs=5e-7)
    for force, place in ((1, 2.439478), (10, 2.276128), (100, 2.178044)):
        pressed = Contact(0.17, adhesion_law="jkr", prestress=force / (1 + force))
        assert antiresonance(pressed) == pytest.approx(place, abs=5e-7)
    hertz = Contact(0.17, adhesion_law="jkr", prestress=1 - 1e-12)
    assert resonance(hertz) == pytest.approx(resonance(dmt), abs=1e-5)  # √(1−s) of adhesion is left


def test_antiresonance_and_resonance_of_the_law_are_in_the_zone_for_every_poisson_ratio_and_do_not_cross() -> None:
    for nu in np.linspace(-1, 0.5, 7):
        contact = Contact(float(nu), adhesion_law="jkr")
        pole, zero = resonance(contact), antiresonance(contact)
        assert pole is not None
        assert zero is not None
        assert 0 < pole + 0.5 < zero < pi


@pytest.mark.parametrize("law", ["secant", "incremental"])
def test_energy_less_the_work_of_the_shear_law_is_constant(law: Any) -> None:
    contact = Contact(0.17, law=law, prestress=0.2, adhesion_law="jkr")
    found = ledger(Wave.of_mode("TR", 1.3, 0.2, contact), np.linspace(0, 30, 31), rtol=1e-9)
    assert np.abs(found.relative - 1).max() > 1e-3  # the law does work
    assert found.gap < 1e-7  # the trajectory, about 10 rtol, is interpolated between the steps of the integrator
    spoilt = replace(found, work=1.01 * found.work)
    assert spoilt.gap > 1e-5


def test_the_secant_law_does_less_work_at_the_resonance_of_a_jkr_crystal() -> None:
    left = []
    for law, wavenumber in (("dmt", 1.475), ("jkr", 1.308)):
        wave = Wave.of_mode("TR", wavenumber, 0.2, Contact(0.17, adhesion_law=law))
        left.append(ledger(wave, np.array([0.0, 200.0]), points=15, rtol=1e-7).relative[-1])
    # Fifteen points of phase and the tolerance leave 1e-5
    assert left == pytest.approx([0.8631, 0.9208], abs=1e-4)


def test_a_contact_opens_where_it_is_pulled_off() -> None:
    strong = Wave.of_mode("L", pi / 2, 1.3, Contact(0.17, adhesion_law="jkr"))
    weak = replace(strong, amplitude=0.9)
    assert opening_time(weak, 10.0, rtol=1e-8) is None
    assert opening_time(strong, 10.0, rtol=1e-8) is not None


# --- third order ---


def test_the_figure_of_effects_names_the_law() -> None:
    assert effects_figure.name(Contact(0.17, adhesion_law="jkr")) == "JKR adhesion"
    assert effects_figure.name(Contact(0.17)) == "as the paper"


@pytest.mark.parametrize(("share", "wavenumber"), latin([0.0, 0.4], [0.802, 1.3083]))
def test_third_order_holds_the_law(wavenumber: float, share: float) -> None:
    tau, amplitudes = np.linspace(0.5, 60, 120), (0.1, 0.05)
    waves = [Wave.of_mode("TR", wavenumber, a, Contact(0.17, prestress=share, adhesion_law="jkr")) for a in amplitudes]
    exact = [torus(wave, tau, rtol=1e-10)[1] for wave in waves]
    second, shifted, three = (
        [relative_error(theory(wave, tau)[1], q) for wave, q in zip(waves, exact, strict=True)]
        for theory in (trajectory, shifted_second_order, three_mode)
    )
    # What is left of q is a²: of the third harmonic, of which second order knows nothing, and of slaved waves
    assert slope(amplitudes, three) == pytest.approx(2, abs=0.1)
    assert three[0] < shifted[0] / 3 < second[0] / 6
