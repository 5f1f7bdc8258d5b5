"""Folder of a run or study: its name, its lock, and the removal of files of an earlier run."""

import fcntl
import logging
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from granular_lmp.crystal.sphere_table import PATTERN
from granular_lmp.errors import RunFolderError, SceneError, one_line
from granular_lmp.lammps.binary_dump import continuation
from granular_lmp.lammps.installation import advice_to_ranks
from granular_lmp.lammps.outputs import (
    CHECKPOINTS,
    CONTACTS,
    COST,
    DUMP,
    LOG,
    MONITOR,
    MONITOR_CONTACTS,
    PER_SAMPLE,
    SCATTER,
    SCENE,
    SNAPSHOTS,
    STATUS,
    SWEEP,
    UNNAMED,
    UNNAMED_CONTACTS,
    UNWAVED_CONTACTS,
    writable,
)
from granular_lmp.scene.files import file_text, toml_tables
from granular_lmp.scene.schema import NAME_PATTERN, checked_name, shown

# Files that a run, a kicked sheet of release 0.2, a collision or a comparison with theory writes beside its deck
_FILES = (
    *(SCENE, STATUS, LOG, DUMP, SNAPSHOTS, CONTACTS, UNWAVED_CONTACTS, "trajectory.csv", *CHECKPOINTS),
    *("dump.everything", "dump.everything.bin", UNNAMED, UNNAMED_CONTACTS),
    *(
        "in.sheet",
        "dump.sheet",
        "sheet.npz",
        "dump.collision",
        "collision.toml",
        "collision.csv",
        "collision.json",
        "compare.png",
    ),
)
_DECK = ("in.{}", "data.{}", "in.{}.kernel", "in.{}.resume")
# Files that are written during the run, or by its readers
_PASSING = {STATUS, CONTACTS, UNWAVED_CONTACTS, "compare.png", *CHECKPOINTS}
_STUDIES = {SWEEP: "a sweep", COST: "a cost study", SCATTER: "a study of scattering"}
_EXCLUSIVE = fcntl.LOCK_EX | fcntl.LOCK_NB
_held: set[int] = set()  # descriptors of the locks of this process
_without_locks: set[int] = set()  # devices of such file systems
_BELOW = 300  # bytes of runs/HASH/N_per_sample/in.NAME.resume for the longest name of a scene


@contextmanager
def locked(folder: Path, *, make: bool = False, force: bool = False) -> Iterator[int]:
    """Lock the folder for one run or sweep and yield the descriptor of the lock.

    The lock is on the folder itself. A LAMMPS that inherits the descriptor keeps the lock if this process is killed;
    the package filelock cannot do this. If the file system has no locks, a file on this machine replaces the lock; it
    does not exclude runs on other machines, and a warning says so.

    Parameters
    ----------
    folder : Path
    make : bool
        Create the folder.
    force : bool
        Accept an existing folder.

    Raises
    ------
    RunFolderError
        If the folder is locked or cannot be locked; with `make` also if its name is too long, if it cannot be created,
        or if it exists (without `force`).
    """
    if make:
        refuse_long(folder)
    with writable(folder):
        if make:
            folder.mkdir(parents=True, exist_ok=force)
        lock = os.open(folder, os.O_RDONLY)
    _held.add(lock)
    try:
        try:
            _lock(lock, folder)
        except BlockingIOError as error:
            raise RunFolderError(f"{folder}: another run is in progress there{advice_to_ranks()}") from error
        except OSError as error:
            if make:
                with suppress(OSError):  # it holds files
                    folder.rmdir()
            place = f"neither there nor in {tempfile.gettempdir()}; name a folder of a local disk in TMPDIR"
            raise RunFolderError(f"{folder}: cannot be locked: {one_line(error)}, {place}") from error
        yield lock
    finally:
        _held.discard(lock)
        os.close(lock)


def _let_go() -> None:
    """Release the locks of the parent in a forked process, which would otherwise keep them until it ends."""
    for descriptor in _held:
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, descriptor, inheritable=False)
        os.close(nothing)


os.register_at_fork(after_in_child=_let_go)


