"""A chain of spheres: its contacts, its energy, its bands; and what it refuses."""

import re

import numpy as np
import pytest

from cases.solitary.chain import (
    Chain,
    acceleration,
    bands,
    compressed,
    energies,
    linear_stiffness,
    normal_modes,
    overlaps,
    spheres,
    uniform,
)
from cases.solitary.chain_motion import SIXTH, march
from granular_analysis.theory.network import Material, Network

STEEL, ALUMINIUM = (193e9, 0.30, 8000.0), (70e9, 0.33, 2700.0)
RADIUS, FORCE = 9.525e-3, 20.0


def mixed(force: float = FORCE) -> Chain:
    """Return steel and aluminium in turn, unequal radii, a wall at the left and a held sphere at the right."""
    materials = np.array([STEEL, ALUMINIUM] * 3).T
    radius = RADIUS * np.array([1.0, 0.8, 1.1, 1.0, 0.9, 1.2])
    modulus, ratio, density = materials
    return spheres(radius, density, modulus, ratio, ends=("wall", "held"), force=force)


def diatomic(count: int, ratio: float) -> Chain:
    """Return heavy and light spheres in turn, heavy ones at the loaded free ends, A = 1, light mass 1, overlap 1."""
    stiffness = np.ones(count + 1)
    stiffness[[0, -1]] = 0.0
    return compressed(np.where(np.arange(count) % 2 == 0, ratio, 1.0), stiffness, 1.0)


@pytest.mark.parametrize("chain", [uniform(5), uniform(5, 1.0), mixed(), mixed(0.0), diatomic(7, 3.0)])
def test_a_chain_is_at_rest_where_all_displacements_are_zero(chain: Chain) -> None:
    assert not acceleration(chain, np.zeros(len(chain))).any()
    assert not energies(chain, np.zeros(len(chain)), np.zeros(len(chain))).any()


def test_every_contact_carries_the_force_that_compresses_the_chain() -> None:
    chain = mixed()
    touching = chain.stiffness > 0
    assert (chain.stiffness * chain.overlap**1.5)[touching] == pytest.approx(FORCE, rel=1e-12)
    assert np.count_nonzero(touching) == 6


def test_the_load_of_free_ends_is_the_force() -> None:
    assert uniform(4, 2.0).load == pytest.approx([2.0, 0.0, 0.0, -2.0], abs=1e-15)


def test_stiffness_and_mass_are_those_of_the_network() -> None:
    chain = mixed()
    radius = RADIUS * np.array([1.0, 0.8])
    materials = tuple(Material(modulus, ratio) for modulus, ratio, _ in (STEEL, ALUMINIUM))
    density = np.array([STEEL[2], ALUMINIUM[2]])
    network = Network(np.array([[0.0, 0.0], [1.0, 0.0]]), radius, density, materials, kind=np.array([0, 1]))
    repulsion = network.coefficients(np.array([0]), np.array([1]))[0]
    assert chain.stiffness[1] == pytest.approx(repulsion[0], rel=1e-12)
    assert chain.mass[:2] == pytest.approx(network.mass, rel=1e-12)


def test_a_rigid_wall_is_stiffer_than_an_equal_sphere_by_the_root_of_eight() -> None:
    wall = spheres(np.ones(2), 1.0, 1.0, 0.2, ends=("wall", "free"))
    # A sphere on a plane is half of two equal ones, and has half of their overlap: (1/2)^{-3/2}
    assert wall.stiffness[0] == pytest.approx(8**0.5 * wall.stiffness[1], rel=1e-12)
    assert wall.stiffness[2] == 0


def test_the_forces_are_the_gradient_of_the_energy() -> None:
    chain = compressed([1.0, 3.0, np.inf, 2.0, 1.0], [2.0, 1.0, 0.5, 1.0, 1.5, 0.0], 0.7)
    rng = np.random.default_rng(1)
    for _ in range(5):
        u = rng.normal(0, 1.0, 5)  # in overlaps: contacts are open too
        u[2] = 0.0
        small = 1e-5
        slope = [
            np.sum(energies(chain, u + small * one, 0 * u) - energies(chain, u - small * one, 0 * u)) / (2 * small)
            for one in np.eye(5)
        ]
        free = np.isfinite(chain.mass)
        # Differences of energies of 1 over 2e-5: rounding 1e-11, curvature 1e-10
        expected = -np.where(free, chain.mass, 0.0)[free] * acceleration(chain, u)[free]
        assert np.array(slope)[free] == pytest.approx(expected, abs=1e-8)


def test_the_energy_of_a_sphere_is_never_negative() -> None:
    chain, rng = mixed(), np.random.default_rng(2)
    u = rng.normal(0, 2 * chain.overlap[1], (200, len(chain)))
    u[:, -1] = 0.0
    assert energies(chain, u, np.zeros_like(u)).min() >= 0


