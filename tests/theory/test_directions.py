"""The general-direction theory against the paper's direction, the symmetry of the lattice, and the exact force laws."""

import ast
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import DOP853

from cases.map import case as zone_map
from granular_analysis import second_harmonic
from granular_analysis.second_harmonic import SOLID_SPHERE
from granular_analysis.theory import bloch, bonds, crystal, lattice, mixing
from granular_analysis.theory.bloch import BONDS, branch_index, wavevector_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.hierarchy import hierarchy_orders
from granular_analysis.theory.wave import Wave, nonlinearity, trajectory
from tests.conftest import latin, members
from tests.polarisations import (
    bloch_matrix,
    doubled_wave,
    mean_rotation,
    modes,
    second_harmonic_amplitude,
)
from tests.polarisations import (
    second_order_at as second_order,
)

SILICA = 0.17  # Poisson's ratio of the paper's spheres
OBLIQUE = {"19 degrees": (1.10, 0.38), "66 degrees": (0.55, 1.25)}  # off both mirror lines (multiples of 30 degrees)

# Derived with computer algebra for ν = 0.17, Ĩ = 0.4: ξ, mode, Ω, Q, f, P̃1/i.
CLOSED_FORM = [
    (0.802, "TR", 0.276935327978, 0.973101202335, 0.230378058881, -0.0365016850),
    (0.802, "RT", 1.788072111095, 0.094276715198, -0.995546031568, -0.0008730171),
    (0.802, "L", 0.390339208440, None, None, 1.1793218504),
    (1.475, "TR", 0.497369073475, 0.909207489850, 0.416343296332, -13.8651197840),
    (2.127, "TR", 0.699055989569, 0.819326692835, 0.573326931521, 4.07540e-5),
]


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


def relative_error(measured: NDArray, expected: NDArray) -> float:
    return float(np.linalg.norm(measured - expected) / np.linalg.norm(expected))


def slope(amplitudes: list[float], errors: list[float]) -> float:
    return float(np.polyfit(np.log(amplitudes), np.log(errors), 1)[0])


# ---- an independent witness: the exact force laws, six contacts written out, on the phase torus --


def torus_even_part(
    k: tuple[float, float],
    branch: int,
    amplitude: float,
    times: NDArray[np.float64],
    phase: float = 0.0,
    points: int = 15,
    poisson_ratio: float = SILICA,
) -> NDArray[np.float64]:
    """Return harmonics 0 and ±2 at a phase, (time, 3) in D0, of the exact lattice started in a pure mode.

        F_N = (2/3)(1 − (1−x)₊^1.5),    F_S = κ t (1−x)₊^½        (displacements in Δ0)

    A wave that starts as a function of the phase k·r alone stays one, and a neighbour at d is a shift of the phase by
    k·d: the infinite lattice without boundaries. These harmonics are the second-order field up to relative O(a²).
    """
    k = np.asarray(k)
    kappa = Contact(poisson_ratio).kappa
    theta = 2.0 * np.pi * np.arange(points) / points
    order = np.fft.fftfreq(points, 1.0 / points)

    def shift(angle: float) -> NDArray[np.float64]:
        return np.real(np.fft.ifft(np.exp(1j * order * angle)[:, None] * np.fft.fft(np.eye(points), axis=0), axis=0))

    angles = np.deg2rad([0, 60, 120, 180, 240, 300])
    n, t = np.stack([np.cos(angles), np.sin(angles)]), np.stack([-np.sin(angles), np.cos(angles)])  # (2, contact)
    shifts = np.stack([shift(k @ normal) for normal in n.T])
    mass = 2.0 * (kappa + 3.0) * np.array([1.0, 1.0, SOLID_SPHERE])

    def rate(_: float, state: NDArray[np.float64]) -> NDArray[np.float64]:
        field, velocity = state.reshape(2, points, 3)
        u, v, turn = np.moveaxis(shifts @ field - field, -1, 0)  # (contact, point), as are stretch and slide
        stretch = n[0, :, None] * u + n[1, :, None] * v
        slide = t[0, :, None] * u + t[1, :, None] * v - (turn + 2.0 * field[:, 2])
        overlap = np.maximum(1.0 - stretch, 0.0)
        root = np.sqrt(overlap)
        pull, shear = (2.0 / 3.0) * (1.0 - overlap * root), kappa * slide * root
        force = np.stack([*(n @ pull + t @ shear), shear.sum(axis=0)], axis=-1)
        return np.concatenate([velocity, force / mass], axis=None)

    frequencies, shapes = modes(k, Contact(poisson_ratio))
    wave = amplitude * np.exp(1j * theta)[:, None] * shapes[branch]
    start = np.concatenate([wave.real, (-1j * frequencies[branch] * wave).real], axis=None)
    # Tighter than the smallest second harmonic (a² ~ 1e-4) times its smallest error (a² ~ 1e-4) by five decades.
    solver = DOP853(rate, 0.0, start, times[-1], rtol=1e-12, atol=1e-14)
    states = []
    while len(states) < len(times):
        solver.step()
        passed = times[len(states) : np.searchsorted(times, solver.t, side="right")]
        if len(passed):
            states += [each[: 3 * points].reshape(points, 3) for each in solver.dense_output()(passed).T]
    harmonics = np.fft.fft(np.array(states), axis=1) / points
    return np.real(harmonics[:, 0] + 2.0 * harmonics[:, 2] * np.exp(2j * phase)) / amplitude


