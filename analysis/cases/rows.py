"""Runs along y whose rows move as one: read row by row from their snapshots, and their tones and waves by amplitude."""

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
AIRY = 3.5  # widths d^{1/3}, after d rows, ahead of a front at which the lattice moves by 1e-6 of the wave


@dataclass(frozen=True)
class Rows:
    """Displacements of whole rows of a run, (T, rows) each, in D0: every row's mean over its spheres."""

    tau: Floats
    p: Floats
    q: Floats
    phi: Floats

    @property
    def count(self) -> int:
        """Number of rows."""
        return self.p.shape[1]


def load_form(folder: str | Path, form: str) -> tuple[Record, Rows]:
    """Load a run whose wave, along y, has the form, and the motion of its rows.

    Raises SystemExit with one line for another form, a run without snapshots, and physics that the theory of the form
    does not hold.
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
    """Return the snapshots of a run, row by row; GranularError where there are none."""
    particles, shape = record.snapshots(), record.scene.shape
    displacement, rotation = particles.stacks("displacement", "rotation")
    moved = displacement.reshape(-1, shape.rows, shape.columns, 2).mean(axis=2)
    turned = rotation.reshape(-1, shape.rows, shape.columns).mean(axis=2)
    return Rows(particles.tau, moved[..., 1], -moved[..., 0], turned)


def echo(distance: ArrayLike) -> Floats:
    """τ after which a signal that has run so many rows arrives, to 1e-6: ½ row per τ, Airy's d^{1/3} ahead of it."""
    rows = np.asarray(distance, dtype=float)
    return 2 * np.maximum(rows - AIRY * np.cbrt(rows), 0)


def amplitudes_at(tau: Floats, signals: Floats, frequencies: ArrayLike) -> tuple[Floats, Complexes]:
    """Mean (N,) and amplitudes (F, N) of e^{−iΩτ} in signals (T, N), beside a slope, by least squares, Hann-weighted.

    The window lowers what other frequencies of a wave just switched on leave in the amplitudes.
    """
    angles = np.multiply.outer(tau, frequencies)
    columns = np.column_stack([np.ones_like(tau), tau - np.mean(tau), np.cos(angles), np.sin(angles)])
    weights = np.sin(np.pi * (np.arange(len(tau)) + 0.5) / len(tau))[:, None]  # squared, they are Hann's
    factors, *_ = np.linalg.lstsq(columns * weights, signals * weights, rcond=None)
    count = angles.shape[1]
    return factors[0], factors[2 : 2 + count] + 1j * factors[2 + count :]


def waves(field: NDArray[np.complexfloating], at: ArrayLike, wavenumbers: Sequence[float]) -> tuple[Complexes, float]:
    """Return the amplitudes of e^{ikn} in a field (n,) at places (n,), and what they leave of it, relative.

    Raises ValueError for fewer places than waves.
    """
    if len(field) < len(wavenumbers):
        raise ValueError(f"{len(field)} rows: must be at least {len(wavenumbers)}, as many as the waves in them")
    basis = np.exp(1j * np.multiply.outer(at, np.asarray(wavenumbers)))
    found = np.linalg.lstsq(basis, field, rcond=None)[0]
    return found, float(np.linalg.norm(basis @ found - field) / np.linalg.norm(field))
