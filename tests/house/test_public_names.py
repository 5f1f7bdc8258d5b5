"""Public names stand in the `__all__` of their modules: what pages import and document, and little else."""

import re
from importlib import import_module

import pytest

from tests.house.test_docs import PAGES, on_pages
from tests.house.test_independence import FOLDERS

# A reader learns at most so many names; all others may change without a word
MOST = {"granular_lmp": 65, "granular_analysis": 50}
_IMPORT = re.compile(r"^from (granular_(?:lmp|analysis)[\w.]*) import ([\w, ]+?)(?: +#.*)?$", re.MULTILINE)
_TWO_ON_A_LINE = re.compile(r"^ +\w+ : .*\. \w+ : ", re.MULTILINE)
_DOCUMENTED = re.compile(r"^::: (granular_(?:lmp|analysis)[\w.]*)\.(\w+)$", re.MULTILINE)


def public(package: str) -> dict[str, list[str]]:
    """Return the public names of each module of a package that has any."""
    found = {}
    for path in FOLDERS[package].rglob("*.py"):
        if "\n__all__ = " in path.read_text("utf-8"):
            parts = path.relative_to(FOLDERS[package].parent).with_suffix("").parts
            name = ".".join(parts).removesuffix(".__init__")
            found[name] = list(import_module(name).__all__)
    return found


def not_public(text: str) -> set[str]:
    """Return the names that a page imports or documents and that no `__all__` holds."""
    asked = {(module, name) for module, names in _IMPORT.findall(text) for name in re.split(", *", names)}
    asked |= set(_DOCUMENTED.findall(text))
    return {f"{module}.{name}" for module, name in asked if not _is_public(module, name)}


def _is_public(module: str, name: str) -> bool:
    try:
        return f"{module}.{name}" in MODULES or name in getattr(import_module(module), "__all__", ())
    except ModuleNotFoundError:  # a method: what stands before its name is a class
        return False


MODULES = {"granular_lmp.errors", "granular_analysis.second_harmonic"}  # documented whole


@pytest.mark.parametrize("package", FOLDERS)
def test_public_names_are_there_few_and_documented(package: str) -> None:
    held = public(package)
    things = {(module, name): getattr(import_module(module), name) for module, names in held.items() for name in names}
    assert not [where for where, thing in things.items() if callable(thing) and not thing.__doc__]
    assert len({name for _, name in things}) <= MOST[package]


@pytest.mark.parametrize("package", FOLDERS)
def test_lists_of_parameters_have_a_line_for_each(package: str) -> None:
    assert not [str(path) for path in FOLDERS[package].rglob("*.py") if _TWO_ON_A_LINE.search(path.read_text("utf-8"))]
    assert _TWO_ON_A_LINE.search("    rows : of the crystal. columns : of the crystal")


def test_what_pages_import_and_document_is_public() -> None:
    assert on_pages(not_public) == {}


def test_a_name_that_is_not_public_is_found() -> None:
    page = (
        "from granular_lmp import Scene, gone\nfrom granular_analysis.theory.wave import no\n::: granular_lmp.nil.f\n"
    )
    assert not_public(page) == {"granular_lmp.gone", "granular_analysis.theory.wave.no", "granular_lmp.nil.f"}
    assert len(PAGES) > 50
