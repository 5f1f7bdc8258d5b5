"""Scenes in space beside the network that starts from their first snapshot: layers on a substrate, fcc, hcp, films."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.harmonic import by_cell
from granular_analysis.measure.signals import IN_SPACE, recorded
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import loaded, present
from granular_analysis.theory.network_tangents import combined
from granular_analysis.tools.compare import compare, table
from granular_lmp import Record, Scene, run
from tests.conftest import members

TAU = {"time.duration": 5.0, "output.particles": 5.0}
MEASURED = {
    "contact.normal_stiffness": 300.0,
    "contact.shear_stiffness": 200.0,
    "substrate.normal_stiffness": 900.0,
    "substrate.shear_stiffness": 500.0,
}
PUSH = {"rows": [14, 14], "frequency": 1.0}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "vertical": ("monolayer_vertical", {}),
    "rocking": ("monolayer_rocking", {}),
    "measured stiffnesses": ("monolayer_rocking", MEASURED),
    "soft substrate": ("monolayer_rocking", {"substrate.youngs_modulus": 3e9, "substrate.poisson_ratio": 0.4}),
    "square between two, JKR": (
        "monolayer_rocking",
        {"packing.lattice": "square", "sphere.adhesion_law": "jkr", "substrate.sides": "both", "wave.mode": "2"},
    ),
    "chain on a substrate": ("monolayer_rocking", {"packing.lattice": "chain", "packing.columns": 1, "wave.mode": "3"}),
    "honeycomb": ("monolayer_rocking", {"packing.lattice": "honeycomb", "packing.columns": 4, "wave.mode": "4"}),
    "oblique": ("monolayer_rocking", {"wave.direction": 50.0, "wave.mode": "3", "wave.wavenumber": 0.4}),
    "standing": ("monolayer_rocking", {"wave.form": "standing"}),
    "dashpots": ("monolayer_rocking", {"effects.viscosity": 1e-7}),
    "a push along z": ("monolayer_rocking", {"source": [PUSH | {"force": "z", "amplitude": 0.3}]}),
    "a torque about x": ("monolayer_rocking", {"source": [PUSH | {"force": "torque_x", "amplitude": 0.01}]}),
    "a sheet without a substrate": ("tr_periodic", {"packing.space": 3}),
    "fcc, incremental": ("fcc_transverse", {"effects.shear_law": "incremental"}),
    "hcp": ("hcp_c_axis", {}),
    "film": ("multilayer", {}),
}


def record_of(name: str, folder: Path, **values: Any) -> Record:
    shipped, changes = CASES[name]
    return run(Scene.load(shipped).with_values(TAU | changes | values), folder / "run")


# The substrate below, its forces and other directions stand in the cases beside; a film and a chain of unequal spheres
# in test_unequal_in_space, a push along z and honeycomb in test_strikes_on_a_layer
MORE = "vertical", "rocking", "soft substrate", "square between two, JKR", "oblique", "standing", "hcp", "film"
MORE += "chain on a substrate", "a push along z", "honeycomb"


@pytest.mark.parametrize("name", members(CASES, *MORE))
def test_a_scene_in_space_moves_as_its_network(name: str, tmp_path: Path) -> None:
    record = record_of(name, tmp_path, **{"time.tolerance": 1e-5})
    found = compare(record)
    assert found.theory == "network"
    assert found.signals is not None
    seen = recorded(record)
    for signal, values in zip(IN_SPACE, found.signals, strict=True):
        # The step is extrapolated; what is left is below a tenth of the tolerance, 1e-8 as a rule
        np.testing.assert_allclose(seen[signal], values, rtol=0, atol=1e-6)
    assert max(np.abs(values).max() for values in found.signals) > 0.2
    assert all(name in table([found]) for name in IN_SPACE)


WALLS = ("vertical", "square between two, JKR", "film", "dashpots")


@pytest.mark.parametrize("name", members(WALLS, "vertical", "film"))
def test_forces_on_substrates_are_those_of_the_network(name: str, tmp_path: Path) -> None:
    """Each sphere pushes and drags its substrate as in the network, which no force from LAMMPS enters."""
    monitor = [{"name": "beside", "rows": [1, 2], "what": "contacts"}]
    short = {"time.duration": 3.0, "output.particles": 3.0}  # the wave is there from the start
    record = record_of(name, tmp_path, **short, **{"time.timestep": 1e-3, "monitor": monitor})
    contacts, first = record.monitor("beside").contacts, first_snapshot(record)
    times = record.tau * first.time
    reached = integrate(first.network, first.state, times, spheres=[first.recorded]).final
    now, pairs, count = present(first.network, reached), reached.pairs, len(first.network.radius)
    unit = first.scales.stiffness * first.length
    faces = ["zlo" if wall.normal[2] < 0 else "zhi" for wall in first.network.walls]
    on = {
        (int(i), faces[j - count]): k
        for k, (i, j) in enumerate(zip(pairs.first, pairs.second, strict=True))
        if j >= count
    }
    at = [on[i, wall] for i, _, wall in contacts.pairs if wall]
    walls = contacts.wall != ""
    pushed = now.repulsion * np.array(now.normal) - np.array(combined(now.shear, now.tangents.along))
    expected, found = pushed[:, at].T / unit, contacts.force[-1, walls]
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()
    assert np.abs(found - 1.01 * expected).max() > 5e-3 * np.abs(expected).max()


@pytest.fixture(scope="module")
def measured_stiffnesses(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return record_of("measured stiffnesses", tmp_path_factory.mktemp("measured"), **{"time.tolerance": 1e-5})


@pytest.mark.parametrize("changed", ["normal force", "shear force", "height", "springs of pairs"])
def test_another_substrate_or_contact_is_seen(changed: str, measured_stiffnesses: Record) -> None:
    record = measured_stiffnesses
    first = first_snapshot(record)
    (wall,), spheres = first.network.walls, first.network
    pressing, shearing = wall.factors
    other = {
        "normal force": {"walls": (wall._replace(factors=(1.01 * pressing, shearing)),)},
        "shear force": {"walls": (wall._replace(factors=(pressing, 1.01 * shearing)),)},
        "height": {"walls": (wall._replace(point=(0.0, 0.0, wall.point[2] + 1e-3 * first.length)),)},
        "springs of pairs": {"factors": (spheres.factors[0], 1.01 * spheres.factors[1])},
    }[changed]
    network = replace(spheres, **other)
    moved = integrate(network, loaded(network, first.state.motion), record.tau * first.time, spheres=[first.recorded])
    found = dict(zip(IN_SPACE, first.signals(moved), strict=True))
    assert max(np.abs(found[name] - values).max() for name, values in recorded(record).items()) > 1e-4


def test_the_harmonic_of_a_cell_refuses_a_run_in_space_by_what_it_declares(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"leaves out packing\.lattice = 'fcc', packing\.orientation"):
        by_cell(record_of("fcc, incremental", tmp_path))
