"""Contacts by the JKR law: its constants, the crystal that it holds, LAMMPS's runs, theory, and what is refused."""

from collections.abc import Callable
from dataclasses import replace
from math import cbrt, pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis import second_harmonic as closed
from analysis.design import design
from analysis.figures import adhesion_laws as figure
from analysis.measure.norms import relative_error, slope
from analysis.measure.snapshot import first_snapshot
from analysis.measure.spectrum import point
from analysis.second_harmonic import ModeName
from analysis.theory import catalogue, directions
from analysis.theory.choice import TheoryError, holding, traits, trajectory, wave_of
from analysis.theory.contact import Contact
from analysis.theory.energy import ledger, opening_time
from analysis.theory.frequency_shift import frequency_shift
from analysis.theory.hierarchy import hierarchy
from analysis.theory.lattice import torus
from analysis.theory.resonance import three_mode
from analysis.theory.third_harmonic import third_harmonic_amplitude
from analysis.theory.timestep import phase_error, stepped
from analysis.theory.wave import Wave
from granular_lmp import ImpactScene, Record, Scene, build, run
from granular_lmp.accuracy.rounding import noise_floor
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.crystal.contacts import find_contacts
from granular_lmp.crystal.equilibrium import relax
from granular_lmp.crystal.lattices import Shape, packed, unit_cell
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.effects.sliding import sliding_force
from granular_lmp.errors import CrystalError, LaunchError, SceneError
from granular_lmp.lammps import contact
from granular_lmp.lammps.units import NANO
from granular_lmp.scene.validation import LARGEST_OVERLAP_RATIO
from granular_lmp.studies.kick import run_kicked
from tests.instance import silent_lammps
from tests.validation.test_contact_law import touch

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


def test_at_rest_the_constants_over_those_of_the_dmt_law_are_numbers() -> None:
    assert JKR.static_overlap / DMT.static_overlap == pytest.approx(3 ** (-1 / 3), rel=ROUNDED)
    assert JKR.normal_stiffness / DMT.normal_stiffness == pytest.approx(0.6 * 3 ** (1 / 3), rel=ROUNDED)
    assert JKR.shear_stiffness / DMT.shear_stiffness == pytest.approx(3 ** (1 / 3), rel=ROUNDED)
    assert JKR.stiffness_ratio / DMT.stiffness_ratio == pytest.approx(5 / 3, rel=ROUNDED)
    assert JKR.pull_off_force / DMT.pull_off_force == pytest.approx(0.75, rel=ROUNDED)
    assert LAW.softening(JKR.static_overlap) == pytest.approx((0.22, 0.2), rel=ROUNDED)
    assert JKR.pull_off_distance / JKR.static_overlap == pytest.approx(2 ** (-1 / 3) / 2, rel=ROUNDED)


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


def test_contacts_of_a_crystal_found_from_its_places_have_the_constants_of_the_sphere() -> None:
    found = find_contacts(unit_cell(JKR), [JKR])
    # Positions of 500 nm are rounded to 1e-16 of it, 1e-12 of the overlap, and a few times that is left
    for name in ("normal_stiffness", "shear_stiffness"):
        np.testing.assert_allclose(getattr(found, name), getattr(JKR, name), rtol=1e-10)
    np.testing.assert_allclose(found.contact_force, 0, atol=1e-10 * JKR.pull_off_force)


# --- LAMMPS ---


