"""Crystals in space and layers on a wall: contacts at rest, six modes a sphere, and their names."""

import tracemalloc
from dataclasses import replace
from math import pi, sqrt
from typing import Any

import numpy as np
import pytest

from granular_lmp import Scene
from granular_lmp.crystal import bloch, modes
from granular_lmp.crystal.bloch import bloch_modes, effective_inertia
from granular_lmp.crystal.contacts import Contacts, find_contacts
from granular_lmp.crystal.creep import creep_velocities
from granular_lmp.crystal.lattices import LATTICES, PLANE_LATTICES, Lattice, Shape, packed, unit_lattice
from granular_lmp.crystal.mode import PLANE, Physics
from granular_lmp.crystal.modes import bloch_mode, contact_stretches, highest_frequency, named_in_space
from granular_lmp.crystal.sphere import INERTIA_RATIO, Sphere
from granular_lmp.crystal.stability import frequency_bound
from granular_lmp.crystal.stiffnesses import Pair, measured_factors
from granular_lmp.crystal.walls import BOTH, Wall, on_wall
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import CrystalError, SceneError
from granular_lmp.rest.linear import physics_of, unit_contacts
from tests.manual import Measure, Mutant, verifies

SILICA = Sphere(5e-7, 73e9, 0.17, 0.063, 2200.0)
GOLD = Sphere(5e-7, 78e9, 0.44, 0.5, 19300.0)
WALL = Wall(SILICA, SILICA)
SPACE = Physics(space=True)
SOLID = [each for each in LATTICES.values() if each.solid]
ON_WALL = ("hexagonal", "square")
UNIT = SILICA.lattice_constant / SILICA.radius


def hertz(frequency: np.ndarray) -> np.ndarray:
    return frequency / (2 * pi * SILICA.time_scale)


def test_a_wall_of_the_same_material_has_the_overlap_and_the_stiffnesses_of_the_field() -> None:
    # A → √2 A and F → 2F with the radius R in place of R/2
    law = WALL.law(SILICA.radius)
    assert WALL.overlap / SILICA.static_overlap == pytest.approx(2 ** (1 / 3), rel=1e-14)
    for found, pair in (
        (law.normal_stiffness(WALL.overlap), SILICA.normal_stiffness),
        (law.shear_stiffness(WALL.overlap), SILICA.shear_stiffness),
    ):
        assert float(found) / pair == pytest.approx(2 ** (2 / 3), rel=1e-14)
    assert abs(float(law.force(WALL.overlap))) < 1e-12 * SILICA.pull_off_force


@pytest.mark.parametrize("law", ["dmt", "jkr"])
def test_measured_stiffnesses_of_a_wall_scale_its_force_at_the_same_overlap(law: str) -> None:
    sphere = replace(SILICA, adhesion_law=law)
    plain, declared = Wall(sphere, GOLD), Pair(normal_stiffness=321.0, shear_stiffness=123.0)
    measured = replace(plain, factors=measured_factors(declared, plain.law(SILICA.radius), load=0.0))
    assert measured.overlap == pytest.approx(plain.overlap, rel=1e-12)
    found = measured.law(SILICA.radius)
    assert float(found.normal_stiffness(measured.overlap)) == pytest.approx(321.0, rel=1e-12)
    assert float(found.shear_stiffness(measured.overlap)) == pytest.approx(123.0, rel=1e-12)
    deeper = 1.7 * plain.overlap
    share = 321.0 / float(plain.law(SILICA.radius).normal_stiffness(plain.overlap))
    assert float(found.force(deeper)) == pytest.approx(share * float(plain.law(SILICA.radius).force(deeper)), rel=1e-12)


