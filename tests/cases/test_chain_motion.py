"""How a chain is integrated: orders, conservation, scaling, and times of peaks."""

import re

import numpy as np
import pytest

from cases.solitary.chain import Chain, compressed, energies, uniform
from cases.solitary.chain_motion import (
    SIXTH,
    VERLET,
    Scheme,
    collision_time,
    first_peak,
    integrate,
    march,
    peak,
)
from tests.cases.test_chain import diatomic

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


def collision_error(steps: int, scheme: Scheme) -> float:
    """Return the error of the velocity after a collision, root mean square over where in a step the contact begins."""
    step, phases = T / steps, np.arange(64) / 64
    u, v = np.zeros((64, 2)), np.zeros((64, 2))
    u[:, 0], v[:, 0] = -step * phases, 1.0
    _, (found,) = march(uniform(2), u, v, step, steps + steps // 2, scheme)
    return float(np.sqrt(np.mean((found[:, 1] - 1) ** 2)))


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


def test_the_good_values_of_the_module_have_the_errors_that_it_says() -> None:
    v = struck(20)
    _, (exact,) = integrate(uniform(20), 0 * v, v, [12 * T], 1e-13)

    def error(steps: int, scheme: Scheme) -> float:
        _, (found,) = march(uniform(20), 0 * v, v, T / steps, 12 * steps, scheme)
        return float(np.max(np.abs(found - exact)))

    assert error(80, VERLET) == pytest.approx(1.4e-4, rel=0.05)
    assert error(20, SIXTH) < 1e-5
    assert np.max(np.abs(integrate(uniform(20), 0 * v, v, [12 * T], 1e-10)[1][0] - exact)) < 1e-7


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


def energy_errors(force: float, steps: int, per_collision: int, samples: int) -> np.ndarray:
    """Return the relative energy error (samples,) of ten spheres between rigid walls by velocity Verlet.

    force : that compresses the row; with 1 its contacts do not open, with 0 they open at every impact.
    """
    stiffness = np.ones(11)
    stiffness[[0, -1]] = 2 * np.sqrt(2)  # a sphere on a rigid plane over two such spheres
    chain, v = compressed(np.ones(10), stiffness, force), struck(10)
    us, vs = march(chain, 0 * v, v, T / per_collision, steps, VERLET, every=steps // samples)
    return energies(chain, us, vs).sum(axis=1) / 0.5 - 1


def test_the_energy_of_closed_contacts_does_not_drift() -> None:
    errors = energy_errors(1.0, 40_000, 50, 400)
    first, last = errors[:100].mean(), errors[-100:].mean()
    # Symplectic: an offset of 1.3e-3 that swings by 4e-4; means of 100 samples differ by a tenth of that
    assert abs(last - first) < 1e-4
    assert np.max(np.abs(errors)) < 5e-3


def test_the_energy_of_contacts_that_open_wanders_by_their_events() -> None:
    coarse, fine = (np.std(energy_errors(0.0, 200 * n, n, 200)) for n in (20, 80))
    # Each event adds an error at random: 4^{5/2} = 32 times less with a quarter of the step; one run is one sample
    assert 6 < coarse / fine < 200


def test_the_motion_runs_backward_to_its_start() -> None:
    chain, v = diatomic(9, 3.0), 0.1 * np.random.default_rng(1).standard_normal(9)
    (u1,), (v1,) = march(chain, 0 * v, v, 0.1, 200, SIXTH)
    (u0,), (v0,) = march(chain, u1, v1, -0.1, 200, SIXTH)
    assert u0 == pytest.approx(0 * v, abs=1e-11)  # rounding of 3600 evaluations
    assert v0 == pytest.approx(v, abs=1e-11)


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
