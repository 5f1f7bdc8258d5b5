"""Friction while a crystal is let go: the law of the shear springs, what they do to whole crystals, what is refused.

Lengths in Δ0 and forces in k1 Δ0 of `SILICA`.
"""

import ase
import numpy as np
import pytest

from granular_lmp.crystal.disorder import WAYS, Disorder, imperfect
from granular_lmp.crystal.equilibrium import BALANCED, relax
from granular_lmp.crystal.friction import carried_over, shear_forces, slipped, stiffest
from granular_lmp.crystal.lattices import Shape, packed
from granular_lmp.crystal.let_go import SETTLED, let_go
from granular_lmp.crystal.potential import Potential, State, potential_of
from granular_lmp.errors import CrystalError
from tests.crystal.test_sphere import SILICA

UNIT = SILICA.static_overlap / SILICA.radius  # Δ0 in radii
KAPPA = SILICA.stiffness_ratio


def at_places(crystal: ase.Atoms, breathes: bool = False) -> tuple[Potential, State]:
    potential = potential_of(crystal, (SILICA,), np.zeros(2), breathes=breathes)
    return potential, potential.start()


def pair(overlap: float = 1.0) -> tuple[Potential, State]:
    """Return two spheres along x that overlap by a multiple of Δ0."""
    crystal = ase.Atoms("X2", positions=[[0, 0, 0], [2 - overlap * UNIT, 0, 0]], cell=[20, 20, 2])
    crystal.set_array("radius", np.ones(2))
    return at_places(crystal)


def sheet(s: float, seed: int = 1) -> tuple[ase.Atoms, tuple]:
    lattice = packed(SILICA, Shape(12, 10, "periodic"))
    return imperfect(lattice, SILICA, Disorder(radius=s * SILICA.overlap_ratio, seed=seed))


