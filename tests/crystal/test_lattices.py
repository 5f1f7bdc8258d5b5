"""Scenes of the square lattice and the chain: closed forms of their waves, and scenes."""

from dataclasses import replace
from math import pi, sqrt
from typing import Any

import numpy as np
import pytest

from granular_lmp import Scene, build
from granular_lmp.crystal.contacts import find_contacts
from granular_lmp.crystal.lattices import (
    CHAIN,
    HEXAGONAL,
    HONEYCOMB,
    PLANE_LATTICES,
    SQUARE,
    Lattice,
    Shape,
    centre,
    lattice_constant,
    offsets,
    packed,
    unit_lattice,
)
from granular_lmp.crystal.mode import FULL, Physics
from granular_lmp.crystal.modes import bears_compression, bloch_modes, highest_frequency, restored
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import CrystalError, SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.initial_fields import initial_fields
from granular_lmp.rest.linear import bloch_wave, mode_of, physics_of, unit_contacts
from granular_lmp.rest.shape import FASTEST_ROWS_PER_TAU
from tests.crystal.test_sphere import SILICA

pytestmark = pytest.mark.rounding  # matrices of an eigenvalue problem, sines and cosines

SPHERES = [SILICA, replace(SILICA, poisson_ratio=-0.6), replace(SILICA, poisson_ratio=0.5)]
FROZEN = Physics(rotation=False)


def scene_of(lattice: str, mode: str, **changes: Any) -> Scene:
    """Return a periodic cell of 8 rows that runs in milliseconds; sections in the names of changes end in "__"."""
    values = {
        "packing.lattice": lattice,
        "packing.rows": 8,
        "packing.columns": "auto",
        "wave.mode": mode,
        "wave.wavenumber": pi / 4,
        "time.duration": 5.0,
        "time.timestep": 0.05,
    }
    return Scene.load("tr_periodic").with_values(values | {k.replace("__", "."): v for k, v in changes.items()})


# --- several spheres a cell ------------------------------------------------------------------------------------------


def test_the_waves_of_a_sheet_are_those_of_the_cell_of_two_spheres() -> None:
    sheet = packed(SILICA, Shape(6, 4, "periodic", HONEYCOMB))
    assert [each[centre(sheet)] for each in offsets(sheet)] == [0.0, 0.0]
    assert HONEYCOMB.fewest_columns == 4
    of_sheet, _ = bloch_modes(find_contacts(sheet, [SILICA], SILICA.contact_force), SILICA, np.zeros(2))
    cell, spacings = unit_lattice(SILICA, HONEYCOMB), (HONEYCOMB.row_spacing, HONEYCOMB.column_spacing)
    vectors = [WaveVector(2 * pi * i / 4, 2 * pi * j / 6, *spacings) for i in range(2) for j in range(6)]
    waves = np.array([each.components for each in vectors]) / lattice_constant(SILICA)
    of_cell, _ = bloch_modes(cell, SILICA, waves)
    # Eigenvalues of order 1, and overlaps of the sheet that follow from the force; the torque arm is the same
    np.testing.assert_allclose(np.sort(of_cell.ravel()) ** 2, np.sort(of_sheet) ** 2, atol=1e-11)
    assert HONEYCOMB.vector(pi).components == pytest.approx((0.0, pi / 1.5))  # rows are 3/2 of a contact apart


def test_two_waves_of_a_honeycomb_meet_at_the_corner_of_its_zone_alone() -> None:
    cell, a = unit_lattice(SILICA, HONEYCOMB), lattice_constant(SILICA)
    corner = np.array(HONEYCOMB.corners[2]) / HONEYCOMB.column_distance(a)
    there, beside = bloch_modes(cell, SILICA, [corner, 0.9 * corner], FROZEN)[0]
    assert there[1] == pytest.approx(there[2], rel=1e-12)
    assert beside[2] > 1.05 * beside[1]


def test_a_honeycomb_whose_spheres_roll_freely_has_a_wave_that_nothing_restores() -> None:
    cell, middle = unit_lattice(SILICA, HONEYCOMB), np.array([[0.0, 1.0], [0.4, 1.0]])  # along y; in no mirror line
    free, oblique = bloch_modes(cell, SILICA, middle)[0]
    assert free[0] < 1e-7 < 0.01 < oblique[0]  # the root of a rounding
    for physics in (FROZEN, Physics(rolling=SILICA.normal_stiffness)):
        assert bloch_modes(cell, SILICA, middle, physics)[0].min() > 0.01


