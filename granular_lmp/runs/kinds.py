"""A scene with a wave and a scene without one, prepared and written by the functions of its class."""

from collections.abc import Mapping
from typing import cast

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp import problem as waves
from granular_lmp.effects.guard import Guard
from granular_lmp.impact import deck as impact_deck
from granular_lmp.impact import guards as impact_guards
from granular_lmp.impact import problem as impacts
from granular_lmp.lammps import checkpoints, guards
from granular_lmp.lammps import deck as wave_deck
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.edits import differing_lines
from granular_lmp.problem import Problem
from granular_lmp.scene.at_rest import crystal_of
from granular_lmp.scene.scene import Scene
from granular_lmp.units import AnyUnits, OwnUnits, units_for


def prepare(scene: Scene) -> Problem:
    """Return the problem of a scene."""
    if scene.wave is None:
        return cast(Problem, impacts.prepare(scene))
    return waves.prepare(scene)


def deck_of(problem: Problem) -> Deck:
    """Return the deck of a problem."""
    if isinstance(problem, impacts.ImpactProblem):
        return cast(Deck, impact_deck.deck_of(problem))
    return wave_deck.deck_of(problem)


def in_deck(what: Scene | Deck) -> tuple[Scene, Deck | None]:
    """Return the scene to run, and its deck if there is one."""
    if isinstance(what, Deck | impact_deck.ImpactDeck):
        return what.problem.scene, what
    return what, None


def edits(deck: Deck) -> list[str]:
    """Return the lines by which the text of a deck differs from the one that this package writes."""
    if isinstance(deck, impact_deck.ImpactDeck):
        return differing_lines(impact_deck.deck_of(deck.problem).input_text, deck.input_text)
    return deck.edits()


def resume_text(deck: Deck, checkpoint: str) -> str:
    """Return the input that continues a run of a deck from a checkpoint."""
    if isinstance(deck, impact_deck.ImpactDeck):
        return impact_deck.resume_text(deck.problem, checkpoint)
    return wave_deck.resume_text(deck.problem, checkpoint)


def checkpoint_steps(problem: Problem, ranks: int) -> int:
    """Return the steps between two checkpoints."""
    if isinstance(problem, impacts.ImpactProblem):
        return impact_deck.checkpoint_steps(problem, ranks)
    return checkpoints.checkpoint_steps(problem, ranks)


def line_steps(problem: Problem) -> int:
    """Return the steps between two lines of the thermo table."""
    if isinstance(problem, impacts.ImpactProblem):
        return impact_deck.look_steps(problem)
    return guards.line_interval(problem)


def kept_columns(problem: Problem) -> tuple[str, ...]:
    """Return the thermo columns that hold extremes between two lines, which are written when a run is stopped."""
    return () if problem.mode is None else tuple(guards.columns(problem))


def guards_of(problem: Problem) -> Mapping[str, Guard]:
    """Return the guards of which some are in the deck of a problem, by title."""
    return impact_guards.GUARDS if problem.mode is None else guards.GUARDS


def units_of(scene: Scene) -> AnyUnits:
    """Return the units of the deck of a scene."""
    if scene.wave is None:
        return OwnUnits(scene.scale.mass, scene.sphere.radius, scene.scale.time)
    return units_for(scene.sphere.radius)


def unit_of(scene: Scene) -> float:
    """Return the unit of displacements, m: D0 of a wave, else the length of the scale."""
    return scene.scale.length if scene.wave is None else scene.displacement_amplitude


def force_of(scene: Scene) -> float:
    """Return the unit of forces, N: k1 D0 of a wave, else m ℓ/t0²."""
    if scene.wave is None:
        return scene.scale.mass * scene.scale.length / scene.scale.time**2
    return scene.sphere.normal_stiffness * scene.displacement_amplitude


def words(scene: Scene) -> str:
    """Return the scene in a few words."""
    return scene.words if scene.wave is None else scene.wave_label


def in_snapshots(scene: Scene) -> tuple[ase.Atoms, NDArray[np.int64]]:
    """Return the spheres of a scene at rest, and the indices of those in its snapshots, ascending."""
    if scene.wave is None:
        problem = prepare(scene)
        return problem.crystal, problem.recorded
    atoms = crystal_of(scene).atoms
    return atoms, np.arange(len(atoms))
