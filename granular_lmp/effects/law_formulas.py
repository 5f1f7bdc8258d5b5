"""Guards take what they need of each adhesion law from here, as formulas and words of LAMMPS.

A JKR contact holds beyond an overlap of 0. LAMMPS's ``contact/atom`` and the cutoff ``radius`` of its local computes do
not know it there; with the cutoff ``type`` they list every pair up to the largest pull-off distance, with forces and
components ``p`` of 0 where LAMMPS has no contact.
"""

from typing import Protocol

from granular_lmp.crystal.sphere import Sphere
from granular_lmp.frozen import dataclass


class Formulas(Protocol):
    """Formulas of one law, with the numbers of a sphere of the lattice at rest.

    Attributes
    ----------
    holding_force : float
        F + F0 in units of the deck.
    cutoff : str
        Cutoff with which local computes list all contacts.
    """

    @property
    def holding_force(self) -> float: ...
    @property
    def cutoff(self) -> str: ...

    @staticmethod
    def mark(axes: int) -> str:
        """Return further columns of such a compute, which tell contacts from other pairs; "" if it lists no others."""

    def above_pull_off(self, x: str) -> str:
        """Return f_N + F of two equal spheres of the overlap x, in Δ0, or a lower bound of it, in units of the deck."""

    def overlap(self, u: str) -> str:
        """Return the overlap, in Δ0, of two spheres of the lattice whose f_N + F is the share u of that at rest."""


@dataclass(frozen=True)
class DmtFormulas:
    """f_N + F = (F + F0) x^{3/2}; `holding_force` is F + F0 in units of the deck."""

    sphere: Sphere
    holding_force: float
    cutoff: str = "radius"

    @staticmethod
    def mark(axes: int) -> str:
        return ""

    def above_pull_off(self, x: str) -> str:
        return f"{self.holding_force!r}*{x}^1.5"

    def overlap(self, u: str) -> str:
        return f"{u}^(2/3)"


@dataclass(frozen=True)
class JkrFormulas:
    """A contact holds to `hold` Δ0 beyond its end.

    The parabola touches zero where f_N + F does and is below it for all overlaps up to that at rest
    (tests/theory/test_adhesion_laws.py).
    """

    sphere: Sphere
    holding_force: float
    cutoff: str = "type"

    @staticmethod
    def mark(axes: int) -> str:
        return "".join(f" p{10 + axis}" for axis in range(axes))

    def above_pull_off(self, x: str) -> str:
        hold = self.sphere.pull_off_distance / self.sphere.static_overlap
        return f"{self.holding_force!r}*(({x}+{hold!r})/(1+{hold!r}))^2"

    def overlap(self, u: str) -> str:
        sphere = self.sphere
        pressed = sphere.holding_force / sphere.pull_off_force
        y = f"(0.5+0.5*sqrt({u}*{pressed!r}))"  # y of granular_lmp.crystal.adhesion_laws
        return f"{sphere.unpressed_overlap / sphere.static_overlap!r}*{y}^(1/3)*(3*{y}-2)"


FORMULAS: dict[str, type[DmtFormulas] | type[JkrFormulas]] = {"dmt": DmtFormulas, "jkr": JkrFormulas}