def pulled(sphere: Sphere, overlaps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force in N between two spheres at these overlaps (m), one after the other, and contacts that the deck counts."""
    model = contact.model(sphere, NANO, normal="jkr", shear="none")
    diameter = NANO.number(2 * sphere.radius, length=1)
    deck = build(PERIODIC.with_values({"sphere.adhesion_law": "jkr"})).input_text
    (count,) = (line for line in deck.split("\n") if line.startswith("compute      touching"))
    forces, counts = [], []
    with silent_lammps() as lammps:
        lammps.commands_string(
            "units nano\natom_style sphere\natom_modify map array\nboundary f f f\n"
            "region all block -2000 2000 -50 50 -50 50\ncreate_box 1 all\n"
            "create_atoms 1 single 0 0 0\ncreate_atoms 1 single 999 0 0\n"
            f"set group all diameter {diameter!r}\nset group all density 1\nneighbor 50 nsq\ncomm_modify vel yes\n"
            f"pair_style granular\npair_coeff * * {model}\n{count}\n"
            "compute counted all reduce max c_touching\nfix move all nve/sphere\nthermo_style custom step c_counted\n"
        )
        for overlap in overlaps:
            lammps.numpy.extract_atom("x")[1, 0] = diameter - NANO.number(float(overlap), length=1)
            lammps.command("run 0 post no")
            forces.append(lammps.numpy.extract_atom("f")[1, 0] / NANO.number(1.0, mass=1, length=1, time=-2))
            counts.append(lammps.extract_compute("counted", 0, 0))
    return np.array(forces), np.array(counts)


def test_lammps_has_the_law_until_the_pull_off_and_counts_the_contact_until_then() -> None:
    reach = JKR.pull_off_distance
    attached = np.linspace(2 * JKR.static_overlap, -0.999 * reach, 12)
    beyond = np.array([-1.001 * reach, -0.5 * reach, 0.5 * JKR.static_overlap])
    forces, counts = pulled(JKR, np.concatenate([attached, beyond]))
    # LAMMPS rounds a distance of 1000 nm to 1e-13 nm, 1e-12 of the overlap; its formula of the radius loses as much
    np.testing.assert_allclose(forces[:12], LAW.force(attached), rtol=0, atol=1e-10 * JKR.pull_off_force)
    assert counts[:12].tolist() == [1] * 12
    assert forces[12:14].tolist() == [0, 0]  # it has parted, and does not come back before the spheres overlap
    assert forces[14] == pytest.approx(float(LAW.force(beyond[2])), rel=1e-9)
    assert counts[12] == 0


@pytest.mark.parametrize("overlap", [0.125, -0.0625])  # nm; pulled off at −0.0687
def test_lammps_shears_and_slides_by_the_radius_and_the_force_of_the_law(overlap: float) -> None:
    nano, metres = NANO.number(1.0, mass=1, length=1, time=-2), overlap / NANO.number(1.0, length=1)
    formed = 0.125  # where the contact forms, before it is pulled to the overlap
    moves = [(0.0, 0.0), (0.0, overlap - formed), (2.0**-10, 0.0)]
    sticking, sliding = (
        touch(contact.pair(contact.model(JKR, NANO, normal="jkr", friction=mu)), JKR, formed, *moves)
        for mu in (10.0, 1e-4)
    )
    assert sticking.normal / nano == pytest.approx(float(LAW.force(metres)), rel=1e-9)
    slip = 2.0**-10 / NANO.number(1.0, length=1)
    assert abs(sticking.shear) / nano == pytest.approx(float(LAW.shear_stiffness(metres)) * slip, rel=1e-9)
    assert abs(sliding.shear) / nano == pytest.approx(1e-4 * float(LAW.sliding_force(metres)), rel=1e-9)


def test_the_neighbour_list_reaches_beyond_the_pull_off_of_any_crystal_that_is_allowed() -> None:
    reach = JKR.pull_off_distance / JKR.static_overlap * LARGEST_OVERLAP_RATIO * 2  # in radii; the deck's skin is 0.1
    assert reach < 0.1
    assert "neighbor     50.0 bin" in build(PERIODIC.with_values({"sphere.adhesion_law": "jkr"})).input_text


def waves(folder: Path, cycles: int, **changes: Any) -> Record:
    """The record of a wave with ξ = 2π·cycles/24 in a periodic crystal held by the JKR law."""
    values = {"sphere.adhesion_law": "jkr", "packing.rows": 24, "wave.wavenumber": 2 * pi * cycles / 24}
    values |= {"wave.amplitude": 0.03, "time.duration": 40.0, "time.timestep": 0.02}
    return run(
        PERIODIC.with_values(values | {key.replace("_", ".", 1): value for key, value in changes.items()}), folder
    )


CYCLES = (1, 3, 4, 5, 6, 8, 10, 11)


@pytest.fixture(scope="module")
def crystal(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Record]:
    """Runs over the wave number, by cycles; 5 and 10 cycles are next to the resonance and the antiresonance."""
    return {cycles: waves(tmp_path_factory.mktemp("wave") / "run", cycles) for cycles in CYCLES}


@pytest.fixture(scope="module")
def by_verlet(crystal: dict[int, Record]) -> dict[int, np.ndarray]:
    """p, q, φ (T, 3) of the same waves in the exact lattice, stepped with LAMMPS's rule and step."""
    stepped_waves = stepped([wave_of(record) for record in crystal.values()], 25, records=80)
    return dict(zip(crystal, stepped_waves, strict=True))


@pytest.mark.parametrize("cycles", CYCLES)
def test_the_second_harmonic_in_lammps_is_that_of_theory(
    cycles: int, crystal: dict[int, Record], by_verlet: dict[int, np.ndarray]
) -> None:
    record = crystal[cycles]
    wave = wave_of(record)
    assert wave.contact.adhesion_law == "jkr"
    stepped = np.array(by_verlet[cycles])
    off = [np.abs(getattr(record, name) - stepped[:, part]).max() for part, name in enumerate(("p", "q", "phi"))]
    # Both step alike, and round differently; the law of the noise is good to a factor of 3, the largest sample is 3 σ
    assert max(off) < 9 * noise_floor(record.scene)
    # Of second order in a = 0.03 and in the step, (Ωτh)², with factors of order 1 by the waves that beat
    assert abs(point(record).deviation) < 2e-3
    another = Wave.of_mode("TR", wave.mode.wavenumber, wave.amplitude, replace(wave.contact, adhesion_law="dmt"))
    assert relative_error(record.p, torus(another, record.tau)[0]) > 0.05  # the other law is seen


def test_the_figure_takes_the_runs_of_a_law_and_finds_resonance_and_antiresonance(crystal: dict[int, Record]) -> None:
    groups = figure.by_law(list(crystal.values()))
    lines = figure.table(groups).splitlines()
    assert list(groups) == ["jkr"]
    found = {line.split()[1]: float(line.split()[2]) for line in lines if "resonance" in line}
    # A polynomial of degree 4 through runs that are 0.26 apart
    assert found["resonance"] == pytest.approx(1.3083, abs=0.02)
    assert found["antiresonance"] == pytest.approx(2.5337, abs=0.02)
    assert len(figure.draw(groups).axes) == 4
    other = run_of_another(crystal[4])
    with pytest.raises(ValueError, match="a figure takes the runs of one crystal"):
        figure.by_law([crystal[3], other])


def run_of_another(record: Record) -> Record:
    """The same record, as if it were of spheres with another ratio."""
    return replace(record, scene=record.scene.with_values({"sphere.poisson_ratio": 0.2}))


def test_the_forces_of_the_figure_are_those_of_the_laws() -> None:
    overlap = np.linspace(0.0, 2.0, 21)
    unit = pi * JKR.work_of_adhesion * JKR.effective_radius
    for law, sphere in (("dmt", DMT), ("jkr", JKR)):
        expected = sphere.contact_law.force(overlap * DMT.static_overlap) / unit
        np.testing.assert_allclose(figure.force(law, overlap), expected, rtol=0, atol=ROUNDED * 10)


def test_the_deck_of_a_compressed_crystal_is_that_of_theory(tmp_path: Path) -> None:
    record = waves(tmp_path / "run", 4, packing_contact_force=2 * JKR.pull_off_force)
    wave = wave_of(record)
    assert wave.contact.kappa == pytest.approx(record.scene.sphere.stiffness_ratio, rel=ROUNDED)
    exact = trajectory("exact-lattice", wave, record.tau)
    step, _ = phase_error(2 * wave.mode.frequency, record.scene.time.step, record.tau[-1])
    assert relative_error(record.p, exact[0]) < 3 * float(step)
    unloaded = replace(wave.contact, prestress=0.0)
    wrong = Wave.of_mode("TR", wave.mode.wavenumber, wave.amplitude, unloaded)
    assert relative_error(record.p, torus(wrong, record.tau)[0]) > 0.05


def test_contacts_that_hold_beyond_their_end_do_not_trigger_the_guard_and_those_that_part_do(tmp_path: Path) -> None:
    both = {"wave_mode": "L", "effects_contact_opening": False, "effects_sliding": False, "time_duration": 12.0}
    held = waves(tmp_path / "held", 6, **both, wave_amplitude=0.9)
    assert -0.3 < held.info["smallest_overlap"] < -0.05
    assert held.info["guards"]["open_contacts"]["value"] == 0
    parted = waves(tmp_path / "parted", 6, **both, wave_amplitude=1.3)
    # The rule, which knows the linear wave, says so before; forced off, the guard reports and does not fail the run
    assert parted.info["effects"]["contact_opening"]["called_for"]
    assert parted.info["guards"]["open_contacts"]["value"] > 0


def test_a_monitor_records_contacts_that_hold_beyond_their_end(tmp_path: Path) -> None:
    pulled_far = {"wave_mode": "L", "wave_amplitude": 0.9, "time_duration": 12.0, "packing_columns": 3}
    record = waves(tmp_path / "run", 6, **pulled_far, monitor=[{"name": "rows", "rows": [10, 13], "what": "contacts"}])
    contacts, sphere = record.monitor("rows").contacts, record.scene.sphere
    overlap = contacts.overlap * sphere.static_overlap
    force = contacts.normal * sphere.normal_stiffness * record.scene.displacement_amplitude
    assert overlap.min() < -0.05 * sphere.static_overlap
    # The overlap is what is left of a distance of 1000 nm, rounded to 1e-13 nm
    np.testing.assert_allclose(force, LAW.force(overlap), rtol=0, atol=1e-9 * sphere.pull_off_force)


def test_a_run_that_is_resumed_while_contacts_hold_beyond_their_end_is_the_same(
    tmp_path: Path, stop: Callable[[Scene, Path], None]
) -> None:
    values = {"sphere.adhesion_law": "jkr", "packing.rows": 24, "wave.wavenumber": pi / 2, "wave.mode": "L"}
    scene = PERIODIC.with_values(values | {"wave.amplitude": 0.9, "time.duration": 100.0, "time.timestep": 0.02})
    whole = run(scene, tmp_path / "whole")
    assert whole.info["smallest_overlap"] < -0.05
    stop(scene, tmp_path / "parts")
    np.testing.assert_array_equal(resume(tmp_path / "parts").p, whole.p)


def test_the_bound_of_the_sliding_force_is_below_it_for_all_overlaps_up_to_rest() -> None:
    text = sliding_force("jkr", "looks").replace("^", "**").replace("v_mu", "1")
    for sphere in PRESSED:
        law, hold = sphere.contact_law, sphere.pull_off_distance / sphere.static_overlap
        values = {"adhesive_force": sphere.pull_off_force, "holding_force": sphere.holding_force, "hold": hold}
        filled = text.replace("v_overlap_looks", "x")
        for name, value in values.items():
            filled = filled.replace(f"<{name}>", repr(value))
        x = np.linspace(-hold, 1, 1001)
        ratio = eval(filled, {"x": x}) / law.sliding_force(np.maximum(x * sphere.static_overlap, law.pull_off_overlap))
        assert ratio.max() < 1 + ROUNDED
        assert ratio[[0, -1]] == pytest.approx(1, rel=1e-9)  # and no lower than needed at both ends


# --- theory ---


def test_the_constants_of_theory_are_those_of_the_sphere_that_it_does_not_know() -> None:
    for sphere in PRESSED:
        share = sphere.contact_force / sphere.holding_force
        theory = Contact(sphere.poisson_ratio, prestress=share, overlap_ratio=sphere.overlap_ratio, adhesion_law="jkr")
        law, rest = sphere.contact_law, sphere.static_overlap
        assert theory.kappa == pytest.approx(sphere.stiffness_ratio, rel=ROUNDED)
        assert theory.adhesion.expansion[1:] == pytest.approx(law.softening(rest), rel=ROUNDED)
        assert theory.adhesion.least_overlap == pytest.approx(law.pull_off_overlap / rest, rel=ROUNDED)
        d = np.linspace(0.01, 3, 30)
        radius = theory.adhesion.radius(d)
        np.testing.assert_allclose(radius, law.shear_stiffness(d * rest) / sphere.shear_stiffness, rtol=ROUNDED)
        force = law.force(d * rest) / (sphere.normal_stiffness * rest)
        np.testing.assert_allclose(-theory.adhesion.pull(d, radius), force, rtol=0, atol=ROUNDED * np.abs(force).max())
        assert closed.nonlinearity(theory.ratios, 0.2) == pytest.approx(sphere.nonlinearity(0.2), rel=ROUNDED)
        compression = theory.adhesion.load / 1.5 * sphere.overlap_ratio / (1 - sphere.overlap_ratio)
        assert compression == pytest.approx(sphere.prestress, rel=1e-12, abs=1e-18)


CASES = [
    (name, law, share, eta)
    for name in ("TR", "L")
    for law, share, eta in (("secant", 0.0, 0.0), ("secant", 0.5, 2e-3), ("incremental", 0.0, 2e-3))
] + [("RT", "secant", 0.0, 2e-3)]


@pytest.mark.parametrize(("name", "law", "share", "eta"), CASES)
def test_the_closed_form_is_exact_at_small_amplitude(name: ModeName, law: Any, share: float, eta: float) -> None:
    contact = Contact(0.17, law=law, prestress=share, overlap_ratio=eta, adhesion_law="jkr")
    tau, amplitudes, own = np.linspace(0.5, 30, 60), (0.04, 0.02), contact.ratios
    mode = closed.mode(name, 0.802, own)
    linear = mode.p * np.cos(0.3 * mode.wavenumber - mode.frequency * tau)
    exact = [torus(Wave(mode, a, contact), tau, row=0.3)[0] - linear for a in amplitudes]

    def order(ratios: closed.Ratios) -> float:
        theory = [closed.second_order(mode, ratios, a, tau, row=0.3)[0] - linear for a in amplitudes]
        return slope(amplitudes, [relative_error(*pair) for pair in zip(theory, exact, strict=True)])

    # What is left out is smaller by a² in p of TR and RT, by a in the second harmonic of L, whose phase drifts
    expected = 1.0 if name == "L" else 2.0
    assert order(own) == pytest.approx(expected, abs=0.1)
    assert order(replace(own, alpha=1.1 * own.alpha + 0.01, longitudinal=1.1 * own.longitudinal)) < expected / 2


def test_second_order_in_another_direction_and_the_hierarchy_meet_the_lattice() -> None:
    contact, tau = Contact(0.17, overlap_ratio=2e-3, prestress=0.3, adhesion_law="jkr"), np.linspace(0.5, 30, 60)
    mode = directions.mode("TR", 0.8, 63.7, contact)
    errors = []
    for amplitude in (0.04, 0.02):
        wave = Wave(mode, amplitude, contact)
        exact = np.array(torus(wave, tau))
        errors.append(float(np.linalg.norm(np.array(directions.trajectory(wave, tau)) - exact)))
    assert slope((0.04, 0.02), errors) == pytest.approx(2, abs=0.1)
    orders = np.array(hierarchy(wave, tau))
    # Six orders leave out a⁶ of the signal; the circle is integrated to 1e-10, a hundred times that at the end
    assert np.linalg.norm(orders - exact) < 1e-7 * np.linalg.norm(exact)


def test_resonance_and_antiresonance_move_by_a_sixth() -> None:
    dmt, jkr = (Contact(0.17, adhesion_law=law).ratios for law in ("dmt", "jkr"))
    # Numbers of docs/adhesion-laws.md, to their last digit
    assert [closed.resonance(dmt), closed.antiresonance(dmt)] == pytest.approx([1.476255, 2.128060], abs=5e-7)
    assert [closed.resonance(jkr), closed.antiresonance(jkr)] == pytest.approx([1.308278, 2.531049], abs=5e-7)
    pressed = Contact(0.17, adhesion_law="jkr", prestress=1 - 1e-12).ratios
    assert closed.resonance(pressed) == pytest.approx(closed.resonance(dmt), abs=1e-5)  # √(1−s) of adhesion is left


def test_a_contact_opens_where_it_is_pulled_off() -> None:
    strong = Wave.of_mode("L", pi / 2, 1.3, Contact(0.17, adhesion_law="jkr"))
    weak = replace(strong, amplitude=0.9)
    assert opening_time(weak, 10.0, rtol=1e-8) is None
    assert opening_time(strong, 10.0, rtol=1e-8) is not None


# --- what is refused ---


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sphere.adhesion_law": "maugis"}, 'sphere.adhesion_law = \'maugis\': must be one of "dmt", "jkr"'),
        ({"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7}, "needs sphere.work_of_adhesion above 0"),
        ({"effects.adhesion": False, "packing.contact_force": 1e-7}, "and effects.adhesion not false"),
        ({"disorder.radius": 1e-5}, 'must be "dmt" where spheres differ or are missing'),
        ({"inclusion": [{"rows": [1, 2], "density": 3000.0}]}, 'must be "dmt" where spheres differ'),
        ({"inclusion": [{"rows": [1, 2], "adhesion_law": "dmt"}]}, "inclusion.1.adhesion_law: unknown key"),
    ],
)
def test_a_scene_that_the_law_does_not_hold_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        PERIODIC.with_values({"sphere.adhesion_law": "jkr", "packing.rows": 16, "packing.columns": 3} | changes)


def test_restitution_is_refused_as_with_any_adhesive_law() -> None:
    with pytest.raises(SceneError, match="restitution"):
        build(PERIODIC.with_values({"sphere.adhesion_law": "jkr", "effects.restitution": 0.9}))


def test_impacts_have_no_adhesion_law() -> None:
    with pytest.raises(SceneError, match="sphere.adhesion_law: unknown key"):
        ImpactScene.load("solitary_chain").with_values({"sphere.adhesion_law": "jkr"})


def test_a_sheet_that_is_kicked_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="record does not name the law"):
        run_kicked(PERIODIC.with_values({"sphere.adhesion_law": "jkr"}), tmp_path / "run")


