"""Compare runs with theory: relative L2 errors of p, q, φ, and measured and predicted second harmonic.

    granular-analysis compare runs/tr_nonresonant runs/tr_resonant [--json FILE] [--theory NAME]
    granular-analysis compare sweeps/tr_periodic

There are two references. The error against a *theory* (a formula) measures the formula. The error against the *exact
lattice* (the same contact laws and geometry, integrated without LAMMPS) measures the run: its time step, walls and
rounding. If no theory of a plane wave applies, because the crystal is imperfect or contacts slide or open, the
*network* of the spheres replaces the theory and measures the run. Without snapshots, runs in other lattices and layers
are compared with the second order of their crystal (`granular_analysis.measure.reference`). A note names the reference
and the reason. A theory that leaves out a part of the scene is refused. So is a run with an effect, a form or a key
that no line of `granular_analysis.theory.catalogue` names.

A run without a wave, with strikers or a state, has no p, q and φ: all recorded motions are compared with the network,
which are displacements and velocities in both directions and spins. For a wave in space they are the displacement and
rotation of the recorded sphere along each axis.

Dumps that were adopted without a scene have a witness (`granular_analysis.measure.witness`) if their law is known. The
output says where the dumps depart from the witness, and how much of this the time step and the digits of the dump
explain.

Each run gets a figure ``compare.png`` in its folder; for several runs the output says how their scenes differ. A sweep
has a line for each finished run, which begins with the varied values, and one figure ``compare.png`` in its folder: the
largest value of each signal over the varied key, with theory (`granular_analysis.tools.curves`).
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.budget import Source, budget_lines, error_budget
from granular_analysis.measure.reference import Reference
from granular_analysis.measure.runs import load
from granular_analysis.measure.signals import (
    COMPONENTS,
    FIELDS,
    IN_SPACE,
    errors,
    measured_amplitude,
    predicted_amplitude,
    recorded,
    signals_of,
)
from granular_analysis.measure.swept import Swept
from granular_analysis.plotting import in_one_line, save, write
from granular_analysis.second_harmonic import ALONG_Y
from granular_analysis.theory.catalogue import CRYSTAL, NETWORK, REFERENCES
from granular_analysis.theory.choice import Trajectory, beyond, holding, trajectory, wave_of
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.wave import Wave
from granular_analysis.tools import curves
from granular_lmp.runs.record import Record
from granular_lmp.runs.unnamed import Unnamed, is_unnamed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Comparison", "compare"]

Floats = NDArray[np.float64]
INSTEAD = {NETWORK: "the network of its spheres", CRYSTAL: "the second order of its crystal", None: "nothing"}
# Plain letters: for formulas in TeX matplotlib first builds its parser, a tenth of the time of a comparison
LABELS = {"p": "p = v/D₀", "q": "q = −u/D₀", "phi": "φ = Rθ/D₀"}
LABELS |= {"displacement": "u/ℓ", "velocity": "v/v₀", "spin": "Rω/v₀"}
LABELS |= {f"u{axis}": f"u{axis}/D₀" for axis in "xyz"} | {f"phi{axis}": f"φ{axis}" for axis in "xyz"}
OBLIQUE_LABELS = LABELS | {"p": "p (along k)", "q": "q (along ẑ × k)"}


@dataclass(frozen=True)
class Comparison:
    """One run against theory.

    Attributes
    ----------
    folder : str or None
        Run folder as given; None for a record without a folder.
    mode, wavenumber, direction, amplitude : or None
        Values of the wave, if any; direction of k in degrees from a close-packed row, where 90 is y.
    theory : str or None
        Reference of the run (`granular_analysis.theory.catalogue.REFERENCES`); None if no reference covers the run.
    error, lattice_error : dict
        Relative L2 error of each signal (`granular_analysis.measure.signals.recorded`) against the theory named, and
        against the exact lattice; None where it is zero by symmetry. Empty without a theory.
    predicted : float or None
        Amplitude |ε P̃1|/2 of the generated second harmonic, in D0, by the closed form; None if it leaves out a part of
        the run, or for waves that do not run along y.
    measured, fit_error : float or None
        Measured amplitude of the run by least squares, and its error from the time step and the fit, without that from
        features that theory leaves out; None if a note gives a reason.
    notes : list of str
        Warnings that the comparison may mislead.
    budget : list of Source
        Differences of the run and of the paper's theory from the exact lattice (`granular_analysis.measure.budget`).
    signals : tuple of (T,) arrays, or None
        Signals of the reference at the times of the record; not in the JSON.
    record, wave : Record, Wave or None
        Record and wave that were compared; not in the JSON.

    Notes
    -----
    `lattice_error` and `budget` integrate the exact lattice at first access, which takes most of the time of a
    comparison.

    Examples
    --------
    >>> record = run(Scene.load("tr_periodic").with_values({"time.duration": 10.0}), "runs/harmonic")
    >>> found = compare(record, "second-order")
    >>> print(f"second harmonic {found.measured:.5f} D0, predicted {found.predicted:.5f} D0")
    second harmonic 0.00189 D0, predicted 0.00189 D0
    """

    folder: str | None
    name: str
    mode: str | None
    wavenumber: float | None
    direction: float | None
    amplitude: float | None
    theory: str | None
    error: dict[str, float | None]
    predicted: float | None
    measured: float | None
    fit_error: float | None
    notes: list[str]
    signals: tuple[Floats, ...] | None = field(repr=False, compare=False)
    record: Record = field(repr=False, compare=False)
    wave: Wave | None = field(repr=False, compare=False)

    @property
    def run(self) -> str:
        """Name of the run: its folder, else the name of its scene."""
        return self.folder or self.name

    @cached_property
    def _exact(self) -> Trajectory | None:
        if self.wave is None or not holding(self.wave):
            return None
        return trajectory("exact-lattice", self.wave, self.record.tau)

    @cached_property
    def lattice_error(self) -> dict[str, float | None]:
        """Return the error of each component against the exact lattice; empty if there is no such solution."""
        return {} if self._exact is None else errors(self.record, self._exact)

    @cached_property
    def budget(self) -> list[Source]:
        """Return the sources of error and their contributions; empty without an exact lattice."""
        if self.wave is None or self._exact is None:
            return []
        return error_budget(self.record, self.wave, self.lattice_error, self._exact)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for the JSON."""
        plain = {each.name: getattr(self, each.name) for each in fields(self) if each.compare}
        return plain | {"lattice_error": self.lattice_error, "budget": [asdict(source) for source in self.budget]}


