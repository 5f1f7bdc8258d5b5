"""Quiet ends: damped rows in front of the held ones, so that no echo comes back (`granular_lmp.crystal.quiet_ends`)."""

from granular_lmp.effects.effect import Case, Effect, Finding
from granular_lmp.scene.absorption import quiet_end_of
from granular_lmp.scene.scene import Scene

LINES = {
    "quiet": "\n# --- quiet ends: the <quiet_rows> rows before a held one are damped, F = -c m v and T = -c I omega\n"
    "#     with c = <quiet_strength> (depth)^<quiet_power> per t0; <quiet_reflection> of the amplitude comes back\n"
    "variable     depth atom (<quiet_side>-<quiet_from>)/<quiet_thickness>\n"
    "variable     deep  atom v_depth>0\n"
    "group        quiet variable deep\n"
    "variable     rate  atom <quiet_strength>*abs(v_depth)^<quiet_power>/v_t0\n"
    "variable     drag_x atom -v_rate*mass*vx\n"
    "variable     drag_y atom -v_rate*mass*vy\n"
    "fix          drag quiet addforce v_drag_x v_drag_y 0.0",
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
