"""The equations of Wallen and Boechler twice: derived from contact law and geometry, and as the paper prints them.

The derived side starts from six unit vectors and the two contact laws; forces follow from virtual work.
The printed side is a transcript. `tests/validation/test_errata.py` lays one beside the other.

Source: S. P. Wallen and N. Boechler, "Shear to longitudinal mode conversion via second harmonic generation in a
two-dimensional microscale granular crystal". Labels in backquotes are the equation labels of its LaTeX source.
"""

from dataclasses import dataclass

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Row = tuple[sp.Expr, sp.Expr, sp.Expr]

A, B, R, mass, D0, Delta0 = sp.symbols("A B R m D0 Delta0", positive=True)
k1, g1, kappa, inertia = sp.symbols("k1 g1 kappa Itilde", positive=True)
k0, k2, g2, dN, dS = sp.symbols("k0 k2 g2 delta_N delta_S", real=True)
u0, v0, th0, ul, vl, thl = sp.symbols("u0 v0 theta0 u_l v_l theta_l", real=True)
p, q, f = ({row: sp.Symbol(f"{name}_{row}", real=True) for row in (-1, 0, 1)} for name in ("p", "q", "phi"))
UNKNOWNS = (*p.values(), *q.values(), *f.values())

# The contacts of Fig. 1 in degrees from x; the wave runs along y, so 1 and 6 lie one row ahead, 3 and 4 one row behind.
CONTACT_ANGLES = {1: 60, 2: 0, 3: -60, 4: -120, 5: 180, 6: 120}
ROW_OF_CONTACT = {1: 1, 2: 0, 3: -1, 4: -1, 5: 0, 6: 1}

# The springs to second order; `test_taylor_coefficients` derives the five constants from `contact_forces`.
SPRINGS = (k0 + k1 * dN + k2 * dN**2, g1 * dS + g2 * dS * dN)
SPRING_CONSTANTS = {
    k0: -A * Delta0 ** sp.Rational(3, 2),
    k1: sp.Rational(3, 2) * A * sp.sqrt(Delta0),
    k2: -sp.Rational(3, 8) * A / sp.sqrt(Delta0),
    g1: B * sp.sqrt(Delta0),
    g2: -B / (2 * sp.sqrt(Delta0)),
}

# ---------------------------------------------------------------- derived from geometry and contact law


def normal_and_tangent(label: int) -> tuple[tuple[sp.Expr, sp.Expr], tuple[sp.Expr, sp.Expr]]:
    """Unit normal n from particle 0 to particle `label`, and t = n turned by +90°."""
    angle = sp.pi * CONTACT_ANGLES[label] / 180
    return (sp.cos(angle), sp.sin(angle)), (-sp.sin(angle), sp.cos(angle))


def separation(label: int) -> tuple[sp.Expr, sp.Expr]:
    """δ_N = n·(u_l−u_0) and δ_S = t·(u_l−u_0) − R(θ_l+θ_0): what the two surfaces do at the contact."""
    normal, tangent = normal_and_tangent(label)
    return (
        normal[0] * (ul - u0) + normal[1] * (vl - v0),
        tangent[0] * (ul - u0) + tangent[1] * (vl - v0) - R * (thl + th0),
    )


def force_weights(label: int) -> tuple[tuple[sp.Expr, sp.Expr], ...]:
    """Weights of (f_N, f_S) in the equations of u, v, θ: −∂(δ_N, δ_S)/∂(u_0, v_0, θ_0), by virtual work."""
    return tuple((-sp.diff(separation(label)[0], x), -sp.diff(separation(label)[1], x)) for x in (u0, v0, th0))


def contact_forces() -> tuple[sp.Expr, sp.Expr]:
    """f_N = −A(Δ0−δ_N)^{3/2} and f_S = B δ_S (Δ0−δ_N)^{1/2} of a closed contact (`springN`, `springS`)."""
    return -A * (Delta0 - dN) ** sp.Rational(3, 2), B * dS * sp.sqrt(Delta0 - dN)


