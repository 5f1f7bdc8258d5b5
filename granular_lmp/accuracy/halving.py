"""Runs of one scene with shorter and shorter steps until their estimated error meets ``time.tolerance``.

What estimates the error of the runs is given. The folder holds a run folder for each step, ``N_per_sample``.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import inf, isfinite
from pathlib import Path
from shlex import quote
from typing import Any

from granular_lmp.accuracy.extrapolation import Judgement, following
from granular_lmp.errors import GranularError, RunInterrupted, ToleranceError
from granular_lmp.lammps.outputs import PER_SAMPLE, SCENE, STATUS, replace_text, writable
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.continuation import read_unfinished, whole_checkpoints
from granular_lmp.runs.folder import clear, locked, refuse_links
from granular_lmp.runs.formats import FORMAT
from granular_lmp.runs.options import Options, Progress
from granular_lmp.runs.record import Record, read_status, write_status
from granular_lmp.runs.seal import scene_digest

MOST_RUNGS = 12  # runs that are tried before the tolerance is refused
# The finest run looks for effects that decks leave out: a contact that opens in a coarser one alone keeps runs apart.
# The first run cannot be the finest, and one of two steps to a sample is so seldom, as nothing comes between 1 and 2
COARSE = 2
FINEST = 128  # steps of the finest run at most, over those of the first


# Makes a run of a scene with a step in a folder; the flag says whether its deck looks for effects that it leaves out
One = Callable[[Scene, Path, Progress | None, bool], Record]


def extrapolated(coarse: Any, fine: Any, order: int) -> Any:
    """Return (2^p b − a)/(2^p − 1): numbers or arrays a of a run and b of half its step, with errors of order p.

    With p = 0 their error is no series, and b is returned.
    """
    return (2**order * fine - coarse) / (2**order - 1) if order else fine


@contextmanager
def begun(scene: Scene, folder: Path, options: Options) -> Iterator[dict[str, Any]]:
    """Give the runs of a scene a locked folder that holds ``scene.toml``; yield what ``run.json`` says from the start.

    Raises
    ------
    RunFolderError
        If the folder exists (without ``options.force``) or cannot be written.
    """
    text = scene.to_toml()
    with locked(folder, make=True, force=options.force):
        clear(folder)
        with writable(folder):
            replace_text(folder / SCENE, text)
        yield {
            "format": FORMAT,
            "name": scene.name,
            "scene_sha256": scene_digest(text),
            "tolerance": scene.time.tolerance,
            "launcher": "lmp" if options.program else "module",
            "ranks": options.ranks,
        }


def continued(one: One, resume: Callable[[Path, Progress | None], Record]) -> One:
    """Return `one` of runs that were stopped: what is finished is read, and what has a checkpoint goes on from it."""

    def rest(scene: Scene, place: Path, progress: Progress | None, looks: bool) -> Record:
        if (place / STATUS).is_file():
            info = read_status(place)
            if info["status"] != "finished":
                read_unfinished(place)  # raises if the run failed by a guard
            elif not looks or info.get("looks") != {}:
                return Record.load(place)
        return resume(place, progress) if whole_checkpoints(place) else one(scene, place, progress, looks)

    return rest


def halved(
    scene: Scene,
    folder: Path,
    plan: Sequence[int],
    one: One,
    estimate: Callable[[Sequence[Record]], Judgement],
    progress: Progress | None,
    info: dict[str, Any],
) -> tuple[list[Record], Judgement, list[str]]:
    """Run with smaller and smaller steps until the estimate meets the tolerance; ``run.json`` says if that fails.

    Parameters
    ----------
    scene : Scene
        With ``time.tolerance``.
    folder : Path
        Existing folder for the runs and ``run.json``.
    plan : sequence of int
        Steps per sample of the planned runs; more of them are said in ``run.json``.
    one : callable
        Function of scene, folder, progress callback and whether to look that makes one run of a scene with a time step.
        Only a run that is finer than all before looks, and the finest does in the end.
    estimate : callable
        Judgement of some runs, of which all errors count.
    progress : callable, optional
        Callback ``progress(step, steps)``.
    info : dict
        Entries of ``run.json`` that are known before the runs.

    Returns
    -------
    records : list
        The runs, in the order in which they were made.
    judgement : Judgement
        What was estimated of them.
    refinements : list of str
        A sentence for each run beyond the plan.

    Raises
    ------
    ToleranceError
        If the shortest step misses the tolerance.
    RunInterrupted
        If a run is stopped.
    """
    tolerance, samples = scene.time.clock.tolerance, scene.time.samples
    records: list[Record] = []
    refinements: list[str] = []
    refuse_links(folder)
    with writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    try:
        counts, count = list[int](), plan[0]
        while True:
            stepped = scene.with_values({"time.timestep": scene.time.sample / count})
            before = sum(counts)
            part = _offset(progress, before * samples, max(before + count, sum(plan)) * samples)
            looks = bool(counts) and count > max(*counts, COARSE)
            records.append(one(stepped, folder / f"{count}{PER_SAMPLE}", part, looks))
            counts.append(count)
            judgement = estimate(records)
            # The comparison is false for a nan
            if len(counts) > 1 and all(error <= tolerance for error in judgement.errors.values()):
                _look(records, lambda run, place: one(run, folder / place, None, True))
                break
            worst = max(judgement.errors.values(), default=inf)
            count = following(counts, judgement, worst, tolerance) if isfinite(worst) else 2 * max(counts)
            if len(counts) == MOST_RUNGS or count > FINEST * plan[0]:
                raise ToleranceError(
                    f"time.tolerance = {tolerance!r}: not met with steps down to {scene.time.sample / max(counts)!r} "
                    f"tau, {_worst(judgement.errors)}; the runs are kept in {folder}"
                )
            if len(counts) >= len(plan):
                shortest = scene.time.sample / max(counts)
                refinements.append(f"steps down to {shortest!r} tau: {_worst(judgement.errors)}; one run more")
    except BaseException as error:  # also from the progress callback: run.json must hold the end of every run
        if isinstance(error, RunInterrupted | KeyboardInterrupt):
            resumed_by = f"granular-lmp resume {quote(str(folder))}"
            error = RunInterrupted(f"{folder}: interrupted; what was recorded is kept; continue with: {resumed_by}")
        message = str(error) if isinstance(error, GranularError) else type(error).__name__
        status = "interrupted" if isinstance(error, RunInterrupted) else "failed"
        write_status(folder, info | {"status": status, "message": message})
        raise error from None
    return records, judgement, refinements


def _look(records: list[Record], again: Callable[[Scene, str], Record]) -> None:
    """Make the finest run of a ladder once more if it has not looked."""
    place, finest = max(enumerate(records), key=lambda each: each[1].scene.time.steps_per_sample)
    if finest.info.get("looks") == {}:
        records[place] = again(finest.scene, f"{finest.scene.time.steps_per_sample}{PER_SAMPLE}")


def _worst(found: dict[str, float]) -> str:
    name = max(found, key=lambda key: found[key])
    return f"estimated error {found[name]:.2g} of {name}"


def _offset(progress: Progress | None, before: int, total: int) -> Progress | None:
    """Return a progress callback for one run that counts the steps of all runs."""
    return None if progress is None else lambda step, _: progress(before + step, total)
