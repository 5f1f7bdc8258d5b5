"""Amplitude of the generated wave, measured in LAMMPS runs over the wave number, with its zero and its pole.

At 2ξ the lattice is one oscillator of frequency w̃, at rest at τ = 0 and driven by B sin 2Ωτ:

    p = B S(τ) + c cos w̃τ + s sin w̃τ (+ the fundamental, for L),    S'' + w̃²S = sin 2Ωτ,  S(0) = S'(0) = 0

At the resonance S stays regular and independent of cos w̃τ and sin w̃τ, while sin 2Ωτ does not. The amplitude of the
wave that runs with the fundamental is A = B/(w̃² − 4Ω²), with its sign; it does not depend on free waves.
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
# Number of runs in the fit of a location, and degree of the polynomial. A change of one degree or of two runs moves the
# locations of `make spectrum` by less than 3e-6
AROUND, DEGREE = 8, 4


@dataclass(frozen=True)
class Frequencies:
    """Ω of the fundamental and w̃ of free waves at 2ξ, rad per τ, with standard errors, 0 if from a formula."""

    fundamental: float
    free: float
    fundamental_error: float = 0.0
    free_error: float = 0.0

    @property
    def detuning(self) -> float:
        """Return w̃² − 4Ω², which vanishes at the resonance."""
        return (self.free - 2 * self.fundamental) * (self.free + 2 * self.fundamental)

    @property
    def detuning_error(self) -> float:
        """Return the standard error of the detuning."""
        return float(np.hypot(2 * self.free * self.free_error, 8 * self.fundamental * self.fundamental_error))


@dataclass(frozen=True)
class Point:
    """A run: its wave, its generated amplitude in εD0 with standard error, and the amplitude of theory, P̃1/2i.

    `amplitude` is a = D0/Δ0 of the fundamental; in these units theory does not depend on it.
    """

    mode: str
    amplitude: float
    wavenumber: float
    value: float
    error: float
    predicted: float

    @property
    def deviation(self) -> float:
        """Return the relative deviation of the measured from the predicted amplitude."""
        return self.value / self.predicted - 1


def least_squares_fit(columns: Sequence[Floats], signal: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the factors of the columns in a signal, their standard errors, and the residual.

    The errors assume that the residual is white noise. If it consists of other waves, the errors only indicate its
    size.
    """
    matrix = np.column_stack(columns)
    sizes = np.linalg.norm(matrix, axis=0)
    factors, *_ = np.linalg.lstsq(matrix / sizes, signal)
    rest = signal - matrix / sizes @ factors
    variance = rest @ rest / (len(signal) - len(sizes))
    covariance = variance * np.linalg.inv((matrix / sizes).T @ (matrix / sizes))
    return factors / sizes, np.sqrt(np.diag(covariance)) / sizes, rest


def response(tau: Floats, frequencies: Frequencies) -> Floats:
    """Return S(τ) of the module's equation, regular at the resonance.

    S = [sin(w̃τ)/w̃ − τ cos(sτ) sin(dτ)/(dτ)]/2s,    s = Ω + w̃/2,  d = Ω − w̃/2
    """
    mean, half = frequencies.fundamental + frequencies.free / 2, frequencies.fundamental - frequencies.free / 2
    own = np.sin(frequencies.free * tau) / frequencies.free
    return (own - tau * np.cos(mean * tau) * np.sinc(half * tau / np.pi)) / (2 * mean)


def pair(frequency: float, tau: Floats) -> list[Floats]:
    """Return cos and sin of a frequency."""
    return [np.cos(frequency * tau), np.sin(frequency * tau)]


def columns(record: Record, frequencies: Frequencies) -> list[Floats]:
    """Return the time functions of p: S, the free waves, and for L the fundamental and its slow drift, of order a²τ."""
    fundamental = pair(frequencies.fundamental, record.tau) if record.scene.require_wave().mode == "L" else []
    drift = [record.tau * each for each in fundamental]
    return [response(record.tau, frequencies), *pair(frequencies.free, record.tau), *fundamental, *drift]


def linear(wave: Wave) -> Frequencies:
    """Return both frequencies from the linear dispersion relation."""
    return Frequencies(wave.mode.frequency, wave.free_frequency)


