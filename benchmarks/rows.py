"""No particle code at all: the paper's equations of 201 rows, integrated by scipy (a sphere a row, point contacts)."""

import time
from pathlib import Path

from analysis.theory.contact import Contact
from analysis.theory.lattice import rows
from analysis.theory.wave import Wave
from benchmarks.problem import Contestant, Solution, base_scene, times

TOLERANCE = 1e-3  # the loosest with which p is within 1 %


def solve(folder: Path) -> Solution:
    """DOP853 in numpy; what is left of its error at tighter tolerances is Δ0/2R, which these equations leave out."""
    scene = base_scene()
    nu = scene.sphere.poisson_ratio
    started = time.perf_counter()
    wave = Wave.of_mode("TR", scene.wavenumber, scene.wave.amplitude, Contact(nu))
    p, q, _ = rows(wave, times(scene), rows=scene.shape.rows, rtol=TOLERANCE)
    return Solution(p, q, time.perf_counter() - started, scene.shape.rows, None)


CONTESTANT = Contestant("rows", f"scipy DOP853 on the row equations, rtol {TOLERANCE:g}", solve)
