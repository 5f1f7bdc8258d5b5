"""Snapshots of all spheres: what stands in the dump, who reads it, what a stop leaves of it."""

from pathlib import Path

import ase.io
import numpy as np
import pytest

from granular_lmp import Record, Scene, build, run
from granular_lmp.crystal.lattices import centre
from granular_lmp.crystal.mode import PLANE
from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.outputs import mend_dump, read_centre, whole_snapshots
from granular_lmp.rest.initial_fields import plane_wave
from granular_lmp.runs.snapshots import Snapshots, Spheres
from granular_lmp.studies.cost_settings import base
from granular_lmp.units import units_for
from tests.stand_in import of_first_format


@pytest.fixture
def seen(small: Scene) -> Scene:
    """The small scene with 3 snapshots, of 24 spheres each."""
    return small.with_values({"output.particles": 1.0})


def test_snapshots_change_nothing_of_a_run(small: Scene, seen: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "without")
    run(seen, tmp_path / "with")
    assert not (tmp_path / "without" / "dump.particles").exists()
    for name in ("dump.centre", "trajectory.csv"):
        assert (tmp_path / "with" / name).read_bytes() == (tmp_path / "without" / name).read_bytes()


def test_the_centre_sphere_is_the_same_in_both_dumps_to_the_last_bit(seen: Scene, tmp_path: Path) -> None:
    record = run(seen, tmp_path / "run")
    centre = seen.shape.centre_row * seen.shape.columns + seen.shape.columns // 2
    lines = (tmp_path / "run" / "dump.particles").read_text().split("\n")
    size = 9 + seen.shape.spheres
    names = lines[8].split()[2:]
    alone = read_centre(tmp_path / "run" / "dump.centre")
    pairs = {"Displacement.X": "ux", "Displacement.Y": "uy", "v_theta": "theta", "omegaz": "omegaz", "vx": "vx"}
    for snapshot in range(3):
        values = dict(zip(names, lines[size * snapshot + 9 + centre].split(), strict=True))
        for ours, theirs in pairs.items():
            assert float(values[ours]) == alone[theirs][2 * snapshot]
    snapshots = Snapshots.load(tmp_path / "run")
    np.testing.assert_array_equal(snapshots.tau, record.tau[::2])
    moved, turned = snapshots.stacks("displacement", "rotation")
    np.testing.assert_array_equal(moved, snapshots.stack("displacement"))
    assert moved.shape == (3, 24, 2)
    # The record divides in metres, the snapshots in the deck's nanometres: a few roundings
    np.testing.assert_allclose(moved[:, centre, 1], record.p[::2], rtol=1e-14, atol=1e-18)
    np.testing.assert_allclose(-moved[:, centre, 0], record.q[::2], rtol=1e-14, atol=1e-18)
    np.testing.assert_allclose(turned[:, centre], record.phi[::2], rtol=1e-14, atol=1e-18)


@pytest.mark.parametrize("direction", [30.0, 90.0])
def test_the_displacement_of_a_record_is_that_of_its_sphere_in_any_direction(direction: float, tmp_path: Path) -> None:
    changes = {"wave.direction": direction, "time.duration": 4.0, "time.sample": 1.0, "output.particles": 1.0}
    record = run(Scene.load("tr_periodic").with_values(changes), tmp_path / "run")
    snapshots = record.snapshots()
    moved = snapshots.stack("displacement")[:, centre(snapshots.crystal)]
    np.testing.assert_allclose(record.displacement[:, 0], moved, rtol=1e-13, atol=1e-16)  # a few roundings
    assert np.abs(moved).max(axis=0).max() > 0.1


