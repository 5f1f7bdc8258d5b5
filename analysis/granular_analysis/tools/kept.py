"""Folders of searches that can be stopped: what was asked, and each step of the search as soon as it is known.

The same command again continues the search, as each step follows from those before it.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.plotting import write
from granular_analysis.theory.errors import TheoryError

KEPT = "evaluations.bin"


def begun(
    folder: Path, name: str, asked: Mapping[str, Any], row: np.dtype[Any], made: Sequence[str]
) -> tuple[Path, NDArray[Any]]:
    """Begin a folder, or continue that of the same search; return its file of steps, and the steps that it holds.

    A search that kept no step gives its folder to another.

    Parameters
    ----------
    folder : of the search.
    name, asked : of the file that says what was asked, and its content.
    row : of a step.
    made : other files that the search leaves.

    Raises TheoryError for a folder that holds another search, or files that are none of it.
    """
    path, steps, said = folder / name, folder / KEPT, json.dumps(asked, indent=2) + "\n"
    there = [each for each in (*made, KEPT) if (folder / each).exists()]
    nothing = not there or (there == [KEPT] and not steps.stat().st_size)
    if path.is_file() and not nothing:
        if path.read_text(encoding="utf-8") != said:
            raise TheoryError(f"{folder}: holds another search; give its scene and options again, or another folder")
    elif there and not path.is_file():
        raise TheoryError(f"{folder}: holds {there[0]}, which is of no search; give another folder")
    else:
        write(path, said)
    with steps.open("ab") as stream:  # without the rest of one that was not written to its end
        stream.truncate(stream.tell() // row.itemsize * row.itemsize)
    return steps, np.fromfile(steps, dtype=row)
