"""Run a scene to the accuracy that it asks for: Richardson pairs of runs, each judged before it is handed out.

`granular_lmp.accuracy.step_law` chooses the first pair, Δτ and Δτ/2. What it says of the pair holds if it is right about what the
pair itself shows, the difference d of the two runs, so the error of the extrapolated record is estimated as

    E = E_law max(1, d/d_law)²  up to d = 2 d_law (d goes as Δτ², E as Δτ⁴);        E = 4 d  beyond

If that misses the tolerance, the step is halved and one run added; so it is where an effect makes the error one of
first order (`granular_lmp.effects.table.order`), which is extrapolated as such, and for waves that are not running, plane and
along y (`Scene.plane_along_y`): the law knows neither. Then there are two extrapolated records, of errors 16 : 1 where
the step's error is of second order (the runs tell: their differences go as 4 : 1), and

    E = |older − newer|/15,               |older − newer| where it is not                + the error of first order in p

The latter also for waves that the law does not know: what their p keeps of first order, the turned slip, is not known.

One halving after a bad guess costs 7/6 of a right guess, since every run but the first is used again.

The folder holds a run folder for each step, ``N_per_sample``, and the extrapolated ``trajectory.csv`` beside
``scene.toml`` and ``run.json``.
"""

import shutil
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.accuracy.budget import as_json, error_budget
from granular_lmp.accuracy.richardson import richardson
from granular_lmp.accuracy.rounding import moving
from granular_lmp.accuracy.step_law import StepError, check_floor, step_errors, step_for, turning_errors, with_step
from granular_lmp.effects.table import order, resolve
from granular_lmp.errors import GranularError, RunFolderError, RunInterrupted, ToleranceError
from granular_lmp.lammps.deck import writable
from granular_lmp.lammps.outputs import CHECKPOINTS, PER_SAMPLE, replace_text
from granular_lmp.runs import launch
from granular_lmp.runs.record import (
    STATUS,
    TRAJECTORY,
    Record,
    read_status,
    refuse_other_scene,
    scene_digest,
    write_status,
)
from granular_lmp.scene.scene import Scene

LEVELS = 5  # pairs that are tried: steps down to 1/16 of the first
# Beyond twice what the law expects it is not the law's waves that two runs show. Then nothing is known of the error but
# its size: 2 d if it is of first order, 2.9 d if it does not depend on the step.
_MISJUDGED, _UNKNOWN = 2.0, 4.0
_SECOND_ORDER = 3.0  # differences of three runs go as 4 : 1 for an error of second order, as 2 : 1 for one of first


OneRun = Callable[[Scene, Path, launch.Progress | None], Record]


def run(scene: Scene, folder: str | Path, **options: Any) -> Record:
    """Run a scene: once with its time step (`launch.run`), or to its tolerance (`run_to_tolerance`)."""
    return (launch.run if scene.time.tolerance is None else run_to_tolerance)(scene, folder, **options)


