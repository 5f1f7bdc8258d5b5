"""The signals of sources by name: all that scenes, quiet ends, time steps, guards and studies know of each.

A new signal is one entry here and its formula in `granular_lmp.lammps.sources`. No field has a default, so that no
place takes a signal for another one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

SAMPLES = "samples"  # the signal that has no name in a scene, but a table


@dataclass(frozen=True)
class Signal:
    """What is known of a signal.

    Attributes
    ----------
    keys : tuple of str
        Keys of a source that it has, of those that not every signal has.
    lasts : callable
        Duration in τ of its ramp or burst, of (ramp, cycles, Ω).
    top : float
        Highest frequency that steps and looks must resolve, over Ω; 0 if it has none.
    band : callable
        Frequencies over Ω of the waves that it makes, of the number of cycles: Ω and the edges of its spectrum. Empty
        if the spectrum reaches down to waves that no number of quiet rows absorbs.
    """

    keys: tuple[str, ...]
    lasts: Callable[[float, float, float], float]
    top: float
    band: Callable[[float], tuple[float, ...]]


def _ramp(ramp: float, cycles: float, frequency: float) -> float:
    return ramp


def _periods(ramp: float, cycles: float, frequency: float) -> float:
    return 2 * pi * cycles / frequency


def _line(cycles: float) -> tuple[float, ...]:
    return (1.0,)


def _main_lobe(cycles: float) -> tuple[float, ...]:
    return 1 - 2 / cycles, 1.0, 1 + 2 / cycles


def _down_to_zero(cycles: float) -> tuple[float, ...]:
    return ()


SIGNALS = {
    "tone": Signal(("frequency", "hertz", "phase", "ramp"), _ramp, 1.0, _line),
    "burst": Signal(("frequency", "hertz", "phase", "cycles"), _periods, 1.0, _main_lobe),
    "ricker": Signal(("frequency", "hertz"), _ramp, 1.0, _down_to_zero),
    "step": Signal(("ramp",), _ramp, 0.0, _down_to_zero),
    SAMPLES: Signal((), _ramp, 1.0, _down_to_zero),
}
