"""Scenes whose spheres differ or are missing: what is declared, refused, written into the deck and said of a run."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp import Record, Scene, build, run
from granular_lmp.cli import main
from granular_lmp.crystal.lattices import centre
from granular_lmp.errors import RunFolderError, SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest import at_rest
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.held import largest_step
from granular_lmp.rest.linear import plane_along_y, uniform_rows
from tests.conftest import PAPER, members
from tests.hard import guard_study

STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7850.0}
SHEET = PAPER.with_values(
    {
        "name": "sheet",
        "packing.rows": 12,
        "packing.columns": 8,
        "packing.ends": "periodic",
        "wave.wavenumber": np.pi / 3,
        "wave.amplitude": 0.02,
        "time.duration": 4.0,
        "output.particles": 1.0,
    }
)
SPREAD = {"disorder.radius": 5e-5, "disorder.density": 0.1, "disorder.vacancies": 0.02, "disorder.seed": 3}


# --- what is declared ------------------------------------------------------------------------------------------------


def test_no_spread_is_the_deck_of_the_perfect_lattice() -> None:
    plain, seeded = build(SHEET), build(SHEET.with_values({"disorder.seed": 7, "disorder.radius": 0.0}))
    assert seeded.input_text == plain.input_text
    assert seeded.data.text("") == plain.data.text("")


def said_of(spread: float, scene: Scene = SHEET) -> list[str]:
    """Return what is said before a run of spheres whose diameters spread by so many overlaps at rest."""
    return scene.with_values({"disorder.radius": spread * scene.sphere.overlap_ratio}).remarks()


def test_what_is_said_of_disorder_is_what_the_study_measured() -> None:
    study = (Path(__file__).parents[2] / "analysis/cases/disorder/README.md").read_text("utf-8")
    cells = {row[0]: row[1:] for line in study.splitlines() if (row := re.split(r" *\| *", line.strip("| ")))}
    pressed = SHEET.with_values({"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7})
    for name, scene in (("adhesion", SHEET), ("compression", pressed)):
        for spread, cell in zip(cells["$s$"], cells[name], strict=True):
            left = 0.0 if cell == "–" else float(cell.split()[0])
            assert (
                not float(spread) or f"about {left:.0%} of the mean second harmonic" in said_of(float(spread), scene)[0]
            )
    for spread in (0.8, 2.0, 12.0):
        part = 1 - float(cells[f"{spread:g}"][0].split()[0]) / 6
        assert f"about {part:.0%} of the contacts open" in said_of(spread)[0]
    assert "no contact opens" in said_of(0.4)[0]
    for name in ("chain", "honeycomb"):  # each contact rests by itself
        shape = {"packing.lattice": name, "packing.columns": 1 if name == "chain" else 8}
        assert not any("diameters" in each for each in said_of(2.0, SHEET.with_values(shape)))


def test_as_many_contacts_part_as_is_said() -> None:
    unequal = SHEET.with_values({"disorder.radius": 2 * SHEET.sphere.overlap_ratio, "packing.rows": 18})
    left = 2 * len(crystal_of(unequal).contacts) / unequal.shape.spheres / 6
    # 16 % are said; of 430 contacts 1.3 % is the standard error
    assert left == pytest.approx(1 - 0.16, abs=0.05)


def test_a_scene_is_read_back_from_its_text() -> None:
    heavy = {"spheres": [[3, 4], [5, 5]], "density": 9000.0}
    scene = SHEET.with_values(SPREAD | {"inclusion": [heavy, {"disc": [6, 2, 1.5], "vacancy": True}]})
    assert Scene.loads(scene.to_toml()) == scene
    assert "[disorder]" not in SHEET.to_toml()
    assert scene.with_values({"inclusion.1.density": 100.0}).inclusion[0].density == 100.0


def test_a_disc_holds_the_spheres_around_its_centre() -> None:
    crystal = crystal_of(SHEET.with_values({"inclusion": [{"disc": [6, 4, 1.0], "density": 9000.0}]})).atoms
    assert np.count_nonzero(crystal.arrays["density"] == 9000.0) == 7


def test_no_random_vacancy_takes_the_recorded_sphere() -> None:
    for seed in range(1, 9):
        crystal = at_rest.places(SHEET.with_values({"disorder.vacancies": 0.6, "disorder.seed": seed}))
        assert centre(crystal) >= 0


def test_spheres_without_a_neighbour_are_left_out_and_said() -> None:
    around = [[8, 3], [8, 5], [7, 4], [7, 5], [9, 4], [9, 5]]  # all neighbours of [8, 4]
    problem = prepare(SHEET.with_values({"inclusion": [{"spheres": around, "vacancy": True}]}))
    assert len(problem.rest.atoms) == 12 * 8 - 7
    assert "1 spheres are left out, because vacancies leave them without a neighbour" in problem.warnings()
    assert not prepare(SHEET).rest.crystal.remarks()


def test_layers_leave_the_rows_alike_and_need_no_columns() -> None:
    layers = SHEET.with_values({"packing.columns": "auto", "inclusion": [{"rows": [0, 5], **STEEL}]})
    assert layers.shape.columns == 3
    assert uniform_rows(layers)
    assert not plane_along_y(layers)


# --- the crystal and its deck ----------------------------------------------------------------------------------------


def test_a_seed_gives_the_same_crystal_again(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = SHEET.with_values(SPREAD)
    first = build(scene).data.text("")
    monkeypatch.setattr(at_rest, "_KEPT", {})
    assert build(scene).data.text("") == first
    assert build(scene.with_values({"disorder.seed": 4})).data.text("") != first


def test_two_materials_are_written_out_pair_by_pair() -> None:
    deck = build(SHEET.with_values({"inclusion": [{"rows": [0, 5], **STEEL}]}))
    assert re.findall(r"^pair_coeff +(\S+ \S+) ", deck.input_text, re.M) == ["1*2 1*2", "1*2 3*4", "3*4 3*4"]
    assert re.search(r"^group +mobile type 1 3$", deck.input_text, re.M)
    kind, density = deck.data.kind.reshape(12, 8), deck.data.density.reshape(12, 8)
    assert (kind == [[3]] * 6 + [[1]] * 6).all()
    assert density[0, 0] / density[-1, 0] == pytest.approx(7850 / 2200, rel=1e-15)  # the units of the deck


@pytest.mark.parametrize("kind", ["perfect", "spread", "steel", "loose"])
def test_atoms_carry_their_masses_and_a_tag_for_their_material(kind: str) -> None:
    steel = {"inclusion": [{"spheres": [[3, 4], [5, 5]], **STEEL}]}
    scene = {
        "perfect": SHEET,
        "spread": SHEET.with_values(SPREAD),
        "steel": SHEET.with_values(steel),
        "loose": Scene.load("dimer_chain"),
    }[kind]
    deck = build(scene)
    atoms, data = deck.packing, deck.data  # what LAMMPS reads
    mass = np.pi / 6 * data.density * data.diameter**3 / deck.scene.units.number(scene.material.mass, mass=1)
    np.testing.assert_allclose(atoms.get_masses(), mass, rtol=1e-13)
    assert np.ptp(mass) == 0 if kind == "perfect" else np.ptp(mass) > 0.1
    at_steel = (np.isin(atoms.arrays["row"] * 8 + atoms.arrays["column"], [28, 45])) & (kind == "steel")
    np.testing.assert_array_equal(atoms.get_tags(), at_steel)


def test_the_deck_says_what_is_not_perfect() -> None:
    head = build(SHEET.with_values(SPREAD)).input_text.partition("\n")[0]
    assert head.endswith("; not perfect: radius 5e-05, density 0.1, vacancies 0.02, seed 3")


def test_light_spheres_bring_the_echo_earlier() -> None:
    walled = SHEET.with_values({"packing.rows": 31, "packing.ends": "fixed", "time.duration": 10.0})
    prepare(walled)
    with pytest.raises(SceneError, match="may bring the echo of the walls to the centre at tau = "):
        prepare(walled.with_values({"inclusion": [{"rows": [5, 6], "density": 500.0}]}))


def test_stiff_contacts_lower_the_largest_step() -> None:
    rigid = SHEET.with_values({"inclusion": [{"rows": [0, 5], **STEEL, "density": 2200.0}]})
    assert largest_step(prepare(rigid).scene) < 0.9 * largest_step(prepare(SHEET).scene)


# --- effects and guards ----------------------------------------------------------------------------------------------


def finding(scene: Scene, name: str) -> Any:
    return next(effect for effect in prepare(scene).effects if effect.name == name)


def test_the_weakest_contact_limits_the_amplitude() -> None:
    scene = SHEET.with_values({"disorder.radius": 8e-5})
    weak = finding(scene, "contact_opening")
    assert not weak.called_for
    limit = float(weak.reason.rpartition("= ")[2])
    # The limit has three digits
    assert not finding(scene.with_values({"wave.amplitude": 0.99 * limit}), "contact_opening").number < 0
    assert finding(scene.with_values({"wave.amplitude": 1.01 * limit}), "contact_opening").called_for


def test_spheres_that_nearly_touch_call_for_opening() -> None:
    # With s = 1 a hundredth of the pairs has parted, some of them by less than the wave stretches
    scene = SHEET.with_values({"disorder.radius": 2.5e-4, "wave.amplitude": 0.03})
    found = (finding(scene.with_values({"disorder.seed": seed}), "contact_opening") for seed in range(1, 6))
    assert any(each.called_for and each.reason.endswith("are close enough to meet") for each in found)


def test_where_spheres_differ_every_wave_turns_some() -> None:
    longitudinal = SHEET.with_values({"wave.mode": "L"})
    assert not finding(longitudinal, "rotation").on
    assert finding(longitudinal.with_values(SPREAD), "rotation").on


def test_dashpots_shorten_the_step_where_spheres_differ() -> None:
    damped = prepare(SHEET.with_values(SPREAD | {"effects.viscosity": 1e-7}))
    assert damped.on["damping"]
    assert largest_step(damped.scene) < largest_step(prepare(SHEET.with_values(SPREAD)).scene)


@pytest.mark.parametrize("seed", members([100, 105, 130], 100, 105))
def test_the_guards_judge_every_contact_by_its_own_law(seed: int, tmp_path: Path) -> None:
    scene = guard_study.random_scene("imperfect", seed)
    for comparison in guard_study.compared(scene, tmp_path / "run"):
        assert not comparison.missed
        assert not comparison.stopped


# --- runs ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def imperfect_run(tmp_path_factory: pytest.TempPathFactory) -> Record:
    scene = SHEET.with_values(SPREAD | {"inclusion": [{"spheres": [[2, 2]], **STEEL}]})
    return run(scene, tmp_path_factory.mktemp("imperfect") / "run")


def test_a_run_says_how_its_crystal_came_to_rest(imperfect_run: Record) -> None:
    assert imperfect_run.folder is not None
    info = json.loads((imperfect_run.folder / "run.json").read_text())
    crystal = info["crystal"]
    assert crystal["disorder"]["seed"] == 3
    assert crystal["residual"] <= 1e-10
    assert crystal["protocol"].startswith("let go")
    assert 5 < crystal["contacts_per_sphere"] < 6
    assert info["particles"] == 12 * 8 - 2
    assert info["centre"] == centre(crystal_of(imperfect_run.scene).atoms) + 1


def test_snapshots_of_an_imperfect_run_hold_the_spheres_that_are_there(imperfect_run: Record) -> None:
    snapshots = imperfect_run.snapshots()
    assert snapshots.stack("displacement").shape == (5, 94, 2)
    moved = snapshots[4].displacement[imperfect_run.info["centre"] - 1]
    assert moved == pytest.approx([-imperfect_run.q[-1], imperfect_run.p[-1]], rel=1e-12)  # the same digits


def test_a_folder_of_another_crystal_is_refused(imperfect_run: Record, tmp_path: Path) -> None:
    assert imperfect_run.folder is not None
    scene = imperfect_run.scene.with_values({"disorder.seed": 4})
    shutil.copytree(imperfect_run.folder, tmp_path / "run")
    (tmp_path / "run" / "scene.toml").write_text(scene.to_toml())
    with pytest.raises(RunFolderError, match=r"scene\.toml was changed"):
        Record.load(tmp_path / "run")


def test_the_command_line_runs_a_scene_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(SHEET.with_values({"name": "mine", **SPREAD}).to_toml())
    assert main(["effects", str(path)]) == 0
    assert "the weakest contact opens at wave.amplitude" in capsys.readouterr().out
    assert main(["run", str(path), "-o", str(tmp_path / "run"), "--set", "disorder.seed=5"]) == 0
    assert main(["run", str(path), "-o", str(tmp_path / "bad"), "--set", "disorder.radius=1"]) == 2
