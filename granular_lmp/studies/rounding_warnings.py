"""Warnings about points of a sweep that round to the same run, one for each cell or sample.

A periodic cell carries only phase advances of 2πk/rows and 2πj/columns, so close wave numbers and directions run as one
wave. A time step is rounded down so that a whole number fits a sample.
"""

from collections import defaultdict
from collections.abc import Iterable
from math import ceil, pi

import numpy as np

from granular_lmp.crystal.lattices import Shape
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.rest.scene import Scene

LARGEST_CELL = 100_000  # rows or columns; a larger cell is not suggested


def remarks(scenes: Iterable[Scene]) -> list[str]:
    """Return a sentence for each cell in which several waves of a sweep become one, and for equal time steps."""
    cells: dict[Shape, set[WaveVector]] = defaultdict(set)
    steps: dict[float, set[float]] = defaultdict(set)
    for scene in scenes:
        if scene.form.waves and scene.shape.ends == "periodic":
            cells[scene.shape].add(scene.declared_vector)
        steps[scene.time.sample].update(scene.time.clock.declared)
    found = [_of_waves(shape, waves) for shape, waves in cells.items()]
    return [sentence for sentence in [*found, *(_of_steps(*each) for each in steps.items())] if sentence]


def _of_waves(shape: Shape, waves: set[WaveVector]) -> str:
    """Return a warning if waves coincide in a cell, with a cell that separates them; "" if they do not."""
    ran = {each.snapped(shape.rows, shape.columns) for each in waves}
    if len(ran) == len(waves):
        return ""
    along_y = all(each.axis == "y" for each in waves)

    def words(rows: int, columns: int) -> str:
        return f"{rows} rows" if along_y else f"{rows} rows and {columns} columns"

    of = f"{len(waves)} values, {len(ran)} wave{'s' * (len(ran) > 1)} in a periodic cell of "
    of += f"{words(shape.rows, shape.columns)}; "
    if cell := _larger(shape, waves, along_y=along_y):
        setting = f"packing.rows = {cell[0]}" + ("" if along_y else f", packing.columns = {cell[1]}")
        return f"{of}a cell of {words(*cell)} separates them ({setting})"
    instead = ', but packing.ends = "fixed" does' if along_y else "; use waves that are farther apart"
    return f"{of}no cell of up to {LARGEST_CELL} rows separates them{instead}"


def _larger(shape: Shape, waves: set[WaveVector], *, along_y: bool) -> tuple[int, int] | None:
    """Return rows and columns of a cell that shifts each wave by less than half of their smallest distance.

    For waves along y it is the cell with the fewest rows, otherwise a multiple of the present cell.
    """
    from scipy.spatial import cKDTree  # slow to import, and only needed for waves that coincide

    advances = np.array([(each.per_row, each.per_column) for each in waves])
    nearest = cKDTree(advances).query(advances, k=2, p=np.inf)[0][:, 1].min()
    step, rows, columns = shape.lattice.row_period, shape.rows, shape.columns
    longer = ((each, columns) for each in range(rows, LARGEST_CELL + 1, step))
    larger = ((times * rows, times * columns) for times in range(2, LARGEST_CELL // max(rows, columns) + 1))
    for cell in longer if along_y else larger:
        held = 2 * pi / np.array(cell)
        if np.abs(advances - held * np.rint(advances / held)).max() < nearest / 2:
            return cell
    return None


def _of_steps(sample: float, declared: set[float]) -> str:
    """Return a warning if time steps coincide in a sample, with a sample that separates them; "" if they do not."""

    def different(of: float) -> int:
        return len({ceil(of / step - 1e-9) for step in declared})

    if different(sample) == len(declared):
        return ""
    enough = next((times for times in range(2, 10_000) if different(times * sample) == len(declared)), None)
    return f"{len(declared)} time steps, {different(sample)} in a whole number to a sample of {sample!r}; " + (
        f"time.sample = {enough * sample!r} separates them" if enough else "use steps farther apart"
    )
