"""The gradient of a run: Taylor remainders and adjoints over all kinds of networks and factors, and what is refused."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Material, Network, Wall
from granular_analysis.theory.network_outside import Drive
from granular_analysis.theory.network_state import State, start
from granular_analysis.theory.network_verlet import march
from granular_analysis.theory.signals import tone
from tests.conftest import members

jax = pytest.importorskip("jax")
jnp = jax.numpy
gradients = pytest.importorskip("granular_analysis.theory.network_gradient", reason="needs JAX")
factors = pytest.importorskip("granular_analysis.theory.network_factors", reason="needs JAX")

OVERLAP, ADHESION = 1e-2, 1e-3  # so deep that a step of 1e-3 in a radius opens no contact
RECORDED = np.array([5, 9])
# Changes of each kind to 24 spheres in the plane; spheres in space lie on a wall
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
FACTORS = list(factors.FACTORS)
# Steps of a factor over four decades; in a radius they change overlaps a hundred times as much
STEPS = 10.0 ** -np.arange(1.5, 6)


@cache
def of_kind(kind: str) -> "factors.Run":
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
    signal = tone(0.3, 5.0)
    push = Drive(np.array([7]), 0, lambda time: 3e-4 * signal(time), longest=3.0, size=3e-4)
    numbers = {"materials": (Material(1.0, 0.2, ADHESION),)} | changes
    network = Network(places, np.ones(24), np.ones(24), cell=cell, drives=(push,), **numbers)
    state = start(network, way, 0.0)
    ahead = np.roll(state.motion, 4, axis=1)
    return factors.Run(network, state, 0.5, 8, 5, RECORDED, contacts=np.arange(0, 60, 7), quadrature=ahead)


def read_off(found: object) -> object:
    """Return a number that depends on all of a record."""
    weights = jnp.asarray(np.random.default_rng(3).normal(size=found.motion.shape))
    return jnp.sum(weights * found.motion) + 1e3 * (jnp.sum(found.motion[:, 0] ** 2) + jnp.sum(found.power))


def order_of(left: np.ndarray, sizes: np.ndarray) -> float:
    """Return the slope of logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(left), 1)[0])


