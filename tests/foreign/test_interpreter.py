"""How decks of any origin are read: LAMMPS's own flow of commands, files, and what is refused."""

import signal
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from granular_lmp.cli.entry import main
from granular_lmp.errors import DeckError
from granular_lmp.foreign import apart, interpreter
from granular_lmp.foreign.apart import read_apart
from granular_lmp.foreign.interpreter import lines_of, split
from granular_lmp.foreign.lint import lint
from granular_lmp.foreign.outside import outside_of
from granular_lmp.foreign.reading import Reading, read
from granular_lmp.foreign.vibrations import contacts_of
from granular_lmp.lammps.installation import lammps_module
from tests.foreign.decks import CHAIN, SHEET

BEGIN = """units lj
atom_style sphere
"""


def of(folder: Path, text: str, **variables: str) -> Reading:
    (folder / "in.deck").write_text(text)
    return read(folder / "in.deck", variables)


def said(reading: Reading) -> list[str]:
    """Return the words that the deck says by a variable of the name *said*."""
    return [command.words[3] for command in reading.named("variable") if command.words[1] == "said"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('if "2 > 1" then "variable said index yes" else "variable said index no"', ["yes"]),
        ('if "1 > 2" then "variable said index yes" elif "3 > 2" "variable said index third"', ["third"]),
        ('if "1 > 2" then "variable said index yes" elif "3 < 2" "" else "variable said index no"', ["no"]),
        ('if "1 > 2" then "variable said index yes"', []),
        ("variable n index a b c\nlabel again\nvariable said string ${n}\nnext n\njump SELF again", ["a", "b", "c"]),
        ('variable n loop 2\nlabel a\nvariable said string "$(v_n*10)"\nnext n\njump SELF a', ["$(v_n*10)"] * 2),
        ("variable n loop 3\nlabel a\nvariable said string $(v_n*10)\nnext n\njump SELF a", ["10", "20", "30"]),
        ("include in.part\nvariable said string after", ["within", "after"]),
        ("jump in.part\nvariable said string after", ["within"]),
        ('if "1 > 0" then "jump SELF end"\nvariable said string no\nlabel end\nvariable said string yes', ["yes"]),
        ("variable said string one\nquit\nvariable said string two", ["one"]),
        ('variable said string "one # two" # three', ["one # two"]),
        ("variable said &\n   string & \t\n   long  # with a comment", ["long"]),
        ("variable said string one  # two &\nvariable said string three", ["one"]),
        ('# """\nvariable said string one\n""" two\nvariable said string three', ["three"]),
        ('variable said string """one\n  two"""', ["one\n  two"]),
        ("variable said string one\n# two &", ["one"]),
        ("variable said string one &\n\n", ["one"]),
    ],
)
def test_commands_follow_each_other_as_in_lammps(tmp_path: Path, text: str, words: list[str]) -> None:
    (tmp_path / "in.part").write_text("variable said string within\n")
    reading = of(tmp_path, f"{BEGIN}{text}\n")
    assert not reading.stopped
    assert said(reading) == words


def test_a_command_has_its_file_and_the_number_of_its_first_line(tmp_path: Path) -> None:
    (tmp_path / "in.part").write_text("\n\nvariable said &\nstring within\n")
    first, second = of(tmp_path, f"{BEGIN}include in.part\n\nvariable said string after\n").commands[-2:]
    assert (first.file, first.line) == ("in.part", 3)
    assert (second.file, second.line) == ("in.deck", 5)


def test_lines_and_words_are_those_of_lammps() -> None:
    text = "a b # c\n\nd &\n  f\n'g # h'\ni & # j\nk\n# l &\nm\nn\n"
    expected = [(1, "a b"), (3, "d   f"), (5, "'g # h'"), (6, "i &"), (7, "k"), (10, "n")]
    assert lines_of(text) == expected


@pytest.mark.parametrize(
    "text",
    [
        "variable one string 1\n# note &\nvariable two string 2\nvariable three string 3\n",
        "variable one string & # note\nvariable two string 2\n",
        '# """\nvariable one string 1\n# """ &\nvariable two string 2\nvariable three string 3\n',
        'variable one string """1 &\n2 # 3\n"""\nvariable two str&\ning 2\n',
        "# don't &\nvariable one string 1\nvariable two string && \n3\n",
    ],
)
def test_lines_are_joined_as_lammps_joins_them(text: str, tmp_path: Path) -> None:
    (tmp_path / "in.lines").write_text(text)
    with closing(lammps_module().lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])) as lmp:
        lmp.file(str(tmp_path / "in.lines"))
        names = ("one", "two", "three")
        there = {name: lmp.extract_variable(name) for name in names if lmp.has_id("variable", name)}
    assert there
    assert {words[1]: words[3] for _, line in lines_of(text) if (words := split(line))} == there
    assert split("""a "b c" 'd "e"' f""") == ("a", "b c", 'd "e"', "f")


