"""Data files keep every digit, also through LAMMPS."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import Scene, build
from granular_lmp.errors import RunFolderError
from granular_lmp.lammps import datafile
from granular_lmp.lammps.datafile import ATOM_COLUMNS, DataFile, read
from tests.instance import silent_lammps


def awkward_spheres(count: int = 40) -> DataFile:
    """Numbers with all 53 bits in use, far and near, in a box that holds them."""
    random = np.random.default_rng(7)
    return DataFile(
        box=np.array([[-1e5, 1e5], [-1e5 / 3, 1e5], [-0.5, 0.5]]),
        kind=random.integers(1, 3, count),
        position=np.column_stack([random.uniform(-3e4, 3e4, (count, 2)), np.zeros(count)]),
        diameter=random.uniform(0.1, 1e3, count),
        density=random.uniform(1e-3, 1, count),
        wave=random.normal(0, 1e-7, (count, 6)),
    )


def same(a: DataFile, b: DataFile) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in vars(a))


def test_reading_gives_back_every_bit(tmp_path: Path) -> None:
    spheres = awkward_spheres()
    (tmp_path / "data").write_text(spheres.text("title"))
    assert same(read(tmp_path / "data"), spheres)


@pytest.mark.parametrize("style", list(ATOM_COLUMNS))
def test_the_style_is_named_as_other_programs_look_for_it(tmp_path: Path, style: str) -> None:
    """OVITO takes all words behind the title for the style and its sub-styles, and LAMMPS writes the first one."""
    spheres, path = replace(awkward_spheres(), style=style), tmp_path / "data"
    text = spheres.text("title")
    columns = text.partition("Atoms #")[0].splitlines()[-1].removeprefix("#").split()
    assert f"\nAtoms # {style}\n\n" in text
    assert len(columns) == len(text.partition("Atoms #")[2].splitlines()[2].split())
    for title in (f"Atoms # {style}", f"Atoms # {style.split()[0]} ({ATOM_COLUMNS[style]})"):  # of now, of before 0.3
        path.write_text(text.replace(f"Atoms # {style}", title))
        assert same(read(path), spheres)


def test_a_lost_digit_is_seen(tmp_path: Path) -> None:
    spheres = awkward_spheres()
    (tmp_path / "data").write_text(spheres.text("title").replace("0 1 0 0", "0 1 0 0", 1))
    other = DataFile(**{**vars(spheres), "diameter": spheres.diameter * (1 + 3e-16)})
    assert not same(read(tmp_path / "data"), other)


def test_pieces_join_to_lines_of_consecutive_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(datafile, "_PIECE", 500)
    count = 2 * 500 + 3
    spheres = awkward_spheres(count)
    pieces = list(spheres.pieces("title"))
    assert max(piece.count("\n") for piece in pieces) == 500  # memory holds no more lines than that
    lines = "".join(pieces).split("\n")
    sections = [lines.index(title) + 2 for title in lines if title.startswith(("Atoms", "wave"))]
    for start in sections:
        assert [int(line.split()[0]) for line in lines[start : start + count]] == list(range(1, count + 1))


def test_minus_zero_stays_apart_from_zero() -> None:
    spheres = awkward_spheres(4)
    spheres.wave[:, 0] = [0.0, -0.0, 0.0, -0.0]
    assert [line.split()[1] for line in spheres.text("title").split("\n")[-5:-1]] == ["0.0", "-0.0", "0.0", "-0.0"]


def test_the_way_through_lammps_changes_no_bit(tmp_path: Path) -> None:
    spheres = awkward_spheres()
    (tmp_path / "data").write_text(spheres.text("title"))
    with silent_lammps() as lmp:
        lmp.commands_string(
            "units nano\ndimension 2\nboundary p p p\natom_style hybrid sphere dipole\n"
            "fix wave all property/atom d_ux d_uy d_phi d_vx d_vy d_vphi\n"
            f"read_data {tmp_path}/data fix wave NULL wave\nmass * 1.0\n"
            f"write_data {tmp_path}/back nocoeff"
        )
    back = read(tmp_path / "back")
    # LAMMPS writes 17 digits of positions, so these come back whole; of the wave's section it writes what it read
    for name in ("kind", "position", "wave"):
        assert np.array_equal(getattr(back, name), getattr(spheres, name)), name
    # diameter = 2 (d/2) and density = m/(4πr³/3) are computed on the way: equal to rounding
    np.testing.assert_allclose(back.diameter, spheres.diameter, rtol=1e-15)
    np.testing.assert_allclose(back.density, spheres.density, rtol=1e-15)


def test_a_deck_s_data_file_holds_the_packing(small: Scene, tmp_path: Path) -> None:
    deck = build(small)
    deck.write(tmp_path / "deck")
    data = read(tmp_path / "deck" / deck.data_name)
    np.testing.assert_array_equal(data.position, deck.packing.positions * 500.0)  # R in nm
    assert (data.diameter == 1000).all()
    assert (data.kind == 1).all()


@pytest.mark.parametrize("text", ["", "title\n\n3 atoms\n", "title\n\n1 atoms\n\nAtoms\n\n1 1 nonsense\n"])
def test_something_else_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "data").write_text(text)
    with pytest.raises(RunFolderError, match="not a data file of spheres"):
        read(tmp_path / "data")
