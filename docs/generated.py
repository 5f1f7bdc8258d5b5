"""Write what the reference takes of the sources: docs/scene.csv, all keys, and docs/commands.txt, all help.

``make reference`` runs it. The files are there for readers without the site, too.
"""

import csv
import os
from io import StringIO
from pathlib import Path

from granular_analysis import cli
from granular_lmp.cli.parser import help_texts
from granular_lmp.scene.declaration import Declaration
from granular_lmp.scene.json_schema import Key, keys
from granular_lmp.scene.schema import toml
from granular_lmp.scene.without_wave import HELD, NOT_HELD, WAVE

KEYS = Path(__file__).with_name("scene.csv")
COMMANDS = Path(__file__).with_name("commands.txt")
ABSENT = "no such key"
HEAD = ("section", "key", "unit", "default", "without [wave]", "allowed", "meaning")


def scene_keys() -> str:
    """Return all keys of a scene file as CSV, a row each."""
    beside, held, not_held = ({(key.section, key.name): key for key in keys(kind)} for kind in (WAVE, HELD, NOT_HELD))
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEAD)
    for section in Declaration.layout.tables:
        for place, key in (beside | held | not_held).items():
            if place[0] == section:
                default = _default(beside.get(place))
                without = _without(default, _default(held.get(place)), _default(not_held.get(place)))
                table = f"[[{section}]]" if section in Declaration.layout.repeated else f"[{section}]"
                writer.writerow((table, key.name, key.rule.unit, default, without, key.rule.allowed, key.rule.meaning))
    return text.getvalue()


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


def commands() -> str:
    """Return the help of all commands, as a terminal of 80 columns shows it."""
    os.environ["COLUMNS"] = "80"
    return "\n\n\n".join((help_texts() | cli.help_texts()).values()) + "\n"


if __name__ == "__main__":
    KEYS.write_text(scene_keys(), encoding="utf-8")
    COMMANDS.write_text(commands(), encoding="utf-8")