# --- modes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lattice", "physics", "names"),
    [
        (HEXAGONAL, FULL, ("L", "TR", "RT")),
        (HEXAGONAL, Physics(shear=False, rotation=False), ("L", "TR")),
        (SQUARE, FULL, ("L", "TR", "RT")),
        (SQUARE, Physics(shear=False, rotation=False), ("L",)),
        (CHAIN, FULL, ("L", "RT")),
        (CHAIN, Physics(rolling=1.0), ("L", "TR", "RT")),
        (CHAIN, FROZEN, ("L", "TR")),
    ],
)
def test_a_wave_is_named_where_contacts_restore_it(lattice: Lattice, physics: Physics, names: tuple[str, ...]) -> None:
    contacts = unit_lattice(SILICA, lattice)
    assert restored(contacts, physics) == names
    lowest = bloch_modes(contacts, SILICA, [0.0, 0.5], physics)[0][0]
    assert lowest > 1e-3 if "TR" in names else lowest < 1e-9  # an exact 0, or the rounding of one


def zone(lattice: Lattice, sphere: Sphere) -> np.ndarray:
    """Return wave vectors all over the Brillouin zone, (P, 2), 1/R; of the hexagonal one a triangle Γ, M, K."""
    if lattice == HEXAGONAL:
        s, t = np.meshgrid(np.linspace(0, 1, 25), np.linspace(0, 1, 13))
        corner = 4 * pi / 3 / lattice_constant(sphere)
        return (corner * s[..., None] * np.stack([0.75 + 0.25 * t, sqrt(3) / 4 * (1 - t)], axis=-1)).reshape(-1, 2)
    side = np.linspace(0, pi, 31)
    first = side if lattice == SQUARE else np.zeros(1)
    return np.stack(np.meshgrid(first, side), axis=-1).reshape(-1, 2) / (sphere.lattice_constant / sphere.radius)


@pytest.mark.parametrize("sphere", [*SPHERES, replace(SILICA, poisson_ratio=-0.9)])
@pytest.mark.parametrize("physics", [FULL, FROZEN, Physics(shear=False, rotation=False), Physics(rolling=1000.0)])
@pytest.mark.parametrize("lattice", [CHAIN, SQUARE, HEXAGONAL])
def test_no_wave_of_the_zone_is_above_the_highest_frequency(lattice: Lattice, physics: Physics, sphere: Sphere) -> None:
    contacts = unit_lattice(sphere, lattice)
    top = bloch_modes(contacts, sphere, zone(lattice, sphere), physics)[0].max()
    # The corners of the zone, where the top is, are points of both; grids of a hexagonal zone miss another top by the
    # square of their spacing, 1/25 and 1/60 of the zone, but hold Γ
    exact = lattice != HEXAGONAL or physics == FULL
    assert top == pytest.approx(highest_frequency(contacts, sphere, physics), rel=1e-12 if exact else 3e-4)


@pytest.mark.parametrize("sphere", SPHERES)
@pytest.mark.parametrize("physics", [FULL, FROZEN])
@pytest.mark.parametrize("lattice", [CHAIN, SQUARE])
def test_no_wave_outruns_the_front_that_the_walls_are_placed_for(
    lattice: Lattice, physics: Physics, sphere: Sphere
) -> None:
    contacts, wavenumbers = unit_lattice(sphere, lattice), np.linspace(1e-3, pi, 400)
    for across in np.linspace(0, pi, 9) if lattice == SQUARE else [0.0]:
        k = np.column_stack([np.full_like(wavenumbers, across), wavenumbers]) * sphere.radius / sphere.lattice_constant
        frequencies = bloch_modes(contacts, sphere, k, physics)[0]
        # Sorted branches that cross leave their slopes in place
        assert np.abs(np.diff(frequencies, axis=0)).max() / np.diff(wavenumbers)[0] < 0.41 < FASTEST_ROWS_PER_TAU


def as_measured(kappa: float) -> Sphere:
    return replace(SILICA, factors=(1.0, kappa / SILICA.stiffness_ratio))


