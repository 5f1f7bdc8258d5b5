"""Initial fields of a wave on a packing, for unit amplitude: lengths in D0, times in t0.

A plane wave is one Bloch mode. A wave with a Gaussian envelope is a sum of Bloch modes of one branch around it,

    Σ_k' w(k') Re[U(k') e^{i(k'·r − Ω(k')τ + phase)}],    w ∝ exp(−½ length² κ∥² − ½ width² κ⊥²),    κ = k' − k,

each with its own shape and frequency, so that the whole packet runs forward and excites no other branch. If an envelope
only multiplied the mode, a share of relative order 1/(k length) would radiate in all directions.

The sum fails for a packet shorter than 4/ξ, part of which would run backward (refused). It also fails where the branch
touches another one within the envelope, as wave vectors then have no unique branch.
"""

from itertools import product
from math import pi

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import Shape, lattice_constant, offsets, places
from granular_lmp.crystal.mode import TURNS, Mode
from granular_lmp.crystal.modes import bloch_modes
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.frozen import dataclass
from granular_lmp.rest.linear import BlochWave, physics_of, wave_contacts
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.sections import Envelope

Floats = NDArray[np.float64]
FARTHEST = 7.0  # standard deviations of w in the sum: beyond them w is below 2e-11
SAME_WAVENUMBER = 1e-9  # rad per row: rounding of a difference of wave vectors


@dataclass(frozen=True)
class Fields:
    """Displacement and velocity of N spheres for unit amplitude.

    Attributes
    ----------
    displacement, velocity : (N, 6) arrays
        Columns (ux, uy, uz, φx, φy, φz) with φ = Rθ, in D0 and D0/t0.
    """

    displacement: Floats
    velocity: Floats


def initial_fields(scene: Scene, packing: ase.Atoms, wave: BlochWave) -> Fields:
    """Return the wave of a scene at τ = 0, zero on held rows.

    A driven wave has only the displacement of its first row at cos(Ωτ − phase) = 1, along y for L and along x for TR
    and RT, without rotation. Without a wave all is at rest.

    Parameters
    ----------
    scene : Scene
    packing : ase.Atoms
        Packing from `granular_lmp.crystal.lattices`.
    wave : BlochWave
        Wave of the scene in its lattice.

    Returns
    -------
    Fields
        Fields for unit amplitude; the deck multiplies them by D0.
    """
    form, mode, phase = wave.declared.known, wave.mode, wave.declared.phase
    if form.driven:
        return _driven_row(packing, mode, scene.envelope)
    if not form.fills:
        return Fields(np.zeros((len(packing), 6)), np.zeros((len(packing), 6)))
    fields = _enveloped(scene, packing, wave) if scene.envelope.finite else plane_wave(packing, mode, phase)
    return Fields(form.displacement * fields.displacement, form.velocity * fields.velocity)


def plane_wave(packing: ase.Atoms, mode: Mode, phase: float = 0.0) -> Fields:
    """Return the wave Re[U e^{i(k·r − Ωτ + phase)}] at τ = 0 with r = 0 at the centre sphere, zero on the held rows.

    Parameters
    ----------
    packing : ase.Atoms
        Packing from `granular_lmp.crystal.lattices`.
    mode : Mode
        Gives U = (u, i f), k and Ω.
    phase : float
        rad.

    Notes
    -----
    Held rows cut the wave off; the disturbance reaches the centre at `Scene.echo_time`.
    """
    along_x, along_y = offsets(packing)
    angle = mode.vector.per_row * along_y + mode.vector.per_column * along_x + phase
    wave = np.exp(1j * angle)[:, None] * mode.shape()[places(packing, len(mode.shape()))]
    return _fields(packing, wave, -1j * mode.frequency * wave)


def _fields(packing: ase.Atoms, wave: NDArray[np.complex128], rate: NDArray[np.complex128]) -> Fields:
    held = packing.arrays["fixed"]
    wave[held] = rate[held] = 0
    return Fields(displacement=wave.real, velocity=rate.real)


