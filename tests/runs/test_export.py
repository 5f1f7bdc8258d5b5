"""A run for other programs, read back by the program that each format is for."""

import csv
import errno
import json
import os
import re
import shutil
import sys
import weakref
import zipfile
from pathlib import Path
from typing import Any

import ase.io
import numpy as np
import pytest

from granular_lmp import Record, Scene, run
from granular_lmp.cli import main
from granular_lmp.errors import PackageMissingError, RunFolderError
from granular_lmp.lammps.outputs import whole
from granular_lmp.runs.export import export
from granular_lmp.runs.front import Front
from granular_lmp.runs.snapshots import Snapshots, Spheres
from tests.manual import Measure, Mutant, off, verifies


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    scene = Scene.load("tr_periodic").with_values({"time.duration": 4.0, "output.particles": 2.0})
    return run(scene, tmp_path_factory.mktemp("export") / "run")


def test_what_cannot_be_exported_leaves_no_file_and_no_new_folder(record: Record, tmp_path: Path) -> None:
    for name, monitor in (("a.csv", "none"), ("a.zip/b.csv", None)):
        (tmp_path / "a.zip").write_bytes(b"in the way")
        with pytest.raises(RunFolderError):
            export(record, tmp_path / "new" / "dir" / name if monitor else tmp_path / name, monitor)
        assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


