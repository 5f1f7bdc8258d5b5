"""A run without LAMMPS's loop: its folder is that of LAMMPS, whatever reads it, and it stops and continues alike."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis import cli as analysis
from granular_analysis.measure import stepping
from granular_analysis.measure.stepping import NetworkEngine
from granular_analysis.theory.errors import TheoryError
from granular_analysis.tools.compare import compare
from granular_lmp import Record, Scene, run
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.cli.entry import main
from granular_lmp.errors import EffectError, LaunchError, RunFolderError, RunInterrupted, SceneError
from granular_lmp.lammps.outputs import LOG, SNAPSHOTS, read_dump, read_log
from granular_lmp.runs.options import options_of
from granular_lmp.runs.status import read_status, write_status
from granular_lmp.scene.collision import Collision
from granular_lmp.studies.collide import run as collide
from granular_lmp.studies.sweep import Sweep, sweep
from tests.conftest import members

HERE = NetworkEngine.on("cpu")
SHORT = {"time.duration": 6.0}
CHANGING = {"run.json", LOG}  # they say when, and how long
# A wave, a source and a monitor, a monitor of the flux between quiet ends, strikers, spheres that meet, one in space,
# a wave between walls of which far spheres leave LAMMPS's run, contacts that open, and a row that is driven
KINDS = ["tr_periodic", "corner_source", "quiet_ends", "struck_crystal", "solitary_chain", "fcc_transverse"]
KINDS += ["tr_nonresonant", "l_opening", "tr_driven"]


def scene_of(name: str, changes: dict[str, Any] | None = None) -> Scene:
    scene = Scene.load(name)
    stepped = {"time.timestep": 0.05} if scene.time.tolerance is not None else {}
    return scene.with_values(SHORT | stepped | (changes or {}))


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name not in CHANGING}


def stopping(at: int) -> Callable[[int, int], None]:
    """Return a callback for progress that is Ctrl-C once a run has come so far."""

    def progress(step: int, _: int) -> None:
        if step >= at:
            raise KeyboardInterrupt

    return progress


def rounding_of(record: Record) -> float:
    """Return how far LAMMPS's roundings of the largest place may gather in a run, in D0."""
    place = np.abs(record.problem.rest.atoms.positions).max() * record.scene.sphere.radius
    return (
        1e-9
        + 4 * np.sqrt(record.info["steps"]) * np.spacing(place) / record.scene.scale.length / record.scene.amplitude
    )


def of_monitor(record: Record, name: str) -> list[np.ndarray]:
    found = record.monitor(name)
    motion = [getattr(found, each) for each in ("displacement", "velocity", "rotation", "spin")]
    return [*motion, found.flux] if found.monitor.with_contacts else motion


@pytest.mark.parametrize("name", KINDS)
def test_the_record_is_that_of_lammps(name: str, tmp_path: Path) -> None:
    scene = scene_of(name)
    theirs, ours = run(scene, tmp_path / "lammps"), run(scene, tmp_path / "network", engine=HERE)
    assert ours.tau.tolist() == theirs.tau.tolist()
    pairs = [(ours.signals[signal], values) for signal, values in theirs.signals.items()]
    for one, other in pairs:
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)
    pairs = [
        pair
        for each in scene.monitor
        for pair in zip(*(of_monitor(run, each.name) for run in (ours, theirs)), strict=True)
    ]
    if scene.wave and scene.output.particles:
        motion = "displacement", "velocity", "rotation", "spin"
        pairs += list(zip(*(each.snapshots().stacks(*motion) for each in (ours, theirs)), strict=True))
    for one, other in pairs:
        np.testing.assert_allclose(one, other, rtol=0, atol=rounding_of(theirs))
    looked, seen = (read_log(tmp_path / each / LOG).table for each in ("lammps", "network"))
    assert seen["Step"].tolist() == looked["Step"].tolist()
    assert list(seen) == list(looked)
    # LAMMPS's are bounds, and at the end those of the last look; it counts the contacts of the sphere that lost most
    for column in seen.keys() - {"v_overlap", "v_open"}:
        assert np.all(seen[column][:-1] <= looked[column][:-1] * (1 + 1e-6) + 1e-9)
    if "v_open" in seen:
        assert np.all((seen["v_open"][:-1] > 0) <= (looked["v_open"][:-1] > 0))
    assert {name: each["quiet"] for name, each in ours.info["guards"].items()} == {
        name: each["quiet"] for name, each in theirs.info["guards"].items()
    }


