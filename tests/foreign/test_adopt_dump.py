"""Dumps of anybody's LAMMPS become the record of an unnamed crystal, whatever their format."""

import gzip
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp.cli import main
from granular_lmp.errors import ReadoutError, RunFolderError, ViewError
from granular_lmp.foreign.adopt_dump import adopt_dump
from granular_lmp.foreign.conversion import Known
from granular_lmp.lammps.custom_dump import frames
from granular_lmp.lammps.outputs import UNNAMED
from granular_lmp.plot import unnamed
from granular_lmp.plot.view import view
from granular_lmp.runs.export import export
from granular_lmp.runs.front import front
from granular_lmp.runs.record import Record
from granular_lmp.runs.unnamed import Unnamed
from tests.instance import run_deck

ROOT = Path(__file__).parents[2]
# Eight beads of steel in a ring through a box with three tilts; they drift, and one crosses each kind of face
DECK = """
units si
atom_style sphere
boundary p p p
newton off
comm_modify vel yes
region box prism 0 0.159 -0.02 0.02 -0.02 0.02 0.004 -0.003 0.002
create_box 2 box
variable i loop 8
label beads
variable x equal (v_i-1)*0.019875+0.0217
variable t equal 1+v_i%2
create_atoms ${{t}} single $x 0.019 -0.019
next i
jump SELF beads
set group all diameter 0.02 density 7780
pair_style granular
pair_coeff * * hertz/material 2e11 0 0.3 tangential mindlin NULL 0.0 0.3
velocity all set 40 30 -30
group one id 3
velocity one set 41 30 -30
fix 1 all nve/sphere
timestep 2e-7
{dumps}
run 400
"""
# How people write a dump: style and columns, what is modified, and digits of a place beside 0.16 m
FORMATS = {
    "wrapped": ("custom", "id type x y z vx vy vz", "", 1e-6),
    "any order": ("custom", "vz id x vx z type y vy", "sort 3", 1e-6),
    "words": ("custom", "element id type proc x y z procp1 vx vy vz", "element Steel Iron format float %.15g", 1e-14),
    "images": ("custom", "id type x y z ix iy iz vx vy vz", "format float %.15g", 1e-14),
    "scaled": ("custom", "id type xs ys zs vx vy vz", "format float %.15g", 1e-14),
    "scaled images": ("custom", "id xs ys zs ix iy iz type vx vy vz", "format float %.15g", 1e-14),
    "unwrapped": ("custom", "id type xu yu zu vx vy vz", "format float %.17g sort id", 1e-14),
    "scaled unwrapped": ("custom", "id type xsu ysu zsu vx vy vz", "format float %.17g", 1e-14),
    "radius, mass": ("custom", "id type diameter mass x y z vx vy vz", "format float %.15g", 1e-14),
    "zipped.gz": ("custom", "id type x y z vx vy vz", "format float %.15g", 1e-14),
    "said": ("custom", "id type x y z vx vy vz", "units yes time yes format float %.15g", 1e-14),
    "binary.bin": ("custom", "id type x y z vx vy vz", "", 1e-14),
    "binary said.bin": ("custom", "type id xs ys zs ix iy iz vx vy vz", "units yes time yes", 1e-14),
    "atom": ("atom", "", "", 1e-6),
    "places": ("custom", "id type x y z", "format float %.15g", 1e-14),
}
KNOWN = Known("si", 2e-7, [0.01], [7780.0])
PLAIN = "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n{}\nITEM: BOX BOUNDS pp ff ff\n0 1\n0 1\n0 1\nITEM: ATOMS {}\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which LAMMPS wrote one run in all formats."""
    place = tmp_path_factory.mktemp("foreign")
    lines = []
    for number, (name, (style, columns, modified, _)) in enumerate(FORMATS.items()):
        lines.append(f'dump {number} all {style} 20 "dump {name}" {columns}')
        lines += [f"dump_modify {number} {modified}"] if modified else []
    (place / "in.ring").write_text(DECK.format(dumps="\n".join(lines)))
    run_deck(place, "in.ring")
    return place


@pytest.fixture(scope="module")
def adopted(folder: Path) -> Callable[[str], Unnamed]:
    """The record of each format."""
    return lambda name: adopt_dump([folder / f"dump {name}"], folder / f"run {name}", KNOWN, force=True)


