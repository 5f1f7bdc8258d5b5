"""The results of a work–precision study: for each setting its seconds, its errors, and the slope of error over work.

Everything is read from the run folders of the study (`granular_lmp.studies.cost`).
"""

from math import log
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from granular_lmp.accuracy.estimates import order_of
from granular_lmp.accuracy.recorded import write_dump
from granular_lmp.accuracy.richardson import richardson
from granular_lmp.accuracy.rounding import judged
from granular_lmp.lammps.outputs import SCENE, SNAPSHOTS, csv_text, replace_text
from granular_lmp.runs.record import STATUS, TRAJECTORY, Record, read_status, write_status
from granular_lmp.runs.seal import files_of, scene_digest
from granular_lmp.scene.scene import Scene
from granular_lmp.studies.cost_settings import ORDERED, REFERENCE, Point, Run
from granular_lmp.studies.output_variants import OUTPUTS

RUNS = "runs"
NOT_RUN = "not run yet"
NOT_MET = "no step meets it: "
COMPONENTS = ("p", "q", "phi"), ("velocity", "spin", "displacement")  # with a wave, and without
_COLUMNS = (
    *("knob", "setting", "repeats", "seconds", "seconds_min", "seconds_max", "loop_seconds"),
    *("particles", "steps", "particle_steps", "particle_steps_per_second"),
)
# A slope is given only if the error is at least this multiple of the error of the reference
_ABOVE_REFERENCE = 3.0

Row = dict[str, Any]


def columns_of(scene: Scene) -> tuple[str, ...]:
    """Return the names of the columns of the table of a scene."""
    errors = (f"error_{name}" for name in COMPONENTS[scene.wave is None])
    return (*_COLUMNS, *errors, "slope", "options", "message")


def place(folder: Path, run: Run, turn: int) -> Path:
    """Return the folder of a run in one round of a study."""
    return folder / RUNS / run.name / str(turn)


def taken(run: Run, folder: Path, repeats: int) -> list[float]:
    """Return the seconds of each finished round of a run."""
    places = (place(folder, run, turn) for turn in range(1, repeats + 1))
    return [read_status(there)["wall_seconds"]["total"] for there in places if is_done(run, there)]


def is_done(run: Run, folder: Path) -> bool:
    """Return whether the run in this folder is finished and its dump of all spheres has been read."""
    there = (folder / STATUS).is_file() and read_status(folder).get("status") == "finished"
    return there and not (folder / OUTPUTS[run.output].file).exists()


def collect(folder: Path, points: list[Point], repeats: int) -> dict[str, Any]:
    """Return the rows of the reference and of all settings from the run folders of a study.

    The record of the reference is written beside them. Without it there are no rows.

    Parameters
    ----------
    folder : Path
    points : list of Point
        Settings, the reference first.
    repeats : int
        Number of rounds.
    """
    first, *others = points
    rounds = _rounds(folder, first, 1)
    if not rounds:
        return {"reference": None, "points": []}
    best, left = _record(rounds[0]), _left(rounds[0])
    _write_reference(folder / REFERENCE, best, left, rounds[0])
    rows: list[Row] = []
    for point in others:
        row = _row(folder, point, _rounds(folder, point, repeats), best)
        row["options"] = point.options(first.runs[0].scene)
        before = next((other for other in reversed(rows) if other["repeats"]), None)
        if row["repeats"] and point.knob in ORDERED and before is not None and before["knob"] == point.knob:
            row["slope"] = _slope(before, row, left)
        rows.append(row)
    of_best = _row(folder, first, rounds, best) | {f"error_{name}": error for name, error in left.items()}
    return {"reference": of_best, "points": rows}


def _write_reference(folder: Path, record: Record, left: dict[str, float | None], places: list[Path]) -> None:
    folder.mkdir(exist_ok=True)
    scene = record.scene.to_toml()
    replace_text(folder / SCENE, scene)
    if record.scene.wave is not None:
        record.write_csv(folder / TRAJECTORY)
    else:
        more = 2 ** order_of(record.scene) - 1
        write_dump(folder / SNAPSHOTS, [there / SNAPSHOTS for there in places[-2:]], [-1 / more, 1 + 1 / more])
    said = {"error_estimate": left, "scene_sha256": scene_digest(scene), "files": files_of(folder)}
    write_status(folder, record.info | said)


def _rounds(folder: Path, point: Point, repeats: int) -> list[list[Path]]:
    """Return the folders of the runs of a setting for each round in which all of them are done."""
    rounds = [[place(folder, run, turn) for run in point.runs] for turn in range(1, repeats + 1)]
    return [places for places in rounds if all(map(is_done, point.runs, places))]


def _record(places: list[Path]) -> Record:
    """Return the record of a setting: that of its single run, or the extrapolation of its last two.

    The finer of the two is returned where the error is no series in the step, as with contacts that open or slide.
    """
    records = [Record.load(there) for there in places[-2:]]
    if len(records) == 1:
        return records[0]
    coarse, fine = records
    return richardson(coarse, fine, order_of(fine.scene))


def _left(places: list[Path]) -> dict[str, float | None]:
    """Return the estimated errors of the reference: its distance to the extrapolation of its coarser runs.

    The distance is the error itself if that is no series in the step or of first order, as at these small steps, and an
    upper bound otherwise.
    """
    return {name.removeprefix("error_"): error for name, error in errors(_record(places[:-1]), _record(places)).items()}


