"""The amplitude of the generated wave, measured in LAMMPS runs over the wave number, and its zero and its pole.

At 2ξ the lattice is one oscillator of frequency w̃, at rest at τ = 0 and driven by B sin 2Ωτ:

    p = B S(τ) + c cos w̃τ + s sin w̃τ (+ the fundamental, for L),    S'' + w̃²S = sin 2Ωτ,  S(0) = S'(0) = 0

S stays regular, and apart from cos w̃τ and sin w̃τ, at the resonance, where sin 2Ωτ does not. The amplitude of the wave
that runs with the fundamental is A = B/(w̃² − 4Ω²), with its sign; free waves of any size do not enter it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from cases.pairs import by_wave
from granular_analysis.theory.catalogue import HOLDS, OBLIQUE
from granular_analysis.theory.choice import traits_of, wave_of
from granular_analysis.theory.wave import Wave, nonlinearity
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
HELD = HOLDS["second-order"] - {OBLIQUE}  # traits of a run that the closed form holds
# Runs on which a location rests, and degree of the polynomial through them. A degree or two runs more or less move the
# locations of `make spectrum` by less than 3e-6.
AROUND, DEGREE = 8, 4


@dataclass(frozen=True)
class Frequencies:
    """Ω of the fundamental and w̃ of free waves at 2ξ, rad per τ, with standard errors: 0 for those of a formula."""

    fundamental: float
    free: float
    fundamental_error: float = 0.0
    free_error: float = 0.0

    @property
    def detuning(self) -> float:
        """w̃² − 4Ω², which vanishes at the resonance."""
        return (self.free - 2 * self.fundamental) * (self.free + 2 * self.fundamental)

    @property
    def detuning_error(self) -> float:
        """Standard error of it."""
        return float(np.hypot(2 * self.free * self.free_error, 8 * self.fundamental * self.fundamental_error))


@dataclass(frozen=True)
class Point:
    """A run: its wave, the generated amplitude in εD0 with its standard error, and that of theory, P̃1/2i.

    amplitude is a = D0/Δ0 of the fundamental, which theory does not depend on in these units.
    """

    mode: str
    amplitude: float
    wavenumber: float
    value: float
    error: float
    predicted: float

    @property
    def deviation(self) -> float:
        """Relative deviation of the measured from the predicted amplitude."""
        return self.value / self.predicted - 1


def least_squares_fit(columns: Sequence[Floats], signal: Floats) -> tuple[Floats, Floats, Floats]:
    """Factors of the columns in a signal, their standard errors, and what is left of the signal.

    The errors are those of white noise. Breaks where what is left is not noise but other waves: they are then a measure
    of it, no more.
    """
    matrix = np.column_stack(columns)
    sizes = np.linalg.norm(matrix, axis=0)
    factors, *_ = np.linalg.lstsq(matrix / sizes, signal)
    rest = signal - matrix / sizes @ factors
    variance = rest @ rest / (len(signal) - len(sizes))
    covariance = variance * np.linalg.inv((matrix / sizes).T @ (matrix / sizes))
    return factors / sizes, np.sqrt(np.diag(covariance)) / sizes, rest


def response(tau: Floats, frequencies: Frequencies) -> Floats:
    """S(τ) of the module's equation, regular at the resonance.

    S = [sin(w̃τ)/w̃ − τ cos(sτ) sin(dτ)/(dτ)]/2s,    s = Ω + w̃/2,  d = Ω − w̃/2
    """
    mean, half = frequencies.fundamental + frequencies.free / 2, frequencies.fundamental - frequencies.free / 2
    own = np.sin(frequencies.free * tau) / frequencies.free
    return (own - tau * np.cos(mean * tau) * np.sinc(half * tau / np.pi)) / (2 * mean)


def pair(frequency: float, tau: Floats) -> list[Floats]:
    """Return cos and sin of a frequency."""
    return [np.cos(frequency * tau), np.sin(frequency * tau)]


def columns(record: Record, frequencies: Frequencies) -> list[Floats]:
    """Return time functions of p: S, then the free waves; for L the fundamental and its slow drift, of order a²τ."""
    fundamental = pair(frequencies.fundamental, record.tau) if record.scene.require_wave().mode == "L" else []
    drift = [record.tau * each for each in fundamental]
    return [response(record.tau, frequencies), *pair(frequencies.free, record.tau), *fundamental, *drift]


def linear(wave: Wave) -> Frequencies:
    """Both frequencies from the linear dispersion relation."""
    return Frequencies(wave.mode.frequency, wave.free_frequency)


def tuned(made: Callable[[float], list[Floats]], signal: Floats, start: float) -> tuple[float, float]:
    """Frequency at which the columns made for it leave the least of a signal, near `start`, and its standard error.

    Breaks where the start is off by more than a phase of about π over the record.
    """
    scaled = signal / np.sqrt(np.mean(signal**2))
    found = least_squares(lambda x: least_squares_fit(made(x[0]), scaled)[2], [start], method="lm", xtol=1e-12)
    noise = 2 * found.cost / (len(signal) - len(made(start)) - 1)
    return float(found.x[0]), float(np.sqrt(noise) / np.linalg.norm(found.jac))


def measured(record: Record, start: Frequencies) -> Frequencies:
    """Both frequencies of a TR or RT run from the run itself: Ω from q(τ), then w̃ from p(τ).

    Breaks where p is not the second harmonic, at the antiresonance: w̃ is then that of nothing.
    """
    fundamental, its_error = tuned(lambda frequency: pair(frequency, record.tau), record.q, start.fundamental)

    def made(free: float) -> list[Floats]:
        return columns(record, Frequencies(fundamental, free))

    free, error = tuned(made, record.p, start.free)
    return Frequencies(fundamental, free, its_error, error)


def point(record: Record) -> Point:
    """Return the generated amplitude of a run, by the frequencies of the linear lattice."""
    wave = wave_of(record)
    epsilon = nonlinearity(wave.contact, wave.amplitude)
    frequencies = linear(wave)
    factors, errors, _ = least_squares_fit(columns(record, frequencies), record.p)
    scale = epsilon * frequencies.detuning
    return Point(
        wave.mode.name,
        wave.amplitude,
        wave.mode.wavenumber,
        float(factors[0] / scale),
        float(abs(errors[0] / scale)),
        float(wave.framed(wave.doubled.forced())[0].imag) / 2 * wave.amplitude / epsilon,
    )


def crossing(x: ArrayLike, y: ArrayLike, errors: ArrayLike) -> tuple[float, float]:
    """Zero x of y(x), and its standard error: root of a polynomial fitted to the points around, weighted.

    Changes of sign away from which |y| falls are poles, and left out; of several others the one of smallest |y| is
    taken. Where the points scatter about the polynomial by more than their errors, these are taken to be as large.

    Raises ValueError where y does not change sign, or there are too few points.
    """
    x, y, errors = np.asarray(x, dtype=float), np.asarray(y, dtype=float), np.asarray(errors, dtype=float)
    if len(x) < AROUND:
        raise ValueError(f"{len(x)} points; a crossing needs {AROUND}")
    order = np.argsort(x)
    size, negative = np.abs(y[order]), np.signbit(y[order])
    changes = 1 + np.flatnonzero(negative[2:-1] != negative[1:-2])
    zeros = [i for i in changes if size[i - 1] > size[i] and size[i + 1] < size[i + 2]]
    if not zeros:
        raise ValueError(f"no change of sign through zero from {min(x):.4g} to {max(x):.4g}")
    left = min(zeros, key=lambda i: size[i] + size[i + 1])
    first = int(np.clip(left + 1 - AROUND // 2, 0, len(x) - AROUND))
    near = order[first : first + AROUND]
    centre = x[order[left : left + 2]].mean()
    factors, covariance = np.polyfit(x[near] - centre, y[near], DEGREE, w=1 / errors[near], cov="unscaled")
    scatter = np.sum(((np.polyval(factors, x[near] - centre) - y[near]) / errors[near]) ** 2) / (AROUND - DEGREE - 1)
    roots = np.roots(factors)
    root = float(roots[np.argmin(np.abs(roots))].real)
    powers = root ** np.arange(DEGREE, -1, -1)
    error = np.sqrt(powers @ covariance @ powers * max(scatter, 1.0)) / abs(np.polyval(np.polyder(factors), root))
    return float(centre + root), float(error)


def locate_antiresonance(points: Iterable[Point]) -> tuple[float, float]:
    """Wave number where the amplitude of TR changes sign through zero, and its standard error."""
    tr = [(each.wavenumber, each.value, each.error) for each in points if each.mode == "TR"]
    return crossing(*np.reshape(tr, (-1, 3)).T)


def locate_resonance(records: Iterable[Record]) -> tuple[float, float]:
    """Wave number where one over the measured amplitude of TR changes sign through zero, and its standard error.

    Of the runs around the one with the largest p; Ω and w̃ too are those of the runs, because the dispersion relation
    would bring its own resonance with it. Raises ValueError as `crossing`, and without TR runs.
    """
    tr = sorted((r for r in records if r.scene.require_wave().mode == "TR"), key=lambda record: record.scene.wavenumber)
    loudest = int(np.argmax([np.mean(record.p**2) for record in tr]))
    if loudest in (0, len(tr) - 1):
        raise ValueError(f"p is largest at the end of the TR runs, xi = {tr[loudest].scene.wavenumber:.5g}")
    inverses = [_inverse(record) for record in tr[max(loudest - AROUND, 0) : loudest + AROUND + 1]]
    return crossing(*np.reshape(inverses, (-1, 3)).T)


def _inverse(record: Record) -> tuple[float, float, float]:
    """Wave number, (w̃² − 4Ω²)/B = 1/A in 1/D0, and the standard error of it."""
    frequencies = measured(record, linear(wave_of(record)))
    (drive, *_), (its_error, *_), _ = least_squares_fit(columns(record, frequencies), record.p)
    inverse = frequencies.detuning / drive
    error = np.hypot(frequencies.detuning_error / drive, inverse * its_error / drive)
    return record.scene.wavenumber, float(inverse), float(error)


def extrapolated(records: Iterable[Record]) -> list[Record]:
    """One record a wave: of two runs with steps h and h/2, (4·fine − coarse)/3; of one run, that run.

    Raises ValueError for other runs of one wave (`cases.pairs.by_wave`).
    """
    return [_one(*runs) for runs in by_wave(records)]


def _one(fine: Record, coarse: Record | None = None) -> Record:
    if coarse is None:
        return fine
    better = {part: (4 * getattr(fine, part) - getattr(coarse, part)) / 3 for part in ("p", "q", "phi")}
    return fine.with_signals(**better)


def refusal(record: Record) -> str | None:
    """Return the reason why a run is not one of the spectrum's, or None."""
    if record.scene.require_wave().phase:
        return f"wave.phase = {record.scene.require_wave().phase!r}: the amplitude has its sign at phase 0 only"
    left_out = sorted(traits_of(record) - HELD)
    if OBLIQUE in left_out:
        return "its wave is not along y, as those of the closed form are; granular-analysis oblique takes it"
    return f"the closed form leaves out {', '.join(left_out)}" if left_out else None