# ---- the paper's direction -----------------------------------------------------------------------


@pytest.mark.parametrize(("xi", "name", "frequency", "transverse", "rotational", "generated"), CLOSED_FORM)
def test_along_y_the_table_of_the_closed_form_is_met(xi, name, frequency, transverse, rotational, generated):
    k = along_y(xi)
    branch = branch_index(name, k, Contact(SILICA))
    frequencies, shapes = modes(k, Contact(SILICA))
    mode = [0, 1, 0] if name == "L" else [-transverse, 0, 1j * rotational]  # p = v, q = −u
    assert abs(frequencies[branch] - frequency) < 1e-12  # the table has 12 decimals
    assert largest_error(shapes[branch], np.array(mode)) < 1e-12
    amplitude = second_harmonic_amplitude(k, branch, Contact(SILICA))
    # 10 decimals of P̃1; at ξ = 2.127 six digits of a number of 4e-5.
    assert largest_error(amplitude, np.array([0, 1j * generated, 0])) < 1e-10


def closed_form(name: str, xi: NDArray, poisson_ratio: float, inertia: float) -> tuple[NDArray, NDArray]:
    """Return Ω and P̃1/i along y from the paper's constants: Ω² from (b−Ĩx)(A−x) = c0², P̃1 = iG/(w̃²−4Ω²)."""
    kappa = Contact(poisson_ratio).kappa
    mu1, mu2 = (3 * kappa + 1) / (kappa + 3), kappa / (kappa + 3)
    alpha, beta = (2 * kappa - 1) / (2 * kappa + 3), 2 * kappa / (2 * kappa + 3)
    if name == "L":
        return np.sin(xi / 2), 0.5 / np.tan(xi / 2)
    a, b, c0 = mu1 * (1 - np.cos(xi)) / 2, 2 * mu2 * (2 + np.cos(xi)), np.sqrt(3) * mu2 * np.sin(xi)
    middle, half = (
        (a * inertia + b) / (2 * inertia),
        np.hypot(a * inertia - b, 2 * c0 * np.sqrt(inertia)) / (2 * inertia),
    )
    x = middle + half if name == "RT" else (a * b - c0**2) / (inertia * (middle + half))
    f_over_q = c0 / (b - inertia * x)
    q = 1 / np.hypot(1, f_over_q)
    g = np.sin(xi) * q * (alpha * np.sin(xi / 2) ** 2 * q - beta / np.sqrt(3) * np.sin(xi) * f_over_q * q)
    return np.sqrt(x), g / (np.sin(xi) ** 2 - 4 * x)


GRID = np.linspace(0.05, 3.1, 62)


