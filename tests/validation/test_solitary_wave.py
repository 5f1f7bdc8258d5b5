"""The solitary wave in LAMMPS: its speed and largest velocity against the travelling-wave equation."""

from typing import NamedTuple

import numpy as np
import pytest

from cases.impact.case import lammps
from granular_analysis.theory.chain import uniform
from granular_analysis.theory.chain_motion import march, peak
from granular_analysis.theory.solitary import solitary_wave
from tests.conftest import members

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
