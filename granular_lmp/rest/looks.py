"""How fast a crystal at rest moves once a wave runs in it, and how often its deck looks at its contacts.

A deck looks `LOOKS` times in a period of the fastest motion Ω (what may hide is in
`granular_lmp.effects.between_looks`).
"""

from math import pi

from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.rest.at_rest import swiftness
from granular_lmp.rest.linear import physics_of, unit_contacts, usual_frequency
from granular_lmp.rest.scene import Scene

LOOKS = 8  # in a period of the fastest motion that matters
TOP = 1.0  # rad/τ, top of the branches that carry displacements: L and TR at the edge of the zone


def fastest(scene: Scene, usual: float | None = None) -> float:
    """Return the highest frequency that the extremes of contacts depend on, rad/t0.

        max(2Ω, 1·s)

    Ω is `usual`, by default that of the declared wave. The highest frequency is that of the second harmonic, of the
    fastest source if there are sources, or the top of the branches of displacement waves, which bounds free waves. A
    strike holds every frequency up to the highest. s is `granular_lmp.rest.at_rest.swiftness`, 1 in a perfect lattice.
    Each higher harmonic is smaller by the amplitude, and the rotational branch, up to Ω_max, holds a part in a thousand
    of the contacts' motion if no wall cuts the wave off (page Effects).
    """
    usual = usual_frequency(scene) if usual is None else usual
    own = [each.top(scene.sphere, usual) for each in scene.drives]
    if scene.form.waves or not any(own):
        own.append(usual)
    top = highest_frequency(unit_contacts(scene), scene.sphere, physics_of(scene)) if scene.struck else TOP
    return max(2 * max(own), top * swiftness(scene))


def longest(scene: Scene, usual: float | None = None) -> float:
    """Return the longest time between two looks, τ."""
    return 2 * pi / (LOOKS * fastest(scene, usual))


def look_interval(scene: Scene, usual: float | None = None) -> int:
    """Return the steps between two looks, as the deck computes them; 1 where a step is longer than `longest`."""
    return max(1, int(longest(scene, usual) / scene.time.step))
