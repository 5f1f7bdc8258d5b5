"""The mirror z → −z of crystals in space: which have it, and modes of one frequency that it tells apart."""

import numpy as np
import pytest

from granular_analysis.theory.crystal import Crystal, Wall
from granular_analysis.theory.lattices import LATTICES
from granular_analysis.theory.network import Material
from granular_analysis.theory.phase_matching import matches
from granular_analysis.theory.second_order import wave

SILICA = Material(73e3, 0.17, 63.0)  # MPa, mJ/m²: lengths in nm, masses in ag
R, DEPTH = 500.0, 0.2498514361612
APART = 2 * R - DEPTH


def crystal(name: str, orientation: str) -> Crystal:
    lattice = LATTICES[name, orientation]
    return Crystal.of(APART * lattice.vectors, APART * lattice.basis, R, 2.2e-3, [SILICA])


LEVEL = [("fcc", "[001]"), ("fcc", "[111]"), ("hcp", "c"), ("cubic", "[001]")]


@pytest.mark.parametrize("name", LEVEL, ids=" ".join)
def test_modes_along_y_are_even_or_odd_whatever_their_frequencies(name: tuple[str, str]) -> None:
    solid, k = crystal(*name), np.array([0.0, 0.9 / APART, 0.0])
    modes = solid.modes(k)
    moved = solid.moving(modes.shapes)
    images = moved @ solid.symmetry.action.T
    np.testing.assert_allclose(images, solid.parity(modes.shapes, k)[:, None] * moved, atol=1e-10)
    assert np.all(np.diff(modes.frequencies) > -1e-9 * modes.frequencies[-1])
    # Half of the modes move within the mirror and turn about its normal
    assert sorted(solid.parity(modes.shapes, k)) == [-1] * (3 * len(solid)) + [1] * (3 * len(solid))
    answers = np.einsum("jbc,lbc->jl", modes.duals, modes.shapes)
    np.testing.assert_allclose(answers, np.eye(len(answers)), atol=1e-10)


def test_a_shear_wave_in_the_plane_needs_no_polarisation() -> None:
    solid, k = crystal("cubic", "[001]"), np.array([0.0, 0.9 / APART, 0.0])
    even, odd = wave(solid, k, 0), wave(solid, k, 1)
    assert even.frequency == pytest.approx(odd.frequency, rel=1e-12)
    assert np.abs(even.shape[0, [2, 3, 4]]).max() < 1e-12
    assert np.abs(odd.shape[0, [0, 1, 5]]).max() < 1e-12
    with pytest.raises(ValueError, match="give `along`, the polarisation"):
        wave(solid, [0.0, 0.0, 0.9 / APART], 0)


def test_a_layer_on_a_wall_is_its_own_image_across_x_alone() -> None:
    lattice = LATTICES["hexagonal", ""]
    vectors = APART * lattice.vectors
    flat = Crystal.of(vectors[:, :2], [[0.0, 0.0]], R, 2.2e-3, [SILICA])
    assert flat.symmetry is None
    alone = Crystal.of(vectors, [[0.0, 0.0, 0.0]], R, 2.2e-3, [SILICA])
    assert list(alone.symmetry.normal) == [0, 0, 1]
    deep = 2 ** (1 / 3) * DEPTH  # at which nothing is left of the force of the wall
    wall = Wall((0.0, 0.0, deep - R), (0.0, 0.0, -1.0), SILICA)
    layer = Crystal.of(vectors, [[0.0, 0.0, 0.0]], R, 2.2e-3, [SILICA], walls=[wall])
    assert layer.mirror([0.0, 0.0, 1.0]) is None
    assert list(layer.symmetry.normal) == [1, 0, 0]
    # Sagittal modes are even under it: they move along y and z, and turn about x
    k = np.array([0.0, 0.9 / APART, 0.0])
    even = layer.parity(layer.modes(k).shapes, k) > 0
    assert np.abs(layer.modes(k).shapes[even][:, 0, [0, 4, 5]]).max() < 1e-9
    assert even.sum() == 3
    assert np.all(layer.parity(layer.modes([0.3 / APART, 0.5 / APART]).shapes, [0.3 / APART, 0.5 / APART]) == 0)


KNOWN = {  # rad per row of silica, and branches from 0
    ("fcc", "[001]"): {(0, 4): 1.541596, (1, 4): 1.541596},
    ("fcc", "[111]"): {(0, 2): 1.471436, (1, 2): 1.471436, (0, 3): 1.621280, (1, 3): 1.621280},
    ("cubic", "[001]"): {(0, 2): 1.454775, (1, 2): 1.454775},
}


@pytest.mark.parametrize("name", KNOWN, ids=" ".join)
def test_resonances_in_space_are_all_found_once(name: tuple[str, str]) -> None:
    found = [each for each in matches(crystal(*name), (0, 1, 0)) if each.rate > 0]
    row = APART * LATTICES[name].row
    assert len(found) == len(KNOWN[name])
    for each in found:
        assert each.wavenumber * row == pytest.approx(KNOWN[name][each.branch, each.target], abs=1e-6)


def test_close_packed_layers_ab_answer_to_a_wave_across_them_as_abc_do() -> None:
    row = APART * LATTICES["hcp", "c"].row
    near = matches(crystal("hcp", "c"), (0, 1, 0))
    others = [each.wavenumber * row for each in near if each.rate > 0]
    assert any(xi == pytest.approx(1.471436, abs=1e-6) for xi in others)
