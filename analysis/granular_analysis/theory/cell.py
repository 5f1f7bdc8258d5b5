"""Second order in a whole cell of N spheres, perfect or not, without a time step.

A wave Re[X e^{iθ}] starts with X = Z and Ẋ = V in a network of spheres at rest. The forces of the contacts to second
order are those of `granular_analysis.theory.bonds`. The part of the motion that turns with e^{2iθ} is Re[Y e^{2iθ}],

    M Ẍ = −D X,        M Ÿ = −D Y + ½[Q(X, X) + Q₀ + ∫₀ᵗ Q_w dt],        Y = Ẏ = 0 at t = 0.

Disorder scatters the wave in the first equation; the square of the wave drives the second. Neither equation is stepped.
The eigenvalues of A = M⁻¹D lie between 0 and ω² (Gershgorin's bound), so a function of A is a sum of Chebyshev
polynomials,

    f(A) = Σ_l f(ω_l²) δ_l(A),    δ_l(A) = (1/K) Σ_n (2 − δ_n0) T_n(x_l) T_n(2A/ω² − 1),    x_l = 2ω_l²/ω² − 1,

exact to rounding once K exceeds ωt/2 by a few tens. So K sparse products give X(t) at any time. A linear readout P·Y is
that of K oscillators with the frequencies ω_l, driven by P·δ_l(A) M⁻¹ times the forces. The forces are evaluated at
Chebyshev points in time. Their number follows from the highest frequency in the integrand, so integrals over time are
exact to rounding, too.

`second_order` returns a readout of the second order of one wave. `fields` returns the fields of first and second order
of all spheres for any start, such as a beam or noise: X(t) and Y(t) = ∫₀ᵗ sin(√A(t−s))/√A M⁻¹Q(s) ds. `fields` may
imitate a time step h of velocity Verlet: ω' = (2/h) arcsin(ωh/2) then replaces ω, and sin(ω't)/(ω cos(ω'h/2)) replaces
sin(ωt)/ω, which is exact in first order and leaves an error O(h²) in second order.

Units are those of the network. Good values: N ωt up to 5e6, for which 3 GB are needed.

When it breaks: if contacts open or slide, if the second order is not small (`Second.reached` says how near contacts
come to opening), and in a network that is not at rest or not stable. Dashpots are refused.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebint, chebval
from numpy.typing import ArrayLike, NDArray
from scipy.fft import dct, next_fast_len
from scipy.sparse import csr_array

from granular_analysis.theory.bonds import AT_REST, Bonds, Strain
from granular_analysis.theory.crystal import PLANE, padded
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_state import search
from granular_analysis.theory.validity import Reached, reached

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_MORE = 30  # polynomials and points beyond the number from which the error falls faster than any power
BAND = 3  # highest frequency in an integrand over the bound: that of the wave twice, that of the answer once
_BATCH = 20_000  # contacts times points in time that are evaluated together
_LAGS = 20_000_000  # most weights in memory: polynomials times points in time times output times


@dataclass(frozen=True, eq=False)
class Cell:
    """N spheres at rest with their contacts.

    Attributes
    ----------
    bonds : the contacts.
    inverse_mass : (3, N) accelerations per force of u_x, u_y and φ = Rθ; 0 for what does not move.
    radius : (N,) radii.
    """

    bonds: Bonds
    inverse_mass: Floats
    radius: Floats

    @classmethod
    def of(cls, network: Network) -> "Cell":
        """Return the cell of a network at rest.

        Raises TheoryError for a network in space, or with dashpots, walls, drives or drag.
        """
        if network.viscosity or network.restitution is not None:
            raise TheoryError("the second order of a cell leaves out viscosity and restitution; use the network")
        if network.dimension == 3:
            raise TheoryError("the second order of a cell leaves out spheres in space; use the network")
        if network.walls or network.drives or network.drag is not None:
            raise TheoryError("the second order of a cell leaves out walls, drives and drag; use the network")
        pairs = search(network, np.zeros((2, len(network.position))))
        touch = np.flatnonzero(pairs.overlap > pairs.normal.end)
        overlap, length, radii = pairs.overlap[touch], pairs.length[touch], pairs.radii[:, touch].T
        A, B, F = (each[touch] for each in (pairs.A, pairs.B, pairs.F))
        law = AT_REST[network.adhesion](overlap, A, B, F)
        apart = padded(pairs.apart[:, touch].T)
        bonds = Bonds(
            *(pairs.first[touch], pairs.second[touch], apart, apart / length[:, None], 1 / length),
            arms=1 - overlap[:, None] / (2 * radii),
            widening=1 / (2 * radii),
            law=law,
            shear_law=network.law,
        )
        mobility = network.mobility * np.array([np.ones_like(network.radius)] * 2 + [network.radius**2])
        return cls(bonds, mobility, network.radius)

    @cached_property
    def matrix(self) -> csr_array:
        """Return A = M⁻¹D, sparse (3N, 3N); the order is u_x, u_y, φ of one sphere after the other."""
        bonds, plane = self.bonds, np.array(PLANE)
        ends = np.stack([bonds.first, bonds.second], axis=1)
        freedoms = 3 * ends[:, :, None] + np.arange(3)  # (C, 2, 3)
        values = -bonds.couplings[:, :, plane][..., plane]  # (C, 2, 3, 2, 3)
        rows = np.broadcast_to(freedoms[:, :, :, None, None], values.shape)
        columns = np.broadcast_to(freedoms[:, None, None], values.shape)
        size = self.inverse_mass.size
        weights = self.inverse_mass.T.ravel()
        return csr_array((weights[rows.ravel()] * values.ravel(), (rows.ravel(), columns.ravel())), (size, size))

    @cached_property
    def highest(self) -> float:
        """Return Gershgorin's upper bound ω² of all squared frequencies."""
        return float(np.abs(self.matrix).sum(axis=1).max())

    def field(self, vectors: NDArray[Any]) -> NDArray[Any]:
        """Return fields (..., N, 6) from their components in the plane, (..., 3N)."""
        result = np.zeros((*vectors.shape[:-1], len(self.radius), 6), dtype=vectors.dtype)
        result[..., list(PLANE)] = vectors.reshape(*vectors.shape[:-1], -1, 3)
        return result

    def strain(self, vectors: NDArray[Any]) -> Strain:
        """Return the deformation of the contacts for fields (..., 3N)."""
        return self.bonds.strain(self.field(vectors), np.zeros(3))

    def forces(self, ends: Complexes) -> Complexes:
        """Return the forces (..., 3N) on spheres from those at both ends of the contacts, (..., C, 2, 6)."""
        gathered = self.bonds.gather(ends, np.zeros(3), len(self.radius))
        return gathered[..., list(PLANE)].reshape(*gathered.shape[:-2], -1)


