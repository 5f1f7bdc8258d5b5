"""Run a deck: in this process through the ``lammps`` module, or as the program ``lmp`` on one or more MPI ranks.

Whatever the route, LAMMPS reads the same ``in.NAME`` in the run folder and the record is the same to the last bit (on
one rank). LAMMPS works in a second thread, so that Ctrl-C and the progress display are served at once.
"""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp import __version__
from granular_lmp.deck import DUMP, Deck, build
from granular_lmp.errors import GranularError, LammpsError, RunFolderError, RunInterrupted
from granular_lmp.locate import lammps_module, lmp_command
from granular_lmp.record import LOG, TRAJECTORY, Record, read_log, write_status
from granular_lmp.scene import Scene

Progress = Callable[[int, int], None]
LAUNCHERS = ("module", "lmp")
_SWITCHES = ("-log", LOG, "-screen", "none", "-nocite")
_POLL = 0.1  # s between two looks at a run: progress, and the longest wait for a program to stop
_GRACE = 0.5  # s that a stopped program gets before it is killed
_working_directory = threading.Lock()  # LAMMPS opens files relative to it, and a process has only one


def run(
    scene: Scene,
    folder: str | Path,
    *,
    launcher: str = "module",
    ranks: int = 1,
    force: bool = False,
    progress: Progress | None = None,
) -> Record:
    """Build the deck of `scene` in `folder`, run it, and return the record of the centre sphere.

    Parameters
    ----------
    scene : Scene
    folder : path
        The run folder, made here. What it will hold: ``scene.toml``, ``in.NAME``, ``data.NAME``, ``log.lammps``,
        ``dump.centre``, ``trajectory.csv``, ``run.json``.
    launcher : "module" or "lmp"
        In this process, or the program ``lmp``. More than one rank always means the program.
    ranks : int
        MPI ranks.
    force : bool
        Run again in a folder that is there; only the files named above are replaced.
    progress : callable, optional
        Called as ``progress(step, steps)`` about ten times a second.

    Raises
    ------
    RunFolderError
        When the folder is there (without `force`) or cannot be written.
    LammpsMissingError, LammpsError
    RunInterrupted
        On Ctrl-C: LAMMPS stops within a second, ``run.json`` says so, what was recorded is kept.
    """
    if launcher not in LAUNCHERS:
        raise ValueError(f"launcher = {launcher!r}: must be one of {', '.join(LAUNCHERS)}")
    if ranks < 1:
        raise ValueError(f"ranks = {ranks!r}: must be at least 1")
    started = time.perf_counter()
    program = launcher == "lmp" or ranks > 1
    deck = build(scene)
    # Everything that can be missing is asked for before a file is written.
    command = [*lmp_command(ranks), "-in", deck.input_name, *_SWITCHES, "-nonbuf"] if program else []
    module = None if program else lammps_module()
    folder = Path(folder)
    deck.write(folder, force=force)
    _clear(folder)
    info = _description(deck, "lmp" if program else "module", ranks)
    write_status(folder, info | {"status": "running", "message": "started"})
    report = _reporter(progress, scene.time.steps)
    status, message = "finished", ""
    failure: GranularError | None = None
    try:
        if module is None:
            _run_program(command, folder, report)
        else:
            _run_module(module, deck, folder, report)
    except KeyboardInterrupt:
        failure = RunInterrupted(f"{folder}: interrupted; what was recorded is kept")
        status, message = "interrupted", "stopped by the user"
    except GranularError as error:
        failure, status, message = error, "failed", str(error)
    record = _collect(folder, scene)
    if failure is None and not all(np.isfinite(x).all() for x in (record.p, record.q, record.phi)):
        failure = LammpsError("the record holds numbers that are not finite", deck.input_name, "")
        status, message = "failed", str(failure)
    if failure is None and len(record.tau) != scene.time.samples + 1:
        failure = LammpsError(
            f"{len(record.tau)} records instead of {scene.time.samples + 1}", deck.input_name, _log_tail(folder)
        )
        status, message = "failed", str(failure)
    info |= _outcome(folder, record, time.perf_counter() - started) | {"status": status, "message": message}
    write_status(folder, info)
    if failure is not None:
        raise failure
    return Record.load(folder)


# --- the folder ------------------------------------------------------------------------------------------------------


def _clear(folder: Path) -> None:
    """Remove what an earlier run of ours recorded, so that it cannot pass for this one's."""
    for name in (LOG, DUMP, TRAJECTORY):
        (folder / name).unlink(missing_ok=True)


def _collect(folder: Path, scene: Scene) -> Record:
    """What the run recorded, finished or not; written to ``trajectory.csv``."""
    if not (folder / DUMP).exists():
        empty = np.empty(0)
        return Record(empty, empty, empty, empty, scene, folder=folder)
    record = Record.from_dump(folder, scene)
    record.write_csv(folder / TRAJECTORY)
    return record


