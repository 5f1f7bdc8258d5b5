"""Late parting: a JKR contact holds up to the largest distance instead of the largest pull.

In y of `granular_lmp.crystal.adhesion_laws.Jkr` the overlap at the end is δ0 y^{1/3} (3y − 2) with

    y = 1/6   at a given distance, −9·6^{−4/3} δ0: bodies that separate lose 7.09 (w⁵Rc⁴/E*²)^{1/3}
    y = 1/2   under a given load, −2^{−4/3} δ0, where LAMMPS ends it: they lose 3.50

LAMMPS has only the second; the first needs the kernel. A scene must declare it, as no wave requires it.

Sources: as of `cases.pull_off.jkr`.
"""

from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect, LawPart
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.sections import DISTANCE

_SHARE = 0.4939  # 3.5026/7.0922


def finding(case: Case) -> Finding:
    if not case.scene.material.contact_law.late:
        return Finding(False, 0.0, "contacts of this law end at overlap 0")
    return Finding(
        False, _SHARE, "a contact that ends at the largest pull loses {} of the energy that it loses in JKR theory"
    )


def declared(scene: Scene) -> bool:
    return scene.effects.parting == DISTANCE


def law(scene: Scene, on: bool) -> LawPart:
    return {"late_parting": True} if on else {}


def loss(case: Case) -> str:
    return "nothing"


def refuse(case: Case) -> str:
    if not case.on["late_parting"]:
        return ""
    if case.contacts.on_wall.any():
        return f'effects.parting = "{DISTANCE}": must be "load" beside walls and substrates, which the kernel lacks'
    if resisted := [name for name in ("rolling", "twisting") if case.on[name]]:
        return f'effects.parting = "{DISTANCE}": must be "load" with effects.{resisted[0]}, which the kernel lacks'
    if not case.scene.perfect:
        return f'effects.parting = "{DISTANCE}": is not built for unequal or missing spheres; must be "load"'
    return ""


LATE_PARTING = Effect(
    "late_parting",
    finding,
    meeting=AmongMeeting(finding),
    cost="1.00",
    loss=loss,
    law=law,
    refuse=refuse,
    in_all=False,
    switch="effects.parting",
    declared=declared,
)
