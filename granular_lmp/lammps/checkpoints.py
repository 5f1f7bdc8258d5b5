"""How often a run writes a checkpoint: in minutes, as a scene declares it, and in steps, as LAMMPS counts them.

The steps of `minutes` on some MPI ranks follow from a rate, not from a clock:

    steps = 60 minutes · SPEED · ranks / spheres

LAMMPS renews its neighbour lists at every checkpoint, which changes the order of sums. With a clock in the deck no two
runs of it would have the same last digits.

By default the checkpoints take at most a hundredth of the run. A rank less or a slower machine makes them rarer in
time, never dearer.
"""

from math import ceil

from granular_lmp.lammps.guards import line_interval
from granular_lmp.problem import Problem
from granular_lmp.scene.schema import AUTO

# Spheres times steps a second on one core. Measured: 1e6 in a large sheet whose guards look at every step, 2.8e6 in the
# base case, 4.6e6 without guards
SPEED = 3e6
WRITING = 1.5e-6  # seconds a sphere of a checkpoint takes, whatever the ranks: 480 bytes (measured 1.2e-6)
SHARE = 0.01  # share of the run that they take at most, by default
LEAST = 0.5  # minutes, by default
MOST = 2**31 - 1  # steps: LAMMPS reads the interval as an integer of 32 bits


def minutes_between(declared: float | str, spheres: int) -> float:
    """Return the minutes between two checkpoints: as declared, or with "auto" the fewest that cost at most `SHARE`."""
    return max(LEAST, spheres * WRITING / SHARE / 60) if declared == AUTO else float(declared)


def checkpoint_steps(problem: Problem, ranks: int = 1) -> int:
    """Return the steps between two checkpoints of a problem."""
    declared, spheres = problem.scene.output.checkpoint, problem.scene.shape.spheres
    return steps_between(declared, spheres, line_interval(problem), ranks)


def steps_between(declared: float | str, spheres: int, lines: int, ranks: int = 1) -> int:
    """Return the steps between two checkpoints on some MPI ranks, from ``output.checkpoint`` as declared.

    They are a multiple of `lines`, the steps between two lines of the thermo table, so that no look of a guard falls
    between a line and a checkpoint, and at most `MOST`.
    """
    steps = 60 * minutes_between(declared, spheres) * SPEED * ranks / spheres
    return min(ceil(steps / lines), MOST // lines) * lines
