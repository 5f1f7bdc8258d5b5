"""Waves of a layer of spheres on an elastic half-space: surface waves coupled to contact resonances.

The half-space z < 0 has the density ρ and the wave speeds c_l and c_t. If its surface moves by u_s e^{i(k·r − ωt)}, the
tractions are S u_s. With μ = ρc_t², p² = k² − ω²/c_l², q² = k² − ω²/c_t² and g = (pq + k²)/(k²(1 + c_t²/c_l²) −
ω²/c_l²), and with components along k, across k, and up,

    S = μ [[pg, 0, ik(2 − g)], [0, q, 0], [−ik(2 − g), 0, qg]]                                    (after Lamb 1904)

Each sphere pulls the surface with C(u_foot − u_s), where C = diag(K_S, K_S, K_N) and u_foot = u − φ × z. With N
contacts per area, the matrix D(k) of the layer on a rigid substrate, and u_foot = B U,

    [[D − ω²M, −BᵀC], [−CB, C + S/N]] (U, u_s) = 0

For K_S = 0 and spheres that do not touch each other, this is the formula for the vertical resonance alone. Below
ω = c_t k the matrix is Hermitian and its eigenvalues decrease with ω: the number of negative eigenvalues equals the
number of *guided* waves below ω, so no wave is missed. Faster waves *leak* into the half-space: their frequency has a
negative imaginary part. At k = 0 the vertical resonance has the quality factor ρc_l/(Nmω0), if this number is large.

When it breaks: if 2π/k is only a few sphere distances, because the half-space responds to the mean of the forces.
Torques have the arm R, which changes frequencies by a share η/2. Units are those of the crystal.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.crystal import Crystal, padded

__all__ = ["Coupled", "HalfSpace"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
_HALVINGS = 60  # largest number of halvings of an interval of frequencies
_SLOWEST = 1e-9  # a motion below this share of the highest frequency is free, without a restoring force
_STEPS = 60  # largest number of Newton steps
_MET = 1e-12  # relative change of a frequency below which Newton's method has converged
_NEAR = 1e-7  # relative step of a numerical derivative
_ASIDE = 1e-6j  # relative offset of the start from the guess, because the guess may be a known wave
_LONGEST = 0.1  # largest Newton step, as a share of the frequency


class Reaction(NamedTuple):
    """Reaction of a body at its surface.

    Attributes
    ----------
    stiffness : S (..., 3, 3).
    held : number (...) of waves below ω in the body with its surface held at rest.
    """

    stiffness: Complexes
    held: NDArray[np.intp]


class Body(Protocol):
    """A substrate under the layer: a half-space, or `granular_analysis.theory.layered.Layered`."""

    @property
    def cutoff(self) -> float:
        """Return the speed from which waves leak into the body."""

    def reaction(self, wavenumber: ArrayLike, frequency: ArrayLike) -> Reaction:
        """Return the reaction of the surface at k > 0 (...) and ω (...), which may be complex."""


class HalfSpace(NamedTuple):
    """Isotropic elastic half-space, given by its density and the speeds of longitudinal and transverse waves."""

    density: float
    longitudinal: float
    transverse: float

    @classmethod
    def of(cls, youngs_modulus: float, poisson_ratio: float, density: float) -> "HalfSpace":
        """Return the half-space with these elastic constants."""
        shear = youngs_modulus / (2 * (1 + poisson_ratio))
        plane = shear * 2 * (1 - poisson_ratio) / (1 - 2 * poisson_ratio)
        return cls(density, float(np.sqrt(plane / density)), float(np.sqrt(shear / density)))

    @property
    def cutoff(self) -> float:
        """Return the speed c_t, from which waves leak."""
        return self.transverse

    def reaction(self, wavenumber: ArrayLike, frequency: ArrayLike) -> Reaction:
        """Return the reaction of the surface; no wave slower than c_t exists below a surface at rest."""
        stiffness = self.stiffness(wavenumber, frequency)
        return Reaction(stiffness, np.zeros(stiffness.shape[:-2], dtype=np.intp))

    def stiffness(self, wavenumber: ArrayLike, frequency: ArrayLike) -> Complexes:
        """Return S (..., 3, 3), along k, across, and up, at k > 0 (...) and ω (...), which may be complex."""
        k, omega = complexes(wavenumber, frequency)
        p, q = (downward(k, omega / speed) for speed in (self.longitudinal, self.transverse))
        slow = (self.transverse / self.longitudinal) ** 2
        g = (p * q + k**2) / (k**2 * (1 + slow) - (omega / self.longitudinal) ** 2)
        result = np.zeros((*k.shape, 3, 3), dtype=complex)
        result[..., 0, 0], result[..., 1, 1], result[..., 2, 2] = p * g, q, q * g
        result[..., 0, 2] = 1j * k * (2 - g)
        result[..., 2, 0] = -result[..., 0, 2]
        return np.asarray(self.density * self.transverse**2 * result)

    def rayleigh(self) -> float:
        """Return the speed of the surface wave of the bare half-space."""
        slow = (self.transverse / self.longitudinal) ** 2
        # x³ − 8x² + (24 − 16s)x − 16(1 − s) = 0 for x = (c/c_t)², s = (c_t/c_l)²
        roots = np.roots([1.0, -8.0, 24 - 16 * slow, -16 * (1 - slow)])
        return float(self.transverse * np.sqrt(next(x.real for x in roots if abs(x.imag) < 1e-9 and 0 < x.real < 1)))


def _hermitian(matrix: Complexes) -> Complexes:
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2).conj())


def _zeros(falling: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Return the zeros (...) of functions that fall from low to high, by Ridders' method."""
    upper, lower = np.abs(falling(low)), -np.abs(falling(high))
    found = high
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        value = falling(middle)
        root = np.sqrt(value**2 - upper * lower)
        last, found = found, middle + (middle - low) * np.divide(value, root, out=0 * value, where=root > 0)
        closer = falling(found)
        for place, there in ((middle, value), (found, closer)):
            left, right = (there > 0) & (place >= low), (there <= 0) & (place <= high)
            low, upper = np.where(left, place, low), np.where(left, there, upper)
            high, lower = np.where(right, place, high), np.where(right, there, lower)
        if np.all((np.abs(found - last) <= _MET * found) | (high - low <= _MET * high)):
            break
    return found


