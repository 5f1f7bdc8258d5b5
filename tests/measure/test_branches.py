"""Branches of an unnamed crystal, whose lattice is found by itself, are those of theory."""

from pathlib import Path

import numpy as np
import pytest

from granular_analysis.cli import main
from granular_analysis.measure.found_lattice import found_lattice
from granular_analysis.theory.bloch import real_modes
from granular_analysis.theory.contact import Contact
from granular_analysis.tools.branches import Branches, branches
from granular_lmp import Record, Scene, run
from granular_lmp.foreign.adopt_dump import adopt_dump
from granular_lmp.foreign.conversion import Known
from granular_lmp.runs.unnamed import Unnamed
from granular_lmp.studies.kick import kicked

Both = tuple[Record, Unnamed]


def thrown_away(record: Record, folder: Path) -> Unnamed:
    """Return the unnamed crystal of the dump of a run alone."""
    scene = record.scene
    step = scene.units.number(scene.time.step * scene.scale.time, time=1)
    assert record.folder is not None
    return adopt_dump([record.folder / "dump.particles"], folder, Known(scene.units.style, step))


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> Both:
    """A sheet kicked at random, and what its dump alone says."""
    folder = tmp_path_factory.mktemp("kicked")
    changes = {"packing.rows": 16, "packing.columns": 4, "time.duration": 120.0, "wave.amplitude": 1e-3}
    record = run(kicked(Scene.load("tr_periodic").with_values(changes)), folder / "run")
    return record, thrown_away(record, folder / "adopted")


def theory_of(record: Record, found: Branches) -> np.ndarray:
    """Return the frequencies (K, 3) of theory at the wave numbers, Hz."""
    sphere, unit = record.scene.sphere, np.linalg.norm(found.lattice.vectors[0])
    contact = Contact(sphere.poisson_ratio, overlap_ratio=sphere.overlap_ratio)
    vectors = np.outer(found.wavenumbers * unit, found.way[:2])
    return np.asarray(real_modes(vectors, contact)[0] / record.scene.scale.time / (2 * np.pi))


def misses(record: Record, found: Branches) -> np.ndarray:
    """Return how far each peak is from the nearest branch, in resolutions."""
    theory = theory_of(record, found)
    number = np.searchsorted(found.wavenumbers, found.rows[:, 0] * (1 - 1e-9))
    return np.asarray(np.min(np.abs(theory[number] - found.rows[:, 1:2]), axis=1) / found.resolution)


@pytest.mark.parametrize("way", [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0)], ids=["along y", "along x"])
def test_branches_of_a_dump_are_those_of_theory(way: tuple[float, float, float], sheet: Both) -> None:
    record, crystal = sheet
    found = branches(crystal, way)
    assert found.fits
    assert len(found.rows) >= 2 * len(found.wavenumbers)
    off = misses(record, found)
    # A peak that overlaps another is shifted by a part of the resolution, and most are alone
    assert np.median(off) < 0.02
    assert off.max() < 1


def test_waves_across_the_plane_of_a_sheet_are_refused(sheet: Both) -> None:
    with pytest.raises(ValueError, match="all spheres lie in one plane across the direction"):
        branches(sheet[1], (0.0, 0.0, 1.0))


def test_other_spheres_are_seen_by_that_comparison(sheet: Both) -> None:
    record, crystal = sheet
    found = branches(crystal, (0.0, 1.0, 0.0))
    other = record.scene.with_values({"sphere.youngs_modulus": 1.2 * record.scene.sphere.youngs_modulus})
    assert np.median(misses(Record(record.tau, record.signals, other), found)) > 0.1


def test_the_lattice_of_a_dump_is_that_of_its_scene(sheet: Both) -> None:
    record, crystal = sheet
    lattice = branches(crystal).lattice
    spacing = 2 * record.scene.sphere.radius - record.scene.sphere.static_overlap
    assert len(lattice.vectors) == 2
    np.testing.assert_allclose(np.linalg.norm(lattice.vectors, axis=1), spacing, rtol=1e-9)
    # M of the hexagonal lattice along y, and its face along x
    assert lattice.zone_edge(np.array([0.0, 1.0, 0.0])) == pytest.approx(2 * np.pi / np.sqrt(3) / spacing)
    assert lattice.zone_edge(np.array([1.0, 0.0, 0.0])) == pytest.approx(4 * np.pi / 3 / spacing)


