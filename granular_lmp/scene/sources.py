"""Sources: spheres that are moved, pushed or turned from outside, in a crystal at rest or in a wave.

A source has the signal a f(t), t = τ − delay, with x = Ωt and r(s) = s³(10 − 15s + 6s²), s clipped to [0, 1]:

    tone      r(t/ramp) cos(x − phase)
    burst     sin²(π s) cos(x − phase),  s = x/(2π cycles): a Hann window
    chirp     sin²(π s) cos(x (1 + (sweep − 1) s/2) − phase),  s = x (1 + sweep)/(4π cycles): from Ω to sweep Ω
    ricker    (1 − y²/2) e^{−y²/4},  y = x − 12: largest at t = 12/Ω; its spectrum has its maximum at Ω
    step      r(t/ramp)

or f interpolates samples, from a file or in the scene (`granular_lmp.scene.samples`).

The unit of the amplitude a is D0 for a motion, counted from rest, k1 D0 for a force, and k1 D0 R for a torque. Spheres
with a prescribed motion neither turn nor move across it; spheres with a prescribed rotation, Rθ in D0, only turn. Two
motions of one sphere cannot be added, and a force on a sphere that is moved or held has no effect: both are refused. A
wave does not act on moved spheres: it is cut off there, as at held rows.
"""

from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from math import pi
from typing import Protocol

import ase
import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene import samples
from granular_lmp.scene.places import AtPlaces, spheres_at
from granular_lmp.scene.schema import choice, number
from granular_lmp.scene.signals import SAMPLES, SIGNALS, Signal

AXES = ("x", "y", "z")
TORQUE, ROTATION = "torque", "rotation"  # about z; about x and y the name ends with the axis: torque_x
TORQUES, ROTATIONS = ((word, f"{word}_x", f"{word}_y") for word in (TORQUE, ROTATION))
# Edges of the spectrum over Ω, for any signal beside quiet ends: the main lobe Ω(1 ± 2/cycles) of a burst of 3 cycles
LOWEST = 1 / 3
_COMPLEX_STEP = 1e-30  # Its square is too small to change a derivative
LARGEST_ANGLE = 2e-3  # rad; the error of a torque in LAMMPS is then 1 - cos = 2e-6 (`granular_lmp.lammps.sources`)
FEWEST_STEPS = 20.0  # in a period of a source: the relative error of Verlet in frequency is then (2π/20)²/24, 0.4 %


class Scaled(Protocol):
    """Units of a scene."""

    @property
    def sphere(self) -> Sphere:
        """Sphere of the deck."""

    @property
    def displacement_amplitude(self) -> float:
        """D0 in metres."""


