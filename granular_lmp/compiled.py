"""Libraries that are compiled on this machine into the user's cache: where they lie, and whether one may be loaded.

A file ends with a seal, the digest of all before it. What is cut off, damaged, or may be written by others is not
loaded: its code would run as that of the user, and a page that is missing ends the process.
"""

import hashlib
import os
import stat
from collections.abc import Iterable
from pathlib import Path

from granular_lmp.errors import one_line

_SEAL = b"granular-lmp, sha256 of all before: "


def place(program: str, name: str, file: str, made_of: Iterable[bytes]) -> Path:
    """Return where a library lies, or will lie: in ``PROGRAM/NAME-DIGEST`` of the cache, by all that it is made of.

    The cache is the folder ``XDG_CACHE_HOME``, by default ``~/.cache``. A relative one is ignored, as
    https://specifications.freedesktop.org/basedir-spec/ wants it.

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
    """Make the two folders of a library, which no other user may write; raises OSError."""
    for folder in (path.parents[1], path.parent):
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)


def seal(path: Path) -> None:
    """Seal a library that was compiled, and let no other user write it."""
    path.chmod(0o755)
    path.write_bytes(sealed(path.read_bytes()))


def sealed(content: bytes) -> bytes:
    """Return the content of a library with its seal."""
    return content + _SEAL + hashlib.sha256(content).digest()


def trouble(path: Path) -> str:
    """Return why a library is not to be loaded, ``PATH: REASON``, or "".

    It is a regular file that its seal fits. It and its folders (`foreign`) belong to the user or to root, and nobody
    else may write them.
    """
    try:
        if why := foreign(path) or _foreign(path):
            return why
        content = path.read_bytes()
    except OSError as error:
        return f"{path}: cannot be read: {one_line(error)}"
    return "" if content == sealed(content[: -len(sealed(b""))]) else f"{path}: is cut off or damaged"


def foreign(path: Path) -> str:
    """Return why nothing in the two folders of a library is to be loaded, ``PATH: REASON``, or ""; raises OSError."""
    return _foreign(path.parents[1].resolve()) or _foreign(path.parent.resolve())


def _foreign(path: Path) -> str:
    status, user = path.lstat(), os.geteuid()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        return f"{path}: must be a file, and no link, as its code is run"
    if status.st_uid not in (user, 0):
        return f"{path}: belongs to user {status.st_uid}: must be of user {user} or of root, as its code is run"
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"{path}: may be written by others: must not (chmod go-w), as its code is run"
    return ""
