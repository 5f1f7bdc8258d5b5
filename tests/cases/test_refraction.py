"""Fronts at an interface of two hexagonal crystals: theory, measurement, and LAMMPS beside them."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.refraction import case as figure
from cases.refraction import plane_front as settling
from cases.refraction.angles import ROWS, angle, quasi_particle
from cases.refraction.plane_front import scaled_speed
from cases.refraction.refraction import fronts_at_interface, plane_front
from cases.solitary import scattering
from cases.solitary.chain import compressed, uniform
from cases.solitary.chain_motion import march
from granular_lmp import ImpactRecord, ImpactScene, run_impact

SCENE = ImpactScene.load("refraction")
settled = cache(settling.plane_front)


def front_speed(height: float) -> float:
    """Return the speed of a plane front along y, diameters per unit of time: that of the chain of rows."""
    return float(np.sqrt(0.75) * 0.9074700784 * ROWS**0.4 * height**0.2)


# --- theory -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("mass", "incidence"), [(2.0, 0.0), (4.0, 40.0), (0.5, 30.0), (1.0, 60.0)])
def test_quasi_particles_keep_energy_and_the_trace_of_the_front(mass: float, incidence: float) -> None:
    found = quasi_particle(mass, incidence)
    incoming, beyond = np.cos(np.radians([incidence, found.transmitted]))
    passed = mass * found.height**2 * beyond / incoming
    assert passed == pytest.approx(4 * mass / (1 + mass) ** 2, rel=1e-12)
    assert found.transmitted == pytest.approx(angle(incidence, mass, found.height), abs=1e-9)
    if mass > 1:
        back = found.height_back**2 * np.cos(np.radians(found.reflected)) / incoming
        assert passed + back == pytest.approx(1, rel=1e-12)
        assert found.reflected == pytest.approx(angle(incidence, 1.0, found.height_back, reflected=True), abs=1e-9)
    if incidence == 0:  # momentum: 1 = M v_t − v_r
        assert mass * found.height - found.height_back == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize(("a", "b"), [(2, 1), (5, 3), (3, 2), (4, 3), (5, 4), (1, 1)])
def test_a_plane_front_is_faster_the_nearer_its_way_is_to_a_row_of_contacts(a: int, b: int) -> None:
    found = settled(a, b)
    # The series has the table to 3e-4; at half of the step, and over 60 diameters, the front changes by as much
    assert found.scaled_speed == pytest.approx(scaled_speed(found.degrees), abs=6e-4)
    assert found.scaled_speed != pytest.approx(scaled_speed(found.degrees + 8.0), abs=6e-4)
    for turned in (found.degrees + 60.0, -found.degrees, found.degrees + 240.0):
        assert scaled_speed(turned) == pytest.approx(scaled_speed(found.degrees), rel=1e-12)


def test_across_the_rows_a_plane_front_is_the_wave_of_the_chain_of_rows() -> None:
    # It is settled to 1e-6; the step of 0.04 makes waves too fast by (ω h)²/24, 9e-5 for a pulse of 3
    assert settled(1, 1).scaled_speed == pytest.approx(front_speed(1.0), rel=2e-4)
    assert scaled_speed(90.0) == pytest.approx(front_speed(1.0), abs=3e-4)  # of the series
    assert settled(2, 1).scaled_speed / front_speed(1.0) == pytest.approx(1.035, abs=5e-4)


def test_in_a_sheet_of_one_mass_a_front_of_the_same_height_is_not_refracted() -> None:
    assert angle(37.0, 1.0, 1.0) == pytest.approx(37.0, abs=1e-9)
    # Thrown back with all of its height along a row of contacts it is 3.5 % faster, and leaves at a wider angle
    wider = angle(45.0, 1.0, 1.0, reflected=True)
    assert np.sin(np.radians(wider)) / np.sin(np.radians(45.0)) == pytest.approx(
        scaled_speed(wider + 315) / 0.8981, 1e-3
    )
    assert wider > 45.5


@pytest.mark.parametrize(("mass", "transmitted"), [(4.0, 0.71570), (2.0, 0.92645), (0.5, 1.0)])
def test_the_shares_of_an_interface(mass: float, transmitted: float) -> None:
    found = scattering.interface(mass)
    # Half of the step changes the shares by less than 1e-6
    assert found.transmitted == pytest.approx(transmitted, abs=5e-6)
    assert found.transmitted + found.reflected == pytest.approx(1, abs=5e-6)
    rule = quasi_particle(mass)
    # The rule is one of thumb: momentum beyond within 2 %, and the first wave within 6 %
    assert found.velocity == pytest.approx(rule.height, rel=0.06)
    if mass > 1:
        assert found.momentum == pytest.approx(2 * mass / (1 + mass), rel=0.02)
        assert 0.75 * rule.height_back < found.velocity_back < rule.height_back
    else:
        assert found.momentum == pytest.approx(1, abs=2e-3)
        assert found.velocity_back == 0
    assert found.velocity != pytest.approx(quasi_particle(1.5 * mass).height, rel=0.06)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: quasi_particle(20.0), "mass must be from 0.1 to 10, not 20"),
        (lambda: quasi_particle(2.0, 90.0), "incidence must be at least 0 and below 90 degrees, not 90"),
        (lambda: quasi_particle(0.5, 40.0), "an incidence of 40 degrees is beyond the critical angle of the mass 0.5"),
        (lambda: settled(3, 1), "places must be a > 0 and b from a/2 to a, not 3 and 1"),
        (lambda: scattering.interface(0.05), "mass must be from 0.1 to 10 times that of a sphere"),
    ],
)
def test_what_has_no_answer_is_refused(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        call()


PAGE = (Path(__file__).parents[2] / "analysis/cases/refraction/README.md").read_text("utf-8")


def numbers(row: str) -> list[float]:
    """Return the numbers of a row of a table; nan for a cell without one."""
    cells = [
        cell.strip().rstrip("°").replace("1/2", "0.5").replace("1/4", "0.25") for cell in row.strip("| ").split("|")
    ]
    return [float(cell) if re.fullmatch(r"[\d.]+", cell) else np.nan for cell in cells]


def test_the_page_has_angles_and_heights_of_the_law_and_the_rule() -> None:
    rows = [numbers(row) for row in re.findall(r"^\| (?:[24]|1/[24]) \| \d+° \|.*$", PAGE, re.MULTILINE)]
    assert len(rows) == 13
    for mass, incidence, through, law, by_rule, height, rule_height, back, law_back, height_back in (
        row + [np.nan] * (10 - len(row)) for row in rows
    ):
        # As many digits as are printed, rounded twice, also of the height that the law takes
        assert law == pytest.approx(angle(incidence, mass, height), abs=0.03)
        rule = quasi_particle(mass, incidence)
        assert by_rule == pytest.approx(rule.transmitted, abs=0.011)
        assert rule_height == pytest.approx(rule.height, abs=0.0011)
        assert abs(through - law) < (0.4 if (mass, incidence) == (4, 60) else 0.15)
        if np.isfinite(back):
            assert law_back == pytest.approx(angle(incidence, 1.0, height_back, reflected=True), abs=0.08)
            assert back - law_back == pytest.approx({45.0: 1.2, 60.0: 1.9}.get(incidence, 0.0), abs=0.4)


def test_the_page_has_the_speed_in_each_direction_and_the_critical_angle() -> None:
    degrees, speeds = (numbers(re.search(rf"^\| {name} \|.*$", PAGE, re.MULTILINE)[0])[1:] for name in ("φ", r"\*C\*"))
    assert speeds == pytest.approx([scaled_speed(each) for each in degrees], abs=3.5e-4)
    critical = float(re.search(r"critical angle\*\* of the rule for \*M\* = 1/2 is ([\d.]+)°", PAGE)[1])
    assert quasi_particle(0.5, critical - 0.1).transmitted < 90
    with pytest.raises(ValueError, match="beyond the critical angle"):
        quasi_particle(0.5, critical + 0.1)


# --- measurement ------------------------------------------------------------------------------------------------------


def passing(direction: float, speed: float, places: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return a pulse (T, n) of height 0.5 that passes the places as a plane front."""
    way = places @ np.array([np.cos(np.radians(direction)), np.sin(np.radians(direction))])
    return 0.5 / np.cosh(times[:, None] - 10 - way / speed) ** 2


