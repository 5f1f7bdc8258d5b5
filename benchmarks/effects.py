"""Cost of each effect in time, and proof that leaving out what a scene does not call for changes nothing.

    python -m benchmarks.effects [--repeats N] [--write docs]

Times are processor seconds of whole LAMMPS runs, set-up included, the smallest of runs that take turns, to which other
work on the machine adds least; the tables hold ratios within one run of this script. With ``--write`` they become
``cost_of_effects.csv`` and ``cost_of_scenes.csv`` in that folder.
"""

import argparse
import csv
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.faster import unguarded
from granular_lmp import Record, Scene, build
from granular_lmp.effects.selection import with_all
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.installation import lammps_module
from granular_lmp.lammps.outputs import LOG
from granular_lmp.scene.shipped import SHIPPED

PAPER = Scene.load("tr_nonresonant")
CELL = PAPER.with_values({"packing.rows": "auto", "packing.ends": "periodic"})

Rows = list[tuple[str, ...]]  # of a table, its head first

# What is changed in the cell
VARIANTS: dict[str, Mapping[str, Any]] = {
    "Hertz contacts held by compression in place of adhesion": {
        "sphere.work_of_adhesion": 0.0,
        "packing.contact_force": PAPER.sphere.pull_off_force,
    },
    "incremental shear law": {"effects.shear_law": "incremental"},
    "no shear, hence no rotation": {"effects.shear": False},
    "no rotation": {"effects.rotation": False},
    "no tracking of the angle": {"effects.tracking": False},
    "sliding (friction 0.3)": {"effects.friction": 0.3, "effects.sliding": True},
    "viscous damping": {"effects.viscosity": 2e-8},
    "contact opening": {"effects.contact_opening": True},
    "held ends: 151 rows for the 94 of the cell": {"packing.ends": "fixed"},
    "6 columns for 3": {"packing.columns": 6},
    "half the time step": {"time.timestep": PAPER.time.timestep / 2},
}


def simulate(deck: Deck, folder: Path) -> tuple[float, Record]:
    """Processor seconds and the record of one run of a deck."""
    deck.write(folder)
    switches = ["-log", str(folder / LOG), "-screen", "none", "-nocite"]
    instance = lammps_module().lammps(cmdargs=[*switches, "-var", "dump", str(folder / "dump")])
    started = time.process_time()
    try:
        instance.commands_string(deck.input_text.replace("${data}", str(folder / deck.data_name)))
    finally:
        instance.close()
    return time.process_time() - started, Record.from_dump(folder, deck.scene, "dump")


def timed(decks: Mapping[str, Deck], repeats: int) -> dict[str, tuple[float, Record]]:
    """Smallest seconds and record of each deck; the decks take turns."""
    seconds: dict[str, list[float]] = {name: [] for name in decks}
    records: dict[str, Record] = {}
    for _ in range(repeats):
        for name, deck in decks.items():
            with tempfile.TemporaryDirectory() as folder:
                spent, records[name] = simulate(deck, Path(folder) / "run")
            seconds[name].append(spent)
    return {name: (min(values), records[name]) for name, values in seconds.items()}


def without_guards(deck: Deck) -> Deck:
    """The deck with nothing measured but what is recorded."""
    return replace(deck, input_text=unguarded(deck.input_text))


def costs(repeats: int) -> Rows:
    """Table of the time of each variant over that of the cell."""
    decks = {"the cell": build(CELL), "no guard at all": without_guards(build(CELL))}
    decks |= {name: build(CELL.with_values(changes)) for name, changes in VARIANTS.items()}
    times = timed(decks, repeats)
    base = times["the cell"][0]
    rows: Rows = [("change", "time", "lines of the deck")]
    for name in list(decks)[1:]:
        rows.append((name, f"{times[name][0] / base:.2f}", f"{difference(decks[name], decks['the cell']):+d}"))
    return rows


def difference(deck: Deck, other: Deck) -> int:
    """How many commands a deck has more than another."""
    return commands(deck) - commands(other)


def commands(deck: Deck) -> int:
    """Lines of a deck that are neither empty nor comments."""
    return sum(bool(line.strip()) and not line.startswith("#") for line in deck.input_text.splitlines())


def largest_difference(one: Record, other: Record) -> str:
    """Largest differences of p, q and φ, in D0."""
    pairs = ((getattr(one, name), getattr(other, name)) for name in ("p", "q", "phi"))
    return ", ".join(f"{np.abs(a - b).max():.0e}" for a, b in pairs)


def lean(scene: Scene) -> Scene:
    """Return the scene with what it calls for and no more: effects auto, rows auto."""
    return scene.with_values({"packing.rows": "auto", "packing.columns": "auto"})


def same(repeats: int) -> Rows:
    """Table of auto against everything, for each shipped scene of a plane wave in a perfect crystal."""
    rows: Rows = [("scene", "spheres", "deck lines", "time", "difference of *p*, *q*, φ (*D*₀)")]
    for path in sorted(SHIPPED.glob("*/scene.toml")):
        scene = Scene.load(path)
        if not scene.form.runs or scene.envelope.finite or scene.inclusion:
            continue  # their rows are declared
        scene = scene.with_values({"output.particles": 0.0})
        # in a cell the wave number depends on the rows: the same rows for both
        few = scene if scene.shape.ends == "periodic" else lean(scene)
        decks = {"auto": build(few), "all": build(with_all(scene))}
        times = timed(decks, repeats)
        auto, full = decks["auto"], decks["all"]
        spheres, lines = f"{len(auto.packing)} / {len(full.packing)}", f"{commands(auto)} / {commands(full)}"
        ratio, differs = times["auto"][0] / times["all"][0], largest_difference(times["auto"][1], times["all"][1])
        rows.append((scene.name, spheres, lines, f"{ratio:.2f}", differs))
    return rows


TABLES: dict[str, Callable[[int], Rows]] = {"cost_of_effects.csv": costs, "cost_of_scenes.csv": same}


def main() -> None:
    """Measure, print, and write if asked to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=7, metavar="N", help="runs of each; default: %(default)s")
    parser.add_argument("--write", metavar="DIR", type=Path, help="write the tables into this folder")
    options = parser.parse_args()
    for name, table in TABLES.items():
        rows = table(options.repeats)
        csv.writer(sys.stdout).writerows(rows)
        if options.write:
            with (options.write / name).open("w", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows(rows)


if __name__ == "__main__":
    main()
