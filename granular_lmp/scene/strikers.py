"""Strikers: spheres of the crystal that have a velocity at the beginning, beside that of a wave or of a state."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import cos, radians, sin

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import CHAIN, Shape
from granular_lmp.errors import SceneError
from granular_lmp.scene.places import AtPlaces, place_of, place_troubles, spheres_at
from granular_lmp.scene.schema import number

WORDS = {"x": (1.0, 0.0), "y": (0.0, 1.0), "-x": (-1.0, 0.0), "-y": (0.0, -1.0)}  # unit vectors


@dataclass(frozen=True)
class Striker(AtPlaces):
    """Spheres of the lattice that have a velocity at the beginning; the first row of a chain is its usual striker.

    Their own radius, density or material is declared by an ``[[inclusion]]`` of the same spheres.
    """

    velocity: float = number("m/s", "of each sphere; must be given", 1e-9, 1e4, default=0.0)
    direction: float | str = number(
        "degrees", "from x towards y; or a word", -180, 180, open_low=True, words=tuple(WORDS), default="y"
    )

    @property
    def components(self) -> tuple[float, float]:
        """Velocity along x and y, m/s."""
        if isinstance(self.direction, str):
            x, y = WORDS[self.direction]
        else:
            x, y = cos(radians(self.direction)), sin(radians(self.direction))
        return self.velocity * x, self.velocity * y

    @property
    def along_y(self) -> bool:
        """True if the velocity is along the rows of contacts of a chain."""
        return self.direction in ("y", "-y", 90.0, -90.0)


def striker_troubles(strikers: Sequence[Striker], shape: Shape) -> Iterator[str]:
    """Yield what is wrong with each striker by itself."""
    for number_, each in enumerate(strikers, 1):
        if not each.velocity:
            yield f"striker {number_}: velocity: missing; must be a number in [1e-9, 10000], m/s"
        if shape.lattice == CHAIN and not each.along_y:
            yield (
                f'striker {number_}: direction = {each.direction!r}: must be "y" or "-y" in a chain, which nothing '
                "holds sideways"
            )
        yield from (f"striker {number_}: {trouble}" for trouble in place_troubles(each.rows, each.spheres, shape))


def struck(strikers: Sequence[Striker], crystal: ase.Atoms) -> tuple[NDArray[np.int64], ...]:
    """Return the indices of the spheres of each striker in a crystal.

    Raises
    ------
    SceneError
        If a striker is a vacancy, held, or in another striker too.
    """
    taken: set[int] = set()
    found = []
    for number_, striker in enumerate(strikers, 1):
        try:
            chosen = spheres_at(striker.rows, striker.spheres, crystal, "striker")
        except SceneError as error:
            raise SceneError(f"striker {number_}: {error}") from error
        if crystal.arrays["fixed"][chosen].any():
            raise SceneError(f"striker {number_}: is in a row that is held, which does not move")
        if twice := taken & {*chosen.tolist()}:
            raise SceneError(
                f"striker {number_}: sphere {place_of(crystal, min(twice))}: is in another striker too; must be in one"
            )
        taken |= {*chosen.tolist()}
        found.append(chosen)
    return tuple(found)
