"""Crystals held at rest by adhesion or a load: values that follow from their contacts and their wave."""

from collections.abc import Mapping
from dataclasses import replace
from math import hypot, inf, nextafter, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import centre, places
from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.rest.absorption import quiet_end_of
from granular_lmp.rest.at_rest import CrystalAtRest, contacts_of, swiftness
from granular_lmp.rest.face import Floats, Rest
from granular_lmp.rest.linear import physics_of, unit_contacts, viscosity_of
from granular_lmp.rest.looks import fastest, look_interval
from granular_lmp.rest.scene import Scene
from granular_lmp.rest.step_rules import COARSEST, StepRule
from granular_lmp.scene.sources import longest_steps


@dataclass(frozen=True, eq=False)
class Held(Rest):
    """Spheres that vibrate about their rest under adhesion or a load."""

    @cached_property
    def planes(self) -> dict[str, float]:
        """Rigid walls, "ylo" → place in radii; the substrates are "zlo" and "zhi"."""
        contacts, found = self.contacts, {}
        for sphere, vector in zip(contacts.i[contacts.on_wall], contacts.vector[contacts.on_wall], strict=True):
            axis = int(np.argmax(np.abs(vector)))
            one = np.argmax(places(self.atoms) == sphere) if self.scene.perfect else sphere
            foot = self.atoms.positions[one, axis] + vector[axis] / self.scene.sphere.radius
            found["xyz"[axis] + ("lo" if vector[axis] < 0 else "hi")] = float(foot)
        return found

    @property
    def loads(self) -> dict[int, float]:
        """No forces: the cell or the walls bear the load."""
        return {}

    @property
    def follows(self) -> str:
        """Axes across which a face is free."""
        free = {*self.scene.shape.free}
        return "x" * ("sides" in free) + "y" * bool({"first", "last"} & free)

    @property
    def outermost(self) -> tuple[float, float]:
        """Nothing beyond the cell."""
        return inf, -inf

    @property
    def shortest_collision(self) -> float:
        """Half a period of the fastest wave, at the stiffness of the contact that a strike compresses most, t0."""
        return pi / fastest(self.scene, self.frequency) / (1 + self.scene.strike) ** 0.25

    @property
    def steps_between_looks(self) -> int:
        """Steps between two checks: `granular_lmp.rest.looks.LOOKS` checks in a period of the fastest motion."""
        return look_interval(self.scene, self.frequency)

    @property
    def steps_to_collision(self) -> None:
        """None, as contacts stay closed."""
        return None

    @property
    def density(self) -> Floats:
        """Density of each sphere, (N,), kg/m³."""
        return np.asarray(self.atoms.arrays.get("density", np.full(len(self.atoms), self.scene.sphere.density)))

    @property
    def closed(self) -> NDArray[np.bool_]:
        """True for all contacts, (C,)."""
        return np.ones(len(self.contacts), dtype=bool)

    @property
    def pressed(self) -> dict[str, float]:
        """Empty: `crystal` describes the relaxation."""
        return {}

    @property
    def entries(self) -> dict[str, Any]:
        """Entries on the crystal at rest, its units, and how often guards check it."""
        scene = self.scene
        return {
            **entries_of(self.crystal),
            "Delta0_m": scene.scale.length,
            "t0_s": scene.scale.time,
            "overlap_ratio": scene.sphere.overlap_ratio,
            "looks": {
                "every_tau": self.steps_between_looks * scene.time.step,
                "fastest": fastest(scene, self.frequency),
            },
        }

    def step_rules(self, enough: float = inf) -> list[StepRule]:
        """Return the rules for the time step; see `step_rules`."""
        return step_rules(self.scene, self.frequency, enough)

    def refuse(self) -> None:
        """Raise SceneError if the echo of the faces may reach the centre and the scene does not allow it."""
        scene = self.scene
        if scene.wave is None or scene.time.allow_echo:
            return
        echo = scene.echo_time / swiftness(scene)
        if scene.time.duration > echo:
            raise SceneError(
                f"time.duration = {scene.time.duration!r}: the stiffest contacts and lightest spheres of this crystal "
                f"may bring the echo of the {scene.shape.edge} to the centre at tau = {echo:.4g}; must be at most "
                "that, or set time.allow_echo = true"
            )


def decided(scene: Scene, switches: Mapping[str, bool]) -> Scene:
    """Return the scene of a crystal at rest with every "auto" decided; `switches` are its decided effects."""
    shape = scene.shape
    values: dict[str, Any] = {f"packing.{key}": getattr(shape, key) for key in ("rows", "columns", "ends")}
    if scene.wave is not None and scene.wave.frequency is not None:
        values["wave.wavenumber"] = scene.wave.wavenumber
    values |= switches
    if quiet := quiet_end_of(scene):
        values["absorb.rows"] = quiet.rows
    return scene.with_values(values)


def entries_of(crystal: CrystalAtRest) -> dict[str, Any]:
    """Return entries on the relaxation of a crystal that is not perfect, and its result; {} for a perfect lattice."""
    rest = crystal.equilibrium
    if rest is None:
        return {}
    overlaps = crystal.contacts.overlap / crystal.materials[0].static_overlap
    found = rest.summary() | {"smallest_overlap": float(overlaps.min()), "largest_overlap": float(overlaps.max())}
    return {"crystal": found, "centre": centre(crystal.atoms) + 1}


def step_rules(scene: Scene, usual: float, enough: float = inf) -> list[StepRule]:
    """Return all rules for the time step of a scene; `usual` is the frequency of its wave, rad/t0.

    A stability limit above `enough` may be underestimated, but not below `enough` (`largest_step`).
    """
    limit = largest_step(scene, enough)
    causes = [(scene.effects.damping is True, "drag"), (scene.struck, "a strike that stiffens contacts")]
    less = " and ".join(cause for there, cause in causes if there)
    name = f"2/Omega_max, less with {less}," if less else "2/Omega_max"
    sentence = f"beyond the stability limit of velocity Verlet; must be below {name} = {limit:.6g}, in tau"
    sources = longest_steps(scene.drives, scene.sphere, usual)
    return [
        *(StepRule(longest, longest, why) for longest, why in sources),
        StepRule(nextafter(limit, 0.0), COARSEST * limit, sentence),
    ]


def largest_step(scene: Scene, enough: float = inf) -> float:
    """Return the stability limit of velocity Verlet in the crystal, τ: 2/Ω_max, less with drag and strikes.

    The drag in LAMMPS uses the velocity half a step earlier, which changes the condition ΩΔτ < 2 to (ΩΔτ)² + 2bΔτ < 4.
    Here b = cλ, with the dashpot c in m/t0 and λ at most 2(κ+3)Ω²/min(κ, 1) in a perfect lattice. The drag of quiet
    ends has no such limit (`granular_lmp.crystal.quiet_ends`). A strike presses a contact to at most (1 + s) Δ0, where
    its stiffness is √(1 + s) times that at rest (`granular_lmp.scene.strikers.stretch`).

    In an imperfect crystal a lower bound of the limit is quick to compute, and is returned if it is above `enough`.
    """
    physics, sphere = physics_of(scene), scene.sphere
    viscosity = viscosity_of(scene) if scene.effects.damping is not False else 0.0
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
    """Return the limit of the step, τ, for the highest frequency at rest, rad/t0, and cλ/Ω², t0."""
    top *= (1 + scene.strike) ** 0.25
    half = drag * top / 2  # b/2Ω
    return 2 / top / (hypot(half, 1) + half)