@pytest.mark.parametrize(
    ("inertia", "poisson_ratio", "name"),
    latin([0.4, 0.5], [-1.0, -0.5, 0.0, SILICA, 0.35, 0.5], ["L", "TR", "RT"]),
)
def test_along_y_the_closed_form_is_met_for_any_material(name, poisson_ratio, inertia):
    k, contact = along_y(GRID), Contact(poisson_ratio, inertia=inertia)
    branch = branch_index(name, k, contact)
    frequency, generated = closed_form(name, GRID, poisson_ratio, inertia)
    found = np.take_along_axis(modes(k, contact)[0], branch[:, None], axis=-1)[:, 0]
    assert largest_error(found, frequency) < 1e-12
    # Rounding of the detuning is magnified as |P̃1|² close to the resonance.
    amplitude = second_harmonic_amplitude(k, branch, contact)[:, 1]
    assert np.all(np.abs(amplitude - 1j * generated) < 1e-12 * np.maximum(1.0, generated**2))


@pytest.mark.parametrize("name", ["L", "TR", "RT"])
@pytest.mark.parametrize("poisson_ratio", [-0.5, 0.0, SILICA, 0.35])
def test_two_derivations_agree_along_y(name, poisson_ratio):
    ratios, contact = second_harmonic.ratios(poisson_ratio), Contact(poisson_ratio)
    closed = (second_harmonic.generated_amplitude(second_harmonic.mode(name, xi, ratios), ratios) for xi in GRID)
    expected = 1j * np.array(list(closed))
    k = along_y(GRID)
    amplitude = second_harmonic_amplitude(k, branch_index(name, k, contact), contact)[:, 1]
    assert np.all(np.abs(amplitude - expected) < 1e-12 * np.maximum(1.0, np.abs(expected) ** 2))  # as above


def imported_from(module, other: str) -> set[str]:
    """Names that a module takes from another of `granular_analysis`."""
    tree, name = ast.parse(Path(module.__file__).read_text(encoding="utf-8")), f"granular_analysis.{other}"
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module == name]
    return {alias.name for node in nodes for alias in node.names}


def test_neither_derivation_imports_the_other():
    # The closed form gives only what a mode is called and consists of.
    assert imported_from(bloch, "second_harmonic") == {"Mode", "ModeName"}
    for module in (bonds, crystal, mixing):
        assert not imported_from(module, "second_harmonic")
    for other in (
        "theory.bonds",
        "theory.crystal",
        "theory.second_order",
        "theory.bloch",
        "theory.mixing",
    ):
        assert not imported_from(second_harmonic, other)
        assert not imported_from(lattice, other)


def test_the_paper_s_resonance_is_where_the_lower_branch_meets_the_middle_one():
    k = along_y(1.476255486117)  # ξ_res for silica, 12 decimals
    detuning = 2.0 * modes(k, Contact(SILICA))[0][0] - modes(2.0 * k, Contact(SILICA))[0][1]
    assert abs(detuning) < 1e-11


def test_the_paper_s_antiresonance_is_a_zero():
    amplitude = second_harmonic_amplitude(along_y(2.128060480170), 0, Contact(SILICA))
    assert largest_error(amplitude, np.zeros(3)) < 1e-11  # slope 4e-2 times 12 decimals, and rounding


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


AMPLITUDES = [0.02, 0.01, 0.005]


@pytest.mark.parametrize(("branch", "oblique"), latin([0, 1, 2], OBLIQUE))
def test_exact_lattice_approaches_the_second_order_field_as_the_square_of_the_amplitude(oblique, branch):
    k, times, amplitudes = OBLIQUE[oblique], np.linspace(1.0, 20.0, 20), AMPLITUDES[:2]
    site = (3, -2)
    phase = float(np.dot(k, 3 * BONDS[0] - 2 * BONDS[1]))
    errors = [
        relative_error(
            torus_even_part(k, branch, a, times, phase), second_order(k, branch, a, times, Contact(SILICA), site=site)
        )
        for a in amplitudes
    ]
    assert errors[0] < 2e-3
    assert abs(slope(amplitudes, errors) - 2.0) < 0.05


