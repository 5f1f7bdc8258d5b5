"""Dispersion by simulation: spectral density of a sheet kicked at random, and distances of its peaks from theory.

The velocities of all spheres, transformed in space and time, have power only where the lattice has waves. Theory is
`granular_analysis.theory.bloch.real_modes`, with the inertia of LAMMPS's contact geometry.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from cases.fields import ROW, rest_of
from granular_analysis.measure.runs import load
from granular_analysis.measure.spectral_density import density as spectral_density
from granular_analysis.measure.spectral_density import peaks, projected
from granular_analysis.theory.bloch import real_modes
from granular_analysis.theory.contact import Contact

Floats = NDArray[np.float64]
# Distance, in resolutions, below which two waves make one peak: half the width of the main lobe of the window
LOBE = 2.0
# Effects, tables and keys that the theory holds; and guards that trigger when a sheet is no longer linear
EFFECTS = {f"effects.{name}" for name in ("adhesion", "shear", "rotation", "tracking", "width")}
TABLES = {"name", "wave", "start", "time", "effects", "output"}
KEYS = {f"sphere.{name}" for name in ("radius", "youngs_modulus", "poisson_ratio", "work_of_adhesion", "density")}
KEYS |= {f"packing.{name}" for name in ("rows", "columns", "ends", "sides", "contact_force")}
LINEAR = {"largest_slip": "contacts slid", "open_contacts": "contacts opened"}
FEWEST = 8  # fewest records; with fewer the window leaves hardly any


@dataclass(frozen=True)
class Sheet:
    """Velocities (T, N, 3) of all spheres, in any unit, at the times tau (T,); and the lattice, in lattice constants.

    `prestress` is the share of compression in the force at rest.
    """

    tau: Floats
    velocity: Floats
    position: Floats
    box: Floats
    poisson_ratio: float
    overlap_ratio: float
    prestress: float = 0.0

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Return the kicked sheet in a run folder.

        Raises
        ------
        ValueError
            For a run without a kick, with fewer than `FEWEST` records, with records too far apart, or with a sheet that
            the theory leaves out.
        """
        record = load(folder)
        scene, particles = record.scene, record.snapshots()
        if not scene.start.noise:
            raise ValueError("start.noise is 0: must be the run of granular-lmp kick")
        if len(particles) < FEWEST:
            raise ValueError(f"{len(particles)} records; a spectrum needs at least {FEWEST}: kick the sheet for longer")
        effects = {f"effects.{name}" for name, effect in record.info["effects"].items() if effect["on"]}
        said = {key for key in scene.departures() if key.partition(".")[0] not in TABLES}
        if left_out := sorted((effects - EFFECTS) | (said - KEYS)):
            raise ValueError(f"the linear theory here leaves out {', '.join(left_out)}")
        if "effects.rotation" not in effects or not (scene.shape.along_x and scene.shape.along_y):
            raise ValueError("the theory needs a periodic sheet whose spheres turn; choose another scene")
        for guard, what in LINEAR.items():
            if not record.info["guards"].get(guard, {}).get("quiet", True):
                raise ValueError(f"{what}; the kick is too hard: use a smaller wave.amplitude")
        velocity, spin = particles.stacks("velocity", "spin")
        sheet = cls(
            particles.tau,
            np.concatenate([velocity, spin[..., None]], axis=-1),
            rest_of(particles),
            np.array([scene.shape.columns, scene.shape.rows * ROW]),
            scene.sphere.poisson_ratio,
            scene.sphere.overlap_ratio,
            scene.sphere.contact_force / scene.sphere.holding_force,
        )
        longest = np.pi / sheet.theory(zone_path(sheet.box)[0]).max()
        if scene.time.sample >= longest:
            raise ValueError(f"time.sample = {scene.time.sample!r}: must be below {longest:.4g} tau, half a period")
        return sheet

    @property
    def resolution(self) -> float:
        """Resolution 2π/T, rad per τ."""
        return float(2 * np.pi / (self.tau[-1] - self.tau[0]))

    def theory(self, wavevectors: Floats) -> Floats:
        """Return the frequencies (K, 3) of the three branches, ascending, rad per τ."""
        ratio, overlap, share = (float(each) for each in (self.poisson_ratio, self.overlap_ratio, self.prestress))
        return real_modes(wavevectors, Contact(ratio, overlap_ratio=overlap, prestress=share))[0]


def zone_path(box: Floats) -> tuple[Floats, list[int]]:
    """Return the wave vectors (K, 2) on Γ–M–K–Γ that fit a periodic sheet, and the indices of the four corners.

    M = (0, 2π/√3) and K = (2π/3, 2π/√3), or (4π/3, 0), in rad per lattice constant; rows of spheres lie along x.

    Raises ValueError for a sheet that M and K do not fit: rows must be even and columns a multiple of 3.
    """
    columns, rows = round(box[0]), round(box[1] * 2 / np.sqrt(3))
    if columns % 3 or rows % 2:
        raise ValueError(f"{rows} rows x {columns} columns: rows must be even and columns a multiple of 3")
    x, y = 2 * np.pi / box
    up = [(0, j * y) for j in range(rows // 2)]
    across = [(i * x, rows // 2 * y) for i in range(columns // 3)]
    back = [(i * x, 0) for i in range(2 * columns // 3, -1, -1)]
    corners = np.cumsum([0, len(up), len(across), len(back) - 1]).tolist()
    return np.array(up + across + back), corners


def density(sheet: Sheet, wavevectors: Floats) -> tuple[Floats, Floats]:
    """Return frequencies (F,) and power (K, F), summed over both directions and all components, with a Hann window."""
    waves = projected(sheet.velocity, np.exp(-1j * wavevectors @ sheet.position.T))
    frequencies, power = spectral_density(sheet.tau, waves)
    return frequencies, power.sum(axis=1) / sheet.velocity.shape[1]


def misses(sheet: Sheet, wavevectors: Floats) -> tuple[Floats, Floats]:
    """Return distances in resolutions: (K, 3) from each branch to its nearest peak, and from each peak to theory.

    nan for branches that share a peak with another, and for the two branches at Γ that move the sheet as a whole.
    """
    frequencies, power = density(sheet, wavevectors)
    theory = sheet.theory(wavevectors)
    branches, others = np.full(theory.shape, np.nan), []
    for row, (expected, spectrum) in enumerate(zip(theory, power, strict=True)):
        found = peaks(frequencies, spectrum)
        distance = np.abs(found[:, None] - expected) / sheet.resolution
        gaps = np.concatenate([[np.inf], np.diff(expected) / sheet.resolution, [np.inf]])
        apart = (np.minimum(gaps[:-1], gaps[1:]) > LOBE) & (expected > sheet.resolution)
        branches[row, apart] = distance.min(axis=0, initial=np.inf)[apart]
        others.append(distance.min(axis=1))
    return branches, np.concatenate(others)
