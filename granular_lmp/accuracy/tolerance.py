"""Run a scene to the accuracy that it asks for: runs of halved steps, until what they show of their error is enough.

The runs go up the ladder h, h/2, h/4, … that `granular_lmp.accuracy.ladder` begins. After each the answer is
extrapolated from the last three, and its error estimated from how much the last run moved it
(`granular_lmp.accuracy.richardson`): no theory of the wave is asked, so this is the same for every wave and every
effect. A run is added until the estimate meets the tolerance, or the ladder ends and the tolerance is refused.

The folder holds a run folder for each step, ``N_per_sample``, and the extrapolated ``trajectory.csv`` beside
``scene.toml`` and ``run.json``.
"""

from collections.abc import Callable
from pathlib import Path
from shlex import quote
from typing import Any

from granular_lmp.accuracy.budget import error_budget
from granular_lmp.accuracy.ladder import MOST_RUNGS, RUNGS, first_step, with_step
from granular_lmp.accuracy.richardson import answer, estimate
from granular_lmp.accuracy.rounding import check_floor, linear_signals
from granular_lmp.effects.table import resolve
from granular_lmp.errors import GranularError, RunFolderError, RunInterrupted, ToleranceError
from granular_lmp.lammps.outputs import CHECKPOINTS, PER_SAMPLE, SWEEP, replace_text, writable
from granular_lmp.runs import launch
from granular_lmp.runs.agreement import refuse_other_scene, scene_digest
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.record import (
    STATUS,
    TRAJECTORY,
    Record,
    read_status,
    write_status,
)
from granular_lmp.scene.scene import Scene

OneRun = Callable[[Scene, Path, launch.Progress | None], Record]


def run(scene: Scene, folder: str | Path, **options: Any) -> Record:
    """Run a scene: once with its time step (`launch.run`), or to its tolerance (`run_to_tolerance`)."""
    return (launch.run if scene.time.tolerance is None else run_to_tolerance)(scene, folder, **options)


def resume(folder: str | Path, *, progress: launch.Progress | None = None) -> Record:
    """Continue an interrupted run, or the runs of an interrupted scene with a tolerance (`launch.resume`)."""
    folder = Path(folder).absolute()
    if (folder / SWEEP).is_file():
        raise RunFolderError(f"{folder}: holds a sweep; the same sweep command again does what is missing")
    info = read_status(folder)
    if "tolerance" not in info:
        return launch.resume(folder, progress=progress)
    if info.get("status") == "finished":
        raise RunFolderError(f"{folder}: the run is finished; there is nothing to resume")
    refuse_other_scene(folder, info)

    if not {"launcher", "ranks"} <= set(info):
        raise RunFolderError(f"{folder}: {STATUS} does not say how the run was started; run it again with --force")

    def one(scene: Scene, place: Path, told: launch.Progress | None) -> Record:
        if (place / STATUS).is_file() and read_status(place).get("status") == "finished":
            return Record.load(place)
        if any((place / name).is_file() for name in CHECKPOINTS):
            return launch.resume(place, progress=told)
        return launch.run(scene, place, launcher=info["launcher"], ranks=info["ranks"], force=True, progress=told)

    with locked(folder):
        return refine(Scene.load(folder / "scene.toml"), folder, one, progress, info)


def run_to_tolerance(
    scene: Scene,
    folder: str | Path,
    *,
    launcher: str = "module",
    ranks: int = 1,
    force: bool = False,
    progress: launch.Progress | None = None,
) -> Record:
    """Run a scene to its ``time.tolerance``, and return the extrapolated record with the estimate of its error.

    Parameters
    ----------
    scene : Scene
        With ``time.tolerance``.
    folder, launcher, ranks, force, progress
        As in `launch.run`. The steps that `progress` is told grow when the ladder goes on.

    Returns
    -------
    Record
        ``info["error_estimate"]`` holds the relative L2 errors of its p, q, phi (None where symmetry makes one zero).

    Raises
    ------
    SceneError
        Before anything is run, when the tolerance is below what rounding or the walls leave of the linear wave.
    ToleranceError
        When it is below what rounding leaves of the signals that the first run shows, or the shortest step misses it.
    RunFolderError, LaunchError, LammpsMissingError, LammpsError, RunInterrupted
        As in `launch.run`.
    """
    scene, _ = resolve(scene)
    check_floor(scene, linear_signals(scene))
    folder = Path(folder).absolute()
    digest = scene_digest(scene.to_toml())
    info = {
        "name": scene.name,
        "scene_sha256": digest,
        "tolerance": scene.time.tolerance,
        "launcher": launcher,
        "ranks": ranks,
    }

    def one(scene: Scene, place: Path, told: launch.Progress | None) -> Record:
        # By force: a folder of the user's own files may have been left there
        return launch.run(scene, place, launcher=launcher, ranks=ranks, force=True, progress=told)

    with locked(folder, make=True, force=force):
        clear(folder)
        with writable(folder):
            replace_text(folder / "scene.toml", scene.to_toml())
        return refine(scene, folder, one, progress, info)


