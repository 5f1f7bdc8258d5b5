"""Chains of two masses in turn: the band gap in LAMMPS, and the shipped breather, which tests/hard runs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cases.solitary.breather import breather
from cases.solitary.chain import Chain, bands, linear_stiffness, spheres
from granular_lmp import ImpactScene, run_impact
from granular_lmp.problem import prepare

Floats = NDArray[np.float64]
SHIPPED = ImpactScene.load("breather")
COUNT, MIDDLE = 43, 21
FORCE, RADIUS = 20.0, 9.525e-3
HEAVY = {"youngs_modulus": 193e9, "poisson_ratio": 0.30, "density": 8000.0}
HOLLOW = HEAVY | {"density": 800.0}  # a tenth of the mass
ALUMINIUM = {"youngs_modulus": 70e9, "poisson_ratio": 0.33, "density": 2700.0}


def theory(light: dict[str, float], count: int = COUNT) -> Chain:
    """The chain of heavy and light spheres in SI units, heavy ones at its free, loaded ends."""
    kinds = [HEAVY, light]
    values = np.array([[kinds[row % 2][name] for row in range(count)] for name in HEAVY])
    return spheres(RADIUS, values[2], values[0], values[1], force=FORCE)


def scene(light: dict[str, float], state: Any, count: int = COUNT, **time: float) -> ImpactScene:
    """The same chain as a scene that begins in a state."""
    return ImpactScene.from_dict(
        {
            "sphere": HEAVY | {"radius": RADIUS},
            "packing": {"rows": count, "contact_force": FORCE},
            "start": {"state": state},
            "time": time,
            "inclusion": [{"rows": [1, count - 2], "every": 2} | light],
        }
    )


def test_the_shipped_scene_is_the_breather_of_the_theory() -> None:
    chain = theory(HOLLOW)
    frequency = 0.75 * bands((chain.mass[0], chain.mass[1]), linear_stiffness(chain)[1])[1]
    guess = np.zeros(COUNT)
    guess[MIDDLE - 1 : MIDDLE + 2] = -0.25, 0.9, -0.25
    u, period = breather(chain, frequency, guess * chain.overlap[1]), 2 * np.pi / frequency
    u -= u.mean()
    motion = prepare(SHIPPED).rest.state
    # Ten digits are written
    assert motion[:, 1] == pytest.approx(u, abs=1e-9 * float(np.max(np.abs(u))))
    assert not motion[:, [0, 2, 3, 4]].any()
    assert SHIPPED.time.duration * SHIPPED.scale.time > 100 * period
    assert SHIPPED.packing.contact_force == pytest.approx(chain.load[0], rel=1e-9)


def test_a_kicked_chain_is_silent_in_the_gap(tmp_path: Path) -> None:
    count, samples = 83, 1024
    chain = theory(ALUMINIUM, count)
    low, high, top = bands((chain.mass[0], chain.mass[1]), linear_stiffness(chain)[1])
    kick = np.random.default_rng(2).standard_normal(count)
    kick -= kick.mean()
    # Displacements stay below 1e-3 of the overlap at rest
    velocity = 1e-4 * chain.overlap[1] * low * kick
    state = [[row, 0, 0, 0, 0, float(velocity[row]), 0] for row in range(count)]
    unit = scene(ALUMINIUM, state, count, duration=1.0).scale.time
    sample = 0.8 / top * 2.0 / unit  # half a period of the top is π/top
    kicked = scene(ALUMINIUM, state, count, timestep=sample / 12, sample=sample, duration=(samples - 0.5) * sample)
    record = run_impact(kicked.with_values({"output.rows": [30, 45]}), tmp_path / "run")
    motion = record.velocity[..., 1]
    assert len(motion) == samples
    power = np.sum(np.abs(np.fft.rfft(motion * np.hanning(samples)[:, None], axis=0)) ** 2, axis=1)
    frequency = 2 * np.pi * np.fft.rfftfreq(samples, sample * unit)

    def share(lowest: float, highest: float) -> float:
        return float(power[(frequency > lowest) & (frequency < highest)].sum() / power.sum())

    # Hann's window leaks 1e-6 of a line at a distance of 5 %; the quadratic force makes 1e-8
    assert share(1.05 * low, 0.97 * high) < 1e-5
    assert share(0.9 * low, 0.97 * high) > 1e-2  # a gap that began below the edge is seen
    assert share(-1.0, 1.05 * low) + share(0.97 * high, 1.05 * top) == pytest.approx(1, abs=1e-5)
    # Hann's window spreads each mode over two lines on either side, and the modes next to an edge are a line from it
    loud, line = frequency[power > 1e-4 * power.sum()], float(frequency[1])
    assert loud[loud < (low + high) / 2].max() == pytest.approx(low, abs=3 * line)
    assert loud[loud > (low + high) / 2].min() == pytest.approx(high, abs=3 * line)
    assert loud.max() == pytest.approx(top, abs=3 * line)
