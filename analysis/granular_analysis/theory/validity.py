"""How far second order holds for a wave: contacts that open and slide, the next order, and slip that winds up.

All numbers are of the wave with its amplitude A, to leading order in it.

| number | of order | what it says |
|---|---|---|
| `opening` | A | the largest stretch of a contact over that which opens it: a contact opens at 1 |
| `friction` | A | the coefficient of friction below which a contact slides |
| `second` | A | the forced second harmonic over the wave |
| `drift` | A² | the phase in rad by which third order has turned the wave after a period; nan where slip winds up |
| `creep` | A | the way in a period, over A, by which spheres creep as slip winds up; 0 in planar lattices |
| `departure` | A² | the share by which the second harmonic changes that creep (`granular_analysis.theory.creep`) |

Second order ends where any of the first three is near 1, and misses the wave itself by drift times the periods.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bonds import Law, Strain
from granular_analysis.theory.creep import creep
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.second_order import Mixed, Wave
from granular_analysis.theory.third_order import shift

Floats = NDArray[np.float64]


class Validity(NamedTuple):
    """The numbers of this module."""

    opening: float
    friction: float
    second: float
    drift: float
    creep: float
    departure: float


class Reached(NamedTuple):
    """Deformation of the contacts in a field, or in several.

    Attributes
    ----------
    opening : largest stretch over that which opens a contact, at any phase.
    friction : coefficient of friction below which one slides.
    energy : sum of k|stretch|² and k|slip|² over the contacts.
    squared : sum of the same times |stretch|² + |slip|² over the square of the stretch that opens a contact.
    """

    opening: float
    friction: float
    energy: float
    squared: float

    @property
    def strength(self) -> float:
        """Return the mean square of stretch and slip over the stretch that opens a contact, weighted by energy."""
        return self.squared / self.energy

    def beside(self, other: "Reached") -> "Reached":
        """Return what is reached in either of two fields."""
        largest = max(self.opening, other.opening), max(self.friction, other.friction)
        return Reached(*largest, self.energy + other.energy, self.squared + other.squared)


def reached(law: Law, strain: Strain) -> Reached:
    """Return how far contacts are deformed in complex fields, at any phase."""
    stretch, slip = np.abs(strain.stretch) ** 2, np.sum(np.abs(strain.slip) ** 2, axis=-1)
    longest = np.sqrt((slip + np.abs(np.sum(strain.slip**2, axis=-1))) / 2)  # The largest |Re(s e^{iα})| over α
    energy = law.stiffness * stretch + law.shear * slip
    return Reached(
        opening=float(np.sqrt(np.max(stretch / law.reach**2))),
        friction=float(np.max(law.shear * longest / law.friction)),
        energy=float(energy.sum()),
        squared=float(np.sum(energy * (stretch + slip) / law.reach**2)),
    )


def together(crystal: Crystal, waves: Sequence[Wave]) -> Reached:
    """Return how far contacts are deformed at most in waves with their amplitudes, whatever their phases."""
    strains = [crystal.bonds.strain(each.shape, each.wavevector) for each in waves]
    slip = np.zeros_like(strains[0].slip)
    slip[..., 0] = np.sum([np.linalg.norm(each.slip, axis=-1) for each in strains], axis=0)
    stretch = np.sum([np.abs(each.stretch) for each in strains], axis=0)
    return reached(crystal.bonds.law, strains[0]._replace(stretch=stretch, slip=slip))


def validity(crystal: Crystal, wave: Wave) -> Validity:
    """Return how far second order holds for a single wave with its amplitude."""
    far = reached(crystal.bonds.law, crystal.bonds.strain(wave.shape, wave.wavevector))
    size, period = _size(wave.shape), 2 * np.pi / float(wave.frequency)
    slow = creep(crystal, wave)
    return Validity(
        opening=far.opening,
        friction=far.friction,
        second=0.5 * _size(Mixed(crystal, wave, wave).forced()) / size,
        drift=float("nan") if np.any(slow.velocity) else float(shift(crystal, wave).total) * period,
        creep=_size(slow.velocity) * period / size,
        departure=slow.departure,
    )


def turned(crystal: Crystal, waves: Sequence[Wave], time: ArrayLike) -> Floats:
    """Return an estimate (T,) of the most by which third order has turned any of waves together up to times (T,), rad.

    A wave turns itself by |θ| of `granular_analysis.theory.third_order`, regular on resonance, and another one by up to
    twice that.
    """
    own = np.array([np.abs(shift(crystal, each).phase(time)) for each in waves if each.frequency])
    if not len(own):
        return np.zeros(np.shape(time))
    return np.maximum.accumulate(np.max(2 * own.sum(axis=0) - own, axis=0))


def _size(field: NDArray[Any]) -> float:
    return float(np.sqrt(np.sum(np.abs(field) ** 2) / len(field)))
