"""The tutorial does what it says: its files, commands and scripts, the lines that it shows, and its notebook."""

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from granular_analysis.cli import main as analysis_main
from granular_lmp.cli import main
from granular_lmp.plot.movie import write_movie
from tests.conftest import members
from tests.house.test_site import loaded

ROOT = Path(__file__).parents[2]
PICTURES = {
    "tutorial": ["image/gif", *["image/png"] * 3],
    "tutorial-fit": ["image/gif", "image/png"],
    "tutorial-doubling": ["image/png"],
}
PAGES = {name: ROOT / "docs" / f"{name}.md" for name in PICTURES}
TUTORIAL = PAGES["tutorial"]
BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?[ \t]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
PROGRAMS: dict[str, Callable[[list[str]], int | None]] = {"granular-lmp": main, "granular-analysis": analysis_main}
# Two digits are shown of what depends on the time step or on last digits; half a unit of the second is at most 5 %
SHOWN = 0.05


def follow(text: str, folder: Path) -> list[str]:
    """Do what a page says in a folder, and return the lines that it shows and that nothing has printed.

    A block with a title is a file; of a console block, the lines that begin with a dollar are commands; what a text
    block or the other lines of a console block show has been printed by the commands or the script before it.
    """
    missing: list[str] = []
    printed = ""
    for kind, title, block in BLOCK.findall(text):
        if title:
            (folder / title).write_text(block, encoding="utf-8")
        elif kind == "python":
            (folder / "script.py").write_text(block, encoding="utf-8")
            printed = output([sys.executable, "script.py"], folder)
        elif kind == "console":
            printed = "".join(command(line[2:], folder) for line in block.splitlines() if line.startswith("$ "))
        missing += [line for line in shown(kind, block) if not any(says(other, line) for other in printed.splitlines())]
    return missing


def shown(kind: str, block: str) -> list[str]:
    """Return the lines of a block that are answers."""
    return [line for line in block.splitlines() if not line.startswith("$ ")] if kind in ("console", "text") else []


def command(line: str, folder: Path) -> str:
    """Return what a command prints: of our programs in this process, which has imported what each would import."""
    program, *words = shlex.split(line)
    if program not in PROGRAMS or ">" in words:
        return output(["bash", "-c", line], folder)
    out, err = StringIO(), StringIO()
    with chdir(folder), redirect_stdout(out), redirect_stderr(err), patch.object(sys, "argv", [program]):
        try:
            status = PROGRAMS[program](words)
        except SystemExit as end:
            status = end.code
    assert not status, f"{line}: {err.getvalue()} {status}"
    return out.getvalue()


def output(command: list[str], folder: Path) -> str:
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    programs = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        command,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path, "PATH": programs, "MPLBACKEND": "Agg"},
        timeout=120,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


def says(printed: str, shown: str) -> bool:
    """Tell if a printed line is the line shown: the same words, and numbers that agree to two digits."""
    words, others = printed.split(), shown.split()
    return len(words) == len(others) and all(map(same, words, others))


def same(word: str, other: str) -> bool:
    try:
        return float(word) == pytest.approx(float(other), rel=SHOWN, abs=0)
    except ValueError:
        return word == other


each_page = pytest.mark.parametrize("name", PAGES)


@pytest.fixture
def short_movies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets movies have three frames; tests/plot draws whole ones."""

    def short(figure: Any, show: Any, count: int, *others: Any) -> None:
        write_movie(figure, show, min(count, 3), *others)

    monkeypatch.setattr("granular_lmp.plot.crystal.write_movie", short)


# `make tested-docs` runs all
@pytest.mark.parametrize("name", members(PAGES, "tutorial", "tutorial-doubling"))
@pytest.mark.usefixtures("short_movies", "drawn_once")
def test_every_command_of_the_tutorial_runs_and_prints_what_the_page_shows(name: str, tmp_path: Path) -> None:
    assert follow(PAGES[name].read_text("utf-8"), tmp_path) == []


def test_a_line_that_nothing_prints_is_found(tmp_path: Path) -> None:
    page = "```python\nprint('p 1.00')\n```\n```text\np 1.01\np 1.1\nq 1.00\np\n```\n"
    assert follow(page, tmp_path) == ["p 1.1", "q 1.00", "p"]


def test_a_command_that_fails_or_that_nobody_knows_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="no such scene"):
        follow("```console\n$ granular-lmp run not_there -o run\n```\n", tmp_path)
    with pytest.raises(AssertionError, match="invalid choice: 'rum'"):
        follow("```console\n$ granular-lmp rum tr_periodic\n```\n", tmp_path)


# ---------------------------------------------------------------- the notebook

NOTEBOOKS: dict[str, dict[str, Any]] = {
    name: json.loads(page.with_suffix(".ipynb").read_text("utf-8")) for name, page in PAGES.items()
}
NOTEBOOK = NOTEBOOKS["tutorial"]


def without_outputs(cells: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the cells of a notebook as they were before it was executed."""
    return [cell | {"outputs": [], "execution_count": None} if "outputs" in cell else cell for cell in cells]