@pytest.mark.parametrize("name", ON_WALL)
@verifies(
    "Modes of the package: six resonances of a layer on a substrate, true torque arms, ω²",
    reference="analytic: closed form at k = 0",
    tolerance=1e-12,
    reason="some roundings of a matrix of six",
    mutant=Mutant(
        "granular_lmp/crystal/bloch.py",
        "(1 - pairs * contacts.overlap / (2 * contacts.radius[end]))",
        "(1 - contacts.overlap / (2 * contacts.radius[end]))",
    ),
)
def test_resonances_of_a_layer_at_k_0_are_those_of_the_closed_form(name: str, measured: Measure) -> None:
    # Exact with the true arms: I θ'' = −torque with the arm R − δ/2 of pairs and R of the wall
    contacts = unit_lattice(SILICA, PLANE_LATTICES[name], WALL)
    count, eta = 2 * (len(contacts) - 1), SILICA.overlap_ratio
    stiff_n, stiff_s = contacts.normal_stiffness[-1], contacts.shear_stiffness[-1]
    pair = SILICA.shear_stiffness * (1 - eta)
    rocking = np.linalg.eigvals(
        np.array([[stiff_s, -stiff_s], [-stiff_s / INERTIA_RATIO, (stiff_s + count * pair) / INERTIA_RATIO]])
    )
    expected = np.array([stiff_n, *rocking, *rocking, 5 * count * pair]) / SILICA.mass
    found = (2 * pi * hertz(bloch_modes(contacts, SILICA, [0.0, 0.0], SPACE)[0])) ** 2
    measured(np.abs(found / np.sort(expected) - 1).max())


@verifies(
    "Resonances of silica spheres on silica, square and hexagonal, MHz",
    reference="analytic: closed forms with arms R, 144.01, 120.84, 478.49, 596.2 MHz (hexagonal)",
    tolerance=0.0002,
    reason="those closed forms leave out η/2",
    mutant=Mutant(
        "granular_lmp/crystal/walls.py",
        "law.between(modulus, shear_modulus, radius, adhesion)",
        "law.between(modulus, shear_modulus, 0.99 * radius, adhesion)",
    ),
)
def test_resonances_of_silica_are_those_of_the_field_to_the_share_eta(measured: Measure) -> None:
    published = {"hexagonal": [120.84, 120.84, 144.01, 478.49, 478.49, 596.2]}
    published["square"] = [114.06, 114.06, 144.01, 413.90, 413.90, 486.8]
    for name, expected in published.items():
        contacts = unit_lattice(SILICA, PLANE_LATTICES[name], WALL)
        found = hertz(bloch_modes(contacts, SILICA, [0.0, 0.0], SPACE)[0]) / 1e6
        measured(np.abs(found / expected - 1).max())


def test_the_vertical_resonance_does_not_know_the_stiffness_of_pairs() -> None:
    soft = replace(SILICA, youngs_modulus=1e9)
    for sphere in (SILICA, soft):
        contacts = unit_lattice(sphere, PLANE_LATTICES["hexagonal"], WALL)
        frequencies, shapes = bloch_modes(contacts, sphere, [0.0, 0.0], SPACE)
        vertical = frequencies[np.argmax(np.abs(shapes[:, 2]))] / sphere.time_scale
        assert vertical == pytest.approx(sqrt(contacts.normal_stiffness[-1] / sphere.mass), rel=1e-13)


