"""A layer of spheres on an elastic half-space, beside the limits that are known in closed form."""

import csv
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from granular_analysis.measure.points import Point
from granular_analysis.theory.crystal import Crystal, Wall
from granular_analysis.theory.lattices import LATTICES
from granular_analysis.theory.network import Material
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.surface_wave import Coupled, HalfSpace
from granular_analysis.tools import saw
from granular_lmp import Scene
from tests.manual import Measure, Mutant, verifies

SILICA = Material(73e3, 0.17, 63.0)  # MPa, mJ/m²: lengths in nm, masses in ag, times in ns
R, DENSITY, DEPTH = 500.0, 2.2e-3, 0.2498514361612
APART = 2 * R - DEPTH
GLASS = HalfSpace.of(73e3, 0.17, 2.2e-3)


def layer(
    name: str = "hexagonal", density: float = DENSITY, *, apart: float = 0.0, shear: bool = True, exact: bool = False
) -> Crystal:
    """Return a layer on a rigid wall whose stiffness is that of silica; apart: gaps between the spheres."""
    lattice = LATTICES[name, ""]
    wall = Wall((0.0, 0.0, 2 ** (1 / 3) * DEPTH - R), (0.0, 0.0, -1.0), SILICA)
    vectors = (APART + apart) * lattice.vectors
    return Crystal.of(vectors, [[0.0, 0.0, 0.0]], R, density, [SILICA], walls=[wall], shear=shear, true_geometry=exact)


def along(angle: float, numbers: np.ndarray) -> np.ndarray:
    return np.multiply.outer(numbers, [np.cos(angle), np.sin(angle), 0.0])


# --- the half-space ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.0, 0.17, 0.4])
@verifies(
    "Elastic half-space under a slow load, three values of ν",
    reference="analytic: Boussinesq",
    tolerance=1e-05,
    reason="inertia is of the order (ω/ck)² = 1e-6",
    mutant=Mutant(
        "analysis/granular_analysis/theory/surface_wave.py",
        "g = (p * q + k**2) / (k**2 * (1 + slow)",
        "g = (p * q + k**2) / (k**2 * (1 + 1.01 * slow)",
    ),
)
def test_a_slow_load_presses_the_half_space_as_boussinesq_says(ratio: float, measured: Measure) -> None:
    solid, k = HalfSpace.of(2.0, ratio, 1.3), 0.7
    shear = 1.0 / (1 + ratio)
    answer = np.linalg.inv(solid.stiffness(k, 1e-3 * k))
    # Pressed by a wave of pressure: (1 − ν)/μk up and along, (1 − 2ν)/2μk across both; inertia is of the order ω²
    known = np.array([[1 - ratio, 0, 0], [0, 1, 0], [0, 0, 1 - ratio]]) / (shear * k)
    measured(np.abs(np.diag(answer) / np.diag(known) - 1).max())
    assert abs(answer[0, 2]) == pytest.approx((1 - 2 * ratio) / (2 * shear * k), rel=1e-5, abs=1e-6)


@verifies(
    "Rayleigh wave of Poisson's solid, c/c_t",
    reference="analytic: √(2 − 2/√3)",
    tolerance=1e-12,
    reason="roots of a cubic, some roundings",
    mutant=Mutant("analysis/granular_analysis/theory/surface_wave.py", "24 - 16 * slow", "24 - 15.9 * slow"),
)
def test_the_bare_surface_wave_is_that_of_rayleigh(measured: Measure) -> None:
    # c_R/c_t of Poisson's solid is √(2 − 2/√3)
    solid = HalfSpace.of(2.5, 0.25, 1.0)
    measured(solid.rayleigh() / solid.transverse / np.sqrt(2 - 2 / np.sqrt(3)) - 1)
    for ratio in (-0.3, 0.0, 0.17, 0.45):
        solid = HalfSpace.of(1.0, ratio, 1.0)
        assert abs(np.linalg.det(solid.stiffness(1.0, solid.rayleigh()))) < 1e-12


