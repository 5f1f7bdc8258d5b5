"""Signals of sources by name: all that scenes, quiet ends, time steps, guards and studies know about each.

A new signal is one entry here and its formula in `granular_lmp.lammps.sources`; a new key is also a key of
`granular_lmp.scene.sources.Source`. No field has a default, so every signal must state each property.
"""

from collections.abc import Callable
from math import pi
from typing import Any, Protocol

import numpy as np

from granular_lmp.frozen import dataclass

SAMPLES = "samples"  # a signal without a name in a scene: it has a table of samples


class Declared(Protocol):
    """Keys of a source that shape its signal (`granular_lmp.scene.sources.Source`)."""

    @property
    def cycles(self) -> float:
        """Periods of a burst or chirp."""

    @property
    def ramp(self) -> float:
        """Rise time of a tone or a step, τ."""

    @property
    def sweep(self) -> float:
        """Last frequency of a chirp over the first."""

    @property
    def phase(self) -> float:
        """Phase, rad."""


@dataclass(frozen=True)
class Signal:
    """Properties of a kind of signal.

    Attributes
    ----------
    keys : tuple of str
        Keys of a source that the signal uses, apart from the keys common to all signals.
    lasts : callable
        Function of a source and Ω: the duration of the ramp or burst, τ.
    top : callable
        Highest frequency, over Ω, that time steps and guards must resolve; 0 if there is none.
    band : callable
        Frequencies, over Ω, of the waves that it makes: Ω and the edges of its spectrum, the lowest first. Empty if the
        spectrum includes waves too long to be absorbed by any number of quiet rows.
    value : callable or None
        Function of a source, Ω and times τ since the beginning: the signal over its amplitude. Times may have a complex
        step. None for samples, which have a spline.
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
    """Return the time since the beginning over the duration of the ramp or burst, 0 before and 1 after it."""
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