def compare(record: Record, theory: str | None = None) -> Comparison:
    """Compare one run with the theory named, or with the best reference (`granular_analysis.measure.reference`).

    Raises TheoryError for a theory that is not in `granular_analysis.theory.catalogue.REFERENCES` or leaves out a part
    of the run, for the network of a run without snapshots, and for a run that no theory covers.

    Examples
    --------
    >>> record = run(Scene.load("tr_periodic").with_values({"time.duration": 10.0}), "runs/compared")
    >>> found = compare(record)
    >>> found.theory, found.error["q"] < 1e-4
    ('hierarchy', True)
    """
    wave = None if signals_of(record) != COMPONENTS else wave_of(record)
    reference = Reference.named(theory, record, wave) if theory else Reference.of(record, wave)
    measured, fit_error, said = _second_harmonic(record, wave)
    return Comparison(
        folder=None if record.folder is None else str(record.folder),
        name=record.scene.name,
        mode=record.scene.wave.mode if record.scene.wave else None,
        wavenumber=record.scene.wavenumber if record.scene.wave else None,
        direction=wave.mode.direction if wave else record.scene.direction if record.scene.wave else None,
        amplitude=record.scene.amplitude if record.scene.wave else None,
        theory=reference.name,
        error={} if reference.signals is None else errors(record, reference.signals),
        predicted=predicted_amplitude(wave) if wave else None,
        measured=measured,
        fit_error=fit_error,
        notes=notes(record, wave, reference) + said,
        signals=reference.signals,
        record=record,
        wave=wave,
    )


def _second_harmonic(record: Record, wave: Wave | None) -> tuple[float | None, float | None, list[str]]:
    """Return amplitude and error of the second harmonic in a run, and a note if it is not measured."""
    if wave is None or not holding(wave):  # `notes` says that no theory holds the wave
        return None, None, []
    try:
        return *measured_amplitude(record, wave), []
    except TheoryError as error:
        return None, None, [f"no second harmonic is measured: {error}"]


