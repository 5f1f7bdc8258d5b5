"""Closed forms of few spheres at rest in space and beside walls.

Lengths in radii and overlaps in Δ0 of `SILICA`, where nothing else is said.
"""

import numpy as np
import pytest

from granular_lmp.crystal.disorder import Inclusion, imperfect
from granular_lmp.crystal.equilibrium import relax
from granular_lmp.crystal.lattices import Shape, packed
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.walls import Wall
from tests.crystal.test_equilibrium import FLOOR, FORCE, UNIT, at_rest, cluster, overlap_of
from tests.crystal.test_sphere import SILICA
from tests.manual import Measure, Mutant, verifies

ON_FLOOR = float(FLOOR.overlap / SILICA.static_overlap)


def on_floor(radius: float) -> float:
    """Return the overlap with the floor of a sphere at rest, Δ0: that of two spheres with Rc = R."""
    return float((2 * radius) ** (1 / 3))


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
