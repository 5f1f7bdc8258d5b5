"""Holding of the spheres of a scene at rest, by adhesion, a load or nothing, and properties that depend on it.

Adhesion or a load holds spheres at rest, as in every scene with a wave (`AT_REST`). Spheres that just touch and a
compressed chain are not held (`LOOSE`): their contacts open without a pull, and they fly.
`granular_lmp.rest.derived.Derived.holding` decides once which of the two a scene is.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Protocol

from granular_lmp.crystal.lattices import Lattice
from granular_lmp.crystal.scale import Scale
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.walls import Wall
from granular_lmp.frozen import dataclass
from granular_lmp.scene.sections import Effects
from granular_lmp.scene.start import Start
from granular_lmp.scene.strikers import Striker, scale_of
from granular_lmp.scene.without_wave import HELD, NOT_HELD


class Spheres(Protocol):
    """Properties of a scene that this module reads."""

    @property
    def material(self) -> Sphere:
        """Spheres as declared."""

    @property
    def sphere(self) -> Sphere:
        """Spheres of the lattice at rest."""

    @property
    def effects(self) -> Effects:
        """Declared effects."""

    @property
    def striker(self) -> Sequence[Striker]:
        """Strikers."""

    @property
    def start(self) -> Start:
        """Initial state."""


class Holding(ABC):
    """Base of the two ways in which spheres rest.

    Attributes
    ----------
    without_wave : str
        Kind of a scene without a wave (`granular_lmp.scene.without_wave`).
    has_modes : bool
        True if contacts have a stiffness at rest, so that linear waves exist.
    whole_cells : bool
        True if the columns of a sheet must be whole cells of its lattice, whatever its sides.
    """

    without_wave: ClassVar[str]
    has_modes: ClassVar[bool]
    whole_cells: ClassVar[bool]

    @abstractmethod
    def scale(self, scene: Spheres) -> Scale:
        """Return the units of a scene."""

    @abstractmethod
    def rigid(self, scene: Spheres) -> Wall | None:
        """Return the law of the contacts at rest with rigid planes; None if nothing presses spheres on them."""

    @abstractmethod
    def stiff(self, lattice: Lattice, scene: Spheres, /) -> Lattice:
        """Return the lattice of a scene, with its ratio of stiffnesses at rest if the ratio makes waves faster."""


@dataclass(frozen=True)
class HeldAtRest(Holding):
    """Adhesion or a load: contacts have an overlap at rest, and stiffnesses."""

    without_wave, has_modes, whole_cells = HELD, True, True

    def scale(self, scene: Spheres) -> Scale:
        """Return Δ0 and t0 of the contacts at rest."""
        return Scale.of(scene.sphere)

    def rigid(self, scene: Spheres) -> Wall:
        """Return the law of the contacts with rigid planes."""
        return Wall.rigid(scene.sphere)

    def stiff(self, lattice: Lattice, scene: Spheres, /) -> Lattice:
        """Return the lattice, with its ratio κ of stiffnesses if transverse waves are faster than L.

        They are faster above κ = 1 if spheres do not turn, and in the plane above κ = 2 if they do.
        """
        sphere, effects = scene.sphere, scene.effects
        if not sphere.static_overlap or effects.shear is False:
            return lattice
        turning = 4 / 3 if lattice.solid else 2.0
        ratio = sphere.stiffness_ratio
        return replace(lattice, ratio=ratio) if ratio > (1.0 if effects.rotation is False else turning) else lattice


@dataclass(frozen=True)
class Loose(Holding):
    """No hold: spheres just touch, have gaps, or are a compressed chain that they can fly from."""

    without_wave, has_modes, whole_cells = NOT_HELD, False, False

    def scale(self, scene: Spheres) -> Scale:
        """Return the units of the impact."""
        return scale_of(scene.striker, scene.start, scene.material)

    def rigid(self, scene: Spheres) -> None:
        """Return None: spheres meet planes as they meet each other."""

    def stiff(self, lattice: Lattice, _: Spheres, /) -> Lattice:
        """Return the lattice unchanged, as it has no stiffnesses at rest."""
        return lattice


AT_REST, LOOSE = HeldAtRest(), Loose()
