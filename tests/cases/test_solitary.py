"""The solitary wave of the travelling-wave equation, against chains that are integrated and against its limits."""

import re

import numpy as np
import pytest

from cases.solitary.chain import acceleration, overlaps, uniform
from cases.solitary.chain_motion import integrate, peak
from cases.solitary.travelling import SolitaryWave, long_wave_speed, solitary_wave, sound
from tests.manual import Measure, Mutant, off, verifies

# V / v^{1/5} and V / δ^{1/4} for A = m = 1
OVER_VELOCITY, OVER_OVERLAP = 0.9074700784122, 0.9055157764191


def constants(wave: SolitaryWave) -> tuple[float, float]:
    return wave.speed / wave.largest_velocity**0.2, wave.speed / wave.largest_overlap**0.25


# --- spheres that just touch ------------------------------------------------------------------------------------------


def test_the_constants_are_those_of_the_travelling_wave() -> None:
    # The iteration stops at 1e-13
    assert constants(solitary_wave(1.0)) == pytest.approx((OVER_VELOCITY, OVER_OVERLAP), rel=1e-12)


@verifies(
    "Solitary wave of touching spheres, velocity near its crest",
    reference="other integrator: a struck chain by DOP853",
    tolerance=1e-07,
    reason="errors of 3e-9 of DOP853, and 6e-8 at sphere 25 where the start is still near",
    mutant=Mutant("analysis/cases/solitary/travelling.py", "force = change**2", "force = 1.001 * change**2"),
)
def test_a_chain_struck_at_unit_velocity_carries_this_wave(measured: Measure) -> None:
    count, times = 70, np.arange(0.0, 74.0, 0.1)
    us, vs = integrate(uniform(count), np.zeros(count), np.eye(count)[0], times, 1e-11)
    (height, first), (again, second) = (peak(times, vs[:, sphere]) for sphere in (45, 55))
    speed = 10 / (second - first)
    # Errors of 1e-10 of DOP853 at the impact, and of 1e-9 of peaks between samples of 0.1
    assert speed == pytest.approx(0.84050877, abs=1e-8)
    assert height == pytest.approx(0.68163155, abs=1e-8)
    assert again == pytest.approx(height, abs=1e-8)
    assert speed / height**0.2 == pytest.approx(OVER_VELOCITY, abs=1e-8)
    deepest, _ = peak(times, us[:, 49] - us[:, 50])
    assert speed / deepest**0.25 == pytest.approx(OVER_OVERLAP, abs=1e-8)
    assert speed / height**0.2 != pytest.approx(0.914610, abs=1e-3)  # the long-wave theory is told apart
    exact = solitary_wave(speed).at(speed * (times - first))[1]
    near = np.abs(times - first) < 6
    measured(off(vs[near, 45], exact[near], size=1))
    assert np.max(np.abs(vs[near, 45] - np.roll(exact, 1)[near])) > 1e-2


def test_the_scale_of_the_wave_follows_from_dimensions() -> None:
    wave = solitary_wave(3.7, stiffness=2e9, mass=0.03)
    rate = 2e9 / 0.03
    assert wave.speed / (rate**0.4 * wave.largest_velocity**0.2) == pytest.approx(OVER_VELOCITY, rel=1e-12)
    assert wave.speed / (rate**0.5 * wave.largest_overlap**0.25) == pytest.approx(OVER_OVERLAP, rel=1e-12)


def test_the_wave_falls_faster_than_any_exponential() -> None:
    wave = solitary_wave(1.0)
    overlap, _ = wave.at(np.arange(5))
    steps = np.log(overlap[1:] / overlap[:-1])
    # ln r(s + 1) = (3/2) ln r(s) + …: the ratios grow by more than 1.5 until rounding, at 1e-15 of the crest
    assert np.all(steps[1:4] / steps[:3] > 1.5)


# --- compressed spheres -----------------------------------------------------------------------------------------------


def test_a_weak_wave_is_the_kdv_soliton() -> None:
    unit = sound(1.0, 1.0, 1.0)
    ratios = np.array([1.004, 1.002, 1.001])
    waves = [solitary_wave(ratio * unit, rest=1.0) for ratio in ratios]
    crests = np.array([wave.largest_overlap for wave in waves])
    errors = (crests / 12) / (ratios - 1) - 1
    assert errors[-1] < 2e-3
    # KdV is the first order in the crest: its relative error falls in proportion
    assert np.polyfit(np.log(crests), np.log(errors), 1)[0] == pytest.approx(1, abs=0.02)
    shape = crests[-1] / np.cosh(np.sqrt(crests[-1] / 2) * waves[-1].place) ** 2
    assert waves[-1].overlap == pytest.approx(shape, abs=5e-3 * crests[-1])  # of the order of the crest over δ0
    assert waves[-1].overlap != pytest.approx(1.02 * shape, abs=5e-3 * crests[-1])


def test_a_strong_wave_is_that_of_spheres_that_touch() -> None:
    wave = solitary_wave(100 * sound(1.0, 1.0, 1.0), rest=1.0)
    # The crest is 3e8 of the rest; the speed goes with the first power of the ratio
    assert constants(wave) == pytest.approx((OVER_VELOCITY, OVER_OVERLAP), rel=1e-7)