def test_a_record_without_factors_is_that_of_the_steps() -> None:
    run = of_kind("friction")
    found = gradients.record(run, run.neutral(*FACTORS))
    expected = np.array([*march(run.network, run.state, run.step, 40, 5)])[:, :, RECORDED]
    np.testing.assert_allclose(found.motion, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    assert found.times == pytest.approx(2.5 * np.arange(9))


def test_runs_of_equal_traits_and_shapes_share_what_is_compiled() -> None:
    run = of_kind("smooth")
    smaller = replace(run, step=0.9 * run.step, state=replace(run.state, motion=0.5 * run.state.motion))
    gradients.record(run, {})
    compiled = gradients._recorded._cache_size()
    found = gradients.record(smaller, {}).motion
    assert gradients._recorded._cache_size() == compiled
    expected = np.array([*march(smaller.network, smaller.state, smaller.step, 40, 5)])[:, :, RECORDED]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_a_slip_that_is_zero_until_a_factor_changes_it_has_its_slope() -> None:
    """Of four spheres in a square that moves as a whole no contact has a slip, unless one of them is heavier."""
    places = (2 - OVERLAP) * np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    network = Network(places, np.ones(4), np.ones(4), (Material(1.0, 0.2, ADHESION),), rotation=False)
    signal = tone(0.3, 5.0)
    push = Drive(np.arange(4), 0, lambda time: 3e-4 * signal(time), longest=3.0, size=3e-4)
    network = replace(network, drives=(push,))
    run = factors.Run(network, start(network, 0.0, 0.0), 0.5, 4, 10, np.arange(4))
    ones = run.neutral("density")

    def read(found: object) -> object:
        return 1e4 * jnp.sum(found.motion[-1, 0, 0])

    slope = gradients.gradient(run, read, ones)[1]["density"]
    step = 1e-3 * np.eye(4)[2]
    ends = [float(read(gradients.record(run, {"density": ones["density"] + way}))) for way in (step, -step)]
    assert slope[2] == pytest.approx((ends[0] - ends[1]) / 2e-3, rel=1e-5)


# Each kind is compiled once, for some seconds; friction runs the lines of most others
@pytest.mark.parametrize("kind", members(KINDS, *(kind for kind in KINDS if kind != "friction")))
def test_what_a_gradient_leaves_is_of_second_order_and_both_modes_are_adjoint(kind: str) -> None:
    run, rng = of_kind(kind), np.random.default_rng(1)
    ones = run.neutral(*FACTORS)
    value, slope = gradients.gradient(run, read_off, ones)
    for name in FACTORS:
        way = rng.normal(size=ones[name].shape)
        way /= np.abs(way).max()
        along, direction = float(np.sum(slope[name] * way)), {each: 0 * ones[each] for each in FACTORS} | {name: way}

        def read(size: float, direction: dict[str, object] = direction) -> tuple[float, float]:
            moved = {each: ones[each] + size * direction[each] for each in FACTORS}
            return tuple(map(float, gradients.derivative(run, read_off, moved, direction)))

        assert read(0.0)[1] == pytest.approx(along, rel=1e-11, abs=1e-15 * abs(value)), name
        sizes = STEPS * (1e-2 if name == "radius" else 1.0)
        left = np.array([abs(read(size)[0] - value - along * size) for size in sizes])
        if left[0] > 1e-12 * abs(value):  # otherwise linear or independent, to rounding
            assert order_of(left, sizes) == pytest.approx(2, abs=0.1), name


@pytest.mark.more  # each compiles for half a minute; that of a sphere on a spring is below
@pytest.mark.parametrize("kind", ["sheet", "friction"])
def test_what_a_hessian_leaves_is_of_third_order_and_it_is_symmetric(kind: str) -> None:
    run, rng = of_kind(kind), np.random.default_rng(2)
    ones = run.neutral(*FACTORS)
    one, other = ({name: rng.normal(size=ones[name].shape) for name in FACTORS} for _ in range(2))
    slope, by_one = gradients.hessian_product(run, read_off, ones, one)
    by_other = gradients.hessian_product(run, read_off, ones, other)[1]
    both = [sum(np.sum(a[name] * b[name]) for name in FACTORS) for a, b in ((other, by_one), (one, by_other))]
    assert both[0] == pytest.approx(both[1], rel=1e-11)
    # All factors change together, radii by a hundredth of the others
    way = {name: one[name] * (1e-2 if name == "radius" else 1.0) for name in FACTORS}
    slope, change = gradients.hessian_product(run, read_off, ones, way)
    first, second = (sum(np.sum(a[name] * way[name]) for name in FACTORS) for a in (slope, change))
    sizes, left = 10.0 ** -np.arange(1.5, 4, 0.5), []
    value = gradients.derivative(run, read_off, ones, way)[0]
    for size in sizes:
        moved = {name: ones[name] + size * way[name] for name in FACTORS}
        read = float(gradients.derivative(run, read_off, moved, way)[0])
        left.append(abs(read - value - size * first - size**2 / 2 * second))
    assert order_of(np.array(left), sizes) == pytest.approx(3, abs=0.1)
    with pytest.raises(TheoryError, match="spheres move so far that new contacts are possible"):
        gradients.hessian_product(run, read_off, ones | {"amplitude": 1e3}, one, kinks=True)


def test_the_memory_of_a_gradient_grows_as_the_root_of_the_steps_also_between_few_records() -> None:
    """With 16 times the steps the states that are held are four times as many, beside what does not grow."""
    plain = of_kind("smooth")
    plain = replace(plain, network=replace(plain.network, drives=()), contacts=())
    few, many = (replace(plain, samples=4, every=steps // 4) for steps in (64, 1024))
    one, other = (gradients.bytes_of_gradient(run, read_off, run.neutral("density")) for run in (few, many))
    assert one < other < 4 * one


# Factors change the run of `friction` without another compilation
WIDE, FAR, SLIPPERY = {"amplitude": 30.0}, {"amplitude": 1e3}, {"normal_stiffness": 1e-5}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (WIDE, r"\d+ contacts opened, first pair \d+"),
        (FAR, "spheres move so far that new contacts are possible"),
        (SLIPPERY, r"\d+ contacts slid"),
    ],
)
def test_a_contact_that_opens_or_slides_and_far_motion_are_refused_on_every_path(
    changes: dict[str, float], message: str
) -> None:
    run = of_kind("friction")
    ones = run.neutral(*FACTORS)
    there = ones | {name: value * ones[name] for name, value in changes.items()}

    def paths(kinks: bool) -> list[Callable[[], object]]:
        return [
            lambda: gradients.gradient(run, read_off, there, kinks=kinks),
            lambda: gradients.derivative(run, read_off, there, ones, kinks=kinks),
        ]

    for path in paths(changes is FAR) + [lambda: gradients.record(run, there)] * (changes is FAR):
        with pytest.raises(TheoryError, match=message):
            path()
    if changes is not FAR:
        assert np.isfinite(paths(True)[0]()[1]["density"]).all()
    assert 0 < gradients.events(run, ones).nearest < 1


def test_a_pair_that_never_touches_is_not_the_nearest_to_open() -> None:
    """Of four spheres in a row the two in the middle have a gap that is a candidate for a contact."""
    gap, overlap = 1e-3, OVERLAP
    along = np.cumsum([0.0, 2 - overlap, 2 + gap, 2 - overlap])
    material = (Material(1.0, 0.2),)
    network = Network(np.stack([along, 0 * along], axis=1), np.ones(4), np.ones(4), material, held=np.ones(4, bool))
    assert np.sum(start(network, 0.0, 0.0).pairs.overlap < 0) == 1
    run = factors.Run(network, start(network, 0.0, 0.0), 0.1, 1, 1, np.array([0]))
    found = gradients.events(run, {})
    assert found.nearest == pytest.approx(1, rel=1e-12)
    assert run.state.pairs.overlap[found.closest] > 0


def test_an_unknown_factor_is_refused_by_name() -> None:
    with pytest.raises(TheoryError, match="'mass': not a factor of a run; allowed: density, radius"):
        of_kind("sheet").neutral("mass")


def test_a_phase_without_a_quadrature_and_a_delay_of_a_signal_for_numpy_alone_are_refused() -> None:
    run = of_kind("sheet")
    with pytest.raises(TheoryError, match="phase: needs the quadrature of the run"):
        replace(run, quadrature=None).neutral("phase")
    push = replace(run.network.drives[0], signal=lambda time: np.cos(time))
    plain = replace(run, network=replace(run.network, drives=(push,)))
    with pytest.raises(TheoryError, match="delay: a signal takes only NumPy arrays"):
        gradients.record(plain, plain.neutral("delay"))


def test_the_mass_of_a_sphere_on_a_spring_has_the_slope_and_the_curvature_of_its_closed_form() -> None:
    """Between two held spheres a small motion is cos ωt, ω² = 2k/m, by the steps cos(2t/h arcsin(ωh/2))."""
    spacing = 2 - OVERLAP
    places = spacing * np.array([[0.0, 0], [1, 0], [2, 0]])
    material, held = (Material(1.0, 0.2, ADHESION),), np.array([True, False, True])
    network = Network(places, np.ones(3), np.ones(3), material, held=held)
    state: State = start(network, [[0, 0], [1e-8, 0], [0, 0]], 0.0)
    run = factors.Run(network, state, 0.7, 1, 100, np.array([1]))
    stiffness = 1.5 * state.pairs.A[0] * np.sqrt(OVERLAP)
    half = np.sqrt(2 * stiffness / network.mass[1]) * 0.7 / 2
    slope, change = gradients.hessian_product(
        run, lambda found: found.motion[-1, 0, 0] / 1e-8, run.neutral("density"), {"density": np.eye(3)[1]}
    )
    # Derivatives of cos φ with φ = 200 arcsin(half/√density)
    angle, root = 200 * np.arcsin(half), np.sqrt(1 - half**2)
    first, second = -100 * half / root, 100 * half * (1 / root + 0.5 / root**3)
    exact = -np.sin(angle) * first, -np.cos(angle) * first**2 - np.sin(angle) * second
    small = 1e-6  # the wave is of the size 1e-6 of the overlap
    assert slope["density"][1] == pytest.approx(exact[0], rel=small)
    assert change["density"][1] == pytest.approx(exact[1], rel=small)
