"""Impacts in LAMMPS through their scenes, against theories that share no code with them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory.chain import Chain, End, compressed, energies, spheres, uniform
from granular_analysis.theory.chain_motion import first_peak, march, peak
from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import start
from granular_analysis.theory.scattering import Meeting, crossing, impurity
from granular_analysis.theory.solitary import solitary_wave
from granular_lmp import ImpactRecord, ImpactScene, Scene, run_impact
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import EffectError, RunFolderError, SceneError
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.outputs import RunLog
from granular_lmp.problem import prepare
from granular_lmp.runs.manifest import description, lacking, outcome
from tests.conftest import members
from tests.manual import Measure, Mutant, verifies

Runs = Callable[..., ImpactRecord]
CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.last": "free"})
SHEET = ImpactScene.load("point_impact")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Runs of a scene with values changed and tables of inclusions, each in a folder of its own."""

    def make(
        scene: ImpactScene, changes: dict[str, Any], inclusions: list[dict[str, Any]] | None = None
    ) -> ImpactRecord:
        scene = scene.with_values(changes)
        if inclusions:
            scene = ImpactScene.from_dict(scene.to_dict() | {"inclusion": inclusions})
        return run_impact(scene, tmp_path_factory.mktemp("impact") / "run")

    return make


# --- the solitary wave ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pair(run: Runs) -> tuple[ImpactRecord, ImpactRecord]:
    """The wave with the steps 0.05 and 0.025, recorded at the spheres 40 and 50."""
    shared = {"time.duration": 66.0, "time.sample": 0.05, "output.spheres": [[40, 0], [50, 0]]}
    coarse, fine = (run(CHAIN, shared | {"time.timestep": step}) for step in (0.05, 0.025))
    return coarse, fine


def speed_and_height(tau: np.ndarray, velocity: np.ndarray) -> tuple[float, float]:
    """Speed, spheres per t0, and largest velocity of a wave from its velocities (T, 2) at spheres ten apart."""
    (height, first), (_, second) = (peak(tau, each) for each in velocity.T)
    return 10 / (second - first), height


@verifies(
    "Solitary wave in LAMMPS: speed and height in a struck chain, step extrapolated",
    reference="other integrator: the travelling-wave equation, 0.84050877 and 0.68163155",
    tolerance=1e-05,
    reason="a sixteenth of 1e-4, the difference of the pair of steps",
    mutant=Mutant(
        "granular_lmp/lammps/contact.py",
        'force = f"hertz/material {modulus!r} ',
        'force = f"hertz/material {1.001 * modulus!r} ',
    ),
)
def test_a_struck_chain_carries_the_solitary_wave(pair: tuple[ImpactRecord, ImpactRecord], measured: Measure) -> None:
    coarse, fine = pair
    values = [np.array(speed_and_height(each.tau, each.velocity[:, :, 1])) for each in pair]
    speed, height = (4 * values[1] - values[0]) / 3
    # Higher orders of the step are left: a sixteenth of 1e-4, the difference of the pair
    measured(speed - 0.84050877)
    measured(height - 0.68163155)
    assert speed / height**0.2 == pytest.approx(0.907470078, abs=1e-5)
    assert values[0][0] / values[0][1] ** 0.2 != pytest.approx(0.907470078, abs=5e-5)  # what one run of 0.05 has
    # In metres and seconds, with the constants of steel spheres: V = 0.907470 (A/m)^{2/5} v^{1/5} 2R
    ball, scale = coarse.scene.sphere, coarse.scale
    rate = (ball.normal_coefficient / ball.mass) ** 0.4 * (height * scale.velocity) ** 0.2
    assert speed / scale.time == pytest.approx(0.907470078 * rate, rel=1e-5)


