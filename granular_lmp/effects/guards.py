"""Guards: what a run measures to prove that the effects left out of its deck stayed silent.

Each is a thermo column of the run: lines of the deck that compute it, from what a contact or a sphere has anyway, and
the largest value that still counts as silence. A guard is in the deck only while its effect is not.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.rounding import farthest_rounding
from granular_lmp.scene.scene import Scene

INTERVAL = 50  # steps between two looks, a few percent of the time
LONGEST = 10.0  # τ between two looks; a wave takes all its phases somewhere in the crystal at any time

# What a symmetry forbids stays at rounding: half of that of the farthest position (spread), 25 times that (torque). For
# a = 0.2 and 201 rows that is 2e-10 D0. A millionth of the wave is no rounding, and harms nothing yet.
BROKEN_SYMMETRY = 1e-6
ROUNDINGS = 100.0

_OVERLAP = (
    "compute      gap all pair/local dist",
    "compute      widest all reduce max c_gap inputs local",
    "variable     overlap equal (2*v_R-c_widest)/v_Delta0  # the smallest, in Delta0, of the contacts that touch",
)


@dataclass(frozen=True)
class Guard:
    """One measure.

    Attributes
    ----------
    columns : names of the thermo columns; the first is the one that is judged.
    lines : of the deck; ``<name>`` stands for a number of the scene.
    limit : the largest value of silence.
    roundings : how many times the rounding of positions (`farthest_rounding`) counts as silence besides.
    meaning : what a larger value says.
    """

    columns: tuple[str, ...]
    lines: tuple[str, ...]
    limit: float
    meaning: str
    roundings: float = 0.0

    def largest_silent(self, scene: Scene) -> float:
        """The largest value that counts as silence in a scene."""
        return self.limit + self.roundings * farthest_rounding(scene)

    def woken(self, table: dict[str, NDArray[np.float64]], scene: Scene) -> int | None:
        """Index of the first thermo line that is not silent; None if all are. What is not finite is not silent."""
        (loud,) = np.nonzero(~(np.abs(table.get(self.columns[0], np.empty(0))) <= self.largest_silent(scene)))
        return int(loud[0]) if len(loud) else None


GUARDS = {
    "open_contacts": Guard(
        columns=("v_open", "v_overlap"),
        lines=(
            *_OVERLAP,
            "compute      total all reduce sum c_gap inputs local",
            "compute      mean all reduce ave c_gap inputs local",
            "variable     open equal <contacts>-round(c_total/(c_mean+(c_mean==0)))  # contacts opened since the start",
        ),
        limit=0.0,
        meaning="contacts opened: no closed form holds, and shear forces are lost",
    ),
    "largest_slip": Guard(
        columns=("v_slip",),
        lines=(
            *_OVERLAP,
            "compute      shear all pair/local p4",
            "compute      hardest all reduce max c_shear inputs local",
            "# over the sliding force of the contact that touches least: never less than the truth",
            "variable     slip equal c_hardest/(<friction_limit>*(<adhesive_force>+<holding_force>*v_overlap^1.5))",
        ),
        limit=1.0,
        meaning="of the sliding force: contacts may have slid, which the model does not",
    ),
    "largest_torque": Guard(
        columns=("v_torque",),
        lines=(
            "compute      torques all property/atom tqz",
            "compute      turn all reduce maxabs c_torques",
            "variable     torque equal c_turn/(v_R*<shear_stiffness>*v_D0)  # in R g1 D0",
        ),
        limit=BROKEN_SYMMETRY,
        roundings=ROUNDINGS,
        meaning="of R g1 D0 is the largest torque: the spheres would turn",
    ),
    "row_spread": Guard(
        columns=("v_spread",),
        lines=(
            "group        row id <centre_row>",
            "compute      most  row reduce max c_u[1] c_u[2]",
            "compute      least row reduce min c_u[1] c_u[2]",
            "variable     spread equal (c_most[1]-c_least[1]+c_most[2]-c_least[2])/v_D0  # in the centre row",
        ),
        limit=BROKEN_SYMMETRY,
        roundings=ROUNDINGS,
        meaning="D0 are between spheres of the centre row: the wave is no longer plane, and needs more packing.columns",
    ),
}


def interval(step: float) -> int:
    """Steps between two looks for a step in τ."""
    return max(1, min(INTERVAL, round(LONGEST / step)))


def lines(names: list[str], step: float) -> list[str]:
    """The lines of some guards, each once, and the thermo output of all; step in τ."""
    texts = list(dict.fromkeys(line for name in names for line in GUARDS[name].lines))
    columns = list(dict.fromkeys(column for name in names for column in GUARDS[name].columns))
    style = " ".join(["thermo_style custom step v_tau", *columns])
    return [
        *texts,
        style,
        "thermo_modify flush yes  # a killed run has heard them too",
        f"thermo       {interval(step)}",
    ]
