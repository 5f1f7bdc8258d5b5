"""Sweeps on a real Slurm of one machine that are cancelled, preempted and killed, and asked for again.

``make engines`` runs them where Slurm is there (`slurm_of_one_machine.sh`); elsewhere they are left out.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from granular_lmp.studies.sweep import Sweep, sweep
from tests.engines.on_engine import OVER, SCENE

HERE = Path(__file__).parent
SCRIPT = HERE / "slurm_of_one_machine.sh"
ENGINES = {"mpi4py": "mpi4py", "submitit": "submitit", "executorlib": "executorlib", "dask": "dask_jobqueue"}
IN_ALLOCATION = {"mpi4py", "executorlib"}  # the others submit jobs themselves

pytestmark = pytest.mark.skipif(
    not all(shutil.which(each) for each in ("slurmctld", "slurmd", "munged"))
    or os.getuid() != 0
    or not any(map(importlib.util.find_spec, ENGINES.values())),
    reason="no engine of sweeps is installed, or Slurm is not there or cannot be started",
)


@pytest.fixture(scope="module", autouse=True)
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    folder = tmp_path_factory.mktemp("slurm")
    subprocess.run([SCRIPT, "start", folder], check=True)
    os.environ["SLURM_CONF"] = str(folder / "slurm.conf")
    yield
    del os.environ["SLURM_CONF"]
    subprocess.run([SCRIPT, "stop", folder], check=True)


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    return sweep(SCENE, OVER, tmp_path_factory.mktemp("local") / "sweep")


def jobs() -> list[str]:
    """Return the numbers of the jobs that run."""
    return subprocess.run(["squeue", "-h", "-t", "R", "-o", "%A"], capture_output=True, text=True).stdout.split()


def queued() -> bool:
    return bool(subprocess.run(["squeue", "-h"], capture_output=True, text=True).stdout)


def wait_for(condition: Callable[[], object], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the condition did not come true"
        time.sleep(0.1)


def started(engine: str, folder: Path) -> subprocess.Popen[bytes]:
    """Start the sweep on an engine: in a batch job where the engine works in an allocation."""
    command = [sys.executable, str(HERE / "on_engine.py"), engine, str(folder)]
    if engine == "mpi4py":
        mpiexec = str(Path(sys.executable).parent / "mpiexec")
        command = [mpiexec, "-n", "3", sys.executable, "-m", "mpi4py.futures", *command[1:]]
    if engine in IN_ALLOCATION:
        script = folder.with_suffix(".sh")
        script.write_text(f"#!/bin/sh\nexec {' '.join(command)}\n")
        command = ["sbatch", "--wait", "-n", "3", "-o", f"{folder}.out", "-J", engine, str(script)]
    return subprocess.Popen(
        command,
        cwd=folder.parent,
        env=os.environ | {"PYTHONPATH": str(HERE.parents[1])},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def cancel() -> None:
    for job in jobs():
        subprocess.run(["scancel", job], check=True)


def preempt() -> None:
    subprocess.run(["sbatch", "-p", "urgent", "-N2", "--exclusive", "-o", "/dev/null", "--wrap", "sleep 2"], check=True)


def kill() -> None:
    for job in jobs():
        subprocess.run(["scancel", "--signal=KILL", "--full", job], check=True)


@pytest.mark.parametrize("fault", [cancel, preempt, kill], ids=lambda each: each.__name__)
@pytest.mark.parametrize("engine", ENGINES)
def test_a_sweep_is_finished_after_a_fault(
    engine: str, fault: Callable[[], None], local: Sweep, tmp_path: Path
) -> None:
    if importlib.util.find_spec(ENGINES[engine]) is None:
        pytest.skip(f"{engine} is not installed")
    folder = tmp_path / "sweep"
    process = started(engine, folder)
    try:
        wait_for(lambda: list(folder.glob("runs/*/checkpoint.?")))
        fault()
        time.sleep(3)  # what the engine does about it by itself
    finally:
        process.terminate()
        subprocess.run(["scancel", "--user", "root", "--partition", "all"], check=True)
        process.wait(60)
        wait_for(lambda: not queued())
    interrupted = [each.parent for each in folder.glob("runs/*/checkpoint.?")]
    assert interrupted  # the fault came in the midst of a run
    done = sweep(SCENE, OVER, folder)
    assert [row["status"] for row in done.rows] == ["finished"] * len(local.rows)
    for mine, theirs in zip(done.rows, local.rows, strict=True):
        for name in ("dump.centre", "trajectory.csv"):
            assert (folder / mine["run"] / name).read_bytes() == (local.folder / theirs["run"] / name).read_bytes()
    for each in interrupted:  # continued, not begun again
        assert "read_restart" in (each / "log.lammps").read_text()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_sweep_on_slurm_is_that_of_this_machine(engine: str, local: Sweep, tmp_path: Path) -> None:
    if importlib.util.find_spec(ENGINES[engine]) is None:
        pytest.skip(f"{engine} is not installed")
    assert started(engine, tmp_path / "sweep").wait(180) == 0
    done = Sweep.load(tmp_path / "sweep")
    assert [row["status"] for row in done.rows] == ["finished"] * len(local.rows)
    for column in ("largest_p", "second_harmonic"):
        assert list(done.column(column)) == list(local.column(column))