def test_the_wave_has_the_shape_of_the_travelling_wave_equation(pair: tuple[ImpactRecord, ImpactRecord]) -> None:
    coarse, fine = pair
    velocity = (4 * fine.velocity[:, 0, 1] - coarse.velocity[:, 0, 1]) / 3
    _, moment = peak(coarse.tau, velocity)
    wave = solitary_wave(0.84050877)
    exact = wave.at(wave.speed * (coarse.tau - moment))[1]
    near = np.abs(coarse.tau - moment) < 4
    # The fourth order of the step is left, 0.05⁴ = 6e-6 times derivatives of order 1
    assert np.max(np.abs(velocity - exact)[near]) < 1e-5
    assert np.max(np.abs(velocity - 1.01 * exact)[near]) > 5e-3


# --- chains -----------------------------------------------------------------------------------------------------------


def model(last: End, count: int = 20) -> Chain:
    """The chain of the theory in the units of the impact: spheres of R = m = 1, A over that of two of them."""
    balls = spheres(np.ones(count), 1 / (4 / 3 * np.pi), 1.0, 0.0, ends=("free", last))
    return compressed(balls.mass, balls.stiffness / balls.stiffness[1])


@pytest.mark.parametrize("last", ["free", "held", "wall"])
def test_a_chain_moves_as_velocity_verlet_moves_it(run: Runs, last: End) -> None:
    record = run(
        CHAIN,
        {"packing.rows": 20, "packing.last": last} | {"time.timestep": 0.1, "time.sample": 0.5, "time.duration": 60.0},
    )
    v = np.eye(20)[0]
    u, v = march(model(last), 0 * v, v, 0.1, 600, every=5)
    # Positions of 4e3 ℓ carry 5e-13, summed over 600 steps of accelerations of order 1
    assert record.velocity[1:, :, 1] == pytest.approx(v, abs=1e-8)
    assert record.displacement[1:, :, 1] == pytest.approx(u, abs=1e-7)
    assert not record.velocity[..., 0].any()
    assert np.max(np.abs(record.velocity[1:, :, 1] - 1.001 * v)) > 5e-4
    if last != "free":  # thrown back
        assert record.velocity[-1, 0, 1] < -0.9


@pytest.mark.parametrize("velocity", [1e-6, 1e-3, 1e2])
def test_a_striker_of_any_velocity_makes_the_same_wave(run: Runs, velocity: float) -> None:
    record = run(
        CHAIN,
        {"packing.rows": 20, "striker.1.velocity": velocity}
        | {"time.timestep": 0.1, "time.sample": 10.0, "time.duration": 10.0},
    )
    v = np.eye(20)[0]
    _, (expected,) = march(uniform(20), 0 * v, v, 0.1, 100)
    # The rounding of positions over the overlaps, 20 R 1e-16/ℓ, summed over 100 steps as it comes, with 10 to spare
    allowed = 10 * 100 * 20 * 1.1e-16 / (record.scale.length / record.scene.sphere.radius)
    assert record.velocity[-1, :, 1] == pytest.approx(expected, abs=allowed)
    assert np.max(np.abs(record.velocity[-1, :, 1] - 1.001 * expected)) > 2e-4
    # V ∝ v^{1/5}: the same number of spheres in a time t0 ∝ v^{-1/5}
    assert record.scale.time * velocity**0.2 == pytest.approx(CHAIN.scale.time, rel=1e-12)


def test_a_wall_throws_the_wave_back_as_two_waves_meet_at_a_contact(run: Runs) -> None:
    record = run(
        CHAIN,
        {"packing.rows": 45, "packing.last": "wall", "output.spheres": [[25, 0]]}
        | {"time.duration": 90.0, "time.sample": 0.05, "time.timestep": 0.05},
    )
    forth, back = (peak(record.tau, sign * record.velocity[:, 0, 1])[0] for sign in (1, -1))
    # Steps of 0.05 shift velocities by 1e-5, at both passages alike
    assert back / forth == pytest.approx(crossing("contact").velocity, abs=5e-5)
    assert back / forth != pytest.approx(crossing("sphere").velocity, abs=5e-4)