def notes(record: Record, wave: Wave | None, reference: Reference) -> list[str]:
    """Return reasons why a comparison may mislead: an unfinished run, triggered guards, another law, or no theory."""
    guards = record.info.get("guards", {})
    status = record.info.get("status", "finished")
    loud = [f"status '{status}': {record.info.get('message')}"] if status != "finished" else []
    loud += [f"{name} = {g['value']}: {g['meaning']}" for name, g in guards.items() if not g["quiet"]]
    if edited := record.info.get("edited"):
        loud.append(
            f"its deck was edited, and no theory includes the edits; lines that differ: {len(edited)}, {edited[0]!r}"
        )
    if accepted := record.info.get("accepted"):
        loud.append(f"files were changed after the run, and accepted: {', '.join(accepted)}")
    if by_network(record) and reference.name == NETWORK:
        loud.append("the network also computed the run: this tests the time steps, not the contact laws")
    material = record.scene.material
    if record.scene.sphere.work_of_adhesion and material.nearer_law != material.adhesion_law:
        loud.append(material.law_words)
    if wave is None:
        return loud + ([] if reference.name else [f"the run has no reference, as {reference.reason}"])
    if not holding(wave):
        instead = INSTEAD[reference.name] + (f", as {reference.reason}" if reference.reason else "")
        loud.append(f"no theory of a plane wave holds {', '.join(beyond(wave))}: the run is compared with {instead}")
    echo = record.scene.echo_time
    if record.tau[-1] > echo and reference.name != NETWORK:
        loud.append(f"echoes of the walls arrive from tau = {echo:.4g} on; the theory is that of the infinite lattice")
    return loud


# --- output ----------------------------------------------------------------------------------------------------------


def table(comparisons: list[Comparison]) -> str:
    """Return the comparisons as text: two lines for a wave (theory and exact lattice), one for other runs, notes."""
    width = max([len("run"), *(len(c.run) for c in comparisons)])
    lines: list[str] = []
    waves, others = ([c for c in comparisons if (c.wave is None) == without] for without in (False, True))
    if waves:
        titles = f"{'p':>9}{'q':>9}{'phi':>9}   {'SH measured':>12}{'±':>9}{'predicted':>11}"
        lines.append(f"{'run':{width}} {'mode':5}{'xi':>8}{'a':>7}  {'against':15}{titles}")
    for c in waves:
        head = f"{c.run:{width}} {c.mode:5}{c.wavenumber:8.4g}{c.amplitude:7.3g}"
        measured = f"{'-':>12}{'-':>9}" if c.measured is None else f"{c.measured:12.4g}{c.fit_error:9.0e}"
        predicted = f"{'-':>11}" if c.predicted is None else f"{c.predicted:11.4g}"
        lines.append(f"{head}  {c.theory or '-':15}{_cells(c.error)}   {measured}{predicted}")
        lines.append(f"{'':{len(head)}}  {'exact lattice':15}{_cells(c.lattice_error)}")
    for names in (FIELDS, IN_SPACE):
        alike = [c for c in others if names_of(c) == names]
        if alike:
            lines.append(f"{'run':{width}}  {'against':15}" + "".join(f"{name:>14}" for name in names))
        lines += [f"{c.run:{width}}  {c.theory or '-':15}{_cells(c.error, names, 14)}" for c in alike]
    lines += [f"note on {c.run}: {note}" for c in comparisons for note in c.notes]
    for c in comparisons:
        lines += budget_lines(c.run, c.budget)
    return "\n".join(lines)