@pytest.fixture(scope="module")
def best(adopted: Callable[[str], Unnamed]) -> Unnamed:
    """The record with all digits and unwrapped places."""
    return adopted("unwrapped")


@pytest.mark.parametrize("name", FORMATS)
def test_each_format_gives_the_same_record_to_its_digits(
    name: str, adopted: Callable[[str], Unnamed], best: Unnamed
) -> None:
    found, digits = adopted(name), FORMATS[name][3]
    assert found.spheres.tolist() == best.spheres.tolist() == [*range(1, 9)]
    assert found.types.tolist() == best.types.tolist()
    np.testing.assert_allclose(found.time, best.time, rtol=1e-14)  # a product of step and number
    for number in (0, 7, len(best) - 1):
        here, there = found[number], best[number]
        # Half of the last digit of a coordinate, of two where a box scales it
        np.testing.assert_allclose(here.place, there.place, atol=digits, rtol=0)
        if "v" in FORMATS[name][1].split("type")[-1] or "vx" in FORMATS[name][1]:
            np.testing.assert_allclose(here.velocity, there.velocity, atol=1e-4, rtol=1e-5)  # %g has six digits
    np.testing.assert_allclose(found.mass, 4 / 3 * np.pi * 1e-6 * 7780, rtol=1e-5)


def test_another_record_is_seen_by_that_comparison(adopted: Callable[[str], Unnamed], best: Unnamed) -> None:
    shift = adopted("wrapped")[7].place + 2e-6
    assert np.abs(shift - best[7].place).max() > FORMATS["wrapped"][3]


def test_spheres_that_cross_a_face_of_each_kind_are_followed(best: Unnamed) -> None:
    np.testing.assert_allclose(best[20].place - best.rest, 8e-5 * np.array([[40, 30, -30]] * 8), atol=1e-4)
    origin, cell, _ = best.cell
    turns = np.floor((best[20].place - origin) @ np.linalg.inv(cell))
    # All cross the faces y and z; those the last one crosses x are told apart from the tilt of the other faces
    assert turns.tolist() == [[0, 1, -1]] * 7 + [[1, 1, -1]]
    assert not np.floor((best.rest - origin) @ np.linalg.inv(cell)).any()


def test_the_box_of_a_dump_is_that_of_the_record_with_its_tilt(best: Unnamed) -> None:
    (again,) = islice(frames(best.folder / UNNAMED, print), 1)
    np.testing.assert_allclose(best.cell[1], [[0.159, 0, 0], [0.004, 0.04, 0], [-0.003, 0.002, 0.04]], rtol=1e-12)
    np.testing.assert_allclose(best.cell[0], [0, -0.02, -0.02], atol=1e-16)
    np.testing.assert_allclose(again.cell, best.cell[1], atol=1e-16)
    np.testing.assert_allclose(again.origin, best.cell[0], atol=1e-16)


def test_velocities_that_a_dump_lacks_are_differences_of_places(
    adopted: Callable[[str], Unnamed], best: Unnamed
) -> None:
    found = adopted("places")
    assert any("differences" in each for each in found.info["remarks"])
    # Second order in the time between two snapshots, a hundredth of the collision time squared of 1 m/s
    np.testing.assert_allclose(found[10].velocity, best[10].velocity, atol=0.05)


def test_a_dump_with_few_digits_says_what_is_left(adopted: Callable[[str], Unnamed], folder: Path) -> None:
    assert not any("printed" in each for each in adopted("images").info["remarks"])
    text = (folder / "dump images").read_text().split("ITEM: TIMESTEP\n")
    (folder / "short").write_text("ITEM: TIMESTEP\n" + text[1] + "ITEM: TIMESTEP\n" + text[1].replace("0\n", "1\n", 1))
    still = adopt_dump([folder / "short"], folder / "still", KNOWN, force=True)
    assert any("printed to 1.0e-16 m" in each or "printed" in each for each in still.info["remarks"])


@pytest.mark.parametrize("end", [12, 200, 777], ids=str)
@pytest.mark.parametrize("name", ["wrapped", "zipped.gz", "binary.bin"])
def test_a_dump_that_is_cut_keeps_its_whole_snapshots(name: str, end: int, folder: Path, tmp_path: Path) -> None:
    whole = (folder / f"dump {name}").read_bytes()
    cut = tmp_path / name
    cut.write_bytes(whole[: len(whole) - end])
    found = adopt_dump([cut], tmp_path / "run", KNOWN)
    assert any("cut off" in each for each in found.info["remarks"])
    assert 0 < len(found) <= 20
    np.testing.assert_array_equal(found[0].place, adopt_dump([folder / f"dump {name}"], tmp_path / "all", KNOWN).rest)