def test_a_plane_front_has_its_direction_and_speed() -> None:
    places, times = np.random.default_rng(1).uniform(0, 4, (30, 2)), np.arange(0.0, 30.0, 0.4)
    found = plane_front(times, passing(110.0, 0.6, places, times), places)
    # The polynomial through nine samples of 0.4 has the crest to 1e-4
    assert found.direction == pytest.approx(110.0, abs=0.02)
    assert found.speed == pytest.approx(0.6, rel=1e-3)
    assert found.height == pytest.approx(0.5, abs=1e-3)
    assert max(found.spread, found.late) < 1e-3
    assert plane_front(times, passing(111.0, 0.6, places, times), places).direction != pytest.approx(110, abs=0.5)


def test_angles_are_from_the_normal_of_the_interface() -> None:
    places, times = np.mgrid[-9:9.5, -9:9.5].reshape(2, -1).T, np.arange(0.0, 80.0, 0.4)
    beyond = places @ np.array([-np.sin(np.pi / 6), np.cos(np.pi / 6)]) > 0
    velocity = np.zeros((len(times), len(places), 2))
    velocity[:, ~beyond, 1] = passing(90.0, 0.8, places, times)[:, ~beyond]
    own = np.array([np.cos(np.radians(-40.0)), np.sin(np.radians(-40.0))])
    velocity[:, ~beyond] += 0.5 * np.roll(passing(-40.0, 0.8, places, times), 75, axis=0)[:, ~beyond, None] * own
    velocity[:, beyond, 1] = passing(102.0, 0.8, places, times)[:, beyond]
    found = fronts_at_interface(times, velocity, places, np.zeros(2), 30.0, heavier=True)
    # Directions of 90° and −40°, and of 102° beyond, from the normal at 120° and from −60°
    assert found.angles == pytest.approx((18.0, 20.0), abs=0.05)
    assert found.incident.direction == pytest.approx(90.0, abs=0.05)
    # Along its own way; its component along the normal is lower by cos 20°, 6 %
    assert found.reflected is not None
    assert found.reflected.height == pytest.approx(0.25, rel=2e-3)
    assert fronts_at_interface(times, velocity, places, np.zeros(2), 30.0, heavier=False).reflected is None
    # Crests of every second sphere 2 t0 later are no plane
    velocity[:, ~beyond & (np.arange(len(places)) % 2 == 0)] = np.roll(velocity, 5, axis=0)[
        :, ~beyond & (np.arange(len(places)) % 2 == 0)
    ]
    assert fronts_at_interface(times, velocity, places, np.zeros(2), 30.0, heavier=True).reflected is None