def test_slow_motion_takes_no_energy_and_fast_motion_does() -> None:
    for omega in (0.5, 0.9):
        matrix = GLASS.stiffness(1.0, omega * GLASS.transverse)
        np.testing.assert_allclose(matrix, matrix.conj().T, atol=1e-12 * np.abs(matrix).max())
    for omega in (1.2, 1.9, 5.0):
        # Power that goes down, ½ Re(−iω u†S u), is positive for every motion
        matrix = GLASS.stiffness(1.0, omega * GLASS.transverse)
        assert np.linalg.eigvalsh((matrix - matrix.conj().T) / 2j).max() < 1e-9 * np.abs(matrix).max()


# --- limits of the coupled waves --------------------------------------------------------------------------------------


def test_light_spheres_leave_the_wave_of_rayleigh() -> None:
    for light in (1e-3, 1e-5):
        # Without contacts between them: a layer that holds together is a stiff skin, however light
        film, numbers = Coupled(layer(density=light * DENSITY, apart=1.0), GLASS), np.array([1e-4, 5e-4])
        for k, found in zip(numbers, film.guided(along(np.pi / 2, numbers)), strict=True):
            assert np.abs(found / k / GLASS.rayleigh() - 1).min() < light


@verifies(
    "Surface waves of spheres without shear on a substrate",
    reference="analytic: the formula of the vertical resonance alone, its roots by Brent's method",
    tolerance=1e-09,
    reason="both iterations end at 1e-12 of a frequency or before",
    mutant=Mutant(
        "analysis/granular_analysis/theory/surface_wave.py",
        "rest[..., count:, count:] = springs",
        "rest[..., count:, count:] = 1.001 * springs",
    ),
)
def test_without_shear_it_is_the_vertical_formula(measured: Measure) -> None:
    film = Coupled(layer(apart=1.0, shear=False), GLASS)
    mass, stiffness = film.crystal.mass[0, 0], film.crystal.bonds.law.stiffness[0]
    assert len(film.crystal.bonds.first) == 1  # spheres do not touch one another
    own, loading = np.sqrt(stiffness / mass), mass / film.area / GLASS.density
    c_l, c_t = GLASS.longitudinal, GLASS.transverse

    def left(omega: float, k: float) -> float:
        x, y = (omega / (k * c_t)) ** 2, (omega / (k * c_l)) ** 2
        rayleigh = (2 - x) ** 2 - 4 * np.sqrt((1 - x) * (1 - y))
        return float(((omega / own) ** 2 - 1) * rayleigh - loading * omega**4 / (k**3 * c_t**4) * np.sqrt(1 - y))

    for k in np.linspace(0.5, 2.5, 9) * own / c_t:
        grid = np.linspace(1e-3, 1 - 1e-9, 4001) * c_t * k
        signs = np.sign([left(omega, k) for omega in grid])
        roots = [brentq(left, grid[n], grid[n + 1], args=(k,), xtol=1e-14) for n in np.flatnonzero(np.diff(signs))]
        found = film.guided(along(0.3, np.array([k])))[0]
        found = found[found > 1e-6 * own]  # spheres that nothing holds sideways have the frequency 0
        measured(np.abs(found / roots - 1).max())


def test_contacts_without_shear_leave_the_vertical_resonance_alone() -> None:
    apart, touching = (Coupled(layer(apart=each, shear=False), GLASS) for each in (1.0, 0.0))
    own = np.sqrt(apart.crystal.bonds.law.stiffness[-1] / apart.crystal.mass[0, 0])
    numbers = along(np.pi / 2, np.array([0.5, 1.0, 1.5]) * own / GLASS.rayleigh())
    for one, other in zip(apart.guided(numbers), touching.guided(numbers), strict=True):
        for omega in one[one > 1e-6 * own]:
            # The distance of spheres that do not touch is larger by 1e-3
            assert np.nanmin(np.abs(other / omega - 1)) < 1e-3