def tuned(made: Callable[[float], list[Floats]], signal: Floats, start: float) -> tuple[float, float]:
    """Return the frequency near `start` whose columns fit a signal best, and its standard error.

    Breaks if the phase of the start is off by more than about π over the record.
    """
    scaled = signal / np.sqrt(np.mean(signal**2))
    found = least_squares(lambda x: least_squares_fit(made(x[0]), scaled)[2], [start], method="lm", xtol=1e-12)
    noise = 2 * found.cost / (len(signal) - len(made(start)) - 1)
    return float(found.x[0]), float(np.sqrt(noise) / np.linalg.norm(found.jac))


def measured(record: Record, start: Frequencies) -> Frequencies:
    """Return both frequencies of a TR or RT run, measured in the run: Ω from q(τ), then w̃ from p(τ).

    Breaks at the antiresonance, where p is not the second harmonic and w̃ is meaningless.
    """
    fundamental, its_error = tuned(lambda frequency: pair(frequency, record.tau), record.q, start.fundamental)

    def made(free: float) -> list[Floats]:
        return columns(record, Frequencies(fundamental, free))

    free, error = tuned(made, record.p, start.free)
    return Frequencies(fundamental, free, its_error, error)


def point(record: Record) -> Point:
    """Return the generated amplitude of a run, fitted with the frequencies of the linear lattice."""
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
    """Return the zero x of y(x) and its standard error: the root of a polynomial fitted, with weights, to near points.

    A change of sign from which |y| falls to either side is a pole, and is skipped; of several zeros the one with the
    smallest |y| is taken. If the points scatter about the polynomial by more than their errors, the errors are scaled
    up accordingly.

    Raises ValueError if y does not change sign, or if there are too few points.
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
    """Return the wave number at which the amplitude of TR changes sign through zero, and its standard error."""
    tr = [(each.wavenumber, each.value, each.error) for each in points if each.mode == "TR"]
    return crossing(*np.reshape(tr, (-1, 3)).T)


def locate_resonance(records: Iterable[Record]) -> tuple[float, float]:
    """Return the wave number at which 1/amplitude of TR changes sign through zero, and its standard error.

    The fit takes the runs around the one with the largest p. Ω and w̃ are measured in the runs too, because the values
    from the dispersion relation already contain its resonance. Raises ValueError as `crossing`, and without TR runs.
    """
    tr = sorted((r for r in records if r.scene.require_wave().mode == "TR"), key=lambda record: record.scene.wavenumber)
    loudest = int(np.argmax([np.mean(record.p**2) for record in tr]))
    if loudest in (0, len(tr) - 1):
        raise ValueError(f"p is largest at the end of the TR runs, xi = {tr[loudest].scene.wavenumber:.5g}")
    inverses = [_inverse(record) for record in tr[max(loudest - AROUND, 0) : loudest + AROUND + 1]]
    return crossing(*np.reshape(inverses, (-1, 3)).T)


def _inverse(record: Record) -> tuple[float, float, float]:
    """Return the wave number, (w̃² − 4Ω²)/B = 1/A in 1/D0, and the standard error of 1/A."""
    frequencies = measured(record, linear(wave_of(record)))
    (drive, *_), (its_error, *_), _ = least_squares_fit(columns(record, frequencies), record.p)
    inverse = frequencies.detuning / drive
    error = np.hypot(frequencies.detuning_error / drive, inverse * its_error / drive)
    return record.scene.wavenumber, float(inverse), float(error)


def extrapolated(records: Iterable[Record]) -> list[Record]:
    """Return a record for each wave: (4·fine − coarse)/3 for two runs with steps h/2 and h, otherwise the single run.

    Raises ValueError for runs of one wave that are not such a pair (`cases.pairs.by_wave`).
    """
    return [_one(*runs) for runs in by_wave(records)]


def _one(fine: Record, coarse: Record | None = None) -> Record:
    if coarse is None:
        return fine
    better = {part: (4 * getattr(fine, part) - getattr(coarse, part)) / 3 for part in ("p", "q", "phi")}
    return fine.with_signals(**better)


def refusal(record: Record) -> str | None:
    """Return the reason why a run is refused, or None."""
    if record.scene.require_wave().phase:
        return f"wave.phase = {record.scene.require_wave().phase!r}: must be 0, for the sign of the amplitude"
    left_out = sorted(traits_of(record) - HELD)
    if OBLIQUE in left_out:
        return "the wave must run along y, as in the closed form; granular-analysis oblique takes other directions"
    return f"the closed form leaves out {', '.join(left_out)}" if left_out else None
