"""Bound on the motion that guards may miss between two looks.

A deck looks `LOOKS` times in a period of the fastest motion Ω. If an oscillation is seen at intervals h, its extreme
exceeds what is seen by at most the share 1 − cos(Ω h/2) of the amplitude, 7.6 %. A run that comes this near to a limit
fails. For the opening of contacts it is this share of their swing, which is at most that of the deepest overlap, and at
most twice the amplitude of all waves, sources and strikes together. The kernel misses nothing, as it checks every step.
"""

from math import cos, pi

from granular_lmp.effects.case import Case
from granular_lmp.rest.face import Rest
from granular_lmp.rest.looks import LOOKS, fastest


def hidden(rest: Rest, every: float | None = None) -> float:
    """Return the share of the amplitude of an oscillation that looks may miss.

    every : τ between two looks; by default as in the deck. A deck of an earlier version with fewer looks is read as if
        it had `LOOKS` looks in a period.
    """
    if every is None:
        every = rest.steps_between_looks * rest.scene.time.step
    return 1 - cos(min(fastest(rest.scene, rest.frequency) * every / 2, pi / LOOKS))


def nearly_open(rest: Rest, every: float | None = None) -> float:
    """Return the overlap, in Δ0, below which a contact may open between two looks; negative values occur with JKR."""
    share, case = hidden(rest, every), Case(rest.scene)
    deepest = max(1.0, float(rest.contacts.overlap.max()) / rest.scene.sphere.static_overlap)
    most = min((deepest + case.hold) * share, case.swing * share / (1 - share) if share < 1 else deepest)
    return most - case.hold
