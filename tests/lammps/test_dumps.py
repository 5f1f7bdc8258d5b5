"""Dumps of many snapshots, which are read at once where they are alike, and one by one where they are not."""

from pathlib import Path

import numpy as np
import pytest

from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.outputs import Snapshot, read_snapshot, read_snapshots

COLUMNS = ["id", "x", "vx"]


def snapshot(step: int, entries: int = 2) -> str:
    """Return the text of a snapshot whose numbers are all its own."""
    rows = "".join(f"{i} {step + i / 7!r} {-step * i / 3!r}\n" for i in range(1, entries + 1))
    box = "ITEM: BOX BOUNDS pp pp pp\n0 1\n0 1\n0 1\n"
    return f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{entries}\n{box}ITEM: ATOMS {' '.join(COLUMNS)}\n{rows}"


def one_by_one(path: Path, *but: str) -> list[Snapshot]:
    found = []
    with path.open(encoding="utf-8") as stream:
        while (each := read_snapshot(stream, but)) is not None:
            found.append(each)
    return found


MANY = [snapshot(step) for step in range(2000)]  # more than are read at once
DUMPS = {
    "alike": (MANY, 2000),
    "one more sphere": ([*MANY[:1500], snapshot(1500, 3), *MANY[1501:]], 2000),
    "no sphere": ([snapshot(step, 0) for step in range(3)], 3),
    "cut in a line": ([*MANY[:1999], MANY[1999][:-4]], 1999),
    "cut after a line": ([*MANY[:1999], MANY[1999].rpartition("2 ")[0]], 1999),
    "cut in its head": ([*MANY[:1999], MANY[1999][:30]], 1999),
    "one": (MANY[:1], 1),
}


@pytest.mark.parametrize("but", [[], ["x"]], ids=str)
@pytest.mark.parametrize("name", DUMPS)
def test_snapshots_are_those_that_are_read_one_by_one(name: str, but: list[str], tmp_path: Path) -> None:
    texts, whole = DUMPS[name]
    path = tmp_path / "dump"
    path.write_text("".join(texts), "utf-8")
    found, expected = list(read_snapshots(path, but)), one_by_one(path, *but)
    assert [step for step, _, _ in found] == [*range(whole)]
    assert [each[:2] for each in found] == [each[:2] for each in expected]
    for (_, _, one), (_, _, other) in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.shape[1] == 3 - len(but)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("\n1 1700", "\n1 5 1700", "7 words at step 1700, expected 2 lines of 3"),
        ("TIMESTEP\n1700\n", "TIMESTEMP\n1700\n", "line 'ITEM: TIMESTEMP', expected"),
        ("\n1 1700", "\n1 x1700", "could not convert string to float: 'x1700"),
    ],
)
def test_what_is_wrong_among_many_snapshots_is_said(old: str, new: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "dump"
    path.write_text("".join(MANY).replace(old, new, 1), "utf-8")
    with pytest.raises(RunFolderError, match=f"not a LAMMPS dump: {said}"):
        list(read_snapshots(path))
