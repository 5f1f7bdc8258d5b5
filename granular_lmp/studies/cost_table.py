"""The table of a work–precision study: the seconds and the errors of each setting, and the one to recommend.

Everything is read from the run folders of the study (`granular_lmp.studies.cost`).
"""

from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from granular_lmp.accuracy.estimates import richardson
from granular_lmp.accuracy.rounding import judged
from granular_lmp.effects.selection import order
from granular_lmp.lammps.outputs import SCENE, csv_text, replace_text
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.record import STATUS, TRAJECTORY, Record, read_status, write_status
from granular_lmp.runs.seal import files_of
from granular_lmp.studies.cost_settings import REFERENCE, Setting
from granular_lmp.studies.sweep_points import scene_hash

NOT_RUN = "not run yet, the same command continues"
NOT_MET = "no step meets it: "
_COLUMNS = (
    *("knob", "setting", "repeats", "seconds", "seconds_min", "seconds_max", "loop_seconds"),
    *("particles", "steps", "particle_steps", "particle_steps_per_second"),
)

Row = dict[str, Any]


def components(scene: Scene) -> tuple[str, ...]:
    """Return the names of the signals whose errors are measured."""
    return ("velocity", "spin", "displacement") if scene.wave is None else ("p", "q", "phi")


def place(folder: Path, run: Scene, turn: int) -> Path:
    """Return the folder of a run in one round of a study."""
    return folder / "runs" / scene_hash(run) / str(turn)


def is_done(folder: Path) -> bool:
    """Return whether the run in this folder is finished."""
    return (folder / STATUS).is_file() and read_status(folder).get("status") == "finished"


def collect(folder: Path, settings: list[Setting], repeats: int, failures: dict[str, str]) -> dict[str, Any]:
    """Return the rows of the reference and of all settings from the run folders of a study.

    Of a wave the record of the reference is written beside them. Without the reference there are no rows.

    Parameters
    ----------
    folder : Path
    settings : list of Setting
        The reference first.
    repeats : int
        Number of rounds.
    failures : dict
        Name of a run → why it failed.
    """
    reference, *others = settings
    places = [place(folder, run, 1) for run in reference.runs]
    if not all(map(is_done, places)):
        return {"reference": None, "points": []}
    best = _record(places)
    # The distance of two extrapolations is the error itself if that is no series in the step or of first order, as at
    # these small steps, and an upper bound otherwise
    left = errors(_record(places[:-1]), best)
    if best.scene.wave is not None:
        _write_reference(folder / REFERENCE, best, left)
    rows = [_row(folder, each, repeats, best, failures) for each in others]
    return {"reference": _row(folder, reference, 1, best, failures) | left, "points": rows}


def _write_reference(folder: Path, record: Record, left: dict[str, float | None]) -> None:
    folder.mkdir(exist_ok=True)
    replace_text(folder / SCENE, record.scene.to_toml())
    record.write_csv(folder / TRAJECTORY)
    estimate = {name.removeprefix("error_"): error for name, error in left.items()}
    write_status(folder, record.info | {"error_estimate": estimate, "files": files_of(folder)})


def _record(places: list[Path]) -> Record:
    """Return the record of a setting: that of its single run, or the extrapolation of its last two.

    The finer of the two is returned where the error is no series in the step, as with contacts that open or slide.
    """
    *coarser, fine = [Record.load(there) for there in places[-2:]]
    return richardson(coarser[0], fine, order(fine.scene)) if coarser else fine


def _row(folder: Path, setting: Setting, repeats: int, best: Record, failures: dict[str, str]) -> Row:
    turns = ([place(folder, run, turn) for run in setting.runs] for turn in range(1, repeats + 1))
    rounds = [places for places in turns if all(map(is_done, places))]
    failed = [failures[name] for name in map(scene_hash, setting.runs) if name in failures]
    message = failed[0] if failed else "" if rounds else NOT_RUN
    names = (*_COLUMNS, *(f"error_{name}" for name in components(best.scene)), "options", "message")
    row: Row = dict.fromkeys(names) | {"knob": setting.knob, "setting": setting.name, "repeats": len(rounds)}
    row |= {"options": setting.options, "message": message}
    if not rounds:
        return row
    infos = [[read_status(there) for there in places] for places in rounds]
    seconds = [sum(info["wall_seconds"]["total"] for info in together) for together in infos]
    loop = median(sum(info["wall_seconds"]["loop"] for info in together) for together in infos)
    work = sum(info["particles"] * info["steps"] for info in infos[0])
    return row | {
        "seconds": median(seconds),
        "seconds_min": min(seconds),
        "seconds_max": max(seconds),
        "loop_seconds": loop,
        "particles": infos[0][0]["particles"],
        "steps": sum(info["steps"] for info in infos[0]),
        "particle_steps": work,
        "particle_steps_per_second": work / loop,
        **errors(_record(rounds[0]), best),  # every round gives the same record
    }