def test_of_a_run_that_was_restarted_the_later_snapshots_count(folder: Path, tmp_path: Path) -> None:
    text = (folder / "dump images").read_text()
    parts = ["ITEM: TIMESTEP\n" + each for each in text.split("ITEM: TIMESTEP\n")[1:]]
    killed = tmp_path / "killed"
    killed.write_text("".join(parts[:12])[:-40] + "".join(parts[8:]))
    found = adopt_dump([killed], tmp_path / "run", KNOWN)
    assert len(found) == 21
    assert found.info["remarks"] == [f"{killed}: a snapshot ends where that of another run begins, and is left out"]


def test_dumps_of_one_run_are_joined_by_step_and_number(folder: Path, best: Unnamed, tmp_path: Path) -> None:
    lines = (folder / "dump unwrapped").read_text().splitlines(keepends=True)

    def columns(chosen: slice, names: str) -> str:
        rows = [line if "ITEM" in line or len(line.split()) < 8 else line.split() for line in lines]
        text = [each if isinstance(each, str) else " ".join([each[0], *each[chosen]]) + "\n" for each in rows]
        return "".join(f"ITEM: ATOMS id {names}\n" if each.startswith("ITEM: ATOMS") else each for each in text)

    (tmp_path / "places").write_text(columns(slice(2, 5), "xu yu zu"))
    (tmp_path / "rates").write_text(columns(slice(5, 8), "vx vy vz"))
    found = adopt_dump([tmp_path / "rates", tmp_path / "places"], tmp_path / "joined", KNOWN)
    np.testing.assert_array_equal(found.stack("velocity"), best.stack("velocity"))
    np.testing.assert_array_equal(found.stack("place"), best.stack("place"))
    half = "".join(lines).index("ITEM: TIMESTEP\n200\n")
    (tmp_path / "first").write_text("".join(lines)[:half])
    (tmp_path / "second").write_text("".join(lines)[half:])
    found = adopt_dump([tmp_path / "second", tmp_path / "first"], tmp_path / "after", KNOWN)
    np.testing.assert_array_equal(found.stack("place"), best.stack("place"))


def test_dumps_that_begin_at_one_step_are_of_two_runs(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "again").write_bytes((folder / "dump unwrapped").read_bytes())
    with pytest.raises(RunFolderError, match="again: begins at step 0, as dump unwrapped does; dumps of one run"):
        adopt_dump([folder / "dump unwrapped", tmp_path / "again"], tmp_path / "run", KNOWN)


def test_spheres_that_come_or_go_are_said_and_left_out(tmp_path: Path) -> None:
    snapshots = [(0, [1, 2, 3]), (10, [3, 1]), (20, [4, 1, 3])]
    text = "".join(
        PLAIN.format(step, len(ids), "id x y z") + "".join(f"{each} 0.{each} 0 0\n" for each in ids)
        for step, ids in snapshots
    )
    (tmp_path / "dump").write_text(text)
    found = adopt_dump([tmp_path / "dump"], tmp_path / "run", KNOWN)
    assert found.spheres.tolist() == [1, 3]
    assert found[2].place[:, 0].tolist() == [0.1, 0.3]
    said = [each.partition(";")[0] for each in found.info["remarks"] if each.startswith("step")]
    assert said == ["step 10: 1 sphere vanishes (id 2)", "step 20: 1 sphere appears (id 4)"]


def test_places_are_followed_across_a_face_by_least_images(tmp_path: Path) -> None:
    text = "".join(PLAIN.format(step, 1, "id x y z") + f"7 {x} 0.5 0.5\n" for step, x in enumerate((0.9, 0.1, 0.3)))
    (tmp_path / "dump").write_text(text)
    found = adopt_dump([tmp_path / "dump"], tmp_path / "run", KNOWN)
    np.testing.assert_allclose(found.stack("place")[:, 0, 0], [0.9, 1.1, 1.3])
    assert not any("image may be another" in each for each in found.info["remarks"])
    (tmp_path / "dump").write_text(text.replace("7 0.3 ", "7 0.45 "))
    found = adopt_dump([tmp_path / "dump"], tmp_path / "far", KNOWN)
    assert any("step 2: spheres move by 0.35 of a period" in each for each in found.info["remarks"])


