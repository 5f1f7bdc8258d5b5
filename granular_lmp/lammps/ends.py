"""Ends of a deck: the faces of its box, rigid walls, held spheres, and forces on free ends.

Quiet ends are an effect (`granular_lmp.effects.quiet_ends`).
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import FACTORS
from granular_lmp.effects.effect import LawPart
from granular_lmp.lammps.contact import model, of_law, rigid, wall
from granular_lmp.problem import Problem

FREE = 3.0  # radii between the centres of the outer spheres and the faces of the box along z, if z is not periodic


def boundary(problem: Problem) -> str:
    """Return the words for the faces of the box; the box follows spheres at a free face, as they may fly."""
    periodic, follows = problem.rest.atoms.pbc, problem.rest.follows
    depth = "f" if problem.scene.space == 3 and not periodic[2] else "p"
    along = ("p" if periodic["xy".index(axis)] else "m" if axis in follows else "f" for axis in "xy")
    return " ".join([*along, depth])


def box_of(problem: Problem) -> NDArray[np.float64]:
    """Return the faces of the box, (3, 2)."""
    packing, to_deck = problem.rest.atoms, problem.units.number(problem.scene.sphere.radius, length=1)
    low = packing.get_celldisp().ravel() * to_deck
    high = low + packing.cell.lengths() * to_deck
    lowest, highest = problem.rest.outermost
    low[1], high[1] = min(low[1], lowest * to_deck), max(high[1], highest * to_deck)
    if problem.scene.space == 3 and not packing.pbc[2]:
        z = packing.positions[:, 2] * to_deck
        low[2], high[2] = z.min() - FREE * to_deck, z.max() + FREE * to_deck
    return np.column_stack([low, high])


def walls(problem: Problem, law: LawPart) -> list[str]:
    """Return the lines of the rigid walls that spheres of each material touch, by the law of their contacts.

    A wall that spheres touch at rest also records which spheres touch it, and the forces.
    """
    if not problem.rest.planes:
        return []
    to_deck = problem.units.number(problem.scene.material.radius, length=1)
    planes = {name: place * to_deck for name, place in problem.rest.planes.items()}
    seen = problem.rest.contacts.on_wall.any() or any(each.with_contacts for each in problem.scene.monitor)
    groups = [f"group        material{m + 1} type {2 * m + 1} {2 * m + 2}" for m in range(len(problem.rest.materials))]
    return groups + [
        wall(
            _against(problem, name, m - 1, law),
            f"{name[0]}plane {f'{place!r} NULL' if name.endswith('lo') else f'NULL {place!r}'}"
            + " contacts" * bool(seen),
            name=f"{name}{m}",
            group=f"material{m}",
        )
        for name, place in planes.items()
        for m in range(1, len(problem.rest.materials) + 1)
    ]


def _against(problem: Problem, name: str, material: int, law: LawPart) -> str:
    """Return the model of the contact of spheres of a material, by its index, with a wall.

    A wall that spheres only meet has no law at rest; its model is that of spheres with twice the modulus.
    """
    declared, own = problem.scene.wall if name[0] == "z" else problem.scene.rigid, problem.rest.materials[material]
    if declared is None:
        return model(rigid(own), problem.units, **law)
    against = declared.beside(problem.rest.materials)[material]
    law_of_wall, factors = against.law(own.radius), problem.rest.atoms.info.get(FACTORS)
    if factors is not None:
        law_of_wall = law_of_wall.times(*map(float, factors[material, -1]))
    sphere, shear_modulus = of_law(law_of_wall, own.radius, own)
    return model(sphere, problem.units, **law, shear_modulus=shear_modulus)


def freezes(problem: Problem) -> bool:
    """Return whether held spheres are frozen, because the dashpots of a restitution use the masses of both spheres."""
    return problem.scene.effects.restitution < 1 and bool(problem.rest.atoms.arrays["fixed"].any())


def held(problem: Problem) -> list[str]:
    """Return the lines that freeze held spheres; this sets their forces to 0, so recorded forces are stored before."""
    if not freezes(problem):
        return []
    return [
        "# dashpots then use an infinite mass for held spheres; with the real mass the rebound would be too strong",
        "group        held subtract all mobile",
        *(["fix          borne held store/force"] if problem.scene.output.forces else []),
        "fix          held held freeze",
    ]


def loads(problem: Problem) -> list[str]:
    """Return the block of the constant forces on free ends of a compressed chain; [] if there are none."""
    lines = ["# --- constant forces on free ends, which press the chain together"]
    for number, (sphere, force) in enumerate(problem.rest.loads.items(), 1):
        of_deck = problem.units.number(
            force * problem.scene.scale.length, length=1
        )  # a deck of an impact has the units m and t0
        lines += [
            f"group        end{number} id {sphere + 1}",
            f"fix          load{number} end{number} addforce 0.0 {of_deck!r} 0.0",
        ]
    return lines if problem.rest.loads else []
