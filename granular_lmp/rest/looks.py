"""Fastest motion of a crystal in which a wave runs, and how often the deck checks its contacts.

A deck checks `LOOKS` times in a period of the fastest motion Ω; `granular_lmp.effects.between_looks` bounds what it may
miss.
"""

from math import pi

from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.rest.at_rest import swiftness
from granular_lmp.rest.linear import physics_of, unit_contacts, usual_frequency
from granular_lmp.rest.scene import Scene

LOOKS = 8  # in a period of the fastest motion that matters
TOP = 1.0  # rad/τ, top of the branches that carry displacements: L and TR at the edge of the zone


def fastest(scene: Scene, usual: float | None = None) -> float:
    """Return the highest frequency that matters for the extremes of contacts, rad/t0.

        max(2Ω, 1·s)

    Ω is `usual`, by default that of the declared wave. It is the frequency of the second harmonic, of the fastest
    source, or at the top of the branches of displacement waves, which bounds free waves. A strike contains every
    frequency up to the highest. s is `granular_lmp.rest.at_rest.swiftness`, 1 in a perfect lattice. Each higher
    harmonic is smaller by a factor of the amplitude. The rotational branch, up to Ω_max, has a thousandth of the motion
    of contacts if no wall cuts the wave off (page Effects).
    """
    usual = usual_frequency(scene) if usual is None else usual
    own = [each.top(scene.sphere, usual) for each in scene.drives]
    if scene.form.waves or not any(own):
        own.append(usual)
    top = highest_frequency(unit_contacts(scene), scene.sphere, physics_of(scene)) if scene.struck else TOP
    return max(2 * max(own), top * swiftness(scene))


def longest(scene: Scene, usual: float | None = None) -> float:
    """Return the longest time between two checks, τ."""
    return 2 * pi / (LOOKS * fastest(scene, usual))


def look_interval(scene: Scene, usual: float | None = None) -> int:
    """Return the steps between two checks, as the deck computes them; 1 if a step is longer than `longest`."""
    return max(1, int(longest(scene, usual) / scene.time.step))