@pytest.mark.parametrize(("count", "meeting"), [pytest.param(200, "contact", marks=pytest.mark.more), (201, "sphere")])
def test_two_waves_that_collide_are_ahead_and_lower_as_the_theory_says(
    tmp_path: Path, count: int, meeting: Meeting
) -> None:
    # Watched where the secondary waves are left behind, and far from the wake of the other striker
    watched = np.array([count // 2 + 28, count // 2 + 43])
    changes = {"packing.rows": count, "time.timestep": 0.05, "time.sample": 0.1, "time.duration": 190.0}
    alone = CHAIN.with_values(changes | {"output.spheres": [[int(sphere), 0] for sphere in watched]})
    other = {"rows": [count - 1, count - 1], "velocity": 1.0, "direction": "-y"}
    both = ImpactScene.from_dict(alone.to_dict() | {"striker": [*alone.to_dict()["striker"], other]})
    heights, times = np.zeros((2, 2)), np.zeros((2, 2))
    for number, scene in enumerate((alone, both)):
        record = run_impact(scene, tmp_path / str(number))
        for each in (0, 1):
            heights[number, each], times[number, each] = first_peak(record.tau, record.velocity[:, each, 1], 0.1)
    found = crossing(meeting)
    assert heights[1, 1] / heights[0, 1] == pytest.approx(found.velocity, abs=1e-5)  # a wave made by a striker
    # Each on its line back to the middle: the wave alone gives the moment, the other wave its place then
    speed, faster = np.diff(watched) / np.diff(times, axis=1).ravel()
    moment = times[0, 1] - (watched[1] - (count - 1) / 2) / speed
    lead = watched[1] - faster * (times[1, 1] - moment) - (count - 1) / 2
    assert lead == pytest.approx(found.lead, abs=5e-4)  # steps of 0.05 have 4e-4, and of half of it 2e-4
    wrong = crossing("sphere" if meeting == "contact" else "contact")
    assert lead != pytest.approx(wrong.lead, abs=2e-3)


@pytest.mark.parametrize("mass", members([0.125, 2.0], 2.0))
def test_an_impurity_passes_and_throws_back_its_shares(run: Runs, mass: float) -> None:
    place, density = 45, CHAIN.sphere.density
    record = run(
        CHAIN,
        {"packing.rows": 100, "time.timestep": 0.05, "time.sample": 100.0, "time.duration": 100.0},
        [{"spheres": [[place, 0]], "density": mass * density}],
    )
    chain = uniform(100)
    masses = np.where(np.arange(100) == place, mass, 1.0)
    found = energies(compressed(masses, chain.stiffness), record.displacement[-1, :, 1], record.velocity[-1, :, 1])
    wave = solitary_wave(0.84050877)
    incoming = energies(chain, *wave.start(100, 30.0)).sum()
    expected = impurity(mass)
    # The same number of spheres counts as its place; steps of 0.05 move shares by their 1e-4
    assert found[place + 6 :].sum() / incoming == pytest.approx(expected.transmitted, abs=3e-4)
    assert expected.transmitted != pytest.approx(impurity(2 * mass).transmitted, abs=3e-3)


def test_a_chain_of_unequal_spheres_has_the_forces_of_the_theory(run: Runs) -> None:
    record = run(
        CHAIN,
        {"packing.rows": 12, "time.timestep": 0.05, "time.sample": 1.0, "time.duration": 20.0},
        [{"spheres": [[4, 0]], "radius": 8e-3}, {"spheres": [[7, 0]], "youngs_modulus": 70e9, "density": 2700.0}],
    )
    radius, density, modulus = np.full(12, 5e-3), np.full(12, 7800.0), np.full(12, 200e9)
    radius[4], density[7], modulus[7] = 8e-3, 2700.0, 70e9
    chain, scale = spheres(radius, density, modulus, 0.3), record.scale
    v = np.eye(12)[0]
    u, v = march(chain, 0 * v, v, record.scene.time.step * scale.time, 400, every=20)
    # The rounding of positions, as for equal spheres
    assert record.velocity[1:, :, 1] == pytest.approx(v / scale.velocity, abs=1e-8)
    assert record.energy() == pytest.approx(0.5, abs=2e-4)  # velocity Verlet at T/50


# --- sheets -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("friction", "sides", "steps", "allowed"),
    [
        # Left of the step: its fourth order, and events of order 5/2, each some percent of the 4e-5 of the finer run
        (0.0, "free", (0.04, 0.02), 4e-6),
        (0.0, "cell", (0.04, 0.02), 4e-6),
        # Sliding begins and ends inside steps, an error of first order: 2e-4 at 0.02 (secant law: 2.5e-5)
        (0.3, "periodic", (0.04, 0.02), 5e-4),
    ],
)
def test_a_sheet_moves_as_the_network_does(
    run: Runs, friction: float, sides: str, steps: tuple[float, float], allowed: float
) -> None:
    changes = {"packing.rows": 7, "packing.columns": 7, "striker.1.spheres": [[0, 3]], "packing.sides": sides}
    if cell := sides == "cell":
        changes |= {"packing.rows": 8, "packing.sides": "periodic", "packing.ends": "periodic"}
    changes |= {"effects.friction": friction, "time.duration": 6.0, "time.sample": 6.0}
    coarse, fine = (run(SHEET, changes | {"time.timestep": step}) for step in steps)
    ball, scale, crystal = fine.scene.sphere, fine.scale, fine.problem.crystal
    network = Network(
        crystal.positions[:, :2] * ball.radius,
        np.full(len(crystal), ball.radius),
        np.full(len(crystal), ball.density),
        (Material(ball.youngs_modulus, ball.poisson_ratio),),
        cell=(
            crystal.cell[0, 0] * ball.radius if sides != "free" else np.inf,
            8 * np.sqrt(3) * ball.radius if cell else np.inf,
        ),
        law="incremental",
        friction=friction,
    )
    v = np.zeros((len(crystal), 2))
    v[3, 1] = scale.velocity
    longest = scale.time / (10 if friction else 5)  # sliding is resolved to second order in the step
    expected = integrate(network, start(network, 0.0, v), [6 * scale.time], rtol=1e-9, longest_step=longest)
    velocity = (4 * fine.velocity[-1] - coarse.velocity[-1]) / 3 if not friction else fine.velocity[-1]
    assert velocity == pytest.approx(expected.velocity[-1] / scale.velocity, abs=allowed)
    assert np.max(np.abs(velocity)) > 0.2
    spin = expected.motion[-1, 5] * ball.radius / scale.velocity
    assert fine.spin[-1] == pytest.approx(spin, abs=allowed)
    assert (np.max(np.abs(spin)) > 0.02) == (friction > 0)


@pytest.mark.more  # two materials stand in test_mixed_with_network, vacancies in test_strikes_at_rest
def test_a_sheet_of_two_materials_with_vacancies_moves_as_the_network_does(run: Runs) -> None:
    inclusions = [
        {"spheres": [[3, 4], [5, 2]], "density": 1000.0},
        {"rows": [4, 7], "youngs_modulus": 70e9, "poisson_ratio": 0.33, "density": 2700.0},
        {"spheres": [[2, 4]], "vacancy": True},
    ]
    changes = {"packing.rows": 8, "packing.columns": 9, "striker.1.spheres": [[0, 4]], "disorder.density": 0.1}
    changes |= {"time.duration": 6.0, "time.sample": 6.0}
    coarse, fine = (run(SHEET, changes | {"time.timestep": step}, inclusions) for step in (0.04, 0.02))
    ball, scale, crystal = fine.scene.sphere, fine.scale, fine.problem.crystal
    network = Network(
        crystal.positions[:, :2] * ball.radius,
        np.full(len(crystal), ball.radius),
        crystal.arrays["density"],
        (Material(200e9, 0.3), Material(70e9, 0.33)),
        kind=crystal.arrays["material"],
        friction=0.0,
    )
    assert len(crystal) == 71
    v = np.zeros((len(crystal), 2))
    v[4, 1] = scale.velocity
    expected = integrate(
        network, start(network, 0.0, v), [6 * scale.time], rtol=1e-9, longest_step=scale.time / 5
    ).velocity[-1]
    velocity = (4 * fine.velocity[-1] - coarse.velocity[-1]) / 3
    # What is left of the step, as in a sheet of equal spheres
    assert velocity == pytest.approx(expected / scale.velocity, abs=8e-6)
    assert np.max(np.abs(velocity - 1.001 * expected / scale.velocity)) > 1e-4


@pytest.mark.parametrize(("wall", "reach"), [(False, 0.5), (True, 1.0)], ids=["two spheres", "on a wall"])
def test_spheres_that_meet_roll_as_the_spring_of_their_contact_says(tmp_path: Path, wall: bool, reach: float) -> None:
    """Two spheres that turn against each other, or one on a wall: ω² = k_r Rc²/I times the number of them."""
    radius, stiffness = 5e-7, 20.0
    sphere = Sphere(radius, 73e9, 0.17, 0.063, 2200.0)
    overlap = sphere.unpressed_overlap
    state = [[0, 0, 0.0, overlap if wall else 0.0, 0.0, 0.0, 1e3]]
    state += [] if wall else [[1, 0, 0.0, -overlap, 0.0, 0.0, -1e3]]
    rate = reach * radius * np.sqrt(len(state) * stiffness / (0.4 * sphere.mass * radius**2))
    tables: dict[str, Any] = {
        "sphere": {"radius": radius, "youngs_modulus": 73e9, "poisson_ratio": 0.17, "density": 2200.0}
        | {"work_of_adhesion": 0.063},
        "packing": {"lattice": "square", "rows": len(state), "last": "wall" if wall else "free"},
        "start": {"state": state, "touching": True},
        "effects": {"friction": 1e-13, "rolling_stiffness": stiffness, "rolling_friction": 50.0},  # shear is nothing
        "time": {"duration": 1.0, "timestep": 0.001, "sample": 0.01},
    }
    scene = Scene.from_dict(tables)
    period = 2 * np.pi / (rate * scene.scale.time)
    errors = []
    for steps in (200, 400):
        time = {"time.sample": period / 20, "time.duration": 3 * period, "time.timestep": period / steps}
        spin = run_impact(scene.with_values(time), tmp_path / str(steps)).spin
        expected = np.cos(2 * np.pi * np.arange(len(spin)) / 20)
        errors.append(np.max(np.abs(spin[:, 0] / spin[0, 0] - expected)))
    assert errors[1] < 2e-4  # (ωh)²/24 of a period, over three periods
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.02)