def test_too_few_spheres_and_a_line_of_them_are_refused() -> None:
    places, times = np.column_stack([np.arange(20.0), np.zeros(20)]), np.arange(0.0, 60.0, 0.4)
    signal = passing(0.0, 0.8, places, times)
    with pytest.raises(ValueError, match="must not lie on one line"):
        plane_front(times, signal, places)
    with pytest.raises(ValueError, match="the front has passed 11 of 20 spheres; must be at least 12"):
        plane_front(times, signal * (np.arange(20) < 11), places)


# --- LAMMPS -----------------------------------------------------------------------------------------------------------


def test_a_front_across_the_rows_is_a_wave_in_a_chain(tmp_path: Path) -> None:
    changes = {"packing.rows": 40, "packing.columns": 3, "inclusion.1.half_plane": [20, 1, 0.0]}
    changes |= {"striker.1.velocity": 1e-3, "time.duration": 40.0, "time.sample": 4.0}
    record = run_impact(SCENE.with_values(changes), tmp_path / "run")
    mass = np.where(np.arange(40) < 20, 1.0, 2.0)
    chain = compressed(mass, ROWS * uniform(40).stiffness)
    v = np.eye(40)[0]
    _, expected = march(chain, 0 * v, v, 0.05, 800, every=80)
    found = record.velocity.reshape(-1, 40, 3, 2)
    # Contacts turn by their overlap over the diameter, 6e-6 at 1 mm/s
    assert found[1:, :, 1, 1] == pytest.approx(expected, abs=2e-5)
    assert found[..., 1] == pytest.approx(found[..., [1, 1, 1], 1], abs=1e-9)
    _, other = march(compressed(mass, 1.01 * chain.stiffness), 0 * v, v, 0.05, 800, every=80)
    assert np.max(np.abs(found[1:, :, 1, 1] - other)) > 1e-3


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> ImpactRecord:
    """The shipped scene with its interface ten rows nearer, in half of its steps, until the fronts have passed."""
    nearer = {"packing.rows": 46, "inclusion.1.half_plane": [26.0, 20.0, 30.0], "output.rows": [14, 38]}
    scene = SCENE.with_values(nearer | {"time.duration": 58.0, "time.timestep": 0.1})
    return run_impact(scene, tmp_path_factory.mktemp("refraction") / "run")