def _lock(descriptor: int, folder: Path) -> None:
    """Lock an open folder, or instead a file on this machine under the same descriptor; raises BlockingIOError."""
    try:
        fcntl.flock(descriptor, _EXCLUSIVE)
    except BlockingIOError:
        raise
    except OSError as missing:  # such as ENOLCK of NFS, EOPNOTSUPP of Lustre
        about = os.fstat(descriptor)
        name = f"granular-lmp-{os.getuid()}-{about.st_dev}-{about.st_ino}.lock"
        file = os.open(Path(tempfile.gettempdir(), name), os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        os.dup2(file, descriptor, inheritable=False)
        os.close(file)
        fcntl.flock(descriptor, _EXCLUSIVE)
        if about.st_dev not in _without_locks:  # once for all runs of a sweep
            _without_locks.add(about.st_dev)
            risk = "two machines that run in one folder at the same time would mix their files"
            logging.getLogger(__name__).warning("%s: has no locks (%s): %s", folder, one_line(missing), risk)


def is_held(folder: Path) -> bool:
    """Return whether a run is in progress in the folder; true if the lock cannot be tested."""
    try:
        with locked(folder):
            return False
    except (RunFolderError, OSError):
        return True


def clear(folder: Path) -> None:
    """Delete the files of an earlier run in a locked folder, and no other files.

    Raises
    ------
    RunFolderError
        If the folder holds a sweep or another study, or a file cannot be deleted.
    """
    for name, study in _STUDIES.items():
        if (folder / name).exists():
            raise RunFolderError(f"{folder}: holds {study} ({name}); choose another folder")
    with writable(folder):
        inners = [*folder.iterdir()]
        written = _own_names(folder) if inners else set()
        for inner in inners:
            if inner.name in written:
                inner.unlink()
            elif _is_part(inner) and inner.is_dir() and not inner.is_symlink():
                clear(inner)
                if not any(inner.iterdir()):
                    inner.rmdir()


def written_files(folder: Path) -> list[str]:
    """Return the names of the files of a finished run, and of the ``run.json`` of each of its steps."""
    inners, own = [*folder.iterdir()], _own_names(folder) - _PASSING
    names = sorted(inner.name for inner in inners if inner.name in own and inner.is_file())
    return names + sorted(f"{part.name}/{STATUS}" for part in inners if _is_part(part) and (part / STATUS).is_file())


def _is_part(path: Path) -> bool:
    """Return whether a path has the name of a folder for one step of a run to a tolerance."""
    return re.fullmatch(rf"\d+{PER_SAMPLE}", path.name) is not None


def _own_names(folder: Path) -> set[str]:
    """Return the names of all files that a run may write into its folder."""
    name, monitors, beside = _names(folder)
    own = [pattern.format(name) for pattern in _DECK if name] + beside
    own += [pattern.format(each) for each in monitors for pattern in (MONITOR, MONITOR_CONTACTS)]
    own += [continuation(Path(MONITOR.format(each))).name for each in monitors]
    return {name + end for name in (*own, *_FILES) for end in ("", ".part")}  # .part: a draft of a killed run


def _names(folder: Path) -> tuple[str, list[str], list[str]]:
    """Return the names of the scene in a folder and of its monitors, which file names contain, and of its table.

    The name is "" without a scene.
    """
    with suppress(SceneError):
        tables = toml_tables(file_text(folder / SCENE))
        monitors = tables.get("monitor", ())
        named = [str(each.get("name")) for each in monitors if isinstance(each, dict)]
        safe = [each for each in named if re.fullmatch(NAME_PATTERN, each)]
        packing = tables.get("packing")
        table = str(packing.get("table")) if isinstance(packing, dict) else ""
        return checked_name(tables, folder.name, "the deck"), safe, [table] * bool(re.fullmatch(PATTERN, table))
    return "", [], []


def refuse_long(folder: Path) -> None:
    """Raise RunFolderError if the path, with the files of a run below it, is longer than the system allows."""
    longest_part, longest = os.pathconf("/", "PC_NAME_MAX"), os.pathconf("/", "PC_PATH_MAX") - _BELOW
    part, whole = max(len(os.fsencode(part)) for part in folder.parts), len(os.fsencode(folder))
    if part > longest_part or whole > longest:
        raise RunFolderError(
            f"folder (-o) = {shown(str(folder))}: must be at most {longest} bytes long, here {whole}, with at most "
            f"{longest_part} between two slashes, here {part}"
        )
