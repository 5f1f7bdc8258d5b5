"""Files that a user names, scenes in TOML and tables in CSV: read whole, up to a largest size.

A device or a pipe never ends, and a TOML key of thousands of parts takes minutes to parse.
"""

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from granular_lmp.errors import SceneError, one_line
from granular_lmp.scene.schema import shown

LARGEST_FILE = 1_000_000  # bytes; a scene with all its comments has 2000
LARGEST_TABLE = 4_000_000  # bytes of a CSV file; the largest that a scene can hold has 0.8 MB at full precision
_POINTED = re.compile(r"[+-]?(\d+\.|\.\d+)([eE][+-]?\d+)?")
MOST_PARTS = 100  # The time that tomllib needs for a dotted key grows as the square of its parts; our keys have two
# tomllib raises a plain ValueError for whole numbers of more than 4300 digits, and recurses into nested brackets until
# Python's stack ends
_NOT_TOML = (ValueError, RecursionError)
# Possessive, so that the search takes one pass over the text; no key begins in the middle of a word or of a string
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w\\-])(?:{_PART}\.[ \t]*+){{{MOST_PARTS}}}")


def first_file(source: object, candidates: Iterable[Path]) -> Path | None:
    """Return the first candidate that is a file; raise SceneError if no file can have that name."""
    try:
        return next((path for path in candidates if path.is_file()), None)
    except (OSError, ValueError) as error:
        raise SceneError(f"{shown(source)}: no such scene file: {one_line(error)}") from error


def file_text(path: Path) -> str:
    """Return the text of a file; raise SceneError as `file_bytes` does, or if it is not UTF-8."""
    try:
        return file_bytes(path, LARGEST_FILE, str(path)).decode(
            "utf-8-sig"
        )  # some editors begin a file with a byte order mark
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: cannot be read as UTF-8 text: {one_line(error)}") from error


def file_bytes(path: Path, largest: int, said: str) -> bytes:
    """Return the bytes of a file; `said` is the name that the user wrote.

    Raises
    ------
    SceneError
        If the file cannot be read, is a device or a pipe, or has more than `largest` bytes.
    """
    try:
        if path.exists() and not path.is_file():
            raise SceneError(f"{said}: must be a regular file, not a folder, device or pipe")
        with path.open("rb") as stream:
            raw = stream.read(largest + 1)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise SceneError(f"{said}: cannot be read: {one_line(error)}") from error
    if len(raw) > largest:
        raise SceneError(f"{said}: is too large: must be at most {largest} bytes")
    return raw


def toml_tables(text: str) -> dict[str, Any]:
    """Return the tables of TOML text; raise SceneError if it is invalid or a key has too many parts."""
    if _LONG_KEY.search(text):
        raise SceneError(f"not a scene: a key has more than {MOST_PARTS} parts")
    try:
        return tomllib.loads(text)
    except _NOT_TOML as error:
        raise SceneError(f"not valid TOML: {one_line(error)}") from error


def assignment(text: str) -> tuple[str, Any]:
    """Return ``("wave.wavenumber", 1.2)`` for ``"wave.wavenumber=1.2"``; a value that is not TOML is a bare word.

    Unlike in TOML, numbers may begin or end with a decimal point: ``.1``, ``1.``, ``1.e-3``.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise SceneError(f"{shown(text)}: must be KEY=VALUE, for instance wave.wavenumber=1.2")
    try:
        (parsed,) = toml_tables(f"value = {value}").values()
    except (SceneError, ValueError):  # ValueError: the text has a second line that sets another key
        word = value.strip()
        return key.strip(), float(word) if _POINTED.fullmatch(word) else word
    return key.strip(), parsed
