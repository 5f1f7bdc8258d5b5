"""What disorder does to plane waves, read off sweeps over seeds: contacts left, attenuation, the second harmonic.

**Second harmonic.** In a disordered crystal part of the wave is scattered from k into 2k, at its own frequency and in
first order, and hides the second harmonic. Two runs of one crystal whose waves differ in sign alone part the two:

    even part (u₊ + u₋)/2: second order and fourth, ...        odd part (u₊ − u₋)/2: first order and third, ...

Of the even part the amplitude C₂(τ) of e^{2ik·r} along k is averaged over the seeds: the *coherent* second harmonic,
as a detector wider than the crystal would see it. Its strength is the root of the mean over τ of
|⟨C₂⟩|² − var(C₂)/n, which has no bias by what n seeds leave of the incoherent part; √⟨|C₂|²⟩ is the whole part at 2k.

**Attenuation.** Γ and the shift of frequency are fitted (`analysis.measure.coherent.decay`) to C₁(τ) e^{iΩτ}, averaged
over the seeds, with Ω of the perfect sheet: what is left turns slowly, so a few samples do.

Standard errors are those of the jackknife over seeds, in which what seeds share is no error: the finite cell, the step.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.measure.coherent import decay, project
from analysis.theory import catalogue
from analysis.theory.bloch import wavevector_of
from analysis.theory.choice import contact_of, traits_of
from analysis.theory.contact import Contact
from analysis.theory.directions import mode
from analysis.theory.quasilinear import Sheet
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_DISORDER = {"disorder.radius", "disorder.density", "disorder.seed"}
MEASURED = (
    catalogue.HOLDS["analysis.figures.oblique"] | catalogue.LAMMPS_ALONE | {catalogue.COMPRESSED} | _DISORDER
) - {catalogue.OBLIQUE}


class Key(NamedTuple):
    """What the seeds of one point share.

    spread is s = σ 2R/Δ0 of the radii, density their relative deviation; prestress is 1 under compression alone.
    """

    mode: str
    wavenumber: float
    spread: float
    density: float
    prestress: float


class Waves(NamedTuple):
    """Coherent amplitudes over n seeds at T times: C of e^{ik·r} or e^{2ik·r}, (n, T), in D0."""

    tau: Floats
    amplitudes: Complexes


@dataclass(frozen=True)
class Value:
    """A number and its standard error."""

    value: float
    error: float


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
    )


def contacts_left(records: Iterable[Record]) -> dict[tuple[float, float], Floats]:
    """Return Z of every crystal, (n,), by overlap ratio Δ0/2R and s; runs of perfect crystals are left out."""
    found: dict[tuple[float, float], dict[int, float]] = defaultdict(dict)
    for record in records:
        if "crystal" in record.info:
            key = round(record.scene.sphere.overlap_ratio, 9), round(spread_of(record), 6)
            found[key][record.scene.disorder.seed] = record.info["crystal"]["contacts_per_sphere"]
    return {key: np.array(list(values.values())) for key, values in sorted(found.items())}


def second_harmonics(records: Iterable[Record]) -> dict[Key, Waves]:
    """Return C₂(τ) along k of the even part of every pair of runs.

    Raises ValueError for a run without its other sign (`wave.phase` 0 and π).
    """
    pairs: dict[Key, dict[int, list[Record]]] = defaultdict(lambda: defaultdict(list))
    for record in records:
        pairs[key_of(record)][record.scene.disorder.seed].append(record)
    found = {}
    for key, seeds in sorted(pairs.items()):
        parts = []
        for seed, runs in sorted(seeds.items()):
            signs = sorted(np.cos(run.scene.wave.phase) for run in runs)
            if len(runs) != 2 or not np.allclose(signs, [-1, 1], atol=1e-9):
                raise ValueError(f"{runs[0].folder}: seed {seed} needs two runs, with wave.phase = 0 and pi")
            taus, fields = zip(*map(_displacements, runs), strict=True)
            parts.append(coherent(runs[0], (fields[0] + fields[1]) / 2)[1][:, 0])
        found[key] = Waves(taus[0], np.array(parts))
    return found


def fundamentals(records: Iterable[Record]) -> dict[Key, tuple[Waves, Contact]]:
    """Return C₁(τ), along k for L and across for the others, of every run, and the contact."""
    found: dict[Key, list[tuple[Floats, Complexes, Contact]]] = defaultdict(list)
    for record in records:
        tau, field = _displacements(record)
        component = 0 if record.scene.wave.mode == "L" else 1
        found[key_of(record)].append((tau, coherent(record, field)[0][:, component], contact_of(record)))
    return {
        key: (Waves(runs[0][0], np.array([each[1] for each in runs])), runs[0][2]) for key, runs in sorted(found.items())
    }


def _displacements(record: Record) -> tuple[Floats, Floats]:
    particles = record.snapshots()
    return particles.tau, particles.stack("displacement")


def coherent(record: Record, field: Floats) -> Complexes:
    """Return the amplitudes (2, T, 2) at k and 2k, along and across, of a field (T, N, 2) on the sheet of a run.

    Phases are those at the places in the lattice, from which spheres at rest are a few Δ0 away.
    """
    shape, sphere = record.scene.shape, record.scene.sphere
    places = Sheet(shape.rows, shape.columns, sphere.poisson_ratio, sphere.overlap_ratio).rest
    places = places - places[shape.centre_row * shape.columns + shape.columns // 2]
    return project(places, field, wavevector_of(record.scene.wavenumber, record.scene.direction).tolist()).amplitudes


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


def resonance(wavenumbers: ArrayLike, strengths: ArrayLike) -> tuple[float, float, float]:
    """Return position, height and full width at half power of a resonance: a parabola through 1/strength².

    Raises ValueError unless there are four points, all positive, around a maximum.
    """
    x, y = np.asarray(wavenumbers, float), np.asarray(strengths, float)
    if len(x) < 4 or x.shape != y.shape or np.any(y <= 0):
        raise ValueError(f"{len(x)} strengths must be four or more, all positive")
    centre = x.mean()
    # Weights y²: what is far down, where a line is no Lorentzian, counts less
    c, b, a = np.polynomial.polynomial.polyfit(x - centre, y**-2.0, 2, w=y**2)
    place, floor = -b / (2 * a) if a else np.inf, c - b**2 / (4 * a) if a else 0.0
    if not (a > 0 and floor > 0 and x.min() < centre + place < x.max()):
        raise ValueError("there is no maximum among the strengths")
    return float(centre + place), float(floor**-0.5), float(2 * np.sqrt(floor / a))


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


def attenuation(key: Key, waves: Waves, contact: Contact, after: float = 0.0) -> tuple[Value, Value]:
    """Return Γ and the shift of frequency of a wave, in 1/t0, from the samples at τ ≥ after."""
    name = key.mode
    frequency = mode(name, key.wavenumber, 90.0, contact).frequency  # type: ignore[arg-type]  # checked by the scene
    late = waves.tau >= after
    tau = waves.tau[late]

    def fit(amplitudes: Complexes) -> list[float]:
        found = decay(tau, amplitudes.mean(axis=0) * np.exp(1j * frequency * tau))
        return [found.rate, found.frequency]

    (rate, shift), errors = jackknife(fit, waves.amplitudes[:, late])
    return Value(float(rate), float(errors[0])), Value(float(shift), float(errors[1]))
