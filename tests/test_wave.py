"""Initial fields of a wave on a packing."""

import numpy as np
import pytest

from granular_lmp.modes import mode_along_y
from granular_lmp.packing import hexagonal, unit_lattice
from granular_lmp.scene import MODES
from granular_lmp.shape import Shape
from granular_lmp.wave import plane_wave
from tests.test_sphere import SILICA


@pytest.mark.parametrize("name", MODES)
def test_fields_are_those_of_the_travelling_wave(name: str) -> None:
    # p, q = P, Q cos ϑ and φ = −f sin ϑ, ϑ = ξn − Ωτ + phase: the signs of the closed form
    packing = hexagonal(SILICA, Shape(41, 3, "fixed"))
    mode = mode_along_y(unit_lattice(SILICA), SILICA, 0.9, name)
    fields = plane_wave(packing, mode, phase=0.4)
    theta = 0.9 * (packing.arrays["row"] - 20) + 0.4
    moving = ~packing.arrays["fixed"]
    expected = np.column_stack([mode.ux * np.cos(theta), mode.uy * np.cos(theta), -mode.f * np.sin(theta)])
    speed = mode.frequency * np.column_stack([mode.ux * np.sin(theta), mode.uy * np.sin(theta), mode.f * np.cos(theta)])
    np.testing.assert_allclose(fields.displacement[moving], expected[moving], atol=1e-14)
    np.testing.assert_allclose(fields.velocity[moving], speed[moving], atol=1e-14)


def test_held_rows_do_not_move() -> None:
    packing = hexagonal(SILICA, Shape(9, 3, "fixed"))
    fields = plane_wave(packing, mode_along_y(packing, SILICA, 0.9, "TR"))
    held = packing.arrays["fixed"]
    assert not fields.displacement[held].any()
    assert not fields.velocity[held].any()