def test_a_sphere_that_is_turned_moves_others_as_in_lammps(tmp_path: Path) -> None:
    turned = [{"spheres": [[0, 0]], "motion": "rotation", "frequency": 0.7, "ramp": 5.0}]
    scene = scene_of("corner_source", {"source": turned, "output.particles": 1.0})
    theirs, ours = run(scene, tmp_path / "lammps"), run(scene, tmp_path / "network", engine=HERE)
    found, expected = (each.snapshots().stack("displacement") for each in (ours, theirs))
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(found, expected, rtol=0, atol=rounding_of(theirs))
    # Spins in the dump too, where the reader does not put the derivative of the signal in their place
    spins = [read_dump(each.folder / SNAPSHOTS, None, ["omegaz"])["omegaz"] for each in (ours, theirs)]
    np.testing.assert_allclose(spins[0], spins[1], rtol=0, atol=1e-8 * np.abs(spins[1]).max())


@pytest.mark.usefixtures("drawn_once")
def test_what_reads_runs_reads_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changes = {"time.duration": 20.0, "output.particles": 2.0}
    record = run(scene_of("tr_periodic", changes), tmp_path / "run", engine=HERE)
    assert Record.load(tmp_path / "run") == record
    assert record.info["device"] == HERE.device
    assert record.info["versions"]["lammps"] is None
    assert compare(record).error["p"] < 2e-3  # the error of the step
    struck = run(scene_of("solitary_chain"), tmp_path / "struck", engine=HERE)
    assert np.ptp(struck.energy()) < 1e-3 * struck.energy()[0]
    assert compare(struck).error["velocity"] < 2e-3
    assert "the network also computed the run" in compare(struck).notes[0]
    run(scene_of("struck_crystal", {"time.duration": 12.0}), tmp_path / "sheet", engine=HERE)
    for folder in ("run", "struck"):
        assert main(["view", str(tmp_path / folder), "-o", str(tmp_path / f"{folder}.png")]) == 0
        assert main(["export", str(tmp_path / folder), "-o", str(tmp_path / f"{folder}.csv")]) == 0
    assert main(["front", str(tmp_path / "sheet")]) == 0
    assert "m/s" in capsys.readouterr().out


@pytest.mark.parametrize("device", members(["cpu", "numpy", "jax"], "numpy"))
def test_a_run_that_is_stopped_continues_to_the_same_bytes(device: str, tmp_path: Path) -> None:
    if device == "jax":
        pytest.importorskip("jax")
    by, scene = NetworkEngine.on(device), scene_of("struck_crystal")
    whole = run(scene, tmp_path / "whole", engine=by)
    with pytest.raises(RunInterrupted, match="continue with: granular-analysis network --resume"):
        run(scene, tmp_path / "stopped", engine=by, progress=stopping(100))
    info = read_status(tmp_path / "stopped")
    info.pop("files")
    write_status(tmp_path / "stopped", info | {"status": "running"})
    for name in ("dump.particles", "monitor.near.bin", "monitor.far.contacts"):  # as a kill would leave them
        with (tmp_path / "stopped" / name).open("ab") as stream:
            stream.write((tmp_path / "stopped" / name).read_bytes()[:150])
    with (tmp_path / "stopped" / LOG).open("a") as stream:
        stream.write("121 2.0 0.0")
    with pytest.raises(LaunchError, match="continue with: granular-analysis network --resume"):
        resume(tmp_path / "stopped")
    with pytest.raises(LaunchError, match="can only continue there"):
        resume(tmp_path / "stopped", engine=NetworkEngine("another"))
    assert resume(tmp_path / "stopped", engine=by) == whole
    assert files_of(tmp_path / "stopped") == files_of(tmp_path / "whole")
    assert read_status(tmp_path / "stopped")["guards"] == whole.info["guards"]