def quadratic_forces() -> tuple[sp.Expr, sp.Expr]:
    """Taylor polynomial of degree two of both forces in (δ_N, δ_S), with the constant of f_N kept."""
    scale = sp.Symbol("scale", positive=True)

    def truncate(force: sp.Expr) -> sp.Expr:
        scaled = force.subs({dN: scale * dN, dS: scale * dS}, simultaneous=True)
        return sum(sp.diff(scaled, scale, order).subs(scale, 0) / sp.factorial(order) for order in range(3))

    normal, shear = contact_forces()
    return truncate(normal), truncate(shear)


def derived_rows(time_scale_squared: sp.Expr) -> Row:
    """p'', q'', Ĩφ'' of row n to second order, from the six contacts, for v=D0 p, u=−D0 q, Rθ=D0 φ, t=t0 τ."""
    force_u, force_v, torque = sp.Integer(0), sp.Integer(0), sp.Integer(0)
    for label, row in ROW_OF_CONTACT.items():
        move = {u0: -D0 * q[0], v0: D0 * p[0], th0: D0 * f[0] / R}
        move |= {ul: -D0 * q[row], vl: D0 * p[row], thl: D0 * f[row] / R}
        moved = dict(zip((dN, dS), (x.subs(move, simultaneous=True) for x in separation(label)), strict=True))
        springs = sp.Matrix([spring.subs(moved, simultaneous=True) for spring in SPRINGS])
        on_u, on_v, on_theta = (sp.Matrix([weights]).dot(springs) for weights in force_weights(label))
        force_u, force_v, torque = force_u + on_u, force_v + on_v, torque + on_theta
    unit = time_scale_squared / (mass * D0)
    return sp.expand(unit * force_v), sp.expand(-unit * force_u), sp.expand(unit * torque / R)


# ---------------------------------------------------------------- as printed

HALF, ROOT3 = sp.Rational(1, 2), sp.sqrt(3)


def printed_weights(factor: sp.Expr) -> dict[int, tuple[tuple[sp.Expr, sp.Expr], tuple[sp.Expr, sp.Expr]]]:
    """Weights of (f_N, f_S) of each contact in `equ` and `eqv`, with `factor` where the paper prints √(3/2)."""
    zero, one, c = sp.Integer(0), sp.Integer(1), factor
    return {
        1: ((HALF, -c), (c, HALF)),
        2: ((one, zero), (zero, one)),
        3: ((HALF, c), (-c, HALF)),
        4: ((-HALF, c), (-c, -HALF)),
        5: ((-one, zero), (zero, -one)),
        6: ((-HALF, -c), (c, -HALF)),
    }


_du, _dv, _roll = ul - u0, vl - v0, R * (thl + th0)
PRINTED_SEPARATIONS: dict[int, tuple[sp.Expr, sp.Expr]] = {
    1: (_du / 2 + ROOT3 * _dv / 2, -ROOT3 * _du / 2 + _dv / 2 - _roll),
    2: (_du, _dv - _roll),
    3: (_du / 2 - ROOT3 * _dv / 2, ROOT3 * _du / 2 + _dv / 2 - _roll),
    4: (-_du / 2 - ROOT3 * _dv / 2, ROOT3 * _du / 2 - _dv / 2 - _roll),
    5: (-_du, -_dv - _roll),
    6: (-_du / 2 + ROOT3 * _dv / 2, -ROOT3 * _du / 2 - (vl - vl) / 2 - _roll),
}


@dataclass(frozen=True)
class Coefficients:
    """The numbers of `eqp`, `eqq`, `eqr` that are in question: t0², ε, and three factors of the quadratic terms."""

    time_scale_squared: sp.Expr
    epsilon: sp.Expr
    p_alpha: sp.Expr
    p_beta: sp.Expr
    q_beta: sp.Expr