def test_smaller_spheres_leave_gaps_in_a_sheet_which_moves_as_the_network_does(run: Runs) -> None:
    inclusions = [{"spheres": [[3, 3]], "radius": 0.004998}, {"spheres": [[4, 2]], "radius": 0.0049, "density": 4000.0}]
    changes = {"packing.rows": 8, "packing.columns": 7, "striker.1.spheres": [[0, 3]], "time.duration": 12.0}
    record = run(SHEET, changes | {"time.sample": 12.0, "time.timestep": 0.005}, inclusions)
    ball, scale, crystal = record.scene.sphere, record.scale, record.problem.crystal
    radius = np.full(len(crystal), ball.radius)
    radius[[3 * 7 + 3, 4 * 7 + 2]] = 0.004998, 0.0049
    density = np.where(radius == 0.0049, 4000.0, ball.density)
    position = crystal.positions[:, :2] * ball.radius
    material = Material(ball.youngs_modulus, ball.poisson_ratio)
    network = Network(position, radius, density, (material,), friction=0.0)
    v = np.zeros((len(crystal), 2))
    v[3, 1] = scale.velocity
    longest = scale.time / 5
    expected = integrate(network, start(network, 0.0, v), [12 * scale.time], rtol=1e-9, longest_step=longest).velocity
    # The second order of the step: four times as much at 0.01
    assert record.velocity[-1] == pytest.approx(expected[-1] / scale.velocity, abs=2e-5)
    assert abs(record.velocity[-1, 3 * 7 + 3]).max() > 0.01
    equal = Network(position, np.full(len(crystal), ball.radius), density, (material,), friction=0.0)
    wrong = integrate(equal, start(equal, 0.0, v), [12 * scale.time], rtol=1e-9, longest_step=longest).velocity
    assert np.max(np.abs(record.velocity[-1] - wrong[-1] / scale.velocity)) > 1e-2


