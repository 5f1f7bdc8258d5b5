"""A faster contact: LAMMPS's own pair style beside its overlay of two others and beside the kernel of this package.

    python -m benchmarks.kernel [--repeats N]

Processor time of the loop per contact and step, in the strip of the base case and in a sheet, with the guards of the
deck and without; and by how much *p* and *q* of the strip differ from those of pair_style granular at the same step.
``granular-lmp build-kernel`` comes before.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.faster import unguarded
from benchmarks.problem import Floats, base_scene, centre_signals
from benchmarks.timing import both_ratios, interleave, machine, table
from granular_analysis.measure.norms import relative_error
from granular_lmp import Scene, build
from granular_lmp.lammps.installation import lammps_module
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.kernel_guards import watched_text
from granular_lmp.lammps.outputs import DUMP, read_centre
from granular_lmp.units import units_for

KINDS = {"granular": "pair_style granular", "overlay": "gran/hertz/history with a table", "kernel": "the kernel"}
SHEET = {"packing.rows": 220, "packing.columns": 220, "packing.ends": "periodic", "time.duration": 10.0}
CONTACTS = 3  # each sphere has six, which two share
HEAD = ["", "spheres", "guards", "ns per contact and step", "ratio", "difference of p", "of q"]


@dataclass(frozen=True)
class Outcome:
    """Processor seconds of a loop, per contact and step, and the signals of the centre sphere."""

    seconds: float
    p: Floats
    q: Floats


def overlay(deck: str, scene: Scene) -> tuple[str, str]:
    """Return the deck with Hertz contacts and a constant attraction in place of DMT, and the table of the attraction.

    The table is linear in r² between its points, of which it has so many that its force is constant to 1e-10.
    """
    sphere = scene.sphere
    units = units_for(sphere.radius)
    pascal, force = units.number(1.0, mass=1, length=-1, time=-2), units.number(1.0, mass=1, length=1, time=-2)
    diameter, pull = 2 * units.number(sphere.radius, length=1), -sphere.pull_off_force * force
    normal, shear = 4 / 3 * sphere.effective_modulus * pascal, 8 * sphere.effective_shear_modulus * pascal
    start, end = deck.index("pair_style"), deck.index("compute      touching")
    style = [
        f"pair_style   hybrid/overlay gran/hertz/history {normal!r} {shear!r} 0.0 0.0 ${{friction}} 0 &",
        "             table linear 100000",
        "pair_coeff   * * gran/hertz/history",
        f"pair_coeff   * * table attraction.table ATTRACTION {diameter!r}\n",
    ]
    points = [f"{k + 1} {share * diameter!r} 0.0 {pull!r}" for k, share in enumerate((0.99, 0.995, 1.0))]
    return deck[:start] + "\n".join(style) + deck[end:], "\n".join(["ATTRACTION", "N 3", "", *points, ""])


def solve(kind: str, scene: Scene, guards: bool, folder: Path) -> Outcome:
    """Run a scene with contacts of a kind in an empty folder, in this process."""
    deck = build(scene)
    deck.write(folder, force=True)
    text = deck.input_text if guards else unguarded(deck.input_text)
    if kind == "kernel":
        text = watched_text(deck.problem, text)
    if kind == "overlay":
        text, attraction = overlay(text, scene)
        (folder / "attraction.table").write_text(attraction, encoding="utf-8")
    head, run, _ = text.partition("run ${steps}")
    with chdir(folder):
        path = library.built() if kind == "kernel" else None
        lammps = library.start(lammps_module(), path, ["-log", "none", "-screen", "none"])
        try:
            lammps.commands_string(head)
            started = time.process_time()
            lammps.commands_string(run)
            seconds = time.process_time() - started
        finally:
            lammps.close()
    dump = read_centre(folder / DUMP)
    metre = units_for(scene.sphere.radius).number(1.0, length=1)
    p, q = centre_signals(scene, np.column_stack([dump["ux"], dump["uy"]]) / metre)
    return Outcome(seconds / len(deck.packing) / CONTACTS / scene.time.steps, p, q)


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.kernel", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="rounds (default 5)")
    options = parser.parse_args(argv)
    scenes = {"strip": base_scene(), "sheet": Scene.load("tr_periodic").with_values(SHEET)}
    jobs = {
        f"{place} {kind} {guards}": lambda folder, kind=kind, scene=scene, guards=guards: solve(
            kind, scene, guards, folder
        )
        for place, scene in scenes.items()
        for guards in (False, True)
        for kind in KINDS
        if not (guards and kind == "overlay")  # the overlay has no shear force that a guard could read
    }
    rounds = {name: [result for _, result in done] for name, done in interleave(jobs, max(options.repeats, 1)).items()}
    lines = []
    for name, done in rounds.items():
        place, kind, guards = name.split()
        first = rounds[f"{place} granular {guards}"]
        seconds = [each.seconds for each in done]
        shape = scenes[place].shape
        differences = [relative_error(done[-1].p, first[-1].p), relative_error(done[-1].q, first[-1].q)]
        lines.append(
            [
                KINDS[kind],
                f"{shape.rows} × {shape.columns}",
                "looked at" if guards == "True" else "none",
                f"{median(seconds) * 1e9:.0f} ({min(seconds) * 1e9:.0f}–{max(seconds) * 1e9:.0f})",
                both_ratios(seconds, [each.seconds for each in first]),
                *(
                    f"{difference:.1e}" if place == "strip" and kind != "granular" else "–"
                    for difference in differences
                ),
            ]
        )
    print(machine() + "\n")
    print(table(HEAD, lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
