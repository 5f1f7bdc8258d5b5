"""Monitors: spheres whose motion is recorded beside the centre sphere, with the forces of their contacts if wanted.

At every sample of the run a monitor records the displacement, velocity, angle and spin of its spheres, and the
quantities of its kind (`granular_lmp.scene.monitor_kinds`). Recording does not change the motion.
`granular_lmp.runs.monitors` reads the records.
"""

from collections.abc import Sequence
from dataclasses import field

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.lattices import Shape
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.monitor_kinds import KINDS, MEANING, WITHOUT_CONTACTS, Kind
from granular_lmp.scene.places import (
    LAYERS_RULE,
    Rows,
    Spheres,
    in_words,
    places_field,
    rows_rule,
    spheres_at,
    spheres_rule,
)
from granular_lmp.scene.schema import NameRule, choice

# LAMMPS has 32 groups. A monitor takes one, or two with contacts; a source takes one; the rest of a deck at most 8
MOST_GROUPS = 24
_CONTACT_LINE = 110  # bytes


@dataclass(frozen=True)
class Monitor:
    """Spheres, and what is recorded about them.

    Attributes
    ----------
    name : str
        Part of the names of its files and of columns of a sweep.
    rows : (first, last)
        All spheres from the first to the last row, counted from 0; or
    spheres : sequence of (row, column)
    layers : (first, last)
        Layers along z that contain these spheres; must be given for single spheres in a crystal of several layers.
    what : str
        Kind of monitor.
    """

    name: str = field(default="", metadata={"rule": NameRule(str, "", "of its files, and of columns of a sweep")})
    rows: Rows = places_field(rows_rule())
    spheres: Spheres = places_field(spheres_rule())
    layers: Rows = field(default=(), metadata={"rule": LAYERS_RULE})
    what: str = choice(MEANING, tuple(KINDS), default="motion")

    @property
    def known(self) -> Kind:
        """Properties of its kind."""
        return KINDS[self.what]

    @property
    def with_contacts(self) -> bool:
        """True if the forces of contacts are recorded."""
        return self.known.contacts

    @property
    def places(self) -> str:
        """The spheres in words."""
        return in_words(self.rows, self.spheres, self.layers)

    @property
    def span(self) -> tuple[int, int]:
        """First and last row with its spheres."""
        rows = self.rows or [row for row, _ in self.spheres]
        return min(rows), max(rows)

    def breadth(self, columns: int) -> tuple[int, int]:
        """Return the first and the last column with its spheres, in a packing with this number of columns."""
        own = [0, columns - 1] if self.rows else [column for _, column in self.spheres]
        return min(own), max(own)


@dataclass(frozen=True, eq=False)
class PlacedMonitor:
    """A monitor in its crystal.

    Attributes
    ----------
    monitor : Monitor
    spheres : (n,) int array
        Indices of its spheres, ascending.
    around : (m,) int array
        Indices of its spheres and of all spheres that they touch or may touch later; empty if only motion is recorded.
    """

    monitor: Monitor
    spheres: NDArray[np.int64]
    around: NDArray[np.int64]

    @property
    def words(self) -> str:
        """Kind and places of the record in words."""
        count = len(self.spheres)
        return f"{self.monitor.what} of {count} sphere{'s' if count > 1 else ''}, {self.monitor.places}"

    @property
    def bytes(self) -> int:
        """Approximate size of a record: 13 doubles per sphere and, with contacts, three lines of text per sphere."""
        return 104 * len(self.spheres) + 3 * _CONTACT_LINE * len(self.around)


def placed_monitors(
    monitors: Sequence[Monitor], crystal: ase.Atoms, shape: Shape, contacts: Contacts | None, unrecorded: Sequence[str]
) -> tuple[PlacedMonitor, ...]:
    """Return the monitors of a scene in its crystal at rest.

    Parameters
    ----------
    monitors : sequence of Monitor
    crystal : ase.Atoms
        Spheres at rest.
    shape : Shape
    contacts : Contacts, optional
        Contacts of all spheres; None for a perfect lattice, where spheres touch only their own and adjacent rows.
    unrecorded : sequence of str
        Active effects whose forces or torques the record of contacts may lack.

    Raises
    ------
    SceneError
        If a place is empty, an effect has torques that are not recorded, or contacts reach beyond the next row.
    """
    found = []
    for each in monitors:
        try:
            chosen = spheres_at(each.rows, each.spheres, crystal, "monitor", each.layers)
        except SceneError as error:
            raise SceneError(f"monitor {each.name}: {error}", because=error.because) from error
        around = chosen[:0]
        if each.with_contacts:
            if unrecorded:
                raise SceneError(
                    f'monitor {each.name}: what = "{each.what}": must be {WITHOUT_CONTACTS} with the effect '
                    f"{unrecorded[0]}, whose forces or torques the record of contacts may lack",
                    because="not built",
                )
            if contacts is not None and _far(contacts, crystal, shape):
                raise SceneError(
                    f'monitor {each.name}: what = "{each.what}": must be {WITHOUT_CONTACTS} where contacts reach '
                    "beyond the next row, as they do in this crystal at rest",
                    because="not built",
                )
            around = _around(each, crystal, shape)
        found.append(PlacedMonitor(each, chosen, around))
    return tuple(found)


def _far(contacts: Contacts, crystal: ase.Atoms, shape: Shape) -> bool:
    """Return whether two spheres touch although their rows are neither equal nor adjacent."""
    row, pairs = crystal.arrays["row"], ~contacts.on_wall
    return bool((np.abs(row_step((row[contacts.j] - row[contacts.i])[pairs], shape)) > 1).any())


def row_step(difference: NDArray[np.int64], shape: Shape) -> NDArray[np.int64]:
    """Return differences of rows, the shorter way round a periodic cell."""
    if not shape.along_y:
        return difference
    return (difference + shape.rows // 2) % shape.rows - shape.rows // 2


def _around(monitor: Monitor, crystal: ase.Atoms, shape: Shape) -> NDArray[np.int64]:
    """Return the spheres of a monitor and all that may touch one of them: in adjacent rows, within 3 radii along x."""
    row, x = crystal.arrays["row"], crystal.positions[:, 0]
    if monitor.rows:
        first, last = monitor.rows
        near = np.abs(row_step(row - first, shape)) <= 1
        near |= np.abs(row_step(row - last, shape)) <= 1
        return np.flatnonzero(near | ((first <= row) & (row <= last)))
    width, reach = float(crystal.cell.lengths()[0]), 3.0 * float(crystal.arrays["radius"].max())
    near = np.zeros(len(row), dtype=bool)
    for each in spheres_at((), monitor.spheres, crystal, "monitor", monitor.layers):
        apart = np.abs(x - x[each])
        apart = np.minimum(apart, width - apart) if shape.along_x else apart
        near |= (np.abs(row_step(row - row[each], shape)) <= 1) & (apart < reach)
    return np.flatnonzero(near)


def check_groups(monitors: Sequence[PlacedMonitor], sources: int) -> None:
    """Raise SceneError if LAMMPS has too few groups for the monitors beside a number of sources."""
    groups = len(monitors) + sum(each.monitor.with_contacts for each in monitors) + sources
    if monitors and groups > MOST_GROUPS:
        raise SceneError(
            f"monitor: {len(monitors)} monitors beside {sources} sources take {groups} groups of LAMMPS, those with "
            f"contacts two each; must be at most {MOST_GROUPS}",
            because="not built",
        )
