"""Initial fields of a wave on a packing, for unit amplitude: lengths in D0, times in t0.

A plane wave is one Bloch mode. A wave with a Gaussian envelope is a sum of Bloch modes of one branch around it,

    Σ_k' w(k') Re[U(k') e^{i(k'·r − Ω(k')τ + phase)}],    w ∝ exp(−½ length² κ∥² − ½ width² κ⊥²),    κ = k' − k,

each with its own shape and frequency, so that all of it runs forward and no other branch is excited: an envelope that
is just multiplied to the mode would send the rest, of relative order 1/(k length), everywhere.
"""

from dataclasses import dataclass
from math import pi

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.modes import Mode, Physics, bloch_modes
from granular_lmp.packing import lattice_constant, offsets, unit_lattice
from granular_lmp.scene import Scene
from granular_lmp.tables import Envelope
from granular_lmp.wavevector import ROW_SPACING, WaveVector

Floats = NDArray[np.float64]
FARTHEST = 7.0  # standard deviations of w that are summed: what is beyond is 2e-11


@dataclass(frozen=True)
class Fields:
    """Displacement and velocity, one row a sphere: columns (ux, uy, φ), φ = Rθ; in D0 and D0/t0."""

    displacement: Floats
    velocity: Floats


def initial_fields(scene: Scene, packing: ase.Atoms, mode: Mode) -> Fields:
    """The wave of a scene at τ = 0; zero on the rows that are held.

    Of a standing wave the displacement of the running one, and no velocity. Of a driven one nothing but the first row:
    its displacement at cos(Ωτ − phase) = 1, along y for L and along x for TR and RT, and no rotation.

    Parameters
    ----------
    scene : Scene
    packing : ase.Atoms
        From `granular_lmp.packing`.
    mode : Mode
        The mode of the scene's wave.
    """
    if scene.wave.form == "driven":
        return _driven_row(packing, mode, scene.envelope)
    fields = _enveloped(scene, packing, mode) if scene.envelope.finite else plane_wave(packing, mode, scene.wave.phase)
    if scene.wave.form == "standing":
        return Fields(fields.displacement, np.zeros_like(fields.velocity))
    return fields


def plane_wave(packing: ase.Atoms, mode: Mode, phase: float = 0.0) -> Fields:
    """The wave Re[U e^{i(k·r − Ωτ + phase)}] at τ = 0, r = 0 at the centre sphere; zero on the rows that are held.

    Parameters
    ----------
    packing : ase.Atoms
        From `granular_lmp.packing`.
    mode : Mode
        Gives U = (ux, uy, i f), k and Ω.
    phase : float
        rad.

    Notes
    -----
    Held rows cut the wave off: what that does reaches the centre at `Scene.echo_time`.
    """
    along_x, along_y = offsets(packing)
    angle = mode.vector.per_row * along_y + mode.vector.per_column * along_x + phase
    wave = np.exp(1j * angle)[:, None] * mode.shape()
    return _fields(packing, wave, -1j * mode.frequency * wave)


def _fields(packing: ase.Atoms, wave: NDArray[np.complex128], rate: NDArray[np.complex128]) -> Fields:
    held = packing.arrays["fixed"]
    wave[held] = rate[held] = 0
    return Fields(displacement=wave.real, velocity=rate.real)


def _enveloped(scene: Scene, packing: ase.Atoms, mode: Mode) -> Fields:
    """The sum of the module's equation over the wave vectors that the packing, taken as a periodic cell, holds."""
    shape, envelope = scene.shape, scene.envelope
    in_columns, in_rows = _around(mode.vector, envelope, shape.columns, shape.rows)
    aside = 2 * pi * in_columns / shape.columns, 2 * pi * in_rows / shape.rows  # κ, as phase advances
    x, y = mode.vector.unit
    along = ROW_SPACING * aside[0] * x + aside[1] * y  # κ∥ in rad per row
    across = aside[1] * x - ROW_SPACING * aside[0] * y
    inside = (envelope.length > 0) | (np.abs(along) < 1e-9)
    inside &= (envelope.width > 0) | (np.abs(across) < 1e-9)
    weight = np.exp(-0.5 * ((envelope.length * along) ** 2 + (envelope.width * across) ** 2)) * inside
    weight = weight / weight.sum() * np.exp(1j * (along * envelope.offset + scene.wave.phase))

    frequency, polarisation = _branch(scene, mode, aside, weight != 0)
    wave = weight[..., None] * polarisation
    sums = [_sum_of_waves(packing, mode.vector, aside, part) for part in (wave, -1j * frequency[..., None] * wave)]
    return _fields(packing, *sums)


