"""Every sphere of a run in LAMMPS beside the network of its first snapshot, with the time step extrapolated away.

LAMMPS's error of second order in the step is extrapolated away. What is left at the steps 0.05 and 0.025 is of fourth
order, and the rounding of positions, 1e-12 of 1e4 nm, which is 1e-10 of D0 at the amplitudes of these tests.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.snapshot import FirstSnapshot
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import loaded
from granular_lmp import Record, Scene, run

Fields = NDArray[np.float64]
STEPS = (0.05, 0.025)


@dataclass(frozen=True, eq=False)
class Pair:
    """A run extrapolated to no time step: its record and its fields."""

    record: Record
    fields: Fields


def _joined(*parts: Fields) -> Fields:
    return np.concatenate([each if each.ndim == 3 else each[..., None] for each in parts], axis=2)


def fields_of(record: Record) -> Fields:
    """Return displacements and Rθ of all spheres at all snapshots, (T, N, 3 or 6), in D0.

    Of a run without a wave, whose record holds all spheres, displacements, velocities and spins.
    """
    if record.scene.wave is None:
        return _joined(record.displacement, record.velocity, record.spin)
    return _joined(*record.snapshots().stacks("displacement", "rotation"))


def times_of(record: Record) -> Fields:
    """Return the times (T,) of `fields_of`."""
    return record.tau if record.scene.wave is None else record.snapshots().tau


def extrapolated(scene: Scene, folder: Path, steps: tuple[float, float] = STEPS, order: int = 2) -> Pair:
    """Return two runs of a scene extrapolated in the order of their error; the record has the folder of the finer."""
    coarse, fine = (run(scene.with_values({"time.timestep": step}), folder / str(step)) for step in steps)

    def best(one: Fields, other: Fields) -> Fields:
        return (2**order * other - one) / (2**order - 1)

    signals = {name: best(coarse.signals[name], values) for name, values in fine.signals.items()}
    return Pair(fine.with_signals(**signals), best(fields_of(coarse), fields_of(fine)))


def network_fields(first: FirstSnapshot, tau: Fields, longest: float = np.inf, rtol: float = 1e-9) -> Fields:
    """Return the fields of a network at times, as `fields_of` does."""
    longest_step = longest * first.time
    motion = integrate(first.network, first.state, tau * first.time, rtol=rtol, longest_step=longest_step)
    if first.recorded < 0:
        return _joined(*first.fields(motion))
    return _joined(motion.displacement / first.length, motion.rotation * first.radius / first.length)


def departure(found: Fields, expected: Fields) -> float:
    """Return the largest difference of a component over its own largest value, or a thirtieth of that of all."""
    size = np.abs(expected).max(axis=(0, 1))
    return float((np.abs(found - expected).max(axis=(0, 1)) / np.maximum(size, size.max() / 30)).max())


def changed(first: FirstSnapshot, **changes: Any) -> FirstSnapshot:
    """Return a first snapshot whose network is another one, in the same motion."""
    network: Network = replace(first.network, **changes)
    return replace(first, network=network, state=loaded(network, first.state.motion))
