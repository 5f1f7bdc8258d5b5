"""Old factors that are mended where contacts have parted or formed."""

import numpy as np
import pytest

from granular_lmp.crystal.disorder import Disorder, imperfect
from granular_lmp.crystal.factors import Factors, conjugate_gradients, order_of
from granular_lmp.crystal.lattices import Shape, packed
from granular_lmp.crystal.potential import Potential, State, potential_of
from granular_lmp.crystal.tangent import Tangent
from tests.crystal.test_sphere import SILICA

PARTED = [200, 700, 1200, 1700, 2200, 2700]
At = tuple[Potential, State]


@pytest.fixture(scope="module")
def at() -> At:
    """A crystal of 1020 spheres with s = 0.8 at the places of its lattice."""
    disorder = Disorder(radius=0.8 * SILICA.overlap_ratio)
    crystal, materials = imperfect(packed(SILICA, Shape(34, 30, "periodic")), SILICA, disorder)
    potential = potential_of(crystal, materials, np.zeros(2), breathes=True)
    return potential, potential.start()


def tangent_of(at: At, across: float = 0.0, *, parted: bool = True) -> Tangent:
    """Return a tangent without six contacts, or with the stiffness across these, k1."""
    potential, state = at
    normal, sideways = state.normal_stiffness, np.zeros(len(state.pairs.i))
    sideways[PARTED] = across
    normal[PARTED] *= not parted
    return Tangent.of(potential, state, 1e-5, normal, sideways)


def old_factors(at: At) -> Factors:
    return Factors(tangent_of(at, parted=False), order_of(*at))


def random_force(at: At) -> np.ndarray:
    return np.random.default_rng(1).normal(size=len(at[0].mass))


def test_no_force_is_left_in_a_patch_and_none_appears_there(at: At) -> None:
    tangent, force = tangent_of(at), random_force(at)
    mended = old_factors(at).mended(tangent)
    start = mended.start(force)
    rows = np.flatnonzero(start)
    assert 100 < len(rows) < 1400
    left = force - tangent @ start
    change = tangent @ mended(left)
    size = np.abs(force).max()
    assert np.abs(left[rows]).max() < 1e-9 * size
    assert np.abs(change[rows]).max() < 1e-9 * size
    assert np.abs(left).max() > 0.1 * size


def test_conjugate_gradients_find_the_same_answer_in_fewer_iterations(at: At) -> None:
    tangent, force, old = tangent_of(at), random_force(at), old_factors(at)
    exact = Factors(tangent, order_of(*at))(force)
    iterations = {}
    for name, factors in {"old": old, "mended": old.mended(tangent)}.items():
        answer, iterations[name], unstable = conjugate_gradients(tangent, factors, force, 1e-8)
        assert unstable is None
        np.testing.assert_allclose(answer, exact, atol=1e-5 * np.abs(exact).max())
    assert iterations["mended"] < iterations["old"]


def test_factors_stay_as_they_are_where_no_contact_changed_or_a_patch_would_buckle(at: At) -> None:
    old = old_factors(at)
    assert old.mended(tangent_of(at, parted=False)) is old
    assert old.mended(tangent_of(at, -3.0, parted=False)) is old
    assert old.mended(tangent_of(at, 1.0, parted=False)) is not old
