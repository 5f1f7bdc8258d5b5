"""One guard: a number that LAMMPS measures to prove that an effect left out of a deck stayed silent.

Each is defined in the file of its effect. `granular_lmp.lammps.guards` writes them into the deck and judges what they
measured.
"""

from dataclasses import dataclass
from math import cos, pi

from granular_lmp.scene.resolution import farthest_rounding
from granular_lmp.scene.scene import Scene

LOOKS = 40  # looks in a period of the fastest motion that matters
BETWEEN = 1 - cos(pi / LOOKS)  # of the swing of a motion: how far it may go beyond what two looks see, 0.31 %
TOP = 1.0  # rad/tau, top of the branches that carry displacements: L and TR at the edge of the zone
NEVER = 1e20  # tau at which a limit was passed that was not; what LAMMPS takes for the minimum of nothing

# What a symmetry forbids stays at rounding: half of that of the farthest position (spread), 25 times that (torque). For
# a = 0.2 and 201 rows that is 2e-10 D0. A millionth of the wave is no rounding, and harms nothing yet.
BROKEN_SYMMETRY = 1e-6
ROUNDINGS = 100.0

# The contacts at a look, for guards that judge contacts
CONTACT = (
    "compute      contact inside pair/local dist p4",
    "compute      extreme inside reduce max c_contact[1] c_contact[2] inputs local",
    "variable     overlap_now equal (2*v_R-c_extreme[1])/v_Delta0  # the smallest, in Delta0, of contacts that touch",
)


@dataclass(frozen=True)
class Guard:
    """One measure.

    Attributes
    ----------
    title : str
        Its name in ``run.json``.
    name : str
        Variables of the deck begin with it: NAME_now at a look, NAME the largest since the last line of the
        table, NAME_at the first time (tau) at which it was above the limit, `NEVER` if it was not.
    lines : tuple of str
        Lines of the deck that give NAME_now; ``<name>`` stands for a number of the scene.
    limit : float
        The largest value of silence.
    meaning : str
        What a larger value says.
    cure : str
        What to do about it.
    roundings : float
        How many times the rounding of positions (`farthest_rounding`) counts as silence besides.
    per_contact : bool
        Whether NAME is only an upper bound, and contacts are written out while it is above the limit.
    """

    title: str
    name: str
    lines: tuple[str, ...]
    limit: float
    meaning: str
    cure: str
    roundings: float = 0.0
    per_contact: bool = False

    @property
    def column(self) -> str:
        """Name of the thermo column of the extreme."""
        return f"v_{self.name}"

    def largest_silent(self, scene: Scene) -> float:
        """Return the largest value that counts as silence in a scene."""
        return self.limit + self.roundings * farthest_rounding(scene)
