"""Contacts left, attenuation and second harmonic of disordered crystals, read off sweeps over seeds.

**Second harmonic.** In a disordered crystal part of the wave is scattered from k into 2k, at its own frequency and in
first order, and hides the second harmonic. Two runs of one crystal whose waves differ in sign alone part the two:

    even part (u₊ + u₋)/2: second order and fourth, ...        odd part (u₊ − u₋)/2: first order and third, ...

Of the even part the amplitude C₂(τ) of e^{2ik·r} along k is averaged over the seeds: the *coherent* second harmonic,
as a detector wider than the crystal would see it. Its strength is the root of the mean over τ of
|⟨C₂⟩|² − var(C₂)/n, which has no bias by what n seeds leave of the incoherent part; √⟨|C₂|²⟩ is the whole part at 2k.

**Attenuation.** Γ and the shift of frequency are fitted (`granular_analysis.measure.coherent.decay`) to C₁(τ) e^{iΩτ},
averaged over the seeds, with Ω of the perfect sheet: what is left turns slowly, so a few samples do. C₁ = (C_u +
iC_v/Ω)/2 of displacements and velocities is what runs along k; without, the wave scattered straight back would beat
with it.

Standard errors are those of the jackknife over seeds, in which what seeds share is no error: the finite cell, the step.

`over_seeds` makes the runs that this takes of one scene: waves of both signs in its crystals and in the perfect one.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from granular_analysis.measure.coherent import decay
from granular_analysis.measure.runs import begun, run_sweep
from granular_analysis.measure.sheets import Sheet, component
from granular_analysis.second_harmonic import ModeName
from granular_analysis.theory import catalogue
from granular_analysis.theory.bloch import branch_index, frame, hexagonal, mode, wavevector_of
from granular_analysis.theory.choice import contact_of, traits_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.second_order import Mixed, branch_of
from granular_analysis.theory.wave import resonance as perfect_resonance
from granular_lmp.runs.record import Record, Scene

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_DISORDER = {"disorder.radius", "disorder.density", "disorder.seed"}
MEASURED = (
    catalogue.HOLDS["granular-analysis oblique"]
    | {catalogue.SLIDING, catalogue.OPENING, catalogue.COMPRESSED}
    | _DISORDER
) - {catalogue.OBLIQUE}


# Deviates are Gaussian, drawn again beyond 3: their variance is 1 − 6 exp(−9/2)/(√(2π) erf(3/√2))
CUT_VARIANCE = 0.97334


class Key(NamedTuple):
    """Parameters that the seeds of one point share.

    spread is s = σ 2R/Δ0 of the radii, density the relative deviation of densities; prestress is 1 under compression
    alone; rows and columns are the crystal's.
    """

    mode: str
    wavenumber: float
    spread: float
    density: float
    prestress: float
    cell: tuple[int, int]

    @property
    def variance(self) -> float:
        """Return the relative variance of the densities that are drawn."""
        return CUT_VARIANCE * self.density**2


class Waves(NamedTuple):
    """Coherent amplitudes C (n, T) of n seeds at T times, in D0; and Ω and the contact of the perfect sheet."""

    tau: Floats
    amplitudes: Complexes
    frequency: float
    contact: Contact


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
        raise ValueError(f"{record.folder}: {', '.join(left)}: the figures of disorder leave that out")


def spread_of(record: Record) -> float:
    """Return s = σ 2R/Δ0 of the radii."""
    return float(record.scene.disorder.radius / record.scene.sphere.overlap_ratio)


def key_of(record: Record) -> Key:
    """Return what a run shares with those of other seeds and signs."""
    scene = record.scene
    prestress = scene.sphere.contact_force / scene.sphere.holding_force
    return Key(
        scene.wave.mode,
        round(scene.wavenumber, 6),
        round(spread_of(record), 6),
        scene.disorder.density,
        round(prestress, 6),
        (scene.shape.rows, scene.shape.columns),
    )


def contacts_left(records: Iterable[Record]) -> dict[tuple[float, float, float], Floats]:
    """Return Z of every crystal, (n,), by overlap ratio Δ0/2R, friction on the way to rest, and s.

    Runs of perfect crystals are left out.
    """
    found: dict[tuple[float, float, float], dict[int, float]] = defaultdict(dict)
    for record in records:
        if "crystal" in record.info:
            scene = record.scene
            key = round(scene.sphere.overlap_ratio, 9), scene.packing.relax_friction, round(spread_of(record), 6)
            found[key][record.scene.disorder.seed] = record.info["crystal"]["contacts_per_sphere"]
    return {key: np.array(list(values.values())) for key, values in sorted(found.items())}


def second_harmonics(records: Iterable[Record]) -> dict[Key, Waves]:
    """Return C₂(τ) along k of the even part of every pair of runs.

    Raises ValueError for a run without its other sign (`wave.phase` 0 and π).
    """
    found = {}
    for key, seeds in _grouped(records).items():
        parts = []
        for seed, runs in seeds.items():
            signs = sorted(np.cos(run.scene.wave.phase) for run in runs)
            if len(runs) != 2 or not np.allclose(signs, [-1, 1], atol=1e-9):
                raise ValueError(f"{runs[0].folder}: seed {seed} needs two runs, with wave.phase = 0 and pi")
            fields = [run.snapshots().stack("displacement") for run in runs]
            parts.append(coherent(runs[0], (fields[0] + fields[1]) / 2, 2)[:, 0])
        found[key] = _waves(runs[0], parts)
    return found


def fundamentals(records: Iterable[Record]) -> dict[Key, Waves]:
    """Return C₁(τ) of what runs along k of every run, its component along k for L and across for the others."""
    found = {}
    for key, seeds in _grouped(records).items():
        parts = []
        for seed, runs in seeds.items():
            if len(runs) > 1:
                raise ValueError(f"{runs[1].folder}: seed {seed} of this wave has another run, {runs[0].folder}")
            run = runs[0]
            moved = 0 if key.mode == "L" else 1
            particles = run.snapshots()
            displacement, velocity = particles.stacks("displacement", "velocity")
            shape, rate = (coherent(run, each)[:, moved] for each in (displacement, velocity))
            parts.append((shape + 1j * rate / _frequency(run)) / 2)
        found[key] = _waves(run, parts)
    return found


def _grouped(records: Iterable[Record]) -> dict[Key, dict[int, list[Record]]]:
    groups: dict[Key, dict[int, list[Record]]] = defaultdict(lambda: defaultdict(list))
    for record in records:
        groups[key_of(record)][record.scene.disorder.seed].append(record)
    return {key: dict(sorted(seeds.items())) for key, seeds in sorted(groups.items())}


def _waves(record: Record, parts: list[Complexes]) -> Waves:
    return Waves(record.snapshots().tau, np.array(parts), _frequency(record), contact_of(record))


def _frequency(record: Record) -> float:
    """Return Ω of the perfect sheet as velocity Verlet has it, (2/h) arcsin(Ωh/2) with the step h of the run."""
    name: ModeName = record.scene.wave.mode  # type: ignore[assignment]  # checked by the scene
    frequency = mode(name, record.scene.wavenumber, record.scene.direction, contact_of(record)).frequency
    step = record.scene.time.step
    return float(2 / step * np.arcsin(frequency * step / 2))


def coherent(record: Record, fields: Floats, harmonic: int = 1) -> Complexes:
    """Return the amplitudes (T, 2) of e^{ink·r}, n = `harmonic`, along k and across, of fields (T, N, 2).

    Phases are those at the places in the lattice, from which spheres at rest are a few Δ0 away; the cell holds whole
    waves, so this is the discrete Fourier transform.

    Raises ValueError where nk and −nk are one wave vector of the lattice.
    """
    shape = record.scene.shape
    places = Sheet(shape.rows, shape.columns).rest
    places = places - places[shape.centre_row * shape.columns + shape.columns // 2]
    k = harmonic * wavevector_of(record.scene.wavenumber, record.scene.direction)
    if np.allclose(np.exp(2j * places @ k), 1, atol=1e-6):
        raise ValueError(
            f"{record.folder}: {harmonic}k is half a reciprocal wave vector: its wave has no direction; "
            "take another wave.wavenumber"
        )
    return component(fields, places, k) @ frame(record.scene.direction).T


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


def measured(waves: Waves, estimate: Callable[[Complexes], float] = strength) -> Value:
    """Return a strength of waves with its standard error over the seeds."""
    value, error = jackknife(estimate, waves.amplitudes)
    return Value(float(value), float(error))


class Seeds(NamedTuple):
    """The second harmonic of a scene over seeds: of its crystals, and of the perfect one.

    scene is the one that ran; spread is s = σ 2R/Δ0.
    """

    scene: Scene
    spread: float
    waves: Waves
    perfect: Waves

    @property
    def mean(self) -> Value:
        """Return the coherent strength and its standard error, in D0."""
        return measured(self.waves)

    @property
    def equal(self) -> float:
        """Return the strength in the perfect crystal, in D0."""
        return strength(self.perfect.amplitudes)


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
    (perfect,) = second_harmonics(run_sweep(equal, Path(folder, "perfect"), signs)).values()
    ((key, waves),) = second_harmonics(run_sweep(scene, Path(folder, "seeds"), signs, seeds)).items()
    return Seeds(scene, key.spread, waves, perfect)


class Resonance(NamedTuple):
    """A resonance beside the closed form of equal spheres: its shift in ξ, its height and width over theirs."""

    shift: Value
    height: Value
    width: Value


def resonance(shape: Mapping[float, Waves], amplitude: float) -> Resonance:
    """Return where a resonance lies, how high and wide it is: the closed form is shifted, scaled and stretched to it.

        strength(ξ) = h T(ξ_r + (ξ − ξ_r − shift)/w),    T: strength of the closed form, ξ_r: its resonance

    by least squares.

    Parameters
    ----------
    shape : C₂ by wave number ξ, of the same seeds each.
    amplitude : D0/Δ0.

    Raises ValueError for fewer than four wave numbers, or if one has other seeds.
    """
    xi, waves = np.array(list(shape)), list(shape.values())
    if len(xi) < 4 or len({each.amplitudes.shape for each in waves}) > 1:
        raise ValueError(f"{len(xi)} wave numbers must be four or more, of as many seeds each")
    contact, tau = waves[0].contact, waves[0].tau
    place = perfect_resonance(contact)
    if place is None:
        raise ValueError("equal spheres of this contact have no resonance")
    template = _perfect_strengths(place, contact, amplitude, tuple(tau.tolist()))

    def fit(samples: Complexes) -> Floats:
        strengths = [strength(samples[:, i]) for i in range(len(xi))]

        def off(x: Floats) -> Floats:
            return np.asarray(x[1] * template(place + (xi - place - x[0]) / x[2]) / max(strengths) - scaled)

        scaled = np.array(strengths) / max(strengths)
        return np.asarray(least_squares(off, [0.0, 0.8, 1.1], x_scale=[0.02, 1.0, 1.0]).x)

    values, errors = jackknife(fit, np.stack([each.amplitudes for each in waves], axis=1))
    return Resonance(*(Value(float(value), float(error)) for value, error in zip(values, errors, strict=True)))


@lru_cache(maxsize=8)  # a figure has several resonances of one crystal, at the same times
def _perfect_strengths(place: float, contact: Contact, amplitude: float, tau: tuple[float, ...]) -> CubicSpline:
    """Return `perfect_strength` around a resonance, as a function of the wave number."""
    fine = np.linspace(0.5 * place, min(1.5 * place, 3.1), 1001)
    return CubicSpline(fine, perfect_strength(fine, contact, amplitude, np.array(tau)))


def perfect_strength(wavenumber: ArrayLike, contact: Contact, amplitude: float, tau: Floats) -> Floats:
    """Return the strength of C₂ of TR waves along y between equal spheres, (...) as the wave numbers."""
    crystal, k = hexagonal(contact), np.multiply.outer(wavenumber, wavevector_of(1.0, 90.0)[None])
    wave = branch_of(crystal, k, branch_index("TR", k, contact))
    along = 0.5 * amplitude * Mixed(crystal, wave, wave).signal(tau)[..., 0, 1]
    return np.asarray(np.sqrt(np.mean(np.abs(along) ** 2, axis=-1)))


def half(spreads: Sequence[float], heights: Sequence[Value], perfect: float) -> Value:
    """Return the s at which a height is half that of the perfect crystal, linear between the points around it.

    Raises ValueError if the heights do not fall below half.
    """
    s, y = np.array([0.0, *spreads]), np.array([perfect, *(each.value for each in heights)]) / perfect
    errors = np.array([0.0, *(each.error for each in heights)]) / perfect
    below = np.flatnonzero(y < 0.5)
    if not below.size or np.any(np.diff(s) <= 0):
        raise ValueError("the heights must fall below half, and the spreads be in ascending order")
    j = int(below[0])
    share = (y[j - 1] - 0.5) / (y[j - 1] - y[j])
    slope = (y[j] - y[j - 1]) / (s[j] - s[j - 1])
    return Value(
        float(s[j - 1] + share * (s[j] - s[j - 1])),
        float(np.hypot((1 - share) * errors[j - 1], share * errors[j]) / abs(slope)),
    )


def attenuation(waves: Waves, after: float = 0.0) -> tuple[Value, Value]:
    """Return Γ and the shift of frequency of fundamentals, in 1/t0, from the samples at τ ≥ after."""
    late = waves.tau >= after
    tau = waves.tau[late]

    def fit(amplitudes: Complexes) -> list[float]:
        found = decay(tau, amplitudes.mean(axis=0) * np.exp(1j * waves.frequency * tau))
        return [found.rate, found.frequency]

    (rate, shift), errors = jackknife(fit, waves.amplitudes[:, late])
    return Value(float(rate), float(errors[0])), Value(float(shift), float(errors[1]))
