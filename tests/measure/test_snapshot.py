"""A network read from the first snapshot of a run moves as the run does."""

from dataclasses import replace

import numpy as np
import pytest

from granular_analysis.measure import snapshot
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Material
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import forces
from granular_lmp import Scene, run
from granular_lmp.problem import prepare
from granular_lmp.rest.absorption import quiet_end_of
from tests.manual import Mutant, off, verifies

STEEL = Material(210e3, 0.3, 100.0)
SILICA, DENSITY = Material(73e3, 0.17, 63.0), 0.0022  # those of the shipped scenes, in units nano
PERIODIC = {"time.duration": 5.0, "time.timestep": 0.0125, "output.particles": 1.0}
HELD = PERIODIC | {"packing.ends": "fixed", "packing.rows": 17, "time.allow_echo": True}


def read_network(path, materials, density=None):
    """Return the network and the state of a dump that belongs to no record."""
    return snapshot._placed(snapshot._read(path, density, rotation=True, turned=True), materials)


@pytest.mark.parametrize("changes", [PERIODIC, HELD], ids=["periodic", "held"])
@verifies(
    "A network read from a dump of LAMMPS moves as the run, periodic and held, in D0",
    reference="other code: LAMMPS",
    tolerance=5e-05,
    reason="the error of Verlet's steps: 1e-4 of the wave with four times the step",
    mutant=Mutant(
        "analysis/granular_analysis/measure/snapshot.py",
        "        return columns\n    scalar",
        "        return -columns\n    scalar",
    ),
)
def test_the_network_moves_as_the_run_that_it_was_read_from(changes, tmp_path, measured):
    scene = Scene.load("tr_periodic").with_values(changes)
    snapshots = run(scene, tmp_path / "run").snapshots()
    network, state = read_network(snapshots.path, [SILICA], density=DENSITY)
    assert np.count_nonzero(network.held) == (6 if changes is HELD else 0)
    times = scene.sphere.time_scale * 1e9 * np.arange(1, 6)
    motion = integrate(network, state, times).motion
    size = scene.wave.amplitude * scene.sphere.static_overlap * 1e9
    for mine, theirs in zip(motion, [snapshots[i] for i in range(1, 6)], strict=True):
        measured(off(mine[:2].T / size, theirs.displacement, size=1))
        measured(off(mine[2] * 500 / size, theirs.rotation, size=1))
    assert np.max(np.abs(motion[-1, :2])) > 0.5 * size


@pytest.fixture
def dump(tmp_path):
    """Return a dump of two spheres that press on each other across the edge of a periodic cell."""
    path = tmp_path / "dump"
    path.write_text(
        "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp ff pp\n0 5000\n-600 600\n-500 500\n"
        "ITEM: ATOMS id type x y z radius Displacement.X Displacement.Y vx vy vz omegaz v_theta\n"
        "2 1 4901 0 0 500 1 0 0.5 0 0 0 0.25\n1 2 100 0 0 700 0 0 0 0 0 0 0\n"
    )
    return path


def test_spheres_come_in_the_order_of_their_numbers(dump):
    network, state = read_network(dump, [SILICA], density=2.0)
    assert network.position.tolist() == [[100, 0], [4900, 0]]
    assert network.cell == (5000, np.inf)
    assert network.held.tolist() == [True, False]
    assert state.motion[:, 1].tolist() == [1, 0, 0.25, 0.5, 0, 0]
    assert network.density.tolist() == [2.0, 2.0]
    assert forces(network, state)[0, 0] > 0


def test_a_dump_of_spheres_in_space_has_all_six_freedoms(tmp_path):
    path = tmp_path / "dump"
    path.write_text(
        "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp pp ff\n0 5000\n0 6000\n-500 500\n"
        "ITEM: ATOMS id type x y z radius Displacement.X Displacement.Y Displacement.Z vx vy vz omegax omegay omegaz "
        "Orientation.W Orientation.X Orientation.Y Orientation.Z\n"
        "2 1 4901 0 7 500 1 0 2 0.5 0 4 7 8 9 0.5 0.25 0 -0.5\n1 2 100 0 0 700 0 0 0 0 0 0 0 0 0 1 0 0 0\n"
    )
    network, state = read_network(path, [SILICA], density=2.0)
    assert network.position.tolist() == [[100, 0, 0], [4900, 0, 5]]
    assert network.cell == (5000, 6000, np.inf)
    assert state.motion[:, 1].tolist() == [1, 0, 2, 1, 0, -2, 0.5, 0, 4, 7, 8, 9]
    path.write_text(path.read_text().replace("Orientation.W", "Orientation"))
    with pytest.raises(ValueError, match="no column Orientation.W"):
        read_network(path, [SILICA], density=2.0)


