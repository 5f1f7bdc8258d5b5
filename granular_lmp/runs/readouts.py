"""Readouts from the monitors of a driven crystal: harmonics of the drive and the static field.

In the steady part of a run, at the frequency Ω of the drive, each component of each sphere is fitted by

    x(τ) = s + d (τ − middle) + Σ_{k=1}^{3} (c_k cos kΩτ + s_k sin kΩτ)

by least squares; d absorbs a slow drift. The amplitude of a harmonic is the root mean square of √(c_k² + s_k²) over the
spheres of the monitor, so different phases do not cancel; the static field s is the mean.

The drive must first rise, and its fastest wave must arrive from the farthest source; the steady part is the second half
of the remaining time. It ends with the run, or with the echo of the walls unless the scene allows the echo. It may not
be steady yet, so the error of each number is the larger of two: the standard error of the fit, and half the difference
between the two halves of the steady part.
"""

from collections.abc import Iterator
from math import isclose, pi
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import ReadoutError
from granular_lmp.rest.at_rest import echo_at
from granular_lmp.rest.linear import usual_frequency
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.components import NAMES, components
from granular_lmp.runs.record import Record
from granular_lmp.scene.monitors import Monitor

if TYPE_CHECKING:
    from granular_lmp.runs.monitors import MonitorRecord

Floats = NDArray[np.float64]

HARMONICS = 3
FEWEST_PERIODS = 4  # fewest periods in the steady part, two in each half


def drive_of(scene: Scene) -> tuple[float, float]:
    """Return the frequency of the drive of a scene, rad/t0, and the time τ at which the drive has risen.

    Raises
    ------
    ReadoutError
        If there is neither a driven row nor a source, if a source is not a tone, or if frequencies differ.
    """
    usual, driven = usual_frequency(scene), scene.form.driven
    if scene.struck or not (driven or scene.source and not scene.form.waves):
        beside = " alone" if scene.source or driven else ""
        begins = "wave: missing table" if scene.wave is None else f'wave.form = "{scene.wave.form}"'
        raise ReadoutError(f"{begins}: nothing{beside} drives the crystal at one frequency")
    for number, each in enumerate(scene.source, 1):
        if each.kind != "tone":
            raise ReadoutError(f'source {number}: signal = "{each.kind}": must be "tone", which becomes steady')
    found = [each.pulsation(scene.sphere, usual) for each in scene.drives]
    first = usual if driven else found[0]
    for number, frequency in enumerate(found, 1):
        if not isclose(frequency, first, rel_tol=1e-12):
            other = "the driven row" if driven else "source 1"
            raise ReadoutError(f"source {number}: frequency = {frequency:.6g}: differs from {first:.6g} of {other}")
    return first, max([each.delay + each.ramp for each in scene.source] + [scene.envelope.ramp] * driven)


def steady_part(scene: Scene, monitor: Monitor) -> tuple[float, float, float]:
    """Return the frequency of the drive, rad/t0, and the beginning and the end of the steady part, τ.

    Raises
    ------
    ReadoutError
        As for `drive_of`; also if the steady part is too short, or samples are too far apart for the third harmonic.
    """
    frequency, risen = drive_of(scene)
    first, last = monitor.span
    rows = [(each.rows_of()[0], each.rows_of()[-1]) for each in scene.source]
    rows += [(0, 0)] if scene.form.driven else []
    far = max(abs(row - place) for ends in rows for row in ends for place in (first, last))
    arrived = risen + far / scene.lattice.fastest
    recorded = scene.time.samples * scene.time.sample
    echoes = scene.time.allow_echo or scene.wave is None  # and every echo belongs to the answer
    end = recorded if echoes else min(recorded, echo_at(scene, monitor))
    begin = (arrived + end) / 2
    periods = (end - begin) * frequency / (2 * pi)
    if periods < FEWEST_PERIODS:
        longer = arrived + 2 * FEWEST_PERIODS * 2 * pi / frequency
        cure = "time.allow_echo = true or quiet ends" if end < recorded else "a longer time.duration"
        raise ReadoutError(
            f"time.duration = {scene.time.duration!r}: leaves {max(periods, 0.0):.2g} steady periods up to tau = "
            f"{end:.4g}; must be {FEWEST_PERIODS}, up to {longer:.4g}: {cure}"
        )
    longest = pi / (HARMONICS * frequency)
    if scene.time.sample >= longest:
        raise ReadoutError(
            f"time.sample = {scene.time.sample!r}: must be below {longest:.4g}, half a period of harmonic {HARMONICS}"
        )
    return frequency, begin, end