def matrices(name: str, wavenumber: float, degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """The sagittal and the shear-horizontal matrix over masses of the field's closed form, arms R."""
    contacts = unit_lattice(SILICA, PLANE_LATTICES[name], WALL)
    stiff_n, stiff_s = contacts.normal_stiffness[-1], contacts.shear_stiffness[-1]
    gn, gs = SILICA.normal_stiffness, SILICA.shear_stiffness
    vector = PLANE_LATTICES[name].vector(wavenumber, degrees)
    k = np.array(vector.components) / SILICA.lattice_constant
    e = np.array(vector.unit)
    p = np.array([-e[1], e[0]])
    d, n = contacts.vector[:-1, :2], contacts.normals[:-1, :2]
    t = np.column_stack([-n[:, 1], n[:, 0]])
    chi = d @ k
    s2, c2 = np.sin(chi / 2) ** 2, np.cos(chi / 2) ** 2
    ne, te, np_, tp = n @ e, t @ e, n @ p, t @ p
    cross = 2 * gs * np.sum(np.sin(chi) * tp)
    sagittal = np.array(
        [
            [stiff_s + 4 * np.sum(s2 * (gn * ne**2 + gs * te**2)), 0, -stiff_s],
            [0, stiff_n + 4 * gs * np.sum(s2), cross],
            [-stiff_s, cross, stiff_s + 4 * gs * np.sum(c2 * tp**2)],
        ]
    )
    horizontal = np.array(
        [
            [stiff_s + 4 * np.sum(s2 * (gn * np_**2 + gs * tp**2)), stiff_s, -cross],
            [stiff_s, stiff_s + 4 * gs * np.sum(c2 * te**2), 0],
            [-cross, 0, 4 * gs * np.sum(c2)],
        ]
    )
    masses = SILICA.mass * np.array([[1, 1, 0.4], [1, 0.4, 0.4]])
    return tuple(m / np.sqrt(np.outer(mass, mass)) for m, mass in zip((sagittal, horizontal), masses, strict=True))


@pytest.mark.parametrize("degrees", [0.0, 90.0])
@pytest.mark.parametrize("name", ON_WALL)
def test_off_k_0_the_branches_of_a_layer_are_those_of_the_closed_form(name: str, degrees: float) -> None:
    lattice = PLANE_LATTICES[name]
    contacts = unit_lattice(SILICA, lattice, WALL)
    named = named_in_space(contacts, SILICA, lattice.vector(0.8, degrees), SPACE)
    assert list(named) == ["S1", "S2", "S3", "H1", "H2", "H3"]
    for letter, matrix in zip("SH", matrices(name, 0.8, degrees), strict=True):
        expected = np.sqrt(np.linalg.eigvalsh(matrix)) * SILICA.time_scale
        found = [named[f"{letter}{number}"][0] for number in (1, 2, 3)]
        # The closed form leaves out the share η of the torques
        np.testing.assert_allclose(found, expected, rtol=1.01 * SILICA.overlap_ratio)
        assert np.abs(found / expected - 1).max() > 1e-6


def test_in_an_oblique_direction_a_layer_has_numbers_only() -> None:
    lattice = PLANE_LATTICES["hexagonal"]
    contacts, vector = unit_lattice(SILICA, lattice, WALL), lattice.vector(0.8, 80.0)
    assert not named_in_space(contacts, SILICA, vector, SPACE)
    with pytest.raises(SceneError, match=r"wave.mode = 'S1': must be one of 1 to 6 in this crystal"):
        bloch_mode(contacts, SILICA, vector, "S1", SPACE)
    assert bloch_mode(contacts, SILICA, vector, "3", SPACE).frequency > 0


def test_without_a_wall_the_modes_in_the_plane_are_those_of_the_plane() -> None:
    lattice = PLANE_LATTICES["hexagonal"]
    contacts, vector = unit_lattice(SILICA, lattice), lattice.vector(1.1, 40.0)
    for name in ("L", "TR", "RT"):
        plane, space = (bloch_mode(contacts, SILICA, vector, name, physics) for physics in (Physics(), SPACE))
        assert space.frequency == pytest.approx(plane.frequency, rel=1e-12)
        np.testing.assert_allclose(space.shape()[:, PLANE], plane.shape()[:, PLANE], rtol=0, atol=1e-10)


@pytest.mark.parametrize("lattice", SOLID, ids=lambda each: each.name)
def test_every_sphere_of_a_packing_touches_those_of_the_infinite_lattice(lattice: Lattice) -> None:
    shape = Shape(4 * lattice.row_period, 4, "periodic", lattice, layers=4 * lattice.layer_period)
    crystal = packed(SILICA, shape)
    cell = np.sort(crystal.positions - crystal.get_celldisp().ravel(), axis=0) / crystal.cell.lengths()
    assert cell.min() > 0
    assert cell.max() < 1
    contacts = find_contacts(crystal, [SILICA], 0.0)
    expected = 6 if lattice.name.startswith("cubic") else 12
    assert (contacts.per_sphere == expected).all()
    assert len(unit_lattice(SILICA, lattice)) * 2 == expected * lattice.cell_size
    assert np.ptp(contacts.overlap) < 1e-9 * SILICA.static_overlap


@pytest.mark.parametrize(
    ("film", "lattice"),
    # Each lattice as one of the two, in turn
    [
        pytest.param(film, lattice, marks=[pytest.mark.more] * ((number + film) % 2), id=f"{kind}-{lattice.name}")
        for film, kind in ((False, "bulk"), (True, "film"))
        for number, lattice in enumerate(SOLID)
    ],
)
def test_modes_of_a_cell_are_those_of_the_whole_packing_at_its_wave_vectors(lattice: Lattice, film: bool) -> None:
    layers = 3 if film else lattice.fewest_layers
    kind = lattice.layered(layers) if film else lattice
    shape = Shape(4 if lattice.row_period < 3 else 6, 4, "periodic", kind, layers=layers)
    wall = Wall(SILICA, GOLD, sides=BOTH)
    crystal = packed(SILICA, shape)
    whole = find_contacts(crystal, [SILICA], 0.0)
    if film:
        whole = with_walls(whole, crystal.positions[:, 2], wall)
    at_gamma = bloch_modes(whole, SILICA, [0.0, 0.0], SPACE)[0]
    vector, own = kind.vector(2 * pi / shape.rows), unit_lattice(SILICA, kind, wall if film else None)
    for frequency in bloch_modes(own, SILICA, np.array(vector.components) / UNIT, SPACE)[0]:
        assert np.abs(at_gamma - frequency).min() < 2e-8  # the root of a rounding where the frequency is near 0


def with_walls(contacts: Contacts, z: np.ndarray, wall: Wall) -> Contacts:
    """Return contacts with those of the outermost spheres with walls."""
    for height, face in zip(wall.heights, (z.min(), z.max()), strict=False):
        spheres = np.flatnonzero(np.abs(z - face) < 1e-6)
        contacts = on_wall(contacts, wall, spheres, np.full(len(spheres), wall.overlap), height * np.eye(3)[2])
    return contacts


@verifies(
    "Speed of long L waves in fcc along [001]",
    reference="analytic: elastic constants of its twelve contacts",
    tolerance=1e-06,
    reason="ξ = 1e-3: dispersion is ξ²/24",
    mutant=Mutant("granular_lmp/crystal/bloch.py", "ways = range(2 if physics.space else 1)", "ways = range(1)"),
)
def test_long_waves_of_fcc_have_the_speeds_of_its_elastic_constants(measured: Measure) -> None:
    # Along [001] in bonds per volume: 8 bonds at 45°, ω² → k² c², by n and t of each
    lattice = LATTICES["fcc [001]"]
    contacts, mass = unit_lattice(SILICA, lattice), SILICA.mass
    xi = 1e-3
    along = contacts.vector[:, 1] / (lattice.row_distance(SILICA.lattice_constant))
    n = contacts.normals
    gn, gs = SILICA.normal_stiffness, SILICA.shear_stiffness
    longitudinal = sqrt(np.sum(along**2 * (gn * n[:, 1] ** 2 + gs * (1 - n[:, 1] ** 2))) / mass)
    mode = bloch_mode(contacts, SILICA, lattice.vector(xi), "L", SPACE)
    measured(mode.frequency / SILICA.time_scale / xi / longitudinal - 1)


def test_no_motion_of_a_layer_is_faster_than_its_bound() -> None:
    lattice = PLANE_LATTICES["hexagonal"]
    crystal = packed(SILICA, Shape(8, 6, "periodic", lattice))
    whole = with_walls(find_contacts(crystal, [SILICA], 0.0), crystal.positions[:, 2], WALL)
    bound = frequency_bound(whole, SILICA, SPACE)
    top = highest_frequency(unit_lattice(SILICA, lattice, WALL), SILICA, SPACE)
    assert top <= bound * (1 + 1e-12)
    assert bound == pytest.approx(top, rel=2e-3)


def test_a_layer_that_is_pressed_together_without_a_substrate_leaves_its_plane() -> None:
    pressed = replace(SILICA, contact_force=1e-7)
    lattice = PLANE_LATTICES["hexagonal"]
    with pytest.raises(CrystalError, match="the crystal is not stable: a mode has the squared frequency -"):
        highest_frequency(unit_lattice(pressed, lattice), pressed, SPACE)


@pytest.mark.parametrize("name", ["square", "chain"])
def test_motions_that_nothing_resists_are_no_sign_of_buckling(name: str) -> None:
    # Without shear nothing holds a sphere across a chain; adhesion pushes it by the rounding of a force that is 0. The
    # substrate then pushes only along z, so that waves within the plane have their names too
    lattice, vector = unit_lattice(SILICA, PLANE_LATTICES[name], WALL), WaveVector(0.0, pi / 4)
    found = named_in_space(lattice, SILICA, vector, Physics(shear=False, rotation=False, space=True))
    assert {branch: frequency > 1e-3 for branch, (frequency, _) in found.items()} == {
        "S1": True, "S2": True, "H1": False, "L": True, "TR": False
    }  # fmt: skip


def test_walls_leave_the_inertia_of_pairs_as_it_is() -> None:
    lattice = PLANE_LATTICES["hexagonal"]
    bare, held = (unit_lattice(SILICA, lattice, wall) for wall in (None, WALL))
    np.testing.assert_array_equal(effective_inertia(bare), effective_inertia(held))
    assert held.on_wall.sum() == 1
    assert held.per_sphere.tolist() == [7]


def test_the_zone_of_fcc_ends_at_x_along_001_and_at_k_along_110() -> None:
    lattice = LATTICES["fcc [001]"]
    assert lattice.zone_edge(90.0) == pytest.approx(pi, rel=1e-12)
    assert lattice.zone_edge(0.0) == pytest.approx(3 * pi / 2 * lattice.row_spacing, rel=1e-12)


def film(layers: int, **values: Any) -> tuple[Scene, Contacts, Physics]:
    scene = Scene.load("multilayer").with_values({"packing.layers": layers} | values)
    return scene, unit_contacts(scene), physics_of(scene)


@pytest.mark.parametrize("values", [{}, {"effects.rotation": False}, {"contact.shear_stiffness": 50.0}])
def test_the_highest_frequency_of_a_thick_film_is_that_of_all_its_wave_vectors(values: dict[str, Any]) -> None:
    scene, crystal, physics = film(14, **values)
    share = np.pi / 4 * np.arange(4) * 2 * scene.sphere.radius / float(crystal.length.min())
    top = max(bloch_modes(crystal, scene.sphere, [x, y], physics)[0].max() for x in share for y in share)
    found = highest_frequency(crystal, scene.sphere, physics)
    # These wave vectors are every third one of the grid; the bound is 1e-3 too high at most
    assert top * (1 - 1e-9) < found < 1.05 * top


@pytest.mark.parametrize("name", ["1", "20", "S2", "H2"])
def test_a_wave_of_a_thick_film_is_that_of_the_whole_spectrum(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, crystal, physics = film(30)
    found = []
    for many in (1000, 12):
        monkeypatch.setattr(modes, "_MANY", many)
        for each in (bloch_mode, named_in_space):
            each.cache_clear()
        mode = bloch_mode(crystal, scene.sphere, scene.vector, name, physics)
        creep_velocities.cache_clear()
        found.append((mode.frequency, *contact_stretches(crystal, scene.sphere, mode)))
    # Of ω² ten digits are left below its largest value
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(one).max())


def test_a_thick_film_creeps_as_the_pseudoinverse_says(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, crystal, physics = film(30)
    mode, found = bloch_mode(crystal, scene.sphere, scene.vector, "1", physics), []
    for sparse in (1000, 12):
        monkeypatch.setattr(bloch, "SPARSE", sparse)
        creep_velocities.cache_clear()
        found.append(creep_velocities(crystal, scene.sphere, mode, physics))
    creep_velocities.cache_clear()
    # 1e-12 of the largest stiffness holds them, and the softest motion of 30 layers has 1e-3
    np.testing.assert_allclose(*found, rtol=0, atol=1e-8 * np.abs(found[0]).max())


def test_a_thick_film_takes_the_memory_of_its_contacts() -> None:
    tracemalloc.start()
    scene, crystal, physics = film(300)
    top = highest_frequency(crystal, scene.sphere, physics)
    mode = bloch_mode(crystal, scene.sphere, scene.vector, "1", physics)
    creep_velocities(crystal, scene.sphere, mode, physics)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # One matrix of its 1800 freedoms has 52 MB
    assert peak < 4e7
    # Inner layers touch twelve others: all spheres that turn in phase are the highest motion, as in fcc
    bulk = highest_frequency(unit_lattice(scene.sphere, LATTICES["fcc [110]"]), scene.sphere, physics)
    assert top == pytest.approx(bulk, rel=2e-3)
    with pytest.raises(SceneError, match=r"wave\.mode = '65': must be at most 64 in a crystal of 300 spheres per cell"):
        bloch_mode(crystal, scene.sphere, scene.vector, "65", physics)
