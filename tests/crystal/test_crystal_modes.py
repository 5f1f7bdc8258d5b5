"""Bloch modes of any crystal from its contacts: closed forms of chains and square lattices, supercells, vacancies."""

from dataclasses import replace
from math import pi, sqrt

import ase
import mpmath
import numpy as np
import pytest

from granular_lmp.crystal.contacts import Contacts, find_contacts
from granular_lmp.crystal.lattices import (
    CHAIN,
    SQUARE,
    Lattice,
    Shape,
    lattice_constant,
    packed,
    unit_cell,
    unit_lattice,
)
from granular_lmp.crystal.mode import FULL, Physics
from granular_lmp.crystal.modes import bloch_mode, bloch_modes, effective_inertia, highest_frequency
from granular_lmp.crystal.sphere import INERTIA_RATIO, Sphere
from granular_lmp.crystal.stability import frequency_bound
from granular_lmp.crystal.wavevector import ROW_SPACING, WaveVector
from granular_lmp.errors import CrystalError
from tests.conftest import latin
from tests.crystal.test_sphere import SILICA
from tests.manual import Measure, Mutant, verifies

PRESSED = replace(SILICA, work_of_adhesion=0.0, contact_force=SILICA.pull_off_force)
PER_MASS = SILICA.time_scale**2 / SILICA.mass
# A frequency is a sum of squares of some ten terms, each rounded a few times
ROUNDED = 1e-13


def at_rest(crystal: ase.Atoms) -> Contacts:
    """Return the contacts of a crystal of silica spheres that adhesion alone holds."""
    return find_contacts(crystal, [SILICA], 0.0)


def frequencies(contacts: Contacts, k: object, physics: Physics = FULL) -> np.ndarray:
    return bloch_modes(contacts, SILICA, k, physics)[0]


# --- the hexagonal lattice -------------------------------------------------------------------------------------------


def exact(sphere: Sphere, k: np.ndarray, physics: Physics) -> list[float]:
    """Return the frequencies of the hexagonal lattice, to 40 digits from its dynamical matrix, lowest first."""
    with mpmath.workdps(40):
        kappa, root = mpmath.mpf(sphere.stiffness_ratio), mpmath.sqrt(3) / 2
        springs = [(mpmath.mpf(1), 1, 0), (kappa if physics.shear else mpmath.mpf(0), 0, 1)]
        mass = [1, 1, mpmath.mpf(INERTIA_RATIO) / (1 - mpmath.mpf(sphere.overlap_ratio))]
        matrix = mpmath.zeros(3)
        for x, y in ((mpmath.mpf(1), mpmath.mpf(0)), (mpmath.mpf(1) / 2, root), (-mpmath.mpf(1) / 2, root)):
            half = (x * mpmath.mpf(k[0]) + y * mpmath.mpf(k[1])) * mpmath.mpf(lattice_constant(sphere)) / 2
            sine, cosine = 2 * mpmath.sin(half), 2 * mpmath.cos(half)
            rows = [(w, [sine * (n * x - t * y), sine * (n * y + t * x), -cosine * t]) for w, n, t in springs]
            rows.append((-mpmath.mpf(sphere.prestress), [-sine * y, sine * x, mpmath.mpf(0)]))
            for weight, row in rows:
                for a in range(3):
                    for b in range(3):
                        matrix[a, b] += weight * row[a] * row[b] / mpmath.sqrt(mass[a] * mass[b]) / (2 * (kappa + 3))
        size = len(physics.coordinates)
        values = mpmath.eigsy(matrix[:size, :size], eigvals_only=True)
        return sorted(float(mpmath.sqrt(value)) for value in values)


@pytest.mark.parametrize(
    ("sphere", "physics"),
    latin(
        [PRESSED, SILICA, replace(SILICA, poisson_ratio=-0.9)],
        [FULL, Physics(rotation=False), Physics(shear=False, rotation=False)],
    ),
)
@verifies(
    "Modes of the package: hexagonal, fifty wave vectors, also compressed or auxetic",
    reference="other code: the matrix in many digits (mpmath)",
    tolerance=1e-13,
    reason="a frequency is a sum of squares of some ten terms, each rounded a few times",
    mutant=Mutant(
        "granular_lmp/crystal/bloch.py",
        "contacts.mass / (1 - _arm_loss(contacts))",
        "contacts.mass / (1 - 1.01 * _arm_loss(contacts))",
    ),
)
def test_fifty_wave_vectors_of_the_hexagonal_lattice_hold_thirteen_digits(
    sphere: Sphere, physics: Physics, measured: Measure
) -> None:
    random = np.random.default_rng(1)
    k = random.normal(size=(50, 2)) * np.logspace(-4, 0.3, 50)[:, None]  # long waves too
    found = bloch_modes(unit_lattice(sphere), sphere, k, physics)[0]
    measured(np.abs(found / [exact(sphere, each, physics) for each in k] - 1).max())


