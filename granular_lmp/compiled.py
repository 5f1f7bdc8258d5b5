"""Libraries compiled on this machine into the cache of the user: where they lie, and whether they may be loaded.

A file ends with a seal, the digest of everything before it. A file that is truncated, damaged or writable by others is
not loaded: its code would run with the rights of the user, and a missing page would end the process.
"""

import hashlib
import os
import stat
from collections.abc import Iterable
from pathlib import Path

from granular_lmp.errors import one_line

_SEAL = b"granular-lmp, sha256 of all before: "


def place(program: str, name: str, file: str, made_of: Iterable[bytes]) -> Path:
    """Return the place of a library, ``PROGRAM/NAME-DIGEST`` in the cache, where the digest covers its sources.

    The cache is the folder ``XDG_CACHE_HOME``, by default ``~/.cache``. A relative path is ignored, as
    https://specifications.freedesktop.org/basedir-spec/ requires.

    Raises
    ------
    RuntimeError
        If the user has no home folder.
    """
    wanted = Path(os.environ.get("XDG_CACHE_HOME", ""))
    cache = wanted if wanted.is_absolute() else Path.home() / ".cache"
    digest = hashlib.sha256(b"\0".join((_SEAL, *made_of))).hexdigest()[:12]
    return cache.absolute() / program / f"{name}-{digest}" / file


def make_folders(path: Path) -> None:
    """Make the two folders of a library, which no other user can write; raises OSError."""
    for folder in (path.parents[1], path.parent):
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)


def seal(path: Path) -> None:
    """Seal a compiled library, and let no other user write it."""
    path.chmod(0o755)
    path.write_bytes(sealed(path.read_bytes()))


def sealed(content: bytes) -> bytes:
    """Return the content of a library with its seal."""
    return content + _SEAL + hashlib.sha256(content).digest()


def trouble(path: Path) -> str:
    """Return why a library is not to be loaded, ``PATH: REASON``, or "".

    It must be a regular file with a valid seal. The file and its folders (`foreign`) must belong to the user or to
    root, and nobody else may write them.
    """
    try:
        if why := foreign(path) or _foreign(path):
            return why
        content = path.read_bytes()
    except OSError as error:
        return f"{path}: cannot be read: {one_line(error)}"
    return "" if content == sealed(content[: -len(sealed(b""))]) else f"{path}: is truncated or damaged"


def foreign(path: Path) -> str:
    """Return why the folders of a library are not safe, ``PATH: REASON``, or ""; raises OSError."""
    return _foreign(path.parents[1].resolve()) or _foreign(path.parent.resolve())


def _foreign(path: Path) -> str:
    status, user = path.lstat(), os.geteuid()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        return f"{path}: must be a file, not a link, because its code is run"
    if status.st_uid not in (user, 0):
        return (
            f"{path}: belongs to user {status.st_uid}: must belong to user {user} or to root, because its code is run"
        )
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"{path}: is writable by others: must not be (chmod go-w), because its code is run"
    return ""
