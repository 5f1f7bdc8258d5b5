"""A continuation trusts fields of ``run.json``, the ranks of this machine and checkpoints only where they fit."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from granular_lmp import ImpactScene, Scene, run, run_impact
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.cli import main
from granular_lmp.errors import EffectError, LaunchError, RunFolderError, RunInterrupted
from granular_lmp.lammps.outputs import CHECKPOINTS, DUMP, LOG, STATUS
from granular_lmp.runs.continuation import whole_checkpoints
from granular_lmp.runs.options import core_count
from granular_lmp.runs.record import read_status, write_status
from tests.conftest import PAPER
from tests.pause import paused

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
        "impact": CHAIN,
    }
    return {name: stopped(scene, folder / name) for name, scene in scenes.items()}


def continued(folder: Path) -> object:
    return resume(folder)


# --- ranks ---


@pytest.mark.parametrize("kind", ["wave", "impact", "tolerance"])
def test_no_more_ranks_are_started_than_there_are_cores(kind: str, cut: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(cut["wave" if kind == "tolerance" else kind], tmp_path / "run"))
    info = read_status(folder) | {"ranks": 40 * core_count(), "launcher": "lmp"}
    write_status(folder, info | ({"tolerance": 1e-2} if kind == "tolerance" else {}))
    with pytest.raises(LaunchError, match=rf"run\.json: ranks = {40 * core_count()}: must be from 1 to {core_count()}"):
        continued(folder)


# --- checkpoints ---


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


def test_a_changed_status_of_a_stopped_run_is_put_back_or_run_again(cut: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(cut["wave"], tmp_path / "run"))
    info = json.loads((folder / STATUS).read_text())
    (folder / STATUS).write_text(json.dumps(info | {"ranks": 2}))
    with pytest.raises(
        RunFolderError, match="was changed since .*put it back, or run the scene again with force=True$"
    ):
        resume(folder)  # `accept` takes finished runs only


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