def test_a_slip_below_the_limit_pushes_back_with_the_stiffness_of_the_deck() -> None:
    potential, before = pair()
    after = potential.state(before.pairs, np.array([[0.0, 0.0], [0.0, 1e-3]]), np.zeros(2))
    slip = slipped(potential, np.zeros(1), before, after, np.zeros(2), np.inf)
    force, torque, _ = shear_forces(potential, slip, after)
    # g1 is κ k1. The step turns the contact by 1e-3 Δ0/2R, 1e-7, and the lever arm is shorter than R by 1e-4 of it
    np.testing.assert_allclose(force, [[0, KAPPA * 1e-3], [0, -KAPPA * 1e-3]], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(torque, KAPPA * 1e-3 * (1 - UNIT / 2), rtol=1e-6)


def test_spheres_that_turn_like_cog_wheels_do_not_slip_and_others_do() -> None:
    potential, state = pair()
    step = (potential, np.zeros(1), state, state)
    assert slipped(*step, np.array([0.2, -0.2]), np.inf) == 0
    assert slipped(*step, np.array([0.1, 0.1]), np.inf) == pytest.approx(-0.2, rel=1e-12)


@pytest.mark.parametrize("overlap", [0.5, 1.0, 2.0])
def test_a_contact_slides_at_the_coulomb_limit_of_its_repulsion(overlap: float) -> None:
    potential, state = pair(overlap)
    slip = slipped(potential, np.array([50.0]), state, state, np.zeros(2), 0.3)
    force, _, _ = shear_forces(potential, slip, state)
    # μ (A δ^1.5 + F), where A δ^1.5 − F vanishes at Δ0 and k1 = 1.5 A √Δ0; the overlap is a rest of 2 radii
    adhesion = 2 / 3
    limit = 0.3 * (adhesion * (overlap**1.5 - 1) + 2 * adhesion)
    assert force[0, 1] == pytest.approx(limit, rel=1e-9)


def test_a_contact_that_opens_forgets_its_slip() -> None:
    potential, state = pair()
    apart = potential.state(state.pairs, np.array([[0.0, 0.0], [1.5, 0.0]]), np.zeros(2))
    assert slipped(potential, np.array([0.4]), state, apart, np.zeros(2), np.inf) == 0


def test_shear_forces_push_and_turn_no_crystal_as_a_whole() -> None:
    crystal = packed(SILICA, Shape(6, 6, "periodic"))
    crystal.pbc = False
    potential, state = at_places(crystal)
    slip = np.random.default_rng(2).uniform(-0.1, 0.1, len(state.pairs.i))
    force, torque, _ = shear_forces(potential, slip, state)
    x, y = crystal.positions[:, :2].T
    turn = np.sum(x * force[:, 1] - y * force[:, 0] + torque)
    # Sums of some hundred products of up to 10 R and 0.1 k1 Δ0
    assert np.abs(force.sum(axis=0)).max() < 1e-12
    assert abs(turn) < 1e-11
    # Lever arms of R, as in the slip, would turn it by Δ0/2 for each force
    assert abs(turn + np.sum(KAPPA * slip) * UNIT) > 1e-6


def test_no_vibration_is_faster_than_the_stiffness_that_bounds_the_time_step() -> None:
    potential, state = at_places(packed(SILICA, Shape(6, 6, "periodic")))
    count, normal = len(state.u), (state.vector / state.length).T
    rows = np.zeros((2, len(state.pairs.i), 3 * count))
    for row, (i, j) in enumerate(zip(state.pairs.i, state.pairs.j, strict=True)):
        across = np.array([-normal[row, 1], normal[row, 0]])
        for sphere, sign in ((i, -1), (j, 1)):
            rows[0, row, 3 * sphere : 3 * sphere + 2] = sign * normal[row]
            rows[1, row, 3 * sphere : 3 * sphere + 2] = sign * across
            rows[1, row, 3 * sphere + 2] = -np.sqrt(5 / 2)  # an angle over √Ĩ has the mass 1
    squared = np.linalg.eigvalsh(rows[0].T @ rows[0] + KAPPA * rows[1].T @ rows[1]).max()
    bound = 2 * 6 * stiffest(state)[state.overlap > 0].max()
    assert squared < bound
    # Without the springs that turn spheres the bound would be too low
    assert squared > 2 * 6 * 1.0


def test_slips_stay_with_their_pairs_when_the_list_is_made_again() -> None:
    pairs = at_places(packed(SILICA, Shape(8, 6, "periodic")))[1].pairs
    slip = np.random.default_rng(1).uniform(-1, 1, len(pairs.i))
    fewer = np.arange(len(pairs.i)) % 5 != 2
    shorter = pairs.of(np.flatnonzero(fewer))
    assert (carried_over(pairs, shorter, slip) == slip[fewer]).all()
    assert (carried_over(shorter, pairs, slip[fewer]) == np.where(fewer, slip, 0.0)).all()


def test_spheres_let_go_with_friction_settle_where_normal_forces_alone_do_not_balance() -> None:
    """The springs bear loads: this is why they are released before the rest that is handed to LAMMPS."""
    crystal, _ = sheet(2.0)
    potential, state = at_places(crystal, breathes=True)
    settled = let_go(potential, state, friction=0.3)
    assert np.sqrt(np.mean(np.sum(settled.force**2, axis=1))) > 100 * SETTLED


@pytest.mark.parametrize("by", WAYS)
def test_a_crystal_prepared_with_friction_is_at_rest_without_and_has_fewer_contacts(by: str) -> None:
    without, prepared = (relax(*sheet(2.0), friction=friction, by=by) for friction in (0.0, 0.3))
    assert max(without.residual, prepared.residual) <= BALANCED
    # The case "disorder" has 5.01 and 4.76, with a deviation of 0.1 between two crystals of 120 spheres
    assert prepared.contacts_per_sphere < without.contacts_per_sphere
    assert "a friction of 0.3" in prepared.protocol
    assert "a friction" not in without.protocol.replace("without friction", "")


def test_a_little_friction_changes_a_crystal_a_little() -> None:
    one, other = (relax(*sheet(0.4), friction=friction) for friction in (0.0, 1e-6))
    # s = 0.4 keeps its contacts on any way, and the rest with given contacts is one
    assert np.abs(one.displacement - other.displacement).max() < 1e-6 * UNIT


def test_a_perfect_lattice_has_nothing_to_rub() -> None:
    rest = relax(packed(SILICA, Shape(8, 6, "periodic")), [SILICA], friction=0.3)
    assert not rest.displacement.any()
    assert rest.protocol == "at rest as it is"


@pytest.mark.parametrize("friction", [-0.1, float("nan")])
def test_a_friction_that_cannot_be_is_refused(friction: float) -> None:
    with pytest.raises(CrystalError, match=r"friction = .*: must be at least 0"):
        relax(*sheet(0.8), friction=friction)


def test_friction_between_spheres_that_meet_twice_is_refused() -> None:
    narrow = imperfect(packed(SILICA, Shape(8, 2, "periodic")), SILICA, Disorder(radius=1e-4))
    with pytest.raises(CrystalError, match="meet more than once across periodic faces"):
        relax(*narrow, friction=0.3)
    assert relax(*narrow).residual <= BALANCED
