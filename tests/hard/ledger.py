"""The energy ledger of LAMMPS's spheres, contact by contact: `tests.theory.energy` is that of the lattice.

In units of k1Δ0², with the overlap d in Δ0, the shear force S in k1Δ0 and the slip s = S/(κ√d) of each contact,

    E = Σ_spheres (κ+3)(p'² + q'² + Ĩφ'²) + Σ_contacts [(4/15)(d^{5/2} − 1) − (2/3)(d − 1)] + ½κ√d s²
    W = Σ ∫ ½ s² d(κ√d) + Σ ∫ η d S (φ'_i + φ'_j) dτ

E is zero at rest and E − W is kept. The first work is the secant law's own: whoever changes the stiffness of a sheared
spring changes its energy. The second is LAMMPS's: its torque has the lever arm R − δ/2, its slip the arm R.

The first is summed as a Stieltjes integral by the trapezoidal rule from step to step: it has no singularity where a
contact opens (√d has one, d(√d) none). A contact that is gone at the next step gives up its whole shear energy, which
is `released`: the same integral, down to d = 0 at a slip that nobody measured again.

Breaks when contacts slide: friction takes energy that is not in the ledger. `sliding` is what to look at.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granular_lmp import build
from granular_lmp.crystal.sphere import INERTIA_RATIO
from tests.hard.cell import Cell, Floats


@dataclass(frozen=True)
class Ledger:
    """Energies of a cell over time, all (T,).

    tau; energy and work, E and W without `released`, what detaching contacts gave up; contacts, how many touch;
    sliding, the largest share of the sliding force that the shear of a contact has reached since τ = 0.
    """

    tau: Floats
    energy: Floats
    work: Floats
    released: Floats
    contacts: Floats
    sliding: Floats

    @property
    def gap(self) -> Floats:
        """(E − W − E(0))/E(0), (T,)."""
        return (self.energy - self.work - self.released) / self.energy[0] - 1


@dataclass(frozen=True)
class _Look:
    """Quantities of one step in the ledger; root √d and slip² s² (pairs,) are zero where there is no contact."""

    energy: float
    lever: float
    root: Floats
    slip2: Floats
    contacts: int
    sliding: float


def _look(cell: Cell, near: NDArray[np.intp], friction: float) -> _Look:
    """The terms of the module docstring, of the pairs (i·N + j) that are near."""
    sphere, contacts = cell.scene.sphere, cell.contacts()
    kappa, eta, d = sphere.stiffness_ratio, sphere.overlap_ratio, contacts.overlap
    velocity = cell.velocity()
    root, slip2 = np.zeros(len(near)), np.zeros(len(near))
    pair = np.searchsorted(near, contacts.spheres @ [cell.spheres, 1])
    root[pair] = np.sqrt(d)
    slip2[pair] = (contacts.shear / (kappa * root[pair])) ** 2
    kinetic = (kappa + 3) * np.einsum("cn,cn,c", velocity, velocity, [1, 1, INERTIA_RATIO])
    normal = ((4 / 15) * (d**2.5 - 1) - (2 / 3) * (d - 1)).sum() + 0.4 * (len(near) - len(d))  # 2/5: open, d = 0
    return _Look(
        energy=float(kinetic + normal + 0.5 * kappa * root @ slip2),
        lever=float(eta * (d * contacts.shear) @ velocity[2][contacts.spheres].sum(axis=1)),
        root=root,
        slip2=slip2,
        contacts=len(d),
        # F_crit = μ(F_N + 2F) of LAMMPS's DMT model, F = (2/3)k1Δ0
        sliding=float(np.max(np.abs(contacts.shear) / (friction * (2 / 3) * (1 + d**1.5)), initial=0.0)),
    )


def keep(cell: Cell, tau: float, every: int, stride: int = 1, look: Callable[[], object] = lambda: None) -> Ledger:
    """Run to τ = tau with the ledger; W is summed each `stride` steps, and the record made each `every` strides.

    `look` is called with each record but the first, for those who want to see more of the cell.
    """
    kappa, step = cell.scene.sphere.stiffness_ratio, cell.scene.time.step * stride
    distances = build(cell.scene).packing.get_all_distances(mic=True)
    near = np.flatnonzero(np.triu(distances < 2, k=1))  # pairs that touch at rest: no others ever come near
    friction = float(cell.instance.extract_variable("friction"))  # the deck's own, whatever the scene says
    before = _look(cell, near, friction)
    work, released, sliding = 0.0, 0.0, before.sliding
    record = [(0.0, before.energy, 0.0, 0.0, before.contacts, sliding)]
    for count in range(1, round(tau / step) + 1):
        cell.advance(stride)
        now = _look(cell, near, friction)
        opened = (before.root > 0) & (now.root == 0)
        change = 0.25 * kappa * (now.root - before.root) * (before.slip2 + now.slip2)
        work += float(change[~opened].sum()) + 0.5 * step * (before.lever + now.lever)
        released -= 0.5 * kappa * float(before.root[opened] @ before.slip2[opened])
        sliding, before = max(sliding, now.sliding), now
        if count % every == 0:
            record.append((count * step, now.energy, work, released, now.contacts, sliding))
            look()
    return Ledger(*np.array(record).T)
