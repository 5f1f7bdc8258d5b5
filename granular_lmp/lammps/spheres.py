"""Spheres of a deck at rest: the data file, and the block that reads it or makes a large sheet from it."""

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects import selection
from granular_lmp.effects.freedoms import style
from granular_lmp.lammps import bins, replicated, start
from granular_lmp.lammps.datafile import DataFile
from granular_lmp.lammps.ends import boundary, box_of
from granular_lmp.problem import Problem

_NEIGHBOURS_THAT_FLY = ["neighbor     0.2 bin", start.STEP]  # flying spheres are faster than vibrating spheres


def data_of(problem: Problem) -> DataFile:
    """Return all spheres of a problem with their initial fields."""
    packing, to_deck = problem.rest.atoms, problem.units.number(problem.scene.sphere.radius, length=1)
    return DataFile(
        box=box_of(problem),
        kind=types(packing),
        types=2 * len(problem.rest.materials),
        position=packing.positions * to_deck,
        diameter=2 * packing.arrays["radius"] * to_deck,
        density=_densities(problem),
        wave=start.columns(problem),
        style=style(problem),
        state=start.state(problem),
    )


def _densities(problem: Problem) -> NDArray[np.float64]:
    density = problem.rest.density
    return density if problem.units.own else problem.units.number(density, mass=1, length=-3)


def types(packing: ase.Atoms) -> NDArray[np.int64]:
    """Return the LAMMPS types of spheres of material m: 2m + 1 if free, 2m + 2 if held."""
    material = packing.arrays.get("material", np.zeros(len(packing), dtype=int))
    return 2 * material + np.where(packing.arrays["fixed"], 2, 1)


def spheres(problem: Problem) -> list[str]:
    """Return the lines that read the spheres at rest and their initial fields, or make a large sheet from rows."""
    made = replicated.suits(problem)
    wave_is = "the variables wave_* are" if made else "the section wave of the data file holds"
    title = "lattice" + f" at rest; {wave_is} the wave for unit amplitude" if problem.scene.wave else "crystal at rest"
    lines = replicated.lines(problem) if made else start.read(problem)
    return _lattice(problem, [f"# --- {title}"], lines, *_bins(problem))


def spheres_of_meeting(problem: Problem) -> list[str]:
    """Return the lines that read spheres that meet, in the units of their impact."""
    scale, sphere = problem.scene.scale, problem.scene.sphere
    titles = [
        f"# --- units: the radius R = {sphere.radius!r} m, the mass m = {scale.mass!r} kg and t0 = {scale.time!r} s",
        f"#     v = {scale.velocity!r} m/s and l = {scale.length!r} m are the units of velocities and overlaps below",
    ]
    flies = "  # m: the box follows spheres that fly away"
    return _lattice(problem, titles, start.read(problem), "", _NEIGHBOURS_THAT_FLY, flies)


def _lattice(
    problem: Problem, titles: list[str], lines: list[str], sort: str, neighbours: list[str], flies: str = ""
) -> list[str]:
    return [
        *titles,
        f"units        {problem.units.style}",
        f"dimension    {problem.scene.space}",
        f"boundary     {boundary(problem)}{flies}",
        f"atom_style   {style(problem)}",
        f"atom_modify  map array{sort}",
        "comm_modify  vel yes",
        *lines,
        *selection.lines("spheres", problem),
        f"group        mobile type {' '.join(str(2 * m + 1) for m in range(len(problem.rest.materials)))}",
        *neighbours,
    ]


def restarted(problem: Problem, checkpoint: str) -> list[str]:
    """Return the lines that read the spheres of a checkpoint, which holds no ``comm_modify``."""
    sort, neighbours = _bins(problem)
    sorted_ = [f"atom_modify {sort}"] if sort else []
    return [*sorted_, *_read_again(checkpoint), *neighbours]


def restarted_of_meeting(problem: Problem, checkpoint: str) -> list[str]:
    """Return the same lines for spheres that meet."""
    return [*_read_again(checkpoint), *_NEIGHBOURS_THAT_FLY]


def _read_again(checkpoint: str) -> list[str]:
    return ["comm_modify  vel yes", f"read_restart {checkpoint}"]


def _bins(problem: Problem) -> tuple[str, list[str]]:
    """Return the words that sort spheres, and the lines of neighbour lists."""
    size = bins.size(problem)
    skin = problem.units.number(problem.scene.sphere.radius / bins.SKIN, length=1)
    clear = f"neigh_modify binsize {size!r}  # no sphere rests on the face of a bin"
    return f" sort 1 {size!r}", [f"neighbor     {skin!r} bin", *([clear] if size else [])]
