"""The honeycomb lattice: its waves by the numbers of their branches, in LAMMPS and beside the theory of any crystal."""

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory.phase_matching import matches
from granular_analysis.theory.scenes import Setting
from granular_analysis.tools.compare import compare
from granular_lmp import Scene, run
from granular_lmp.crystal.lattices import offsets, places
from granular_lmp.crystal.mode import FULL, TURNS
from granular_lmp.crystal.modes import bloch_modes
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.problem import prepare
from granular_lmp.rest.initial_fields import initial_fields
from granular_lmp.rest.linear import mode_of, unit_contacts

HONEYCOMB = Scene.load("tr_periodic").with_values(
    {
        "packing.lattice": "honeycomb",
        "packing.rows": 24,
        "packing.columns": "auto",
        "wave.mode": 3,
        "wave.wavenumber": pi / 3,
        "wave.amplitude": 0.02,
        "time.duration": 30.0,
        "time.timestep": 0.025,
        "time.allow_echo": True,
    }
)


def branch(number: int | str, **changes: Any) -> Scene:
    return HONEYCOMB.with_values({"wave.mode": number} | {key.replace("_", "."): each for key, each in changes.items()})


def phase_error(scene: Scene) -> float:
    """Return the error of a wave by velocity Verlet, (Ωh)²Ωτ/24, at the end of a run."""
    rate = mode_of(scene).frequency
    return (rate * scene.time.step) ** 2 * rate * scene.time.duration / 24


@pytest.mark.parametrize(
    "scene",
    [
        branch(2),
        pytest.param(branch(3), marks=pytest.mark.more),
        branch(6),
        branch(2, wave_direction="x", wave_wavenumber=3.4),
        branch(3, wave_direction=30.0, wave_wavenumber=1.0, packing_columns=24),
    ],
    ids=lambda scene: f"{scene.wave.mode} at {scene.direction:.0f}",
)
def test_a_branch_in_lammps_is_that_of_second_order(scene: Scene, tmp_path: Path) -> None:
    record = run(scene, tmp_path / "run")
    found = compare(record)
    assert found.theory == "crystal-second-order"
    heard = [error for error in found.error.values() if error is not None]
    # Third order leaves a² = 4e-4 of a wave, and the step its phase, twice that of the second harmonic
    assert heard
    assert max(heard) < 4e-4 + 2 * phase_error(scene)
    (p, q, _), _ = Setting(scene.with_values({"wave.phase": 0.02})).signals(record.tau)
    assert np.hypot(record.p - p, record.q - q).max() > 5e-3 * np.hypot(p, q).max()


def test_a_resonance_that_theory_finds_grows_in_lammps(tmp_path: Path) -> None:
    setting = Setting(HONEYCOMB)
    found = matches(setting.crystal(), (0.0, 1.0))
    (there,) = [each for each in found if (each.kind, each.branch, each.target) == ("resonance", 2, 3)]
    xi = there.wavenumber / setting.unit
    scene = branch(3, wave_wavenumber=xi, packing_rows=68, time_duration=60.0)  # 2π·15/68, 2e-4 beside it
    assert prepare(scene).scene.wavenumber == pytest.approx(xi, rel=5e-4)
    lattice, sphere = unit_contacts(scene), scene.sphere
    k = np.array([[0.0, xi], [0.0, 2 * xi]]) / (1.5 * sphere.lattice_constant / sphere.radius)
    (own, double), _ = bloch_modes(lattice, sphere, k, FULL)
    assert 2 * own[2] == pytest.approx(double[3], rel=1e-9)
    record = run(scene, tmp_path / "run")
    early, late = (np.abs(record.p[part]).max() for part in (record.tau < 20, record.tau > 40))
    assert late > 2 * early
    error = compare(record).error["p"]
    assert error is not None
    assert error < 5e-3  # third order: a² times the growth


def test_snapshots_are_compared_with_the_network_also_of_a_packet(tmp_path: Path) -> None:
    packet = {"envelope.length": 5.0, "packing.ends": "periodic", "packing.rows": 64, "output.particles": 3.0}
    found = compare(run(branch(2).with_values(packet), tmp_path / "run"))
    assert found.theory == "network"
    assert found.error["p"] is not None
    assert found.error["p"] < 2 * phase_error(branch(2)) + 1e-5


def test_a_packet_runs_forward_with_its_branch() -> None:
    rows, step = 96, 1.5 * HONEYCOMB.sphere.lattice_constant / HONEYCOMB.sphere.radius
    scene = branch(2).with_values({"envelope.length": 6.0, "packing.ends": "periodic", "packing.rows": rows})
    problem = prepare(scene)
    fields = initial_fields(problem.scene, problem.rest.atoms, problem.wave)
    per_row = 2 * pi / rows * np.arange(8, 25)  # three standard deviations around π/3
    along = np.column_stack([np.zeros_like(per_row), per_row / step])
    (_, y), place = offsets(problem.rest.atoms), places(problem.rest.atoms)
    waves = np.exp(-1j * np.outer(per_row, y))
    u, v = (
        np.hstack([waves[:, place == own] @ (field[place == own] / TURNS) for own in (0, 1)])
        for field in (fields.displacement, fields.velocity)
    )
    found = bloch_modes(unit_contacts(scene), scene.sphere, along, FULL)
    frequency, shape = found[0][:, 1], found[1][:, 1]
    inertia = np.tile([1, 1, 1, *[INERTIA_RATIO] * 3], 2)

    def product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.sum(one.conj() * inertia * other, axis=1)

    # The part of all other branches, and of what runs back: rounding
    share = np.abs(product(shape, u)) ** 2 / np.real(product(shape, shape) * product(u, u))
    assert share == pytest.approx(1, abs=1e-12)
    assert np.abs(v + 1j * frequency[:, None] * u).max() < 1e-12 * np.abs(v).max()


def test_the_squares_of_a_branch_over_its_cell_are_1_and_its_largest_amplitude_is_real() -> None:
    for number in range(2, 7):
        shape = mode_of(branch(number)).shape()
        assert np.sum(np.abs(shape) ** 2) == pytest.approx(1)
        moved = shape[:, :2].ravel()
        largest = moved[np.argmax(np.abs(moved) > np.abs(moved).max() * (1 - 1e-6))]
        assert abs(largest.imag) < 1e-12
        assert abs(largest.real) > 0.04


def test_a_number_may_be_written_as_one_or_as_a_word() -> None:
    assert branch(3) == branch("3")
    assert prepare(branch(3)).wave.mode.words == "a wave of branch 3"


def test_rolling_stiffness_restores_the_lowest_branch() -> None:
    rolled = {"wave.mode": 1, "effects.rolling_stiffness": 100.0, "effects.rolling_friction": 0.1}
    assert prepare(HONEYCOMB.with_values(rolled)).wave.mode.frequency > 0.05


def test_a_square_sheet_has_waves_in_any_direction(tmp_path: Path) -> None:
    square = {"packing.lattice": "square", "wave.mode": "TR", "wave.direction": 30.0, "packing.columns": 24}
    scene = HONEYCOMB.with_values(square)
    found = compare(run(scene, tmp_path / "run"))
    assert found.theory == "crystal-second-order"
    # Third order: 2.6 a² of p, which is the second harmonic alone
    assert max(error for error in found.error.values() if error is not None) < 3 * scene.wave.amplitude**2