@pytest.mark.parametrize(
    ("style", "length", "time"),
    [("si", 1.0, 1.0), ("cgs", 1e-2, 1.0), ("micro", 1e-6, 1e-6), ("nano", 1e-9, 1e-9), ("lj", 1.0, 1.0)],
)
def test_a_record_is_in_si_units_whatever_the_style(style: str, length: float, time: float, tmp_path: Path) -> None:
    text = "".join(PLAIN.format(step, 1, "id x y z vx vy vz") + "1 0.25 0 0 3 0 0\n" for step in (0, 10))
    (tmp_path / "dump").write_text(text)
    found = adopt_dump([tmp_path / "dump"], tmp_path / "run", Known(style, 0.5, [0.1], [2.0]))
    assert found.rest[0, 0] == pytest.approx(0.25 * length, rel=1e-14)
    assert found.time[1] == pytest.approx(5 * time, rel=1e-14)
    assert found[0].velocity[0, 0] == pytest.approx(3 * length / time, rel=1e-14)
    density = {"si": 2.0, "lj": 2.0, "cgs": 2e3, "micro": 2e3, "nano": 2e6}[style]  # g/cm³, pg/µm³, ag/nm³
    assert found.in_si == (style != "lj")
    assert [*found.si][:3] == (["t", "id", "x"] if style == "lj" else ["t_s", "id", "x_m"])
    assert found.mass[0] == pytest.approx(density * 4 / 3 * np.pi * (0.1 * length) ** 3, rel=1e-13)
    unit = "units of length" if style == "lj" else "m"
    assert any(f"0.0e+00 {unit}: displacements" in each for each in found.info["remarks"])


REFUSED = {
    "the dump does not state its units": ("id x y z", "1 0 0 0", Known(None, 1.0, [0.1])),
    "give timestep=VALUE": ("id x y z", "1 0 0 0", Known("si", None, [0.1])),
    "give radius=VALUE": ("id x y z", "1 0 0 0", Known("si", 1.0)),
    "2 numbers, but the spheres have 3 types": ("id type x y z", "1 3 0 0 0", Known("si", 1.0, [0.1, 0.2])),
    "holds no id": ("type x y z", "1 0 0 0", KNOWN),
    "holds no places": ("id vx vy vz", "1 0 0 0", KNOWN),
    "step 0: y of sphere 1 is not finite": ("id x y z", "1 0 nan 0", KNOWN),
    "holds molecules": ("id mol x y z", "1 4 0 0 0", KNOWN),
    "density = 7780: the dump says 239926 at step 0; leave out density": ("id mass x y z", "1 1.005 0 0 0", KNOWN),
    "radius = 0.01: the dump says 0.0101 at step 0; leave out radius": ("id radius x y z", "1 0.0101 0 0 0", KNOWN),
    "step 0: .*could not convert string 'no'": ("id x y z", "1 no 0 0", KNOWN),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_known_is_asked_for_by_name(name: str, tmp_path: Path) -> None:
    columns, row, known = REFUSED[name]
    (tmp_path / "dump").write_text(PLAIN.format(0, 1, columns) + row + "\n")
    with pytest.raises(RunFolderError, match=name):
        adopt_dump([tmp_path / "dump"], tmp_path / "run", known)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("ITEM: TIMESTEP\n0\nITEM: NUMBER OF ENTRIES\n1\n", "local dump"),
        ("units si\nrun 1\n", "line 'units si', expected ITEM"),
        ("", "holds no whole snapshot"),
        (
            "ITEM: UNITS\nreal\n" + PLAIN.format(0, 1, "id x y z") + "1 0 0 0\n",
            "the dump says units real: must be one of si, cgs",
        ),
        (PLAIN.format(0, 2, "id x y z") + "1 0 0 0\n1 1 0 0\n", "have the same id"),
    ],
)
def test_what_is_no_dump_of_spheres_is_refused(text: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "dump").write_text(text)
    with pytest.raises(RunFolderError, match=why):
        adopt_dump([tmp_path / "dump"], tmp_path / "run", replace(KNOWN, units=None if "real" in text else "si"))


