"""The problem: a scene with every "auto" decided, its contacts found, its wave solved, and its effects chosen.

`prepare` does this once. The deck, the guards, the choice of a time step and the run take the resulting `Problem`.
"""

from dataclasses import replace
from math import hypot, inf, nextafter
from typing import TYPE_CHECKING, Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.lattices import centre, places
from granular_lmp.crystal.mode import Mode, Physics
from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.crystal.scale import Scale
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.effects.case import Case
from granular_lmp.effects.effect import Chosen
from granular_lmp.effects.selection import EFFECTS, remarks, select, warnings
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.rest.absorption import quiet_end_of, remarks_on_ends
from granular_lmp.rest.at_rest import CrystalAtRest, contacts_of, crystal_of, echo_at, swiftness
from granular_lmp.rest.linear import mode_of, physics_of, unit_contacts, usual_frequency
from granular_lmp.rest.scene import Scene
from granular_lmp.rest.step_rules import COARSEST, StepRule, refuse_step
from granular_lmp.scene.monitors import PlacedMonitor, check_groups, placed_monitors
from granular_lmp.scene.places import place_of, spheres_at
from granular_lmp.scene.sources import PlacedSource, longest_steps, placed
from granular_lmp.scene.start import state_in
from granular_lmp.scene.strikers import struck
from granular_lmp.units import AnyUnits

if TYPE_CHECKING:
    from granular_lmp.rest.collisions import Collisions

__all__ = ["Problem", "prepare"]


