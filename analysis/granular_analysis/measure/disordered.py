"""Coherent second harmonic of disordered crystals, averaged over seeds.

A disordered crystal scatters part of the wave from k into 2k, in first order and at the wave's own frequency, which
hides the second harmonic. Two runs of one crystal whose waves differ only in sign separate the two:

    even part (u₊ + u₋)/2: second order and fourth, ...        odd part (u₊ − u₋)/2: first order and third, ...

C₂(τ) is the amplitude of e^{2ik·r} along k in the even part. Its average over the seeds is the *coherent* second
harmonic, as a detector wider than the crystal would see it. The strength of the coherent part is the root of the mean
over τ of |⟨C₂⟩|² − var(C₂)/n; the second term removes the incoherent part that n seeds leave in |⟨C₂⟩|². √⟨|C₂|²⟩ is
the strength of both parts together.

Standard errors come from the jackknife over seeds. They do not contain errors that all seeds share: of the finite cell
and of the time step.

`over_seeds` makes the runs of one scene: waves of both signs in its crystals and in the perfect one.
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

# Allowed traits of the runs: plane waves in periodic sheets
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
        """Return value and error divided by a unit."""
        return Value(self.value / unit, self.error / unit)


def refuse(record: Record) -> None:
    """Raise ValueError with the names of the traits of a run that these measures leave out."""
    if left := sorted(traits_of(record) - MEASURED):
        raise ValueError(f"{record.folder}: the measures of disorder leave out {', '.join(left)}")


def coherent(record: Record, fields: Floats, harmonic: int = 1) -> Complexes:
    """Return the amplitudes (T, 2) of e^{ink·r} in fields (T, N, 2), along k and across; n = `harmonic`.

    r are the sites of the perfect lattice, from which spheres at rest are a few Δ0 away. The cell holds whole waves, so
    this is the discrete Fourier transform. The amplitudes have the unit of the fields.

    Raises ValueError if nk and −nk are the same wave vector of the lattice.
    """
    shape, places = record.scene.shape, Sites.of(record.scene).place / 2  # lattice constants
    places = places - places[shape.centre_row * shape.columns + shape.columns // 2]
    k = harmonic * wavevector_of(record.scene.wavenumber, record.scene.direction)
    if np.allclose(np.exp(2j * places @ k), 1, atol=1e-6):
        raise ValueError(
            f"{record.folder}: {harmonic}k is half a reciprocal lattice vector, so its wave has no direction; "
            "take another wave.wavenumber"
        )
    amplitudes = 2 / len(places) * np.einsum("tnc,n->tc", fields, np.exp(-1j * places @ k))
    return np.asarray(amplitudes @ frame(record.scene.direction).T)


def jackknife(estimate: Callable[[Complexes], ArrayLike], samples: Complexes) -> tuple[Floats, Floats]:
    """Return an estimate from samples (n, ...) and its standard error, by leaving out one sample at a time.

    The error is √((n − 1)/n Σ_i (e_i − ē)²) with e_i the estimate without sample i; it is nan for one sample. Raises
    ValueError without samples.
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
    """Return the coherent strength of C (n, T), the root of the mean over τ of |⟨C⟩|² − var(C)/n; 0 if negative."""
    n = len(amplitudes)
    power = np.abs(amplitudes.mean(axis=0)) ** 2
    if n > 1:
        power = power - np.var(amplitudes, axis=0, ddof=1) / n
    return float(np.sqrt(max(power.mean(), 0.0)))


def whole_strength(amplitudes: Complexes) -> float:
    """Return √⟨|C|²⟩ over seeds and τ, the strength of coherent and incoherent part together."""
    return float(np.sqrt(np.mean(np.abs(amplitudes) ** 2)))


def mean_strength(amplitudes: Complexes) -> Value:
    """Return the coherent strength of C (n, T) with its standard error over the seeds."""
    value, error = jackknife(strength, amplitudes)
    return Value(float(value), float(error))


def even_parts(runs: Iterable[Record]) -> Complexes:
    """Return C₂(τ) along k, (n, T) in D0, of the even part of each pair of runs, in the order of the seeds.

    Raises ValueError for a seed without exactly two runs, one of each sign (`wave.phase` 0 and π).
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
    """Second harmonic of a scene over n seeds.

    Attributes
    ----------
    scene : the scene that ran.
    tau : (T,).
    amplitudes, perfect : C₂ of the disordered crystals (n, T) and of the perfect one (1, T), in D0.
    """

    scene: Scene
    tau: Floats
    amplitudes: Complexes
    perfect: Complexes

    @property
    def spread(self) -> float:
        """Return s = σ 2R/Δ0, with σ the relative standard deviation of the radii."""
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
    """Run the crystals of a scene with the seeds 1 to `count`, and the perfect crystal, each with waves of both signs.

    The command granular-lmp runs them as sweeps in `folder`, and skips finished runs. Contacts may open. If the scene
    asks for no snapshots, there are twenty.

    Raises ValueError for fewer than two seeds, for a scene without disorder or with traits that these measures leave
    out, and for runs that fail.
    """
    if count < 2:
        raise ValueError(f"{count} seed: must be at least two, as the error comes from the spread over seeds")
    if not (scene.wave and (scene.disorder.radius or scene.disorder.density)):
        raise ValueError("the scene must have a wave, and disorder.radius or disorder.density above 0")
    apart = scene.output.particles or max(scene.time.duration / 20, scene.time.sample)
    scene = scene.with_values({"effects.contact_opening": True, "output.particles": apart})
    with TemporaryDirectory() as short:
        if left := sorted(traits_of(begun(scene, short)) - MEASURED):
            raise ValueError(f"the mean over seeds leaves out {', '.join(left)}")
    signs, seeds = "wave.phase=0.0,3.141592653589793", f"disorder.seed=1:{count}:{count}"
    equal = scene.with_values({"disorder.radius": 0.0, "disorder.density": 0.0})
    perfect = run_sweep(equal, Path(folder, "perfect"), signs)
    found = run_sweep(scene, Path(folder, "seeds"), signs, seeds)
    return Seeds(scene, found[0].snapshots().tau, even_parts(found), even_parts(perfect))
