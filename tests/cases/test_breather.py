"""Discrete breathers: periodic, localised, in the gap, and stable or not as published."""

import re
from functools import cache

import numpy as np
import pytest

from cases.solitary.breather import breather, multipliers
from cases.solitary.chain import (
    Chain,
    Floats,
    bands,
    compressed,
    energies,
    linear_stiffness,
    spheres,
    uniform,
)
from cases.solitary.chain_motion import SIXTH, integrate, march
from tests.cases.test_chain import ALUMINIUM, FORCE, RADIUS, STEEL, diatomic
from tests.conftest import members

COUNT, PER_PERIOD = 43, 96
STEEL_ALUMINIUM = 2.963  # ratio of the masses of equal spheres, 8000 / 2700


@cache
def light_centred(ratio: float, share: float) -> tuple[Chain, Floats, float]:
    """Return a chain, the breather centred on its middle, light sphere, and its frequency, a share of ω₂."""
    chain, middle = diatomic(COUNT, ratio), COUNT // 2
    frequency = share * bands((1.0, ratio), 1.5)[1]
    guess = np.zeros(COUNT)
    guess[middle - 1 : middle + 2] = -0.25, 0.9, -0.25
    return chain, breather(chain, frequency, guess), frequency


def central(chain: Chain, us: Floats, vs: Floats, spheres: int = 5) -> Floats:
    """Return the share of the energy in so many spheres in the middle."""
    each, first = energies(chain, us, vs), (len(chain) - spheres) // 2
    return each[..., first : first + spheres].sum(axis=-1) / each.sum(axis=-1)


