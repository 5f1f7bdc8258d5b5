"""Runs of one wave with two time steps, for Richardson's extrapolation."""

from collections.abc import Iterable
from math import isclose

from granular_analysis.measure.runs import all_but
from granular_lmp.runs.record import Record


def by_wave(records: Iterable[Record]) -> list[list[Record]]:
    """Return the runs of each wave: one run, or two runs with steps h/2 and h to extrapolate, the finer one first.

    Runs belong to one wave if their scenes differ only in name, description and time step.

    Raises
    ------
    ValueError
        For a wave with more than two runs, with steps other than h/2 and h, or with records of different length.
    """
    waves: dict[str, list[Record]] = {}
    for record in records:
        waves.setdefault(repr(all_but(record, "time.timestep", "time.tolerance")), []).append(record)
    groups = [sorted(runs, key=lambda record: record.scene.time.step) for runs in waves.values()]
    for fine, *rest in groups:
        scene = fine.scene
        pair = len(rest) == 1 and isclose(rest[0].scene.time.step, 2 * scene.time.step)
        if rest and not (pair and len(rest[0].tau) == len(fine.tau)):
            wave = f"{scene.require_wave().mode}, xi = {scene.wavenumber:.5g} at {scene.direction:.5g} degrees"
            raise ValueError(f"{wave}: {1 + len(rest)} runs are not a pair with steps h and h/2")
    return groups