@dataclass(frozen=True, eq=False)
class Problem:
    """A prepared scene.

    Attributes
    ----------
    declared : Scene
        Scene as declared.
    scene : Scene
        Scene with every "auto" decided.
    effects : tuple of Chosen
        Each effect, on or off, with the reason.
    at_rest : CrystalAtRest
        Spheres at rest, their materials and contacts.
    mode : Mode
        Bloch mode of the wave in the lattice with these effects; None without a wave.
    looks : bool
        False for a run whose deck does not look for the effects that it leaves out (`without_looks`).

    Examples
    --------
    >>> problem = prepare(Scene.load("tr_periodic"))
    >>> print(f"{len(problem.crystal)} spheres, {problem.mode.frequency:.4f} rad/t0, t0 = {problem.scale.time:.3e} s")
    48 spheres, 0.2713 rad/t0, t0 = 4.981e-10 s
    """

    declared: Scene
    scene: Scene
    effects: tuple[Chosen, ...]
    at_rest: CrystalAtRest
    mode: Mode = None  # type: ignore[assignment]  # as `Scene.wave`: what needs it asks for the wave first
    looks: bool = True

    @property
    def crystal(self) -> ase.Atoms:
        """Spheres at rest."""
        return self.at_rest.atoms

    @property
    def materials(self) -> tuple[Sphere, ...]:
        """Materials by index of the array ``material``, the sphere of the lattice first."""
        return self.at_rest.materials

    @property
    def contacts(self) -> Contacts:
        """Contacts at rest: of all spheres, or of one sphere of a perfect lattice."""
        return self.at_rest.contacts

    @property
    def scale(self) -> Scale:
        """Units of the scene."""
        return self.scene.scale

    @property
    def units(self) -> AnyUnits:
        """Units of the deck."""
        return self.scene.units

    @cached_property
    def recorded(self) -> NDArray[np.int64]:
        """Indices of the spheres that are always recorded: the centre one, and without a wave those of ``[output]``."""
        output = self.scene.output
        if self.mode is not None:
            return np.array([centre(self.crystal)])
        if output.everyone:
            return np.arange(len(self.crystal))
        try:
            return spheres_at(output.rows, output.spheres, self.crystal, "recorded sphere", output.layers)
        except SceneError as error:
            raise SceneError(f"output: {error}", because=error.because) from error

    @cached_property
    def collisions(self) -> "Collisions":
        """Quantities in the units of an impact."""
        from granular_lmp.rest.collisions import Collisions  # kept out of start-up

        return Collisions(self.scene, self.crystal, self.materials, self.contacts, self.strikers, self.state)

    @cached_property
    def planes(self) -> dict[str, float]:
        """Rigid walls, "ylo" → place, radii; those of a substrate are "zlo" and "zhi"."""
        if self.scene.loose:
            return self.collisions.planes
        contacts, found = self.contacts, {}
        for sphere, vector in zip(contacts.i[contacts.on_wall], contacts.vector[contacts.on_wall], strict=True):
            axis = int(np.argmax(np.abs(vector)))
            one = np.argmax(places(self.crystal) == sphere) if self.scene.perfect else sphere
            foot = self.crystal.positions[one, axis] + vector[axis] / self.scene.sphere.radius
            found["xyz"[axis] + ("lo" if vector[axis] < 0 else "hi")] = float(foot)
        return found

    @property
    def loads(self) -> dict[int, float]:
        """Constant forces along y on free ends, m v/t0, by sphere; none beside a wave."""
        return self.collisions.loads if self.scene.loose else {}

    @property
    def physics(self) -> Physics:
        """Degrees of freedom of the lattice."""
        return physics_of(self.scene)

    @cached_property
    def sources(self) -> tuple[PlacedSource, ...]:
        """Sources in the crystal."""
        return placed(self.scene.drives, self.crystal, self.scene.sphere, self.mode.frequency if self.mode else 0.0)

    @cached_property
    def strikers(self) -> tuple[NDArray[np.int64], ...]:
        """Indices of the spheres of each striker."""
        return struck(self.scene.striker, self.crystal)

    @cached_property
    def state(self) -> NDArray[np.float64]:
        """Displacements (m), velocities (m/s) and spins (rad/s) of ``[start]``, (N, 9); without the strikers."""
        turns = self.on["rotation"]
        return state_in(
            self.scene.start, self.crystal, self.scene.sphere.radius, self.strikers, turns=turns, space=self.scene.space
        )

    @cached_property
    def monitors(self) -> tuple[PlacedMonitor, ...]:
        """Monitors in the crystal."""
        contacts = None if self.scene.perfect and not self.scene.loose else self.contacts
        unrecorded = [each.name for each in EFFECTS if self.on.get(each.name) and not each.recorded]
        return placed_monitors(self.scene.monitor, self.crystal, self.scene.shape, contacts, unrecorded)

    @cached_property
    def on(self) -> dict[str, bool]:
        """True or false for each effect by name; false for those that are none of such scenes."""
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
        """Titles of the guards whose effects are off, also where the scene calls for them."""
        return [effect.guard for effect in self.effects if effect.guard and not effect.on]

    @property
    def step_rules(self) -> list[StepRule]:
        """Rules for the time step."""
        return self.collisions.step_rules if self.scene.loose else step_rules(self.scene, self.mode)

    @property
    def largest_step(self) -> float:
        """Stability limit of velocity Verlet, τ."""
        return largest_step(self.scene)

    def warnings(self) -> list[str]:
        """Return a sentence for each change that made the scene fit, effect forced off, and echo at a monitor."""
        if self.scene.loose:
            return self.declared.remarks()
        of_scene = [*self.declared.remarks(), *self.at_rest.remarks(), *remarks_on_ends(self.scene)]
        return [*of_scene, *remarks(self.declared), *warnings(self.effects), *self._echoes()]

    def _echoes(self) -> list[str]:
        """Return a sentence for each monitor that the echo of the faces reaches, unless the scene allows an echo."""
        time = self.scene.time
        judged = () if time.allow_echo or self.mode is None else self.scene.monitor
        found = {each.name: echo_at(self.scene, each) for each in judged}
        return [
            f"monitor {name}: the echo of the {self.scene.shape.edge} may reach it at tau = {echo:.4g}"
            for name, echo in found.items()
            if echo < time.duration
        ]

    def stepped(self, scene: Scene) -> "Problem":
        """Return the problem of the same scene with another time step."""
        return replace(self, scene=scene)

    def without_looks(self) -> "Problem":
        """Return the problem of a run that has no guards: a coarse one of a ladder, whose finer runs look."""
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
    problem = Problem(scene, scene, chosen, crystal_of(scene)) if scene.loose else _at_rest(scene, chosen)
    _check_strikes(problem)
    check_groups(problem.monitors, len(problem.sources))
    if problem.mode is None:
        _ = problem.recorded
    if scene.loose:
        problem.collisions.refuse()
    if problem.mode is not None:
        _refuse_echo(problem)
    # A limit above the declared step is enough, and in a large crystal much faster to find than the longest step
    enough = scene.time.clock.of_answer
    refuse_step(scene.time, problem.step_rules if scene.loose else step_rules(problem.scene, problem.mode, enough))
    return problem


def _at_rest(scene: Scene, chosen: tuple[Chosen, ...]) -> Problem:
    """Return the problem of a crystal at rest under load, its every "auto" decided."""
    shape = scene.shape
    values: dict[str, Any] = {f"packing.{key}": getattr(shape, key) for key in ("rows", "columns", "ends")}
    if scene.wave is not None and scene.wave.frequency is not None:
        values["wave.wavenumber"] = scene.wave.wavenumber
    values |= {effect.switch: effect.on for effect in chosen if effect.switch == f"effects.{effect.name}"}
    if quiet := quiet_end_of(scene):
        values["absorb.rows"] = quiet.rows
    resolved = scene.with_values(values)
    mode = None if resolved.wave is None else mode_of(resolved)
    return Problem(scene, resolved, chosen, crystal_of(resolved), mode)


