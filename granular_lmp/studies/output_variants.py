"""Variants of a run's output, to compare their cost and accuracy: the centre sphere or all spheres, text or binary.

The record of a run is always made from one sphere at full precision (`granular_lmp.lammps.deck`). Here the deck's text
is edited so that LAMMPS writes more spheres or fewer digits, and the trajectory is made from that output alone.
"""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import centre
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.cone import staying_lines
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.outputs import DUMP, read_snapshots
from granular_lmp.runs.record import IN_SPACE, TRAJECTORY, Record, write_status
from granular_lmp.runs.seal import files_of
from granular_lmp.runs.snapshots import rotation_vector

Floats = NDArray[np.float64]

EVERYTHING = "dump.everything"
_ALL_DIGITS = "format float %.17g"


@dataclass(frozen=True)
class Output:
    """One variant of LAMMPS's output.

    Attributes
    ----------
    everything : bool
        True for positions (and dipoles, if spheres turn) of all spheres, beside the record of the centre sphere.
    binary : bool
        True for a binary dump.
    all_digits : bool
        True for 17 digits instead of LAMMPS's default of six.
    work : float
        Time of one sphere in one record, in units of the time of one sphere in one step.
    """

    everything: bool
    binary: bool
    all_digits: bool
    work: float

    @property
    def file(self) -> str:
        """Name of the file of all spheres."""
        return EVERYTHING + ".bin" * self.binary  # LAMMPS writes a binary dump to a name with this suffix


# The work follows from 415 to 560 µs (text) and 42 µs (binary) for 603 spheres, each of which takes 0.22 µs per step
OUTPUTS = {
    "probe": Output(everything=False, binary=False, all_digits=True, work=0.0),
    "probe, 6 digits": Output(everything=False, binary=False, all_digits=False, work=0.0),
    "all, text": Output(everything=True, binary=False, all_digits=True, work=4.0),
    "all, text, 6 digits": Output(everything=True, binary=False, all_digits=False, work=3.0),
    "all, binary": Output(everything=True, binary=True, all_digits=True, work=0.3),
}


def edited(deck: Deck, output: Output) -> Deck:
    """Return the deck edited for a variant of the output.

    Raises
    ------
    ValueError
        If the text of the deck is not that of `granular_lmp.lammps.deck`.
    """
    text = deck.input_text
    head, run, tail = text.rpartition("\nrun ")
    if not run or text.count(_ALL_DIGITS) != 1:
        raise ValueError(f"{deck.input_name}: not a deck whose output can be changed")
    if output.everything:
        columns, tracked = "id" + " xs ys zs"[: 3 * deck.scene.space], deck.scene.effects.tracking is True
        if tracked and deck.scene.space == 3:
            head += "compute      everywhere all property/atom quatw quati quatj quatk\n"
            columns += " c_everywhere[*]"
        elif tracked:
            columns += " mux muy"
        head += "".join(f"{line}\n" for line in staying_lines(deck.scene))
        head += f"dump         all all custom ${{every}} {output.file} {columns}\n"
        if output.all_digits and not output.binary:
            head += f"dump_modify  all {_ALL_DIGITS}\n"
        text = head + run + tail
    elif not output.all_digits:
        text = text.replace(f" {_ALL_DIGITS}", "")
    return replace(deck, input_text=text)


def keep_centre(deck: Deck, record: Record, output: Output) -> Record:
    """Return the record from a run's dump of all spheres, write it to ``trajectory.csv``, and delete the dump.

    p = (y − y₀)/D0, q = −(x − x₀)/D0, φ = atan2(μy, μx) R/D0, with x₀ and y₀ the positions at rest; in space φ is that
    of the quaternion about z, and displacements and angles along all axes are kept. Without such a dump the record is
    returned unchanged.

    Positions are dumped in units of the box, as by ``dump atom``. In units of length the centre sphere lies so close to
    the origin that six digits would be more accurate there than anywhere else.
    """
    assert record.folder is not None
    path = record.folder / output.file
    if not path.exists():
        return record
    index = centre(deck.packing)
    rows = _binary_rows(path, len(deck.packing), index + 1) if output.binary else _text_rows(path, index + 1)
    if len(rows) != len(record.tau):
        raise ValueError(f"{path}: {len(rows)} snapshots instead of {len(record.tau)}")
    scene = deck.scene
    units, size = scene.units, scene.displacement_amplitude
    radius, d0 = (units.number(length, length=1) for length in (scene.sphere.radius, size))
    low, high = deck.data.box[: scene.space].T
    rest = radius * deck.packing.positions[index, : scene.space]
    place, turn = np.split(rows, [scene.space], axis=1)
    ways = ((low + (high - low) * place - rest) / d0).T
    signals = {"p": ways[1], "q": -ways[0]} | (dict(zip(IN_SPACE, ways, strict=False)) if scene.space == 3 else {})
    if turn.shape[1] == 4:
        angles = rotation_vector(turn).T * radius / d0
        signals |= {"phi": angles[2], **dict(zip(IN_SPACE[3:], angles, strict=True))}
    elif turn.size:
        signals["phi"] = np.arctan2(turn[:, 1], turn[:, 0]) * radius / d0
    kept = record.with_signals(**signals)
    kept.write_csv(record.folder / TRAJECTORY)
    for stale in (path, record.folder / DUMP):  # the trajectory no longer belongs to the dump of the centre sphere
        stale.unlink()
    kept = replace(kept, info=record.info | {"files": files_of(record.folder)})
    write_status(record.folder, kept.info)
    return kept


def _text_rows(path: Path, number: int) -> Floats:
    """Return the numbers behind the id of one sphere in a text dump, one row per snapshot."""
    rows = []
    for _, _, table in read_snapshots(path):
        (row,) = table[table[:, 0] == number]
        rows.append(row[1:])
    return np.array(rows)


def _binary_rows(path: Path, spheres: int, number: int) -> Floats:
    """Return the numbers behind the id of one sphere in a binary dump of one rank, one row per snapshot.

    All snapshots have the same size. Each ends with the number of doubles (int) and the doubles; the names of the
    columns stand before them and give the size of the rest. https://docs.lammps.org/dump.html, tools/binary2txt.cpp of
    LAMMPS.
    """
    content = path.read_bytes()
    names = content.index(b"id xs ys")
    (length,) = struct.unpack_from("=i", content, names - 4)
    columns = len(content[names : names + length].split())
    body = names + length + 2 * 4  # the data follow the number of chunks, here 1, and the number of doubles
    size = body + 8 * columns * spheres
    if len(content) % size:
        raise ValueError(f"{path}: {len(content)} bytes are no whole number of snapshots of {size}")
    rows = []
    for start in range(0, len(content), size):
        table = np.frombuffer(content, offset=start + body, count=columns * spheres).reshape(spheres, columns)
        (row,) = table[table[:, 0] == number]
        rows.append(row[1:])
    return np.array(rows)