def _enveloped(scene: Scene, packing: ase.Atoms, wave: BlochWave) -> Fields:
    """Return the sum in the equation of this module over the wave vectors of the packing as a periodic cell."""
    envelope, mode = scene.envelope, wave.mode
    x, y = mode.vector.unit
    per_column, per_row = _around(mode.vector, envelope, scene.shape)  # κ
    kx, ky = mode.vector.row_spacing * per_column[:, None], per_row[None, :]  # rad per row
    along, across = x * kx + y * ky, x * ky - y * kx
    exponent = (envelope.length * along) ** 2 + (envelope.width * across) ** 2
    inside = exponent <= FARTHEST**2
    # A direction without an envelope has only the wave vector of the wave
    inside &= (envelope.length > 0) | (np.abs(along) < SAME_WAVENUMBER)
    inside &= (envelope.width > 0) | (np.abs(across) < SAME_WAVENUMBER)
    weight = np.exp(-exponent[inside] / 2)
    weight = weight / weight.sum() * np.exp(1j * (along[inside] * envelope.offset + wave.declared.phase))

    i, j = np.nonzero(inside)
    own = np.array([mode.vector.per_column, mode.vector.per_row])
    frequency, polarisation = _branch(scene, mode, own + np.column_stack([per_column[i], per_row[j]]))
    field = np.zeros((*inside.shape, *mode.shape().shape), dtype=complex)
    rate = np.zeros_like(field)
    field[inside] = weight[:, None, None] * polarisation
    rate[inside] = -1j * frequency[:, None, None] * field[inside]
    sums = (_sum_of_waves(packing, own[0] + per_column, own[1] + per_row, part) for part in (field, rate))
    return _fields(packing, *sums)


def _around(vector: WaveVector, envelope: Envelope, shape: Shape) -> tuple[Floats, Floats]:
    """Return the differences in phase advance, per column and per row, of wave vectors that may contribute."""
    x, y = (abs(part) for part in vector.unit)
    narrow = [1 / size if size else 0.0 for size in (envelope.length, envelope.width)]  # rad per row
    reach = [np.hypot(narrow[0] * x, narrow[1] * y) / vector.row_spacing, np.hypot(narrow[0] * y, narrow[1] * x)]
    most = [
        min(int(FARTHEST * far * count / (2 * pi)), (count - 1) // 2)
        for far, count in zip(reach, (shape.columns, shape.rows), strict=True)
    ]
    return (
        2 * pi * np.arange(-most[0], most[0] + 1) / shape.columns,
        2 * pi * np.arange(-most[1], most[1] + 1) / shape.rows,
    )


def _branch(scene: Scene, mode: Mode, vectors: Floats) -> tuple[Floats, NDArray[np.complex128]]:
    """Return frequencies (M,) and shapes (u, i f), (M, P, 6), on the branch of a mode at phase advances (M, 2).

    The overlap of shapes identifies the branch, because names change where branches come close.
    """
    sphere = scene.sphere
    across = scene.lattice.column_distance(lattice_constant(sphere))
    k = vectors / [1, mode.vector.row_spacing] / across
    frequencies, shapes = bloch_modes(wave_contacts(scene), sphere, k, physics_of(scene))
    own = mode.shape() / TURNS
    likeness = shapes.conj() @ (own * np.repeat([1, INERTIA_RATIO], 3)).ravel()
    best = np.argmax(np.abs(likeness), axis=-1)[:, None]
    alike = np.take_along_axis(likeness, best, axis=-1)
    turned = np.take_along_axis(shapes, best[..., None], axis=-2)[:, 0] * alike / np.abs(alike)
    polarisation = turned.reshape(-1, *own.shape) * TURNS
    return np.take_along_axis(frequencies, best, axis=-1)[:, 0], polarisation


def _sum_of_waves(
    packing: ase.Atoms, per_column: Floats, per_row: Floats, amplitude: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return Σ amplitude(i, j) e^{ik_ij·r} at the spheres, (N, 6), over a grid of wave vectors: first y, then x.

    Spheres at one place of their cell, in rows of one parity, lie on a grid of x and y.
    """
    (along_x, along_y), place, row = offsets(packing), places(packing, amplitude.shape[2]), packing.arrays["row"]
    result = np.empty((len(packing), 6), dtype=complex)
    for parity, own in product((0, 1), range(amplitude.shape[2])):
        these = (row % 2 == parity) & (place == own)
        (x, at_x), (y, at_y) = (np.unique(each[these], return_inverse=True) for each in (along_x, along_y))
        by_row = np.tensordot(np.exp(1j * np.outer(y, per_row)), amplitude[:, :, own], axes=(1, 1))  # (y, i, 6)
        result[these] = (np.exp(1j * np.outer(x, per_column)) @ by_row)[at_y, at_x]
    return result


def _driven_row(packing: ase.Atoms, mode: Mode, envelope: Envelope) -> Fields:
    """Return the displacement of the driven first row for unit amplitude, a Gaussian if the envelope has a width."""
    along_x, _ = offsets(packing)
    first = packing.arrays["row"] == 0
    profile = np.ones(len(packing))
    if envelope.width:
        columns = packing.info["columns"]
        middle = along_x - columns * np.round(along_x / columns) if packing.pbc[0] else along_x
        profile = np.exp(-0.5 * (middle / (envelope.width * mode.vector.row_spacing)) ** 2)
    displacement = np.zeros((len(packing), 6))
    displacement[first, int(mode.along_y)] = (1 if mode.along_y else -1) * profile[first]
    return Fields(displacement, np.zeros_like(displacement))