def swept_table(swept: Swept, comparisons: list[Comparison]) -> str:
    """Return a sweep as text, one line per run: varied values, errors against theory, second harmonic in D0."""
    varied = swept.columns([c.record for c in comparisons])
    signals = names_of(comparisons[0])
    titles = [*varied, "against", *signals, "SH measured", "±", "predicted", "deviation"]
    rows = [titles]
    for number, c in enumerate(comparisons):
        numbers = [("-" if x is None else f"{x:.5g}") for x in (c.measured, c.fit_error, c.predicted)]
        off = "-" if c.measured is None or not c.predicted else f"{c.measured / c.predicted - 1:.1e}"
        values = [column[number] for column in varied.values()]
        rows.append([*values, c.theory or "-", *_cells(c.error, signals).split(), *numbers, off])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    lines += [f"note on {c.run}: {note}" for c in comparisons for note in c.notes]
    asked = len(comparisons) + swept.shared + swept.missing
    if swept.shared:
        runs = asked - swept.shared
        lines.append(f"{asked} points of the sweep share {runs} run{'s' * (runs > 1)}, because values are equal")
    if swept.missing:
        lines.append(f"{swept.missing} of {asked} points are not finished, and left out")
    return "\n".join(lines)


def differences(records: Sequence[Record]) -> dict[str, list[Any]]:
    """Return the values of all runs, in order, for each key of the scene that differs between runs.

    A key that a scene does not have, such as a time step beside a tolerance, has the value None. Keys that have their
    default in every scene are left out.
    """
    scenes = [_values(record) for record in records]
    said = {key for record in records for key in record.scene.departures()}
    keys = [key for scene in scenes for key in scene if key in said or key.partition(".")[0] in said]
    values = {key: [scene.get(key) for scene in scenes] for key in keys}
    return {key: row for key, row in values.items() if any(value != row[0] for value in row)}


def _values(record: Record) -> dict[str, Any]:
    """Return the values of a scene by dotted key, such as "inclusion.1.density" in the first of several tables.

    Name and description, which do not change a run, are left out.
    """
    scene = record.scene
    tables = {name: asdict(getattr(scene, name)) for name in scene.layout.optional} | scene.to_dict()
    for name in scene.layout.repeated:
        tables |= {f"{name}.{number}": table for number, table in enumerate(tables.pop(name, []), start=1)}
    held = {table: values for table, values in tables.items() if isinstance(values, dict)}
    return {f"{table}.{key}": value for table, values in held.items() for key, value in values.items()}


def difference_lines(records: Sequence[Record], comparisons: Sequence[Comparison]) -> list[str]:
    """Return a line for each difference between the scenes of several runs; none for one run or equal scenes."""
    found = differences(records)
    if not found:
        return []
    lines = ["", "differences between the scenes:"]
    for number, comparison in enumerate(comparisons):
        own = (f"{key} = {row[number]!r}" for key, row in found.items() if row[number] is not None)
        lines.append(f"  {comparison.run}: " + ", ".join(own))
    return lines


def by_network(record: Record) -> bool:
    """Return whether the network computed a run, in place of LAMMPS."""
    return record.info.get("launcher") == NETWORK


def names_of(comparison: Comparison) -> tuple[str, ...]:
    """Return the names of the signals of a comparison."""
    return signals_of(comparison.record)


def _cells(values: dict[str, float | None], names: Sequence[str] = COMPONENTS, width: int = 9) -> str:
    shown = {name: "0" if value is None else format(value, ".1e") for name, value in values.items()}
    return "".join(f"{shown.get(name, '-'):>{width}}" for name in names)


