"""The paper's lattice with its full contact laws, integrated in time: the witness that knows no perturbation theory.

Displacements are in units of Δ0, with p along the wave, q = −u, φ = Rθ. A row is bound to the next by two contacts,
right (R, upper sign) and left (L), with dp = p₊−p, dq = q₊−q, σ = φ₊+φ, D X = X_n − X_{n−1}, S X = X_n + X_{n−1}:

    stretch x = (√3 dp ∓ dq)/2          normal force  N = (2/3)(1 − (1−x)₊^{3/2})     [springN; in units of k1Δ0]
    slip    t = (√3/2)dq ± dp/2 − σ     shear force   S = κ t (1−x)₊^{1/2}            [springS]

    p''  = C D[(√3/2)(N_R + N_L) + (S_R − S_L)/2]
    q''  = C D[−(N_R − N_L)/2 + (√3/2)(S_R + S_L)]                                   C = 1/(2(κ+3))
    Ĩφ'' = C{S[S_R + S_L] − 4κφ}                 (the last term: the two neighbours in the same row)

These are equ, eqv, eqphi of the paper for plane waves along y. The paper prints √(3/2) for the factor √3/2 and
v6 − v6 for v6 − v0 in δ_6,S.

Three departures can be asked for. `incremental`: the shear force grows with the slip, dS = κ(1−x)₊^{1/2} dt, and does
not follow later changes of the overlap (LAMMPS mindlin/force). `potential`: the shear energy ½κt²(1−x)₊^{1/2} also acts
on the normal force, N → N − ¼κt²(1−x)^{−1/2} while the contact is closed, which makes the lattice conservative.
`overlap_ratio` η = Δ0/2R > 0: contacts have their true direction and length, as in LAMMPS. Slip is then no function of
the configuration (so it has no `potential`) and is integrated as a state,

    dt/dτ = (tangent of now)·(relative velocity) − (φ'₊ + φ'),     torque = S·[1 − η(1−x)₊]     (lever arm R − δ/2)

Its start is what one force-free step from equilibrium leaves in LAMMPS: the displacement along the final tangent.

And the physics a scene calls for (`Effects`). `prestress`: adhesion holds the lattice at 0, compression at 1; the
contacts at rest push with F0 = (2/3)·prestress, N → N − F0, which cancels unless the normals turn (η > 0). `shear`,
`rotation`: without, S = 0; φ = 0, whose Ĩ is infinite, but as a number that would make 0·∞ of Ĩφ'². `viscosity` c (in
m/t0, t0 the unit of τ): every closed contact, also that within the row, has a dashpot along its normal and, if it
resists shear, one along its tangent, N → N + 2(κ+3)c dx/dτ and S → S + 2(κ+3)c dt/dτ (LAMMPS damping velocity).
`restitution`: the same with c ∝ (1−x)^{1/4} (LAMMPS damping coeff_restitution; see `damping`).

Breaks when contacts open for long: the paper's law keeps the adhesive force at any distance (with prestress = 1 there
is none), and shear springs are kept, a slip or under `incremental` a force, where LAMMPS forgets them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypedDict, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from analysis.damping import restitution_viscosity
from analysis.second_harmonic import SOLID_SPHERE, Mode

Floats = NDArray[np.float64]
Law = Literal["secant", "incremental", "potential"]
Neighbours = tuple[Callable[[Floats], Floats], Callable[[Floats], Floats]]  # (…, K) → values of row n+1; of row n−1

SIDE = np.array([[1.0], [-1.0]])  # right, left contact
NORMAL = (np.sqrt(3) / 2, -SIDE / 2)  # (p, q) components at equilibrium


class Effects(TypedDict, total=False):
    """Arguments of `contact` beyond ν, which every function that integrates a wave takes and hands on."""

    law: Law
    overlap_ratio: float
    inertia: float
    prestress: float
    shear: bool
    rotation: bool
    viscosity: float
    restitution: float | None


@dataclass(frozen=True)
class Contact:
    """What rules a contact, by the terms of this module: made and checked by `contact`.

    kappa is the spheres' own κ, which sets the unit of τ; a contact without shear has none of its force. viscosity is
    that at rest, in m/t0; hertzian says whether it varies as (1−x)^{1/4}.
    """

    kappa: float
    inertia: float
    law: Law
    overlap_ratio: float
    prestress: float
    shear: bool
    rotation: bool
    viscosity: float
    hertzian: bool

    @property
    def shear_stiffness(self) -> float:
        """κ of the contacts at rest; 0 without shear."""
        return self.kappa if self.shear else 0.0

    @property
    def incremental(self) -> bool:
        """Whether the shear force itself is the state, not the slip."""
        return self.law == "incremental"

    @property
    def has_history(self) -> bool:
        """Whether the shear of a contact is a state of its own rather than a function of the displacements."""
        return self.shear and (self.incremental or self.overlap_ratio > 0)


def contact(
    poisson_ratio: float,
    *,
    law: Law = "secant",
    overlap_ratio: float = 0.0,
    inertia: float = SOLID_SPHERE,
    prestress: float = 0.0,
    shear: bool = True,
    rotation: bool = True,
    viscosity: float = 0.0,
    restitution: float | None = None,
) -> Contact:
    """Hertz–Mindlin contact, κ = 2(1−ν)/(2−ν), with the physics named at the top of this module.

    Raises ValueError for a law, ν, η, inertia, prestress, viscosity or restitution that is none, and for laws that do
    not go together: `potential` with η > 0, `restitution` with `viscosity` or with adhesion (LAMMPS refuses it too).
    """
    if law not in get_args(Law):
        raise ValueError(f"law = {law!r} is none of {get_args(Law)}")
    if not -1.0 <= poisson_ratio <= 0.5:
        raise ValueError(f"poisson_ratio = {poisson_ratio} is outside [-1, 0.5]")
    if not 0.0 <= overlap_ratio <= 0.1:
        raise ValueError(f"overlap_ratio = {overlap_ratio} is outside [0, 0.1]")
    if law == "potential" and overlap_ratio > 0:
        raise ValueError(f"law = 'potential' needs overlap_ratio = 0, not {overlap_ratio}: slip has a history")
    if not 0.0 < inertia < np.inf:
        raise ValueError(f"inertia = {inertia} must be positive and finite")
    if not 0.0 <= prestress <= 1.0:
        raise ValueError(f"prestress = {prestress} is outside [0, 1]")
    if not 0.0 <= viscosity < np.inf:
        raise ValueError(f"viscosity = {viscosity} must be finite and not negative")
    kappa = 2 * (1 - poisson_ratio) / (2 - poisson_ratio)
    if restitution is not None:
        if viscosity:
            raise ValueError(f"restitution = {restitution} and viscosity = {viscosity}: a contact has one dashpot")
        if prestress != 1:
            raise ValueError(f"restitution = {restitution} needs prestress = 1, not {prestress}: it knows no adhesion")
        viscosity = restitution_viscosity(restitution, kappa)
    return Contact(
        kappa, inertia, law, overlap_ratio, prestress, shear, rotation, viscosity, hertzian=restitution is not None
    )


def stretch_and_normal(dp: Floats, dq: Floats, overlap_ratio: float) -> tuple[Floats, Floats | float, Floats]:
    """Elongation x (2, K) of the right and left contacts to the next row, and the (p, q) components of their normals.

    With η > 0 the vector between centres is r = ℓ n0 + (dp, dq), ℓ = 1/η − 1, and x = |r| − ℓ.
    """
    along = NORMAL[0] * dp + NORMAL[1] * dq
    if overlap_ratio == 0:
        return along, *NORMAL
    length = 1 / overlap_ratio - 1
    r_p, r_q = length * NORMAL[0] + dp, length * NORMAL[1] + dq
    distance = np.hypot(r_p, r_q)
    # |r| − ℓ itself would lose the four digits by which ℓ exceeds x.
    stretch = (2 * length * along + dp**2 + dq**2) / (distance + length)
    return stretch, r_p / distance, r_q / distance


def slip(n_p: Floats | float, n_q: Floats, ahead: Floats, here: Floats) -> Floats:
    """Tangential displacement (2, K) of the contacts from p, q, φ (3, K) of two rows, or its rate from p', q', φ'."""
    return n_p * (ahead[1] - here[1]) - n_q * (ahead[0] - here[0]) - (ahead[2] + here[2])