def run(chain: Chain, u: Floats, frequency: float, periods: int, per_period: int = 1) -> tuple[Floats, Floats]:
    """Return states of the stepped chain, so many in a period."""
    step = 2 * np.pi / frequency / PER_PERIOD
    return march(chain, u, np.zeros_like(u), step, periods * PER_PERIOD, SIXTH, every=PER_PERIOD // per_period)


@pytest.mark.parametrize("periods", members([20, 100], 100))
def test_a_breather_lives_for_a_hundred_periods(periods: int) -> None:
    chain, u, frequency = light_centred(10.0, 0.75)
    us, vs = run(chain, u, frequency, periods, per_period=8)
    # 99.77 % to 99.9 % within a period, and so in every period: all multipliers are 1, rounding does not grow
    assert central(chain, us, vs).min() > 0.9976
    assert us[-1] == pytest.approx(u, abs=1e-9)
    assert vs[-1] == pytest.approx(0 * u, abs=1e-9)
    assert central(chain, np.roll(us, 2, axis=1), np.roll(vs, 2, axis=1)).max() < 0.99  # two spheres off


@pytest.mark.parametrize(
    ("ratio", "share", "five", "seven", "largest"),
    [
        pytest.param(STEEL_ALUMINIUM, 0.91, 0.939, 0.981, 1.000, marks=pytest.mark.more),
        (STEEL_ALUMINIUM, 0.79, 0.969, 0.994, 1.006),
        pytest.param(5.0, 0.80, 0.989, 0.999, 1.075, marks=pytest.mark.more),
        (10.0, 0.75, 0.998, 1.000, 1.000),
    ],
)
def test_the_table_of_breathers_is_measured(
    ratio: float, share: float, five: float, seven: float, largest: float
) -> None:
    chain, u, frequency = light_centred(ratio, share)
    us, vs = run(chain, u, frequency, 1, per_period=PER_PERIOD)
    # The last digit of the page
    assert central(chain, us, vs).min() == pytest.approx(five, abs=6e-4)
    assert central(chain, us, vs, 7).min() == pytest.approx(seven, abs=6e-4)
    assert multipliers(chain, u, frequency)[0] == pytest.approx(largest, abs=6e-4)


def test_half_a_percent_off_it_is_no_longer_periodic() -> None:
    chain, u, frequency = light_centred(10.0, 0.75)
    us, _ = run(chain, 1.005 * u, frequency, 10)
    assert np.max(np.abs(us[-1] - 1.005 * u)) > 1e-3


def test_the_breather_is_that_of_the_exact_motion() -> None:
    chain, u, frequency = light_centred(10.0, 0.75)
    us, vs = integrate(chain, u, 0 * u, 2 * np.pi / frequency * np.arange(1, 11), 1e-11)
    # The error of the steps, where contacts open: 1e-6 a period
    assert us[-1] - np.mean(us[-1] - u) == pytest.approx(u, abs=2e-5)
    assert central(chain, us, vs) == pytest.approx(central(chain, u, 0 * u), abs=1e-6)


@pytest.mark.more
def test_in_steel_and_aluminium_it_is_seven_spheres_wide() -> None:
    chain, u, frequency = light_centred(STEEL_ALUMINIUM, 0.79)
    us, vs = run(chain, u, frequency, 100, per_period=4)
    five, seven = (central(chain, us, vs, width) for width in (5, 7))
    # The multiplier is 1.006, so that rounding stays rounding
    assert 0.968 < five.min() < five.max() < 0.98
    assert seven.min() > 0.993
    assert us[-1] == pytest.approx(u, abs=1e-8)


def test_it_is_found_in_units_of_metres() -> None:
    values = np.array([STEEL, ALUMINIUM] * (COUNT // 2) + [STEEL]).T
    modulus, ratio, density = values
    chain = spheres(RADIUS, density, modulus, ratio, force=FORCE)
    unit, frequency = chain.overlap[1], 0.79 * bands((chain.mass[0], chain.mass[1]), linear_stiffness(chain)[1])[1]
    scaled, expected, _ = light_centred(chain.mass[0] / chain.mass[1], 0.79)
    u = breather(chain, frequency, expected * unit)
    assert u / unit - np.mean(u / unit) == pytest.approx(expected - np.mean(expected), abs=1e-9)
    assert len(scaled) == len(chain)


@pytest.mark.rounding
def test_the_family_centred_on_a_heavy_sphere_is_symmetric_and_unstable() -> None:
    count, middle = 45, 22
    chain = diatomic(count, STEEL_ALUMINIUM)
    frequency = 0.85 * bands((1.0, STEEL_ALUMINIUM), 1.5)[1]
    guess = np.zeros(count)
    guess[[middle - 1, middle + 1]] = -0.9, 0.9
    u = breather(chain, frequency, guess)
    u -= u.mean()
    assert u == pytest.approx(-u[::-1], abs=1e-9)
    assert multipliers(chain, u, frequency)[0] == pytest.approx(2.805, abs=0.01)


@pytest.mark.rounding
def test_the_family_centred_on_a_light_sphere_is_asymmetric_and_nearly_stable() -> None:
    chain, u, frequency = light_centred(STEEL_ALUMINIUM, 0.85)
    assert np.max(np.abs(u + u[::-1] - 2 * np.mean(u))) > 0.5
    largest = multipliers(chain, u, frequency)
    assert len(largest) == 2 * COUNT
    assert 1.05 < largest[0] < 1.1
    assert np.prod(largest) == pytest.approx(1, abs=1e-6)  # the map keeps volumes
    stable = light_centred(STEEL_ALUMINIUM, 0.91)
    # Two pairs of ones, of time and of free motion, are found to the root of the rounding
    assert multipliers(*stable)[0] == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize(
    ("chain", "frequency", "guess", "error", "message"),
    [
        (uniform(5), 1.0, np.ones(5), ValueError, "every contact must be compressed"),
        (uniform(5, 1.0), -1.0, np.ones(5), ValueError, "frequency must be positive, not -1.0"),
        (diatomic(21, 3.0), 1.5, 1e-3 * np.eye(21)[11], RuntimeError, "leads to the chain at rest"),
    ],
)
def test_what_has_no_breather_is_refused(
    chain: Chain, frequency: float, guess: Floats, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=re.escape(message)):
        breather(chain, frequency, guess)


def test_newtons_method_that_does_not_converge_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cases.solitary.breather.MOST", 2)
    with pytest.raises(RuntimeError, match=re.escape("no breather of frequency 1.5 from this guess")):
        breather(diatomic(21, 3.0), 1.5, np.eye(21)[11])


def test_held_ends_compress_the_chain() -> None:
    free, u, frequency = light_centred(10.0, 0.75)
    mass = free.mass.copy()
    mass[[0, -1]] = np.inf
    held = compressed(mass, free.stiffness, 1.0)
    between = breather(held, frequency, u)
    assert between[0] == u[0]  # held where the guess is
    assert not np.array_equal(between, u)
