"""Runs for scripts: an error is one line on the screen and ends the script."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from granular_analysis.measure.signals import recorded
from granular_analysis.measure.swept import Swept
from granular_lmp.runs.record import GranularError, Record, Scene

PROGRAM = (sys.executable, "-P", "-m", "granular_lmp")  # -P: imports nothing from the current folder


def load(folder: str | Path, *, unfinished: bool = False) -> Record:
    """Return the record of a run.

    Raises SystemExit with one line for a folder that cannot be read, for fewer than two records, and for records that
    are not finite.
    """
    try:
        record = Record.load(folder, unfinished=unfinished)
    except GranularError as error:
        raise SystemExit(error.in_options()) from error
    if len(record.tau) < 2:
        raise SystemExit(f"{folder}: {len(record.tau)} records; there is nothing to compare")
    if not all(np.isfinite(x).all() for x in recorded(record).values()):
        raise SystemExit(f"{folder}: the record holds numbers that are not finite; there is nothing to compare")
    return record


def begun(scene: Scene, folder: str | Path) -> Record:
    """Run a scene for one sample with the command granular-lmp, and return the record with a snapshot of the start.

    Raises ValueError with the error of the command if the scene cannot be run.
    """
    sample = scene.time.sample
    short = {"time.duration": sample, "output.particles": sample, "output.checkpoint": "auto"}
    declared, run = Path(folder, "scene.toml"), Path(folder, "run")
    scene.with_values(short | {"packing.rows": scene.shape.rows}).write(declared)
    command = [*PROGRAM, "run", str(declared), "-o", str(run)]
    said = subprocess.run(command, capture_output=True, text=True)
    if said.returncode:
        raise ValueError(said.stderr.strip().rpartition("\n")[2])
    return load(run)


def run_sweep(scene: Scene, folder: Path, *over: str) -> list[Record]:
    """Run a sweep of a scene with the command granular-lmp, and return its runs by wave number.

    `over` are the arguments KEY=VALUES of --over. The command prints its progress. Raises ValueError if it fails.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    declared = folder.with_suffix(".toml")
    scene.write(declared)
    keys = [word for each in over for word in ("--over", each)]
    command = [*PROGRAM, "sweep", str(declared), *keys, "-o", str(folder)]
    if subprocess.run(command, stdout=subprocess.DEVNULL).returncode:
        raise ValueError(f"{folder}: the sweep failed, as it says above")
    return sweep(str(folder))


def sweep(folder: str) -> list[Record]:
    """Return the runs of a sweep by wave number, without runs of an earlier sweep in the same folder.

    Raises SystemExit with one line for a folder without a sweep, and if a run has failed or is not finished.
    """
    swept = Swept.load(folder)
    if swept is None:
        raise SystemExit(f"{folder}: is no sweep; granular-lmp sweep SCENE --over KEY=VALUES makes one")
    if swept.missing:
        raise SystemExit(f"{folder}: {swept.missing} runs are not finished; the same sweep command again does them")
    return sorted(map(load, swept.folders), key=lambda record: record.scene.wavenumber)


def all_but(record: Record, *keys: str) -> dict[str, Any]:
    """Return the values of a run's scene without its name, its description and the given keys, "section.key"."""

    def others(section: str, table: Any) -> Any:
        if isinstance(table, list):
            return [others(section, each) for each in table]
        if not isinstance(table, dict):
            return table
        return {key: value for key, value in table.items() if f"{section}.{key}" not in keys}

    tables = record.scene.to_dict()
    return {name: others(name, table) for name, table in tables.items() if name not in ("name", "description")}