def test_the_mean_rotation_is_real():
    # Harmonic 0 of φ alone: two phases a quarter apart leave harmonic 2 out.
    times = np.linspace(0.5, 20.0, 40)
    k = OBLIQUE["19 degrees"]
    mean = 0.5 * (torus_even_part(k, 0, 0.01, times, 0.0) + torus_even_part(k, 0, 0.01, times, np.pi / 2))
    optical = modes((0.0, 0.0), Contact(SILICA))[0][2]
    expected = (
        0.5
        * nonlinearity(Contact(SILICA), 0.01)
        * mean_rotation(k, 0, Contact(SILICA))
        * (1.0 - np.cos(optical * times))
    )
    assert relative_error(mean[:, 2], expected) < 1e-3  # next order, a² times a number of order one
    assert largest_error(mean[:, :2], np.zeros(2)) < 1e-12  # momentum


def test_without_the_mean_rotation_the_exact_lattice_is_not_met():
    times = np.linspace(0.5, 20.0, 40)
    k = OBLIQUE["19 degrees"]
    field = second_order(k, 0, 0.01, times, Contact(SILICA))
    exact = torus_even_part(k, 0, 0.01, times)
    assert relative_error(exact, field) < 2e-5
    optical = modes((0.0, 0.0), Contact(SILICA))[0][2]
    field[:, 2] -= (
        0.5
        * nonlinearity(Contact(SILICA), 0.01)
        * mean_rotation(k, 0, Contact(SILICA))
        * (1.0 - np.cos(optical * times))
    )
    assert relative_error(exact, field) > 1e-3


def test_the_response_starts_from_rest():
    k = OBLIQUE["66 degrees"]
    field = second_order(k, 0, 0.1, [0.0, 1e-4], Contact(SILICA))
    assert largest_error(field[0], np.zeros(3)) == 0.0
    assert largest_error(field[1], np.zeros(3)) < 1e-8  # τ²/2 times accelerations of order one


def test_on_resonance_the_response_grows_as_time():
    xi = 1.476255486117  # ξ_res for silica
    tau = np.linspace(0.0, 1000.0, 2001)
    w = np.sin(xi)  # Ω_L(2ξ)
    frequency, generated = closed_form("TR", xi + 1e-4, SILICA, 0.4)
    source = generated * (np.sin(xi + 1e-4) ** 2 - 4 * frequency**2)  # G, smooth across the resonance
    response = 1j * tau * np.exp(-1j * w * tau) / (2 * w) - 1j * np.sin(w * tau) / (2 * w**2)
    expected = 0.5 * nonlinearity(Contact(SILICA), 0.1) * np.real(1j * source * response)
    measured = second_order(along_y(xi), 0, 0.1, tau, Contact(SILICA))
    assert relative_error(measured[:, 1], expected) < 1e-3  # G is taken 1e-4 off the resonance
    assert largest_error(measured[:, [0, 2]], np.zeros((2001, 2))) < 1e-12


def test_a_uniform_rotation_has_no_second_harmonic():
    # 2k = 0, where two of the target frequencies are exactly zero.
    field = second_order((0.0, 0.0), 2, 0.1, np.linspace(0, 100, 50), Contact(SILICA))
    assert largest_error(field, np.zeros(3)) < 1e-15


def test_waves_of_the_zone_edge_stay_finite():
    # 2k is a reciprocal vector at M: the lattice as a whole could drift, and is not pushed.
    field = second_order(along_y(np.pi), 1, 0.1, np.linspace(0, 100, 50), Contact(SILICA))
    assert largest_error(field, np.zeros(3)) < 1e-12


# ---- the paper's variables, and LAMMPS's contact geometry -----------------------------------------

# Physics that a scene can call for, in the words of `granular_analysis.theory.contact.Contact`.
CONTACTS = {
    "paper": {},
    "geometry": {"overlap_ratio": 0.01},
    "compression": {"overlap_ratio": 0.05, "prestress": 1.0},
    "incremental": {"overlap_ratio": 0.01, "law": "incremental"},
    "no rotation": {"overlap_ratio": 0.02, "prestress": 0.5, "rotation": False},
    "no shear": {"overlap_ratio": 0.02, "prestress": 1.0, "shear": False},
}
WAVES = [(key, name) for key in CONTACTS for name in ("L", "TR", "RT") if name != "RT" or not key.startswith("no ")]
DEGREES = (17.0, -41.0, 0.0)  # two oblique ones, and along a row