def test_types_and_masses_say_material_and_density(dump):
    text = (
        dump.read_text()
        .replace("radius", "radius mass")
        .replace("500 1 0", "500 3e9 1 0")
        .replace("700 0", "700 5e9 0")
    )
    dump.write_text(text.replace("2 1 4901", "2 3 4901"))
    network, _ = read_network(dump, [SILICA, STEEL])
    assert network.kinds.tolist() == [0, 1]
    assert network.held.tolist() == [True, False]
    assert network.mass == pytest.approx([5e9, 3e9], rel=1e-15)  # two roundings
    with pytest.raises(ValueError, match="type 3, which means material 2; materials has 1"):
        read_network(dump, [SILICA])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("TIMESTEP\n0", "TIMESTEP\n10", "begins at step 10"),
        ("ITEM: TIMESTEP", "LAMMPS data", "no text dump"),
        ("v_theta", "angle", "no column v_theta"),
        ("ATOMS\n2", "ATOMS\n3", "cut off"),
        ("ITEM: ATOMS", "", "no text dump"),
        ("4901", "49o1", "no text dump of LAMMPS: could not convert string to float: '49o1'"),
        ("ATOMS\n2", "ATOMS\ntwo", "no text dump of LAMMPS: invalid literal"),
        ("pp", "pp pp", "no text dump"),
        ("700", "7\udcff", "no text dump of LAMMPS: 'utf-8' codec"),
    ],
)
def test_another_file_is_refused(dump, old, new, message):
    dump.write_text(dump.read_text().replace(old, new), errors="surrogateescape")
    with pytest.raises(TheoryError, match=message):
        read_network(dump, [SILICA], density=1.0)


BRIEF = {"time.duration": 0.5, "time.sample": 0.5, "output.particles": 0.5}
LAYER = BRIEF | {"packing.rows": 8, "packing.columns": 6, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4}
UNEQUAL = {"disorder.radius": 5e-5}
ROLLING = {"effects.rolling": True, "effects.rolling_stiffness": 10.0, "effects.rolling_friction": 1.0}
WALLED = {"packing.rows": 9, "packing.first": "wall", "packing.last": "wall", "time.allow_echo": True}
STANDING = {
    "a layer": ("monolayer_rocking", LAYER),
    "an unequal layer of JKR spheres": ("monolayer_rocking", LAYER | UNEQUAL | {"sphere.adhesion_law": "jkr"}),
    "an unequal layer between two plates": ("monolayer_rocking", LAYER | UNEQUAL | {"substrate.sides": "both"}),
    "unequal rows between walls": ("tr_nonresonant", BRIEF | WALLED | UNEQUAL | {"packing.columns": 6}),
}


@pytest.mark.parametrize("name", STANDING)
def test_walls_stand_where_the_spheres_on_them_are_at_rest(name, tmp_path):
    shipped, changes = STANDING[name]
    scene = Scene.load(shipped).with_values(changes)
    record = run(scene, tmp_path / "run")
    for deck in (tmp_path / "run").glob("in.*"):  # which says where they are
        deck.unlink()
    first = first_snapshot(record)
    radius, overlap = first.radius, first.radius * scene.sphere.static_overlap / scene.sphere.radius
    found = {
        ("xyz"[k], each.normal[k]): each.point[k] for each in first.network.walls for k in np.flatnonzero(each.normal)
    }
    places = prepare(scene).rest.planes
    assert {f"{axis}{'lo' if way < 0 else 'hi'}" for axis, way in found} == set(places)
    for (axis, way), place in found.items():
        # Rounding of places in a crystal of 10 radii, and what is left of the forces at rest, 2e-10 of k1 Delta0
        assert place == pytest.approx(places[f"{axis}{'lo' if way < 0 else 'hi'}"] * radius, abs=1e-8 * overlap)


def test_a_substrate_is_where_adhesion_and_repulsion_balance(tmp_path):
    scene = Scene.load("monolayer_rocking").with_values(LAYER)
    first = first_snapshot(run(scene, tmp_path / "run"))
    (wall,), sphere, under = first.network.walls, scene.sphere, scene.substrate
    modulus = 1 / sum((1 - each.poisson_ratio**2) / each.youngs_modulus for each in (sphere, under))
    adhesion = np.sqrt(sphere.work_of_adhesion * under.work_of_adhesion)
    # 2 pi w R = (4/3) E* R^(1/2) d^(3/2)
    depth = (1.5 * np.pi * adhesion * np.sqrt(sphere.radius) / modulus) ** (2 / 3)
    assert wall.point[2] == pytest.approx(-(1 - depth / sphere.radius) * first.radius, rel=1e-12)


def test_a_run_whose_contacts_resist_rolling_has_no_network(tmp_path):
    scene = Scene.load("tr_periodic").with_values(BRIEF | ROLLING)
    record = run(scene, tmp_path / "run")
    with pytest.raises(TheoryError, match=r"the network leaves out effects\.rolling"):
        first_snapshot(record)


def test_quiet_ends_damp_as_the_run_says(tmp_path):
    scene = Scene.load("quiet_ends").with_values(BRIEF)
    record = run(scene, tmp_path / "run")
    for deck in (tmp_path / "run").glob("in.*"):
        deck.unlink()
    first, end = first_snapshot(record), quiet_end_of(prepare(scene).scene)
    damped = first.network.drag * ~first.network.held * first.time
    rows = damped.reshape(scene.shape.rows, -1)
    np.testing.assert_allclose(rows.max(axis=1), rows.min(axis=1))
    np.testing.assert_allclose(rows[-end.rows - 1 : -1, 0], end.rates(), rtol=1e-12)
    np.testing.assert_allclose(rows[1 : end.rows + 1, 0], end.rates()[::-1], rtol=1e-12)
    assert not rows[end.rows + 1 : -end.rows - 1].any()
    with pytest.raises(TheoryError, match=r"absorb.rows: run.json lacks .* run the scene again"):
        first_snapshot(replace(record, info={**record.info, "quiet_ends": None}))
