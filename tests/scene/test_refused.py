"""Scenes that cannot be are refused in one line that names the key, the value and what is allowed: `refused.txt`."""

import re
from pathlib import Path
from typing import Any

import pytest

from granular_lmp import Scene, prepare
from granular_lmp.errors import CrystalError, SceneError
from granular_lmp.rest.scene import assignment
from tests.conftest import PAPER
from tests.crystal.test_lattices import scene_of
from tests.crystal.test_quiet_ends import DRIVEN
from tests.crystal.test_rolling import CELL
from tests.crystal.test_stiffnesses import BASE
from tests.lammps.test_monitors import SHEET as WATCHED
from tests.scene.test_faces import SHAKEN
from tests.scene.test_faces import SHEET as FACED
from tests.scene.test_honeycomb import HONEYCOMB
from tests.scene.test_impact_scenes import CHAIN_SCENE, PRESSED
from tests.scene.test_impact_scenes import SHEET as STRUCK
from tests.scene.test_impact_start import CHAIN, with_state
from tests.scene.test_impact_start import SHEET as SMALL
from tests.scene.test_imperfect_scenes import SHEET as PERFECT
from tests.scene.test_layers_by_number import LAYERS
from tests.scene.test_sources import QUIET, SHEET
from tests.scene.test_space import FREE, LAYER

ADHESIVE = {"sphere.work_of_adhesion": 0.1, "start.touching": True, "effects.friction": 0.1}
JKR = {"sphere.adhesion_law": "jkr", "packing.rows": 16, "packing.columns": 3}
BASES: dict[str, Scene] = {
    "paper": PAPER.with_values({"time.duration": 120, "time.timestep": 0.05, "time.sample": 0.5}),
    "cell": scene_of("hexagonal", "TR"),
    "driven": DRIVEN,
    "rolling": CELL.with_values({"wave.mode": "TR"}),
    "jkr": Scene.load("tr_periodic").with_values(JKR),
    "stiffnesses": BASE,
    "imperfect": PERFECT,
    "honeycomb": HONEYCOMB,
    "layers": LAYERS,
    "layer": LAYER,
    "sheet in space": FREE,
    "faces": FACED,
    "one quiet end": Scene.from_dict(SHAKEN),
    "sources": SHEET,
    "quiet": QUIET,
    "monitors": WATCHED,
    "struck chain": CHAIN_SCENE,
    "pressed chain": PRESSED,
    "struck sheet": STRUCK,
    "adhesive impact": STRUCK.with_values(ADHESIVE),
    "begun chain": with_state(CHAIN, [[0, 0, 0, 0, 0, 1.0, 0]]),
    "begun sheet": with_state(SMALL, [[0, 0, 0, 0, 0, 1.0, 0]]),
}


def rows() -> list[Any]:
    """Return the rows of the table: the scene that is changed, what is typed, and the message."""
    found, base = [], ""
    for line in Path(__file__).with_name("refused.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            base = line.strip("[]")
        elif line and not line.startswith("#"):
            typed, message = line.split("  =>  ")
            found.append(pytest.param(base, typed, message, id=f"{base}: {typed[:60]}"))
    return found


@pytest.mark.parametrize(("base", "typed", "message"), rows())
def test_a_scene_that_cannot_be_is_refused_by_name(base: str, typed: str, message: str) -> None:
    changes = dict(assignment(each) for each in typed.split("; "))
    with pytest.raises((SceneError, CrystalError)) as refused:
        prepare(BASES[base].with_values(changes))
    pattern = re.escape(message).replace("…", ".*").replace(r"\$", "$").replace(r"\^", "^")
    assert re.search(pattern, str(refused.value)), refused.value
    assert "\n" not in str(refused.value)
