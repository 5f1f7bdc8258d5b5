"""A deck of anybody and the dumps that it wrote become an unnamed crystal, of which nothing has to be asked."""

from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure.witness import witness
from granular_analysis.theory.errors import TheoryError
from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError
from granular_lmp.foreign.adopt_dump import Known, adopt_dump
from granular_lmp.foreign.known import law_of
from granular_lmp.lammps.custom_dump import is_dump
from granular_lmp.runs.unnamed import Unnamed
from tests.instance import run_deck

# The chain of steel beads of thirty lines, whose dump holds id, type, places and velocities
DECK = """
units cgs
atom_style sphere
boundary f f f
newton off
comm_modify vel yes
region box block -2 25 -2 2 -2 2
create_box 2 box
variable i loop 10
label beads
variable x equal (v_i-1)*1.9999
variable kind equal 1+(v_i==10)
create_atoms ${kind} single $x 0 0
next i
jump SELF beads
set group all diameter 2 density 7.78
pair_style granular
pair_coeff * * hertz/material 2e12 0 0.3 tangential mindlin NULL 0.0 0.5
group first id 1
group last id 10
group free subtract all last
velocity first set 10 0 0
fix 1 free nve/sphere
FIX
timestep 2e-7
dump 1 all custom 20 dump.beads id type x y z vx vy vz
dump_modify 1 format float %.17g
dump 2 all custom 20 dump.coarse id x y z
dump 3 all custom 500 dump.rare id x y z
run 1000
"""


