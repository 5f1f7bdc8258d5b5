"""Surface waves of an elastic substrate under the layer of a scene: their branches, and those of measured points.

The substrate has the moduli of `[substrate]` and its density, by default that of the spheres; in a run it is rigid.
The theory is `granular_analysis.theory.surface_wave`.
"""

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.points import Point
from granular_analysis.theory.bloch import frame
from granular_analysis.theory.layered import Layered, Slab
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.surface_wave import Coupled, HalfSpace

Floats = NDArray[np.float64]
BRANCH = "saw"  # a point of it is the nearest surface wave; saw1, saw2, ... are the guided ones from the lowest
SHOWN = 1.6  # the highest frequency that is shown is as many times the vertical resonance
_ABOVE = 1.5  # waves of a plate, which have no end, are sought up to as many times the highest measured one
STILL = 1e-6  # share of the vertical resonance; nothing holds spheres whose frequency is lower
_ROUNDING = 1e-12  # share of a frequency; a decay that is no larger is none
SLOWEST = 1e-3  # leaking waves begin at this share of the first wave number
STEP = 0.05  # a leaking wave changes by at most this share of its frequency from one wave number to the next


class Wave(NamedTuple):
    """A wave: rad per row, m, "guided" or "leaking", Hz, 1/s, and its shape.

    Shares of the spheres' motion, u and φ = Rθ: along k, across, vertical, and turning. The surface moves by `surface`
    times as much as the spheres do.
    """

    wavenumber: float
    wavelength: float
    kind: str
    frequency_Hz: float
    attenuation: float
    vertical: float
    along: float
    across: float
    turning: float
    surface: float

    @property
    def quality(self) -> float:
        """Return the quality factor."""
        return np.pi * self.frequency_Hz / self.attenuation if self.attenuation else np.inf


