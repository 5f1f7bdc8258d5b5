"""The solitary wave in LAMMPS: its speed and largest velocity against the travelling-wave equation."""

from math import acos, pi, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from cases.impact.case import lammps
from cases.solitary.chain import uniform
from cases.solitary.chain_motion import march, peak
from cases.solitary.travelling import solitary_wave
from granular_lmp import Scene, run
from tests.conftest import members
from tests.manual import Measure, Mutant, verifies

COUNT, END = 60, 66.0  # the wave has passed sphere 51, and not come to the end
WATCHED = (40, 51)


class Row(NamedTuple):
    """Times (T,) and the velocities (T, k) of the watched spheres in a row that is struck at the velocity 1."""

    times: np.ndarray
    velocities: np.ndarray

    @property
    def speed_and_height(self) -> np.ndarray:
        """Return the speed and the largest velocity of the wave."""
        (height, first), (_, second) = (peak(self.times, self.velocities[:, sphere]) for sphere in (0, -1))
        return np.array([(WATCHED[1] - WATCHED[0] - 1) / (second - first), height])


@pytest.fixture(scope="module")
def pair() -> tuple[Row, Row]:
    return tuple(Row(*lammps(COUNT, step, round(END / step), 1, WATCHED)[:2]) for step in (0.05, 0.025))


def test_lammps_carries_the_solitary_wave(pair: tuple[Row, Row]) -> None:
    coarse, fine = (row.speed_and_height for row in pair)
    speed, velocity = (4 * fine - coarse) / 3
    # Higher orders of the step are left: a sixteenth of 1e-4, the pair's difference
    assert speed == pytest.approx(0.84050877, abs=1e-5)
    assert velocity == pytest.approx(0.68163155, abs=1e-5)
    wave = solitary_wave(1.0)
    assert speed / velocity**0.2 == pytest.approx(wave.speed / wave.largest_velocity**0.2, abs=1e-5)
    assert coarse[0] != pytest.approx(0.84050877, abs=5e-5)  # what one run of this step has


@verifies(
    "Pulse in a chain of 60 steel beads: velocity, width, and speed of Nesterenko's long waves",
    reference="other code: 0.68 m/s, 3.96 diameters at 1 % of the peak, 13 % narrower than cos⁴, speed within 0.8 %",
    tolerance=0.008,
    reason="the difference of a long wave, and two digits",
    mutant=Mutant(
        "granular_lmp/lammps/contact.py",
        'force = f"hertz/material {modulus!r}',
        'force = f"hertz/material {0.98 * modulus!r}',
    ),
)
def test_the_pulse_in_steel_beads_is_that_of_another_code(tmp_path: Path, measured: Measure) -> None:
    steel = {"sphere.youngs_modulus": 203e9, "sphere.density": 7780.0}
    seen = {"time.duration": 66.0, "time.sample": 0.1, "output.rows": [40, 50]}
    record = run(Scene.load("solitary_chain").with_values(steel | seen), tmp_path / "run")
    velocities = record.velocity[:, :, 1]
    (height, first), (_, last) = (peak(record.tau, velocities[:, bead]) for bead in (0, -1))
    speed = 10 / (last - first)  # beads, a diameter each, in a unit of time
    velocity = height * record.scale.velocity
    measured(velocity / 0.68 - 1)
    theta = 3 * (1 - 0.3**2) / (4 * 203e9)
    long_wave = (6 / (5 * pi * 7780 * theta)) ** 0.4 * velocity**0.2  # C. Coste, E. Falcon, S. Fauve 1997
    measured(speed * 0.01 / record.scale.time / long_wave - 1)
    shape = CubicSpline(record.tau, velocities[:, 0] / height)

    def width(share: float) -> float:
        times = shape.solve(share, extrapolate=False) - first
        return float(speed * (times[times > 0].min() - times[times < 0].max()))

    measured(width(0.01) / 3.96 - 1)
    half_of_cosine = 2 * acos(0.5**0.25) * 5 / sqrt(10)
    measured(width(0.5) / half_of_cosine - 0.87)


def test_the_wave_in_lammps_has_the_exact_shape(pair: tuple[Row, Row]) -> None:
    coarse, fine = pair
    velocities = (4 * fine.velocities[::2, 0] - coarse.velocities[:, 0]) / 3
    _, moment = peak(coarse.times, velocities)
    wave = solitary_wave(0.84050877)
    exact = wave.at(wave.speed * (coarse.times - moment))[1]
    near = np.abs(coarse.times - moment) < 4
    # The fourth order of the step is left, 0.05⁴ = 6e-6 times derivatives of order 1
    assert np.max(np.abs(velocities - exact)[near]) < 1e-5
    assert np.max(np.abs(velocities - 1.01 * exact)[near]) > 5e-3


def test_each_run_has_the_error_of_its_step(pair: tuple[Row, Row]) -> None:
    found = [speed / velocity**0.2 for speed, velocity in (row.speed_and_height for row in pair)]
    # As velocity Verlet on the same row; peaks between samples are good to 1e-9
    assert found == pytest.approx([0.9075651, 0.9074938], abs=2e-7)


@pytest.fixture(scope="module")
def short() -> np.ndarray:
    """Velocities (6, 20) of a row that is struck at the velocity 1, each 20 steps."""
    return np.asarray(lammps(20, 0.1, 100, 20, (0, 20))[1])


def test_lammps_is_velocity_verlet_to_rounding(short: np.ndarray) -> None:
    velocities, v = short, np.eye(20)[0]
    _, expected = march(uniform(20), 0 * v, v, 0.1, 100, every=20)
    # Positions of 1e4 overlaps carry 1e-12, over 100 steps
    assert velocities[1:] == pytest.approx(expected, abs=1e-9)
    assert velocities[1:] != pytest.approx(np.roll(expected, 1, axis=0), abs=1e-3)


@pytest.mark.parametrize("velocity", members([1e-6, 1e-3, 1e2], 1e-3, 1e2))
def test_strikers_of_any_velocity_make_the_same_wave_in_lammps(velocity: float, short: np.ndarray) -> None:
    scale, plain = velocity**-0.2, short
    _, found, _ = lammps(20, 0.1 * scale, 100, 100, (0, 20), velocity)
    # Positions of 2e4 carry 4e-12, overlaps are v^{4/5}: 2e-7 of them at 1e-6, summed over 100 steps
    allowed = 1e-9 + 3e-11 * velocity**-0.8
    assert found[-1] / velocity == pytest.approx(plain[-1], abs=allowed)
    assert np.max(np.abs(found[-1] / velocity - 1.001 * plain[-1])) > 2 * allowed
