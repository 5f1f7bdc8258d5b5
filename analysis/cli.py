"""The command line ``granular-analysis``: ``granular-analysis compare RUN`` is ``python -m analysis.compare RUN``.

Python looks for `analysis` in the current folder first, where another folder may have that name. A command that was
installed does not look there.
"""

import argparse
import os
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import NoReturn

SCRIPTS = {
    "accuracy": "what granular-lmp cost measured, beside the theories",
    "adhesion_laws": "the DMT and the JKR law in the same crystal: forces, second harmonic, resonance, antiresonance",
    "behind": "the second harmonic behind an interface: made before it, and at it",
    "compare": "runs beside theory: errors of p, q, φ, and the amplitude of the second harmonic",
    "convergence": "how errors of the theories fall with amplitude",
    "defects": "a wave that a vacancy or a heavy sphere scatters, beside the network and theory",
    "design": "two waves of given frequencies that resonate: which pair, directions and compression",
    "dimers": "the front of an impact on a chain of heavy and light spheres: where it decays, and where it does not",
    "disorder": "what unequal spheres do to contacts, attenuation, sound and the second harmonic, from sweeps",
    "dispersion": "all branches, from one kicked sheet",
    "driven": "a driven row beside its theory",
    "effects": "the second harmonic over wave number, by what a scene leaves out or adds",
    "figure2": "the paper's figure 2: dispersion, resonance and antiresonance",
    "figure3": "the paper's figure 3: p, q and φ of runs beside theory",
    "fronts": "the front of an impact on a hexagonal sheet: its decay and its speed",
    "harmonic": "the coherent second harmonic of any scene or run, perfect or not, with its error",
    "impact": "error over cost of an impact: LAMMPS, two symplectic schemes, DOP853",
    "laws": "three shear laws side by side",
    "map": "the second harmonic over direction and wave number",
    "mixing": "the partners of a wave: with which others of the zone it is phase-matched",
    "oblique": "waves of any direction beside theory, from a sweep",
    "onset": "the amplitudes at which contacts open and slide, and the second harmonic beyond",
    "pull_off": "a collision by the JKR law: snap-in, pull-off and restitution, in LAMMPS and theory",
    "resonances": "all resonances and antiresonances of second order of a scene's crystal",
    "refraction": "a plane front of an impact at an interface of two hexagonal crystals: angles, and what passes",
    "scatter": "what passes rows that differ and what comes back, beside the linear lattice",
    "sheets": "any field on a periodic sheet beside theory",
    "solitary": "the solitary wave: shape, speed from sonic vacuum to sound, impurities",
    "spectrum": "the second harmonic of runs over wave number, its zero and its pole",
    "standing": "a standing wave beside its theory",
    "timestep": "what a time step does to a lattice",
    "tones": "two rows shaken at two frequencies: sum and difference beside their theory",
    "unequal": "the front of an impact in sheets of unequal spheres: decay and speed over the spread of radii",
    "witness": "error over time in a crystal that is not perfect, beside the network",
}
DOORS = {"compare", "design", "harmonic"}  # scripts whose answer is a table


def main(argv: list[str] | None = None) -> int:
    """Run one script of `analysis`; returns its exit status."""
    return _script(argv)() or 0


def program() -> NoReturn:
    """Run one script as a program, whose errors are one line (`analysis.plotting.start`)."""
    script = _script(None)
    from analysis.plotting import start  # matplotlib would slow --help down

    start(script)


def _script(argv: list[str] | None) -> Callable[[], int | None]:
    """Return the script that the arguments name, with its own arguments."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the matrices are small; threads would only wait for each other
    os.environ["MPLBACKEND"] = "agg"  # pictures go to files; matplotlib is not imported where it knows not the backend
    parser = argparse.ArgumentParser(
        prog="granular-analysis",
        description="Theory that shares no code with LAMMPS, beside runs of granular-lmp.",
        epilog="scripts:\n" + "\n".join(f"  {name:13} {says}" for name, says in SCRIPTS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("script", choices=SCRIPTS, metavar="SCRIPT", help="which; each has --help")
    parser.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...", help="for the script")
    chosen = parser.parse_args(argv)
    sys.argv[0] = f"granular-analysis {chosen.script}"  # the name by which the script speaks of itself
    module = f"analysis.{chosen.script}" if chosen.script in DOORS else f"analysis.cases.{chosen.script}.case"
    return partial(import_module(module).main, chosen.arguments)
