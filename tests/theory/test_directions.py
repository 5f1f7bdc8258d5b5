"""The general-direction theory against the paper's direction, the symmetry of the lattice, and the exact force laws."""

import ast
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from granular_analysis import second_harmonic
from granular_analysis.second_harmonic import SOLID_SPHERE
from granular_analysis.theory import bloch, bonds, crystal, lattice
from granular_analysis.theory.bloch import BONDS
from granular_analysis.theory.contact import Contact
from tests.conftest import latin
from tests.polarisations import (
    bloch_matrix,
    mean_rotation,
    modes,
    second_harmonic_amplitude,
)
from tests.polarisations import (
    second_order_at as second_order,
)

SILICA = 0.17  # Poisson's ratio of the paper's spheres
OBLIQUE = {"19 degrees": (1.10, 0.38), "66 degrees": (0.55, 1.25)}  # off both mirror lines (multiples of 30 degrees)


def along_y(xi: ArrayLike) -> NDArray[np.float64]:
    """Return the wave vectors (..., 2) of the paper's ξ (...), per row of spacing √3/2."""
    return np.multiply.outer(xi, [0.0, 2.0 / np.sqrt(3.0)])


def rotation(angle: float) -> NDArray[np.float64]:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


# Sums of some twenty numbers of order one, and the modes of a matrix of norm 4: 1e-16 of each number, in whatever order
# they are summed, and some ten times that for modes that lie close. A wrong sign or index makes 1e-3 or more.
ROUNDING = 1e-13


def amplified_rounding(k: ArrayLike, branch: int) -> float:
    """Rounding of the second harmonic of a mode: that of its drive, of order one, over the least 4ω² − ω_i(2k)²."""
    frequencies, doubled = (modes(j * np.asarray(k), Contact(SILICA))[0] for j in (1.0, 2.0))
    return float(ROUNDING / min(1.0, np.min(np.abs(4.0 * frequencies[branch] ** 2 - doubled**2))))


def largest_error(measured: NDArray, expected: NDArray) -> float:
    return float(np.max(np.abs(np.asarray(measured) - expected)))


# ---- two derivations -----------------------------------------------------------------------


def imported_from(module, other: str) -> set[str]:
    """Names that a module takes from another of `granular_analysis`."""
    tree, name = ast.parse(Path(module.__file__).read_text(encoding="utf-8")), f"granular_analysis.{other}"
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module == name]
    return {alias.name for node in nodes for alias in node.names}


def test_neither_derivation_imports_the_other():
    # The closed form gives only what a mode is called and consists of.
    assert imported_from(bloch, "second_harmonic") == {"Mode", "ModeName"}
    for module in (bonds, crystal):
        assert not imported_from(module, "second_harmonic")
    for other in ("theory.bonds", "theory.crystal", "theory.second_order", "theory.bloch"):
        assert not imported_from(second_harmonic, other)
        assert not imported_from(lattice, other)


# ---- the lattice's symmetry ----------------------------------------------------------------------


@pytest.mark.parametrize("k", OBLIQUE.values(), ids=OBLIQUE.keys())
def test_bloch_matrix_is_hermitian_and_periodic_and_has_the_modes(k):
    matrix = bloch_matrix(k, Contact(SILICA))
    assert largest_error(matrix, matrix.conj().T) < ROUNDING
    reciprocal = 2.0 * np.pi * np.array([1.0, -1.0 / np.sqrt(3.0)])
    # φ is sampled at the sphere's centre: D itself, not only its spectrum, has the period of the reciprocal lattice.
    assert largest_error(bloch_matrix(k + reciprocal, Contact(SILICA)), matrix) < ROUNDING
    frequencies, shapes = modes(k, Contact(SILICA))
    residual = matrix @ shapes.T - shapes.T * frequencies**2 * np.array([1, 1, SOLID_SPHERE])[:, None]
    assert largest_error(residual, np.zeros(3)) < ROUNDING
    assert largest_error(np.linalg.norm(shapes, axis=-1), np.ones(3)) < ROUNDING


@pytest.mark.parametrize(
    ("sixths", "branch"),
    latin([1, 2, 3, 4, 5], [0, 1, 2]),
)
def test_rotation_by_60_degrees_rotates_the_second_harmonic(branch, sixths):
    turn = rotation(sixths * np.pi / 3)
    for k in OBLIQUE.values():
        assert largest_error(modes(turn @ k, Contact(SILICA))[0], modes(k, Contact(SILICA))[0]) < ROUNDING
        before, after = (second_harmonic_amplitude(q, branch, Contact(SILICA)) for q in (k, turn @ k))
        assert largest_error(after, np.append(turn @ before[:2], before[2])) < amplified_rounding(k, branch)
        assert (
            abs(mean_rotation(turn @ k, branch, Contact(SILICA)) - mean_rotation(k, branch, Contact(SILICA))) < ROUNDING
        )


