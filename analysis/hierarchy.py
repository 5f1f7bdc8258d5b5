"""The perturbation hierarchy to any order in the amplitude: the exact lattice, fed with power series.

With a = D0/Δ0 the displacements (in Δ0) of a wave are a power series, y = a y1 + a² y2 + … + aⁿ yn + O(aⁿ⁺¹). Put into
the equations of motion, each power of a gives the equation of one order: the linear lattice, driven by the orders
below. Nobody needs to write these equations down. `lattice.rhs` is made of sums, products, quotients and square roots,
and each of them has a rule for truncated series (Knuth, The Art of Computer Programming 2, section 4.7):

    xy: (xy)_k = Σ_j x_j y_{k−j}      q = x/y: q_k = (x_k − Σ_{j<k} q_j y_{k−j})/y_0
                                      r = √x:  r_k = (x_k − Σ_{0<j<k} r_j r_{k−j})/(2r_0)

`Series` is an array that obeys them. Given to `lattice.rhs` in place of numbers, it returns the equations of all orders
at once, in the paper's geometry or with contacts of true direction and length, under compression, the incremental law,
with dashpots or without shear or rotation, and these are integrated in time.

In units of D0 the displacement to order n is y1 + a y2 + … + aⁿ⁻¹ yn. Order k holds the harmonics k, k−2, … of ϑ, so
2n+1 points of phase are exact. Order 2 is `second_harmonic.second_order`, in any direction `directions.second_order`.
For TR and RT along y, p has even orders only, q and φ odd ones only: the relative error of p falls as aⁿ, that of q and
φ (n odd) as aⁿ⁺¹.

**Antiresonance.** There y2 is next to nothing in p, and p is of order a⁴: error of p at ξ=2.127, a=0.2, τ≤120, ν=0.17

    order        2      4        6
    error of p   1.13   4.2e-2   1.6e-3

What a⁴ brings is the harmonic 2ξ (99 % of its mean square) and a little 4ξ. Most of it is there because the wave was
started as the linear mode, without the harmonics that go with it. Of the 2ξ part 61 % are free L waves, ±Ω_L(2ξ), and
37 % are driven by the fundamental with a free TR or RT wave of order a³ (Ω_RT(3ξ) − Ω and Ω_RT(ξ) ± Ω above all);
only 1.7 % are bound to the fundamental, at 2Ω. Of the 4ξ part it is 46, 42 and 12 %.

**When it breaks.** Orders grow with time where waves resonate or frequencies shift, so any order fails at last. At
a=0.2 the error of p at order 6, averaged over 80 τ, has grown at τ=400 to 6e-6 (TR, ξ=0.802), 7e-3 (TR, ξ=1.475, the
resonance), 8e-3 (L, ξ=0.802), 2.5e-2 (TR, ξ=2.127). A contact that opens has no power series.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, Self, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis import lattice
from analysis.second_harmonic import Mode

Floats = NDArray[np.float64]


class Series(np.ndarray[Any, np.dtype[np.float64]]):
    """Array of truncated power series in a. The last axis, hidden from arithmetic, holds the coefficients of a⁰ … aⁿ.

    Plain numbers and arrays are constants. The arithmetic is what `lattice.rhs` asks for; any other ufunc raises
    TypeError, and a square root, maximum or sign that is not analytic at a=0 raises ValueError.
    """

    __array_priority__ = 1.0  # so that np.stack and np.concatenate of series are series

    @classmethod
    def variable(cls, order: int) -> Self:
        """The series a itself, to order n ≥ 1."""
        return np.eye(order + 1)[1].view(cls)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """Apply the rule of a ufunc to the coefficients; NumPy raises TypeError for one that has none."""
        out = options.pop("out", (None,))[0]
        if ufunc is np.add and method == "reduce":  # a sum over an axis, which must be counted from the front
            result = np.add.reduce(np.asarray(self), **options)
        elif ufunc is np.matmul and method == "__call__":  # only Series @ matrices, one per bond
            result = np.swapaxes(inputs[1], -1, -2)[..., None, :, :] @ np.asarray(inputs[0])
        elif ufunc in RULES and method == "__call__" and not options:
            result = RULES[ufunc](*(_coefficients(value, self.shape[-1]) for value in inputs))
        else:
            return NotImplemented
        if out is None:
            return result.view(Series)
        np.asarray(out)[...] = result
        return out


def _coefficients(value: ArrayLike, terms: int) -> Floats:
    """The coefficients of a series; those of a constant, (…, terms), for anything else."""
    if isinstance(value, Series):
        return np.asarray(value)
    return np.multiply.outer(value, np.eye(terms)[0])


@cache
def _cauchy(terms: int) -> Floats:
    """Array (terms, terms, terms) of 1 where the powers i, j of two factors add up to k, and 0 elsewhere."""
    power = np.arange(terms)
    return np.equal.outer(np.add.outer(power, power), power).astype(float)


def _product(x: Floats, y: Floats) -> Floats:
    return np.tensordot(x[..., :, None] * y[..., None, :], _cauchy(x.shape[-1]), axes=2)


def _quotient(x: Floats, y: Floats) -> Floats:
    if not y[..., 1:].any():  # by a constant, as most often: spares a fifth of the time
        return x / y[..., :1]
    q: Floats = np.empty(np.broadcast_shapes(x.shape, y.shape))
    for k in range(q.shape[-1]):
        q[..., k] = (x[..., k] - (q[..., :k] * y[..., k:0:-1]).sum(axis=-1)) / y[..., 0]
    return q


def _root(x: Floats) -> Floats:
    if np.any(x[..., 0] <= 0):
        raise ValueError("the square root has no power series where the constant term is not positive")
    r = np.empty_like(x)
    r[..., 0] = np.sqrt(x[..., 0])
    for k in range(1, r.shape[-1]):
        r[..., k] = (x[..., k] - (r[..., 1:k] * r[..., k - 1 : 0 : -1]).sum(axis=-1)) / (2 * r[..., 0])
    return r


def _sign(x: Floats) -> Floats:
    if np.any(x[..., 0] == 0):
        raise ValueError("the sign has no power series where the argument is 0 at a = 0")
    return np.multiply.outer(np.sign(x[..., 0]), np.eye(x.shape[-1])[0])


def _maximum(x: Floats, y: Floats) -> Floats:
    if np.any(x[..., 0] <= y[..., 0]):
        raise ValueError("the maximum has a power series here only where the first argument is the larger at a = 0")
    return x


RULES: dict[np.ufunc, Callable[..., Floats]] = {
    np.add: np.add,
    np.subtract: np.subtract,
    np.multiply: _product,
    np.divide: _quotient,
    np.square: lambda x: _product(x, x),
    np.sqrt: _root,
    np.hypot: lambda x, y: _root(_product(x, x) + _product(y, y)),
    np.maximum: _maximum,
    np.sign: _sign,
}


def hierarchy_orders(
    mode: Mode,
    tau: ArrayLike,
    poisson_ratio: float,
    *,
    order: int = 6,
    rtol: float = 1e-10,
    **effects: Unpack[lattice.Effects],
) -> Floats:
    """Every order of p, q, φ on the phase torus, (n, T, 3, 2n+1): [k−1] is yk, the factor of aᵏ in units of Δ0.

    Parameters
    ----------
    mode : the wave at τ=0 (all of it in y1), made from ratios with the same ν and effects.
    tau : (T,) ascending times.
    poisson_ratio, effects : as in `lattice.contact`; the law from a potential, which divides by the overlap, is none.
    order : n ≥ 2, the highest power of a.
    rtol : error per step, relative for an order larger than 1, absolute else. At τ=120 it has become up to 100 rtol
        (φ of RT).

    Raises
    ------
    ValueError
        For an order below 2, a time or a contact that is none, or the law "potential".

    Source: the equations of `analysis.lattice` (equ, eqv, eqphi of the paper).
    """
    if order < 2:
        raise ValueError(f"order = {order} must be at least 2")
    contact = lattice.contact(poisson_ratio, **effects)
    if contact.law == "potential":
        raise ValueError("law = 'potential' has no hierarchy here; 'secant' and 'incremental' do")
    points = 2 * order + 1
    neighbours = lattice.torus_neighbours(mode.wavenumber, points, mode.direction)
    amplitude = Series.variable(order)
    start = lattice.initial_state(mode, amplitude, lattice.torus_phases(points), contact, neighbours)

    def derivative(coefficients: Floats) -> Floats:
        return np.asarray(lattice.rhs(coefficients.view(Series), contact, neighbours))

    states = lattice.integrate(derivative, np.asarray(start), tau, rtol, scale=1.0)
    return np.moveaxis(states[:, :3, :, 1:], -1, 0)


def hierarchy(
    mode: Mode,
    amplitude: float,
    tau: ArrayLike,
    poisson_ratio: float,
    *,
    order: int = 6,
    row: float = 0,
    phase: float = 0.0,
    rtol: float = 1e-10,
    **effects: Unpack[lattice.Effects],
) -> tuple[Floats, Floats, Floats]:
    """Displacements p, q, φ (T,) of one sphere to order n in units of D0: Σ aᵏ⁻¹ yk, where ϑ = ξ·row + phase at τ=0.

    row is as in `lattice.torus`, amplitude a = D0/Δ0; the other arguments are those of `hierarchy_orders`, which serves
    all amplitudes, rows and phases at once. For TR and RT along y, orders 2 and 3 differ in q and φ only, orders 3 and
    4 in p only.
    """
    orders = hierarchy_orders(mode, tau, poisson_ratio, order=order, rtol=rtol, **effects)
    points = orders.shape[-1]
    weights = lattice.periodic_kernel(mode.wavenumber * row + phase - lattice.torus_phases(points), points)
    p, q, phi = np.tensordot(amplitude ** np.arange(order), orders @ weights, axes=1).T
    return p, q, phi
