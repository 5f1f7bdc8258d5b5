"""``python -m tests.matrix.compared`` runs pairs of the matrix, compares all spheres with the network.

Each pair of waves that the first table refused as not built, and each with a feature that came later, runs with
two time steps. The *departure* is the largest difference between the fields of all spheres, extrapolated from both
steps to none, and those of the network, over the largest of the network. The *bound* is what the two runs differ by: an
error of any order in the step is at most that, and an extrapolation in second order leaves two thirds of it, or far
less.
"""

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from granular_analysis.measure.reference import SLIDING_STEP
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.catalogue import NETWORK, missing
from granular_analysis.theory.choice import TheoryError, others_of
from granular_analysis.theory.network_motion import integrate
from granular_lmp import Record, Scene, run
from granular_lmp.studies.combine import BUILDS, together
from granular_lmp.studies.features import KINDS
from tests.matrix.outcomes import Row, committed, write

LEFT_OUT = "the network leaves it out: "
LATER = {"striker", "state", "free end", "free sides", "held sides", "finite sheet", "chirp", "honeycomb", "wall end"}
# Refused as not built by the first table
OPENED = {
    "jkr": ("radii", "densities", "vacancies", "rows of another", "another sphere"),
    "hertz": ("chain",),
    "packet": ("moved row", "pushed sphere", "torque"),
    "beam": ("moved row", "pushed sphere", "torque"),
    "oblique": ("square", "fixed", "quiet"),
    "quiet": ("chain", "square"),
    "viscosity": ("radii", "densities", "vacancies", "rows of another", "another sphere"),
    "restitution": ("chain", "radii", "densities", "vacancies", "rows of another", "another sphere"),
    "flux": ("rolling",),
    "torque": ("no tracking",),
}
STEPS = (0.05, 0.025)
SHORT = {"time.duration": 8.0, "time.sample": 1.0, "output.particles": 2.0}
ROUNDING = 1e-8  # of positions, over D0, and what the network's own error leaves


@dataclass(frozen=True)
class Outcome:
    """Departure and bound of a pair, over the largest field; or why the network refuses it."""

    departure: float = np.nan
    bound: float = np.nan
    refused: str = ""

    @property
    def holds(self) -> bool:
        """Return whether the pair is refused, or departs by less than its bound."""
        return bool(self.refused or self.departure <= self.bound + ROUNDING)


def pairs() -> Iterator[tuple[str, str]]:
    """Yield the pairs of waves that were opened, of those that build today."""
    for (kind, one, other), row in committed().items():
        new = {one, other} & LATER or other in OPENED.get(one, ()) or one in OPENED.get(other, ())
        if kind == "waves" and one != other and new and row.outcome == BUILDS:
            yield other, one


def scene_of(one: str, other: str) -> Scene:
    """Return the short scene of a pair of waves."""
    kind = KINDS[0]
    return kind.scene.with_values(together(kind.features[one], kind.features[other]) | SHORT)


def fields_of(record: Record) -> np.ndarray:
    """Return displacement x, y and Rθ of all spheres at every snapshot, (T, N, 3), in D0."""
    displacement, rotation = record.snapshots().stacks("displacement", "rotation")
    return np.concatenate([displacement, rotation[:, :, None]], axis=2)


def outcome(scene: Scene, folder: Path) -> Outcome:
    """Run a scene with two steps, or to its tolerance, and compare it with its network."""
    steps = STEPS if scene.time.tolerance is None else (None,)
    runs = [
        run(scene if step is None else scene.with_values({"time.timestep": step}), folder / f"step{step}")
        for step in steps
    ]
    record = runs[-1]
    if lacks := missing(NETWORK, others_of(record)):
        return Outcome(refused=", ".join(lacks))
    try:
        first = first_snapshot(record)
    except (TheoryError, ValueError) as error:
        return Outcome(refused=str(error).rpartition(": ")[2])
    longest = SLIDING_STEP * first.time if np.isfinite(first.network.friction) else np.inf
    tau = record.snapshots().tau
    motion = integrate(first.network, first.state, tau * first.time, longest_step=longest).motion[:, :3]
    expected = np.moveaxis(motion, 1, 2) * np.array([1.0, 1.0, first.radius]) / first.length
    found = [fields_of(each) for each in runs]
    size = np.abs(expected).max()
    if len(found) == 1:
        return Outcome(float(np.abs(found[0] - expected).max() / size), float(scene.time.tolerance or 0.0))
    coarse, fine = found
    best = (4 * fine - coarse) / 3
    return Outcome(float(np.abs(best - expected).max() / size), float(np.abs(fine - coarse).max() / size))


def row(found: Outcome) -> Row:
    """Return an outcome as a row of the table."""
    if found.refused:
        return Row(BUILDS, LEFT_OUT + found.refused)
    return Row(BUILDS, departure=f"{found.departure:.1e}", bound=f"{found.bound:.1e}")


def outcome_of(row: Row) -> Outcome:
    """Return the outcome that a row of the table holds."""
    if row.departure:
        return Outcome(float(row.departure), float(row.bound))
    return Outcome(refused=row.message.removeprefix(LEFT_OUT))


def main() -> int:
    """Run all pairs; return 1 if one departs by more than its bound."""
    found: dict[tuple[str, str], Outcome] = {}
    for pair in pairs():
        with tempfile.TemporaryDirectory() as folder:
            try:
                found[pair] = outcome(scene_of(*pair), Path(folder))
            except Exception as error:
                print(*pair, type(error).__name__, str(error)[:200], sep=" | ", flush=True)
                continue
        each = found[pair]
        if not each.holds:
            print(*pair, each, sep=" | ", flush=True)
    write(committed() | {("waves", other, one): row(each) for (one, other), each in found.items()})
    return int(not all(each.holds for each in found.values()))


if __name__ == "__main__":
    sys.exit(main())