def test_a_wrong_wave_vector_is_told_from_the_right_one() -> None:
    k = np.array([0.3, 0.4])
    wrong = frequencies(unit_lattice(SILICA), k * (1 + 1e-11))
    assert np.abs(wrong / exact(SILICA, k, FULL) - 1).max() > ROUNDED


@pytest.mark.parametrize("repeats", [(2, 1, 1), (2, 2, 1), (3, 2, 1)])
def test_a_supercell_holds_the_waves_of_the_unit_cell_folded(repeats: tuple[int, int, int]) -> None:
    crystal = unit_cell(SILICA).repeat(repeats)
    k = np.array([0.11, 0.23])
    corners = np.array([(i, j, 0) for i in range(repeats[0]) for j in range(repeats[1])])
    shifts = 2 * pi * corners @ np.linalg.inv(crystal.cell.array).T
    folded = np.sort(frequencies(unit_lattice(SILICA), k + shifts[:, :2]).ravel())
    # Stretches of neighbours that move alike are differences of numbers near 1, frequencies here 0.03 and above
    np.testing.assert_allclose(frequencies(at_rest(crystal), k), folded, rtol=1e-12)


def test_the_sheet_of_a_scene_is_a_supercell() -> None:
    sheet = packed(SILICA, Shape(4, 3, "periodic"))
    height, width = 4 * ROW_SPACING * lattice_constant(SILICA), 3 * lattice_constant(SILICA)
    k = [[2 * pi * i / width, 2 * pi * j / height] for i in range(3) for j in range(4)]
    folded = np.sort(frequencies(unit_lattice(SILICA), k).ravel())
    np.testing.assert_allclose(frequencies(at_rest(sheet), [0, 0])[2:], folded[2:], rtol=1e-11)


# --- vacancies and zero modes ----------------------------------------------------------------------------------------


def with_vacancy() -> Contacts:
    crystal = unit_cell(SILICA).repeat((4, 4, 1))
    del crystal[5]
    return at_rest(crystal)


@pytest.mark.parametrize(
    ("physics", "zero"),
    [
        (FULL, 2),
        (Physics(rotation=False), 2),
        (Physics(shear=False, rotation=False), 2),  # central forces hold a triangular lattice
        (Physics(shear=False), 2 + 15),  # and nothing holds the rotations
    ],
)
def test_a_crystal_with_a_vacancy_is_free_to_be_shifted_and_no_more(physics: Physics, zero: int) -> None:
    contacts = with_vacancy()
    assert len(contacts) == 3 * 16 - 6
    found = frequencies(contacts, [0.0, 0.0], physics)
    # Zero is some roundings of 1e-16; the lowest mode that is not zero is a wave as long as the cell
    assert (found < 1e-12).sum() == zero
    assert found[zero] > 0.1


def test_a_translation_of_a_crystal_with_a_vacancy_has_no_frequency() -> None:
    contacts = with_vacancy()
    _, shapes = bloch_modes(contacts, SILICA, [0.0, 0.0])
    for column in (0, 1):
        translation = np.zeros(6 * 15)
        translation[column::6] = 1 / sqrt(15)
        # All of it is in the two modes of zero frequency
        assert np.sum(np.abs(shapes[:2] @ translation) ** 2) == pytest.approx(1, abs=1e-12)


def test_a_vacancy_moves_frequencies() -> None:
    full = frequencies(at_rest(unit_cell(SILICA).repeat((4, 4, 1))), [0.0, 0.0])
    assert abs(frequencies(with_vacancy(), [0.0, 0.0])[2] / full[2] - 1) > 1e-3


# --- square lattice and chain ----------------------------------------------------------------------------------------


