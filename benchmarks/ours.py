"""This package: the scene as it is, run by the program ``lmp`` on one rank, guards and record included."""

from pathlib import Path

from benchmarks.problem import Contestant, Solution, base_scene
from granular_lmp import run


def solve(folder: Path) -> Solution:
    """From the scene to the record, data file and log written on the way."""
    scene = base_scene()
    record = run(scene, folder / "run", launcher="lmp")
    info = record.info
    return Solution(record.p, record.q, info["wall_seconds"]["loop"], info["particles"], info["steps"])


CONTESTANT = Contestant("ours", "granular-lmp, 201 × 3, step 0.05", solve)
