"""Make the `Rest` of a scene: a crystal held at rest, or spheres that meet.

Code that has a problem reads its `Rest`; code that runs earlier, or needs none, reads `granular_lmp.rest.holding`.
"""

from collections.abc import Mapping

from granular_lmp.rest.face import Rest
from granular_lmp.rest.held import Held, decided
from granular_lmp.rest.linear import bloch_wave
from granular_lmp.rest.scene import Scene


def rest_of(scene: Scene, switches: Mapping[str, bool] | None = None, *, turns: bool = True) -> Rest:
    """Return the spheres of a scene at rest; for a crystal held at rest, with every "auto" decided.

    Parameters
    ----------
    scene : Scene
        Scene as declared.
    switches : mapping, optional
        Decided effects, by the key that forces them, such as ``effects.shear``.
    turns : bool
        True if spheres turn.
    """
    if not scene.held_at_rest:
        from granular_lmp.rest.meeting import Meeting  # kept out of start-up

        return Meeting(scene, turns)
    whole = decided(scene, switches or {})
    return Held(whole, turns) if whole.wave is None else Held(whole, turns, bloch_wave(whole))