@pytest.fixture(scope="module")
def measured(run: ImpactRecord) -> Any:
    return figure.measured(run)


def test_a_front_is_refracted_by_the_law_of_angles(measured: Any) -> None:
    mass, found = measured
    assert (mass, found.incidence) == (2.0, 30.0)
    through, back = found.angles
    height = found.transmitted.height / found.incident.height
    # Before the interface the exact wave, whose height is 0.6816 and whose contacts overlap by 0.3 % of the diameter
    assert found.incident.direction == pytest.approx(90.0, abs=0.01)
    assert found.incident.height == pytest.approx(0.6816, rel=2e-3)
    assert found.incident.speed == pytest.approx(front_speed(found.incident.height), rel=2e-3)
    # Measured: 20.39° beyond, where the law of the measured heights has 20.43° and the rule 20.49°; with one speed in
    # all directions the law would have 20.23°. Crests are up to 0.03 t0 off a plane of 16 diameters
    assert through == pytest.approx(angle(30.0, mass, height), abs=0.1)
    rule = quasi_particle(mass, 30.0)
    assert through == pytest.approx(rule.transmitted, abs=0.3)
    assert height == pytest.approx(rule.height, rel=0.03)
    # The front that comes back is 0.12 t0 late or early, and its angle good to a degree
    assert found.reflected is not None
    returning = found.reflected.height / found.incident.height
    assert back == pytest.approx(angle(30.0, 1.0, returning, reflected=True), abs=1.0)
    assert back < 25.0


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_is_drawn_with_a_table(
    run: ImpactRecord,
    measured: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(figure, "MASSES", np.array([0.5, 2.0]))
    monkeypatch.setattr(figure, "ANGLES", np.linspace(0.0, 60.0, 7))
    monkeypatch.setattr(figure, "measured", lambda record: {run.folder: measured}[record.folder])
    assert figure.main([str(run.folder), "-o", str(tmp_path / "refraction.png")]) == 0
    assert (tmp_path / "refraction.png").stat().st_size > 10_000
    assert re.search(r"^ +2 +30\.0 +20\.\d+ +20\.\d+ +20\.49", capsys.readouterr().out, re.MULTILINE)


@pytest.mark.parametrize(
    "changes",
    [
        {"packing.lattice": "square"},
        {"striker.1.rows": [0, 1]},
        {"inclusion.1.youngs_modulus": 7e10},
        {"inclusion": [{"rows": [30, 63], "density": 9000.0}]},
    ],
)
def test_a_run_without_such_an_interface_is_refused(tmp_path: Path, changes: dict[str, object]) -> None:
    scene = SCENE.with_values({"time.duration": 0.5, "output.rows": [0, 1]} | changes)
    with pytest.raises(ValueError, match="must be a hexagonal sheet that its first row strikes, with one inclusion"):
        figure.measured(run_impact(scene, tmp_path / "run"))
