"""Spheres that meet: values from places, masses and contacts in the units of an impact, m, ℓ and v.

Neighbours just touch, have a gap, or are pressed together in a chain (`granular_lmp.crystal.touching`).
"""

from math import hypot, inf, pi, sqrt
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.chain_bands import cell_of
from granular_lmp.crystal.contacts import law_between
from granular_lmp.crystal.lattices import CHAIN, FREE, WALL
from granular_lmp.crystal.scale import LARGEST_OVERLAP_RATIO, collision_time
from granular_lmp.crystal.search import overlapping
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.rest.face import Floats, Rest
from granular_lmp.rest.step_rules import StepRule, rules_of_collisions
from granular_lmp.scene.places import place_of

LOOKS_IN_COLLISION = 20  # checks by the guards in the shortest collision
# A force f on a sphere that vibrates with ω makes a velocity f/mω: at most 1e-4 of the velocity of the striker
LARGEST_RESIDUAL = 1e-4


@dataclass(frozen=True, eq=False)
class Meeting(Rest):
    """Spheres that are not held at rest: they just touch, have gaps, or are a compressed chain.

    Their contacts open without a pull, and they fly.
    """

    @cached_property
    def softest(self) -> float:
        """Smallest of the `coefficients`, in A; for a single sphere, that of its wall."""
        return float(self.coefficients.min()) if len(self.coefficients) else self.on_wall(0)

    @cached_property
    def shortest_collision(self) -> float:
        """Shortest collision, t0, of two neighbours that meet with the velocity of the fastest striker.

        For neighbours that are pressed together it is half a period of their vibration, π/ω. Between the two limits,
        1/T² is the sum of both squares, which makes T too short by at most 17 %. A single sphere collides with its
        wall.
        """
        if not len(self.contacts):
            return collision_time(float(self.mass[0]), self.softest)
        one, other = self.mass[self.contacts.i], self.mass[self.contacts.j]
        light = one * other / (one + other)
        rate = np.sqrt(self.rest_stiffness / light)
        pairs = {*zip(light.tolist(), self.coefficients.tolist(), rate.tolist(), strict=True)}
        return min((1 / hypot(1 / collision_time(m, s), w / pi) for m, s, w in pairs), default=inf)

    @cached_property
    def started(self) -> ase.Atoms:
        """Spheres at the beginning, displaced by ``[start]``, in radii."""
        moved = self.atoms.copy()
        moved.positions[:, :2] += self.state[:, :2] / self.scene.sphere.radius
        return moved

    @cached_property
    def first_depth(self) -> float:
        """Deepest initial overlap, in ℓ; for unlike spheres, the overlap of the softest contact at their force.

        Adhering contacts are pulled to their overlap at zero force as soon as they close.
        """
        pulled = 0.0
        if self.scene.start.touching:
            pulled = max(each.unpressed_overlap for each in self.materials) / self.scale.length
        if not self.scene.start.state:
            return max(pulled, float(self.rest_force.max(initial=0.0) / self.coefficients.min(initial=1.0)) ** (2 / 3))
        radius, places, softest = self.atoms.arrays["radius"], self.started.positions, self.softest
        i, j, vector = overlapping(self.started)
        law = law_between(self.atoms, self.materials, i, j)
        relative = (law.normal_coefficient / self.scene.sphere.normal_coefficient / softest) ** (2 / 3)
        in_walls = [
            radius - (places[:, "xy".index(name[0])] - plane) * (1 if name.endswith("lo") else -1)
            for name, plane in self.planes.items()
        ]
        depth = np.concatenate([relative * (radius[i] + radius[j] - np.linalg.norm(vector, axis=1)), *in_walls])
        return max(pulled, float(depth.max(initial=0.0)) * self.scene.sphere.radius / self.scale.length)

    def step_rules(self, enough: float = inf) -> list[StepRule]:
        """Return the rules for the time step."""
        rate = max(sqrt(self.square_rate * sqrt(self.first_depth)), self.rolling_rate)
        return rules_of_collisions(self.shortest_collision, rate, self.drag_rate)

    @property
    def rolling_rate(self) -> float:
        """Bound on ω, 1/t0, for spheres that roll on all their neighbours: ω² = 2n k_r Rc²/I, Rc at most R."""
        effects = self.scene.effects
        if effects.rolling is False:
            return 0.0
        stiffness = effects.rolling_stiffness * self.scale.time**2 / self.scale.mass
        return sqrt(2 * self._most_touching * stiffness / (INERTIA_RATIO * float(self.mass.min())))

    @property
    def drag_rate(self) -> float:
        """Bound on the rate, 1/t0, at which dashpots slow a motion: 2η/m for each contact, times 1/Ĩ for a rotation."""
        effects = self.scene.effects
        turning = effects.shear_damping / INERTIA_RATIO if effects.friction else 0.0
        dashpot = effects.viscosity * max(1.0, turning) + effects.rolling_viscosity / INERTIA_RATIO
        return 2 * self._most_touching * dashpot * self.scale.time / self.scale.mass / float(self.mass.min())

    @property
    def _most_touching(self) -> int:
        return int(self.contacts.per_sphere.max(initial=1)) + (2 if self.planes else 0)

    # --- compressed chains ---

    @cached_property
    def loads(self) -> dict[int, float]:
        """Constant forces along y on the free ends of a chain, m v/t0, by sphere; they balance the contacts."""
        packing, last = self.scene.packing, len(self.atoms) - 1
        if not packing.contact_force:
            return {}
        ends = {0: (packing.first, float(self.rest_force[0])), last: (packing.last, -float(self.rest_force[-1]))}
        return {sphere: force for sphere, (end, force) in ends.items() if end == FREE}

    @cached_property
    def planes(self) -> dict[str, float]:
        """Rigid walls that touch or press the outermost sphere of a face, "ylo" → place in radii."""
        packing, places, radius = self.scene.packing, self.atoms.positions, self.atoms.arrays["radius"]
        pressed = [
            (self.scene.sphere.static_overlap / self.on_wall(end) ** (2 / 3)) / self.scene.sphere.radius
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
    def residual_force(self) -> float:
        """Largest force on a sphere of a chain at rest due to rounding of the places, m v/t0."""
        walls = {end: coefficient * overlap**1.5 for end, (coefficient, overlap) in self.on_walls.items()}
        low, high = ([walls[end]] if end in walls else [] for end in (0, -1))
        return float(np.max(np.abs(np.diff([*low, *self.rest_force, *high])), initial=0.0))

    @property
    def rest_rate(self) -> float:
        """√(K/m) for spheres of ``[sphere]`` at rest, 1/t0, with K = (3/2) A √δ."""
        return sqrt(1.5 * sqrt(self.scene.sphere.static_overlap / self.scale.length))

    @cached_property
    def cell(self) -> tuple[Floats, Floats]:
        """Masses (p,), m, and stiffnesses (p,), m/t0², of the cell of a compressed chain.

        Raises
        ------
        SceneError
            If nothing presses the spheres together, or their order does not repeat.
        """
        if not self.scene.packing.contact_force:
            packing = self.scene.packing
            what = "packing.contact_force = 0.0: must be above 0"
            if self.scene.lattice != CHAIN:
                what = f'packing.lattice = "{packing.lattice}": must be "chain", with packing.contact_force above 0'
            raise SceneError(f"{what}; spheres that just touch have no modes", because="physics")
        if not (count := cell_of(self.mass, self.rest_stiffness)):
            raise SceneError(
                "inclusion: the spheres of the chain do not repeat from end to end, and only a periodic chain has "
                "bands; let every n-th row differ (rows and every of an [[inclusion]]), beginning with the first",
                because="physics",
            )
        return self.mass[:count], self.rest_stiffness[:count]

    @property
    def sound(self) -> float:
        """Speed of long waves along a chain, m/s: mean spacing over √(mean mass · mean compliance); 0 if unloaded."""
        if not self.scene.packing.contact_force:
            return 0.0
        spacing = np.mean(np.abs(self.contacts.vector[:, 1]))
        inertia = np.mean(self.mass) * np.mean(1 / self.rest_stiffness)
        return float(spacing / np.sqrt(inertia) / self.scale.time)

    @property
    def pressed(self) -> dict[str, float]:
        """Force on the chain, its ratio to the force of the impact, sound and residual; {} without a load."""
        if not (force := self.scene.packing.contact_force):
            return {}
        return {
            "contact_force_N": force,
            "contact_force_over_impact": float(np.mean(self.rest_force)),
            "overlap_m": self.scene.sphere.static_overlap,
            "sound_m_s": self.sound,
            "residual_force_over_impact": self.residual_force,
        }

    # --- values for decks and runs ---

    @property
    def follows(self) -> str:
        """Both axes in the plane, as spheres fly away."""
        return "xy"

    @property
    def outermost(self) -> tuple[float, float]:
        """Ends of the spheres along y if the chain is not periodic: with unequal spheres it is longer or shorter."""
        if self.atoms.pbc[1]:
            return inf, -inf
        places = self.atoms.positions[:, 1]
        return float(places.min() - 1), float(places.max() + 1)

    @property
    def steps_between_looks(self) -> int:
        """Steps between two checks; they divide a sample, with at least `LOOKS_IN_COLLISION` checks in a collision."""
        time = self.scene.time
        most = int(self.shortest_collision / LOOKS_IN_COLLISION / time.step)
        whole = time.steps_per_sample
        return next(steps for steps in range(max(min(most, whole), 1), 0, -1) if whole % steps == 0)

    @property
    def steps_to_collision(self) -> float:
        """Steps in the shortest collision."""
        return self.shortest_collision / self.scene.time.step

    @property
    def density(self) -> Floats:
        """Density of each sphere, (N,), in m/R³."""
        return np.asarray(self.mass / (4 / 3 * np.pi * self.atoms.arrays["radius"] ** 3))

    @property
    def closed(self) -> NDArray[np.bool_]:
        """True for contacts of neighbours with a gap of at most 1e-3 ℓ, (C,)."""
        contacts, radius = self.contacts, self.atoms.arrays["radius"]
        reach = (radius[contacts.i] + radius[contacts.j]) * self.scene.sphere.radius + 1e-3 * self.scale.length
        return np.asarray(np.linalg.norm(contacts.vector, axis=1) <= reach)

    @property
    def entries(self) -> dict[str, Any]:
        """Entries on the units of the impact, its shortest collision and the chain at rest."""
        scale = self.scale
        return {
            "velocity_m_s": scale.velocity,
            "length_m": scale.length,
            "t0_s": scale.time,
            "mass_kg": scale.mass,
            "shortest_collision": self.shortest_collision,
            "at_rest": self.pressed,
        }

    # --- refusals ---

    def refuse(self) -> None:
        """Raise SceneError if spheres overlap too deeply at rest or at the beginning, or are not at rest."""
        self._refuse_depth_at_rest()
        self._refuse_residual()
        if self.scene.start.state:
            self._refuse_depth_in_walls()

    def _refuse_depth_at_rest(self) -> None:
        radius = self.contacts.radius
        smaller = np.minimum(radius[self.contacts.i], radius[self.contacts.j])
        rest = float((self.contacts.overlap / (2 * smaller)).max(initial=0.0))
        if rest > LARGEST_OVERLAP_RATIO:
            raise SceneError(
                f"packing.contact_force = {self.scene.packing.contact_force!r}: two spheres overlap by {rest:.3g} of "
                f"the diameter at rest; at most {LARGEST_OVERLAP_RATIO} is allowed",
                because="physics",
            )

    def _refuse_residual(self) -> None:
        force, most = self.scene.packing.contact_force, LARGEST_RESIDUAL * max(1.0, self.rest_rate)
        if force and self.residual_force > most:
            raise SceneError(
                f"packing.contact_force = {force!r}: rounding of the places leaves a force of "
                f"{self.residual_force:.2g} m v/t0 on a sphere at rest; must be at most {most:.2g}; use a smaller "
                "force or a faster striker",
                because="physics",
            )

    def _refuse_depth_in_walls(self) -> None:
        radius = self.atoms.arrays["radius"]
        for name, plane in self.planes.items():
            inward = (self.started.positions[:, "xy".index(name[0])] - plane) * (1 if name.endswith("lo") else -1)
            overlap = (1 - inward / radius) / 2
            if overlap.max() > LARGEST_OVERLAP_RATIO:
                worst = int(overlap.argmax())
                raise SceneError(
                    f"start.state: sphere {place_of(self.atoms, worst)}: overlaps the wall {name} by "
                    f"{overlap[worst]:.3g} of the diameter; at most {LARGEST_OVERLAP_RATIO} is allowed",
                    because="physics",
                )
