"""Scenes of impacts: spheres that just touch, the units, what is refused, and the deck."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp import ImpactScene, Scene
from granular_lmp.cli import main
from granular_lmp.crystal.disorder import Disorder, Inclusion
from granular_lmp.crystal.lattices import CHAIN, HEXAGONAL, LATTICES, SQUARE
from granular_lmp.crystal.scale import DEEPEST, Scale, collision_time
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.touching import grain, neighbours, touching
from granular_lmp.errors import SceneError
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.guards import line_interval
from granular_lmp.problem import prepare
from granular_lmp.scene.shipped import SHIPPED

STEEL = Sphere(radius=5e-3, youngs_modulus=200e9, poisson_ratio=0.3, work_of_adhesion=0.0, density=7800.0)
NAMES = sorted(path.parent.name for path in (SHIPPED / "impacts").glob("*/scene.toml"))
CHAIN_SCENE = ImpactScene.load("solitary_chain")
PRESSED = CHAIN_SCENE.with_values({"packing.contact_force": 1e4})
SHEET = ImpactScene.load("point_impact")


def overlaps(crystal: Any) -> np.ndarray:
    """Overlaps of the neighbours, radii, as LAMMPS computes them: of coordinates, by the root of a sum of squares."""
    i, j, _ = neighbours(crystal)
    apart = crystal.positions[j] - crystal.positions[i]
    apart[:, 0] -= np.round(apart[:, 0] / crystal.cell[0, 0]) * crystal.cell[0, 0] * crystal.pbc[0]
    radius = crystal.arrays["radius"]
    return np.asarray(radius[i] + radius[j] - np.sqrt(apart[:, 0] ** 2 + apart[:, 1] ** 2))


# --- spheres that just touch ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "of_one"), [("chain", 1), ("square", 2), ("hexagonal", 3)])
@pytest.mark.parametrize("rows", [2, 9, 250])
def test_no_rounding_parts_two_neighbours(name: str, of_one: int, rows: int) -> None:
    columns = 1 if name == "chain" else 7
    crystal, _ = touching(STEEL, LATTICES[name], rows, columns, periodic=(name != "chain", False))
    found = overlaps(crystal)
    # Each sphere has half of its contacts to the row above, and those of a row have one contact in it
    assert len(found) == (rows - 1) * columns * max(of_one - 1, 1) + (rows * columns if columns > 1 else 0)
    assert np.all(found >= 0)
    assert np.all(found < np.spacing(float(rows)))  # at most a rounding of the farthest position
    if name != "hexagonal":
        assert not found.any()


def test_rows_of_a_hexagonal_lattice_are_all_alike() -> None:
    crystal, _ = touching(STEEL, HEXAGONAL, 101, 5)
    assert len(np.unique(np.diff(np.unique(crystal.positions[:, 1])))) == 1
    # The naive places, multiples of a rounded √3, open contacts
    crystal.positions[:, 1] = (crystal.arrays["row"] - 50) * np.sqrt(3.0)
    assert np.min(overlaps(crystal)) < 0


def test_unequal_spheres_of_a_chain_touch_exactly() -> None:
    crystal, _ = touching(
        STEEL, CHAIN, 500, 1, disorder=Disorder(radius=0.02), inclusions=(Inclusion(spheres=((7, 0),), radius=2e-2),)
    )
    assert crystal.arrays["radius"][7] == pytest.approx(4.0, rel=0.061)  # three deviations
    assert len(np.unique(crystal.arrays["radius"])) == 500
    assert not overlaps(crystal).any()
    crystal.positions[8, 1] = np.nextafter(crystal.positions[8, 1], np.inf)
    assert overlaps(crystal).any()  # a wrong last digit is seen


def test_all_multiples_of_the_grain_are_exact() -> None:
    unit = grain(1000.0)
    assert (1000.0 - unit) - 999.0 == 1.0 - unit
    assert 1000.0 + unit / 4 == 1000.0


# --- units ------------------------------------------------------------------------------------------------------------


def test_the_impact_is_the_unit() -> None:
    scale = Scale.of(STEEL, 2.0)
    # A = m = v = 1 in these units
    assert STEEL.normal_coefficient * scale.length**1.5 * scale.time**2 / scale.mass == pytest.approx(scale.length)
    assert scale.velocity == pytest.approx(2.0)
    assert Scale.of(STEEL, 64.0).time == pytest.approx(scale.time / 2)  # v^{-1/5}


def test_the_collision_time_and_the_deepest_overlap_are_hertzs() -> None:
    from cases.solitary.chain_motion import collision_time as other

    assert collision_time(0.5) == pytest.approx(other(1.0, 1.0, 1.0), rel=1e-12)
    assert pytest.approx(0.5 * 0.5) == 2 / 5 * DEEPEST**2.5  # ½ μ v² = (2/5) A δ^{5/2}, μ = m/2


def test_spheres_at_rest_have_their_own_scale() -> None:
    scene = Scene.load("tr_periodic")
    assert scene.scale == Scale(scene.sphere.mass, scene.sphere.static_overlap, scene.sphere.time_scale)
    assert Scale.of(scene.sphere, 3.0) == scene.scale
    with pytest.raises(ValueError, match="velocity = 0.0: must be above 0 where spheres have no overlap at rest"):
        Scale.of(STEEL)


# --- what is refused --------------------------------------------------------------------------------------------------


def test_a_sheet_that_is_periodic_both_ways_has_no_free_ends(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    periodic = SHEET.with_values({"packing.rows": 20, "packing.ends": "periodic", "packing.sides": "periodic"})
    walls = {each.name: each for each in prepare(periodic).effects}["walls"]
    assert (walls.on, walls.finding) == (False, "the packing is periodic and has no ends")
    path = tmp_path / "scene.toml"
    path.write_text(periodic.to_toml())
    main(["check", str(path)])
    assert "packing.first" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("envelope", "envelope: is only for a wave"),
        ("absorb", "absorb: absorbs linear waves, and contacts without load have none"),
        ("source", "source: has no unit of time where nothing is at rest"),
    ],
)
def test_tables_that_touching_spheres_give_no_meaning_are_refused(table: str, message: str) -> None:
    with pytest.raises(SceneError, match=f"^{message}"):
        ImpactScene.from_dict(CHAIN_SCENE.to_dict() | {table: {}})


def test_a_step_too_long_for_the_lightest_sphere_is_refused() -> None:
    prepare(CHAIN_SCENE.with_values({"time.timestep": 0.1}))
    light = {"inclusion": [{"rows": [5, 5], "density": 7.8}]}
    with pytest.raises(SceneError, match=r"time.timestep = 0.1: leaves the shortest collision of two neighbours, 0.2"):
        prepare(ImpactScene.from_dict(CHAIN_SCENE.with_values({"time.timestep": 0.1}).to_dict() | light))


# --- files and commands -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_the_shipped_decks_are_those_of_their_scenes(name: str) -> None:
    deck = deck_of(prepare(ImpactScene.load(name)))
    committed = (SHIPPED / "impacts" / name / f"in.{name}").read_text("utf-8")
    # Numbers are compared as numbers: their last digit depends on the processor
    number = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?")
    assert number.sub("#", committed) == number.sub("#", deck.input_text)
    assert [*map(float, number.findall(committed))] == pytest.approx([*map(float, number.findall(deck.input_text))])
    data = "".join(deck.files()[f"data.{name}"])
    assert (SHIPPED / "impacts" / name / f"data.{name}").read_text("utf-8").split("\n", 1)[1] == data.split("\n", 1)[1]


def test_a_scene_reads_back_what_it_writes() -> None:
    for name in NAMES:
        scene = ImpactScene.load(name)
        assert ImpactScene.loads(scene.to_toml()) == scene
        for chosen in ({"output.rows": [1, 4]}, {"output.spheres": [[3, 0]]}):
            changed = scene.with_values(chosen).with_values({"time.timestep": 0.02})
            assert ImpactScene.loads(changed.to_toml()) == changed


def test_the_scenes_of_waves_and_of_impacts_are_told_apart() -> None:
    assert Scene.load("solitary_chain") == CHAIN_SCENE
    assert CHAIN_SCENE.wave is None
    assert Scene.load("tr_periodic").wave is not None


def test_commands_of_a_linear_wave_refuse_an_impact(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["kick", "solitary_chain"]) == 2
    assert "wave: missing table; this scene has sources, strikers or a [start] alone" in capsys.readouterr().err


@pytest.mark.usefixtures("tried")
def test_check_and_effects_say_what_a_run_does(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "solitary_chain", "--set", "striker.1.velocity=2.0"]) == 0
    assert "a chain of 60 spheres that just touch, struck at 2 m/s" in capsys.readouterr().out
    assert main(["effects", "point_impact", "--json"]) == 0
    assert '"reason": "no force holds the contacts together"' in capsys.readouterr().out
    assert main(["run", "solitary_chain", "--all-effects"]) == 2


def test_guards_look_often_enough() -> None:
    problem = prepare(CHAIN_SCENE)
    steps = line_interval(problem)
    assert CHAIN_SCENE.time.steps_per_sample % steps == 0
    assert steps * CHAIN_SCENE.time.step <= problem.rest.shortest_collision / 20


def test_a_square_sheet_has_its_wall_at_the_edge_of_the_spheres() -> None:
    scene = SHEET.with_values({"packing.lattice": SQUARE.name, "packing.last": "wall", "packing.sides": "wall"})
    text = deck_of(prepare(scene)).input_text
    places = re.findall(r"([xy])plane (\S+) (\S+)", text)
    (left, low), (right, high) = (
        getattr(prepare(scene).rest.atoms.positions, name)(0)[:2].tolist() for name in ("min", "max")
    )
    assert low < high
    assert places == [("y", "NULL", repr(high + 1)), ("x", repr(left - 1), "NULL"), ("x", "NULL", repr(right + 1))]