@pytest.mark.parametrize(("xi", "departure"), [(0.102, 0.01), (0.213, 0.1)])
def test_spheres_by_themselves_part_from_the_lattice_as_the_page_says(xi: float, departure: float) -> None:
    lattice, vertical = Coupled(layer(), GLASS), Coupled(layer(apart=1.0, shear=False), GLASS)
    own = np.sqrt(lattice.crystal.bonds.law.stiffness[-1] / lattice.crystal.mass[0, 0])
    k = along(np.pi / 2, np.array([xi / (APART * np.sqrt(0.75))]))
    slowest = [waves[waves > 1e-6 * own][0] for waves in (lattice.guided(k)[0], vertical.guided(k)[0])]
    assert slowest[1] / slowest[0] - 1 == pytest.approx(departure, rel=0.02)


def test_a_stiff_substrate_leaves_the_branches_of_the_layer() -> None:
    departures = []
    for factor in (1e2, 1e4):
        stiff = HalfSpace.of(73e3 * factor, 0.17, 2.2e-3 * factor)
        film = Coupled(layer(), stiff)
        # Where all six are slower than its waves
        k = along(np.pi / 2, np.array([1.9 / APART]))
        departures.append(np.abs(film.guided(k)[0, :6] / film.crystal.modes(k)[0][0] - 1).max())
    assert departures[1] < 1e-5
    assert departures[0] / departures[1] == pytest.approx(100, rel=0.05)


@verifies(
    "Quality factor of a layer that leaks into its substrate",
    reference="analytic: ρ c_l/(N m ω0)",
    tolerance=0.001,
    reason="to the first order of 1/Q², at Q of 30",
    mutant=Mutant(
        "analysis/granular_analysis/theory/surface_wave.py",
        "np.where(square.real > 0, np.sqrt(square), -1j * np.sqrt(-square))",
        "np.where(square.real > 0, np.sqrt(square), -1.01j * np.sqrt(-square))",
    ),
)
def test_the_vertical_resonance_leaks_by_its_formula(measured: Measure) -> None:
    left = []
    for density in (2.2e-2, 2.2):
        solid = HalfSpace(density, GLASS.longitudinal, GLASS.transverse)
        film = Coupled(layer(), solid)
        own = np.sqrt(film.crystal.bonds.law.stiffness[-1] / film.crystal.mass[0, 0])
        found = film.leaking([0.0, 1e-9 / APART], own)
        assert found.imag < 0
        quality = density * GLASS.longitudinal * film.area / (film.crystal.mass[0, 0] * own)
        left.append(found.real / (2 * abs(found.imag)) / quality - 1)
    # To the first order of 1/Q², which falls by 1e4
    measured(left[0])
    assert abs(left[1]) < 1e-6


def test_where_the_waves_cross_they_repel() -> None:
    film = Coupled(layer(), GLASS)
    own = np.sqrt(film.crystal.bonds.law.stiffness[-1] / film.crystal.mass[0, 0])
    numbers = np.linspace(0.3, 2.0, 60) * own / GLASS.rayleigh()
    found = film.guided(along(np.pi / 2, numbers))
    # Sagittal: below the vertical resonance the surface wave bends away, at no k are two waves of one frequency
    assert np.nanmin(np.diff(found, axis=1)[:, 0]) > 1e-3 * own
    spheres, surface = film.shape(along(np.pi / 2, numbers)[5], found[5, 0])
    matrix = film.matrix(along(np.pi / 2, numbers)[5], found[5, 0])
    vector = np.concatenate([film.crystal.moving(spheres), surface])
    assert np.linalg.norm(matrix @ vector) < 1e-9 * np.linalg.norm(matrix) * np.linalg.norm(vector)


def test_every_direction_of_a_hexagonal_layer_has_the_same_slow_waves() -> None:
    film, numbers = Coupled(layer(), GLASS), np.array([2e-5])
    one, other = (film.guided(along(angle, numbers))[0] for angle in (0.3, 1.2))
    np.testing.assert_allclose(one, other, rtol=1e-6)


