"""Crystals from tables: values of single spheres beside a scene, in every lattice, in LAMMPS and in the network."""

import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.harmonic import by_theory
from granular_analysis.measure.runs import begun
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.errors import TheoryError
from granular_analysis.tools import compare
from granular_lmp import Scene, Sweep, build, resume, run, sweep
from granular_lmp.cli import main
from granular_lmp.crystal.lattices import LATTICE_NAMES
from granular_lmp.errors import CrystalError, SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.held import largest_step
from granular_lmp.scene import spreadsheets
from granular_lmp.studies.sweep_points import scene_hash
from tests.crystal.test_lattices import scene_of
from tests.manual import Measure, Mutant, verifies
from tests.matrix.compared import outcome
from tests.scene.test_space import LAYER

MODES = {"honeycomb": "3", "hcp": "S1"}
SPATIAL = ("cubic", "fcc", "hcp")
SMALL = scene_of("hexagonal", "TR", packing__columns=4, output__particles=1.0)
COUNT = SMALL.shape.spheres


def of_lattice(lattice: str) -> Scene:
    """Return a small periodic crystal of a lattice, its size declared."""
    columns = 1 if lattice == "chain" else 4
    mode = "L" if lattice == "chain" else MODES.get(lattice, "TR")
    rows = 12 if lattice in ("honeycomb", "hcp") else 8
    scene = scene_of(lattice, mode, packing__columns=columns, packing__rows=rows, wave__wavenumber=np.pi / 2)
    return scene.with_values({"packing.layers": scene.shape.layers}) if lattice in SPATIAL else scene


def with_table(scene: Scene, **columns: Any) -> Scene:
    return scene.with_values({"packing.table": columns})


def random_values(scene: Scene) -> dict[str, Any]:
    """Return values of all spheres: densities, radii that differ by less than an overlap, factors of stiffness."""
    count, random = scene.shape.spheres, np.random.default_rng(1)
    return {
        "density": scene.sphere.density * random.uniform(0.7, 1.4, count),
        "normal_stiffness": random.choice([0.5, 1.0, 2.0], count),
        "shear_stiffness": random.choice([0.8, 1.0], count),
        "radius": scene.sphere.radius * (1 + 0.1 * scene.sphere.overlap_ratio * random.uniform(-1, 1, count)),
    }


# --- every lattice ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lattice", LATTICE_NAMES)
def test_a_table_of_the_values_of_the_scene_is_the_perfect_crystal(lattice: str) -> None:
    scene = of_lattice(lattice)
    count, sphere = scene.shape.spheres, scene.sphere
    own = with_table(scene, density=[sphere.density] * count, radius=[sphere.radius] * count)
    perfect, same = prepare(scene).rest, prepare(own).rest
    # Newton steps leave 1e-10 of an overlap of 2.5e-4 radii on lattices that are exact to rounding, 1e-15 of 10 radii
    np.testing.assert_allclose(same.atoms.positions, perfect.atoms.positions, atol=1e-12)
    np.testing.assert_array_equal(same.density, perfect.density)
    np.testing.assert_array_equal(same.atoms.get_masses(), 1.0)
    other = prepare(with_table(scene, density=[sphere.density] * (count - 1) + [3000.0])).rest
    assert np.flatnonzero(other.density != perfect.density).tolist() == [count - 1]


@pytest.mark.parametrize("lattice", LATTICE_NAMES)
def test_an_exported_table_read_back_is_the_same_crystal(lattice: str, tmp_path: Path) -> None:
    scene, flat = of_lattice(lattice), lattice in ("square", "cubic")
    disorder = {"disorder.density": 0.1, "disorder.vacancies": 0.05 if scene.lattice.sheet else 0.0}
    scene = scene.with_values(disorder | ({} if flat else {"disorder.radius": 1e-5}))
    (tmp_path / "drawn.toml").write_text(scene.to_toml(), encoding="utf-8")
    assert main(["export", str(tmp_path / "drawn.toml"), "--spheres", "-o", str(tmp_path / "spheres.csv")]) == 0
    given = {"disorder.density": 0.0, "disorder.radius": 0.0, "packing.table": str(tmp_path / "spheres.csv")}
    one, other = crystal_of(scene).atoms, crystal_of(scene.with_values(given)).atoms
    # Radii in m and back in R are a rounding away, and places at rest follow them
    for name in ("radius", "density", "site"):
        np.testing.assert_allclose(other.arrays[name], one.arrays[name], rtol=3e-16)
    np.testing.assert_allclose(other.positions, one.positions, atol=1e-11)
    assert np.ptp(one.arrays["density"]) > 0.1 * one.arrays["density"].mean()


