"""The problem of an impact: its spheres, who strikes and who is recorded, and what its deck holds."""

from dataclasses import dataclass
from functools import cached_property
from math import inf

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import force_law
from granular_lmp.crystal.lattices import CHAIN
from granular_lmp.crystal.scale import collision_time
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.effects.effect import Chosen
from granular_lmp.errors import SceneError
from granular_lmp.impact.lattice import neighbours, touching
from granular_lmp.impact.scene import HELD, PERIODIC, WALL, ImpactScene, Output, Striker
from granular_lmp.scene.places import spheres_at

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
STEPS_IN_COLLISION = 10.0  # The shortest collision has at least as many; the velocities then err by 3 %


@dataclass(frozen=True, eq=False)
class ImpactProblem:
    """A prepared impact.

    Attributes
    ----------
    scene : ImpactScene
    crystal : ase.Atoms
        Spheres that just touch, in radii R of ``[sphere]``.
    materials : tuple of Sphere
        By index of the array ``material``.
    strikers : tuple of arrays
        Indices of the spheres of each striker.
    recorded : array
        Indices of the recorded spheres, ascending.
    """

    scene: ImpactScene
    crystal: ase.Atoms
    materials: tuple[Sphere, ...]
    strikers: tuple[Integers, ...]
    recorded: Integers

    @cached_property
    def mass(self) -> Floats:
        """Mass of each sphere, (N,), in m."""
        radius, density = self.crystal.arrays["radius"], self.crystal.arrays["density"]
        return np.asarray(radius**3 * density / self.scene.sphere.density)

    @cached_property
    def contacts(self) -> tuple[Integers, Integers, Floats, Floats]:
        """Contacts i, j, (C,) each, their vectors (C, 2), radii, and coefficients (C,), in A."""
        i, j, vector = neighbours(self.crystal)
        stiffness = force_law(self.crystal, self.materials, i, j)[0] / self.scene.sphere.normal_coefficient
        return i, j, vector, stiffness

    @cached_property
    def shortest_collision(self) -> float:
        """Shortest time, t0, in which two neighbours part again that meet with the velocity of the fastest striker."""
        i, j, _, stiffness = self.contacts
        light = self.mass[i] * self.mass[j] / (self.mass[i] + self.mass[j])
        of_pairs = (collision_time(m, s) for m, s in {*zip(light.tolist(), stiffness.tolist(), strict=True)})
        return min(of_pairs, default=inf)

    @property
    def effects(self) -> tuple[Chosen, ...]:
        """Effects that the deck holds, with the reasons, as for the scene of a wave."""
        scene, effects = self.scene, self.scene.effects
        rubs, loses = effects.friction > 0, effects.restitution < 1
        ends = [name for name in ("first", "last", "sides") if getattr(scene.packing, name) in (HELD, WALL)]
        smooth = "nothing is sheared in a chain" if scene.lattice == CHAIN else "effects.friction is 0"
        law = f"by the {effects.shear_law} law" if rubs else smooth
        turns = smooth if not rubs else "shear forces turn spheres" if effects.rotation else "effects.rotation is off"
        slides, closed = "is the coefficient of friction", f"held or rigid: {', '.join(ends)}"
        time = scene.time
        step = (time.step, "t0 is the step") if time.tolerance is None else (time.tolerance, "chooses the step")
        table = (
            ("adhesion", "sphere.work_of_adhesion", False, inf, "spheres just touch, and part without a pull", ""),
            ("contact_opening", "striker", True, inf, "no force holds the contacts together", ""),
            ("shear", "effects.friction", rubs, inf, law, ""),
            ("rotation", "effects.rotation", rubs and effects.rotation, inf, turns, ""),
            ("sliding", "effects.friction", rubs, effects.friction, slides, ""),
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
    def on(self) -> dict[str, bool]:
        """True or false for each effect by name."""
        return {effect.name: effect.on for effect in self.effects}


def prepare(scene: ImpactScene) -> ImpactProblem:
    """Return the problem of an impact; no file is written.

    Raises
    ------
    SceneError
        If a striker is held, missing, or in another striker too, or the time step is too long for the shortest
        collision.
    CrystalError
        If imperfections do not fit into the lattice.
    """
    packing = scene.packing
    crystal, materials = touching(
        scene.sphere,
        scene.lattice,
        packing.rows,
        packing.columns,
        held=(packing.first == HELD, packing.last == HELD),
        periodic=packing.sides == PERIODIC,
        disorder=scene.disorder,
        inclusions=scene.inclusion,
    )
    struck: set[int] = set()
    strikers = []
    for number, striker in enumerate(scene.striker, 1):
        chosen = _chosen(striker, crystal, f"striker {number}")
        if crystal.arrays["fixed"][chosen].any():
            raise SceneError(f"striker {number}: is in a row that is held, which does not move")
        if twice := struck & {*chosen.tolist()}:
            where = [int(crystal.arrays[name][min(twice)]) for name in ("row", "column")]
            raise SceneError(f"striker {number}: sphere {where}: is in another striker too; must be in one")
        struck |= {*chosen.tolist()}
        strikers.append(chosen)
    recorded = np.arange(len(crystal))
    if not scene.output.everyone:
        recorded = _chosen(scene.output, crystal, "output")
    problem = ImpactProblem(scene, crystal, materials, tuple(strikers), recorded)
    most = problem.shortest_collision / STEPS_IN_COLLISION
    if scene.time.tolerance is None and scene.time.step > most:
        raise SceneError(
            f"time.timestep = {scene.time.timestep!r}: leaves the shortest collision of two neighbours, "
            f"{problem.shortest_collision:.4g} t0, fewer than {STEPS_IN_COLLISION:g} steps; must be at most "
            f"{most:.4g}, and at most {most / 8:.2g} for errors of 1e-4"
        )
    return problem


def _chosen(where: Striker | Output, crystal: ase.Atoms, name: str) -> Integers:
    """Return the indices of the spheres that a table names, ascending."""
    role = "striker" if isinstance(where, Striker) else "recorded sphere"
    try:
        return spheres_at(where.rows, where.spheres, crystal, role)
    except SceneError as error:
        raise SceneError(f"{name}: {error}") from error