def _root(at: Callable[[NDArray[Any]], Reaction], guess: Complexes, known: Complexes) -> Complexes:
    """Return a root ω (...) of the determinant near each guess (...), apart from known roots (..., n); nan if none.

    This is Newton's method for the determinant divided by Π(ω − ω_n).
    """
    there = np.isfinite(guess)
    omega, live = np.where(there, guess, 1.0) * (1 - _ASIDE), there
    for _ in range(_STEPS):
        if not live.any():
            break
        here, near = at(omega * np.reshape([1, 1 + _NEAR], (2, *[1] * omega.ndim))).stiffness
        # f′/f = trace(K⁻¹K′) for the determinant f. K is singular once a guess has converged, so those are masked
        changed = np.linalg.solve(np.where(live[..., None, None], here, np.eye(here.shape[-1])), near - here)
        slope = np.trace(changed, axis1=-2, axis2=-1) / (omega * _NEAR)
        apart = np.where(np.isfinite(known), omega[..., None] - known, np.inf)
        step = -1 / (slope - np.sum(1 / apart, axis=-1))
        step *= np.minimum(1.0, _LONGEST * np.abs(omega / step))
        there = there & (np.isfinite(step) | ~live)
        omega = np.where(live & there, omega + step, omega)
        live = live & there & ~(np.abs(step) < _MET * np.abs(omega))
    return np.where(there & ~live, omega, np.nan)


def complexes(wavenumber: ArrayLike, frequency: ArrayLike) -> tuple[Complexes, Complexes]:
    """Return k and ω as complex arrays of one shape."""
    k, omega = np.broadcast_arrays(*(np.asarray(each, dtype=complex) for each in (wavenumber, frequency)))
    return k, omega


def downward(k: NDArray[Any], slowness: NDArray[Any]) -> Complexes:
    """Return √(k² − (ω/c)²), slowness ω/c, for waves that decay into the half-space or, if faster, run into it."""
    square = k**2 - slowness**2
    return np.asarray(np.where(square.real > 0, np.sqrt(square), -1j * np.sqrt(-square)))


