"""The network's steps on a device by JAX, over kinds of packings and the number of spheres.

    python -m benchmarks.device [--spheres N ...] [--largest N] [--demand gpu]

Each kind is built here, without LAMMPS, with a plane wave of a tenth of the overlap at rest. Times are those of the
clock, of a run that is compiled: nanoseconds a contact and step, and millions of sphere-steps a second. NumPy steps the
smaller ones beside it. The error is that of the step at 10 t0: the change of all displacements when the step is halved,
times 4/3, as the scheme is of second order, over the displacements; both as root mean squares. Two runs must give the
same bits, and a million spheres of the sheet take 10⁵ steps where a GPU is found. What came out is in RESULTS.md.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from math import pi, sqrt
from time import perf_counter
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import machine, table
from granular_analysis.theory import network_traced, network_verlet
from granular_analysis.theory.network import Material, Network, Wall
from granular_analysis.theory.network_state import State, start

Floats = NDArray[np.float64]
OVERLAP = 1e-3  # R, at rest
AMPLITUDE = 0.1  # overlaps
STEP = 0.1  # t0
SPACING = 2 - OVERLAP  # R
LARGEST = 1_000_000  # spheres of all kinds; --largest adds one run of the sheet
SPAN = 100  # steps that are compared with those of half the length, and with NumPy's
COMPARED = 200_000  # spheres at most that NumPy steps too
LONG = (1_000_000, 100_000)  # spheres and steps that should take less than half a minute on a card
HEAD = ["packing", "spheres", "contacts", "JAX, ns", "M sphere-steps/s", "NumPy, ns", "error of the step"]
Built = tuple[Network, State, float]  # and t0


def hexagonal(spheres: int) -> tuple[Floats, tuple[float, float]]:
    """Return places (N, 2) of about as many spheres of radius 1, and the periods of their cell, about a square."""
    columns = max(4, round(sqrt(spheres * sqrt(3) / 2)))
    rows = max(4, 2 * round(spheres / columns / 2))
    row, column = np.divmod(np.arange(rows * columns), columns)
    places = SPACING * np.stack([column + row % 2 / 2, row * sqrt(3) / 2], axis=1)
    return places, (SPACING * columns, SPACING * rows * sqrt(3) / 2)


def face_centred(spheres: int) -> tuple[Floats, tuple[float, float, float]]:
    """Return places (N, 3) of about as many spheres of radius 1 on an fcc lattice, and the periods of their cube."""
    side, edge = SPACING * sqrt(2), max(3, round((spheres / 4) ** (1 / 3)))
    corners = np.stack(np.meshgrid(*[np.arange(edge)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    basis = np.array([(0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5)])
    return side * (corners + basis).reshape(-1, 3), (side * edge,) * 3


def adhering() -> tuple[Material, float]:
    """Return a material whose contacts have `OVERLAP` at rest, and t0 = √(m/k) of its spheres of radius and mass 1."""
    hertz = 4 / 3 / (2 * (1 - 0.3**2)) * sqrt(0.5)  # A of E = 1, ν = 0.3
    work = hertz * OVERLAP**1.5 / pi  # F = 2π w Rc with Rc = ½
    return Material(1.0, 0.3, work), sqrt(1 / (1.5 * hertz * sqrt(OVERLAP)))


def built(places: Floats, cell: tuple[float, ...], shake: float = 0.0, **changes: Any) -> Built:
    """Return a packing with a wave along its last period, and random velocities of `shake` overlaps a t0."""
    material, time = adhering()
    count, dimension = places.shape
    density = changes.pop("density", np.ones(count)) * 3 / (4 * pi)
    network = Network(places, changes.pop("radius", np.ones(count)), density, (material,), cell=cell, **changes)
    last = max(axis for axis in range(dimension) if np.isfinite(cell[axis]))
    phase = 2 * pi * max(1, round(cell[last] / 16)) / cell[last] * places[:, last]
    displacement = np.zeros_like(places)
    displacement[:, 0] = AMPLITUDE * OVERLAP * np.sin(phase)
    velocity = shake * OVERLAP / time * np.random.default_rng(1).standard_normal(places.shape)
    return network, start(network, displacement, velocity), time


def sheet(spheres: int) -> Built:
    """Return a perfect sheet."""
    return built(*hexagonal(spheres))


def unequal(spheres: int) -> Built:
    """Return a sheet of spheres with 10 % of spread in density, and 2 % of the overlap in radius."""
    places, cell = hexagonal(spheres)
    density, radius = np.random.default_rng(2).standard_normal((2, len(places)))
    return built(places, cell, density=np.exp(0.1 * density), radius=1 + 0.02 * OVERLAP * radius)


def sliding(spheres: int) -> Built:
    """Return a sheet that is shaken so that contacts slide and open."""
    return built(*hexagonal(spheres), shake=0.5, friction=0.2)


def in_space(spheres: int) -> Built:
    """Return an fcc crystal, with six freedoms a sphere."""
    return built(*face_centred(spheres))


def layer(spheres: int) -> Built:
    """Return a sheet of spheres with six freedoms on a plane."""
    places, cell = hexagonal(spheres)
    plane = Wall((0.0, 0.0, OVERLAP - 1), (0.0, 0.0, -1.0), adhering()[0])
    return built(np.pad(places, ((0, 0), (0, 1))), (*cell, np.inf), walls=(plane,))


KINDS = {
    "perfect sheet": sheet,
    "unequal spheres": unequal,
    "sliding, opening": sliding,
    "fcc": in_space,
    "layer on a plane": layer,
}


def marched(
    march: Callable[..., Any], packing: Built, step: float, count: int, every: int = SPAN
) -> tuple[Floats, float]:
    """Return the displacements (d, N) after some steps, compiled for each `every` of them, and seconds of the clock."""
    network, state, time = packing
    began = perf_counter()
    *_, last = march(network, state, step * time, count, every)
    return last[: network.dimension], perf_counter() - began


def line(kind: str, spheres: int, repeats: int) -> list[str]:
    """Return one line of the table.

    Raises
    ------
    AssertionError
        If two runs differ in any bit, or a run from NumPy's.
    """
    print(f"{kind}, {spheres} spheres", file=sys.stderr, flush=True)
    packing = KINDS[kind](spheres)
    network, state, _ = packing
    count, contacts = len(network.position), len(state.pairs.first)
    coarse, _ = marched(network_traced.march, packing, STEP, SPAN)  # compiles
    again, seconds = marched(network_traced.march, packing, STEP, SPAN)
    assert again.tobytes() == coarse.tobytes(), f"{kind}, {count} spheres: two runs differ"
    fine, _ = marched(network_traced.march, packing, STEP / 2, 2 * SPAN)
    error = 4 / 3 * np.linalg.norm(coarse - fine) / np.linalg.norm(fine)
    numpy = "–"
    if count <= COMPARED:
        other, spent = marched(network_verlet.march, packing, STEP, SPAN)
        np.testing.assert_allclose(coarse, other, rtol=0, atol=1e-9 * OVERLAP)
        numpy = f"{1e9 * spent / SPAN / contacts:.3g}"
    longer = SPAN * round(np.clip(0.5 / seconds, 1, 100))
    marched(network_traced.march, packing, STEP, longer, longer)
    seconds = min(marched(network_traced.march, packing, STEP, longer, longer)[1] for _ in range(repeats)) / longer
    speeds = f"{1e9 * seconds / contacts:.3g}", f"{count / seconds / 1e6:.4g}"
    return [kind, str(count), str(contacts), *speeds, numpy, f"{error:.1e}"]


def long_run() -> str:
    """Return how long a million spheres take for 10⁵ steps, with a hundred records."""
    spheres, steps = LONG
    network, state, time = sheet(spheres)
    recorded = np.linspace(0, len(network.position) - 1, 100).astype(int)
    records, began = [], perf_counter()
    for motion in network_traced.march(network, state, STEP * time, steps, steps // 100):
        records.append(motion[:, recorded])
    return (
        f"{len(network.position)} spheres × {steps} steps with {len(records)} records: {perf_counter() - began:.3g} s"
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.device", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--spheres", type=int, nargs="+", default=[600, 10_000, 100_000, LARGEST], metavar="N")
    parser.add_argument("--largest", type=int, default=0, metavar="N", help="one run more of the perfect sheet")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="runs, the fastest of which counts")
    parser.add_argument("--demand", choices=["gpu"], help="do nothing, with a word, without such a device")
    options = parser.parse_args(argv)
    device = jax.devices()[0]
    if options.demand and device.platform != options.demand:
        print(f"skipped: JAX finds no {options.demand} here, only {device.device_kind}")
        return 0
    print(f"{machine()}\nJAX {jax.__version__} on {device.device_kind}\n")
    points = [(kind, spheres) for kind in KINDS for spheres in options.spheres]
    points += [("perfect sheet", options.largest)] if options.largest else []
    print(table(HEAD, [line(kind, spheres, options.repeats) for kind, spheres in points]))
    if device.platform == "gpu":
        print("\n" + long_run())
    return 0


if __name__ == "__main__":
    sys.exit(main())