def rhs(state: Floats, contact: Contact, neighbours: Neighbours) -> Floats:
    """Time derivative of the state: the equations of motion at the top of this module.

    Parameters
    ----------
    state : (6, K): p, q, φ, p', q', φ' of K rows, displacements in Δ0; (8, K) for a contact with history, whose last
        two are the slip t (secant) or shear force S (incremental, in k1Δ0) of the right and left contacts to row n+1.
    contact : the contact's constants.
    neighbours : two functions, values → values one row on, and one row back.
    """
    after, before = neighbours
    dashpot = 2 * (contact.kappa + 3) * contact.viscosity
    # Velocities are asked for only where they matter: where slip is a state, and where there is damping.
    moving = state[: 6 if contact.has_history or contact.viscosity else 3]
    here, ahead = moving, after(moving)
    dp, dq = ahead[:2] - here[:2]
    x, n_p, n_q = stretch_and_normal(dp, dq, contact.overlap_ratio)
    overlap = np.maximum(1 - x, 0)
    root = np.sqrt(overlap)
    normal = (1 - contact.prestress - overlap * root) / 1.5

    rate = np.empty_like(state)
    stiffness = contact.shear_stiffness * root
    if contact.has_history:
        slip_rate = slip(n_p, n_q, ahead[3:], here[3:])
        rate[6:] = stiffness * slip_rate if contact.incremental else slip_rate
        shear = state[6:] if contact.incremental else stiffness * state[6:]
    else:
        tangential = slip(n_p, n_q, ahead[:3], here[:3])
        shear = stiffness * tangential
        if contact.law == "potential":
            normal -= np.divide(shear * tangential, 4 * overlap, out=np.zeros_like(overlap), where=overlap > 0)
    turning = contact.shear_stiffness * state[2]  # the slip −2φ of the contacts within the row, over −2
    if contact.viscosity:
        closed = np.sqrt(root) if contact.hertzian else np.sign(overlap)
        p_rate, q_rate = ahead[3:5] - here[3:5]
        normal = normal + dashpot * closed * (n_p * p_rate + n_q * q_rate)
        if contact.shear:
            shear = shear + dashpot * closed * slip(n_p, n_q, ahead[3:], here[3:])
            turning = turning + dashpot * state[5]

    eta = contact.overlap_ratio
    force = np.stack(
        [
            (n_p * normal - n_q * shear).sum(axis=0),
            (n_q * normal + n_p * shear).sum(axis=0),
            ((1 - eta * overlap) * shear).sum(axis=0),
        ]
    )
    behind = before(force)
    rate[:3] = state[3:6]
    rate[3:5] = force[:2] - behind[:2]
    rate[5] = (force[2] + behind[2] - 4 * (1 - eta) * turning) / contact.inertia if contact.rotation else 0.0
    rate[3:6] /= 2 * (contact.kappa + 3)
    return rate


