"""Initial fields of a wave on a packing."""

from math import erfc
from typing import Any

import numpy as np
import pytest

from granular_lmp import Scene
from granular_lmp.crystal.lattices import Shape, lattice_constant, offsets, packed, unit_lattice
from granular_lmp.crystal.mode import PLANE, TURNS
from granular_lmp.crystal.modes import MODES, bloch_mode, bloch_modes
from granular_lmp.crystal.wavevector import ROW_SPACING, WaveVector
from granular_lmp.errors import SceneError
from granular_lmp.rest.initial_fields import Fields, initial_fields, plane_wave
from granular_lmp.rest.linear import bloch_wave, mode_of
from granular_lmp.rest.refusals_of_waves import FEWEST_RADIANS
from tests.conftest import PAPER
from tests.crystal.test_sphere import SILICA

pytestmark = pytest.mark.rounding  # matrices of an eigenvalue problem, sines and cosines

CELL = {"packing.ends": "periodic", "packing.rows": "auto", "packing.columns": "auto"}
PULSE = PAPER.with_values(
    CELL
    | {"wave.wavenumber": 1.2, "wave.direction": 35.0, "envelope.length": 6.0, "envelope.width": 4.0}
    | {"time.duration": 10.0}
)


def fields_of(scene: Scene) -> Fields:
    return initial_fields(scene, packed(scene.sphere, scene.shape), bloch_wave(scene))


@pytest.mark.parametrize("name", MODES)
def test_fields_are_those_of_the_travelling_wave(name: str) -> None:
    # p, q = P, Q cos ϑ and φ = −f sin ϑ, ϑ = ξn − Ωτ + phase: the signs of the closed form
    packing = packed(SILICA, Shape(41, 3, "fixed"))
    mode = bloch_mode(unit_lattice(SILICA), SILICA, WaveVector.of(0.9), name)
    fields = plane_wave(packing, mode, phase=0.4)
    theta = 0.9 * (packing.arrays["row"] - 20) + 0.4
    moving = ~packing.arrays["fixed"]
    expected = np.column_stack([mode.ux * np.cos(theta), mode.uy * np.cos(theta), -mode.f * np.sin(theta)])
    speed = mode.frequency * np.column_stack([mode.ux * np.sin(theta), mode.uy * np.sin(theta), mode.f * np.cos(theta)])
    assert not fields.displacement[:, 2:5].any()
    assert not fields.velocity[:, 2:5].any()
    np.testing.assert_allclose(fields.displacement[moving][:, PLANE], expected[moving], atol=1e-14)
    np.testing.assert_allclose(fields.velocity[moving][:, PLANE], speed[moving], atol=1e-14)


def test_held_rows_do_not_move() -> None:
    packing = packed(SILICA, Shape(9, 3, "fixed"))
    fields = plane_wave(packing, bloch_mode(unit_lattice(SILICA), SILICA, WaveVector.of(0.9), "TR"))
    held = packing.arrays["fixed"]
    assert not fields.displacement[held].any()
    assert not fields.velocity[held].any()


@pytest.mark.parametrize("direction", [0.0, 20.0, -130.0])
def test_the_phase_of_an_oblique_wave_is_that_of_the_positions(direction: float) -> None:
    packing = packed(SILICA, Shape(10, 7, "periodic"))
    mode = bloch_mode(unit_lattice(SILICA), SILICA, WaveVector.of(1.1, direction), "TR")
    positions = packing.positions[:, :2] / lattice_constant(SILICA)
    centre = packing.arrays["row"].max() // 2 * 7 + 3
    angle = (positions - positions[centre]) @ mode.vector.components + 0.3
    fields = plane_wave(packing, mode, phase=0.3)
    np.testing.assert_allclose(fields.displacement[:, 0], mode.ux * np.cos(angle), atol=1e-13)
    np.testing.assert_allclose(fields.displacement[:, 5], -mode.f * np.sin(angle), atol=1e-13)
    np.testing.assert_allclose(fields.velocity[:, 1], mode.frequency * mode.uy * np.sin(angle), atol=1e-13)


