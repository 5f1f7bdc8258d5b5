"""A deck at work, step by step: the state of every sphere and contact, which the run folder does not keep.

The text is that of `granular_lmp.build`, without the final ``run``, guards and dumps. Displacements are p = uy,
q = −ux, φ = Rθ in units of Δ0, velocities in Δ0/t0, forces in k1Δ0: the units of `granular_analysis.theory.lattice`.
"""

from collections.abc import Iterator
from contextlib import chdir, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp import Scene, build
from granular_lmp.effects.selection import with_all
from granular_lmp.units import units_for
from tests.hard.case import Edits
from tests.instance import silent_lammps

Floats = NDArray[np.float64]
LAST = "run ${steps}\n"
PER_CONTACT = """
thermo_style custom step
undump centre
compute shears   all pair/local dist p1 p2 dx dy cutoff radius
compute pairs    all property/local patom1 patom2 cutoff radius
run 0 post no
"""


@dataclass(frozen=True)
class Contacts:
    """Contacts that touch: spheres (C, 2) counted from 0, pairs ascending; overlap (C,) and shear force (C,).

    The shear force has the sign of the torque that it exerts on both spheres, turned round: n × f of one sphere, with n
    from the other to it.
    """

    spheres: NDArray[np.intp]
    overlap: Floats
    shear: Floats


class Cell:
    """A running LAMMPS instance of a scene; made by `running`."""

    def __init__(self, scene: Scene, instance: Any) -> None:
        sphere = scene.sphere
        units = units_for(sphere.radius)
        self.scene = scene
        self.instance = instance
        self.spheres = scene.shape.rows * scene.shape.columns
        self.radius = units.number(sphere.radius, length=1)
        self.overlap = units.number(sphere.static_overlap, length=1)
        self.time = units.number(sphere.time_scale, time=1)
        self.force = units.number(sphere.normal_stiffness * sphere.static_overlap, mass=1, length=1, time=-2)

    def advance(self, steps: int = 1) -> None:
        """Run on without looking at anything again, so that the chunks of a run add up to the same bytes."""
        self.instance.command(f"run {steps} pre no post no")

    def _by_id(self, *values: Floats) -> Floats:
        """Components x, y, z (values, N, 3) of quantities of LAMMPS's spheres, in the order of the packing."""
        sorted_ones = np.full((len(values), self.spheres, 3), np.nan)  # a lost sphere keeps nan
        local = self.instance.extract_global("nlocal")
        ids = self.instance.numpy.extract_atom("id")[:local] - 1
        for each, unsorted in zip(sorted_ones, values, strict=True):
            each[ids] = unsorted[:local, :3]
        return sorted_ones

    def displacement(self) -> Floats:
        """p, q, φ (3, N), spheres in the order of the packing."""
        here = self.instance.numpy
        moved, dipole = self._by_id(here.extract_compute("u", 1, 2), here.extract_atom("mu"))
        turned = np.arctan2(dipole[:, 1], dipole[:, 0]) * self.radius
        return np.stack([moved[:, 1], -moved[:, 0], turned]) / self.overlap

    def velocity(self) -> Floats:
        """p', q', φ' (3, N)."""
        here = self.instance.numpy
        v, omega = self._by_id(here.extract_atom("v"), here.extract_atom("omega"))
        return np.stack([v[:, 1], -v[:, 0], omega[:, 2] * self.radius]) * (self.time / self.overlap)

    def rows(self) -> Floats:
        """p, q, φ, p', q', φ' (6, rows), the mean of each row's spheres."""
        state = np.concatenate([self.displacement(), self.velocity()])
        return state.reshape(6, self.scene.shape.rows, -1).mean(axis=-1)

    def follow(self, tau: Floats) -> Floats:
        """The states `rows` (T, 6, rows) at the times tau (T,), the first of which is now."""
        states = [self.rows()]
        for interval in np.diff(tau):
            self.advance(round(interval / self.scene.time.step))
            states.append(self.rows())
        return np.array(states)

    def reverse(self) -> None:
        """Turn every velocity round."""
        local = self.instance.extract_global("nlocal")
        for name in ("v", "omega"):
            values = self.instance.numpy.extract_atom(name)[:local]
            values *= -1

    def kick(self, rates: Floats) -> None:
        """Add q', φ' (2, rows), in Δ0/t0, to the velocities of each row's spheres."""
        local = self.instance.extract_global("nlocal")
        row = (self.instance.numpy.extract_atom("id")[:local] - 1) // self.scene.shape.columns
        q_rate, phi_rate = rates[:, row] * (self.overlap / self.time)
        self.instance.numpy.extract_atom("v")[:local, 0] -= q_rate
        self.instance.numpy.extract_atom("omega")[:local, 2] += phi_rate / self.radius

    def contacts(self) -> Contacts:
        """The contacts of this step."""
        spheres = np.sort(self.instance.numpy.extract_compute("pairs", 2, 2).astype(np.intp), axis=1) - 1
        distance, force_x, force_y, x, y = self.instance.numpy.extract_compute("shears", 2, 2).T
        shear = (x * force_y - y * force_x) / distance
        return Contacts(spheres, (2 * self.radius - distance) / self.overlap, shear / self.force)


def edited(text: str, edits: Edits) -> str:
    """A deck with pieces replaced, each of which must be there once: a deck that is not broken tests nothing."""
    for old, new in edits:
        if text.count(old) != 1:
            raise ValueError(f"{old!r} is {text.count(old)} times in the deck, not once")
        text = text.replace(old, new)
    return text


@contextmanager
def running(scene: Scene, edits: Edits = ()) -> Iterator[Cell]:
    """The cell of a scene at τ = 0, with pieces of its deck replaced; the step is ``scene.time.step``."""
    deck = build(with_all(scene))  # angles and spins are looked at in L waves too
    text = edited(deck.input_text, ((LAST, PER_CONTACT), *edits))
    with TemporaryDirectory() as folder, chdir(folder):
        Path(deck.data_name).write_text("".join(deck.files()[deck.data_name]), encoding="utf-8")
        with silent_lammps() as instance:
            instance.commands_string(text)
            yield Cell(scene, instance)
