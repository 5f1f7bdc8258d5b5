"""A layer on a substrate in closed form, beside the crystal that has its exact geometry."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cases.layer.monolayer import Layer
from granular_analysis.theory.crystal import Crystal, Wall
from granular_analysis.theory.lattices import LATTICES
from granular_analysis.theory.network import Material, mixed
from tests.manual import Measure, Mutant, verifies

SILICA = Material(73e3, 0.17, 63.0)  # MPa, mJ/m²: lengths in nm, masses in ag
R, DENSITY = 500.0, 2.2e-3
LAYERS = ["square", "hexagonal"]
LINES = [(0.0, 1.0), (1.0, 0.0)]
BONDS = {"square": [[1, 0], [0, 1]], "hexagonal": [[1, 0], [0.5, np.sqrt(0.75)], [-0.5, np.sqrt(0.75)]]}


def overlap(one: Material, other: Material, radius: float) -> float:
    """Return the overlap at rest of a sphere with another (radius R) or a wall (infinite)."""
    A, _, F, _ = mixed([one, other], (np.array([0]), np.array([1])), (np.array([R]), np.array([radius])))
    return float((F / A)[0] ** (2 / 3))


def on_substrate(
    name: str, sphere: Material = SILICA, substrate: Material = SILICA, depth: float | None = None, **options: Any
) -> tuple[Crystal, Layer]:
    """Return a layer whose spheres overlap by a depth, at rest by default, and what its formulas take."""
    depth = overlap(sphere, sphere, R) if depth is None else depth
    length, sunk = 2 * R - depth, overlap(sphere, substrate, np.inf)
    wall = Wall((0.0, 0.0, sunk - R), (0.0, 0.0, -1.0), substrate)
    vectors, place = length * LATTICES[name, ""].vectors, np.zeros((1, 3))
    crystal = Crystal.of(vectors, place, R, DENSITY, [sphere], walls=[wall], **options)
    law = crystal.bonds.law
    stiffness = law.stiffness[0], law.shear[0], law.stiffness[-1], law.shear[-1]
    return crystal, Layer(length * np.array(BONDS[name]), crystal.mass[0, 0], *map(float, stiffness))


def departures(name: str, adhesion: float) -> tuple[float, np.ndarray]:
    """Return η, and by which share the closed forms miss the frequencies of the crystal."""
    crystal, layer = on_substrate(name, *2 * [replace(SILICA, work_of_adhesion=adhesion)])
    length = np.linalg.norm(crystal.vectors[0])
    k = np.concatenate([np.multiply.outer(np.linspace(0, 3, 13) / length, line) for line in LINES])
    found = np.sort(np.concatenate(layer.frequencies(k), axis=-1), axis=-1)
    return float(1 - length / (2 * R)), found / crystal.modes(k).frequencies - 1


@pytest.mark.parametrize("name", LAYERS)
def test_six_branches_miss_those_of_the_crystal_by_half_of_the_overlap_ratio(name: str) -> None:
    (thin, strong), (thinner, weak) = (departures(name, adhesion) for adhesion in (63.0, 2.0))
    assert np.abs(strong).max() == pytest.approx(0.5 * thin, rel=1e-3)
    # What is left is of the first order in η: half of it in torsion, and the same share of it in every other branch
    np.testing.assert_allclose(strong / thin, weak / thinner, rtol=0, atol=0.01)


@pytest.mark.parametrize("name", LAYERS)
@verifies(
    "Six resonances of a square and a hexagonal layer on a substrate at k = 0",
    reference="other code: the lattice dynamics of the exact geometry",
    tolerance=0.00025,
    reason="closed forms leave out η/2, η = 2.5e-4 of two spheres",
    mutant=Mutant(
        "analysis/cases/layer/monolayer.py",
        "total = 7 * substrate + 5 * neighbours * shear",
        "total = 7 * substrate + 4.98 * neighbours * shear",
    ),
)
def test_resonances_are_those_of_the_crystal_at_rest(name: str, measured: Measure) -> None:
    crystal, layer = on_substrate(name)
    vertical, (lower, upper), torsion = layer.resonances()
    found = crystal.modes(np.zeros(3)).frequencies
    known = np.sort([vertical, lower, lower, upper, upper, torsion])
    measured(np.abs(known / found - 1).max())
    # No contact of two spheres enters: rounding of the overlap is left
    assert np.abs(found / vertical - 1).min() < 1e-11
    sagittal, horizontal = layer.frequencies([0.0, 0.0])
    np.testing.assert_allclose(sagittal, sorted([vertical, lower, upper]), rtol=1e-12)
    np.testing.assert_allclose(horizontal, sorted([lower, upper, torsion]), rtol=1e-12)


def test_numbers_of_silica_in_megahertz() -> None:
    for name, known in (("hexagonal", [144.01, 120.84, 478.5, 596.2]), ("square", [144.01, 114.06, 413.9, 486.8])):
        _, layer = on_substrate(name)
        vertical, rocking, torsion = layer.resonances()
        # Measured elsewhere in LAMMPS's geometry, η/2 lower
        np.testing.assert_allclose(np.array([vertical, *rocking, torsion]) / (2e-3 * np.pi), known, rtol=2e-4)


def test_without_contacts_between_spheres_rocking_knows_the_substrate_alone() -> None:
    _, layer = on_substrate("hexagonal")
    free = layer._replace(shear=1e-12 * layer.shear).resonances()
    ratio = layer.substrate_shear / layer.substrate_normal
    assert free.rocking[1] / free.vertical == pytest.approx(np.sqrt(3.5 * ratio), rel=1e-9)
    assert free.rocking[0] < 1e-5 * free.vertical


# --- buckling ---------------------------------------------------------------------------------------------------------

SOFT = Material(20.0, 0.3, 63.0)  # a substrate so soft that a load which it can hold is a small part of a sphere


def zone(name: str) -> np.ndarray:
    """Return wave vectors along both mirror lines, times the distance of spheres."""
    return np.concatenate([np.multiply.outer(np.linspace(0.1, 4.2, 83), line) for line in LINES])


# Without shear a square layer also gives way within its plane, at any load
@pytest.mark.parametrize(("name", "shear"), [("square", True), ("hexagonal", True), ("hexagonal", False)])
def test_a_compressed_layer_buckles_at_its_load(name: str, shear: bool) -> None:
    def left(depth: float) -> tuple[float, float]:
        """Return what the load lacks to that of buckling, over it, and the lowest squared frequency."""
        crystal, layer = on_substrate(name, substrate=SOFT, depth=depth, shear=shear)
        k = zone(name) / np.linalg.norm(crystal.vectors[0])
        lowest = np.linalg.eigvalsh(crystal.stiffness(k))[..., 0].min()
        return float(1 - crystal.bonds.law.push[0] / layer.buckling_load(k).min()), float(lowest)

    low, high = overlap(SILICA, SILICA, R), 0.02 * R
    for _ in range(16):  # to 1e-4 of the load
        middle = (low + high) / 2
        low, high = (middle, high) if left(middle)[1] > 0 else (low, middle)
    # The formula leaves out η/2 of torques, f/ℓ beside G_N, and that loaded contacts turn
    assert abs(left(high)[0]) < 3 * high / (2 * R)
    assert left(0.99 * high)[0] > 0 > left(1.01 * high)[0]


@pytest.mark.parametrize(("name", "share"), [("square", 8), ("hexagonal", 9)])
def test_without_shear_the_substrate_alone_holds_a_layer(name: str, share: int) -> None:
    _, layer = on_substrate(name)
    bare = layer._replace(shear=0.0, substrate_shear=1e-9 * layer.substrate_shear)
    length = np.linalg.norm(layer.bonds[0])
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-4.2, 4.2, 85)]), axis=-1) / length
    lifted = 4 * np.sum(np.sin(0.5 * grid @ layer.bonds.T) ** 2, axis=-1)
    least = length * layer.substrate_normal / lifted.max()
    assert least == pytest.approx(length * layer.substrate_normal / share, rel=2e-3)
    edge = np.array([np.pi, np.pi]) if name == "square" else np.array([4 * np.pi / 3, 0.0])
    assert bare.buckling_load(edge / length) == pytest.approx(length * layer.substrate_normal / share, rel=1e-9)
