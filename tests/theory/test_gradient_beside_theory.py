"""The gradient of a run beside the exact derivatives that `design` and `fit` take from theory."""

from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.norms import slope
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.network_state import start
from granular_analysis.theory.variation import Spot, Varied

jax = pytest.importorskip("jax")
gradients = pytest.importorskip("granular_analysis.theory.network_gradient", reason="needs JAX")
factors = pytest.importorskip("granular_analysis.theory.network_factors", reason="needs JAX")

OVERLAP = 1e-2
SPACING = 2 - OVERLAP
BASIS = SPACING * np.array([[0, 0], [0.5, np.sqrt(3) / 2]])
CELL = SPACING * np.array([[1, 0], [0, np.sqrt(3)]])
COLUMNS, PAIRS_OF_ROWS = 4, 3
WAVEVECTOR = 2 * np.pi * np.array([1 / (COLUMNS * CELL[0, 0]), 1 / (PAIRS_OF_ROWS * CELL[1, 1]), 0])
RATIO = 0.2
VALUES = np.array([1.0, 1.5, 1.0, RATIO])  # densities of both rows of a cell, E and ν of all spheres
STEP, STEPS = 0.25, 120


def spot(values: np.ndarray) -> Spot:
    one, other, modulus, ratio = values
    crystal = Crystal.of(CELL, BASIS, np.ones(2), np.array([one, other]), [Material(modulus, ratio)])
    return Spot(crystal, WAVEVECTOR + 0 * one, OVERLAP)


def test_derivatives_of_a_run_approach_those_of_theory_as_the_square_of_the_amplitude() -> None:
    """A mode that is let go has the amplitude cos(2 N arcsin(Ωh/2)) after N steps; Ω depends on density, E and ν."""
    branch = 3
    theory = Varied(spot, VALUES, 1.0)
    own, half = theory.here.shapes[branch], theory.here.frequencies[branch] * STEP / 2
    rate = -np.sin(2 * STEPS * np.arcsin(half)) * STEPS * STEP / np.sqrt(1 - half**2)
    exact = rate * theory.here.rates[:4, branch]

    cells = np.array([[column, pair] for pair in range(PAIRS_OF_ROWS) for column in range(COLUMNS)])
    places = (BASIS + (cells @ CELL)[:, None]).reshape(-1, 2)
    row = np.tile([0, 1], len(cells))
    size = tuple(CELL.diagonal() * [COLUMNS, PAIRS_OF_ROWS])
    network = Network(places, np.ones(len(places)), VALUES[row], (Material(1.0, RATIO),), cell=size)
    wave = np.real(own[row] * np.exp(1j * places @ WAVEVECTOR[:2])[:, None])[:, [0, 1, 5]].T
    inertia = theory.spot.crystal.mass[row][:, [0, 1, 5]].T
    weights = jax.numpy.asarray(inertia * wave / np.sum(inertia * wave**2))
    begun = start(network, OVERLAP * wave[:2].T, 0.0, OVERLAP * wave[2])
    run = factors.Run(network, begun, STEP, 1, STEPS, np.arange(len(places)))

    def amplitude(found: Any) -> Any:
        return jax.numpy.sum(weights * found.motion[-1, :3])

    def departure(amplitude_over_overlap: float) -> np.ndarray:
        given = run.neutral("density", "normal_stiffness", "shear_stiffness", "amplitude")
        given["amplitude"] = np.float64(amplitude_over_overlap)
        _, found = gradients.gradient(run, amplitude, given, kinks=True)
        normal, shear = found["normal_stiffness"].sum(), found["shear_stiffness"].sum()
        # A ∝ E/(1 − ν²) and B ∝ E/((2 − ν)(1 + ν))
        of_ratio = normal * 2 * RATIO / (1 - RATIO**2) - shear * (1 - 2 * RATIO) / ((2 - RATIO) * (1 + RATIO))
        densities = [found["density"][row == number].sum() / VALUES[number] for number in (0, 1)]
        return np.array([*densities, normal + shear, of_ratio]) / (OVERLAP * amplitude_over_overlap) - exact

    sizes = 10.0 ** -np.arange(1.0, 4.0)
    left = np.abs([departure(each) for each in sizes]) / np.abs(exact).max()
    assert left[-1].max() < 2e-6  # the square of 1e-3, times a number of order 1
    for each in left.T:
        assert slope(sizes, each) == pytest.approx(2, abs=0.05)  # the next order in a, 1 % of the largest
    assert np.all(np.abs(exact) > 100 * left[1])  # so that each derivative is told from 0