@pytest.mark.parametrize("device", ["numpy", "jax"])
def test_each_device_gives_one_record(device: str, tmp_path: Path) -> None:
    if device == "jax":
        pytest.importorskip("jax")
    scene = scene_of("corner_source")
    one, other = (run(scene, tmp_path / by.device, engine=by) for by in (HERE, NetworkEngine.on(device)))
    assert ("jax" in other.info["versions"]) == (device == "jax")
    for name, values in one.signals.items():
        np.testing.assert_allclose(other.signals[name], values, rtol=0, atol=1e-11)
    for name, guard in one.info["guards"].items():
        assert other.info["guards"][name]["value"] == pytest.approx(guard["value"], rel=1e-6)


def test_a_tolerance_is_met_and_its_ladder_continues(tmp_path: Path) -> None:
    scene = Scene.load("tr_periodic").with_values({"time.duration": 10.0, "time.tolerance": 1e-2})
    whole, theirs = run(scene, tmp_path / "whole", engine=HERE), run(scene, tmp_path / "lammps")
    for name, values in theirs.signals.items():
        np.testing.assert_allclose(whole.signals[name], values, rtol=0, atol=1e-9)
    assert whole.info["launcher"] == "network"
    with pytest.raises(RunInterrupted, match="granular-analysis network --resume"):
        run(scene, tmp_path / "stopped", engine=HERE, progress=stopping(30))
    assert resume(tmp_path / "stopped", engine=HERE) == whole


def test_an_effect_that_is_left_out_and_occurs_fails_the_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    look = stepping.Motion.look
    monkeypatch.setattr(stepping.Motion, "look", lambda *said: look(*said)._replace(changed=3.0))
    with pytest.raises(EffectError, match="contact_opening triggered its guard at tau = 0: open_contacts = 3, above 0"):
        run(scene_of("tr_periodic"), tmp_path / "run", engine=HERE)


ROLLING = {"effects.rolling": True, "effects.rolling_stiffness": 10.0, "effects.rolling_friction": 1.0}
WALLED = {"packing.rows": 9, "packing.first": "wall", "packing.last": "wall", "time.allow_echo": True}


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("tr_periodic", ROLLING, "effects.rolling"),
        ("tr_nonresonant", WALLED | {"monitor": [{"name": "m", "rows": [3, 4], "what": "flux"}]}, "monitor m"),
        ("l_wave", {"sphere.adhesion_law": "jkr", "effects.parting": "distance"}, "effects.parting"),
    ],
)
def test_what_the_network_does_not_hold_is_refused_by_name_before_a_file_is_written(
    name: str, changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError, match=message):
        run(scene_of(name, changes), tmp_path / "run", engine=HERE)
    assert not (tmp_path / "run").exists()


def test_a_collision_takes_the_network(tmp_path: Path) -> None:
    slow = Collision.load("test2", {"collision.steps": 100})
    ours, theirs = (collide(slow, tmp_path / str(by), engine=by) for by in (HERE, None))
    for one, other in ((ours.numbers(), theirs.numbers()), (ours.errors(), theirs.errors())):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-12)
    with pytest.raises(SceneError, match=r"effects\.shear_damping"):
        collide(Collision.load("test4"), tmp_path / "test4", engine=HERE)


def command(*words: str) -> int:
    """Return the exit status of ``granular-analysis network``."""
    return analysis.main(["network", *words])


def test_memory_that_is_not_there_is_refused_before_it_runs_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(stepping, "_free", lambda: 1e9)
    with pytest.raises(SystemExit, match=r"1000000 spheres need 5.9 GB of memory, and 1 GB are free: take fewer rows"):
        command("tr_periodic", "--set", "packing.rows=1000", "--set", "packing.columns=1000", "-o", str(tmp_path / "r"))
    monkeypatch.setattr(stepping, "_free", lambda: 4.1e8)
    with pytest.raises(SceneError, match=r"4800 spheres need 0.43 GB .* \(in the sweep at packing.columns = 300\)"):
        sweep(scene_of("tr_periodic"), {"packing.columns": [3, 300]}, tmp_path / "s", engine=HERE)
    with pytest.raises(SceneError, match=r"48 spheres in each of 2 runs at once need 0.8 GB .* or columns, or workers"):
        sweep(scene_of("tr_periodic"), {"packing.columns": [3, 4]}, tmp_path / "s", engine=replace(HERE, at_once=2))
    with pytest.raises(SceneError, match=r"4800 spheres need 0.43 GB"):
        run(scene_of("tr_periodic", {"packing.columns": 300, "time.tolerance": 0.1}), tmp_path / "t", engine=HERE)
    monkeypatch.setattr(stepping, "_free", lambda: np.inf)
    with pytest.raises(TheoryError, match="0.5 GB has gpu"):
        NetworkEngine("gpu, JAX", room=5e8).refuse_larger(scene_of("tr_periodic", {"packing.columns": 10_000}))
    assert not [*tmp_path.iterdir()]


