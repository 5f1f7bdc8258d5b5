"""Solitary wave of a chain of equal spheres, from the exact equation of the travelling wave.

In a wave of speed V (spheres per unit of time) the contact between the spheres n − 1 and n has the overlap
δ_n(t) = δ0 + r(s), s = n − V t. Newton's law for two neighbours gives an equation with advance and delay,

    m V² r''(s) = A [g(s + 1) − 2 g(s) + g(s − 1)],   g = (δ0 + r)^{3/2} − δ0^{3/2},

which in Fourier space is a fixed-point equation, with Λ(k) = [sin(k/2)/(k/2)]² and the speed of sound
c² = (3A/2m) √δ0:

    (V² − c² Λ) r̂ = (A/m) Λ N̂,   N = g − (3/2) √δ0 r = (√(δ0 + r) − √δ0)² (√(δ0 + r) + √δ0/2)

Petviashvili's iteration solves it. The velocity of sphere n is w(n − V t + 1/2), ŵ = (A/mV) [sin(k/2)/(k/2)] ĝ.

Spheres that just touch (δ0 = 0) have a single wave up to scale:

    V = 0.9074701 (A/m)^{2/5} v^{1/5} = 0.9055158 (A/m)^{1/2} δ^{1/4}

with its largest velocity v and overlap δ; the long-wave theory of Nesterenko has the factors 0.9146 and 0.8944.
Compressed spheres have a wave for each V > c, from the KdV soliton, V/c = 1 + δ/(12 δ0), to the wave of touching
spheres.

Good values: V/c from 1.001 to 100. For larger V/c use δ0 = 0; nearer to 1 the wave is longer than 200 spheres, and KdV
gives V to 2e-6. Unequal spheres, tension, adhesion and damping are left out.

Sources: V. F. Nesterenko, Dynamics of Heterogeneous Materials (2001), chapter 1; J. M. English & R. L. Pego, Proc. Am.
Math. Soc. 133, 1763 (2005), for the fixed point. The numbers are measured here.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

PER_SPHERE = 16  # samples per sphere; 8 give the wave of touching spheres to 1e-15
NARROWEST = 6.0  # least half period, at which the wave of touching spheres has fallen to 1e-20
GAMMA = 2.5  # Petviashvili's exponent p/(p − 1): 2 for the quadratic N of sound, 3 for the power 3/2; both converge
ENOUGH = 1e-13  # relative change at which the iteration ends
MOST = 400  # largest number of iterations; 60 to 100 are typical
SLOWEST, FASTEST = 1.001, 100.0  # V/c


@dataclass(frozen=True, eq=False)
class SolitaryWave:
    """A solitary wave at equally spaced places s of a period; its crest is at s = 0.

    Attributes
    ----------
    speed : V, spheres per unit of time.
    rest : δ0, overlap at rest.
    place : (K,) s.
    overlap : (K,) r(s), overlap above that at rest.
    velocity : (K,) w(s), with its crest at s = 0; sphere n has w(n − V t + 1/2) when contact n has r(n − V t).
    """

    speed: float
    rest: float
    place: Floats
    overlap: Floats
    velocity: Floats

    @property
    def largest_overlap(self) -> float:
        """Return the largest r."""
        return float(self.overlap.max())

    @property
    def largest_velocity(self) -> float:
        """Return the largest w."""
        return float(self.velocity.max())

    def at(self, places: ArrayLike) -> tuple[Floats, Floats]:
        """Return r and w at any places s, from their Fourier series; zero outside the period."""
        s = np.asarray(places, dtype=float)
        half = -self.place[0]
        orders = np.arange(self.place.size // 2 + 1)
        waves = np.cos(np.pi / half * s[..., None] * orders)
        weights = np.where((orders == 0) | (orders == orders[-1]), 1.0, 2.0) / self.place.size
        inside = np.abs(s) < half
        r, w = (
            np.where(inside, waves @ (weights * np.fft.rfft(np.fft.ifftshift(values)).real), 0.0)
            for values in (self.overlap, self.velocity)
        )
        return r, w

    def start(self, count: int, crest: float) -> tuple[Floats, Floats]:
        """Return displacements and velocities (n,) of a chain of `count` spheres with the crest at the contact `crest`.

        Contact j lies between the spheres j − 1 and j. The spheres ahead are at rest, with displacement 0.
        """
        contacts = np.arange(1, count + 1) - crest
        r, _ = self.at(contacts)
        _, w = self.at(np.arange(count) - crest + 0.5)
        return np.cumsum(r[::-1])[::-1], w


def solitary_wave(speed: float, *, stiffness: float = 1.0, mass: float = 1.0, rest: float = 0.0) -> SolitaryWave:
    """Return the solitary wave of the given speed.

    Parameters
    ----------
    speed : V, spheres per unit of time; with rest > 0 from 1.001 to 100 times the speed of `sound`.
    stiffness, mass : A and m of the spheres.
    rest : δ0 = (F0/A)^{2/3}, overlap of the compressed chain at rest.

    Raises ValueError for other values, RuntimeError if the iteration does not converge.
    """
    if not (min(speed, stiffness, mass) > 0 and rest >= 0 and np.isfinite(speed * stiffness * mass * rest)):
        raise ValueError(
            "speed, stiffness and mass must be positive, rest not negative, not "
            f"speed = {speed}, stiffness = {stiffness}, mass = {mass}, rest = {rest}"
        )
    ratio = speed / sound(stiffness, mass, rest) if rest else np.inf
    if rest and not SLOWEST <= ratio <= FASTEST:
        raise ValueError(f"speed must be from {SLOWEST} to {FASTEST:g} times that of sound, not {ratio:.6g} times")
    # Units from the largest overlap in the long-wave theory without compression
    unit = (mass * speed**2 / stiffness) ** 2
    place, overlap, velocity = _solved(rest / unit, ratio)
    return SolitaryWave(speed, rest, place, overlap * unit, velocity * (unit * speed))


def sound(stiffness: float, mass: float, rest: float) -> float:
    """Return the speed of long sound waves c = √(3A√δ0/2m), in spheres per unit of time."""
    return float(np.sqrt(1.5 * stiffness / mass * np.sqrt(rest)))


def long_wave_speed(crest: ArrayLike) -> Floats:
    """Return V/c in the long-wave theory for the relative overlap x = δ_max/δ0 > 1 at the crest.

        V²/c² = (4/15) [3 + 2 x^{5/2} − 5x]/(x − 1)²

    The result is exact for x → 1 and 1.2 % too low for x → ∞. Source: Nesterenko (2001), chapter 1.
    """
    x = np.asarray(crest, dtype=float)
    if not np.all(x > 1):
        raise ValueError(f"the overlap at the crest must exceed that at rest: x > 1, not {x}")
    y = np.sqrt(x)
    # (3 + 2y⁵ − 5y²)/(y² − 1)² without its double root at y = 1
    result: Floats = np.sqrt(4 / 15 * (2 * y**3 + 4 * y**2 + 6 * y + 3)) / (y + 1)
    return result


def _solved(rest: float, ratio: float) -> tuple[Floats, Floats, Floats]:
    """Return s, r and w for A = m = V = 1."""
    root = np.sqrt(rest)
    slow, fast = 2 * np.sqrt(6 * (ratio - 1)), 2 * np.log(2 * ratio)  # q of the tail e^{−qs}, V q/2 = c sinh(q/2)
    half = max(NARROWEST, 37.0 / min(slow, fast))  # e^{−37} = 1e-16
    size = 2 ** int(np.ceil(np.log2(2 * half * PER_SPHERE)))
    s = (np.arange(size) - size // 2) * (2 * half / size)
    box = np.sinc(np.fft.rfftfreq(size, 2 * half / size))
    linear = box**2 / (1 - 1.5 * root * box**2)
    r = rest * 12 * (ratio - 1) / np.cosh(slow / 2 * s) ** 2 if ratio < 1.5 else 1.5 / np.cosh(s) ** 4
    for _ in range(MOST):
        change = _root_change(r, rest)
        power = change**2 * (change + 1.5 * root)
        new = np.maximum(np.fft.irfft(linear * np.fft.rfft(power), size), 0.0)
        new *= (np.dot(r, r) / np.dot(r, new)) ** GAMMA
        error, r = np.max(np.abs(new - r)) / np.max(new), new
        if error < ENOUGH:
            change = _root_change(r, rest)
            force = change**2 * (change + 1.5 * root) + 1.5 * root * r
            return s, r, np.fft.irfft(box * np.fft.rfft(force), size)
    raise RuntimeError(f"no solitary wave after {MOST} iterations, V/c = {ratio:.6g}: the last change is {error:.1e}")


def _root_change(r: Floats, rest: float) -> Floats:
    """Return √(δ0 + r) − √δ0 without cancellation."""
    result: Floats = r / (np.sqrt(rest + r) + np.sqrt(rest)) if rest else np.sqrt(r)
    return result