class Film(NamedTuple):
    """The layer of a scene on its substrate.

    Attributes
    ----------
    coupled : both.
    solid : the material of the substrate.
    unit : (2,) 1/m, the wave vector of one rad per row.
    own : rad/s, √(K_N/m) of a sphere on a rigid substrate.
    """

    coupled: Coupled
    solid: HalfSpace
    unit: Floats
    own: float

    @classmethod
    def of(
        cls,
        setting: Setting,
        density: float | None = None,
        degrees: float | None = None,
        *,
        thickness: float | None = None,
        below: HalfSpace | None = None,
    ) -> "Film":
        """Return the film of a scene, by default with its density of the substrate and its direction.

        A substrate with a thickness is a plate, or a film on the half-space that is below. Raises ValueError for a
        scene without a substrate below.
        """
        substrate = setting.scene.substrate
        if substrate is None or substrate.sides != "below":
            raise ValueError('[substrate]: missing, or with sides = "both"; surface waves run under one film')
        if substrate.poisson_ratio >= 0.5:
            raise ValueError("substrate.poisson_ratio = 0.5: must be below 0.5 for a half-space that is compressed")
        crystal = setting.crystal(true_geometry=False)
        heavy = density or substrate.density or setting.scene.sphere.density
        solid = HalfSpace.of(substrate.youngs_modulus, substrate.poisson_ratio, heavy)
        own = float(np.sqrt(crystal.bonds.law.stiffness[-1] / crystal.mass[0, 0]))
        way = frame(setting.scene.direction if degrees is None else degrees)[0]
        body = Layered((Slab(solid, thickness),), below) if thickness else solid
        return cls(Coupled(crystal, body), solid, setting.unit * way, own)

    @property
    def highest(self) -> float:
        """Return the frequency, rad/s, up to which waves are shown."""
        return SHOWN * self.own

    @property
    def crossing(self) -> float:
        """Return where the bare surface wave has the frequency of the vertical resonance, rad per row."""
        return float(self.own / self.solid.rayleigh() / np.linalg.norm(self.unit))

    def wave(self, xi: float, omega: complex, kind: str) -> Wave:
        """Return a wave at a wave number ξ, rad per row."""
        spheres, surface = self.coupled.shape(xi * self.unit, omega)
        length = float(np.linalg.norm(self.unit))
        way = np.array([[*self.unit / length], [-self.unit[1] / length, self.unit[0] / length]])
        size = np.sum(np.abs(spheres) ** 2, axis=0)
        level = np.sum(np.abs(spheres[:, :2] @ way.T) ** 2, axis=0)
        shares = np.array([size[2], *level, size[3:].sum()]) / max(size.sum(), np.finfo(float).tiny)
        moved = np.linalg.norm(surface) / max(np.sqrt(size.sum() / len(spheres)), np.finfo(float).tiny)
        rate = -omega.imag if abs(omega.imag) > _ROUNDING * abs(omega) else 0.0
        return Wave(xi, 2 * np.pi / (xi * length), kind, omega.real / (2 * np.pi), rate, *map(float, [*shares, moved]))

    def guided(self, numbers: Floats) -> list[Wave]:
        """Return the guided waves at wave numbers, rad per row."""
        found = self._guided(np.multiply.outer(numbers, self.unit), self.highest)
        return [
            self.wave(float(xi), complex(omega), "guided")
            for xi, row in zip(numbers, found, strict=True)
            for omega in row[np.isfinite(row)]
        ]

    def _guided(self, wavevectors: Floats, highest: float) -> Floats:
        """Return ω (N, J) of the guided waves that something holds; of a plate those below a frequency."""
        below = np.inf if np.isfinite(self.coupled.substrate.cutoff) else highest
        found = self.coupled.guided(wavevectors, below)
        return np.where(found > STILL * self.own, found, np.nan)

    def leaking(self, numbers: Floats) -> Iterator[Wave]:
        """Yield the leaking waves at wave numbers, followed from those of the rigid substrate at k = 0."""
        begin = SLOWEST * numbers[0] * self.unit
        for resonance in self.coupled.crystal.modes(begin).frequencies:
            omega = self.coupled.leaking(begin, resonance)
            for xi in numbers:
                found = self.coupled.leaking(xi * self.unit, omega)
                slow = found.real < self.coupled.substrate.cutoff * xi * np.linalg.norm(self.unit)
                if not abs(found - omega) < STEP * abs(omega) or slow:
                    break
                omega = found
                yield self.wave(float(xi), omega, "leaking")

    def met(self, points: Sequence[Point], wavevectors: Floats) -> Floats:
        """Return the frequencies (N,), Hz, of the waves that points at wave vectors (N, 2), 1/m, are.

        Raises ValueError for a point whose wave is not there.
        """
        guided = self._guided(wavevectors, _ABOVE * 2 * np.pi * max(each.value for each in points))
        return np.array([self._met(*each) for each in zip(points, wavevectors, guided, strict=True)]) / (2 * np.pi)

    def _met(self, point: Point, wavevector: Floats, guided: Floats) -> float:
        found, measured = guided[np.isfinite(guided)], 2 * np.pi * point.value
        if number := numbered(point.branch):
            found = found[number - 1 : number]
        elif measured > self.coupled.substrate.cutoff * np.linalg.norm(wavevector):
            found = np.append(found, self.coupled.leaking(wavevector, measured).real)
            found = found[np.isfinite(found)]
        if not len(found):
            raise ValueError(f"line {point.line}: branch = {point.branch!r}: the layer has no such wave there")
        return float(found[np.argmin(np.abs(found - measured))])


def numbered(branch: str) -> int:
    """Return the number of "saw1", "saw2", …; 0 of "saw"."""
    return int(branch.removeprefix(BRANCH) or 0)


def is_surface_wave(point: Point) -> bool:
    """Return whether a point is a surface wave, by its branch."""
    return point.kind == "frequency" and re.fullmatch(rf"{BRANCH}([1-9]\d*)?", point.branch) is not None
