"""Problem: a scene with every "auto" decided, its contacts found, its wave solved, and its effects chosen.

`prepare` does this once. The deck, the guards, the choice of a time step and the run take the resulting `Problem`.
"""

from dataclasses import replace

import numpy as np

from granular_lmp.effects.effect import Chosen
from granular_lmp.effects.rotation import ROTATION
from granular_lmp.effects.selection import EFFECTS, remarks, select, warnings
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.rest.absorption import remarks_on_ends
from granular_lmp.rest.at_rest import echo_at
from granular_lmp.rest.face import Rest
from granular_lmp.rest.kinds import rest_of
from granular_lmp.rest.linear import BlochWave
from granular_lmp.rest.scene import Scene
from granular_lmp.rest.step_rules import refuse_step
from granular_lmp.scene.monitors import PlacedMonitor, check_groups, placed_monitors
from granular_lmp.scene.places import place_of
from granular_lmp.scene.sources import PlacedSource, placed
from granular_lmp.units import AnyUnits

__all__ = ["Problem", "prepare"]


@dataclass(frozen=True, eq=False)
class Problem:
    """A prepared scene.

    Attributes
    ----------
    declared : Scene
        Scene as declared.
    effects : tuple of Chosen
        Each effect, on or off, with the reason.
    rest : Rest
        Spheres at rest, and values that follow from them.
    looks : bool
        False if the deck does not check for the effects that it leaves out (`without_looks`).

    Examples
    --------
    >>> problem = prepare(Scene.load("tr_periodic"))
    >>> print(f"{len(problem.rest.atoms)} spheres, Omega = {problem.rest.frequency:.4f} rad/t0")
    48 spheres, Omega = 0.2713 rad/t0
    """

    declared: Scene
    effects: tuple[Chosen, ...]
    rest: Rest
    looks: bool = True

    @property
    def scene(self) -> Scene:
        """Scene with every "auto" decided."""
        return self.rest.scene

    @property
    def wave(self) -> BlochWave | None:
        """Wave in the lattice with these effects; None without a wave."""
        return self.rest.wave

    @property
    def units(self) -> AnyUnits:
        """Units of the deck."""
        return self.scene.units

    @cached_property
    def sources(self) -> tuple[PlacedSource, ...]:
        """Sources in the crystal."""
        return placed(self.scene.drives, self.rest.atoms, self.scene.sphere, self.rest.frequency)

    @cached_property
    def monitors(self) -> tuple[PlacedMonitor, ...]:
        """Monitors in the crystal."""
        contacts = None if self.rest.crystal.of_one else self.rest.contacts
        unrecorded = [each.name for each in EFFECTS if self.on.get(each.name) and not each.recorded]
        return placed_monitors(self.scene.monitor, self.rest.atoms, self.scene.shape, contacts, unrecorded)

    @cached_property
    def on(self) -> dict[str, bool]:
        """Name → whether the effect is on; false for effects that such scenes do not have."""
        return dict.fromkeys((each.name for each in EFFECTS), False) | {each.name: each.on for each in self.effects}

    @property
    def guards(self) -> list[str]:
        """Titles of the guards in the deck."""
        return [effect.guard for effect in self.effects if effect.guard]

    @property
    def judged(self) -> list[str]:
        """Titles of the guards that fail the run if they trigger."""
        return [effect.guard for effect in self.effects if effect.guard and effect.judged]

    @property
    def left_out(self) -> list[str]:
        """Titles of the guards whose effects are off, also if the scene needs the effects."""
        return [effect.guard for effect in self.effects if effect.guard and not effect.on]

    def warnings(self) -> list[str]:
        """Return sentences on changes that made the scene fit, effects forced off, and echoes at monitors."""
        of_scene = [*self.declared.remarks(), *self.rest.crystal.remarks(), *remarks_on_ends(self.scene)]
        return [*of_scene, *remarks(self.declared), *warnings(self.effects), *self._echoes()]

    def _echoes(self) -> list[str]:
        """Return a sentence for each monitor that the echo of the faces reaches, unless the scene allows an echo."""
        time = self.scene.time
        judged = () if time.allow_echo or self.wave is None else self.scene.monitor
        found = {each.name: echo_at(self.scene, each) for each in judged}
        return [
            f"monitor {name}: the echo of the {self.scene.shape.edge} may reach it at tau = {echo:.4g}"
            for name, echo in found.items()
            if echo < time.duration
        ]

    def stepped(self, step: float) -> "Problem":
        """Return the problem of the same scene with this time step, τ, in place of its step or tolerance."""
        scene = self.scene.with_values({"time.timestep": step})
        return replace(self, rest=replace(self.rest, scene=scene))

    def without_looks(self) -> "Problem":
        """Return the problem without guards, for a coarse run of a ladder whose finer runs have guards."""
        return replace(self, looks=False, effects=tuple(replace(each, guard="") for each in self.effects))


def prepare(scene: Scene) -> Problem:
    """Return the problem of a scene; no file is written.

    Raises
    ------
    SceneError
        If effects contradict each other (`granular_lmp.effects.selection.select`), a source or a monitor does not fit
        the crystal (`granular_lmp.scene.sources`, `granular_lmp.scene.monitors`), or the time step is beyond the
        stability limit of velocity Verlet.

    Examples
    --------
    >>> problem = prepare(Scene.load("tr_periodic"))
    >>> [effect.name for effect in problem.effects if effect.on]
    ['adhesion', 'shear', 'rotation', 'tracking']
    """
    chosen = tuple(select(scene))
    switches = {each.switch: each.on for each in chosen if each.switch == f"effects.{each.name}"}
    turns = any(each.name == ROTATION.name and each.on for each in chosen)
    problem = Problem(scene, chosen, rest_of(scene, switches, turns=turns))
    _check_strikes(problem)
    check_groups(problem.monitors, len(problem.sources))
    _ = problem.rest.recorded
    problem.rest.refuse()
    # A limit above the declared step is enough; in a large crystal it is found much faster than the longest step
    refuse_step(scene.time, problem.rest.step_rules(scene.time.clock.of_answer))
    return problem


def _check_strikes(problem: Problem) -> None:
    """Check that no source moves a sphere of a striker or a state."""
    begun = np.concatenate([*problem.rest.strikers, np.flatnonzero(problem.rest.state.any(axis=1))])
    for number, source in enumerate(problem.sources, 1):
        if source.source.motion and (both := np.intersect1d(begun, source.spheres)).size:
            place = place_of(problem.rest.atoms, int(both[0]))
            raise SceneError(
                f"source {number}: sphere {place}: is also in a striker or the state; a sphere that a source moves "
                "has no velocity of its own",
                because="physics",
            )
