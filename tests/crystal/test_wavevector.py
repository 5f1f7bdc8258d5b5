"""Wave vectors: axes without rounding, the zone, what a periodic cell holds."""

from math import pi, sqrt

import numpy as np
import pytest

from granular_lmp.crystal.wavevector import WaveVector, snapped, zone_edge

pytestmark = pytest.mark.rounding  # matrices of an eigenvalue problem, sines and cosines


@pytest.mark.parametrize(
    ("degrees", "advances", "axis"),
    [(90, (0, 0.8), "y"), (-90, (0, -0.8), "y"), (0, (1.6 / sqrt(3), 0), "x"), (180, (-1.6 / sqrt(3), 0), "x")],
)
def test_a_wave_along_an_axis_has_no_rounding_of_the_other(
    degrees: float, advances: tuple[float, float], axis: str
) -> None:
    vector = WaveVector.of(0.8, degrees)
    assert (vector.per_column, vector.per_row) == pytest.approx(advances, rel=1e-15)
    assert 0 in (vector.per_column, vector.per_row)
    assert vector.axis == axis
    assert vector.direction == degrees


@pytest.mark.parametrize("degrees", [-170.0, -45.0, 10.0, 30.0, 89.0, 135.0])
def test_wave_number_and_direction_come_back(degrees: float) -> None:
    vector = WaveVector.of(1.1, degrees)
    assert vector.wavenumber == pytest.approx(1.1, rel=1e-15)
    assert vector.direction == pytest.approx(degrees, rel=1e-14)
    assert vector.axis is None
    assert np.hypot(*vector.components) == pytest.approx(1.1 * 2 / sqrt(3), rel=1e-15)  # ξ = (√3/2)|k|a


def test_components_along_and_across_are_those_of_a_turned_frame() -> None:
    vector = WaveVector.of(1.1, 25.0)
    x, y = vector.unit
    assert (vector.along(x, y), vector.across(x, y)) == pytest.approx((1, 0), abs=1e-15)
    assert (vector.along(-y, x), vector.across(-y, x)) == pytest.approx((0, 1), abs=1e-15)
    up = WaveVector.of(1.1)
    assert (up.along(0.3, 0.7), up.across(0.3, 0.7)) == (0.7, -0.3)  # p = v, q = −u


def test_the_zone_ends_at_its_corners_and_edges() -> None:
    corner = 2 * pi / sqrt(3)
    for degrees in range(0, 360, 60):
        assert zone_edge(degrees) == pytest.approx(corner, rel=1e-14)  # K
        assert zone_edge(degrees + 30) == pytest.approx(pi, rel=1e-14)  # M
    # On an edge, k and the wave vector on the opposite edge differ by one of the reciprocal lattice: k·d by 2π for two
    # The three bonds d
    kx, ky = WaveVector.of(zone_edge(80.0), 80.0).components
    assert ky == pytest.approx(2 * pi / sqrt(3), rel=1e-14)
    assert abs(kx) < 2 * pi / 3


def test_a_periodic_cell_holds_whole_numbers_of_waves_each_way() -> None:
    vector = WaveVector.of(0.8, 40.0).snapped(rows=24, columns=16)
    assert vector.per_row * 24 / (2 * pi) == pytest.approx(2, abs=1e-14)
    assert vector.per_column * 16 / (2 * pi) == pytest.approx(2, abs=1e-14)
    assert snapped(1.0, 1000) == pytest.approx(1.0, abs=pi / 1000)
