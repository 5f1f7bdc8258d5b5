"""A chain with dashpots: what two spheres keep, what a wave loses, and how it is integrated."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cases.solitary.chain import (
    Chain,
    acceleration,
    compressed,
    dashpot_forces,
    energies,
    normal_modes,
    uniform,
)
from cases.solitary.chain_motion import SIXTH, collision_time, integrate, march, peak
from cases.solitary.damping import damping_ratio, decay, power
from cases.solitary.travelling import solitary_wave
from tests.conftest import latin, members

T = collision_time(1.0, 1.0, 1.0)


def lossy(chain: Chain, restitution: float) -> Chain:
    return replace(chain, restitution=restitution)


# --- two spheres ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("other", "velocity", "restitution"),
    latin([(1.0, 1.0), (1.0, 1e-3), (7.0, 1.0), (np.inf, 1.0)], [0.9, 0.5, 0.1]),
)
def test_two_spheres_part_with_the_restitution(restitution: float, other: float, velocity: float) -> None:
    chain = lossy(compressed([1.0, other], [0.0, 2.0, 0.0]), restitution)
    _, (v,) = integrate(chain, np.zeros(2), np.array([velocity, 0.0]), [20 * velocity**-0.2], 1e-10)
    # DOP853 shortens its steps to where the contact ends
    assert (v[1] - v[0]) / velocity == pytest.approx(restitution, abs=1e-8)
    if np.isfinite(other):
        assert v[0] + other * v[1] == pytest.approx(velocity, abs=1e-13 * velocity * (1 + other))  # rounding


def test_a_sphere_comes_back_from_a_wall_with_the_restitution() -> None:
    chain = lossy(compressed([1.0], [0.0, 2.0**1.5]), 0.7)
    _, (v,) = integrate(chain, np.zeros(1), np.ones(1), [20.0], 1e-10)
    assert v[0] == pytest.approx(-0.7, abs=1e-8)


def test_a_contact_pulls_before_it_ends() -> None:
    chain, v = lossy(uniform(2), 0.5), np.eye(2)[0]
    us, vs = march(chain, 0 * v, v, T / 1000, 1500, every=1)
    overlap = us[:, 0] - us[:, 1]
    force = np.where(overlap > 0, overlap, 0.0) ** 1.5 + dashpot_forces(chain, us, vs)[:, 1]
    closed = np.flatnonzero(overlap > 0)
    assert force[closed[-1]] < 0
    assert np.all(force[closed[: len(closed) // 2]] > 0)
    assert np.all(force[overlap <= 0] == 0)


# --- energy -----------------------------------------------------------------------------------------------------------


def test_the_energy_that_is_lost_is_what_the_dashpots_take() -> None:
    chain, v = lossy(uniform(12), 0.7), np.eye(12)[0]
    us, vs = march(chain, 0 * v, v, 2e-3, 8000, every=10)
    lost = 0.5 - energies(chain, us, vs).sum(axis=1)
    taken = power(chain, us, vs)
    assert np.all(taken >= 0)
    ledger = np.concatenate([[0.0], np.cumsum((taken[1:] + taken[:-1]).sum(axis=1) * 0.01)])
    # Of first order in the step, in units of the impact: 2e-3 of what is lost
    assert ledger == pytest.approx(lost - lost[0], abs=2e-3 * lost[-1])
    assert lost[-1] > 0.3
    half = replace(chain, restitution=float(np.sqrt(chain.restitution)))
    assert np.sum(power(half, us, vs)) < 0.6 * np.sum(taken)  # other dashpots would take another energy


@pytest.mark.parametrize("velocity", [32.0**-3, 32.0])
def test_a_lossy_chain_does_the_same_at_every_velocity(velocity: float) -> None:
    chain, v = lossy(uniform(20), 0.8), np.eye(20)[0]
    _, (plain,) = march(chain, 0 * v, v, 0.05, 400)
    _, (other,) = march(chain, 0 * v, velocity * v, 0.05 * velocity**-0.2, 400)
    assert other / velocity == pytest.approx(plain, abs=1e-11)  # rounding of 400 steps; η itself is rounded


# --- decay of the solitary wave ---------------------------------------------------------------------------------------


def measured_decay(restitution: float) -> float:
    """Return Γ between the spheres 20 and 30 behind the start of a solitary wave, at two steps, extrapolated."""
    chain, found = lossy(uniform(60), restitution), []
    u, v = solitary_wave(1.0).start(60, 10.0)
    for step in (0.04, 0.02):
        _, vs = march(chain, u, v, step, round(36 / step), every=round(0.08 / step))
        heights = [peak(np.arange(len(vs)), vs[:, sphere])[0] for sphere in (30, 40)]
        found.append(-np.log(heights[1] / heights[0]) / 10)
    return 2 * found[1] - found[0]


def test_a_wave_decays_as_the_wave_without_loss_predicts() -> None:
    ratios = [measured_decay(e) / decay(e) for e in (0.9975, 0.99)]
    off = 1 - np.array(ratios)
    zetas = np.array([damping_ratio(0.9975), damping_ratio(0.99)])
    # What is left is of second order in ζ
    assert off / zetas == pytest.approx([6, 6], rel=0.1)
    assert measured_decay(0.9975) != pytest.approx(decay(0.997), rel=0.1)


def pulses(restitution: float) -> tuple[int, int]:
    """Return the spheres of the highest velocity at τ = 100, and of the highest that is apart from it, farther back."""
    _, (v,) = march(lossy(uniform(110), restitution), np.zeros(110), np.eye(110)[0], 0.05, 2000)
    first = int(np.argmax(v))
    least = first - 12 + int(np.argmin(v[first - 12 : first]))  # within 12 spheres of the crest
    return first, int(np.argmax(v[:least])) if least > first - 12 else first


def test_little_loss_leaves_a_second_pulse_behind_the_wave_and_much_loss_one_pulse() -> None:
    """The two waves of Rosas et al. 2007."""
    first, second = pulses(0.95)
    assert first - second > 12
    first, second = pulses(0.7)
    assert first == second


def test_spheres_that_meet_two_by_two_decay_faster() -> None:
    for e in (0.99, 0.9, 0.5):
        assert -np.log((1 + e) / 2) > 1.9 * decay(e)
    assert decay(1.0) == 0


# --- integration ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", members([0.9, 0.5], 0.9))
def test_verlet_is_of_first_order_with_dashpots(restitution: float) -> None:
    chain, v = lossy(uniform(8), restitution), np.eye(8)[0]
    _, (exact,) = integrate(chain, 0 * v, v, [12.0], 1e-10)
    steps = np.array([0.04, 0.02, 0.01, 0.005])
    errors = [np.sqrt(np.mean((march(chain, 0 * v, v, h, round(12 / h))[1][0] - exact) ** 2)) for h in steps]
    # The second order adds 0.1 at the longest step
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(1, abs=0.1)
    assert errors[-1] < 1e-3


def test_without_loss_nothing_has_changed() -> None:
    chain, v = uniform(6), np.eye(6)[0]
    assert not chain.damped
    assert not chain.dashpot.any()
    assert np.array_equal(march(lossy(chain, 1.0), 0 * v, v, 0.1, 50), march(chain, 0 * v, v, 0.1, 50))


def test_what_dashpots_do_not_go_with_is_refused_by_name() -> None:
    chain, v = lossy(uniform(5), 0.9), np.eye(5)[0]
    for wrong, message in (
        (lambda: lossy(uniform(5), 0.0), "restitution must be above 0 and at most 1, not 0.0"),
        (lambda: lossy(uniform(5), np.nan), "restitution must be above 0"),
        (lambda: acceleration(chain, v), "restitution = 0.9: the acceleration needs the velocities"),
        (lambda: march(chain, 0 * v, v, 0.1, 10, SIXTH), "restitution = 0.9: needs VERLET and a positive step"),
        (lambda: march(chain, 0 * v, v, -0.1, 10), "needs VERLET and a positive step, not step = -0.1"),
        (lambda: normal_modes(chain), "damped vibrations have no normal modes"),
        (lambda: decay(1.5), "restitution must be above 0 and at most 1, not 1.5"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            wrong()
