"""A finished folder lists what its run wrote: what was changed or is gone is refused, and can be accepted."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.tools import compare
from granular_lmp import ImpactRecord, ImpactScene, Record, Scene, run, run_impact
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.outputs import DUMP, LOG, SNAPSHOTS, STATUS
from granular_lmp.runs import seal
from granular_lmp.runs.record import TRAJECTORY, read_status, write_status
from granular_lmp.runs.seal import accept, refuse_changed
from granular_lmp.studies.sweep import Sweep, sweep
from tests.conftest import PAPER

WAVE = PAPER.with_values(
    {
        "name": "sealed",
        "packing.rows": 8,
        "packing.ends": "periodic",
        "wave.wavenumber": 0.7853981633974483,
        "time.duration": 4.0,
        "output.particles": 1.0,
        "monitor": [{"name": "line", "rows": [1, 2]}, {"name": "through", "rows": [3, 3], "what": "flux"}],
    }
)
CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.rows": 10, "time.duration": 20.0})
COARSE = {"time.tolerance": 1e-2}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Finished runs of each kind, not to be changed."""
    folder = tmp_path_factory.mktemp("sealed")
    run(WAVE, folder / "wave")
    run(WAVE.with_values({"wave.amplitude": 0.1}), folder / "other")
    run(WAVE.with_values(COARSE), folder / "steps")
    run_impact(CHAIN, folder / "impact")
    run_impact(CHAIN.with_values(COARSE), folder / "impact_steps")
    return folder


@pytest.fixture
def copied(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "sealed"))


def read_all(folder: Path) -> None:
    """Read a run folder with all that it holds."""
    if "impact" in folder.name:
        ImpactRecord.load(folder)
        return
    record = Record.load(folder)
    record.snapshots()
    record.monitor("line")
    assert len(record.monitor("through").flux)


def refused(folder: Path, name: str, said: str) -> None:
    pattern = rf"{re.escape(str(folder / name))}: .*{said}.*granular-lmp accept"
    with pytest.raises(RunFolderError, match=pattern):
        read_all(folder)


@pytest.mark.parametrize("kind", ["wave", "steps", "impact", "impact_steps"])
def test_every_file_of_a_finished_run_is_listed(kind: str, finished: Path) -> None:
    there = {path.name for path in (finished / kind).iterdir() if path.is_file()} - {STATUS}
    parts = {f"{path.name}/{STATUS}" for path in (finished / kind).glob("*_per_sample")}
    assert set(read_status(finished / kind)["files"]) == there | parts
    assert bool(parts) == ("steps" in kind)
    read_all(finished / kind)


@pytest.mark.parametrize("kind", ["wave", "steps", "impact", "impact_steps"])
def test_each_file_that_was_changed_or_is_gone_is_refused(kind: str, copied: Path) -> None:
    folder = copied / kind
    for name in [*read_status(folder)["files"], STATUS]:
        path = folder / name
        content = path.read_bytes()
        last = content.rstrip()[-1:]  # a digit of a number, or the end of an object
        changed = content.rstrip()[:-1] + (b"7" if last != b"7" else b"8") + content[len(content.rstrip()) :]
        for text, said in ((changed, "changed|cannot be read"), (None, "missing|no run.json|cannot be read|no such")):
            if text is None:
                path.unlink()
            else:
                path.write_bytes(text)
            with pytest.raises(RunFolderError, match=rf"{re.escape(str(path.parent))}.*({said})"):
                read_all(folder)
            path.write_bytes(content)
    read_all(folder)


def test_the_guard_of_an_impact_is_not_to_be_changed(copied: Path) -> None:
    path = copied / "impact" / STATUS
    info = json.loads(path.read_text())
    info["guards"]["largest_overlap"]["value"] /= 2
    path.write_text(json.dumps(info))
    refused(copied / "impact", STATUS, "was changed since the run wrote it")


@pytest.mark.parametrize("name", [SNAPSHOTS, "monitor.line.bin", "monitor.through.contacts"])
def test_snapshots_and_monitors_of_another_run_are_refused(name: str, copied: Path) -> None:
    shutil.copy(copied / "other" / name, copied / "wave" / name)
    refused(copied / "wave", name, "was changed since the run wrote it")


