"""Tracking: the angle of each sphere is recorded, by a dipole that turns with it."""

from granular_lmp.effects.effect import Case, Effect, Finding
from granular_lmp.scene.scene import Scene

LINES = {
    "motion": "nve/sphere update dipole",
    "atom_style": "hybrid sphere dipole",
    "mass": "mass         * 1.0  # asked for by the dipole style, not used: spheres have their own",
    "start_angle": "variable     mx atom cos(v_D0*d_phi/v_R)\n"
    "variable     my atom sin(v_D0*d_phi/v_R)\n"
    "set          group all dipole v_mx v_my v_zero",
    "read_angle": "compute      dipole <seen> property/atom mux muy\n"
    "variable     theta atom atan2(c_dipole[2],c_dipole[1])",
    "angle_column": " v_theta",
    "angle_name": " colname v_theta theta",
}


def called_for(case: Case) -> Finding:
    angle = case.mode.f * case.scene.displacement_amplitude / case.scene.sphere.radius
    return Finding(case.on["rotation"], abs(angle), "rad is the largest angle of a sphere")


def loss(case: Case) -> str:
    return "the angle is not in the record"


def required(scene: Scene) -> str:
    turned = [(number, each) for number, each in enumerate(scene.source, 1) if each.turns]
    if not turned:
        return ""
    number, source = turned[0]
    return (
        f'source {number}: {"motion" if source.motion else "force"} = "{source.turns}": turns the dipole that tracks '
        "the angle"
    )


def refuse(case: Case) -> str:
    needed = required(case.scene)
    return f"{needed}, and needs effects.rotation, which is off" if needed and not case.on["tracking"] else ""


TRACKING = Effect(
    "tracking", called_for, cost="1.03", loss=loss, needs="rotation", lines=LINES, required=required, refuse=refuse
)
