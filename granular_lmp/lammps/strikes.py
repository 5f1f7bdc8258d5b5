"""The lines of a deck that strike spheres: the velocities of strikers, and a state beside the wave.

A state is in columns of its own in the section ``wave`` of the data file, in the units of the deck, so that neither it
nor a striker scales with the amplitude of the wave.
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.lammps.datafile import id_ranges
from granular_lmp.problem import Problem
from granular_lmp.units import Units

# Slots of a deck whose spheres begin in a state: beside the displacements, velocities and spins of the wave
STATE = {
    "state_field": " d_sx d_sy d_svx d_svy",
    "to_ux": "(v_D0*d_ux+d_sx)",
    "to_uy": "(v_D0*d_uy+d_sy)",
    "state_vx": "+d_svx",
    "state_vy": "+d_svy",
}
NO_STATE = dict.fromkeys(("state_field", "state_vx", "state_vy", "state_spin"), "") | {
    "to_ux": "v_D0*d_ux",
    "to_uy": "v_D0*d_uy",
}
TURNS = {"state_field": f"{STATE['state_field']} d_sspin", "state_spin": "+d_sspin"}


def slots(problem: Problem) -> dict[str, str]:
    """Return the slots of the state, and the lines of the strikers without their numbers."""
    if not problem.scene.start.state:
        return NO_STATE
    return NO_STATE | STATE | (TURNS if problem.on["rotation"] else {})


def state_columns(problem: Problem, units: Units) -> NDArray[np.float64]:
    """Return the columns of the state in the data file, (N, 4 or 5) with the spin; (N, 0) without a state."""
    if not problem.scene.start.state:
        return np.empty((len(problem.crystal), 0))
    length, velocity = units.number(1.0, length=1), units.number(1.0, length=1, time=-1)
    factors = np.array([length, length, velocity, velocity, units.number(1.0, time=-1)])
    return np.asarray(problem.state * factors)[:, : 5 if problem.on["rotation"] else 4]


def lines(problem: Problem, units: Units) -> str:
    """Return the block that gives strikers their velocities, in addition to that of the wave; "" without any.

    One group after the other is made, as LAMMPS has 32 at most.
    """
    text = ["# --- strikers: velocities in addition to that of the wave"]
    for striker, spheres in zip(problem.scene.striker, problem.strikers, strict=True):
        vx, vy = (units.number(each, length=1, time=-1) for each in striker.components)
        text += [
            f"group        striker id {id_ranges(spheres)}",
            f"velocity     striker set {vx!r} {vy!r} NULL sum yes units box",
            "group        striker delete",
        ]
    return "\n".join(text) if problem.strikers else ""
