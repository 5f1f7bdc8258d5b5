"""A driven row: the waves that it sends into a crystal at rest, with their second harmonic over the distance.

Row 0 of a strip along y is moved by force, all its spheres alike and none of them turning (lengths in D0):

    L:       p_0 = r(τ) cos(Ωτ − phase),  q_0 = φ_0 = 0
    TR, RT:  q_0 = r(τ) cos(Ωτ − phase),  p_0 = φ_0 = 0,        Ω that of the mode at ξ

r rises once, from 0 to 1. Behind the front, in a strip without end, is a steady state: fields Re[X_n e^{−iΩτ}].

**Linear.** X_n = Σ_m X_m e^{iκ_m n} over the waves of frequency Ω that leave the row: group velocity > 0, or Im κ > 0.
L is one, e^{iξn}. Of TR and RT there are two at each frequency, since with x = Ω², C = cos κ the dispersion relation

    [2μ2(2+C) − Ĩx][μ1(1−C)/2 − x] = 3μ2²(1−C²)

is quadratic in C. One is ±ξ: −ξ where Ω falls with ξ, as on all of RT of solid spheres, whose crests run *towards*
the row. The other decays within a row or two (κ = π + 2.2i for TR of solid spheres); with Ĩ ≥ 1.5 it can run too. What
each gets follows from q_0 = 1, φ_0 = 0.

**Second order.** With dX = X_{n+1} − X_n, σ = φ_{n+1} + φ_n of the linear waves, the force of each bond at 2Ω is

    B_ab = (ε/16) [longitudinal dp_a dp_b − α dq_a dq_b + (β/√3)(σ_a dq_b + dq_a σ_b)]     for each pair of waves a, b,

and the wave it forces, K = κ_a + κ_b, starts with a free L wave k2 that cancels it at row 0, whose motion is pure:

    P_n = (1 − e^{−iK}) B_ab [e^{iKn} − e^{ik2 n}]/(speed² sin²(K/2) − 4Ω²),    speed sin(k2/2) = 2Ω

Both beat over 2π/|2κ_1 − k2| rows, and P_n grows as n where K = k2 (TR at the resonance). Above the cutoff, 2Ω > speed,
k2 = π + i·(…) stays at the row and |P_n| soon is constant. The same bonds push steadily too: see `static`.

When it breaks: where |P| or a²n is not small, the latter as the wave number shifts by an amount of order a². Measured
relative errors fall as a² down to a floor from switching on: the ramp also excites waves at the edges of the bands,
which have no group velocity and leave slowly. They are linear: the floor does not depend on a, but in the second
harmonic of L, which they meet in the same component, it rises as 1/a. Where the steady waves themselves are slow it is
high: at TR's resonance k2 runs 0.05 rows per τ, and 8 rows are within 2.5 % of their steady 2Ω only at τ = 1900.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.second_harmonic import Mode, Ratios, nonlinearity

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class RowWaves:
    """The linear waves that a driven row sends out.

    Attributes
    ----------
    wavenumbers : (m,) complex
        κ, rad per row.
    shapes : (3, m) complex
        p, q, φ of each at row 0, together 1 in the driven component.
    velocities : (m,)
        Group velocity, rows per τ; 0 of a wave that decays.
    """

    wavenumbers: Complexes
    shapes: Complexes
    velocities: Floats

    @property
    def bonds(self) -> tuple[Complexes, Complexes, Complexes]:
        """dp, dq, σ of the bond from row 0 to row 1, for each wave."""
        onward = np.exp(1j * self.wavenumbers)
        p, q, phi = self.shapes
        return (onward - 1) * p, (onward - 1) * q, (onward + 1) * phi


def linear_waves(mode: Mode, ratios: Ratios) -> RowWaves:
    """The one (L; spheres that do not turn) or two waves with which a row answers at the mode's frequency.

    Raises ValueError where the mode has no group velocity, as at ξ = π: nothing leaves the row.
    """
    if mode.name == "L" or not ratios.rotation:
        component, speed = (0, ratios.speed) if mode.name == "L" else (1, np.sqrt(ratios.mu1))
        velocities = np.array([speed * np.cos(mode.wavenumber / 2) / 2])
        waves = RowWaves(np.array([mode.wavenumber + 0j]), np.eye(3, dtype=complex)[:, [component]], velocities)
    else:
        waves = _two_waves(mode, ratios)
    if waves.velocities[0] < 1e-6:
        raise ValueError(f"{mode.name} at wavenumber = {mode.wavenumber} has no group velocity: nothing leaves the row")
    return waves


def _two_waves(mode: Mode, ratios: Ratios) -> RowWaves:
    mu1, mu2, inertia, x = ratios.mu1, ratios.mu2, ratios.inertia, mode.frequency**2
    own = np.cos(mode.wavenumber)
    # The sum of the roots of the quadratic in C
    total = (2 * mu2 * (mu1 / 2 - x) - mu1 / 2 * (4 * mu2 - inertia * x)) / (mu2 * (mu1 - 3 * mu2))
    C = np.array([own, total - own])
    k = np.arccos(C + 0j)
    k = np.where(k.imag < 0, -k, k)
    A, b = mu1 * (1 - C) / 2 - x, 2 * mu2 * (2 + C) - inertia * x
    # dΩ/dκ = sin κ F_C/(2Ω F_x) of F(C, x) = bA − 3μ2²(1−C²)
    slope = (2 * mu2 * A - b * mu1 / 2 + 6 * mu2**2 * C) / (-inertia * A - b)
    velocity = np.where(np.abs(C) < 1, np.sin(k).real * slope / (2 * mode.frequency), 0.0)
    k = np.where(velocity < 0, -k, k)
    c0 = np.sqrt(3) * mu2 * np.sin(k)
    # A Q = c0 f and b f = c0 Q say the same; where one is 0 = 0, the other is not.
    choices = np.array([b + 0j, 1j * c0]), np.array([c0, 1j * A])
    shapes = np.where(*(np.linalg.norm(choices[0], axis=0) > np.linalg.norm(choices[1], axis=0), *choices))
    shares = np.linalg.solve(shapes, [1, 0])
    return RowWaves(k, np.concatenate([np.zeros((1, 2)), shapes * shares]), np.abs(velocity))


def free_wavenumber(frequency: float, ratios: Ratios) -> complex:
    """k of the L wave of a frequency, speed·sin(k/2) = Ω: in (0, π], or π + 2i·arcosh(Ω/speed) above the cutoff."""
    ratio = frequency / ratios.speed
    return complex(2 * np.arcsin(ratio)) if ratio <= 1 else complex(np.pi, 2 * np.arccosh(ratio))


def beat_length(mode: Mode, ratios: Ratios) -> float:
    """Rows over which the second harmonic rises and falls, 2π/|2κ − k2|: inf on resonance, nan above the cutoff."""
    free = free_wavenumber(2 * mode.frequency, ratios)
    if free.imag:
        return float("nan")
    mismatch = abs(2 * linear_waves(mode, ratios).wavenumbers[0].real - free.real)
    return float(2 * np.pi / mismatch) if mismatch else float("inf")


def slowest(mode: Mode, ratios: Ratios) -> float:
    """Group velocity, rows per τ, of the slowest wave that carries the steady state: fundamental, or free L at 2Ω."""
    free = free_wavenumber(2 * mode.frequency, ratios)
    velocities = linear_waves(mode, ratios).velocities
    own = [] if free.imag else [ratios.speed * np.cos(free.real / 2) / 2]
    return float(min([*velocities[velocities > 0], *own]))


def driven_amplitudes(
    mode: Mode, ratios: Ratios, amplitude: float, rows: ArrayLike, phase: float = 0.0
) -> tuple[Complexes, Complexes]:
    """Complex amplitudes over the rows of the fundamental (p, q, φ), Re[X e^{−iΩτ}], and of p at 2Ω, Re[P e^{−2iΩτ}].

    Parameters
    ----------
    mode : of `second_harmonic.mode`, made from the ratios; its frequency is that of the row.
    ratios : constants of the lattice. With the incremental shear law the result holds too (but see `static`), not with
        the potential law, whose drive is no sum of pairs in α and β.
    amplitude : a = D0/Δ0, D0 the amplitude of the row.
    rows : (N,) whole numbers n ≥ 0.
    phase : rad, of the row.

    Returns
    -------
    (3, N) in D0, and (N,) in D0

    Raises
    ------
    ValueError
        For rows that are no such numbers, and what `linear_waves` raises.

    Source: eqp to eqr of the paper with the boundary at row 0; not in the paper.
    """
    n = _counted(rows)
    waves, free = linear_waves(mode, ratios), free_wavenumber(2 * mode.frequency, ratios)
    fundamental = waves.shapes @ np.exp(1j * np.multiply.outer(waves.wavenumbers, n))
    bonds = waves.bonds
    forces = _bond_force(bonds, bonds, ratios, amplitude)
    second = np.zeros(n.shape, dtype=complex)
    for force, forced in zip(forces.ravel(), np.add.outer(waves.wavenumbers, waves.wavenumbers).ravel(), strict=True):
        # speed² sin²(K/2) − 4Ω² is −(speed²/4)(z − z2)(1 − 1/(z z2)), z = e^{iK}, z2 = e^{ik2}
        z = np.exp(1j * forced)
        second += -4 / ratios.speed**2 * force * (z - 1) / (z - np.exp(-1j * free)) * _beat(complex(forced), free, n)
    return fundamental * np.exp(1j * phase), second * np.exp(2j * phase)


def static(mode: Mode, ratios: Ratios, amplitude: float, rows: ArrayLike) -> Floats:
    """Mean displacement p (N,) in D0 that the waves leave in the rows they have reached; it grows with the distance.

        (c² dp + B)_n = B_∞ v/(c + v),    B_n = Σ_ab B_ab e^{i(κ_a − κ_b*)n},  p_0 = 0,  c = speed/2

    Bonds soften when stretched, so the wave pushes the crystal apart. The mean force in the bonds is uniform behind the
    front, but not zero: the front, which moves at v, pushes a long L wave ahead of itself, and that needs a force. B_∞
    is B of the waves that run, each with its own v. Rows as in `driven_amplitudes`. Breaks once the second harmonic has
    grown large anywhere behind the front, as on resonance: that force comes from all the way there.

    Raises ValueError for TR and RT under a shear law with memory: next to the row stretch and slip of a contact are
    not in phase, ∫x dt gains the area of their ellipse in every period, and p creeps with no steady state.
    """
    n = _counted(rows)
    if ratios.memory and mode.name != "L":
        raise ValueError(f"{mode.name} has no steady mean displacement under a shear law with memory")
    waves = linear_waves(mode, ratios)
    dp, dq, sigma = waves.bonds
    forces = _bond_force((dp, dq, sigma), (dp.conj(), dq.conj(), sigma.conj()), ratios, amplitude)
    c = ratios.speed / 2
    uniform = np.sum(np.diag(forces).real * waves.velocities / (c + waves.velocities))
    decay = np.exp(
        1j * np.multiply.outer(np.arange(np.max(n)), np.subtract.outer(waves.wavenumbers, waves.wavenumbers.conj()))
    )
    stretch = (uniform - np.sum(decay * forces, axis=(1, 2)).real) / c**2
    return np.concatenate([[0.0], np.cumsum(stretch)])[n]


def _bond_force(
    one: tuple[Complexes, Complexes, Complexes], other: tuple[Complexes, Complexes, Complexes], ratios: Ratios, a: float
) -> Complexes:
    """B_ab (m, m) of the module from dp, dq, σ of each wave; of real fields Re z, hence ε/16 for the ε/8 of eqp."""
    pair = np.multiply.outer
    longitudinal = ratios.longitudinal * pair(one[0], other[0])
    transverse = -ratios.alpha * pair(one[1], other[1])
    mixed = ratios.beta / np.sqrt(3) * (pair(one[2], other[1]) + pair(one[1], other[2]))
    return np.asarray(nonlinearity(ratios, a) / 16 * (longitudinal + transverse + mixed))


def _beat(one: complex, other: complex, n: NDArray[np.intp]) -> Complexes:
    """(e^{ikn} − e^{ik'n})/(e^{ik} − e^{ik'}) of two wave numbers: n e^{ik(n−1)} where they are equal."""
    # Out of the wave that decays least, so that no exponential overflows
    slow, fast = sorted((one, other), key=lambda k: k.imag)
    mismatch = 1j * (fast - slow)
    growth = np.expm1(mismatch * n) / np.expm1(mismatch) if mismatch else n
    return np.asarray(np.exp(1j * slow * (n - 1)) * growth)


def _counted(rows: ArrayLike) -> NDArray[np.intp]:
    n = np.asarray(rows)
    if n.ndim != 1 or n.size == 0 or not np.issubdtype(n.dtype, np.integer) or np.min(n) < 0:
        raise ValueError(f"rows = {rows!r} must be one-dimensional, whole numbers, not negative")
    return n.astype(np.intp)
