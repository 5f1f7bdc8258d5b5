"""The examples in the docstrings of what the reference page of Python lists."""

import doctest
import inspect
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import granular_lmp
from granular_analysis import second_harmonic

ROOT = Path(__file__).parents[2]
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | doctest.IGNORE_EXCEPTION_DETAIL


def listed(page: str) -> dict[str, Any]:
    """Return the functions and classes of a page by name; those of a module are its members, or its errors."""
    found = {}
    for path, members in re.findall(
        r"^::: (\S+)$(?:\n    options:\n(?:      \w+: true\n)?      members: \[([^\]]*)\])?", page, re.MULTILINE
    ):
        module, _, name = path.rpartition(".")
        try:
            whole = import_module(path)
        except ModuleNotFoundError:
            found[name] = getattr(import_module(module), name)
        else:
            found |= {each: getattr(whole, each) for each in re.findall(r"\w+", members)}
    return found


PAGES = sorted((ROOT / "docs/reference").glob("python*.md"))
LISTED = listed("\n".join(page.read_text("utf-8") for page in PAGES))


def failures(name: str, thing: Any) -> str:
    """Return what doctest says of the examples of a function or a class; its module's names are there, and ours."""
    said: list[str] = []
    names = {each: getattr(granular_lmp, each) for each in granular_lmp.__all__} | LISTED
    names |= {each: getattr(second_harmonic, each) for each in ("mode", "ratios", "nonlinearity")}
    examples = doctest.DocTestParser().get_doctest(
        inspect.getdoc(thing) or "", names | {"np": np, "Path": Path}, name, None, 0
    )
    assert examples.examples, f"{name} has no example"
    doctest.DocTestRunner(optionflags=FLAGS).run(examples, out=said.append)
    return "".join(said)


@pytest.mark.parametrize("name", LISTED)
def test_an_example_of_the_reference_is_right(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert failures(name, LISTED[name]) == ""


def test_a_wrong_example_is_found() -> None:
    def wrong() -> None:
        """
        >>> round(ratios(0.17).kappa, 4)
        0.9
        """

    assert "Got:\n    0.9071" in failures("wrong", wrong)
    with pytest.raises(AssertionError, match="none has no example"):
        failures("none", lambda: None)
