"""Search of densities in whole runs, for ``granular-analysis design --maximize``.

The folder of a search holds its options, all evaluations, the log of the objective, and the designed scene with its
table of densities. The same command continues a search that was stopped. `granular_analysis.tools.design` imports this
module only for ``--maximize``, because it needs JAX.
"""

import argparse
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from granular_analysis.measure.designs import Subject, designed, goal_of, read_off
from granular_analysis.measure.runs import load
from granular_analysis.plotting import in_one_line, scene_of, write, write_csv
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network_design import Best, Design, Evaluation, improved
from granular_analysis.tools.kept import begun
from granular_lmp.cli.output import interruptible
from granular_lmp.runs.folder import locked

SCENE, TABLE, LOG, ASKED = "scene.toml", "spheres.csv", "log.csv", "design.json"
INTERRUPTED = 130


class Kept:
    """Folder of a search: its options, and all evaluations so far."""

    def __init__(self, folder: Path, asked: Mapping[str, Any]) -> None:
        """Begin a folder, or continue the folder of the same search; raise TheoryError as `begun` does."""
        self.folder, count = folder, int(asked["numbers"])
        row = np.dtype([("value", "<f8"), ("slope", "<f8", count), ("numbers", "<f8", count)])
        self.path, rows = begun(folder, ASKED, asked, row, (SCENE, TABLE, LOG))
        self.evaluations = [Evaluation(float(each["value"]), each["slope"], each["numbers"]) for each in rows]

    def add(self, found: Evaluation) -> None:
        """Add an evaluation to the folder."""
        with self.path.open("ab") as stream:
            np.concatenate([[found.value], found.slope, found.numbers]).astype("<f8").tofile(stream)
        self.evaluations.append(found)

    def write_log(self, uniform: float, count: int) -> None:
        """Write the log: number, objective, best so far, and the best over the objective of the uniform crystal.

        The log has the first `count` evaluations, which this search needed; an earlier command may have made more.
        """
        values = np.array([each.value for each in self.evaluations[:count]])
        best = np.fmax.accumulate(values)
        head = ["evaluation", "objective", "best", "best_over_uniform"]
        write_csv(self.folder / LOG, head, zip(range(1, len(values) + 1), values, best, best / uniform, strict=True))


def read(chosen: argparse.Namespace) -> int:
    """Print an objective of a run, or of two runs that start with opposite signs."""
    folders = [chosen.what, *([chosen.opposite] if chosen.opposite else [])]
    with in_one_line(chosen.what):
        print(f"{chosen.maximize}: {read_off([load(each) for each in folders], chosen.maximize):.6g}")
    return 0


def search(chosen: argparse.Namespace) -> int:
    """Search the densities of a scene, print the result, and write the folder."""
    folder = Path(chosen.output)
    with in_one_line(chosen.what):
        scene = scene_of(chosen.what, chosen)
        subject = Subject.of(scene)
        if not scene.perfect:
            raise TheoryError("packing, disorder, inclusion: a search must start from a crystal of equal spheres")
        goal, spheres = goal_of(subject, chosen.maximize)
        low, high = chosen.within
        groups = subject.groups(chosen.per)
        robust = {"same_mass": chosen.same_mass, "spread": chosen.robust, "seeds": chosen.seeds}
        design = Design(subject.run(spheres), goal, groups, low, high, **robust)
        begin = design.begin(chosen.start)
        digest = hashlib.sha256(scene.to_toml().encode()).hexdigest()
        asked = {"scene_sha256": digest, "maximize": chosen.maximize, "within": [low, high], "per": chosen.per}
        with locked(folder, make=True, force=True):
            kept = Kept(folder, asked | robust | {"start": chosen.start, "numbers": len(begin)})
            uniform = design.value(np.ones(len(begin)))
            known = list(kept.evaluations)
            with interruptible() as progress:

                def noted(found: Evaluation) -> None:
                    kept.add(found)
                    if progress is not None:
                        progress(len(kept.evaluations), chosen.evaluations)

                best = improved(design, begin, chosen.evaluations, known, noted)
            kept.write_log(uniform, best.evaluations)
            made = designed(scene, best.densities[groups])
            table = made.packing.table
            write(folder / TABLE, "".join(table.pieces()))
            write(folder / SCENE, made.to_toml().replace(f'"{table}"', f'"{TABLE}"'))
    print(said(chosen, best, design, uniform))
    return INTERRUPTED if best.interrupted else 0


def said(chosen: argparse.Namespace, best: Best, design: Design, uniform: float) -> str:
    """Return the report of a search."""
    mass = float(design.sizes @ best.densities / design.sizes.sum())
    lines = [
        f"{chosen.maximize}: {best.value:.5g}, {best.value / uniform:.4g} times the uniform crystal's {uniform:.4g}",
        f"{len(best.densities)} densities, {best.densities.min():.3g} to {best.densities.max():.3g}, mean {mass:.4g}",
        f"{best.evaluations} evaluations: {best.ended}",
    ]
    if best.refused:
        lines.append(f"{best.refused} of them were refused, and the search stepped back; the last: {best.why}")
    return "\n".join([*lines, f"granular-lmp run {chosen.output} runs the designed crystal"])
