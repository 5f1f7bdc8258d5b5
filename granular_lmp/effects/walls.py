"""Walls: rows or columns at the faces are held, or touch a rigid plane.

A periodic cell has none, and stands for the infinite lattice.
"""

from math import inf

from granular_lmp.crystal.lattices import HELD, WALL
from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect
from granular_lmp.rest.scene import Scene


def of_meeting(case: Case) -> Finding:
    faces = case.scene.shape.faces
    closed = [name for name, face in faces.items() if face in (HELD, WALL)]
    if closed:
        return Finding(True, inf, f"held or rigid: {', '.join(closed)}")
    return Finding(False, inf, "all ends are free" if faces else "the packing is periodic and has no ends")


def called_for(case: Case) -> Finding:
    shape = case.scene.shape
    if case.scene.wave is None:
        return of_meeting(case)
    if not shape.faces or not shape.lattice.sheet and shape.along_y:
        return Finding(False, float(shape.rows), "{} rows in a periodic cell are the infinite lattice")
    if not {HELD, WALL} & {*shape.faces.values()}:
        return Finding(False, case.scene.echo_time, "the echo of the free faces reaches the centre at tau = {}")
    what = "faces" if not shape.infinite else "held rows"
    if case.scene.echo_time == inf:
        return Finding(True, inf, f"no echo of the {what} reaches the centre")
    return Finding(True, case.scene.echo_time, f"the echo of the {what} reaches the centre at tau = {{}}")


def loss(case: Case) -> str:
    return "wave numbers other than 2 pi k/rows"


def declared(scene: Scene) -> bool:
    return bool({HELD, WALL} & {*scene.shape.faces.values()})


WALLS = Effect(
    "walls",
    called_for,
    cost="rows",
    loss=loss,
    meeting=AmongMeeting(of_meeting),
    switch="packing.ends",
    declared=declared,
    recorded=True,
)
