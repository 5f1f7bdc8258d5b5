"""Contacts and crystals by the JKR law in LAMMPS: forces, waves, guards, monitors, and a run that is resumed."""

import re
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.adhesion_laws import case as figure
from cases.rows import FORMS
from cases.spectrum.points import point
from granular_analysis.measure.norms import relative_error
from granular_analysis.measure.reference import Reference
from granular_analysis.theory import catalogue
from granular_analysis.theory.choice import THEORIES, holding, traits, trajectory, wave_of
from granular_analysis.theory.lattice import torus
from granular_analysis.theory.wave import Wave
from granular_lmp import Record, Scene, build, run
from granular_lmp.accuracy.rounding import noise_floor
from granular_lmp.crystal.scale import LARGEST_OVERLAP_RATIO
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.lammps import contact
from granular_lmp.units import NANO
from tests.instance import silent_lammps
from tests.stepped import phase_error, stepped
from tests.validation.test_contact_law import touch

PERIODIC = Scene.load("tr_periodic")
DMT = PERIODIC.sphere
JKR = replace(DMT, adhesion_law="jkr")
LAW = JKR.contact_law
ROUNDED = 1e-13  # a thousand roundings of 1e-16: a dozen operations, of which Newton's rule is well conditioned


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


@pytest.mark.parametrize("overlap", [2.0**-8, 0.125, 64.0, -0.0625])  # nm; pulled off at −0.0687
def test_lammps_shears_and_slides_by_the_radius_and_the_force_of_the_law(overlap: float) -> None:
    nano, metres = NANO.number(1.0, mass=1, length=1, time=-2), overlap / NANO.number(1.0, length=1)
    formed = max(overlap, 0.125)  # where the contact forms, before it is pulled to the overlap
    moves = [(0.0, 0.0), (0.0, overlap - formed), (2.0**-5, 0.0)]
    sticking, sliding = (
        touch(contact.pair(contact.model(JKR, NANO, normal="jkr", friction=mu)), JKR, formed, *moves)
        for mu in (10.0, 1e-4)
    )
    force, slip = float(LAW.force(metres)), 2.0**-5 / NANO.number(1.0, length=1)
    # Ten roundings, which the slope of the radius near the pull-off makes larger; the force cancels at rest
    assert abs(sticking.normal / nano - force) < 1e-9 * (abs(force) + JKR.pull_off_force)
    assert abs(sticking.shear) / nano == pytest.approx(float(LAW.shear_stiffness(metres)) * slip, rel=1e-9)
    assert abs(sliding.shear) / nano == pytest.approx(1e-4 * float(LAW.sliding_force(metres)), rel=1e-9)
    assert abs(sliding.shear) / nano != pytest.approx(1e-4 * abs(force), rel=1e-4, abs=0)


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
    """p, q, φ (21, 3) of the same waves in the exact lattice, stepped with LAMMPS's rule and step, until τ = 10."""
    stepped_waves = stepped([wave_of(record) for record in crystal.values()], 25, records=20)
    return dict(zip(crystal, stepped_waves, strict=True))


@pytest.mark.parametrize("cycles", CYCLES)
def test_the_second_harmonic_in_lammps_is_that_of_theory(
    cycles: int, crystal: dict[int, Record], by_verlet: dict[int, np.ndarray]
) -> None:
    record = crystal[cycles]
    wave = wave_of(record)
    assert wave.contact.adhesion_law == "jkr"
    stepped = np.array(by_verlet[cycles])
    first = (getattr(record, name)[: len(stepped)] for name in ("p", "q", "phi"))
    off = [np.abs(values - stepped[:, part]).max() for part, values in enumerate(first)]
    # Both step alike, and round differently; the law of the noise is good to a factor of 3, the largest sample is 3 σ
    assert max(off) < 9 * noise_floor(record.scene)
    # Of second order in a = 0.03 and in the step, (Ωτh)², with factors of order 1 by the waves that beat
    assert abs(point(record).deviation) < 2e-3
    another = Wave.of_mode("TR", wave.mode.wavenumber, wave.amplitude, replace(wave.contact, adhesion_law="dmt"))
    assert relative_error(record.p, torus(another, record.tau)[0]) > 0.05  # the other law is seen


def test_the_figure_takes_the_runs_of_a_law_and_finds_resonance_and_antiresonance(
    crystal: dict[int, Record], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # An antiresonance is located by eight runs beyond the resonance, a pole: 0.13 apart
    between = {"packing_rows": 48, "time_duration": 20.0, "time_timestep": 0.05}
    more = [waves(tmp_path / str(each), each, **between) for each in (7.5, 8.5, 9.5, 10.5)]
    more.append(waves(tmp_path / "9", 9, **between | {"packing_rows": 24}))
    groups = figure.by_law([*crystal.values(), *more])
    lines = figure.table(groups).splitlines()
    assert list(groups) == ["jkr"]
    # Both within three of their standard errors, which are those of polynomials of degree 4
    for name, known, resolved in (("resonance", 1.3083, 0.02), ("antiresonance", 2.5337, 2e-3)):
        (line,) = (line for line in lines if line.split()[1:2] == [name])
        place, error = re.findall(r"[\d.e+-]+", line.partition(name)[2])[:2]
        assert float(error) < resolved
        assert abs(float(place) - known) < 3 * float(error)
    monkeypatch.setattr(figure, "POINTS", 4)  # the lines of the theory take 3 s
    assert len(figure.draw(groups).axes) == 4
    other = run_of_another(crystal[4])
    with pytest.raises(ValueError, match="all runs must have the same crystal"):
        figure.by_law([crystal[3], other])


def run_of_another(record: Record) -> Record:
    """The same record, as if it were of spheres with another ratio."""
    return replace(record, scene=record.scene.with_values({"sphere.poisson_ratio": 0.2}))


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
    assert not held.info["effects"]["contact_opening"]["called_for"]
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


def test_theories_that_leave_the_law_out_refuse_it_by_name(tmp_path: Path) -> None:
    record = waves(tmp_path / "run", 4, output_particles=10.0)
    wave = wave_of(record)
    assert holding(wave) == list(THEORIES)
    for name, held in catalogue.HOLDS.items():
        assert (catalogue.JKR in held) != (catalogue.JKR in catalogue.missing(name, traits(wave)))
    assert all(catalogue.JKR not in held for held in FORMS.values())
    # Two theories, of a plane wave and of all spheres, in D0: each step is integrated to 1e-9, and some dozens add up
    network, lattice = Reference.named("network", record, wave).signals, trajectory("exact-lattice", wave, record.tau)
    assert network is not None
    for own, other in zip(network, lattice, strict=True):
        assert np.abs(own - other).max() < 1e-7
    assert point(record).deviation == pytest.approx(0, abs=0.01)  # second order in a: 0.03² times a few, and the step
