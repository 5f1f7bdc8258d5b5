"""Crystals at rest in space and beside walls: closed forms of few spheres, balance of forces, and stiffness.

Lengths in radii and overlaps in Δ0 of `SILICA`, where nothing else is said.
"""

import ase
import numpy as np
import pytest

from granular_lmp.crystal.balance import BALANCED
from granular_lmp.crystal.disorder import WAYS, WHOLE, Disorder, Inclusion, imperfect
from granular_lmp.crystal.equilibrium import Equilibrium, relax
from granular_lmp.crystal.lattices import LATTICES, Shape, packed
from granular_lmp.crystal.potential import box_load, potential_of
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.tangent import Tangent
from granular_lmp.crystal.walls import Face, Wall
from granular_lmp.errors import CrystalError
from tests.conftest import latin
from tests.crystal.test_equilibrium import FORCE, HERTZ, ROUNDED, UNIT, overlap_of, spread
from tests.crystal.test_sphere import SILICA
from tests.manual import Measure, Mutant, verifies

UP = np.eye(3)[2]
FLOOR = Face(Wall(SILICA, SILICA), -UP, Wall(SILICA, SILICA).overlap)
CEILING = Face(Wall(SILICA, SILICA), UP, Wall(SILICA, SILICA).overlap)
ON_FLOOR = float(FLOOR.overlap / SILICA.static_overlap)
FILM = LATTICES["fcc [11-2]"].layered(3)
CRYSTALS = {
    "sheet in the plane": (Shape(8, 6, "periodic"), ()),
    "layer": (Shape(12, 10, "periodic"), (FLOOR,)),
    "layer between held rows": (Shape(13, 10, "fixed"), (FLOOR,)),
    "honeycomb": (Shape(12, 10, "periodic", LATTICES["honeycomb"]), (FLOOR,)),
    "chain": (Shape(20, 1, "periodic", LATTICES["chain"]), (FLOOR,)),
    "fcc": (Shape(6, 4, "periodic", LATTICES["fcc [001]"], layers=4), ()),
    "hcp": (Shape(6, 4, "periodic", LATTICES["hcp c"], layers=4), ()),
    "film": (Shape(6, 4, "periodic", FILM, layers=3), (FLOOR,)),
    "film between two plates": (Shape(6, 4, "periodic", FILM, layers=3), (FLOOR, CEILING)),
}
PLANE = {"sheet in the plane"}


def on_floor(radius: float) -> float:
    """Return the overlap with the floor of a sphere at rest, Δ0: that of two spheres with Rc = R."""
    return float((2 * radius) ** (1 / 3))


def cluster(positions: list[list[float]], radius: list[float]) -> ase.Atoms:
    """Return free spheres in no box; the lowest touch the floor as spheres of the reference radius do."""
    crystal = ase.Atoms(f"X{len(radius)}", positions=positions, cell=[20, 20, 20])
    crystal.set_array("radius", np.array(radius))
    return crystal


def at_rest(name: str, s: float, seed: int = 1, sphere: Sphere = SILICA, by: str = WHOLE) -> Equilibrium:
    shape, faces = CRYSTALS[name]
    crystal, materials = imperfect(packed(sphere, shape), sphere, spread(s, seed))
    return relax(crystal, materials, faces=faces, space=name not in PLANE, by=by)


def forces(rest: Equilibrium) -> np.ndarray:
    """Return the forces of the contacts on the spheres, (N, 3), in k1 Δ0."""
    contacts = rest.contacts
    push, pairs = contacts.contact_force[:, None] * contacts.normals / FORCE, ~contacts.on_wall
    total = np.zeros((len(rest.lattice), 3))
    np.add.at(total, contacts.j[pairs], push[pairs])
    np.add.at(total, contacts.i, -push)
    return total


# --- closed forms ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.99, 1.0, 1.03])
def test_a_sphere_rests_on_the_floor_at_the_overlap_of_its_own_radius(radius: float) -> None:
    rest = relax(cluster([[0, 0, 0], [5, 0, 0]], [radius, 1.0]), [SILICA], faces=[FLOOR], space=True)
    assert rest.contacts.on_wall.all()
    expected = [on_floor(radius), ON_FLOOR]
    np.testing.assert_allclose(rest.contacts.overlap / SILICA.static_overlap, expected, rtol=0, atol=1e-9)
    height = rest.crystal.positions[:, 2] - (-1 + ON_FLOOR * UNIT)
    np.testing.assert_allclose(height, [radius - on_floor(radius) * UNIT, 1 - ON_FLOOR * UNIT], rtol=0, atol=1e-12)


