"""Bounds of second-order theory for a wave: opening and sliding contacts, the next order, and accumulated slip.

All numbers belong to the wave with its amplitude A, to leading order in A.

| number | order | meaning |
|---|---|---|
| `opening` | A | largest stretch of a contact over the stretch that opens it: a contact opens at 1 |
| `friction` | A | coefficient of friction below which a contact slides |
| `second` | A | forced second harmonic over the wave |
| `drift` | A² | phase in rad by which third order turns the wave in one period; nan where slip winds up |
| `creep` | A | path, over A, by which spheres creep in one period as slip winds up; 0 in planar lattices |
| `departure` | A² | relative change of this creep by the second harmonic (`granular_analysis.theory.creep`) |

Second order fails where one of the first three numbers is near 1. After n periods, its phase of the wave is wrong by
n times `drift`.
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
    """Bounds of second order for a wave; see the table of the module."""

    opening: float
    friction: float
    second: float
    drift: float
    creep: float
    departure: float


class Reached(NamedTuple):
    """Largest and mean deformation of the contacts in one or several fields.

    Attributes
    ----------
    opening : largest stretch over the stretch that opens the contact, at any phase.
    friction : coefficient of friction below which a contact slides.
    energy : sum of k|stretch|² + k|slip|² over the contacts, with the stiffness k for each.
    squared : the same sum, each contact weighted by |stretch|² + |slip|² over the square of the opening stretch.
    """

    opening: float
    friction: float
    energy: float
    squared: float

    @property
    def strength(self) -> float:
        """Return the mean square of stretch and slip in units of the opening stretch, weighted by energy."""
        return self.squared / self.energy

    def beside(self, other: "Reached") -> "Reached":
        """Return the deformation reached in either of two fields."""
        largest = max(self.opening, other.opening), max(self.friction, other.friction)
        return Reached(*largest, self.energy + other.energy, self.squared + other.squared)


def reached(law: Law, strain: Strain) -> Reached:
    """Return the deformation of contacts in complex fields: the largest at any phase, and the mean."""
    stretch, slip = np.abs(strain.stretch) ** 2, np.sum(np.abs(strain.slip) ** 2, axis=-1)
    longest = np.sqrt((slip + np.abs(np.sum(strain.slip**2, axis=-1))) / 2)  # largest |Re(s e^{iα})| over α
    energy = law.stiffness * stretch + law.shear * slip
    return Reached(
        opening=float(np.sqrt(np.max(stretch / law.reach**2))),
        friction=float(np.max(law.shear * longest / law.friction)),
        energy=float(energy.sum()),
        squared=float(np.sum(energy * (stretch + slip) / law.reach**2)),
    )


def together(crystal: Crystal, waves: Sequence[Wave]) -> Reached:
    """Return the largest deformation of contacts in several waves with their amplitudes, for the worst phases."""
    strains = [crystal.bonds.strain(each.shape, each.wavevector) for each in waves]
    slip = np.zeros_like(strains[0].slip)
    slip[..., 0] = np.sum([np.linalg.norm(each.slip, axis=-1) for each in strains], axis=0)
    stretch = np.sum([np.abs(each.stretch) for each in strains], axis=0)
    return reached(crystal.bonds.law, strains[0]._replace(stretch=stretch, slip=slip))


def validity(crystal: Crystal, wave: Wave) -> Validity:
    """Return the bounds of second order for a single wave with its amplitude."""
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
    """Return an estimate (T,) in rad of the largest phase error of any of several waves up to times (T,).

    Third order turns the phase of a wave by its own |θ| of `granular_analysis.theory.third_order`, which is regular on
    resonance, and by up to twice the |θ| of every other wave.
    """
    own = np.array([np.abs(shift(crystal, each).phase(time)) for each in waves if each.frequency])
    if not len(own):
        return np.zeros(np.shape(time))
    return np.maximum.accumulate(np.max(2 * own.sum(axis=0) - own, axis=0))


def _size(field: NDArray[Any]) -> float:
    return float(np.sqrt(np.sum(np.abs(field) ** 2) / len(field)))
