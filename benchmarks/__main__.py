"""Every contestant on one problem, interleaved: time as a whole and in the loop, and the error that goes with it.

    python -m benchmarks [--repeats N] [--only NAME ...]

One that is not installed is skipped and said so. Times are medians (smallest–largest); a ratio is to the first line,
the median of the ratios within a round, then the ratio of the smallest times.
"""

import argparse
import sys
from collections.abc import Sequence

from benchmarks import naive, ours, rows
from benchmarks.peers import liggghts, yade
from benchmarks.problem import Contestant, Solution, base_scene, errors, exact
from benchmarks.timing import both_ratios, interleave, machine, rates, spread, table

CONTESTANTS = {module.CONTESTANT.name: module.CONTESTANT for module in (ours, naive, rows, yade, liggghts)}
HEAD = [
    *("", "spheres", "steps", "whole, s", "ratio", "loop, s", "ratio", "error of p", "of q"),
    *("M particle-steps/s", "ns per contact and step"),
]


def report(present: Sequence[Contestant], repeats: int) -> str:
    """Run the contestants and give the table, their remarks below it."""
    exact(base_scene())  # not on anybody's clock
    rounds = interleave({contestant.name: contestant.solve for contestant in present}, repeats)
    lines, remarks = [], []
    for contestant in present:
        last = rounds[contestant.name][-1][1]
        lines.append(_line(contestant.title, rounds[contestant.name], rounds[present[0].name]))
        if last.remark:
            remarks.append(f"- {contestant.name}: {last.remark}")
    return "\n".join([table(HEAD, lines), "", *remarks])


def _line(title: str, rounds: list[tuple[float, Solution]], first: list[tuple[float, Solution]]) -> list[str]:
    whole, first_whole = [seconds for seconds, _ in rounds], [seconds for seconds, _ in first]
    loop, first_loop = [solution.loop for _, solution in rounds], [solution.loop for _, solution in first]
    last = rounds[-1][1]
    return [
        title,
        str(last.spheres),
        "own" if last.steps is None else str(last.steps),
        spread(whole),
        both_ratios(whole, first_whole),
        spread(loop),
        both_ratios(loop, first_loop),
        *(f"{error:.2g}" for error in errors(base_scene(), last.p, last.q)),
        *(("–", "–") if last.steps is None else rates(last.spheres * last.steps, loop)),
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="rounds (default 5)")
    parser.add_argument("--only", nargs="+", choices=CONTESTANTS, metavar="NAME", help=", ".join(CONTESTANTS))
    options = parser.parse_args(argv)
    missing = {name: CONTESTANTS[name].missing() for name in options.only or CONTESTANTS}
    print(machine() + "\n")
    if present := [CONTESTANTS[name] for name, why in missing.items() if not why]:
        print(report(present, max(options.repeats, 1)))
    for name, why in missing.items():
        if why:
            print(f"- {name}: skipped, {why}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
