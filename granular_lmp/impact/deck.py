"""The deck of an impact under its own name, for one release: `granular_lmp.lammps.deck` writes it."""

from typing import Any, cast

from granular_lmp.impact.problem import ImpactProblem
from granular_lmp.lammps import checkpoints, deck, guards, recording
from granular_lmp.problem import Problem


class ImpactDeck(deck.Deck):
    """The deck of an impact and the problem that it was made from."""

    problem: Any


def deck_of(problem: ImpactProblem) -> ImpactDeck:
    """Return the deck of an impact; no file is written."""
    made = deck.deck_of(_any(problem))
    return ImpactDeck(made.problem, made.input_text, made.data)


def dump_columns(problem: ImpactProblem) -> list[str]:
    """Return the names of the columns of the dump, as OVITO knows them."""
    return recording.dump_columns(_any(problem))


def look_steps(problem: ImpactProblem) -> int:
    """Return the steps between two looks of the guards, a whole number of them in a sample."""
    return guards.look_interval(_any(problem))


def checkpoint_steps(problem: ImpactProblem, ranks: int = 1) -> int:
    """Return the steps between two checkpoints."""
    return checkpoints.checkpoint_steps(_any(problem), ranks)


def resume_text(problem: ImpactProblem, checkpoint: str) -> str:
    """Return the input that continues a run from a checkpoint."""
    return deck.resume_text(_any(problem), checkpoint)


def _any(problem: ImpactProblem) -> Problem:
    return cast(Problem, problem)
