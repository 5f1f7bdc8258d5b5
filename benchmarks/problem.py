"""The problem that every contestant solves: p and q of the centre sphere for the paper's base case, ξ = 0.802.

201 rows between held ends, TR wave, D0 = 0.2 Δ0, τ = 0, 0.5, …, 120. The reference is the exact infinite lattice in
true contact geometry (`granular_analysis.theory.lattice.torus`), which 201 rows meet to 1e-7 until walls echo.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.norms import relative_error
from granular_analysis.second_harmonic import MODES
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact, Law
from granular_analysis.theory.errors import one_of
from granular_analysis.theory.wave import Wave
from granular_lmp import Scene, build
from granular_lmp.crystal.lattices import centre
from granular_lmp.crystal.mode import PLANE
from granular_lmp.rest.initial_fields import plane_wave
from granular_lmp.rest.linear import bloch_wave

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Solution:
    """Answer of a contestant.

    Attributes
    ----------
    p, q : (T,) arrays
        v/D0 and −u/D0 of the centre sphere at the times of `times`.
    loop : float
        Seconds in its time loop, by its own clock.
    spheres : int
    steps : int or None
        Time steps of a fixed step; None for an integrator that chooses its own.
    remark : str
        What was measured besides, for the foot of the table.
    """

    p: Floats
    q: Floats
    loop: float
    spheres: int
    steps: int | None
    remark: str = ""


@dataclass(frozen=True)
class Contestant:
    """A way to the solution: `solve` works in an empty folder, `missing` says what is not installed ("" if nothing)."""

    name: str
    title: str
    solve: Callable[[Path], Solution]
    missing: Callable[[], str] = lambda: ""
    series: str = ""  # what a line of the figure joins; "": a point by itself


@cache
def base_scene() -> Scene:
    """The base case with the step 0.05 that every contestant with a fixed step takes."""
    return Scene.load("tr_nonresonant").with_values(
        {"packing.rows": 201, "packing.columns": 3, "packing.ends": "fixed", "time.timestep": 0.05}
    )


def times(scene: Scene) -> Floats:
    """τ of the records, the one at 0 included."""
    return scene.time.sample * np.arange(scene.time.samples + 1, dtype=np.float64)


@cache
def exact(scene: Scene, law: Law = "secant") -> tuple[Floats, Floats]:
    """p and q of the infinite lattice at the scene's wave number, in true contact geometry."""
    nu, eta = scene.sphere.poisson_ratio, scene.sphere.overlap_ratio
    name = one_of(MODES, scene.require_wave().mode, "wave.mode")
    wave = Wave.of_mode(name, scene.wavenumber, scene.amplitude, Contact(nu, law=law, overlap_ratio=eta))
    p, q, _ = lattice.torus(wave, times(scene))
    return p, q


def errors(scene: Scene, p: Floats, q: Floats, law: Law = "secant") -> tuple[float, float]:
    """Relative L2 error of p and of q against `exact`."""
    p_exact, q_exact = exact(scene, law)
    return relative_error(p, p_exact), relative_error(q, q_exact)


@dataclass(frozen=True)
class Start:
    """The lattice and the wave in SI units, for codes that read no LAMMPS data file.

    Attributes
    ----------
    position : (N, 2) array
        At rest, m; the corner of the packing is at the origin.
    displacement, velocity : (N, 3) arrays
        x, y (m, m/s) and angle (rad, rad/s) of the wave at τ = 0.
    held : (N,) bool array
    centre : int
        Index of the centre sphere.
    size : (2,) array
        Period along x; height along y, with a radius of air beyond the held rows. m.
    """

    position: Floats
    displacement: Floats
    velocity: Floats
    held: NDArray[np.bool_]
    centre: int
    size: Floats

    @classmethod
    def of(cls, scene: Scene) -> "Start":
        """Return it for a scene with fixed ends."""
        deck, sphere, wave = build(scene), scene.sphere, bloch_wave(scene)
        packing = deck.packing
        fields = plane_wave(packing, wave.mode, wave.declared.phase)
        unit = scene.displacement_amplitude * np.array([1.0, 1.0, 1 / sphere.radius])
        low = packing.get_celldisp().ravel()[:2]
        return cls(
            position=(packing.positions[:, :2] - low) * sphere.radius,
            displacement=fields.displacement[:, list(PLANE)] * unit,
            velocity=fields.velocity[:, list(PLANE)] * unit / sphere.time_scale,
            held=packing.arrays["fixed"],
            centre=centre(packing),
            size=packing.cell.lengths()[:2] * sphere.radius,
        )

    def save(self, path: Path, **numbers: Any) -> None:
        """As ``.npz``, with the `numbers` that another code's script needs."""
        np.savez(path, **vars(self), **numbers)


def centre_signals(scene: Scene, displacement: Floats) -> tuple[Floats, Floats]:
    """p and q from the displacement (T, 2) of the centre sphere in m."""
    d0 = scene.displacement_amplitude
    return displacement[:, 1] / d0, -displacement[:, 0] / d0
