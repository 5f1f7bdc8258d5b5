"""Runs that LAMMPS has not made: what a script reads of a record whose rows move as given."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from granular_lmp import Record, Scene
from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.outputs import SCENE, STATUS
from granular_lmp.problem import prepare
from granular_lmp.runs.formats import FORMAT
from granular_lmp.runs.record import TRAJECTORY, write_status
from granular_lmp.runs.seal import files_of, scene_digest
from granular_lmp.scene.sections import Envelope
from tests.conftest import PAPER

AMPLITUDE = 0.1
COLUMNS = 3


def status_of(scene: Scene) -> dict[str, Any]:
    """Return what ``run.json`` says of the scene of a run, its effects and guards, all of which were quiet."""
    found = {effect.name: (effect.on, effect.guard) for effect in prepare(scene).effects}
    return {
        "format": FORMAT,
        "scene_sha256": scene_digest(scene.to_toml()),
        "particles": scene.shape.spheres,
        "wavenumber_used": scene.wavenumber,
        "direction_used": scene.direction,
        "amplitude": scene.wave.amplitude,
        "effects": {name: {"on": on, "called_for": on, "guard": guard} for name, (on, guard) in found.items()},
        "guards": {
            guard: {"effect": name, "quiet": True, "value": 0.0, "meaning": "", "judges": not on}
            for name, (on, guard) in found.items()
            if guard
        },
    }


def leave_folder(record: Record, folder: Path) -> None:
    """Write what a finished run leaves that a script reads; ``run.json`` holds the record's info besides."""
    scene = prepare(record.scene).scene
    folder.mkdir(parents=True)
    (folder / SCENE).write_text(scene.to_toml(), encoding="utf-8")
    record.write_csv(folder / TRAJECTORY)
    said = {"status": "finished", "samples": len(record.tau)} | status_of(scene) | record.info
    write_status(folder, said | {"files": files_of(folder)})


def of_first_format(folder: Path) -> Path:
    """Make a folder one of release 0.1.0, which lists no files."""
    info = json.loads((folder / STATUS).read_text(encoding="utf-8"))
    for key in ("format", "files", "sealed"):
        info.pop(key, None)
    info["versions"] = info.get("versions", {}) | {"granular_lmp": "0.1.0"}
    (folder / STATUS).write_text(json.dumps(info), encoding="utf-8")
    return folder


def leave_sweep(records: Sequence[Record], folder: Path) -> None:
    """Write what a finished sweep over the wave number leaves that a script reads, its runs in the order of records."""
    lines = ["wave.wavenumber,run,status"]
    for number, record in enumerate(records):
        leave_folder(record, folder / "runs" / str(number))
        lines.append(f"{record.scene.wave.wavenumber!r},runs/{number},finished")
    (folder / "sweep.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "sweep.json").write_text('{"over": {"wave.wavenumber": []}}', encoding="utf-8")


class Changed:
    """An object with some attributes changed."""

    def __init__(self, base: Any, **changes: Any) -> None:
        self._base = base
        vars(self).update(changes)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._base, name)


def run_of_rows(
    tau: np.ndarray,
    signals: tuple[np.ndarray, np.ndarray, np.ndarray],
    *,
    wavenumber: float,
    ends: str,
    envelope: Envelope | None = None,
    snapshots: bool = True,
    info: dict[str, Any] | None = None,
    **wave: Any,
) -> Any:
    """A record of the paper's spheres, 3 to a row, with p, q, φ (T, rows) of its rows in D0 = 0.1 Δ0."""
    rows = signals[0].shape[1]
    p, q, phi = (each.repeat(COLUMNS, axis=1) for each in signals)
    fields = {"displacement": np.stack([-q, p], axis=-1), "rotation": phi}

    def read() -> Any:
        if not snapshots:
            raise RunFolderError("run: holds no snapshots of all spheres")
        return SimpleNamespace(tau=tau, stacks=lambda *names: [fields[name] for name in names])

    scene = Changed(
        PAPER.with_values({f"wave.{key}": value for key, value in {"amplitude": AMPLITUDE, **wave}.items()}),
        wavenumber=wavenumber,
        envelope=envelope or Envelope(),
        shape=SimpleNamespace(rows=rows, columns=COLUMNS, ends=ends, centre_row=(rows - 1) // 2),
    )
    return SimpleNamespace(scene=scene, info=info or {}, snapshots=read)


def refused_in_one_line(main: Callable[[Sequence[str]], int], message: str) -> None:
    """Assert that a script exits with a message of one line on a run."""
    with pytest.raises(SystemExit, match=message) as refusal:
        main(["run"])
    assert "\n" not in str(refusal.value)