def resume(folder: str | Path, *, progress: launch.Progress | None = None) -> Record:
    """Continue an interrupted run, or the runs of an interrupted scene with a tolerance (`launch.resume`)."""
    folder = Path(folder).absolute()
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

    with launch.locked(folder):
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
        As in `launch.run`. The steps that `progress` is told grow when a pair is not enough.

    Returns
    -------
    Record
        ``info["error_estimate"]`` holds the relative L2 errors of its p, q, phi (None where symmetry makes one zero).

    Raises
    ------
    SceneError
        Before anything is run, when the tolerance is below what rounding or the walls leave in the scene.
    ToleranceError
        When the smallest step tried does not meet it.
    RunFolderError, LaunchError, LammpsMissingError, LammpsError, RunInterrupted
        As in `launch.run`.
    """
    scene, _ = resolve(scene)
    check_floor(scene)
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
        return launch.run(scene, place, launcher=launcher, ranks=ranks, progress=told)

    with launch.locked(folder, make=True, force=force):
        with writable(folder):
            (folder / STATUS).unlink(missing_ok=True)  # of an earlier run, as the rest: it must not pass for this one's
            for stale in folder.glob(f"*{PER_SAMPLE}"):
                if (stale / "scene.toml").is_file():
                    shutil.rmtree(stale)
            (folder / TRAJECTORY).unlink(missing_ok=True)
            replace_text(folder / "scene.toml", scene.to_toml())
        return refine(scene, folder, one, progress, info)


def estimate(records: list[Record]) -> dict[str, float]:
    """Relative L2 errors of p, q, φ that the extrapolation of the last two records is estimated to have.

    Parameters
    ----------
    records : list of Record
        Two runs or more of a scene, each with half the step of the one before.

    Returns
    -------
    dict
        Without those that vanish by symmetry; inf where two runs cannot tell.
    """
    coarse = records[-2]
    exponent = order(records[-1].scene)
    first_order = exponent == 1
    newer = richardson(coarse, records[-1], exponent)
    law = step_errors(coarse.scene, coarse.scene.time.step) if coarse.scene.plane_along_y else {}
    law = {name: error for name, error in law.items() if not np.isnan(getattr(newer, name)).any()}  # not tracked: φ
    names = list(law) or moving(newer.signals)
    found = {name: newer.info["error_estimate"][name] or 0.0 for name in names}
    if len(records) == 2:
        if first_order or not law:
            return dict.fromkeys(names, inf)  # the law is that of velocity Verlet, and of a plane wave along y
        return {name: _of_two(error, found[name]) for name, error in law.items()}
    older = richardson(records[-3], coarse, exponent)
    result = {}
    for name in names:
        values = getattr(newer, name)
        size = np.linalg.norm(values)
        moved = float(np.linalg.norm(getattr(older, name) - values) / size)
        coarser = older.info["error_estimate"][name] or 0.0
        second_order = bool(law) and not first_order and coarser > _SECOND_ORDER * found[name]
        result[name] = moved / 15 if second_order else moved
    if not first_order:
        for name, error in turning_errors(coarse.scene, coarse.scene.time.step).items():
            result[name] = result.get(name, 0.0) + error / 3
    return result


def _of_two(law: StepError, found: float) -> float:
    """E from the difference that two runs show, `found`, and the one that the law expects."""
    if found > _MISJUDGED * law.halved:
        return _UNKNOWN * found
    return law.extrapolated * max(1.0, found / law.halved) ** 2


def refine(scene: Scene, folder: Path, one: OneRun, progress: launch.Progress | None, info: dict[str, Any]) -> Record:
    """Run pair after pair until one meets the tolerance; ``run.json`` says how that ended.

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
    per_sample = round(scene.time.sample / step_for(scene))
    records: list[Record] = []
    said: list[str] = []
    found: dict[str, float] = {}
    with writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    try:
        for level in range(LEVELS + 1):
            count = per_sample << level
            stepped = with_step(scene, scene.time.sample / count)
            # The runs before this one made count − per_sample steps a sample; the first pair makes 3 per_sample
            before, all_ = count - per_sample, max(2 * count - per_sample, 3 * per_sample)
            told = _offset(progress, before * scene.time.samples, all_ * scene.time.samples)
            records.append(one(stepped, folder / f"{count}{PER_SAMPLE}", told))
            if level == 0:
                continue
            found = estimate(records)
            if all(error <= tolerance for error in found.values()):  # a nan is not
                break
            said.append(f"steps of {2 * stepped.time.step!r} and {stepped.time.step!r} tau: {_worst(found)}; halved")
        else:
            raise ToleranceError(
                f"time.tolerance = {tolerance!r}: not met with steps down to {records[-1].scene.time.step!r} tau, "
                f"{_worst(found)}; the runs are kept in {folder}"
            )
    except BaseException as error:  # also what the caller's progress raises: the folder must say how the run ended
        stopped = isinstance(error, RunInterrupted | KeyboardInterrupt)
        message = str(error) if isinstance(error, GranularError) else type(error).__name__
        write_status(folder, info | {"status": "interrupted" if stopped else "failed", "message": message})
        raise
    record = richardson(records[-2], records[-1], order(records[-1].scene))
    runs = [run.info for run in records]
    outcome = {
        "error_estimate": {name: found.get(name) for name in ("p", "q", "phi")},
        "error_budget": as_json(error_budget(scene, found)),
        "extrapolated_from": [run.scene.time.step for run in records[-2:]],
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