def test_a_run_does_not_take_the_place_of_its_dumps(tmp_path: Path) -> None:
    path = tmp_path / "dump.everything"
    path.write_text(PLAIN.format(0, 1, "id x y z vx vy vz") + "1 0.5 0.5 0.5 0 0 0\n")
    with pytest.raises(RunFolderError, match=r"holds the dump dump.everything; choose another folder"):
        adopt_dump([path], tmp_path, KNOWN, force=True)
    assert path.is_file()


def test_places_of_several_kinds_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "dump.mixed"
    path.write_text(PLAIN.format(0, 1, "id xu y z") + "1 0.5 0.5 0.5\n")
    with pytest.raises(RunFolderError, match="mixes places"):
        adopt_dump([path], tmp_path / "run", KNOWN)


@pytest.mark.parametrize("height", [0.0, 1e-3])
def test_spheres_in_a_plane_touch_none_across_it(height: float, tmp_path: Path) -> None:
    text = PLAIN.replace("pp ff ff\n0 1\n0 1\n0 1", "ff ff pp\n0 1\n0 1\n-0.005 0.005")
    path = tmp_path / "dump.plane"
    path.write_text(text.format(0, 2, "id x y z") + f"1 0.5 0.5 0\n2 0.5199 0.5 {height}\n")
    found = adopt_dump([path], tmp_path / "run", KNOWN)
    assert (len(found.contacts(found[0]).overlap) == 1) == (height == 0)


@pytest.mark.parametrize(("edge", "later"), [("0 1", "0 0.9"), ("0 1e-5", "0 0.9991e-5")])
def test_contacts_in_a_box_that_deforms_are_refused(edge: str, later: str, tmp_path: Path) -> None:
    path = tmp_path / "dump.pressed"
    texts = (PLAIN.format(step, 1, "id x y z") + "1 0.5 0.5 0.5\n" for step in (0, 10))
    boxes = zip(texts, (edge, later), strict=True)
    path.write_text("".join(text.replace("pp ff ff\n0 1", f"pp ff ff\n{box}") for text, box in boxes))
    found = adopt_dump([path], tmp_path / "run", KNOWN)
    assert any("the box has changed" in each for each in found.info["remarks"])
    with pytest.raises(RunFolderError, match="its box deforms"):
        found.contacts(found[0])


def test_values_out_of_range_are_refused() -> None:
    for style in ("metal", "real", "electron"):
        with pytest.raises(RunFolderError, match=f"units = '{style}': allowed: si, cgs"):
            Known(style)
    with pytest.raises(RunFolderError, match="radius = -1.0: must be a number above 0"):
        Known("si", 1.0, [0.1, -1.0])


def test_contacts_energies_and_tables_of_an_unnamed_crystal(best: Unnamed) -> None:
    pairs = best.contacts(best[0])
    assert sorted(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True)) == [
        (0, 1), (0, 7), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 7),
    ]  # fmt: skip
    np.testing.assert_allclose(pairs.overlap, 0.02 - 0.159 / 8, rtol=1e-9)
    energy = best.kinetic_energy(best[0])
    np.testing.assert_allclose(energy / best.mass, [1700] * 2 + [1740.5] + [1700] * 5, rtol=1e-12)
    columns = ["t_s", "id", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "kinetic_energy_J"]
    assert [*best.to_pandas()] == columns
    assert best.contact_columns["id_i"][:8].tolist() == [1, 1, 2, 3, 4, 5, 6, 7]
    assert best.to_xarray()["velocity"].shape == (21, 8, 3)


def test_other_programs_read_an_unnamed_crystal(best: Unnamed, tmp_path: Path) -> None:
    import ase.io

    export(best, tmp_path / "run.xyz")
    found = ase.io.read(tmp_path / "run.xyz", ":")
    np.testing.assert_allclose(found[7].positions, best[7].place, rtol=1e-15)
    np.testing.assert_allclose(found[0].cell, best.cell[1])
    names = next(frames(best.folder / UNNAMED, print)).columns
    binary = ase.io.read(best.folder / UNNAMED, 7, format="lammps-dump-binary", colnames=[*names])
    np.testing.assert_allclose(binary.cell, best.cell[1], atol=1e-16)  # with its tilt
    np.testing.assert_allclose(binary.positions, best[7].place, rtol=1e-15)
    export(best, tmp_path / "run.csv")
    assert len((tmp_path / "run.csv").read_text().splitlines()) == 1 + 8 * 21
    with pytest.raises(RunFolderError, match="must end in .* for an unnamed crystal"):
        export(best, tmp_path / "run.h5md")
    export(best, tmp_path / "contacts.csv", "contacts")
    assert (tmp_path / "contacts.csv").read_text().startswith("t_s,id_i,id_j,overlap_m\n0.0,1,2,")
    with pytest.raises(RunFolderError, match="monitor = 'line': an unnamed crystal has only 'contacts'"):
        export(best, tmp_path / "contacts.csv", "line")
    # The dump of the folder is one that can be adopted
    again = adopt_dump([best.folder / "dump.unnamed.bin"], tmp_path / "again", Known(None, 2e-7))
    np.testing.assert_array_equal(again.stack("place"), best.stack("place"))