def test_a_scene_without_a_table_is_not_changed_by_it() -> None:
    assert "table" not in SMALL.to_toml()
    assert build(SMALL.with_values({"packing.table": ""})).input_text == build(SMALL).input_text


# --- LAMMPS and the network ------------------------------------------------------------------------------------------


def errors_of(scene: Scene, folder: Path) -> np.ndarray:
    """Return the errors of a run against the network of its spheres, of the signals that are not zero."""
    run(scene, folder)
    comparison = compare.compare(compare.load(folder))
    assert comparison.theory == "network"
    return np.array([each for each in comparison.error.values() if each is not None])


@verifies(
    "All spheres of a crystal from a table of densities, radii and stiffness factors, in LAMMPS",
    reference="other code: the network of the spheres, with its own rule for stiffnesses",
    tolerance=1e-6,
    reason="the fourth order in the step is left of two runs, and 1e-8 of the rounding of positions over D0",
    mutant=Mutant("granular_lmp/crystal/stiffnesses.py", "2 * one * other / (one + other)", "np.sqrt(one * other)"),
)
def test_lammps_with_a_random_table_moves_as_the_network(measured: Measure, tmp_path: Path) -> None:
    found = outcome(with_table(SMALL, **random_values(SMALL)), tmp_path)
    measured(found.departure)
    assert found.departure < 1e-6
    assert found.bound > 1e-5  # what the step is worth, so that the spheres do move


EVERYTHING = {
    "disorder.stiffness": 0.05,
    "disorder.density": 0.1,
    "inclusion": [{"rows": [3, 4], "youngs_modulus": 6e10}],
    "pair": [{"of": [0, 1], "normal_stiffness": 500.0}],
}
FACES = {"packing.ends": "fixed", "packing.rows": 9, "packing.last": "wall", "time.allow_echo": True}


@pytest.mark.parametrize("beside", [EVERYTHING, FACES, {"packing.lattice": "fcc"}], ids=["all", "a wall", "space"])
def test_a_table_combines_with_what_disorder_combines_with(beside: dict[str, Any], tmp_path: Path) -> None:
    scene = SMALL.with_values(beside)
    errors = errors_of(with_table(scene, **random_values(scene)), tmp_path / "run")
    assert np.all(errors < 2e-3)  # of the step, as with disorder


def test_on_a_substrate_a_sphere_has_its_own_factor(tmp_path: Path) -> None:
    scene = LAYER.with_values({"packing.rows": 8, "packing.columns": 4, "output.particles": 1.0})
    factors = np.random.default_rng(2).choice([0.5, 1.0, 2.0], scene.shape.spheres)
    scene = with_table(scene, normal_stiffness=factors)
    on_wall = (contacts := crystal_of(scene).contacts).on_wall
    expected = scene.wall.law(scene.sphere.radius).normal_stiffness(contacts.overlap[on_wall])
    np.testing.assert_allclose(contacts.normal_stiffness[on_wall], factors[contacts.i[on_wall]] * expected, rtol=1e-12)
    assert np.all(errors_of(scene, tmp_path / "run") < 2e-3)  # of the step


def test_the_network_of_a_run_has_the_values_of_each_sphere(tmp_path: Path) -> None:
    scene = with_table(SMALL, **(table := random_values(SMALL)))
    first = first_snapshot(begun(scene, tmp_path))
    network, scales = first.network, first.scales
    # Dumps have 6 digits of a mass and 15 of a radius
    np.testing.assert_allclose(network.density * scales.metre**-3 * scales.kilogram, table["density"], rtol=1e-5)
    np.testing.assert_allclose(network.radius * scales.metre, table["radius"], rtol=1e-12)
    own = np.diagonal(network.factors)[:, network.kind]
    np.testing.assert_allclose(own, [table["normal_stiffness"], table["shear_stiffness"]], rtol=1e-15)


def test_theories_of_a_perfect_lattice_refuse_a_table() -> None:
    with pytest.raises(TheoryError, match=r"leaves out packing\.table"):
        by_theory(with_table(SMALL, density=[2500.0] * COUNT), np.arange(3.0))
    assert by_theory(SMALL, np.arange(3.0)).by == "theory"