def initial_state(
    mode: Mode, amplitude: float | Floats, phases: Floats, contact: Contact, neighbours: Neighbours
) -> Floats:
    """State of a mode of amplitude D0/Δ0 at τ=0, ϑ = phases (K,) [ICqTR, ICrTR, IC], with the shear of the contacts."""
    cos, sin = np.cos(phases), np.sin(phases)
    omega = mode.frequency
    moving = np.stack(
        [mode.p * cos, mode.q * cos, -mode.f * sin, mode.p * omega * sin, mode.q * omega * sin, mode.f * omega * cos]
    )
    return with_shear(amplitude * moving, contact, neighbours)


def with_shear(moving: Floats, contact: Contact, neighbours: Neighbours) -> Floats:
    """The state (6, K), with the rows of the contacts' shear appended where the contact has a history."""
    if not contact.has_history:
        return moving
    here, ahead = moving[:3], neighbours[0](moving[:3])
    dp, dq = ahead[:2] - here[:2]
    x, n_p, n_q = stretch_and_normal(dp, dq, contact.overlap_ratio)
    start = slip(n_p, n_q, ahead, here)
    if contact.incremental:
        start *= contact.shear_stiffness * np.sqrt(np.maximum(1 - x, 0))
    return np.concatenate([moving, start])


def integrate(
    derivative: Callable[[Floats], Floats], start: Floats, tau: ArrayLike, rtol: float, scale: float
) -> Floats:
    """States (T, …) of y' = derivative(y) from y(0) = start at the times tau, by DOP853 with errors of rtol·scale.

    Raises ValueError unless tau is one-dimensional, ascending and not negative, RuntimeError if the integration fails.
    """
    tau = np.asarray(tau, dtype=float)
    if tau.ndim != 1 or tau.size == 0 or tau[0] < 0 or np.any(np.diff(tau) <= 0):
        raise ValueError("tau must be one-dimensional, not empty, not negative and ascending")
    solution = solve_ivp(
        lambda _, y: derivative(y.reshape(start.shape)).ravel(),
        (0.0, tau[-1]),
        start.ravel(),
        method="DOP853",
        t_eval=tau,
        rtol=rtol,
        atol=rtol * scale,
    )
    if not solution.success:
        raise RuntimeError(f"integration of the lattice failed: {solution.message}")
    return solution.y.T.reshape(-1, *start.shape)


