"""This package in a warm process, with guards and record, by LAMMPS's own contacts and by the kernel.

Single runs, and runs to a tolerance on the rows that it takes, which is what docs/which-tool.md recommends.
"""

from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.problem import Contestant, Solution, base_scene
from granular_lmp import Scene, run
from granular_lmp.errors import GranularError
from granular_lmp.lammps.kernel import library

STEPS = (0.05, 0.2, 0.1, 0.025)  # the first is that of the peers
TOLERANCES = (1e-1, 1e-2, 1e-5)


def solve(values: dict[str, Any], kernel: bool, folder: Path) -> Solution:
    """From the scene to the record, data file and log written on the way."""
    scene = Scene.load("tr_nonresonant").with_values({"packing.columns": 3, "packing.ends": "fixed"} | values)
    record = run(scene, folder / "run", kernel=kernel)
    info = record.info
    return Solution(record.p, record.q, info["wall_seconds"]["loop"], info["particles"], info["steps"])


def missing_kernel() -> str:
    """Why the kernel cannot take part."""
    try:
        library.built()
    except GranularError as error:
        return str(error)
    return ""


def _contestants(kernel: bool) -> list[Contestant]:
    name, title, series = ("kernel", "granular-lmp --kernel", ", kernel") if kernel else ("ours", "granular-lmp", "")
    missing = missing_kernel if kernel else (lambda: "")
    rows = base_scene().packing.rows
    singles = [
        Contestant(
            f"{name}-{step:g}",
            f"{title}, 201 × 3, step {step:g}",
            partial(solve, {"packing.rows": rows, "time.timestep": step}, kernel),
            missing,
            f"LAMMPS, one step{series}",
        )
        for step in STEPS
    ]
    return singles + [
        Contestant(
            f"{name}-tolerance-{tolerance:g}",
            f"{title}, tolerance {tolerance:g}, rows by the echo",
            partial(solve, {"packing.rows": "auto", "time.tolerance": tolerance}, kernel),
            missing,
            f"LAMMPS, to a tolerance{series}",
        )
        for tolerance in TOLERANCES
    ]


CONTESTANTS = [*_contestants(kernel=False), *_contestants(kernel=True)]
