"""Impacts in LAMMPS through their scenes, against theories that share no code with them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.solitary.chain import Chain, End, compressed, energies, spheres, uniform
from cases.solitary.chain_motion import first_peak, march, peak
from cases.solitary.scattering import Meeting, crossing, impurity
from cases.solitary.travelling import solitary_wave, sound
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

ALUMINIUM = {"youngs_modulus": 70e9, "poisson_ratio": 0.33, "density": 2700.0}
LARGER = {"spheres": [[4, 0]], "radius": 8e-3}
MIXED = [{"rows": [1, 11], "every": 2} | ALUMINIUM, LARGER, {"spheres": [[12, 0]], "radius": 8e-3}]
WEAK, STRONG = 100.0, 1e4  # N: 0.31 and 31 of the force of the impact
# Faces, force, restitution, inclusions and the sphere that strikes
CHAINS: dict[str, tuple[tuple[End, End], float, float, list[dict[str, Any]], int]] = {
    "free": (("free", "free"), 0.0, 1.0, [], 0),
    "a held end": (("free", "held"), 0.0, 1.0, [], 0),
    "a wall": (("free", "wall"), 0.0, 1.0, [], 0),
    "pressed": (("free", "free"), WEAK, 1.0, [], 5),
    "pressed against a wall": (("free", "wall"), WEAK, 1.0, [], 5),
    "pressed between a wall and a held end": (("wall", "held"), WEAK, 1.0, [], 5),
    "pressed hard": (("free", "free"), STRONG, 1.0, [], 5),
    "pressed hard against a wall": (("free", "wall"), STRONG, 1.0, [], 5),
    "pressed hard between a wall and a held end": (("wall", "held"), STRONG, 1.0, [], 5),
    "unequal": (("free", "free"), 0.0, 1.0, [LARGER, {"spheres": [[7, 0]]} | ALUMINIUM], 0),
    "unequal, pressed": (("held", "free"), 50.0, 1.0, MIXED, 6),
    "unequal, pressed between walls": (("wall", "wall"), 50.0, 1.0, MIXED, 6),
    "lossy, 0.9": (("free", "free"), 0.0, 0.9, [], 0),
    "lossy, 0.7": (("free", "free"), 0.0, 0.7, [], 0),
    "lossy, 0.5": (("free", "free"), 0.0, 0.5, [], 0),
    "lossy, unequal, a held end": (("free", "held"), 0.0, 0.7, MIXED, 0),
    "lossy, unequal, a wall": (("free", "wall"), 0.0, 0.7, MIXED, 0),
}


def model(scene: ImpactScene, inclusions: list[dict[str, Any]]) -> Chain:
    """Return the chain of the theory in SI units; of inclusions the later ones win whole."""
    count = scene.packing.rows
    own = {name: np.full(count, getattr(scene.sphere, name)) for name in ("radius", "density", *ALUMINIUM)}
    for inclusion in inclusions:
        rows = [row for row, _ in inclusion.get("spheres", [])]
        if "rows" in inclusion:
            rows = [*range(inclusion["rows"][0], inclusion["rows"][1] + 1, inclusion.get("every", 1))]
        for name, values in own.items():
            values[rows] = inclusion.get(name, getattr(scene.sphere, name))
    ends: tuple[End, End] = (scene.packing.first, scene.packing.last)
    constants = (own[name] for name in ("radius", "density", "youngs_modulus", "poisson_ratio"))
    chain = spheres(*constants, ends=ends, force=scene.packing.contact_force)
    return replace(chain, restitution=scene.effects.restitution)


@pytest.mark.parametrize("name", members(CHAINS, "lossy, 0.7"))
def test_a_chain_moves_as_velocity_verlet_moves_it_at_rest_and_with_its_energies(run: Runs, name: str) -> None:
    (first, last), force, restitution, inclusions, struck = CHAINS[name]
    scene = CHAIN.with_values(
        {"packing.rows": 13 if inclusions else 20, "packing.first": first, "packing.last": last}
        | {"packing.contact_force": force, "effects.restitution": restitution, "striker.1.rows": [struck, struck]}
    )
    step = 0.02 if inclusions else 0.05
    record = run(scene, {"time.timestep": step, "time.sample": 10 * step, "time.duration": 600 * step}, inclusions)
    chain, scale, count = model(record.scene, inclusions), record.scale, scene.packing.rows
    v = scale.velocity * np.eye(count)[struck]
    us, vs = march(chain, 0 * v, v, step * scale.time, 600, every=10)
    # Rounding of positions, 1e-16 of the chain over ℓ, at random in 600 steps, tenfold; contacts that are pressed hard
    # are stiffer by a fourth root
    allowed = 10 * np.sqrt(600) * 1.1e-16 * 2 * count * record.scene.sphere.radius / scale.length
    assert record.velocity[1:, :, 1] == pytest.approx(vs / scale.velocity, abs=allowed)
    assert record.displacement[1:, :, 1] == pytest.approx(us / scale.length, abs=10 * allowed)
    assert not record.velocity[..., 0].any()
    each = energies(chain, us, vs) / (scale.mass * scale.velocity**2)
    assert record.energies()[1:] == pytest.approx(each, abs=1e-9)
    other = replace(chain, mass=1.001 * chain.mass, restitution=min(1.0, restitution + 1e-4))
    _, vs = march(other, 0 * v, v, step * scale.time, 600, every=10)
    assert np.max(np.abs(record.velocity[1:, :, 1] - vs / scale.velocity)) > 1e4 * allowed
    if restitution < 1:
        assert np.all(np.diff(record.energy()) < 0)
    if force:
        rest = record.info["at_rest"]
        assert rest["residual_force_over_impact"] < 1e-10 * rest["contact_force_over_impact"]
        over = force * scale.time / (scale.mass * scale.velocity)
        assert rest["contact_force_over_impact"] == pytest.approx(over, rel=1e-9)
    if force and not inclusions:
        speed = sound(float(chain.stiffness[2]), float(chain.mass[2]), float(chain.overlap[2]))
        spacing = 2 * scene.sphere.radius - rest["overlap_m"]
        assert rest["sound_m_s"] == pytest.approx(speed * spacing, rel=1e-9)


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


# --- sheets -----------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize(("restitution", "friction"), [(1.0, 0.0), (1.0, 0.3), (0.7, 0.0)])
def test_a_square_sheet_struck_at_a_point_is_a_chain(restitution: float, friction: float, run: Runs) -> None:
    shared = {"time.duration": 12.0, "time.sample": 1.0, "time.timestep": 0.05, "effects.restitution": restitution}
    square = {"packing.lattice": "square", "packing.columns": 5, "striker.1.spheres": [[0, 2]]}
    sheet = run(SHEET, shared | square | {"packing.rows": 12, "effects.friction": friction})
    chain = run(CHAIN, shared | {"packing.rows": 12})
    in_column = sheet.problem.rest.atoms.arrays["column"] == 2
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
    ahead = record.problem.rest.atoms.arrays["row"] > 25
    # Contacts between rows overlap by 1e-15 R at most, 4e-13 ℓ, with a force of 3e-19 m ℓ/t0²
    assert np.max(np.abs(record.velocity[-1][ahead])) < 1e-16


# --- the run ----------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("force", [0.0, WEAK])
def test_the_guards_are_never_below_the_truth_and_count_the_overlap_at_rest(run: Runs, force: float) -> None:
    changes = {"packing.rows": 10, "packing.last": "wall", "time.sample": 0.1, "time.duration": 30.0}
    record = run(CHAIN, changes | {"packing.contact_force": force})
    u, rest, at_wall = record.displacement[..., 1], 0.0, 0.0
    if force:
        collisions = record.problem.rest
        rest, at_wall = float(collisions.rest_overlap[0]), collisions.on_walls[-1][1]
    wall = float(np.max(at_wall + u[:, -1]))
    deepest = max(float(np.max(rest + u[:, :-1] - u[:, 1:])), wall)
    unit = record.scale.length / (2 * record.scene.sphere.radius)
    # Looks are at the records and between; thermo columns have eight digits, and a crest is flat over 0.1 t0
    found = record.info["guards"]["largest_overlap"]["value"]
    assert (1 - 1e-6) * deepest * unit <= found < (1.02 if force else 1 + 1e-6) * deepest * unit
    rate = np.sqrt(3 * np.sqrt(2) * np.sqrt(wall))  # the wall is the stiffest: (3/2) 2√2 A √δ, m = 1
    assert record.info["guards"]["step_in_contact"]["value"] >= record.scene.time.step * rate * (1 - 1e-6)
    assert deepest > rest + 0.5


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
