"""Start of a run: the fields of the wave and of the state, in the data file and in the lines that set them.

A state has separate columns in units of the deck, so it does not scale with the amplitude of the wave.
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects import selection
from granular_lmp.effects.freedoms import about, along, axes, turns
from granular_lmp.problem import Problem
from granular_lmp.rest.initial_fields import initial_fields
from granular_lmp.rest.linear import physics_of

STEP = "timestep     $(v_step:%.17g)"
_REFERENCE = "compute      u all displace/atom"
_MOVES = ("u", "v", "s", "sv")  # fields with a component along each axis; the others are angles


def field(problem: Problem) -> str:
    """Return the line that names the columns of the section ``wave`` in the data file; "" if there are none."""
    scene = problem.scene
    if scene.wave is None:
        state = _names(problem, "u", "v", "spin")
        return f"fix          start all property/atom {state}" if scene.start.moves else ""
    names = _names(problem, "u", "phi", "v", "vphi")
    if scene.start.moves and scene.space == 2:
        names += " " + _names(problem, "s", "sv", "sspin")
    return f"fix          wave all property/atom {names}"


def _apart(problem: Problem) -> bool:
    """Return whether the state has its own section, as LAMMPS reads at most 255 characters in a line."""
    return problem.scene.space == 3 and problem.scene.wave is not None and problem.scene.start.moves


def _names(problem: Problem, *fields: str) -> str:
    """Return the columns of fields: "u" means ux, uy and in space uz; "phi" one or three angles if spheres turn."""
    spins = turns(problem) if problem.on["rotation"] else ()
    return " ".join(f"d_{field}{end}" for field in fields for end in (axes(problem) if field in _MOVES else spins))


def read(problem: Problem) -> list[str]:
    """Return the lines that read the data file and the fields in it."""
    names = field(problem)
    fixes = [f" fix {names.split()[1]} NULL wave"] if names else []
    lines = [names] if names else []
    if _apart(problem):
        lines.append(f"fix          state all property/atom {_names(problem, 's', 'sv', 'sspin')}")
        fixes.append(" fix state NULL state")
    return [*lines, f"read_data    ${{data}}{''.join(fixes)}"]


def columns(problem: Problem) -> NDArray[np.float64]:
    """Return the section ``wave``: the wave for unit amplitude, (N, 4 or 6), and then the state, 4 or 5 columns.

    In space the wave has 6 or 12 columns, and the state is in `state`.
    """
    if problem.wave is None:
        return _state(problem)
    fields = initial_fields(problem.scene, problem.rest.atoms, problem.wave)
    for source in problem.sources:
        if source.source.motion:
            fields.displacement[source.spheres] = fields.velocity[source.spheres] = 0.0
    moving = physics_of(problem.scene).coordinates
    # 13 decimals of D0 are finer than a double resolves a position, and turn rounding into 0. The last decimal depends
    # on the cosine of the processor. Minus zeros are avoided
    wave = [part[:, moving].round(13) + 0.0 for part in (fields.displacement, fields.velocity)]
    return np.hstack([*wave, *([] if _apart(problem) else [_state(problem)])])


def state(problem: Problem) -> NDArray[np.float64]:
    """Return the section ``state`` beside a wave in space, (N, 6 or 9); (0, 0) if there is none."""
    return _state(problem) if _apart(problem) else np.empty((0, 0))


def _state(problem: Problem) -> NDArray[np.float64]:
    """Return the columns of the state, (N, 4 or 5) with the spin, in space (N, 6 or 9); (N, 0) without a state."""
    if not problem.scene.start.moves:
        return np.empty((len(problem.rest.atoms), 0))
    units = problem.units
    length, velocity = units.number(1.0, length=1), units.number(1.0, length=1, time=-1)
    state = np.asarray(problem.rest.state * np.repeat([length, velocity, units.number(1.0, time=-1)], 3))
    moves = [*range(9)] if problem.scene.space == 3 else [0, 1, 3, 4, 8]
    return state[:, moves[: None if problem.on["rotation"] else -len(turns(problem))]]


# --- the lines --------------------------------------------------------------------------------------------------------


def _preloads(problem: Problem) -> bool:
    """Return whether contacts are sheared at the start: by a wave, or by a state that displaces spheres."""
    if problem.scene.wave is None:
        return problem.on["shear"] and bool(problem.rest.state[:, :3].any())
    return problem.scene.form.fills or problem.scene.start.moves


def _sum(problem: Problem, of_wave: str, of_state: str) -> str:
    """Return the sum of the fields of the wave and of the state, as far as the scene has them.

    The field of a driven row is left out: it describes its later motion, and a preload would shear contacts at once.
    """
    if not problem.scene.form.fills:
        return of_state
    return of_wave + (f"+{of_state}" if problem.scene.start.moves else "")


def preload(problem: Problem) -> list[str]:
    """Return the lines that move spheres from rest to their initial places, or only measure displacements from rest."""
    return _preload(problem, reference(problem), plane(problem))


def preload_of_meeting(problem: Problem) -> list[str]:
    """Return the same lines for spheres that meet; their plane comes with the motion, which a continued run repeats."""
    return _preload(problem, reference_of_meeting(problem), [])


def _preload(problem: Problem, otherwise: list[str], held: list[str]) -> list[str]:
    if not _preloads(problem):
        return otherwise
    state, wave = problem.scene.start.moves, problem.scene.wave
    ways = {axis: _sum(problem, f"v_D0*d_u{axis}", f"d_{'s' if wave else 'u'}{axis}") for axis in axes(problem)}
    if wave and state:
        ways = {axis: f"({way})" for axis, way in ways.items()}
    return [
        f"# --- preload: one long step without forces, from rest to the {'wave' if wave else 'state'}, loads the shear "
        "springs",
        "timestep     $(1e6*v_step:%.17g)  # so slow that dashpots hardly act",
        _REFERENCE,
        *(f"variable     to_u{axis} atom {way}/dt" for axis, way in ways.items()),
        f"velocity     all set {along(problem, 'to_u', 'NULL')} units box",
        *selection.lines("preload", problem),
        *held,
        "fix          move mobile nve/noforce",
        "thermo_style custom step",
        "run          1 post no",
        "unfix        move",
        "reset_timestep 0",
        STEP,
    ]


def reference(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the lines that measure displacements from rest; LAMMPS finds the places in a checkpoint by the name u."""
    return [_REFERENCE, *plane(problem), STEP]


