"""The linear answer of a finite crystal to sources: against Bloch sums, against itself, and what it refuses."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from granular_analysis.theory import signals
from granular_analysis.theory.contact import Contact
from tests.linear_answer import COMPONENTS, Crystal, Load, response
from tests.manual import Measure, Mutant, off, verifies
from tests.polarisations import modes

pytestmark = pytest.mark.rounding

CONTACT = Contact(0.17, overlap_ratio=0.01)
ROWS, COLUMNS = 6, 5
TAU = np.linspace(0.0, 9.0, 10)
PUSH = signals.burst(0.9, 1.0)


def sheet(rows: int = ROWS, columns: int = COLUMNS, *, walls: bool = False, contact: Contact = CONTACT) -> Crystal:
    """A hexagonal sheet, periodic, or between held rows."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    position = np.column_stack([column + 0.5 * (row % 2), row * np.sqrt(0.75)])
    held = walls & ((row == 0) | (row == rows - 1))
    return Crystal(position, (float(columns), np.inf if walls else rows * np.sqrt(0.75)), contact, held)


@verifies(
    "Response of a linear sheet to a point force",
    reference="other method: the sum over its Bloch waves, trapezoidal in time",
    tolerance=1e-05,
    reason="the trapezoidal rule, (ωh)²/12 with h = 9/2000",
    mutant=Mutant(
        "tests/linear_answer.py",
        "(self.contact.shear_stiffness, np.hstack([-tangent, -one, tangent, -one]))",
        "(self.contact.shear_stiffness, np.hstack([-tangent, -one, tangent, one]))",
    ),
)
def test_a_point_force_is_the_bloch_sum(measured: Measure) -> None:
    crystal = sheet()
    found, _ = response(crystal, [Load([7], "x", PUSH)], TAU)
    # Wave vectors of the cell: k·a1 = 2π i/5, k·(row pair) = 2π j/3, one for each sphere of the sheet
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)))
    k = 2 * np.pi * np.column_stack([i / COLUMNS, j / (ROWS * np.sqrt(0.75))])
    frequency, shapes = modes(k, CONTACT)
    mass = crystal.mass[:3]
    weight = shapes[..., 0].conj() / np.sum(np.abs(shapes) ** 2 * mass, axis=-1) * crystal.strength("x")
    grid = np.linspace(0, 1, 2001)
    expected = np.zeros((len(TAU), ROWS * COLUMNS, 3), dtype=complex)
    waves = np.exp(1j * (crystal.position - crystal.position[7]) @ k.T)
    for place, tau in enumerate(TAU[1:], 1):
        late = tau * (1 - grid)
        kernel = late * np.sinc(np.multiply.outer(frequency, late) / np.pi)  # sin(ωt)/ω, also at Γ
        swing = np.trapezoid(kernel * PUSH(tau * grid), tau * grid, axis=-1)
        expected[place] = waves @ ((swing * weight)[..., None] * shapes).sum(axis=1) / (ROWS * COLUMNS)
    # 1e-5: the trapezoidal rule of this test, (ωh)²/12 with h = 9/2000
    measured(off(found, expected.real))
    assert np.abs(found).max() > 0.1


@pytest.mark.parametrize(
    ("load", "walls"),
    [
        (Load([7, 8], "torque", PUSH), False),
        (Load([12], "y", PUSH, moves=True), True),
        (Load(range(5), "x", signals.tone(0.7, 5.0, phase=0.4, delay=1.0), moves=True), True),
    ],
)
def test_the_sum_over_modes_solves_the_equations_of_motion(load: Load, walls: bool) -> None:
    crystal = sheet(walls=walls)
    found, speed = response(crystal, [load], TAU)
    count = crystal.mass.size
    freedoms = 3 * np.asarray(load.spheres) + COMPONENTS[load.axis]
    stuck = np.repeat(crystal.held, 3)
    if load.moves:
        stuck[(3 * np.asarray(load.spheres)[:, None] + np.arange(3)).ravel()] = True
    push = np.isin(np.arange(count), freedoms)

    def rate(tau: float, state: np.ndarray) -> np.ndarray:
        u, v = state.reshape(2, -1).copy()
        now = load.signal(np.array([tau]))[0]
        force = np.zeros(count)
        if load.moves:
            u[freedoms] = now
        else:
            # A torque g k1 D0 R makes Ĩ φ″ = g/(2(κ+3)), and M holds Ĩ/(1−η)
            force = now * push / (2 * (CONTACT.kappa + 3)) / (1 - CONTACT.overlap_ratio)
        change = (force - crystal.stiffness @ u) / crystal.mass
        return np.concatenate([np.where(stuck, 0, v), np.where(stuck, 0, change)])

    solution = solve_ivp(rate, (0, TAU[-1]), np.zeros(2 * count), t_eval=TAU, rtol=1e-9, atol=1e-11, max_step=0.5)
    field, velocity = solution.y.reshape(2, count, -1)
    free = ~stuck
    flat, flat_speed = found.reshape(len(TAU), -1), speed.reshape(len(TAU), -1)
    # The integrator's own error, rtol times some hundred steps
    np.testing.assert_allclose(flat[:, free], field.T[:, free], atol=1e-6)
    np.testing.assert_allclose(flat_speed[:, free], velocity.T[:, free], atol=1e-6)
    if load.moves:
        np.testing.assert_allclose(flat[:, freedoms], np.repeat(load.signal(TAU)[:, None], len(freedoms), 1))


