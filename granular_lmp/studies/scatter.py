"""Scattering by unequal rows: runs with and without the inclusions of a scene give transmission and reflection.

A source below the inclusions shakes whole rows of a crystal with quiet ends, by a burst or a tone. The waves that run
up and down are separated in rows before and behind the inclusions (`running_waves`). With the amplitudes a before and b
behind them,

    T = |b_up|²/|a_up|²,    R = |a_down|²/|a_up|²

of each mode, relative to the incident one. The **normalisation run** is the same scene without its inclusions. There
nothing scatters, so the deviation of its transmission from 1 is an error, and so is the wave b_down that comes back
from behind.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import astuple, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.accuracy.tolerance import run
from granular_lmp.crystal.disorder import Disorder
from granular_lmp.crystal.lattices import HEXAGONAL
from granular_lmp.crystal.row_waves import Line, lattice_at, line_of, row_waves
from granular_lmp.errors import CrystalError, SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.outputs import SCATTER, csv_text, replace_text, writable
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.linear import physics_of, unit_contacts
from granular_lmp.rest.scene import Scene
from granular_lmp.rest.shape import FASTEST_ROWS_PER_TAU
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.engine import Engine
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.snapshots import Snapshots
from granular_lmp.scene.forms import STILL
from granular_lmp.scene.schema import either, shown
from granular_lmp.scene.sources import Source
from granular_lmp.studies.running_waves import (
    PERIODS,
    Complexes,
    Floats,
    amplitudes,
    burst_spectrum,
    row_motion,
    tone_amplitude,
)

NORMALISATION, INCLUSIONS = "normalisation", "inclusions"  # run folders of the signal of the scene
FREQUENCIES = 11  # a burst is evaluated where its spectrum is above half of its peak, half of the main lobe
CLEAR = 2  # rows left out next to a source, inclusions and quiet ends, as their places at rest are shifted
FEWEST_ROWS = 8  # to separate six waves
FEWEST_SNAPSHOTS = 6.0  # samples in a period of the highest frequency
FORBIDDEN = 1e-6  # share below which a wave is not shown
OTHER = 1e-2  # largest amplitude of other waves from the source, over that of the incident wave

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Row:
    """Transmitted and reflected share of the incident wave in one mode, at one frequency.

    Attributes
    ----------
    signal : str
        "burst" or "tone".
    frequency : float
        rad/t0.
    incident, mode : str
        The incident wave, and the transmitted or reflected wave: L, TR or RT.
    transmission, reflection : float
        Shares of the incident energy flux.
    transmission_error, reflection_error : float
        Errors from the normalisation run, the fits, and waves that come back from behind. They do not include the time
        step: the shares of a run are those of the lattice at (2/Δτ) sin(ΩΔτ/2).
    """

    signal: str
    frequency: float
    incident: str
    mode: str
    transmission: float
    transmission_error: float
    reflection: float
    reflection_error: float


@dataclass(frozen=True, repr=False)
class Scatter:
    """Scattering of a scene.

    Attributes
    ----------
    folder : Path
        Study folder, with a run folder for each run.
    scene : Scene
    rows : list of Row
        Rows of the table, by signal, frequency and mode.
    """

    folder: Path
    scene: Scene
    rows: list[Row]

    def balance(self) -> dict[tuple[str, float], float]:
        """Return the sum of all transmissions and reflections by signal and frequency; 1 without dissipation."""
        sums: dict[tuple[str, float], float] = {}
        for row in self.rows:
            key = row.signal, row.frequency
            sums[key] = sums.get(key, 0.0) + row.transmission + row.reflection
        return sums

    @property
    def modes(self) -> list[str]:
        """Names of the waves with a share above `FORBIDDEN`; mirror symmetry forbids the others."""
        return sorted({row.mode for row in self.rows if max(row.transmission, row.reflection) > FORBIDDEN})

    def text(self) -> str:
        """Return the table as text, a line for each frequency and mode, with the deviation of the sums from 1."""
        lines = [f"{'signal':7}{'Omega t0':>9}{'wave':>10}{'passes':>10}{'error':>9}{'comes back':>12}{'error':>9}"]
        for row in self.rows:
            if row.mode in self.modes:
                lines.append(
                    f"{row.signal:7}{row.frequency:9.4f}{row.incident + ' > ' + row.mode:>10}{row.transmission:10.5f}"
                    f"{row.transmission_error:9.1e}{row.reflection:12.5f}{row.reflection_error:9.1e}"
                )
        off = max(abs(total - 1) for total in self.balance().values())
        return "\n".join([*lines, f"the sums of all shares differ from 1 by {off:.1e} at most"])

    def to_csv(self) -> str:
        """Return the table as CSV, each number in the shortest form that reads back to the same double."""
        return csv_text([field.name for field in fields(Row)], map(astuple, self.rows))


def scatter(
    scene: Scene,
    folder: str | Path,
    *,
    tones: int = 0,
    force: bool = False,
    progress: Progress | None = None,
    kernel: bool | None = None,
    engine: Engine | None = None,
) -> Scatter:
    """Run a scene with and without its inclusions, and return the transmitted and reflected shares.

    Parameters
    ----------
    scene : Scene
        Hexagonal crystal with quiet ends, a source of whole rows with a burst or a tone, and inclusions above it.
        ``[wave]`` gives the mode of the incident wave and the default frequency. If there are no snapshots, one per
        record is added.
    folder : path
        Study folder, which is created. It will hold ``scatter.csv`` and the run folders ``normalisation``,
        ``inclusions`` and, for each tone, ``tone_N_normalisation`` and ``tone_N_inclusions``.
    tones : int
        Number of frequencies of the burst that also run as tones.
    force : bool
        Run again in an existing folder.
    progress : callable, optional
        Callback ``progress(step, steps)`` of each run.
    kernel, engine : optional
        As in `granular_lmp.run`.

    Raises
    ------
    SceneError
        If the scene is not such an experiment (the error names the key, before any run), or if the run is too short for
        its signal.
    RunFolderError, EffectError, LammpsMissingError, LammpsError
        As in `granular_lmp.run`.
    """
    folder = absolute(folder)
    source = _source_of(scene)
    if tones and source.kind != "burst":
        raise SceneError(f"tones = {tones}: must be 0 for a source that is a tone itself")
    if not scene.output.particles:
        scene = scene.with_values({"output.particles": scene.time.sample})
    problem = prepare(scene)
    frequency = problem.sources[0].frequency
    width = 1 / source.cycles if source.kind == "burst" else 0.0
    apart = 2 * np.pi / (frequency * (1 + 2 * width)) / FEWEST_SNAPSHOTS
    if scene.output.particles > apart:
        raise SceneError(
            f"output.particles = {scene.output.particles!r}: must be at most {apart:.4g}, a sixth of the shortest "
            "period of the source"
        )
    windows = _windows(problem)
    # Lower bound for any wave; the record decides whether the wave has passed
    passed = source.delay + problem.sources[0].lasts + (windows.behind[-1] - source.rows[1]) / FASTEST_ROWS_PER_TAU
    if scene.time.duration < passed:
        raise SceneError(
            f"time.duration = {scene.time.duration!r}: must be at least {passed:.4g}, so that the fastest wave passes "
            "the rows behind the inclusions; slower waves need longer"
        )
    frequencies = _running(windows, problem, frequency * np.linspace(1 - width, 1 + width, FREQUENCIES if width else 1))
    inner = frequencies[np.abs(frequencies / frequency - 1) <= width / 2]
    chosen = inner[np.unique(np.round(np.linspace(0, len(inner) - 1, tones)).astype(int))] if tones else inner[:0]
    runs = [(problem, "", frequencies)]
    runs += [(prepare(_as_tone(scene, float(at))), f"tone_{k}_", np.array([at])) for k, at in enumerate(chosen, 1)]
    how: dict[str, Any] = {"force": force, "progress": progress, "kernel": kernel, "engine": engine}
    rows: list[Row] = []
    with locked(folder, make=True, force=force):
        _clear_study(folder)
        for each, prefix, at in runs:
            whole = each.declared
            normal, scattered = (
                run(one, folder / f"{prefix}{name}", **how).snapshots()
                for name, one in ((NORMALISATION, whole.with_values({"inclusion": []})), (INCLUSIONS, whole))
            )
            rows += _compare(each, normal, scattered, at)
        found = Scatter(folder, scene, rows)
        with writable(folder):
            replace_text(folder / SCATTER, found.to_csv())
    return found


def _clear_study(folder: Path) -> None:
    """Delete the table and the tones of an earlier study, which must not stand beside new runs."""
    with writable(folder):
        (folder / SCATTER).unlink(missing_ok=True)
        clear(folder)
        for tone in (each for each in folder.glob("tone_*") if each.is_dir() and not each.is_symlink()):
            clear(tone)
            if not any(tone.iterdir()):
                tone.rmdir()


# --- the experiment --------------------------------------------------------------------------------------------------


def _source_of(scene: Scene) -> Source:
    """Return the source of a scene; raise SceneError if the scene cannot be a scattering experiment."""
    shape = scene.shape
    if not scene.inclusion:
        raise SceneError("inclusion = []: must be at least one table [[inclusion]], as nothing scatters without it")
    if shape.lattice != HEXAGONAL:
        raise SceneError(f'packing.lattice = "{shape.lattice.name}": must be "hexagonal" for scattering')
    if scene.form.waves:
        raise SceneError(
            f'wave.form = "{scene.form.name}": must be {either(STILL)} for scattering, whose [[source]] makes the wave'
        )
    if len(scene.source) != 1:
        raise SceneError(f"source = {len(scene.source)}: must be one table [[source]] for scattering")
    for item in fields(Disorder):
        value = getattr(scene.disorder, item.name)
        if item.name != "seed" and value != item.default:  # the seed selects inclusions with a share
            raise SceneError(f"disorder.{item.name} = {value!r}: must be {item.default:g} for scattering by inclusions")
    if scene.packing.table:
        raise SceneError(f"packing.table = {scene.packing.table.said!r}: must be left out for scattering by inclusions")
    if scene.absorb.rows == 0:
        raise SceneError('absorb.rows = 0: must be "auto" or a number, as held ends reflect the measured waves')
    (source,) = scene.source
    if not source.rows:
        raise SceneError(f"source 1: spheres = {shown([list(each) for each in source.spheres])}: must be rows")
    if source.kind not in ("burst", "tone"):
        raise SceneError(f'source 1: signal = "{source.kind}": must be "burst" or "tone" for scattering')
    return source


def _as_tone(scene: Scene, frequency: float) -> Scene:
    """Return the scene with a tone of a frequency in place of its burst.

    The tone rises no faster than the burst. The waves of its start have therefore passed when a burst would have
    passed, and it is evaluated after that.
    """
    burst, period = scene.source[0], 2 * np.pi / frequency
    ramp = max(1.0, burst.cycles * period / 2)
    tone = replace(burst, signal="tone", cycles=Source.cycles, frequency=frequency, hertz=None, ramp=ramp)
    duration = scene.time.duration + 2 * PERIODS * period
    return scene.replace(source=(tone,)).with_values({"time.duration": duration})


@dataclass(frozen=True, eq=False)
class _Windows:
    """Rows of perfect lattices before and behind the inclusions, their lattices, and the lattice without inclusions."""

    front: range
    behind: range
    lower: Line
    upper: Line
    whole: Line


def _windows(problem: Problem) -> _Windows:
    """Return the rows before and behind the inclusions of a scene.

    Raises
    ------
    SceneError
        If inclusions are not above the source, or leave fewer than `FEWEST_ROWS` rows.
    """
    scene, crystal = problem.scene, problem.rest.atoms
    arrays = crystal.arrays
    row = arrays["row"]
    quiet, last = int(scene.absorb.rows), scene.shape.rows - 1
    kinds = [
        sorted(zip(*(arrays[name][row == each].tolist() for name in ("material", "radius", "density")), strict=True))
        for each in range(last + 1)
    ]
    changes = [each for each in range(1, last + 1) if kinds[each] != kinds[each - 1]]
    top = scene.source[0].rows[1]
    if not changes or changes[0] <= top:
        first = changes[0] if changes else 0
        raise SceneError(
            f"source 1: rows = {list(scene.source[0].rows)}: must be below the inclusions, whose first row is {first}"
        )
    front = range(top + 1 + CLEAR, changes[0] - CLEAR)
    behind = range(changes[-1] + CLEAR, last - quiet - CLEAR)
    for name, window in (("in front of the inclusions", front), ("behind them", behind)):
        if len(window) < FEWEST_ROWS:
            raise SceneError(
                f"packing.rows = {scene.shape.rows}: leave {max(len(window), 0)} rows {name}, beside {quiet} quiet "
                f"ones at each end and {CLEAR} next to what differs; must be at least {FEWEST_ROWS}"
            )
    contacts = problem.rest.crystal.contacts
    middle = [int(np.flatnonzero(row == window[len(window) // 2])[0]) for window in (front, behind)]
    lattices = (lattice_at(contacts, middle[0]), lattice_at(contacts, middle[1]), unit_contacts(scene))
    return _Windows(front, behind, *(line_of(lattice, scene.sphere, physics_of(scene)) for lattice in lattices))


def _running(windows: _Windows, problem: Problem, frequencies: Floats) -> Floats:
    """Return the frequencies at which the incident wave runs, except edges of bands before and behind."""
    name, physics = problem.scene.require_wave().mode, physics_of(problem.scene)
    found = []
    for frequency in frequencies:
        with suppress(CrystalError):  # the edge of a band
            waves, _ = (row_waves(line, float(frequency), physics) for line in (windows.lower, windows.upper))
            if name in waves.running(onward=True):
                found.append(float(frequency))
    if not found:
        raise SceneError(
            f'wave.mode = "{name}": no {name} wave along y exists at the frequency of the source, '
            f"{frequencies.mean():.6g} rad per t0"
        )
    return np.array(found)


def _compare(problem: Problem, normal: Snapshots, scattered: Snapshots, frequencies: Floats) -> list[Row]:
    """Return the table of one pair of runs."""
    scene, windows, physics = problem.scene, _windows(problem), physics_of(problem.scene)
    signal, incident = scene.source[0].kind, scene.require_wave().mode
    fields = [
        _field(signal, run_.tau, motion[:, window], frequencies)
        for run_, motion in ((each, row_motion(each)) for each in (normal, scattered))
        for window in (windows.front, windows.behind)
    ]
    rows = []
    for k, frequency in enumerate(frequencies):
        # Velocity Verlet has the waves that the lattice has at this frequency
        whole, lower, upper = (
            row_waves(line, frequency * np.sinc(frequency * step / (2 * np.pi)), physics)
            for line, step in (
                (windows.whole, normal.step),
                (windows.lower, scattered.step),
                (windows.upper, scattered.step),
            )
        )
        before, after, front, behind = (
            amplitudes(waves, field[k]) for waves, field in zip((whole, whole, lower, upper), fields, strict=True)
        )
        coming, alone = front.up[incident], before.up[incident]
        for name, other in before.up.items():
            if name != incident and abs(other) > OTHER * abs(alone):
                raise SceneError(
                    f"source 1: {scene.source[0].words}: makes {name} too, {abs(other / alone):.2g} of the amplitude "
                    f"of {incident} at {frequency:.6g} rad per t0; must be at most {OTHER:g}, for a wave of one mode"
                )
        kept = abs(abs(after.up[incident] / alone) - 1)
        fit = front.residual / np.sqrt(len(windows.front))
        echo = max(abs(wave / coming) for wave in behind.down.values()) if behind.down else 0.0
        for name in sorted({*behind.up, *front.down}):
            passed = abs(behind.up.get(name, 0.0) / coming)
            back = abs(front.down.get(name, 0.0) / coming)
            fit_behind = passed * behind.residual / np.sqrt(len(windows.behind))
            lost, gone = passed * (kept + fit) + fit_behind + echo, back * kept + fit + echo
            rows.append(
                Row(
                    signal, float(frequency), incident, name,
                    passed**2, 2 * passed * lost + lost**2, back**2, 2 * back * gone + gone**2,
                )
            )  # fmt: skip
    return rows


def _field(signal: str, tau: Floats, motion: Floats, frequencies: Floats) -> Complexes:
    """Return a motion (T, rows, 3) at each frequency, (F, rows, 3)."""
    if signal == "burst":
        return burst_spectrum(tau, motion, frequencies)
    return np.stack([tone_amplitude(tau, motion, float(each)) for each in frequencies])
