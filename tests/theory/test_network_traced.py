"""The network by JAX: the lines are those of NumPy, and so are forces and motions, to rounding."""

from dataclasses import replace

import numpy as np
import pytest

from granular_analysis.theory.network_outside import Drive
from granular_analysis.theory.network_state import contacts, resultants
from granular_analysis.theory.network_tangents import length
from granular_analysis.theory.network_verlet import march, slip_ratios
from tests.conftest import latin
from tests.theory.test_loops import LAWS, touching

traced = pytest.importorskip("granular_analysis.theory.network_traced", reason="needs JAX")
jax = pytest.importorskip("jax")


@pytest.mark.parametrize(("changes", "dimension"), latin(LAWS, [2, 3]), ids=str)
def test_forces_of_any_law_are_those_of_numpy(changes: dict[str, object], dimension: int) -> None:
    network, state = touching(dimension, torn=True, **changes)

    @jax.jit
    def forces(arrays: traced.Arrays, motion: object, memory: object, begun: object) -> object:
        pairs = traced.pairs_of(network, arrays)
        now = contacts(network, motion, pairs, memory, begun)
        return resultants(pairs, now), now.memory_rate

    found = forces(traced.arrays_of(state.pairs), *map(jax.numpy.asarray, (state.motion, state.shear, state.begun)))
    now = contacts(network, state.motion, state.pairs, state.shear, state.begun)
    for one, other in zip(found, (resultants(state.pairs, now), now.memory_rate), strict=True):
        np.testing.assert_allclose(np.array(one), other, rtol=0, atol=1e-13 * np.abs(other).max())


@pytest.mark.parametrize("changes", [each for each in LAWS if each.get("shear", True)], ids=str)
@pytest.mark.parametrize("dimension", [2, 3])
def test_what_slides_has_the_ratio_of_the_friction_and_all_else_a_smaller_one(
    changes: dict[str, object], dimension: int
) -> None:
    network, state = touching(dimension, torn=True, **{**changes, "friction": 0.05})
    there = contacts(network, state.motion, state.pairs, state.shear, state.begun)
    free = contacts(replace(network, friction=np.inf), state.motion, state.pairs, state.shear, state.begun)
    slides = there.closed & (length(free.shear) > length(there.shear) * (1 + 1e-12))
    found = slip_ratios(network, state.pairs, there)
    assert 5 < slides.sum() < there.closed.sum()
    np.testing.assert_allclose(found[slides], 0.05, rtol=1e-12)  # rounding
    assert found[~slides].max() < 0.05


def test_motions_are_those_of_numpy_also_where_pairs_are_searched_again() -> None:
    network, state = touching(2, torn=True, friction=0.2)
    swing = Drive(np.array([3, 4]), 0, lambda time: 0.3 * np.sin(time), moves=True, longest=1.0, size=0.3)
    push = Drive(np.array([10]), 1, lambda time: 1e-3 * np.cos(time), longest=1.0, size=1e-3)
    network = replace(network, drives=(swing, push), drag=np.linspace(0, 0.1, 60))
    one, other = (np.array([*way(network, state, 0.02, 130, 40)]) for way in (march, traced.march))
    assert len(one) == 4  # 130 steps hold three times 40
    assert np.abs(one[-1, :2] - one[0, :2]).max() > network.margin / 4  # so that they were
    np.testing.assert_allclose(other, one, rtol=0, atol=1e-11)


def test_two_runs_give_the_same_bits() -> None:
    network, state = touching(2, torn=True)
    one, other = (np.array([*traced.march(network, state, 0.02, 50, 50)]) for _ in range(2))
    assert one.tobytes() == other.tobytes()
