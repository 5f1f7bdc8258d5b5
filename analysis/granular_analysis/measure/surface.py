"""Surface waves of an elastic substrate under the layer of a scene: branches, and frequencies of measured points.

The substrate has the moduli and the density of `[substrate]`; by default the density is that of the spheres. In a run
the substrate is rigid. The theory is `granular_analysis.theory.surface_wave`.
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
BRANCH = "saw"  # branch of a point: the nearest surface wave; saw1, saw2, ... are guided waves, lowest first
SHOWN = 1.6  # highest shown frequency over the vertical resonance
_ABOVE = 1.5  # a plate has infinitely many waves: they are sought up to this multiple of the highest measured frequency
STILL = 1e-6  # frequency over the vertical resonance below which no contact holds the spheres
_ROUNDING = 1e-12  # decay over frequency below which the decay is rounding
SLOWEST = 1e-3  # leaking waves are followed from this share of the first wave number on
STEP = 0.05  # largest relative change of the frequency of a leaking wave in one step of the wave number
LONGEST_STEP = 1 / 40  # longest such step, over the wave number where surface wave and vertical resonance cross


class Wave(NamedTuple):
    """A surface wave.

    Attributes
    ----------
    wavenumber : rad per row.
    wavelength : m.
    kind : "guided" or "leaking".
    frequency_Hz : Hz.
    attenuation : decay rate of the amplitude, 1/s; 0 for a guided wave.
    vertical, along, across, turning : shares of the spheres' Σ(u² + φ²), φ = Rθ: vertical, along k, across k, and φ.
    surface : amplitude of the surface over the root mean square amplitude of a sphere.
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
        """Return the quality factor Q = πf/Γ, with Γ the attenuation; inf without attenuation."""
        return np.pi * self.frequency_Hz / self.attenuation if self.attenuation else np.inf