@pytest.mark.parametrize(
    ("contacts", "name"), [(key, name) for key, name in WAVES if not Contact(SILICA, **CONTACTS[key]).departures]
)
@pytest.mark.parametrize("xi", [0.5, 1.3, 2.2])
def test_along_y_modes_and_second_order_are_the_closed_form(contacts, name, xi):
    options = CONTACTS[contacts]
    ratios = Contact(SILICA, **options).closed
    expected = second_harmonic.mode(name, xi, ratios)
    found = bloch.mode(name, xi, 90.0, Contact(SILICA, **options))
    assert (found.name, found.wavenumber, found.direction) == (name, xi, 90.0)
    for component in ("frequency", "p", "q", "f"):
        assert getattr(found, component) == pytest.approx(getattr(expected, component), rel=0, abs=1e-13)  # rounding
    tau = np.linspace(0.0, 30.0, 31)
    # Phase 0.4: what the start leaves in the contacts is there too. Rounding of Ωτ, and of terms a few times larger.
    fields = trajectory(Wave(found, 0.2, Contact(SILICA, **options), 0.4), tau)
    closed = second_harmonic.second_order(expected, ratios, 0.2, tau, phase=0.4)
    assert largest_error(np.array(fields), np.array(closed)) < 1e-12


@pytest.mark.parametrize(
    ("contacts", "name", "direction"),
    latin(WAVES, DEGREES),
)
def test_the_exact_lattice_runs_in_the_modes_of_any_direction(contacts, name, direction):
    options = CONTACTS[contacts]
    mode = bloch.mode(name, 1.1, direction, Contact(SILICA, **options))
    tau = np.linspace(0.0, 10.0, 11)
    order = hierarchy_orders(mode, Contact(SILICA, **options), tau, order=2, rtol=1e-11)[0]
    theta = lattice.torus_phases(order.shape[-1]) - mode.frequency * tau[:, None]
    wave = np.stack([mode.p * np.cos(theta), mode.q * np.cos(theta), -mode.f * np.sin(theta)], axis=1)
    assert largest_error(order, wave) < 1e-9  # 100 rtol


TAU = np.linspace(0.0, 20.0, 21)


@cache
def exact_even_parts(mode, contact):
    """Return the exact lattice at each of AMPLITUDES less its odd part, (T, 3, K): p, q, φ in D0 at five phases."""
    states = lattice.torus_trajectories(mode, AMPLITUDES, contact, TAU, points=15, rtol=5e-13)
    phases = lattice.torus_phases(15)
    turned = states @ lattice.periodic_kernel(phases[:, None] + np.pi - phases, 15)  # a → −a: a phase of π
    return [part[..., ::3] / a for part, a in zip((states + turned) / 2, AMPLITUDES, strict=True)]


@cache
def second_order_parts(k, branch, contact):
    """Return the second order per amplitude, (T, 3, K): (u, v, φ) in D0 at the phases of `exact_even_parts`."""
    fields = [
        second_order(k, branch, AMPLITUDES[0], TAU, contact, phase=phase) for phase in lattice.torus_phases(15)[::3]
    ]
    return np.stack(fields, axis=-1) / AMPLITUDES[0]


def even_parts(name, direction, amplitude, theory=None, **options):
    """Second order and the exact lattice, both less their odd part, (T, 3, K): p, q, φ in D0 at five phases.

    theory : contacts of the second order, those of the lattice unless given; the mode is the lattice's.
    """
    mode = bloch.mode(name, 1.1, direction, Contact(SILICA, **options))
    exact = exact_even_parts(mode, Contact(SILICA, **options))[AMPLITUDES.index(amplitude)]
    k = wavevector_of(1.1, direction)
    linear = {key: value for key, value in options.items() if key != "law"}
    branch = int(branch_index(name, k, Contact(SILICA, **linear)))
    contacts = options if theory is None else theory
    angle = np.radians(direction)
    frame = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return amplitude * frame @ second_order_parts(tuple(k), branch, Contact(SILICA, **contacts)), exact


