"""The start of a run: the fields of the wave and of the state, in the data file and in the lines that set them.

A state is in columns of its own, in the units of the deck, so that it does not scale with the amplitude of the wave.
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects import selection
from granular_lmp.problem import Problem
from granular_lmp.scene.initial_fields import initial_fields

STEP = "timestep     $(v_step:%.17g)"


def field(problem: Problem) -> str:
    """Return the line that names the columns of the section ``wave`` of the data file."""
    turns, state = problem.on["rotation"], problem.scene.start.moves
    names = ["d_ux", "d_uy", *["d_phi"] * turns, "d_vx", "d_vy", *["d_vphi"] * turns]
    if state:
        names += ["d_sx", "d_sy", "d_svx", "d_svy", *["d_sspin"] * turns]
    return f"fix          wave all property/atom {' '.join(names)}"


def columns(problem: Problem) -> NDArray[np.float64]:
    """Return the section ``wave``, (N, 4 or 6): the wave for unit amplitude; behind it the state, 4 or 5 columns."""
    fields = initial_fields(problem.scene, problem.crystal, problem.mode)
    for source in problem.sources:
        if source.source.motion:
            fields.displacement[source.spheres] = fields.velocity[source.spheres] = 0.0
    moving = problem.physics.coordinates
    # 13 decimals of D0 are finer than a double resolves a position, and turn rounding into 0. The last decimal depends
    # on the processor's cosine. No minus zeros
    wave = [part[:, moving].round(13) + 0.0 for part in (fields.displacement, fields.velocity)]
    return np.hstack([*wave, _state(problem)])


def _state(problem: Problem) -> NDArray[np.float64]:
    """Return the columns of the state, (N, 4 or 5) with the spin; (N, 0) without a state."""
    if not problem.scene.start.moves:
        return np.empty((len(problem.crystal), 0))
    units = problem.units
    length, velocity = units.number(1.0, length=1), units.number(1.0, length=1, time=-1)
    factors = np.array([length, length, velocity, velocity, units.number(1.0, time=-1)])
    return np.asarray(problem.state * factors)[:, : 5 if problem.on["rotation"] else 4]


def _moves(problem: Problem) -> bool:
    """Return whether spheres begin displaced or with velocities, other than those of strikers."""
    return problem.scene.start.moves or problem.scene.wave.form in ("running", "standing")


def preload(problem: Problem) -> list[str]:
    """Return the lines that move the spheres from rest to their places, or that count displacements from rest."""
    if not _moves(problem):
        return reference(problem)
    state = problem.scene.start.moves
    ux, uy = ("(v_D0*d_ux+d_sx)", "(v_D0*d_uy+d_sy)") if state else ("v_D0*d_ux", "v_D0*d_uy")
    return [
        "# --- preload: LAMMPS starts every contact without shear, so the spheres are moved from rest to the wave in "
        "one",
        "#     step without forces, which loads the shear springs; a long step, slow enough for negligible forces of "
        "dashpots",
        "variable     slow  equal 1e6*v_step",
        "timestep     $(v_slow:%.17g)",
        "compute      u all displace/atom",
        f"variable     to_ux atom {ux}/v_slow",
        f"variable     to_uy atom {uy}/v_slow",
        "velocity     all set v_to_ux v_to_uy NULL units box",
        *selection.lines("preload", problem),
        "fix          plane all enforce2d",
        "fix          move mobile nve/noforce",
        "thermo_style custom step",
        "run          1 post no",
        "unfix        move",
        "reset_timestep 0",
        STEP,
    ]


def reference(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the lines that count displacements from rest: LAMMPS finds the places of a checkpoint by the name u."""
    return ["compute      u all displace/atom", "fix          plane all enforce2d", STEP]


def kept_field(problem: Problem, checkpoint: str) -> list[str]:
    """Return the line by which LAMMPS finds the field of a driven row in a checkpoint."""
    return [field(problem)] if problem.scene.wave.form == "driven" else []


def wave(problem: Problem) -> list[str]:
    """Return the lines of the true velocities, spins and angles."""
    if not _moves(problem):
        return []
    vx, vy = ("+d_svx", "+d_svy") if problem.scene.start.moves else ("", "")
    return [
        "# --- wave: the true velocities",
        f"variable     vx atom v_D0*d_vx/v_t0{vx}",
        f"variable     vy atom v_D0*d_vy/v_t0{vy}",
        "velocity     all set v_vx v_vy NULL units box",
        *selection.lines("wave", problem),
    ]
