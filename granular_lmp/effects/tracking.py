"""Tracking: a dipole that turns with each sphere, in space a quaternion, records its angle."""

from math import inf

from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import Effect
from granular_lmp.effects.guard import Prepared
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.sources import TORQUES


def spheres(problem: Prepared) -> list[str]:
    if problem.scene.space == 3 and not any(each.force in TORQUES for each in problem.scene.source):
        return []
    return ["mass         * 1.0  # required by the dipole style but not used, as spheres have their own masses"]


def wave(problem: Prepared) -> list[str]:
    """Return the lines that turn dipoles by the angles of the wave, or quaternions by its rotation vectors."""
    if problem.scene.space == 3:
        return [
            "variable     turn  atom sqrt(d_phix^2+d_phiy^2+d_phiz^2)",
            "variable     unit  atom v_turn+(v_turn==0)",
            *(f"variable     about{axis} atom d_phi{axis}/v_unit" for axis in "xyz"),
            "variable     degrees atom v_D0/v_R*v_turn*180/PI",
            "set          group all quat v_aboutx v_abouty v_aboutz v_degrees  # LAMMPS requires an axis of length 1",
        ]
    return [
        "variable     mx atom cos(v_D0*d_phi/v_R)",
        "variable     my atom sin(v_D0*d_phi/v_R)",
        "set          group all dipole v_mx v_my 0.0",
    ]


def record(problem: Prepared) -> list[str]:
    """Return the lines that measure the angle of the recorded spheres."""
    scene = problem.scene
    seen = "all" if scene.wave is None or scene.output.particles > 0 or scene.monitor else "centre"
    if scene.space == 3:
        return [
            f"compute      turned {seen} property/atom quatw quati quatj quatk",
            *(
                f"variable     theta{axis} atom 2*atan2(c_turned[{part}],c_turned[1])"
                for part, axis in enumerate("xyz", 2)
            ),
        ]
    return [
        f"compute      dipole {seen} property/atom mux muy",
        "variable     theta atom atan2(c_dipole[2],c_dipole[1])",
    ]


def called_for(case: Case) -> Finding:
    if case.scene.wave is None:
        return Finding(case.on["rotation"], inf, "spheres turn")
    angle = case.mode.f * case.scene.displacement_amplitude / case.scene.sphere.radius
    return Finding(case.on["rotation"], abs(angle), "the largest angle of a sphere is {} rad")


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
    "tracking",
    called_for,
    cost="1.03",
    loss=loss,
    needs="rotation",
    lines={"spheres": spheres, "wave": wave, "record": record},
    required=required,
    refuse=refuse,
    recorded=True,
)