def printed_in(notebook: dict[str, Any]) -> list[str]:
    """Return the lines that the cells of a notebook have printed."""
    outputs = [output for cell in notebook["cells"] for output in cell.get("outputs", [])]
    return [line for output in outputs for line in output.get("text", "").splitlines()]


def not_printed(page: str, notebook: dict[str, Any]) -> list[str]:
    """Return the lines that a page shows as answers and that the notebook does not hold."""
    lines = [line for kind, _, block in BLOCK.findall(page) for line in shown(kind, block)]
    return [line for line in lines if not any(says(other, line) for other in printed_in(notebook))]


def test_every_tutorial_has_its_notebook() -> None:
    assert set(loaded("tutorial_notebook").PAGES) == set(PAGES)
    for page in PAGES.values():
        assert f"[notebook]({page.stem}.ipynb)" in page.read_text("utf-8").replace("\n", " ")


@each_page
def test_the_notebook_is_what_the_page_makes(name: str) -> None:
    made = loaded("tutorial_notebook").cells(PAGES[name].read_text("utf-8"))
    assert without_outputs(NOTEBOOKS[name]["cells"]) == made, "make notebook makes it again"


@each_page
def test_the_notebook_holds_every_answer_that_the_page_shows(name: str) -> None:
    assert not_printed(PAGES[name].read_text("utf-8"), NOTEBOOKS[name]) == []


@each_page
def test_the_notebook_shows_every_picture_and_no_error(name: str) -> None:
    outputs = [output for cell in NOTEBOOKS[name]["cells"] for output in cell.get("outputs", [])]
    assert not [output for output in outputs if output["output_type"] == "error"]
    kinds = [kind for output in outputs for kind in output.get("data", {}) if kind.startswith("image/")]
    assert sorted(kinds) == PICTURES[name]


@each_page
def test_the_notebook_is_a_valid_one(name: str) -> None:
    pytest.importorskip("nbformat").validate(NOTEBOOKS[name])


def test_another_page_is_not_the_page_of_the_notebook() -> None:
    page = TUTORIAL.read_text("utf-8")
    for before, after in (
        ("poisson_ratio = 0.34", "poisson_ratio = 0.35"),
        ("ten minutes", "an hour"),
        (":21 ", ":22 "),
    ):
        changed = page.replace(before, after)
        assert loaded("tutorial_notebook").cells(changed) != without_outputs(NOTEBOOK["cells"])
    assert not_printed(page.replace("resonance       1.353267", "resonance       1.753267"), NOTEBOOK) == [
        "resonance       1.753267    TR -> L 8.58971e+07 Hz     0.0484"
    ]


def test_a_block_that_is_no_cell_is_refused() -> None:
    with pytest.raises(ValueError, match="a block of ruby: allowed are console, python, text"):
        loaded("tutorial_notebook").cells("```ruby\nputs 1\n```\n")


def test_an_executed_notebook_holds_its_answers_and_a_failing_cell_stops_it() -> None:
    exceptions = pytest.importorskip("nbclient").exceptions
    pytest.importorskip("ipykernel")
    builder = loaded("tutorial_notebook")
    file, command, code = "x = 1", "$ cat a.toml\nshown", "print(1 + 1)"
    page = f'# A\n\n```toml title="a.toml"\n{file}\n```\n\n```console\n{command}\n```\n\n```python\n{code}\n```\n'
    done = builder.executed(builder.cells(page))
    assert printed_in(done) == ["Writing a.toml", "x = 1", "2"]
    assert without_outputs(done["cells"]) == builder.cells(page)
    with pytest.raises(exceptions.CellExecutionError):
        builder.executed(builder.cells("```console\n$ granular-lmp run not_there -o run\n$ true\n```\n"))
