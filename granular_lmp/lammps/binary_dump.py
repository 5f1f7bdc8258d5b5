"""Binary dumps of LAMMPS (``dump custom`` to a name that ends in ".bin"): all digits of a double, without text.

A snapshot of revision 2 of the format is, in the byte order of the machine,

    −10 (int64), "DUMPCUSTOM", 1, 2 (int), step, spheres (int64), triclinic, 6 boundaries (int), 6 faces (double),
    columns (int), length and text of the units, 0 or 1 and a time (char, double), length and names of the columns,
    chunks (int), and for each chunk the number of its doubles (int) and these

https://docs.lammps.org/dump.html, tools/binary2txt.cpp of LAMMPS. OVITO and ASE (``lammps-dump-binary``) read it too.
"""

import struct
from collections.abc import Iterable, Iterator, Sequence
from mmap import ACCESS_READ, MADV_DONTNEED, PAGESIZE, mmap
from pathlib import Path
from shutil import copyfileobj

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.outputs import SnapshotPlace, keep_latest

CONTINUED = ".next"
_MAGIC = b"DUMPCUSTOM"
_HEAD = struct.Struct(f"=q{len(_MAGIC)}siiqqi6i6d")
_TILT = struct.Struct("=3d")
_TIME = struct.Struct("=d")
_INT = struct.Struct("=i")
_GENERAL = 2  # in place of 0 or 1: a triclinic box of any orientation


@dataclass(frozen=True)
class BinarySnapshot:
    """A whole snapshot of a binary dump.

    Attributes
    ----------
    step : int
    names : list of str
        Names of the columns.
    table : (spheres, columns) array
    begin, end : int
        Offsets in the file, bytes.
    head_end : int
        Offset of the chunks.
    bounds : (3, 2) array
        Faces of the box, or of one that encloses a tilted box.
    tilt : (3,) array or None
        xy, xz and yz of a tilted box.
    periodic : (3,) array of bool
    units : str or None
    time : float or None
    """

    step: int
    names: list[str]
    table: NDArray[np.float64]
    begin: int
    end: int
    head_end: int
    bounds: NDArray[np.float64]
    tilt: NDArray[np.float64] | None
    periodic: NDArray[np.bool_]
    units: str | None
    time: float | None


def binary_snapshots(path: str | Path) -> Iterator[BinarySnapshot]:
    """Yield the complete snapshots of a binary dump, without an incomplete last one of a killed run.

    Raises
    ------
    RunFolderError
        If the file cannot be read or is not such a dump.
    """
    begin = 0
    try:
        if not Path(path).stat().st_size:
            return
        with Path(path).open("rb") as stream:
            content = mmap(stream.fileno(), 0, access=ACCESS_READ)
        while begin < len(content):
            snapshot = snapshot_at(content, begin)
            if snapshot is None:
                return
            yield snapshot
            begin = snapshot.end
            content.madvise(MADV_DONTNEED, 0, begin // PAGESIZE * PAGESIZE)  # free the memory of what was read
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{path}: not a binary dump of LAMMPS: {one_line(error)}") from error


def snapshot_at(content: mmap, begin: int) -> BinarySnapshot | None:
    """Return the snapshot at an offset, or None if the file ends within it."""
    try:
        size, magic, byte_order, revision, step, spheres, tilted, *rest = _HEAD.unpack_from(content, begin)
        if (size, magic, byte_order, revision) != (-len(_MAGIC), _MAGIC, 1, 2):
            raise ValueError(f"at byte {begin} {(size, magic, byte_order, revision)!r}, expected {_MAGIC!r}, 1, 2")
        if tilted == _GENERAL:
            raise ValueError("its box is of general triclinic form; write it without triclinic/general")
        at = begin + _HEAD.size
        tilt = np.array(_TILT.unpack_from(content, at)) if tilted else None
        at += _TILT.size if tilted else 0
        (columns,) = _INT.unpack_from(content, at)
        at += _INT.size
        (length,) = _INT.unpack_from(content, at)
        at += _INT.size
        units = content[at : at + length].decode() or None
        at += length
        time = _TIME.unpack_from(content, at + 1)[0] if content[at] else None
        at += 1 + (_TIME.size if content[at] else 0)
        (length,) = _INT.unpack_from(content, at)
        at += _INT.size
        names = content[at : at + length].decode().split()
        at += length
        head_end = at
        (chunks,) = _INT.unpack_from(content, at)
        at += _INT.size
        parts = []
        for _ in range(chunks):
            (count,) = _INT.unpack_from(content, at)
            at += _INT.size
            if at + 8 * count > len(content):
                return None
            parts.append(np.frombuffer(content, np.float64, count, at))
            at += 8 * count
    except (struct.error, IndexError):
        return None
    return BinarySnapshot(
        step,
        names,
        (parts[0] if chunks == 1 else np.concatenate(parts)).reshape(spheres, columns),
        begin,
        at,
        head_end,
        np.array(rest[6:]).reshape(3, 2),
        tilt,
        np.array(rest[:6:2]) == 0,
        units,
        time,
    )


def write_binary(path: Path, like: Path, snapshots: Iterable[tuple[BinarySnapshot, NDArray[np.float64]]]) -> None:
    """Write a binary dump: the snapshots of the dump `like`, with other numbers in their tables."""
    with like.open("rb") as source, path.open("wb") as target:
        for snapshot, table in snapshots:
            source.seek(snapshot.begin)
            target.write(source.read(snapshot.head_end - snapshot.begin))
            target.write(_INT.pack(1) + _INT.pack(table.size) + np.ascontiguousarray(table, dtype=np.float64).tobytes())


def binary_head(
    step: int,
    names: Sequence[str],
    spheres: int,
    faces: Sequence[int],
    box: NDArray[np.float64],
    *,
    tilt: NDArray[np.float64] | None = None,
    units: str = "",
    time: float | None = None,
) -> bytes:
    """Return the bytes before the doubles of a snapshot; `faces` along x, y and z are 0 where periodic."""
    both, titles = [each for face in faces for each in (face, face)], " ".join(names).encode()
    tilted = int(tilt is not None)
    head = _HEAD.pack(-len(_MAGIC), _MAGIC, 1, 2, step, spheres, tilted, *both, *box.ravel().tolist())
    head += b"" if tilt is None else _TILT.pack(*tilt)
    said = _INT.pack(len(units)) + units.encode() + (b"\0" if time is None else b"\1" + _TIME.pack(time))
    sizes = _INT.pack(1) + _INT.pack(spheres * len(names))
    return head + _INT.pack(len(names)) + said + _INT.pack(len(titles)) + titles + sizes


def continuation(path: Path) -> Path:
    """Return the name of a dump of a continued run, as LAMMPS cannot append to binary files."""
    return path.with_name(path.name.removesuffix(".bin") + f"{CONTINUED}.bin")


def mend_binary(path: Path) -> None:
    """Turn the binary dump of a stopped run, or of a run and its `continuation`, into that of an uninterrupted run.

    As in `granular_lmp.lammps.outputs.mend_dump`, an incomplete snapshot is removed, and the later of two snapshots of
    one step is kept. The continuation is appended and removed; if this is interrupted, the next call repeats it with
    the same result.
    """
    _keep_whole(path)
    after = continuation(path)
    if after.is_file():
        with after.open("rb") as source, path.open("ab") as target:
            copyfileobj(source, target)
        _keep_whole(path)
        after.unlink()


def _keep_whole(path: Path) -> None:
    keep_latest(
        path, (SnapshotPlace(each.step, len(each.table), each.begin, each.end) for each in binary_snapshots(path))
    )
