"""The folder of a sweep: which of its runs are finished, and what was varied in each, in the order of its table."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from granular_lmp.runs.record import STATUS


@dataclass(frozen=True)
class Swept:
    """The finished runs of a sweep.

    Attributes
    ----------
    over : list of str
        The keys that were varied.
    points : list of list
        Their values, as ``sweep.csv`` writes them, of each finished run.
    folders : list of Path
        The folder of each finished run; runs of the same scene share one.
    missing : int
        Runs that are not finished.
    """

    over: list[str]
    points: list[list[str]]
    folders: list[Path]
    missing: int

    @classmethod
    def load(cls, folder: str | Path) -> Self | None:
        """Read ``sweep.json`` and ``sweep.csv``; None for a folder that holds no sweep.

        Raises SystemExit with one line when a file cannot be read, or no run is finished.
        """
        folder = Path(folder)
        if not (folder / "sweep.json").is_file() or (folder / STATUS).is_file():
            return None
        try:
            over = list(json.loads((folder / "sweep.json").read_text(encoding="utf-8"))["over"])
            with (folder / "sweep.csv").open(encoding="utf-8", newline="") as stream:
                rows: list[dict[str, Any]] = list(csv.DictReader(stream))
            finished = [row for row in rows if row["status"] == "finished"]
            points = [[row[key] for key in over] for row in finished]
            folders = [folder / row["run"] for row in finished]
        except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
            raise SystemExit(f"{folder}: not the folder of a sweep: {error!r}") from error
        if not finished:
            raise SystemExit(f"{folder}: none of its {len(rows)} runs is finished; there is nothing to compare")
        return cls(over, points, folders, len(rows) - len(finished))
