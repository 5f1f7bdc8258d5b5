"""The files of a run folder are compared with each other, and one that is of another run is refused by name."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
from granular_lmp.accuracy.tolerance import run as run_any
from granular_lmp.effects.selection import EFFECTS, select, switches
from granular_lmp.errors import RunFolderError
from granular_lmp.problem import prepare
from granular_lmp.runs.agreement import SAME, refuse_other_trajectory, scene_digest
from granular_lmp.runs.formats import FORMAT
from granular_lmp.runs.launch import resume
from granular_lmp.runs.record import TRAJECTORY, read_status, write_status
from tests.conftest import PAPER
from tests.pause import as_if_killed
from tests.stand_in import of_first_format

Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run, not to be changed."""
    scene = PAPER.with_values({"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": 0.7853981633974483})
    folder = tmp_path_factory.mktemp("agreement") / "run"
    run(scene.with_values({"name": "small", "time.duration": 2.0}), folder)
    return folder


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    """A copy of the finished run."""
    return Path(shutil.copytree(whole, tmp_path / "run"))


def refused(folder: Path, said: str) -> None:
    """The folder is refused by library and script, in one line that names it and says why."""
    with pytest.raises(RunFolderError, match=said) as caught:
        Record.load(folder)
    assert str(folder) in str(caught.value)
    with pytest.raises(SystemExit, match=said) as stopped:
        compare.main([str(folder)])
    assert "\n" not in str(stopped.value)


def without(key: str) -> Change:
    return lambda info: info.pop(key)


def changed(dotted: str, value: Any) -> Change:
    """A change of one value of ``run.json``, that may be new there."""
    *path, last = dotted.split(".")

    def change(info: dict[str, Any]) -> None:
        for key in path:
            info = info[key]
        info[last] = value

    return change


LIQUID = {"on": True, "called_for": True, "number": 1.0, "reason": "", "guard": ""}
HEARD = {"effect": "liquid", "quiet": True, "value": 0.0, "meaning": "", "judges": False}
LIES: list[tuple[Change, str]] = [
    (without("scene_sha256"), "scene_sha256 is missing"),
    (without("effects"), "effects is missing"),
    (without("guards"), "guards is missing"),
    (lambda info: info["guards"].pop("row_spread"), 'guards.row_spread.effect = null, but "width" by scene.toml'),
    (lambda info: info["effects"].pop("walls"), "effects.walls.on = null, but false by scene.toml"),
    *(
        (changed(f"effects.{name}.on", not on), f"effects.{name}.on = {json.dumps(not on)}, but {json.dumps(on)}")
        for name, on in {row.name: row.name in ("adhesion", "shear", "rotation", "tracking") for row in EFFECTS}.items()
    ),
    (changed("effects.liquid", LIQUID), 'effects.liquid.on = true, but "no such name" by scene.toml'),
    (changed("effects.liquid", LIQUID | {"on": False}), 'effects.liquid.on = false, but "no such name"'),
    (changed("effects.sliding.guard", ""), 'effects.sliding.guard = "", but "largest_slip"'),
    (changed("effects.sliding.called_for", True), "guards.largest_slip.judges = true, but false"),
    (changed("guards.wetted", HEARD), 'guards.wetted.effect = "liquid", but "no such name"'),
    (changed("guards.largest_slip.quiet", False), "guards.largest_slip.quiet = false, but true"),
    (changed("guards.largest_slip.effect", "width"), 'guards.largest_slip.effect = "width", but "sliding"'),
    (changed("amplitude", 0.1), "amplitude = 0.1, but 0.2 by scene.toml"),
    (changed("wavenumber_used", 0.8), "wavenumber_used = 0.8, but 0.785398"),
    (changed("direction_used", 60.0), "direction_used = 60.0, but 90.0"),
    (without("particles"), "particles = null, but 24"),
]


@pytest.mark.parametrize(("change", "said"), LIES, ids=[said[:40] for _, said in LIES])
def test_a_run_json_that_says_something_else_than_its_scene_is_refused(change: Change, said: str, folder: Path) -> None:
    info = read_status(folder)
    change(info)
    write_status(folder, info)
    refused(folder, re.escape(said))


