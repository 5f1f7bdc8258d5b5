"""Folder of a sweep: its finished runs and their varied values, in the order of its table."""

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from granular_lmp.runs.record import STATUS, Record


@dataclass(frozen=True)
class Swept:
    """Finished runs of a sweep.

    Attributes
    ----------
    over : list of str
        Varied keys.
    points : list of dict
        Line of ``sweep.csv`` of each finished run; if several points share a run, the first of their lines.
    folder : Path
        Folder of the sweep.
    missing : int
        Number of points without a finished run.
    shared : int
        Number of points that share the run of an earlier point.
    """

    over: list[str]
    points: list[dict[str, str]]
    folder: Path
    missing: int
    shared: int

    @property
    def folders(self) -> list[Path]:
        """Return the folder of each finished run."""
        return [self.folder / point["run"] for point in self.points]

    def columns(self, records: Sequence[Record]) -> dict[str, list[str]]:
        """Return the varied values of each run by key; as "KEY_asked" also the values asked for, if any differs.

        The values come from the scenes; the table adds values that no scene holds: wave vectors, and values asked for.
        """
        found: dict[str, list[str]] = {}
        for key in self.over:
            used = [_words(record, key, point[key]) for record, point in zip(records, self.points, strict=True)]
            asked = [point.get(f"{key}_asked", point[key]) for point in self.points]
            found |= {key: used} | ({f"{key}_asked": asked} if used != asked else {})
        return found

    @classmethod
    def load(cls, folder: str | Path) -> Self | None:
        """Return the sweep in a folder; None if the folder has no ``sweep.json``, or is that of a run.

        Raises SystemExit with one line if a file cannot be read, or no run is finished.
        """
        folder = Path(folder)
        if not (folder / "sweep.json").is_file() or (folder / STATUS).is_file():
            return None
        try:
            over = list(json.loads((folder / "sweep.json").read_text(encoding="utf-8"))["over"])
            with (folder / "sweep.csv").open(encoding="utf-8", newline="") as stream:
                rows: list[dict[str, Any]] = list(csv.DictReader(stream))
            finished = [row for row in rows if row["status"] == "finished"]
            runs: dict[str, dict[str, str]] = {}
            for row in finished:
                runs.setdefault(row["run"], row | {key: row[key] for key in over})  # KeyError for a missing column
        except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
            raise SystemExit(f"{folder}: not the folder of a sweep: {error!r}") from error
        if not finished:
            raise SystemExit(f"{folder}: none of its {len(rows)} runs is finished; there is nothing to compare")
        missing, shared = len(rows) - len(finished), len(finished) - len(runs)
        return cls(over, list(runs.values()), folder, missing, shared)


def _words(record: Record, key: str, listed: str) -> str:
    """Return the value of a key in a run; as the table writes it, if the table has the same value."""
    ran = record.scene.used.get(key, record.scene.value(key))
    try:
        same = float(listed) == ran
    except ValueError:
        same = False
    return listed if same or ran is None else str(ran)