@pytest.mark.parametrize("branch", [0, 1, 2])
@pytest.mark.parametrize("axis", [0.0, np.pi / 6, np.pi / 2])
def test_a_mirror_turns_rotations_round(branch, axis):
    mirror = rotation(axis) @ np.diag([1.0, -1.0]) @ rotation(-axis)
    for k in OBLIQUE.values():
        assert largest_error(modes(mirror @ k, Contact(SILICA))[0], modes(k, Contact(SILICA))[0]) < ROUNDING
        before, after = (second_harmonic_amplitude(q, branch, Contact(SILICA)) for q in (k, mirror @ k))
        assert largest_error(after, np.append(mirror @ before[:2], -before[2])) < amplified_rounding(k, branch)
        assert (
            abs(mean_rotation(mirror @ k, branch, Contact(SILICA)) + mean_rotation(k, branch, Contact(SILICA)))
            < ROUNDING
        )


@pytest.mark.rounding
@pytest.mark.parametrize("line", [0.0, np.pi / 6])
def test_on_a_mirror_line_the_second_harmonic_is_longitudinal_and_nothing_turns(line):
    along = np.array([np.cos(line), np.sin(line)])
    for length in np.linspace(0.2, 3.4, 9):
        for branch in range(3):
            amplitude = second_harmonic_amplitude(length * along, branch, Contact(SILICA))
            transverse = amplitude[1] * along[0] - amplitude[0] * along[1]
            tolerance = amplified_rounding(length * along, branch)
            assert max(abs(transverse), abs(amplitude[2])) < tolerance < 1e-3 * max(1e-3, np.linalg.norm(amplitude))
            assert abs(mean_rotation(length * along, branch, Contact(SILICA))) < ROUNDING


def test_long_waves_have_the_isotropic_speeds():
    # The hexagonal symmetry makes them so; Ω_L = sin(ξ/2) and ξ = (√3/2) k_y give c_L = √3/4.
    angles = np.linspace(0.0, np.pi, 13)
    k = 1e-3 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    frequencies, _ = modes(k, Contact(SILICA))
    assert largest_error(frequencies[:, 1] / 1e-3, np.sqrt(3.0) / 4.0) < 1e-6  # dispersion: |k|²
    assert np.ptp(frequencies[:, 0]) < 1e-9


# ---- the exact force laws ------------------------------------------------------------------------


def test_the_response_starts_from_rest():
    k = OBLIQUE["66 degrees"]
    field = second_order(k, 0, 0.1, [0.0, 1e-4], Contact(SILICA))
    assert largest_error(field[0], np.zeros(3)) == 0.0
    assert largest_error(field[1], np.zeros(3)) < 1e-8  # τ²/2 times accelerations of order one


def test_a_uniform_rotation_has_no_second_harmonic():
    # 2k = 0, where two of the target frequencies are exactly zero.
    field = second_order((0.0, 0.0), 2, 0.1, np.linspace(0, 100, 50), Contact(SILICA))
    assert largest_error(field, np.zeros(3)) < 1e-15


def test_waves_of_the_zone_edge_stay_finite():
    # 2k is a reciprocal vector at M: the lattice as a whole could drift, and is not pushed.
    field = second_order(along_y(np.pi), 1, 0.1, np.linspace(0, 100, 50), Contact(SILICA))
    assert largest_error(field, np.zeros(3)) < 1e-12


# ---- the paper's variables, and LAMMPS's contact geometry -----------------------------------------


def test_a_phase_is_a_place():
    k, tau = np.array(OBLIQUE["19 degrees"]), np.linspace(0.0, 20.0, 21)
    by_site, by_phase = (
        second_order(k, 1, 0.1, tau, Contact(SILICA, overlap_ratio=0.01), **where)
        for where in ({"site": (3, -2)}, {"phase": float(k @ (3 * BONDS[0] - 2 * BONDS[1]))})
    )
    assert largest_error(by_site, by_phase) < 1e-14


def test_modes_of_any_direction_are_named_and_signed_as_they_are_said_to_be():
    for direction in np.arange(0.0, 360.0, 13.0):
        found = {
            name: bloch.mode(name, 1.3, direction, Contact(SILICA, overlap_ratio=0.01)) for name in ("L", "TR", "RT")
        }
        assert max(found.values(), key=lambda mode: abs(mode.p)).name == "L"
        assert found["TR"].frequency < found["RT"].frequency
        for mode in found.values():
            assert max(mode.p, mode.q, key=abs) > 0
            assert np.hypot(np.hypot(mode.p, mode.q), mode.f) == pytest.approx(1.0, rel=1e-14)


# ---- the helpers and what is refused -------------------------------------------------------------


@pytest.mark.parametrize("xi", [0.802, 1.475])
def test_the_paper_s_printed_prefactor_is_seen_as_wrong(xi):
    amplitude = second_harmonic_amplitude(along_y(xi), 0, Contact(SILICA))[1]
    ratios = second_harmonic.ratios(SILICA)
    right = second_harmonic.generated_amplitude(second_harmonic.mode("TR", xi, ratios), ratios)
    assert abs(amplitude - 4 / 3 * 1j * right) > 1e-2


def test_arrays_of_wave_vectors_give_what_single_ones_give():
    k = np.array(list(OBLIQUE.values()))
    together = second_harmonic_amplitude(k, [0, 2], Contact(SILICA))
    apart = np.array(
        [second_harmonic_amplitude(k[0], 0, Contact(SILICA)), second_harmonic_amplitude(k[1], 2, Contact(SILICA))]
    )
    assert largest_error(together, apart) < 1e-14
