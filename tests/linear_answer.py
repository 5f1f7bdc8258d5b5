"""The linear answer of a finite crystal to sources: spheres that are pushed, turned or moved from outside.

N equal spheres at places r of a lattice whose spheres touch, in a periodic cell, between held spheres, or free. With
the linear forces of `granular_analysis.theory.bonds` their displacements U = (u, v, φ) of all spheres, φ = Rθ, obey

    M U″ + K U = Σ_s b_s g_s(τ),    K = Σ_contacts (e_N e_Nᵀ + κ e_S e_Sᵀ − χ e_T e_Tᵀ)/(2(κ+3)),    M = (1, 1, Ĩ/(1−η))

in D0 and t0. A force g k1 D0 on a sphere is b = 1/(2(κ+3)) on its u or v, a torque g k1 D0 R is b = 1/(2(κ+3)(1−η)) on
its φ. Spheres that are moved by g D0, and those that are held, leave the unknowns; the moved ones act on the rest by
b = −K_{free, moved}. With the modes K_ff Φ = M Φ ω², Φᵀ M Φ = 1, the answer from rest is exact:

    U(τ) = Φ Σ_s (Φᵀ b_s) ∫₀^τ [sin ω(τ−σ)/ω] g_s(σ) dσ

The integrals are sums over Gauss points, which err by rounding for signals that are smooth between the times asked for.

When it breaks: at amplitudes at which the second order counts; with dashpots; for more than a thousand spheres, whose
matrix is dense. Not in the paper.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.contact import Contact
from granular_analysis.theory.errors import TheoryError

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Function = Callable[[Floats], Floats]
COMPONENTS = {"x": 0, "y": 1, "torque": 2, "rotation": 2}
_SAME = 1e-3  # lattice constants: spheres farther apart than 1 + that do not touch
_LOWEST = 1e-6  # rad/t0: a crystal that nothing holds shifts as a whole, ω = 0; its answer is off by (ωτ)²/6
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_PANEL = 0.25  # τ, a tenth of the shortest period


@dataclass(frozen=True)
class Load:
    """One source: a force or torque on spheres along an axis, or a motion of them, with its signal g(τ).

    Attributes
    ----------
    spheres : (n,) indices.
    axis : "x", "y" or "torque"; of a motion "x", "y" or "rotation", φ = Rθ.
    signal : g of times (T,), in k1 D0, k1 D0 R or D0.
    moves : True for a motion. Its spheres then do nothing else.
    """

    spheres: Sequence[int]
    axis: str
    signal: Function
    moves: bool = False

    def __post_init__(self) -> None:
        allowed = ("x", "y", "rotation" if self.moves else "torque")
        if self.axis not in allowed:
            raise TheoryError(f"axis = {self.axis!r}: must be one of {', '.join(allowed)}")


@dataclass(frozen=True, eq=False)
class Crystal:
    """Spheres at rest and the springs between them.

    Attributes
    ----------
    position : (N, 2) places, in lattice constants.
    cell : periods in x and y, inf where the crystal ends.
    contact : contact of the spheres, without dashpots.
    held : (N,) spheres that do not move.
    """

    position: Floats
    cell: tuple[float, float]
    contact: Contact
    held: NDArray[np.bool_]

    def __post_init__(self) -> None:
        if not self.contact.rotation:
            raise TheoryError("contact.rotation = False: must be True, as sources turn spheres")
        if self.contact.viscosity or self.contact.restitution is not None:
            raise TheoryError("contact: must be without dashpots")

    @cached_property
    def mass(self) -> Floats:
        """M of all displacements, (3N,)."""
        return np.tile(self.contact.masses, len(self.position))

    @cached_property
    def stiffness(self) -> Floats:
        """K, (3N, 3N)."""
        from scipy.spatial import cKDTree  # slow to import, and only here needed

        box = np.where(np.isfinite(self.cell), self.cell, 0.0)  # 0 is a direction without a period
        pairs = cKDTree(np.mod(self.position, np.where(box > 0, box, np.inf)), boxsize=box).query_pairs(
            1 + _SAME, output_type="ndarray"
        )
        first, second = pairs.T
        apart = self.position[second] - self.position[first]
        apart -= np.where(box > 0, box * np.round(apart / np.where(box > 0, box, 1.0)), 0.0)
        normal = apart / np.linalg.norm(apart, axis=1, keepdims=True)
        tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
        matrix = np.zeros((3 * len(self.position),) * 2)
        none, one = np.zeros((len(pairs), 1)), np.ones((len(pairs), 1))
        rows = (
            (1.0, np.hstack([-normal, none, normal, none])),
            (self.contact.shear_stiffness, np.hstack([-tangent, -one, tangent, -one])),
            (-self.contact.softening, np.hstack([-tangent, none, tangent, none])),
        )
        freedoms = np.hstack([3 * end[:, None] + np.arange(3) for end in (first, second)])
        for weight, row in rows:
            each = weight / (2 * (self.contact.kappa + 3)) * row[:, :, None] * row[:, None, :]
            np.add.at(matrix, (freedoms[:, :, None], freedoms[:, None, :]), each)
        return matrix

    def energy(self, displacement: Floats, velocity: Floats) -> Floats:
        """Return ½ U̇ᵀMU̇ + ½ UᵀKU of fields (T, N, 3), in m (D0/t0)²: (T,)."""
        u, v = (field.reshape(len(field), -1) for field in (displacement, velocity))
        return 0.5 * np.asarray(v**2 @ self.mass + np.sum(u @ self.stiffness * u, axis=1))

    def strength(self, axis: str) -> float:
        """Return b of a unit force or torque on one sphere, along an axis."""
        unit = 1 / (2 * (self.contact.kappa + 3))
        return unit / (1 - self.contact.overlap_ratio) if axis == "torque" else unit


def response(crystal: Crystal, loads: Sequence[Load], times: ArrayLike) -> tuple[Floats, Floats]:
    """Return displacements and velocities (T, N, 3), (u, v, φ) in D0 and D0/t0, of a crystal that starts from rest.

    Parameters
    ----------
    crystal : Crystal
    loads : sequence of Load
    times : (T,) ascending from 0, τ. Signals must be smooth between neighbouring times.

    Raises
    ------
    ValueError
        For times that do not ascend from 0, and for a sphere that is moved twice.
    """
    tau = np.asarray(times, dtype=float)
    if tau.ndim != 1 or not len(tau) or tau[0] < 0 or np.any(np.diff(tau) <= 0):
        raise TheoryError("times must be one-dimensional, ascending and not negative")
    count = len(crystal.position)
    still = np.repeat(crystal.held, 3)
    moved: list[Integers] = [np.asarray(load.spheres, dtype=np.intp) for load in loads if load.moves]
    every = np.concatenate([*moved, np.empty(0, dtype=np.intp)])
    if len(np.unique(every)) < len(every):
        raise TheoryError("loads: a sphere is moved twice")
    still[(3 * every[:, None] + np.arange(3)).ravel()] = True
    free = np.flatnonzero(~still)
    root = np.sqrt(crystal.mass[free])
    square, modes = np.linalg.eigh(crystal.stiffness[np.ix_(free, free)] / (root[:, None] * root))
    frequency, shapes = np.maximum(np.sqrt(np.maximum(square, 0.0)), _LOWEST), modes / root[:, None]
    displacement, velocity = np.zeros((2, len(tau), 3 * count))
    for load in loads:
        freedoms = 3 * np.asarray(load.spheres, dtype=np.intp) + COMPONENTS[load.axis]
        if load.moves:
            push = -crystal.stiffness[np.ix_(free, freedoms)].sum(axis=1)
        else:
            push = crystal.strength(load.axis) * np.isin(free, freedoms)
        sine, cosine = _swings(frequency, load.signal, tau)
        share = shapes.T @ push
        displacement[:, free] += (sine * share) @ shapes.T
        velocity[:, free] += (cosine * share) @ shapes.T
        if load.moves:
            displacement[:, freedoms] = load.signal(tau)[:, None]
            velocity[:, freedoms] = _slope(load.signal, tau)[:, None]
    return displacement.reshape(-1, count, 3), velocity.reshape(-1, count, 3)


def _swings(frequency: Floats, signal: Function, tau: Floats) -> tuple[Floats, Floats]:
    """Return ∫ [sin ω(τ−σ)/ω] g dσ and ∫ cos ω(τ−σ) g dσ from 0, (T, modes) each."""
    sine, cosine = np.zeros((2, len(tau), len(frequency)))
    at, s, c = 0.0, np.zeros(len(frequency)), np.zeros(len(frequency))
    for place, end in enumerate(tau):
        count = int(np.ceil((end - at) / _PANEL))
        for low, high in zip(
            *(np.linspace(at, end, count + 1)[part] for part in (slice(-1), slice(1, None))), strict=True
        ):
            step = high - low
            nodes = low + step * (_POINTS + 1) / 2
            weights = signal(nodes) * _WEIGHTS * step / 2
            late = np.multiply.outer(high - nodes, frequency)
            turn = np.cos(frequency * step), np.sin(frequency * step)
            s, c = (
                turn[0] * s + turn[1] * c + weights @ np.sin(late),
                turn[0] * c - turn[1] * s + weights @ np.cos(late),
            )
        sine[place], cosine[place], at = s / frequency, c, end
    return sine, cosine


def _slope(signal: Function, tau: Floats) -> Floats:
    """Return dg/dτ by central differences of fourth order, to 1e-10 of the signal."""
    h = 1e-3
    return np.asarray((8 * (signal(tau + h) - signal(tau - h)) - signal(tau + 2 * h) + signal(tau - 2 * h)) / (12 * h))