@pytest.mark.parametrize("name", ["tr_periodic", "fcc_transverse", "hcp_c_axis"])
@pytest.mark.parametrize("rotation", [True, False])
def test_stiff_shear_makes_no_wave_faster_than_its_front(name: str, rotation: bool) -> None:
    xi = np.linspace(0.01, 4.0, 150)
    for kappa in (1.2, 2.0, 5.0, 50.0):
        measured = {"contact.normal_stiffness": 500.0, "contact.shear_stiffness": 500.0 * kappa}
        scene = Scene.load(name).with_values({**measured, "effects.rotation": rotation})
        sphere, lattice, fastest = scene.sphere, scene.lattice, 0.0
        assert sphere.stiffness_ratio == pytest.approx(kappa, rel=1e-12)
        for degrees in (0.0, 30.0, 45.0, 90.0):
            k = np.array([lattice.vector(each, degrees).components for each in xi]) / lattice_constant(sphere)
            found = bloch_modes(unit_lattice(sphere, lattice), sphere, k, physics_of(scene))[0]
            fastest = max(fastest, float(np.abs(np.diff(found, axis=0) / np.diff(xi)[:, None]).max()))
        # The arm of the torque adds a share of η = 2.5e-4. Long waves of spheres that do not turn reach the bound
        assert fastest < lattice.fastest * (1 + 1e-3)
        assert rotation or fastest > 0.999 * lattice.fastest


@pytest.mark.parametrize("lattice", [CHAIN, SQUARE, HEXAGONAL])
def test_soft_shear_leaves_the_highest_frequency_to_waves_that_do_not_turn(lattice: Lattice) -> None:
    sphere = as_measured(0.01)
    contacts = unit_lattice(sphere, lattice)
    edge = lattice.vector(lattice.zone_edge(90.0)).components
    top = bloch_modes(contacts, sphere, np.array(edge) / lattice_constant(sphere), FULL)[0].max()
    assert top * (1 - 1e-12) <= highest_frequency(contacts, sphere) < 1.01 * top
    assert top > 3 * bloch_modes(contacts, sphere, np.zeros(2), FULL)[0].max()


def test_a_compressed_square_lattice_stands_by_its_shear_forces_and_a_chain_by_nothing() -> None:
    # The softest sphere under the largest overlap that a scene allows, which loses most of its transverse stiffness
    loose = replace(SILICA, poisson_ratio=0.5, work_of_adhesion=0.0, contact_force=1.0)
    pressed = replace(loose, contact_force=(0.1 * loose.radius) ** 1.5 * loose.normal_coefficient)
    assert pressed.overlap_ratio == pytest.approx(0.05, rel=1e-12)
    square, chain = unit_lattice(pressed, SQUARE), unit_lattice(pressed, CHAIN)
    assert bears_compression(square)
    bloch_modes(square, pressed, zone(SQUARE, pressed))  # raises for a mode that grows
    assert not bears_compression(square, shear=False)
    assert not bears_compression(chain)
    for contacts, lattice, physics in (
        (square, SQUARE, Physics(shear=False, rotation=False)),
        (chain, CHAIN, FULL),
        (chain, CHAIN, Physics(rolling=1.0)),
    ):
        with pytest.raises(CrystalError, match="not stable"):
            bloch_modes(contacts, pressed, zone(lattice, pressed), physics)


# --- scenes ----------------------------------------------------------------------------------------------------------


def test_a_scene_decides_its_size_by_its_lattice() -> None:
    chain = scene_of("chain", "L", packing__rows="auto", packing__ends="fixed", time__duration=60.0)
    assert (chain.shape.columns, chain.shape.rows, chain.shape.lattice) == (1, 87, CHAIN)
    assert scene_of("square", "TR").shape.columns == 3
    # 2π/5 fits a cell of five rows where rows do not alternate
    assert (
        scene_of("square", "TR", packing__rows="auto", packing__ends="auto", wave__wavenumber=2 * pi / 5).shape.rows
        == 5
    )
    odd = {"packing.rows": 9, "wave.wavenumber": 2 * pi / 9}
    with pytest.raises(SceneError, match=r"packing\.rows = 9: must be even"):
        scene_of("hexagonal", "TR").with_values(odd)
    assert scene_of("square", "TR").with_values(odd).vector.components == (0.0, 2 * pi / 9)


