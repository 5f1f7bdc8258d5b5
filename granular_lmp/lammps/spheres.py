"""The spheres of a deck at rest: the data file, and the block that reads it or makes a large sheet of it."""

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects import selection
from granular_lmp.lammps import replicated, start
from granular_lmp.lammps.datafile import DataFile
from granular_lmp.problem import Problem


def data_of(problem: Problem) -> DataFile:
    """Return all spheres of a problem with the fields in which they begin."""
    scene, packing, units = problem.scene, problem.crystal, problem.units
    to_deck = units.number(scene.sphere.radius, length=1)
    low = packing.get_celldisp().ravel() * to_deck
    size = packing.cell.lengths() * to_deck
    densities = packing.arrays.get("density", np.full(len(packing), scene.sphere.density))
    return DataFile(
        box=np.column_stack([low, low + size]),
        kind=types(packing),
        position=packing.positions * to_deck,
        diameter=2 * packing.arrays["radius"] * to_deck,
        density=units.number(densities, mass=1, length=-3),
        wave=start.columns(problem),
        directed=problem.on["tracking"],
    )


def types(packing: ase.Atoms) -> NDArray[np.int64]:
    """Return the LAMMPS types of spheres: 2m + 1 for the free ones of material m, 2m + 2 for those that are held."""
    material = packing.arrays.get("material", np.zeros(len(packing), dtype=int))
    return 2 * material + np.where(packing.arrays["fixed"], 2, 1)


def spheres(problem: Problem) -> list[str]:
    """Return the lines that read the spheres at rest, or make a large sheet of its first rows."""
    if not replicated.suits(problem.scene):
        return read(problem)
    return _lattice(problem, "the variables wave_* are", replicated.lines(problem))


def read(problem: Problem) -> list[str]:
    """Return the lines that read the spheres at rest and their wave."""
    lines = [start.field(problem), "read_data    ${data} fix wave NULL wave"]
    return _lattice(problem, "the section wave of the data file holds", lines)


def _lattice(problem: Problem, wave_is: str, lines: list[str]) -> list[str]:
    return [
        f"# --- lattice at rest; {wave_is} the wave for unit amplitude",
        f"units        {problem.units.style}",
        "dimension    2",
        f"boundary     {boundary(problem)}",
        f"atom_style   {'hybrid sphere dipole' if problem.on['tracking'] else 'sphere'}",
        "atom_modify  map array sort 1 0.0",
        "comm_modify  vel yes",
        *lines,
        *selection.lines("spheres", problem),
        f"group        mobile type {' '.join(str(2 * m + 1) for m in range(len(problem.materials)))}",
        _neighbor(problem),
    ]


def restarted(problem: Problem, checkpoint: str) -> list[str]:
    """Return the lines that read the spheres of a checkpoint, which holds no ``comm_modify``."""
    return ["atom_modify  sort 1 0.0", "comm_modify  vel yes", f"read_restart {checkpoint}", _neighbor(problem)]


def _neighbor(problem: Problem) -> str:
    return f"neighbor     {problem.units.number(problem.scene.sphere.radius / 10, length=1)!r} bin"


def boundary(problem: Problem) -> str:
    """Return the words for the faces of the box: the box follows spheres at a free face, which may fly."""
    shape = problem.scene.shape
    faces = (shape.along_x, "sides" in shape.free), (shape.along_y, {"first", "last"} & {*shape.free})
    return " ".join("p" if periodic else "m" if free else "f" for periodic, free in faces) + " p"