def test_the_folder_of_a_run_agrees_with_itself_for_each_effect(tmp_path: Path) -> None:
    for number, changes in enumerate(
        [
            {"wave.mode": "L"},
            {"effects.tracking": False},
            {"effects.rotation": False},
            {"effects.shear": False},
            {"effects.friction": 5.0, "effects.sliding": True},
            {"effects.viscosity": 1e-9},
            {"packing.ends": "periodic", "packing.rows": 8, "wave.direction": 30.0},
        ]
    ):
        scene = PAPER.with_values({"packing.rows": 21, "time.duration": 4.0} | changes)
        record = run(scene, tmp_path / str(number))
        assert Record.load(tmp_path / str(number)).info == record.info


@pytest.mark.parametrize(
    "changes", [{}, {"wave.mode": "L"}, {"effects.rotation": False}, {"effects.shear": False}], ids=str
)
def test_what_a_resolved_scene_switches_is_what_the_rules_chose(changes: dict[str, Any]) -> None:
    scene = PAPER.with_values(changes)
    chosen = {effect.name: (effect.on, effect.guard) for effect in select(scene)}
    assert switches(prepare(scene).scene) == chosen


@pytest.mark.parametrize("number", [FORMAT + 1, 0, "2", True, None], ids=repr)
def test_a_folder_of_another_format_is_refused(number: Any, folder: Path) -> None:
    change = json.loads((folder / "run.json").read_text()) | {"format": number}
    write_status(folder, change)
    newer = number == FORMAT + 1
    refused(folder, "written by a newer release" if newer else "must be a whole number from 1 to")


def test_a_run_that_was_stopped_may_say_less_but_nothing_else(folder: Path) -> None:
    info = read_status(folder) | {"status": "interrupted"}
    del info["guards"], info["effects"]
    write_status(folder, info)
    assert len(Record.load(folder, unfinished=True).tau) == 5
    write_status(folder, info | {"amplitude": 0.1})
    with pytest.raises(RunFolderError, match=r"amplitude = 0\.1"):
        Record.load(folder, unfinished=True)


def test_a_run_without_the_digest_of_its_scene_is_not_resumed(folder: Path) -> None:
    info = read_status(folder) | {"status": "interrupted"}
    del info["scene_sha256"]
    write_status(folder, info)
    with pytest.raises(RunFolderError, match="scene_sha256 is missing"):
        resume(folder)
    write_status(folder, info | {"scene_sha256": "0"})
    (folder / "scene.toml").unlink()
    with pytest.raises(RunFolderError, match=r"scene\.toml: cannot be read"):
        resume(folder)


# --- trajectory.csv and dump.centre ---


@pytest.mark.parametrize("column", range(4), ids=["tau", "p", "q", "phi"])
@pytest.mark.parametrize("row", [1, 3, 5])
def test_one_number_of_a_trajectory_that_its_dump_does_not_give_is_refused(row: int, column: int, folder: Path) -> None:
    of_first_format(folder)
    lines = (folder / TRAJECTORY).read_text().splitlines()
    cells = lines[row].split(",")
    cells[column] = repr(float(cells[column]) + 1e-9)
    (folder / TRAJECTORY).write_text("\n".join([*lines[:row], ",".join(cells), *lines[row + 1 :], ""]))
    refused(folder, rf"trajectory\.csv: {['tau', 'p', 'q', 'phi'][column]} = .* by dump\.centre")


def test_the_trajectory_and_the_dump_of_another_run_are_refused(folder: Path, tmp_path: Path) -> None:
    of_first_format(folder)
    scene = Record.load(folder).scene
    run(scene.with_values({"wave.phase": 0.1}), tmp_path / "phase")
    run(scene.with_values({"time.duration": 1.5}), tmp_path / "short")
    for other, name, said in (
        ("phase", TRAJECTORY, "p = "),  # the first of the columns that differ
        ("phase", "dump.centre", "p = "),
        ("short", "dump.centre", "5 records, and dump.centre holds 4"),
    ):
        kept = (folder / name).read_bytes()
        shutil.copy(tmp_path / other / name, folder / name)
        refused(folder, rf"trajectory\.csv: .*{re.escape(said)}")
        (folder / name).write_bytes(kept)
    Record.load(folder)


