"""The gradient of a run: Taylor remainders and adjoints over all kinds of networks and factors, and what is refused."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Material, Network, Wall
from granular_analysis.theory.network_outside import Drive
from granular_analysis.theory.network_state import State, start
from granular_analysis.theory.network_verlet import march
from tests.conftest import members

jax = pytest.importorskip("jax")
jnp = jax.numpy
gradients = pytest.importorskip("granular_analysis.theory.network_gradient", reason="needs JAX")

OVERLAP, ADHESION = 1e-2, 1e-3  # so deep that a step of 1e-3 in a radius opens no contact
RECORDED = np.array([5, 9])
# What each kind changes of 24 spheres in the plane; those in space lie on a wall
KINDS = {
    "sheet": {},
    "incremental": {"law": "incremental"},
    "dashpots": {"viscosity": 1e-2},
    "friction": {"friction": 10.0, "viscosity": 1e-2},
    "restitution": {"materials": (Material(1.0, 0.2),), "restitution": 0.8},
    "jkr": {"adhesion": "jkr"},
    "smooth": {"shear": False},
    "held": {"held": np.arange(24) < 4},
    "drag": {"drag": np.linspace(0, 0.05, 24)},
    "layer": {"space": True},
}
FACTORS = ["density", "radius", "normal_stiffness", "shear_stiffness", "damping", "amplitude", "drives"]


@cache
def of_kind(kind: str) -> "gradients.Run":
    """Return a run of 40 steps of a wave in 4 × 6 spheres, one of which is pushed."""
    changes = dict(KINDS[kind])
    space = changes.pop("space", False)
    row, column = np.divmod(np.arange(24), 4)
    spacing = 2 - OVERLAP
    places = spacing * np.stack([column + row % 2 / 2, row * np.sqrt(3) / 2], axis=1)
    cell = (4 * spacing, 6 * spacing * np.sqrt(3) / 2)
    size = 1e-3 * np.sin(2 * np.pi * places[:, 1] / cell[1] + 0.3)[:, None]
    way = size * [1.0, 0.3]
    if space:
        places, way, cell = np.hstack([places, np.zeros((24, 1))]), np.hstack([way, size]), (*cell, np.inf)
        changes["walls"] = (Wall((0.0, 0.0, OVERLAP / 2 - 1), (0.0, 0.0, -1.0), Material(2.0, 0.3, ADHESION)),)
    push = Drive(np.array([7]), 0, lambda time: 1e-5 * np.cos(time / 20), longest=20.0, size=1e-5)
    numbers = {"materials": (Material(1.0, 0.2, ADHESION),)} | changes
    network = Network(places, np.ones(24), np.ones(24), cell=cell, drives=(push,), **numbers)
    return gradients.Run(network, start(network, way, 0.0), 0.5, 8, 5, RECORDED)


def read_off(motions: object) -> object:
    """Return a number that hangs on all of a record."""
    weights = jnp.asarray(np.random.default_rng(3).normal(size=motions.shape))
    return jnp.sum(weights * motions) + 1e3 * jnp.sum(motions[:, 0] ** 2)


def test_a_record_without_factors_is_that_of_the_steps() -> None:
    run = of_kind("friction")
    found = np.asarray(gradients.record(run, run.ones("density")))
    expected = np.array([*march(run.network, run.state, run.step, 40, 5)])[:, :, RECORDED]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


# Of a kind all is compiled once, which takes some seconds; one holds the lines of most
@pytest.mark.parametrize("kind", members(KINDS, *(kind for kind in KINDS if kind != "friction")))
def test_what_a_gradient_leaves_is_of_second_order_and_both_modes_are_adjoint(kind: str) -> None:
    run, rng = of_kind(kind), np.random.default_rng(1)
    ones = run.ones(*FACTORS)
    value, slope = gradients.gradient(run, read_off, ones)
    for name in FACTORS:
        way = rng.normal(size=ones[name].shape)
        along = float(np.sum(slope[name] * way))
        direction = {each: way if each == name else 0 * ones[each] for each in FACTORS}
        forward = float(gradients.derivative(run, read_off, ones, direction)[1])
        assert forward == pytest.approx(along, rel=1e-11, abs=1e-15 * abs(value)), name
        sizes = 10.0 ** np.array([-4, -5]) / np.abs(way).max()
        found = [gradients.record(run, ones | {name: ones[name] + size * way}) for size in sizes]
        left = np.abs(np.array([*map(float, map(read_off, found))]) - value - along * sizes)
        floor = 1e-12 * abs(value)  # rounding of the record
        if left[1] > 10 * floor:
            assert np.log10(left[0] / left[1]) == pytest.approx(2, abs=0.1), name
        else:  # linear, or nothing hangs on it
            assert left[0] < max(200 * left[1], 10 * floor), name


def test_a_contact_that_opens_or_slides_is_named_and_refused_unless_asked_for() -> None:
    run = of_kind("sheet")
    wide = replace(run, state=start(run.network, 30 * run.state.motion[:2].T, 0.0))
    ones = run.ones("density")
    with pytest.raises(TheoryError, match=r"\d+ contacts opened, first pair \d+"):
        gradients.gradient(wide, read_off, ones)
    assert np.isfinite(gradients.gradient(wide, read_off, ones, kinks=True)[1]["density"]).all()
    far = replace(run, state=start(run.network, 1e3 * run.state.motion[:2].T, 0.0))
    for moving in (
        lambda: gradients.gradient(far, read_off, ones, kinks=True),
        lambda: gradients.derivative(far, read_off, ones, ones, kinks=True),
        lambda: gradients.record(far, ones),
    ):
        with pytest.raises(TheoryError, match="spheres move so far that others may touch"):
            moving()
    slippery = replace(run, network=replace(run.network, friction=1e-2))
    with pytest.raises(TheoryError, match=r"\d+ contacts slid"):
        gradients.derivative(slippery, read_off, ones, ones)
    assert 0 < gradients.events(run, ones).nearest < 1


def test_a_pair_that_never_touches_is_not_the_nearest_to_open() -> None:
    """Of four spheres in a row the two in the middle have a gap that is a candidate for a contact."""
    gap, overlap = 1e-3, OVERLAP
    along = np.cumsum([0.0, 2 - overlap, 2 + gap, 2 - overlap])
    material = (Material(1.0, 0.2),)
    network = Network(np.stack([along, 0 * along], axis=1), np.ones(4), np.ones(4), material, held=np.ones(4, bool))
    assert np.sum(start(network, 0.0, 0.0).pairs.overlap < 0) == 1
    run = gradients.Run(network, start(network, 0.0, 0.0), 0.1, 1, 1, np.array([0]))
    assert gradients.events(run, {}).nearest == pytest.approx(1, rel=1e-12)


def test_an_unknown_factor_is_refused_by_name() -> None:
    with pytest.raises(TheoryError, match="'mass': is no factor of a run; density, radius"):
        of_kind("sheet").ones("mass")


def test_the_mass_of_a_sphere_on_a_spring_has_the_slope_of_its_closed_form() -> None:
    """Between two held spheres a small motion is cos ωt, ω² = 2k/m, by the steps cos(2t/h arcsin(ωh/2))."""
    spacing = 2 - OVERLAP
    places = spacing * np.array([[0.0, 0], [1, 0], [2, 0]])
    material, held = (Material(1.0, 0.2, ADHESION),), np.array([True, False, True])
    network = Network(places, np.ones(3), np.ones(3), material, held=held)
    state: State = start(network, [[0, 0], [1e-8, 0], [0, 0]], 0.0)
    run = gradients.Run(network, state, 0.7, 1, 100, np.array([1]))
    stiffness = 1.5 * state.pairs.A[0] * np.sqrt(OVERLAP)
    rate = np.sqrt(2 * stiffness / network.mass[1])
    _, slope = gradients.gradient(run, lambda motions: motions[-1, 0, 0] / 1e-8, run.ones("density"))
    angle, half = 2 * 100 * np.arcsin(rate * 0.7 / 2), rate * 0.7 / 2
    expected = np.sin(angle) * 100 * half / np.sqrt(1 - half**2)  # −sin(angle) dangle/dω · (−ω/2m) m
    assert slope["density"][1] == pytest.approx(expected, rel=1e-6)  # the wave is of the size 1e-6 of the overlap