@pytest.mark.parametrize("ending", ["png", "xyz", "zip"])
def test_a_full_disk_leaves_the_file_of_before(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{ending}"
    path.write_bytes(b"before")

    def full() -> None:
        with whole(path) as draft:
            assert draft.suffix == path.suffix  # by which programs choose the format
            draft.write_bytes(b"part")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(RunFolderError, match=rf"a\.{ending}: cannot be written: No space left on device"):
        full()
    assert path.read_bytes() == b"before"
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@verifies(
    "Export in SI units: time, displacements and angle, relative",
    reference="analytic: τ t0, p D0, φ D0/R",
    tolerance=1e-14,
    reason="a rounding or two of each number",
    mutant=Mutant(
        "granular_lmp/runs/tables.py", '"phi": ("theta_rad", unit, radius)', '"phi": ("theta_rad", unit, 2 * radius)'
    ),
)
def test_the_csv_holds_the_trajectory_in_si_units(record: Record, tmp_path: Path, measured: Measure) -> None:
    export(record, tmp_path / "new" / "si.csv")
    with (tmp_path / "new" / "si.csv").open(encoding="utf-8", newline="") as stream:
        names, *lines = csv.reader(stream)
    assert names == ["t_s", "p_m", "q_m", "theta_rad"]
    t, p, q, theta = np.array(lines, dtype=float).T
    info, radius = record.info, record.scene.sphere.radius
    d0 = info["amplitude"] * info["Delta0_m"]
    for found, expected in ((t, record.tau * info["t0_s"]), (p, record.p * d0), (q, record.q * d0)):
        measured(off(found, expected))
    measured(off(theta * radius / d0, record.phi))


def test_xarray_reads_the_netcdf_with_units_and_scales(record: Record, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    export(record, tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc") as read:
        for name, values in record.columns.items():
            np.testing.assert_array_equal(read[name].to_numpy(), values)
        assert [read[name].attrs["units"] for name in ("tau", "p", "q", "phi")] == ["t0", "D0", "D0", "D0/R rad"]
        assert read.attrs["t0_s"] == record.scene.sphere.time_scale
        assert read.attrs["D0_m"] == record.scene.wave.amplitude * record.scene.sphere.static_overlap
        assert Scene.loads(read.attrs["scene"]) == record.scene
        assert read.attrs["status"] == "finished"


def test_ase_reads_the_extended_xyz(record: Record, tmp_path: Path) -> None:
    export(record, tmp_path / "run.xyz")
    frames = ase.io.read(tmp_path / "run.xyz", index=":", format="extxyz")
    particles = record.snapshots()
    assert [atoms.info["tau"] for atoms in frames] == list(particles.tau)
    d0 = record.scene.wave.amplitude * record.scene.sphere.static_overlap / record.scene.sphere.radius
    for atoms, spheres in zip(frames, particles, strict=False):
        np.testing.assert_array_equal(atoms.arrays["displacement"], spheres.displacement)
        np.testing.assert_array_equal(atoms.arrays["velocity"], spheres.velocity)
        np.testing.assert_array_equal(atoms.arrays["rotation"], spheres.rotation)
        np.testing.assert_array_equal(atoms.arrays["spin"], spheres.spin)
        expected = particles.rest + spheres.displacement * d0
        np.testing.assert_allclose(atoms.positions[:, :2], expected, rtol=0, atol=1e-13)  # roundings of 12 radii
        np.testing.assert_array_equal(atoms.cell, particles.crystal.cell)
        np.testing.assert_array_equal(atoms.arrays["radius"], 1.0)
        assert list(atoms.arrays["id"]) == list(range(1, 49))
        assert list(atoms.pbc) == [True, True, False]


def exported(record: Record, path: Path) -> Any:
    """Return the HDF5 file of a run, open for reading; skipped without h5py."""
    h5py = pytest.importorskip("h5py")
    export(record, path)
    return h5py.File(path, "r")


def test_h5py_reads_every_snapshot_with_its_units(record: Record, tmp_path: Path) -> None:
    particles, scene = record.snapshots(), record.scene
    nano = 1e-9
    length, time = scene.displacement_amplitude / nano, scene.sphere.time_scale / nano
    radius = scene.sphere.radius / nano
    with exported(record, tmp_path / "run.h5") as file:
        group = file["particles/trajectory"]
        for name, unit, scale in (
            ("displacement", "nm", length),
            ("rotation", "rad", length / radius),
            ("spin", "rad ns-1", length / radius / time),
        ):
            element = group[name]
            assert element["value"].attrs["unit"] == unit
            # Products of three factors: a rounding of each
            np.testing.assert_allclose(element["value"][:], particles.stack(name) * scale, rtol=1e-15, atol=0)
            np.testing.assert_allclose(element["time"][:], particles.tau * time, rtol=1e-15, atol=0)
            assert list(element["step"]) == [each.step for each in particles.index]
        velocity = particles.stack("velocity") * length / time
        np.testing.assert_allclose(group["velocity/value"][:, :, :2], velocity, rtol=1e-15, atol=0)
        assert not group["velocity/value"][:, :, 2].any()
        assert group["time"].attrs["unit"] == "ns"
        np.testing.assert_allclose(group["radius"][:], radius, rtol=1e-15)
        assert list(group["id"]) == list(range(1, 49))
        assert set(group["species"]) == {group["species"].attrs["moving"]} == {1}
        box, said = group["box"], file["parameters"].attrs
        assert [part.decode() if isinstance(part, bytes) else part for part in box.attrs["boundary"]] == [
            "periodic",
            "periodic",
            "none",
        ]
        edges, position = box["edges/value"][:], group["position/value"][:]
        np.testing.assert_allclose(edges[0], np.diag(particles.crystal.cell.array) * radius, rtol=1e-15)
        assert (position >= 0).all()
        assert (position <= edges[:, None, :]).all()
        # Where the deck has them, in radii: roundings of 28 radii, the cell
        back = position * nano + said["origin_m"]
        expected = particles.rest + particles.stack("displacement") * length / radius
        np.testing.assert_allclose(back[..., :2] / scene.sphere.radius, expected, rtol=0, atol=1e-13)
        assert Scene.loads(said["scene"]) == scene
        assert said["t0_s"] == scene.sphere.time_scale
        assert said["D0_m"] == scene.displacement_amplitude
        assert said["status"] == "finished"
        assert list(file["h5md"].attrs["version"]) == [1, 1]


def test_held_spheres_have_their_own_species_and_walls_are_not_periodic(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    changes = {"packing.rows": 21, "time.duration": 2.0, "time.allow_echo": True, "output.particles": 1.0}
    walled = run(Scene.load("tr_nonresonant").with_values(changes), tmp_path / "walls")
    with exported(walled, tmp_path / "walls.h5md") as file:
        group = file["particles/trajectory"]
        held = walled.snapshots().held
        assert held.sum() == 6
        np.testing.assert_array_equal(group["species"][:] == group["species"].attrs["held"], held)
        assert list(group["box"].attrs["boundary"]) == ["periodic", "none", "none"]


def test_no_more_than_two_snapshots_are_in_memory(
    record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("h5py")
    read, alive = Snapshots.__getitem__, []

    def watched(self: Snapshots, number: int) -> Spheres:
        assert sum(each() is not None for each in alive) <= 1  # beside this one, the one before
        spheres = read(self, number)
        alive.append(weakref.ref(spheres))
        return spheres

    monkeypatch.setattr(Snapshots, "__getitem__", watched)
    export(record, tmp_path / "run.h5")
    assert len(alive) == len(record.snapshots()) == 3


def test_mdanalysis_reads_the_hdf5_file(record: Record, tmp_path: Path) -> None:
    mda = pytest.importorskip("MDAnalysis")
    exported(record, tmp_path / "run.h5md").close()
    universe, particles = mda.Universe(tmp_path / "run.h5md", to_guess=()), record.snapshots()
    assert len(universe.trajectory) == len(particles)
    assert len(universe.atoms) == 48
    angstrom, picosecond = 1e-10, 1e-12
    radius, t0 = record.scene.sphere.radius, record.scene.sphere.time_scale
    unit = record.scene.displacement_amplitude
    corner = particles.crystal.get_celldisp().ravel()
    for frame, spheres in zip(universe.trajectory, particles, strict=False):
        assert frame.time == pytest.approx(spheres.tau * t0 / picosecond, rel=1e-14)  # roundings of units
        place = (particles.rest - corner[:2]) * radius + spheres.displacement * unit
        # Single precision
        np.testing.assert_allclose(universe.atoms.positions[:, :2], place / angstrom, rtol=3e-7)
        speed = spheres.velocity * unit / t0 / angstrom * picosecond
        np.testing.assert_allclose(universe.atoms.velocities[:, :2], speed, rtol=0, atol=3e-7 * np.abs(speed).max())
        np.testing.assert_allclose(frame.dimensions[3:], 90.0)


def test_the_block_of_the_how_to_page_reads_the_hdf5_file(
    record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exported(record, tmp_path / "seen.h5md").close()
    page = (Path(__file__).parents[2] / "docs" / "how-to.md").read_text("utf-8")
    (block,) = re.findall(r'^```python title="with h5py"\n(.*?)^```', page, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    exec(block, found)
    spheres = record.snapshots()[-1]
    expected = np.abs(spheres.displacement).max() * record.scene.displacement_amplitude
    assert found["largest"] == pytest.approx(expected / 1e-9, rel=1e-14)  # roundings of a product


def test_without_h5py_the_package_is_named(record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(PackageMissingError, match="h5py is not installed; pip install h5py"):
        export(record, tmp_path / "run.h5")


def test_the_page_of_files_names_the_columns_of_the_tables(record: Record, tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs/reference/run-folder.md").read_text("utf-8")
    export(record, tmp_path / "a.csv")
    empty = Front(dict.fromkeys(["row", "column"], np.empty(0)), *(np.empty(0) for _ in range(4)))
    heads = {*(tmp_path / "a.csv").read_text().partition("\n")[0].split(","), *record.columns, *empty.columns}
    assert [name for name in sorted(heads) if f"`{name}`" not in page] == []


def graph_of(metadata: str) -> dict[str, dict[str, Any]]:
    """Return the entities of a crate by their @id."""
    return {entity["@id"]: entity for entity in json.loads(metadata)["@graph"]}


def missing(graph: dict[str, dict[str, Any]]) -> list[str]:
    """Return what a Process Run Crate 0.5 must or should say, and this one does not; a licence and an agent are not
    known to a run."""
    profile = "https://w3id.org/ro/wfrun/process/0.5"
    found = []
    if graph["./"].get("conformsTo") != {"@id": profile} or graph.get(profile, {}).get("@type") != "CreativeWork":
        found.append("conformsTo")
    actions = [entity for entity in graph.values() if entity["@type"] == "CreateAction"]
    mentioned = [each["@id"] for each in graph["./"].get("mentions", [])]
    for action in actions:
        if action["@id"] not in mentioned:
            found.append("mentions")
        tool = graph.get(action["instrument"]["@id"], {})
        if tool.get("@type") != "SoftwareApplication":
            found.append("instrument")
        found += [key for key in ("name", "softwareVersion") if not tool.get(key)]
        found += [key for key in ("name", "description", "endTime", "object", "result") if not action.get(key)]
        for file in (*action["object"], *action["result"]):
            found += [] if graph.get(file["@id"], {}).get("@type") == "File" else [file["@id"]]
    return found if actions else ["CreateAction"]


def test_a_crate_says_which_program_made_which_file(record: Record, tmp_path: Path) -> None:
    pytest.importorskip("rocrate")
    export(record, tmp_path / "crate")
    graph = graph_of((tmp_path / "crate" / "ro-crate-metadata.json").read_text())
    assert missing(graph) == []
    assert graph["ro-crate-metadata.json"]["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert {each["@id"] for each in graph["./"]["hasPart"]} == {*record.info["files"], "run.json"}
    made = {
        graph[entity["instrument"]["@id"]]["name"]: {each["@id"] for each in entity["result"]}
        for entity in graph.values()
        if entity["@type"] == "CreateAction"
    }
    assert made["LAMMPS"] == {"dump.centre", "dump.particles", "log.lammps"}
    assert made["granular-lmp"] == {"data.tr_periodic", "in.tr_periodic", "run.json", "trajectory.csv"}
    assert Record.load(tmp_path / "crate").p.tolist() == record.p.tolist()  # it is a run folder too
    graph["./"]["mentions"].pop()
    del graph["#granular-lmp"]["softwareVersion"]
    assert missing(graph) == ["softwareVersion", "mentions"]


def test_a_crate_is_an_archive_too_and_replaces_no_folder(record: Record, tmp_path: Path) -> None:
    pytest.importorskip("rocrate")
    export(record, tmp_path / "run.zip")
    with zipfile.ZipFile(tmp_path / "run.zip") as archive:
        assert missing(graph_of(archive.read("ro-crate-metadata.json").decode())) == []
    (tmp_path / "crate").mkdir()
    (tmp_path / "crate" / "mine").touch()
    with pytest.raises(RunFolderError, match="crate: exists already and is not empty; choose another folder"):
        export(record, tmp_path / "crate")


def test_a_folder_of_the_user_is_no_part_of_a_crate(record: Record, tmp_path: Path) -> None:
    pytest.importorskip("rocrate")
    assert record.folder is not None
    shutil.copytree(record.folder, tmp_path / "run")
    (tmp_path / "run" / "mine_per_sample").mkdir()
    (tmp_path / "run" / "mine_per_sample" / "run.json").touch()
    export(Record.load(tmp_path / "run"), tmp_path / "crate")
    graph = graph_of((tmp_path / "crate" / "ro-crate-metadata.json").read_text())
    assert {each["@id"] for each in graph["./"]["hasPart"]} == {*record.info["files"], "run.json"}


def test_without_rocrate_the_package_is_named(record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rocrate", None)
    monkeypatch.delitem(sys.modules, "rocrate.rocrate", raising=False)
    with pytest.raises(PackageMissingError, match="rocrate is not installed; pip install rocrate"):
        export(record, tmp_path / "crate")


def test_what_cannot_be_exported_is_one_line(
    record: Record, small: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(
        RunFolderError, match=r"run.hdf: must end in one of .csv, .nc, .xyz, .extxyz, .h5md, .h5, crate, .zip$"
    ):
        export(record, tmp_path / "run.hdf")
    run(small, tmp_path / "small")
    assert main(["export", str(tmp_path / "small"), "-o", str(tmp_path / "a.xyz")]) == 2
    assert "holds no snapshots of all spheres; run its scene with output.particles" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "small"), "-o", str(tmp_path / "a.csv")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'a.csv'}\n"