def test_of_a_run_that_was_stopped_what_both_files_hold_is_compared(folder: Path) -> None:
    write_status(folder, read_status(folder) | {"samples": 4})
    as_if_killed(folder)
    lines = (folder / TRAJECTORY).read_text().splitlines(keepends=True)
    (folder / TRAJECTORY).write_text("".join(lines[:-1]))
    assert len(Record.load(folder, unfinished=True).tau) == 4
    (folder / TRAJECTORY).write_text("".join([*lines[:3], lines[3].replace(",", ",1", 1)]))
    with pytest.raises(RunFolderError, match=r"p = .* by dump\.centre"):
        Record.load(folder, unfinished=True)


def test_neighbouring_doubles_are_the_same_trajectory_and_more_is_not(whole: Path, tmp_path: Path) -> None:
    record = Record.load(whole)
    for off, agree in ((SAME / 10, True), (SAME * 10, False)):
        moved = record.with_signals(q=record.q + off)
        if agree:
            refuse_other_trajectory(tmp_path, moved.columns, record.columns, whole=True)
        else:
            with pytest.raises(RunFolderError, match="q = "):
                refuse_other_trajectory(tmp_path, moved.columns, record.columns, whole=True)


def test_untracked_angles_are_the_same_and_a_number_among_them_is_not(whole: Path, tmp_path: Path) -> None:
    record = Record.load(whole)
    none = record.with_signals(phi=np.full(5, np.nan))
    refuse_other_trajectory(tmp_path, none.columns, none.columns, whole=True)
    with pytest.raises(RunFolderError, match="phi = "):
        refuse_other_trajectory(tmp_path, record.columns, none.columns, whole=True)


def test_a_folder_of_release_0_1_without_a_dump_is_read(folder: Path) -> None:
    of_first_format(folder)
    (folder / "dump.centre").unlink()
    assert len(Record.load(folder).tau) == 5


def test_the_runs_of_a_tolerance_and_their_extrapolation_agree_with_themselves(small: Scene, tmp_path: Path) -> None:
    run_any(small.with_values({"time.tolerance": 1e-2}), tmp_path / "run")
    Record.load(tmp_path / "run")
    parts = sorted((tmp_path / "run").glob("*_per_sample"))
    assert len([Record.load(part) for part in parts]) >= 2
    shutil.copy(parts[0] / TRAJECTORY, of_first_format(parts[1]) / TRAJECTORY)
    refused(parts[1], r"by dump\.centre")


def test_an_extrapolation_that_was_changed_is_refused(small: Scene, tmp_path: Path) -> None:
    run_any(small.with_values({"time.tolerance": 1e-2}), tmp_path / "run")
    written = (tmp_path / "run" / TRAJECTORY).read_text(encoding="utf-8")
    digest = scene_digest(written)
    for part in sorted((tmp_path / "run").glob("*_per_sample")):  # as long as the extrapolation, of the same times
        shutil.copy(part / TRAJECTORY, tmp_path / "run" / TRAJECTORY)
        refused(tmp_path / "run", "trajectory.csv: was changed since the run wrote it")
    # Release 0.1.0 listed no files, and the digest of this one
    info = json.loads((of_first_format(tmp_path / "run") / "run.json").read_text()) | {"trajectory_sha256": digest}
    (tmp_path / "run/run.json").write_text(json.dumps(info))
    refused(tmp_path / "run", "trajectory.csv: was changed since its runs ended")
    (tmp_path / "run" / TRAJECTORY).write_text(written, encoding="utf-8")
    assert len(Record.load(tmp_path / "run").tau) == 5
