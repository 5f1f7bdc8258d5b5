"""Packings: geometry, arrays, and what ASE makes of them."""

import io

import ase.io
import numpy as np
import pytest
from ase.visualize.plot import plot_atoms
from matplotlib.figure import Figure

from granular_lmp.crystal.contacts import find_contacts
from granular_lmp.crystal.lattices import CHAIN, HONEYCOMB, SQUARE, Shape, centre, lattice_constant, packed
from tests.crystal.test_sphere import SILICA

pytestmark = pytest.mark.rounding  # matrices of an eigenvalue problem, sines and cosines

SPACING = lattice_constant(SILICA)
SHAPES = [
    Shape(5, 3, "fixed"),
    Shape(201, 3, "fixed"),
    Shape(7, 8, "fixed"),
    Shape(4, 3, "periodic"),
    Shape(10, 5, "periodic"),
]
OTHERS = [
    Shape(9, 1, "fixed", CHAIN),
    Shape(5, 1, "periodic", CHAIN),
    Shape(7, 4, "fixed", SQUARE),
    Shape(5, 3, "periodic", SQUARE),
    Shape(7, 6, "fixed", HONEYCOMB),
    Shape(6, 4, "periodic", HONEYCOMB),
]
NEIGHBOURS = {"hexagonal": 6, "square": 4, "honeycomb": 3, "chain": 2}
of_each = pytest.mark.parametrize("shape", [*SHAPES, *OTHERS], ids=lambda each: f"{each.lattice.name} {each.rows}")


@of_each
def test_every_free_sphere_touches_its_neighbours_at_the_equilibrium_distance_and_no_image(shape: Shape) -> None:
    packing = packed(SILICA, shape)
    contacts = find_contacts(packing, [SILICA], 0.0)
    assert set(contacts.per_sphere[~packing.arrays["fixed"]]) == {NEIGHBOURS[shape.lattice.name]}
    # The coordinates reach 174 R, whose last digit is 3e-14 R
    np.testing.assert_allclose(contacts.length / SILICA.radius, SPACING, atol=1e-13)


@of_each
def test_no_sphere_lies_on_or_beyond_a_face_of_the_cell(shape: Shape) -> None:
    packing = packed(SILICA, shape)
    inside = (packing.positions - packing.get_celldisp().ravel()) / packing.cell.lengths()
    assert inside.min() > 1e-3
    assert inside.max() < 1 - 1e-3


@of_each
def test_arrays_number_rows_and_columns_and_hold_the_ends(shape: Shape) -> None:
    packing = packed(SILICA, shape)
    assert len(packing) == shape.rows * shape.columns
    assert list(packing.pbc) == [shape.lattice != CHAIN, shape.ends == "periodic", False]
    held = np.unique(packing.arrays["row"][packing.arrays["fixed"]]).tolist()
    assert held == ([] if shape.ends == "periodic" else [0, shape.rows - 1])
    assert (packing.arrays["radius"] == 1).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_rows_go_along_y_and_the_centre_sphere_is_next_to_the_origin(shape: Shape) -> None:
    packing = packed(SILICA, shape)
    height = packing.positions[:, 1] / (np.sqrt(3) / 2 * SPACING)
    np.testing.assert_allclose(height, packing.arrays["row"] - shape.centre_row, atol=1e-12)
    x, y, z = packing.positions[centre(packing)]
    assert abs(x) < SPACING
    assert y == z == 0


def test_ase_draws_and_writes_the_packing() -> None:
    packing = packed(SILICA, Shape(5, 3, "fixed"))
    axes = Figure().subplots()
    plot_atoms(packing, axes, radii=packing.arrays["radius"])
    assert len(axes.patches) >= len(packing)
    text = io.StringIO()
    ase.io.write(text, packing, format="extxyz")
    text.seek(0)
    again = ase.io.read(text, format="extxyz")
    np.testing.assert_array_equal(again.arrays["row"], packing.arrays["row"])