def figure(record: Record, comparison: Comparison) -> "Figure":
    """Return the figure of each nonzero signal of the run and the reference, with their difference below.

    A run without a wave shows the signals of the sphere that moves most, in its direction.

    Raises TheoryError for a comparison without a theory.
    """
    from matplotlib.figure import Figure  # slow to import, and sweeps have no figure

    c = comparison
    if c.signals is None:
        raise TheoryError(f"theory = None: {c.run} is compared with nothing")
    along_y = c.wave is None or c.direction == ALONG_Y
    labels = LABELS if along_y else OBLIQUE_LABELS
    runs, signals = recorded(record), dict(zip(signals_of(record), c.signals, strict=True))
    # A signal that is zero by symmetry would fill two panels with rounding
    drawn = {name: values for name, values in signals.items() if c.error.get(name, 0.0) is not None} or signals
    high = 6.3 * len(drawn) / 3
    result = Figure(figsize=(6.3, high))
    # Margins by hand: a layout that is sought draws every label twice, a quarter of the time of a comparison
    result.subplots_adjust(left=0.14, right=0.97, bottom=0.84 / high, top=1 - 0.56 / high, hspace=0.35)
    panels = result.subplots(2 * len(drawn), 1, sharex=True, height_ratios=[3, 1] * len(drawn))
    for axes in panels[:-1]:  # ticks take half of the time of a drawing
        axes.xaxis.set_visible(False)
    for (signal, difference), (name, values) in zip(panels.reshape(-1, 2), drawn.items(), strict=True):
        run, theory = _liveliest(runs.get(name, np.full_like(values, np.nan)), values)
        signal.plot(record.tau, run, color="black", label="network" if by_network(record) else "LAMMPS")
        signal.plot(record.tau, theory, color="C3", linestyle="--", label=c.theory)
        signal.set_ylabel(labels[name])
        signal.set_title(_title(c.error, name), pad=2, y=1.0)
        difference.plot(record.tau, run - theory, color="tab:grey", linewidth=0.8)
        difference.set_ylabel("difference")
    result.legend(*panels[0].get_legend_handles_labels(), loc="lower center", ncols=2)
    panels[-1].set_xlabel("time τ" if c.mode else "time t/t₀")
    panels[-1].margins(x=0)
    heading = "" if along_y else f" at {c.direction:g}°"
    of_wave = f": {c.mode}{heading}, ξ = {c.wavenumber:.5g}, D₀ = {c.amplitude:g} Δ₀" if c.mode else ""
    result.suptitle(c.name.replace("_", " ") + of_wave)
    return result


def _liveliest(run: Floats, reference: Floats) -> tuple[Floats, Floats]:
    """Return the component, (T,), of two signals (T, ...) of a run and its reference where the reference is largest."""
    flat = reference.reshape(len(reference), -1)
    largest = int(np.argmax(np.abs(flat).max(axis=0)))
    return run.reshape(len(run), -1)[:, largest], flat[:, largest]


def _title(error: dict[str, float | None], name: str) -> str:
    if name not in error:
        return "not in the record"
    value = error[name]
    return "zero by symmetry" if value is None else f"relative error {value:.1e}"


def _of_unnamed(options: argparse.Namespace) -> int:
    """Compare adopted dumps with their witness; returns the exit status."""
    from granular_analysis.measure.witness import table as witness_table  # takes SciPy
    from granular_analysis.measure.witness import witness

    if options.theory:
        raise SystemExit(f"--theory {options.theory}: is for runs of scenes; an unnamed crystal has a witness instead")
    found = []
    for folder in options.runs:
        with in_one_line(folder):
            crystal = Unnamed.load(folder)
            beside = witness(crystal)
        print(witness_table(crystal, beside))
        found.append({"folder": folder} | asdict(beside))
    if options.json:
        write(Path(options.json), json.dumps(found, indent=2) + "\n")
    return 0


def main(argv: list[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", nargs="+", metavar="RUN", help="run folders, or one sweep folder")
    parser.add_argument(
        "--theory", choices=sorted(REFERENCES), help="compare with this theory in place of the best one for each run"
    )
    parser.add_argument("--json", metavar="FILE", help="write the comparisons as JSON")
    parser.add_argument("--force", action="store_true", help="include runs that did not finish")
    options = parser.parse_args(argv)
    if any(map(is_unnamed, options.runs)):
        return _of_unnamed(options)
    swept = Swept.load(options.runs[0]) if len(options.runs) == 1 else None
    folders = swept.folders if swept else options.runs
    comparisons, records = [], [load(folder, unfinished=options.force) for folder in folders]
    for folder, record in zip(folders, records, strict=True):
        try:
            comparisons.append(compare(record, options.theory))
        except TheoryError as error:
            raise SystemExit(f"{folder}: {error}") from error
    if swept:
        print(swept_table(swept, comparisons))
    else:
        print("\n".join([table(comparisons), *difference_lines(records, comparisons)]))
    if options.json:
        write(Path(options.json), json.dumps([c.to_dict() for c in comparisons], indent=2) + "\n")
    if swept:  # figures last: they may fail where the numbers do not
        if drawn := curves.figure(swept, records, [each.signals for each in comparisons], LABELS):
            save(drawn, swept.folder / "compare.png")
        return 0
    for folder, record, found in zip(folders, records, comparisons, strict=True):
        if found.theory:
            save(figure(record, found), Path(folder) / "compare.png")
    return 0
