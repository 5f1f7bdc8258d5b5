"""The signals of sources by name: all that scenes, quiet ends, time steps, guards and studies know of each.

A new signal is one entry here and its formula in `granular_lmp.lammps.sources`; a key that no other signal has is also
a key of `granular_lmp.scene.sources.Source`. No field has a default, so that no place takes a signal for another one.
"""

from collections.abc import Callable
from math import pi
from typing import Any, Protocol

import numpy as np

from granular_lmp.frozen import dataclass

SAMPLES = "samples"  # the signal that has no name in a scene, but a table


class Declared(Protocol):
    """Keys of a source that say how its signal is (`granular_lmp.scene.sources.Source`)."""

    @property
    def cycles(self) -> float:
        """Periods of a burst or chirp."""

    @property
    def ramp(self) -> float:
        """Time in which a tone or a step rises, τ."""

    @property
    def sweep(self) -> float:
        """Last frequency of a chirp over its first."""

    @property
    def phase(self) -> float:
        """Phase, rad."""


@dataclass(frozen=True)
class Signal:
    """Properties of a kind of signal.

    Attributes
    ----------
    keys : tuple of str
        Keys of a source that it has, of those that not every signal has.
    lasts : callable
        Duration in τ of its ramp or burst, of a source and Ω.
    top : callable
        Highest frequency that steps and looks must resolve, over Ω; 0 if it has none.
    band : callable
        Frequencies over Ω of the waves that it makes: Ω and the edges of its spectrum, the lowest first. Empty if the
        spectrum reaches down to waves that no number of quiet rows absorbs.
    value : callable or None
        Signal over its amplitude, of a source, Ω and times τ since it began, which may have a complex step; None of
        samples, which have a spline.
    """

    keys: tuple[str, ...]
    lasts: Callable[[Declared, float], float]
    top: Callable[[Declared], float]
    band: Callable[[Declared], tuple[float, ...]]
    value: "Callable[[Declared, float, Any], Any] | None"


def _ramp(source: Declared, frequency: float) -> float:
    return source.ramp


def _periods(source: Declared, frequency: float) -> float:
    return 2 * pi * source.cycles / frequency


def _swept_periods(source: Declared, frequency: float) -> float:
    return _periods(source, (1 + source.sweep) / 2 * frequency)


def _usual(source: Declared) -> float:
    return 1.0


def _none(source: Declared) -> float:
    return 0.0


def _higher_end(source: Declared) -> float:
    return max(1.0, source.sweep)


def _line(source: Declared) -> tuple[float, ...]:
    return (1.0,)


def _main_lobe(source: Declared) -> tuple[float, ...]:
    return 1 - 2 / source.cycles, 1.0, 1 + 2 / source.cycles


def _swept_lobes(source: Declared) -> tuple[float, ...]:
    low, high = sorted((1.0, source.sweep))
    lobe = (1 + source.sweep) / source.cycles
    return low - lobe, low, high, high + lobe


def _down_to_zero(source: Declared) -> tuple[float, ...]:
    return ()


def _share(tau: Any, lasts: float) -> Any:
    """Return the time since the beginning as a share of the ramp or of the burst, 0 before and 1 after it."""
    return np.where(tau.real < 0, 0.0, np.where(tau.real < lasts, tau / lasts, 1.0))


def _tone(source: Declared, frequency: float, tau: Any) -> Any:
    return _step(source, frequency, tau) * np.cos(frequency * tau - source.phase)


def _burst(source: Declared, frequency: float, tau: Any) -> Any:
    share = _share(tau, _periods(source, frequency))
    return np.sin(pi * share) ** 2 * np.cos(frequency * tau - source.phase)


def _chirp(source: Declared, frequency: float, tau: Any) -> Any:
    share = _share(tau, _swept_periods(source, frequency))
    turned = frequency * tau * (1 + (source.sweep - 1) / 2 * share)
    return np.sin(pi * share) ** 2 * np.cos(turned - source.phase)


def _step(source: Declared, frequency: float, tau: Any) -> Any:
    share = _share(tau, source.ramp)
    return share**3 * (10 - 15 * share + 6 * share**2)


def _ricker(source: Declared, frequency: float, tau: Any) -> Any:
    y = frequency * tau - 12
    return (1 - y**2 / 2) * np.exp(-(y**2) / 4)


SIGNALS = {
    "tone": Signal(("frequency", "hertz", "phase", "ramp"), _ramp, _usual, _line, _tone),
    "burst": Signal(("frequency", "hertz", "phase", "cycles"), _periods, _usual, _main_lobe, _burst),
    "chirp": Signal(
        ("frequency", "hertz", "phase", "cycles", "sweep"), _swept_periods, _higher_end, _swept_lobes, _chirp
    ),
    "ricker": Signal(("frequency", "hertz"), _ramp, _usual, _down_to_zero, _ricker),
    "step": Signal(("ramp",), _ramp, _none, _down_to_zero, _step),
    SAMPLES: Signal((), _ramp, _usual, _down_to_zero, None),
}
