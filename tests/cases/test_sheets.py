"""Any wave on a sheet to second order, against closed forms, the exact force laws and LAMMPS."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from cases.fields import ROW, component, fields_of
from cases.sheets.case import Comparison, carrier, compare, draw, main, relative
from granular_analysis.measure.norms import slope
from granular_analysis.theory.cell import fields
from granular_analysis.theory.contact import Contact
from granular_lmp import Record, Scene, run
from granular_lmp.crystal.lattices import Shape, lattice_constant, packed
from granular_lmp.crystal.sphere import Sphere
from tests.conftest import latin
from tests.polarisations import modes
from tests.sheet import Sheet, evolve
from tests.stand_in import of_first_format

Floats = NDArray[np.float64]

SILICA = 0.17  # Poisson's ratio of the paper's spheres
PERIODIC = Scene.load("tr_periodic")  # 16 rows × 3 columns, TR at ξ = 2π·2/16
TAU = np.array([0.0, 0.7, 3.0, 10.0])


def wavevector(sheet: Sheet, x: int, y: int) -> Floats:
    """The wave vector with x periods across the sheet and y along it, in 1/lattice constant."""
    return 2 * np.pi * np.array([x / sheet.columns, y / (sheet.rows * ROW)])


def plane_wave(sheet: Sheet, k: Floats, branch: int, tau: Floats, phase: float = 0.0) -> tuple[Floats, Floats]:
    """Field and its rate (T, N, 3) of Re U exp i(k·r − Ωτ + phase)."""
    frequencies, shapes = modes(k, sheet.contact)
    turns = np.exp(1j * (sheet.rest @ k + phase - np.multiply.outer(tau, frequencies[[branch]])))[..., None]
    return (shapes[branch] * turns).real, (-1j * frequencies[branch] * shapes[branch] * turns).real


def noise(sheet: Sheet) -> tuple[Floats, Floats]:
    """A field and a rate (N, 3) with all modes in them, of the size of D0."""
    field, rate = np.random.default_rng(1).normal(scale=0.5, size=(2, sheet.rows * sheet.columns, 3))
    return field, rate


# ---- the sheet


@pytest.mark.parametrize(("rows", "columns"), [(4, 3), (6, 4), (10, 5)])
def test_the_sheet_is_that_of_the_deck(rows: int, columns: int) -> None:
    sphere = Sphere(5e-7, 7.3e10, SILICA, 0.063, 2200.0)
    packing = packed(sphere, Shape(rows=rows, columns=columns, ends="periodic"))
    assert Sheet(rows, columns, SILICA).rest == pytest.approx(packing.positions[:, :2] / lattice_constant(sphere))


@pytest.mark.parametrize(("rows", "columns"), [(2, 1), (4, 3), (6, 4)])
def test_neighbours_are_where_the_contacts_point(rows: int, columns: int) -> None:
    sheet, cell = Sheet(rows, columns, SILICA), np.array([columns, rows * ROW])
    for index, angle in zip(sheet.neighbours, np.radians(60.0 * np.arange(6)), strict=True):
        off = sheet.rest[index] - sheet.rest - [np.cos(angle), np.sin(angle)]
        assert off == pytest.approx(cell * np.round(off / cell), abs=1e-12)  # rounding


@pytest.mark.parametrize(("rows", "columns"), [(7, 3), (0, 3), (4, 0)])
def test_rows_that_do_not_close_are_refused(rows: int, columns: int) -> None:
    with pytest.raises(ValueError, match=f"{rows} rows x {columns} columns"):
        Sheet(rows, columns, SILICA)


@pytest.mark.parametrize("columns", [1, 3, 4, 7])
def test_a_field_is_the_sum_of_its_waves(columns: int) -> None:
    sheet = Sheet(6, columns, SILICA)
    field, _ = noise(sheet)
    assert sheet.field(sheet.waves(field)) == pytest.approx(field, abs=1e-13)  # rounding


# ---- first order


@pytest.mark.parametrize(
    ("columns", "x", "y", "branch"),
    latin([(3, 0, 1), (6, 1, 2), (6, 3, 1), (7, -2, 3)], [0, 1, 2]),
)
def test_a_plane_wave_stays_one_to_first_order(columns: int, x: int, y: int, branch: int) -> None:
    sheet = Sheet(8, columns, SILICA)
    field, rate = plane_wave(sheet, wavevector(sheet, x, y), branch, TAU)
    linear, _ = evolve(sheet, field[0], rate[0], TAU)
    assert linear == pytest.approx(field, abs=1e-12)  # rounding


def test_a_sheet_that_drifts_goes_on_to_first_order() -> None:
    sheet = Sheet(4, 3, SILICA)
    linear, second = evolve(sheet, np.zeros((12, 3)), np.tile([1.0, -2.0, 0.0], (12, 1)), TAU)
    assert linear == pytest.approx(TAU[:, None, None] * np.array([1.0, -2.0, 0.0]) * np.ones((12, 1)), abs=1e-12)
    assert np.abs(second).max() < 1e-12  # rounding: no contact is strained


def test_the_time_step_of_a_run_is_in_the_first_order_exactly() -> None:
    sheet, step = Sheet(6, 4, SILICA), 0.25
    field, rate = noise(sheet)
    expected, velocity, accelerate = field, rate, accelerations(sheet, linear_law)
    for _ in range(40):
        velocity = velocity + step / 2 * accelerate(expected)
        expected = expected + step * velocity
        velocity = velocity + step / 2 * accelerate(expected)
    stepped, exact = (evolve(sheet, field, rate, [0.0, 10.0], timestep=each)[0][-1] for each in (step, 0.0))
    assert stepped == pytest.approx(expected, abs=1e-11)  # rounding of 40 steps
    assert relative(exact, expected) > 0.01  # so that the test can fail


# ---- second order, against closed forms


def test_the_times_between_make_no_difference() -> None:
    sheet = Sheet(6, 4, SILICA)
    field, rate = noise(sheet)
    few, many = (evolve(sheet, field, rate, tau)[1][-1] for tau in ([5.0, 12.0], np.linspace(5.0, 12.0, 10)))
    assert few == pytest.approx(many, abs=1e-10)  # rounding


# ---- second order, against the exact force laws, each contact written out


def full_law(stretch: Floats, slide: Floats, kappa: float) -> tuple[Floats, Floats]:
    """Hertz and Mindlin forces over k1Δ0, displacements in Δ0."""
    overlap = np.maximum(1 - stretch, 0)
    return 2 / 3 * (1 - overlap**1.5), kappa * slide * overlap**0.5


def linear_law(stretch: Floats, slide: Floats, kappa: float) -> tuple[Floats, Floats]:
    return stretch, kappa * slide


def accelerations(
    sheet: Sheet, law: Callable[[Floats, Floats, float], tuple[Floats, Floats]]
) -> Callable[[Floats], Floats]:
    """Acceleration (N, 3) of a field (N, 3), from pairs of spheres that are found by their distance."""
    kappa, cell = Contact(sheet.poisson_ratio).kappa, np.array([sheet.columns, sheet.rows * ROW])
    apart = sheet.rest[None] - sheet.rest[:, None]
    apart -= cell * np.round(apart / cell)
    here, there = np.nonzero(np.abs(np.linalg.norm(apart, axis=-1) - 1) < 1e-9)
    assert len(here) == 6 * len(sheet.rest)
    normal = apart[here, there]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])

    def accelerate(field: Floats) -> Floats:
        difference = field[there, :2] - field[here, :2]
        slide = np.sum(difference * tangent, axis=1) - field[here, 2] - field[there, 2]
        pull, shear = law(np.sum(difference * normal, axis=1), slide, kappa)
        force = np.zeros_like(field)
        np.add.at(force, here, np.column_stack([normal * pull[:, None] + tangent * shear[:, None], shear]))
        return force / (2 * (kappa + 3)) / sheet.contact.masses

    return accelerate


def integrated(sheet: Sheet, amplitude: float, field: Floats, rate: Floats, tau: Floats) -> Floats:
    """The exact lattice started from a field (N, 3) in D0 = aΔ0, (T, N, 3) in D0."""
    accelerate = accelerations(sheet, full_law)

    def slopes(_: float, state: Floats) -> Floats:
        position, velocity = state.reshape(2, -1, 3)
        return np.concatenate([velocity.ravel(), accelerate(position).ravel()])

    start = amplitude * np.concatenate([field.ravel(), rate.ravel()])
    whole = (float(tau[0]), float(tau[-1]))
    # Off by 1e-9 of a, where the second order leaves 2e-5 or more
    done = solve_ivp(slopes, whole, start, method="DOP853", t_eval=tau, rtol=1e-9, atol=1e-11 * amplitude)
    states: Floats = done.y.T.reshape(len(tau), 2, -1, 3)
    return states[:, 0] / amplitude


AMPLITUDES = [0.01, 0.02, 0.04]


@pytest.fixture(scope="module")
def witness() -> dict[str, list[float]]:
    """Relative errors of y1, of y1 + a y2 and of y1 − a y2 for noise on all modes, an amplitude each."""
    sheet, tau = Sheet(6, 4, SILICA), np.array([0.0, 3.0, 8.0])
    field, rate = noise(sheet)
    linear, second = evolve(sheet, field, rate, tau)
    errors: dict[str, list[float]] = {"y1": [], "y1 + a y2": [], "y1 - a y2": []}
    for amplitude in AMPLITUDES:
        exact = integrated(sheet, amplitude, field, rate, tau)
        for name, sign in zip(errors, (0, 1, -1), strict=True):
            errors[name].append(float(relative(linear + sign * amplitude * second, exact)))
    return errors


def test_linear_theory_is_wrong_by_the_first_power_of_the_amplitude(witness: dict[str, list[float]]) -> None:
    assert slope(AMPLITUDES, witness["y1"]) == pytest.approx(1, abs=0.05)


def test_second_order_is_wrong_by_the_second_power_of_the_amplitude(witness: dict[str, list[float]]) -> None:
    assert slope(AMPLITUDES, witness["y1 + a y2"]) == pytest.approx(2, abs=0.05)


def test_a_wrong_sign_of_the_second_order_is_noticed(witness: dict[str, list[float]]) -> None:
    assert slope(AMPLITUDES, witness["y1 - a y2"]) == pytest.approx(1, abs=0.05)
    assert np.array(witness["y1 - a y2"]) == pytest.approx(2 * np.array(witness["y1"]), rel=0.05)


# ---- what is wrong is said


@pytest.mark.parametrize(
    ("size", "tau", "timestep", "said"),
    [
        (33, [0.0, 1.0], 0.0, r"displacement and velocity are \(\(33,\), \(36,\)\); both must be \(36,\)"),
        (36, [0.0, -1.0], 0.0, "time = .* must be one or more times since the start"),
        (36, [], 0.0, "time = .* must be one or more times since the start"),
        (36, [0.0, 1.0], 1.2, r"timestep = 1\.2: must be below 2/Omega_max"),
    ],
)
def test_what_cannot_be_evolved_is_refused(size: int, tau: list[float], timestep: float, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        fields(Sheet(4, 3, SILICA).cell, np.zeros(size), np.zeros(36), tau, timestep)


def recorded(changes: dict[str, Any] | None = None, effects: dict[str, Any] | None = None) -> Record:
    """A record of nothing but its scene and effects."""
    return Record.of_centre(*np.zeros((4, 2)), PERIODIC.with_values(changes or {}), {"effects": effects or {}})


@pytest.mark.parametrize(
    ("changes", "effects", "said"),
    [
        ({"packing.ends": "fixed", "packing.rows": 201}, {}, "packing.ends = 'fixed'"),
        ({}, {"shear": {"on": False}}, "effects.shear = false"),
        ({}, {"rotation": {"on": False}}, "effects.rotation = false"),
        ({}, {"sliding": {"on": True}}, "effects.sliding"),
        ({}, {"contact_opening": {"on": True, "called_for": True}}, "effects.contact_opening"),
        ({"effects.viscosity": 1e-9}, {}, "effects.damping"),
        ({"disorder.density": 0.1}, {}, "disorder.density"),
    ],
)
def test_physics_that_the_theory_leaves_out_is_refused(
    changes: dict[str, Any], effects: dict[str, Any], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        compare(recorded(changes, effects))


def test_a_run_without_snapshots_is_refused(tmp_path: Path) -> None:
    run(PERIODIC.with_values({"time.duration": 1.0}), tmp_path / "run")
    with pytest.raises(SystemExit, match=re.escape("output.particles")):
        main([str(tmp_path / "run"), "-o", str(tmp_path / "figure.png")])


@pytest.mark.parametrize(
    ("changes", "said"),
    [({"effects.tracking": False}, "angles are not in the snapshots"), ({"output.particles": 2.0}, "1 snapshots")],
)
def test_snapshots_that_do_not_tell_all_are_refused(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    scene = PERIODIC.with_values({"time.duration": 2.0, "output.particles": 1.0} | changes)
    record = run(scene, tmp_path / "run")
    if "1 snapshots" in said:
        dump = of_first_format(tmp_path / "run") / "dump.particles"  # which no digest protects
        text = dump.read_text()
        dump.write_text(text[: text.index("ITEM: TIMESTEP", 1)])
    with pytest.raises(ValueError, match=said):
        compare(record)


# ---- wave numbers


def test_a_component_is_the_amplitude_of_its_wave() -> None:
    sheet = Sheet(8, 6, SILICA)
    k, other = wavevector(sheet, 1, 2), wavevector(sheet, 2, 1)
    amplitude = np.array([1.0 - 2.0j, 0.5j, 0.3])
    field = (np.exp(1j * sheet.rest @ k)[:, None] * amplitude).real
    assert component(field, sheet.rest, k) == pytest.approx(amplitude)
    assert component(np.stack([field, 2 * field]), sheet.rest, other) == pytest.approx(np.zeros((2, 3)), abs=1e-12)


@pytest.mark.parametrize(("x", "y"), [(0, 2), (1, 2), (-2, 1), (2, 0)])
def test_the_carrier_is_the_strongest_wave(x: int, y: int) -> None:
    sheet = Sheet(12, 8, SILICA)
    k = wavevector(sheet, x, y)
    field, rate = plane_wave(sheet, k, 0, TAU)
    weak, weak_rate = noise(sheet)
    found = carrier(sheet, field[0] + 0.1 * weak, rate[0] + 0.1 * weak_rate)
    assert found == pytest.approx(k)


def test_the_second_order_of_an_oblique_wave_is_around_0_and_2k() -> None:
    sheet = Sheet(12, 8, SILICA)
    k = wavevector(sheet, 1, 2)
    field, rate = plane_wave(sheet, k, 0, TAU)
    linear, second = evolve(sheet, field[0], rate[0], TAU)
    comparison = Comparison(sheet, 1.0, k, TAU, linear + second, linear, second)
    parts = [comparison.around(second, multiple) for multiple in range(4)]
    assert sum(parts) == pytest.approx(second, abs=1e-12)
    assert parts[0] + parts[2] == pytest.approx(second, abs=1e-12)
    assert np.abs(parts[0]).max() > 1e-4  # the spheres turn
    assert np.abs(parts[2]).max() > 1e-4
    assert comparison.around(linear, 1) == pytest.approx(linear, abs=1e-12)


# ---- LAMMPS


SHORT = {"wave.amplitude": 0.02, "time.duration": 20.0, "output.particles": 1.0}


@pytest.fixture(scope="module")
def lammps(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """A TR wave on 16 rows × 3 columns, snapshots to τ = 20."""
    return run(PERIODIC.with_values(SHORT), tmp_path_factory.mktemp("sheet") / "run")


@pytest.fixture(scope="module")
def compared(lammps: Record) -> Comparison:
    return compare(lammps)


def test_lammps_makes_the_second_order_of_theory(compared: Comparison) -> None:
    c = compared
    # Fourth order is of order a² = 4e-4 of the second harmonic, and so is O(Δτ²) of y2, (2Ω·0.05)²/8; the third order,
    # at the fundamental, is 1.6 % of the field at this amplitude and time, 4e-6 of the wave
    assert relative(c.around(c.second, 2), c.around(c.beyond, 2)) < 4e-4
    assert relative(c.second, c.beyond) < 0.02
    assert relative(c.linear + c.second, c.run) < 6e-6
    assert relative(-c.second, c.beyond) == pytest.approx(2, abs=0.04)


@pytest.mark.parametrize(
    ("other", "bound"),
    # O(Δτ²) and a²; an incremental law turns its force with the tangent of the step's end: 6.5e-3 at twice the step,
    # 1.6e-3 at half of it
    [
        ({"effects.shear_law": "incremental"}, 4e-3),
        ({"sphere.adhesion_law": "jkr"}, 2e-4),
        ({"packing.contact_force": 1e-6}, 2e-4),
    ],
    ids=["incremental", "jkr", "compressed"],
)
def test_lammps_makes_the_second_order_of_other_contacts(
    other: dict[str, Any], bound: float, compared: Comparison, tmp_path: Path
) -> None:
    c = compare(run(PERIODIC.with_values(SHORT | other), tmp_path / "run"))
    assert relative(c.around(c.second, 2), c.around(c.beyond, 2)) < bound
    assert relative(c.around(compared.second, 2), c.around(c.beyond, 2)) > 10 * bound  # of the usual contacts


def test_a_beam_in_lammps_has_the_static_field_and_the_second_harmonic_of_theory(tmp_path: Path) -> None:
    shape = {"packing.columns": 24, "envelope.width": 4.0, "wave.amplitude": 0.02}
    record = run(PERIODIC.with_values(shape | {"time.duration": 20.0, "output.particles": 2.0}), tmp_path / "run")
    c = compare(record)
    assert np.linalg.norm(c.around(c.second, 0)) > np.linalg.norm(c.around(c.second, 2)) > 0.005
    # Fourth order, a² = 4e-4, times numbers below 1. Without the geometry of contacts: 3.8η and 1.8η
    assert relative(c.around(c.second, 0), c.around(c.beyond, 0)) < 1e-4
    assert relative(c.around(c.second, 2), c.around(c.beyond, 2)) < 2e-4
    flat = Sheet(c.sheet.rows, c.sheet.columns, SILICA)
    snapshots = record.snapshots()
    start = fields_of(snapshots)[0], fields_of(snapshots, "velocity", "spin")[0]
    second = 0.02 * evolve(flat, *start, c.tau, timestep=record.scene.time.step)[1]
    assert relative(c.around(second, 0), c.around(c.beyond, 0)) > 5e-4
    assert relative(c.linear + c.second, c.run) < 5e-6


def test_the_time_step_of_the_run_has_to_be_in_the_theory(lammps: Record, compared: Comparison) -> None:
    c = compared
    snapshots = lammps.snapshots()
    rate = np.concatenate([snapshots[0].velocity, snapshots[0].spin[:, None]], axis=1)
    sheet = Sheet(c.sheet.rows, c.sheet.columns, SILICA, lammps.scene.sphere.overlap_ratio)
    exact, _ = evolve(sheet, c.run[0], rate, c.tau)
    assert relative(c.second, c.run - exact) > 0.04


@pytest.mark.usefixtures("drawn_once")
def test_the_script_draws(lammps: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(lammps.folder), "-o", str(tmp_path / "figure.png")]) == 0
    assert (tmp_path / "figure.png").stat().st_size > 0
    said = capsys.readouterr().out
    assert "16 rows x 3 columns, a = 0.02, 21 snapshots to tau = 20, carrier k = (0, 0.9069)" in said
    assert re.search(r"around 2k +\d\.\d+e-04 +\d\.\d+e-04 +\d\.\d+e-0[345]\n", said)


@pytest.mark.usefixtures("drawn_once")
def test_a_sheet_at_rest_is_drawn_too() -> None:
    sheet = Sheet(4, 3, SILICA)
    still = np.zeros((2, 12, 3))
    c = Comparison(sheet, 0.1, np.zeros(2), np.array([0.0, 1.0]), still, still, still)
    draw(replace(c, run=still + 1e-3)).canvas.draw()
