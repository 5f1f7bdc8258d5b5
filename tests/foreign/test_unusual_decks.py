"""Legal decks that few people write: each number of theirs is right under its name, or refused by name and line."""

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import pytest

from granular_analysis.measure.witness import witness
from granular_analysis.theory.errors import TheoryError
from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError
from granular_lmp.foreign.adopt_dump import adopt_dump
from granular_lmp.foreign.conversion import Known
from granular_lmp.foreign.known import dumps_of, known_of
from granular_lmp.foreign.outside import Outside, outside_of
from granular_lmp.foreign.reading import Reading, read
from granular_lmp.runs.unnamed import Unnamed
from tests.instance import run_deck

# Ten beads in a line, the first of which is struck obliquely, and one beside it; the last one of the line is held
BEADS = """
units cgs
atom_style sphere
boundary f f f
comm_modify vel yes
region box block -2 25 -4 4 -4 4
create_box 2 box
variable i loop 10
label beads
variable x equal (v_i-1)*1.9999
variable kind equal 1+(v_i==10)
create_atoms ${kind} single $x 0 0
next i
jump SELF beads
create_atoms 1 single 8.9955 1.7319 0
set group all diameter 2 density 7.78
pair_style granular
pair_coeff * * hertz/material 2e12 0 0.3 tangential mindlin NULL 0.0 0.5
group first id 1
group last id 10
group free subtract all last
velocity first set 10 3 0
fix 1 free nve/sphere
timestep 2e-7
dump 1 all custom 20 dump.beads id type x y z vx vy vz omegax omegay omegaz
dump_modify 1 format float %.17g
run 500
"""
LAW = "pair_coeff * * hertz/material 2e12 0 0.3 tangential mindlin NULL 0.0 0.5\n"
DAMPED = LAW.replace("2e12 0 ", "2e12 200 ").replace("NULL 0.0", "NULL 1.0")
FLOOR = "fix 3 all wall/gran granular hertz/material 1e12 0 0.3 tangential mindlin NULL 0.0 0.5 yplane -0.9999 NULL\n"
GRAVITY = "gravity 9e7 vector 0 -1 0\n"
MOVE, DUMP = "fix 1 free nve/sphere\n", BEADS[BEADS.index("dump 1") : BEADS.index("run 500")]
APPEND, UPPER = "dump_modify 1 append yes\n", "region r block INF INF 0 INF INF INF\n"
ALL = (MOVE, "fix 1 all nve/sphere\n")


def changed(*changes: tuple[str, str]) -> str:
    text = BEADS
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def written(folder: Path, text: str) -> Reading:
    (folder / "in.beads").write_text(text)
    return read(folder / "in.beads")


def adopted(reading: Reading, *dumps: Path) -> Unnamed:
    known, _ = known_of(reading, Known(), dumps)
    return adopt_dump(dumps or dumps_of(reading), Path(reading.deck).parent / "run", known, force=True)


