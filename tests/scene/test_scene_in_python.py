"""A scene written in Python with keyword arguments: it is that of its file, and is checked as it is written."""

import pickle
import re
from typing import Any

import pytest

from granular_lmp import Scene
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import SceneError
from granular_lmp.scene.sections import Effects, Envelope, Packing, Time, Wave
from granular_lmp.scene.strikers import Striker

SILICA = Sphere(radius=5e-7, youngs_modulus=73e9, poisson_ratio=0.17, work_of_adhesion=0.063, density=2200.0)
STEEL = Sphere(radius=5e-3, youngs_modulus=200e9, poisson_ratio=0.3, work_of_adhesion=0.0, density=7800.0)
WAVE = Scene(
    sphere=SILICA,
    packing=Packing(rows=201),
    wave=Wave(mode="TR", wavenumber=0.802, amplitude=0.2),
    time=Time(duration=120.0),
)
STRIKE = Scene(
    sphere=STEEL, packing=Packing(rows=20), time=Time(duration=20.0), striker=[Striker(rows=(0, 0), velocity=1.0)]
)


@pytest.mark.parametrize("scene", [WAVE, STRIKE], ids=["wave", "strike"])
def test_it_is_the_scene_of_its_file(scene: Scene) -> None:
    assert Scene.loads(scene.to_toml()) == scene
    assert pickle.loads(pickle.dumps(scene)) == scene


def test_what_is_left_out_has_the_default_of_such_scenes_and_what_is_said_stays() -> None:
    assert (STRIKE.packing.lattice, STRIKE.packing.first, STRIKE.effects.friction) == ("chain", "free", 0.0)
    said = STRIKE.replace(packing=Packing(lattice="hexagonal", rows=6, columns=5, sides="periodic"))
    assert (said.packing.lattice, said.packing.sides, said.packing.last) == ("hexagonal", "periodic", "free")


def test_a_table_is_replaced_as_a_whole() -> None:
    packet = WAVE.replace(envelope=Envelope(length=20.0), time=Time(duration=60.0, timestep=0.02))
    assert packet == WAVE.with_values({"envelope.length": 20.0, "time.duration": 60.0, "time.timestep": 0.02})
    assert packet.replace(envelope=None, time=Time(duration=120.0)) == WAVE
    assert WAVE.replace(striker=[Striker(rows=(3, 3), velocity=1e-3)]).replace(striker=()) == WAVE


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"wave": Wave(mode="X", wavenumber=1.0, amplitude=0.1)}, "wave.mode = 'X': must be one of"),
        (
            {"wave": Wave(mode="L", wavenumber=1.0, amplitude=1e3)},
            "wave.amplitude = 1000.0: must be a number in (0, 100]",
        ),
        ({"effects": Effects(friction=-1.0)}, "effects.friction = -1.0: must be a number in [0, 10000]"),
        ({"waves": WAVE.wave}, "waves: unknown key; did you mean 'wave'?"),
        ({"packing": Packing(rows=200)}, "packing.rows = 200: must be odd between fixed ends"),
    ],
)
def test_it_is_checked_as_it_is_written(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=re.escape(message)):
        WAVE.replace(**tables)