def test_a_wave_thrown_away_has_the_same_p_and_q(tmp_path: Path) -> None:
    scene = Scene.load("tr_periodic").with_values({"time.duration": 10.0, "output.particles": 0.5})
    record = run(scene, tmp_path / "run")
    crystal = thrown_away(record, tmp_path / "adopted")
    snapshots = record.snapshots()
    moved = crystal.stack("displacement") / scene.displacement_amplitude
    own = snapshots.stack("displacement")
    # Places in the dump have 17 digits of 1e4 nm, and D0 is 0.03 nm
    np.testing.assert_allclose(moved[..., :2], own - own[0], atol=1e-9)
    centre = int(np.argmin(np.abs(own[:, :, 1] - np.interp(snapshots.tau, record.tau, record.p)[:, None]).max(axis=0)))
    there = np.isin(record.tau, snapshots.tau)
    np.testing.assert_allclose(moved[:, centre, 1], record.p[there] - record.p[0], atol=1e-9)
    np.testing.assert_allclose(-moved[:, centre, 0], record.q[there] - record.q[0], atol=1e-9)
    assert np.abs(moved[:, centre, 0]).max() > 0.1


def test_spheres_of_two_masses_make_a_cell_of_two(tmp_path: Path) -> None:
    record = run(Scene.load("breather").with_values({"time.duration": 6.0}), tmp_path / "run")
    crystal = adopt_dump([tmp_path / "run/dump.particles"], tmp_path / "adopted", Known("lj", record.scene.time.step))
    lattice = branches(crystal).lattice
    np.testing.assert_allclose(lattice.vectors, [[0, 4, 0]], atol=2e-3)  # radii, and the chain is compressed
    assert len(np.unique(lattice.site)) == 2


CRYSTALS = {  # vectors and sites of a cell
    "square": ([[1, 0], [0, 1]], [[0, 0]], [0]),
    "honeycomb": ([[3**0.5, 0], [3**0.5 / 2, 1.5]], [[0, 0], [3**0.5 / 2, 0.5]], [0, 0]),
    "kagome": ([[2, 0], [1, 3**0.5]], [[0, 0], [1, 0], [0.5, 3**0.5 / 2]], [0, 0, 0]),
    "two kinds": ([[1, 0], [0, 2]], [[0, 0], [0, 1]], [0, 1]),
}


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("name", CRYSTALS)
def test_the_lattice_is_found_from_places_alone(name: str, periodic: bool) -> None:
    vectors, sites, kinds = (np.array(each) for each in CRYSTALS[name])
    cells = np.array([(i, j) for i in range(12) for j in range(12)]) @ vectors
    places = np.zeros((len(cells) * len(sites), 3))
    places[:, :2] = (cells[:, None] + sites).reshape(-1, 2)
    shaken = np.random.default_rng(2).permutation(len(places))
    places, kind = places[shaken], np.tile(kinds, len(cells))[shaken]
    cell = np.eye(3)
    cell[:2, :2] = 12 * vectors
    found = found_lattice(places, kind, cell, np.array([periodic, periodic, True]))
    assert len(found.vectors) == 2
    area = abs(np.linalg.det(found.vectors[:, :2]))
    assert area == pytest.approx(abs(np.linalg.det(vectors)))
    assert len(np.unique(found.site)) == len(sites)
    steps = found.vectors[:, :2] @ np.linalg.inv(vectors)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_spheres_in_no_order_have_no_lattice() -> None:
    places = np.random.default_rng(3).random((200, 3))
    found = found_lattice(places, np.zeros(200, dtype=int), np.eye(3), np.zeros(3, dtype=bool))
    assert not len(found.vectors)
    assert found.zone_edge(np.array([1.0, 0.0, 0.0])) == np.inf


def test_the_command_prints_the_branches(sheet: Both, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, crystal = sheet
    main(["branches", str(crystal.folder), "--direction", "90", "-o", str(tmp_path / "b.png")])
    out = capsys.readouterr().out
    assert "sites in a cell: 1" in out
    assert (tmp_path / "b.png").stat().st_size > 1000
    assert (tmp_path / "b.csv").read_text().startswith("wavenumber,frequency,along,power\n")
    with pytest.raises(SystemExit, match="is the run of a scene"):
        main(["branches", str(sheet[0].folder)])
