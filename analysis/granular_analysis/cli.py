"""Command line ``granular-analysis``: ``granular-analysis compare RUN`` runs `granular_analysis.tools.compare`.

In a checkout it also runs the cases, which stand beside the package.
"""

import argparse
import sys
from contextlib import redirect_stdout, suppress
from importlib import import_module
from io import StringIO
from pathlib import Path

from granular_lmp.cli.entry import as_program
from granular_lmp.cli.output import notes_of_log

DOORS = {
    "branches": "frequencies over wave numbers from adopted dumps of any origin; the lattice is found automatically",
    "compare": "comparison of runs with theory: errors of p, q, φ, and amplitude of the second harmonic",
    "design": "pairs of waves that resonate; best numbers of a scene for second-order effects or a whole run",
    "fit": "fit of keys of a scene to measured frequencies, harmonics and arrivals, with 95 % intervals",
    "harmonic": "coherent second harmonic of any scene or run, perfect or not, with its error",
    "image": "image of the contacts or spheres that differ, from records of a few spheres",
    "network": "run of a scene without LAMMPS but with the same time steps, on a CPU or a GPU",
    "resonances": "resonances and antiresonances of second order in the crystal of a scene",
    "saw": "surface waves of an elastic substrate, coupled to the contact resonances of a layer",
    "scatter": "transmission and reflection by unequal rows, compared with the linear lattice",
}
CASE = "run cases: the runs, script and expected numbers behind a figure"
CASES = Path(__file__).parents[1] / "cases"  # only in a checkout


def main(argv: list[str] | None = None) -> int:
    """Run one script of the package or of a case, and return its exit status."""
    words = sys.argv[1:] if argv is None else argv
    known = DOORS if words and words[0] in DOORS else scripts()
    parser = argparse.ArgumentParser(
        prog="granular-analysis",
        description="Compare runs of granular-lmp with theory that shares no code with LAMMPS.",
        epilog="scripts:\n" + "\n".join(f"  {name:13} {says}" for name, says in known.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "script",
        choices=[*known, "case", "cases"],
        metavar="SCRIPT",
        help="name of the script; each has --help; cases lists the cases with runs and figures",
    )
    parser.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...", help="arguments of the script")
    chosen = parser.parse_args(words)
    if chosen.script == "cases":
        chosen.script, chosen.arguments = "case", ["--list", *chosen.arguments]
    if chosen.script == "case" and not CASES.is_dir():
        parser.error("case: only a checkout of the repository has cases")
    sys.argv[0] = f"granular-analysis {chosen.script}"  # name of the script in its messages
    module = f"granular_analysis.tools.{chosen.script}" if chosen.script in DOORS else f"cases.{chosen.script}.case"
    with notes_of_log():
        return import_module("cases.run" if chosen.script == "case" else module).main(chosen.arguments) or 0


def help_texts() -> dict[str, str]:
    """Return the help of the command and of each of `DOORS`, for the reference page."""
    found = {}
    for words in ([], *([door] for door in DOORS)):
        with redirect_stdout(StringIO()) as printed, suppress(SystemExit):
            main([*words, "--help"])
        found[" ".join(["granular-analysis", *words])] = printed.getvalue().rstrip()
    return found


def program() -> int:
    """Run the script of this process and return its exit status; an error is one line."""
    return as_program("granular-analysis", main)


def scripts() -> dict[str, str]:
    """Return the purpose of each script, including cases, whose files are then read."""
    if not CASES.is_dir():
        return DOORS
    run = import_module("cases.run")  # inside the entry, like the scripts
    cases = {case.name: case.says for case in map(run.Case.load, run.names()) if case.figure}
    return DOORS | {"case": CASE} | {name: says for name, says in cases.items() if name not in DOORS}
