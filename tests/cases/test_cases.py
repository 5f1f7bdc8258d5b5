"""Cases: commands that the programs take, pages that show the figures, and numbers that are as expected."""

import os
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from cases import run as door
from cases.run import Case, Number, Run, names
from granular_analysis.cli import main
from tests.conftest import members
from tests.house.test_docs import ROOT, judge_package

CASES = [Case.load(name) for name in names()]
DRAWN = [case for case in CASES if case.figure]
each_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
each_drawn = pytest.mark.parametrize("case", DRAWN, ids=lambda case: case.name)
WIDTH = Number("width, measured", 2, 1.5e-3, 1e-4, "the printed digits")
PRINTED = "a line of 7 words\n  width, measured  0.25 1.55e-03\nheight 1.5e-3 1.5e-3\nhollow nan nan\n"


@each_case
def test_the_runs_of_a_case_are_commands_that_the_program_takes(case: Case) -> None:
    for program, *words in case.runs().values():
        assert program == "granular-lmp"
        judge_package(words)


@each_case
def test_the_page_of_a_case_shows_its_figures(case: Case) -> None:
    file = (ROOT / "docs" / case.page).resolve()
    page, figures = file.read_text("utf-8"), os.path.relpath(ROOT / "figures", file.parent)
    drawn = re.findall(r"[\w-]+\.png", " ".join([case.figure or "", *case.pictures]))
    assert drawn
    assert all(f"({figures}/{figure})" in page for figure in drawn)


@each_drawn
def test_a_case_says_which_numbers_are_expected_and_why(case: Case) -> None:
    expected = case.expected()
    assert expected
    assert len({(number.line, number.number) for number in expected}) == len(expected)
    assert all(number.tolerance > 0 and number.reason for number in expected)


def test_a_number_that_is_printed_is_found_behind_the_words_of_its_line() -> None:
    assert WIDTH.missed(PRINTED) == ""
    assert replace(WIDTH, number=1, value=0.25).missed(PRINTED) == ""


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"value": 1.7e-3}, "must be 0.0017 ± 0.0001 (the printed digits), and is 1.55e-03"),
        ({"number": 3}, "is not there"),
        ({"line": "depth"}, "is not there"),
        ({"line": "hollow"}, "is nan"),
    ],
)
def test_a_number_that_is_not_as_expected_is_said(changed: dict[str, object], says: str) -> None:
    assert says in replace(WIDTH, **changed).missed(PRINTED)


def test_a_run_is_made_for_each_combination_of_values() -> None:
    run = Run("${law}_$speed", "$collide --set a=$law --set b=$speed", {"law": ["x", "y"], "speed": [1, 2.5]})
    made = dict(run.expanded({"collide": "granular-lmp collide"}))
    assert list(made) == ["x_1", "x_2.5", "y_1", "y_2.5"]
    assert made["y_2.5"] == ["granular-lmp", "collide", "--set", "a=y", "--set", "b=2.5"]


@pytest.mark.usefixtures("drawn_once")
@pytest.mark.parametrize("name", members(["figure2", "own_deck", "standing"], "standing"))
def test_a_case_is_run_drawn_and_judged_by_one_command(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    words = ["case", name, "--runs", str(tmp_path / "runs"), "--figures", str(tmp_path)]
    assert main(words) == 0
    assert (tmp_path / str(Case.load(name).figure)).stat().st_size > 10_000
    # A wrong value is said, with the runs that are there
    wrong = [replace(number, value=2 * number.value) for number in Case.load(name).expected()]
    monkeypatch.setattr(Case, "expected", lambda self: wrong)
    capsys.readouterr()
    request.getfixturevalue("unrendered")
    assert main([*words, "--measure"]) == 1
    assert len(capsys.readouterr().err.splitlines()) == len(wrong)


def test_a_case_that_is_not_there_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["case", "nowhere"])
    assert "nowhere: is not a case; granular-analysis cases lists all cases" in capsys.readouterr().err


def test_a_run_that_fails_ends_the_case(tmp_path: Path) -> None:
    broken = replace(Case.load("standing"), run=[Run("broken", "granular-lmp run nowhere")])
    with pytest.raises(SystemExit, match="run nowhere .* ended with status 2"):
        door.simulate(broken, tmp_path, 1)


def test_the_table_of_cases_has_a_row_of_each() -> None:
    _, *rows = door.table()
    assert [row[0].strip("`") for row in rows] == names()
    assert ("`fronts`", "[studies](../studies.md)", "0.5", Case.load("fronts").says) in rows


def test_the_recipe_of_a_case_is_its_runs_and_its_script(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cases"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == names()
    assert main(["cases", "fronts"]) == 0
    smooth, rough, script = capsys.readouterr().out.splitlines()
    assert shlex.split(smooth) == [*Case.load("fronts").runs()["smooth"], "-o", "runs/fronts/smooth"]
    assert rough.endswith("--set effects.friction=0.3 -o runs/fronts/rough")
    assert script == "granular-analysis fronts runs/fronts/smooth runs/fronts/rough -o figures/fronts.png"