def reference_of_meeting(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the same lines for spheres that meet; their step is set with the neighbour lists."""
    return ["# --- displacements are measured from the places at rest", _REFERENCE]


def plane(problem: Problem) -> list[str]:
    """Return the line that keeps the spheres in their plane; [] in space."""
    return ["fix          plane all enforce2d"] if problem.scene.space == 2 else []


def kept_field(problem: Problem, checkpoint: str) -> list[str]:
    """Return the line by which LAMMPS finds the field of a driven row in a checkpoint."""
    return [field(problem)] if problem.scene.form.driven else []


def begin(problem: Problem) -> list[str]:
    """Return the lines that set velocities, spins and angles of the wave and of the state."""
    if problem.scene.wave is None:
        return _begun(problem)
    if not _preloads(problem):
        return []
    return [
        "# --- wave: the true velocities",
        *(
            f"variable     v{axis} atom {_sum(problem, f'v_D0*d_v{axis}/v_t0', f'd_sv{axis}')}"
            for axis in axes(problem)
        ),
        f"velocity     all set {along(problem, 'v', 'NULL')} units box",
        *selection.lines("wave", problem),
    ]


def _begun(problem: Problem) -> list[str]:
    """Return the lines that displace and move the spheres of a state."""
    if not problem.scene.start.moves:
        return []
    there, spins = _preloads(problem), [f"spin{end}" for end in turns(problem) if problem.on["rotation"]]
    names = [f"{field}{axis}" for field in ("v" if there else "uv") for axis in axes(problem)] + spins
    return [
        "# --- state at the beginning: displacements from rest and velocities, the section wave of the data file",
        *(f"variable     {name} atom d_{name}" for name in names),
        *([] if there else [f"displace_atoms all move {along(problem, 'u', '0.0')} units box"]),
        f"velocity     all set {along(problem, 'v', '0.0')} units box",
        *([f"set          group all omega {about(problem, 'spin')}"] if spins else []),
    ]
