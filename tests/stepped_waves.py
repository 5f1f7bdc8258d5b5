"""Waves in the lattice that LAMMPS steps, stepped without LAMMPS: records of any scene of one, by steps per sample."""

from collections import defaultdict
from collections.abc import Iterable, Mapping

import numpy as np

from granular_analysis.measure.norms import relative_error
from granular_analysis.second_harmonic import ModeName
from granular_analysis.theory import wave as theory
from granular_analysis.theory.contact import Contact
from granular_lmp import Record, Scene
from granular_lmp.accuracy.rounding import moving
from granular_lmp.runs.manifest import wall_seconds
from tests.conftest import PAPER
from tests.stepped import SAMPLE, TAU, limit, stepped

Wave = tuple[ModeName, float, float, float]  # mode, ξ, a = D0/Δ0, ν
NAMES = ("p", "q", "phi")
RECORDS = 120  # one every 0.5 τ


def scene_of(wave: Wave, tolerance: float, records: int = RECORDS) -> Scene:
    """The scene of a wave over so many samples; E is such that the overlap is the paper's for every ν."""
    name, xi, amplitude, nu = wave
    return PAPER.with_values(
        {
            "wave.mode": name,
            "wave.wavenumber": xi,
            "wave.amplitude": amplitude,
            "sphere.poisson_ratio": nu,
            "sphere.youngs_modulus": 73e9 * (1 - nu**2) / (1 - 0.17**2),
            "time.duration": SAMPLE * records,
            "time.tolerance": tolerance,
            # What is stepped here has neither ends nor rounding
            "packing.rows": 21,
            "time.allow_echo": True,
        }
    )


def in_lammps(wave: Wave, overlap_ratio: float = PAPER.sphere.overlap_ratio) -> theory.Wave:
    """The wave in contacts of LAMMPS's geometry."""
    name, wavenumber, amplitude, poisson_ratio = wave
    return theory.Wave.of_mode(name, wavenumber, amplitude, Contact(poisson_ratio, overlap_ratio=overlap_ratio))


class Stepped:
    """Trajectories of waves by steps per sample, each computed once."""

    def __init__(self, records: Mapping[Wave, int] | None = None) -> None:
        self.records = defaultdict(lambda: RECORDS, records or {})
        self.kept: dict[tuple[Wave, int], np.ndarray] = {}
        self.limits: dict[Wave, np.ndarray] = {}

    def prepare(self, wanted: Iterable[tuple[Wave, int]]) -> None:
        for wave, count in set(wanted) - set(self.kept):
            (self.kept[wave, count],) = stepped([in_lammps(wave)], count, records=self.records[wave], points=17)

    def single(self, wave: Wave, count: int) -> np.ndarray:
        self.prepare([(wave, count)])
        return self.kept[wave, count]

    def prepare_limits(self, waves: Iterable[Wave]) -> None:
        """Integrate the waves to which the others are compared."""
        for wave in waves:
            self.limits[wave] = limit([in_lammps(wave)], TAU[: self.records[wave] + 1])[0]

    def errors(self, wave: Wave, record: np.ndarray) -> dict[str, float]:
        """The errors of p, q, φ, of those that do not vanish by symmetry."""
        exact = self.limits[wave][: len(record)]
        names = moving(dict(zip(NAMES, exact.T, strict=True)))
        return {name: relative_error(record[:, i], exact[:, i]) for i, name in enumerate(NAMES) if name in names}

    def record(self, scene: Scene, wave: Wave) -> Record:
        """As if LAMMPS had run the scene."""
        p, q, phi = self.single(wave, scene.time.steps_per_sample).T
        info = {
            "steps": scene.time.steps,
            "samples": len(p),
            "wall_seconds": wall_seconds({}, {}),
        }
        return Record.of_centre(SAMPLE * np.arange(len(p)), p, q, phi, scene, info)
