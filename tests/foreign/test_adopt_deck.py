"""A deck of anybody and the dumps that it wrote become an unnamed crystal, of which nothing has to be asked."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure.witness import witness
from granular_analysis.theory.errors import TheoryError
from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError
from granular_lmp.foreign.adopt_dump import adopt_dump
from granular_lmp.foreign.conversion import Known
from granular_lmp.foreign.known import dumps_of, known_of, law_of
from granular_lmp.foreign.outside import Outside, outside_of
from granular_lmp.foreign.reading import read
from granular_lmp.lammps.custom_dump import is_dump
from granular_lmp.runs.unnamed import Unnamed
from granular_lmp.units import STYLES
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
    assert (known["units"], known["outside"]["held"], known["outside"]["others"]) == ("cgs", [10], [])
    assert (known["outside"]["begin"], known["outside"]["history"]) == (0, False)
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


LAW = "hertz/material 2e12 0 0.3 tangential mindlin NULL 0.0 0.5"
FLOOR = LAW.replace("2e12", "1e12")
# Fixes that a witness integrates; some take the place of others
INTEGRATED = {
    "constant forces": ("", "fix 2 free addforce 0 3e5 0\nfix 3 free gravity 981 vector -1 0 0\n"),
    "slopes": ("", "fix 2 free gravity 9e7 spherical 30 100\nfix 3 free gravity 981 chute 24\n"),
    "a floor": (
        "",
        f"fix 2 all wall/gran granular {FLOOR} yplane -0.9999 NULL\nfix 3 free gravity 9e7 vector 0 -1 0\n",
    ),
    "a wall above": ("", f"fix 2 all wall/gran granular {FLOOR} zplane NULL 0.9999 contacts\n"),
    "a bead to and fro": ("", "fix 2 last move wiggle -3e-4 1e-4 0 6e-5\n"),
    "in units of a lattice": ("", "lattice hcp 0.5\nfix 2 last move wiggle -6e-4 1.1547e-4 0 6e-5\n"),
    "a bead that goes on": ("", "fix 2 last move linear -10 2 0\n"),
    "a piston": ("fix 1 free nve/sphere\nfix 3 last nve", "velocity last set -10 0 0\nfix 2 last setforce 0 0 0\n"),
    "frozen": ("fix 1 all nve/sphere", "fix 2 last freeze\n"),
    "discs": ("fix 1 free nve/sphere disc", "fix 3 all enforce2d\n"),
    "no rotation": ("fix 1 free nve", ""),
    "a line": ("", "velocity first set 10 0 0\nfix 2 all setforce NULL 0 0\n"),
    "nothing that acts": ("", "fix 2 all ave/time 1 1 1 c_thermo_temp\nfix 3 all print 9 no\n"),
}


def pushed(deck: Path, folder: Path, other: str, fixes: str) -> Path:
    """Write the deck, in which the first bead is struck sideways too, with other fixes."""
    text, line = deck.read_text().replace("first set 10 0 0", "first set 10 3 0"), "fix 1 free nve/sphere"
    if "enforce2d" in fixes:
        text = text.replace("boundary f f f", "dimension 2\nboundary f f p").replace("-2 2 -2 2", "-2 2 -0.1 0.1")
    path = folder / "in.beads"
    path.write_text(text.replace(line, fixes + (other or line)))
    return path


def adopted(deck: Path, *dumps: Path) -> Unnamed:
    """Adopt dumps of a deck, as the command does in two processes."""
    reading = read(deck)
    known, _ = known_of(reading, Known())
    return adopt_dump(dumps or dumps_of(reading), deck.parent / "run", known, force=True)


def ran(deck: Path, folder: Path, other: str, fixes: str) -> Unnamed:
    """Run the deck with other fixes, and adopt what it wrote."""
    path = pushed(deck, folder, other, fixes)
    run_deck(folder, path.name)
    return adopted(path)


@pytest.mark.parametrize("name", INTEGRATED)
def test_what_acts_in_a_deck_acts_in_its_witness(name: str, deck: Path, tmp_path: Path) -> None:
    crystal = ran(deck, tmp_path, *INTEGRATED[name])
    found = witness(crystal)
    assert found.cause == "the step"
    assert found.reasons == ()
    assert found.error < 2e-3
    plain = Outside(held=tuple(crystal.known["outside"]["held"]))
    nothing = {**crystal.known, "outside": plain.in_si(STYLES["cgs"])}
    without = witness(replace(crystal, info=crystal.info | {"unnamed": nothing}))
    assert without.explained == (name in ("a line", "nothing that acts", "frozen", "a piston"))


def test_constant_forces_are_in_si_units(deck: Path, tmp_path: Path) -> None:
    crystal = ran(deck, tmp_path, *INTEGRATED["constant forces"])
    # 3e5 dyn are 3 N, and the weight of a bead is 4 g by its acceleration
    expected = [1, -9.81 * crystal.mass[0], 3.0, 0.0]
    assert crystal.known["outside"]["pushes"][0] == pytest.approx(expected, rel=1e-12)


OTHERS = {
    "viscous": "fix 2 free viscous 1e-3\n",
    "a force over time": "variable f equal 1e5*sin(1e5*step*dt)\nfix 2 first addforce v_f 0 0\n",
    "a force in a region": "fix 2 first addforce 1e5 0 0 every 10\n",
    "a slope over time": "variable t equal 9e2*step\nfix 2 free gravity v_t chute 24\n",
    "setforce": "fix 2 first setforce 1e5 0 0\n",
    "no force across": "fix 2 free setforce NULL 0 NULL\n",
    "held spheres that turn": "fix 3 last nve/sphere\nfix 2 last setforce 0 0 0\n",
    "a turning motion": "fix 2 last move rotate 18 0 0 0 0 1 1e-3\n",
    "a motion along one axis": "fix 2 last move wiggle 1e-4 NULL NULL 1e-4\n",
    "a motion in a stretched lattice": "lattice sc 0.5 spacing 1 2 1\nfix 2 last move linear -10 2 0\n",
    "a moving wall": f"fix 2 all wall/gran granular {LAW} yplane -0.9999 NULL wiggle y 1e-4 1e-4\n",
    "a round wall": f"fix 2 all wall/gran granular {LAW} zcylinder 30\n",
    "a wall for some": f"fix 2 free wall/gran granular {LAW} yplane -0.9999 NULL\n",
    "a limit": "fix 2 first nve/limit 0.1\n",
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_no_witness_knows_is_kept_by_its_line(name: str, deck: Path, tmp_path: Path) -> None:
    found = outside_of(read(pushed(deck, tmp_path, "", OTHERS[name])))
    assert found.others == (OTHERS[name].splitlines()[-1],)


def test_held_spheres_of_a_line_do_not_turn(deck: Path, tmp_path: Path) -> None:
    fixes, line = OTHERS["held spheres that turn"], "first set 10 3 0"
    path = pushed(deck, tmp_path, "", fixes)
    path.write_text(path.read_text().replace(line, "first set 10 0 0"))
    assert outside_of(read(path)).others == ()


def test_a_motion_in_units_of_the_box_does_not_ask_for_a_lattice(deck: Path, tmp_path: Path) -> None:
    way = "fix 2 last move linear -10 2 0 units"
    for units, size in (("box", 1.0), ("lattice", 0.5)):
        (motion,) = outside_of(read(pushed(deck, tmp_path, "", f"lattice sc 0.5\n{way} {units}\n"))).motions
        assert motion.velocity == (-10 * size, 2 * size, 0.0)


def test_spheres_that_turn_beside_others_that_do_not_are_kept_by_their_lines(deck: Path, tmp_path: Path) -> None:
    other = "group two subtract free first\nfix 1 first nve/sphere\nfix 2 two nve"
    assert outside_of(read(pushed(deck, tmp_path, other, ""))).others == ("fix 1 first nve/sphere", "fix 2 two nve")


def test_what_changes_between_two_runs_of_a_dump_is_refused(deck: Path, tmp_path: Path) -> None:
    again = "run 500\nvelocity first set 10 0 0\nfix 2 free viscous 1e-3\nunfix 2\nfix 4 all print 10 no\nrun 500\n"
    (tmp_path / "in.beads").write_text(deck.read_text().replace("run 1000\n", again))
    crystal = adopted(tmp_path / "in.beads", deck.parent / "dump.beads")
    lines = ["velocity first set 10 0 0", "fix 2 free viscous 1e-3", "unfix 2"]
    assert crystal.known["outside"]["others"] == lines
    with pytest.raises(TheoryError, match="'velocity first set 10 0 0' is not built; the witness knows constant"):
        witness(crystal)


@pytest.mark.parametrize("runs", ["run 1000 EVERY", "run 500\nrun 500 EVERY", "run 500 EVERY\nrun 500"])
def test_commands_within_a_run_are_kept_by_its_line(runs: str, deck: Path, tmp_path: Path) -> None:
    path = tmp_path / "in.beads"
    path.write_text(
        deck.read_text().replace("run 1000", runs.replace("EVERY", 'every 100 "velocity first set 10 0 0"'))
    )
    (found,) = outside_of(read(path)).others
    assert found.endswith("every 100 velocity first set 10 0 0")
    path.write_text(deck.read_text().replace("run 1000", runs.replace("EVERY", "every 100 NULL")))
    assert outside_of(read(path)).others == ()


def test_what_acts_before_the_dump_begins_is_not_in_its_run(deck: Path, tmp_path: Path) -> None:
    before = (
        "fix 2 free viscous 10\nfix 1 free nve/sphere\ntimestep 2e-7\nrun 300\nunfix 2\nvelocity first set 10 3 0\n"
    )
    (tmp_path / "in.beads").write_text(deck.read_text().replace("fix 1 free nve/sphere\n", before))
    run_deck(tmp_path, "in.beads")
    crystal = adopted(tmp_path / "in.beads")
    outside = crystal.known["outside"]
    assert (crystal.steps[0], outside["begin"], outside["history"], outside["others"]) == (300, 300, True, [])
    found = witness(crystal)
    assert found.reasons[:1] == ("the first snapshot is at step 300, and no dump holds the slip of its contacts",)


def test_slip_that_a_data_file_forgets_is_named(deck: Path, tmp_path: Path) -> None:
    text = (
        deck.read_text().replace("first set 10 0 0", "first set 10 6 0").replace("dump.beads id", "dump.one.beads id")
    )
    (tmp_path / "in.first").write_text(text.replace("run 1000", "run 500\nwrite_data half nocoeff"))
    run_deck(tmp_path, "in.first")
    head, _, tail = text.replace("dump.one", "dump.two").partition("region box")
    tail = f"reset_timestep 500\n{tail[tail.index('pair_style') :]}".replace("velocity first", "#").replace(
        "run 1000", "run 500"
    )
    (tmp_path / "in.second").write_text(f"{head}read_data half\n{tail}")
    run_deck(tmp_path, "in.second")
    one, two = (tmp_path / f"dump.{name}.beads" for name in ("one", "two"))
    whole = adopted(tmp_path / "in.second", one, two)
    assert whole.steps.tolist() == [*range(0, 1001, 20)]
    found = witness(whole)
    assert not found.explained
    assert (
        found.reasons[0] == "the deck loses the slip of its contacts at step 500, where it continues from a data file"
    )
    # What the second deck wrote begins without slip in LAMMPS too
    found = witness(adopted(tmp_path / "in.second", two))
    assert found.reasons == ("the dump has no spins (omegax, omegay, omegaz); the witness begins without spin",)


def test_two_materials_are_mixed_as_lammps_does_and_others_refused(deck: Path, tmp_path: Path) -> None:
    tail = "tangential mindlin NULL 0.0 0.5"
    laws = f"pair_coeff 1 1 hertz/material 2e12 0 0.3 {tail}\npair_coeff 2 2 hertz/material 5e11 0 0.2 {tail}\n"
    line = next(each for each in deck.read_text().splitlines(True) if each.startswith("pair_coeff"))
    sideways = deck.read_text().replace(line, laws).replace("set 10 0 0", "set 10 3 0").replace("10)", "3)")
    (tmp_path / "in.mixed").write_text(sideways)
    run_deck(tmp_path, "in.mixed")
    crystal = adopted(tmp_path / "in.mixed")
    assert [each["mixed"] for each in crystal.known["laws"]].count(True) == 1
    assert witness(crystal).explained
    own = sideways.replace(laws, laws + f"pair_coeff 1 2 hertz/material 1e12 0 0.3 {tail}\n")
    (tmp_path / "in.own").write_text(own)
    with pytest.raises(TheoryError, match="a separate law between types 1 and 2 is not built"):
        witness(adopted(tmp_path / "in.own", tmp_path / "dump.beads"))


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
    assert "dump.beads: missing; run the deck first, which writes it" in capsys.readouterr().err
    (tmp_path / "in.none").write_text("".join(line for line in text.splitlines(True) if "dump" not in line))
    assert main(["adopt", str(tmp_path / "in.none"), "-o", str(tmp_path / "run")]) == 2
    assert "has no dump of style custom or atom" in capsys.readouterr().err
    assert main(["adopt", str(deck), str(deck), "-o", str(tmp_path / "run")]) == 2
    assert "give one deck and its dumps" in capsys.readouterr().err


def test_spheres_that_the_deck_does_not_have_are_refused(deck: Path, tmp_path: Path) -> None:
    (tmp_path / "dump").write_text((deck.parent / "dump.beads").read_text().replace("\n10 2 ", "\n77 2 "))
    known, _ = known_of(read(deck), Known())
    with pytest.raises(RunFolderError, match="id 77: is in the dump, but not among the spheres of the deck"):
        adopt_dump([tmp_path / "dump"], tmp_path / "run", known)


@pytest.mark.parametrize(
    "words", ["", "springs 1 2", "hertz/material soft 0 0.3", "hertz/material 2e11 0 0.3 rolling sds 1 1 1"]
)
def test_words_that_are_no_law_are_refused(words: str) -> None:
    with pytest.raises(RunFolderError, match=f"law = '{words}': "):
        law_of(words, 1)


def test_a_dump_is_told_from_a_deck(deck: Path) -> None:
    assert is_dump(deck.parent / "dump.beads")
    assert not is_dump(deck)
