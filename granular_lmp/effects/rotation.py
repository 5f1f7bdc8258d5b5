"""Rotation: spheres turn, because shear forces act at their surface. By symmetry an L wave along y turns none."""

from math import inf

from granular_lmp.crystal.modes import kinetic_parts
from granular_lmp.effects.case import NOTHING, Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect
from granular_lmp.effects.freedoms import about, turns
from granular_lmp.effects.guard import BROKEN_SYMMETRY, ROUNDINGS, Guard, Prepared
from granular_lmp.rest.linear import uniform_rows, wave_contacts


def preload(problem: Prepared) -> list[str]:
    """Return the lines that turn the spheres during the preload of a wave; a state has no angles."""
    if problem.scene.wave is None:
        return []
    return [
        *(f"variable     to_th{axis} atom v_D0*d_phi{axis}/v_R/dt" for axis in turns(problem)),
        f"set          group all omega {about(problem, 'to_th')}",
    ]


def wave(problem: Prepared) -> list[str]:
    """Return the lines that set the initial spins."""
    state = "+d_sspin{axis}" if problem.scene.start.moves else ""
    return [
        *(f"variable     om{axis} atom v_D0*d_vphi{axis}/v_R/v_t0{state.format(axis=axis)}" for axis in turns(problem)),
        f"set          group all omega {about(problem, 'om')}",
    ]


def measured(problem: Prepared) -> list[str]:
    """Return the lines that measure the largest torque."""
    stiffness = problem.units.number(problem.scene.sphere.shear_stiffness, mass=1, time=-2)
    if problem.scene.space == 2:
        columns, inputs, largest = "tqz", "c_torques", "c_turn"
    else:
        columns, inputs = "tqx tqy tqz", "c_torques[1] c_torques[2] c_torques[3]"
        largest = f"sqrt({'+'.join(f'c_turn[{axis}]^2' for axis in (1, 2, 3))})"
    return [
        f"compute      torques all property/atom {columns}",
        f"compute      turn inside reduce maxabs {inputs}",
        f"variable     torque equal {largest}/(v_R*{stiffness!r}*v_D0)  # in R g1 D0",
    ]


GUARD = Guard(
    title="largest_torque",
    name="torque",
    lines=measured,
    limit=BROKEN_SYMMETRY,
    roundings=ROUNDINGS,
    meaning="of R g1 D0 is the largest torque: the spheres would turn",
    cure="set effects.rotation = true",
)


def called_for(case: Case) -> Finding:
    if case.scene.wave is None:
        return Finding(True, inf, case.every_mode)
    moved, spin = kinetic_parts(wave_contacts(case.scene), case.scene.sphere, case.mode)
    share = spin / (moved + spin)
    reason = f"rotation has {{}} of the kinetic energy of {case.wave_words}"
    if case.mode.cell:
        return Finding(True, share, reason + ", and branches are numbered with it")
    if case.every_mode:
        return Finding(True, share, f"{reason}, but {case.every_mode}")
    if "sides" in case.scene.shape.faces:
        return Finding(True, share, f"{reason}, but at sides that are {case.scene.shape.sides} spheres turn")
    if not case.scene.layered:
        return Finding(True, share, reason + ", but every wave turns some spheres if spheres differ or are missing")
    if case.scene.envelope.width > 0:
        return Finding(True, share, reason + ", but at the sides of a beam spheres turn")
    if case.scene.wave.mode == "RT":  # at K along x the wave turns no spheres, but the branch exists only with rotation
        return Finding(True, share, reason)
    mirrored = case.mode.name == "L" and uniform_rows(case.scene)  # Rows normal to the wave keep its mirror symmetry
    undisturbed = case.scene.perfect and case.scene.shape.along_y
    if share <= NOTHING and not (mirrored or undisturbed):
        ends = "held rows" if case.scene.shape.infinite else "ends"
        return Finding(
            True, share, f"{reason}, but the {ends if case.scene.perfect else 'rows that differ'} turn their neighbours"
        )
    return Finding(share > NOTHING, share, reason)


def of_meeting(case: Case) -> Finding:
    turning = case.scene.effects.rotation is not False
    return Finding(turning, inf, "shear forces turn spheres" if turning else "effects.rotation is off")


def loss(case: Case) -> str:
    if case.scene.envelope.width > 0:
        return "the sides of a beam, where spheres turn, are wrong"
    return case.frequency_shift(case.physics(case.on.get("shear", True), rotation=False))


ROTATION = Effect(
    "rotation",
    called_for,
    cost="1.02",
    loss=loss,
    meeting=AmongMeeting(of_meeting),
    needs="shear",
    lines={"preload": preload, "wave": wave},
    guards=(GUARD,),
    recorded=True,
)