def test_tables_hold_what_the_snapshots_do_with_units(seen: Scene, tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    snapshots = run(seen, tmp_path / "run").snapshots()
    data, table = snapshots.to_xarray(), snapshots.to_pandas()
    assert dict(data.sizes) == {"tau": 3, "sphere": 24}
    moved, spin = snapshots.stacks("displacement", "spin")
    np.testing.assert_array_equal(data.u, moved[..., 0])
    np.testing.assert_array_equal(data.phi_t, spin)
    np.testing.assert_array_equal(data.row, snapshots.crystal.arrays["row"])
    assert [data[name].attrs["units"] for name in ("tau", "v", "phi", "phi_t")] == [
        "t0",
        "D0",
        "D0/R rad",
        "D0/R rad/t0",
    ]
    assert data.attrs["D0_m"] == seen.displacement_amplitude
    chosen = table[(table.tau == snapshots.tau[1]) & (table.row == 4)]
    np.testing.assert_array_equal(chosen.v, data.v.isel(tau=1)[data.row == 4])


def test_the_first_snapshot_is_the_wave_that_was_asked_for(seen: Scene, tmp_path: Path) -> None:
    run(seen, tmp_path / "run")
    deck = build(seen)
    wave = plane_wave(deck.packing, deck.problem.wave.mode)
    first = Snapshots.load(tmp_path / "run")[0]
    # A position of 3e3 nm resolves 5e-13 nm, 1e-11 of D0; the data file holds 13 decimals
    moved, rate = wave.displacement[:, PLANE], wave.velocity[:, PLANE]
    np.testing.assert_allclose(np.column_stack([first.displacement, first.rotation]), moved, atol=1e-10)
    np.testing.assert_allclose(np.column_stack([first.velocity, first.spin]), rate, atol=1e-12)


def test_kinetic_energy_is_that_of_translation_and_of_a_solid_sphere_s_spin() -> None:
    still = np.zeros(1)
    moving = Spheres(0.0, np.zeros((1, 2)), np.array([[3.0, 4.0]]), rotation=still, spin=np.array([5.0]))
    assert moving.energy == pytest.approx([(25 + 0.4 * 25) / 2], rel=1e-15)


def test_ase_reads_every_digit(seen: Scene, tmp_path: Path) -> None:
    run(seen, tmp_path / "run")
    path = tmp_path / "run" / "dump.particles"
    frames = ase.io.read(path, index=":", format="lammps-dump-text", specorder=["X", "X"])
    lines = path.read_text().split("\n")
    table = np.array([line.split() for line in lines[9 : 9 + 24]], dtype=float)
    names = lines[8].split()[2:]
    column = {name: table[:, names.index(name)] for name in names}
    assert len(frames) == 3
    # ASE takes numbers of length for Å unless told otherwise, so that none is changed
    np.testing.assert_array_equal(frames[0].positions, np.column_stack([column[name] for name in "xyz"]))
    np.testing.assert_array_equal(np.ravel(frames[0].arrays["v_theta"]), column["v_theta"])  # before ASE 3.28 a column
    np.testing.assert_array_equal(frames[0].arrays["type"], column["type"])
    assert frames[0].get_velocities() is not None
    assert frames[0].pbc.tolist() == [True, True, True]
    # In its own units, Å: lattice of the deck, moved as the snapshot says
    nano = ase.io.read(path, index=0, format="lammps-dump-text", specorder=["X", "X"], units="nano")
    packing = build(seen).packing
    metre = units_for(seen.sphere.radius).number(1.0, length=1)
    rest = nano.positions / 10 - np.column_stack([column["Displacement.X"], column["Displacement.Y"], 0 * column["x"]])
    # rounding of positions of 3e3 nm
    np.testing.assert_allclose(rest, packing.positions * seen.sphere.radius * metre, atol=2e-12)


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({}, "vx vy vz omegaz v_theta"),
        ({"effects.tracking": False}, "vx vy vz omegaz"),
        ({"wave.mode": "L"}, "vx vy vz"),
    ],
)
def test_columns_have_the_names_that_ovito_maps_by_itself(
    changes: dict[str, object], names: str, seen: Scene, tmp_path: Path
) -> None:
    run(seen.with_values(changes), tmp_path / "run")
    header = (tmp_path / "run" / "dump.particles").read_text().split("\n")[8]
    assert header == f"ITEM: ATOMS id type x y z radius Displacement.X Displacement.Y {names}"
    rotation = Snapshots.load(tmp_path / "run")[1].rotation
    assert np.isnan(rotation).all() == ("tracking" in str(changes))
    assert np.any(rotation != 0) == (changes.get("wave.mode") != "L")


@pytest.mark.parametrize("cut", [30, 400, 2000])
def test_a_mended_dump_of_many_spheres_is_that_of_one_run(cut: int, seen: Scene, tmp_path: Path) -> None:
    run(seen, tmp_path / "run")
    dump = tmp_path / "run" / "dump.particles"
    text = dump.read_text()
    parts = ["ITEM: TIMESTEP" + part for part in text.split("ITEM: TIMESTEP")[1:]]
    dump.write_text("".join(parts[:2]) + parts[2][:cut] + "".join(parts[1:]) + parts[0][:cut])
    assert [each.step for each in whole_snapshots(dump)] == [0, 20, 20, 40]
    mend_dump(dump)
    assert dump.read_text() == text


def test_a_run_to_a_tolerance_shows_the_snapshots_of_its_answer(seen: Scene, tmp_path: Path) -> None:
    record = run(seen.with_values({"time.tolerance": 1e-3}), tmp_path / "run")
    snapshots = Snapshots.load(tmp_path / "run")
    assert (snapshots.path.parent, snapshots.step) == (tmp_path / "run", 0.0)
    np.testing.assert_allclose(snapshots.tau, record.tau[::2])
    centre = seen.shape.centre_row * seen.shape.columns + seen.shape.columns // 2
    # Sums of three numbers of order 1
    np.testing.assert_allclose(snapshots.stack("displacement")[:, centre, 1], record.p[::2], atol=1e-14)
    assert snapshots[2].rotation[centre] == pytest.approx(record.phi[4], abs=1e-14)
    assert record.info["errors_of_monitors"]["output.particles.v"] <= 1e-3


def test_a_run_without_snapshots_says_what_its_scene_needs(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    with pytest.raises(RunFolderError, match=r"no snapshots of all spheres; run its scene with output\.particles"):
        Snapshots.load(tmp_path / "run")


def test_a_dump_of_something_else_is_refused(seen: Scene, tmp_path: Path) -> None:
    run(seen, tmp_path / "run")
    dump = of_first_format(tmp_path / "run") / "dump.particles"  # which no digest protects
    dump.write_text(dump.read_text().replace("Displacement.X", "c_d"))
    with pytest.raises(RunFolderError, match="not a dump of these spheres"):
        Snapshots.load(tmp_path / "run")[0]
    dump.write_text("a\n" * 20)
    assert len(Snapshots.load(tmp_path / "run")) == 0


def test_a_study_of_costs_takes_no_snapshots_of_its_own(seen: Scene) -> None:
    assert base(seen) == base(seen.with_values({"output.particles": 0.0}))


def test_a_second_run_leaves_no_snapshots_of_the_first(small: Scene, seen: Scene, tmp_path: Path) -> None:
    run(seen, tmp_path / "run")
    assert isinstance(run(small, tmp_path / "run", force=True), Record)
    assert not (tmp_path / "run" / "dump.particles").exists()