def failed(row: Row) -> bool:
    """Return whether a setting failed: neither the time nor its tolerance is why it has no numbers."""
    return not (row["message"] in ("", NOT_RUN) or row["message"].startswith(NOT_MET))


def errors(record: Record, best: Record) -> dict[str, float | None]:
    """Return the errors against the reference: of a wave relative L2 errors of p, q, φ, else the largest errors.

    The largest errors of velocities and spins are in the unit of velocity, and that of displacements is over the
    largest of them. An error is None if the signal vanishes by symmetry or was not recorded.
    """
    wave = best.scene.wave is not None
    there = judged(best.scene, best.signals) if wave else best.signals
    found: dict[str, float | None] = {}
    for name in components(best.scene):
        error, size = 0.0, 0.0
        if name in there and not np.isnan(record.signals[name]).all():
            norm = np.linalg.norm if wave else lambda values: np.max(np.abs(values))
            error = float(norm(record.signals[name] - best.signals[name]))
            size = float(norm(best.signals[name])) if wave or name == "displacement" else 1.0
        found[f"error_{name}"] = error / size if size else None
    return found


def largest(row: Row) -> tuple[float, str] | None:
    """Return the largest error of a row and its signal, or None if no error is known."""
    errors = {key.removeprefix("error_"): value for key, value in row.items() if key.startswith("error_")}
    return max(((value, name) for name, value in errors.items() if value is not None), default=None)


def recommended(result: dict[str, Any], accuracy: float) -> str:
    """Return the fastest measured setting of an accuracy, in words and as options of ``granular-lmp run``.

    The error of a setting is the largest of its signals, and no smaller than that of the reference.
    """
    best = (largest(result["reference"]) or (0.0, ""))[0] if result["reference"] else 0.0
    known = [(row, largest(row)) for row in result["points"] if row["repeats"] and row["options"] is not None]
    found = [(row, max(error[0], best), error[1]) for row, error in known if error is not None]
    if not found:
        return "no setting has been measured that could be recommended"
    met = [each for each in found if each[1] <= accuracy]
    row, error, name = min(met, key=lambda each: each[0]["seconds"]) if met else min(found, key=lambda each: each[1])
    said = f"{row['knob']}, {row['setting']}: {row['seconds']:.3g} s, error {error:.1e} in {name}"
    if not met:
        return f"no measured setting has an error of at most {accuracy:g}; the best is {said}: {row['options']}"
    return f"for an error of at most {accuracy:g} the fastest is {said}\n{row['options']}"


def to_csv(rows: list[Row]) -> str:
    """Return the table as CSV, each number in the shortest form that reads back to the same double."""
    return csv_text(rows[0], (row.values() for row in rows)) if rows else ""


def text(result: dict[str, Any]) -> str:
    """Return the table for a terminal; errors below that of the reference are marked with <."""
    best = result["reference"]
    names = [key for key in best or {} if key.startswith("error_")]
    head = f"{'knob':18}{'setting':26}{'rounds':>6}{'s, median':>10}{'(min - max)':>21}{'M p-s/s':>9}"
    lines = [head + "".join(f"{name.removeprefix('error_')[:9]:>10}" for name in names)]
    for row in [*([best] if best else []), *result["points"]]:
        start = f"{row['knob']:18.17}{row['setting']:26.25}"
        if not row["repeats"]:
            lines.append(f"{start}{row['message']}")
            continue
        spread = f"({row['seconds_min']:.3g} - {row['seconds_max']:.3g})"
        rate = row["particle_steps_per_second"] / 1e6
        cells = "".join(f"{_cell(row[name], None if row is best else best[name]):>10}" for name in names)
        lines.append(f"{start}{row['repeats']:6d}{row['seconds']:10.3g}{spread:>21}{rate:9.2f}{cells}")
    return "\n".join(lines)


def _cell(error: float | None, floor: float | None) -> str:
    if error is None:
        return "-"
    return f"{error:.1e}" if floor is None or error >= floor else f"<{floor:.1e}"
