"""Periodic crystal of spheres in the plane or in space: its contacts from positions and radii, and its modes.

A cell of B spheres repeats by one, two or three vectors (a chain, a plane, space); walls are planes at rest. Spheres
have six freedoms (u, φ = Rθ); in the plane the same theory is constrained to (u_x, u_y, φ_z). Spheres touch if their
centres are closer than the sum of their radii. `granular_analysis.theory.bonds` has the laws of the contacts.

**Modes** have the form U e^{i(k·r − ωt)}, with the position r of each sphere, and satisfy D U = ω²M U. Torques have the
arm R − δ/2, which is absorbed in the moment of inertia: I/(1 − δ/2R). If the contacts of a sphere differ in δ or R, the
remaining matrix is not symmetric and each mode has a dual: a force F drives mode j by dual_j·M⁻¹F.

Any consistent units are allowed; wave vectors are in 1/length. `granular_analysis.theory.bloch.hexagonal` is the
crystal of the paper in the paper's units.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple, Self, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bonds import AT_REST, Bonds, Measured, ShearLaw
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.mirror import Mirror, images, mirrored
from granular_analysis.theory.network import Elastic, Material, ShearMixing, mixed
from granular_analysis.theory.network_laws import Adhesion

__all__ = ["Crystal"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Array = TypeVar("Array", bound=NDArray[Any])
PLANE, SPACE = (0, 1, 5), (0, 1, 2, 3, 4, 5)
_EVEN = 1e-13  # a difference of arms below this is rounding
_AT_REST = 1e-6  # largest net force on a sphere, in f′δ of the stiffest contact; rounding of positions leaves 1e-9
_ONE_SIGN = 1e-6  # components within this share of the largest count as equally large
_TOUCHES_TWICE = 1e-9
_ASKEW = np.array([0.37, 0.23, 0.41])  # a wave vector that no symmetry of a lattice maps to itself
_MIRRORED = 1e-9  # share of D by which a mirrored D may differ from D
_ONE = 1e-9  # relative difference below which squared frequencies count as equal
_STILL = 1e-9  # a motion below this share of the largest is rounding
# Components (along, across, u_z, φ) that may lead a mode that moves in the plane, moves only up, or only turns
_LEADING = np.array([[1, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]])
_SLOW = 1e-7  # frequencies below this share of the highest are those of a rigid motion, or unstable if squared < 0


class Wall(NamedTuple):
    """Plane at rest through a point, with the normal that points out of the crystal.

    For a rigid wall, choose a Young's modulus far above that of the spheres.
    """

    point: tuple[float, float, float]
    normal: tuple[float, float, float]
    material: Material | Elastic


class Modes(NamedTuple):
    """Modes at wave vectors (...): ω (..., J) ascending, U (..., J, B, 6), and duals (..., J, B, 6) of U.

    Σ|U|² = B, so amplitudes are the root mean square of (u, φ) over the spheres. The leading component fixes the phase.
    It is the largest in-plane translation, real and positive; for equally large components, the first sphere and the
    direction along k come first. Without in-plane motion the largest u_z leads, real and positive. In a mode that only
    turns the largest rotation leads, as −i times a positive number.
    """

    frequencies: Floats
    shapes: Complexes
    duals: Complexes


@dataclass(frozen=True, eq=False)
class Crystal:
    """Periodic crystal at rest.

    Attributes
    ----------
    bonds : contacts of a cell.
    mass : (B, 6) M: masses, and moments of inertia divided by R² and by the mean arm/R.
    position : (B, 3) positions of the spheres of a cell.
    vectors : (d, 3) lattice vectors.
    freedoms : indices of the freedoms that move: `PLANE`, `SPACE`, or fewer.
    """

    bonds: Bonds
    mass: Floats
    position: Floats
    vectors: Floats
    freedoms: tuple[int, ...] = SPACE

    def __len__(self) -> int:
        """Return the number of spheres per cell."""
        return len(self.mass)

    @property
    def reciprocal(self) -> Floats:
        """Return the reciprocal lattice (d, 3), 2π included."""
        return np.asarray(2 * np.pi * np.linalg.solve(self.vectors @ self.vectors.T, self.vectors))

    @cached_property
    def even(self) -> bool:
        """True if all contacts of each sphere have equal arms, so that D is symmetric."""
        return not self.turns or bool(np.all(np.abs(self.bonds.arms - 1.0) < _EVEN))

    @property
    def turns(self) -> bool:
        """True if spheres turn."""
        return max(self.freedoms) > 2

    @cached_property
    def highest(self) -> float:
        """Return an upper bound of all frequencies: the frequency of a sphere whose neighbours move against it."""
        law, bonds = self.bonds.law, self.bonds
        stiff = law.stiffness + np.abs(law.push) * bonds.curving + 2 * law.shear * (1 + self.turns)
        total = np.zeros(len(self))
        np.add.at(total, bonds.first, stiff)
        np.add.at(total, bonds.second[bonds.second >= 0], stiff[bonds.second >= 0])
        return float(np.sqrt(np.max(2 * total / self.mass[:, list(self.freedoms)].min(axis=1))))

    def mirror(self, normal: ArrayLike) -> Mirror | None:
        """Return the mirror of the crystal with this unit normal (3,), or None."""
        across = np.asarray(normal, dtype=float)
        reflection, units = np.eye(3) - 2 * np.outer(across, across), self.whole(np.eye(self.moving(self.mass).size))
        askew = _ASKEW[: len(self.vectors)] @ self.reciprocal.real
        matrix = self.stiffness(askew - (askew @ across) * across)
        for to in range(len(self)):
            places = images(self.position.real, self.vectors.real, self.mass.real, reflection, to)
            image = None if places is None else self.moving(mirrored(units, reflection, places)).T.real
            if image is not None and np.abs(image @ matrix - matrix @ image).max() < _MIRRORED * np.abs(matrix).max():
                return Mirror(across, np.asarray(image))
        return None

    @cached_property
    def symmetry(self) -> Mirror | None:
        """Return the mirror that separates degenerate modes; None in the plane or without such a mirror.

        It is z → −z if the crystal has it, otherwise x → −x, a symmetry of waves along y in most lattices.
        """
        normals = np.eye(3)[[2, 0]] if 2 in self.freedoms else np.zeros((0, 3))
        return next((mirror for normal in normals if (mirror := self.mirror(normal)) is not None), None)

    def parity(self, shapes: Complexes, wavevector: ArrayLike, mirror: Mirror | None = None) -> Floats:
        """Return the parity (...) of modes (..., B, 6) under a mirror: 1 for even, −1 for odd, 0 for mixed modes.

        The default mirror is `symmetry`. The result is 0 without a mirror, or if the mirror plane does not contain k.
        """
        mirror, moved = mirror or self.symmetry, self.moving(shapes)
        if mirror is None or not _across(padded(wavevector), mirror.normal):
            return np.zeros(moved.shape[:-1])
        share = np.sum(moved.conj() * (moved @ mirror.action.T), axis=-1).real / np.sum(np.abs(moved) ** 2, axis=-1)
        return np.asarray(np.where(np.abs(share) > 1 - _ONE_SIGN, np.sign(share), 0.0))

    @cached_property
    def _blocks(self) -> tuple[Floats, Floats, NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """Return D(0) (B, B, f, f) for f freedoms, and the blocks of the P contacts between two spheres.

        The blocks (2P, f, f) are multiplied by e^{ik·d} or its conjugate, and are sorted by their pair of spheres. The
        other results are the place (2P,) of each block among the contacts, the first block of each pair, and the row
        and column (2, ...) of each pair.
        """
        chosen, i, j = list(self.freedoms), self.bonds.first, self.bonds.second
        ends = -self.bonds.couplings[:, :, chosen][..., chosen]  # (C, 2, f, 2, f)
        blocks = np.stack([ends[:, 0, :, 0], ends[:, 1, :, 1], ends[:, 0, :, 1], ends[:, 1, :, 0]], axis=1)
        rows, columns = np.stack([i, j, i, j], axis=-1), np.stack([i, j, j, i], axis=-1)
        there = (rows >= 0) & (columns >= 0)
        still = np.zeros((len(self), len(self), *blocks.shape[2:]))
        np.add.at(still, (rows[there], columns[there]), blocks[there])
        rows, columns = rows[j >= 0, 2:].ravel(), columns[j >= 0, 2:].ravel()
        order = np.lexsort((columns, rows))
        _, begin = np.unique(rows[order] * len(self) + columns[order], return_index=True)
        blocks = blocks[j >= 0, 2:].reshape(-1, *still.shape[2:])[order]
        return still, blocks, order, begin, np.stack([rows[order][begin], columns[order][begin]])

    @cached_property
    def _between(self) -> Floats:
        """Return the vectors (3, P) between the centres of touching spheres, without contacts with walls."""
        return self.bonds.apart[self.bonds.second >= 0].T

    def stiffness(self, wavevector: ArrayLike) -> Complexes:
        """Return D(k) (..., F, F) for the F = B·freedoms that move; k (..., 2 or 3)."""
        still, blocks, order, begin, (rows, columns) = self._blocks
        # e^{ik·d} − 1, so that the common part of translations cancels before rounding
        turns = np.expm1(1j * (padded(wavevector) @ self._between))
        matrix = np.zeros((*turns.shape[:-1], *still.shape), dtype=complex)
        if len(blocks):
            both = np.stack([turns, turns.conj()], axis=-1).reshape(*turns.shape[:-1], len(order))
            phased = both[..., order, None, None] * blocks
            ends = [*begin[1:].tolist(), len(order)]
            for row, column, first, end in zip(rows.tolist(), columns.tolist(), begin.tolist(), ends, strict=True):
                # In sequence, so that a contact and its reverse cancel without rounding
                matrix[..., row, column, :, :] = sum(phased[..., each, :, :] for each in range(first, end))
        matrix += still
        size = len(self) * len(self.freedoms)
        return matrix.swapaxes(-3, -2).reshape(*turns.shape[:-1], size, size)

    def moving(self, vector: Array) -> Array:
        """Return the moving components (..., F) of a field (..., B, 6)."""
        chosen = vector[..., list(self.freedoms)]
        return cast(Array, chosen.reshape(*chosen.shape[:-2], -1))

    def whole(self, vector: NDArray[Any]) -> Complexes:
        """Return the field (..., B, 6) with these moving components (..., F), and 0 in all others."""
        result = np.zeros((*vector.shape[:-1], len(self), 6), dtype=complex)
        result[..., list(self.freedoms)] = vector.reshape(*vector.shape[:-1], len(self), -1)
        return result

    @cached_property
    def _root(self) -> Floats:
        """Return the square root of the mass of each moving freedom, (F,)."""
        return np.sqrt(self.moving(self.mass))

    def modes(self, wavevector: ArrayLike) -> Modes:
        """Return all modes at wave vectors (..., 3) or (..., 2).

        If k lies in the mirror plane of `symmetry`, all modes are even or odd; the even mode of a degenerate pair comes
        first.

        Raises
        ------
        ValueError
            For an unstable mode, as when a compressed contact buckles; for modes that grow or decay because the arms
            of torques are unequal.
        """
        k = padded(wavevector)
        squares, shapes, duals = self._solved(k)
        scale = np.sqrt(np.sum(np.abs(shapes) ** 2, axis=(-2, -1)) / len(self)) * _phase(shapes, k)
        shapes, duals = shapes / scale[..., None, None], duals * scale[..., None, None]
        return Modes(np.sqrt(np.maximum(squares, 0.0)), shapes, duals)

    def frequencies(self, wavevector: ArrayLike) -> Floats:
        """Return the frequencies of `modes`, (..., J), in half the computing time."""
        return np.sqrt(np.maximum(self._solved(padded(wavevector))[0], 0.0))

    def _solved(self, k: Floats) -> tuple[Floats, Complexes, Complexes]:
        """Return squared frequencies, modes and duals at wave vectors (..., 3), with arbitrary norm and phase."""
        root = self._root
        matrix = self.stiffness(k) / (root[:, None] * root)
        if self.even:
            if parted := self.symmetry is not None and _across(k, self.symmetry.normal):
                # Separates even and odd modes even if their frequencies are equal
                matrix = matrix - self.highest**2 * self.symmetry.action
            _, vectors = np.linalg.eigh(0.5 * (matrix + matrix.swapaxes(-1, -2).conj()))
            inverse = vectors.swapaxes(-1, -2).conj()
        else:
            values, vectors = np.linalg.eig(matrix)
            vectors = np.take_along_axis(vectors, np.argsort(values.real, axis=-1)[..., None, :], axis=-1)
            inverse = np.linalg.inv(vectors)
        shapes = self.whole(vectors.swapaxes(-1, -2) / root)
        duals = self.whole(inverse * root)
        if self.even:  # eigh rounds in units of the highest frequency; the energy resolves low frequencies
            squares = self.bonds.energy(self.bonds.strain(shapes, k[..., None, :]))
            if parted:
                order = np.argsort(squares - _ONE * np.abs(squares) * self.parity(shapes, k), axis=-1)
                squares = np.take_along_axis(squares, order, axis=-1)
                shapes, duals = (np.take_along_axis(each, order[..., None, None], axis=-3) for each in (shapes, duals))
        else:
            if np.any(np.abs(values.imag) > _SLOW * self.highest**2):
                raise TheoryError("modes grow or decay: torques with unequal arms are not conservative here")
            squares = np.sort(values.real, axis=-1)
        if (squares < -((_SLOW * self.highest) ** 2)).any():
            raise TheoryError(f"the crystal is unstable: a squared frequency is {squares.min():.3g}; compress it less")
        return squares, shapes, duals

    def accelerations(self, forces: Complexes) -> Complexes:
        """Return M⁻¹F (..., B, 6), with 0 for freedoms that do not move."""
        result = np.zeros(np.shape(forces), dtype=complex)
        chosen = list(self.freedoms)
        result[..., chosen] = forces[..., chosen] / self.mass[:, chosen]
        return result

    @classmethod
    def of(
        cls,
        vectors: ArrayLike,
        position: ArrayLike,
        radius: ArrayLike,
        density: ArrayLike,
        materials: Sequence[Material | Elastic],
        *,
        kind: ArrayLike = 0,
        walls: Sequence[Wall] = (),
        adhesion: Adhesion = "dmt",
        shear_law: ShearLaw = "secant",
        shear_mixing: ShearMixing = "mindlin",
        shear: bool = True,
        rotation: bool = True,
        true_geometry: bool = True,
        measured: Measured | None = None,
    ) -> Self:
        """Return the crystal of spheres at given positions, with all contacts between overlapping spheres.

        Parameters
        ----------
        vectors : (d, 2 or 3) lattice vectors
        position : (B, 2 or 3); two components make a crystal in the plane
        radius, density : (B,), or one value for all spheres
        materials : elastic constants of each kind of spheres
        kind : (B,) index into `materials`, or one value for all spheres
        walls : planes that spheres may touch
        adhesion : "dmt" (the Hertz law if the work of adhesion is 0) or "jkr"
        shear_law : "secant", "incremental" or "potential"; see `granular_analysis.theory.bonds`
        shear_mixing : rule for the shear modulus between two kinds; see `granular_analysis.theory.network`
        shear : whether contacts resist shear
        rotation : whether spheres turn; without shear they never turn
        true_geometry : True for the geometry of LAMMPS, with normals that turn and arms R − δ/2; False for the paper's
        measured : measured stiffnesses that replace those from moduli

        Raises
        ------
        ValueError
            For positions of another shape, a crystal without contacts, and a crystal that is not in equilibrium.
        """
        place, cell = padded(position), padded(vectors)
        if len(place) == 0 or place.shape[1:] != (3,):
            raise TheoryError(f"position must be of shape (B, 2) or (B, 3), not {np.shape(position)}")
        R, rho = (np.broadcast_to(np.asarray(each) + 0.0, len(place)) for each in (radius, density))
        kinds = np.broadcast_to(np.asarray(kind, dtype=np.intp), len(place))
        first, second, steps = find_contacts(cell.real, place.real, R.real)
        apart = place[second] + steps @ cell - place[first]
        length = np.sqrt(np.sum(apart**2, axis=1))
        overlap = R[first] + R[second] - length
        coefficients = mixed(materials, (kinds[first], kinds[second]), (R[first], R[second]), shear_mixing)
        parts: list[tuple[NDArray[Any], ...]] = [
            (first, second, apart, apart / length[:, None], 1 / length, overlap, *coefficients)
        ]
        parts += [_touching(wall, place, R, kinds, materials) for wall in walls]
        first, second, apart, normal, curving, overlap, A, B, F, _ = map(np.concatenate, zip(*parts, strict=True))
        if not len(first):
            raise TheoryError("no spheres touch each other or a wall: all distances exceed the sum of the two radii")
        law = AT_REST[adhesion](overlap, A, B, F)
        law = law if measured is None else measured.scale(law, second < 0, np.stack([kinds[first], kinds[second]]))
        if not shear:
            none = 0 * law.shear
            law = law._replace(shear=none, shear_growth=none, shear_curvature=none)
        plane = np.shape(position)[1] == 2
        moves = (PLANE if plane else SPACE) if shear and rotation else (PLANE if plane else SPACE)[: 2 if plane else 3]
        both = np.stack([R[first], R[second]], axis=1)
        bends = (curving.real > 0)[:, None] & true_geometry
        bonds = Bonds(
            *(first, second, apart, normal, curving * true_geometry),
            arms=np.where(bends, 1 - overlap[:, None] / (2 * both), 1.0),
            widening=np.where(bends, 1 / (2 * both), 0.0),
            law=law,
            shear_law=shear_law,
        )
        mass = 4 / 3 * np.pi * R**3 * rho
        result = cls(bonds, mass[:, None] * np.array([1, 1, 1, 0.4, 0.4, 0.4]), place, cell, moves)
        result._refuse_moving(overlap)
        return result._with_mean_arms()

    def _with_mean_arms(self) -> Self:
        """Return the crystal in which moments of inertia absorb the mean arm of each sphere, weighted by k."""
        bonds, shear = self.bonds, self.bonds.law.shear
        weight, total = np.zeros((2, len(self)), dtype=np.result_type(shear, bonds.arms))
        pairs = bonds.second >= 0
        for spheres, arms, k in (
            (bonds.first, bonds.arms[:, 0], shear),
            (bonds.second[pairs], bonds.arms[pairs, 1], shear[pairs]),
        ):
            np.add.at(weight, spheres, k)
            np.add.at(total, spheres, k * arms)
        mean = np.where(weight > 0, total / np.where(weight > 0, weight, 1.0), 1.0)
        ends = np.stack([mean[bonds.first], np.where(pairs, mean[bonds.second], 1.0)], axis=1)
        turned = replace(bonds, arms=bonds.arms / ends, widening=bonds.widening / ends)
        mass = self.mass * np.where(np.arange(6) < 3, 1.0, 1 / mean[:, None])
        return type(self)(turned, mass, self.position, self.vectors, self.freedoms)

    def _refuse_moving(self, overlap: Floats) -> None:
        """Raise ValueError if the contacts leave a net force on a sphere."""
        push = (self.bonds.law.push[:, None] * self.bonds.normal)[:, None] * np.array([[-1.0], [1.0]])
        ends = np.concatenate([push, np.zeros_like(push)], axis=-1)
        left = np.abs(self.bonds.gather(ends, np.zeros(3), len(self))[:, list(self.freedoms)]).max()
        allowed = _AT_REST * float(np.max(np.abs(self.bonds.law.stiffness * overlap)))
        if left > allowed:
            raise TheoryError(
                f"the crystal is not at rest: the net force on a sphere is {left:.3g}; allowed: up to {allowed:.3g}"
            )


def _across(wavevector: Floats, normal: Floats) -> bool:
    """Return whether all wave vectors (..., 3) lie in the mirror plane with this normal."""
    return bool(np.all(np.abs(wavevector @ normal) <= 1e-12 * np.linalg.norm(wavevector, axis=-1)))


def find_contacts(
    vectors: Floats, position: Floats, radius: Floats
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    """Return each contact once: its first and second sphere (C,), and the lattice vectors that shift the second.

    The shifts (C, d) count the vectors (d, 3).
    """
    reach = 2 * float(radius.max()) + float(np.ptp(position, axis=0).max()) * np.sqrt(3)
    # The distance of lattice planes is 1/|b|, with the reciprocal vector b without 2π
    most = np.floor(reach * np.linalg.norm(np.linalg.pinv(vectors), axis=0) + _TOUCHES_TWICE).astype(int)
    found: list[tuple[int, int, tuple[int, ...]]] = []
    near, others = radius[:, None] + radius, np.triu(np.ones((len(radius), len(radius)), dtype=bool), 1)
    themselves = others | np.eye(len(radius), dtype=bool)
    every = list(product(*(range(-each, each + 1) for each in most)))
    shifts = np.array(every, dtype=float) @ vectors
    for number in np.flatnonzero(np.linalg.norm(shifts, axis=1) <= reach * (1 + _TOUCHES_TWICE)).tolist():
        apart = position[None] + shifts[number] - position[:, None]
        onward = number > len(every) // 2  # the first half of the shifts is the reverse of the second
        touch = (np.sqrt((apart**2).sum(axis=2)) < near) & (themselves if onward else others)
        found += [(i, j, every[number]) for i, j in np.argwhere(touch).tolist()]
    if not found:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), np.zeros((0, len(vectors)))
    first, second, counts = zip(*found, strict=True)
    return np.array(first, dtype=np.intp), np.array(second, dtype=np.intp), np.array(counts, dtype=float)


def padded(vector: ArrayLike) -> Floats:
    """Return vectors (..., 1 to 3) as (..., 3), padded with zeros."""
    result = np.asarray(vector) + 0.0
    return np.concatenate([result, np.zeros((*result.shape[:-1], 3 - result.shape[-1]))], axis=-1)


def _touching(
    wall: Wall, place: Floats, radius: Floats, kinds: NDArray[np.intp], materials: Sequence[Material | Elastic]
) -> tuple[NDArray[Any], ...]:
    """Return the contacts with a wall, as the columns that `Crystal.of` concatenates."""
    normal = np.asarray(wall.normal, dtype=float) / np.linalg.norm(wall.normal)
    overlap = radius - (np.asarray(wall.point, dtype=float) - place) @ normal
    first = np.flatnonzero(overlap.real > 0)
    size, other = radius[first], np.full(len(first), len(materials))
    plane = np.full(len(first), np.inf)
    coefficients = mixed([*materials, wall.material], (kinds[first], other), (size, plane))
    none = np.zeros((len(first), 3))
    return first, np.full(len(first), -1), none, none + normal, 0 * size, overlap[first], *coefficients


def _phase(shapes: Complexes, wavevector: Floats) -> Complexes:
    """Return the phase factor (...) by which modes (..., J, B, 6) are divided to follow the rule of `Modes`."""
    size = np.sqrt((wavevector**2).sum(axis=-1, keepdims=True))
    along = np.divide(wavevector, size, out=np.zeros_like(wavevector) + [0.0, 1.0, 0.0], where=size > 0)
    frame = np.zeros((*along.shape[:-1], 3, 2))  # along k and across it, in the plane
    frame[..., 0], frame[..., 0, 1], frame[..., 1, 1] = along, -along[..., 1], along[..., 0]
    parts = 1j * shapes
    parts[..., :2], parts[..., 2] = shapes[..., :3] @ frame[..., None, :, :], shapes[..., 2]
    size = np.abs(parts)
    highest = size.max(axis=-2)
    inside, least = highest[..., :2].max(axis=-1), _STILL * highest.max(axis=-1)
    size *= _LEADING[np.where(inside >= least, 0, np.where(highest[..., 2] >= least, 1, 2))][..., None, :]
    size, parts = (each.reshape(*each.shape[:-2], -1) for each in (size, parts))
    first = np.argmax(size > (1 - _ONE_SIGN) * size.max(axis=-1, keepdims=True), axis=-1)
    leading = np.take_along_axis(parts, first[..., None], axis=-1)[..., 0]
    return np.asarray(leading / np.abs(leading))
