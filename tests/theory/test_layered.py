"""Films on a half-space and plates, beside the limits that are known in closed form."""

import numpy as np
import pytest
from scipy.optimize import brentq

from granular_analysis.theory.layered import Layered, Slab
from granular_analysis.theory.surface_wave import Coupled, HalfSpace
from tests.manual import Measure, Mutant, verifies
from tests.theory.test_surface_wave import APART, DENSITY, GLASS, along, layer

ALUMINIUM = HalfSpace.of(70e3, 0.33, 2.7e-3)
SOFT = HalfSpace.of(4e3, 0.34, 1.05e-3)


def bare(body: Layered, k: float, number: int, most: float) -> float:
    """Return the wave of a number, from 0, of a body without spheres, slower than `most` at k."""

    def below(speed: float) -> int:
        stiffness, held = body.reaction(k, speed * k)
        return int(held + np.sum(np.linalg.eigvalsh(stiffness) < 0))

    low, high = 0.0, most
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if below(middle) > number else (middle, high)
    return high


@pytest.mark.parametrize("thickness", [0.3, 30.0, 3e3])
@verifies(
    "A film on a half-space of its own material, two slabs, three thicknesses",
    reference="analytic: the half-space alone",
    tolerance=1e-09,
    reason="rounding of the film, which 1/kh enlarges",
    mutant=Mutant(
        "analysis/granular_analysis/theory/layered.py",
        "below = stiff[..., 3:, 3:] - stiff[..., 3:, :3]",
        "below = stiff[..., :3, :3] - stiff[..., 3:, :3]",
    ),
)
def test_a_film_of_the_same_material_is_the_half_space(thickness: float, measured: Measure) -> None:
    k = np.array([1e-2, 0.3, 2.0])
    body = Layered((Slab(GLASS, thickness), Slab(GLASS, 2 * thickness)), GLASS)
    for speed in (0.4, 0.95):
        omega = speed * GLASS.transverse * k
        found, held = body.reaction(k, omega)
        whole = GLASS.stiffness(k, omega)
        # Rounding of the film is larger where it is thin, by 1/kh
        measured(np.abs(found - whole).max() / np.abs(whole).max())
        assert not held.any()


def test_a_film_of_the_same_material_leaks_as_the_half_space_does() -> None:
    k, omega = 0.5, (2.3 - 0.05j) * GLASS.transverse
    found = Layered((Slab(GLASS, 2.0),), GLASS).reaction(k, omega).stiffness
    whole = GLASS.stiffness(k, omega)
    assert np.abs(found - whole).max() < 1e-12 * np.abs(whole).max()


def test_a_plate_that_is_thick_has_the_wave_of_rayleigh_on_either_face() -> None:
    plate, departures = Layered((Slab(GLASS, 1.0),)), []
    for k in (20.0, 30.0):
        speeds = [bare(plate, k, number, 0.99 * GLASS.transverse) / GLASS.rayleigh() for number in (0, 1)]
        departures.append(speeds[1] - speeds[0])
        assert speeds[0] < 1 < speeds[1]
    # Both couple through the plate by e^{−qh}, q = 0.42 k here
    decay = np.sqrt(1 - (GLASS.rayleigh() / GLASS.transverse) ** 2)
    assert departures[1] / departures[0] == pytest.approx(np.exp(-10 * decay), rel=0.01)


def test_a_plate_is_stable_where_it_is_very_thick() -> None:
    found = Layered((Slab(GLASS, 1e7),)).reaction(1.0, 0.5 * GLASS.transverse).stiffness
    np.testing.assert_allclose(found, GLASS.stiffness(1.0, 0.5 * GLASS.transverse), atol=1e-9)