@pytest.mark.parametrize(
    "line",
    [
        "shell touch left",
        "python f input 0 here \"def f(): open('left', 'w')\"",
        "variable x python f",
        "fix x all python/invoke 1 end_of_step f",
        "fix x all imd 8888",
        "plugin load left.so",
        'if "1 > 0" then "shell touch left"',
        "pair_style python 5.0",
        "pair_style hybrid zero 1.0 python 5.0",
        "fix x all ipi left 8888 unix",
        "partition yes 1 shell touch left",
        "variable s string shell\n${s} touch left",
    ],
)
def test_decks_that_run_programs_are_refused_by_the_line(tmp_path: Path, line: str) -> None:
    reading = of(tmp_path, f"{BEGIN}{line}\n")
    assert "may run other programs" in reading.stopped
    assert f"line {2 + len(line.splitlines())}" in reading.stopped
    assert not list(tmp_path.rglob("left"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("label a\njump SELF a\n", "is this an endless loop"),
        ("jump SELF nowhere\n", "no label 'nowhere'"),
        ("include in.none\n", "cannot be read"),
        ("pair_style nothing\n", "LAMMPS refuses 'pair_style nothing'"),
        ("jump\n", "'jump' lacks a word"),
        ("next 1*2\n", "LAMMPS refuses 'next 1*2'"),
        ("run some\n", "LAMMPS refuses 'run some'"),
        ("run 500 &\n", "in.deck, line 3: the file ends in '&' here, and LAMMPS refuses 'run 500 &'; take out the '&'"),
        ("run 500 &", "the file ends in '&' here, and LAMMPS refuses 'run 500 &'"),
        ("run 500 & # ends\n", "LAMMPS refuses 'run 500 &'"),
        ('print """one\n', "Unmatched triple quote"),
        ("variable a equal ${b}\n", "LAMMPS refuses 'variable a equal ${b}'"),
    ],
)
def test_reading_stops_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, message: str
) -> None:
    monkeypatch.setattr(interpreter, "MOST_COMMANDS", 1000)
    assert message in of(tmp_path, f"{BEGIN}{text}").stopped


def test_variables_of_the_command_line_come_before_those_of_the_deck(tmp_path: Path) -> None:
    text = f"{BEGIN}variable n index 3\nvariable said string ${{n}}\n"
    assert said(of(tmp_path, text)) == ["3"]
    assert said(of(tmp_path, text, n="5")) == ["5"]


@pytest.mark.parametrize(
    "line",
    [
        "fix w all ave/time 1 1 1 c_t file {0}",
        'fix w all ave/time 1 1 1 c_t file "{0}"',
        'fix w all ave/time 1 1 1 c_t "file" {0}',
        "variable s string {0}\nfix w all ave/time 1 1 1 c_t file ${{s}}",
        "balance 1.0 shift x 5 1.1 out {0}",
        "group2ndx {0}",
        "write_data {0}",
    ],
)
def test_a_deck_that_is_read_writes_over_no_file(tmp_path: Path, line: str) -> None:
    place = tmp_path / "precious"
    place.write_text("mine\n")
    reading = of(tmp_path, f"{CHAIN}compute t all temp\n{line.format(place)}\ntimestep 1e-7\nrun 2\n")
    assert not reading.stopped
    assert place.read_text() == "mine\n"


@pytest.mark.parametrize("steps", ["5", "+5", "0", "-0", "1e1", "v_n"])
def test_what_a_run_executes_in_between_is_not_executed(tmp_path: Path, steps: str) -> None:
    of(tmp_path, f'{CHAIN}timestep 1e-7\nvariable n equal 5\nrun {steps} every 1 "shell touch {tmp_path}/left"\n')
    assert not (tmp_path / "left").exists()


def test_a_command_that_is_not_known_is_refused(tmp_path: Path) -> None:
    assert "'temper 1 2 3' is a command that is not known here" in of(tmp_path, f"{BEGIN}temper 1 2 3\n").stopped


def test_a_file_that_is_called_as_a_fix_is_not_taken_for_it(tmp_path: Path) -> None:
    (tmp_path / "move").write_text("")
    text = CHAIN.replace("fix move", "fix  move")
    assert not of(tmp_path, f"{text}fix move all nve/sphere\n" if "fix  move" not in text else text).stopped


def test_a_deck_that_is_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in.folder").mkdir()
    assert "is not a file" in of(tmp_path, f"{BEGIN}include in.folder\n").stopped


