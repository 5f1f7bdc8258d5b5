"""The command line ``granular-analysis``: ``granular-analysis compare RUN`` runs `granular_analysis.tools.compare`.

In a checkout it runs the cases too, which stand beside the package.
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
    "branches": "frequencies over wave numbers of anybody's adopted dumps, whose lattice is found by itself",
    "compare": "runs beside theory: errors of p, q, φ, and the amplitude of the second harmonic",
    "design": "which two waves resonate; at which numbers of a scene second order or a whole run does best",
    "fit": "keys of a scene from measured frequencies, harmonics and arrivals, with 95 % intervals",
    "harmonic": "the coherent second harmonic of any scene or run, perfect or not, with its error",
    "image": "which contacts or spheres of a crystal differ, by what was recorded of a few of its spheres",
    "network": "a run without LAMMPS: the deck of a scene, stepped as LAMMPS does, on a CPU or a GPU",
    "resonances": "all resonances and antiresonances of second order of a scene's crystal",
    "saw": "surface waves of an elastic substrate that couple to the contact resonances of a layer",
    "scatter": "what passes rows that differ and what comes back, beside the linear lattice",
}
CASE = "run cases: what a figure needs, runs, script and expected numbers"
CASES = Path(__file__).parents[1] / "cases"  # in a checkout alone


def main(argv: list[str] | None = None) -> int:
    """Run one script of the package or of a case; returns its exit status."""
    words = sys.argv[1:] if argv is None else argv
    known = DOORS if words and words[0] in DOORS else scripts()
    parser = argparse.ArgumentParser(
        prog="granular-analysis",
        description="Theory that shares no code with LAMMPS, beside runs of granular-lmp.",
        epilog="scripts:\n" + "\n".join(f"  {name:13} {says}" for name, says in known.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "script",
        choices=[*known, "case", "cases"],
        metavar="SCRIPT",
        help="which; each has --help; cases lists those with runs and figures",
    )
    parser.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...", help="for the script")
    chosen = parser.parse_args(words)
    if chosen.script == "cases":
        chosen.script, chosen.arguments = "case", ["--list", *chosen.arguments]
    if chosen.script == "case" and not CASES.is_dir():
        parser.error("case: cases are only in a checkout of the repository")
    sys.argv[0] = f"granular-analysis {chosen.script}"  # the name by which the script speaks of itself
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
    """Run the script of this process; returns its exit status, and says an error in one line."""
    return as_program("granular-analysis", main)


def scripts() -> dict[str, str]:
    """Return what each script does, those of the cases among them, whose files are then read."""
    if not CASES.is_dir():
        return DOORS
    run = import_module("cases.run")  # inside the entry, as the scripts
    cases = {case.name: case.says for case in map(run.Case.load, run.names()) if case.figure}
    return DOORS | {"case": CASE} | {name: says for name, says in cases.items() if name not in DOORS}