def distances(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """From the middle of the envelope along and across the wave, in rows, of the nearest images."""
    x, y = offsets(packed(scene.sphere, scene.shape))
    (along_x, along_y), offset = scene.vector.unit, scene.envelope.offset
    x, y = x + offset * along_x * ROW_SPACING, y + offset * along_y
    if scene.shape.ends == "periodic":
        y = y - scene.shape.rows * np.round(y / scene.shape.rows)
    x = (x - scene.shape.columns * np.round(x / scene.shape.columns)) / ROW_SPACING
    return along_x * x + along_y * y, along_x * y - along_y * x


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"envelope.offset": 9.0},
        {"wave.direction": "y", "envelope.width": 0.0, "envelope.offset": -5.0},
        {"wave.direction": "x", "envelope.length": 0.0},
        {"wave.direction": "y", "packing.ends": "fixed", "packing.rows": 201, "packing.columns": 60},
    ],
)
def test_a_pulse_is_a_gaussian_of_the_length_and_width_asked_for(changes: dict[str, Any]) -> None:
    scene = PULSE.with_values(changes)
    fields, mode, envelope = fields_of(scene), mode_of(scene), scene.envelope
    displacement = fields.displacement[:, :2]
    # The field and the quarter of a period later that its velocity shows, together the square of the envelope
    square = np.sum(displacement**2 + (fields.velocity[:, :2] / mode.frequency) ** 2, axis=1)
    along, across = distances(scene)
    moments = [np.sqrt(2 * np.sum(square * away**2) / np.sum(square)) for away in (along, across)]
    # exp(−s²/2σ²) squared has the variance σ²/2. To 5 %: the modes around differ in shape and frequency
    for found, asked in zip(moments, (envelope.length, envelope.width), strict=True):
        if asked:
            assert found == pytest.approx(asked, rel=0.05)
    largest = np.sqrt(square.max() / (mode.ux**2 + mode.uy**2))
    assert largest == pytest.approx(1, abs=0.03)  # the amplitude is D0 in the middle
    assert np.sqrt(square[np.hypot(along, across) < 1.5].min()) > 0.8 * np.sqrt(square.max())


def test_a_pulse_holds_one_branch_and_runs_forward() -> None:
    scene = PULSE
    fields = fields_of(scene)
    packing = packed(scene.sphere, scene.shape)
    positions = np.column_stack(offsets(packing)) * [1, ROW_SPACING]
    shape, (i, j) = scene.shape, (2, -3)  # a wave vector at the side of the middle
    vector = WaveVector(
        scene.vector.per_column + 2 * np.pi * i / shape.columns, scene.vector.per_row + 2 * np.pi * j / shape.rows
    )
    carrier = np.exp(-1j * positions @ vector.components)
    amplitude, rate = (2 * carrier @ part / len(packing) for part in (fields.displacement, fields.velocity))
    frequencies, shapes = bloch_modes(
        unit_lattice(scene.sphere), scene.sphere, np.array(vector.components) / lattice_constant(scene.sphere)
    )
    likeness = np.abs(shapes * TURNS.conj() @ amplitude) / np.linalg.norm(amplitude)
    assert likeness.max() == pytest.approx(1, abs=1e-12)
    frequency = frequencies[np.argmax(likeness)]
    np.testing.assert_allclose(rate, -1j * frequency * amplitude, atol=1e-12 * np.abs(rate).max())
    # Were the envelope only multiplied to the mode, the middle's frequency and shape would be here
    assert abs(frequency / mode_of(scene).frequency - 1) > 0.05


def test_a_standing_wave_starts_from_rest_where_the_running_one_is() -> None:
    running, standing = (fields_of(PULSE.with_values({"wave.form": form})) for form in ("running", "standing"))
    np.testing.assert_array_equal(standing.displacement, running.displacement)
    assert not standing.velocity.any()
    assert running.velocity.any()


@pytest.mark.parametrize(("name", "column", "sign"), [("L", 1, 1), ("TR", 0, -1), ("RT", 0, -1)])
def test_a_driven_row_moves_alone_and_in_one_direction(name: str, column: int, sign: int) -> None:
    scene = PAPER.with_values({"wave.form": "driven", "wave.mode": name, "packing.rows": 21, "time.duration": 10.0})
    displacement = fields_of(scene).displacement.reshape(21, 3, 6)
    assert (displacement[0, :, column] == sign).all()
    displacement[0, :, column] = 0
    assert not displacement.any()


def test_a_driven_row_with_a_width_is_a_gaussian_around_the_centre_column() -> None:
    scene = PAPER.with_values(
        {"wave.form": "driven", "wave.mode": "L", "packing.rows": 21, "time.duration": 10.0}
        | {"packing.columns": 60, "envelope.width": 5.0}
    )
    row = fields_of(scene).displacement.reshape(21, 60, 6)[0, :, 1]
    columns = np.arange(60) - 30
    np.testing.assert_allclose(row, np.exp(-0.5 * (columns / (5 * ROW_SPACING)) ** 2), atol=1e-12)


def test_a_packet_that_would_run_backward_too_is_refused() -> None:
    # Σ|w|² of the waves whose κ∥ is below −k, with length = 4/ξ: erfc(4)/2 = 8e-9 of the energy
    assert erfc(FEWEST_RADIANS) / 2 < 1e-7
    with pytest.raises(SceneError, match=r"envelope\.length = 4\.0: must be 0 or at least 4/xi = 4\.988 rows"):
        PAPER.with_values({"envelope.length": 4.0})
