"""Phase matching of two waves with given frequencies: branches, directions and compression at which they resonate.

Two sources shake a crystal at the frequencies f1 and f2, each along its own direction. In units of the crystal the
frequencies are Ωi = 2π fi t0. The unit t0 falls as the crystal is compressed by the force F0 per contact, with the
pull F = π w R of adhesion:

    t0² = m/(3(κ+3) A √Δ0),    A Δ0^{3/2} = F + F0

F0 can therefore tune two waves of given frequencies to Ω1 ± Ω2 = Ω_j(k1 ± k2). For each pair of branches and
directions, `design` finds the wave numbers at which the pair is phase-matched with Ω2/Ω1 = f2/f1, and the force F0 at
which these waves have the given frequencies, with the geometry and prestress (η, F0) of such contacts. Pairs that
symmetry forbids (`granular_analysis.theory.selection`) are left out.

Good values: a compression with η = Δ0/2R below 0.01, where contacts still are springs. The list is sorted by the number
of periods of the first wave in which two waves of equal amplitude generate a third wave of the same amplitude
(`granular_analysis.theory.second_order.Mixed.growth_rates`); fewer are better. If both waves are the same, they count
as a single wave, whose second harmonic resonates. An adhesive crystal is stiff without compression, so frequencies
below some value cannot be matched by any compression.

When it breaks: as `granular_analysis.theory.second_order`. A detuning of 1/(100 periods) is one thousandth of Ω; a
spread of sphere sizes easily causes that much.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray
from scipy.optimize import root

from granular_analysis.theory.bloch import branch_index, frame, hexagonal, pair_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.second_order import Mixed
from granular_analysis.theory.selection import forbidden
from granular_lmp.crystal.sphere import Sphere

Floats = NDArray[np.float64]

SILICA = Sphere(
    radius=5e-7, youngs_modulus=7.3e10, poisson_ratio=0.17, work_of_adhesion=0.063, density=2200.0
)  # the paper's
EDGE = 2.0 * np.pi / np.sqrt(3.0)  # |ΓM|, in 1/lattice constant
POINTS = 160  # values of each wave number, from Γ to the border of the zone
LARGEST = 0.099  # largest overlap ratio: `Contact` allows 0.1, and the root search steps past the solution
SMALLEST = 1e-12  # least overlap ratio of spheres without adhesion; a smaller overlap is below an atom
CLOSE = 1e-10  # largest difference of frequencies at a root, and relative difference of its time unit from the target
SAME = 1e-6  # relative difference of lengths and forces below which two resonances are the same


@dataclass(frozen=True)
class Resonance:
    """Phase-matched pair of waves, with the compressed crystal in which it resonates.

    Attributes
    ----------
    pair : the two waves and the field that they generate
    branches : indices of their branches
    target : branch that grows at k1 ± k2
    sphere : the spheres, with the compressive force F0 of a contact in N
    frequency : f1 in hertz
    """

    pair: Mixed
    branches: tuple[int, int]
    target: int
    sphere: Sphere
    frequency: float

    @property
    def sign(self) -> int:
        """Return 1 for the sum of the two waves, −1 for their difference."""
        return 1 if self.pair.second.frequency > 0 else -1

    @property
    def generated_frequency(self) -> float:
        """Return |f1 ± f2| in hertz."""
        return float(abs(self.pair.frequency) / self.pair.first.frequency * self.frequency)

    @property
    def rate(self) -> float:
        """Return the rate of growth per τ and a; half the rate of a pair if both waves are the same."""
        (one, branch), (other, another), _ = self._three
        single = self.sign == 1 and branch == another and np.allclose(one, other, rtol=SAME, atol=0)
        return float(self.pair.growth_rates()[self.target]) * (0.5 if single else 1.0)

    def periods(self, amplitude: float) -> float:
        """Return the periods of the first wave after which the generated wave would have the amplitude a = D0/Δ0.

        The two waves, or the single wave, have this amplitude too, and their loss of energy is neglected.
        """
        return self.frequency * self.sphere.time_scale / (self.rate * amplitude)

    def mirrors(self, other: "Resonance") -> bool:
        """Return whether another resonance is this one mirrored, rotated, or with its two waves exchanged."""
        if self.sign != other.sign:
            return False
        mine, others = self._waves, other._waves
        return any(np.allclose(mine, order, rtol=SAME, atol=0) for order in (others, others[[1, 0, 2]]))

    @property
    def _waves(self) -> Floats:
        """Branch (from 1), length of the wave vector, and holding force of a contact for the three waves, (3, 3)."""
        return np.array([(1 + int(branch), np.linalg.norm(k), self.sphere.holding_force) for k, branch in self._three])

    @property
    def _three(self) -> list[tuple[Floats, int]]:
        """Wave vectors and branches of the first wave, the second wave, and the wave that grows."""
        vectors = self.pair.first.wavevector, self.sign * self.pair.second.wavevector, self.pair.wavevector
        return [(k[:2], branch) for k, branch in zip(vectors, (*self.branches, self.target), strict=True)]

    @property
    def names(self) -> str:
        """Return the names of the three waves, as "TR + TR -> L"; away from mirrors the names label quasi-modes."""
        contact = Contact.of(self.sphere)
        one, other, third = (
            next(name for name in ("L", "TR", "RT") if branch_index(name, k, contact) == branch)
            for k, branch in self._three
        )
        return f"{one} {'+' if self.sign == 1 else '-'} {other} -> {third}"


def compressed(sphere: Sphere, time_scale: float) -> Sphere:
    """Return the spheres under the force F0 that gives the unit of time t0, in s; a negative F0 is a pull."""
    root_of_overlap = sphere.mass / (3 * (sphere.stiffness_ratio + 3) * sphere.normal_coefficient * time_scale**2)
    return replace(sphere, contact_force=sphere.normal_coefficient * root_of_overlap**3 - sphere.pull_off_force)


def design(
    sphere: Sphere,
    frequency: float,
    second: float | None = None,
    directions: Sequence[float] = (90.0, 0.0),
    openings: Sequence[float] = (0.0, 60.0, 90.0, 120.0, 180.0),
) -> list[Resonance]:
    """Return the phase-matched pairs of two frequencies, sorted by the periods that they need to grow.

    Parameters
    ----------
    sphere : in SI units; its contact_force is not used
    frequency, second : f1 and f2 in hertz; f2 = f1 by default
    directions : directions of the first wave, degrees from a close-packed row (90: the paper's y)
    openings : angles from the first wave to the second, degrees

    Raises
    ------
    ValueError
        For a value out of range, by name, and for a frequency so low that all pairs need a pull on the contacts.
    """
    second = frequency if second is None else second
    _check(sphere, frequency, second, [*directions, *openings])
    resting, ratio = replace(sphere, contact_force=0.0), second / frequency
    longest, shortest = (
        replace(resting, contact_force=resting.normal_coefficient * overlap**1.5 - resting.pull_off_force).time_scale
        for overlap in (max(resting.static_overlap, SMALLEST * 2 * resting.radius), LARGEST * 2 * resting.radius)
    )

    def under_pressure(omega: float) -> Sphere:
        """Return the spheres in which the first wave has frequency f1, limited to F0 ≥ 0 and η ≤ `LARGEST`."""
        asked = compressed(resting, float(np.clip(abs(omega) / (2 * np.pi * frequency), shortest, longest)))
        return replace(asked, contact_force=max(asked.contact_force, 0.0))

    guesses = [
        guess
        for direction, opening in product(directions, openings)
        for guess in _guesses(Contact(sphere.poisson_ratio), ratio, (direction, direction + opening))
    ]
    found: list[Resonance] = []
    for guess in guesses:
        pair = _root(guess, ratio, lambda omega: Contact.of(under_pressure(omega)))
        if pair is None or forbidden(pair)[guess.target]:
            continue
        omega = float(pair.first.frequency)
        each = Resonance(pair, guess.branches, guess.target, under_pressure(omega), frequency)
        agrees = abs(omega / (2 * np.pi * frequency) - each.sphere.time_scale) < CLOSE * each.sphere.time_scale
        if agrees and not any(each.mirrors(other) for other in found):
            found.append(each)
    if not found and sphere.work_of_adhesion:
        held = Contact.of(resting)
        pairs = [(guess, _root(guess, ratio, lambda _: held)) for guess in guesses]
        left = [pair for guess, pair in pairs if pair and not forbidden(pair)[guess.target]]
        omegas = [float(each.first.frequency) for each in left]
        lowest = min(omegas, default=0.0) / (2 * np.pi * resting.time_scale)
        if frequency < lowest:
            raise ValueError(f"frequency is {frequency:g}; allowed: {lowest:.4g} Hz and above, where F0 is no pull")
    return sorted(found, key=lambda each: each.periods(1.0))


def _check(sphere: Sphere, frequency: float, second: float, angles: Sequence[float]) -> None:
    """Raise ValueError, naming the argument, its value and the allowed range, for invalid input of `design`."""
    positive = {"frequency": frequency, "second": second} | {
        name: getattr(sphere, name) for name in ("radius", "youngs_modulus", "density")
    }
    for name, value in positive.items():
        if not 1e-15 <= value <= 1e15:  # so that powers neither overflow nor underflow
            raise ValueError(f"{name} is {value}; allowed: from 1e-15 to 1e15")
    if not np.isfinite(angles).all():
        raise ValueError(f"directions and openings are {list(angles)}; allowed: degrees, finite")
    if sphere.adhesion_law != "dmt":
        raise ValueError(f"adhesion_law is {sphere.adhesion_law!r}; allowed: 'dmt'")
    if not -1 < sphere.poisson_ratio <= 0.5:
        raise ValueError(f"poisson_ratio is {sphere.poisson_ratio}; allowed: above -1, up to 0.5")
    adhesion = replace(sphere, contact_force=0.0)
    if not (sphere.work_of_adhesion >= 0 and adhesion.overlap_ratio < LARGEST):
        raise ValueError(
            f"work_of_adhesion is {sphere.work_of_adhesion}; allowed: 0 or above, with an overlap of the spheres at "
            f"rest below {LARGEST:g} of a diameter"
        )


class _Guess(NamedTuple):
    """Two waves near phase matching.

    Attributes
    ----------
    along : unit vectors along both wave vectors
    start : their lengths, and Ω1
    branches : branches of both waves
    sign : 1 for their sum, −1 for their difference
    target : branch that they generate
    """

    along: tuple[Floats, Floats]
    start: Floats
    branches: tuple[int, int]
    sign: Literal[1, -1]
    target: int

    def pair(self, lengths: Floats, contact: Contact) -> Mixed:
        """Return the two waves with wave vectors of these lengths, (2,) or (2, N)."""
        first, second = (
            (length[..., None] * direction, branch)
            for length, direction, branch in zip(lengths, self.along, self.branches, strict=True)
        )
        return pair_of(first, second, self.sign, contact)

    def frequencies(self, lengths: Floats, contact: Contact) -> tuple[Floats, Floats, Floats]:
        """Return Ω1 (...), Ω2 (...) and |Ω1 ± Ω2| − Ω_j(k1 ± k2) (..., J) at wave numbers (2, ...)."""
        k1, k2 = (length[..., None] * direction for length, direction in zip(lengths, self.along, strict=True))
        every = hexagonal(contact).frequencies(np.stack([k1, k2, k1 + self.sign * k2]))
        first, second = every[0, ..., self.branches[0]], every[1, ..., self.branches[1]]
        return first, second, np.abs(first + self.sign * second)[..., None] - every[2]


def _guesses(contact: Contact, ratio: float, angles: tuple[float, float]) -> Iterator[_Guess]:
    """Yield waves along two directions with Ω2 = ratio·Ω1 that resonate with a branch, on a grid of wave numbers."""
    along = (frame(angles[0])[0], frame(angles[1])[0])
    lengths = [np.linspace(0.02, 1.0, POINTS) * _border(direction) for direction in along]
    first, second = (
        hexagonal(contact).frequencies(length[:, None] * direction)
        for length, direction in zip(lengths, along, strict=True)
    )
    # The difference of two waves of equal frequency is static, not a wave
    signs: tuple[Literal[1, -1], ...] = (1, -1) if ratio != 1.0 else (1,)
    for one, other in product(range(3), repeat=2):
        gap = second[:, None, other] - ratio * first[:, one]
        for line in contour_generator(lengths[0], lengths[1], gap).lines(0.0):
            for sign in signs:
                guess = _Guess(along, np.empty(3), (one, other), sign, 0)
                omega, _, gaps = guess.frequencies(np.asarray(line).T, contact)
                for step, target in np.argwhere(np.diff(np.signbit(gaps), axis=0)):
                    start_at = np.array([*line[step], omega[step]])
                    yield guess._replace(start=start_at, target=int(target))


def _root(guess: _Guess, ratio: float, contact_at: Callable[[float], Contact]) -> Mixed | None:
    """Return the phase-matched pair near a guess, or None if there is none in the zone.

    contact_at returns the contact of the crystal in which the first wave has a given frequency Ω1.
    """

    def residual(unknown: Floats) -> list[float]:
        first, second, gaps = guess.frequencies(unknown[:2], contact_at(float(unknown[2])))
        return [float(each) for each in (first - unknown[2], second - ratio * first, gaps[guess.target])]

    found = root(residual, guess.start, tol=1e-13).x
    borders = np.array([_border(direction) for direction in guess.along])
    inside = np.all((found[:2] > 0) & (found[:2] <= borders * (1 + CLOSE)))
    matched = inside and np.max(np.abs(residual(found))) < CLOSE
    return guess.pair(found[:2], contact_at(float(found[2]))) if matched else None


def _border(direction: Floats) -> float:
    """Return the length at which a wave vector along a unit vector meets the border of the first zone."""
    normals = np.radians(30.0 + 60.0 * np.arange(6))
    return float(EDGE / np.max(np.cos(normals) * direction[0] + np.sin(normals) * direction[1]))


def table(found: Sequence[Resonance], amplitude: float) -> str:
    """Return a table with one resonance per line.

    Columns: names of the waves, directions, wave numbers ξ, the generated frequency, F0, η, and periods of growth at an
    amplitude of D0/Δ0.
    """
    lines = [
        f"{'waves':15}{'deg 1':>7}{'deg 2':>7}{'deg 3':>7}{'xi 1':>9}{'xi 2':>9}{'xi 3':>9}"
        f"{'f3, Hz':>11}{'F0, N':>11}{'eta':>9}{'periods':>9}"
    ]
    for each in found:
        *waves, made = (k for k, _ in each._three)
        waves.append(made * np.sign(each.pair.frequency))
        angles = "".join(f"{np.degrees(np.arctan2(k[1], k[0])) % 360:7.1f}" for k in waves)
        numbers = "".join(f"{np.linalg.norm(k) * np.sqrt(0.75):9.5f}" for k in waves)
        lines.append(
            f"{each.names:15}{angles}{numbers}{each.generated_frequency:11.4g}{each.sphere.contact_force:11.4g}"
            f"{each.sphere.overlap_ratio:9.2g}{each.periods(amplitude):9.1f}"
        )
    return "\n".join(lines)
