"""Strikes alone in crystals at rest under load: scenes without [wave] whose spheres adhere or are pressed together."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory.scenes import CRYSTAL_KEYS, Setting
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, export, load, run
from granular_lmp.errors import ReadoutError, SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest.linear import mode_of
from granular_lmp.runs.readouts import drive_of
from granular_lmp.studies.sweep import sweep
from tests.conftest import members
from tests.matrix.compared import outcome
from tests.validation.test_beside_network import PUSH, SPREAD, STILL, STRIKE, STRIKES

# --- what runs are made of --------------------------------------------------------------------------------------------


WATCHED = STRIKE.with_values(SPREAD | {"monitor": [{"name": "m", "rows": [4, 5], "what": "contacts"}]})


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(WATCHED, tmp_path_factory.mktemp("watched") / "run")


def test_units_are_those_of_the_crystal_at_rest(watched: Record) -> None:
    scene = watched.scene
    assert scene.held_at_rest
    assert (scene.scale.length, scene.scale.time) == (scene.sphere.static_overlap, scene.sphere.time_scale)
    first = np.linalg.norm(watched.velocity[0], axis=1)
    assert first.max() * scene.scale.velocity == pytest.approx(1e-3, rel=1e-12)
    assert np.count_nonzero(first) == 1
    assert watched.info["Delta0_m"] == scene.scale.length
    assert watched.to_xarray()["displacement"].attrs["units"] == "Delta0"


def test_effects_follow_the_bound_of_the_strike(watched: Record) -> None:
    effects = watched.info["effects"]
    assert effects["shear"]["on"]
    assert not effects["contact_opening"]["called_for"]
    strong = STRIKE.with_values({"striker.1.velocity": 5.0, "effects.friction": 0.3})
    found = {each.name: each for each in prepare(strong).effects}
    assert found["contact_opening"].called_for
    assert found["sliding"].called_for
    pressed = STRIKE.with_values(STILL | STRIKES["pressed"] | {"striker.1.velocity": 5.0})
    for faces in ("held", "wall"):
        with pytest.raises(SceneError, match="in a strike this strong, contacts slide before they open"):
            prepare(pressed.with_values({"packing.first": faces, "packing.last": faces}))


@pytest.mark.parametrize(("launcher", "ranks"), members([("lmp", 1), ("lmp", 2)], ("lmp", 2)))
def test_routes_agree(watched: Record, launcher: Any, ranks: int, tmp_path: Path) -> None:
    other = run(WATCHED, tmp_path / "run", launcher=launcher, ranks=ranks)
    np.testing.assert_allclose(other.displacement, watched.displacement, rtol=0, atol=1e-12)
    assert other.monitor("m").contacts.normal == pytest.approx(watched.monitor("m").contacts.normal, abs=1e-9)


def test_monitors_have_the_unit_of_forces_of_the_crystal(watched: Record) -> None:
    at_rest = watched.problem.rest.contacts.contact_force / (WATCHED.sphere.normal_stiffness * WATCHED.scale.length)
    of_monitor = watched.monitor("m").contacts.normal[0]
    assert np.abs(of_monitor).max() <= np.abs(at_rest).max() * 1.01
    assert np.abs(of_monitor).max() > 1e-3


def test_tolerance_bounds_the_departure_from_the_network(tmp_path: Path) -> None:
    scene = STRIKE.with_values({"time.tolerance": 1e-4} | SPREAD)
    found = outcome(scene, tmp_path)
    assert found.departure < 1e-4
    errors = load(tmp_path / "stepNone").info["error_estimate"]
    assert max(errors.values()) <= 1e-4


def test_sweeps_and_exports_take_such_scenes(watched: Record, tmp_path: Path) -> None:
    rows = sweep(STRIKE, {"striker.1.velocity": [1e-3, 2e-3]}, tmp_path / "sweep").rows
    assert [row["status"] for row in rows] == ["finished"] * 2
    for suffix in ("csv", "nc", "xyz"):
        assert export(watched, tmp_path / f"out.{suffix}") or (tmp_path / f"out.{suffix}").is_file()


@pytest.mark.usefixtures("unrendered")
def test_compare_takes_the_network(watched: Record, capsys: pytest.CaptureFixture[str]) -> None:
    assert compare.main([str(watched.folder)]) == 0
    assert "network" in capsys.readouterr().out


def test_a_tone_is_read_off_without_a_wave() -> None:
    tone = STRIKE.with_values({"striker": [], "source": [PUSH | {"frequency": 0.5}]})
    assert drive_of(tone) == (0.5, 20.0)
    with pytest.raises(ReadoutError, match="wave: missing table: nothing drives the crystal at one frequency"):
        drive_of(STRIKE)


# --- what a file means ------------------------------------------------------------------------------------------------


def test_a_scene_reads_back_as_it_was_written() -> None:
    for changes in STRIKES.values():
        scene = STRIKE.with_values(changes)
        assert Scene.loads(scene.to_toml()) == scene
        assert Scene.loads(scene.to_toml(full=True)) == scene


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"striker": []}, "striker: missing; an impact needs a table [[striker]], or a [start]"),
        ({"packing.ends": "periodic"}, "packing.rows = 13: must be even in a periodic cell"),
        (
            {"packing.rows": 12, "packing.ends": "periodic", "packing.last": "held"},
            'packing.last = "held": must be "free"',
        ),
        ({"striker.1.velocity": 1e-9, "packing.rows": 10001}, "striker, start or source: would stretch contacts by"),
        ({"source": [PUSH | {"signal": "burst"}]}, "source 1: frequency: missing; without [wave] it must be given"),
        ({"absorb.rows": 3}, "absorb.rows = 3: must be 0 beside [[striker]] or [start]"),
        ({"output.spheres": [[99, 0]]}, "output: sphere [99, 0]: must be [row, column]"),
        ({"packing.contact_force": 1e-7}, "packing.contact_force = 1e-07: must be 0 with free faces"),
        (
            {"sphere.work_of_adhesion": 0.0, "sphere.adhesion_law": "jkr"},
            "sphere.adhesion_law: is only for spheres that adhere",
        ),
    ],
)
def test_what_a_crystal_at_rest_cannot_be_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=re.escape(message)):
        STRIKE.with_values(changes)


def test_a_value_of_a_wave_alone_is_refused_where_there_is_none() -> None:
    for scene in (STRIKE, Scene.load("solitary_chain")):
        with pytest.raises(
            SceneError, match=r"^wave\.amplitude: the scene has no \[wave\]; wave\.mode, wave\.wavenumber must"
        ):
            scene.with_values({"wave.amplitude": 0.1})
    wave = {"wave.mode": "TR", "wave.amplitude": 0.1, "wave.frequency": 2e8, "time.allow_echo": True}
    assert STRIKE.with_values(wave | {"striker.1.spheres": [[5, 4]]}).wave.mode == "TR"


def test_a_theory_says_what_it_leaves_out_as_a_file_has_it() -> None:
    struck = Setting(Scene.load("struck_sheet"))
    with pytest.raises(ValueError, match=r"leaves out disorder\.density = 0\.1, .*, 1 table \[\[striker\]\]$"):
        struck.refuse(CRYSTAL_KEYS)


def test_what_needs_a_wave_says_so() -> None:
    with pytest.raises(SceneError, match=r"wave: missing table; .* and no wave with a mode"):
        mode_of(STRIKE)
