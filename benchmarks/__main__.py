"""Every contestant on one problem, interleaved: processor time, wall time, time of the loop, and the error with it.

    python -m benchmarks [--repeats N] [--only NAME ...] [-o FILE]

One that is not installed is skipped and said so. Times are medians (smallest–largest). A ratio is one of processor
times, and only to the first run of this package in LAMMPS whose error of p is the same within a factor of 1.5: the
median of the ratios within a round, then the ratio of the smallest times. With -o the figure is drawn, error over time.
"""

import argparse
import resource
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks import contact_list, naive, ours, rows
from benchmarks.figure import Point, draw
from benchmarks.peers import liggghts, yade
from benchmarks.problem import Contestant, Solution, base_scene, errors, exact
from benchmarks.timing import both_ratios, interleave, machine, spread, table

CONTESTANTS = {
    each.name: each
    for each in (
        *(*ours.CONTESTANTS, *contact_list.CONTESTANTS, *rows.CONTESTANTS),
        *(naive.CONTESTANT, yade.CONTESTANT, liggghts.CONTESTANT),
    )
}
SAME = 1.5  # factor within which errors are the same
HEAD = [
    "",
    "spheres",
    "steps",
    "error of p",
    "of q",
    "processor, s",
    "wall, s",
    "loop, s",
    "ratio at equal error",
    "to",
]


@dataclass(frozen=True)
class Rounds:
    """The rounds of one contestant: processor seconds, wall seconds, solutions; and the errors of the last."""

    contestant: Contestant
    processor: list[float]
    wall: list[float]
    solutions: list[Solution]

    @property
    def errors(self) -> tuple[float, float]:
        """Errors of p and q."""
        return errors(base_scene(), self.solutions[-1].p, self.solutions[-1].q)


def timed(solve: Callable[[Path], Solution]) -> Callable[[Path], tuple[float, Solution]]:
    """Return the job with its processor seconds, also those of the programs that it starts."""

    def job(folder: Path) -> tuple[float, Solution]:
        started = _processor_seconds()
        solution = solve(folder)
        return _processor_seconds() - started, solution

    return job


def _processor_seconds() -> float:
    each = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(used.ru_utime + used.ru_stime for used in each)


def measured(present: Sequence[Contestant], repeats: int) -> dict[str, Rounds]:
    """Run the contestants in turn, `repeats` times."""
    exact(base_scene())  # not on anybody's clock, nor is the compiler
    if any(each.name.startswith("list") for each in present):
        contact_list.library()
    done = interleave({each.name: timed(each.solve) for each in present}, repeats)
    return {
        each.name: Rounds(
            each,
            [result[0] for _, result in done[each.name]],
            [wall for wall, _ in done[each.name]],
            [result[1] for _, result in done[each.name]],
        )
        for each in present
    }


def reference(error: float, rounds: Mapping[str, Rounds]) -> str | None:
    """Return the first contestant of this package in LAMMPS with the same error of p, if there is one."""
    own = [each.name for each in ours.CONTESTANTS if each.name in rounds]
    return next((name for name in own if 1 / SAME <= rounds[name].errors[0] / error <= SAME), None)


def report(rounds: Mapping[str, Rounds]) -> str:
    """Return the table, and the remarks of contestants below it."""
    remarks = [f"- {name}: {each.solutions[-1].remark}" for name, each in rounds.items() if each.solutions[-1].remark]
    return "\n".join([table(HEAD, [_line(each, rounds) for each in rounds.values()]), "", *remarks])


def _line(each: Rounds, rounds: Mapping[str, Rounds]) -> list[str]:
    last = each.solutions[-1]
    equal = reference(each.errors[0], rounds)
    return [
        each.contestant.title,
        str(last.spheres),
        "own" if last.steps is None else str(last.steps),
        *(f"{error:.2g}" for error in each.errors),
        spread(each.processor),
        spread(each.wall),
        spread([solution.loop for solution in each.solutions]),
        *(("–", "–") if equal is None else (both_ratios(each.processor, rounds[equal].processor), equal)),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="rounds (default 5)")
    parser.add_argument("--only", nargs="+", choices=CONTESTANTS, metavar="NAME", help=", ".join(CONTESTANTS))
    parser.add_argument("-o", "--output", metavar="FILE", help="draw error over processor time: PNG, PDF or SVG")
    options = parser.parse_args(argv)
    missing = {name: CONTESTANTS[name].missing() for name in options.only or CONTESTANTS}
    print(machine() + "\n")
    if present := [CONTESTANTS[name] for name, why in missing.items() if not why]:
        rounds = measured(present, max(options.repeats, 1))
        print(report(rounds))
        if options.output:
            draw(
                [
                    Point(each.contestant.series or each.contestant.title, each.processor, each.errors)
                    for each in rounds.values()
                ],
                options.output,
            )
    for name, why in missing.items():
        if why:
            print(f"- {name}: skipped, {why}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
