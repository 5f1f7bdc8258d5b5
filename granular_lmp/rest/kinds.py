"""The maker of the `Rest` of a scene: of a crystal that is held at rest, or of spheres that meet.

Who has a problem asks its `Rest`. What needs none, or comes before it, asks `granular_lmp.rest.holding`.
"""

from collections.abc import Mapping

from granular_lmp.rest.face import Rest
from granular_lmp.rest.held import Held, decided
from granular_lmp.rest.linear import bloch_wave
from granular_lmp.rest.scene import Scene


def rest_of(scene: Scene, switches: Mapping[str, bool] | None = None, *, turns: bool = True) -> Rest:
    """Return the spheres of a scene at rest: of a crystal that is held there with every "auto" decided.

    Parameters
    ----------
    scene : Scene
        As declared.
    switches : mapping, optional
        Effects that are decided, by the key that forces them, as ``effects.shear``.
    turns : bool
        True if spheres turn.
    """
    if not scene.held_at_rest:
        from granular_lmp.rest.meeting import Meeting  # kept out of start-up

        return Meeting(scene, turns)
    whole = decided(scene, switches or {})
    return Held(whole, turns) if whole.wave is None else Held(whole, turns, bloch_wave(whole))
