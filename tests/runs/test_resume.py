"""A continuation trusts fields of ``run.json``, the ranks of this machine and checkpoints only where they fit."""

import json
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

import pytest

from granular_lmp import ImpactScene, Record, Scene, run, run_impact
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.cli import main
from granular_lmp.errors import EffectError, GranularError, LammpsError, LaunchError, RunFolderError, RunInterrupted
from granular_lmp.lammps.outputs import CHECKPOINTS, DUMP, LOG, SCENE, STATUS
from granular_lmp.runs import launch
from granular_lmp.runs.continuation import whole_checkpoints
from granular_lmp.runs.fields import FIELDS, refuse_malformed
from granular_lmp.runs.options import core_count
from granular_lmp.runs.record import read_status, write_status
from granular_lmp.runs.status import seal_of
from tests.conftest import PAPER, members
from tests.pause import as_if_killed, paused

# 8 rows, as `small`, with a monitor; 12,000 steps, and few records, which each continuation reads again
WAVE = PAPER.with_values(
    {
        "name": "stopped",
        "packing.rows": 8,
        "packing.ends": "periodic",
        "wave.wavenumber": 0.7853981633974483,
        "time.duration": 600.0,
        "time.sample": 10.0,
        "monitor": [{"name": "line", "rows": [1, 2]}],
    }
)
CHAIN = ImpactScene.load("solitary_chain").with_values(
    {"packing.rows": 10, "time.duration": 400.0, "time.sample": 10.0, "output.checkpoint": 3e-5}
)
OPENS = PAPER.with_values(
    {
        "packing.rows": 16,
        "packing.ends": "periodic",
        "wave.form": "standing",
        "wave.mode": "L",
        "sphere.poisson_ratio": 0.3,
        "wave.wavenumber": 2.356194490192345,
        "wave.phase": 0.3,
        "wave.amplitude": 0.56,  # contacts open at tau = 3.45, see tests/lammps/test_guards.py
        "time.duration": 10.0,
    }
)
SHORT = {"time.duration": 20.0}


