"""Lattices in space, by what every textbook says of them: neighbours, volumes, rows, layers."""

import numpy as np
import pytest

from granular_analysis.theory.crystal import find_contacts
from granular_analysis.theory.lattices import LATTICES, Lattice

TOUCH = 0.5 + 1e-6  # radius at which neighbours at a distance of 1 touch, and no others


def neighbours(vectors: np.ndarray, place: np.ndarray) -> np.ndarray:
    first, second, _ = find_contacts(vectors, place, np.full(len(place), TOUCH))
    return np.bincount(np.concatenate([first, second]), minlength=len(place))


SPHERES = {"chain": (2, 1.0), "square": (4, 1.0), "hexagonal": (6, np.sqrt(0.75)), "honeycomb": (3, np.sqrt(27) / 4)}
SPHERES |= {"cubic": (6, 1.0), "fcc": (12, np.sqrt(0.5)), "hcp": (12, np.sqrt(0.5))}


@pytest.mark.parametrize("name", LATTICES, ids=" ".join)
def test_each_sphere_has_the_neighbours_and_the_room_of_its_lattice(name: tuple[str, str]) -> None:
    lattice, (count, room) = LATTICES[name], SPHERES[name[0]]
    assert set(neighbours(lattice.vectors, lattice.basis)) == {count}
    volume = np.sqrt(np.linalg.det(lattice.vectors @ lattice.vectors.T))
    assert volume / len(lattice.basis) == pytest.approx(room, rel=1e-12)


def of_rows(lattice: Lattice) -> bool:
    try:
        lattice.rows(lattice.repeats)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("name", [name for name, each in LATTICES.items() if of_rows(each)], ids=" ".join)
def test_patterns_of_rows_are_the_same_crystal(name: tuple[str, str]) -> None:
    lattice = LATTICES[name]
    for period in (lattice.repeats, 2 * lattice.repeats):
        vectors, place, rows = lattice.rows(period)
        assert set(neighbours(vectors, place)) == {SPHERES[name[0]][0]}
        assert set(rows) == set(range(period))


def test_layers_that_have_other_rows_have_no_pattern() -> None:
    without = {name for name, each in LATTICES.items() if not of_rows(each)}
    assert without == {("fcc", "[110]"), ("fcc", "[11-2]"), ("hcp", "[1-100]")}


def test_rows_are_the_planes_that_their_orientation_names() -> None:
    repeats = {name: each.repeats for name, each in LATTICES.items()}
    assert repeats["fcc", "[001]"] == 2
    assert repeats["fcc", "[111]"] == 3
    assert repeats["hcp", "c"] == 2
    # Along y a sphere touches the next row by 4 neighbours in square layers, by 3 in close-packed ones
    for name, count in ((("fcc", "[001]"), 4), (("fcc", "[111]"), 3), (("hcp", "c"), 3), (("cubic", "[001]"), 1)):
        lattice = LATTICES[name]
        first, second, steps = find_contacts(lattice.vectors, lattice.basis, np.full(len(lattice.basis), TOUCH))
        apart = lattice.basis[second] + steps @ lattice.vectors - lattice.basis[first]
        assert np.count_nonzero(np.abs(apart[:, 1]) > 0.1) == count * len(lattice.basis)


@pytest.mark.parametrize(
    ("name", "inside", "between"),
    [(("fcc", "[110]"), 4, 4), (("fcc", "[11-2]"), 6, 3), (("hcp", "[1-100]"), 6, 3), (("cubic", "[001]"), 4, 1)],
    ids=str,
)
def test_films_are_stacks_of_layers(name: tuple[str, str], inside: int, between: int) -> None:
    vectors, place = LATTICES[name].film(5)
    assert vectors.shape == (2, 3)
    assert np.ptp(vectors[:, 2]) == 0
    assert list(neighbours(vectors, place)) == [inside + between, *3 * [inside + 2 * between], inside + between]
    assert np.allclose(np.diff(place[:, 2]), place[1, 2])
