"""The tutorials as executed notebooks: ``make notebook`` writes ``docs/tutorial.ipynb`` from ``docs/tutorial.md``.

A page is the only source of its notebook. A block with a title becomes a cell that writes the file; the commands of a
console block become one cell of bash, and each picture that they leave a cell that shows it; Python stays Python. What
the page shows of the answers is left out: the notebook has the answers themselves.

The extra ``docs`` executes it; `cells` needs nothing.
"""

import json
import os
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parents[1]
PAGES = ("tutorial", "tutorial-fit", "tutorial-doubling")  # of docs/
BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?[ \t]*\n(.*?)^```[ \t]*\n", re.MULTILINE | re.DOTALL)
PICTURE = re.compile(r"(?:-o|--plot) (\S+\.(?:png|gif))")
SECONDS = 300  # that one cell may take
Cell = dict[str, Any]


def cells(page: str) -> list[Cell]:
    """Return the cells that a page makes, code without its outputs; the same page makes the same cells."""
    made: list[Cell] = []

    def add(kind: str, source: str) -> None:
        if source.strip():
            code = {"execution_count": None, "outputs": []} if kind == "code" else {}
            made.append({"cell_type": kind, "id": f"cell-{len(made)}", "metadata": {}, "source": source.strip()} | code)

    end = 0
    for block in BLOCK.finditer(page):
        add("markdown", page[end : block.start()])
        end = block.end()
        language, title, text = block.groups()
        if title:
            add("code", f"%%writefile {title}\n{text}")
        elif language == "console":
            commands = "\n".join(line[2:] for line in text.splitlines() if line.startswith("$ "))
            add("code", f"%%bash -e\n{commands}")
            for picture in PICTURE.findall(commands):
                add("code", f'from IPython.display import Image\n\nImage("{picture}")')
        elif language == "python":
            add("code", text)
        elif language != "text":
            raise ValueError(f"a block of {language}: allowed are console, python, text, and files with a title")
    add("markdown", page[end:])
    return made


def notebook(made: list[Cell]) -> dict[str, Any]:
    """Return a notebook of cells, without anything of the machine."""
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    about = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": made, "metadata": about, "nbformat": 4, "nbformat_minor": 5}


def executed(made: list[Cell]) -> dict[str, Any]:
    """Return the notebook with the outputs of its cells, executed in an empty folder.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        If a cell fails.
    """
    import nbformat
    from nbclient import NotebookClient

    programs = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    environment = os.environ | {"PATH": programs, "PYTHONPATH": path}
    with TemporaryDirectory() as folder:
        done = nbformat.from_dict(notebook(made))
        resources = {"metadata": {"path": folder}}
        client = NotebookClient(done, timeout=SECONDS, resources=resources, coalesce_streams=True)
        client.execute(env=environment)
    for cell in done.cells:
        cell.metadata.clear()  # the time of execution
    return dict(notebook(done.cells))


if __name__ == "__main__":
    for name in sys.argv[1:] or PAGES:
        source = ROOT / "docs" / f"{name}.md"
        answer = executed(cells(source.read_text("utf-8")))
        text = json.dumps(answer, indent=1, ensure_ascii=False) + "\n"
        source.with_suffix(".ipynb").write_text(text, encoding="utf-8")
