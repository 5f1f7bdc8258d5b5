"""Dumps of contacts of anybody's deck are the contacts of its unnamed crystal."""

import gzip
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError, ViewError
from granular_lmp.foreign.adopt_dump import adopt_dump
from granular_lmp.foreign.conversion import Known
from granular_lmp.foreign.local_columns import local_dumps
from granular_lmp.foreign.reading import read
from granular_lmp.lammps.local_dump import is_local, local_snapshots
from granular_lmp.plot.view import view
from granular_lmp.runs.export import export
from granular_lmp.runs.unnamed import Unnamed
from tests.foreign.test_to_scene import PLATE
from tests.instance import run_deck

DUMPS = """
compute ids all property/local patom1 patom2 cutoff type
compute forces all pair/local dist force fx fy fz p1 p2 p3 p4
dump 2 all local 20 dump.local c_ids[*] c_forces[*]
dump_modify 2 format float %.17g
dump 3 all local 20 dump.label.gz index c_forces[1*2] c_ids[2] c_ids[1] c_forces[9]
dump_modify 3 label CONTACTS time yes units yes colname c_ids[1] one
run 200
"""
WORDS = ["patom1", "patom2", "dist", "force", "fx", "fy", "fz", "p1", "p2", "p3", "p4"]
KNOWN = Known("si", 2e-6, [0.01], [2500.0])


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a plate whose contacts LAMMPS wrote."""
    folder = tmp_path_factory.mktemp("plate")
    # An oblique strike, so that contacts are sheared
    (folder / "in.plate").write_text(PLATE.replace("set -1.0 0.0", "set -0.8 -0.6").replace("\nrun 200\n", DUMPS))
    run_deck(folder, "in.plate")
    return folder


@pytest.fixture(scope="module")
def adopted(plate: Path) -> Unnamed:
    """The run folder of this plate."""
    return adopt_dump([plate / "dump.plate"], plate / "adopted", KNOWN, contacts={plate / "dump.local": WORDS})


def test_the_contacts_are_those_that_the_places_say(adopted: Unnamed) -> None:
    columns = adopted.contact_columns
    moments, modulus = np.unique(columns["t_s"]), 7e10 / (2 * (1 - 0.22**2))
    assert len(moments) == len(adopted) == 11
    last = columns["t_s"] == moments[5]
    overlap, normal = columns["overlap_m"][last], columns["normal_N"][last]
    pairs = adopted.contacts(adopted[5])
    deep = overlap > 1e-12  # those that just touch are there or not by rounding
    np.testing.assert_allclose(np.sort(overlap[deep]), np.sort(pairs.overlap[pairs.overlap > 1e-12]), atol=1e-15)
    # Hertz, of two spheres with R/2; an overlap is known to the rounding of 0.02 m
    hertz = 4 / 3 * modulus * np.sqrt(0.005) * np.maximum(overlap, 0.0) ** 1.5
    np.testing.assert_allclose(normal, hertz, rtol=1e-9, atol=1e-6)
    parts = np.stack([columns[f"normal_{axis}_N"][last] for axis in "xyz"])
    np.testing.assert_allclose(np.linalg.norm(parts, axis=0), normal, rtol=1e-9, atol=1e-12)
    across = np.stack([columns[f"shear_{axis}_N"][last] for axis in "xyz"])
    assert np.abs(np.sum(parts * across, axis=0)).max() < 1e-9 * normal.max() ** 2
    assert columns["shear_N"][last].max() > 1.0


def test_another_force_is_seen_by_that_comparison(adopted: Unnamed) -> None:
    normal = adopted.recorded_contacts(5)["force"]
    assert not np.allclose(normal, 1.001 * normal, rtol=1e-9, atol=1e-6)


def test_a_deck_says_what_its_columns_hold(plate: Path, adopted: Unnamed, capsys: pytest.CaptureFixture[str]) -> None:
    found = {path.name: words for path, words in local_dumps(read(plate / "in.plate")).items()}
    assert found["dump.local"] == WORDS
    assert found["dump.label.gz"] == ["-", "dist", "force", "patom2", "patom1", "p4"]
    asked = ["adopt", str(plate / "in.plate"), str(plate / "dump.plate"), str(plate / "dump.local")]
    assert main([*asked, "-o", str(plate / "by_deck")]) == 0
    for name in ("by_deck", "adopted"):
        assert main(["export", str(plate / name), "--monitor", "contacts", "-o", str(plate / f"{name}.csv")]) == 0
    assert (plate / "by_deck.csv").read_bytes() == (plate / "adopted.csv").read_bytes()
    assert main(["view", str(plate / "by_deck"), "--monitor", "contacts", "-o", str(plate / "forces.png")]) == 0
    assert main(["view", str(plate / "by_deck"), "--monitor", "other", "-o", str(plate / "forces.png")]) == 2
    capsys.readouterr()


def test_a_labelled_dump_in_gzip_is_read_too(plate: Path, adopted: Unnamed) -> None:
    words = ["-", "dist", "force", "patom2", "patom1", "p4"]
    found = adopt_dump([plate / "dump.plate"], plate / "label", KNOWN, contacts={plate / "dump.label.gz": words})
    here, there = found.recorded_contacts(7), adopted.recorded_contacts(7)
    assert here["patom1"].tolist() == there["patom1"].tolist()
    np.testing.assert_allclose(here["force"], there["force"], rtol=1e-5)  # %g has six digits


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (None, r"what its columns c_ids\[1\] .* hold is not said; give columns=WORDS"),
        (["patom1", "patom2"], "dump.local has 11 columns"),
        (["patom1", "patom2", "dits", *WORDS[3:]], "dits: .*dist"),
        (["-", *WORDS[1:]], "give columns=WORDS"),
    ],
)
def test_columns_that_are_not_known_are_asked_for(words: list[str] | None, message: str, plate: Path) -> None:
    with pytest.raises(RunFolderError, match=message):
        adopt_dump([plate / "dump.plate"], plate / "none", KNOWN, contacts={plate / "dump.local": words})
    assert not (plate / "none").exists()


def test_dumps_of_other_columns_or_the_same_steps_are_refused(plate: Path, tmp_path: Path) -> None:
    place = tmp_path / "run"
    words = ["-", "dist", "force", "patom2", "patom1", "p4"]
    both = {plate / "dump.local": WORDS, plate / "dump.label.gz": words}
    with pytest.raises(RunFolderError, match="begins at step 0, as dump.label.gz does"):
        adopt_dump([plate / "dump.plate"], place, KNOWN, contacts=both)
    text = (plate / "dump.local").read_text()
    (tmp_path / "later").write_text(text.replace("TIMESTEP\n0\n", "TIMESTEP\n10\n"))
    others = {plate / "dump.local": WORDS, tmp_path / "later": [*WORDS[:2], "-", *WORDS[3:]]}
    with pytest.raises(RunFolderError, match=r"later: holds patom1, patom2, -, .* dump.local patom1, patom2, dist"):
        adopt_dump([plate / "dump.plate"], place, KNOWN, contacts=others)


def test_contacts_of_which_the_spheres_alone_are_known_are_not_drawn(plate: Path, tmp_path: Path) -> None:
    contacts = {plate / "dump.local": [*WORDS[:2], *"-" * 9]}
    adopt_dump([plate / "dump.plate"], tmp_path / "run", KNOWN, contacts=contacts)
    with pytest.raises(ViewError, match="have no overlap or magnitude of a force"):
        view(tmp_path / "run", tmp_path / "contacts.svg", monitor="contacts")


def test_the_sphere_of_the_lower_number_stands_first(plate: Path, adopted: Unnamed, tmp_path: Path) -> None:
    swapped = adopt_dump(
        [plate / "dump.plate"],
        tmp_path / "run",
        KNOWN,
        contacts={plate / "dump.local": ["patom2", "patom1", *WORDS[2:]]},
    )
    usual, turned = adopted.contact_columns, swapped.contact_columns
    assert (usual["id_i"] < usual["id_j"]).all()
    for name, values in usual.items():  # what the swapped names say is the force on the other sphere
        sign = -1 if name.startswith(("normal_", "shear_")) and name[-3] in "xyz" else 1
        np.testing.assert_array_equal(turned[name], sign * values, err_msg=name)


def test_all_styles_of_local_dumps_of_a_deck_are_found(plate: Path, tmp_path: Path) -> None:
    text = (plate / "in.plate").read_text().replace("dump 3 all local ", "dump 9 all\ndump 3 all local/gz ")
    (plate / "in.gz").write_text(text)
    assert {path.name for path in local_dumps(read(plate / "in.gz"))} == {"dump.local", "dump.label.gz"}


def test_words_of_columns_need_a_dump_of_contacts(plate: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["adopt", str(plate / "dump.plate"), "-o", str(plate / "none"), "--units", "si", "--timestep", "2e-6"]
    assert main([*asked, "--radius", "0.01", "--columns", "patom1,patom2"]) == 2
    assert "columns = patom1,patom2: there is no dump of contacts" in capsys.readouterr().err


def test_contacts_alone_are_no_crystal(plate: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert is_local(plate / "dump.local")
    assert is_local(plate / "dump.label.gz")
    assert not is_local(plate / "dump.plate")
    for size in (3, 300):
        (plate / "cut.gz").write_bytes((plate / "dump.label.gz").read_bytes()[:size])
        assert is_local(plate / "cut.gz") == (size > 3)
    assert main(["adopt", str(plate / "dump.local"), "-o", str(plate / "alone")]) == 2
    assert "is a dump of contacts; name the dump of their spheres too" in capsys.readouterr().err


def test_a_dump_that_is_cut_keeps_its_whole_snapshots(plate: Path, tmp_path: Path) -> None:
    (tmp_path / "cut").write_bytes((plate / "dump.local").read_bytes()[:-9])
    said: list[str] = []
    assert len(list(local_snapshots(tmp_path / "cut", said.append))) == 10
    assert said == [f"{tmp_path / 'cut'}: the snapshot at its end is cut off, and left out"]
    (tmp_path / "wrong").write_text("ITEM: TIMESTEP\n0\nITEM: NUMBER OF ENTRIES\n1\nITEM: ENTRIES a\nx\n")
    with pytest.raises(RunFolderError, match="not a local dump of LAMMPS"):
        list(local_snapshots(tmp_path / "wrong", said.append))


def test_without_such_a_dump_the_contacts_are_overlaps(plate: Path, tmp_path: Path) -> None:
    found = adopt_dump([plate / "dump.plate"], tmp_path / "run", KNOWN)
    assert found.recorded_contacts(3) == {}
    assert list(found.contact_columns) == ["t_s", "id_i", "id_j", "overlap_m"]
    view(tmp_path / "run", tmp_path / "overlaps.svg", monitor="contacts")
    export(found, tmp_path / "overlaps.csv", "contacts")
    with pytest.raises(ViewError, match="an unnamed crystal has only 'contacts'"):
        view(tmp_path / "run", tmp_path / "overlaps.svg", monitor="forces")


def test_memory_does_not_grow_with_the_snapshots_of_contacts(plate: Path, tmp_path: Path) -> None:
    lines = "".join(f"{n + 1} {n + 2} 0.02 1.5\n" for n in range(2000))
    head = "ITEM: NUMBER OF ENTRIES\n2000\nITEM: BOX BOUNDS pp ff pp\n0 1\n0 1\n0 1\n"
    head += "ITEM: ENTRIES patom1 patom2 dist other\n"
    peaks = []
    for snapshots in (4, 16):
        with gzip.open(tmp_path / f"{snapshots}.gz", "wt", compresslevel=1) as stream:
            stream.writelines(f"ITEM: TIMESTEP\n{20 * n}\n{head}{lines}" for n in range(snapshots))
        tracemalloc.start()
        folder, dumps = tmp_path / f"run{snapshots}", [plate / "dump.plate"]
        adopt_dump(dumps, folder, KNOWN, contacts={tmp_path / f"{snapshots}.gz": None})
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0]  # the same table; four times as many would be 0.5 MB more