def test_a_name_like_a_program_is_no_program(tmp_path: Path) -> None:
    lines = "variable python index 1\nvariable shell equal 2\nvariable home getenv HOME\n"
    assert not of(tmp_path, BEGIN + lines).stopped


def test_the_longest_step_of_all_long_runs_is_judged(tmp_path: Path) -> None:
    reading = of(tmp_path, CHAIN + "timestep 3.0e-6\nrun 100\ntimestep 1.0e-7\nrun 100\ntimestep 1.0\nrun 1\n")
    ((check, finding),) = lint(reading)
    assert check.name == "time-step"
    assert str(finding.command) == "timestep 3.0e-6"


@pytest.mark.parametrize("line", ["dump", "dump 1 all custom", "undump", "dump_modify", "print", "quit"])
def test_a_line_that_lacks_words_and_is_not_executed_stops_nothing(line: str, tmp_path: Path) -> None:
    reading = of(tmp_path, SHEET.replace("run 2000", f"run 100\n{line}\nrun 100"))
    assert not reading.stopped
    assert not lint(reading)
    assert not outside_of(reading).others


def test_a_negative_stiffness_is_not_judged(tmp_path: Path) -> None:
    reading = of(tmp_path, SHEET.replace("mindlin NULL 0.0 1.0", "mindlin -1 0.0 1.0"))
    assert contacts_of(reading) is None
    assert not lint(reading)


def test_only_the_first_step_of_a_long_run_is_computed(tmp_path: Path) -> None:
    reading = of(tmp_path, SHEET.replace("run 2000", "run 1\nrun 100000000\ntimestep 1.0\nrun 0"))
    assert [(stage.steps, stage.exact) for stage in reading.stages] == [(1, True), (100000000, True), (0, False)]
    assert reading.start is reading.stages[1]
    assert reading.start.timestep == 0.025


def test_a_deck_that_brings_lammps_down_is_told_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "in.deck").write_text(CHAIN)
    assert len(read_apart(tmp_path / "in.deck").stages) == 1
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(DeckError, match="in.deck: LAMMPS died at the deck: 1"):
        read_apart(tmp_path / "in.deck")


@pytest.mark.parametrize(
    ("end", "said"),
    [
        (-signal.SIGSEGV, "LAMMPS died at 'in.deck:3: units si': Segmentation fault"),
        (-signal.SIGXCPU, "LAMMPS did not finish 'in.deck:3: units si' in 300 s"),
        (None, "LAMMPS did not finish 'in.deck:3: units si' in 300 s"),
    ],
)
def test_a_command_at_which_lammps_ends_or_hangs_is_told(
    end: int | None, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(command: list[str], **options: Any) -> Any:
        """End as a process in which LAMMPS is at the third line."""
        Path(command[-1]).with_suffix(apart.AT).write_text("in.deck:3: units si")
        if end is None:
            raise subprocess.TimeoutExpired(command, options["timeout"])
        return subprocess.CompletedProcess(command, end, "", "")

    monkeypatch.setattr(subprocess, "run", run)
    with pytest.raises(DeckError, match=f"in.deck: {said}"):
        read_apart(tmp_path / "in.deck")


def test_the_command_at_which_a_process_is_stands_in_its_file(tmp_path: Path) -> None:
    told: list[str] = []
    (tmp_path / "in.deck").write_text(CHAIN)
    read(tmp_path / "in.deck", tell=lambda command: told.append(str(command)))
    assert (told[0], told[-1]) == ("units si", "run 5000")


def test_the_command_says_what_it_could_not_judge(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in.lj").write_text("units lj\natom_style atomic\npair_style lj/cut 2.5\n")
    assert main(["lint", "in.lj"]) == 0
    assert "the deck has no run" in (errors := capfd.readouterr().err)
    assert "does not use pair_style granular" in errors
    Path("in.bad").write_text("units nothing\n")
    assert main(["lint", "in.bad"]) == 2
    assert "in.bad, line 1: LAMMPS refuses 'units nothing'" in capfd.readouterr().err
    lines = SHEET.splitlines()
    Path("in.empty").write_text(
        "\n".join(line for line in lines if not line.startswith(("create_atoms", "set", "velocity")))
    )
    assert main(["lint", "in.empty"]) == 0
    assert "there were no spheres" in capfd.readouterr().err
    assert main(["lint", "in.none"]) == 2
    assert "no such deck" in capfd.readouterr().err
    Path("in.sheet").write_text(SHEET + "pair_style nothing\n")
    assert main(["lint", "in.sheet", "--json", "--strict"]) == 0
    shown = capfd.readouterr()
    assert shown.out.strip() == "[]"
    assert "the rest of the deck was not read" in shown.err
