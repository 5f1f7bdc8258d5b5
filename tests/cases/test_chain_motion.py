"""How a chain is integrated: orders, conservation, scaling, the window that moves along, and times of peaks."""

import re

import numpy as np
import pytest

from cases.impact.case import collision_error, energy_errors
from cases.solitary.chain import Chain, compressed, uniform
from cases.solitary.chain_motion import (
    SIXTH,
    VERLET,
    Scheme,
    collision_time,
    first_peak,
    follow,
    integrate,
    march,
    peak,
)
from tests.cases.test_chain import diatomic
from tests.conftest import members

T = collision_time(1.0, 1.0, 1.0)


def struck(count: int, velocity: float = 1.0) -> np.ndarray:
    return velocity * np.eye(count)[0]


def slope(steps: list[int], errors: list[float]) -> float:
    """Return the order of the error in the step."""
    return float(-np.polyfit(np.log(steps), np.log(errors), 1)[0])


# --- orders -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scheme", "order", "steps"), [(VERLET, 2, [32, 64, 128]), (SIXTH, 6, [16, 24, 32])])
def test_the_order_of_smooth_motion(scheme: Scheme, order: int, steps: list[int]) -> None:
    chain, v = diatomic(9, 3.0), 0.1 * np.random.default_rng(1).standard_normal(9)
    exact, _ = march(chain, 0 * v, v, 0.02, 400, SIXTH)  # its error is 1e-12
    errors = [np.max(np.abs(march(chain, 0 * v, v, 8 / n, n, scheme)[0] - exact)) for n in steps]
    # The next term of the error adds 0.04 to the order at the longest step
    assert slope(steps, errors) == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize("scheme", [VERLET, SIXTH], ids=["second", "sixth"])
def test_where_contacts_close_and_open_the_order_is_five_halves(scheme: Scheme) -> None:
    steps = [40, 80, 160]
    errors = [collision_error(n, scheme) for n in steps]
    # Velocity Verlet has 2.556 and 2.529, the other 2.504 and 2.501: higher orders add to either
    assert slope(steps, errors) == pytest.approx(2.5, abs=0.06)


def test_dop853_and_the_sixth_order_agree_where_contacts_open() -> None:
    chain, v = uniform(12), struck(12)
    _, (adaptive,) = integrate(chain, 0 * v, v, [8 * T], 1e-11)
    _, (stepped,) = march(chain, 0 * v, v, T / 160, 8 * 160, SIXTH)
    # 1e-7 for an opening contact at this step, by the test above, and the error of DOP853 at one: 1e-8
    assert np.max(np.abs(adaptive - stepped)) < 5e-7
    _, (coarse,) = march(chain, 0 * v, v, T / 20, 8 * 20, VERLET)
    assert np.max(np.abs(adaptive - coarse)) > 1e-3


def test_dop853_has_no_units() -> None:
    chain, v = uniform(8), struck(8)
    metres = Chain(1e-3 * chain.mass, 1e9 * chain.stiffness, chain.overlap)
    # m' = 1e-3, A' = 1e9, v' = 0.01: overlaps by (m'v'²/A')^{2/5}, times by that over v'
    length = (1e-3 * 1e-4 / 1e9) ** 0.4
    _, (plain,) = integrate(chain, 0 * v, v, [5.0], 1e-9)
    _, (scaled,) = integrate(metres, 0 * v, 0.01 * v, [5.0 * length / 0.01], 1e-9)
    # Same steps but for rounding, which moves a step by its size
    assert scaled / 0.01 == pytest.approx(plain, abs=1e-8)


# --- collisions and scaling -------------------------------------------------------------------------------------------


def test_two_spheres_part_after_the_collision_time() -> None:
    times = np.linspace(0.99, 1.01, 3) * T
    us, _ = integrate(uniform(2), np.zeros(2), struck(2), times, 1e-11)
    near, there, far = us[:, 0] - us[:, 1]  # the overlap
    assert near > 0 > far
    assert abs(there) < 1e-7  # the error of DOP853, of one impact


