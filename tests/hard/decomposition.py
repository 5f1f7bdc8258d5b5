"""The same record, however the packing is divided among MPI ranks. For restarts see `tests/hard/test_honesty.py`."""

import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from granular_lmp import Record, build
from granular_lmp.lammps.installation import lmp_command
from granular_lmp.lammps.outputs import DUMP, LOG
from granular_lmp.runs.options import core_count
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import Floats, edited
from tests.hard.waves import scene

RANKS = (2, 3, 4)


def course(ranks: int, steps: int, edits: Edits = ()) -> Floats:
    """p, q, φ (3, T) of a short cell in D0, run on a number of ranks, also on more than there are cores."""
    wave = scene("TR", 2, 16, 0.2, 0.05, 0.05 * steps)
    deck = build(wave)
    with TemporaryDirectory() as place:
        folder = Path(place)
        deck.write(folder, force=True)
        (folder / deck.input_name).write_text(edited(deck.input_text, edits), encoding="utf-8")
        command = [*lmp_command(ranks), "-in", deck.input_name, "-log", LOG, "-screen", "none", "-nocite"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=100)
        record = Record.from_dump(folder, deck.scene, DUMP)
    return np.array([record.p, record.q, record.phi])


def ranks(counts: tuple[int, ...] = RANKS, edits: Edits = ()) -> Cases:
    """The largest difference of runs on some numbers of ranks from that on one."""
    alone = course(1, 200)
    cases = []
    for count in counts:
        # Ranks that share a core wait for each other in busy loops, a time slice at each step
        steps = 200 if count <= core_count() else 20
        apart = np.abs(course(count, steps, edits) - alone[:, : steps // 10 + 1]).max()
        cases.append(
            Case(
                f"largest difference in D0 of {count} ranks from one, {steps} steps",
                "a contact between two ranks is computed on both or one, with copies of spheres that move and turn",
                float(apart),
                "forces are summed in another order: 1e-16 of positions of 1e4 nm a step, 200 steps, over D0 = 0.05 nm",
                most=1e-9,
            )
        )
    return cases