def stopped(scene: Scene | ImpactScene, folder: Path) -> Path:
    with paused(folder), pytest.raises(RunInterrupted):
        run(scene, folder)
    assert whole_checkpoints(folder)
    return folder


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Stopped runs, not to be changed."""
    folder = tmp_path_factory.mktemp("stopped")
    scenes = {
        "wave": WAVE,
        "weaker": WAVE.with_values({"wave.amplitude": 0.1}),
        "impact": CHAIN,
        "faster": CHAIN.with_values({"striker.1.velocity": 2.0}),
    }
    return {name: stopped(scene, folder / name) for name, scene in scenes.items()}


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """``run.json`` of finished runs of each kind."""
    folder = tmp_path_factory.mktemp("ended")
    return {
        "wave": run(WAVE.with_values(SHORT), folder / "wave").info,
        "steps": run(WAVE.with_values(SHORT | {"time.tolerance": 1e-2}), folder / "steps").info,
        "impact": run(CHAIN.with_values(SHORT), folder / "impact").info,
        "impact to a tolerance": run(CHAIN.with_values(SHORT | {"time.tolerance": 1e-2}), folder / "impact_steps").info,
    }


def continued(folder: Path) -> object:
    return resume(folder)


# --- each field of run.json ---


def test_every_field_that_a_run_writes_is_declared(ended: dict[str, dict[str, Any]]) -> None:
    assert {key for info in ended.values() for key in info} <= set(FIELDS)


WRONG = [None, True, -1, 2.5, "x", [], {}, [None], {"x": None}, nan, 10**400, "\ud800"]


def changed(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Put each wrong value into each place of nested objects and lists, yield the path of the place, and undo it."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in [*inner]:
        for wrong in WRONG:
            value[key] = wrong
            yield (*path, key)
        value[key] = each
        yield from changed(each, (*path, key))


def malformed(info: dict[str, Any]) -> None:
    try:
        refuse_malformed(info)
    except ValueError as error:
        raise RunFolderError(str(error)) from error


def refusal(door: Callable[[], object]) -> str:
    """Return what a refusal says; nothing if there is none."""
    try:
        door()
    except GranularError as error:
        return str(error)
    return ""


# A run to a tolerance has the fields of one run, and its own
@pytest.mark.parametrize("kind", members(["wave", "steps", "impact", "impact to a tolerance"], "steps", "impact"))
def test_a_wrong_value_in_any_field_is_one_line_and_never_a_traceback(
    kind: str,
    ended: dict[str, dict[str, Any]],
    cut: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unmoved(*arguments: Any, **options: Any) -> None:
        raise LammpsError("not run in this test", "", "")

    monkeypatch.setattr("granular_lmp.runs.loop.execute", unmoved)
    monkeypatch.setattr(launch, "launch", unmoved)
    of = "impact" if "impact" in kind else "wave"
    folder = Path(shutil.copytree(cut[of], tmp_path / "run"))
    there = ended[kind] | {name: read_status(folder)[name] for name in ("scene_sha256", "status", "steps")}
    loaded = partial(Record.load, folder, unfinished=True)
    refused = 0
    for path in changed(there):
        if len(path) > 1:  # inside a field: the file is one object to all doors
            said = refusal(lambda: malformed(there))
        else:
            (folder / STATUS).write_text(json.dumps(there | {"sealed": seal_of(there)}))
            said = refusal(lambda: read_status(folder)).partition(f"{STATUS}: ")[2]
            assert "\n" not in (said or refusal(loaded) + refusal(lambda: continued(folder)))
        if said:
            key = ".".join(str(each + 1 if isinstance(each, int) else each) for each in path)
            named = said.split(" = ")[0].split(": must hold")[0]
            assert named.startswith(key) or key.startswith(named)
            refused += 1
    assert refused > 5 * len(there)


# --- ranks ---


@pytest.mark.parametrize("kind", ["wave", "impact", "tolerance"])
def test_no_more_ranks_are_started_than_there_are_cores(kind: str, cut: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(cut["wave" if kind == "tolerance" else kind], tmp_path / "run"))
    info = read_status(folder) | {"ranks": 40 * core_count(), "launcher": "lmp"}
    write_status(folder, info | ({"tolerance": 1e-2} if kind == "tolerance" else {}))
    with pytest.raises(LaunchError, match=rf"run\.json: ranks = {40 * core_count()}: must be from 1 to {core_count()}"):
        continued(folder)


# --- checkpoints ---


@pytest.mark.parametrize(("of", "other"), [("wave", "weaker"), ("impact", "faster")])
def test_a_checkpoint_of_another_run_is_refused(of: str, other: str, cut: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(cut[of], tmp_path / "run"))
    as_if_killed(folder)
    for name in CHECKPOINTS:
        if (cut[other] / name).is_file():
            shutil.copy(cut[other] / name, folder / name)
    with pytest.raises(RunFolderError, match=r"checkpoint\.\w: is not of the scene of this run"):
        continued(folder)


@pytest.mark.parametrize("name", [DUMP, LOG, "data.stopped", "monitor.line.bin", CHECKPOINTS[0]])
def test_a_file_of_a_stopped_run_that_was_changed_is_refused(name: str, cut: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(cut["wave"], tmp_path / "run"))
    content = bytearray((folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / name).write_bytes(content)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(RunFolderError, match=f"{name}: was changed since .*; put it back, or run the scene again with"):
        resume(folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    shutil.copy(cut["wave"] / name, folder)
    assert resume(folder).info["status"] == "finished"


# --- links ---


def test_a_changed_status_of_a_stopped_run_is_put_back_or_run_again(cut: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(cut["wave"], tmp_path / "run"))
    info = json.loads((folder / STATUS).read_text())
    (folder / STATUS).write_text(json.dumps(info | {"ranks": 2}))
    with pytest.raises(
        RunFolderError, match="was changed since .*put it back, or run the scene again with force=True$"
    ):
        resume(folder)  # `accept` takes finished runs only


@pytest.mark.parametrize("name", [DUMP, LOG, STATUS, SCENE, "in.stopped.resume", f"{DUMP}.part", "monitor.line.bin"])
def test_a_continuation_writes_through_no_link(name: str, cut: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(cut["wave"], tmp_path / "run"))
    target = tmp_path / "elsewhere"
    if (folder / name).exists():
        (folder / name).rename(target)
    else:
        target.write_text("of the user")
    (folder / name).symlink_to(target)
    before = target.read_bytes()
    with pytest.raises(RunFolderError, match=rf"{name}: is a link, or no plain file"):
        resume(folder)
    assert target.read_bytes() == before


def test_the_folder_of_a_step_that_is_a_link_is_not_written_into(small: Scene, tmp_path: Path) -> None:
    scene = small.with_values({"time.tolerance": 1e-2})
    run(scene, tmp_path / "run")
    part = sorted((tmp_path / "run").glob("*_per_sample"))[0]
    part.rename(tmp_path / "elsewhere")
    part.symlink_to(tmp_path / "elsewhere")
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "elsewhere").iterdir()}
    with pytest.raises(RunFolderError, match="is a link, or no plain file"):
        run(scene, tmp_path / "run", force=True)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "elsewhere").iterdir()} == before


# --- runs that failed ---


@pytest.mark.parametrize("often", [{}, {"output.checkpoint": 1e-5}], ids=["no checkpoint", "a checkpoint"])
def test_a_run_that_a_guard_failed_is_called_failed(often: dict[str, Any], tmp_path: Path) -> None:
    scene = OPENS.with_values(often)
    with pytest.raises(EffectError, match="triggered its guard"):
        run(scene, tmp_path / "run")
    assert bool(whole_checkpoints(tmp_path / "run")) == bool(often)
    with pytest.raises(RunFolderError, match="run: the run failed; there is nothing to resume: .* triggered its guard"):
        resume(tmp_path / "run")


def test_a_run_that_a_guard_had_failed_when_it_was_interrupted_says_so(tmp_path: Path) -> None:
    found = r"contact_opening triggered its guard at tau = 3\.2: .*; set effects\.contact_opening = true"
    with paused(tmp_path / "run", 0.6), pytest.raises(RunInterrupted, match=f"run: interrupted; {found}"):
        run(OPENS, tmp_path / "run")
    assert read_status(tmp_path / "run")["status"] == "failed"
    with pytest.raises(RunFolderError, match=f"the run failed; there is nothing to resume: {found}"):
        resume(tmp_path / "run")


def test_an_impact_that_a_guard_failed_is_called_failed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # As in tests/studies/test_far_sphere.py: two spheres would overlap by 0.0497 of the diameter, a row of them is more
    scene = ImpactScene.from_dict(
        CHAIN.with_values({"packing.last": "wall", "time.duration": 20.0, "time.sample": 1.0}).to_dict()
        | {"striker": [{"rows": [0, 3], "velocity": 118.0}]}
    )
    with pytest.raises(EffectError, match="largest_overlap"):
        run_impact(scene, tmp_path / "run")
    assert main(["resume", str(tmp_path / "run")]) == 2
    assert (
        "the run failed; there is nothing to resume: deep_overlap triggered its guard at tau = "
        in capsys.readouterr().err
    )
