"""A finished sweep is known again as long as nothing that its table follows from has changed."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from shutil import copytree

import pytest

from granular_lmp.errors import GranularError
from granular_lmp.rest.scene import Scene
from granular_lmp.studies import sweep as module
from granular_lmp.studies import sweep_memory
from granular_lmp.studies.sweep import Sweep, sweep
from granular_lmp.studies.sweep_memory import recalled

SMALL = Scene.load("tr_periodic").with_values({"packing.rows": 8, "time.duration": 2.0})
OVER = {"wave.amplitude": [0.1, 0.2]}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    return sweep(SMALL, OVER, tmp_path_factory.mktemp("memory") / "sweep")


def request(folder: Path) -> dict[str, object]:
    return json.loads((folder / "sweep.json").read_text())


def test_a_finished_sweep_is_known_without_its_runs_being_read(done: Sweep, monkeypatch: pytest.MonkeyPatch) -> None:
    table, files = (done.folder / "sweep.csv").read_bytes(), set(done.folder.iterdir())
    (done.folder / "sweep.csv").unlink()
    monkeypatch.setattr(module, "points", None)
    monkeypatch.setattr(module, "row_of", None)
    assert sweep(SMALL, OVER, done.folder) == Sweep.load(done.folder) == done
    assert (done.folder / "sweep.csv").read_bytes() == table
    assert set(done.folder.iterdir()) == files


def edit(path: Path) -> None:
    text = path.read_bytes()
    path.write_bytes(text.replace(b"1", b"2", 1))  # the file keeps its length


CHANGES: dict[str, Callable[[Path], object]] = {
    **{f"*{name}": lambda path: edit(path) for name in ("run.json", "dump.centre", "trajectory.csv", "scene.toml")},
    "*log.lammps": Path.unlink,
    "": lambda run: run.rename(run.with_name("0" * 16)),
    "../../known.json": edit,
    "../../sweep.json": edit,
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_was_changed_is_read_again(name: str, done: Sweep, tmp_path: Path) -> None:
    folder = copytree(done.folder, tmp_path / "sweep")
    assert recalled(folder, request(folder)) == (done.rows, done.notes)
    CHANGES[name](folder / done.rows[0]["run"] / name.removeprefix("*"))
    try:
        asked = request(folder)
    except ValueError:
        return
    assert recalled(folder, asked) is None
    if name.startswith("*"):
        assert [row["status"] for row in Sweep.load(folder).rows] == ["failed", "finished"]


def test_another_package_reads_the_runs_again(done: Sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "module.py").touch()
    monkeypatch.setattr(sweep_memory, "_PACKAGE", tmp_path)
    assert recalled(done.folder, request(done.folder)) is None
    sweep_memory.remember(done.folder, request(done.folder), done.rows, done.notes)
    assert recalled(done.folder, request(done.folder)) is not None
    os.utime(tmp_path / "module.py", ns=(1, 1))
    assert recalled(done.folder, request(done.folder)) is None


def test_a_sweep_with_a_failed_run_or_over_files_is_not_remembered(done: Sweep, tmp_path: Path) -> None:
    folder, asked = copytree(done.folder, tmp_path / "sweep"), request(done.folder)
    for over, status in ((asked["over"], "failed"), ({"start.state": ["state.csv"]}, "finished")):
        rows = [row | {"status": status} for row in done.rows]
        sweep_memory.remember(folder, asked | {"over": over}, rows, [])
        assert not (folder / "known.json").exists()


def test_another_sweep_in_the_folder_is_refused_as_before(done: Sweep) -> None:
    with pytest.raises(GranularError, match="holds another sweep, over wave.amplitude"):
        sweep(SMALL, {"wave.amplitude": [0.1, 0.3]}, done.folder)