def test_the_kernel_refuses_the_law_before_a_file_is_written(tmp_path: Path) -> None:
    with pytest.raises(LaunchError, match="does not know the contact 'jkr"):
        run(PERIODIC.with_values({"sphere.adhesion_law": "jkr"}), tmp_path / "run", kernel=True)
    assert not (tmp_path / "run").exists()


def test_the_design_of_triads_refuses_the_law() -> None:
    with pytest.raises(ValueError, match="adhesion_law is 'jkr'; allowed: 'dmt'"):
        design(JKR, 1e8)


def test_spheres_and_crystals_of_the_library_refuse_what_the_law_does_not_hold() -> None:
    with pytest.raises(ValueError, match=r"work_of_adhesion = 0\.0: must be above 0"):
        _ = replace(JKR, work_of_adhesion=0.0).static_overlap
    with pytest.raises(ValueError, match="adhesion_law = 'maugis': must be one of dmt, jkr"):
        _ = replace(JKR, adhesion_law="maugis").contact_law
    with pytest.raises(ValueError, match="adhesion_law = dmt, jkr: must be the same for all materials"):
        find_contacts(unit_cell(JKR), [JKR, DMT])
    with pytest.raises(CrystalError, match="sphere.adhesion_law = 'jkr'"):
        relax(packed(JKR, Shape(6, 4, "periodic")), [JKR])