def _refuse_echo(problem: Problem) -> None:
    """Raise a SceneError if the echo of the faces may reach the centre, unless the scene allows it."""
    scene, declared = problem.scene, problem.declared
    echo = scene.echo_time / swiftness(scene)
    if declared.time.duration > echo and not declared.time.allow_echo:
        raise SceneError(
            f"time.duration = {declared.time.duration!r}: contacts as stiff and spheres as light as in this crystal "
            f"may bring the echo of the {scene.shape.edge} to the centre at tau = {echo:.4g}; must be at most that, or "
            "set time.allow_echo = true",
            because="physics",
        )


def _check_strikes(problem: Problem) -> None:
    """Check that strikers and a state are spheres that nothing else moves."""
    begun = np.concatenate([*problem.strikers, np.flatnonzero(problem.state.any(axis=1))])
    for number, source in enumerate(problem.sources, 1):
        if source.source.motion and (both := np.intersect1d(begun, source.spheres)).size:
            raise SceneError(
                f"source {number}: sphere {place_of(problem.crystal, int(both[0]))}: is a striker or of the state too, "
                "and a sphere that is moved has no velocity of its own",
                because="physics",
            )


def step_rules(scene: Scene, mode: Mode | None = None, enough: float = inf) -> list[StepRule]:
    """Return all rules for the time step of a scene, whose wave has a mode, by default the one that it declares.

    The limit of stability may be given too short, but above `enough` where it is longer (`largest_step`).
    """
    limit = largest_step(scene, enough)
    causes = [(scene.effects.damping is True, "drag"), (scene.struck, "a strike that stiffens contacts")]
    less = " and ".join(cause for there, cause in causes if there)
    name = f"2/Omega_max, less with {less}," if less else "2/Omega_max"
    sentence = f"beyond the stability limit of velocity Verlet; must be below {name} = {limit:.6g}, in tau"
    sources = longest_steps(scene.drives, scene.sphere, mode.frequency if mode else usual_frequency(scene))
    return [
        *(StepRule(longest, longest, why) for longest, why in sources),
        StepRule(nextafter(limit, 0.0), COARSEST * limit, sentence),
    ]


def largest_step(scene: Scene, enough: float = inf) -> float:
    """Return the stability limit of velocity Verlet in the scene's crystal, τ: 2/Ω_max, less with drag and strikes.

    LAMMPS's drag uses the velocity of half a step before, which changes the condition ΩΔτ < 2 to (ΩΔτ)² + 2bΔτ < 4.
    Here b = cλ: c in m/t0 is that of the dashpots, λ at most 2(κ+3)Ω²/min(κ, 1) in a perfect lattice. The drag of quiet
    ends is none of the kind (`granular_lmp.crystal.quiet_ends`). A strike presses a contact to at most (1 + s) Δ0,
    where its stiffness is √(1 + s) times that at rest (`granular_lmp.scene.strikers.stretch`).

    In a crystal that is not perfect a lower bound of the limit is quick to find. It is returned if above `enough`.
    """
    physics, sphere = physics_of(scene), scene.sphere
    viscosity = Case(scene).viscosity if scene.effects.damping is not False else 0.0
    if scene.perfect:
        top, kappa = highest_frequency(unit_contacts(scene), sphere, physics), sphere.stiffness_ratio
        drag = viscosity * 2 * (kappa + 3) / (min(kappa, 1.0) if physics.shear else 1.0)  # cλ/Ω²
        return _stable(scene, top, drag)
    from granular_lmp.crystal.stability import crude_bound, frequency_bound  # kept out of start-up

    contacts = contacts_of(scene)
    for bound in (crude_bound, frequency_bound):
        top = bound(contacts, sphere, physics)
        drag = 0.0
        if viscosity:
            dashpots, unloaded = np.full(len(contacts), sphere.mass / sphere.time_scale**2), np.zeros(len(contacts))
            alone = replace(
                contacts, normal_stiffness=dashpots, shear_stiffness=dashpots.copy(), contact_force=unloaded
            )
            drag = viscosity * (bound(alone, sphere, physics) / top) ** 2  # the same
        if (limit := _stable(scene, top, drag)) > enough:
            break
    return limit


def _stable(scene: Scene, top: float, drag: float) -> float:
    """Return the limit of the step for the highest frequency at rest, rad/t0, and cλ/Ω², t0."""
    top *= (1 + scene.strike) ** 0.25
    half = drag * top / 2  # b/2Ω
    return 2 / top / (hypot(half, 1) + half)
