"""Strikers: spheres of the crystal with an initial velocity, in addition to that of a wave or of a state."""

from collections.abc import Iterator, Sequence
from math import cos, radians, sin, sqrt

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import CHAIN, Shape
from granular_lmp.crystal.scale import Scale
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.places import AtPlaces, place_of, place_troubles, spheres_at
from granular_lmp.scene.schema import number
from granular_lmp.scene.start import Start

WORDS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}  # unit vectors
WORDS |= {f"-{name}": (0.0 - x, 0.0 - y, 0.0 - z) for name, (x, y, z) in WORDS.items()}


@dataclass(frozen=True)
class Striker(AtPlaces):
    """Spheres of the lattice with an initial velocity; in a chain usually the first row.

    An ``[[inclusion]]`` of the same spheres declares their own radius, density or material.
    """

    velocity: float = number("m/s", "of each sphere; must be given", 1e-9, 1e4, default=0.0)
    direction: float | str = number(
        "degrees", "from x towards y; or a word; z in space", -180, 180, open_low=True, words=tuple(WORDS), default="y"
    )

    @property
    def components(self) -> tuple[float, float, float]:
        """Velocity along x, y and z, m/s."""
        if isinstance(self.direction, str):
            x, y, z = WORDS[self.direction]
        else:
            x, y, z = cos(radians(self.direction)), sin(radians(self.direction)), 0.0
        return self.velocity * x, self.velocity * y, self.velocity * z

    @property
    def along_y(self) -> bool:
        """True if the velocity is along a chain."""
        return self.direction in ("y", "-y", 90.0, -90.0)


def striker_troubles(strikers: Sequence[Striker], shape: Shape, space: int) -> Iterator[str]:
    """Yield the errors of each single striker, for spheres that move in `space` dimensions."""
    for number_, each in enumerate(strikers, 1):
        if not each.velocity:
            yield f"striker {number_}: velocity: missing; must be a number in [1e-9, 10000], m/s"
        if shape.lattice == CHAIN and not each.along_y:
            yield (
                f'striker {number_}: direction = {each.direction!r}: must be "y" or "-y" in a chain, which nothing '
                "holds sideways"
            )
        elif space == 2 and each.components[2]:
            yield (
                f'striker {number_}: direction = "{each.direction}": leaves the plane; needs a [substrate], or '
                "packing.space = 3 beside [wave]"
            )
        yield from (
            f"striker {number_}: {trouble}" for trouble in place_troubles(each.rows, each.spheres, shape, each.layers)
        )


def fastest_striker(strikers: Sequence[Striker]) -> float:
    """Return the largest velocity of strikers, m/s; 0 if there are none."""
    return max((each.velocity for each in strikers), default=0.0)


def leads(strikers: Sequence[Striker], start: Start, radius: float) -> bool:
    """Return whether a striker is at the beginning the fastest sphere, compared with the spheres of a state."""
    return bool(strikers) and fastest_striker(strikers) >= start.fastest(radius)


def scale_of(strikers: Sequence[Striker], start: Start, sphere: Sphere) -> Scale:
    """Return the units of an impact: they follow from the fastest initial velocity, for spheres that just touch.

    If all spheres are released from rest, the largest displacement ℓ gives v = √(A/m) ℓ^{5/4}. The units do not depend
    on adhesion or compression of the spheres.
    """
    unloaded = sphere.unloaded
    fastest = max(fastest_striker(strikers), start.fastest(sphere.radius))
    let_go = sqrt(unloaded.normal_coefficient / unloaded.mass) * start.farthest**1.25
    return Scale.of(unloaded, fastest or let_go)


def stretch(strikers: Sequence[Striker], start: Start, sphere: Sphere) -> float:
    """Return a bound for stretch and slip of contacts, in Δ0: v √(m/k1) plus twice the displacement of a state.

    The energy ½mv² of a sphere stretches one contact by at most v √(m/k1), and the contacts around it by less. The mass
    is that of `sphere`; lighter spheres stretch contacts less.
    """
    speed = max(fastest_striker(strikers), start.fastest(sphere.radius))
    return (speed * sqrt(sphere.mass / sphere.normal_stiffness) + 2 * start.farthest) / sphere.static_overlap


def struck(strikers: Sequence[Striker], crystal: ase.Atoms) -> tuple[NDArray[np.int64], ...]:
    """Return the indices of the spheres of each striker in a crystal.

    Raises
    ------
    SceneError
        If a sphere of a striker is a vacancy, is held, or belongs to another striker too.
    """
    taken: set[int] = set()
    found = []
    for number_, striker in enumerate(strikers, 1):
        try:
            chosen = spheres_at(striker.rows, striker.spheres, crystal, "striker", striker.layers)
        except SceneError as error:
            raise SceneError(f"striker {number_}: {error}", because=error.because) from error
        free = chosen[~crystal.arrays["fixed"][chosen]]
        if len(free) < len(chosen) and not (
            striker.rows and len(free)
        ):  # spheres of whole rows do not move where sides hold them
            raise SceneError(
                f"striker {number_}: {striker.places}: is at a face that is held, which does not move",
                because="physics",
            )
        chosen = free
        if twice := taken & {*chosen.tolist()}:
            raise SceneError(
                f"striker {number_}: sphere {place_of(crystal, min(twice))}: is in another striker too; must be in one",
                because="physics",
            )
        taken |= {*chosen.tolist()}
        found.append(chosen)
    return tuple(found)
