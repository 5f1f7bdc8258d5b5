"""When a deck looks at its contacts, and how much of a motion may hide between two looks.

A deck looks `LOOKS` times in a period of the fastest motion Ω. Of an oscillation that is seen every h at most the
share

    1 − cos(Ω h/2)

of the amplitude lies beyond what is seen, 7.6 %. What comes so near to a limit is refused: on the opening of contacts,
the share of their swing, which is at most that of the deepest overlap, and at most twice the amplitude of all waves,
sources and strikes together. With the kernel nothing hides: it sees every step.
"""

from math import cos, pi

from granular_lmp.crystal.mode import Mode
from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.effects.case import Case
from granular_lmp.rest.at_rest import contacts_of, swiftness
from granular_lmp.rest.linear import physics_of, unit_contacts, usual_frequency
from granular_lmp.rest.scene import Scene

LOOKS = 8  # in a period of the fastest motion that matters
TOP = 1.0  # rad/τ, top of the branches that carry displacements: L and TR at the edge of the zone


def fastest(scene: Scene, mode: Mode | None = None) -> float:
    """Return the highest frequency that the extremes of contacts depend on, rad/t0; by default of the declared mode.

        max(2Ω, 1·s)

    It is that of the second harmonic, of the fastest source if there are sources, or the top of the branches of
    displacement waves, which bounds free waves. A strike holds every frequency up to the highest. s is
    `granular_lmp.rest.at_rest.swiftness`, 1 in a perfect lattice.
    Each higher harmonic is smaller by the amplitude, and the rotational branch, up to Ω_max, holds a part in a thousand
    of the contacts' motion if no wall cuts the wave off (docs/effects.md).
    """
    usual = mode.frequency if mode else usual_frequency(scene)
    own = [each.top(scene.sphere, usual) for each in scene.drives]
    if scene.form != "none" or not any(own):
        own.append(usual)
    top = highest_frequency(unit_contacts(scene), scene.sphere, physics_of(scene)) if scene.struck else TOP
    return max(2 * max(own), top * swiftness(scene))


def longest(scene: Scene, mode: Mode | None = None) -> float:
    """Return the longest time between two looks, τ."""
    return 2 * pi / (LOOKS * fastest(scene, mode))


def look_interval(scene: Scene, mode: Mode | None = None) -> int:
    """Return the steps between two looks, as the deck computes them; 1 where a step is longer than `longest`."""
    return max(1, int(longest(scene, mode) / scene.time.step))


def hidden(scene: Scene, mode: Mode | None = None, every: float | None = None) -> float:
    """Return the share of the amplitude of an oscillation that may lie beyond what is seen.

    every : τ between two looks; by default those of the deck. A deck of an earlier version that looked more rarely is
        read as if it had looked `LOOKS` times in a period.
    """
    if every is None:
        every = look_interval(scene, mode) * scene.time.step
    return 1 - cos(min(fastest(scene, mode) * every / 2, pi / LOOKS))


def nearly_open(scene: Scene, mode: Mode | None = None, every: float | None = None) -> float:
    """Return the overlap, in Δ0, below which a contact may open between two looks; in JKR's law it may be negative."""
    share, case = hidden(scene, mode, every), Case(scene)
    deepest = max(1.0, float(contacts_of(scene).overlap.max()) / scene.sphere.static_overlap)
    most = min((deepest + case.hold) * share, case.swing * share / (1 - share) if share < 1 else deepest)
    return most - case.hold
