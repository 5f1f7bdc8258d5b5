"""Solitary waves that meet each other, a wall, an impurity, or are made by many strikers."""

import re

import numpy as np
import pytest

from cases.solitary.chain import compressed, energies, uniform
from cases.solitary.chain_motion import SIXTH, integrate, march
from cases.solitary.scattering import WAVE, crossing, impurity


def head_on(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocities over time of two equal waves that meet in the middle, and the energies at the end."""
    chain = uniform(count)
    u, v = WAVE.start(count, 12.0)
    us, vs = march(chain, u - u[::-1], v - v[::-1], 0.1, 500, SIXTH, every=5)
    return vs, energies(chain, us[-1], vs[-1])


@pytest.mark.parametrize(("count", "last", "stiffness"), [(60, 1.0, 8**0.5), (59, np.inf, 0.0)], ids=["wall", "held"])
def test_a_wave_is_thrown_back_as_two_waves_meet(count: int, last: float, stiffness: float) -> None:
    both, _ = head_on(count)
    half = (count + 1) // 2
    equal = uniform(half)
    masses, contacts = equal.mass.copy(), equal.stiffness.copy()
    masses[-1], contacts[-1] = last, stiffness
    u, v = WAVE.start(half, 12.0)
    v[-1] *= np.isfinite(last)
    _, vs = march(compressed(masses, contacts), u, v, 0.1, 500, SIXTH, every=5)
    # The same motion but for rounding of 500 steps
    assert np.max(np.abs(vs - both[:, :half])) < 1e-11


def test_waves_that_meet_at_a_contact_leave_more_behind_than_at_a_sphere() -> None:
    contact, sphere = crossing("contact"), crossing("sphere")
    # Steps of half the length change the shares by 1e-7 and the leads by 1e-7
    assert contact.secondary == pytest.approx(2.9624e-3, abs=1e-6)
    assert sphere.secondary == pytest.approx(4.466e-4, abs=1e-6)
    assert contact.lead == pytest.approx(0.35657, abs=1e-5)
    assert sphere.lead == pytest.approx(0.36012, abs=1e-5)
    for found in (contact, sphere):
        # A wave's energy goes with the square of its velocity: the secondary share is all that is missing
        assert found.velocity**2 + found.secondary == pytest.approx(1, abs=1e-6)


def test_a_collision_by_dop853_leaves_the_same_energy_behind() -> None:
    count, middle = 100, 50
    chain = uniform(count)
    u, v = WAVE.start(count, 12.0)
    us, vs = integrate(chain, u - u[::-1], v - v[::-1], [38.0 + 32.0], 1e-9)
    shares = energies(chain, us[0], vs[0]) / energies(chain, u - u[::-1], v - v[::-1]).sum()
    # The waves are 32 spheres from the middle, and the secondary ones, of 0.56 of their speed, within 22
    assert shares[middle - 24 : middle + 24].sum() == pytest.approx(crossing("contact").secondary, abs=2e-6)


def test_an_equal_sphere_is_no_impurity() -> None:
    found = impurity(1.0)
    # A wave that moves by steps has 1e-9 of its velocity, and the shares are sums of rounding
    assert found.transmitted == pytest.approx(1, abs=1e-9)
    assert found.velocity == pytest.approx(1, abs=1e-8)
    assert found.reflected < 1e-12
    assert found.kept < 1e-12


@pytest.mark.parametrize(
    ("mass", "transmitted", "reflected"),
    [(0.125, 0.96226, 0.03740), (0.5, 0.97561, 0.02392), (2.0, 0.93034, 0.06962), (8.0, 0.47309, 0.52635)],
)
def test_the_shares_of_an_impurity(mass: float, transmitted: float, reflected: float) -> None:
    found = impurity(mass)
    # The shares change by 2e-6 when the step is halved
    assert found.transmitted == pytest.approx(transmitted, abs=1e-5)
    assert found.reflected == pytest.approx(reflected, abs=1e-5)
    assert found.transmitted + found.reflected + found.kept == pytest.approx(1, abs=1e-5)


def test_a_light_impurity_vibrates_and_gaps_open_beside_it() -> None:
    count, place = 61, 30
    masses = np.ones(count)
    masses[place] = 0.125
    chain = compressed(masses, uniform(count).stiffness)
    u, v = WAVE.start(count, 15.0)
    us, vs = march(chain, u, v, 0.05, 500, SIXTH, every=1)
    gaps = us[:, place] - us[:, place + 1] < 0
    assert np.count_nonzero(np.diff(gaps.astype(int)) == 1) >= 2  # opens, closes, and opens again
    relative = vs[:, place] - (vs[:, place - 1] + vs[:, place + 1]) / 2
    turns = np.count_nonzero(np.diff(np.sign(relative[280:400])) != 0)
    assert turns >= 6  # three vibrations in six units of time, in which the wave moves by six spheres, its length


@pytest.mark.parametrize("strikers", [1, 2, 3])
def test_as_many_strikers_make_as_many_solitary_waves(strikers: int) -> None:
    count = 140
    v = np.where(np.arange(count) < strikers, 1.0, 0.0)
    _, vs = march(uniform(count), 0 * v, v, 0.1, 2000, SIXTH, every=1)
    seen = vs[:, 110]
    peaks = np.flatnonzero((seen[1:-1] > seen[:-2]) & (seen[1:-1] >= seen[2:]) & (seen[1:-1] > 1e-3)) + 1
    assert len(peaks) == strikers
    heights = seen[peaks]
    assert np.all(np.diff(heights) < 0)  # the largest is the fastest


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: crossing("wall"), "meeting must be 'contact' or 'sphere', not 'wall'"),
        (lambda: impurity(0.0), "mass must be from 0.1 to 30 times that of a sphere, not 0"),
        (lambda: impurity(1e4), "mass must be from 0.1 to 30 times that of a sphere, not 10000"),
    ],
)
def test_what_is_not_known_is_refused(call, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        call()
