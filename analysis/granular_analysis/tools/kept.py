"""Folder of a search that can be stopped: its options, and each step as soon as it is known.

The same command continues the search, because each step follows from the steps before it.
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
    """Begin a folder, or continue the folder of the same search; return the file of its steps, and the steps in it.

    A folder without a step may be taken by another search.

    Parameters
    ----------
    folder : folder of the search.
    name, asked : name of the file of options, and the options.
    row : data type of a step.
    made : names of other files that the search writes.

    Raises TheoryError for a folder with another search, or with files of that name but without a search.
    """
    path, steps, said = folder / name, folder / KEPT, json.dumps(asked, indent=2) + "\n"
    there = [each for each in (*made, KEPT) if (folder / each).exists()]
    nothing = not there or (there == [KEPT] and not steps.stat().st_size)
    if path.is_file() and not nothing:
        if path.read_text(encoding="utf-8") != said:
            raise TheoryError(f"{folder}: holds another search; give its scene and options again, or another folder")
    elif there and not path.is_file():
        raise TheoryError(f"{folder}: holds {there[0]} without a search; give another folder")
    else:
        write(path, said)
    with steps.open("ab") as stream:  # cuts off a step that was not written completely
        stream.truncate(stream.tell() // row.itemsize * row.itemsize)
    return steps, np.fromfile(steps, dtype=row)