def test_a_sheet_keeps_energy_momentum_and_mirror_symmetry(run: Runs) -> None:
    changes = {"packing.rows": 15, "packing.columns": 15, "striker.1.spheres": [[0, 7]], "time.duration": 15.0}
    record = run(SHEET, changes | {"time.timestep": 0.02, "packing.sides": "periodic"})
    energy, velocity = record.energy(), record.velocity
    # Velocity Verlet at T/120: 1e-4 of a pulse of one collision's rate
    assert energy == pytest.approx(0.5, abs=1e-4)
    assert velocity.sum(axis=1) == pytest.approx(np.array([0.0, 1.0]) + np.zeros((16, 2)), abs=1e-11)
    # Even rows are symmetric about the column of the striker; what rounding breaks grows as contacts open
    row, column = record.problem.crystal.arrays["row"], record.problem.crystal.arrays["column"]
    sheet = np.zeros((15, 15, 2))
    sheet[row, column] = velocity[-1]
    assert sheet[::2] == pytest.approx(sheet[::2, ::-1] * [-1, 1], abs=1e-8)
    assert np.max(np.abs(sheet[::2] - sheet[::2, ::-1])) > 1e-3


@pytest.mark.parametrize(("restitution", "friction"), [(1.0, 0.0), (1.0, 0.3), (0.7, 0.0)])
def test_a_square_sheet_struck_at_a_point_is_a_chain(restitution: float, friction: float, run: Runs) -> None:
    shared = {"time.duration": 12.0, "time.sample": 1.0, "time.timestep": 0.05, "effects.restitution": restitution}
    square = {"packing.lattice": "square", "packing.columns": 5, "striker.1.spheres": [[0, 2]]}
    sheet = run(SHEET, shared | square | {"packing.rows": 12, "effects.friction": friction})
    chain = run(CHAIN, shared | {"packing.rows": 12})
    in_column = sheet.problem.crystal.arrays["column"] == 2
    # The neighbours beside the column have an overlap of exactly 0, and the same arithmetic moves the spheres in it
    assert sheet.velocity[:, in_column] == pytest.approx(chain.velocity, abs=1e-10)
    assert not sheet.velocity[:, ~in_column].any()