def refine(scene: Scene, folder: Path, one: OneRun, progress: launch.Progress | None, info: dict[str, Any]) -> Record:
    """Run with smaller and smaller steps until the estimate meets the tolerance; ``run.json`` says how that ended.

    Parameters
    ----------
    scene : Scene
        With ``time.tolerance``.
    folder : Path
        Is there, and gets ``trajectory.csv`` and ``run.json``.
    one : callable
        Makes one run: of a scene with a time step, in a folder, telling its progress.
    progress : callable, optional
    info : dict
        What ``run.json`` is to hold of the whole.
    """
    tolerance = scene.time.tolerance
    assert tolerance is not None
    per_sample = round(scene.time.sample / first_step(scene))
    records: list[Record] = []
    said: list[str] = []
    found: dict[str, float] = {}
    with writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    try:
        for rung in range(MOST_RUNGS):
            count = per_sample << rung
            stepped = with_step(scene, scene.time.sample / count)
            # The runs before this one made count − per_sample steps a sample
            before, all_ = count - per_sample, (per_sample << max(rung + 1, RUNGS)) - per_sample
            told = _offset(progress, before * scene.time.samples, all_ * scene.time.samples)
            records.append(one(stepped, folder / f"{count}{PER_SAMPLE}", told))
            if rung == 0:
                check_floor(scene, records[0].signals, ToleranceError)
                continue
            found = estimate(records)
            if all(error <= tolerance for error in found.values()):  # a nan is not
                break
            if rung + 1 >= RUNGS:
                said.append(f"steps down to {stepped.time.step!r} tau: {_worst(found)}; halved")
        else:
            raise ToleranceError(
                f"time.tolerance = {tolerance!r}: not met with steps down to {records[-1].scene.time.step!r} tau, "
                f"{_worst(found)}; the runs are kept in {folder}"
            )
    except BaseException as error:  # also what the caller's progress raises: the folder must say how the run ended
        if isinstance(error, RunInterrupted | KeyboardInterrupt):
            resumed_by = f"granular-lmp resume {quote(str(folder))}"
            error = RunInterrupted(f"{folder}: interrupted; what was recorded is kept; continue with: {resumed_by}")
        message = str(error) if isinstance(error, GranularError) else type(error).__name__
        status = "interrupted" if isinstance(error, RunInterrupted) else "failed"
        write_status(folder, info | {"status": status, "message": message})
        raise error from None
    record = answer(records)
    runs = [run.info for run in records]
    outcome = {
        "error_estimate": {name: found.get(name) for name in ("p", "q", "phi")},
        "error_budget": error_budget(scene, record.signals, found),
        "extrapolated_from": [run.scene.time.step for run in records[-3:]],
        "refinements": said,
        "steps": sum(run["steps"] for run in runs),
        "wall_seconds": {
            key: sum(run["wall_seconds"][key] or 0.0 for run in runs) for key in ("total", "loop", "other")
        },
        "status": "finished",
        "message": "",
    }
    with writable(folder):
        record.write_csv(folder / TRAJECTORY)
        write_status(folder, record.info | info | outcome)
    return Record.load(folder)


def _worst(found: dict[str, float]) -> str:
    name = max(found, key=lambda key: found[key])
    return f"estimated error {found[name]:.2g} of {name}"


def _offset(progress: launch.Progress | None, before: int, total: int) -> launch.Progress | None:
    """The progress of one run as a part of all of them."""
    return None if progress is None else lambda step, _: progress(before + step, total)