def test_the_factor_of_a_contact_is_that_of_two_springs_in_series() -> None:
    normal, shear = np.random.default_rng(2).uniform(0.2, 5.0, (2, COUNT)).round(1)
    normal[6:], shear[6:] = 1.0, 1.0  # others keep their contacts
    plain, contacts = (
        crystal_of(each).contacts
        for each in (
            with_table(SMALL, density=[2200.0] * COUNT),
            with_table(SMALL, normal_stiffness=normal, shear_stiffness=shear),
        )
    )
    for values, name in ((normal, "normal_stiffness"), (shear, "shear_stiffness")):
        one, other = values[contacts.i], values[contacts.j]
        found = getattr(contacts, name) / getattr(plain, name)
        np.testing.assert_allclose(found, 2 * one * other / (one + other), rtol=1e-9)  # of the overlaps at rest
        assert np.ptp(found) > 0.5


def test_inclusions_replace_what_they_declare_and_disorder_spreads_what_is_left() -> None:
    table = {"density": [3000.0] * COUNT, "radius": [SMALL.sphere.radius * (1 + 1e-5)] * COUNT}
    scene = with_table(SMALL, **table).with_values({"inclusion": [{"rows": [2, 2], "density": 5000.0}]})
    atoms = crystal_of(scene).atoms
    np.testing.assert_array_equal(atoms.arrays["density"], np.where(atoms.arrays["row"] == 2, 5000.0, 3000.0))
    np.testing.assert_allclose(atoms.arrays["radius"], 1 + 1e-5, rtol=1e-15)
    drawn = crystal_of(scene.with_values({"disorder.density": 0.1})).atoms.arrays["density"]
    alone = crystal_of(SMALL.with_values({"disorder.density": 0.1})).atoms.arrays["density"] / SMALL.sphere.density
    np.testing.assert_allclose(drawn, atoms.arrays["density"] * alone, rtol=1e-15)


def test_the_step_follows_the_lightest_sphere(tmp_path: Path) -> None:
    scene = with_table(SMALL, sphere=[9], density=[2.2])  # a thousandth of the others
    # Between spheres that are far heavier it turns fastest: with 6 contacts of stiffness g and the inertia 2/5 mR² at
    # Ω² = 15 g/m. The others move with it by a thousandth, and levers are shorter by half an overlap, 1e-4 of them
    fastest = np.sqrt(15 * SMALL.sphere.shear_stiffness / (SMALL.sphere.mass / 1000)) * SMALL.sphere.time_scale
    assert largest_step(scene) == pytest.approx(2 / fastest, rel=2e-3)
    assert largest_step(SMALL) > 10 * largest_step(scene)
    with pytest.raises(SceneError, match="beyond the stability limit"):
        prepare(scene)  # its step, 0.05, is above the limit, 0.048
    assert np.all(errors_of(scene.with_values({"time.tolerance": 1e-2}), tmp_path / "run") < 1e-2)


@pytest.mark.parametrize("lattice", ["chain", "hexagonal", "square"])
def test_spheres_that_just_touch_have_the_values_of_a_table(lattice: str) -> None:
    columns = 1 if lattice == "chain" else 5
    scene = Scene.load("point_impact").with_values(
        {"packing.lattice": lattice, "packing.rows": 7, "packing.columns": columns, "striker.1.spheres": [[0, 0]]}
    )
    own = {"density": 4000.0, "radius": 0.9 * scene.sphere.radius}
    table = {name: [value] * columns for name, value in own.items()}
    one = scene.with_values({"packing.table": {"sphere": range(2 * columns, 3 * columns), **table}})
    other = scene.with_values({"inclusion": [{"rows": [2, 2], **own}]})
    assert build(one).data.text("") == build(other).data.text("")
    assert build(one).input_text == build(other).input_text
    assert build(one).data.text("") != build(scene).data.text("")


# --- the identity of a scene -----------------------------------------------------------------------------------------


