"""MonitorRecords of contacts record the force of each sphere on its wall or substrate."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp import Record, Scene, build, run
from granular_lmp.lammps.outputs import MONITOR
from granular_lmp.plot.monitors import monitor_figure
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.runs.export import export
from granular_lmp.runs.monitors import MonitorRecord
from granular_lmp.runs.scales import force_of, length_of
from tests.conftest import PAPER
from tests.lammps.test_space import LAYER, layer

ALL: dict[str, Any] = {"name": "all", "rows": [0, 7], "what": "contacts"}
SAMPLED: dict[str, Any] = {"time__sample": 0.1, "time__timestep": 0.01, "time__duration": 10.0, "monitor": [ALL]}
HEAVY: dict[str, Any] = {"inclusion": [{"spheres": [[2, 1], [5, 0]], "density": 4400.0}], "disorder__radius": 1e-5}
PUSH: dict[str, Any] = {"spheres": [[6, 1]], "force": "y", "signal": "burst", "cycles": 2.0, "frequency": 1.0}
AT_FACE: dict[str, Any] = {
    "name": "face",
    "packing.rows": 9,
    "packing.columns": 4,
    "packing.first": "held",
    "packing.last": "wall",
    "packing.sides": "periodic",
    "wave.form": "none",
    "wave.wavenumber": 1.0,
    "wave.amplitude": 1e-4,
    "source": [PUSH],
    "time.allow_echo": True,
} | {key.replace("__", "."): value for key, value in SAMPLED.items()}
AT_FACE["monitor"] = [ALL | {"rows": [0, 8]}]
BOUNCE: dict[str, Any] = {
    "packing.lattice": "chain",
    "packing.columns": 1,
    "packing.rows": 2,
    "packing.last": "wall",
    "striker.1.spheres": [[0, 0]],
    "time.duration": 12.0,
    "time.sample": 0.02,
    "time.timestep": 0.01,
    "monitor": [ALL | {"rows": [0, 1]}],
}


def scenes() -> dict[str, Scene]:
    return {
        "a layer": layer(**SAMPLED, wave__mode="3", wave__amplitude=1e-2),
        "a layer between two substrates": layer(**SAMPLED, wave__mode="3", substrate__sides="both"),
        "a layer of two materials": layer(**SAMPLED, **HEAVY, wave__mode="3", wave__form="standing"),
        "a sheet at a rigid wall": PAPER.with_values(AT_FACE),
    }


def judged(record: Record, monitor: MonitorRecord, end: int, *, walls: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return m a of a sphere from its velocity, and the sum of the forces of its contacts, N, (T - 2, D) each."""
    scene, contacts = record.scene, monitor.contacts
    crystal = crystal_of(scene)
    number = int(monitor.spheres[end])
    sign = np.where(contacts.j == number, 1.0, np.where(contacts.i == number, -1.0, 0.0))
    sign[contacts.wall != ""] *= walls
    found = (sign[:, None] * contacts.force).sum(axis=1) * force_of(scene)
    material = int(crystal.atoms.arrays.get("material", np.zeros(len(crystal.atoms), dtype=int))[number])
    mass = crystal.materials[material].mass * crystal.atoms.arrays["radius"][number] ** 3
    velocity = monitor.velocity[:, list(monitor.spheres).index(number)] * length_of(scene) / scene.scale.time
    slope = mass * np.gradient(velocity, monitor.tau[1] * scene.scale.time, axis=0)[1:-1]
    return slope, (found[:-2] + 4 * found[1:-1] + found[2:]) / 6  # Simpson's mean of the acceleration


