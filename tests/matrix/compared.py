"""``python -m tests.matrix.compared`` runs pairs of the matrix, compares all spheres with the network, writes the page.

Each pair of waves that the first golden file refused as not built, and each with a feature that came later, runs with
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
from tests.matrix.features import KINDS, together
from tests.matrix.outcomes import BUILDS, golden

PAGE = Path(__file__).parents[2] / "docs/reference/pairs.md"
BEGIN, END = "<!-- pairs -->\n", "<!-- end of pairs -->\n"
LATER = {"striker", "state", "free end", "free sides", "held sides", "finite sheet", "chirp", "honeycomb", "wall end"}
# Refused as not built by the first golden file
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
    kind = KINDS[0]
    rows, names = golden(kind.name), list(kind.features)
    for place, one in enumerate(names):
        for number, other in enumerate(names[:place]):
            new = {one, other} & LATER or other in OPENED.get(one, ()) or one in OPENED.get(other, ())
            if new and rows[one][number] == BUILDS:
                yield other, one


def scene_of(one: str, other: str) -> Scene:
    """Return the short scene of a pair of waves."""
    kind = KINDS[0]
    settings = together(kind.features[one], kind.features[other])
    assert settings is not None
    return kind.scene.with_values(settings | SHORT)


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


def table(found: dict[tuple[str, str], Outcome]) -> str:
    """Return the outcomes as a table, the largest departure over its bound first."""
    judged = {pair: each for pair, each in found.items() if not each.refused}
    order = sorted(judged, key=lambda pair: -judged[pair].departure)
    lines = ["| pair | departure | bound |", "|---|---|---|"]
    for pair in order:
        lines.append(f"| {' with '.join(pair)} | {judged[pair].departure:.1e} | {judged[pair].bound:.1e} |")
    reasons: dict[str, list[str]] = {}
    for pair, each in found.items():
        if each.refused:
            reasons.setdefault(each.refused, []).append(" with ".join(pair))
    lines += ["", "| refused as the network leaves out | pairs |", "|---|---|"]
    lines += [f"| `{why}` | {'; '.join(which)} |" for why, which in sorted(reasons.items())]
    return "\n".join(lines)


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
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n{table(found)}\n\n{END}{rest.partition(END)[2]}", "utf-8")
    return int(not all(each.holds for each in found.values()))


if __name__ == "__main__":
    sys.exit(main())