@verifies(
    "Bending of a thin plate, how its departure grows with kh, less 4",
    reference="analytic: Kirchhoff's plate, corrections of the order (kh)²",
    tolerance=0.2,
    reason="the next order, (kh)² = 1e-2 of it, and rounding",
    mutant=Mutant(
        "analysis/granular_analysis/theory/layered.py",
        "slope * up + (plane - 2 * shear) * ik * along",
        "slope * up + (plane - 1.99 * shear) * ik * along",
    ),
)
def test_a_thin_plate_bends_and_stretches_by_the_theory_of_plates(measured: Measure) -> None:
    modulus, ratio, density = 73e3, 0.17, 2.2e-3
    plate, departures = Layered((Slab(GLASS, 1.0),)), []
    for k in (0.05, 0.1):
        bending, shear, stretch = (bare(plate, k, number, 1.9 * GLASS.transverse) for number in range(3))
        departures.append(1 - bending / (k * np.sqrt(modulus / (12 * density * (1 - ratio**2)))))
        assert shear == pytest.approx(GLASS.transverse, rel=1e-9)
        assert stretch == pytest.approx(np.sqrt(modulus / (density * (1 - ratio**2))), rel=1e-3 * k)
    # Shear and rotary inertia slow bending by the order (kh)²
    measured(departures[1] / departures[0] - 4)
    assert departures[1] < 2e-3


def test_a_soft_film_has_the_waves_of_love() -> None:
    k, h = 1.0, 3.0
    mu, under = (each.density * each.transverse**2 for each in (SOFT, GLASS))

    def left(speed: float) -> float:
        q, p = np.sqrt((speed / SOFT.transverse) ** 2 - 1), np.sqrt(1 - (speed / GLASS.transverse) ** 2)
        return float(mu * q * np.sin(q * k * h) - under * p * np.cos(q * k * h))

    grid = np.linspace(1.0001 * SOFT.transverse, 0.9999 * GLASS.transverse, 4001)
    signs = np.sign([left(speed) for speed in grid])
    roots = [brentq(left, grid[n], grid[n + 1]) for n in np.flatnonzero(np.diff(signs))]
    body = Layered((Slab(SOFT, h),), GLASS)
    for root in roots:
        answers = [body.reaction(k, speed * k) for speed in (root * (1 - 1e-7), root * (1 + 1e-7))]
        # One wave more is below, whether its surface moves or is held
        counts = [int(held + np.sum(np.linalg.eigvalsh(stiffness) < 0)) for stiffness, held in answers]
        assert counts[1] - counts[0] == 1
    assert len(roots) == 3


def test_spheres_on_a_thick_plate_have_the_waves_of_the_half_space() -> None:
    numbers = np.array([0.7, 1.1]) / APART
    whole = Coupled(layer(), GLASS).guided(along(0.4, numbers))
    plate = Coupled(layer(), Layered((Slab(GLASS, 60 * APART),)))
    found = plate.guided(along(0.4, numbers), 1.5 * np.nanmax(whole))
    for row, waves in zip(whole, found, strict=True):
        for omega in row[np.isfinite(row)][:3]:  # the slowest, which reach down least
            assert np.nanmin(np.abs(waves / omega - 1)) < 1e-8


def test_no_wave_of_a_film_is_missed() -> None:
    film, k = Coupled(layer(), Layered((Slab(SOFT, 2 * APART),), ALUMINIUM)), np.array([0.0, 1.3, 0.0]) / APART

    def values(omega: float) -> np.ndarray:
        return np.linalg.eigvalsh(film.matrix(k, np.array(omega)))

    # A sign of the determinant changes at a wave, where an eigenvalue is 0, and at a pole, where one is infinite
    grid = np.linspace(1e-3, 1 - 1e-9, 2001) * ALUMINIUM.transverse * np.linalg.norm(k)
    signs = np.prod(np.sign(np.linalg.eigvalsh(film.matrix(np.tile(k, (len(grid), 1)), grid))), axis=-1)
    roots = []
    for n in np.flatnonzero(np.diff(signs)):
        low, high = grid[n], grid[n + 1]
        for _ in range(32):  # of a step of 5e-4, to 1e-13
            middle = (low + high) / 2
            low, high = (middle, high) if np.prod(np.sign(values(middle))) == signs[n] else (low, middle)
        if np.abs(values(high)).min() < 1e-6 * np.abs(values(grid[n])).max():
            roots.append(high)
    np.testing.assert_allclose(film.guided(k), roots, rtol=1e-10)
    assert len(roots) > 5


def test_a_light_layer_leaves_the_waves_of_the_plate() -> None:
    plate, k = Layered((Slab(GLASS, 2 * APART),)), 0.5 / APART
    film = Coupled(layer(density=1e-4 * DENSITY, apart=1.0), plate)
    found = film.guided(along(0.0, np.array([k])), 0.9 * GLASS.transverse * k)[0]
    bending = bare(plate, k, 0, GLASS.transverse) * k
    assert np.abs(found / bending - 1).min() < 1e-3