def winding(film: Coupled, k: np.ndarray, low: complex, high: complex) -> int:
    """Return how many zeros, less poles, the determinant has in a box of the complex plane, by its phase around it."""
    corners = [low, complex(high.real, low.imag), high, complex(low.real, high.imag), low]
    side = np.linspace(0, 1, 400, endpoint=False)
    path = np.concatenate([a + (b - a) * side for a, b in itertools.pairwise(corners)] + [[low]])
    phase = np.unwrap(np.angle(np.linalg.slogdet(film._at(k)(path).stiffness)[0]))
    assert np.abs(np.diff(phase)).max() < 1.5  # the path is fine enough, and crosses no cut
    return round((phase[-1] - phase[0]) / (2 * np.pi))


@pytest.mark.parametrize("lattice", ["hexagonal", "honeycomb"])
@pytest.mark.parametrize(
    ("body", "share"),
    [
        ({}, 1e-3),
        ({}, 0.43),
        ({"thickness": 2e-7, "below": HalfSpace.of(70e9, 0.33, 2700.0)}, 1e-3),
        ({"thickness": 2e-7, "below": HalfSpace.of(70e9, 0.33, 2700.0)}, 0.3),
        ({"thickness": 1e-6}, 0.1),
        ({"thickness": 1e-6}, 0.43),
    ],
)
def test_each_wave_is_found_as_often_as_the_argument_principle_counts_it(
    lattice: str, body: dict[str, Any], share: float
) -> None:
    """Branches begin in pairs, of which one pole after the other must be found; 17 degrees are no mirror."""
    scene = Scene.load("monolayer_vertical").with_values({"packing.lattice": lattice, "packing.columns": 4})
    film = saw.Film.of(Setting(scene), degrees=17.0, **body)
    xi, own = share * film.crossing, film.own
    k, top = xi * film.unit, 1.1 * film.coupled.crystal.frequencies(xi * film.unit).max()
    if np.isinf(film.coupled.substrate.cutoff):
        found = film.coupled.guided(k[None], top)[0].astype(complex)
        low = 0.3 * own - 0.02j * own
    else:
        found = np.array([2 * np.pi * each.frequency_Hz - 1j * each.attenuation for each in film.leaking([xi])])
        # The sheet of waves that leak begins at a hyperbola, Re ω² = (c_l k)²
        fastest = max([film.solid, body.get("below", film.solid)], key=lambda each: each.longitudinal).longitudinal
        low = 1.03 * np.hypot(fastest * np.linalg.norm(k), 0.15 * own) - 0.15j * own
    apart = np.abs(found[:, None] - found) + top * np.eye(len(found))
    assert apart.min() > 1e-10 * top  # those of a pair are 1e-9 apart at the smallest wave number
    inside = (found.real > low.real) & (found.real < top) & (found.imag > low.imag)
    assert inside.sum() == winding(film.coupled, k, low, top + 0.02j * own) >= 6


def test_the_sagittal_and_the_horizontal_rocking_waves_leak_apart() -> None:
    film = saw.Film.of(Setting(Scene.load("monolayer_vertical")))
    for xi, attenuation in ((0.0718, 5.54e7), (0.1005, 7.42e7)):
        rocking, other, *_ = sorted(film.leaking(np.array([xi])), key=lambda each: each.frequency_Hz)
        assert rocking.across > 0.9
        assert other.along > 0.9
        assert other.attenuation == pytest.approx(attenuation, rel=1e-3)
    # A measured one is the nearest of both, 121.32 and 124.02 MHz
    points = [Point("frequency", each, 1e5, 2, branch="saw", wavenumber=0.1005) for each in (1.23e8, 1.22e8)]
    found = film.met(points, np.tile(0.1005 * film.unit, (2, 1)))
    np.testing.assert_allclose(found, [other.frequency_Hz, rocking.frequency_Hz], rtol=1e-9)


# --- the command ------------------------------------------------------------------------------------------------------


