"""Runs in threads with relative folders: each lands in its own folder, whatever runs beside it."""

import threading
from collections.abc import Callable
from pathlib import Path
from time import sleep

import pytest

from granular_lmp import ImpactRecord, ImpactScene, Record, Scene, run, run_impact
from granular_lmp.runs import directory
from granular_lmp.runs.options import Options
from granular_lmp.scene.collision import Collision
from granular_lmp.studies.collide import run as collide
from granular_lmp.studies.kick import kicked

LONG = 1000.0  # τ of the run beside which the others begin: 20,000 steps of 24 spheres, an eighth of a second
CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.rows": 10, "time.duration": 20.0})


@pytest.fixture(params=[True, False], ids=["directory of the thread", "directory of the process"])
def systems(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Systems that give a thread its own working directory, as this one may, and that refuse."""
    if not request.param:
        monkeypatch.setattr(directory, "_moved_alone", lambda folder: False)
    return bool(request.param)


def test_staggered_runs_with_relative_folders_land_in_their_own(
    systems: bool, small: Scene, tmp_path: Path, fast_looks: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    at_work = threading.Event()
    failed: list[BaseException] = []

    def heard(step: int, steps: int) -> None:
        if 0 < step < steps:
            at_work.set()

    calls: list[Callable[[], object]] = [
        lambda: run(small.with_values({"time.duration": LONG, "time.sample": 10.0}), "out/long", progress=heard),
        lambda: run(small.with_values({"wave.phase": 0.1}), "out/wave"),
        lambda: run(small.with_values({"time.tolerance": 1e-2}), Path("out/to_tolerance")),
        lambda: run_impact(CHAIN, "out/impact"),
        lambda: run_impact(CHAIN, "out/program", Options("lmp")),
        lambda: collide(Collision.load("test2"), "out/collision"),
        lambda: run(kicked(small.with_values({"name": "kicked", "time.duration": 4.0})), "out/kicked"),
    ]

    def call(function: Callable[[], object]) -> None:
        try:
            function()
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=call, args=[each]) for each in calls]
    threads[0].start()
    assert at_work.wait(60)
    for thread in threads[1:]:
        thread.start()
        sleep(0.01)
    for thread in threads:
        thread.join()
    assert not failed
    assert Path.cwd() == tmp_path
    names = {"long", "wave", "to_tolerance", "impact", "program", "collision", "kicked"}
    assert {path.name for path in Path("out").iterdir()} == names
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert Record.load("out/long").scene.time.duration == LONG
    assert Record.load("out/wave").scene.wave.phase == 0.1
    Record.load("out/to_tolerance")
    assert ImpactRecord.load("out/impact").velocity.tolist() == ImpactRecord.load("out/program").velocity.tolist()
    assert Path("out/collision/collision.csv").is_file()
    assert len(Record.load("out/kicked").snapshots())


def test_while_lammps_runs_no_other_thread_sees_its_directory(
    small: Scene, tmp_path: Path, fast_looks: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    seen: set[Path] = set()
    alone: list[bool] = []
    moved = directory._moved_alone
    monkeypatch.setattr(directory, "_moved_alone", lambda folder: alone.append(moved(folder)) or alone[-1])
    run(
        small.with_values({"time.duration": LONG / 5, "time.sample": 10.0}),
        "long",
        progress=lambda step, steps: seen.add(Path.cwd()),
    )
    if not all(alone):
        pytest.skip("this system gives a thread no working directory of its own")
    assert seen == {tmp_path}