@dataclass(frozen=True)
class Source(AtPlaces):
    """Source: its spheres, how and along which axis it acts on them, and its signal over time.

    Attributes
    ----------
    rows : (first, last)
        All spheres of these rows and of those between, counted from 0; or
    spheres : sequence of (row, column)
    motion : "x", "y", "z", "rotation", "rotation_x" or "rotation_y", optional
        Axis of the prescribed displacement, in D0, or of the prescribed rotation φ = Rθ about z, x or y, in D0; or
    force : "x", "y", "z", "torque", "torque_x" or "torque_y", optional
        Axis of a force on each sphere, in k1 D0, or of a torque about z, x or y, in k1 D0 R. Only spheres in space can
        move along z, or turn about x and y.
    signal : "tone", "burst", "chirp", "ricker", "step", or sequence of (τ, value), behind a head of (s, N) or (s, m)
    amplitude : float
        Above 0; multiplies the values of samples. Good values: about 1, as D0 is small already.
    frequency, hertz : float, optional
        Ω in rad/t0, or in Hz; default: Ω of the wave. Samples have their own Ω (`samples.pulsation`).
    phase, delay, cycles, ramp : float
        In rad, τ, periods and τ. Good values: 5 cycles; a ramp of several periods, as a short ramp excites other waves.
    sweep : float
        Last frequency of a chirp over the first. Good values: 0.5 and 2, with 10 cycles or more.
    """

    motion: str | None = choice(
        "displacement from rest, in D0; for a rotation, R times the angle", (*AXES, *ROTATIONS), default=None
    )
    force: str | None = choice("on each sphere, in k1 D0; a torque in k1 D0 R", (*AXES, *TORQUES), default=None)
    signal: str | samples.Samples = field(
        default="tone",
        metadata={
            "rule": samples.SignalRule(str, "", "over time", words=tuple(name for name in SIGNALS if name != SAMPLES))
        },
    )
    amplitude: float = number("", "in D0, k1 D0 or k1 D0 R", 0, 100, open_low=True, default=1.0)
    frequency: float | None = number("rad/t0", "of the signal; left out: frequency of the wave", 1e-6, 20, default=None)
    hertz: float | None = number("Hz", "in place of frequency", 1e-6, 1e15, default=None)
    phase: float = number("rad", "phase of a tone, burst or chirp", -2 * pi, 2 * pi, default=0.0)
    delay: float = number("tau", "before the signal begins", 0, 1e7, default=0.0)
    cycles: float = number("", "number of periods in a burst or chirp", 1, 1e5, default=5.0)
    ramp: float = number("tau", "rise time of a tone or a step", 1, 1e5, default=20.0)
    sweep: float = number("", "last frequency of a chirp over the first", 0.01, 100, default=2.0)
    measured_words: str = ""  # length and size of a measured drive that `in_units` has converted

    def in_units(self, scene: Scaled) -> "Source":
        """Return the source with the samples of a measured drive in τ and in the unit of the amplitude.

        Raises SceneError if the measured quantity does not fit the source, such as a force in m.
        """
        head, pairs = samples.split(self.sampled)
        if not head:
            return self
        if bool(self.motion) == bool(
            self.force
        ):  # a later check refuses a source with neither motion nor force, or with both
            return replace(self, signal=pairs)
        sphere, length = scene.sphere, scene.displacement_amplitude
        if self.motion:
            needed, unit = ("angle", length / sphere.radius) if self.turns else ("motion", length)
        else:
            force = sphere.normal_stiffness * length
            needed, unit = ("torque", force * sphere.radius) if self.turns else ("force", force)
        what, _, si = head[1].partition("_")
        if what != needed:
            does = "motion" if self.motion else "force"
            raise SceneError(
                f'signal: has {head[1]}: must be {needed} with {does} = "{self.motion or self.force}"',
                because="physics",
            )
        most = self.amplitude * samples.largest(pairs)
        measured_words = f" ({len(pairs)} over {pairs[-1][0]:.4g} s, up to {most:.4g} {si})"
        reduced = tuple((seconds / sphere.time_scale, value / unit) for seconds, value in pairs)
        return replace(self, signal=reduced, measured_words=measured_words)

    @property
    def sampled(self) -> samples.Samples:
        """Samples of the signal; none if it has a name. A measured drive needs `in_units` first."""
        return () if isinstance(self.signal, str) else self.signal

    @property
    def kind(self) -> str:
        """Name of the signal."""
        return self.signal if isinstance(self.signal, str) else SAMPLES

    @property
    def known(self) -> Signal:
        """Properties of the kind of signal."""
        return SIGNALS[self.kind]

    @property
    def band(self) -> tuple[float, ...]:
        """Frequencies, over Ω, of the waves that it makes; empty if they reach down to 0."""
        return self.known.band(self)

    @property
    def largest(self) -> float:
        """Largest value of the signal, in the unit of the amplitude."""
        return self.amplitude * (samples.largest(self.sampled) if self.sampled else 1.0)

    @property
    def words(self) -> str:
        """Kind and signal in words: "burst of force along y"."""
        what = "motion along" if self.motion else "force along"
        return f"{self.kind} of {self.turns or f'{what} {self.motion or self.force}'}{self.measured_words}"

    @property
    def turns(self) -> str:
        """Word such as "torque" or "rotation_x" if the source turns spheres, else ""."""
        return next((word for word in (self.motion, self.force) if word in (*TORQUES, *ROTATIONS)), None) or ""

    @property
    def axis(self) -> str:
        """Axis along which the source moves or pushes spheres, or about which it turns them."""
        word = self.motion or self.force or ""
        return word if word in AXES else word.partition("_")[2] or "z"

    @property
    def leaves_plane(self) -> bool:
        """True if spheres confined to the plane cannot follow the source."""
        return (self.axis == "z") != bool(self.turns)

    @property
    def needs_frequency(self) -> bool:
        """True if the signal has a frequency but none is given, so that it takes the frequency of the wave."""
        return not self.sampled and self.known.top(self) > 0 and self.frequency is None and self.hertz is None

    def pulsation(self, sphere: Sphere, default: float) -> float:
        """Return Ω in rad/t0; `default` is Ω of the wave."""
        if self.sampled:
            return samples.pulsation(self.sampled)
        if self.hertz is not None:
            return 2 * pi * self.hertz * sphere.time_scale
        return default if self.frequency is None else self.frequency

    def top(self, sphere: Sphere, default: float) -> float:
        """Return the highest frequency that time steps must resolve, rad/t0; 0 if the signal has none."""
        return self.known.top(self) * self.pulsation(sphere, default)


