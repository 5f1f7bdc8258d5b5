"""Fields of all spheres of a periodic hexagonal sheet, from snapshots: places, waves, components along a wave."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bloch import unit

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
FieldOrWave = TypeVar("FieldOrWave", Floats, Complexes)

ROW = np.sqrt(0.75)  # spacing of rows in lattice constants


@dataclass(frozen=True)
class Sheet:
    """Places of a periodic hexagonal sheet, row by row as in LAMMPS's deck; lengths in lattice constants.

    Raises ValueError for an odd number of rows, and for a sheet without rows or columns.
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
        """Return the places (N, 2) at rest; no sphere is on the border of the cell."""
        row, column, odd = self._index
        x, y = column - self.columns // 2 + 0.25 + 0.5 * odd, (row - (self.rows - 1) // 2) * ROW
        return np.stack([x, y], axis=-1).reshape(-1, 2)

    @cached_property
    def wavevectors(self) -> Floats:
        """Return the wave vectors that fit the sheet, (R, columns//2 + 1, 2): one of k and −k, which are conjugates."""
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
    """Return the amplitude X = (2/N) Σ field e^{−ik·r} of a wave vector in a real field Re[X e^{ik·r}], (..., 3).

    Parameters
    ----------
    field : (..., N, 3).
    rest : (N, 2) places, lattice constants.
    wavevector : (2,) k, rad per lattice constant.

    When it breaks: other waves leak into X unless k fits the sheet. If k and −k are the same wave vector (k = 0, and
    the middles of the zone's sides), X is twice the amplitude.
    """
    phases = np.exp(-1j * rest @ np.asarray(wavevector, dtype=float))
    return 2 / len(rest) * np.einsum("...nc,n->...c", field, phases)


def in_frame(field: FieldOrWave, wavevector: ArrayLike) -> FieldOrWave:
    """Return p along k (…, 2), q along ẑ × k, and φ, (…, 3), of a field of u, v, φ; k = 0 counts as along y."""
    x, y = np.moveaxis(unit(wavevector), -1, 0)
    u, v, phi = np.moveaxis(field, -1, 0)
    return np.stack([x * u + y * v, x * v - y * u, phi], axis=-1)


def rest_of(particles: Any) -> Floats:
    """Return the places (N, 2) at rest of the spheres of a run, in lattice constants."""
    sphere = particles.scene.sphere
    return particles.rest * sphere.radius / sphere.lattice_constant


def fields_of(particles: Any, moved: str = "displacement", turned: str = "rotation") -> Floats:
    """Return the fields (T, N, 3) of u, v, φ in the snapshots of a run, in D0.

    moved, turned : attributes of a snapshot; "velocity" and "spin" give the rates.
    """
    return np.array([field_of(each, moved, turned) for each in particles])


def field_of(spheres: Any, moved: str = "displacement", turned: str = "rotation") -> Floats:
    """Return the field (N, 3) of one snapshot, see `fields_of`."""
    return np.column_stack([getattr(spheres, moved), getattr(spheres, turned)])
