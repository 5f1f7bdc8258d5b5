"""Quiet ends: damped rows before the held rows prevent an echo (`granular_lmp.crystal.quiet_ends`).

Their drag is not a force in LAMMPS, which computes forces with the velocities of half a step ago, but sets up a run
with those of the whole step. A drag force would have an error of first order in the step, and a resumed run would begin
with another force.
"""

from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import Effect
from granular_lmp.effects.freedoms import about, axes, turns
from granular_lmp.effects.guard import Prepared
from granular_lmp.rest.absorption import quiet_end_of, quiet_side
from granular_lmp.rest.linear import uniform_rows
from granular_lmp.rest.scene import Scene


def motion(problem: Prepared) -> list[str]:
    """Return the lines that damp the rows before the held rows."""
    scene, units = problem.scene, problem.units
    end = quiet_end_of(scene)
    assert end is not None  # the effect is on
    row = scene.lattice.row_distance(scene.sphere.lattice_constant)
    inside = (scene.shape.rows - 1 - scene.shape.centre_row - end.rows - 1) * row  # to the last row without damping
    rows, strength, power = end.rows, repr(end.strength), repr(end.power)
    place, first = f"({quiet_side(scene)}-{units.number(inside, length=1)!r})", units.number(row, length=1)
    spins, moved = turns(problem) if problem.on["rotation"] else (), axes(problem)
    one = len(spins) == 1
    spin = [
        f"fix          spin quiet store/state 1 {'omegaz' if one else 'omegax omegay omegaz'}",
        *(f"variable     kept_turn{end} atom f_kept*f_spin{f'[{n}]' * (not one)}" for n, end in enumerate(spins, 1)),
    ]
    return [
        "",
        f"# --- quiet ends: in row n of the {rows} rows before a held row, velocities decay at the rate",
        f"#     c = {strength} (n/{rows})^{power} per t0, by (1 - c step/2)/(1 + c step/2) at the end of",
        f"#     a step; {end.reflection:.1e} of the amplitude is reflected at this step",
        f"variable     depth atom round({place}/{first!r})",
        "variable     deep  atom v_depth>0",
        "group        quiet variable deep",
        f"variable     loss  atom $({strength}*v_step/v_t0/2:%.17g)*(v_depth/{rows})^{power}",
        "variable     keep  atom (1-v_loss)/(1+v_loss)",
        "fix          kept quiet store/state 0 v_keep",
        *(f"variable     kept_{axis} atom f_kept*v{axis}" for axis in moved),
        *(spin if spins else []),
        f"fix          drag all set 1 0 group quiet {' '.join(f'v{axis} v_kept_{axis}' for axis in moved)}"
        + (f" omega {about(problem, 'kept_turn')}" if spins else ""),
    ]


def called_for(case: Case) -> Finding:
    end = quiet_end_of(case.scene)
    if end is None:
        return Finding(False, 0.0, "no rows absorb the wave")
    oblique = " for waves along y; oblique waves are not included" if not uniform_rows(case.scene) else ""
    return Finding(True, end.reflection, f"{{}} of the amplitude is reflected by {end.rows} rows at an end{oblique}")


def loss(case: Case) -> str:
    return "the echo of the walls"


def declared(scene: Scene) -> bool:
    return scene.absorb.rows != 0


QUIET_ENDS = Effect(
    "quiet_ends",
    called_for,
    cost="rows",
    loss=loss,
    needs="walls",
    lines={"motion": motion},
    switch="absorb.rows",
    declared=declared,
    in_all=False,
    recorded=True,
)