class Second(NamedTuple):
    """A readout P·Y (T, R) of the second order of a wave, and how far the first order deforms contacts."""

    signal: Complexes
    reached: Reached


def second_order(
    cell: Cell, displacement: ArrayLike, velocity: ArrayLike, readout: ArrayLike, time: ArrayLike
) -> Second:
    """Return R linear readouts P·Y of the second order of a wave, in the part that turns with e^{2iθ}.

    Parameters
    ----------
    displacement, velocity : (3N,) Z and V, complex: u_x, u_y, Rθ of one sphere after the other.
    readout : (R, 3N) P.
    time : (T,) since the start.
    """
    start = np.array([displacement, velocity], dtype=complex)
    course = Course.of(np.asarray(time, dtype=float), float(np.sqrt(cell.highest)))
    moved = course.polynomials(cell.matrix, start)
    read = course.polynomials(csr_array(cell.matrix.T), np.asarray(readout, dtype=complex))
    forces, far = _forces(cell, course, moved)
    return Second(course.answer(0.5 * (read * cell.inverse_mass.T.ravel()) @ forces), far)


def fields(
    cell: Cell, displacement: ArrayLike, velocity: ArrayLike, time: ArrayLike, timestep: float = 0.0
) -> tuple[Floats, Floats]:
    """Return the fields of first and second order, (T, 3N) each, for a start that belongs to the first order.

    Parameters
    ----------
    displacement, velocity : (3N,) u_x, u_y, Rθ of one sphere after the other.
    time : (T,) since the start.
    timestep : step h of velocity Verlet; 0 for exact frequencies.

    Raises TheoryError for other shapes, times before the start, and a time step at which Verlet may be unstable.
    """
    times, shapes = np.asarray(time, dtype=float), (np.shape(displacement), np.shape(velocity))
    if set(shapes) != {(cell.inverse_mass.size,)}:
        raise TheoryError(f"displacement and velocity are {shapes}; both must be ({cell.inverse_mass.size},)")
    if times.ndim != 1 or not len(times) or times.min() < 0:
        raise TheoryError(f"time = {times} must be one or more times since the start, none negative")
    start = np.array([displacement, velocity], dtype=float)
    course = Course.of(times, float(np.sqrt(cell.highest)), timestep)
    moved = course.polynomials(cell.matrix, start)
    forces, _ = _forces(cell, course, moved)
    pushed = np.ascontiguousarray(forces.real.T) * cell.inverse_mass.T.ravel()
    return course.motion(moved, times)[0], course.driven(cell.matrix, pushed)