def test_two_unequal_spheres_on_the_floor_touch_across_their_heights() -> None:
    radius = [1.0, 1.0004]
    rest = relax(cluster([[0, 0, 0], [2 - UNIT, 0, 0]], radius), [SILICA], faces=[FLOOR], space=True)
    assert len(rest.contacts) == 3
    assert np.abs(rest.contacts.contact_force).max() < 1e-9 * FORCE
    heights = [each - on_floor(each) * UNIT for each in radius]
    distance = sum(radius) - overlap_of(*radius) * UNIT
    apart = rest.crystal.positions[1] - rest.crystal.positions[0]
    assert apart[0] == pytest.approx(np.sqrt(distance**2 - (heights[1] - heights[0]) ** 2), abs=1e-9 * UNIT)
    assert apart[2] == pytest.approx(heights[1] - heights[0], abs=1e-9 * UNIT)


@pytest.mark.parametrize("radius", [0.9999, 1.0002])
@verifies(
    "Equilibrium: an unequal sphere on three others on a floor, height in Δ0",
    reference="analytic: the overlaps at rest of its contacts",
    tolerance=1e-09,
    reason="Newton's steps end at forces of 1e-9 of the pull-off force",
    mutant=Mutant(
        "granular_lmp/crystal/contacts.py",
        "effective_radius = radius[i] * radius[j] / (radius[i] + radius[j])",
        "effective_radius = radius[i] / 2 + 0 * radius[j]",
    ),
)
def test_a_sphere_rests_on_three_others(radius: float, measured: Measure) -> None:
    side = 2 - UNIT
    base = [[0, 0, 0], [side, 0, 0], [side / 2, side * np.sqrt(3) / 2, 0]]
    top = [side / 2, side / np.sqrt(12), side * np.sqrt(2 / 3)]
    crystal = cluster([*base, top], [1.0, 1.0, 1.0, radius])
    rest = relax(crystal, [SILICA], faces=[FLOOR], space=True)
    assert len(rest.contacts) == 3 + 3 + 3
    assert np.abs(rest.contacts.contact_force).max() < 1e-9 * FORCE
    slope = 1 + radius - overlap_of(1.0, radius) * UNIT
    height = rest.crystal.positions[3, 2] - rest.crystal.positions[0, 2]
    measured((height - np.sqrt(slope**2 - side**2 / 3)) / UNIT)


def test_a_floor_of_another_material_has_the_law_of_the_two() -> None:
    gold = Sphere(5e-7, 78e9, 0.44, 0.5, 19300.0)
    crystal, materials = imperfect(
        packed(SILICA, Shape(6, 4, "periodic")),
        SILICA,
        inclusions=[Inclusion(rows=(2, 3), youngs_modulus=78e9, poisson_ratio=0.44, work_of_adhesion=0.5)],
    )
    rest = relax(crystal, materials, faces=[FLOOR], space=True)
    walls = rest.contacts.on_wall
    expected = np.where(
        rest.lattice.arrays["material"] == 1, Wall(gold, SILICA).law(5e-7).overlap_under(0.0), FLOOR.overlap
    )
    assert walls.sum() == len(crystal)
    # Contacts between gold and silica are of other lengths, and press the layer out of its plane by less than this
    np.testing.assert_allclose(rest.contacts.overlap[walls], expected, rtol=1e-3)


def test_the_upper_plate_of_a_film_moves_until_nothing_presses_on_it() -> None:
    rest = at_rest("film between two plates", 0.8)
    push = rest.contacts.contact_force / FORCE
    for way in (-1, 1):
        plate = rest.contacts.on_wall & (rest.contacts.normals[:, 2] * way > 0.5)
        assert plate.sum() > 20
        assert abs(push[plate].sum()) < 1e-7
    assert np.abs(push[rest.contacts.on_wall]).max() > 0.1
    assert rest.strain[2] > 1e-6