@dataclass(frozen=True, eq=False)
class PlacedSource:
    """Source in its crystal.

    Attributes
    ----------
    source : Source
    spheres : (n,) int array
        Indices of its spheres, ascending.
    frequency : float
        Ω of its signal, rad/t0; a step does not use it.
    """

    source: Source
    spheres: NDArray[np.int64]
    frequency: float

    @property
    def words(self) -> str:
        """Words for its kind, frequency and number of spheres."""
        count = len(self.spheres)
        at = "" if not self.source.known.top(self.source) else f" at {self.frequency:.6g} rad per t0"
        return f"{self.source.words}{at} on {count} sphere{'s' if count > 1 else ''}"

    @property
    def lasts(self) -> float:
        """Duration of the ramp or burst, τ."""
        return self.source.known.lasts(self.source, self.frequency)

    def rate(self, tau: ArrayLike) -> NDArray[np.float64]:
        """Return the derivative of the signal at times τ, in the unit of the amplitude over t0."""
        since = np.asarray(tau, dtype=float) - self.source.delay
        if self.source.known.value is None:
            fit = samples.spline(self.source.sampled)
            inside = (since >= 0) & (since <= fit.x[-1])
            return np.asarray(self.source.amplitude * np.where(inside, fit(since, 1), 0.0))
        stepped = self.source.known.value(self.source, self.frequency, since + 1j * _COMPLEX_STEP)
        return np.asarray(self.source.amplitude * stepped.imag / _COMPLEX_STEP)

    @property
    def cost(self) -> int:
        """Measured computing time per step, in spheres of the crystal, mostly for its variables."""
        return (110 if self.source.motion else 30) * (3 if self.source.sampled else 1)


def placed(sources: Sequence[Source], crystal: ase.Atoms, sphere: Sphere, usual: float) -> tuple[PlacedSource, ...]:
    """Return the sources of a scene in its crystal at rest; `usual` is Ω of the wave, rad/t0.

    Raises
    ------
    SceneError
        If a place is empty, or another source moves or pushes a sphere that is moved.
    """
    if not sources:
        return ()
    row, column = crystal.arrays["row"], crystal.arrays["column"]
    found = []
    by: dict[int, tuple[int, bool]] = {}
    turned: dict[int, str] = {}
    for number_, source in enumerate(sources, 1):
        try:
            chosen = spheres_at(source.rows, source.spheres, crystal, "source", source.layers)
        except SceneError as error:
            raise SceneError(f"source {number_}: {error}", because=error.because) from error
        for each in chosen.tolist():
            other, moved = by.get(each, (0, False))
            if other and (moved or source.motion):
                raise SceneError(
                    f"source {number_}: sphere [{row[each]}, {column[each]}]: is in source {other} too; a sphere that "
                    "is moved must be in no other source",
                    because="physics",
                )
            by[each] = number_, bool(source.motion)
            if source.force in TORQUES and turned.setdefault(each, source.axis) != source.axis:
                raise SceneError(
                    f'source {number_}: force = "{source.force}": sphere [{row[each]}, {column[each]}] feels a torque '
                    "about another axis too, and LAMMPS has one dipole for both; take other spheres",
                    because="physics",
                )
        found.append(PlacedSource(source, chosen, source.pulsation(sphere, usual)))
    return tuple(found)


def longest_steps(sources: Sequence[Source], sphere: Sphere, usual: float) -> Iterator[tuple[float, str]]:
    """Yield the longest step, τ, that resolves the signal of each source, and the reason; `usual` is Ω of the wave."""
    for number_, each in enumerate(sources, 1):
        top = each.top(sphere, usual)
        if top:
            most = 2 * pi / top / FEWEST_STEPS
            yield (
                most,
                f"leaves a period of source {number_} fewer than {FEWEST_STEPS:g} steps at its frequency of {top:.6g} "
                f"rad per t0; must be at most {most:.4g}",
            )