def _description(deck: Deck, launcher: str, ranks: int) -> dict[str, Any]:
    """What is known before the run."""
    scene, sphere, time_ = deck.scene, deck.scene.sphere, deck.scene.time
    phase_lag = (deck.mode.frequency * time_.step) ** 2 / 24 * deck.mode.frequency * time_.duration
    return {
        "name": scene.name,
        "versions": {"granular_lmp": __version__},
        "launcher": launcher,
        "ranks": ranks,
        "particles": len(deck.packing),
        "steps": time_.steps,
        "timestep_used": time_.step,
        "wavenumber_used": scene.wavenumber,
        "frequency": deck.mode.frequency,
        "amplitude": scene.wave.amplitude,
        "epsilon": sphere.nonlinearity(scene.wave.amplitude),
        "Delta0_m": sphere.static_overlap,
        "t0_s": sphere.time_scale,
        "overlap_ratio": sphere.overlap_ratio,
        "effects": {e.name: {"on": e.on, "number": _finite(e.number), "reason": e.reason} for e in deck.effects},
        # Velocity Verlet runs a mode (Ω Δτ)²/24 too fast; the lag at the end over √3 is its L2 error over the run
        "error_estimate": {"timestep_fundamental": phase_lag / 3**0.5},
        "remarks": scene.remarks(),
    }


def _outcome(folder: Path, record: Record, seconds: float) -> dict[str, Any]:
    """What is known after the run: time split into loop and the rest, and the guards."""
    table, loop = read_log(folder / LOG) if (folder / LOG).exists() else ({}, float("nan"))
    overlap, opened, slip = (table.get(name, np.empty(0)) for name in ("v_overlap", "v_open", "v_slip"))
    return {
        "samples": len(record.tau),
        "wall_seconds": {"total": seconds, "loop": _finite(loop), "other": _finite(seconds - loop)},
        "guards": {
            "smallest_overlap": {
                "value": _finite(np.min(overlap, initial=np.inf)),
                "unit": "Delta0",
                "quiet": bool((overlap > 0).all()),
                "meaning": "of the contacts that touch",
            },
            "open_contacts": {
                "value": _finite(np.max(opened, initial=0.0)),
                "unit": "contacts",
                "quiet": bool((opened == 0).all()),
                "meaning": "contacts opened: no closed form holds, and shear forces are lost",
            },
            "largest_slip": {
                "value": _finite(np.max(slip, initial=0.0)),
                "unit": "sliding force",
                "quiet": bool((slip < 1).all()),
                "meaning": "contacts may have slid: the paper's no-slip contact does not hold",
            },
        },
        "lammps_version": _lammps_version(folder),
    }


def _finite(value: float) -> float | None:
    """JSON has no inf and no nan."""
    return float(value) if np.isfinite(value) else None


def _lammps_version(folder: Path) -> str | None:
    try:
        with (folder / LOG).open(encoding="utf-8", errors="replace") as stream:
            return stream.readline().strip().removeprefix("LAMMPS (").removesuffix(")") or None
    except OSError:
        return None


def _log_tail(folder: Path, lines: int = 15) -> str:
    try:
        return "\n".join((folder / LOG).read_text(encoding="utf-8", errors="replace").splitlines()[-lines:])
    except OSError:
        return ""


# --- the two routes --------------------------------------------------------------------------------------------------


def _reporter(progress: Progress | None, steps: int) -> Callable[[int | None], None]:
    def report(step: int | None) -> None:
        if progress is not None and step is not None:
            progress(min(step, steps), steps)

    return report


def _run_module(module: Any, deck: Deck, folder: Path, report: Callable[[int | None], None]) -> None:
    with _working_directory, chdir(folder), ThreadPoolExecutor(1, thread_name_prefix="lammps") as pool:
        opened = pool.submit(module.lammps, cmdargs=list(_SWITCHES))
        instance = opened.result()
        try:
            job = pool.submit(instance.file, deck.input_name)
            try:
                _watch(job, lambda: report(instance.extract_global("ntimestep")))
            except KeyboardInterrupt:
                instance.force_timeout()  # the time loop ends at its next step
                job.exception()
                raise
            except Exception as error:  # the module raises plain Exception and MPIAbortException
                raise LammpsError(_first_line(error), _last_command(folder), _log_tail(folder)) from error
        finally:
            pool.submit(instance.close).result()
    report(deck.scene.time.steps)


def _watch(job: "Future[Any]", look: Callable[[], None]) -> None:
    """Wait for `job`, calling `look` now and then."""
    while True:
        try:
            job.result(timeout=_POLL)
            return
        except TimeoutError:
            if job.done():  # the job itself raised it
                raise
            look()


def _run_program(command: list[str], folder: Path, report: Callable[[int | None], None]) -> None:
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,  # Ctrl-C of the terminal is ours to pass on
    )
    try:
        while True:
            try:
                output, _ = process.communicate(timeout=_POLL)
                break
            except subprocess.TimeoutExpired:
                report(_step_in_log(folder))
    except KeyboardInterrupt:
        _stop(process)
        raise
    if process.returncode != 0:
        said = [*_log_tail(folder).splitlines(), *output.splitlines()]
        errors = [line for line in said if "ERROR" in line] or [f"exit status {process.returncode}"]
        raise LammpsError(errors[0], _last_command(folder) or " ".join(command), _log_tail(folder))


def _stop(process: "subprocess.Popen[str]") -> None:
    """End the program and all its ranks."""
    os.killpg(process.pid, signal.SIGTERM)
    try:
        process.wait(_GRACE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _step_in_log(folder: Path) -> int | None:
    try:
        table, _ = read_log(folder / LOG)
    except RunFolderError:
        return None
    steps = table.get("Step")
    return int(steps[-1]) if steps is not None and len(steps) else None


def _first_line(error: BaseException) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def _last_command(folder: Path) -> str:
    """The input line that LAMMPS names in its log as the last one."""
    lines = _log_tail(folder, 40).splitlines()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("Last input line:")]
    return named[-1] if named else ""
