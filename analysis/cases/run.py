"""Run a case: make its runs, run its script, and compare its numbers with the expected ones.

    granular-analysis case NAME... [--runs DIR] [--figures DIR] [--workers N] [--measure]
    granular-analysis cases [NAME...]

A case is a folder ``analysis/cases/NAME``. ``case.toml`` holds its subject, the commands of its runs, and commands of
pictures that need no script. ``case.py`` measures the runs, prints a table and draws the figure. ``expected.json``
holds numbers of that table, each with a tolerance and its reason. The exit status is 1 if a number is missed.
"""

import argparse
import io
import itertools
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from string import Template
from typing import Any

CASES = Path(__file__).parent
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|nan|inf)(?![\w.])")
PROGRAMS = {"granular-lmp": ["-P", "-m", "granular_lmp"]}  # -P: imports nothing from the current folder
CONTINUED = ("sweep", "cost")  # commands that keep finished runs of a folder; others start again


@dataclass(frozen=True)
class Number:
    """A number that a case prints.

    Attributes
    ----------
    line : start of its line, with single spaces between words.
    number : number of the value behind these words, from 1.
    value, tolerance : expected value, and the largest difference from it.
    reason : reason of the tolerance.
    """

    line: str
    number: int
    value: float
    tolerance: float
    reason: str

    def missed(self, printed: str) -> str:
        """Return a sentence if the number in the output of a case is missing or off; "" if it is as expected."""
        wanted = f"{self.line!r}, number {self.number}: must be {self.value:g} ± {self.tolerance:g} ({self.reason})"
        lines = (" ".join(line.split()) for line in printed.splitlines())
        rest = next((line.removeprefix(self.line) for line in lines if line.startswith(self.line)), "")
        found = NUMBER.findall(rest)[self.number - 1 : self.number]
        if not found:
            return f"{wanted}, and is not there"
        return "" if abs(float(found[0]) - self.value) <= self.tolerance else f"{wanted}, and is {found[0]}"


@dataclass(frozen=True)
class Run:
    """A command that makes a run folder; ``$name`` in its words stands for each of the values of `each` in turn."""

    folder: str
    command: str
    each: Mapping[str, Sequence[Any]] = field(default_factory=dict)

    def expanded(self, short: Mapping[str, str]) -> Iterator[tuple[str, list[str]]]:
        """Return the folder and the words of the command for each combination of values."""
        command = Template(Template(self.command).safe_substitute(short))
        for values in itertools.product(*self.each.values()):
            named = dict(zip(self.each, values, strict=True))
            yield Template(self.folder).substitute(named), shlex.split(command.substitute(named))


@dataclass(frozen=True)
class Case:
    """A case.

    Attributes
    ----------
    name : folder of the case.
    says : subject, in words.
    page : page that shows the case, relative to the folder of the docs; by default the README.md of the case.
    minutes : processor time of runs and script.
    figure : file of the figure; None if the case has only `pictures`.
    arguments : arguments of the script; ``$folders`` stands for the run folders.
    short : abbreviations in the commands of the runs.
    run : commands that make the run folders.
    pictures : commands that draw runs.
    """

    name: str
    says: str
    page: str
    minutes: float
    figure: str | None = None
    arguments: str = "$folders"
    short: Mapping[str, str] = field(default_factory=dict)
    run: Sequence[Run] = ()
    pictures: Sequence[str] = ()

    @classmethod
    def load(cls, name: str) -> "Case":
        """Return the case with a name; raise ValueError if there is none."""
        try:
            table = tomllib.loads((CASES / name / "case.toml").read_text("utf-8"))
        except OSError:
            raise ValueError(f"{name}: is not a case; granular-analysis cases lists all cases") from None
        table.setdefault("page", f"../analysis/cases/{name}/README.md")
        return cls(name, **table | {"run": [Run(**run) for run in table.get("run", ())]})

    @property
    def title(self) -> str:
        """Title of the page: the name of its file, or for the README of a case the name of the folder."""
        path = Path(self.page)
        return path.parent.name if path.name == "README.md" else path.stem

    def runs(self) -> dict[str, list[str]]:
        """Return the words of the command of each run, by folder."""
        return {folder: words for run in self.run for folder, words in run.expanded(self.short)}

    def script(self) -> Any:
        """Return the module that measures and draws: ``case.py``, or the tool with the name of the case."""
        own = (CASES / self.name / "case.py").is_file()
        return import_module(f"cases.{self.name}.case" if own else f"granular_analysis.tools.{self.name}")

    def expected(self) -> list[Number]:
        """Return the numbers that the script must print."""
        file = CASES / self.name / "expected.json"
        return [Number(**each) for each in json.loads(file.read_text("utf-8"))] if file.is_file() else []