def rows(printed: str, kind: str) -> list[dict[str, float]]:
    """Return the waves of a kind in the table of the command, by the names of its columns."""
    head, *lines = [line.split() for line in printed.splitlines() if line.split()[0] in ("wave", kind)]
    return [dict(zip(head[-len(line) + 1 :], map(float, line[1:]), strict=True)) for line in lines]


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command prints its table, and seeks no other waves to draw and write."""
    monkeypatch.setattr(saw, "POINTS", 2)
    monkeypatch.setattr(saw.Film, "leaking", lambda film, numbers: [])
    monkeypatch.setattr(saw, "draw", lambda *found: None)
    monkeypatch.setattr(saw, "save", lambda figure, path: None)


@pytest.mark.usefixtures("drawn_once")
def test_the_command_prints_resonances_and_writes_all_waves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(saw, "POINTS", 24)
    saw.main(["monolayer_vertical", "-o", str(tmp_path / "saw.png")])
    said = capsys.readouterr().out
    assert "surface 3410.8 m/s" in said
    (vertical,) = (each for each in rows(said, "resonance") if each["vertical"] == 1)
    # The formula of a large quality factor says 11.0: ρ c_l/(N m ω0) with one sphere on √¾ square micrometres
    assert vertical["Q"] == pytest.approx(11.0, abs=0.2)
    assert vertical["1/s"] == pytest.approx(np.pi * vertical["Hz"] / vertical["Q"], rel=0.01)
    written = list(csv.DictReader((tmp_path / "saw.csv").read_text("utf-8").splitlines()))
    assert {row["kind"] for row in written} == {"guided", "leaking"}
    guided = [row for row in written if row["kind"] == "guided"]
    assert all(float(row["attenuation"]) == 0 for row in guided)
    for row in guided:  # none is faster than a transverse wave
        assert float(row["frequency_Hz"]) * float(row["wavelength"]) < 3765.8
    for row in written:
        assert sum(float(row[name]) for name in ("vertical", "along", "across", "turning")) == pytest.approx(1)
    assert (tmp_path / "saw.png").stat().st_size > 1e4


@pytest.mark.usefixtures("printed")
def test_another_density_of_the_substrate_changes_the_leak(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = Scene.load("monolayer_vertical").with_values({"substrate.density": 4400.0})
    (tmp_path / "heavy.toml").write_text(scene.to_toml())
    found = []
    for words in (["monolayer_vertical"], ["monolayer_vertical", "--density", "4400"], [str(tmp_path / "heavy.toml")]):
        saw.main([*words, "--limit", "0.05", "-o", str(tmp_path / "saw.png")])
        found += [each["Q"] for each in rows(capsys.readouterr().out, "resonance") if each["vertical"] == 1]
    light, heavy, declared = found
    # Q goes with ρ c_l, c_l with 1/√ρ
    assert heavy / light == pytest.approx(np.sqrt(2), rel=0.02)
    assert declared == heavy


@pytest.mark.usefixtures("printed")
def test_the_command_takes_a_plate_and_a_film(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plate = ["monolayer_vertical", "--thickness", "2e-6", "-o", str(tmp_path / "saw.png")]
    saw.main([*plate, "--limit", "0.06"])
    assert not rows(capsys.readouterr().out, "resonance")  # nothing leaks from a plate
    saw.main([*plate, "--below", "73e9", "0.17", "2200", "--limit", "0.06"])  # of the substrate's own material
    film = rows(capsys.readouterr().out, "resonance")
    assert film
    saw.main(["monolayer_vertical", "-o", str(tmp_path / "saw.png"), "--limit", "0.06"])
    for one, other in zip(film, rows(capsys.readouterr().out, "resonance"), strict=True):
        assert one["Hz"] == pytest.approx(other["Hz"], rel=1e-5)


def test_a_layer_that_moves_with_its_substrate_feels_no_force() -> None:
    film = Coupled(layer(), HalfSpace(1e-12, 1.0, 0.5))
    matrix = film.matrix([1e-9, 0.0], np.array(1e-9))
    for way in range(3):
        together = np.zeros(9)
        together[[way, 6 + way]] = 1.0
        assert np.abs(matrix @ together).max() < 1e-6 * np.abs(matrix).max()