def constants(sphere: Sphere) -> tuple[float, float, float]:
    """Return k and g over the mass in 1/t0², and the inertia Ĩ/(1 − η) that LAMMPS's torque arm makes of Ĩ."""
    unit = sphere.time_scale**2 / sphere.mass
    return sphere.normal_stiffness * unit, sphere.shear_stiffness * unit, INERTIA_RATIO / (1 - sphere.overlap_ratio)


def named(sphere: Sphere, lattice: Lattice, names: str, phase: float, physics: Physics = FULL) -> list[float]:
    vector, contacts = WaveVector.of(phase, row_spacing=lattice.row_spacing), unit_lattice(sphere, lattice)
    return [bloch_mode(contacts, sphere, vector, name, physics).frequency for name in names.split()]


@pytest.mark.parametrize("sphere", [SILICA, replace(SILICA, poisson_ratio=-0.6), replace(SILICA, poisson_ratio=0.5)])
@pytest.mark.parametrize("phase", [0.1, 0.3, 0.802, 1.1, 2.9])
def test_waves_of_a_square_lattice_and_a_chain_have_their_closed_forms(phase: float, sphere: Sphere) -> None:
    """Square: E = ½ g [(s u + c f)² + 4 f²] + ½ k s² v² with s, c = 2 sin, 2 cos of half the phase; rows resist turns.

    In a chain one combination of u and f is free. Without rotation both have the transverse wave s √g.
    """
    (k, g, inertia), s, c = constants(sphere), 2 * np.sin(phase / 2), 2 * np.cos(phase / 2)
    middle, product = (s**2 + (c**2 + 4) / inertia) / 2, 4 * s**2 / inertia
    upper = sqrt(g * (middle + sqrt(middle**2 - product)))
    across = [g * sqrt(product) / upper, upper]  # the lower root without a difference of nearly equal numbers
    chain = np.array([s * sqrt(k), sqrt(g * (s**2 + c**2 / inertia))])
    np.testing.assert_allclose(named(sphere, SQUARE, "TR RT L", phase), [*across, s * sqrt(k)], rtol=1e-12)
    np.testing.assert_allclose(named(sphere, CHAIN, "L RT", phase), chain, rtol=1e-12)
    for lattice in (SQUARE, CHAIN):
        np.testing.assert_allclose(
            named(sphere, lattice, "TR", phase, Physics(rotation=False)), s * sqrt(g), rtol=1e-12
        )
    height = lattice_constant(sphere)
    for way in ([0, phase], [phase, 0]):
        found = bloch_modes(find_contacts(unit_cell(sphere, SQUARE), [sphere], 0.0), sphere, np.array(way) / height)[0]
        np.testing.assert_allclose(found, np.sort([*across, s * sqrt(k)]), rtol=ROUNDED)
    found = bloch_modes(find_contacts(unit_cell(sphere, CHAIN), [sphere], 0.0), sphere, [0, phase / height])[0]
    assert found[0] < 1e-12  # nothing holds it sideways
    np.testing.assert_allclose(found[1:], np.sort(chain), rtol=ROUNDED)


def test_spheres_of_a_square_lattice_turn_as_gears() -> None:
    corner = np.array([pi, pi]) / lattice_constant(SILICA)
    found, shapes = bloch_modes(at_rest(unit_cell(SILICA, SQUARE)), SILICA, corner)
    assert found[0] < 1e-12
    np.testing.assert_allclose(np.abs(shapes[0]), np.eye(6)[5], rtol=0, atol=1e-12)


def test_a_chain_that_is_pressed_together_buckles() -> None:
    contacts = find_contacts(unit_cell(PRESSED, CHAIN), [PRESSED], PRESSED.contact_force)
    with pytest.raises(CrystalError, match="the crystal is not stable: a mode has the squared frequency -"):
        bloch_modes(contacts, PRESSED, [0.0, 1.0])