def _row(folder: Path, point: Point, rounds: list[list[Path]], best: Record) -> Row:
    """Return the row of a setting."""
    row: Row = dict.fromkeys(columns_of(best.scene)) | {"knob": point.knob, "setting": point.setting, "message": ""}
    row["repeats"] = len(rounds)
    if not rounds:
        return row | {"message": _why_not(folder, point)}
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


def _why_not(folder: Path, point: Point) -> str:
    for run in point.runs:
        there = place(folder, run, 1)
        status = read_status(there) if (there / STATUS).is_file() else {}
        if status.get("status") == "failed":
            return f"{NOT_MET}{status['message']}" if status.get("tolerance_met") is False else str(status["message"])
    return NOT_RUN


def failed(row: Row) -> bool:
    """Return whether a setting failed: it has no numbers, and neither the budget nor its tolerance is the reason."""
    return bool(row["message"]) and row["message"] != NOT_RUN and not row["message"].startswith(NOT_MET)


def errors(record: Record, best: Record) -> dict[str, float | None]:
    """Return the errors against the reference: relative L2 errors of p, q, φ, or the largest ones of a strike.

    Those of velocities and spins are in the unit of velocity, that of displacements is over the largest of them. An
    error is None if the signal vanishes by symmetry or was not recorded.
    """
    if best.scene.wave is None:
        return _largest_errors(record, best)
    there = judged(best.scene, best.signals)
    found: dict[str, float | None] = {}
    for name in COMPONENTS[False]:
        values, exact = getattr(record, name), getattr(best, name)
        absent = name not in there or np.isnan(values).all()
        found[f"error_{name}"] = None if absent else float(np.linalg.norm(values - exact) / np.linalg.norm(exact))
    return found


def _largest_errors(record: Record, best: Record) -> dict[str, float | None]:
    found: dict[str, float | None] = dict.fromkeys(f"error_{name}" for name in COMPONENTS[True])
    for name, exact in best.signals.items():
        unit = float(np.max(np.abs(exact))) if name == "displacement" else 1.0
        found[f"error_{name}"] = float(np.max(np.abs(record.signals[name] - exact))) / unit if unit else None
    return found


def largest(row: Row) -> tuple[float, str] | None:
    """Return the largest error of a row and its signal, or None if no error is known."""
    errors = {key.removeprefix("error_"): value for key, value in row.items() if key.startswith("error_")}
    known = [(value, name) for name, value in errors.items() if value is not None]
    return max(known, default=None)


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


def _slope(before: Row, row: Row, left: dict[str, float | None]) -> float | None:
    """Return d log error/d log work from the setting before: −2 for one run, −4 for a pair, 0 for wasted work.

    The slope is None if the work is the same, or the reference is no better than the setting.
    """
    more, error, error_before = row["particle_steps"] / before["particle_steps"], largest(row), largest(before)
    if abs(more - 1) < 0.01 or error is None or error_before is None:
        return None
    if error[0] < _ABOVE_REFERENCE * (left[error[1]] or 0.0) or error_before[0] == 0:
        return None
    return log(error[0] / error_before[0]) / log(more)


def to_csv(rows: list[Row]) -> str:
    """Return the table as CSV, each number in the shortest form that reads back to the same double."""
    return csv_text(rows[0], (row.values() for row in rows)) if rows else ""


def text(result: dict[str, Any]) -> str:
    """Return the table for a terminal; errors below that of the reference are marked with <."""
    names = [key.removeprefix("error_") for key in (result["reference"] or {}) if key.startswith("error_")]
    head = f"{'knob':18}{'setting':26}{'rounds':>6}{'s, median':>10}{'(min - max)':>21}{'M p-s/s':>9}"
    lines = [head + "".join(f"{name[:9]:>10}" for name in names) + f"{'slope':>7}"]
    best = result["reference"]
    for row in [*([best] if best else []), *result["points"]]:
        start = f"{row['knob']:18.17}{row['setting']:26.25}"
        if not row["repeats"]:
            lines.append(f"{start}{_reason(row, result['left_out'])}")
            continue
        spread = f"({row['seconds_min']:.3g} - {row['seconds_max']:.3g})"
        cells = "".join(f"{_cell(row, best, name):>10}" for name in names)
        slope = "" if row["slope"] is None else f"{row['slope']:z.1f}"
        rate = row["particle_steps_per_second"] / 1e6
        lines.append(f"{start}{row['repeats']:6d}{row['seconds']:10.3g}{spread:>21}{rate:9.2f}{cells}{slope:>7}")
    return "\n".join(lines)


def _reason(row: Row, left_out: dict[str, str]) -> str:
    """Return the reason why a setting has no numbers."""
    message = str(row["message"])
    return left_out.get(f"{row['knob']}: {row['setting']}", message) if message == NOT_RUN else message


def _cell(row: Row, best: Row, name: str) -> str:
    value, floor = row[f"error_{name}"], best[f"error_{name}"]
    if value is None:
        return "-"
    return f"<{floor:.1e}" if floor is not None and value < floor and row is not best else f"{value:.1e}"