@pytest.mark.parametrize("ratio", [1.001, 1.1, 2.0, 20.0])
def test_the_long_wave_theory_is_near_from_sound_to_the_strong_wave(ratio: float) -> None:
    wave = solitary_wave(ratio * sound(1.0, 1.0, 1.0), rest=1.0)
    error = float(long_wave_speed(1 + wave.largest_overlap)) / ratio - 1
    assert -0.0123 < error < 0
    assert abs(error) < 0.1 * wave.largest_overlap**2  # exact in second order of the crest


@verifies(
    "Long-wave speed of compressed chains",
    reference="published: Nesterenko's formula",
    tolerance=1e-12,
    reason="some roundings",
    mutant=Mutant(
        "analysis/cases/solitary/travelling.py",
        "(2 * y**3 + 4 * y**2 + 6 * y + 3)",
        "(2 * y**3 + 4 * y**2 + 5 * y + 3)",
    ),
)
def test_the_long_wave_speed_is_nesterenkos(measured: Measure) -> None:
    x = np.array([1.5, 3.0, 40.0])
    known = 4 / 15 * (3 + 2 * x**2.5 - 5 * x) / (x - 1) ** 2
    measured(np.abs(long_wave_speed(x) ** 2 / known - 1).max())
    far = 1e12
    # c² = 1.5 for A = m = δ0 = 1; corrections are the root of 1e12
    assert long_wave_speed(far) * np.sqrt(1.5) / far**0.25 == pytest.approx(0.8**0.5, rel=1e-5)
    near = 1e-6
    assert (long_wave_speed(1 + near) - 1) / near == pytest.approx(1 / 12, rel=1e-5)


# --- the equation of motion -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [1.03, 1.5, 10.0, np.inf])
def test_the_wave_moves_through_a_chain_unchanged(ratio: float) -> None:
    rest = 0.0 if np.isinf(ratio) else 1.0
    speed = 0.84 if np.isinf(ratio) else ratio * sound(1.0, 1.0, 1.0)
    wave = solitary_wave(speed, rest=rest)
    half = min(wave.place[-1], 60.0)
    count, way = int(2 * half) + 20, 10.0
    chain, crest = uniform(count, rest**1.5), half + 0.3
    u, v = wave.start(count, crest)
    (after,), (found,) = integrate(chain, u, v, [way / speed], 1e-11)
    expected, velocity = wave.start(count, crest + way)
    # DOP853's errors of 1e-11 a step
    assert np.max(np.abs(found - velocity)) < 1e-8 * wave.largest_velocity
    assert np.max(np.abs(after - expected)) < 1e-8 * wave.largest_overlap
    _, late = wave.start(count, crest + 1.0001 * way)
    assert np.max(np.abs(found - late)) > 1e-5 * wave.largest_velocity  # a speed that is wrong by 1e-4


@pytest.mark.parametrize("rest", [0.0, 0.3])
def test_the_start_has_the_overlaps_and_the_accelerations_of_the_wave(rest: float) -> None:
    wave = solitary_wave(1.3, rest=rest)
    chain, crest, small = uniform(60, rest**1.5), 30.2, 1e-4
    u, v = wave.start(60, crest)
    expected, _ = wave.at(np.arange(1, 60) - crest)
    assert overlaps(chain, u)[1:-1] - chain.overlap[1:-1] == pytest.approx(expected, abs=1e-14)
    _, later = wave.start(60, crest + wave.speed * small)
    _, earlier = wave.start(60, crest - wave.speed * small)
    # Differences over 2e-4: a third derivative of 10 times 1e-9, rounding 1e-12
    assert acceleration(chain, u) == pytest.approx((later - earlier) / (2 * small), abs=1e-7)
    assert v == pytest.approx((later + earlier) / 2, abs=1e-7)


def test_the_series_gives_the_samples_and_nothing_beyond_the_period() -> None:
    wave = solitary_wave(1.0)
    overlap, velocity = wave.at(wave.place[1:])
    assert overlap == pytest.approx(wave.overlap[1:], abs=1e-14)
    assert velocity == pytest.approx(wave.velocity[1:], abs=1e-14)
    assert not np.any(wave.at([-100.0, 50.0]))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"speed": 0.0}, "speed, stiffness and mass must be positive"),
        ({"speed": 1.0, "rest": -1.0}, "rest = -1.0"),
        ({"speed": 1.0, "mass": np.inf}, "mass = inf"),
        ({"speed": np.nan}, "speed = nan"),
        ({"speed": 1.0, "rest": 1.0}, "from 1.001 to 100 times that of sound, not 0.816497 times"),
        ({"speed": 200.0, "rest": 1.0}, "not 163.299 times"),
    ],
)
def test_what_has_no_solitary_wave_is_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        solitary_wave(**values)


def test_an_iteration_that_does_not_end_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cases.solitary.travelling.MOST", 5)
    with pytest.raises(RuntimeError, match="no solitary wave after 5 iterations"):
        solitary_wave(1.0)


def test_a_crest_below_the_rest_is_refused() -> None:
    with pytest.raises(ValueError, match="x > 1, not 1.0"):
        long_wave_speed(1.0)