@pytest.mark.parametrize(
    ("contacts", "name", "direction"),
    latin(WAVES, DEGREES),
)
def test_the_relative_error_of_the_second_harmonic_falls_as_amplitude_squared_for_all_contacts(
    contacts, name, direction
):
    errors = np.array(
        [relative_error(*reversed(even_parts(name, direction, a, **CONTACTS[contacts]))) for a in AMPLITUDES]
    )
    # At most 7 a² (RT under the incremental law, whose own second harmonic is small).
    assert errors[0] < 5e-3
    assert abs(slope(AMPLITUDES, errors) - 2.0) < 0.02


@pytest.mark.parametrize(
    ("left_out", "name"),
    [("overlap_ratio", "L"), ("prestress", "TR"), ("law", "TR"), ("law", "L"), ("overlap_ratio", "RT")],
)
def test_contacts_left_out_are_seen_in_the_second_harmonic(left_out, name):
    options = {"overlap_ratio": 0.05, "prestress": 1.0, "law": "incremental"}
    wrong = {key: value for key, value in options.items() if key != left_out}
    right, off = (relative_error(*even_parts(name, 17.0, 0.005, contacts, **options)) for contacts in (None, wrong))
    assert right < 1e-3
    assert off > 5 * right


def test_doubled_wave_is_what_a_projection_on_2k_shows():
    mode, tau = bloch.mode("TR", 1.1, 17.0, Contact(SILICA, overlap_ratio=0.01)), np.linspace(0.0, 20.0, 21)
    phases = lattice.torus_phases(15)
    exact = lattice.torus_trajectory(Wave(mode, 0.005, Contact(SILICA, overlap_ratio=0.01)), tau, points=15, rtol=1e-12)
    shown = 2.0 * np.mean(exact * np.exp(-2j * phases), axis=-1)
    k = wavevector_of(1.1, 17.0)
    factor = doubled_wave(k, 0, 0.005, tau, Contact(SILICA, overlap_ratio=0.01))
    along = k / np.linalg.norm(k)
    turned = np.stack([factor[:, :2] @ along, factor[:, :2] @ [-along[1], along[0]], factor[:, 2]], axis=-1)
    assert relative_error(shown, turned) < 1e-4  # a² = 2.5e-5 times a number of order one
    later = doubled_wave(k, 0, 0.005, tau, Contact(SILICA, overlap_ratio=0.01), phase=0.3)
    assert largest_error(later, factor * np.exp(0.6j)) < 1e-15


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


def test_where_spheres_do_not_turn_there_are_two_modes():
    frequencies, shapes = modes(OBLIQUE["19 degrees"], Contact(SILICA, rotation=False))
    assert frequencies.shape == (2,)
    assert np.all(shapes[:, 2] == 0)
    with pytest.raises(ValueError, match="name is 'RT'; allowed: L, TR"):
        bloch.mode("RT", 1.0, 17.0, Contact(SILICA, shear=False))
    with pytest.raises(ValueError, match="branch is 2; allowed: 0, 1 "):
        second_harmonic_amplitude(OBLIQUE["19 degrees"], 2, Contact(SILICA, rotation=False))


def test_the_forced_second_harmonic_without_rotation_is_that_of_the_sum_over_modes():
    k = np.array(OBLIQUE["19 degrees"])
    amplitude = second_harmonic_amplitude(k, 0, Contact(SILICA, rotation=False, overlap_ratio=0.02))
    frequency = modes(k, Contact(SILICA, rotation=False, overlap_ratio=0.02))[0][0]
    targets = modes(2 * k, Contact(SILICA, rotation=False, overlap_ratio=0.02))[0]
    tau = np.linspace(0.0, 60.0, 601)
    factor = doubled_wave(k, 0, 0.1, tau, Contact(SILICA, rotation=False, overlap_ratio=0.02))
    # The part of X that turns with 2Ω, beside free waves at 2k and what the start leaves.
    columns = np.exp(-1j * tau[:, None] * np.concatenate([[2 * frequency, 0.0], targets, -targets]))
    forced = np.linalg.lstsq(columns, factor)[0][0]
    assert largest_error(forced, 0.5 * nonlinearity(Contact(SILICA), 0.1) * amplitude) < 1e-12
    assert forced[2] == 0