def names() -> list[str]:
    """Return the names of all cases."""
    return sorted(file.parent.name for file in CASES.glob("*/case.toml"))


def simulate(case: Case, folder: Path, workers: int) -> None:
    """Run the commands of a case: single runs in parallel, then sweeps one after another, each with all workers."""
    single, swept = [], []
    for command in commands(case, folder):
        if command[1] in CONTINUED:
            swept.append(command + (["--workers", str(workers)] if command[1] == "sweep" else []))
        else:
            single.append([*command, "--force"])
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(launch, single))
    for command in swept:
        launch(command)


def commands(case: Case, folder: Path) -> list[list[str]]:
    """Return the words of the command of each run of a case, with run folders inside `folder`."""
    return [[*words, "-o", str(folder / name)] for name, words in case.runs().items()]


def drawing(case: Case, runs: Path, figures: Path) -> list[list[str]]:
    """Return the words of the commands that draw a case: its pictures, then its script."""
    folders = shlex.join(str(runs / name) for name in case.runs())
    where = {"folders": folders, "runs": shlex.quote(str(runs)), "figures": shlex.quote(str(figures))}
    drawn = [shlex.split(Template(picture).substitute(where)) for picture in case.pictures]
    if case.figure is None:
        return drawn
    arguments = shlex.split(Template(case.arguments).substitute(where))
    return [*drawn, ["granular-analysis", case.name, *arguments, "-o", str(figures / case.figure)]]


def recipe(case: Case) -> list[str]:
    """Return the commands that make the runs and figures of a case, as lines to copy."""
    runs = Path("runs", case.name)
    return [shlex.join(words) for words in (*commands(case, runs), *drawing(case, runs, Path("figures")))]


def table() -> list[Sequence[str]]:
    """Return the head and the rows of the table of cases for a page in ``docs/reference``."""
    cases = [Case.load(name) for name in names()]
    rows = [(f"`{each.name}`", f"[{each.title}](../{each.page})", f"{each.minutes:g}", each.says) for each in cases]
    return [("case", "page", "minutes", "subject"), *rows]


def launch(words: Sequence[str]) -> None:
    """Run one command, which prints its own errors; raise SystemExit if it fails."""
    program, *rest = words
    if status := subprocess.run([sys.executable, *PROGRAMS[program], *rest], check=False).returncode:
        raise SystemExit(f"{shlex.join(words)}: ended with status {status}")


def measure(case: Case, runs: Path, figures: Path) -> list[str]:
    """Measure and draw the runs of a case; return a sentence for each expected number that is missed."""
    drawn = drawing(case, runs, figures)
    script = drawn.pop() if case.figure else None
    for picture in drawn:
        launch(picture)
    if script is None:
        return []
    with redirect_stdout(io.StringIO()) as printed:
        case.script().main(script[2:])
    print(printed.getvalue(), end="")
    return [missed for number in case.expected() if (missed := number.missed(printed.getvalue()))]


def listing() -> str:
    """Return a line for each case: name, minutes of processor time, page, subject."""
    cases = map(Case.load, names())
    return "\n".join(f"{each.name:14} {each.minutes:5g} min  {each.title:24} {each.says}" for each in cases)


def main(argv: list[str] | None = None) -> int:
    """Run the cases on the command line; return 1 if a number is not as expected."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("cases", nargs="*", metavar="NAME", help="cases; granular-analysis cases lists them")
    parser.add_argument("--list", action="store_true", help="list all cases, or the commands of the named ones")
    parser.add_argument("--runs", type=Path, metavar="DIR", help="folder of the runs (default: runs/NAME)")
    parser.add_argument("--figures", type=Path, default=Path("figures"), metavar="DIR", help="default: figures")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), metavar="N", help="default: all processors")
    parser.add_argument("--measure", action="store_true", help="make no runs, only measure existing ones")
    chosen = parser.parse_args(argv)
    try:
        cases = [Case.load(name) for name in chosen.cases]
    except ValueError as error:
        parser.error(str(error))
    if chosen.list or not cases:
        print("\n".join(line for each in cases for line in recipe(each)) or listing())
        return 0
    return max(map(partial(_play, chosen), cases), default=0)


def _play(chosen: argparse.Namespace, case: Case) -> int:
    runs = chosen.runs or Path("runs", case.name)
    if not chosen.measure:
        simulate(case, runs, chosen.workers)
    missed = measure(case, runs, chosen.figures)
    for each in missed:
        print(f"{case.name}: {each}", file=sys.stderr)
    return int(bool(missed))