def test_snapshots_that_the_run_did_not_write_are_refused(small: Scene, copied: Path, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    shutil.copy(copied / "wave" / SNAPSHOTS, tmp_path / "run" / SNAPSHOTS)
    with pytest.raises(RunFolderError, match="was not written by the run of its folder"):
        Record.load(tmp_path / "run").snapshots()


def test_a_trajectory_whose_dump_is_gone_is_refused(copied: Path) -> None:
    folder = copied / "wave"
    lines = (folder / TRAJECTORY).read_text().splitlines()
    doubled = [",".join([tau, *(repr(2 * float(x)) for x in rest)]) for tau, *rest in (s.split(",") for s in lines[1:])]
    (folder / TRAJECTORY).write_text("\n".join([lines[0], *doubled, ""]))
    (folder / DUMP).unlink()
    refused(folder, DUMP, "is missing")


@pytest.mark.parametrize("key", ["files", "sealed", "status"])
def test_a_run_json_that_says_less_is_refused(key: str, copied: Path) -> None:
    for kind in ("steps", "impact_steps"):
        path = copied / kind / STATUS
        info = json.loads(path.read_text())
        del info[key]
        path.write_text(json.dumps(info))
        with pytest.raises(RunFolderError, match=re.escape(str(path))):
            read_all(copied / kind)


def test_a_step_of_another_run_is_refused(copied: Path, tmp_path: Path) -> None:
    run(WAVE.with_values(COARSE | {"wave.amplitude": 0.1}), tmp_path / "weaker")
    part = sorted((copied / "steps").glob("*_per_sample"))[-1]
    shutil.rmtree(part)
    shutil.copytree(tmp_path / "weaker" / part.name, part)
    refused(copied / "steps", f"{part.name}/{STATUS}", "was changed since the run wrote it")


def test_a_run_to_a_tolerance_is_not_continued_from_a_step_that_was_changed(copied: Path) -> None:
    folder = copied / "steps"
    write_status(folder, read_status(folder) | {"status": "interrupted"})
    part = min(folder.glob("*_per_sample"), key=lambda path: int(path.name.split("_")[0]))
    (part / LOG).write_text("changed")
    with pytest.raises(RunFolderError, match=r"log\.lammps: was changed since the run wrote it"):
        resume(folder)


def test_commands_refuse_in_one_line_what_was_changed(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for kind in ("wave", "impact"):
        folder = copied / kind
        with (folder / LOG).open("a") as stream:
            stream.write("more\n")
        for words in (["view", "-o", "x.png"], ["export", "-o", "x.csv"], ["resume"]):
            assert main([words[0], str(folder), *words[1:]]) == 2
            error = capsys.readouterr().err
            assert error.count("\n") == 1
            assert "was changed since" in error or words == ["resume"]
    with pytest.raises(SystemExit, match=r"log\.lammps: was changed since"):
        compare.main([str(copied / "wave")])


def test_a_sweep_says_which_run_was_changed_and_makes_it_again(small: Scene, tmp_path: Path) -> None:
    changes: list[Callable[[Path], None]] = [
        lambda folder: (folder / DUMP).unlink(),
        lambda folder: (folder / STATUS).write_text((folder / STATUS).read_text().replace("40,", "41,")),
    ]
    done = sweep(small, {"wave.amplitude": [0.1, 0.2]}, tmp_path)
    for change in changes:
        change(tmp_path / done.rows[0]["run"])
        found = Sweep.load(tmp_path)
        assert list(found.column("status")) == ["failed", "finished"]
        assert "granular-lmp accept" in found.rows[0]["message"]
        with pytest.raises(RunFolderError, match="granular-lmp accept"):
            found.record(found.rows[0])
        again = sweep(small, {"wave.amplitude": [0.1, 0.2]}, tmp_path)
        np.testing.assert_array_equal(again.column("largest_q"), done.column("largest_q"))


def test_files_of_the_user_are_the_user_s(copied: Path) -> None:
    for kind in ("wave", "steps", "impact", "impact_steps"):
        (copied / kind / "notes.txt").write_text("mine")
        (copied / kind / "compare.png").touch()
        read_all(copied / kind)


def test_what_was_changed_on_purpose_is_accepted_and_said(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for kind in ("wave", "impact"):
        folder = copied / kind
        (folder / LOG).write_text("of another machine\n")
        assert main(["accept", str(folder)]) == 0
        assert f"{folder}/{LOG}: accepted" in capsys.readouterr().out
        read_all(folder)
        assert read_status(folder)["accepted"] == [LOG]
    notes = compare.compare(Record.load(copied / "wave")).notes
    assert "files were changed after the run, and accepted: log.lammps" in notes
    assert accept(copied / "wave") == []
    path = copied / "wave" / STATUS
    path.write_text(path.read_text().replace('"steps": 80', '"steps": 81'))
    assert accept(copied / "wave") == [STATUS]
    assert read_status(copied / "wave")["accepted"] == [LOG, STATUS]
    read_all(copied / "wave")


def test_steps_are_accepted_with_their_run_and_those_that_are_gone(copied: Path) -> None:
    folder = copied / "steps"
    first, *_, last = sorted(folder.glob("*_per_sample"))
    (last / LOG).write_text("shorter\n")
    shutil.rmtree(first)
    found = accept(folder)
    assert found == [f"{last.name}/{LOG}", f"{first.name}/{STATUS}", f"{last.name}/{STATUS}"]
    Record.load(folder)


def test_another_scene_is_another_run_and_not_accepted(copied: Path) -> None:
    path = copied / "wave" / "scene.toml"
    path.write_text(path.read_text().replace("amplitude = 0.2", "amplitude = 0.3"))
    with pytest.raises(RunFolderError, match=r"scene\.toml was changed since the run began"):
        accept(copied / "wave")


def test_large_files_are_compared_when_they_are_read(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = read_status(copied / "wave")
    path = copied / "wave" / SNAPSHOTS
    path.write_bytes(path.read_bytes()[:-2] + b"7\n")
    with pytest.raises(SystemExit, match=SNAPSHOTS):  # small ones by every reader
        compare.main([str(copied / "wave")])
    monkeypatch.setattr(seal, "_QUICK", 0)
    refuse_changed(copied / "wave", info, lazily=True)
    path.write_bytes(path.read_bytes()[:-2])
    with pytest.raises(RunFolderError, match=SNAPSHOTS):
        refuse_changed(copied / "wave", info, lazily=True)