def readout(record: "MonitorRecord") -> dict[str, Any]:
    """Return the entry of a monitor of motion in ``run.json``.

    Returns
    -------
    dict
        ``frequency``, rad/t0; ``from`` and ``to``, τ; ``u``, ``v`` and ``phi`` (`components`), each with ``static``,
        ``1``, ``2`` and ``3``: the number and its error in D0. A component that was not recorded is missing. If the run
        gives no readout, there is only ``why``.
    """
    try:
        frequency, begin, end = steady_part(record.scene, record.monitor)
    except ReadoutError as error:
        return {"why": str(error)}
    tau = record.tau
    steady = (tau >= begin) & (tau <= end * (1 + 1e-12))
    signals = components(record.displacement, record.rotation)
    found: dict[str, Any] = {"frequency": frequency, "from": float(tau[steady][0]), "to": float(tau[steady][-1])}
    for name, values in signals.items():
        if not np.isnan(values).any():
            found[name] = dict(harmonics(tau[steady], values[steady], frequency))
    return found


def harmonics(tau: Floats, values: Floats, frequency: float) -> Iterator[tuple[str, list[float]]]:
    """Yield the static field and the harmonics of signals (T, N), each with its error, by name."""
    middle = len(tau) // 2
    whole, errors = fitted(_functions(tau, frequency), values)
    early, late = (
        fitted(_functions(tau[part], frequency), values[part])[0] for part in (slice(middle), slice(middle, None))
    )
    changed = np.abs(late - early) / 2
    yield "static", [float(whole[0].mean()), max(_rms(errors[0]), abs(float((late - early)[0].mean())) / 2)]
    for harmonic in range(1, HARMONICS + 1):
        both = slice(2 * harmonic, 2 * harmonic + 2)
        error = _rms(errors[both])
        yield str(harmonic), [_rms(np.hypot(*whole[both])), max(error, _rms(np.hypot(*changed[both])))]


def _functions(tau: Floats, frequency: float) -> Floats:
    """Return the functions of time of the fit as columns: 1, τ, cos kΩτ, sin kΩτ."""
    turning = [f(k * frequency * tau) for k in range(1, HARMONICS + 1) for f in (np.cos, np.sin)]
    return np.column_stack([np.ones_like(tau), tau - tau.mean(), *turning])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def fitted(matrix: Floats, signals: Floats) -> tuple[Floats, Floats]:
    """Return the least-squares coefficients of the columns of a matrix for signals, and their standard errors.

    Parameters
    ----------
    matrix : (T, F) array
    signals : (T,) or (T, N) array

    Returns
    -------
    factors, errors : (F,) or (F, N) arrays
    """
    sizes = np.linalg.norm(matrix, axis=0)
    columns = matrix / sizes
    scale = sizes if signals.ndim == 1 else sizes[:, None]
    factors, *_ = np.linalg.lstsq(columns, signals)
    rest = signals - columns @ factors
    variance = np.sum(rest**2, axis=0) / (len(signals) - len(sizes))
    spread = np.diag(np.linalg.pinv(columns.T @ columns))
    return factors / scale, np.sqrt(np.multiply.outer(spread, variance)) / scale


def readouts_of(record: Record) -> dict[str, Any]:
    """Return the entry ``monitors`` of ``run.json`` from the record of a run; {} without a monitor of motion."""
    names = [each.name for each in record.scene.monitor if each.known.of == "sphere"]
    return {"monitors": {name: readout(record.monitor(name)) for name in names}} if names else {}


def readout_columns(info: dict[str, Any]) -> dict[str, float]:
    """Return the readouts in ``run.json`` as columns of a table: "line.u_static", "line.u1", "line.u1_error"."""
    found: dict[str, float] = {}
    for monitor, said in info.get("monitors", {}).items():
        for component in (name for name in NAMES if name in said):
            for harmonic, (value, error) in said[component].items():
                name = f"{monitor}.{component}{'_' * (harmonic == 'static')}{harmonic}"
                found |= {name: value, f"{name}_error": error}
    return found
