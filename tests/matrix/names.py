"""The names that users import: a golden list, from which a name goes only if the changelog says so.

They are those of `granular_lmp`, with the attributes of its classes, all that docs/reference/python.md documents, and
the modules of `analysis` that the pages name or once named, with their functions and classes; of cases, which are
commands, only the modules.
"""

import re
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import granular_lmp

ROOT = Path(__file__).parents[2]
NAMES = Path(__file__).with_name("names.txt")
CHANGELOG = ROOT / "CHANGELOG.md"
PAGES = (
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "analysis/cases").glob("*/README.md")),
)


def public_names() -> set[str]:
    """Return all public names, dotted."""
    names = {f"granular_lmp.{name}" for name in granular_lmp.__all__}
    for name in granular_lmp.__all__:
        names |= set(_attributes(f"granular_lmp.{name}", getattr(granular_lmp, name)))
    for name in _documented():
        names |= {name, *_attributes(name, at(name))}
    for name in _modules_of_analysis():
        names.add(name)
        if name.startswith("granular_analysis.cases"):
            continue
        module = import_module(name)
        own = (key for key, value in vars(module).items() if getattr(value, "__module__", "") == name)
        names |= {f"{name}.{key}" for key in own if not key.startswith("_")}
    return names


def at(dotted: str) -> Any:
    """Return what a dotted name means: a module, or what is in it."""
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        if _is_module(".".join(parts[:count])):
            found: Any = import_module(".".join(parts[:count]))
            for part in parts[count:]:
                found = getattr(found, part)
            return found
    raise AttributeError(f"no such module: {dotted}")


def listed() -> set[str]:
    """Return the names of the golden list."""
    return set(NAMES.read_text("utf-8").split())


def gone(held: set[str], now: set[str], changelog: str) -> set[str]:
    """Return the names that are held and no more there, without those that the topmost release of a changelog says."""
    newest = re.split(r"^## ", changelog, flags=re.MULTILINE)[1]
    said = set(re.findall(r"`([\w.]+)`", newest))
    return {name for name in held - now if not said & {name, name.rpartition(".")[2]}}


def _attributes(name: str, value: Any) -> Iterator[str]:
    if isinstance(value, type):
        there = {*dir(value), *getattr(value, "__dataclass_fields__", ())}
        yield from (f"{name}.{each}" for each in there if not each.startswith("_"))


def _documented() -> set[str]:
    text = (ROOT / "docs/reference/python.md").read_text("utf-8")
    return set(re.findall(r"^::: ([\w.]+)$", text, re.MULTILINE))


def _modules_of_analysis() -> set[str]:
    dotted = re.compile(r"\bgranular_analysis(?:\.\w+)+")
    said = {name for page in (*PAGES, NAMES) for name in dotted.findall(page.read_text("utf-8"))}
    parents = {".".join(name.split(".")[:count]) for name in said for count in (2, 3)}
    return {name for name in parents if _is_module(name)}


def _is_module(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # what stands before the last dot is no package
        return False
