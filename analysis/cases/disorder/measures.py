"""Remaining contacts, attenuation and resonance of disordered crystals, from sweeps over seeds.

The second harmonic is that of `granular_analysis.measure.disordered`.

**Attenuation.** Γ and the frequency shift are fitted (`granular_analysis.measure.coherent.decay`) to C₁(τ) e^{iΩτ},
averaged over the seeds, with Ω of the perfect sheet. This product turns slowly, so a few samples are enough.
C₁ = (C_u + iC_v/Ω)/2, from displacements and velocities, is the part that runs along k; C_u alone would beat with the
wave that is scattered straight back.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from granular_analysis.measure.coherent import decay
from granular_analysis.measure.disordered import Value, coherent, even_parts, jackknife, mean_strength, strength
from granular_analysis.second_harmonic import MODES
from granular_analysis.theory.bloch import branch_index, hexagonal, mode, wavevector_of
from granular_analysis.theory.choice import contact_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.errors import one_of
from granular_analysis.theory.second_order import Mixed, branch_of
from granular_analysis.theory.wave import resonance as perfect_resonance
from granular_lmp.runs.record import Record, Scene

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
# Variance of Gaussian deviates that are redrawn beyond 3: 1 − 6 exp(−9/2)/(√(2π) erf(3/√2))
CUT_VARIANCE = 0.97334


class Key(NamedTuple):
    """Parameters that the seeds of one point share.

    `spread` is s = σ 2R/Δ0 of the radii, `density` the relative standard deviation of densities; `prestress` is 1 under
    compression without adhesion; `rows` and `columns` give the size of the crystal.
    """

    mode: str
    wavenumber: float
    spread: float
    density: float
    prestress: float
    cell: tuple[int, int]

    @property
    def variance(self) -> float:
        """Return the relative variance of the drawn densities."""
        return CUT_VARIANCE * self.density**2


class Waves(NamedTuple):
    """Coherent amplitudes C (n, T) of n seeds at T times, in D0, with Ω and the contact of the perfect sheet."""

    tau: Floats
    amplitudes: Complexes
    frequency: float
    contact: Contact


def _spread(scene: Scene) -> float:
    """Return s = σ 2R/Δ0 of the radii."""
    return round(float(scene.disorder.radius / scene.sphere.overlap_ratio), 6)


def key_of(record: Record) -> Key:
    """Return the parameters that a run shares with runs of other seeds and signs."""
    scene = record.scene
    prestress = scene.sphere.contact_force / scene.sphere.holding_force
    return Key(
        scene.require_wave().mode,
        round(scene.wavenumber, 6),
        _spread(scene),
        scene.disorder.density,
        round(prestress, 6),
        (scene.shape.rows, scene.shape.columns),
    )


def contacts_left(records: Iterable[Record]) -> dict[tuple[float, float, float], Floats]:
    """Return the contacts per sphere Z of each crystal, (n,), by overlap ratio Δ0/2R, friction while relaxing, and s.

    Runs of perfect crystals are left out.
    """
    found: dict[tuple[float, float, float], dict[int, float]] = defaultdict(dict)
    for record in records:
        if "crystal" in record.info:
            scene = record.scene
            key = round(scene.sphere.overlap_ratio, 9), scene.packing.relax_friction, _spread(scene)
            found[key][record.scene.disorder.seed] = record.info["crystal"]["contacts_per_sphere"]
    return {key: np.array(list(values.values())) for key, values in sorted(found.items())}


def second_harmonics(records: Iterable[Record]) -> dict[Key, Waves]:
    """Return C₂(τ) along k of the even part of each pair of runs, see `even_parts`."""
    return {key: _waves(runs[0], even_parts(runs)) for key, runs in _grouped(records).items()}


def fundamentals(records: Iterable[Record]) -> dict[Key, Waves]:
    """Return C₁(τ) of the wave that runs along k in each run: the component along k for L, across k for others."""
    found = {}
    for key, runs in _grouped(records).items():
        parts: dict[int, Complexes] = {}
        for run in runs:
            seed, moved = run.scene.disorder.seed, 0 if key.mode == "L" else 1
            if seed in parts:
                raise ValueError(f"{run.folder}: seed {seed} of this wave has another run")
            displacement, velocity = run.snapshots().stacks("displacement", "velocity")
            shape, rate = (coherent(run, each)[:, moved] for each in (displacement, velocity))
            parts[seed] = (shape + 1j * rate / _frequency(run)) / 2
        found[key] = _waves(runs[0], np.array([parts[seed] for seed in sorted(parts)]))
    return found


def _grouped(records: Iterable[Record]) -> dict[Key, list[Record]]:
    groups: dict[Key, list[Record]] = defaultdict(list)
    for record in records:
        groups[key_of(record)].append(record)
    return dict(sorted(groups.items()))


def _waves(record: Record, parts: Complexes) -> Waves:
    return Waves(record.snapshots().tau, parts, _frequency(record), contact_of(record))


def _frequency(record: Record) -> float:
    """Return Ω of the perfect sheet under velocity Verlet, (2/h) arcsin(Ωh/2) with the step h of the run."""
    name = one_of(MODES, record.scene.require_wave().mode, "wave.mode")
    frequency = mode(name, record.scene.wavenumber, record.scene.direction, contact_of(record)).frequency
    step = record.scene.time.step
    return float(2 / step * np.arcsin(frequency * step / 2))


def measured(waves: Waves) -> Value:
    """Return the coherent strength of waves with its standard error over the seeds."""
    return mean_strength(waves.amplitudes)


class Resonance(NamedTuple):
    """A resonance relative to the closed form for equal spheres: shift in ξ, ratio of heights, ratio of widths."""

    shift: Value
    height: Value
    width: Value


def resonance(shape: Mapping[float, Waves], amplitude: float) -> Resonance:
    """Return shift, height and width of a resonance, from a least-squares fit of the closed form.

        strength(ξ) = h T(ξ_r + (ξ − ξ_r − shift)/w),    T: strength of the closed form, ξ_r: its resonance

    Parameters
    ----------
    shape : C₂ by wave number ξ, with the same seeds at each ξ.
    amplitude : D0/Δ0.

    Raises ValueError for fewer than four wave numbers, or different numbers of seeds.
    """
    xi, waves = np.array(list(shape)), list(shape.values())
    if len(xi) < 4 or len({each.amplitudes.shape for each in waves}) > 1:
        raise ValueError(f"{len(xi)} wave numbers: must be at least four, with equal numbers of seeds")
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


@lru_cache(maxsize=8)  # several resonances of a figure have the same crystal and times
def _perfect_strengths(place: float, contact: Contact, amplitude: float, tau: tuple[float, ...]) -> CubicSpline:
    """Return `perfect_strength` around a resonance, as a function of the wave number."""
    fine = np.linspace(0.5 * place, min(1.5 * place, 3.1), 1001)
    return CubicSpline(fine, perfect_strength(fine, contact, amplitude, np.array(tau)))


def perfect_strength(wavenumber: ArrayLike, contact: Contact, amplitude: float, tau: Floats) -> Floats:
    """Return the strength of C₂ of TR waves along y in a crystal of equal spheres, at wave numbers of any shape."""
    crystal, k = hexagonal(contact), np.multiply.outer(wavenumber, wavevector_of(1.0, 90.0)[None])
    wave = branch_of(crystal, k, branch_index("TR", k, contact))
    along = 0.5 * amplitude * Mixed(crystal, wave, wave).signal(tau)[..., 0, 1]
    return np.asarray(np.sqrt(np.mean(np.abs(along) ** 2, axis=-1)))


def half(spreads: Sequence[float], heights: Sequence[Value], perfect: float) -> Value:
    """Return the s at which a height is half that of the perfect crystal, by linear interpolation.

    Raises ValueError if the heights do not fall below half.
    """
    s, y = np.array([0.0, *spreads]), np.array([perfect, *(each.value for each in heights)]) / perfect
    errors = np.array([0.0, *(each.error for each in heights)]) / perfect
    below = np.flatnonzero(y < 0.5)
    if not below.size or np.any(np.diff(s) <= 0):
        raise ValueError("the heights must fall below half, and the spreads must ascend")
    j = int(below[0])
    share = (y[j - 1] - 0.5) / (y[j - 1] - y[j])
    slope = (y[j] - y[j - 1]) / (s[j] - s[j - 1])
    return Value(
        float(s[j - 1] + share * (s[j] - s[j - 1])),
        float(np.hypot((1 - share) * errors[j - 1], share * errors[j]) / abs(slope)),
    )


def attenuation(waves: Waves, after: float = 0.0) -> tuple[Value, Value]:
    """Return Γ and the frequency shift of fundamentals, in 1/t0, from the samples at τ ≥ `after`."""
    late = waves.tau >= after
    tau = waves.tau[late]

    def fit(amplitudes: Complexes) -> list[float]:
        found = decay(tau, amplitudes.mean(axis=0) * np.exp(1j * waves.frequency * tau))
        return [found.rate, found.frequency]

    (rate, shift), errors = jackknife(fit, waves.amplitudes[:, late])
    return Value(float(rate), float(errors[0])), Value(float(shift), float(errors[1]))
