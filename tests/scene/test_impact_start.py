"""The state in which an impact begins: its file, its units, what it may not move."""

import re
import subprocess
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import granular_lmp
from granular_lmp import ImpactRecord, ImpactScene, Scene, export, run, run_impact
from granular_lmp.cli import main
from granular_lmp.errors import SceneError
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.installation import lmp_command
from granular_lmp.lammps.outputs import read_snapshots
from granular_lmp.problem import prepare
from granular_lmp.scene.records import declared_keys
from granular_lmp.scene.start import Start
from granular_lmp.scene.strikers import leads

CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.rows": 10, "time.duration": 6.0})
SHEET = ImpactScene.load("point_impact").with_values(
    {"packing.rows": 8, "packing.columns": 9, "striker.1.spheres": [[0, 4]], "time.duration": 6.0}
)
SMALL = {
    **{"packing.rows": 9, "packing.columns": 6, "disorder.vacancies": 0.0, "time.duration": 2.0},
    **{"striker.1.spheres": [[4, 2]], "monitor.1.rows": [5, 5]},
}


def with_state(scene: ImpactScene, state: Any, **tables: Any) -> ImpactScene:
    """The scene with a state in place of its strikers."""
    left = {name: table for name, table in scene.to_dict().items() if name != "striker"}
    return ImpactScene.from_dict(left | {"start": {"state": state}} | tables)


def test_a_state_of_velocities_is_a_striker(tmp_path: Path) -> None:
    struck = run_impact(CHAIN, tmp_path / "struck")
    begun = run_impact(with_state(CHAIN, [[0, 0, 0.0, 0.0, 0.0, 1.0, 0.0]]), tmp_path / "begun")
    assert begun.scale == struck.scale
    assert np.array_equal(begun.velocity, struck.velocity)
    assert np.array_equal(ImpactRecord.load(tmp_path / "begun").velocity, struck.velocity)


def test_a_file_of_one_time_of_a_run_goes_on_from_there(tmp_path: Path) -> None:
    whole = run_impact(SHEET, tmp_path / "whole")
    export(whole, tmp_path / "whole.csv")
    head, *lines = (tmp_path / "whole.csv").read_text().splitlines()
    chosen = [line for line in lines if float(line.split(",")[0]) == whole.tau[3] * whole.scale.time]
    (tmp_path / "state.csv").write_text("\n".join([head, *chosen]) + "\n\n")
    text = with_state(SHEET, [[0, 4, 0, 0, 0, 1.0, 0]]).to_toml()
    (tmp_path / "mine.toml").write_text(re.sub(r"state = .*", 'state = "state.csv"', text))
    begun = ImpactScene.load(tmp_path / "mine.toml")  # its file is beside it
    assert len(begun.start.state) == 72
    # Its t0 is that of the sphere that is fastest now; the same steps, in seconds
    ratio = SHEET.scale.time / begun.scale.time
    assert ratio < 0.99
    steps = {"time.timestep": ratio * 0.05, "time.sample": ratio * 3.0, "time.duration": ratio * 3.0}
    rest = run_impact(begun.with_values(steps), tmp_path / "rest")
    for now, then in ((0, 3), (1, 6)):
        # Places of 40 R are rounded to 7e-15 R, and accelerations of order 1 add that up over 60 steps
        moved = rest.displacement[now] * rest.scale.length / whole.scale.length
        assert moved == pytest.approx(whole.displacement[then], abs=1e-9)
        velocity = rest.velocity[now] * rest.scale.velocity / whole.scale.velocity
        assert velocity == pytest.approx(whole.velocity[then], abs=1e-9)
    assert np.max(np.abs(rest.velocity[1] - rest.velocity[0])) > 0.1


