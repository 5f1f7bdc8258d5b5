"""Crystals from tables: values of single spheres beside a scene, in every lattice, in LAMMPS and in the network."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.tools import compare
from granular_lmp import Scene, Sweep, build, resume, run, sweep
from granular_lmp.cli import main
from granular_lmp.crystal.lattices import LATTICE_NAMES
from granular_lmp.errors import SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.studies.sweep_points import scene_hash
from tests.crystal.test_lattices import scene_of
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


def test_lammps_with_a_random_table_moves_as_the_network(tmp_path: Path) -> None:
    scene = with_table(SMALL, **random_values(SMALL))
    coarse = errors_of(scene, tmp_path / "coarse")
    fine = errors_of(scene.with_values({"time.timestep": 0.0125}), tmp_path / "fine")
    # The error of velocity Verlet is of second order: a sixteenth at a quarter of the step
    assert np.all(coarse < 1e-3)
    np.testing.assert_allclose(coarse / fine, 16, rtol=0.1)


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
