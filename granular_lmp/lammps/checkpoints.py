"""Interval of checkpoints: in minutes, as a scene declares it, and in steps, as LAMMPS counts.

The number of steps in `minutes` follows from a rate, not from a clock:

    steps = 60 minutes · SPEED · ranks / spheres

LAMMPS renews its neighbour lists at every checkpoint, which changes the order of sums. With a clock in the deck, two
runs would differ in their last digits.

By default checkpoints take at most a hundredth of the run. With fewer ranks or a slower machine they are rarer in time,
but not more expensive.
"""

from math import ceil

from granular_lmp.lammps.guards import line_interval
from granular_lmp.problem import Problem
from granular_lmp.scene.schema import AUTO

# Spheres times steps per second on one core. Measured: 1e6 in a large sheet with guards at every step, 2.8e6 in the
# base case, 4.6e6 without guards
SPEED = 3e6
WRITING = 1.5e-6  # seconds per sphere of a checkpoint, with any number of ranks: 480 bytes (measured 1.2e-6)
SHARE = 0.01  # largest share of the run by default
LEAST = 0.5  # fewest minutes by default
MOST = 2**31 - 1  # steps: LAMMPS reads the interval as an integer of 32 bits


def minutes_between(declared: float | str, spheres: int) -> float:
    """Return the minutes between two checkpoints: as declared, or for "auto" the fewest that cost at most `SHARE`."""
    return max(LEAST, spheres * WRITING / SHARE / 60) if declared == AUTO else float(declared)


def checkpoint_steps(problem: Problem, ranks: int = 1) -> int:
    """Return the steps between two checkpoints of a problem."""
    declared, spheres = problem.scene.output.checkpoint, problem.scene.shape.spheres
    return steps_between(declared, spheres, line_interval(problem), ranks)


def steps_between(declared: float | str, spheres: int, lines: int, ranks: int = 1) -> int:
    """Return the steps between two checkpoints on some MPI ranks, from ``output.checkpoint`` as declared.

    They are at most `MOST`, and a multiple of `lines`, the steps between two lines of the thermo table, so that guards
    never check between a line and a checkpoint.
    """
    steps = 60 * minutes_between(declared, spheres) * SPEED * ranks / spheres
    return min(ceil(steps / lines), MOST // lines) * lines
