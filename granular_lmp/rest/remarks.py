"""Notes on a scene: values that replace declared ones, and a sentence for each.

Each function ``on_…`` returns the notes on one subject, or an empty list if it is used as declared.
"""

from collections.abc import Callable
from math import degrees, hypot, pi
from typing import Any

import numpy as np

from granular_lmp.crystal.disorder import Disorder
from granular_lmp.crystal.lattices import Shape
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.rest.shape import EXACT
from granular_lmp.scene.schema import AUTO
from granular_lmp.scene.sections import Effects, Packing, Sampled, Wave

# Effect of the spread s of diameters over the overlap at rest, as measured (analysis/cases/disorder/README.md):
# remaining share of the mean second harmonic of TR at the resonance of a hexagonal sheet until tau = 100, with a load
# or adhesion; and contacts left per sphere
_SPREADS = (0.0, 0.1, 0.2, 0.4, 0.5, 0.7, 1.0)
_HARMONIC = {False: (1, 0.959, 0.850, 0.538, 0.366, 0.18, 0), True: (1, 0.960, 0.853, 0.547, 0.32, 0, 0)}
_HALF = 0.42  # s at which half of the second harmonic is lost
_PLANE = ((0.4, 0.8, 2, 4, 12, 40), (6, 5.758, 5.015, 4.617, 4.163, 3.971))
_SPACE = ((0.4, 0.8, 2, 12, 40), (12, 11.42, 9.12, 6.65, 5.92))
_CONTACTS = {
    "hexagonal": _PLANE,
    "fcc": _SPACE,
    "hcp": _SPACE,
}  # in a chain or a honeycomb each contact is at rest by itself
FAR = 0.1  # relative change of the wave vector above which the note warns of another wave


def used_vector(declared: WaveVector, used: WaveVector, hertz: Callable[[], float]) -> dict[str, Any]:
    """Return the values of the wave that replaces one that does not fit its periodic cell, by dotted key.

    Empty if the wave runs as declared. `hertz` computes the frequency of the wave in the run.
    """
    if not _moved(declared, used):
        return {}
    found = {"wave.wavenumber": used.wavenumber, "wave.wavevector": list(used.components), "wave.frequency": hertz()}
    if abs(used.direction - declared.direction) > degrees(EXACT):
        found["wave.direction"] = used.direction
    return found


def used_step(time: Sampled) -> dict[str, Any]:
    """Return the time step that replaces one that does not fit a sample, by its dotted key; empty otherwise."""
    used = time.clock.as_run.items()
    return {f"time.{key}": value for key, value in used if value < getattr(time, key) * (1 - 1e-9)}


def _moved(declared: WaveVector, used: WaveVector) -> bool:
    """Return True if a wave vector was snapped to another one."""
    return max(abs(used.per_column - declared.per_column), abs(used.per_row - declared.per_row)) > EXACT


def on_frequency(wave: Wave, wavenumbers: tuple[float, ...]) -> list[str]:
    """Return a note on a declared frequency: the wave number taken, the smallest with this frequency, rad per row."""
    others = ", ".join(f"{xi:.6g}" for xi in wavenumbers[1:])
    taken = f"; the smallest is taken, {others} has this frequency too" if others else ""
    return [f"wave.frequency {wave.frequency!r} Hz is that of wave.wavenumber {wave.wavenumber!r}{taken}"]


def on_packing(packing: Packing, shape: Shape) -> list[str]:
    """Return notes on every "auto" of the packing, and on a single column."""
    if packing.columns != shape.columns and packing.columns != AUTO:
        return [
            f"packing.columns {packing.columns} is read as {shape.columns}, the fewest that LAMMPS simulates correctly"
        ]
    declared = AUTO not in (packing.rows, packing.columns, packing.ends)
    return [] if declared else [f"the packing is {shape.words}, {shape.cut}"]


def on_vector(wave: Wave, shape: Shape, used: WaveVector) -> list[str]:
    """Return a note on a wave vector that was changed to fit a periodic cell."""
    declared, rows, columns = wave.vector(shape.lattice), shape.rows, shape.columns
    if not _moved(declared, used):
        return []
    in_rows = round(used.per_row * rows / (2 * pi))
    in_columns = round(used.per_column * columns / (2 * pi))
    if declared.axis == "y":
        snapped = (
            f"wave.wavenumber {wave.wavenumber!r} is snapped to {used.wavenumber!r} = "
            f"2 pi {abs(in_rows)}/{rows}, which fits the periodic cell"
        )
    else:
        per_column = [f"2 pi {in_columns}/{columns} per column"] if shape.along_x else []
        per_row = [f"2 pi {in_rows}/{rows} per row"] if shape.along_y else []
        snapped = (
            f"wave.wavenumber {wave.wavenumber!r} at {wave.degrees!r} degrees is snapped to "
            f"{used.wavenumber!r} at {used.direction!r}, which fits the periodic cell: its phase advances by "
            + " and ".join(per_column + per_row)
        )
    (x, y), (declared_x, declared_y) = used.components, declared.components
    share = hypot(x - declared_x, y - declared_y) / hypot(declared_x, declared_y)
    return [snapped + (f"; that is {share:.0%} away: use more rows or columns" if share > FAR else "")]


def law_words(material: Sphere, effects: Effects) -> str:
    """Return the adhesion law that Tabor's parameter suggests; "" for spheres that do not adhere."""
    return material.law_words if material.work_of_adhesion > 0 and effects.adhesion is not False else ""


def on_law(material: Sphere, effects: Effects) -> list[str]:
    """Return a note if Tabor's parameter suggests another adhesion law than the one in use."""
    said = law_words(material, effects)
    return [said] if said and material.nearer_law != material.adhesion_law else []


def on_disorder(disorder: Disorder, sphere: Sphere, packing: Packing, wave: Wave | None) -> list[str]:
    """Return a note on unequal spheres: s = σ 2R/Δ0, and the share of the second harmonic that remains.

    Beyond the measured range the last value is used. Contacts without an overlap at rest have no s.
    """
    if not disorder.radius or packing.lattice not in _CONTACTS or not sphere.static_overlap:
        return []
    spread, (spreads, contacts) = disorder.radius / sphere.overlap_ratio, _CONTACTS[packing.lattice]
    parted = 1 - np.interp(np.log(spread), np.log(spreads), contacts) / contacts[0]
    share = f"about {parted:.0%} of the contacts open" if parted > 0.005 else "no contact opens"
    said = f"the diameters spread by s = {spread:.3g} overlaps at rest: {share}"
    if wave is not None:
        left = np.interp(spread, _SPREADS, _HARMONIC[sphere.work_of_adhesion > 0])
        said += f", and about {left:.0%} of the mean second harmonic of a sheet is left (half at s = {_HALF})"
    return [said]


def on_step(time: Sampled) -> list[str]:
    """Return a note on a time step that was rounded down to fit a sample."""
    if not used_step(time):
        return []
    return [f"time.timestep {time.timestep!r} is rounded down to {time.step!r}, {time.steps_per_sample} to a sample"]