def test_the_command_runs_a_scene_and_says_what_is_mistyped(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stepping, "find_spec", lambda _: None)  # without JAX
    monkeypatch.setattr(stepping, "library", lambda: None)  # and a compiler
    words = ["tr_periodic", "--set", "time.duration=2", "-o", str(tmp_path / "run")]
    assert command(*words, "--step", "0.1") == 0
    said = capsys.readouterr().out
    assert "20 steps" in said
    assert "in the loop of the network" in said
    swept, over = tmp_path / "sweep", ["--over", "wave.amplitude=0.1,0.2"]
    assert command(*words[:3], "--step", "0.1", *over, "-o", str(swept)) == 0
    assert "2 of 2 runs finished" in capsys.readouterr().out
    assert Sweep.load(swept).scene.time.timestep == 0.1
    assert main(["view", str(swept), "-o", str(tmp_path / "sweep.png")]) == 0
    assert main(["sweep", *words[:3], "--set", "time.timestep=0.1", *over, "-o", str(swept)]) == 2
    assert "only the network (cpu, NumPy) can continue, not LAMMPS; choose another" in capsys.readouterr().err
    for device in ("gpu", "jax"):
        with pytest.raises(SystemExit, match=f"--device {device}: needs JAX: pip install"):
            command(*words, "--device", device)
    with pytest.raises(RunFolderError, match="exists already"):
        command(*words)
    with pytest.raises(RunFolderError, match="is finished"):
        command("--resume", str(tmp_path / "run"))
    for wrong in (
        [],
        ["tr_periodic", "--resume", "run"],
        ["--resume", str(tmp_path / "run"), *over],
        [*words, *over, "--device", "gpu", "--workers", "2"],
        [*words, "--step", "0.1", "--tolerance", "0.1"],
    ):
        with pytest.raises(SystemExit):
            command(*wrong)
    for device in ("tpu", "1"):
        with pytest.raises(SystemExit):
            command(*words, "--device", device)


def test_a_run_is_continued_on_its_device(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kinds = {"cpu, C": "cpu", "cpu, NumPy": "numpy", "cpu, JAX": "jax", "gpu NVIDIA H100, JAX": "gpu"}
    assert {device: stepping.kind_of(device) for device in kinds} == kinds
    with pytest.raises(RunInterrupted):
        run(scene_of("tr_periodic"), tmp_path / "run", engine=NetworkEngine.on("numpy"), progress=stopping(50))
    assert command("--resume", str(tmp_path / "run")) == 0
    assert read_status(tmp_path / "run")["device"] == "cpu, NumPy"
    capsys.readouterr()


def test_a_run_of_lammps_is_not_continued_by_the_network() -> None:
    with pytest.raises(LaunchError, match="continue with: granular-lmp resume run"):
        options_of(Path("run"), {"launcher": "module", "ranks": 1}, HERE)


def test_what_jax_compiles_is_kept_for_later_runs_unless_the_user_has_said_where(tmp_path: Path) -> None:
    config = pytest.importorskip("jax").config
    names = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
    before = [config.values[name] for name in names]
    try:
        NetworkEngine.on("jax")
        assert [config.values[name] for name in names] == before
        config.update(names[0], None)
        NetworkEngine.on("jax")
        folder, least = (config.values[name] for name in names)
        assert Path(folder).parent == Path(os.environ["XDG_CACHE_HOME"]) / "granular-analysis"
        assert least == 0.2
    finally:
        for name, value in zip(names, before, strict=True):
            config.update(name, value)
