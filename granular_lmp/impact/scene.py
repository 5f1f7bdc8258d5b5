"""The earlier name of a scene without a wave, and how to tell one from its file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from granular_lmp.errors import SceneError
from granular_lmp.scene.files import file_text, first_file, toml_tables
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.shipped import SHIPPED

ImpactScene = Scene
SHIPPED_IMPACTS = SHIPPED / "impacts"


def is_impact(source: str | Path) -> bool:
    """Return whether a file, a folder or a name is the scene of an impact (`marked`)."""
    path = Path(source)
    found = first_file(source, (path, path / "scene.toml", SHIPPED_IMPACTS / path / "scene.toml"))
    if found is None:
        return False
    try:
        return marked(toml_tables(file_text(found)))
    except SceneError:
        return False  # the reader of scenes says what is wrong


def marked(tables: Mapping[str, Any]) -> bool:
    """Return whether tables are those of an impact: with ``[[striker]]`` or ``[start]``, and without ``[wave]``."""
    return Scene.is_bare(tables) and not tables.keys().isdisjoint(Scene.marks)