def test_friction_takes_its_part_where_the_corner_of_a_square_sheet_is_struck_at_an_angle(run: Runs) -> None:
    square = {"packing.lattice": "square", "packing.rows": 10, "packing.columns": 10, "striker.1.spheres": [[0, 0]]}
    shared = {"striker.1.direction": 45.0, "time.duration": 12.0, "time.sample": 0.2, "output.spheres": [[7, 0]]}
    smooth, rough, still = (
        np.max(run(SHEET, square | shared | changes).velocity[:, 0, 1])
        for changes in ({}, {"effects.friction": 0.3}, {"effects.friction": 0.3, "effects.rotation": False})
    )
    # Measured after 20 rows: 0.85, and 0.79 where spheres do not turn; steps of 0.05 with sliding have 1e-3
    assert rough / smooth == pytest.approx(0.85, abs=0.01)
    assert still / smooth == pytest.approx(0.80, abs=0.02)


def test_a_lattice_that_nothing_strikes_stays_at_rest(run: Runs) -> None:
    # A striker far from a sheet of 12 rows: what is ahead of the wave knows only the rounding of the places
    record = run(SHEET, {"packing.rows": 31, "time.duration": 5.0, "time.sample": 5.0, "packing.sides": "periodic"})
    ahead = record.problem.crystal.arrays["row"] > 25
    # Contacts between rows overlap by 1e-15 R at most, 4e-13 ℓ, with a force of 3e-19 m ℓ/t0²
    assert np.max(np.abs(record.velocity[-1][ahead])) < 1e-16


# --- the run ----------------------------------------------------------------------------------------------------------


