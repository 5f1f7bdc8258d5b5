"""The coherent second harmonic of disordered crystals, over seeds.

In a disordered crystal part of the wave is scattered from k into 2k, at its own frequency and in first order, and hides
the second harmonic. Two runs of one crystal whose waves differ in sign alone part the two:

    even part (u₊ + u₋)/2: second order and fourth, ...        odd part (u₊ − u₋)/2: first order and third, ...

Of the even part the amplitude C₂(τ) of e^{2ik·r} along k is averaged over the seeds: the *coherent* second harmonic,
as a detector wider than the crystal would see it. Its strength is the root of the mean over τ of
|⟨C₂⟩|² − var(C₂)/n, which has no bias by what n seeds leave of the incoherent part; √⟨|C₂|²⟩ is the whole part at 2k.

Standard errors are those of the jackknife over seeds, in which what seeds share is no error: the finite cell, the step.

`over_seeds` makes the runs that this takes of one scene: waves of both signs in its crystals and in the perfect one.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.measure.runs import begun, run_sweep
from granular_analysis.measure.strikes import Sites
from granular_analysis.theory import catalogue
from granular_analysis.theory.bloch import frame, wavevector_of
from granular_analysis.theory.choice import traits_of
from granular_lmp.runs.record import Record, Scene

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

# Traits of runs that are measured here: plane waves in periodic sheets
MEASURED = (
    catalogue.HOLDS["second-order"] - {*catalogue.HELD, catalogue.JKR, catalogue.OBLIQUE}
    | {catalogue.SLIDING, catalogue.OPENING, catalogue.COMPRESSED}
    | {"disorder.radius", "disorder.density", "disorder.seed"}
)


class Value(NamedTuple):
    """A number and its standard error."""

    value: float
    error: float

    def __truediv__(self, unit: float) -> "Value":
        """Return both in another unit."""
        return Value(self.value / unit, self.error / unit)


def refuse(record: Record) -> None:
    """Raise ValueError for a run with anything that these measures do not know, by name."""
    if left := sorted(traits_of(record) - MEASURED):
        raise ValueError(f"{record.folder}: {', '.join(left)}: the figures of disorder leave it out")


def coherent(record: Record, fields: Floats, harmonic: int = 1) -> Complexes:
    """Return the amplitudes (T, 2) of e^{ink·r}, n = `harmonic`, along k and across, of fields (T, N, 2).

    Phases are those at the places in the lattice, from which spheres at rest are a few Δ0 away; the cell holds whole
    waves, so this is the discrete Fourier transform.

    Raises ValueError where nk and −nk are one wave vector of the lattice.
    """
    shape, places = record.scene.shape, Sites.of(record.scene).place / 2  # lattice constants
    places = places - places[shape.centre_row * shape.columns + shape.columns // 2]
    k = harmonic * wavevector_of(record.scene.wavenumber, record.scene.direction)
    if np.allclose(np.exp(2j * places @ k), 1, atol=1e-6):
        raise ValueError(
            f"{record.folder}: {harmonic}k is half a reciprocal wave vector: its wave has no direction; "
            "take another wave.wavenumber"
        )
    amplitudes = 2 / len(places) * np.einsum("tnc,n->tc", fields, np.exp(-1j * places @ k))
    return np.asarray(amplitudes @ frame(record.scene.direction).T)


def jackknife(estimate: Callable[[Complexes], ArrayLike], samples: Complexes) -> tuple[Floats, Floats]:
    """Return an estimate from samples (n, ...) and its standard error by leaving out one at a time.

    The error is nan for one sample. Raises ValueError without any.
    """
    n = len(samples)
    if n == 0:
        raise ValueError("there is no sample to estimate from")
    whole = np.asarray(estimate(samples), dtype=float)
    if n == 1:
        return whole, np.full_like(whole, np.nan)
    left = np.array([estimate(np.delete(samples, i, axis=0)) for i in range(n)], dtype=float)
    return whole, np.sqrt((n - 1) / n * np.sum((left - left.mean(axis=0)) ** 2, axis=0))


def strength(amplitudes: Complexes) -> float:
    """Return the coherent strength of C (n, T): the root of the mean over τ of |⟨C⟩|² − var(C)/n, 0 if negative."""
    n = len(amplitudes)
    power = np.abs(amplitudes.mean(axis=0)) ** 2
    if n > 1:
        power = power - np.var(amplitudes, axis=0, ddof=1) / n
    return float(np.sqrt(max(power.mean(), 0.0)))


def whole_strength(amplitudes: Complexes) -> float:
    """Return √⟨|C|²⟩ over seeds and τ: coherent and incoherent part together."""
    return float(np.sqrt(np.mean(np.abs(amplitudes) ** 2)))


def mean_strength(amplitudes: Complexes) -> Value:
    """Return the coherent strength of C (n, T) with its standard error over the seeds."""
    value, error = jackknife(strength, amplitudes)
    return Value(float(value), float(error))


def even_parts(runs: Iterable[Record]) -> Complexes:
    """Return C₂(τ) along k (n, T) of the even part of every pair of runs of one wave, by seed.

    Raises ValueError for a run without its other sign (`wave.phase` 0 and π).
    """
    seeds: dict[int, list[Record]] = defaultdict(list)
    for record in runs:
        seeds[record.scene.disorder.seed].append(record)
    parts = []
    for seed, pair in sorted(seeds.items()):
        signs = sorted(np.cos(run.scene.require_wave().phase) for run in pair)
        if len(pair) != 2 or not np.allclose(signs, [-1, 1], atol=1e-9):
            raise ValueError(f"{pair[0].folder}: seed {seed} needs two runs, with wave.phase = 0 and pi")
        fields = [run.snapshots().stack("displacement") for run in pair]
        parts.append(coherent(pair[0], (fields[0] + fields[1]) / 2, 2)[:, 0])
    return np.array(parts)


class Seeds(NamedTuple):
    """The second harmonic of a scene over seeds: C₂ of its crystals (n, T) and of the perfect one (1, T), in D0.

    scene is the one that ran.
    """

    scene: Scene
    tau: Floats
    amplitudes: Complexes
    perfect: Complexes

    @property
    def spread(self) -> float:
        """Return s = σ 2R/Δ0 of the radii."""
        return float(self.scene.disorder.radius / self.scene.sphere.overlap_ratio)

    @property
    def mean(self) -> Value:
        """Return the coherent strength and its standard error, in D0."""
        return mean_strength(self.amplitudes)

    @property
    def equal(self) -> float:
        """Return the strength in the perfect crystal, in D0."""
        return strength(self.perfect)


def over_seeds(scene: Scene, count: int, folder: str | Path) -> Seeds:
    """Run the crystals of a scene with the seeds 1 to `count`, and the perfect one, each with waves of both signs.

    The command granular-lmp runs them, as sweeps in `folder`; those that are finished are not run again. Contacts may
    open, and snapshots are taken twenty times where the scene asks for none.

    Raises ValueError for fewer than two seeds, a scene without disorder, or that these measures do not know, and for
    runs that fail.
    """
    if count < 2:
        raise ValueError(f"{count} seed: must be two or more, as the error is found from how seeds differ")
    if not (scene.wave and (scene.disorder.radius or scene.disorder.density)):
        raise ValueError("disorder.radius = 0: must be above 0, or disorder.density, in the scene of a wave")
    apart = scene.output.particles or max(scene.time.duration / 20, scene.time.sample)
    scene = scene.with_values({"effects.contact_opening": True, "output.particles": apart})
    with TemporaryDirectory() as short:
        if left := sorted(traits_of(begun(scene, short)) - MEASURED):
            raise ValueError(f"{', '.join(left)}: the mean over seeds leaves that out")
    signs, seeds = "wave.phase=0.0,3.141592653589793", f"disorder.seed=1:{count}:{count}"
    equal = scene.with_values({"disorder.radius": 0.0, "disorder.density": 0.0})
    perfect = run_sweep(equal, Path(folder, "perfect"), signs)
    found = run_sweep(scene, Path(folder, "seeds"), signs, seeds)
    return Seeds(scene, found[0].snapshots().tau, even_parts(found), even_parts(perfect))
