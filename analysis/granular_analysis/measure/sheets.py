"""Any wave on a periodic sheet to second order, against the snapshots of a run: beams, packets, standing waves.

The run holds snapshots of all spheres (``output.particles``). The first is taken as the initial field, all of it first
order, and `granular_analysis.theory.cell` predicts the later ones, y = y1 + a y2, in LAMMPS's contact geometry and with
the time step of the run: the second order of a run is seen in its difference to y1, next to which the phase error of
velocity Verlet is not small.

run − y1 holds the third order too, whose part at the fundamental is a drift of its phase, a²τ; hence the split by wave
number, around multiples of the strongest wave vector k. A field without one (noise) is predicted all the same.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.bloch import RECIPROCAL, unit
from granular_analysis.theory.catalogue import missing
from granular_analysis.theory.cell import Cell
from granular_analysis.theory.cell import fields as second_order
from granular_analysis.theory.choice import traits_of
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
FieldOrWave = TypeVar("FieldOrWave", Floats, Complexes)

ROW = np.sqrt(0.75)  # spacing of rows in lattice constants


@dataclass(frozen=True)
class Sheet:
    """The places of a periodic hexagonal sheet, row by row as in LAMMPS's deck; lengths in lattice constants.

    Raises ValueError for an odd number of rows, and for none.
    """

    rows: int
    columns: int

    def __post_init__(self) -> None:
        if self.rows < 2 or self.rows % 2 or self.columns < 1:
            raise ValueError(f"{self.rows} rows x {self.columns} columns: rows must be even, and there must be columns")

    @cached_property
    def _index(self) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.int_]]:
        """Return row and column of each sphere, and whether its row is shifted by half a lattice constant, (R, C)."""
        row, column = np.indices((self.rows, self.columns))
        return row, column, (row - (self.rows - 1) // 2) % 2

    @cached_property
    def rest(self) -> Floats:
        """Return the positions (N, 2) at rest; no sphere is on the border of the cell."""
        row, column, odd = self._index
        x, y = column - self.columns // 2 + 0.25 + 0.5 * odd, (row - (self.rows - 1) // 2) * ROW
        return np.stack([x, y], axis=-1).reshape(-1, 2)

    @cached_property
    def wavevectors(self) -> Floats:
        """Return half of the wave vectors that the sheet holds, (R, columns//2 + 1, 2), −k being the conjugate of k."""
        y, x = np.indices((self.rows, self.columns // 2 + 1))
        return 2 * np.pi * np.stack([x / self.columns, y / (self.rows * ROW)], axis=-1)

    @cached_property
    def _turn(self) -> Complexes:
        return np.exp(-0.5j * self.wavevectors[0, :, 0] * self._index[2][:, :1])[..., None]

    def waves(self, field: Floats) -> Complexes:
        """Return the waves (..., R, columns//2 + 1, 3) of a field (..., N, 3)."""
        rows = field.reshape(*field.shape[:-2], self.rows, self.columns, 3)
        return np.fft.fft(np.fft.rfft(rows, axis=-2) * self._turn, axis=-3)

    def field(self, waves: Complexes) -> Floats:
        """Return the field (..., N, 3) of waves."""
        rows = np.fft.irfft(np.fft.ifft(waves, axis=-3) * self._turn.conj(), self.columns, axis=-2)
        return rows.reshape(*rows.shape[:-3], self.rows * self.columns, 3)


def component(field: Floats, rest: Floats, wavevector: ArrayLike) -> Complexes:
    """Return the amplitude X of a wave vector in a field: X = (2/N) Σ field e^{−ik·r}, of a real field Re[X e^{ik·r}].

    Shapes (..., N, 3), (N, 2) in lattice constants and (2,) in their inverse give (..., 3). Other waves leak in where
    the sheet does not hold this one. Where −k is k (at k = 0, in the middle of the zone's sides) it is twice as large.
    """
    phases = np.exp(-1j * rest @ np.asarray(wavevector, dtype=float))
    return 2 / len(rest) * np.einsum("...nc,n->...c", field, phases)


def in_frame(field: FieldOrWave, wavevector: ArrayLike) -> FieldOrWave:
    """Return (…, 3) of u, v, φ as p along k (…, 2), q along ẑ × k, φ; k = 0 counts as along y."""
    x, y = np.moveaxis(unit(wavevector), -1, 0)
    u, v, phi = np.moveaxis(field, -1, 0)
    return np.stack([x * u + y * v, x * v - y * u, phi], axis=-1)


def rest_of(particles: Any) -> Floats:
    """Positions (N, 2) at rest of the spheres of a run, in lattice constants."""
    sphere = particles.scene.sphere
    return particles.rest * sphere.radius / sphere.lattice_constant


def fields_of(particles: Any, moved: str = "displacement", turned: str = "rotation") -> Floats:
    """Fields (T, N, 3) of u, v, φ of the snapshots of a run, in D0, or by other names their rates."""
    return np.array([field_of(each, moved, turned) for each in particles])


def field_of(spheres: Any, moved: str = "displacement", turned: str = "rotation") -> Floats:
    """Field (N, 3) of one snapshot, as `fields_of`."""
    return np.column_stack([getattr(spheres, moved), getattr(spheres, turned)])


def carrier(sheet: Sheet, field: Floats, rate: Floats) -> Floats:
    """The wave vector (2,) of the strongest wave in an initial field, in the first zone, upwards (ky > 0)."""
    power = sum(np.sum(np.abs(sheet.waves(part)) ** 2, axis=-1) for part in (field, rate))
    images = _images(sheet.wavevectors[np.unravel_index(np.argmax(power), power.shape)])
    found = np.round(images[np.argmin(np.round(np.linalg.norm(images, axis=1), 9))], 12)  # a zero may be 1e-17
    return (found if (found[1], found[0]) >= (0, 0) else -found) + 0.0  # no −0


def _images(wavevectors: Floats) -> Floats:
    """Wave vectors (..., 9, 2) that differ from these (..., 2) by a reciprocal lattice vector, with the shortest."""
    apart = wavevectors @ np.linalg.inv(RECIPROCAL)
    around = np.indices((3, 3)).reshape(2, -1).T - 1
    return ((apart - np.round(apart))[..., None, :] + around) @ RECIPROCAL


@dataclass(frozen=True)
class Comparison:
    """Snapshots of a run and the theory of them, fields (T, N, 3) of (u, v, Rθ) in D0; second is a y2."""

    sheet: Sheet
    amplitude: float
    wavevector: Floats
    tau: Floats
    run: Floats
    linear: Floats
    second: Floats

    @property
    def beyond(self) -> Floats:
        """The part of the run that is not linear, run − y1: its second order, and all higher ones."""
        return self.run - self.linear

    def around(self, field: Floats, *multiples: int) -> Floats:
        """The part of a field at wave vectors nearer to ±mk, with m of the multiples, than with another m of 0 to 3."""
        centres = [[m * self.wavevector, -m * self.wavevector] for m in range(4)]
        images = _images(self.sheet.wavevectors[None, None] - np.array(centres)[:, :, None, None])
        nearest = np.argmin(np.round(np.linalg.norm(images, axis=-1).min(axis=(1, -1)), 9), axis=0)
        return self.sheet.field(self.sheet.waves(field) * np.isin(nearest, multiples)[..., None])


def compare(record: Record) -> Comparison:
    """Predict the snapshots of a run from the first.

    Raises ValueError for a run that the theory does not hold (`refuse`), or whose snapshots do not tell all of the
    field; `GranularError` where there are none.
    """
    refuse(record)
    particles = record.snapshots()
    shape = record.scene.shape
    if len(particles.tau) < 2:
        raise ValueError(f"{len(particles.tau)} snapshots; the theory starts from the first and predicts the others")
    fields, rate = fields_of(particles), field_of(particles[0], "velocity", "spin")
    if np.isnan(fields[..., 2]).any():
        raise ValueError("the angles are not in the snapshots; run with effects.tracking = true")
    sheet = Sheet(shape.rows, shape.columns)
    if not np.allclose(rest_of(particles), sheet.rest, rtol=0, atol=1e-6):
        raise ValueError("the spheres at rest are not where this theory has them, row by row")
    first, tau = first_snapshot(record), particles.tau
    start = (fields[0] * first.length).ravel(), (rate * first.length / first.time).ravel()
    since, step = (tau - tau[0]) * first.time, particles.step * first.time
    orders = second_order(Cell.of(first.network), start[0], start[1], since, step)
    linear, second = (each.reshape(fields.shape) / first.length for each in orders)
    wavevector = carrier(sheet, fields[0], rate)
    return Comparison(sheet, record.scene.wave.amplitude, wavevector, tau, fields, linear, second)


def refuse(record: Record) -> None:
    """ValueError for a run whose lattice or contacts are not those of the theory, which names them."""
    left_out = missing("granular-analysis sheets", traits_of(record))
    if left_out:
        raise ValueError(f"{', '.join(left_out)}: the theory of sheets leaves that out")


def relative(estimate: Floats, reference: Floats, axis: tuple[int, ...] | None = None) -> Floats:
    """‖estimate − reference‖/‖reference‖ over the axes, nan where the reference is zero."""
    off, norm = (np.sqrt(np.sum(part**2, axis=axis)) for part in (estimate - reference, reference))
    return np.divide(off, norm, out=np.full_like(norm, np.nan), where=norm > 0)