def test_spins_are_those_of_the_state(tmp_path: Path) -> None:
    rough = SHEET.with_values({"effects.friction": 0.2})
    spin = 30.0
    record = run_impact(with_state(rough, [[3, 4, 0, 0, 0.1, 0, spin], [4, 4, 0, 0, 0, 0.1, 0]]), tmp_path / "run")
    scale, radius = record.scale, rough.sphere.radius
    assert scale.velocity == pytest.approx(spin * radius)  # the surface is the fastest here
    turned = record.problem.rest.atoms.arrays["row"] == 3
    assert record.spin[0].max() * scale.velocity / radius == pytest.approx(spin, rel=1e-12)
    assert np.count_nonzero(record.spin[0][turned]) == np.count_nonzero(record.spin[0]) == 1
    assert np.count_nonzero(record.spin[-1]) > 5  # its neighbours are turned


def test_spheres_that_are_let_go_from_rest_have_their_largest_displacement_as_the_unit(tmp_path: Path) -> None:
    pressed = CHAIN.with_values({"packing.contact_force": 10.0})
    record = run_impact(with_state(pressed, [[5, 0, 0, -2e-6, 0, 0, 0], [4, 0, 0, 1e-6, 0, 0, 0]]), tmp_path / "run")
    assert record.scale.length == pytest.approx(2e-6, rel=1e-12)
    assert record.displacement[0, 4:6, 1] == pytest.approx([0.5, -1.0], abs=1e-9)
    assert not record.velocity[0].any()
    assert record.velocity[1:].any()
    assert "pressed together by 10 N, which begins in a given state" in record.scene.words


def test_a_scene_with_a_state_reads_back_what_it_writes() -> None:
    scene = with_state(CHAIN, [[4, 0, 0, 1e-7, 0, -1.0, 0], [5, 0, 0.0, 3.3e-7, 0, 0, 0]])
    assert ImpactScene.loads(scene.to_toml()) == scene
    assert scene.to_dict()["start"]["state"][1] == (5, 0, 0.0, 3.3e-7, 0.0, 0.0, 0.0)
    assert "start" not in CHAIN.to_dict()