class Film(NamedTuple):
    """The layer of a scene on its substrate.

    Attributes
    ----------
    coupled : layer and substrate.
    solid : material of the substrate.
    unit : (2,) wave vector of one rad per row, rad/m.
    own : vertical resonance √(K_N/m) of a sphere on a rigid substrate, rad/s.
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
        """Return the layer of a scene on its substrate.

        Parameters
        ----------
        setting : setting of the scene.
        density : density of the substrate, kg/m³; None for that of the scene.
        degrees : direction of the wave; None for that of the scene.
        thickness : thickness of the substrate, m; None for a half-space.
        below : half-space under a substrate with a thickness; None for a free plate.

        Raises ValueError for a scene without a substrate, with two plates, or with an incompressible substrate.
        """
        substrate = setting.scene.substrate
        if substrate is None or substrate.sides != "below":
            raise ValueError('[substrate]: missing, or has sides = "both"; surface waves need one substrate, below')
        if substrate.poisson_ratio >= 0.5:
            raise ValueError("substrate.poisson_ratio = 0.5: must be below 0.5, because surface waves compress it")
        crystal = setting.crystal(true_geometry=False)
        heavy = density or substrate.density or setting.scene.sphere.density
        solid = HalfSpace.of(substrate.youngs_modulus, substrate.poisson_ratio, heavy)
        own = float(np.sqrt(crystal.bonds.law.stiffness[-1] / crystal.mass[0, 0]))
        way = frame(setting.scene.direction if degrees is None else degrees)[0]
        body = Layered((Slab(solid, thickness),), below) if thickness else solid
        return cls(Coupled(crystal, body), solid, setting.unit * way, own)

    @property
    def highest(self) -> float:
        """Return the highest shown frequency, rad/s."""
        return SHOWN * self.own

    @property
    def crossing(self) -> float:
        """Return the wave number at which the bare surface wave crosses the vertical resonance, rad per row."""
        return float(self.own / self.solid.rayleigh() / np.linalg.norm(self.unit))

    def wave(self, xi: float, omega: complex, kind: str) -> Wave:
        """Return the wave with wave number ξ (rad per row), complex frequency ω (rad/s) and kind."""
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
        """Return the guided waves at wave numbers (rad per row)."""
        found = self._guided(np.multiply.outer(numbers, self.unit), self.highest)
        return [
            self.wave(float(xi), complex(omega), "guided")
            for xi, row in zip(numbers, found, strict=True)
            for omega in row[np.isfinite(row)]
        ]

    def _guided(self, wavevectors: Floats, highest: float) -> Floats:
        """Return ω (N, J) of the guided waves, rad/s, in a plate up to `highest`; nan without a restoring force."""
        below = np.inf if np.isfinite(self.coupled.substrate.cutoff) else highest
        found = self.coupled.guided(wavevectors, below)
        return np.where(found > STILL * self.own, found, np.nan)

    def leaking(self, numbers: Floats) -> Iterator[Wave]:
        """Yield the leaking waves at ascending wave numbers (rad per row)."""
        between = self._steps(float(np.diff(numbers, prepend=0.0).max()))
        path = np.interp(np.arange(1, between * len(numbers) + 1) / between, range(len(numbers) + 1), [0, *numbers])
        for step, found in enumerate(self.followed(path[:, None] * self.unit), 1):
            if step % between == 0:
                xi = float(path[step - 1])
                yield from (self.wave(xi, complex(omega), "leaking") for omega in found[np.isfinite(found)])

    def followed(self, path: Floats) -> Iterator[Complexes]:
        """Yield ω (..., F) of the leaking waves, rad/s, at each step of a path (S, ..., 2) of wave vectors from k = 0.

        The waves start as resonances on a rigid substrate near k = 0. A wave is nan from the step on at which it leaks
        no longer.
        """
        found = self.resonances(SLOWEST * path[0])[1]
        for vector in path:
            last, found = found, self.coupled.leaking(vector, found)
            slowest = self.coupled.substrate.cutoff * np.linalg.norm(vector, axis=-1)[..., None]
            # Comparisons with nan are False, so a wave that is lost stays lost
            found = np.where((np.abs(found - last) < STEP * np.abs(last)) & (found.real >= slowest), found, np.nan)
            yield found

    def resonances(self, wavevector: Floats) -> tuple[Floats, Complexes]:
        """Return ω (..., F), rad/s, at wave vectors (..., 2) near 0: on a rigid substrate, and of the leaking waves."""
        rigid = self.coupled.crystal.frequencies(wavevector)
        held = np.where(rigid > STILL * self.own, rigid, np.nan)
        return held, self.coupled.leaking(wavevector, held)

    def met(self, points: Sequence[Point], wavevectors: Floats) -> Floats:
        """Return the frequencies (N,), Hz, of the waves nearest to measured points at wave vectors (N, 2), rad/m.

        Raises ValueError for a point without a wave of its branch.
        """
        guided = self._guided(wavevectors, _ABOVE * 2 * np.pi * max(each.value for each in points))
        leaking = self._leaking(points, wavevectors)
        found = [_met(*each) for each in zip(points, guided, leaking, strict=True)]
        return np.array(found) / (2 * np.pi)

    def _leaking(self, points: Sequence[Point], wavevectors: Floats) -> Floats:
        """Return ω (N, F) of the leaking waves at points; nan for points that are too slow to leak, or numbered."""
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
        """Return the number of steps in which leaking waves are followed from 0 to a wave number ξ, rad per row."""
        return max(1, int(np.ceil(xi / (LONGEST_STEP * self.crossing) - _ROUNDING)))


def _met(point: Point, guided: Floats, leaking: Floats) -> float:
    """Return ω of the wave of a point, rad/s: by its number, or the nearest of all guided and leaking waves."""
    found = guided[np.isfinite(guided)]
    number = numbered(point.branch)
    found = found[number - 1 : number] if number else np.append(found, leaking[np.isfinite(leaking)])
    if not len(found):
        raise ValueError(f"line {point.line}: branch = {point.branch!r}: no such wave at this wave number")
    return float(found[np.argmin(np.abs(found - 2 * np.pi * point.value))])


def numbered(branch: str) -> int:
    """Return the number in "saw1", "saw2", …; 0 for "saw" and for an empty branch."""
    return int(branch.removeprefix(BRANCH) or 0)


def is_surface_wave(point: Point) -> bool:
    """Return whether the branch of a point names a surface wave."""
    return point.kind == "frequency" and re.fullmatch(rf"{BRANCH}([1-9]\d*)?", point.branch) is not None
