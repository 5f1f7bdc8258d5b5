"""Runs as a script reads them: what is wrong with one is a single line and the end of the script."""

from pathlib import Path

import numpy as np

from granular_lmp.runs.record import STATUS, GranularError, Record


def load(folder: str | Path, *, unfinished: bool = False) -> Record:
    """`Record.load` for a script: what is wrong is one line and SystemExit, also a run with next to no record."""
    try:
        record = Record.load(folder, unfinished=unfinished)
    except GranularError as error:
        raise SystemExit(error.in_options()) from error
    if len(record.tau) < 2:
        raise SystemExit(f"{folder}: {len(record.tau)} records; there is nothing to compare")
    tracked = [x for x in (record.p, record.q, record.phi) if not (x is record.phi and np.isnan(x).all())]
    if not all(np.isfinite(x).all() for x in tracked):
        raise SystemExit(f"{folder}: the record holds numbers that are not finite; there is nothing to compare")
    return record


def sweep(folder: str) -> list[Record]:
    """The finished runs of a sweep, by wave number."""
    runs = (load(path.parent) for path in Path(folder).glob(f"runs/*/{STATUS}"))
    return sorted(runs, key=lambda record: record.scene.wavenumber)