_ratio = D0 * (g2 + 3 * k2) / (g1 + 3 * k1)
# `q_beta` is right in `eqq`; its printed value here is that of `eqQ1TR`.
PRINTED = Coefficients(
    2 * mass / (g1 + 3 * k1), 3 * _ratio / 2, p_alpha=sp.Rational(1, 6), p_beta=1 / (3 * ROOT3), q_beta=ROOT3 / 2
)
CORRECT = Coefficients(
    mass / (2 * (g1 + 3 * k1)), ROOT3 * _ratio, p_alpha=sp.Rational(1, 8), p_beta=1 / (4 * ROOT3), q_beta=ROOT3
)

MU1, MU2 = (3 * g1 + k1) / (g1 + 3 * k1), g1 / (g1 + 3 * k1)
ALPHA, BETA, GAMMA = (x / (g2 + 3 * k2) for x in (g2 - k2, g2, g2 + k2))
# k1, g1, k2, g2 as `springN` and `springS` give them, in units where k1 = Δ0 = 1.
HERTZ_MINDLIN = {k1: 1, g1: kappa, k2: -sp.Rational(1, 4), g2: -kappa / 2, mass: 1}


def _product(x: dict[int, sp.Symbol], y: dict[int, sp.Symbol]) -> dict[int, sp.Expr]:
    return {j: x[j] * y[j] for j in x}


def _diff(x: dict[int, sp.Expr]) -> sp.Expr:
    return x[1] - x[-1]


def _diff2(x: dict[int, sp.Expr]) -> sp.Expr:
    return x[1] - 2 * x[0] + x[-1]


def _sum(x: dict[int, sp.Expr]) -> sp.Expr:
    return x[1] + x[-1]


def _sum2(x: dict[int, sp.Expr]) -> sp.Expr:
    return x[1] + 2 * x[0] + x[-1]


def paper_rows(c: Coefficients) -> Row:
    """Right-hand sides of `eqp`, `eqq` and Ĩ·`eqr`, operator by operator as the paper writes them, with factors `c`."""
    along = _diff2(p) / 4 + c.epsilon * (
        _diff2(p) * _diff(p) / 8
        - c.p_alpha * ALPHA * _diff2(q) * _diff(q)
        + c.p_beta * BETA * (f[0] * _diff2(q) - q[0] * _sum(f) + _sum(_product(q, f)))
    )
    across = (
        MU1 / 4 * _diff2(q)
        - ROOT3 * MU2 / 2 * _diff(f)
        - c.epsilon
        / 4
        * (
            GAMMA * (p[0] * _diff(q) + q[0] * _diff(p) - _diff(_product(q, p)))
            + c.q_beta * BETA * (-p[0] * _sum2(f) + f[0] * _sum(p) + _sum(_product(f, p)))
        )
    )
    turning = MU2 / 2 * (-2 * (_sum2(f) + 2 * f[0]) + ROOT3 * _diff(q)) + c.epsilon * BETA / 2 * (
        (-q[0] * _diff2(p) - p[0] * _sum(q) + _sum(_product(q, p))) / ROOT3
        + (p[0] * _diff(f) - f[0] * _diff(p) - _diff(_product(f, p)))
    )
    return along, across, turning


# ---------------------------------------------------------------- numbers


def stiffness_ratio(poisson_ratio: float | Array) -> float | Array:
    """κ = g1/k1 = 2(1−ν)/(2−ν) of a Hertz–Mindlin contact of equal spheres."""
    return 2 * (1 - poisson_ratio) / (2 - poisson_ratio)


def transverse_branches(wavenumber: float | Array, ratio: float | Array, inertia: float = 0.4) -> tuple[Array, Array]:
    """Ω of TR and RT: the two roots x=Ω² of (A−x)(b−Ĩx) = 3μ2²sin²ξ (`TRdisp`)."""
    mu1, mu2 = (3 * ratio + 1) / (ratio + 3), ratio / (ratio + 3)
    a = mu1 * (1 - np.cos(wavenumber)) / 2
    b = 2 * mu2 * (2 + np.cos(wavenumber)) / inertia
    half_sum, split = (a + b) / 2, np.hypot((a - b) / 2, np.sqrt(3 / inertia) * mu2 * np.sin(wavenumber))
    upper = half_sum + split
    # The product of the roots instead of half_sum − split: no cancellation at small ξ.
    lower = (a * b - 3 * (mu2 * np.sin(wavenumber)) ** 2 / inertia) / upper
    return np.sqrt(lower), np.sqrt(upper)


