"""Ways to write down a run, to compare what they cost and what they lose: the centre sphere or all, text or binary.

The record of a run is always made from one sphere at full precision (`granular_lmp.lammps.deck`). Here the deck's text
is edited so that LAMMPS writes more, or fewer digits, and the trajectory is made from what it then wrote, as someone
would who has nothing else.
"""

import struct
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import centre
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.outputs import DUMP, read_snapshots
from granular_lmp.lammps.units import units_for
from granular_lmp.runs.record import TRAJECTORY, Record

Floats = NDArray[np.float64]

EVERYTHING = "dump.everything"
_ALL_DIGITS = "format float %.17g"


@dataclass(frozen=True)
class Output:
    """What LAMMPS is told to write.

    Attributes
    ----------
    everything : bool
        Positions (and dipoles, where spheres turn) of all spheres, beside the record of the centre sphere.
    binary : bool
    all_digits : bool
        17 digits, or the six that LAMMPS writes unless told otherwise.
    work : float
        Time that one sphere takes in one record, in particle-steps.
    """

    everything: bool
    binary: bool
    all_digits: bool
    work: float

    @property
    def file(self) -> str:
        """The name of the file of all spheres."""
        return EVERYTHING + ".bin" * self.binary  # by this ending LAMMPS knows that it is to be binary


# The work is from 415 to 560 µs as text and 42 µs as binary for 603 spheres, of which each takes 0.22 µs a step
OUTPUTS = {
    "probe": Output(everything=False, binary=False, all_digits=True, work=0.0),
    "probe, 6 digits": Output(everything=False, binary=False, all_digits=False, work=0.0),
    "all, text": Output(everything=True, binary=False, all_digits=True, work=4.0),
    "all, text, 6 digits": Output(everything=True, binary=False, all_digits=False, work=3.0),
    "all, binary": Output(everything=True, binary=True, all_digits=True, work=0.3),
}


def edited(deck: Deck, output: Output) -> Deck:
    """The deck whose run writes this.

    Raises
    ------
    ValueError
        When the text of the deck is not one that `granular_lmp.lammps.deck` writes.
    """
    text = deck.input_text
    head, run, tail = text.rpartition("\nrun ")
    if not run or text.count(_ALL_DIGITS) != 1:
        raise ValueError(f"{deck.input_name}: not a deck whose output can be changed")
    if output.everything:
        columns = "id xs ys" + " mux muy" * (deck.scene.effects.tracking is True)
        head += f"dump         all all custom ${{every}} {output.file} {columns}\n"
        if output.all_digits and not output.binary:
            head += f"dump_modify  all {_ALL_DIGITS}\n"
        text = head + run + tail
    elif not output.all_digits:
        text = text.replace(f" {_ALL_DIGITS}", "")
    return replace(deck, input_text=text)


def keep_centre(deck: Deck, record: Record, output: Output) -> Record:
    """Make ``trajectory.csv`` from what a run wrote of all spheres, which is then deleted, and return it as a record.

    p = (y − y₀)/D0, q = −(x − x₀)/D0, φ = atan2(μy, μx) R/D0, with x₀ and y₀ the positions at rest. Where nothing was
    written of all spheres, or it is gone already, the record is returned as it is.

    Positions are dumped in units of the box, as ``dump atom`` does: those of our decks are so small at the centre, next
    to the origin, that six digits of them would look better than they are anywhere else.
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
    units, size = units_for(scene.sphere.radius), scene.displacement_amplitude
    radius, d0 = (units.number(length, length=1) for length in (scene.sphere.radius, size))
    low, high = deck.data.box[:2].T
    rest = radius * deck.packing.positions[index, :2]
    x, y = ((low + (high - low) * rows[:, :2] - rest) / d0).T
    phi = np.arctan2(rows[:, 3], rows[:, 2]) * radius / d0 if rows.shape[1] == 4 else record.phi
    kept = replace(record, p=y, q=-x, phi=phi)
    kept.write_csv(record.folder / TRAJECTORY)
    for stale in (path, record.folder / DUMP):  # the trajectory is no longer that of the dump of the centre sphere
        stale.unlink()
    return kept


def _text_rows(path: Path, number: int) -> Floats:
    """Return the numbers behind the id of one sphere, snapshot by snapshot, of a text dump."""
    rows = []
    for _, _, table in read_snapshots(path):
        (row,) = table[table[:, 0] == number]
        rows.append(row[1:])
    return np.array(rows)


def _binary_rows(path: Path, spheres: int, number: int) -> Floats:
    """The same of a binary dump of one rank, whose snapshots all have one size.

    A snapshot ends with the number of doubles (int) and the doubles; before them stand the names of the columns, from
    whose count the size of the rest follows. https://docs.lammps.org/dump.html, tools/binary2txt.cpp of LAMMPS.
    """
    content = path.read_bytes()
    names = content.index(b"id xs ys")
    (length,) = struct.unpack_from("=i", content, names - 4)
    columns = len(content[names : names + length].split())
    body = names + length + 2 * 4  # behind the number of chunks, here 1, and that of its doubles
    size = body + 8 * columns * spheres
    if len(content) % size:
        raise ValueError(f"{path}: {len(content)} bytes are no whole number of snapshots of {size}")
    rows = []
    for start in range(0, len(content), size):
        table = np.frombuffer(content, offset=start + body, count=columns * spheres).reshape(spheres, columns)
        (row,) = table[table[:, 0] == number]
        rows.append(row[1:])
    return np.array(rows)
