"""Runs that LAMMPS has not made: what a script reads of a record whose rows move as given."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from granular_lmp.errors import RunFolderError
from granular_lmp.scene.sections import Envelope
from tests.conftest import PAPER

AMPLITUDE = 0.1
COLUMNS = 3


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

    def particles() -> Any:
        if not snapshots:
            raise RunFolderError("run: holds no snapshots of all spheres")
        return SimpleNamespace(tau=tau, stack=fields.__getitem__)

    scene = Changed(
        PAPER,
        wave=replace(PAPER.wave, amplitude=AMPLITUDE, **wave),
        wavenumber=wavenumber,
        envelope=envelope or Envelope(),
        shape=SimpleNamespace(rows=rows, columns=COLUMNS, ends=ends, centre_row=(rows - 1) // 2),
    )
    return SimpleNamespace(scene=scene, info=info or {}, particles=particles)
