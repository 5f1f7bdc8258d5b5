"""Folders of another format, or without the digest of their scene, are refused; those of release 0.1.0 are read."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
from granular_lmp.accuracy.tolerance import run as run_any
from granular_lmp.errors import RunFolderError
from granular_lmp.runs.formats import FORMAT
from granular_lmp.runs.launch import resume
from granular_lmp.runs.record import TRAJECTORY, read_status, write_status
from tests.conftest import PAPER
from tests.stand_in import of_first_format


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


@pytest.mark.parametrize("number", [FORMAT + 1, 0, "2", True, None], ids=repr)
def test_a_folder_of_another_format_is_refused(number: Any, folder: Path) -> None:
    change = json.loads((folder / "run.json").read_text()) | {"format": number}
    write_status(folder, change)
    newer = number == FORMAT + 1
    refused(folder, "written by a newer release" if newer else "must be a whole number from 1 to")


def test_a_run_without_the_digest_of_its_scene_is_not_resumed(folder: Path) -> None:
    info = read_status(folder) | {"status": "interrupted"}
    del info["scene_sha256"]
    write_status(folder, info)
    with pytest.raises(RunFolderError, match="was changed since the run began"):
        resume(folder)
    (folder / "scene.toml").unlink()
    with pytest.raises(RunFolderError, match=r"scene\.toml: cannot be read"):
        resume(folder)


def test_a_folder_of_release_0_1_without_a_dump_is_read(folder: Path) -> None:
    of_first_format(folder)
    (folder / "dump.centre").unlink()
    assert len(Record.load(folder).tau) == 5


def test_an_extrapolation_that_was_changed_is_refused(small: Scene, tmp_path: Path) -> None:
    run_any(small.with_values({"time.tolerance": 1e-2}), tmp_path / "run")
    written = (tmp_path / "run" / TRAJECTORY).read_text(encoding="utf-8")
    for part in sorted((tmp_path / "run").glob("*_per_sample")):  # as long as the extrapolation, of the same times
        shutil.copy(part / TRAJECTORY, tmp_path / "run" / TRAJECTORY)
        refused(tmp_path / "run", "trajectory.csv: was changed since the run wrote it")
    (tmp_path / "run" / TRAJECTORY).write_text(written, encoding="utf-8")
    assert len(Record.load(tmp_path / "run").tau) == 5
