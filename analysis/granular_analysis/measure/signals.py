"""Signals of a run: their errors against a reference, and their second harmonic.

The signals of a wave in the plane are p, q, φ of one sphere, in space the displacement and Rθ of the sphere along each
axis. The signals of a run without a wave are displacements and velocities (T, n, d) and spins (T, n), in space
(T, n, 3), of all recorded spheres.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.norms import relative_error
from granular_analysis.theory.catalogue import missing
from granular_analysis.theory.choice import drive_cancels, holding, second_order_until, traits
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.timestep import stepped_second_harmonic
from granular_analysis.theory.wave import Wave, second_harmonic
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
COMPONENTS = ("p", "q", "phi")
IN_SPACE = ("ux", "uy", "uz", "phix", "phiy", "phiz")
FIELDS = ("displacement", "velocity", "spin")
# Largest value below which a reference is zero: an error relative to it would compare rounding with rounding
SILENT = 1e-9
FEWEST = 3  # fewest records for each factor of a fit; with fewer the standard error means nothing


def predicted_amplitude(wave: Wave) -> float | None:
    """Amplitude |ε P̃1|/2, in D0, of the generated second harmonic of a real wave.

    None if second order leaves out a feature of the wave, and for directions other than y, in which the second harmonic
    is three waves, in p, q and φ, instead of one amplitude.
    """
    if "second-order" not in holding(wave) or not wave.mode.along_y:
        return None
    return float(abs(wave.amplitude * wave.framed(wave.doubled.forced())[0])) / 2


def signals_of(record: Record) -> tuple[str, ...]:
    """Return the names of the compared signals of a run."""
    if record.scene.wave is None:
        return FIELDS
    return IN_SPACE if record.scene.space == 3 else COMPONENTS


def recorded(record: Record) -> dict[str, Floats]:
    """Return the recorded signals of a run by name, without angles that were not tracked."""
    names = signals_of(record)
    found = {name: np.asarray(record.signals[name] if names == IN_SPACE else getattr(record, name)) for name in names}
    return {name: values for name, values in found.items() if not np.isnan(values).all()}


def errors(record: Record, reference: tuple[Floats, ...]) -> dict[str, float | None]:
    """Return the relative L2 error of each signal against its reference; None if the reference is zero (`SILENT`)."""
    names, found = signals_of(record), recorded(record)
    return {
        name: relative_error(found[name], values) if np.max(np.abs(values)) > SILENT else None
        for name, values in zip(names, reference, strict=True)
        if name in found
    }


class Shapes(NamedTuple):
    """Functions of τ whose sum is fitted to p(τ) of a run.

    Attributes
    ----------
    predicted : amplitude of the generated second harmonic in D0, for which the factor of the first column is 1.
    exact, stepped : (T, 1 or 3) columns without and with the effect of the run's time step: the second harmonic, and
        for L cos and sin of the fundamental. `stepped` is None for a run with a tolerance, whose record is
        extrapolated to short steps.
    """

    predicted: float
    exact: Floats
    stepped: Floats | None


def shapes_of(record: Record, wave: Wave) -> Shapes:
    """Return the functions of τ for the fit of a run; TheoryError as `measured_amplitude` raises it."""
    predicted, time, tau = predicted_amplitude(wave), record.scene.time, record.tau
    if predicted is None:
        lacks = missing("second-order", traits(wave))
        waves = "in this direction the second harmonic is three waves"
        raise TheoryError(f"second order leaves out {', '.join(lacks)}" if lacks else waves)
    second, _, _ = second_harmonic(wave, tau)
    if np.max(np.abs(second), initial=0.0) < SILENT:
        raise TheoryError(f"the second harmonic is below {SILENT:g} D0, as small as rounding")
    if drive_cancels(wave):
        most = second_order_until(wave.mode, wave.contact)
        raise TheoryError(f"fourth order exceeds second order in p; wave.amplitude must be below {most:.2g}")
    own = wave.mode.frequency
    exact = _columns(wave, second, own, tau)
    if len(tau) < (fewest := FEWEST * exact.shape[1]):
        raise TheoryError(f"a fit needs {fewest} records, and there are {len(tau)}")
    if time.tolerance is not None:
        return Shapes(predicted, exact, None)
    turning = 2 * np.arcsin(own * time.step / 2) / time.step
    return Shapes(predicted, exact, _columns(wave, stepped_second_harmonic(wave, tau, time.step), turning, tau))


def _columns(wave: Wave, second: Floats, fundamental: float, tau: Floats) -> Floats:
    """Return the columns of a fit: the second harmonic and, if p has a fundamental, its cos and sin."""
    own = [np.cos(fundamental * tau), np.sin(fundamental * tau)] if wave.mode.p else []
    return np.column_stack([second, *own])


def amplitude_by(shapes: Shapes, record: Record) -> tuple[float, float]:
    """Return the amplitude of the generated second harmonic in a run and its error, in D0; see `measured_amplitude`."""
    factor, spread = _factor(shapes.exact, record.p)
    if shapes.stepped is not None:
        without, spread = _factor(shapes.stepped, record.p)
        step = factor - without
    else:
        share = record.info.get("error_estimate", {}).get("p")
        step = factor * next(each for each in (share, record.scene.time.tolerance) if each is not None)
    return factor * shapes.predicted, float(np.hypot(step, spread)) * shapes.predicted


def measured_amplitude(record: Record, wave: Wave) -> tuple[float, float]:
    """Return the amplitude of the generated second harmonic in a run and its error, in D0.

    p(τ) is fitted by least squares with functions from theory: cos Ωτ and sin Ωτ of the fundamental (L only), and the
    second harmonic with its free waves, whose factor gives the amplitude. Generated and free waves have a fixed ratio,
    which keeps the fit well-posed at the resonance, where they are the same function.

    A second fit has the same functions as the time step of the run changes them. The error is √(s² + d²), with s the
    standard error of the second fit and d the difference of the two amplitudes. For a run with a tolerance, whose
    record is extrapolated, d is the error that the run estimates for p, and s that of the first fit.

    Raises TheoryError if p is not a second harmonic that second order predicts (at the antiresonance, where fourth
    order is larger), if the second harmonic is below rounding, if there is no theory for it, and for fewer than
    `FEWEST` records a factor.
    """
    return amplitude_by(shapes_of(record, wave), record)


def _factor(matrix: Floats, signal: Floats) -> tuple[float, float]:
    """Return the factor of the first column in a least-squares fit of a signal, and its standard error."""
    solution, *_ = np.linalg.lstsq(matrix, signal)
    residual = signal - matrix @ solution
    variance = residual @ residual / np.subtract(*matrix.shape)
    return float(solution[0]), float(np.sqrt(variance * np.linalg.inv(matrix.T @ matrix)[0, 0]))
