"""The declaration of a case: its commands in ``case.toml``, and in ``expected.json`` the numbers that it must print."""

import itertools
import json
import re
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from string import Template
from typing import Any

CASES = Path(__file__).parent
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|nan|inf)(?![\w.])")


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
        """Return the module that measures and draws."""
        return import_module(f"granular_analysis.cases.{self.name}.case")

    def expected(self) -> list[Number]:
        """Return the numbers that the script must print."""
        file = CASES / self.name / "expected.json"
        return [Number(**each) for each in json.loads(file.read_text("utf-8"))] if file.is_file() else []


def names() -> list[str]:
    """Return the names of all cases."""
    return sorted(file.parent.name for file in CASES.glob("*/case.toml"))