@pytest.mark.parametrize("power", range(-4, 3))
def test_the_scaling_with_the_velocity_is_exact(power: int) -> None:
    v = struck(20)
    us, vs = march(uniform(20), 0 * v, v, T / 30, 360, VERLET, every=60)
    # v = 32^k from 1e-6 to 1e3: lengths v^{4/5} and times v^{−1/5} scale by powers of two, without rounding
    us2, vs2 = march(uniform(20), 0 * v, 32.0**power * v, T / 30 * 2.0**-power, 360, VERLET, every=60)
    seen = np.abs(vs) > 1e-100  # the front of the wave underflows
    assert np.array_equal(vs2[seen] * 32.0**-power, vs[seen])
    assert np.array_equal(us2[seen] * 16.0**-power, us[seen])


# --- long runs --------------------------------------------------------------------------------------------------------


def test_the_energy_of_closed_contacts_does_not_drift() -> None:
    errors = energy_errors(1.0, 40_000, 50, samples=400)
    first, last = errors[:100].mean(), errors[-100:].mean()
    # Symplectic: an offset of 1.3e-3 that swings by 4e-4; means of 100 samples differ by a tenth of that
    assert abs(last - first) < 1e-4
    assert np.max(np.abs(errors)) < 5e-3


def test_the_energy_of_contacts_that_open_wanders_by_their_events() -> None:
    coarse, fine = (np.std(energy_errors(0.0, 200 * n, n, samples=200)) for n in (20, 80))
    # Each event adds an error at random: 4^{5/2} = 32 times less with a quarter of the step; one run is one sample
    assert 6 < coarse / fine < 200


def test_the_motion_runs_backward_to_its_start() -> None:
    chain, v = diatomic(9, 3.0), 0.1 * np.random.default_rng(1).standard_normal(9)
    (u1,), (v1,) = march(chain, 0 * v, v, 0.1, 200, SIXTH)
    (u0,), (v0,) = march(chain, u1, v1, -0.1, 200, SIXTH)
    assert u0 == pytest.approx(0 * v, abs=1e-11)  # rounding of 3600 evaluations
    assert v0 == pytest.approx(v, abs=1e-11)


# --- the window -------------------------------------------------------------------------------------------------------


def changed(count: int, contact: tuple[int, float] | None = None, **masses: float) -> Chain:
    """Return equal spheres but for the stiffness of one contact, and the mass of the `first` or the `fortieth` last."""
    chain = uniform(count)
    mass, stiffness = chain.mass.copy(), chain.stiffness.copy()
    if contact:
        stiffness[contact[0]] = contact[1]
    for place, value in masses.items():
        mass[{"first": 0, "fortieth": -40}[place]] = value
    return compressed(mass, stiffness)


@pytest.mark.parametrize(
    ("chain", "finer", "steps", "back"),
    [
        (changed(300), 20, 2000, False),
        (changed(60, first=20.0), 20, 600, False),  # a heavy striker pushes on: no sphere is left behind
        (changed(160, (-1, 8**0.5)), 12, 1500, True),  # a wall throws the wave back
        (changed(160, fortieth=50.0), 12, 1500, True),
    ],
    ids=["alone", "heavy striker", "wall", "heavy sphere"],
)
def test_the_window_gives_what_the_whole_chain_does(chain: Chain, finer: int, steps: int, back: bool) -> None:
    v = struck(len(chain))
    (us,), (vs,) = march(chain, 0 * v, v, T / finer, steps)
    u, w = follow(chain, 0 * v, v, T / finer, steps)
    assert not back or np.argmin(vs) < 80  # it has come back by more than the window is long
    # The residue, 1e-13 of the velocity, of a few contacts, at each of which it is lost
    assert np.max(np.abs(w - vs)) < (1e-11 if back else 1e-12)
    assert np.max(np.abs(u - us)) < (1e-8 if back else 1e-9)  # what flies for 2000 steps sums its rounding