@pytest.mark.usefixtures("tried")
def test_a_file_with_a_state_is_an_impact(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(with_state(CHAIN, [[0, 0, 0, 0, 0, 1.0, 0]]).to_toml())
    assert Scene.load(file).wave is None
    assert main(["check", str(file)]) == 0
    assert "a chain of 10 spheres that just touch, which begins in a given state" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["row,uy_m", "1,1e-6"], "column column: missing"),
        (["row,column", "1,0"], "must have one of the columns ux_m, uy_m, vx_m_s, vy_m_s, spin_rad_s"),
        (["row,column,uy", "1,0,1e-6"], "column 'uy': the unit must be one of uy_m, uy_mm"),
        (["row,column,uy_m,uy_m", "1,0,1,1"], "2 columns hold uy; must be one"),
        (["row,column,uy_m", "1,0,1e-6", "2,0"], "line 3: 2 cells under 3 heads"),
        (["row,column,uy_m", "1,0,much"], "line 2: uy_m = 'much': must be 0, or from 1e-30 to 1e+12 in size"),
        (["row,column,uy_m", "1,0,nan"], "line 2: uy_m = 'nan': must be 0, or"),
        (["row,column,uy_m", "1.5,0,1e-6"], "line 2: row = 1.5: must be a whole number, counted from 0"),
        (["row,column,uy_m", "-1,0,1e-6"], "line 2: row = -1.0: must be a whole number"),
        (["row,column,vy_m_s", "1,0,1", "1,0,2"], "sphere [1, 0]: is there twice; must be there once"),
        (["row,column,uy_m", "1,0,1e-300"], "line 2: uy_m = 1e-300: must be 0, or"),
        (["row,column,uy_m", "1,0,1e-20"], "start.state: velocity = 1.33933e-19: its overlap of 1e-20 m is less than"),
        (["row,column,vy_m_s", "1,0,500"], "start.state: velocity = 500: two spheres would overlap by"),
        (["row,column,vy_m_s", "99,0,1"], "start.state: sphere [99, 0]: must be [row, column]"),
        (["row,column,vy_m_s", "1,0,0"], "striker: missing; an impact needs a table [[striker]], or a [start]"),
        ([], "has no head; must have a line of column, row"),
        (["row,column,uy_m", "1_0,0,1e-6"], "line 2: row = '1_0'"),
    ],
)
def test_a_file_that_is_no_state_is_refused_by_name(
    tmp_path: Path, lines: list[str], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("state.csv").write_text("\n".join(lines))
    with pytest.raises(SceneError, match=re.escape(message)):
        with_state(CHAIN, "state.csv")


def test_a_state_is_of_a_bounded_number_of_spheres() -> None:
    with pytest.raises(SceneError, match=r"start\.state: 6000 spheres: must be at most 5000"):
        with_state(CHAIN, [[0, 0, 0, 0, 0, 1.0, 0]] * 6000)


@pytest.mark.parametrize("sides", ["free", "wall"])
def test_contacts_that_rub_begin_with_the_shear_of_the_state(sides: str, tmp_path: Path) -> None:
    """The forces at the beginning are (4/3) E* √Rc δ^{3/2} and 8 G* √(Rc δ) times the shear displacement from rest."""
    sheet = SHEET.with_values({"effects.friction": 1e3, "packing.sides": sides})
    deck = deck_of(prepare(with_state(sheet, [[4, 3, 3e-6, 2e-6, 0.0, 0.3, 0.0]])))
    deck.write(tmp_path / "deck")
    dump = "dump force all custom 1 dump.force id fx fy c_u[1] c_u[2]\ndump_modify force sort id format float %.17g"
    text = deck.input_text[: deck.input_text.index("# --- at a checkpoint")]
    (tmp_path / "deck" / "in.force").write_text(f"{text}\n{dump}\nrun 0\n")
    subprocess.run([*lmp_command(1), "-in", "in.force", "-screen", "none"], cwd=tmp_path / "deck", check=True)
    ((_, _, found),) = read_snapshots(tmp_path / "deck" / "dump.force")
    force, moved = found[:, 1:3], found[:, 3:5]
    units, material = deck.problem.units, deck.problem.scene.material
    modulus = units.number(material.youngs_modulus, mass=1, length=-1, time=-2)
    nu, places = material.poisson_ratio, deck.problem.rest.atoms.positions[:, :2] + moved
    normal, shear = modulus / (2 * (1 - nu**2)), modulus / (4 * (2 - nu) * (1 + nu))
    expected = np.zeros_like(force)
    for i, j in zip(*np.triu_indices(len(places), 1), strict=True):
        between = places[i] - places[j]
        if (overlap := 2 - np.hypot(*between)) <= 0:
            continue
        along, slip = between / np.hypot(*between), moved[i] - moved[j]
        slip = slip - (slip @ along) * along
        push = 4 / 3 * normal * np.sqrt(0.5) * overlap**1.5 * along - 8 * shear * np.sqrt(0.5 * overlap) * slip
        expected[i] += push
        expected[j] -= push
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    assert np.abs(moved[:, 0]).max() == pytest.approx(3e-6 / material.radius)


def test_errors_and_words_name_what_is_fastest_or_presses() -> None:
    both = ImpactScene.from_dict(CHAIN.to_dict() | {"start": {"state": [[3, 0, 0, 0, 0, 5.0, 0]]}})
    assert both.scale.velocity == pytest.approx(5.0)
    assert not leads(both.striker, both.start, both.sphere.radius)
    assert both.words.endswith("that just touch, struck at 1 m/s, which begins in a given state")
    assert leads(both.with_values({"striker.1.velocity": 5.0}).striker, both.start, both.sphere.radius)
    with pytest.raises(SceneError, match=re.escape("start.state: velocity = 500: two spheres would overlap by")):
        ImpactScene.from_dict(CHAIN.to_dict() | {"start": {"state": [[3, 0, 0, 0, 0, 500.0, 0]]}})
    with pytest.raises(SceneError, match=re.escape("packing.contact_force = 1000000.0: two spheres would overlap by")):
        CHAIN.with_values({"packing.contact_force": 1e6})


def test_a_sphere_is_a_striker_or_in_the_state() -> None:
    both = {"start": {"state": [[0, 0, 0, 0, 0, 0.5, 0]]}}
    with pytest.raises(
        SceneError, match=re.escape("must be 0 for a sphere in a [[striker]], which has its own velocity")
    ):
        prepare(ImpactScene.from_dict(CHAIN.to_dict() | both))
    beside = {"start": {"state": [[3, 0, 0, 0, 0, -0.5, 0]]}}
    assert prepare(ImpactScene.from_dict(CHAIN.to_dict() | beside)).rest.state[3, 4] == -0.5


def test_numbers_of_numpy_are_written_as_any_other() -> None:
    sample = np.float64(0.5)
    scene = with_state(CHAIN.with_values({"time.sample": sample}), [[0, 0, 0, 0, 0, np.float64(1.0), 0]])
    assert type(scene.time.sample) is float
    assert "np." not in deck_of(prepare(scene)).input_text + scene.to_toml()


@pytest.mark.parametrize(
    ("state", "fits"),
    [
        ("state.csv", True),
        ([[0, 0, 0.0, 1e-6, 0.0, 0.0, 0.0]], True),
        ("state.txt", False),
        ([[0, 0, 0.0, 1e-6, 0.0, 0.0]], False),
        ([[0.5, 0, 0.0, 1e-6, 0.0, 0.0, 0.0]], False),
        ([[0, 0, "x", 1e-6, 0.0, 0.0, 0.0]], False),
    ],
)
def test_the_schema_of_a_state_is_that_of_its_reader(state: Any, fits: bool) -> None:
    state_key = next(key for key in declared_keys(Start) if key.name == "state")
    schema = jsonschema.Draft202012Validator(state_key.rule.schema())
    assert schema.is_valid(state) == fits


@pytest.mark.parametrize(
    ("scene", "free"),
    [
        (CHAIN.with_values({"packing.last": "held"}), 8),
        (Scene.load("struck_sheet").with_values(SMALL), 41),
    ],
    ids=["a struck chain that is held at one end", "an uneven sheet"],
)
def test_noise_is_the_state_that_it_draws(scene: Any, free: int, tmp_path: Path) -> None:
    """A striker and a held sphere have none, the others no momentum, and a state of the same numbers moves alike."""
    noisy = scene.with_values({"start.noise": 0.01 * scene.striker[0].velocity, "start.seed": 5})
    problem = granular_lmp.prepare(noisy)
    mass, moves = (
        problem.rest.atoms.arrays["radius"] ** 3 * problem.rest.atoms.arrays["density"],
        problem.rest.state.any(axis=1),
    )
    assert np.count_nonzero(moves) == free
    assert not problem.rest.state[np.concatenate(problem.rest.strikers)].any()
    assert (
        np.abs(mass @ problem.rest.state[:, 3:5]).max()
        < 1e-12 * np.abs(mass @ np.abs(problem.rest.state[:, 3:5])).max()
    )
    if scene.lattice.name == "chain":
        assert not problem.rest.state[:, [0, 1, 2, 3, 5, 6, 7, 8]].any()
    row, column = (problem.rest.atoms.arrays[name] for name in ("row", "column"))
    lines = np.column_stack([row, column, problem.rest.state[:, [0, 1, 3, 4, 8]]])[moves].tolist()
    same = scene.with_values({"start.state": lines})
    one, other = run(noisy, tmp_path / "noisy"), run(same, tmp_path / "same")
    first, second = (each.velocity if scene.wave is None else each.snapshots()[-1].velocity for each in (one, other))
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-9 * np.abs(first).max())  # the units differ by rounding