def _around(vector: WaveVector, envelope: Envelope, columns: int, rows: int) -> tuple[NDArray, NDArray]:
    """Numbers (i, j) of the wave vectors 2π(i/columns, j/rows) that count, from that of the wave, as a grid."""
    x, y = (abs(part) for part in vector.unit)
    narrow = [1 / size if size else 0.0 for size in (envelope.length, envelope.width)]  # rad per row
    reach = [FARTHEST * np.hypot(narrow[0] * y, narrow[1] * x), FARTHEST * np.hypot(narrow[0] * x, narrow[1] * y)]
    most_rows = min(int(reach[0] * rows / (2 * pi)), (rows - 1) // 2)
    most_columns = min(int(reach[1] / ROW_SPACING * columns / (2 * pi)), (columns - 1) // 2)
    i, j = np.meshgrid(np.arange(-most_columns, most_columns + 1), np.arange(-most_rows, most_rows + 1), indexing="ij")
    return i, j


def _branch(
    scene: Scene, mode: Mode, aside: tuple[Floats, Floats], wanted: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.complex128]]:
    """Frequencies and shapes (ux, uy, i f) of the branch of a mode at wave vectors around its own.

    At each wave vector the mode that is most like it is taken: names would change hands where branches come near.
    """
    sphere, physics = scene.sphere, Physics.of(scene)
    packing, constant = unit_lattice(sphere), lattice_constant(sphere)
    centre = np.array([mode.ux, mode.uy, mode.f])
    frequency, polarisation = np.zeros(wanted.shape), np.zeros((*wanted.shape, 3), dtype=complex)
    for place in zip(*np.nonzero(wanted), strict=True):
        vector = WaveVector(mode.vector.per_column + aside[0][place], mode.vector.per_row + aside[1][place])
        frequencies, shapes = bloch_modes(packing, sphere, np.array(vector.components) / constant, physics)
        likeness = shapes @ centre
        best = int(np.argmax(np.abs(likeness)))
        frequency[place] = frequencies[best]
        polarisation[place] = shapes[best] * np.sign(likeness[best]) * [1, 1, 1j]
    return frequency, polarisation


def _sum_of_waves(
    packing: ase.Atoms, vector: WaveVector, aside: tuple[Floats, Floats], amplitude: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Σ amplitude(i, j) e^{i(k + κ_ij)·r} at the spheres, (N, 3): first along the columns, then along the rows."""
    along_x, along_y = offsets(packing)
    rows, columns = packing.arrays["row"], packing.arrays["column"]
    x = along_x.reshape(rows.max() + 1, columns.max() + 1)
    y = along_y.reshape(x.shape)[:, 0]
    by_row = np.einsum("nj,ijc->nic", np.exp(1j * np.outer(y, vector.per_row + aside[1][0])), amplitude)
    result = np.empty((*x.shape, 3), dtype=complex)
    for parity in (0, 1):  # of the row, which is what its shift depends on
        advance = np.exp(1j * np.outer(x[parity], vector.per_column + aside[0][:, 0]))
        result[parity::2] = np.einsum("mi,nic->nmc", advance, by_row[parity::2])
    return result.reshape(-1, 3)


def _driven_row(packing: ase.Atoms, mode: Mode, envelope: Envelope) -> Fields:
    """What the first row moves by, for unit amplitude; a Gaussian along it where the envelope has a width."""
    along_x, _ = offsets(packing)
    first = packing.arrays["row"] == 0
    profile = np.ones(len(packing))
    if envelope.width:
        columns = packing.arrays["column"].max() + 1
        middle = along_x - columns * np.round(along_x / columns)
        profile = np.exp(-0.5 * (middle / (envelope.width * ROW_SPACING)) ** 2)
    displacement = np.zeros((len(packing), 3))
    displacement[first, 1 if mode.name == "L" else 0] = (1 if mode.name == "L" else -1) * profile[first]
    return Fields(displacement, np.zeros_like(displacement))
