"""The tutorial does what it says: its files, commands and scripts, one after the other, and the lines that it shows."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from granular_lmp.cli import help_texts

ROOT = Path(__file__).parents[1]
TUTORIAL = ROOT / "docs" / "tutorial.md"
BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?[ \t]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
# Two digits are shown of what depends on the time step or on last digits; half a unit of the second is at most 5 %
SHOWN = 0.05
# Commands that a version may not have yet: the page names them all the same
LATER = {"list", "init", "check", "schema"}


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
            commands = [line[2:] for line in block.splitlines() if line.startswith("$ ")]
            printed = "".join(output(["bash", "-c", command], folder) for command in commands if known(command))
        missing += [
            line
            for line in block.splitlines() * (kind in ("console", "text"))
            if not line.startswith("$ ") and not any(says(other, line) for other in printed.splitlines())
        ]
    return missing


def known(command: str) -> bool:
    """Whether this version has the command; one of the few that another version adds is left out."""
    name = f"granular-lmp {command.split()[1]}"
    takes_a_file = not command.startswith("granular-lmp init ") or "positional" in help_texts()[name]
    left_out = command.split()[1] in LATER and not (name in help_texts() and takes_a_file)
    assert left_out or name in help_texts() or command.startswith("granular-analysis ")
    return not left_out


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
    """Whether a printed line is the line shown: the same words, and numbers that agree to two digits."""
    words, others = printed.split(), shown.split()
    return len(words) == len(others) and all(map(same, words, others))


def same(word: str, other: str) -> bool:
    try:
        return float(word) == pytest.approx(float(other), rel=SHOWN, abs=0)
    except ValueError:
        return word == other


@pytest.mark.slow
def test_every_command_of_the_tutorial_runs_and_prints_what_the_page_shows(tmp_path: Path) -> None:
    assert follow(TUTORIAL.read_text("utf-8"), tmp_path) == []


def test_a_line_that_nothing_prints_is_found(tmp_path: Path) -> None:
    page = "```python\nprint('p 1.00')\n```\n```text\np 1.01\np 1.1\nq 1.00\np\n```\n"
    assert follow(page, tmp_path) == ["p 1.1", "q 1.00", "p"]


def test_a_command_that_fails_or_that_nobody_knows_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="no such scene"):
        follow("```console\n$ granular-lmp run not_there -o run\n```\n", tmp_path)
    with pytest.raises(AssertionError):
        follow("```console\n$ granular-lmp rum tr_periodic\n```\n", tmp_path)
