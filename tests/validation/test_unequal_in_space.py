"""Spheres of unequal radii, moduli and adhesion at rest in space, in LAMMPS: layers on a substrate, films, fcc, hcp.

LAMMPS finds no force on a sphere at rest, and every sphere moves as in the network of its first snapshot. Two time
steps are extrapolated to none; what is left is of fourth order in the step.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.snapshot import FirstSnapshot, first_snapshot
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import loaded
from granular_analysis.tools.compare import compare
from granular_lmp import Record, Scene, build, run
from granular_lmp.crystal.balance import BALANCED
from granular_lmp.lammps.installation import lammps_module
from granular_lmp.problem import prepare
from tests.conftest import members

Changes = dict[str, Any]
STEPS = (0.02, 0.01)
FIELDS = 1e-6  # D0; the step leaves at most 2e-7
# Positions of up to 10 radii are rounded to 1e-15 radii, 4e-12 overlaps
ROUNDED = 1e-10
SIZE: Changes = {
    "packing.rows": 8,
    "packing.columns": 6,
    "packing.ends": "periodic",
    "wave.wavenumber": np.pi / 4,
    "time.duration": 3.0,
    "time.sample": 1.0,
    "time.allow_echo": True,
    "output.particles": 3.0,
}
SPREAD = {"disorder.radius": 5e-5}  # s = 0.2
STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "work_of_adhesion": 0.1, "density": 7850.0}
BULK = {"packing.layers": 4, "packing.columns": 4}
PRESSED = {"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7}
MEASURED = {
    "contact.normal_stiffness": 300.0,
    "contact.shear_stiffness": 200.0,
    "substrate.normal_stiffness": 900.0,
    "substrate.shear_stiffness": 500.0,
}
FIXED = {"packing.ends": "fixed", "packing.rows": 9}
WALLED = {"packing.first": "wall", "packing.last": "wall", "packing.sides": "wall"}
OPEN = {"packing.first": "free", "packing.last": "free", "packing.sides": "free"}
CASES: dict[str, tuple[str, Changes]] = {
    "a layer": ("monolayer_rocking", SPREAD),
    "a layer that lost contacts": ("monolayer_rocking", {"disorder.radius": 3e-4}),
    "a layer of 1 % spheres": ("monolayer_rocking", {"disorder.radius": 1e-2}),
    "a layer of every imperfection": (
        "monolayer_rocking",
        SPREAD | {"disorder.density": 0.05, "disorder.vacancies": 0.05},
    ),
    "a layer of JKR spheres": ("monolayer_rocking", SPREAD | {"sphere.adhesion_law": "jkr"}),
    "a layer with measured stiffnesses": ("monolayer_rocking", SPREAD | MEASURED),
    "a layer between held rows": ("monolayer_rocking", SPREAD | FIXED),
    "a layer in a box": ("monolayer_rocking", FIXED | WALLED),
    "an unequal layer in a box": ("monolayer_rocking", SPREAD | FIXED | WALLED),
    "an island": ("monolayer_rocking", SPREAD | FIXED | OPEN),
    "a layer that is pressed together": ("monolayer_rocking", SPREAD | {"packing.contact_force": 1e-8}),
    "a layer between two plates": ("monolayer_rocking", SPREAD | {"substrate.sides": "both"}),
    "a larger sphere": ("monolayer_rocking", {"inclusion": [{"spheres": [[4, 3]], "radius": 5.001e-7}]}),
    "rows of steel on a substrate": ("monolayer_rocking", {"inclusion": [{"rows": [0, 3], **STEEL}]}),
    "a chain": (
        "monolayer_rocking",
        SPREAD | {"packing.lattice": "chain", "packing.columns": 1, "wave.mode": "3"},
    ),
    "a honeycomb": ("monolayer_rocking", SPREAD | {"packing.lattice": "honeycomb", "wave.mode": "4"}),
    "fcc": ("fcc_transverse", SPREAD | BULK),
    "fcc of JKR spheres": ("fcc_transverse", SPREAD | BULK | {"sphere.adhesion_law": "jkr"}),
    "fcc under load": ("fcc_transverse", SPREAD | BULK | PRESSED),
    "fcc with vacancies under load": ("fcc_transverse", BULK | PRESSED | {"disorder.vacancies": 0.03}),
    "hcp": ("hcp_c_axis", SPREAD | BULK),
    "rows of steel in hcp": ("hcp_c_axis", BULK | {"inclusion": [{"rows": [0, 3], **STEEL}]}),
    "a film": ("multilayer", SPREAD),
    "spheres on three others": (
        "multilayer",
        SPREAD
        | {"packing.orientation": "[11-2]", "packing.layers": 2}
        | {"inclusion": [{"layers": [1, 1], "share": 0.6, "vacancy": True}]},
    ),
    "a cover of steel": ("multilayer", {"inclusion": [{"layers": [1, 1], **STEEL}]}),
    "a film between two plates": ("multilayer", SPREAD | {"substrate.sides": "both"}),
}


def scene_of(name: str) -> Scene:
    shipped, changes = CASES[name]
    return Scene.load(shipped).with_values(SIZE | changes)


def fields_of(record: Record) -> np.ndarray:
    """Return displacements and Rθ of all spheres at every snapshot, (T, N, 6), in D0."""
    return np.concatenate(record.snapshots().stacks("displacement", "rotation"), axis=2)


def network_fields(first: FirstSnapshot, tau: np.ndarray) -> np.ndarray:
    """Return the fields of a network at times, as `fields_of` does."""
    motion = integrate(first.network, first.state, tau * first.time).motion[:, :6]
    return np.moveaxis(motion, 1, 2) * np.repeat([1.0, first.radius], 3) / first.length


def extrapolated(scene: Scene, folder: Path) -> tuple[Record, np.ndarray]:
    """Return two runs of a scene extrapolated to no step, and the record of the finer one."""
    coarse, fine = (run(scene.with_values({"time.timestep": step}), folder / str(step)) for step in STEPS)
    return fine, (4 * fields_of(fine) - fields_of(coarse)) / 3


def forces_in_lammps(scene: Scene, folder: Path) -> np.ndarray:
    """Return the forces on the free spheres at rest in LAMMPS, (n, 3), in k1 Δ0."""
    deck, sphere = build(scene), scene.sphere
    deck.write(folder)
    until_rest, preload, _ = deck.input_text.partition("# --- preload")
    assert preload
    lammps = lammps_module().lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    try:
        lammps.command(f'variable data index "{folder / deck.data_name}"')
        lammps.commands_string(until_rest)
        lammps.commands_string("thermo_style custom step\nfix move all nve/noforce\nrun 0 post no\n")
        count = len(deck.packing)
        free = lammps.numpy.extract_atom("type")[:count] % 2 == 1
        forces = np.array(lammps.numpy.extract_atom("f")[:count][free])
    finally:
        lammps.close()
    unit = deck.problem.units.number(sphere.normal_stiffness * sphere.static_overlap, mass=1, length=1, time=-2)
    return forces / unit


# Of each, a case with one feature more stands beside it; honeycomb stands in test_strikes_on_a_layer
MORE = ("a layer", "a layer that lost contacts", "a layer of 1 % spheres", "a layer in a box", "an island")
MORE += ("a layer that is pressed together", "a larger sphere", "rows of steel on a substrate")
MORE += ("fcc", "fcc under load", "hcp", "a film", "a layer with measured stiffnesses")
MORE += ("a layer between held rows", "a layer between two plates", "a cover of steel", "fcc of JKR spheres")
MORE += ("rows of steel in hcp", "spheres on three others", "a honeycomb")


@pytest.mark.parametrize("name", members(CASES, *MORE))
def test_a_crystal_of_unequal_spheres_in_space_is_at_rest_in_lammps(name: str, tmp_path: Path) -> None:
    forces = forces_in_lammps(scene_of(name), tmp_path / "deck")
    assert len(forces)
    assert np.abs(forces).max() < BALANCED + ROUNDED


@pytest.mark.parametrize("name", members(CASES, *MORE))
def test_every_unequal_sphere_in_space_moves_as_in_its_network(name: str, tmp_path: Path) -> None:
    record, fields = extrapolated(scene_of(name), tmp_path)
    assert all(guard["quiet"] for guard in record.info["guards"].values())
    first = first_snapshot(record)
    tau = record.snapshots().tau
    expected = network_fields(first, tau)
    assert np.abs(fields - expected).max() < FIELDS
    # Radii that differ by a thousandth of their deviations more are seen
    radius = first.network.radius
    other = replace(first.network, radius=radius + 1e-3 * (radius - np.median(radius)) + 1e-7 * radius)
    moved = network_fields(replace(first, network=other, state=loaded(other, first.state.motion)), tau)
    assert np.abs(moved - expected).max() > 10 * FIELDS


def test_compare_takes_the_network_of_unequal_spheres_in_space(tmp_path: Path) -> None:
    found = compare(run(scene_of("a layer").with_values({"time.tolerance": 1e-4}), tmp_path / "run"))
    assert found.theory == "network"
    assert max(found.error.values()) < 1e-3


def test_spheres_that_are_pushed_off_their_substrate_are_said() -> None:
    rough = {"disorder.radius": 1e-2}
    problem = prepare(scene_of("a layer").with_values(rough))
    lifted = problem.at_rest.equilibrium.lifted  # type: ignore[union-attr]  # it came to rest
    assert 0 < lifted == len(problem.crystal) - problem.contacts.on_wall.sum()
    assert any(said.startswith(f"{lifted} spheres were pushed off their wall") for said in problem.warnings())
    assert not prepare(scene_of("a layer")).at_rest.remarks()
