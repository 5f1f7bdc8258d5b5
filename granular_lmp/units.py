"""Units of a deck: a LAMMPS style in which its numbers are near 1, or units of its own."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from granular_lmp.frozen import dataclass

Value = TypeVar("Value", float, NDArray[np.float64])


@dataclass(frozen=True)
class Units:
    """LAMMPS unit style (https://docs.lammps.org/units.html): mass, length and time as powers of ten of kg, m, s.

    Attributes
    ----------
    style : str
        Argument of the command ``units``.
    mass, length, time : int
        Exponents of ten in kg, m, s.
    names : str
        Names of the units, for the comment in the deck.
    own : bool
        True if they are the units of the scene, where t0 is 1.
    """

    style: str
    mass: int
    length: int
    time: int
    names: str
    own: bool = False

    @property
    def title(self) -> str:
        """Units in words, for a title."""
        return f"units {self.style}"

    def number(self, value: Value, *, mass: int = 0, length: int = 0, time: int = 0) -> Value:
        """Return an SI quantity, a number or an array, of dimension kg^mass m^length s^time in units of this style.

        Powers of ten up to 22 are exact in floating point, so 0.5e-6 m becomes 500.0 nm and not 499.99999999999994.
        """
        exponent = mass * self.mass + length * self.length + time * self.time
        return value / 10.0**exponent if exponent > 0 else value * 10.0**-exponent

    def si(self, value: Value, *, mass: int = 0, length: int = 0, time: int = 0) -> Value:
        """Return a number or an array in units of this style in SI units: the inverse of `number`."""
        return self.number(value, mass=-mass, length=-length, time=-time)


@dataclass(frozen=True)
class OwnUnits:
    """Units of a deck of style ``lj``, by their size in kg, m and s, for spheres that are not held at rest.

    The unit of length is R, in which spheres that just touch have exact places.
    """

    mass: float
    length: float
    time: float
    style: str = "lj"
    names: str = "lengths in radii, masses in m"
    title: str = "lengths in radii, masses in m"
    own: bool = True

    def number(self, value: Value, *, mass: int = 0, length: int = 0, time: int = 0) -> Value:
        """Return an SI quantity, a number or an array, of dimension kg^mass m^length s^time in these units."""
        return value / (self.mass**mass * self.length**length * self.time**time)

    def si(self, value: Value, *, mass: int = 0, length: int = 0, time: int = 0) -> Value:
        """Return a number or an array in these units in SI units: the inverse of `number`."""
        return self.number(value, mass=-mass, length=-length, time=-time)


AnyUnits = Units | OwnUnits

NANO = Units("nano", -21, -9, -9, "ag, nm, ns, MPa, mJ/m2")
MICRO = Units("micro", -15, -6, -6, "pg, um, us, kPa, mJ/m2")
SI = Units("si", 0, 0, 0, "kg, m, s, Pa, J/m2")
CGS = Units("cgs", -3, -2, 0, "g, cm, s, dyn/cm2, erg/cm2")
LJ = Units("lj", 0, 0, 0, "units of mass, length and time")
STYLES = {each.style: each for each in (SI, CGS, MICRO, NANO, LJ)}  # for decks of spheres, by the argument of `units`


def units_for(radius: float) -> Units:
    """Return the style for spheres of this radius (m): ``nano`` below 10 µm, ``micro`` below 1 mm, else ``si``."""
    return NANO if radius < 1e-5 else MICRO if radius < 1e-3 else SI
