"""Write what the reference takes of the sources: all keys of a scene, all help, all cases.

``make reference`` runs it. The files are there for readers without the site, too.
"""

import csv
import os
from collections.abc import Iterable, Sequence
from io import StringIO
from pathlib import Path

from cases.run import table
from granular_analysis import cli
from granular_lmp.cli.parser import help_texts
from granular_lmp.scene.declaration import Declaration
from granular_lmp.scene.json_schema import Key, keys
from granular_lmp.scene.schema import toml
from granular_lmp.scene.without_wave import HELD, NOT_HELD, WAVE

DOCS = Path(__file__).parent
ABSENT = "no such key"


def scene_keys() -> str:
    """Return all keys of a scene file as CSV, a row each."""
    beside, held, not_held = ({(key.section, key.name): key for key in keys(kind)} for kind in (WAVE, HELD, NOT_HELD))
    rows = [("section", "key", "unit", "default", "without [wave]", "allowed", "meaning")]
    for section in Declaration.layout.tables:
        title = f"[[{section}]]" if section in Declaration.layout.repeated else f"[{section}]"
        for place, key in (beside | held | not_held).items():
            if place[0] == section:
                default = _default(beside.get(place))
                without = _without(default, _default(held.get(place)), _default(not_held.get(place)))
                rows.append((title, key.name, key.rule.unit, default, without, key.rule.allowed, key.rule.meaning))
    return _csv(rows)


def _without(default: str, held: str, not_held: str) -> str:
    """Return the defaults of a scene without a wave, whose spheres are held at rest under load or not, in words."""
    held, not_held = ("the same" if each == default else each for each in (held, not_held))
    if held == not_held:
        return held
    return f"{held}, only under load" if not_held == ABSENT else f"{held} under load, else {not_held}"


def _default(key: Key | None) -> str:
    """Return the default of a key in words."""
    if key is None:
        return ABSENT
    if key.required:
        return "must be given"
    return "none" if key.default in (None, (), "") else toml(key.default)


def cases() -> str:
    """Return all cases as CSV, a row each."""
    return _csv(table())


def _csv(rows: Iterable[Sequence[str]]) -> str:
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def commands() -> str:
    """Return the help of all commands, as a terminal of 80 columns shows it."""
    os.environ["COLUMNS"] = "80"
    return "\n\n\n".join((help_texts() | cli.help_texts()).values()) + "\n"


FILES = {"scene.csv": scene_keys, "cases.csv": cases, "commands.txt": commands}

if __name__ == "__main__":
    for name, made in FILES.items():
        (DOCS / name).write_text(made(), encoding="utf-8")