def test_restitution_takes_its_share_of_a_collision(run: Runs) -> None:
    record = run(
        CHAIN,
        {"packing.rows": 2, "effects.restitution": 0.6, "time.timestep": 0.005}
        | {"time.duration": 10.0, "time.sample": 10.0},
    )
    # Two equal spheres leave with (1 ∓ e)/2; the step leaves an error of its own size
    assert record.velocity[-1, :, 1] == pytest.approx([0.2, 0.8], abs=5e-3)


def test_a_run_folder_is_read_back_and_one_that_was_changed_is_not(run: Runs) -> None:
    record = run(CHAIN, {"packing.rows": 8, "time.duration": 5.0})
    assert record.folder is not None
    again = ImpactRecord.load(record.folder)
    assert np.array_equal(again.velocity, record.velocity)
    assert again.info["guards"]["largest_overlap"]["quiet"]
    path = Path(record.folder) / "scene.toml"
    path.write_text(path.read_text().replace("velocity = 1.0", "velocity = 2.0"))
    with pytest.raises(RunFolderError, match=r"scene\.toml was changed"):
        ImpactRecord.load(record.folder)


def test_the_guard_of_overlaps_triggers_where_strikers_press_a_sphere_against_a_wall(run: Runs, tmp_path: Path) -> None:
    fast = CHAIN.with_values({"packing.rows": 6, "packing.last": "wall", "time.duration": 20.0})
    # At 118 m/s two spheres overlap by 0.0497 of the diameter, and a row of four strikers makes it more
    row = ImpactScene.from_dict(fast.to_dict() | {"striker": [{"rows": [0, 3], "velocity": 118.0}]})
    with pytest.raises(EffectError, match=r"largest_overlap = 0\.0\d+, above 0\.05: of the diameter"):
        run_impact(row, tmp_path / "run")
    with pytest.raises(RunFolderError, match="not a finished run"):
        ImpactRecord.load(tmp_path / "run")
    with pytest.raises(SceneError, match="striker: velocity = 130"):
        fast.with_values({"striker.1.velocity": 130.0})


def test_the_guards_are_never_below_the_truth(run: Runs) -> None:
    record = run(CHAIN, {"packing.rows": 10, "packing.last": "wall", "time.sample": 0.1, "time.duration": 30.0})
    u, unit = record.displacement[..., 1], record.scale.length / (2 * record.scene.sphere.radius)
    deepest = max(np.max(u[:, :-1] - u[:, 1:]), np.max(u[:, -1])) * unit
    # Looks are at the records; thermo columns have eight digits
    assert record.info["guards"]["largest_overlap"]["value"] == pytest.approx(deepest, rel=1e-6)
    wall = float(np.max(u[:, -1]))
    rate = np.sqrt(3 * np.sqrt(2) * np.sqrt(wall))  # (3/2) 2√2 A √δ, m = 1
    assert record.info["guards"]["step_in_contact"]["value"] >= record.scene.time.step * rate * (1 - 1e-6)


def test_a_guard_without_a_value_is_not_quiet() -> None:
    problem = prepare(CHAIN)
    said = description(problem, [], "module", 1)
    times = {"Step": np.arange(0.0, 1e4), "v_tau": np.arange(0.0, 1e4)}

    def found(**columns: float) -> dict[str, Any]:
        table = times | {f"v_{name}": np.full(10_000, value) for name, value in columns.items()}
        info = said | outcome(Path(), problem, 0, table, said)
        return info | {"lacks": lacking(problem, RunLog(table, 0.0, {}), info)}

    assert "the guard largest_overlap" in found(omega_dt=0.1)["lacks"]  # which fails a run that is over
    assert not found(overlap=np.nan, omega_dt=0.1)["guards"]["largest_overlap"]["quiet"]
    assert found(overlap=0.01, omega_dt=0.1)["guards"]["largest_overlap"]["quiet"]
    assert not found(overlap=0.01, omega_dt=0.1)["lacks"]


def test_a_deck_of_chosen_spheres_records_them_alone() -> None:
    text = deck_of(prepare(CHAIN.with_values({"output.rows": [3, 5]}))).input_text
    assert "group        recorded id 4:6" in text
    assert "dump         record recorded custom" in text
