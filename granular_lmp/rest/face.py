"""Derived values of the spheres at rest: the common interface of crystals held at rest and of spheres that meet.

`granular_lmp.rest.kinds.rest_of` decides once which of the two a scene is; all later code reads its values here. They
are in the units of the scene: m, its length and t0 (`granular_lmp.crystal.scale`).
"""

from abc import ABC, abstractmethod
from math import inf, sqrt
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts, law_between
from granular_lmp.crystal.lattices import CHAIN, centre
from granular_lmp.crystal.scale import Scale
from granular_lmp.crystal.sphere import INERTIA_RATIO, Sphere
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.rest.at_rest import CrystalAtRest, crystal_of
from granular_lmp.rest.linear import BlochWave
from granular_lmp.rest.scene import Scene
from granular_lmp.rest.step_rules import StepRule
from granular_lmp.scene.places import spheres_at
from granular_lmp.scene.start import state_in
from granular_lmp.scene.strikers import struck

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Rest(ABC):
    """Spheres of a scene at rest.

    Attributes
    ----------
    scene : Scene
        Scene with every "auto" decided.
    turns : bool
        True if spheres turn.
    wave : BlochWave, optional
        Wave in the lattice; None without a wave.
    """

    scene: Scene
    turns: bool = True
    wave: BlochWave | None = None

    # --- values that each kind defines ---

    @property
    @abstractmethod
    def planes(self) -> dict[str, float]:
        """Rigid walls, "ylo" → place in radii; the substrates are "zlo" and "zhi"."""

    @property
    @abstractmethod
    def loads(self) -> dict[int, float]:
        """Constant forces along y on free ends, m v/t0, by sphere."""

    @property
    @abstractmethod
    def follows(self) -> str:
        """Axes "x" and "y" along which the box grows with the spheres at its faces."""

    @property
    @abstractmethod
    def outermost(self) -> tuple[float, float]:
        """Lowest and highest place along y that the box must contain in addition to its cell, radii."""

    @property
    @abstractmethod
    def shortest_collision(self) -> float:
        """Shortest collision of two neighbours, or half a period of their vibration, t0."""

    @property
    @abstractmethod
    def steps_between_looks(self) -> int:
        """Steps between two checks of the guards, which are the lines of the thermo table."""

    @property
    @abstractmethod
    def density(self) -> Floats:
        """Density of each sphere, (N,), in m/ℓ³ if the deck has units of its own, else in kg/m³."""

    @property
    @abstractmethod
    def closed(self) -> NDArray[np.bool_]:
        """True for each closed contact, (C,)."""

    @property
    @abstractmethod
    def pressed(self) -> dict[str, float]:
        """Force of a compressed chain, its ratio to the force of the impact, and the speed of sound."""

    @property
    @abstractmethod
    def steps_to_collision(self) -> float | None:
        """Steps in the shortest collision; None if spheres do not meet."""

    @property
    @abstractmethod
    def entries(self) -> dict[str, Any]:
        """Entries in ``run.json`` on the spheres at rest and the units."""

    @property
    def cell(self) -> tuple[Floats, Floats]:
        """Masses (p,), m, and stiffnesses (p,), m/t0², of the cell of a chain of spheres that meet.

        Raises
        ------
        SceneError
            If there is no such cell.
        """
        raise SceneError("packing.lattice: a crystal that is held at rest has modes in place of the bands of a chain")

    @abstractmethod
    def step_rules(self, enough: float = inf) -> list[StepRule]:
        """Return the rules for the time step; a limit above `enough` may be underestimated, but not below `enough`."""

    @abstractmethod
    def refuse(self) -> None:
        """Raise SceneError if the spheres at rest do not fit the scene."""

    # --- values common to both kinds ---

    @cached_property
    def crystal(self) -> CrystalAtRest:
        """Spheres at rest, their materials and contacts."""
        return crystal_of(self.scene)

    @property
    def atoms(self) -> ase.Atoms:
        """Spheres at rest, in radii R of ``[sphere]``."""
        return self.crystal.atoms

    @property
    def materials(self) -> tuple[Sphere, ...]:
        """Materials by index of the array ``material``, the sphere of the lattice first."""
        return self.crystal.materials

    @property
    def contacts(self) -> Contacts:
        """Contacts at rest: of all spheres, or of one sphere in a perfect lattice."""
        return self.crystal.contacts

    @property
    def frequency(self) -> float:
        """Ω of the wave, rad/t0; 0 without a wave, as sources then have their own frequencies."""
        return 0.0 if self.wave is None else self.wave.mode.frequency

    @property
    def scale(self) -> Scale:
        """Units of the scene."""
        return self.scene.scale

    @cached_property
    def strikers(self) -> tuple[Integers, ...]:
        """Indices of the spheres of each striker."""
        return struck(self.scene.striker, self.atoms)

    @cached_property
    def state(self) -> Floats:
        """Displacements (m), velocities (m/s) and spins (rad/s) from ``[start]``, (N, 9), without strikers."""
        scene = self.scene
        turns, space = self.turns, scene.space
        return state_in(scene.start, self.atoms, scene.sphere.radius, self.strikers, turns=turns, space=space)

    @cached_property
    def recorded(self) -> Integers:
        """Indices of the spheres that are always recorded: the centre sphere and, without a wave, ``[output]``."""
        output = self.scene.output
        if self.scene.wave is not None:
            return np.array([centre(self.atoms)])
        if output.everyone:
            return np.arange(len(self.atoms))
        try:
            return spheres_at(output.rows, output.spheres, self.atoms, "recorded sphere", output.layers)
        except SceneError as error:
            raise SceneError(f"output: {error}") from error

    @cached_property
    def mass(self) -> Floats:
        """Mass of each sphere, (N,), in m."""
        radius, density = self.atoms.arrays["radius"], self.atoms.arrays.get("density", self.scene.sphere.density)
        return np.asarray(radius**3 * density / self.scene.sphere.density)

    @cached_property
    def coefficients(self) -> Floats:
        """Coefficient of the normal force of each contact, (C,), in A."""
        law = law_between(self.atoms, self.materials, self.contacts.i, self.contacts.j)
        return np.asarray(law.normal_coefficient / self.scene.sphere.normal_coefficient)

    def kinetic_energy(self, velocity: Floats, spin: Floats, spheres: Integers) -> Floats:
        """Return ½mv² + ½(I/mR²)m(Rω)² of n spheres, in m v², from velocities (…, n, 2 or 3), in v, and R ω/v."""
        turning = spin**2 if spin.ndim < velocity.ndim else np.sum(spin**2, axis=-1)
        surface = self.atoms.arrays["radius"][spheres] ** 2 * turning
        return np.asarray(self.mass[spheres] * (np.sum(velocity**2, axis=-1) + INERTIA_RATIO * surface) / 2)

    @property
    def given_energy(self) -> float:
        """Kinetic energy of all spheres at the beginning, in m v²."""
        velocity, spin = self.state[:, 3:5].copy(), self.state[:, 8] * self.scene.sphere.radius
        for striker, spheres in zip(self.scene.striker, self.strikers, strict=True):
            velocity[spheres] = striker.components[:2]
        unit, everyone = self.scale.velocity, np.arange(len(self.atoms))
        return float(self.kinetic_energy(velocity / unit, spin / unit, everyone).sum())

    @cached_property
    def rest_overlap(self) -> Floats:
        """Overlap of each contact at rest, (C,), in the unit of length; 0 where nothing presses or pulls."""
        return np.asarray(self.contacts.overlap / self.scale.length)

    @cached_property
    def rest_force(self) -> Floats:
        """Force A d^{3/2} of each contact at rest, (C,), in m v/t0."""
        return np.asarray(self.coefficients * self.rest_overlap**1.5)

    @cached_property
    def rest_stiffness(self) -> Floats:
        """Stiffness (3/2) A √d of each contact at rest, (C,), in m/t0²."""
        return np.asarray(1.5 * self.coefficients * np.sqrt(self.rest_overlap))

    def on_wall(self, sphere: int) -> float:
        """Return the coefficient of a contact with a rigid wall, in A: (4/3) E* √R, twice the E* of two spheres."""
        material, ball = self.materials[int(self.atoms.arrays["material"][sphere])], self.scene.sphere
        radius = float(self.atoms.arrays["radius"][sphere])
        return sqrt(8 * radius) * material.effective_modulus / ball.effective_modulus

    @cached_property
    def on_walls(self) -> dict[int, tuple[float, float]]:
        """Return coefficient (A) and overlap at rest of a wall with the first (0) and last (−1) sphere of a chain."""
        if self.scene.lattice != CHAIN:
            return {}
        y, radius = self.atoms.positions[:, 1], self.atoms.arrays["radius"]
        unit = self.scene.sphere.radius / self.scale.length
        places = {end: self.planes[name] for end, name in ((0, "ylo"), (-1, "yhi")) if name in self.planes}
        return {
            end: (self.on_wall(end), max(float(radius[end]) - abs(float(y[end]) - place), 0.0) * unit)
            for end, place in places.items()
        }

    @cached_property
    def square_rate(self) -> float:
        """ω² of the stiffest contact at an overlap ℓ, 1/t0²: k (1/m + 1/m), k = (3/2) A √ℓ."""
        lightest, largest = float(self.mass.min()), float(self.atoms.arrays["radius"].max())
        square = 3 * float(self.coefficients.max(initial=1.0)) / lightest
        own = [each.effective_modulus / self.scene.sphere.effective_modulus for each in self.materials]
        return max(square, 3 * sqrt(2 * largest) * max(own) / lightest) if self.planes else square