@pytest.mark.parametrize(
    ("count", "steps", "passed"), members([(1_000, 4_600, 780), (10_000, 56_000, 9000)], (10_000, 56_000, 9000))
)
def test_a_wave_runs_through_up_to_ten_thousand_spheres_unchanged(count: int, steps: int, passed: int) -> None:
    step = T / 12
    chain, v = uniform(count), struck(count)
    early = follow(chain, 0 * v, v, step, 1000)
    late = follow(chain, *early, step, steps)

    def crest(state: tuple[np.ndarray, np.ndarray]) -> tuple[int, float]:
        sphere = int(np.argmax(state[1])) + 4
        near = slice(sphere - 20, sphere + 20)
        _, vs = march(uniform(40), state[0][near] - state[0][sphere + 10], state[1][near], step, 60, every=1)
        return sphere, peak(np.arange(60), vs[:, 20])[0]

    (first, before), (last, after) = crest(early), crest(late)
    assert last - first > passed
    # Velocity Verlet has a solitary wave too; peaks between samples of T/12 are found to 1e-6
    assert after == pytest.approx(before, rel=3e-6)


def test_a_chain_at_rest_stays_so() -> None:
    u, v = follow(uniform(10), np.zeros(10), np.zeros(10), 0.1, 10)
    assert not u.any()
    assert not v.any()


def test_a_clearance_that_is_too_small_is_refused() -> None:
    with pytest.raises(RuntimeError, match="take a larger clearance"):
        follow(uniform(100), np.zeros(100), struck(100), T / 20, 2000, clearance=2)


# --- peaks ------------------------------------------------------------------------------------------------------------


def test_a_peak_between_samples_is_found() -> None:
    times = np.arange(-3.0, 3.0, 0.1)
    height, place = peak(times, 2 / np.cosh(times - 0.234) ** 2)
    # The next term of the polynomial, 0.1^9 times a derivative of 1e5 over 9!; a slope of it over a curvature of 4
    assert height == pytest.approx(2, abs=1e-8)
    assert place == pytest.approx(0.234, abs=1e-7)
    assert peak(times, np.exp(-((times - 0.3) ** 2)))[1] != pytest.approx(0.234, abs=1e-3)


def test_what_cannot_be_done_is_refused_by_name() -> None:
    v = struck(5)
    for wrong, message in (
        (lambda: peak(np.arange(9.0), np.arange(9.0)), "the highest value is sample 8 of 9"),
        (lambda: march(uniform(5), v, v, 0.1, 10, every=3), "steps must be a positive multiple of every = 3, not 10"),
        (lambda: march(uniform(5), v, v, 0.1, 0), "steps must be a positive multiple"),
        (lambda: integrate(uniform(5), 0 * v, 0 * v, [1.0]), "the chain is at rest"),
        (lambda: integrate(uniform(1), np.zeros(1), np.ones(1), [1.0]), "the chain has no contact"),
        (lambda: follow(uniform(5, 1.0), 0 * v, v, 0.1, 10), "spheres that just touch"),
        (lambda: follow(uniform(5), 0 * v, v, -0.1, 10), "step must be positive, not -0.1"),
        (lambda: collision_time(1.0, 1.0, 0.0), "must be positive, not 1.0, 1.0, 0.0"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            wrong()


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_a_step_that_is_far_too_long_is_an_error() -> None:
    wall = compressed(np.ones(3), np.array([8.0, 1.0, 1.0, 8.0]) ** 0.5, 1.0)
    with pytest.raises(RuntimeError, match=re.escape("the step 50.0 is too long")):
        march(wall, np.zeros(3), struck(3), 50.0, 2000)


def test_the_first_pulse_is_found_before_a_higher_one() -> None:
    times = np.arange(0.0, 20.0, 0.1)
    low, twin, high = (height / np.cosh(times - at) ** 2 for height, at in ((0.5, 5.03), (0.55, 7.03), (2.0, 14.0)))
    # The polynomial is exact to 1e-7 in a pulse of this width
    assert first_peak(times, low + high, 1e-3) == pytest.approx((0.5, 5.03), abs=1e-5)
    assert first_peak(times, low + high, 0.6) == pytest.approx((2.0, 14.0), abs=1e-5)
    # Two tops with a dip above half of the height are one pulse, whose crest is the higher
    height, time = first_peak(times, low + twin + high, 1e-3)
    assert height > 0.55
    assert time == pytest.approx(7.0, abs=0.1)
    with pytest.raises(ValueError, match="no pulse above 3 has passed"):
        first_peak(times, high, 3.0)