@pytest.mark.parametrize(
    "function",
    [
        second_harmonic.doubled_frequency,
        second_harmonic.generated_amplitude,
        lambda mode, ratios: second_harmonic.second_harmonic(mode, ratios, 0.2, [1.0]),
        lambda mode, ratios: second_harmonic.second_harmonic_terms(mode, ratios, 0.2, [1.0]),
        lambda mode, ratios: second_harmonic.second_order(mode, ratios, 0.2, [1.0]),
    ],
)
@pytest.mark.parametrize("name", ["L", "TR"])
def test_closed_forms_refuse_a_mode_of_another_direction(function, name):
    mode, ratios = bloch.mode(name, 1.0, 17.0, Contact(SILICA)), second_harmonic.ratios(SILICA)
    with pytest.raises(ValueError, match="direction = 17.0 of the mode is not 90"):
        function(mode, ratios)


# ---- the map -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("branch", "poisson_ratio", "names"), [(0, SILICA, "TR"), (1, SILICA, "L"), (2, SILICA, "RT"), (0, -0.5, "TR/L")]
)
def test_panels_carry_the_names_of_the_paper_s_direction(branch, poisson_ratio, names):
    assert zone_map.names_along_y(branch, Contact(poisson_ratio)) == names


def test_the_map_never_meets_gamma():
    assert np.linalg.norm(zone_map.wave_vectors(zone_map.POINTS), axis=-1).min() > 1e-3


@pytest.mark.parametrize("poisson_ratio", members([-1.0, 0.5], -1.0))  # silica's is drawn below
@pytest.mark.usefixtures("drawn_once")
def test_the_map_is_written_for_any_material(tmp_path, poisson_ratio, monkeypatch):
    monkeypatch.setattr(zone_map, "POINTS", 12)
    target = tmp_path / "new folder" / "map.png"
    zone_map.main(["-o", str(target), "--poisson-ratio", str(poisson_ratio)])
    assert target.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "contact", "title"),
    [
        ([], Contact(SILICA), r"$\nu$ = 0.17, solid spheres"),
        (
            ["--overlap-ratio", "0.05", "--prestress", "0.25"],
            Contact(SILICA, overlap_ratio=0.05, prestress=0.25),
            r"$\nu$ = 0.17, solid spheres, overlap $\Delta_0/2R$ = 0.05, compression bears 25% of the contact force",
        ),
    ],
)
def test_the_map_draws_the_lattice_of_its_options(options, contact, title, monkeypatch):
    monkeypatch.setattr(zone_map, "POINTS", 16)
    drawn = []
    monkeypatch.setattr(zone_map, "save", lambda figure, path: drawn.append(figure))
    zone_map.main(options)
    (legend,) = drawn[0].legends
    assert legend.get_title().get_text() == title
    k = zone_map.wave_vectors(16)
    for branch, panel in enumerate(drawn[0].axes[:3]):
        expected = np.linalg.norm(second_harmonic_amplitude(k, branch, contact), axis=-1)
        # Here ε is divided out before the norm is taken: a rounding or two apart
        np.testing.assert_allclose(panel.images[0].get_array(), expected, rtol=1e-14)


def locations_on_the_page() -> list[tuple[float, float, float, float]]:
    """Return overlap ratio, prestress, resonance and antiresonance of each row of the table below the map."""
    lines = (Path(__file__).parents[2] / "analysis" / "cases" / "map" / "README.md").read_text("utf-8").splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("| `--overlap-ratio`")) + 2
    rows = []
    while lines[first].startswith("|"):
        rows.append(tuple(float(cell) for cell in lines[first].strip("|").split("|")))
        first += 1
    return rows


