"""Numbers that are read off the record of a run are what they say."""

import numpy as np
import pytest

from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.network_state import contacts, start

jnp = pytest.importorskip("jax").numpy
gradients = pytest.importorskip("granular_analysis.theory.network_gradient", reason="needs JAX")
factors = pytest.importorskip("granular_analysis.theory.network_factors", reason="needs JAX")
objectives = pytest.importorskip("granular_analysis.theory.network_objectives", reason="needs JAX")

PLACES = 2.0 * np.stack(np.divmod(np.arange(48), 8), axis=1)[:, ::-1]  # 8 along x, 6 along y
K, FREQUENCY = np.array([2 * np.pi / 16, 0.0]), 0.7


def recorded(size: float, wavevector: np.ndarray, frequency: float) -> "gradients.Record":
    """Return the record of a wave along y in four of its periods at `FREQUENCY`."""
    times = np.linspace(0, 4 * 2 * np.pi / FREQUENCY, 65)
    way = size * np.cos(PLACES @ wavevector - frequency * times[:, None] + 0.4)
    motion = np.zeros((len(times), 6, len(PLACES)))
    motion[:, 1] = way
    return gradients.Record(times, motion, np.zeros((len(times), 0)))


def test_the_amplitude_is_that_of_the_wave_with_this_wave_vector_and_frequency_alone() -> None:
    def read(found: "gradients.Record") -> float:
        return float(objectives.amplitude(found, 1, PLACES, K, FREQUENCY))

    assert read(recorded(0.3, K, FREQUENCY)) == pytest.approx(0.3, rel=1e-12)
    for other in (recorded(0.3, -K, FREQUENCY), recorded(0.3, 2 * K, FREQUENCY), recorded(0.3, K, 2 * FREQUENCY)):
        assert read(other) < 1e-12


def test_the_misfit_is_the_sum_of_squares_in_errors_and_leaves_out_what_was_not_measured() -> None:
    found = recorded(0.3, K, FREQUENCY)
    errors = np.full((6, 1), np.inf)
    errors[1] = 0.1
    assert float(objectives.misfit(found, 0.0, errors)) == pytest.approx(np.sum((found.motion[:, 1] / 0.1) ** 2))


def test_the_largest_value_is_that_of_the_window() -> None:
    found = recorded(0.3, K, FREQUENCY)
    found.motion[10, 1, 3] = -1.0
    assert float(objectives.largest(found, 1)) == 1.0
    assert float(objectives.largest(found, 1, found.times[11])) <= 0.3


def test_the_energy_through_a_plane_is_what_the_spheres_beyond_it_gain() -> None:
    """In a row between held ends: their energy of motion, that of their contacts, and half of that of the plane's."""
    count, overlap = 6, 1e-2
    along = (2 - overlap) * np.arange(count)
    held = (np.arange(count) == 0) | (np.arange(count) == count - 1)
    material = (Material(1.0, 0.2),)
    network = Network(np.stack([along, 0 * along], axis=1), np.ones(count), np.ones(count), material, held=held)
    state = start(network, 0.0, np.array([[0.0, 0], [1e-4, 0], [0, 0], [0, 0], [0, 0], [0, 0]]))
    through, signs = objectives.across(network, state.pairs, (along[2] + 0.9, 0.0), (1.0, 0.0))
    back, others = objectives.across(network, state.pairs, (along[2] + 0.9, 0.0), (-1.0, 0.0))
    assert np.array_equal(through, back)
    assert np.array_equal(signs, -others)
    run = factors.Run(network, state, 0.05, 4000, 1, np.arange(count), contacts=through)
    found = gradients.record(run, {})
    assert list(zip(state.pairs.first[through], state.pairs.second[through], strict=True)) == [(2, 3)]

    def beyond(motion: np.ndarray) -> float:
        now = contacts(network, motion, state.pairs, state.shear, state.begun)
        stored = state.pairs.normal.energy(now.overlap, now.radius)
        share = np.select([state.pairs.first == 2, state.pairs.first > 2], [0.5, 1.0], 0.0)
        return float(np.sum(share * stored) + np.sum(network.mass[3:] * motion[3, 3:] ** 2) / 2)

    gained = [beyond(motion) - beyond(found.motion[0]) for motion in found.motion[[1600, 4000]]]
    carried = [
        objectives.energy(found._replace(times=found.times[:n], power=found.power[:n]), signs) for n in (1601, 4001)
    ]
    assert np.ptp([0.0, *gained]) > 0.1 * network.mass[1] * 1e-8 / 2
    # Step and trapezium err by (Ωh)²/12 each, 1e-5 in the fastest mode
    assert carried == pytest.approx(gained, abs=1e-4 * np.ptp([0.0, *gained]))