@pytest.fixture(scope="module", params=scenes())
def record(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(scenes()[request.param], tmp_path_factory.mktemp("walls") / "run")


@pytest.fixture(scope="module")
def monitor(record: Record) -> MonitorRecord:
    """The monitor of the record, whose contacts are read once."""
    return record.monitor("all")


def test_forces_of_all_contacts_and_walls_are_what_moves_a_sphere(record: Record, monitor: MonitorRecord) -> None:
    contacts = monitor.contacts
    sphere = int(contacts.i[contacts.wall != ""][1])
    momentum, force = judged(record, monitor, sphere)
    scale = np.abs(force).max()
    assert np.abs(momentum - force).max() < 1e-3 * scale
    assert np.abs(momentum - judged(record, monitor, sphere, walls=False)[1]).max() > 0.1 * scale


def test_torques_of_contacts_and_substrate_are_what_turns_a_sphere(record: Record, monitor: MonitorRecord) -> None:
    """The shear force of a wall acts at a lever arm R."""
    scene = record.scene
    contacts, radius = monitor.contacts, monitor.crystal.arrays["radius"]
    number = int(contacts.i[contacts.wall != ""][1])
    half = np.where(contacts.wall == "", np.nan_to_num(contacts.overlap) * scene.sphere.overlap_ratio, 0.0)
    arm = radius[number] - half
    found = sum(
        (contacts.torque(end, arm)[:, getattr(contacts, end) == number].sum(axis=1) for end in ("i", "j")),
        start=np.zeros(()),
    ) * (force_of(scene) * scene.sphere.radius)
    material = int(crystal_of(scene).atoms.arrays.get("material", np.zeros(len(radius), dtype=int))[number])
    mass = crystal_of(scene).materials[material].mass * radius[number] ** 3
    spin = monitor.spin[:, list(monitor.spheres).index(number)] * length_of(scene) / scene.scale.time
    turning = 0.4 * mass * radius[number] ** 2 * scene.sphere.radius * spin
    slope = np.gradient(turning, monitor.tau[1] * scene.scale.time, axis=0)[1:-1]
    mean = (found[:-2] + 4 * found[1:-1] + found[2:]) / 6
    assert np.abs(slope - mean).max() < 1e-3 * np.abs(found).max()


def test_the_program_and_two_ranks_give_the_same(tmp_path: Path) -> None:
    scene = layer(**SAMPLED | {"time__duration": 3.0}, wave__amplitude=0.05, **HEAVY, wave__form="standing")
    options: dict[str, dict[str, Any]] = {"module": {}, "program": {"launcher": "lmp"}}
    options["ranks"] = {"launcher": "lmp", "ranks": 2}
    module, program, ranks = (run(scene, tmp_path / name, **how) for name, how in options.items())
    name = MONITOR.format("all")
    assert (tmp_path / "module" / name).read_bytes() == (tmp_path / "program" / name).read_bytes()
    one, other = (each.monitor("all").contacts for each in (module, ranks))
    assert one.pairs == other.pairs
    assert program.monitor("all").contacts.pairs == one.pairs
    on_wall = one.wall != ""
    assert on_wall.sum() == 24
    for part in ("normal", "shear", "overlap"):
        mine, others = (getattr(each, part)[:, on_wall] for each in (one, other))
        assert np.abs(mine - others).max() < 1e-9 * max(1.0, np.abs(mine).max())


def test_a_table_names_the_wall_as_partner(tmp_path: Path) -> None:
    record = run(layer(**SAMPLED), tmp_path / "run")
    export(record, tmp_path / "out.csv", "all")
    lines = [line.split(",") for line in (tmp_path / "out.csv").read_text().splitlines()]
    table = [dict(zip(lines[0], line, strict=True)) for line in lines[1:]]
    assert {each["partner"] for each in table} == {"sphere", "wall zlo"}
    walls = [each for each in table if each["partner"] == "wall zlo"]
    assert {(each["row_j"], each["column_j"]) for each in walls} == {("-1", "-1")}
    contacts = record.monitor("all").contacts
    normal = contacts.normal[:, contacts.wall == "zlo"]
    assert [float(each["normal_N"]) for each in walls] == pytest.approx(normal.ravel() * force_of(record.scene))


def test_a_sphere_that_bounces_off_a_wall_leaves_its_momentum_there(tmp_path: Path) -> None:
    """The force on the wall follows the law of Hertz on a rigid plane."""
    record = run(Scene.load("point_impact").with_values(BOUNCE), tmp_path / "run")
    monitor = record.monitor("all")
    contacts = monitor.contacts
    at = contacts.wall == "yhi"
    normal, momentum = contacts.normal[:, at], monitor.velocity[..., 1].sum(axis=1)
    assert momentum[[0, -1]] == pytest.approx([1.0, -1.0], abs=0.3)
    assert np.trapezoid(normal.sum(axis=1), monitor.tau) == pytest.approx(momentum[0] - momentum[-1], rel=1e-4)
    hertz = np.sqrt(8) * np.maximum(np.nan_to_num(contacts.overlap[:, at]), 0.0) ** 1.5
    np.testing.assert_allclose(normal, hertz, atol=1e-9)


@pytest.mark.more
def test_a_tolerance_holds_for_forces_on_walls(tmp_path: Path) -> None:
    fine = layer(**SAMPLED | {"time__duration": 4.0, "time__timestep": 1e-3})
    values = LAYER | {"time.duration": 4.0, "monitor": [ALL], "time.tolerance": 1e-4}
    del values["time.timestep"]
    record, exact = run(PAPER.with_values(values), tmp_path / "run"), run(fine, tmp_path / "fine")
    one, other = (each.monitor("all").contacts for each in (record, exact))
    on_wall = one.wall != ""
    assert one.pairs == other.pairs
    assert "all.normal" in record.info["errors_of_monitors"]
    difference = np.abs(one.normal - other.normal)[:, on_wall].max()
    assert difference < 1e-4 * np.abs(other.normal).max()


def test_a_deck_without_contacts_has_no_columns_of_walls() -> None:
    with_forces = build(layer(**SAMPLED)).input_text
    assert "wall_zlo_fz" in with_forces
    assert "wall_zlo" not in build(layer(monitor=[ALL | {"what": "motion"}])).input_text


def test_a_picture_of_forces_in_space_names_the_wall(tmp_path: Path) -> None:
    monitor = {"name": "all", "spheres": [[2, 1]], "what": "contacts"}
    record = run(layer(**SAMPLED | {"monitor": [monitor]}, wave__mode="3"), tmp_path / "run")
    panels = monitor_figure(record.monitor("all")).axes
    assert [each.get_text() for each in panels[0].get_legend().get_texts()][-1] == "[2, 1] – wall zlo"
    assert any("shear force along z" in each.get_ylabel() for each in panels)
