"""Runs along y whose rows move as one: motion of the rows from snapshots, and amplitudes of its tones and waves."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.measure.runs import load
from granular_analysis.theory.catalogue import DRIVEN, HOLDS, JKR, OBLIQUE, QUIET, RUNNING, STANDING
from granular_analysis.theory.choice import traits_of
from granular_lmp.runs.record import GranularError, Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating]

_ALONG_Y = HOLDS["second-order"] - {RUNNING, OBLIQUE, JKR}
FORMS = {"standing": _ALONG_Y | {STANDING}, "driven": _ALONG_Y | {DRIVEN} | QUIET}  # traits that their theories hold
AIRY = 3.5  # distance ahead of a front, in widths d^{1/3} after d rows, at which the motion is 1e-6 of the wave


@dataclass(frozen=True)
class Rows:
    """Displacements of whole rows of a run, (T, rows) each, in D0: the mean over the spheres of each row."""

    tau: Floats
    p: Floats
    q: Floats
    phi: Floats

    @property
    def count(self) -> int:
        """Number of rows."""
        return self.p.shape[1]


def load_form(folder: str | Path, form: str) -> tuple[Record, Rows]:
    """Return a run whose wave along y has a given form, and the motion of its rows.

    Raises SystemExit with one line for another form, for a run without snapshots, and for physics that the theory of
    the form leaves out.
    """
    record = load(folder)
    found = record.scene.require_wave().form
    if found != form:
        raise SystemExit(f"{folder}: its wave has the form '{found}'; this script reads runs of the form '{form}'")
    if left_out := sorted(traits_of(record) - FORMS[form]):
        raise SystemExit(f"{folder}: the theory leaves out {', '.join(left_out)}, which this run has")
    try:
        return record, rows_of(record)
    except GranularError as error:
        raise SystemExit(error.in_options()) from error


def rows_of(record: Record) -> Rows:
    """Return the motion of the rows in the snapshots of a run; GranularError without snapshots."""
    particles, shape = record.snapshots(), record.scene.shape
    displacement, rotation = particles.stacks("displacement", "rotation")
    moved = displacement.reshape(-1, shape.rows, shape.columns, 2).mean(axis=2)
    turned = rotation.reshape(-1, shape.rows, shape.columns).mean(axis=2)
    return Rows(particles.tau, moved[..., 1], -moved[..., 0], turned)


def echo(distance: ArrayLike) -> Floats:
    """Return the τ before which less than 1e-6 of a signal has arrived after a number of rows d.

    The front runs ½ row per τ; its Airy head runs ahead of it by 3.5 d^{1/3} rows.
    """
    rows = np.asarray(distance, dtype=float)
    return 2 * np.maximum(rows - AIRY * np.cbrt(rows), 0)


def amplitudes_at(tau: Floats, signals: Floats, frequencies: ArrayLike) -> tuple[Floats, Complexes]:
    """Return mean (N,) and amplitudes (F, N) of e^{−iΩτ} in signals (T, N), by least squares with a Hann window.

    The fit also has a slope in τ. The window lowers the leakage from other frequencies, which a wave has after it was
    switched on.
    """
    angles = np.multiply.outer(tau, frequencies)
    columns = np.column_stack([np.ones_like(tau), tau - np.mean(tau), np.cos(angles), np.sin(angles)])
    weights = np.sin(np.pi * (np.arange(len(tau)) + 0.5) / len(tau))[:, None]  # their squares are the Hann window
    factors, *_ = np.linalg.lstsq(columns * weights, signals * weights, rcond=None)
    count = angles.shape[1]
    return factors[0], factors[2 : 2 + count] + 1j * factors[2 + count :]


def waves(field: NDArray[np.complexfloating], at: ArrayLike, wavenumbers: Sequence[float]) -> tuple[Complexes, float]:
    """Return the amplitudes of e^{ikn} in a field (n,) at places (n,), and the relative norm of the rest.

    Raises ValueError for fewer places than waves.
    """
    if len(field) < len(wavenumbers):
        raise ValueError(f"{len(field)} rows: must be at least {len(wavenumbers)}, the number of waves to fit")
    basis = np.exp(1j * np.multiply.outer(at, np.asarray(wavenumbers)))
    found = np.linalg.lstsq(basis, field, rcond=None)[0]
    return found, float(np.linalg.norm(basis @ found - field) / np.linalg.norm(field))
