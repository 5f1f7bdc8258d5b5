"""The signals of a run: their errors, and the second harmonic that is in them.

Those of a wave are p, q, φ of one sphere, in space its displacement and Rθ along each axis. Those of a run without a
wave are the displacements and velocities (T, n, d) and the spins (T, n), in space (T, n, 3), of all that it records.
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
# A component that theory says is zero is compared with nothing: rounding over rounding.
SILENT = 1e-9
FEWEST = 3  # records for each factor of a fit, without which its error says nothing


def predicted_amplitude(wave: Wave) -> float | None:
    """|ε P̃1|/2 in D0: amplitude of the generated second harmonic of a real wave.

    None where second order leaves out what the wave's contacts do, and in other directions than y: there the second
    harmonic is three waves, in p, q and φ, not one amplitude.
    """
    if "second-order" not in holding(wave) or not wave.mode.along_y:
        return None
    return float(abs(wave.amplitude * wave.framed(wave.doubled.forced())[0])) / 2


def signals_of(record: Record) -> tuple[str, ...]:
    """Return the names of the signals of a run that are compared."""
    if record.scene.wave is None:
        return FIELDS
    return IN_SPACE if record.scene.space == 3 else COMPONENTS


def recorded(record: Record) -> dict[str, Floats]:
    """Return the signals of a run by name; an angle that was not tracked is left out."""
    names = signals_of(record)
    found = {name: np.asarray(record.signals[name] if names == IN_SPACE else getattr(record, name)) for name in names}
    return {name: values for name, values in found.items() if not np.isnan(values).all()}


def errors(record: Record, reference: tuple[Floats, ...]) -> dict[str, float | None]:
    """Return the relative L2 error of each signal of a run against a reference; None where the reference is silent."""
    names, found = signals_of(record), recorded(record)
    return {
        name: relative_error(found[name], values) if np.max(np.abs(values)) > SILENT else None
        for name, values in zip(names, reference, strict=True)
        if name in found
    }


class Shapes(NamedTuple):
    """Shapes that p(τ) of a run is fitted by, the columns of matrices (T, 1 or 3).

    Attributes
    ----------
    predicted : amplitude of the generated second harmonic in D0, which the factor of the first column multiplies.
    exact, stepped : the second harmonic, and for L the fundamental's cos and sin, without and with the time step of the
        run; `stepped` is None for a run to a tolerance, whose record is extrapolated.
    """

    predicted: float
    exact: Floats
    stepped: Floats | None


def shapes_of(record: Record, wave: Wave) -> Shapes:
    """Return the shapes of a run by theory; TheoryError where no amplitude is measured (`measured_amplitude`)."""
    predicted, time, tau = predicted_amplitude(wave), record.scene.time, record.tau
    if predicted is None:
        lacks = missing("second-order", traits(wave))
        why = f"second order leaves out {', '.join(lacks)}" if lacks else "in this direction it is three waves"
        raise TheoryError(why)
    second, _, _ = second_harmonic(wave, tau)
    if np.max(np.abs(second), initial=0.0) < SILENT:
        raise TheoryError(f"it is below {SILENT:g} D0 and rounding")
    if drive_cancels(wave):
        most = second_order_until(wave.mode, wave.contact)
        raise TheoryError(f"p is more of fourth order than of second; wave.amplitude must be below {most:.2g}")
    own = wave.mode.frequency
    exact = _columns(wave, second, own, tau)
    if len(tau) < (fewest := FEWEST * exact.shape[1]):
        raise TheoryError(f"a fit needs {fewest} records, and there are {len(tau)}")
    if time.tolerance is not None:
        return Shapes(predicted, exact, None)
    turning = 2 * np.arcsin(own * time.step / 2) / time.step
    return Shapes(predicted, exact, _columns(wave, stepped_second_harmonic(wave, tau, time.step), turning, tau))


def _columns(wave: Wave, second: Floats, fundamental: float, tau: Floats) -> Floats:
    """Return the second harmonic, beside cos and sin of the fundamental where p has one."""
    own = [np.cos(fundamental * tau), np.sin(fundamental * tau)] if wave.mode.p else []
    return np.column_stack([second, *own])


def amplitude_by(shapes: Shapes, record: Record) -> tuple[float, float]:
    """Return the amplitude of the generated second harmonic in a run, in D0, and its error, as `measured_amplitude`."""
    factor, spread = _factor(shapes.exact, record.p)
    if shapes.stepped is not None:
        without, spread = _factor(shapes.stepped, record.p)
        step = factor - without
    else:
        share = record.info.get("error_estimate", {}).get("p")
        step = factor * next(each for each in (share, record.scene.time.tolerance) if each is not None)
    return factor * shapes.predicted, float(np.hypot(step, spread)) * shapes.predicted


def measured_amplitude(record: Record, wave: Wave) -> tuple[float, float]:
    """Amplitude of the generated second harmonic in a run, in D0, and its error: of the fit and of the time step.

    Least squares of p(τ) on the time functions that theory knows: cos Ωτ and sin Ωτ of the fundamental (L only) and the
    second harmonic with its free waves, whose factor is sought. That the generated and the free waves come in fixed
    proportion keeps the fit well-posed at the resonance, where they are one function. A second fit has the functions
    that the time step of the run makes of these: the error is its standard error, and the distance of both amplitudes.
    Of a run to a tolerance, whose record is extrapolated, that distance is the share that the estimate of p says.

    Raises TheoryError where the second harmonic is not what p consists of: at the antiresonance, and where it is below
    rounding; where there is no theory of it; and for fewer than `FEWEST` records a factor.
    """
    return amplitude_by(shapes_of(record, wave), record)


def _factor(matrix: Floats, signal: Floats) -> tuple[float, float]:
    """Return the factor of the first column in a signal, and its standard error."""
    solution, *_ = np.linalg.lstsq(matrix, signal)
    residual = signal - matrix @ solution
    variance = residual @ residual / np.subtract(*matrix.shape)
    return float(solution[0]), float(np.sqrt(variance * np.linalg.inv(matrix.T @ matrix)[0, 0]))
