"""The lattices of ``benchmarks/unittest``, in the format of LAMMPS's ``unittest/granular``, beside their decks."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.lattice_cases import (
    CASES,
    EPSILON,
    FOLDER,
    RECORDED,
    SEGMENTS,
    commands,
    departure,
    ran,
    read,
    scene_of,
)
from granular_lmp import build, run
from granular_lmp.problem import prepare
from tests.lammps.test_deck import differing_lines
from tests.manual import Measure, Mutant, off, verifies


@verifies(
    "Five lattices in the format of LAMMPS's unittest/granular: each sphere after 40 steps, in D0",
    reference="other run: the scene itself, in its run folder",
    tolerance=1e-9,
    reason="both round places of 3e3 nm, to 5e-13 nm or 2e-11 of D0",
    mutant=Mutant("granular_lmp/lammps/start.py", "v_D0*d_v{axis}/v_t0", "1.001*v_D0*d_v{axis}/v_t0"),
)
@pytest.mark.parametrize("name", CASES)
def test_a_lattice_case_is_the_run_of_its_scene(name: str, tmp_path: Path, measured: Measure) -> None:
    scene = scene_of(name)
    case, found = read(FOLDER / f"{name}.yaml")
    snapshots = run(scene, tmp_path / "run").snapshots()
    unit, axes = scene.displacement_amplitude * 1e9, snapshots.stack("displacement").shape[-1]
    rest = prepare(scene).rest.atoms.positions * scene.sphere.radius * 1e9
    moved = (found["run_pos"] - rest)[..., :axes] / unit
    measured(off(moved, snapshots.stack("displacement")[1:], size=1))
    written = commands(build(scene))
    assert written.keys() <= case.keys()
    for key, lines in written.items():
        assert not differing_lines("\n".join(case[key]), "\n".join(lines)), key


@pytest.mark.parametrize("name", CASES)
def test_lammps_s_drivers_would_take_it_with_newton_off(name: str) -> None:
    case, found = read(FOLDER / f"{name}.yaml")
    assert found.keys() == RECORDED.keys()
    assert found["run_pos"].shape == (len(SEGMENTS), int(case["natoms"][0]), 3)
    assert departure(ran(case, "off"), found) < EPSILON
    wrong = {key: values * (1 + 2 * EPSILON) for key, values in found.items()}
    assert departure(wrong, found) > EPSILON
    assert np.abs(found["run_vel"]).max() > 0
