"""The problem of an impact: its spheres, what moves and what is recorded, and what its deck holds."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import hypot, inf, pi, sqrt
from typing import ClassVar

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.chain_bands import cell_of
from granular_lmp.crystal.contacts import Contacts, contacts_between, law_between
from granular_lmp.crystal.lattices import CHAIN, FREE, HELD, PERIODIC, WALL
from granular_lmp.crystal.scale import Scale, collision_time
from granular_lmp.crystal.search import overlapping
from granular_lmp.crystal.sphere import INERTIA_RATIO, Sphere
from granular_lmp.effects.effect import Chosen
from granular_lmp.effects.selection import EFFECTS
from granular_lmp.errors import SceneError
from granular_lmp.impact.lattice import neighbours, touching
from granular_lmp.impact.scene import ImpactScene
from granular_lmp.scene.monitors import PlacedMonitor, check_groups, placed_monitors
from granular_lmp.scene.places import place_of, spheres_at
from granular_lmp.scene.remarks import on_step
from granular_lmp.scene.sections import Output
from granular_lmp.scene.sources import PlacedSource
from granular_lmp.scene.start import refuse_motion, state_in
from granular_lmp.scene.strikers import struck
from granular_lmp.scene.validation import LARGEST_OVERLAP_RATIO
from granular_lmp.step_rules import StepRule, refuse_step, rules_of_collisions
from granular_lmp.units import AnyUnits

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# A force f on a sphere that vibrates with ω makes a velocity f/mω, which then is 1e-4 of the striker's at most
LARGEST_RESIDUAL = 1e-4


@dataclass(frozen=True, eq=False)
class ImpactProblem:
    """A prepared impact.

    Attributes
    ----------
    declared, scene : ImpactScene
        As declared, and with the time step of a run to a tolerance.
    crystal : ase.Atoms
        Spheres at rest, in radii R of ``[sphere]``.
    materials : tuple of Sphere
        By index of the array ``material``.
    strikers : tuple of arrays
        Indices of the spheres of each striker.
    recorded : array
        Indices of the recorded spheres, ascending.
    state : array
        Displacements (m), velocities (m/s) and spins (rad/s) of ``[start]``, (N, 5); without the strikers.
    """

    declared: ImpactScene
    scene: ImpactScene
    crystal: ase.Atoms
    materials: tuple[Sphere, ...]
    strikers: tuple[Integers, ...]
    recorded: Integers
    state: Floats
    mode: ClassVar[None] = None
    sources: ClassVar[tuple[PlacedSource, ...]] = ()

    @cached_property
    def monitors(self) -> tuple[PlacedMonitor, ...]:
        """Monitors in the crystal."""
        return placed_monitors(self.scene.monitor, self.crystal, self.scene.shape, self.contacts, self.on)

    @property
    def scale(self) -> Scale:
        """Units of the impact."""
        return self.scene.scale

    @property
    def units(self) -> AnyUnits:
        """Units of the deck: R, m and t0."""
        return self.scene.units

    @cached_property
    def mass(self) -> Floats:
        """Mass of each sphere, (N,), in m."""
        radius, density = self.crystal.arrays["radius"], self.crystal.arrays["density"]
        return np.asarray(radius**3 * density / self.scene.sphere.density)

    @cached_property
    def contacts(self) -> Contacts:
        """Contacts of neighbours, of which those that a gap parts have no overlap."""
        i, j, vector = neighbours(self.crystal)
        radius, unit = self.crystal.arrays["radius"], self.scene.sphere.radius
        overlap = np.zeros(len(i))
        if self.scene.packing.contact_force:
            overlap = (radius[i] + radius[j] - np.linalg.norm(vector, axis=1)) * unit
        return contacts_between(self.crystal, self.materials, i, j, vector * unit, overlap)

    @cached_property
    def coefficients(self) -> Floats:
        """Coefficient of the normal force of each contact, (C,), in A."""
        law = law_between(self.crystal, self.materials, self.contacts.i, self.contacts.j)
        return np.asarray(law.normal_coefficient / self.scene.sphere.normal_coefficient)

    def kinetic_energy(self, velocity: Floats, spin: Floats, spheres: Integers) -> Floats:
        """Return ½mv² + ½(I/mR²)m(Rω)² of n spheres, in m v², of velocities (…, n, 2), in v, and R ω/v (…, n)."""
        surface = self.crystal.arrays["radius"][spheres] * spin
        return np.asarray(self.mass[spheres] * (np.sum(velocity**2, axis=-1) + INERTIA_RATIO * surface**2) / 2)

    @property
    def given_energy(self) -> float:
        """Kinetic energy of all spheres at the beginning, in m v²."""
        velocity, spin = self.state[:, 2:4].copy(), self.state[:, 4] * self.scene.sphere.radius
        for striker, spheres in zip(self.scene.striker, self.strikers, strict=True):
            velocity[spheres] = striker.components
        unit, everyone = self.scene.scale.velocity, np.arange(len(self.crystal))
        return float(self.kinetic_energy(velocity / unit, spin / unit, everyone).sum())

    @cached_property
    def rest_overlap(self) -> Floats:
        """Overlap of each contact at rest, (C,), in ℓ; 0 where no force presses the spheres together."""
        return np.asarray(self.contacts.overlap / self.scale.length)

    @cached_property
    def shortest_collision(self) -> float:
        """Shortest time, t0, in which two neighbours part again that meet with the velocity of the fastest striker.

        Of neighbours that are pressed together it is half a period of their vibration, π/ω. Between the two limits
        1/T² is taken as the sum of both squares, which makes T too short, by 17 % at most.
        """
        one, other = self.mass[self.contacts.i], self.mass[self.contacts.j]
        light = one * other / (one + other)
        rate = np.sqrt(self.rest_stiffness / light)
        pairs = {*zip(light.tolist(), self.coefficients.tolist(), rate.tolist(), strict=True)}
        return min((1 / hypot(1 / collision_time(m, s), w / pi) for m, s, w in pairs), default=inf)

    @cached_property
    def started(self) -> ase.Atoms:
        """Spheres at the beginning, displaced by ``[start]``, in radii."""
        moved = self.crystal.copy()
        moved.positions[:, :2] += self.state[:, :2] / self.scene.sphere.radius
        return moved

    @cached_property
    def square_rate(self) -> float:
        """ω² of the stiffest contact at an overlap of ℓ, 1/t0²: k (1/m + 1/m) with k = (3/2) A √ℓ."""
        lightest, largest = float(self.mass.min()), float(self.crystal.arrays["radius"].max())
        square = 3 * float(self.coefficients.max(initial=1.0)) / lightest
        own = [each.effective_modulus / self.scene.sphere.effective_modulus for each in self.materials]
        return max(square, 3 * sqrt(2 * largest) * max(own) / lightest) if self.planes else square

    @cached_property
    def first_depth(self) -> float:
        """Deepest overlap at the beginning, in ℓ; of contacts of unlike spheres that of the softest at their force."""
        if not self.scene.start.state:
            return float(self.rest_force.max(initial=0.0) / self.coefficients.min(initial=1.0)) ** (2 / 3)
        radius, places, softest = self.crystal.arrays["radius"], self.started.positions, self.coefficients.min()
        i, j, vector = overlapping(self.started)
        law = law_between(self.crystal, self.materials, i, j)
        relative = (law.normal_coefficient / self.scene.sphere.normal_coefficient / softest) ** (2 / 3)
        in_walls = [
            radius - (places[:, "xy".index(name[0])] - plane) * (1 if name.endswith("lo") else -1)
            for name, plane in self.planes.items()
        ]
        depth = np.concatenate([relative * (radius[i] + radius[j] - np.linalg.norm(vector, axis=1)), *in_walls])
        return float(depth.max(initial=0.0)) * self.scene.sphere.radius / self.scene.scale.length

    @property
    def step_rules(self) -> list[StepRule]:
        """Rules for the time step."""
        return rules_of_collisions(self.shortest_collision, sqrt(self.square_rate * sqrt(self.first_depth)))

    # --- a chain that is pressed together ---

    @cached_property
    def rest_force(self) -> Floats:
        """Force of each contact at rest, (C,), in m v/t0."""
        return np.asarray(self.coefficients * self.rest_overlap**1.5)

    @cached_property
    def loads(self) -> dict[int, float]:
        """Constant forces along y on the free ends of a chain, m v/t0, by sphere: they balance their contacts."""
        packing, last = self.scene.packing, len(self.crystal) - 1
        if not packing.contact_force:
            return {}
        ends = {0: (packing.first, float(self.rest_force[0])), last: (packing.last, -float(self.rest_force[-1]))}
        return {sphere: force for sphere, (end, force) in ends.items() if end == FREE}

    def _on_wall(self, sphere: int) -> float:
        """Coefficient of the contact of a sphere with a rigid wall, in A: (4/3) E* √R, twice the E* of two spheres."""
        material, ball = self.materials[int(self.crystal.arrays["material"][sphere])], self.scene.sphere
        radius = float(self.crystal.arrays["radius"][sphere])
        return sqrt(8 * radius) * material.effective_modulus / ball.effective_modulus

    @cached_property
    def planes(self) -> dict[str, float]:
        """Rigid walls that the outermost sphere of a side touches, or is pressed on, "ylo" → place, radii."""
        packing, places, radius = self.scene.packing, self.crystal.positions, self.crystal.arrays["radius"]
        pressed = [
            (self.scene.sphere.static_overlap / self._on_wall(end) ** (2 / 3)) / self.scene.sphere.radius
            for end in (0, -1)
        ]
        found = {}
        for axis, name, low, high in ((1, "y", packing.first, packing.last), (0, "x", packing.sides, packing.sides)):
            if low == WALL:
                found[f"{name}lo"] = float((places[:, axis] - radius).min()) + pressed[0]
            if high == WALL:
                found[f"{name}hi"] = float((places[:, axis] + radius).max()) - pressed[1]
        return found

    @cached_property
    def on_walls(self) -> dict[int, tuple[float, float]]:
        """Coefficient (A) and overlap at rest (ℓ) of the first (0) and the last (−1) sphere of a chain with a wall."""
        y, radius = self.crystal.positions[:, 1], self.crystal.arrays["radius"]
        unit = self.scene.sphere.radius / self.scene.scale.length
        places = {end: self.planes[name] for end, name in ((0, "ylo"), (-1, "yhi")) if name in self.planes}
        return {
            end: (self._on_wall(end), max(float(radius[end]) - abs(float(y[end]) - place), 0.0) * unit)
            for end, place in places.items()
            if self.scene.lattice == CHAIN
        }

    @cached_property
    def residual_force(self) -> float:
        """Largest force that rounding of the places leaves on a sphere of a chain at rest, m v/t0."""
        walls = {end: coefficient * overlap**1.5 for end, (coefficient, overlap) in self.on_walls.items()}
        low, high = ([walls[end]] if end in walls else [] for end in (0, -1))
        return float(np.max(np.abs(np.diff([*low, *self.rest_force, *high])), initial=0.0))

    @property
    def rest_rate(self) -> float:
        """√(K/m), 1/t0, of spheres of ``[sphere]`` at rest, K = (3/2) A √δ."""
        return sqrt(1.5 * sqrt(self.scene.sphere.static_overlap / self.scale.length))

    @cached_property
    def rest_stiffness(self) -> Floats:
        """Stiffness (3/2) A √d of each contact at rest, (C,), in m/t0²."""
        return np.asarray(1.5 * self.coefficients * np.sqrt(self.rest_overlap))

    @cached_property
    def cell(self) -> tuple[Floats, Floats]:
        """Masses (p,), m, and stiffnesses (p,), m/t0², of the cell of a chain that is pressed together.

        Raises
        ------
        SceneError
            If nothing presses the spheres together, or their order does not repeat.
        """
        if not self.scene.packing.contact_force:
            raise SceneError(
                "packing.contact_force = 0.0: must be above 0, in a chain; spheres that just touch have no modes"
            )
        if not (count := cell_of(self.mass, self.rest_stiffness)):
            raise SceneError(
                "inclusion: the spheres of the chain do not repeat in any order from end to end, and only a periodic "
                "chain has bands; let every n-th row differ (rows and every of an [[inclusion]]), the first one too"
            )
        return self.mass[:count], self.rest_stiffness[:count]

    @property
    def sound(self) -> float:
        """Speed of long waves along a chain, m/s: its mean spacing over √(mean mass · mean compliance); 0 if none."""
        if not self.scene.packing.contact_force:
            return 0.0
        spacing = np.mean(np.abs(self.contacts.vector[:, 1]))
        inertia = np.mean(self.mass) * np.mean(1 / self.rest_stiffness)
        return float(spacing / np.sqrt(inertia) / self.scene.scale.time)

    @property
    def at_rest(self) -> dict[str, float]:
        """Force that presses the chain together, its ratio to that of the impact, sound and residual; {} if none."""
        if not (force := self.scene.packing.contact_force):
            return {}
        return {
            "contact_force_N": force,
            "contact_force_over_impact": float(np.mean(self.rest_force)),
            "overlap_m": self.scene.sphere.static_overlap,
            "sound_m_s": self.sound,
            "residual_force_over_impact": self.residual_force,
        }

    @cached_property
    def effects(self) -> tuple[Chosen, ...]:
        """Effects that the deck holds, with the reasons, as for the scene of a wave."""
        scene, effects = self.scene, self.scene.effects
        rubs, loses = float(effects.friction) > 0, effects.restitution < 1
        ends = [name for name in ("first", "last", "sides") if getattr(scene.packing, name) in (HELD, WALL)]
        smooth = "nothing is sheared in a chain" if scene.lattice == CHAIN else "effects.friction is 0"
        law = f"by the {effects.shear_law} law" if rubs else smooth
        turning = effects.rotation is True
        turns = smooth if not rubs else "shear forces turn spheres" if turning else "effects.rotation is off"
        holds = scene.packing.contact_force or inf
        opens = "N press the contacts together" if holds < inf else "no force holds the contacts together"
        slides, closed = "is the coefficient of friction", f"held or rigid: {', '.join(ends)}"
        time = scene.time
        step = (time.step, "t0 is the step") if time.tolerance is None else (time.tolerance, "chooses the step")
        table = (
            ("adhesion", "sphere.work_of_adhesion", False, inf, "spheres part without a pull", ""),
            ("contact_opening", "packing.contact_force", True, holds, opens, ""),
            ("shear", "effects.friction", rubs, inf, law, ""),
            ("rotation", "effects.rotation", rubs and turning, inf, turns, ""),
            ("sliding", "effects.friction", rubs, float(effects.friction), slides, ""),
            ("damping", "effects.restitution", loses, effects.restitution, "is the restitution of a collision", ""),
            ("walls", "packing", bool(ends), inf, closed if ends else "all ends are free", ""),
            ("deep_overlap", "striker", False, inf, "Hertz's law is one of small overlaps", "largest_overlap"),
            ("long_step", "time.timestep", False, *step, "step_in_contact"),
        )
        return tuple(
            Chosen(name, key, on, on, value, reason, guard=guard, cost="-", loss="nothing")
            for name, key, on, value, reason, guard in table
        )

    @property
    def guards(self) -> list[str]:
        """Titles of the guards in the deck."""
        return [effect.guard for effect in self.effects if effect.guard]

    @property
    def judged(self) -> list[str]:
        """Titles of the guards that fail the run if they trigger."""
        return [effect.guard for effect in self.effects if effect.guard and effect.judged]

    def warnings(self) -> list[str]:
        """Return a sentence for each change that made the scene fit."""
        return on_step(self.declared.time)

    def stepped(self, scene: ImpactScene) -> "ImpactProblem":
        """Return the problem of the same scene with another time step."""
        return replace(self, scene=scene)

    @cached_property
    def on(self) -> dict[str, bool]:
        """True or false for each effect by name."""
        return {effect.name: False for effect in EFFECTS} | {effect.name: effect.on for effect in self.effects}


def prepare(scene: ImpactScene) -> ImpactProblem:
    """Return the problem of an impact; no file is written.

    Raises
    ------
    SceneError
        If a striker is held, missing, or in another striker too, a state moves such spheres or presses them too deep,
        or the time step is too long for the shortest collision.
    CrystalError
        If imperfections do not fit into the lattice.
    """
    packing = scene.packing
    crystal, materials = touching(
        scene.material,
        scene.lattice,
        scene.shape.rows,
        scene.shape.columns,
        held=(packing.first == HELD, packing.last == HELD),
        periodic=packing.sides == PERIODIC,
        force=packing.contact_force,
        disorder=scene.disorder,
        inclusions=scene.inclusion,
    )
    strikers = struck(scene.striker, crystal)
    recorded = np.arange(len(crystal))
    if not scene.output.everyone:
        recorded = _recorded(scene.output, crystal)
    turns = float(scene.effects.friction) > 0 and scene.effects.rotation is True
    state = state_in(scene.start, crystal, scene.sphere.radius, strikers, turns=turns)
    problem = ImpactProblem(scene, scene, crystal, materials, strikers, recorded, state)
    contacts = problem.contacts
    smaller = np.minimum(contacts.radius[contacts.i], contacts.radius[contacts.j])
    rest = float((problem.rest_overlap * scene.scale.length / (2 * smaller)).max(initial=0.0))
    if rest > LARGEST_OVERLAP_RATIO:
        raise SceneError(
            f"packing.contact_force = {scene.packing.contact_force!r}: two spheres overlap by {rest:.3g} of the "
            f"diameter at rest; at most {LARGEST_OVERLAP_RATIO} is allowed"
        )
    if scene.packing.contact_force and problem.residual_force > LARGEST_RESIDUAL * max(1.0, problem.rest_rate):
        raise SceneError(
            f"packing.contact_force = {scene.packing.contact_force!r}: rounding of the places leaves a force of "
            f"{problem.residual_force:.2g} m v/t0 on a sphere at rest, and at most "
            f"{LARGEST_RESIDUAL * max(1, problem.rest_rate):.2g} is allowed; take a smaller force or a faster striker"
        )
    check_groups(problem.monitors, len(problem.sources))
    if scene.start.state:
        _check_start(problem)
    if scene.time.tolerance is None:
        refuse_step(scene.time, problem.step_rules)
    return problem


def _check_start(problem: ImpactProblem) -> None:
    """Raise a SceneError if the state at the beginning displaces spheres that rub, or presses them into a wall."""
    crystal, everyone = problem.crystal, np.ones(len(problem.crystal), dtype=bool)
    if problem.on["shear"]:
        refuse_motion(problem.state, [0, 1], crystal, everyone, "whose contacts rub: a state lacks their shear at rest")
    radius = crystal.arrays["radius"]
    for name, plane in problem.planes.items():
        inward = (problem.started.positions[:, "xy".index(name[0])] - plane) * (1 if name.endswith("lo") else -1)
        overlap = (1 - inward / radius) / 2
        if overlap.max() > LARGEST_OVERLAP_RATIO:
            worst = int(overlap.argmax())
            raise SceneError(
                f"start.state: sphere {place_of(crystal, worst)}: overlaps the wall {name} by {overlap[worst]:.3g} of "
                f"the diameter; at most {LARGEST_OVERLAP_RATIO} is allowed"
            )


def _recorded(output: Output, crystal: ase.Atoms) -> Integers:
    """Return the indices of the recorded spheres, ascending."""
    try:
        return spheres_at(output.rows, output.spheres, crystal, "recorded sphere")
    except SceneError as error:
        raise SceneError(f"output: {error}") from error