def a_wave_of(lattice: str) -> str:
    """Return the name of a wave that a lattice has, the longitudinal one where it has names."""
    return "2" if PLANE_LATTICES[lattice].column_period > 1 else "L"


def test_a_scene_knows_its_wave_number_by_the_frequency_in_its_lattice() -> None:
    for lattice in PLANE_LATTICES.values():
        declared = scene_of(lattice.name, a_wave_of(lattice.name))
        hertz = mode_of(declared).frequency / (2 * pi * declared.sphere.time_scale)
        found = declared.with_values({"wave.frequency": hertz}).wave.wavenumber
        assert found == pytest.approx(pi / 4, rel=1e-9)  # a bisected zero


def test_a_wave_that_shears_no_contact_keeps_the_shear_that_its_lattice_needs() -> None:
    plain = scene_of("square", "L")
    assert not prepare(plain).on["shear"]
    assert prepare(plain.with_values({"packing.contact_force": 1e-7})).on["shear"]
    assert prepare(plain.with_values({"disorder.vacancies": 0.1, "packing.columns": 4})).on["shear"]
    assert prepare(plain.with_values({"envelope.width": 5.0, "packing.columns": 60})).on["shear"]


def test_spheres_of_other_density_and_empty_places_leave_a_lattice_at_rest() -> None:
    for lattice in (CHAIN, SQUARE):
        scene = scene_of(lattice.name, "L", packing__rows=20, packing__columns=1 if lattice == CHAIN else 4)
        crystal = crystal_of(scene.with_values({"disorder.density": 0.1, "disorder.vacancies": 0.1}))
        assert crystal.equilibrium is not None
        assert crystal.equilibrium.steps == 0
        assert not crystal.equilibrium.displacement.any()
        assert crystal.atoms.pbc[0] == (lattice == SQUARE)


@pytest.mark.parametrize("envelope", [{}, {"envelope.length": 6.0}])
@pytest.mark.parametrize("lattice", PLANE_LATTICES)
def test_the_wave_is_at_the_same_places_where_others_are_empty(lattice: str, envelope: dict[str, float]) -> None:
    shape = {"packing.rows": 40, "packing.columns": 1 if lattice == "chain" else 4}
    scene = scene_of(lattice, a_wave_of(lattice)).with_values(shape | envelope)
    empty = [[39, column] for column in range(shape["packing.columns"])] + [[7, 0]]  # the whole last row, and one more
    broken = scene.with_values({"inclusion": [{"spheres": empty, "vacancy": True}]})
    crystal, wave = crystal_of(broken).atoms, bloch_wave(scene)
    there = crystal.arrays["row"] * shape["packing.columns"] + crystal.arrays["column"]
    assert len(there) == scene.shape.spheres - len(empty)
    assert there[centre(crystal)] == centre(packed(scene.sphere, scene.shape))
    whole = initial_fields(scene, packed(scene.sphere, scene.shape), wave)
    found = initial_fields(broken, crystal, wave)
    # Sums of some ten terms of order 1/10
    np.testing.assert_allclose(found.displacement, whole.displacement[there], rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.velocity, whole.velocity[there], rtol=0, atol=1e-13)
    assert "v_spread" not in build(broken).input_text  # no row stays straight there, and that of a chain is a sphere


def test_a_chain_of_unequal_spheres_is_as_long_as_its_contacts_and_stays_straight() -> None:
    scene = scene_of("chain", "L", packing__rows=40, disorder__radius=0.3 * SILICA.overlap_ratio)
    rest = crystal_of(scene).equilibrium
    assert rest is not None
    assert len(rest.contacts) == 40
    assert not rest.displacement[:, 0].any()
    # At rest: every contact has the overlap that balances its adhesion, to the residual of 1e-10
    np.testing.assert_allclose(rest.contacts.contact_force / SILICA.holding_force, 0, atol=1e-9)


def test_the_contacts_of_a_scene_are_those_of_its_lattice() -> None:
    assert [len(unit_contacts(scene_of(name, a_wave_of(name)))) for name in PLANE_LATTICES] == [3, 2, 1, 3]
