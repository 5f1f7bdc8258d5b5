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
from granular_analysis.theory.surface_wave import Complexes, Coupled, HalfSpace

Floats = NDArray[np.float64]
BRANCH = "saw"  # a point of it is the nearest surface wave; saw1, saw2, ... are the guided ones from the lowest
SHOWN = 1.6  # the highest frequency that is shown is as many times the vertical resonance
_ABOVE = 1.5  # waves of a plate, which have no end, are sought up to as many times the highest measured one
STILL = 1e-6  # share of the vertical resonance; nothing holds spheres whose frequency is lower
_ROUNDING = 1e-12  # share of a frequency; a decay that is no larger is none
SLOWEST = 1e-3  # leaking waves begin at this share of the first wave number
STEP = 0.05  # a leaking wave changes by at most this share of its frequency from one wave number to the next
LONGEST_STEP = 1 / 40  # which is at most this share of the one where surface wave and vertical resonance meet


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
        """Yield the leaking waves at wave numbers, rad per row, ascending."""
        between = self._steps(float(np.diff(numbers, prepend=0.0).max()))
        path = np.interp(np.arange(1, between * len(numbers) + 1) / between, range(len(numbers) + 1), [0, *numbers])
        for step, found in enumerate(self.followed(path[:, None] * self.unit), 1):
            if step % between == 0:
                xi = float(path[step - 1])
                yield from (self.wave(xi, complex(omega), "leaking") for omega in found[np.isfinite(found)])

    def followed(self, path: Floats) -> Iterator[Complexes]:
        """Yield ω (..., F) of the leaking waves at each step of a path (S, ..., 2) of wave vectors away from k = 0.

        They begin as the resonances of the rigid substrate next to k = 0; nan from where one leaks no longer.
        """
        found = self.resonances(SLOWEST * path[0])[1]
        for vector in path:
            last, found = found, self.coupled.leaking(vector, found)
            slowest = self.coupled.substrate.cutoff * np.linalg.norm(vector, axis=-1)[..., None]
            # nan is neither near nor fast
            found = np.where((np.abs(found - last) < STEP * np.abs(last)) & (found.real >= slowest), found, np.nan)
            yield found

    def resonances(self, wavevector: Floats) -> tuple[Floats, Complexes]:
        """Return ω (..., F) on the rigid substrate at wave vectors (..., 2) next to 0, and of the waves that leak."""
        rigid = self.coupled.crystal.frequencies(wavevector)
        held = np.where(rigid > STILL * self.own, rigid, np.nan)
        return held, self.coupled.leaking(wavevector, held)

    def met(self, points: Sequence[Point], wavevectors: Floats) -> Floats:
        """Return the frequencies (N,), Hz, of the waves that points at wave vectors (N, 2), 1/m, are.

        Raises ValueError for a point whose wave is not there.
        """
        guided = self._guided(wavevectors, _ABOVE * 2 * np.pi * max(each.value for each in points))
        leaking = self._leaking(points, wavevectors)
        found = [_met(*each) for each in zip(points, guided, leaking, strict=True)]
        return np.array(found) / (2 * np.pi)

    def _leaking(self, points: Sequence[Point], wavevectors: Floats) -> Floats:
        """Return ω (N, F) of the leaking waves that points may be; nan for points that are slower, or numbered."""
        size = np.linalg.norm(wavevectors, axis=1)
        fast = 2 * np.pi * np.array([each.value for each in points]) > self.coupled.substrate.cutoff * size
        fast &= np.array([not numbered(each.branch) for each in points])
        if not fast.any():
            return np.empty((len(points), 0))
        steps = self._steps(float(size[fast].max() / np.linalg.norm(self.unit)))
        *_, last = self.followed(np.arange(1, steps + 1)[:, None, None] / steps * wavevectors[fast])
        found = np.full((len(points), last.shape[1]), np.nan)
        found[fast] = last.real
        return found

    def _steps(self, xi: float) -> int:
        """Return in how many steps leaking waves are followed over a range of wave numbers, rad per row."""
        return max(1, int(np.ceil(xi / (LONGEST_STEP * self.crossing) - _ROUNDING)))


def _met(point: Point, guided: Floats, leaking: Floats) -> float:
    """Return ω of the wave that a point is, of those that are there."""
    found = guided[np.isfinite(guided)]
    number = numbered(point.branch)
    found = found[number - 1 : number] if number else np.append(found, leaking[np.isfinite(leaking)])
    if not len(found):
        raise ValueError(f"line {point.line}: branch = {point.branch!r}: the layer has no such wave there")
    return float(found[np.argmin(np.abs(found - 2 * np.pi * point.value))])


def numbered(branch: str) -> int:
    """Return the number of "saw1", "saw2", …; 0 of "saw"."""
    return int(branch.removeprefix(BRANCH) or 0)


def is_surface_wave(point: Point) -> bool:
    """Return whether a point is a surface wave, by its branch."""
    return point.kind == "frequency" and re.fullmatch(rf"{BRANCH}([1-9]\d*)?", point.branch) is not None
