"""Remarks on a scene: a sentence for each value that is used otherwise than it was declared.

Each function returns the remarks on one subject, an empty list if it is used as declared.
"""

from math import hypot, pi

from granular_lmp.crystal.lattices import Shape
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.scene.schema import AUTO
from granular_lmp.scene.sections import Packing, Time, Wave
from granular_lmp.scene.shape import EXACT

FAR = 0.1  # relative change of the wave vector by snapping, beyond which the remark warns that it is another wave


def on_frequency(wave: Wave, wavenumbers: tuple[float, ...]) -> list[str]:
    """Return what became of a frequency in hertz: the first of the wave numbers that have it, rad per row."""
    others = ", ".join(f"{xi:.6g}" for xi in wavenumbers[1:])
    taken = f"; the smallest is taken, {others} has it too" if others else ""
    return [f"wave.frequency {wave.frequency!r} Hz is that of wave.wavenumber {wave.wavenumber!r}{taken}"]


def on_packing(packing: Packing, shape: Shape) -> list[str]:
    """Return what became of every "auto" of the packing, and of a single column."""
    if packing.columns != shape.columns and packing.columns != AUTO:
        return [f"packing.columns {packing.columns} is read as {shape.columns}, the fewest that LAMMPS simulates right"]
    declared = AUTO not in (packing.rows, packing.columns, packing.ends)
    return [] if declared else [f"the packing is {shape.words}, {shape.ends} ends"]


def on_vector(wave: Wave, shape: Shape, used: WaveVector) -> list[str]:
    """Return how a wave vector was snapped to fit a periodic cell."""
    declared, rows, columns = wave.vector(shape.lattice), shape.rows, shape.columns
    moved = used.per_column - declared.per_column, used.per_row - declared.per_row
    if max(map(abs, moved)) <= EXACT:
        return []
    in_rows = round(used.per_row * rows / (2 * pi))
    in_columns = round(used.per_column * columns / (2 * pi))
    if declared.axis == "y":
        snapped = (
            f"wave.wavenumber {wave.wavenumber!r} is snapped to {used.wavenumber!r} = "
            f"2 pi {abs(in_rows)}/{rows}, which fits the periodic cell"
        )
    else:
        snapped = (
            f"wave.wavenumber {wave.wavenumber!r} at {wave.degrees!r} degrees is snapped to "
            f"{used.wavenumber!r} at {used.direction!r}, which fits the periodic cell: its phase advances by "
            f"2 pi {in_columns}/{columns} per column and 2 pi {in_rows}/{rows} per row"
        )
    (x, y), (declared_x, declared_y) = used.components, declared.components
    share = hypot(x - declared_x, y - declared_y) / hypot(declared_x, declared_y)
    return [snapped + (f"; that is {share:.0%} away: take more rows or columns" if share > FAR else "")]


def on_step(time: Time) -> list[str]:
    """Return how a time step was rounded down to fit a sample."""
    if time.tolerance is not None or time.step >= time.timestep * (1 - 1e-9):
        return []
    return [f"time.timestep {time.timestep!r} is rounded down to {time.step!r}, {time.steps_per_sample} to a sample"]
