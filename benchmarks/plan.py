"""Model the time, memory and bytes that crystals beyond this machine take, from measured costs.

    python -m benchmarks.plan [--spheres N ...]

prints a table, whose last row docs/how-long.md tells; with ``--spheres`` it first measures the set-up of sheets whose
densities differ, processor time and memory of a process each.

With N spheres, S steps and R ranks

    set-up = (build + read) N        by one process, then by rank 0: more ranks do not shorten it
    loop   = N S / speed · (1 + s log₂R) / R
    memory = LAMMPS + sphere N/R + map N        a rank: ``atom_modify map array`` has every number on each rank

It agrees with the measured rows of RESULTS.md within a factor of 2 in time and 1.15 in memory
(tests/house/test_benchmarks.py). More than 4 ranks are extrapolated.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import log2
from multiprocessing import get_context
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from tempfile import TemporaryDirectory

from benchmarks.problem import base_scene
from benchmarks.timing import machine, table
from granular_lmp import build
from granular_lmp.lammps.checkpoints import SPEED

STEPS = 10_000
# Seconds and bytes of a sphere, as measured in RESULTS.md and docs/how-long.md
BUILD, READ = 15e-6, 6.5e-6  # the deck of a crystal that is not perfect; LAMMPS reads its data file, 4 to 11
SERIAL = 0.1  # 2 ranks take 0.55 of one at most, 4 ranks 0.30
PYTHON, BUILT = 50e6, 1.1e3
LAMMPS, SPHERE, MAP = 33e6, 875.0, 4.0
DATA, SNAPSHOT, CHECKPOINT = 170.0, 156.0, 480.0
HEAD = [
    *("spheres", "ranks", "build, s", "read, s", "loop, s"),
    *("GB to build", "GB a rank", "data, snapshot, checkpoint, GB"),
]


@dataclass(frozen=True)
class Plan:
    """Cost of a run: seconds of each stage, bytes of the process that builds it and of a rank, bytes of files."""

    spheres: float
    ranks: int = 1
    steps: float = STEPS

    @property
    def build(self) -> float:
        return BUILD * self.spheres

    @property
    def read(self) -> float:
        return READ * self.spheres

    @property
    def loop(self) -> float:
        return self.spheres * self.steps / SPEED * (1 + SERIAL * log2(self.ranks)) / self.ranks

    @property
    def builder(self) -> float:
        return PYTHON + BUILT * self.spheres

    @property
    def rank(self) -> float:
        return LAMMPS + SPHERE * self.spheres / self.ranks + MAP * self.spheres

    @property
    def files(self) -> list[float]:
        return [size * self.spheres for size in (DATA, SNAPSHOT, CHECKPOINT)]


def planned() -> str:
    """Return the table of 10⁷ and 10⁸ spheres."""
    sizes = {"10⁷": 1e7, "10⁸": 1e8}
    plans = [(name, Plan(spheres, ranks)) for name, spheres in sizes.items() for ranks in (64, 1024)]
    return table(
        HEAD,
        [
            [
                name,
                str(plan.ranks),
                *(f"{seconds:.0f}" for seconds in (plan.build, plan.read, plan.loop)),
                f"{plan.builder / 1e9:.0f}",
                f"{plan.rank / 1e9:.2g}",
                ", ".join(f"{size / 1e9:.2g}" for size in plan.files),
            ]
            for name, plan in plans
        ],
    )


def set_up(spheres: int) -> tuple[int, float, float, float]:
    """Return spheres, processor seconds, peak MB and MB of files of a sheet that is built and written here."""
    side = round(spheres**0.5)
    values = {"packing.rows": side | 1, "packing.columns": side, "time.allow_echo": True, "disorder.density": 0.05}
    started = time.process_time()
    with TemporaryDirectory(prefix="bench-") as folder:
        deck = build(base_scene().with_values(values))
        deck.write(Path(folder) / "run")
        size = sum(file.stat().st_size for file in (Path(folder) / "run").iterdir())
    seconds = time.process_time() - started
    return len(deck.packing), seconds, getrusage(RUSAGE_SELF).ru_maxrss / 1024, size / 1e6


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.plan", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--spheres", type=int, nargs="+", default=[], metavar="N")
    rows = []
    for spheres in parser.parse_args(argv).spheres:
        with get_context("spawn").Pool(1) as pool:  # whose memory is its own
            found, *measured = pool.apply(set_up, (spheres,))
        rows.append([str(found), f"{measured[0]:.3g}", *(f"{each:.0f}" for each in measured[1:])])
    if rows:
        print(machine() + "\n\n" + table(["spheres", "set-up, s", "peak MB", "files, MB"], rows) + "\n")
    print(planned())
    return 0


if __name__ == "__main__":
    sys.exit(main())