def _forces(cell: Cell, course: "Course", moved: NDArray[Any]) -> tuple[Complexes, Reached]:
    """Return Q(X, X) + Q₀ + ∫Q_w dt (3N, S) at the points, from polynomials of X, and how far X deforms contacts."""
    here = cell.strain(moved[:1, 0])
    far, left = reached(cell.bonds.law, here), cell.forces(cell.bonds.left(here, here))
    running, winding = [left[:0]], [left[:0]]
    at_once = max(_BATCH // len(cell.bonds.first), 1)
    for times in np.split(course.points, range(at_once, len(course.points), at_once)):
        here, onward = map(cell.strain, course.motion(moved, times))
        running.append(cell.forces(cell.bonds.running(here, here)))
        winding.append(cell.forces(cell.bonds.winding(here, onward, -0.5)))
        far = far.beside(reached(cell.bonds.law, here))
    return np.concatenate(running).T + left.T + course.integral(np.concatenate(winding).T), far


@dataclass(frozen=True, eq=False)
class Course:
    """Chebyshev points for functions of A (K rates ω_l) and of time (S points from 0 to the last time).

    Attributes
    ----------
    times : (T,) times of the results.
    highest : bound ω of all frequencies.
    whole : the last time.
    rates : (K,) ω_l.
    points : (S,) times at which forces are evaluated.
    timestep : h of velocity Verlet; 0 for exact frequencies.
    """

    times: Floats
    highest: float
    whole: float
    rates: Floats
    points: Floats
    timestep: float

    @classmethod
    def of(cls, times: Floats, highest: float, timestep: float = 0.0) -> "Course":
        """Return the course for frequencies below a bound; raise TheoryError for a step that may be unstable."""
        if not highest * timestep < 2:
            raise TheoryError(f"timestep = {timestep}: must be below 2/Omega_max; below {2 / highest:.4g} is safe")
        whole = max(float(times.max()), 1e-3 / highest)
        turns = highest * whole / 2
        fastest = whole / timestep * np.arcsin(highest * timestep / 2) if timestep else turns
        count, moments = (next_fast_len(int(1.05 * each) + _MORE) for each in (turns, BAND * fastest))
        angles = np.pi * (np.arange(count) + 0.5) / count
        points = 0.5 * whole * (1 - np.cos(np.pi * (np.arange(moments) + 0.5) / moments))
        return cls(times, highest, whole, highest * np.cos(angles / 2), points, timestep)

    @cached_property
    def actual(self) -> Floats:
        """Return ω'_l (K,), the frequencies that the time step makes of ω_l."""
        h = self.timestep
        return 2 / h * np.arcsin(self.rates * h / 2) if h else self.rates

    @cached_property
    def gain(self) -> Floats:
        """Return 1/(ω_l cos(ω'_l h/2)), (K,), the factor of sin(ω'_l t) in the response to a push."""
        return np.asarray(1 / (self.rates * np.sqrt(1 - (self.rates * self.timestep / 2) ** 2)))

    def polynomials(self, matrix: csr_array, vectors: NDArray[Any]) -> NDArray[Any]:
        """Return T_n(2A/ω² − 1) times vectors (m, 3N), (m, K, 3N)."""
        found = np.empty((len(vectors), len(self.rates), vectors.shape[1]), dtype=vectors.dtype)
        found[:, 0] = vectors
        for n in range(1, len(self.rates)):
            last = found[:, n - 1]
            turned = (2 / self.highest**2) * (matrix @ last.T).T - last
            found[:, n] = turned if n == 1 else 2 * turned - found[:, n - 2]
        return found

    def motion(self, start: NDArray[Any], moments: Floats) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return X and Ẋ, (S, 3N) each, at moments (S,), from the polynomials (2, K, 3N) of Z and V."""
        phase = np.outer(moments, self.actual)
        swing, sway = np.cos(phase), np.sin(phase)
        each = swing, sway * self.gain, -sway * self.actual, swing * self.actual * self.gain
        still, swung, swayed, moved = map(self._coefficients, each)
        displaced, moving = (part.view(float) for part in start)  # the coefficients are real
        place = still @ displaced + swung @ moving
        rate = swayed @ displaced + moved @ moving
        return place.view(start.dtype), rate.view(start.dtype)

    def _coefficients(self, values: Floats) -> Floats:
        """Return the weights (S, K) of the polynomials in functions with values (S, K) at the ω_l."""
        weights = np.asarray(dct(values, axis=1)) / len(self.rates)
        weights[:, 0] /= 2
        return weights

    def answer(self, moments: Complexes) -> Complexes:
        """Return P·Y (T, R) from P·T_n M⁻¹ times the forces at the points, (R, K, S)."""
        read = np.asarray(dct(moments, type=3, axis=1)) / len(self.rates)
        turned = np.exp(1j * np.outer(self.actual, self.points))
        onward, backward = self.integral(read * turned.conj()), self.integral(read * turned)
        answers = np.sum((turned * onward - turned.conj() * backward) * (-0.5j * self.gain[:, None]), axis=1)
        return np.asarray(chebval(1 - 2 * self.times / self.whole, self._expanded(answers).T).T)

    def driven(self, matrix: csr_array, pushed: Floats) -> Floats:
        """Return ∫₀ᵗ sin(√A(t−s))/√A a(s) ds (T, 3N), from accelerations a (S, 3N) at the points."""
        at_once = max(_LAGS // (len(self.rates) * len(self.points)), 1)
        parts = np.split(self.times, range(at_once, len(self.times), at_once))
        return np.concatenate([self._driven(matrix, pushed, times) for times in parts])

    def _driven(self, matrix: csr_array, pushed: Floats, times: Floats) -> Floats:
        since = (times[:, None] - self.points)[..., None] * self.actual
        weights = self._coefficients((np.sin(since) * self.gain).reshape(-1, len(self.rates)))
        weights = weights.reshape(len(times), len(self.points), -1) * self._quadrature(times)[..., None]
        last = before = np.zeros((len(times), pushed.shape[1]))
        for n in range(len(self.rates) - 1, -1, -1):  # Clenshaw's summation of the polynomials
            turned = (2 / self.highest**2) * (matrix @ last.T).T - last
            last, before = weights[..., n] @ pushed + (2 if n else 1) * turned - before, last
        return last

    def _quadrature(self, times: Floats) -> Floats:
        """Return the weights (T, S) of the values at the points in an integral from 0 to times (T,)."""
        weights = chebint(self._expanded(np.eye(len(self.points))).real, lbnd=1, scl=-0.5 * self.whole, axis=-1)
        return np.asarray(chebval(1 - 2 * times / self.whole, weights.T).T)

    def _expanded(self, values: NDArray[Any]) -> Complexes:
        """Return the Chebyshev coefficients (..., S) of a function of time from its values at the points."""
        weights = np.asarray(dct(values, axis=-1), dtype=np.complex128) / len(self.points)
        weights[..., 0] /= 2
        return weights

    def integral(self, values: Complexes) -> Complexes:
        """Return the integrals (..., S) from time 0 to each point, of a function with these values at the points."""
        # The argument of the polynomials falls from 1 as time grows
        weights = chebint(self._expanded(values), lbnd=1, scl=-0.5 * self.whole, axis=-1)
        lowered = weights[..., :-1].copy()
        lowered[..., 1:] /= 2
        return np.asarray(dct(lowered, type=3, axis=-1))
