"""YADE: its own Mindlin law with DMT adhesion, which adds up shear forces instead of taking them from the slip.

That law (`Law2_ScGeom_MindlinPhys_Mindlin`) is the incremental one: another p than the paper's, see
``docs/contact-laws.md``. The remark gives the error against the exact lattice with *that* law, which is what
the integration itself leaves. A per-contact secant force would have to be added in Python, at ten times the cost.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np

from benchmarks.problem import Contestant, Solution, Start, base_scene, centre_signals, errors

SCRIPT = Path(__file__).with_name("yade_script.py")


def solve(folder: Path) -> Solution:
    """Run `yade_script.py` inside YADE on one core."""
    scene = base_scene()
    start, sphere, time = Start.of(scene), scene.sphere, scene.time
    start.save(
        folder / "start.npz",
        radius=sphere.radius,
        young=sphere.youngs_modulus,
        poisson=sphere.poisson_ratio,
        density=sphere.density,
        gamma=sphere.work_of_adhesion / 2,  # YADE's γ, like LAMMPS's
        step=time.step * sphere.time_scale,
        every=time.steps_per_sample,
        samples=time.samples,
    )
    command = ["yade", "-n", "-x", "-j1", str(SCRIPT), str(folder)]
    subprocess.run(
        command,
        cwd=folder,
        check=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    record = json.loads((folder / "record.json").read_text(encoding="utf-8"))
    p, q = centre_signals(scene, np.array(record["displacement"]))
    remark = "against the exact lattice with its own, incremental, law: {:.2g}, {:.2g}".format(
        *errors(scene, p, q, "incremental")
    )
    return Solution(p, q, record["loop"], len(start.position), time.steps, remark)


def missing() -> str:
    """Why it cannot take part."""
    return "" if shutil.which("yade") else "no program yade (apt-get install yade)"


CONTESTANT = Contestant("yade", "YADE, Mindlin with DMT (incremental shear law)", solve, missing)