def test_pictures_and_movies_of_an_unnamed_crystal(best: Unnamed, folder: Path, tmp_path: Path) -> None:
    text = (folder / "dump images").read_text()
    (tmp_path / "short").write_text(text[: text.index("ITEM: TIMESTEP\n40\n")])
    adopt_dump([tmp_path / "short"], tmp_path / "run", KNOWN)
    view(tmp_path / "run", tmp_path / "a.png")
    view(tmp_path / "run", tmp_path / "b.gif", colour="x", magnify=2.0, size=(200, 150))
    assert min((tmp_path / name).stat().st_size for name in ("a.png", "b.gif")) > 1000
    with pytest.raises(ViewError, match="tau = 1: must be from 0 to 8e-05"):
        view(best.folder, tmp_path / "a.png", tau=1)
    with pytest.raises(ViewError, match="--rows: cannot be used for an unnamed crystal"):
        view(best.folder, tmp_path / "a.png", rows=3)
    with pytest.raises(ViewError, match="must be one of speed"):
        view(best.folder, tmp_path / "a.png", colour="p")


def test_one_fast_sphere_does_not_pale_the_others_in_a_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = ""
    for step in (0, 10):
        text += PLAIN.format(step, 200, "id x y z vx vy vz")
        for each in range(200):
            x = 0.005 * each + (0.002 if each else 0.4) * step / 1000
            text += f"{each + 1} {x:.9f} {0.5 + 0.1 * (each % 2)} 0 0 0 0\n"
    (tmp_path / "dump").write_text(text)
    adopt_dump([tmp_path / "dump"], tmp_path / "run", Known("si", 2e-7, [0.002], [7780.0]))
    drawn: list[Any] = []
    monkeypatch.setattr(unnamed, "save", lambda figure, path, size: drawn.append(figure.axes[0].collections[0]))
    for colour, low in (("x", -2e-5), ("displacement", 0.0)):
        view(tmp_path / "run", tmp_path / "a.png", colour=colour)
        np.testing.assert_allclose(drawn[-1].get_clim(), [low, 2e-5], atol=1e-8)
        assert drawn[-1].colorbar.extend == ("both" if low else "max")