@pytest.fixture(scope="module")
def deck(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The deck, which has run."""
    folder = tmp_path_factory.mktemp("deck")
    (folder / "in.beads").write_text(DECK.replace("FIX", ""))
    run_deck(folder, "in.beads")
    return folder / "in.beads"


def test_a_deck_says_units_spheres_step_and_law(deck: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["adopt", str(deck), "-o", str(tmp_path / "run")]) == 0
    assert "10 spheres, 51 snapshots, 0 to 0.0002 s" in capsys.readouterr().out
    found = Unnamed.load(tmp_path / "run")
    assert found.radius.tolist() == pytest.approx([0.01] * 10, rel=1e-14)
    assert found.mass[0] == pytest.approx(4 / 3 * np.pi * 1e-6 * 7780, rel=1e-12)
    assert found.types.tolist() == [1] * 9 + [2]
    known = found.known
    assert (known["units"], known["held"], known["acting"]) == ("cgs", [10], [])
    assert known["timestep"] == 2e-7
    assert known["laws"][0]["young"] == pytest.approx(2e11, rel=1e-14)
    # Dumps of the same steps are joined, and places have the digits of the better one
    assert [Path(each).name for each in known["dumps"]] == ["dump.beads", "dump.coarse"]
    assert known["resolution"] == 0
    assert found[0].velocity[0].tolist() == pytest.approx([0.1, 0, 0])


def test_the_witness_of_a_deck_needs_nothing_else(deck: Path, tmp_path: Path) -> None:
    main(["adopt", str(deck), "-o", str(tmp_path / "run")])
    found = witness(Unnamed.load(tmp_path / "run"))
    assert found.explained
    assert found.parted is None
    # Second order in a step of a hundredth of the collision
    assert found.error < 1e-3


def test_times_of_a_step_that_changes_must_be_in_the_dump(deck: Path, tmp_path: Path) -> None:
    fixes = "fix 2 free dt/reset 1 NULL 2e-7 1e-6\nfix 1 free"
    (tmp_path / "in.reset").write_text(deck.read_text().replace("fix 1 free", fixes))
    asked = ["adopt", str(tmp_path / "in.reset"), str(deck.parent / "dump.beads"), "-o", str(tmp_path / "run")]
    assert main(asked) == 2
    assert main([*asked, "--timestep", "2e-7"]) == 0


def test_the_path_of_a_dump_may_be_absolute(deck: Path, tmp_path: Path) -> None:
    text = deck.read_text().replace("dump.beads", str(deck.parent / "dump.beads"))
    (tmp_path / "in.absolute").write_text(text.replace("dump.coarse", str(deck.parent / "dump.coarse")))
    assert main(["adopt", str(tmp_path / "in.absolute"), "-o", str(tmp_path / "run")]) == 0


def test_forces_of_a_wall_are_not_taken_for_constant_ones(deck: Path, tmp_path: Path) -> None:
    wall = "fix 3 free wall/gran granular hertz/material 2e12 0 0.3 tangential mindlin NULL 0 0.5 yplane -0.9999 NULL"
    fixes = f"fix 2 free addforce 0 3e5 0\n{wall}\nfix 1 free"
    (tmp_path / "in.wall").write_text(deck.read_text().replace("fix 1 free", fixes))
    main(["adopt", str(tmp_path / "in.wall"), str(deck.parent / "dump.beads"), "-o", str(tmp_path / "run")])
    known = Unnamed.load(tmp_path / "run").known
    assert not known["pushes"]
    assert [each.split()[3] for each in known["acting"]] == ["wall/gran", "addforce"]


def test_what_else_acts_is_named(deck: Path, tmp_path: Path) -> None:
    (tmp_path / "in.pushed").write_text(deck.read_text().replace("fix 1 free", "fix 2 free viscous 1e-3\nfix 1 free"))
    main(["adopt", str(tmp_path / "in.pushed"), str(deck.parent / "dump.beads"), "-o", str(tmp_path / "run")])
    assert witness(Unnamed.load(tmp_path / "run")).reasons[-1:] == ("the witness leaves out 'fix 2 free viscous 1e-3'",)


def test_constant_forces_of_a_deck_are_those_of_its_witness(deck: Path, tmp_path: Path) -> None:
    fixes = "fix 2 free addforce 0 3e5 0\nfix 3 free gravity 981 vector -1 0 0\nfix 1 free"
    (tmp_path / "in.pushed").write_text(deck.read_text().replace("fix 1 free", fixes))
    run_deck(tmp_path, "in.pushed")
    main(["adopt", str(tmp_path / "in.pushed"), "-o", str(tmp_path / "run")])
    crystal = Unnamed.load(tmp_path / "run")
    # 3e5 dyn are 3 N, and the weight of a bead is 4 g by its acceleration
    assert crystal.known["pushes"][0] == pytest.approx([1, -9.81 * crystal.mass[0], 3.0, 0.0], rel=1e-6)
    found = witness(crystal)
    assert found.explained
    assert not [each for each in found.reasons if "leaves out" in each]
    assert np.abs(crystal.stack("velocity")[-1, :9, 1]).min() > 1e-3


def test_two_materials_are_mixed_as_lammps_does_and_others_refused(deck: Path, tmp_path: Path) -> None:
    tail = "tangential mindlin NULL 0.0 0.5"
    laws = f"pair_coeff 1 1 hertz/material 2e12 0 0.3 {tail}\npair_coeff 2 2 hertz/material 5e11 0 0.2 {tail}\n"
    line = next(each for each in deck.read_text().splitlines(True) if each.startswith("pair_coeff"))
    sideways = deck.read_text().replace(line, laws).replace("set 10 0 0", "set 10 3 0").replace("10)", "3)")
    (tmp_path / "in.mixed").write_text(sideways)
    run_deck(tmp_path, "in.mixed")
    main(["adopt", str(tmp_path / "in.mixed"), "-o", str(tmp_path / "run")])
    crystal = Unnamed.load(tmp_path / "run")
    assert [each["mixed"] for each in crystal.known["laws"]].count(True) == 1
    assert witness(crystal).explained
    own = sideways.replace(laws, laws + f"pair_coeff 1 2 hertz/material 1e12 0 0.3 {tail}\n")
    (tmp_path / "in.own").write_text(own)
    main(["adopt", str(tmp_path / "in.own"), str(tmp_path / "dump.beads"), "-o", str(tmp_path / "other")])
    with pytest.raises(TheoryError, match="a law of their own of types 1 and 2 is not built"):
        witness(Unnamed.load(tmp_path / "other"))


def test_what_is_given_counts_beside_a_deck(deck: Path, tmp_path: Path) -> None:
    words = ["--timestep", "1e-7", "--density", "1", "--law", "hertz/material 1e12 0 0.2"]
    assert main(["adopt", str(deck), *words, "-o", str(tmp_path / "run")]) == 0
    found = Unnamed.load(tmp_path / "run")
    assert found.time[-1] == pytest.approx(1e-4)
    assert found.mass[0] == pytest.approx(4 / 3 * np.pi * 1e-6 * 1000)
    assert {(each["young"], each["tangential"]) for each in found.known["laws"]} == {(1e11, "none")}


def test_a_deck_without_dumps_is_refused(deck: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = deck.read_text()
    (tmp_path / "in.new").write_text(text)
    assert main(["adopt", str(tmp_path / "in.new"), "-o", str(tmp_path / "run")]) == 2
    assert "dump.beads: missing; the deck writes it, run it first" in capsys.readouterr().err
    (tmp_path / "in.none").write_text("".join(line for line in text.splitlines(True) if "dump" not in line))
    assert main(["adopt", str(tmp_path / "in.none"), "-o", str(tmp_path / "run")]) == 2
    assert "has no dump of style custom or atom" in capsys.readouterr().err
    assert main(["adopt", str(deck), str(deck), "-o", str(tmp_path / "run")]) == 2
    assert "give one deck and its dumps" in capsys.readouterr().err


def test_spheres_that_the_deck_does_not_have_are_refused(deck: Path, tmp_path: Path) -> None:
    from granular_lmp.foreign.known import known_of
    from granular_lmp.foreign.reading import read

    (tmp_path / "dump").write_text((deck.parent / "dump.beads").read_text().replace("\n10 2 ", "\n77 2 "))
    known, _ = known_of(read(deck), Known())
    with pytest.raises(RunFolderError, match="id 77: is in the dump, but not among the spheres of the deck"):
        adopt_dump([tmp_path / "dump"], tmp_path / "run", known)


@pytest.mark.parametrize("words", ["", "springs 1 2", "hertz/material soft 0 0.3"])
def test_words_that_are_no_law_are_refused(words: str) -> None:
    with pytest.raises(RunFolderError, match=f"law = '{words}': "):
        law_of(words, 1)


def test_a_dump_is_told_from_a_deck(deck: Path) -> None:
    assert is_dump(deck.parent / "dump.beads")
    assert not is_dump(deck)