# --- balance ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CRYSTALS)
def test_a_perfect_crystal_in_space_is_returned_as_it_is(name: str) -> None:
    rest = at_rest(name, 0.0)
    assert not rest.displacement.any()
    assert not rest.strain.any()
    assert rest.steps == 0


@pytest.mark.parametrize(("s", "name", "by"), latin([0.12, 2.0], CRYSTALS, WAYS))
def test_no_force_is_left_in_space(name: str, s: float, by: str) -> None:
    rest = at_rest(name, s, by=by)
    free = ~rest.lattice.arrays["fixed"]
    assert rest.residual <= BALANCED
    assert np.abs(forces(rest)[free]).max() < BALANCED + ROUNDED
    assert not rest.displacement[~free, :2].any()
    assert len(rest.box_load) == (2 if name in PLANE else 3)
    assert rest.lifted == 0


def test_a_compressed_crystal_in_space_bears_the_load_of_its_lattice() -> None:
    lattice = packed(HERTZ, Shape(6, 4, "periodic", LATTICES["fcc [001]"], layers=4))
    load = box_load(lattice, HERTZ, axes=3)
    rest = relax(*imperfect(lattice, HERTZ, spread(0.4, vacancies=0.03)), load=load, space=True)
    np.testing.assert_allclose(rest.box_load / (1 + rest.strain), load, rtol=1e-8)
    assert np.abs(rest.strain).min() > 1e-7


@pytest.mark.parametrize("name", ["sheet in the plane", "layer", "film between two plates", "fcc"])
def test_stiffness_is_the_derivative_of_the_force(name: str) -> None:
    (shape, faces), axes = CRYSTALS[name], 2 if name in PLANE else 3
    crystal, materials = imperfect(packed(SILICA, shape), SILICA, spread(0.3))
    potential = potential_of(crystal, materials, np.zeros(axes), breathes=True, faces=faces)
    random, u = np.random.default_rng(3), potential.start().u
    u, e = u + random.uniform(-0.1, 0.1, u.shape), random.uniform(-1e-5, 1e-5, axes)
    du, de = random.uniform(-1, 1, u.shape), random.uniform(-1, 1, axes) / potential.neighbour
    u[len(crystal) :] = du[len(crystal) :] = 0.0  # a wall does not move
    e, de = e * potential.breathing, de * potential.breathing
    state, h = potential.at(u, e), 1e-4
    tangent = Tangent.of(potential, state)
    more, less = (potential.state(state.pairs, u + sign * h * du, e + sign * h * de) for sign in (1, -1))
    force = -(more.force - less.force) / (2 * h)
    stress = -(more.stress - less.stress) / (2 * h)
    predicted = tangent.by_u @ du.ravel() + tangent.by_both @ de
    # Central differences: the third derivative of a contact is of order 1, h² = 1e-8
    np.testing.assert_allclose(force.ravel(), predicted, rtol=0, atol=1e-6)
    predicted = tangent.by_both.T @ du.ravel() + tangent.by_e @ de
    breathing = potential.breathing
    np.testing.assert_allclose(stress[breathing], predicted[breathing], rtol=0, atol=1e-6 * np.abs(predicted).max())
    assert not stress[~breathing].any()


@pytest.mark.parametrize("name", ["layer", "fcc", "film"])
def test_the_rest_in_space_is_stable(name: str) -> None:
    rest, faces = at_rest(name, 1.2), CRYSTALS[name][1]
    potential = potential_of(rest.lattice, (SILICA,), np.zeros(3), breathes=False, faces=faces)
    u = np.zeros((len(potential.free), 3))
    u[: len(rest.lattice)] = rest.displacement / UNIT
    tangent = Tangent.of(potential, potential.at(u, rest.strain))
    assert np.linalg.eigvalsh(tangent.by_u.toarray())[0] > -1e-9


def test_friction_in_space_is_refused() -> None:
    crystal, materials = imperfect(packed(SILICA, Shape(6, 4, "periodic")), SILICA, Disorder(radius=1e-5))
    for how in ({"space": True}, {"faces": [FLOOR]}):
        with pytest.raises(CrystalError, match=r"friction = 0\.3: must be 0 in space and beside walls"):
            relax(crystal, materials, friction=0.3, **how)  # type: ignore[arg-type]
