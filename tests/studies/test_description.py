"""The description of a scene: one line that changes nothing of its run."""

import pytest

from granular_lmp import ImpactScene, Scene
from granular_lmp.errors import SceneError
from granular_lmp.scene.collision import Collision
from granular_lmp.scene.shipped import SHIPPED, shipped
from granular_lmp.studies.sweep_points import points, scene_hash

PAPER = Scene.load("tr_nonresonant")
OTHER = PAPER.with_values({"description": 'of "mine", ξ = 0.8'})


def test_a_description_is_read_back() -> None:
    assert Scene.loads(OTHER.to_toml()) == OTHER
    assert Scene.from_dict(OTHER.to_dict()).description == 'of "mine", ξ = 0.8'


def test_a_description_is_neither_in_the_hash_of_a_run_nor_among_what_theories_are_asked_about() -> None:
    assert scene_hash(OTHER) == scene_hash(PAPER)
    assert OTHER.departures() == PAPER.departures()
    with pytest.raises(SceneError, match="description = 'a': cannot be swept over"):
        points(PAPER, {"description": ["a", "b"]})


@pytest.mark.parametrize("wrong", ["two\nlines", "x" * 201, 3, "\x7f"])
def test_what_is_not_one_line_is_refused(wrong: object) -> None:
    with pytest.raises(SceneError, match="description = .*: must be one line of at most 200 printable characters"):
        PAPER.with_values({"description": wrong})


def test_every_shipped_scene_and_collision_has_one() -> None:
    scenes, collisions = shipped("*/scene.toml"), shipped("collisions/*.toml")
    assert len(scenes) == len(list(SHIPPED.glob("*/scene.toml")))
    for name, said in scenes.items():
        assert said
        assert Scene.load(name).description == said
    for name, said in shipped("impacts/*/scene.toml").items():
        assert said
        assert ImpactScene.load(name).description == said
    for name, said in collisions.items():
        assert said
        assert Collision.load(name).description == said
        assert Collision.from_dict(Collision.load(name).to_dict()) == Collision.load(name)
