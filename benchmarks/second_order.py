"""Time second order beside the exact lattice, LAMMPS and the network, at errors no larger; ratios of one run.

    python -m benchmarks.second_order [--spheres N ...] [--amplitudes A ...] [--repeats N]

First table, a plane wave: TR, ξ = 0.802, τ ≤ 120, over the amplitude. Second order is the general theory of a scene's
crystal (`granular_analysis.theory.scenes`), and its error in p is what it leaves out, from the exact lattice with rtol
1e-11. The exact lattice and LAMMPS take the cheapest of their settings whose error is no larger; – if none is.

Second table, sheets of unequal spheres, τ ≤ 20, over their number: the coherent second harmonic by the cell
(`granular_analysis.theory.cell`) and by the network, whose error is its own fourth order. The difference of the two is
a share of the largest C.

Seconds are processor time, from the scene or the first snapshot to the signal.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import ours
from benchmarks.network import sized
from benchmarks.problem import base_scene, errors, times
from benchmarks.problem import exact as exact_signal
from benchmarks.timing import both_ratios, interleave, machine, spread, table
from granular_analysis.measure.harmonic import by_cell, by_network
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.wave import Wave
from granular_lmp import Scene, run

LATTICE = (1e-4, 1e-6, 1e-8, 1e-10)  # rtol
LAMMPS: list[dict[str, Any]] = [
    *({"packing.rows": 201, "time.timestep": step} for step in (0.2, 0.1, 0.05, 0.025)),
    *({"packing.rows": "auto", "time.tolerance": tolerance} for tolerance in (1e-1, 1e-2, 1e-3)),
]
PLANE_HEAD = [
    *("a", "error of p", "second order, s", "exact lattice, s", "LAMMPS, s"),
    *("exact lattice over second order", "LAMMPS over second order"),
]
SHEET_HEAD = ["spheres", "cell, s", "network, s", "network over cell", "difference", "fourth order"]


class Spent(NamedTuple):
    """Processor seconds of a way to a signal, and its error."""

    seconds: float
    error: float


class Plane(NamedTuple):
    """A plane wave by second order, and by the cheapest setting of the others that is as good, if there is one."""

    theory: Spent
    exact: Spent | None
    lammps: Spent | None


class Sheet(NamedTuple):
    """A coherent second harmonic by the cell and by the network: seconds, difference and fourth order."""

    cell: float
    network: float
    difference: float
    fourth: float


def timed(solve: Callable[[], tuple[np.ndarray, np.ndarray]], scene: Scene) -> Spent:
    """Return what p and q of a wave cost, and the error of p."""
    begun = time.process_time()
    p, q = solve()
    return Spent(time.process_time() - begun, errors(scene, p, q)[0])


def plane(amplitude: float, folder: Path) -> Plane:
    """Solve the plane wave in all ways."""
    scene = base_scene().with_values({"wave.amplitude": amplitude})
    exact_signal(scene)  # on nobody's clock
    theory = timed(partial(by_theory, scene), scene)
    exact = (timed(partial(on_lattice, scene, rtol), scene) for rtol in LATTICE)
    runs = (
        timed(partial(in_lammps, {"wave.amplitude": amplitude, **values}, folder / str(number)), scene)
        for number, values in enumerate(LAMMPS)
    )
    return Plane(theory, cheapest(list(exact), theory.error), cheapest(list(runs), theory.error))


def by_theory(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return p and q to second order."""
    parts = Setting(scene).signals(times(scene))
    p, q, _ = (one + other for one, other in zip(*parts, strict=True))
    return p, q


def on_lattice(scene: Scene, rtol: float) -> tuple[np.ndarray, np.ndarray]:
    """Return p and q on the exact lattice."""
    sphere = scene.sphere
    contact = Contact.of(sphere)
    p, q, _ = lattice.torus(Wave.of_mode("TR", scene.wavenumber, scene.amplitude, contact), times(scene), rtol=rtol)
    return p, q


def in_lammps(values: dict[str, Any], folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return p and q of a run."""
    found = ours.solve(values, kernel=False, folder=folder)
    return found.p, found.q


def cheapest(ways: Sequence[Spent], worst: float) -> Spent | None:
    """Return the cheapest of the ways whose error is no larger than another one."""
    return min((each for each in ways if each.error <= worst), default=None, key=lambda each: each.seconds)


def sheet(spheres: int, folder: Path) -> Sheet:
    """Solve a sheet of unequal spheres by the cell and by the network."""
    record = run(sized(spheres), folder / "run", kernel=False)
    tau = np.arange(21.0)
    begun = time.process_time()
    cell = by_cell(record, tau)
    between = time.process_time()
    network = by_network(record, tau)
    used = between - begun, time.process_time() - between
    largest = np.abs(network.amplitudes).max()
    apart, fourth = np.abs(cell.amplitudes - network.amplitudes).max(), network.errors.max()
    return Sheet(*used, float(apart / largest), float(fourth / largest))


def plane_line(amplitude: float, rounds: Sequence[Plane]) -> list[str]:
    """Return one line of the first table; ratios are within rounds, and of the smallest times."""
    theory = [each.theory.seconds for each in rounds]
    seconds, ratios = [], []
    for ways in ([each.exact for each in rounds], [each.lammps for each in rounds]):
        known = [each.seconds for each in ways if each is not None]
        whole = len(known) == len(rounds)
        seconds.append(spread(known) if whole else "–")
        ratios.append(both_ratios(known, theory) if whole else "–")
    return [f"{amplitude:g}", f"{rounds[-1].theory.error:.1e}", spread(theory), *seconds, *ratios]


def sheet_line(spheres: int, rounds: Sequence[Sheet]) -> list[str]:
    """Return one line of the second table."""
    cell, network = [each.cell for each in rounds], [each.network for each in rounds]
    last = rounds[-1]
    shares = f"{last.difference:.0e}", f"{last.fourth:.0e}"
    return [str(sized(spheres).shape.spheres), spread(cell), spread(network), both_ratios(network, cell), *shares]


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.second_order", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--spheres", type=int, nargs="*", default=[100, 1000, 10000], metavar="N")
    parser.add_argument("--amplitudes", type=float, nargs="*", default=[0.2, 0.05, 0.0125], metavar="A")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="rounds (default 3)")
    options = parser.parse_args(argv)
    repeats = max(options.repeats, 1)
    planes = interleave({f"a = {each:g}": partial(plane, each) for each in options.amplitudes}, repeats)
    sheets = interleave({f"{each} spheres": partial(sheet, each) for each in options.spheres}, repeats)
    print(machine() + "\n")
    waves = zip(options.amplitudes, planes.values(), strict=True)
    print(table(PLANE_HEAD, [plane_line(each, [found for _, found in rounds]) for each, rounds in waves]) + "\n")
    cells = zip(options.spheres, sheets.values(), strict=True)
    print(table(SHEET_HEAD, [sheet_line(each, [found for _, found in rounds]) for each, rounds in cells]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