@pytest.fixture(scope="module")
def dump(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dump of the deck as it is."""
    folder = tmp_path_factory.mktemp("beads")
    (folder / "in.beads").write_text(BEADS)
    run_deck(folder, "in.beads")
    return folder / "dump.beads"


# --- options of contact laws ------------------------------------------------------------------------------------------

OPTIONS = {
    "rolling sds": "rolling sds 1e9 0.0 0.1",
    "twisting marshall": "rolling none twisting marshall",
    "twisting sds": "twisting sds 1e9 0.0 0.1",
    "cutoff": "cutoff 1.99995",
    "synchronized_verlet": "synchronized_verlet",
    "limit_damping": "limit_damping",
}


@pytest.mark.parametrize("option", OPTIONS)
def test_an_option_of_a_law_that_the_witness_does_not_know_is_refused_by_its_line(
    option: str, dump: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = LAW.replace("\n", f" damping velocity {OPTIONS[option]}\n")
    crystal = adopted(written(tmp_path, changed((LAW, more))), dump)
    with pytest.raises(TheoryError, match=f"in.beads:18: 'pair_coeff .*': {option} is not built; the witness knows"):
        witness(crystal)
    assert main(["lint", str(tmp_path / "in.beads")]) == 0
    assert f"note: in.beads:18: no check knows {option};" in capsys.readouterr().err


@pytest.mark.parametrize("option", OPTIONS)
def test_options_after_one_that_is_not_known_are_read(option: str, tmp_path: Path) -> None:
    more = LAW.replace(" tangential", f" {OPTIONS[option]} tangential").replace("\n", " damping tsuji\n")
    law = written(tmp_path, changed((LAW, more))).laws[1, 1]
    assert (law.unread, law.tangential, law.friction, law.damping_law) == (option, "mindlin", 0.5, "tsuji")


@pytest.mark.parametrize(("given", "mixed"), [("4e11", 2e11), ("NULL", None)])
def test_lammps_mixes_two_shear_stiffnesses_and_computes_one_that_is_null(
    given: str, mixed: float | None, tmp_path: Path
) -> None:
    laws = [LAW.replace("* *", each).replace("NULL", word) for each, word in (("1 1", "1e11"), ("2 2", given))]
    law = written(tmp_path, changed((LAW, "".join(laws)))).laws[1, 2]
    assert law.shear_stiffness == (mixed if mixed is None else pytest.approx(mixed))
    assert (law.shear_share == 1) == (mixed is not None)


def test_the_global_cutoff_is_refused(dump: Path, tmp_path: Path) -> None:
    crystal = adopted(written(tmp_path, changed(("pair_style granular", "pair_style granular 1.9"))), dump)
    with pytest.raises(TheoryError, match="pair_style granular 1.9 is not built"):
        witness(crystal)


def test_an_option_of_one_of_two_mixed_laws_is_refused(dump: Path, tmp_path: Path) -> None:
    laws = LAW.replace("* *", "1 1") + LAW.replace("* *", "2 2").replace("\n", " limit_damping\n")
    assert witness_refuses(changed((LAW, laws)), dump, tmp_path) == "limit_damping"


def witness_refuses(text: str, dump: Path, folder: Path) -> str:
    """Return the option of a law for which the witness refuses a deck."""
    with pytest.raises(TheoryError, match="is not built") as refused:
        witness(adopted(written(folder, text), dump))
    return str(refused.value).partition(" is not built")[0].rpartition(": ")[2]


LATER = {"unread": "laws", "line": "walls", "unfollowed": "outside", "strangers": "unnamed", "absent": "unnamed"}


@pytest.mark.parametrize(("entry", "where"), LATER.items())
def test_a_folder_without_an_entry_that_refuses_decks_must_be_adopted_again(
    entry: str, where: str, dump: Path, tmp_path: Path
) -> None:
    crystal = adopted(written(tmp_path, changed((MOVE, MOVE + FLOOR))), dump)
    known = deepcopy(crystal.known)
    for place in {"laws": known["laws"], "walls": known["outside"]["walls"]}.get(
        where, [known["outside"] if where == "outside" else known]
    ):
        del place[entry]
    with pytest.raises(TheoryError, match=f"run.json lacks {entry}, as another version wrote it; adopt the dump again"):
        witness(replace(crystal, info=crystal.info | {"unnamed": known}))


def test_walls_with_other_options_are_kept_by_their_line(tmp_path: Path) -> None:
    wall = FLOOR.replace(" yplane", " rolling sds 1e9 0 0.1 yplane")
    found = outside_of(written(tmp_path, changed((MOVE, MOVE + wall))))
    assert (found.walls, found.others) == ((), (wall.strip(),))


def test_the_last_of_two_damping_laws_holds(dump: Path, tmp_path: Path) -> None:
    law = DAMPED.replace("\n", " damping velocity damping mass_velocity\n")
    with pytest.raises(
        TheoryError, match="in.beads:18: .*: damping mass_velocity is not built; the witness knows velocity and coeff"
    ):
        witness(adopted(written(tmp_path, changed((LAW, law))), dump))


def test_a_restitution_that_adds_energy_is_refused(dump: Path, tmp_path: Path) -> None:
    law = DAMPED.replace("2e12 200 ", "2e12 1.1 ").replace("\n", " damping coeff_restitution\n")
    with pytest.raises(
        TheoryError,
        match=r"in.beads:18: .*: a restitution of 1\.1 is not built; the witness knows values above 0, up to 1",
    ):
        witness(adopted(written(tmp_path, changed((LAW, law))), dump))


@pytest.mark.parametrize(
    ("line", "pairs"),
    [
        ("2* 1*2", {(2, 2)}),
        ("2 1", {(1, 2)}),
        ("1* 2", {(1, 2), (2, 2)}),
        ("B A", {(1, 2)}),
        ("* *", {(1, 1), (1, 2), (2, 2)}),
    ],
)
def test_a_law_is_that_of_the_pairs_that_lammps_chooses(line: str, pairs: set[tuple[int, int]], tmp_path: Path) -> None:
    other = f"labelmap atom 1 A 2 B\n{LAW}{LAW.replace('* *', line).replace('2e12', '1e12')}"
    reading = written(tmp_path, changed((LAW, other)))
    assert not reading.stopped
    assert {pair for pair, law in reading.laws.items() if law.young == 1e12} == pairs
    assert len(reading.laws) == 3


# --- what acts, and when ----------------------------------------------------------------------------------------------

# Changes of the deck, and the lines that no witness knows
BETWEEN = {
    "a minimization at the end": ((("run 500\n", "run 500\nminimize 0 0 9 9\n"),), "minimize 0 0 9 9"),
    "a minimization at the beginning": ((("run 500\n", "minimize 0 0 9 9\nrun 500\n"),), "minimize 0 0 9 9"),
    "velocities behind a run of no step": (
        (("run 500\n", "run 0\nvelocity first set 9 0 0\nrun 500\n"),),
        "velocity first set 9 0 0",
    ),
    "another dump ends": (
        (("run 500\n", "dump 2 all atom 50 two\nrun 200\nundump 2\nset group first omega 0 0 9\nrun 300\n"),),
        "set group first omega 0 0 9",
    ),
    "a fix that another one follows": (
        (
            (MOVE, MOVE + "fix 2 all ave/time 1 1 1 c_thermo_temp\n"),
            (
                "run 500\n",
                "run 200\nunfix 2\nfix 2 free viscous 1e3\nrun 200\nunfix 2\nfix 2 all print 9 no\nrun 100\n",
            ),
        ),
        "fix 2 free viscous 1e3, unfix 2",
    ),
    "a group that grows": (
        ((MOVE, f"{MOVE}fix 2 first {GRAVITY}"), ("run 500\n", "run 200\ngroup first id 2\nrun 300\n")),
        "group first id 2",
    ),
    "a dump that is appended": (
        (
            (
                "run 500\n",
                f"{APPEND}run 200\nundump 1\nfix 2 free {GRAVITY}{DUMP}{APPEND}run 300\n",
            ),
        ),
        f"fix 2 free {GRAVITY.strip()}",
    ),
    "a rerun": ((("run 500\n", "run 500\nrerun dump.beads dump x y z\n"),), "rerun dump.beads dump x y z"),
    "pairs without forces": (
        ((MOVE, MOVE + "neigh_modify exclude group first free\n"),),
        "neigh_modify exclude group first free",
    ),
    "pairs of held spheres": (((MOVE, MOVE + "neigh_modify exclude group last last\n"),), ""),
    "a dump that is written anew": (
        (("run 500\n", f"run 200\nundump 1\nvelocity first set 9 0 0\n{DUMP}run 300\n"),),
        "",
    ),
    "nothing that acts": ((("run 500\n", "run 200\nthermo 10\ncompute 1 all ke\nvariable x equal 1\nrun 300\n"),), ""),
}


def others(reading: Reading) -> str:
    known, _ = known_of(reading, Known())
    return ", ".join(known.outside.others)


@pytest.mark.parametrize("name", BETWEEN)
def test_what_changes_the_motion_of_a_dump_is_kept_by_its_line(name: str, tmp_path: Path) -> None:
    changes, lines = BETWEEN[name]
    assert others(written(tmp_path, changed(*changes))) == lines


def test_adopting_a_dump_with_a_minimization_names_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "in.beads").write_text(changed(("run 500\n", "run 500\nminimize 0 0 9 9\n")))
    run_deck(tmp_path, "in.beads")
    assert main(["adopt", str(tmp_path / "in.beads"), "-o", str(tmp_path / "run")]) == 0
    assert "note: in.beads:28: 'minimize 0 0 9 9' acts between frames of the dump" in capsys.readouterr().err


# Changes of the deck, and the sentence with which the witness refuses it
UNFOLLOWED = {
    "a weight of frozen spheres": (
        (ALL, ("timestep", f"fix 2 last freeze\nfix 3 all {GRAVITY}timestep")),
        "'fix 3 all gravity .*' pushes sphere 10, whose forces an earlier fix sets to 0",
    ),
    "a force behind setforce": (
        (ALL, ("timestep", "fix 2 last setforce 0 0 0\nfix 3 last addforce 1e7 0 0\ntimestep")),
        "'fix 3 last addforce .*' pushes sphere 10",
    ),
    "a floor under held spheres": (
        (ALL, ("timestep", f"fix 2 last setforce 0 0 0\n{FLOOR}timestep")),
        "'fix 3 all wall/gran .*' pushes sphere 10",
    ),
    "two integrators": (
        (("timestep", "fix 2 first nve/sphere\ntimestep"),),
        "in.beads:24: 'fix 2 first nve/sphere' moves sphere 1, which 'fix 1 free nve/sphere' moves too",
    ),
    "a velocity at rest": (
        (("velocity first", "velocity last set 5 0 0\nvelocity first"),),
        "sphere 10 has a velocity or a spin, and no fix moves it",
    ),
    "a dynamic group": (
        (
            (
                "timestep",
                f"{UPPER}group up dynamic free region r\nfix 2 up {GRAVITY}timestep",
            ),
        ),
        "acts on the group of in.beads:25, 'group up dynamic free region r'",
    ),
    "a group by places behind a run": (
        (
            (
                "dump 1 all",
                f"run 200\n{UPPER}group up region r\ngroup some union up\nfix 2 some freeze\ndump 1 all",
            ),
        ),
        "'fix 2 some freeze' acts on the group of in.beads:28, 'group some union up', whose",
    ),
    "a value behind a run": (
        (
            (
                "dump 1 all",
                "variable f equal 9*ke(all)\nvariable g equal v_f\nrun 200\nfix 2 first addforce ${g} 0 0\ndump 1 all",
            ),
        ),
        "'fix 2 first addforce .*' has a value that depends on runs",
    ),
    "a motion that began at an unknown step": (
        (
            (
                "dump 1 all",
                "variable k equal step\nfix h all halt 1 v_k > 100\nrun 300\nunfix h\n"
                "fix 2 last move wiggle -3e-4 0 0 6e-5\ndump 1 all",
            ),
        ),
        "'fix 2 last move wiggle .*' began at a step that is not known here",
    ),
    "a choice behind a run": (
        (("dump 1 all", f"run 200\nif '$(ke) > 1' then 'fix 2 free {GRAVITY.strip()}'\ndump 1 all"),),
        "'if .*' has a value that depends on runs",
    ),
}


@pytest.mark.parametrize("name", UNFOLLOWED)
def test_what_no_witness_can_follow_is_refused_with_its_cause(name: str, dump: Path, tmp_path: Path) -> None:
    changes, sentence = UNFOLLOWED[name]
    reading = written(tmp_path, changed(*changes))
    assert not reading.stopped
    with pytest.raises(TheoryError, match=sentence):
        witness(adopted(reading, dump))


def test_values_that_runs_do_not_change_are_known(tmp_path: Path) -> None:
    more = "variable f equal 1e5\nvariable temp index 7\nrun 200\nfix 2 first addforce ${f} 0 $(v_f/2+0*v_temp)\n"
    text = changed(("dump 1 all", f"{more}fix 3 last addforce ${{temp}} 0 0\ndump 1 all"))
    found, _ = known_of(written(tmp_path, text), Known())
    assert (found.outside.pushes, found.outside.unfollowed) == ({1: (1e5, 0.0, 5e4)}, ())


# --- the run to which a dump belongs ----------------------------------------------------------------------------------

AGAIN = "variable k index 0.5 0.1\nlabel again\nclear\n"
# Changes of the deck with which the witness agrees, as it takes what holds while the dump is written
FOLLOWED = {
    "another law at the end": (("run 500\n", f"run 500\nundump 1\n{LAW.replace('2e12', '1e11')}run 100\n"),),
    "a second tangential law": ((LAW, LAW.replace("\n", " tangential linear_nohistory 0.0 0.0\n")),),
    "a loop that overwrites its dump": (
        ("\nunits cgs", f"\n{AGAIN}units cgs"),
        ("variable i loop", "variable i delete\nvariable i loop"),
        ("NULL 0.0 0.5", "NULL 0.0 $k"),
        ("run 500\n", "run 500\nnext k\njump SELF again\n"),
    ),
    "types that only the deck says": (
        (LAW, LAW.replace("* *", "1 1") + LAW.replace("* *", "2 2").replace("2e12", "2e11")),
        ("id type x", "id x"),
    ),
    "spheres of another mass": (
        ("mindlin NULL 0.0 0.5", "linear_nohistory 0.0 0.0"),
        ("dump 1 all", "run 20\nset type 2 density 1\nset group first density 3\ndump 1 all"),
    ),
    "radii and masses of six digits": (
        ("diameter 2 density 7.78", "diameter 1.9999333333333333 density 7.777777777"),
        ("*1.9999\n", "*1.9998333333\n"),
        ("id type x", "id type radius mass x"),
        ("float %.17g\n", "float %.17g format 3 %g format 4 %g\n"),
    ),
    "gaps in the numbers": (("group first", "group gone id 3 7\ndelete_atoms group gone compress no\ngroup first"),),
    "a weight that freeze takes": (ALL, ("timestep", f"fix 3 all {GRAVITY}fix 2 last freeze\ntimestep")),
}


@pytest.mark.parametrize("name", FOLLOWED)
def test_the_witness_takes_what_holds_while_the_dump_is_written(name: str, tmp_path: Path) -> None:
    (tmp_path / "in.beads").write_text(changed(*FOLLOWED[name]))
    run_deck(tmp_path, "in.beads")
    found = witness(adopted(read(tmp_path / "in.beads")))
    assert (found.cause, found.reasons[1:]) == ("the step", ())
    assert found.error < 1e-3


def test_a_later_dump_is_that_of_its_own_run(tmp_path: Path) -> None:
    second = DUMP.replace("dump 1", "dump 2").replace("modify 1", "modify 2").replace("dump.beads", "dump.second")
    more = f"run 500\nundump 1\ntimestep 1e-7\nfix 2 free {GRAVITY}{second}run 300\n"
    reading = written(tmp_path, changed(("run 500\n", more)))
    first, _ = known_of(reading, Known())
    later, remarks = known_of(reading, Known(), [tmp_path / "dump.second"])
    assert (first.outside.pushes, first.outside.begin, first.timestep) == ({}, 0, 2e-7)
    assert (len(later.outside.pushes), later.outside.begin, later.timestep) == (10, 500, 1e-7)
    assert remarks == [f"{reading.deck}: changes its time step; times are counted with 1e-07, that of line 33"]


def test_a_dump_of_a_part_says_that_contacts_are_missing(tmp_path: Path) -> None:
    (tmp_path / "in.beads").write_text(changed(("dump 1 all", "dump 1 free")))
    run_deck(tmp_path, "in.beads")
    found = witness(adopted(read(tmp_path / "in.beads")))
    assert not found.explained
    assert found.reasons == (
        "sphere 10 of the deck is not in the dump, and the witness has no contacts with such spheres",
    )


def test_spheres_that_the_deck_does_not_have_there_are_refused(tmp_path: Path) -> None:
    (tmp_path / "in.beads").write_text(changed(("id type x", "id type radius mass x")))
    run_deck(tmp_path, "in.beads")
    text = (tmp_path / "dump.beads").read_text()
    (tmp_path / "dump.beads").write_text(text.replace("\n11 1 ", "\n77 1 "))
    with pytest.raises(TheoryError, match="sphere 77 is in the dump and not in the deck where its run begins"):
        witness(adopted(read(tmp_path / "in.beads")))


@pytest.mark.parametrize(
    ("columns", "refused"),
    [
        ("y z vx vy", "the dump holds no x, and the spheres of the deck differ"),
        ("x y z vx", "holds no vy, and spheres move"),
    ],
)
def test_a_dump_without_an_axis_along_which_something_moves_is_refused(
    columns: str, refused: str, tmp_path: Path
) -> None:
    (tmp_path / "in.beads").write_text(changed(("x y z vx vy vz omegax omegay omegaz", columns)))
    run_deck(tmp_path, "in.beads")
    with pytest.raises(RunFolderError, match=refused):
        adopted(read(tmp_path / "in.beads"))


def test_several_radii_ask_for_types(tmp_path: Path) -> None:
    (tmp_path / "in.beads").write_text(changed(("id type x", "id x")))
    run_deck(tmp_path, "in.beads")
    with pytest.raises(RunFolderError, match="radius: several numbers, but the dump holds no type; give one number"):
        adopt_dump([tmp_path / "dump.beads"], tmp_path / "run", Known("cgs", 2e-7, [1.0, 2.0]))


def test_a_deck_without_a_pair_style_is_read(tmp_path: Path) -> None:
    reading = written(tmp_path, changed((LAW, ""), ("pair_style granular\n", "")))
    assert not reading.stopped
    assert reading.laws == {}
    assert isinstance(outside_of(reading), Outside)


EMPTY = """
units si
atom_style sphere
boundary f f f
newton off
comm_modify vel yes
region box block 0 1 0 1 0 1
create_box 1 box
pair_style granular
pair_coeff * * hertz/material 1e7 0 0.3 tangential linear_nohistory 0.0 0.0
fix 1 all nve/sphere
region slab block 0 1 0 1 0.5 1
fix 2 all gravity 9.81 vector 0 0 -1
fix ins all pour 3 1 4711 region slab diam one 0.1 dens 2500 2500
timestep 1e-4
run 2000
unfix ins
dump 1 all custom 10 dump.beads id radius mass x y z vx vy vz
run 100
"""


def test_a_deck_that_inserts_spheres_is_refused_with_a_remedy_that_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "in.beads").write_text(EMPTY)
    run_deck(tmp_path, "in.beads")
    folder = ["-o", str(tmp_path / "run")]
    assert main(["adopt", str(tmp_path / "in.beads"), *folder]) == 2
    assert "has no spheres yet at line 16 of in.beads, 'run 2000'; dump them after" in capsys.readouterr().err
    assert main(["adopt", str(tmp_path / "dump.beads"), "--units", "si", "--timestep", "1e-4", *folder]) == 0