def test_the_energy_is_that_of_hertz_less_the_work_of_the_force() -> None:
    chain = compressed([1.0, 2.0, 1.0], [0.0, 1.5, 0.5, 0.0], 0.8)
    u = np.array([[0.4, -0.1, 0.0], [-3.0, 0.2, 3.0]])  # closed and open
    now, rest = (overlaps(chain, one)[..., 1:3] for one in (u, np.zeros(3)))
    expected = chain.stiffness[1:3] * 0.4 * (np.maximum(now, 0) ** 2.5 - rest**2.5) - 0.8 * (now - rest)
    assert energies(chain, u, 0 * u).sum(axis=1) == pytest.approx(expected.sum(axis=1), rel=1e-12)
    assert energies(chain, u, 0 * u)[:, 0] == pytest.approx(expected[:, 0] / 2, rel=1e-12)


def test_the_energy_of_the_smallest_motions_keeps_its_digits() -> None:
    chain, small = uniform(2, 1.0), 1e-12
    # K x²/2 with K = 3/2; the next term is 1e-13 of it
    assert energies(chain, np.array([small, 0.0]), np.zeros(2)).sum() == pytest.approx(0.75 * small**2, rel=1e-10)


def test_energy_and_momentum_are_conserved() -> None:
    chain, rng = diatomic(9, 3.0), np.random.default_rng(3)
    u, v = np.zeros(9), 0.3 * rng.standard_normal(9)
    us, vs = march(chain, u, v, 0.02, 500, SIXTH, every=100)
    assert vs @ chain.mass == pytest.approx(v @ chain.mass, rel=0, abs=1e-12)  # forces cancel in pairs
    # Contacts stay closed, so the error is of order 6: 1e-11 at this step
    assert energies(chain, us, vs).sum(axis=1) == pytest.approx(energies(chain, u, v).sum(), rel=1e-9)


def test_states_side_by_side_move_as_each_alone() -> None:
    chain, rng = mixed(0.0), np.random.default_rng(4)
    u = 1e-6 * rng.standard_normal((3, len(chain)))
    assert np.array_equal(acceleration(chain, u), [acceleration(chain, one) for one in u])
    assert overlaps(chain, u).shape == (3, 7)


# --- bands ------------------------------------------------------------------------------------------------------------


def test_the_gap_of_the_bands_is_that_of_the_modes_of_a_long_chain() -> None:
    chain = diatomic(401, 3.0)
    low, high, top = bands((3.0, 1.0), linear_stiffness(chain)[1])
    frequencies, _ = normal_modes(chain)
    inside = frequencies[(frequencies > low * 1.0001) & (frequencies < high * 0.9999)]
    assert inside.size == 0
    # Edges of a chain of 200 cells: 1/2 (π/400)² (…) of order 1e-5
    assert frequencies[frequencies <= low * 1.0001].max() == pytest.approx(low, rel=1e-4)
    assert frequencies[frequencies >= high * 0.9999].min() == pytest.approx(high, rel=1e-4)
    assert frequencies.max() == pytest.approx(top, rel=1e-4)


def test_modes_are_normalised_and_move_with_their_frequency() -> None:
    chain = mixed()
    frequencies, shapes = normal_modes(chain)
    assert shapes.shape == (5, 6)
    assert not shapes[:, -1].any()
    masses = chain.mass[:-1]
    assert (shapes[:, :-1] * masses) @ shapes[:, :-1].T == pytest.approx(np.eye(5), abs=1e-12)
    small = 1e-9 * chain.overlap[1] * shapes[2] / np.abs(shapes[2]).max()
    # 1e-9 of the overlap: the force's second order is 1e-9, its rounding 1e-7
    assert acceleration(chain, small) == pytest.approx(-(frequencies[2] ** 2) * small, abs=1e-6 * np.ptp(small) * 1e10)


# --- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Chain(np.ones(3), np.ones(3), np.zeros(4)), "stiffness must hold 4 numbers"),
        (lambda: Chain(np.ones(3), np.ones(4), np.zeros(3)), "overlap must hold 4 numbers"),
        (lambda: Chain(np.array([1.0, np.nan]), np.ones(3), np.zeros(3)), "mass must hold 2 numbers"),
        (lambda: Chain(np.array([1.0, 0.0]), np.ones(3), np.zeros(3)), "mass must be positive"),
        (lambda: Chain(np.ones(0), np.ones(1), np.zeros(1)), "mass must be positive"),
        (lambda: Chain(np.ones(2), -np.ones(3), np.zeros(3)), "stiffness must be finite and not negative"),
        (lambda: Chain(np.ones(2), np.ones(3), np.full(3, np.inf)), "overlap must be finite"),
        (lambda: compressed(np.ones(2), np.zeros(3)), "stiffness must be positive between two spheres"),
        (lambda: uniform(3, -1.0), "force must be finite and not negative, not -1.0"),
        (lambda: spheres([1.0, -1.0], 1.0, 1.0, 0.2), "radius must be positive"),
        (lambda: spheres([1.0, 1.0], 0.0, 1.0, 0.2), "density must be positive"),
        (lambda: spheres([1.0, 1.0], 1.0, np.inf, 0.2), "youngs_modulus must be positive"),
        (lambda: spheres([1.0, 1.0], 1.0, 1.0, 0.6), "poisson_ratio must be above -1"),
        (lambda: spheres([1.0, 1.0], 1.0, 1.0, 0.2, ends=("free", "fixed")), "ends must be two of free, held, wall"),
        (lambda: bands((1.0, 0.0), 1.0), "masses and stiffness must be positive"),
    ],
)
def test_values_out_of_range_are_refused_by_name(make, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        make()
