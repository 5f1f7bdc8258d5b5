"""Places, densities and units of spheres that just touch and are struck.

A scene declares the spheres; masses, stiffnesses and overlaps follow from the formulas here, never from the package
that made the deck.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.lattices import LATTICES
from granular_analysis.theory.network import Material, mixed
from granular_lmp.runs.record import Scene

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Sites:
    """Sites of a plane lattice whose spheres just touch; row 0 is at y = 0.

    Attributes
    ----------
    row, column : (N,) numbers of row and column, row by row.
    place : (N, 2) places in radii.
    """

    row: Integers
    column: Integers
    place: Floats

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Return all sites of a scene's lattice.

        Raises TheoryError (a ValueError) for a lattice of unknown stacking or with vacancies.
        """
        packing = scene.packing
        known = [name for (name, _), each in LATTICES.items() if len(each.vectors) < 3 and len(each.basis) == 1]
        if packing.lattice not in known:
            raise TheoryError(f"packing.lattice = {packing.lattice!r}: must be one of {', '.join(known)}")
        if scene.disorder.vacancies or any(each.vacancy for each in scene.inclusion):
            raise TheoryError(f"{scene.name}: must have no vacancies, which shift the numbers of its spheres")
        lattice = LATTICES[packing.lattice, ""]
        row, column = np.divmod(np.arange(int(packing.rows) * int(packing.columns)), int(packing.columns))
        # Every other row is shifted relative to the centre row
        aside = lattice.shift * ((row - scene.shape.centre_row) % 2)
        return cls(row, column, 2.0 * np.column_stack([column + aside, lattice.row * row]))

    def chosen(self, places: Any) -> Integers:
        """Return the indices of the spheres in the rows, or among the single spheres, of a striker or an output."""
        first, last = (*places.rows, -1, -1)[:2] if places.rows else (0, -1)
        single = {tuple(each) for each in places.spheres}
        sites = zip(self.row.tolist(), self.column.tolist(), strict=True)
        return np.flatnonzero([first <= row <= last or (row, column) in single for row, column in sites])


def densities(scene: Scene) -> Floats:
    """Return the density of each row (rows,), kg/m³, of a lattice whose rows differ in density only.

    Raises TheoryError (a ValueError) for an inclusion with keys other than rows, every and density, for disorder, and
    for a table.
    """
    found = np.full(int(scene.packing.rows), scene.sphere.density)
    if scene.disorder.radius or scene.disorder.density or scene.packing.table:
        raise TheoryError(f"{scene.name}: must have neither disorder nor packing.table")
    for number, each in enumerate(scene.inclusion, 1):
        differs = {name for name, value in vars(each).items() if value != getattr(type(each)(), name)}
        if other := sorted(differs - {"rows", "every", "density"}):
            raise TheoryError(f"{scene.name}: inclusion {number} has {', '.join(other)}; allowed: rows, every, density")
        found[each.rows[0] : each.rows[-1] + 1 : each.every] = each.density
    return found


def hertz(scene: Scene) -> float:
    """Return A of Hertz's law F = A δ^{3/2} between two of the declared spheres, N/m^{3/2}."""
    sphere, one = scene.sphere, np.zeros(1, dtype=np.intp)
    material = Material(sphere.youngs_modulus, sphere.poisson_ratio)
    return float(mixed([material], (one, one), (np.full(1, sphere.radius),) * 2)[0][0])


def scale_of_strike(scene: Scene) -> tuple[float, float]:
    """Return the units ℓ (m) and t0 = ℓ/v (s) of a scene without a wave.

    If something moves at the start, v is the largest velocity there and ℓ = (m v²/A)^{2/5}. A sphere that turns counts
    with the velocity Rω of its surface. `start.noise` adds 2√2 times its value to the velocities of a state: a bound
    on the largest velocity that it gives, less the mean. If all spheres are released from rest, ℓ is the largest
    displacement and v = √(A/m) ℓ^{5/4}. m and A are those of the declared sphere (`hertz`).
    """
    sphere, state = scene.sphere, np.reshape([each[2:] for each in scene.start.state], (-1, 5))
    A, mass = hertz(scene), 4 / 3 * np.pi * sphere.radius**3 * sphere.density
    struck = [each.velocity for each in scene.striker]
    begins = (
        max([0.0, *np.hypot(*state[:, 2:4].T), *abs(sphere.radius * state[:, 4])]) + 2 * np.sqrt(2) * scene.start.noise
    )
    fastest = max([begins, *struck])
    length = float((mass * fastest**2 / A) ** 0.4) if fastest else float(np.hypot(*state[:, :2].T).max())
    return length, length / float(fastest or np.sqrt(A / mass) * length**1.25)