def periodic_kernel(angle: Floats, points: int) -> Floats:
    """Weight with which a sample at distance `angle` enters the trigonometric interpolation through K odd points.

    sin(Kα/2)/(K sin(α/2)), the Dirichlet kernel, summed as cosines to be regular at α=0.
    """
    orders = np.arange(1, (points + 1) // 2)
    return (1 + 2 * np.cos(np.multiply.outer(angle, orders)).sum(axis=-1)) / points


def torus_phases(points: int) -> Floats:
    """K equidistant phases on [0, 2π); ValueError unless K is odd (only then is a shift invertible) and at least 5."""
    if points < 5 or points % 2 == 0:
        raise ValueError(f"points = {points} must be odd and at least 5")
    return 2 * np.pi * np.arange(points) / points


def torus_neighbours(wavenumber: float, points: int) -> Neighbours:
    """On the phase torus the next row is a shift of the phase by ξ: two K×K matrices, each the other's transpose."""
    phases = torus_phases(points)
    shift = periodic_kernel(phases[:, None] + wavenumber - phases, points)
    back = np.ascontiguousarray(shift.T)
    return (lambda values: values @ back), (lambda values: values @ shift)


def ring_neighbours() -> Neighbours:
    """Rows on a ring: the exact infinite lattice for waves with ξN a multiple of 2π."""
    return (lambda values: np.roll(values, -1, axis=-1)), (lambda values: np.roll(values, 1, axis=-1))


def torus_trajectory(
    mode: Mode,
    amplitude: float,
    tau: ArrayLike,
    poisson_ratio: float,
    *,
    points: int = 31,
    rtol: float = 1e-11,
    **effects: Unpack[Effects],
) -> Floats:
    """P, Q, Φ in units of D0 on the phase torus, (T, 3, K): the wave in the infinite lattice, for any ξ.

    A wave p_n(τ) = P(ξn + phase, τ) with P 2π-periodic in its first argument obeys the equations of the lattice with
    "next row" = a shift of that argument by ξ. One period of K points thus holds every row and every phase at once:
    no boundaries, and ξ need not be commensurate.

    Parameters
    ----------
    mode : the wave at τ=0, of `analysis.second_harmonic.mode`, made from ratios with the same effects.
    amplitude : a = D0/Δ0.
    tau : (T,) ascending times.
    poisson_ratio, effects : as in `contact`; inertia is the sphere's, without the factor of η.
    points : K, odd. At a = 0.2, τ ≤ 120, K=31 agrees with K=61 to 1e-12; K=21 does to 5e-9 (L at ξ=2), K=15 to 2e-6.
    rtol : error per step of the integration; at a = 0.2, τ=120 the error of φ, the largest, is about 50 rtol.

    Breaks once the wave steepens so that harmonic (K−1)/2 carries weight.
    """
    laws = contact(poisson_ratio, **effects)
    neighbours = torus_neighbours(mode.wavenumber, points)
    start = initial_state(mode, amplitude, torus_phases(points), laws, neighbours)
    states = integrate(lambda state: rhs(state, laws, neighbours), start, tau, rtol, amplitude)
    return states[:, :3] / amplitude


def torus(
    mode: Mode,
    amplitude: float,
    tau: ArrayLike,
    poisson_ratio: float,
    *,
    row: float = 0,
    phase: float = 0.0,
    points: int = 31,
    rtol: float = 1e-11,
    **effects: Unpack[Effects],
) -> tuple[Floats, Floats, Floats]:
    """Displacements p, q, φ (T,) of one row in units of D0, where ϑ = ξ·row + phase at τ=0. See `torus_trajectory`."""
    trajectory = torus_trajectory(mode, amplitude, tau, poisson_ratio, points=points, rtol=rtol, **effects)
    weights = periodic_kernel(mode.wavenumber * row + phase - torus_phases(points), points)
    p, q, phi = (trajectory @ weights).T
    return p, q, phi


def rows(
    mode: Mode,
    amplitude: float,
    tau: ArrayLike,
    poisson_ratio: float,
    *,
    rows: int = 201,
    phase: float = 0.0,
    rtol: float = 1e-11,
) -> tuple[Floats, Floats, Floats]:
    """Displacements p, q, φ (T,) of the centre row, (rows−1)//2 counted from 0, in units of D0: the paper's set-up.

    The first and last row are held at zero, so they are one and the same row of a ring of rows−1.

    Breaks when the walls are heard: the fastest wave, long L, covers half a row per τ. In 201 rows the centre departs
    from the infinite lattice by 1e-7 at τ=175 and by order 1 of the walls' signal at τ=200.
    """
    if rows < 5:
        raise ValueError(f"rows = {rows} must be at least 5")
    laws, neighbours = contact(poisson_ratio), ring_neighbours()
    centre = (rows - 1) // 2
    phases = mode.wavenumber * np.arange(-centre, rows - 1 - centre, dtype=np.float64) + phase
    start = initial_state(mode, amplitude, phases, laws, neighbours)
    start[:, 0] = 0.0

    def held(state: Floats) -> Floats:
        rate = rhs(state, laws, neighbours)
        rate[:, 0] = 0.0
        return rate

    p, q, phi = (integrate(held, start, tau, rtol, amplitude)[:, :3, centre] / amplitude).T
    return p, q, phi
