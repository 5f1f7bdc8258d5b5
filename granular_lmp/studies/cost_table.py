"""The table of a work–precision study: the seconds and the errors of each setting, and the one to recommend.

Its rows are made from the run folders of the study (`granular_lmp.studies.cost`).
"""

from typing import Any

import numpy as np

from granular_lmp.accuracy.rounding import judged
from granular_lmp.lammps.outputs import csv_text
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.record import Record

NOT_RUN = "not run yet, the same command continues"
NOT_MET = "no step meets it: "
COLUMNS = (
    *("knob", "setting", "repeats", "seconds", "seconds_min", "seconds_max", "loop_seconds"),
    *("particles", "steps", "particle_steps", "particle_steps_per_second"),
)

Row = dict[str, Any]


def components(scene: Scene) -> tuple[str, ...]:
    """Return the names of the signals whose errors are measured."""
    return ("velocity", "spin", "displacement") if scene.wave is None else ("p", "q", "phi")


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
