"""Table of a work–precision study: seconds and errors of each setting, and the recommended setting.

Its rows are made from the run folders of the study (`granular_lmp.studies.cost`).
"""

from math import inf
from typing import Any

import numpy as np

from granular_lmp.accuracy.rounding import judged
from granular_lmp.runs.record import Record

NOT_RUN = "not run yet; the same command continues"
NUMBERS = ("seconds", "seconds_min", "seconds_max", "loop_seconds", "particles", "steps")

Row = dict[str, Any]


def failed(row: Row) -> bool:
    """Return whether a setting failed; a tolerance that no step meets is a result, not a failure."""
    return row["varied"] == "time step" and row["message"] not in ("", NOT_RUN)


def errors(record: Record, best: Record) -> dict[str, float | None]:
    """Return the errors against the reference: relative L2 errors of the signals of a wave, else largest errors.

    Largest errors of velocities and spins are in the unit of velocity; those of other signals are relative to the
    largest value. An error is None if the signal vanishes by symmetry or was not recorded.
    """
    wave = best.scene.wave is not None
    there = judged(best.problem, best.signals) if wave else best.signals
    norm = np.linalg.norm if wave else lambda values: np.max(np.abs(values))
    found: dict[str, float | None] = {}
    for name, values in best.signals.items():
        size = 1.0 if name in ("velocity", "spin") else float(norm(values))
        known = name in there and size > 0 and not np.isnan(record.signals[name]).all()
        found[f"error_{name}"] = float(norm(record.signals[name] - values)) / size if known else None
    return found


def largest(row: Row) -> tuple[float, str]:
    """Return the largest error of a row and its signal; the error is infinite if none is known."""
    errors = {key.removeprefix("error_"): value for key, value in row.items() if key.startswith("error_")}
    return max(((value, name) for name, value in errors.items() if value is not None), default=(inf, ""))


def recommended(result: dict[str, Any], accuracy: float) -> str:
    """Return the fastest measured setting with an accuracy, in words and as options of ``granular-lmp run``.

    The error of a setting is the largest of its signals, and at least that of the reference.
    """
    least = largest(result["reference"] or {})
    met = [row for row in result["points"] if max(largest(row), least)[0] <= accuracy]
    if not met:
        return f"no measured setting has an error of at most {accuracy:g}"
    row = min(met, key=lambda row: float(row["seconds"]))
    error, name = max(largest(row), least)
    said = f"{row['varied']}, {row['setting']}: {row['seconds']:.3g} s, error {error:.1e} in {name}"
    return f"for an error of at most {accuracy:g} the fastest is {said}\n{row['options']}"


def text(result: dict[str, Any]) -> str:
    """Return the table for a terminal; errors below that of the reference are marked with <."""
    best = result["reference"]
    names = [key for key in best or {} if key.startswith("error_")]
    head = f"{'varied':12}{'setting':12}{'rounds':>6}{'s, median':>10}{'(min - max)':>21}"
    lines = [head + "".join(f"{name.removeprefix('error_')[:9]:>10}" for name in names)]
    for row in [*([best] if best else []), *result["points"]]:
        start = f"{row['varied']:12}{row['setting']:12}"
        if not row["repeats"]:
            lines.append(f"{start}{row['message']}")
            continue
        spread = f"({row['seconds_min']:.3g} - {row['seconds_max']:.3g})"
        cells = "".join(f"{_cell(row[name], None if row is best else best[name]):>10}" for name in names)
        lines.append(f"{start}{row['repeats']:6d}{row['seconds']:10.3g}{spread:>21}{cells}")
    return "\n".join(lines)


def _cell(error: float | None, floor: float | None) -> str:
    if error is None:
        return "-"
    return f"{error:.1e}" if floor is None or error >= floor else f"<{floor:.1e}"