@verifies(
    "Energy that a torque brings into a linear sheet",
    reference="analytic: the integral of its power",
    tolerance=0.0001,
    reason="the trapezoidal rule, h²ω²/12 with h = 0.01",
    mutant=Mutant(
        "tests/linear_answer.py",
        "0.5 * np.asarray(v**2 @ self.mass +",
        "0.5 * np.asarray(v**2 @ (1.01 * self.mass) +",
    ),
)
def test_the_power_of_a_force_is_the_change_of_energy(measured: Measure) -> None:
    crystal, tau = sheet(), np.linspace(0.0, 9.0, 901)
    field, velocity = response(crystal, [Load([7], "torque", PUSH)], tau)
    power = crystal.strength("torque") * PUSH(tau) * velocity[:, 7, 2]
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(tau))])
    energy = crystal.energy(field, velocity)
    measured(off(work, energy))
    assert np.abs(1.01 * work - energy).max() > 5e-3 * energy.max()  # one percent more power is seen


@pytest.mark.parametrize("sweep", [0.4, 1.0, 3.0])
def test_a_chirp_goes_from_one_frequency_to_the_other(sweep: float) -> None:
    tau, duration = np.linspace(0.0, 200.0, 20001), 4 * np.pi * 20 / (1.3 * (1 + sweep))
    quadratures = [signals.chirp(1.3, sweep, 20.0, phase, delay=2.0)(tau) for phase in (0.0, np.pi / 2)]
    share = (tau - 2.0) / duration
    inside = (share > 0.02) & (share < 0.98)  # where the window is above 4e-3
    pitch = np.gradient(np.unwrap(np.arctan2(*quadratures[::-1])), tau)
    np.testing.assert_allclose(pitch[inside], 1.3 * (1 + (sweep - 1) * share[inside]), rtol=1e-3)  # central differences
    window = np.hypot(*quadratures)
    np.testing.assert_allclose(window[inside], np.sin(np.pi * share[inside]) ** 2, atol=1e-12)
    assert not window[(share < 0) | (share > 1 + 1e-12)].max() > 1e-20
    if sweep == 1.0:
        np.testing.assert_allclose(signals.burst(1.3, 20.0, delay=2.0)(tau), quadratures[0], atol=1e-12)


def test_a_ricker_wavelet_and_a_step_are_what_they_are_called() -> None:
    tau = np.linspace(0, 40, 4001)
    wavelet = signals.ricker(1.3, delay=2.0)(tau)
    assert tau[np.argmax(wavelet)] == pytest.approx(2.0 + 12 / 1.3, abs=0.01)  # the spacing of the times
    padded = np.abs(np.fft.rfft(wavelet, 1 << 16))
    at = 2 * np.pi * np.fft.rfftfreq(1 << 16, 0.01)[np.argmax(padded)]
    assert at == pytest.approx(1.3, abs=0.01)  # the spacing of the frequencies
    assert signals.step(5.0, delay=1.0)(np.array([0.0, 3.5, 9.0])) == pytest.approx([0.0, 0.5, 1.0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Load([0], "z", PUSH), "axis = 'z': must be one of x, y, torque"),
        (lambda: Load([0], "torque", PUSH, moves=True), "axis = 'torque': must be one of x, y"),
        (lambda: sheet(contact=Contact(0.17, rotation=False)), "contact.rotation = False: must be True"),
        (lambda: sheet(contact=Contact(0.17, viscosity=0.1)), "must be without dashpots"),
        (lambda: response(sheet(), [], [1.0, 0.5]), "ascending and not negative"),
        (
            lambda: response(sheet(), [Load([1], "x", PUSH, moves=True), Load([1], "y", PUSH, moves=True)], TAU),
            "a sphere is moved twice",
        ),
    ],
)
def test_what_cannot_be_answered_is_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
