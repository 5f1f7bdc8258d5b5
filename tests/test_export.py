"""A run for other programs, read back by the program that each format is for."""

import csv
from pathlib import Path

import ase.io
import numpy as np
import pytest

from granular_lmp import Record, Scene, run
from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError
from granular_lmp.runs.export import export


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    scene = Scene.load("tr_periodic").with_values({"time.duration": 4.0, "output.particles": 2.0})
    return run(scene, tmp_path_factory.mktemp("export") / "run")


def test_the_csv_holds_the_trajectory_in_si_units(record: Record, tmp_path: Path) -> None:
    export(record, tmp_path / "new" / "si.csv")
    with (tmp_path / "new" / "si.csv").open(encoding="utf-8", newline="") as stream:
        names, *lines = csv.reader(stream)
    assert names == ["t_s", "p_m", "q_m", "theta_rad"]
    t, p, q, theta = np.array(lines, dtype=float).T
    info, radius = record.info, record.scene.sphere.radius
    d0 = info["amplitude"] * info["Delta0_m"]
    for found, expected in ((t, record.tau * info["t0_s"]), (p, record.p * d0), (q, record.q * d0)):
        np.testing.assert_allclose(found, expected, rtol=1e-14)
    np.testing.assert_allclose(theta * radius / d0, record.phi, rtol=1e-14)


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


def test_what_cannot_be_exported_is_one_line(
    record: Record, small: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RunFolderError, match=r"run.hdf: must end in one of .csv, .nc, .xyz, .extxyz"):
        export(record, tmp_path / "run.hdf")
    run(small, tmp_path / "small")
    assert main(["export", str(tmp_path / "small"), "-o", str(tmp_path / "a.xyz")]) == 2
    assert "holds no snapshots of all spheres; run its scene with output.particles" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "small"), "-o", str(tmp_path / "a.csv")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'a.csv'}\n"
