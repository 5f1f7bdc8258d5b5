"""Walls: the first and the last row are held; without them the cell is periodic and stands for the infinite lattice."""

from granular_lmp.effects.effect import Case, Effect, Finding
from granular_lmp.scene.scene import Scene


def called_for(case: Case) -> Finding:
    if case.scene.shape.ends == "periodic":
        return Finding(False, float(case.scene.shape.rows), "rows in a periodic cell are the infinite lattice")
    return Finding(True, case.scene.echo_time, "tau is when the echo of the held rows reaches the centre")


def loss(case: Case) -> str:
    return "wave numbers other than 2 pi k/rows"


def declared(scene: Scene) -> bool:
    return scene.shape.ends == "fixed"


WALLS = Effect(
    "walls", called_for, cost="rows", loss=loss, lines={"along_y": "f"}, switch="packing.ends", declared=declared
)
