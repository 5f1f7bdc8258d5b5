"""Run a case: its runs, its script, and its numbers beside those that are expected.

    granular-analysis case NAME... [--runs DIR] [--figures DIR] [--workers N] [--measure]
    granular-analysis cases [NAME...]

A case is a folder ``analysis/cases/NAME``. ``case.toml`` says what it is about, and holds the commands of its runs and
of pictures that need no script; ``case.py`` measures the runs, prints a table and draws the figure; ``expected.json``
holds numbers of that table, each with a tolerance and its reason. The exit status is 1 if one of them is missed.
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
PROGRAMS = {"granular-lmp": ["-P", "-m", "granular_lmp"]}  # -P: nothing of the folder is imported
CONTINUED = ("sweep", "cost")  # commands that keep what is finished in a folder; others begin again


@dataclass(frozen=True)
class Number:
    """A number that a case prints: which of the numbers behind the words that begin its line, spaces joined."""

    line: str
    number: int
    value: float
    tolerance: float
    reason: str

    def missed(self, printed: str) -> str:
        """Return how the number misses in what a case printed; "" if it does not."""
        wanted = f"{self.line!r}, number {self.number}: must be {self.value:g} ± {self.tolerance:g} ({self.reason})"
        lines = (" ".join(line.split()) for line in printed.splitlines())
        rest = next((line.removeprefix(self.line) for line in lines if line.startswith(self.line)), "")
        found = NUMBER.findall(rest)[self.number - 1 : self.number]
        if not found:
            return f"{wanted}, and is not there"
        return "" if abs(float(found[0]) - self.value) <= self.tolerance else f"{wanted}, and is {found[0]}"


@dataclass(frozen=True)
class Run:
    """A command that makes a run folder, and in its words ``$name`` for each of the values of `each`."""

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
    """The subject of a case, its page, its commands, and the arguments of its script behind the run folders.

    page : the page that shows it, from the folder of the docs; without one it is the case's own README.md.
    figure : file of the figure; None where all that is drawn are `pictures`, commands that draw runs.
    minutes : processor time of all of it.
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
        """Return a case by its name. Raises ValueError for a name that is not there."""
        try:
            table = tomllib.loads((CASES / name / "case.toml").read_text("utf-8"))
        except OSError:
            raise ValueError(f"{name}: is no case; granular-analysis cases lists them") from None
        table.setdefault("page", f"../analysis/cases/{name}/README.md")
        return cls(name, **table | {"run": [Run(**run) for run in table.get("run", ())]})

    @property
    def title(self) -> str:
        """Name of the page: its file's, or its folder's where it is the README of a case."""
        path = Path(self.page)
        return path.parent.name if path.name == "README.md" else path.stem

    def runs(self) -> dict[str, list[str]]:
        """Return the words of the command of each run, by folder."""
        return {folder: words for run in self.run for folder, words in run.expanded(self.short)}

    def script(self) -> Any:
        """Return the module that measures and draws: the case's own, or the command of its name."""
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
    """Run the commands of a case: single runs side by side, sweeps one after another with as many workers."""
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
    """Return the words of the command of each run of a case, into folders of `folder`."""
    return [[*words, "-o", str(folder / name)] for name, words in case.runs().items()]


def drawing(case: Case, runs: Path, figures: Path) -> list[list[str]]:
    """Return the words of the commands that draw a case: its pictures, and its script."""
    folders = shlex.join(str(runs / name) for name in case.runs())
    where = {"folders": folders, "runs": shlex.quote(str(runs)), "figures": shlex.quote(str(figures))}
    drawn = [shlex.split(Template(picture).substitute(where)) for picture in case.pictures]
    if case.figure is None:
        return drawn
    arguments = shlex.split(Template(case.arguments).substitute(where))
    return [*drawn, ["granular-analysis", case.name, *arguments, "-o", str(figures / case.figure)]]


def recipe(case: Case) -> list[str]:
    """Return the commands that make a case, its runs and its figures, as lines to copy."""
    runs = Path("runs", case.name)
    return [shlex.join(words) for words in (*commands(case, runs), *drawing(case, runs, Path("figures")))]


def table() -> list[Sequence[str]]:
    """Return the cases as rows of a table of Markdown, its head first, for a page in ``docs/reference``."""
    cases = [Case.load(name) for name in names()]
    rows = [(f"`{each.name}`", f"[{each.title}](../{each.page})", f"{each.minutes:g}", each.says) for each in cases]
    return [("case", "page", "minutes", "what it is about"), *rows]


def launch(words: Sequence[str]) -> None:
    """Run one command. Raises SystemExit if it fails; what it says stands above."""
    program, *rest = words
    if status := subprocess.run([sys.executable, *PROGRAMS[program], *rest], check=False).returncode:
        raise SystemExit(f"{shlex.join(words)}: ended with status {status}")


def measure(case: Case, runs: Path, figures: Path) -> list[str]:
    """Measure the runs of a case and draw; returns the expected numbers that are missed."""
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
    """Return a line for each case: name, minutes of processor time, page, what it is about."""
    cases = map(Case.load, names())
    return "\n".join(f"{each.name:14} {each.minutes:5g} min  {each.title:24} {each.says}" for each in cases)


def main(argv: list[str] | None = None) -> int:
    """Run the cases that the command line names; returns 1 if a number is not as expected."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("cases", nargs="*", metavar="NAME", help="cases; granular-analysis cases lists them")
    parser.add_argument("--list", action="store_true", help="list the cases; of those that are named, the commands")
    parser.add_argument("--runs", type=Path, metavar="DIR", help="folder of the runs (default: runs/NAME)")
    parser.add_argument("--figures", type=Path, default=Path("figures"), metavar="DIR", help="default: figures")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), metavar="N", help="default: all processors")
    parser.add_argument("--measure", action="store_true", help="make no runs: measure those that are there")
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
