"""Block of a deck with the law of its contacts, to which all effects contribute."""

from dataclasses import replace
from itertools import combinations_with_replacement

from granular_lmp.crystal.contacts import FACTORS, equivalent
from granular_lmp.effects.effect import LawPart
from granular_lmp.effects.openings import at_rest_lines
from granular_lmp.effects.selection import EFFECTS
from granular_lmp.lammps.contact import model, pairs
from granular_lmp.lammps.ends import walls
from granular_lmp.problem import Problem


def contacts(problem: Problem) -> list[str]:
    """Return the block of the contacts between spheres and with walls."""
    return [*_contacts(problem, "${friction}", "damping, nu and half the work of adhesion"), *at_rest_lines(problem)]


def contacts_of_meeting(problem: Problem) -> list[str]:
    """Return the block of the contacts of spheres that meet; their friction is a number."""
    return _contacts(problem, problem.scene.effects.friction, "damping and nu")


def _contacts(problem: Problem, friction: float | str, words: str) -> list[str]:
    law: LawPart = {"friction": friction}
    for effect in EFFECTS:
        law |= effect.law(problem.scene, problem.on[effect.name])
    laws = {
        (m, n): of_pair(problem, m, n, law)
        for m, n in combinations_with_replacement(range(len(problem.rest.materials)), 2)
    }
    return [
        f"# --- contacts: normal law with E, {words}; tangential law with friction",
        pairs(laws),
        *walls(problem, law),
    ]


def of_pair(problem: Problem, one: int, other: int, law: LawPart) -> str:
    """Return the model of the contacts of two materials, multiplied by the factors of other stiffnesses."""
    sphere, factors = (
        equivalent(problem.rest.materials[one], problem.rest.materials[other]),
        problem.rest.atoms.info.get(FACTORS),
    )
    if factors is None:
        return model(sphere, problem.units, **law)
    normal, shear = (float(each * own) for each, own in zip(factors[one, other], sphere.factors, strict=True))
    return model(replace(sphere, factors=(normal, shear)), problem.units, **law)
