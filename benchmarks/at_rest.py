"""How long a disordered crystal takes to come to rest: processor time of one core by spheres and spread.

    python -m benchmarks.at_rest [--spheres N ...] [--spread S ...] [--by WAY ...]

The spread is s = σ 2R/Δ0, the standard deviation of the radii over the overlap at rest. The ways
are those of `packing.relax_by`. Targets, by avalanches, are 10 s for 1e4 spheres at s = 4 and 60 s for 1e5 at s = 2.
"""

import argparse
import time

from benchmarks.problem import base_scene
from granular_lmp.crystal.disorder import WAYS, Disorder, imperfect
from granular_lmp.crystal.equilibrium import relax
from granular_lmp.crystal.lattices import Shape, packed

HEAD = ("spheres", "s", "by", "let go, s", "steps", "all, s", "contacts a sphere", "largest force")


def row(spheres: int, spread: float, by: str) -> list[str]:
    """Return a line of the table: a square of periodic sheet, seed 1."""
    sphere = base_scene().sphere
    rows = 2 * round(spheres**0.5 / 2)
    lattice = packed(sphere, Shape(rows, round(spheres / rows), "periodic"))
    crystal, materials = imperfect(lattice, sphere, Disorder(radius=spread * sphere.overlap_ratio))
    begun, let_go = time.process_time(), 0.0

    def progress(stage: str, step: int, force: float, energy: float) -> None:
        nonlocal let_go
        if stage == "let go":
            let_go = time.process_time() - begun

    rest = relax(crystal, materials, by=by, progress=progress)
    used = time.process_time() - begun
    numbers = (
        f"{let_go:.1f}",
        f"{rest.steps}",
        f"{used:.1f}",
        f"{rest.contacts_per_sphere:.4f}",
        f"{rest.residual:.1e}",
    )
    return [f"{len(crystal)}", f"{spread:g}", by, *numbers]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spheres", type=int, nargs="+", default=[1000, 10000, 100000])
    parser.add_argument("--spread", type=float, nargs="+", default=[0.8, 2.0])
    parser.add_argument("--by", choices=WAYS, nargs="+", default=WAYS)
    given = parser.parse_args()
    print("| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|")
    for spheres in given.spheres:
        for spread in given.spread:
            for by in given.by:
                print("| " + " | ".join(row(spheres, spread, by)) + " |", flush=True)


if __name__ == "__main__":
    main()