@verifies(
    "Chain of two masses, acoustic and optical branch, edges of the gap",
    reference="analytic: the diatomic chain",
    tolerance=1e-11,
    reason="rounding of differences of stretches at a phase of 0.1",
    mutant=Mutant(
        "granular_lmp/crystal/bloch.py",
        "inverse_root_mass = np.sqrt(sphere.mass / mass)",
        "inverse_root_mass = np.sqrt(sphere.mass / mass.mean()) + 0 * mass",
    ),
)
def test_a_chain_of_two_masses_has_a_band_gap(measured: Measure) -> None:
    """ω² = k [1/m + 1/M ± √((1/m + 1/M)² − 4 sin²(ka)/(mM))], from √(2k/M) to √(2k/m) none at ka = π/2."""
    crystal = unit_cell(SILICA, CHAIN).repeat((1, 2, 1))
    crystal.set_array("density", SILICA.density * np.array([1.0, 3.0]))
    contacts, k = at_rest(crystal), SILICA.normal_stiffness * PER_MASS

    def longitudinal(phase: float) -> np.ndarray:
        found, shapes = bloch_modes(contacts, SILICA, [0, phase / lattice_constant(SILICA)])
        along = np.sum(np.abs(shapes[:, 1::3]) ** 2, axis=1) > 0.5
        return found[along]

    for phase in (0.1, 0.7, 1.3):
        root = sqrt((1 + 1 / 3) ** 2 - 4 * np.sin(phase) ** 2 / 3)
        expected = np.sqrt([k * (4 / 3 - root), k * (4 / 3 + root)])
        # In a chain the sideways zero modes touch Γ, so the shapes are told apart away from it
        measured(np.abs(longitudinal(phase) / expected - 1).max())
    measured(np.abs(longitudinal(pi / 2) / np.sqrt([2 * k / 3, 2 * k]) - 1).max())


def test_unequal_spheres_of_a_chain_turn_as_gears_of_their_radii() -> None:
    small = 0.6
    law = find_contacts(unit_cell(SILICA, CHAIN), [SILICA], 0.0)
    curvature = 1 / (1 / 1 + 1 / small)  # Rc over R; equal spheres have 1/2
    # δ = (F/A)^{2/3} with F ~ Rc and A ~ √Rc
    overlap = law.overlap[0] * (2 * curvature) ** (1 / 3)
    distance = 1 + small - overlap / SILICA.radius
    crystal = ase.Atoms(
        "X2", positions=[[0, 0, 0], [0, distance, 0]], cell=[2, 2 * distance, 2], pbc=[False, True, False]
    )
    crystal.set_array("radius", np.array([1.0, small]))
    contacts = at_rest(crystal)
    np.testing.assert_allclose(
        contacts.shear_stiffness, law.shear_stiffness[0] * (2 * curvature) ** (2 / 3), rtol=1e-12
    )
    eta = overlap / (2 * SILICA.radius * np.array([1.0, small]))
    inertia = INERTIA_RATIO * np.array([1.0, small**3]) / (1 - eta)
    np.testing.assert_allclose(effective_inertia(contacts) / SILICA.mass, inertia, rtol=1e-12)
    found, shapes = bloch_modes(contacts, SILICA, [0.0, 0.0])
    turning = sqrt(2 * contacts.shear_stiffness[0] * PER_MASS * (1 / inertia).sum())
    assert np.abs(found / turning - 1).min() < 1e-12  # both turn alike, which shears both contacts
    gears = np.eye(12)[5] - np.eye(12)[11]  # Rθ of one against that of the other
    free = shapes[found < 1e-12].T
    np.testing.assert_allclose(free @ np.linalg.lstsq(free, gears)[0], gears, rtol=0, atol=1e-12)


def test_a_crystal_that_is_not_flat_is_refused() -> None:
    crystal = ase.Atoms("X2", positions=[[0, 0, 0], [0, 1.2, 1.6 - 1e-3]], cell=[9, 9, 9])
    crystal.set_array("radius", np.ones(2))
    contacts = find_contacts(crystal, [SILICA])
    for ask in (lambda: bloch_modes(contacts, SILICA, [0.0, 0.0]), lambda: frequency_bound(contacts, SILICA)):
        with pytest.raises(ValueError, match="contact 0: leaves the plane z = const"):
            ask()


# --- torque arms that differ -----------------------------------------------------------------------------------------


