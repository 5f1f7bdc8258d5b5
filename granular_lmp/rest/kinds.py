"""The one place where a prepared scene is asked whether its spheres are held at rest: which maker makes its `Rest`."""

from collections.abc import Mapping

from granular_lmp.rest.face import Rest
from granular_lmp.rest.held import Held, decided
from granular_lmp.rest.linear import bloch_wave
from granular_lmp.rest.scene import Scene


def has_modes(scene: Scene) -> bool:
    """Return whether the crystal of a scene has Bloch modes: spheres that meet have none, at most bands of a chain."""
    return scene.held_at_rest


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