def test_theories_that_leave_the_law_out_refuse_it_by_name(tmp_path: Path) -> None:
    record = waves(tmp_path / "run", 4, output_particles=10.0)
    wave = wave_of(record)
    assert holding(wave) == ["second-order", "hierarchy", "exact-lattice"]
    for name, held in catalogue.HOLDS.items():
        assert (catalogue.JKR in held) != (catalogue.JKR in catalogue.missing(name, traits(wave)))
    with pytest.raises(TheoryError, match="'three-mode' leaves out sphere.adhesion_law = 'jkr'"):
        trajectory("three-mode", wave, record.tau)
    with pytest.raises(ValueError, match="the network holds 'dmt' only"):
        first_snapshot(record)
    assert point(record).deviation == pytest.approx(0, abs=0.01)  # second order in a: 0.03² times a few, and the step


@pytest.mark.parametrize(
    "ask",
    [
        lambda wave: frequency_shift(wave.mode, wave.ratios),
        lambda wave: three_mode(wave.mode, wave.ratios, 0.1, np.linspace(0, 1, 3)),
        lambda wave: third_harmonic_amplitude(np.array([0.0, 0.9]), 0, wave.contact),
        lambda wave: ledger(wave, np.linspace(0, 1, 3)),
    ],
)
def test_formulas_of_third_order_refuse_constants_of_the_law(ask: Any) -> None:
    with pytest.raises(ValueError, match="third order is not known"):
        ask(Wave.of_mode("TR", 0.8, 0.1, Contact(0.17, adhesion_law="jkr")))