@pytest.mark.parametrize(("overlap_ratio", "prestress", "resonance", "antiresonance"), locations_on_the_page())
def test_the_map_has_the_resonance_and_the_antiresonance_of_its_page(
    overlap_ratio, prestress, resonance, antiresonance
):
    contact = Contact(SILICA, overlap_ratio=overlap_ratio, prestress=prestress)

    def detuning(xi):
        return 2 * modes(along_y(xi), contact)[0][0] - modes(2 * along_y(xi), contact)[0][1]

    def amplitude(xi):
        return second_harmonic_amplitude(along_y(xi), 0, contact)[1].imag

    half = 5e-4  # half of the last digit shown
    assert detuning(resonance - half) * detuning(resonance + half) < 0
    assert amplitude(antiresonance - half) * amplitude(antiresonance + half) < 0
    # The page's numbers are not those of the paper's lattice, and the closed form agrees where it holds the contact
    if not contact.departures:
        assert second_harmonic.resonance(contact.closed) == pytest.approx(resonance, abs=half)
        assert second_harmonic.antiresonance(contact.closed) == pytest.approx(antiresonance, abs=half)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--poisson-ratio", "0.7"], "poisson_ratio = 0.7 is outside [-1, 0.5]"),
        (["--overlap-ratio", "0.2"], "overlap_ratio = 0.2 is outside [0, 0.1]"),
        (["--overlap-ratio", "0.01", "--prestress", "1.5"], "prestress = 1.5 is outside [0, 1]"),
        (["--prestress", "1"], "--prestress 1 needs --overlap-ratio above 0"),
    ],
)
def test_the_map_refuses_a_lattice_that_is_none(options, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        zone_map.main(options)
    assert said in capsys.readouterr().err


# ---- the helpers and what is refused -------------------------------------------------------------


def test_the_error_measures_see_a_wrong_value():
    right = np.array([1.0, 2.0, 3.0])
    assert relative_error(right, right) == 0.0
    assert relative_error(1.01 * right, right) == pytest.approx(0.01)
    assert largest_error(right - [0.0, 0.5, 0.0], right) == pytest.approx(0.5)
    assert slope([1.0, 2.0, 4.0], [1.0, 2.0, 4.0]) == pytest.approx(1.0)


@pytest.mark.parametrize("xi", [0.802, 1.475])
def test_the_paper_s_printed_prefactor_is_seen_as_wrong(xi):
    amplitude = second_harmonic_amplitude(along_y(xi), 0, Contact(SILICA))[1]
    assert abs(amplitude - 4 / 3 * 1j * closed_form("TR", xi, SILICA, 0.4)[1]) > 1e-2


def test_the_0_over_0_at_gamma_is_refused():
    with pytest.raises(ValueError, match="a rigid motion makes no waves"):
        second_harmonic_amplitude((0.0, 0.0), 0, Contact(SILICA))


def test_arrays_of_wave_vectors_give_what_single_ones_give():
    k = np.array(list(OBLIQUE.values()))
    together = second_harmonic_amplitude(k, [0, 2], Contact(SILICA))
    apart = np.array(
        [second_harmonic_amplitude(k[0], 0, Contact(SILICA)), second_harmonic_amplitude(k[1], 2, Contact(SILICA))]
    )
    assert largest_error(together, apart) < 1e-14


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Contact(0.6).kappa, r"poisson_ratio = 0\.6 is outside \[-1, 0\.5\]"),
        (lambda: modes((1.0, 0.0), Contact(SILICA, inertia=0.0)), r"inertia = 0\.0 must be positive"),
        (lambda: branch_index("T", (1.0, 0.0), Contact(SILICA)), "name is 'T'; allowed: L, TR, RT"),
        (lambda: modes((1.0, 0.0), Contact(SILICA, overlap_ratio=0.2)), r"overlap_ratio = 0\.2 is outside \[0, 0\.1\]"),
        (lambda: modes((1.0, 0.0), Contact(SILICA, prestress=-1.0)), r"prestress = -1\.0 is outside \[0, 1\]"),
        (lambda: wavevector_of(0.0, 90.0), r"wavenumber is 0\.0; allowed: above 0"),
        (lambda: wavevector_of(1.0, np.nan), "direction is nan"),
        (lambda: mean_rotation((1.0, 0.0), 3, Contact(SILICA)), "branch is 3; allowed: 0, 1, 2"),
    ],
)
def test_a_bad_value_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