@dataclass(frozen=True, eq=False)
class Coupled:
    """Layer of spheres on a half-space or another substrate.

    Attributes
    ----------
    crystal : the layer on a rigid wall, with `true_geometry=False`, because the exact geometry would give torques of
        pairs and walls different arms.
    substrate : `HalfSpace` or another `Body`, in the units of the crystal.
    feet : contacts with the wall, found from the crystal.

    Raises
    ------
    ValueError
        For a crystal that is not a film with two lattice vectors, on one wall below, with equal arms.
    """

    crystal: Crystal
    substrate: Body
    feet: NDArray[np.intp] = field(init=False)

    def __post_init__(self) -> None:
        bonds, feet = self.crystal.bonds, np.flatnonzero(self.crystal.bonds.second < 0)
        below = len(feet) and np.allclose(bonds.normal[feet], [0.0, 0.0, -1.0])
        if not (below and len(self.crystal.vectors) == 2 and self.crystal.even):
            raise ValueError(
                "the crystal must be a film that repeats along x and y, on one wall below, with equal arms"
            )
        object.__setattr__(self, "feet", feet)

    @property
    def area(self) -> float:
        """Return the area of a cell of the layer."""
        return float(np.linalg.norm(np.cross(*self.crystal.vectors)))

    def matrix(self, wavevector: ArrayLike, frequency: ArrayLike) -> Complexes:
        """Return the matrix (..., F + 3, F + 3) of the module, at wave vectors (..., 2 or 3) and ω (...)."""
        return self._at(wavevector)(np.asarray(frequency)).stiffness

    def _at(self, wavevector: ArrayLike) -> Callable[[NDArray[Any]], Reaction]:
        """Return the matrix at wave vectors (..., 2 or 3) as a function of ω (...)."""
        k, crystal = padded(wavevector), self.crystal
        size = np.linalg.norm(k, axis=-1)
        along = k / size[..., None]
        frame = np.stack([along, np.cross([0.0, 0.0, 1.0], along), np.broadcast_to([0.0, 0.0, 1.0], k.shape)], axis=-2)
        moved, springs = self._pulled()
        count, area = len(moved), self.area
        rest: Complexes = np.zeros((*size.shape, count + 3, count + 3), dtype=complex)
        rest[..., :count, :count] = crystal.stiffness(k)
        rest[..., :count, count:], rest[..., count:, :count] = -moved, -moved.T
        rest[..., count:, count:] = springs
        mass = np.diag(np.append(crystal.moving(crystal.mass), np.zeros(3)))

        def assembled(omega: NDArray[Any]) -> Reaction:
            body = self.substrate.reaction(size, omega)
            matrix: Complexes = rest - (omega**2)[..., None, None] * mass
            matrix[..., count:, count:] += area * (np.swapaxes(frame, -1, -2) @ body.stiffness @ frame)
            return Reaction(matrix, body.held)

        return assembled

    def _pulled(self) -> tuple[Floats, Floats]:
        """Return BᵀC (F, 3) and C (3, 3), summed over the feet of a cell."""
        law, crystal = self.crystal.bonds.law, self.crystal
        pulls, springs = np.zeros((len(crystal), 6, 3)), np.zeros((3, 3))
        # u_foot = u − φ × z, as columns of u and φ
        foot = np.concatenate([np.eye(3), [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]])
        for contact in self.feet:
            stiffness = np.diag([law.shear[contact], law.shear[contact], law.stiffness[contact]])
            pulls[crystal.bonds.first[contact]] += foot @ stiffness
            springs += stiffness
        return pulls[:, list(crystal.freedoms)].reshape(-1, 3), springs

    def guided(self, wavevector: ArrayLike, below: float = np.inf) -> Floats:
        """Return ω (..., J) of the guided waves below `below`, ascending; nan where there are fewer than J.

        Parameters
        ----------
        wavevector : (..., 2 or 3); J is the largest number of waves at one of them
        below : upper limit of ω; a plate requires it

        Raises ValueError for a plate without a limit.
        """
        k = padded(wavevector)
        fastest = np.minimum(self.substrate.cutoff * np.linalg.norm(k, axis=-1) * (1 - 1e-12), below)
        if not np.isfinite(fastest).all():
            raise ValueError("a plate has infinitely many guided waves: give the frequency below which to find them")
        matrix, held = self._at(k)(fastest)
        counts = held + np.sum(np.linalg.eigvalsh(_hermitian(matrix)) < 0, axis=-1)
        numbers = np.arange(counts.max(initial=0))
        at = self._at(np.broadcast_to(k[..., None, :], (*counts.shape, len(numbers), 3)))

        def passed(omega: Floats) -> Floats:
            """Return for each wave a number that falls with ω and is 0 at the frequency of the wave."""
            matrix, held = at(omega)
            values = np.linalg.eigvalsh(_hermitian(matrix))
            place = numbers - held
            chosen = np.take_along_axis(values, np.clip(place, 0, values.shape[-1] - 1)[..., None], axis=-1)[..., 0]
            return np.where(place < 0, -np.abs(chosen), np.where(place < values.shape[-1], chosen, np.abs(chosen)))

        high = np.broadcast_to(fastest[..., None], (*counts.shape, len(numbers)))
        return np.where(numbers < counts[..., None], _zeros(passed, _SLOWEST * high, high), np.nan)

    def leaking(self, wavevector: ArrayLike, guess: ArrayLike) -> Complexes:
        """Return ω (..., J) of the waves near guesses (..., J), with Im ω < 0 if they leak; nan if none is found.

        Guesses at one wave vector find different waves, or one wave as often as its multiplicity.

        Parameters
        ----------
        wavevector : (..., 2 or 3); (2,) or (3,) for a single guess ()
        guess : starting frequencies, such as those on the rigid substrate
        """
        guesses, at = np.atleast_1d(np.asarray(guess, dtype=complex)), self._at(wavevector)
        found = np.full_like(guesses, np.nan)
        for number in range(guesses.shape[-1]):
            found[..., number] = _root(at, guesses[..., number], found[..., :number])
        return found.reshape(np.shape(guess))

    def shape(self, wavevector: ArrayLike, frequency: complex) -> tuple[Complexes, Complexes]:
        """Return the motion of the spheres (B, 6) and of the surface (3,) in the wave of one frequency."""
        _, _, rows = np.linalg.svd(self.matrix(wavevector, np.array(frequency)))
        vector = rows[-1].conj()
        return self.crystal.whole(vector[:-3]), vector[-3:]