def transverse_shape(wavenumber: float, ratio: float, frequency: float, inertia: float = 0.4) -> tuple[float, float]:
    """(Q, f) of Q̃=Q>0, Φ̃=i f with |Q̃|²+|Φ̃|²=1, from the second row of M."""
    mu2 = ratio / (ratio + 3)
    slope = np.sqrt(3) * mu2 * np.sin(wavenumber) / (2 * mu2 * (2 + np.cos(wavenumber)) - inertia * frequency**2)
    return float(1 / np.hypot(1, slope)), float(slope / np.hypot(1, slope))


_NX, _NY = (of(np.deg2rad([*CONTACT_ANGLES.values()]))[:, None] for of in (np.cos, np.sin))  # (6, 1) each


def exact_acceleration(
    ahead: Array, here: Array, behind: Array, amplitude: float, ratio: float, inertia: float = 0.4
) -> Array:
    """(p'', q'', φ'') from the exact contact laws, contact by contact, with opening at zero overlap.

    `ahead`, `here`, `behind` hold (p, q, φ), shape (3, K), in units of D0; `amplitude` is D0/Δ0.
    """
    rows = {1: ahead, 0: here, -1: behind}
    # One contact to a line: (6, K)
    along, across, turned = np.stack([rows[row] for row in ROW_OF_CONTACT.values()], axis=1)
    along, across = along - here[0], here[1] - across
    overlap = np.maximum(1 - amplitude * (_NX * across + _NY * along), 0)
    # Less the static force 2/(3a): it cancels between opposite contacts, its round-off would not.
    normal = -2 / (3 * amplitude) * (overlap**1.5 - 1)
    shear = ratio * (-_NY * across + _NX * along - turned - here[2]) * np.sqrt(overlap)
    force_u, force_v = (_NX * normal - _NY * shear).sum(axis=0), (_NY * normal + _NX * shear).sum(axis=0)
    torque = shear.sum(axis=0)
    return np.array([force_v, -force_u, torque / inertia]) / (2 * (ratio + 3))


def integrate_wave(
    wavenumber: float, ratio: float, amplitude: float, times: Array, points: int = 31, tolerance: float = 1e-9
) -> Array:
    """p, q, φ of a TR wave in the infinite exact lattice, shape (len(times), 3, points), on one period of phase.

    A wave p_n(τ)=P(ξn, τ) has the next row at the phase ξ further on: a spectral shift of the `points` samples.
    A step of the integrator may be off by `tolerance` of the state.
    When it breaks: harmonics above points/2 alias.
    """
    frequency = float(transverse_branches(wavenumber, ratio)[0])
    shape_q, shape_f = transverse_shape(wavenumber, ratio, frequency)
    phase = 2 * np.pi * np.arange(points) / points
    order = np.fft.fftfreq(points, 1 / points)
    shift = np.real(np.fft.ifft(np.exp(1j * order * wavenumber)[:, None] * np.fft.fft(np.eye(points), axis=0), axis=0))
    still = np.zeros(points)
    start = np.array([still, shape_q * np.cos(phase), -shape_f * np.sin(phase)])
    speed = np.array([still, frequency * shape_q * np.sin(phase), frequency * shape_f * np.cos(phase)])

    def rate(_time: float, state: Array) -> Array:
        place, pace = state.reshape(2, 3, points)
        force = exact_acceleration(place @ shift.T, place, place @ shift, amplitude, ratio)
        return np.concatenate([pace, force], axis=None)

    start_state = np.concatenate([start, speed], axis=None)
    bounds = {"rtol": tolerance, "atol": tolerance / 100}
    solution = solve_ivp(rate, (0, times[-1]), start_state, method="DOP853", t_eval=times, **bounds)
    return solution.y.T.reshape(len(times), 2, 3, points)[:, 0]
