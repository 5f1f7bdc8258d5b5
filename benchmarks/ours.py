"""This package: the scene as it is, run by the program ``lmp`` on one rank, guards and record included."""

from pathlib import Path

from benchmarks.problem import Contestant, Solution, base_scene
from granular_lmp import run


def solve(folder: Path) -> Solution:
    """From the scene to the record, data file and log written on the way."""
    scene = base_scene()
    record = run(scene, folder / "run", launcher="lmp")
    loop, spheres, steps = record.info["wall_seconds"]["loop"], record.info["particles"], record.info["steps"]
    contacts = spheres * 3 - 2 * scene.packing.columns
    remark = (
        f"{spheres * steps / loop / 1e6:.2f} M particle-steps/s, "
        f"{loop / steps / contacts * 1e9:.0f} ns per contact and step in the loop"
    )
    return Solution(record.p, record.q, loop, spheres, steps, remark)


CONTESTANT = Contestant("ours", "granular-lmp, 201 × 3, step 0.05", solve)
