"""Warm processes: calls come back, a process that dies fails its own call alone, nothing outlives the caller."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest

from granular_lmp.errors import LaunchError, RunInterrupted, WorkerError
from granular_lmp.studies import executors
from granular_lmp.studies.executors import Workers, mpi_workers, stop_requested

ROOT = Path(__file__).parents[2]


def test_a_process_answers_many_calls_and_is_not_this_one() -> None:
    with Workers(1) as workers:
        numbers = {workers.submit(os.getpid).result() for _ in range(3)}
    assert len(numbers) == 1
    assert os.getpid() not in numbers


def test_an_error_of_a_call_is_the_caller_s() -> None:
    with Workers(1) as workers:
        with pytest.raises(ValueError, match="invalid literal"):
            workers.submit(int, "x").result()
        with pytest.raises(Exception, match="pickle"):  # what cannot be sent back
            workers.submit(compile, "0", "", "eval").result()
        assert workers.submit(int, "7").result() == 7


@pytest.mark.parametrize(
    ("call", "end"), [((os._exit, 3), "exit status 3"), ((signal.raise_signal, signal.SIGKILL), "signal 9")]
)
def test_a_process_that_dies_fails_its_own_call_and_is_replaced(call: tuple, end: str) -> None:
    with Workers(1) as workers:
        with pytest.raises(WorkerError, match=f"ended by {end}$"):
            workers.submit(*call).result()
        assert workers.submit(abs, -1).result() == 1


def test_a_process_that_dies_is_quoted(caplog: pytest.LogCaptureFixture) -> None:
    with Workers(1) as workers:
        with pytest.raises(WorkerError, match="ended by exit status 1; it wrote: the last of two lines$"):
            workers.submit(exec, "import os; os.write(2, b'a line\\nthe last of two lines'); os._exit(1)").result()
        workers.submit(print, "a worker that lives").result()
    assert "a line\nthe last of two lines" in caplog.text
    assert "a worker that lives" in caplog.text


def test_a_process_imports_nothing_of_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("lammps", "signal", "random", "types", "queue", "numbers", "ase", "numpy")
    for name in names:
        (tmp_path / f"{name}.py").write_text("raise SystemExit(7)")
    monkeypatch.chdir(tmp_path)
    with Workers(1) as workers:
        for name in names:
            assert not workers.submit(eval, f"__import__('{name}').__file__").result().startswith(str(tmp_path))


def test_leaving_by_an_exception_drops_what_waits() -> None:
    with suppress(KeyboardInterrupt), Workers(1) as workers:
        workers.submit(abs, 1).result()  # the process is there
        first, second = (workers.submit(time.sleep, 0.5) for _ in range(2))
        while not first.running():
            time.sleep(0.01)
        raise KeyboardInterrupt
    assert first.done()
    assert second.cancelled()


def test_no_stop_is_requested_outside_a_worker() -> None:
    assert not stop_requested()


def test_no_workers_are_refused() -> None:
    with pytest.raises(LaunchError, match="workers = 0: must be at least 1"):
        Workers(0)


def test_without_mpi4py_ranks_are_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    with pytest.raises(LaunchError, match="'mpi': mpi4py cannot be loaded"):
        mpi_workers()


def test_a_script_needs_no_main_guard_and_a_killed_caller_leaves_no_process(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import os, time\nfrom granular_lmp.studies.executors import Workers\n"
        "workers = Workers(1)\nprint(workers.submit(os.getpid).result(), flush=True)\ntime.sleep(60)\n"
    )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True, env=environment) as caller:
        assert caller.stdout is not None
        worker = int(caller.stdout.readline())
        os.kill(worker, 0)  # it is there
        caller.kill()
    deadline = time.monotonic() + 20
    while alive(worker) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not alive(worker)


def alive(process: int) -> bool:
    """Return whether a process runs; an unreaped zombie does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_alive_tells_the_living_from_the_dead() -> None:
    assert alive(os.getpid())
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    assert not alive(process.pid)


# --- batch systems ---------------------------------------------------------------------------------------------------


def end_this_process() -> None:
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(10)


def test_sigterm_interrupts_a_call_and_ends_the_process_to_further_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "_terminated", False)
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), executors.terminable():
        end_this_process()
    assert signal.getsignal(signal.SIGTERM) == before
    with pytest.raises(RunInterrupted, match="stopped before it began"), executors.terminable():
        pass


def test_a_program_that_handles_sigterm_keeps_its_handler(monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, _: heard.append(number))
    try:
        with executors.terminable():
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.01)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == [signal.SIGTERM]


def test_threads_leave_sigterm_to_the_main_thread() -> None:
    def handler() -> object:
        with executors.terminable():
            return signal.getsignal(signal.SIGTERM)

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(handler).result() == signal.getsignal(signal.SIGTERM)
