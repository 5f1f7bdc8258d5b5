"""The tables of the scene of an impact: frozen records whose fields carry their own range.

`granular_lmp.scene.strikers` and `granular_lmp.scene.start` have ``[[striker]]`` and ``[start]``.
"""

from dataclasses import dataclass

from granular_lmp.crystal.lattices import CHAIN, LATTICES
from granular_lmp.scene.places import AtPlaces, Rows, Spheres, places_field, rows_rule, spheres_rule
from granular_lmp.scene.schema import choice, count, flag, number
from granular_lmp.scene.sections import FINEST, SHEAR_LAWS, Sampled, checkpoint_field

FREE, HELD, WALL, PERIODIC = "free", "held", "wall", "periodic"


@dataclass(frozen=True)
class Packing:
    """Rows along y, columns along x, and what is beyond the first and the last of them.

    A ``wall`` is a rigid plane (``fix wall/gran``) that touches the row, of unequal spheres the outermost one, with the
    contact law of its spheres on a rigid body: A is 2√2 times that of two spheres. A ``held`` row does not move.
    Where a chain is pressed together by the ``contact_force``, walls and held spheres bear it; at a ``free`` end a
    constant force F0 pushes the last sphere.
    """

    rows: int = count("along y", 2, 10_000_000)
    lattice: str = choice("chain: one row of spheres along y", tuple(LATTICES), default=CHAIN.name)
    columns: int = count("along x: 1 in a chain", 1, 1_000_000, default=1)
    first: str = choice("end at the first row", (FREE, HELD, WALL), default=FREE)
    last: str = choice("end at the last row", (FREE, HELD, WALL), default=FREE)
    contact_force: float = number("N", "presses the contacts of a chain together at rest", 0, 1e12, default=0.0)
    sides: str = choice("of a sheet: periodic needs at least 3 columns", (FREE, PERIODIC, WALL), default=FREE)


@dataclass(frozen=True)
class Time(Sampled):
    """Duration and sampling of the run in t0 of the impact, and either its time step or the required accuracy.

    Good values: a step of 0.03, T/80 for the collision time T = 2.439 t0 of two spheres, leaves an error of 1.4e-4 in
    the velocities after 12 collision times (root mean square; 6e-4 at the worst place), which falls with the square of
    the step; with damping, or friction and the law "incremental", it falls with the step (docs/impacts.md).
    """

    duration: float = number("t0", "of the run", 1e-3, 1e8)
    timestep: float = number("t0", "at most", FINEST, 1, default=0.03)
    tolerance: float | None = number(
        "", "error of each velocity over the fastest striker's, in place of a timestep", 1e-9, 0.1, default=None
    )
    sample: float = number("t0", "between records", FINEST, 1e8, default=0.5)


@dataclass(frozen=True)
class Effects:
    """Forces of contacts beside Hertz's repulsion. Contacts open and close by themselves."""

    friction: float = number("", "Coulomb coefficient; 0: no shear force, no rotation", 0, 1e4, default=0.0)
    rotation: bool = flag("spheres turn, where there is friction", default=True)
    shear_law: str = choice("of the shear force", SHEAR_LAWS, default="incremental")
    restitution: float = number("", "of a collision of two spheres; 1: none lost", 0, 1, open_low=True, default=1.0)


@dataclass(frozen=True)
class Output(AtPlaces):
    """Spheres that are recorded at each sample, all of them if none are declared, and how often a run is saved."""

    rows: Rows = places_field(rows_rule("first and last recorded row"))
    spheres: Spheres = places_field(spheres_rule("[row, column] of each recorded sphere"))
    checkpoint: float | str = checkpoint_field()

    @property
    def everyone(self) -> bool:
        """True if all spheres are recorded."""
        return not self.rows and not self.spheres
