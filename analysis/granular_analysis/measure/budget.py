"""Error budget: differences of a run from the infinite lattice, and of the paper's theory from both.

Every error is a relative L2 error over the run. The run itself estimates the errors from the time step, the walls and
rounding, in ``run.json``. The others are measured here with the exact lattice (`granular_analysis.theory.lattice`), an
integration with the contacts of LAMMPS:

- all of it: the run against the exact lattice. It includes the three errors above and any that a single run cannot
  estimate;
- geometry: the exact lattice in the paper's limit Δ0/R → 0 against the exact lattice in LAMMPS's geometry;
- perturbation order: second order, in LAMMPS's geometry, against the exact lattice.

The last two are errors of theories, not of the run.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from granular_analysis.measure.norms import relative_error
from granular_analysis.second_harmonic import MODES
from granular_analysis.theory.bloch import mode
from granular_analysis.theory.choice import Trajectory, holding, trajectory
from granular_analysis.theory.errors import one_of
from granular_analysis.theory.wave import Wave
from granular_lmp.runs.record import Record

COMPONENTS = ("p", "q", "phi")
Errors = Mapping[str, float | None]
# A source dominates from this share of the largest error on. "all of it" often is the time step plus rounding, which
# must not decide between the two
_AS_LARGE = 0.9


@dataclass(frozen=True)
class Source:
    """One source of error.

    Attributes
    ----------
    name : str
    of : "run" or "theory"
        Error of the run against the infinite lattice, or of the paper's theory against the exact lattice.
    p, q, phi : float or None
        Relative L2 errors; None if the signal vanishes by symmetry or the error is unknown.
    to_halve : str
        Change that halves the error.
    dominates : tuple of str
        Signals in which this error is at least 0.9 of the largest.
    """

    name: str
    of: str
    p: float | None
    q: float | None
    phi: float | None
    to_halve: str
    dominates: tuple[str, ...] = ()


def error_budget(record: Record, wave: Wave, measured: Errors, exact: Trajectory) -> list[Source]:
    """Return the sources of error of a run, and of the paper's theory of it.

    Parameters
    ----------
    record : Record
        Run that the exact lattice holds.
    wave : Wave
        Wave of the run.
    measured : mapping
        Relative errors of p, q, φ of the run against the exact lattice; None if the signal vanishes by symmetry.
    exact : tuple of (T,) array
        p, q, φ of the exact lattice at the times of the record, in D0.

    Returns
    -------
    list of Source
        Sources that ``run.json`` estimates, if any, then those measured here; second order only if it holds the wave.
    """
    known = [
        Source(_named(line), "run", line["p"], line["q"], line["phi"], line["to_halve"])
        for line in record.info.get("error_budget", [])
    ]
    found = {("run", "all of it, measured"): (dict(measured), "the largest error above")}
    if wave.contact.overlap_ratio:
        found["theory", "geometry"] = (
            _distance(trajectory("exact-lattice", points_of_contact(wave), record.tau), exact, measured),
            "sphere.radius x 2.83, or a theory with overlap_ratio",
        )
    if "second-order" in holding(wave):
        found["theory", "perturbation order"] = (
            _distance(trajectory("second-order", wave, record.tau), exact, measured),
            "wave.amplitude x 0.71, or a theory of higher order",
        )
    table = known + [
        Source(name, of, values.get("p"), values.get("q"), values.get("phi"), to_halve)
        for (of, name), (values, to_halve) in found.items()
    ]
    largest = {name: max((getattr(line, name) or 0.0 for line in table), default=0.0) for name in COMPONENTS}
    return [
        replace(
            line,
            dominates=tuple(
                name for name in COMPONENTS if (getattr(line, name) or 0.0) >= _AS_LARGE * largest[name] > 0
            ),
        )
        for line in table
    ]


def _named(line: Mapping[str, Any]) -> str:
    """Return the name of an error in ``run.json``; for the time step with the order of convergence."""
    if "order" not in line:
        return str(line["name"])
    return f"{line['name']}, order {line['order']}" if line["order"] else f"{line['name']}, no order"


def points_of_contact(wave: Wave) -> Wave:
    """Return the wave with the same mode, wave number and direction in the paper's geometry, Δ0/R → 0."""
    contact = replace(wave.contact, overlap_ratio=0.0)
    pointlike = mode(one_of(MODES, wave.mode.name, "mode"), wave.mode.wavenumber, wave.mode.direction, contact)
    return replace(wave, mode=pointlike, contact=contact)


def _distance(theory: Trajectory, exact: Trajectory, measured: Errors) -> dict[str, float | None]:
    """Return the relative errors of a theory against the exact lattice, for the signals that do not vanish."""
    return {
        name: relative_error(values, reference)
        for name, values, reference in zip(COMPONENTS, theory, exact, strict=True)
        if measured.get(name) is not None
    }


def budget_lines(name: str, budget: list[Source]) -> list[str]:
    """Return the budget of a run as lines of text; * marks the errors that dominate. An empty budget gives no line."""
    if not budget:
        return []
    text = ["", f"error budget of {name:27}{'p':>10}{'q':>10}{'phi':>10}   to halve it"]
    for source in budget:
        values = {name: getattr(source, name) for name in COMPONENTS}
        cells = "".join(
            f"{'-' if value is None else format(value, '.1e'):>9}" + ("*" if name in source.dominates else " ")
            for name, value in values.items()
        )
        text.append(f"  of the {source.of:8}{source.name:27}{cells}   {source.to_halve}")
    return text
