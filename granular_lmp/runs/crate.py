"""Write a run as a Process Run Crate: a folder or archive with its files and their origin, for data repositories.

The profile (https://w3id.org/ro/wfrun/process/0.5) describes which program made which files from which other files.
Here granular-lmp turned the scene into a deck and read the record, and LAMMPS ran the deck. Each action ends when the
last of its files was written.
"""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.outputs import LOG, SCENE, STATUS
from granular_lmp.runs.folder import written_files
from granular_lmp.runs.record import Record, optional_package

PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
TERMS = "https://w3id.org/ro/terms/workflow-run/context"
PROGRAMS = {  # entry of `versions` in run.json → name, address
    "granular_lmp": ("granular-lmp", "#granular-lmp"),
    "lammps": ("LAMMPS", "https://www.lammps.org"),
}
_KINDS = {
    ".toml": "application/toml",
    ".json": "application/json",
    ".csv": "text/csv",
    ".bin": "application/octet-stream",
}


def write_crate(record: Record, path: Path) -> None:
    """Write a run as a crate: an archive if the path ends in .zip, else a folder.

    Raises
    ------
    RunFolderError
        If the record belongs to no run folder, or a folder of this name is not empty.
    PackageMissingError
        If rocrate is not installed.
    """
    if record.folder is None:
        raise RunFolderError(f"{record!r}: belongs to no run folder, which a crate needs")
    if path.is_dir() and any(path.iterdir()):
        raise RunFolderError(f"{path}: exists already and is not empty; choose another folder")
    optional_package("rocrate")
    crate = optional_package("rocrate.rocrate").ROCrate(version="1.1")
    crate.metadata.extra_contexts.append(TERMS)
    crate.name, crate.description = record.scene.name, record.scene.description or str(record)
    names = _names(record.folder)
    files = {name: crate.add_file(record.folder / name, name, properties=_said(record.folder / name)) for name in names}
    crate.root_dataset["conformsTo"] = _entity(crate, PROFILE, "CreativeWork", name="Process Run Crate", version="0.5")
    deck = [name for name in names if Path(name).name.startswith(("in.", "data."))]
    made = [name for name in names if Path(name).name == LOG or Path(name).name.startswith(("dump.", "monitor."))]
    for program, given, written in (
        ("granular_lmp", [SCENE], [name for name in names if name != SCENE and name not in made]),
        ("lammps", deck, made),
    ):
        _add_action(crate, record, program, [files[name] for name in given], [files[name] for name in written])
    (crate.write_zip if path.suffix == ".zip" else crate.write)(path)


def _add_action(crate: Any, record: Record, program: str, given: list[Any], written: list[Any]) -> None:
    """Add a program, and the action in which it made files from other files."""
    name, address = PROGRAMS[program]
    said = {"name": name, "softwareVersion": record.info.get("versions", {}).get(program), "url": address}
    if not address.startswith("https:"):
        del said["url"]
    tool = _entity(crate, address, "SoftwareApplication", **{key: value for key, value in said.items() if value})
    end = max(entity.source.stat().st_mtime for entity in written)
    action = crate.add_action(
        tool,
        object=given,
        result=written,
        properties={
            "name": f"{name} of {record.scene.name}",
            "description": f"launcher {record.info.get('launcher')}, MPI ranks {record.info.get('ranks')}",
            "endTime": datetime.fromtimestamp(end, UTC).isoformat(timespec="seconds"),
            "actionStatus": "http://schema.org/CompletedActionStatus",
        },
    )
    crate.root_dataset.append_to("mentions", action)


def _entity(crate: Any, address: str, kind: str, **said: str) -> Any:
    entity = optional_package("rocrate.model.contextentity").ContextEntity
    return crate.add(entity(crate, address, properties={"@type": kind, **said}))


def _names(folder: Path) -> list[str]:
    """Return the names of the files of a run and of its steps, below its folder."""
    names: list[str] = []
    for name in written_files(folder):
        step = Path(name).parent.name
        names += [f"{step}/{inner}" for inner in _names(folder / step)] if step else [name]
    return [*names, STATUS]


def _said(path: Path) -> dict[str, Any]:
    return {"contentSize": str(path.stat().st_size), "encodingFormat": _KINDS.get(path.suffix, "text/plain")}
