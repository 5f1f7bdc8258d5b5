"""Quiet ends: damped rows in front of the held ones, so that no echo comes back (`granular_lmp.crystal.quiet_ends`).

Their drag is no force. LAMMPS computes forces with the velocities of half a step ago, and sets a run up with those of
the whole step: a force of drag errs by first order in the step, and a resumed run begins with another one.
"""

from granular_lmp.effects.effect import Case, Effect, Finding
from granular_lmp.scene.absorption import quiet_end_of
from granular_lmp.scene.scene import Scene

LINES = {
    "quiet": "\n# --- quiet ends: in row n of the <quiet_rows> before a held one velocities decay at the rate\n"
    "#     c = <quiet_strength> (n/<quiet_rows>)^<quiet_power> per t0, by (1 - c step/2)/(1 + c step/2) at the end of\n"
    "#     a step; <quiet_reflection> of the amplitude comes back at this step\n"
    "variable     depth atom round((<quiet_side>-<quiet_from>)/<quiet_row>)\n"
    "variable     deep  atom v_depth>0\n"
    "group        quiet variable deep\n"
    "variable     loss  atom $(<quiet_strength>*v_step/v_t0/2:%.17g)*(v_depth/<quiet_rows>)^<quiet_power>\n"
    "variable     keep  atom (1-v_loss)/(1+v_loss)\n"
    "fix          kept quiet store/state 0 v_keep\n"
    "variable     kept_x atom f_kept*vx\n"
    "variable     kept_y atom f_kept*vy\n"
    "<quiet_turn>fix          drag all set 1 0 group quiet vx v_kept_x vy v_kept_y<quiet_spin>",
}


def called_for(case: Case) -> Finding:
    end = quiet_end_of(case.scene)
    if end is None:
        return Finding(False, 0.0, "rows at each end absorb the wave")
    oblique = "; of waves along y, while oblique ones are not judged" if not case.scene.uniform_rows else ""
    return Finding(True, end.reflection, f"of the amplitude comes back from {end.rows} rows at an end{oblique}")


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
    lines=LINES,
    switch="absorb.rows",
    declared=declared,
    in_all=False,
)
