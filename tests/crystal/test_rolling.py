"""Rolling and twisting resistance: in the deck, in the linear problem, refused where no theory holds them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.tools.compare import main as compare
from granular_lmp import build, run
from granular_lmp.accuracy.estimates import richardson
from granular_lmp.crystal.contacts import find_contacts
from granular_lmp.crystal.lattices import Shape, packed, unit_lattice
from granular_lmp.crystal.mode import Physics
from granular_lmp.crystal.modes import bloch_modes, highest_frequency
from granular_lmp.crystal.stability import frequency_bound
from granular_lmp.problem import prepare
from tests.conftest import PAPER
from tests.manual import Measure, Mutant, differing, verifies

K1 = PAPER.sphere.normal_stiffness
CELL = PAPER.with_values(
    {
        "packing.rows": 8,
        "packing.ends": "periodic",
        "wave.wavenumber": np.pi / 4,
        "wave.mode": "RT",
        "wave.amplitude": 1e-2,
        "time.duration": 40.0,
        "time.timestep": 0.02,
    }
)
ROLLING = {"effects.rolling_stiffness": 5 * K1, "effects.rolling_friction": 10.0}


@verifies(
    "Rolling resistance: an RT wave in LAMMPS, step extrapolated",
    reference="analytic: the mode with rolling, τ ≤ 40",
    tolerance=0.002,
    reason="second order adds nothing to q, the third a² = 1e-4, over 40 τ",
    mutant=Mutant(
        "granular_lmp/crystal/bloch.py",
        "return physics.rolling / (1 - contacts.overlap / contacts.radii)",
        "return 1.01 * physics.rolling / (1 - contacts.overlap / contacts.radii)",
    ),
)
def test_a_run_swings_with_the_frequency_of_the_modes_with_rolling(tmp_path: Path, measured: Measure) -> None:
    scene = CELL.with_values(ROLLING)
    coarse = run(scene, tmp_path / "coarse")
    fine = run(scene.with_values({"time.timestep": 0.01}), tmp_path / "fine")
    record, mode = richardson(coarse, fine), prepare(scene).wave.mode
    free = prepare(CELL).wave.mode
    assert mode.frequency > 1.05 * free.frequency
    # q = Q cos Ωτ at the centre; second order adds nothing to q, third order a² = 1e-4 of it
    error = np.abs(record.q - mode.q * np.cos(mode.frequency * record.tau)).max() / mode.q
    measured(error)
    wrong = np.abs(record.q - mode.q * np.cos(free.frequency * record.tau)).max() / mode.q
    assert wrong > 0.5


def test_rolling_is_in_the_deck_and_free_rolling_is_not() -> None:
    text = build(CELL.with_values(ROLLING)).input_text
    assert " rolling sds " in text
    assert "rolling" not in build(CELL).input_text


def test_rolling_costs_nothing_where_all_spheres_turn_alike() -> None:
    sphere = PAPER.sphere
    lattice = unit_lattice(sphere)
    stiff = Physics(rolling=10 * K1)
    at_rest, _ = bloch_modes(lattice, sphere, np.zeros(2), stiff)
    free, _ = bloch_modes(lattice, sphere, np.zeros(2))
    # A frequency of order 1; roundings of 1e-16 of its square
    assert at_rest[-1] == pytest.approx(free[-1], rel=1e-12)
    moving = np.array([0.0, 1.0])
    assert bloch_modes(lattice, sphere, moving, stiff)[0][-1] > bloch_modes(lattice, sphere, moving)[0][-1] + 0.1


def test_the_bound_of_a_sheet_holds_its_rolling_modes() -> None:
    sphere, stiff = PAPER.sphere, Physics(rolling=20 * K1)
    sheet = find_contacts(packed(sphere, Shape(12, 12, "periodic")), [sphere], 0.0)
    top = highest_frequency(unit_lattice(sphere), sphere, stiff)
    assert top > 1.2 * highest_frequency(unit_lattice(sphere), sphere)
    # The zone's edge is sampled at 120 points, and the bound is 1e-3 above the top of the sheet
    assert frequency_bound(sheet, sphere, stiff) == pytest.approx(top, rel=5e-3)


def test_no_rolling_mode_of_soft_spheres_lies_above_the_bound() -> None:
    # The overlap is 0.03 of the diameter, which the torque arm of a shear force loses and that of a roll does not
    sphere = replace(PAPER.sphere, youngs_modulus=5e7)
    assert sphere.overlap_ratio > 0.03
    stiff = Physics(rolling=20 * sphere.normal_stiffness)
    sheet = find_contacts(packed(sphere, Shape(8, 8, "periodic")), [sphere], 0.0)
    frequencies, _ = bloch_modes(sheet, sphere, np.zeros(2), stiff)
    # Roundings of 1e-16 of a squared frequency; the arm of the roll makes 0.015
    assert frequency_bound(sheet, sphere, stiff) > frequencies.max() * (1 - 1e-12)


@verifies(
    "Twisting resistance in the plane: bytes of a record that it changes",
    reference="analytic: nothing twists where all spheres turn about one axis",
    tolerance=0.0,
    reason="a torque of 0 changes no bit",
    mutant=Mutant(
        "granular_lmp/lammps/contact.py",
        '{"rolling": "none", "twisting": "none"}',
        '{"rolling": "sds 1e5 0.0 1.0", "twisting": "none"}',
    ),
)
def test_twisting_changes_no_byte_of_a_record_in_the_plane(tmp_path: Path, measured: Measure) -> None:
    scene = CELL.with_values({"time.duration": 10.0})
    run(scene, tmp_path / "free")
    run(scene.with_values({"effects.twisting": True}), tmp_path / "twisting")
    free, twisting = ((tmp_path / name / "dump.centre").read_bytes() for name in ("free", "twisting"))
    assert "twisting marshall" in next((tmp_path / "twisting").glob("in.*")).read_text()
    measured(differing(free, twisting))


def test_no_theory_holds_rolling_and_compare_says_so(tmp_path: Path) -> None:
    run(CELL.with_values(ROLLING | {"time.duration": 5.0}), tmp_path / "run")
    with pytest.raises(SystemExit, match="no theory here holds effects.rolling"):
        compare([str(tmp_path / "run")])
