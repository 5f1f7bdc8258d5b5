"""The spheres of a deck at rest: the data file, and the block that reads it or makes a large sheet of it."""

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects import selection
from granular_lmp.effects.freedoms import style
from granular_lmp.lammps import bins, replicated, start
from granular_lmp.lammps.datafile import DataFile
from granular_lmp.lammps.ends import boundary, box_of
from granular_lmp.problem import Problem


def data_of(problem: Problem) -> DataFile:
    """Return all spheres of a problem with the fields in which they begin."""
    packing, to_deck = problem.crystal, problem.units.number(problem.scene.sphere.radius, length=1)
    return DataFile(
        box=box_of(problem),
        kind=types(packing),
        types=2 * len(problem.materials),
        position=packing.positions * to_deck,
        diameter=2 * packing.arrays["radius"] * to_deck,
        density=_densities(problem),
        wave=start.columns(problem),
        style=style(problem),
        state=start.state(problem),
    )


def _densities(problem: Problem) -> NDArray[np.float64]:
    if problem.scene.loose:
        return np.asarray(problem.collisions.mass / (4 / 3 * np.pi * problem.crystal.arrays["radius"] ** 3))
    densities = problem.crystal.arrays.get("density", np.full(len(problem.crystal), problem.scene.sphere.density))
    return problem.units.number(densities, mass=1, length=-3)


def types(packing: ase.Atoms) -> NDArray[np.int64]:
    """Return the LAMMPS types of spheres: 2m + 1 for the free ones of material m, 2m + 2 for those that are held."""
    material = packing.arrays.get("material", np.zeros(len(packing), dtype=int))
    return 2 * material + np.where(packing.arrays["fixed"], 2, 1)


def spheres(problem: Problem) -> list[str]:
    """Return the lines that read the spheres at rest and how they begin, or make a large sheet of its first rows."""
    if replicated.suits(problem.scene):
        return _lattice(problem, "the variables wave_* are", replicated.lines(problem))
    return _lattice(problem, "the section wave of the data file holds", start.read(problem))


def _lattice(problem: Problem, wave_is: str, lines: list[str]) -> list[str]:
    flies = "  # m: the box follows spheres that fly away" if problem.scene.loose else ""
    sort, neighbours = _bins(problem)
    return [
        *_titles(problem, wave_is),
        f"units        {problem.units.style}",
        f"dimension    {problem.scene.space}",
        f"boundary     {boundary(problem)}{flies}",
        f"atom_style   {style(problem)}",
        f"atom_modify  map array{sort}",
        "comm_modify  vel yes",
        *lines,
        *selection.lines("spheres", problem),
        f"group        mobile type {' '.join(str(2 * m + 1) for m in range(len(problem.materials)))}",
        *neighbours,
    ]


def _titles(problem: Problem, wave_is: str) -> list[str]:
    scale, sphere = problem.scale, problem.scene.sphere
    if problem.scene.wave is None and not problem.scene.loose:
        return ["# --- crystal at rest"]
    if not problem.scene.loose:
        return [f"# --- lattice at rest; {wave_is} the wave for unit amplitude"]
    return [
        f"# --- units: the radius R = {sphere.radius!r} m, the mass m = {scale.mass!r} kg and t0 = {scale.time!r} s",
        f"#     v = {scale.velocity!r} m/s and l = {scale.length!r} m are the units of velocities and overlaps below",
    ]


def restarted(problem: Problem, checkpoint: str) -> list[str]:
    """Return the lines that read the spheres of a checkpoint, which holds no ``comm_modify``."""
    sort, neighbours = _bins(problem)
    sorted_ = [f"atom_modify {sort}"] if sort else []
    return [*sorted_, "comm_modify  vel yes", f"read_restart {checkpoint}", *neighbours]


def _bins(problem: Problem) -> tuple[str, list[str]]:
    """Return how spheres are sorted, and the lines of neighbour lists; spheres that fly outrun those that vibrate."""
    if problem.scene.loose:
        return "", ["neighbor     0.2 bin", start.STEP]
    size = bins.size(problem)
    skin = problem.units.number(problem.scene.sphere.radius / bins.SKIN, length=1)
    clear = f"neigh_modify binsize {size!r}  # no sphere rests on the face of a bin"
    return f" sort 1 {size!r}", [f"neighbor     {skin!r} bin", *([clear] if size else [])]