def test_a_run_folder_holds_the_table_by_the_name_of_its_values(tmp_path: Path) -> None:
    scene = with_table(SMALL, **random_values(SMALL)).with_values({"time.duration": 1.0})
    build(scene).write(tmp_path / "deck")
    record = run(scene, tmp_path / "run")
    for folder in (tmp_path / "deck", tmp_path / "run"):
        again = Scene.load(folder)
        assert again.packing.table == scene.packing.table
        assert scene_hash(again) == scene_hash(scene)
        for name, values in scene.packing.table.columns.items():
            np.testing.assert_array_equal(again.packing.table.columns[name], values)
    assert scene.packing.table in record.info["files"]
    changed = tmp_path / "run" / scene.packing.table
    changed.write_text(changed.read_text("utf-8").replace("2.0", "1.5", 1), encoding="utf-8")
    with pytest.raises(SceneError, match="was changed since it was written"):
        Scene.load(tmp_path / "run")
    run(SMALL.with_values({"time.duration": 1.0}), tmp_path / "run", force=True)
    assert not changed.exists()


def test_the_values_of_a_table_are_part_of_the_scene_and_its_name_is_not(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("radius_nm;sphere;density [g/cm3]\n500,1;2;2,5\n;0;3,5\n", encoding="utf-8")
    read = SMALL.with_values({"packing.table": str(tmp_path / "mine.csv")})
    given = with_table(SMALL, sphere=[0, 2], density=[3500.0, 2500.0], radius=[np.nan, 500.1 * 1e-9])
    assert read == given
    assert scene_hash(read) == scene_hash(given)
    other = with_table(SMALL, sphere=[0, 2], density=[3500.0, 2500.0], radius=[np.nan, 500.2 * 1e-9])
    assert other != given
    assert scene_hash(other) != scene_hash(given) != scene_hash(SMALL)
    assert pickle.loads(pickle.dumps(given)).packing.table.columns["density"].tolist() == [3500.0, 2500.0]
    changed = given.with_values({"wave.amplitude": 0.1})
    assert changed.packing.table is given.packing.table
    assert read.with_values({"packing.table": ""}) == SMALL


def test_a_scene_is_written_with_its_table_beside_it(tmp_path: Path) -> None:
    scene = with_table(SMALL, **random_values(SMALL))
    (tmp_path / "inner").mkdir()
    scene.write(tmp_path / "mine.toml")
    assert main(["init", str(tmp_path / "inner/begun.toml"), "--from", str(tmp_path / "mine.toml")]) == 0
    (tmp_path / "inner").rename(tmp_path / "other")
    assert Scene.load(tmp_path / "mine.toml") == scene
    assert Scene.load(tmp_path / "other/begun.toml").packing == scene.packing


def test_a_stopped_run_with_a_table_goes_on(tmp_path: Path, stop: Any) -> None:
    scene = with_table(SMALL, **random_values(SMALL)).with_values({"time.duration": 40.0, "time.allow_echo": True})
    whole = run(scene, tmp_path / "whole")
    stop(scene, tmp_path / "stopped")
    continued = resume(tmp_path / "stopped")
    np.testing.assert_array_equal(continued.p, whole.p)


def test_a_sweep_keeps_the_table_in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = with_table(SMALL, **random_values(SMALL)).with_values({"time.duration": 1.0})
    done = sweep(scene, {"wave.amplitude": [0.1, 0.2]}, tmp_path / "sweep")
    monkeypatch.chdir("/")
    again = Sweep.load(tmp_path / "sweep")
    assert again.scene == scene
    assert [row["status"] for row in done.rows] == [row["status"] for row in again.rows] == ["finished"] * 2


# --- what is refused -------------------------------------------------------------------------------------------------

HEAD = "sphere,density_kg/m3,radius_m\n"
FILES = {
    "sphere,densty_kg/m3\n0,2200\n": "column 'densty_kg/m3' is unknown; did you mean density_kg/m3?",
    "sphere,density_kg\n0,2200\n": "column 'density_kg': the unit must be one of density_g/cm3, density_kg/m3",
    f"{HEAD}0,2200,5e-7\n1,heavy,5e-7\n": "line 3: density = 'heavy': must be a number",
    f"{HEAD}0,2200,5e-7\n\n1,0.5,5e-7\n": "line 4: density_kg/m3 = 0.5: must be a number in [1, 100000], kg/m3",
    f"{HEAD}0,2200,5\n": "line 2: radius_m = 5: must be a number in [1e-9, 1], m",
    f"{HEAD}0.5,2200,5e-7\n": "line 2: sphere = 0.5: must be a whole number from 0",
    f"{HEAD},2200,5e-7\n": "line 2: sphere = nan: must be a whole number from 0",
    f"{HEAD}3,2200,5e-7\n4,2200,5e-7\n3,2500,5e-7\n": "line 4: sphere = 3: is there twice, in line 2 too",
    f"{HEAD}3,2200\n": "line 2: 2 cells under 3 heads",
    HEAD: "must have a row and one of the columns density_kg/m3, radius_m, normal_stiffness, shear_stiffness",
    "sphere\n3\n": "must have a row and one of the columns density_kg/m3",
    "normal_stiffness\n1e-9\n": "line 2: normal_stiffness = 1e-09: must be a number in [0.001, 1000]",
    "": "has no head; must have a line of density_UNIT, normal_stiffness, radius_UNIT, shear_stiffness, sphere",
}


@pytest.mark.parametrize(("text", "message"), FILES.items(), ids=list(FILES.values()))
def test_a_file_that_is_no_table_is_refused_by_line_column_and_value(
    text: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.csv").write_text(text, encoding="utf-8")
    with pytest.raises(SceneError, match=re.escape(message)) as refused:
        SMALL.with_values({"packing.table": "mine.csv"})
    assert str(refused.value).startswith("packing.table = 'mine.csv': ")


def test_a_table_of_other_places_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("density_kg/m3\n2500\n2600\n", encoding="utf-8")
    read = SMALL.with_values({"packing.table": str(tmp_path / "mine.csv")})
    with pytest.raises(CrystalError, match=rf"mine.csv': 2 rows: must be {COUNT}, one for each place"):
        prepare(read)
    with pytest.raises(CrystalError, match=rf"sphere = {COUNT}: must be from 0 to {COUNT - 1}, a place of the lattice"):
        prepare(with_table(SMALL, sphere=[COUNT], density=[2500.0]))


def test_too_many_factors_are_refused() -> None:
    cell = SMALL.with_values({"packing.rows": 64, "disorder.stiffness": 0.1})
    cell = with_table(cell, normal_stiffness=np.linspace(1.1, 1.2, cell.shape.spheres))
    with pytest.raises(CrystalError, match=r"257 different .* of 1 material in 8 classes .* make 2056 types"):
        prepare(cell)


def test_a_table_of_too_many_rows_is_refused_before_it_is_parsed(tmp_path: Path) -> None:
    (tmp_path / "long.csv").write_text("density_kg/m3\n" + "2200\n" * 9, encoding="utf-8")
    said, kinds = "long.csv", {"density": {"kg/m3": 1.0}}
    with pytest.raises(SceneError, match="9 rows: must be at most 8"):
        spreadsheets.numbers(tmp_path / "long.csv", kinds, {}, said, largest=1000, most=8)
    with pytest.raises(SceneError, match="too large: must be at most 50 bytes"):
        spreadsheets.numbers(tmp_path / "long.csv", kinds, {}, said, largest=50, most=8)
    (tmp_path / "long.csv").write_text("density_kg/m3\n" + "x\n" * 300, encoding="utf-8")
    with pytest.raises(SceneError, match="must have at most 8 rows"):
        spreadsheets.numbers(tmp_path / "long.csv", kinds, {}, said, largest=1000, most=8)


BODIES = [
    "1,2\n3,4\n",
    "1,\n,4\n",
    ",\n1,2\n",
    "1,2\n\n3,4",
    "1,2,\n3,4,\n",
    "+.5,1.e3\n",
    "1-2,3\n",
    "e,1\n",
    "1e,2\n",
    "1\n2\n",
]
BODIES += ["1e999,2\n", "-1,--2\n", "", "\n", "1,2", ".,1\n"]


@pytest.mark.parametrize("body", BODIES)
def test_plain_numbers_are_read_as_those_of_any_other_table(
    body: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds = {"density": {"kg/m3": 1.0, "g/cm3": 1e3}, "radius": {"m": 1.0}}
    (tmp_path / "mine.csv").write_text(f"density_g/cm3, radius [m]\n{body}", encoding="utf-8")

    def read() -> Any:
        try:
            lines, columns = spreadsheets.numbers(tmp_path / "mine.csv", kinds, {}, "mine", largest=1000, most=8)
        except SceneError as error:
            return str(error)
        return list(lines), {name: values.tolist() for name, values in columns.items()}

    fast = repr(read())
    monkeypatch.setattr(spreadsheets, "_plain", lambda *_: None)
    assert fast == repr(read())
