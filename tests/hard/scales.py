"""Materials and sizes: equal κ and Δ0/R are one trajectory in any units; no corner of the ranges overflows."""

from itertools import product
from math import inf

import numpy as np

from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from granular_lmp import Scene
from granular_lmp.crystal.scale import LARGEST_OVERLAP_RATIO
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import SceneError
from tests.hard.case import Case, Cases
from tests.hard.cell import Floats, running
from tests.hard.waves import NU, scene, verlet_bound

TAU = np.arange(0.0, 20.5, 1.0)
STEP, AMPLITUDE = 0.025, 0.2
NUS = (-0.9, -0.5, 0.0, 0.3, 0.49, 0.5)
YOUNG, RADIUS, ADHESION = (1e6, 1e12), (50e-9, 10e-3), (1e-4, 1.0)  # the ends of the ranges
# Radius, E, w, density with the same w/(ER) = 1e-6, and with it Δ0/R: nano, nano, micro, si, si
ADHESIVE = ((50e-9, 1e12, 0.05, 1e4), (1e-6, 1e11, 0.1, 2200), (20e-6, 1e9, 0.02, 1000), (10e-3, 1e6, 0.01, 20))
# Radius, E, force, density with the same F0/(ER²) = 1e-6
PRESSED = ((50e-9, 1e12, 2.5e-9, 1e4), (1e-6, 1e11, 1e-7, 2200), (20e-6, 1e9, 4e-7, 1000), (10e-3, 1e11, 10.0, 7800))


def course(wave: Scene) -> Floats:
    """p, q, φ (3, T) of the centre sphere in D0."""
    with running(wave) as cell:
        return cell.follow(TAU)[:, :3, wave.shape.centre_row].T / wave.wave.amplitude


def material(radius: float, modulus: float, nu: float = NU, **others: float) -> Scene:
    """The TR wave of these cases in spheres of a size and a material."""
    sphere = {"sphere.radius": radius, "sphere.youngs_modulus": modulus, "sphere.poisson_ratio": nu}
    return scene("TR", 2, 16, AMPLITUDE, STEP, float(TAU[-1])).with_values(sphere | others)


def similar(pressed: bool = False, off: float = 0.0) -> Cases:
    """How far spheres of other sizes and materials are from the first; `off` falsifies the ν of the last."""
    courses: list[Floats] = []
    table = PRESSED if pressed else ADHESIVE
    for radius, modulus, hold, density in table:
        force, adhesion = (hold, 0.0) if pressed else (0.0, hold)
        nu = NU + off * (len(courses) == len(table) - 1)
        others = {"packing.contact_force": force, "sphere.work_of_adhesion": adhesion, "sphere.density": density}
        courses.append(course(material(radius, modulus, nu, **others)))
    apart = max(float(np.abs(other - courses[0]).max()) for other in courses[1:])
    held = "Hertz contacts that F0 holds" if pressed else "adhesive contacts"
    return [
        Case(
            f"R = 50 nm … 10 mm, E = 1e6 … 1e12 Pa, {held}: largest difference in D0, τ ≤ 20",
            "three unit styles, lengths over five decades: a power of ten forgotten, or an absolute tolerance in a law",
            apart,
            "κ and Δ0/R are all that the motion depends on; required. Rounding of positions leaves 1e-10",
            most=1e-8,
        )
    ]


def corners(nu: float, reference: float | None = None) -> Cases:
    """The largest error over its bound in the corners of the ranges; `reference` is the lattice's ν, if another."""
    worst, ran, refused = 0.0, 0, 0
    for modulus, radius, adhesion in product(YOUNG, RADIUS, ADHESION):
        if Sphere(radius, modulus, nu, adhesion, 2200.0).overlap_ratio > LARGEST_OVERLAP_RATIO:
            try:
                material(radius, modulus, nu, **{"sphere.work_of_adhesion": adhesion})
                worst = inf  # it should have been refused
            except SceneError:
                refused += 1
            continue
        wave = material(radius, modulus, nu, **{"sphere.work_of_adhesion": adhesion})
        ran += 1
        eta = wave.sphere.overlap_ratio
        exact = nu if reference is None else reference
        theory = Wave.of_mode("TR", wave.wavenumber, AMPLITUDE, Contact(exact, overlap_ratio=eta))
        truth = lattice.torus(theory, TAU, rtol=1e-9)  # error: 5e-8, of 1e-4
        error = np.abs(course(wave) - truth).max()
        worst = max(worst, float(error / verlet_bound(wave, theory.mode.frequency)) if np.isfinite(error) else inf)
    return [
        Case(
            f"ν = {nu:g}, E, R, w at both ends of 1e6 … 1e12 Pa, 50 nm … 10 mm, 1e-4 … 1 J/m²: error over its bound, "
            f"largest of {ran} corners, {refused} are refused",
            "Δ0/R from 1e-9 to 0.05: positions have 16 digits, laws have powers of 3/2",
            worst,
            "as at the ends of the zone: Verlet's phase and amplitude, and nine times the noise of rounded positions; "
            "refused is an overlap above 0.05 of the diameter, and nothing else",
            most=1.0,
        )
    ]
