"""The Python of each page runs as a reader would run it."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.conftest import members

ROOT = Path(__file__).parents[2]
PYTHON = re.compile(r"^```python[ \t]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
ALLOWED = 60.0  # s per code block

# What others made is imported once, which takes half a second, and the process is then copied for each page; matplotlib
# by the pages that draw. What its file `said` holds at the end is why a page failed
SESSIONS = """
import json, os, sys, traceback
import numpy, scipy.integrate, scipy.optimize

for folder, blocks in json.load(sys.stdin):
    if os.fork() == 0:
        os.chdir(folder)
        space, failure = {"__name__": "__main__"}, ""
        try:
            for number, block in enumerate(blocks, 1):
                exec(compile(block, f"block {number}", "exec"), space)
        except BaseException:
            failure = traceback.format_exc()
        with open("said", "w", encoding="utf-8") as said:
            said.write(failure)
        os._exit(0)
    os.wait()
"""


def run_blocks(pages: Mapping[str, str], folder: Path) -> dict[str, str]:
    """Run the ```python blocks of each page in an empty folder, one after the other in one session, as a reader would.

    A block that is not to be run (too long, or in need of something) carries another mark than plain ```python.

    Returns
    -------
    dict of str to str
        The traceback of each page, which is empty for one that runs.
    """
    blocks = {name: PYTHON.findall(text) for name, text in pages.items()}
    places = {name: folder / str(number) for number, name in enumerate(pages)}
    for place in places.values():
        place.mkdir()
        (place / "said").write_text("the process was killed", "utf-8")
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    subprocess.run(
        [sys.executable, "-c", SESSIONS],
        input=json.dumps([(str(places[name]), blocks[name]) for name in pages]),
        env=os.environ | {"PYTHONPATH": path},
        timeout=ALLOWED * sum(map(len, blocks.values())),
        stdout=subprocess.DEVNULL,
        text=True,
        check=True,
    )
    return {name: (place / "said").read_text("utf-8") for name, place in places.items()}


PAGES_OF_PYTHON = [
    "README.md",
    "docs/how-to.md",
    "docs/sweeps.md",
    "docs/gallery.md",
    "docs/network.md",
    "docs/gpu.md",
    "docs/imperfect.md",
    "docs/impacts.md",
    "analysis/cases/solitary/README.md",
    "docs/mixing.md",
    "docs/collisions.md",
    "docs/crystals.md",
    "docs/experiments.md",
    "docs/reference/units.md",
]


MORE = ["docs/how-to.md", "docs/sweeps.md", "docs/experiments.md", "docs/impacts.md"]
MORE += ["docs/gallery.md", "docs/gpu.md", "docs/collisions.md", "analysis/cases/solitary/README.md"]
PAGE = "```python\nimport granular_analysis\nx = 1\n```\n\n```console\nfalse\n```\n\n```python\n{}\n```\n"
LINES = {"right": "assert x == 1", "wrong": "assert x == 2", "gone": "import os; os._exit(0)"}


@pytest.fixture(scope="module")
def failures(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Tracebacks of the pages that are asked for in this session, and of three that are no files."""
    asked = [item.callspec.params.get("page") for item in request.session.items if hasattr(item, "callspec")]
    pages = {page: (ROOT / page).read_text("utf-8") for page in PAGES_OF_PYTHON if page in asked}
    pages |= {name: PAGE.format(line) for name, line in LINES.items()}
    return run_blocks(pages, tmp_path_factory.mktemp("pages"))


@pytest.mark.parametrize("page", members(PAGES_OF_PYTHON, *MORE))
def test_the_python_of_a_page_runs(page: str, failures: dict[str, str]) -> None:
    if page == "docs/gpu.md":
        pytest.importorskip("jax")
    assert failures[page] == ""


def test_python_that_fails_or_ends_its_process_is_found(failures: dict[str, str]) -> None:
    assert failures["right"] == ""
    assert 'File "block 2", line 1' in failures["wrong"]
    assert failures["gone"] == "the process was killed"