def test_unequal_overlaps_of_a_sphere_shift_frequencies_by_less_than_their_spread() -> None:
    """With the arm R − δ/2 of each contact LAMMPS's equations have no energy, and their matrix is not symmetric."""
    crystal = unit_cell(SILICA).repeat((3, 3, 1))
    crystal.arrays["radius"] += np.random.default_rng(2).uniform(-1e-4, 1e-4, 9)
    contacts = replace(find_contacts(crystal, [SILICA]), contact_force=np.zeros(27))
    force = np.zeros((27, 27))
    mass = np.column_stack([contacts.mass, contacts.mass, INERTIA_RATIO * contacts.mass]).ravel()
    for c, (i, j) in enumerate(zip(contacts.i, contacts.j, strict=True)):
        normal, slip = np.zeros(27), np.zeros(27)
        n, t = contacts.normals[c, :2], contacts.tangents[c, 0, :2]
        for sphere, sign in ((i, -1), (j, 1)):
            normal[3 * sphere : 3 * sphere + 2] += sign * n
            slip[3 * sphere : 3 * sphere + 3] += [*(sign * t), -1]
        torque = slip.copy()
        for sphere in (i, j):
            torque[3 * sphere + 2] *= 1 - contacts.overlap[c] / (2 * contacts.radius[sphere])
        force += contacts.normal_stiffness[c] * np.outer(normal, normal)
        force += contacts.shear_stiffness[c] * np.outer(torque, slip)
    true = np.sort(np.sqrt(np.maximum(np.linalg.eigvals(force / mass[:, None]).real, 0.0))) * SILICA.time_scale
    found = frequencies(contacts, [0.0, 0.0])
    spread = np.ptp(contacts.overlap) / (2 * SILICA.radius)
    assert spread > 5e-5
    assert np.abs(found[2:] / true[2:] - 1).max() < spread


# --- the highest frequency and the time scale ------------------------------------------------------------------------


@pytest.mark.parametrize("physics", [FULL, Physics(rotation=False), Physics(shear=False, rotation=False)])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_frequency_of_a_disordered_crystal_exceeds_its_bound(seed: int, physics: Physics) -> None:
    random = np.random.default_rng(seed)
    crystal = packed(SILICA, Shape(8, 7, "periodic"))
    del crystal[random.choice(len(crystal), 5, replace=False)]
    crystal.set_array("density", SILICA.density * random.uniform(0.5, 2, len(crystal)))
    contacts = at_rest(crystal)
    highest, bound = frequencies(contacts, [0.0, 0.0], physics)[-1], frequency_bound(contacts, SILICA, physics)
    # From above, and as near as sixty steps come
    assert highest * (1 - ROUNDED) <= bound < highest * 1.01


def test_of_a_large_lattice_the_bound_is_the_top_of_the_spectrum() -> None:
    contacts = at_rest(packed(SILICA, Shape(40, 40, "periodic")))
    highest = highest_frequency(unit_lattice(SILICA), SILICA)
    assert highest < frequency_bound(contacts, SILICA) < highest * (1 + 2e-3)


def time_scale(contacts: Contacts, row_spacing: float) -> float:
    """Return t0 = s/2c of rows s (m) apart, with c² = Σ (k n_y² + g t_y²) d_y²/Σ m over the contacts, s."""
    n, t = contacts.normals[:, 1], contacts.tangents[:, :, 1]
    stiffness = contacts.normal_stiffness * n**2 + contacts.shear_stiffness * np.sum(t**2, axis=1)
    squares = np.sum(stiffness * contacts.vector[:, 1] ** 2)
    return float(row_spacing / 2 * np.sqrt(contacts.mass.sum() / squares))


@pytest.mark.parametrize("sphere", [SILICA, PRESSED])
def test_time_scale_of_the_hexagonal_lattice_is_that_of_the_sphere(sphere: Sphere) -> None:
    row = ROW_SPACING * sphere.lattice_constant
    np.testing.assert_allclose(time_scale(unit_lattice(sphere), row), sphere.time_scale, rtol=ROUNDED)
    sheet = find_contacts(packed(sphere, Shape(6, 5, "periodic")), [sphere], sphere.contact_force)
    np.testing.assert_allclose(time_scale(sheet, row), sphere.time_scale, rtol=ROUNDED)


@pytest.mark.parametrize("lattice", [CHAIN, SQUARE])
def test_time_scale_of_chain_and_square_is_that_of_the_spring_chain(lattice: Lattice) -> None:
    expected = sqrt(SILICA.mass / (4 * SILICA.normal_stiffness))
    np.testing.assert_allclose(
        time_scale(at_rest(unit_cell(SILICA, lattice)), SILICA.lattice_constant), expected, rtol=ROUNDED
    )
