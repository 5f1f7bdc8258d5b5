"""Scenes, collisions and decks that come with the package."""

import tomllib
from pathlib import Path
from shutil import copytree

from granular_lmp.errors import RunFolderError, one_line

# In a checkout this is a link to the folder beside the package. It is a path because LAMMPS opens files by name
SHIPPED = Path(__file__).parents[1] / "lammps_inputs"


def copy_shipped(folder: str | Path) -> list[str]:
    """Copy all shipped scenes into a new folder and return the names of its entries.

    Raises
    ------
    RunFolderError
        If the folder exists or cannot be written.
    """
    try:
        copytree(SHIPPED, folder)
    except FileExistsError as error:
        raise RunFolderError(f"{folder}: exists already; choose another folder") from error
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written: {one_line(error)}") from error
    return sorted(path.name for path in SHIPPED.iterdir())


def shipped(pattern: str) -> dict[str, str]:
    """Return name → description of the shipped files that match ``*/scene.toml`` or ``collisions/*.toml``."""
    tables = (tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(SHIPPED.glob(pattern)))
    return {table["name"]: table.get("description", "") for table in tables}