def test_harmonics_of_a_wave_in_an_unnamed_crystal(tmp_path: Path) -> None:
    times, places = np.arange(200) * 1e-5, np.arange(10) * 0.02
    phase = 2 * np.pi * 4e3 * times[:, None] - 30 * places
    moved = 3e-6 * np.cos(phase) + 2e-7 * np.sin(2 * phase)
    rows = [
        PLAIN.format(step, 10, "id x y z")
        + "".join(f"{n + 1} {x:.15g} 0 0\n" for n, x in enumerate(places + moved[step]))
        for step in range(len(times))
    ]
    (tmp_path / "dump").write_text("".join(rows))
    crystal = adopt_dump([tmp_path / "dump"], tmp_path / "run", Known("si", 1e-5, [0.01]))
    along = crystal.harmonics(4e3, np.array([1.0, 0.0, 0.0]))["along"]
    # The fit is exact but for the digits of the dump
    assert along["1"][0] == pytest.approx(3e-6, rel=1e-8)
    assert along["2"][0] == pytest.approx(2e-7, rel=1e-7)
    assert along["3"][0] < 1e-14
    with pytest.raises(RunFolderError, match="half a period of harmonic 3"):
        crystal.harmonics(4e4, np.array([1.0, 0.0, 0.0]))
    with pytest.raises(RunFolderError, match="fewer than 4 periods"):
        crystal.harmonics(4e2, np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize("name", ["dump", "dump.bin"])
def test_a_box_of_general_triclinic_form_is_refused(name: str, tmp_path: Path) -> None:
    lattice = "lattice custom 0.02 a1 1 0 0 a2 0.5 1 0 a3 0.2 0.1 1 basis 0 0 0 triclinic/general"
    text = DECK[: DECK.index("region box")] + f"{lattice}\ncreate_box 2 NULL 0 4 0 4 0 4\n"
    dump = f"dump 1 all custom 1 {name} id x y z\ndump_modify 1 triclinic/general yes\nfix 1 all nve/sphere\nrun 0\n"
    (tmp_path / "in.general").write_text(f"{text}create_atoms 1 box\npair_style zero 0.1\npair_coeff * *\n{dump}")
    run_deck(tmp_path, "in.general")
    with pytest.raises(RunFolderError, match="of general triclinic form; write it without triclinic/general"):
        adopt_dump([tmp_path / name], tmp_path / "run", KNOWN)


def test_the_front_in_an_unnamed_crystal_starts_at_a_sphere(tmp_path: Path) -> None:
    times, places, speed = np.arange(120) * 1e-5, np.arange(10) * 0.02, 200.0
    pulses = np.exp(-(((times[:, None] - 1e-4 - places / speed) / 3e-5) ** 2))
    rows = [
        PLAIN.format(step, 10, "id x y z vx vy vz").replace("pp", "ff")
        + "".join(f"{n + 1} {places[n]:.15g} 0 0 {pulses[step, n]:.15g} 0 0\n" for n in range(10))
        for step in range(len(times))
    ]
    (tmp_path / "dump").write_text("".join(rows))
    crystal = adopt_dump([tmp_path / "dump"], tmp_path / "run", Known("si", 1e-5, [0.01]))
    found = front(crystal, origin=1, direction=0.0)
    assert found.places["id"].tolist() == [*range(2, 11)]
    # The vertex of a parabola lies within 1 % of a sample of the crest of a pulse of three samples
    assert found.speed[0] == pytest.approx(speed, rel=1e-3)
    with pytest.raises(ReadoutError, match="give the id of a sphere, origin=ID"):
        front(crystal, direction=0.0)
    with pytest.raises(ReadoutError, match="no sphere has this id"):
        front(crystal, origin=77)


def test_commands_adopt_dumps_and_say_what_needs_a_scene(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, dump = str(tmp_path / "run"), str(folder / "dump said")
    assert main(["adopt", dump, "-o", run]) == 2
    assert "give --radius VALUE in its units" in capsys.readouterr().err
    assert main(["adopt", dump, "-o", run, "--radius", "0.01", "--density", "7780"]) == 0
    assert "8 spheres, 21 snapshots, 0 to 8e-05 s" in capsys.readouterr().out
    assert main(["front", run, "--origin", "3", "--direction", "0"]) in (0, 1)
    assert main(["export", run, "-o", str(tmp_path / "run.csv")]) == 0
    assert main(["adopt", dump, str(tmp_path), "-o", run]) == 2
    with pytest.raises(RunFolderError, match="holds an unnamed crystal, adopted without the scene that this needs"):
        Record.load(run)
    path = tmp_path / "run/dump.unnamed.bin"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(RunFolderError, match="was changed since"):
        Unnamed.load(run)


def test_memory_does_not_grow_with_the_snapshots(tmp_path: Path) -> None:
    count = 20_000
    places = np.random.default_rng(1).random((count, 3))
    table = "".join(f"{n + 1} {x:.6f} {y:.6f} {z:.6f}\n" for n, (x, y, z) in enumerate(places))
    peaks = []
    for snapshots in (3, 9):  # the first, the one before and the present one are in memory
        path = tmp_path / f"dump{snapshots}.gz"
        with gzip.open(path, "wt", compresslevel=1) as stream:
            for step in range(snapshots):
                stream.write(PLAIN.format(step, count, "id x y z") + table)
        tracemalloc.start()
        found = adopt_dump([path], tmp_path / f"run{snapshots}", KNOWN)
        peaks.append(tracemalloc.get_traced_memory()[1] / count)
        tracemalloc.stop()
        assert (len(found), len(found.spheres)) == (snapshots, count)
    # Bytes a sphere: three snapshots and what sorts and follows them; 1e6 spheres take half a gigabyte
    assert max(peaks) < 500
    assert peaks[1] < 1.1 * peaks[0]
