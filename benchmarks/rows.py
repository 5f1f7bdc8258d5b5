"""No particle code at all: the paper's equations, a sphere a row, integrated by scipy.

The 201 rows touch at points, which leaves 1e-4 of *p* at any tolerance. The exact lattice is one wavelength in the true
contact geometry; the reference of all errors is the same with a tolerance of 1e-11.
"""

import time
from functools import partial
from pathlib import Path

from benchmarks.paper_rows import rows
from benchmarks.problem import Contestant, Solution, base_scene, times
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.lattice import torus
from granular_analysis.theory.wave import Wave


def solve(rtol: float, exact: bool, folder: Path) -> Solution:
    """DOP853 in numpy, of the rows or of the exact lattice."""
    scene = base_scene()
    contact = Contact(scene.sphere.poisson_ratio, overlap_ratio=scene.sphere.overlap_ratio if exact else 0.0)
    started = time.perf_counter()
    wave = Wave.of_mode("TR", scene.wavenumber, scene.amplitude, contact)
    if exact:
        p, q, _ = torus(wave, times(scene), rtol=rtol)
    else:
        p, q, _ = rows(wave, times(scene), rows=scene.shape.rows, rtol=rtol)
    return Solution(p, q, time.perf_counter() - started, 31 if exact else scene.shape.rows, None)


CONTESTANTS = [
    Contestant(
        f"{name}-{rtol:g}",
        f"scipy DOP853 on {title}, rtol {rtol:g}",
        partial(solve, rtol, exact),
        series=f"{title}, scipy",
    )
    for name, title, exact, tolerances in (
        ("rows", "the row equations", False, (1e-4, 1e-6)),
        ("exact", "the exact lattice", True, (1e-4, 1e-6, 1e-8, 1e-10)),
    )
    for rtol in tolerances  # looser ones take the same steps, which the lattice limits
]
