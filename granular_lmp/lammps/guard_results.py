"""Results of the guards of a run: from its thermo table, or from single contacts if the table does not decide."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import law_between
from granular_lmp.effects.between_looks import nearly_open
from granular_lmp.effects.case import Case
from granular_lmp.effects.contact_opening import GUARD as OPEN
from granular_lmp.effects.guard import NEVER, Guard
from granular_lmp.effects.reading import Reading
from granular_lmp.effects.sliding import GUARD as SLIP
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.outputs import CONTACTS, UNWAVED_CONTACTS, read_snapshots
from granular_lmp.problem import Problem


@dataclass(frozen=True)
class Measured:
    """Result of a guard.

    Attributes
    ----------
    value : float
        Extreme over all checks; for contacts judged one by one, over the checks where the bound is above the limit.
    passed_at : float or None
        Time τ at which the guard first triggered; None if it did not.
    bound : float
        Extreme of the thermo column, which is an upper bound of the value.
    near : float or None
        Smallest overlap, in Δ0, of a touching contact that may have opened between two checks; else None.
    """

    value: float
    passed_at: float | None
    bound: float
    near: float | None = None


def seen_every(table: Mapping[str, NDArray[np.float64]]) -> float:
    """Return the longest time between two checks in a run, τ; 0 if the kernel checked every step."""
    if any(column.endswith("_at") for column in table):
        return 0.0
    return float(np.max(np.diff(table.get("v_tau", np.empty(0))), initial=0.0))


def measured(guard: Guard, table: Mapping[str, NDArray[np.float64]], problem: Problem, folder: Path) -> Measured:
    """Return the result of a guard in a run.

    Parameters
    ----------
    guard : Guard
    table : dict
        Thermo table of the run by column.
    problem : Problem
    folder : Path
        Run folder; it may hold single contacts if the table only bounds the value.
    """
    scene = problem.scene
    every = seen_every(table)
    limit = guard.limit_in(problem, every)
    # A run whose log lacks a column fails for this reason, or has not come so far
    value = np.abs(table.get(guard.column, np.empty(0)))
    at = table.get(f"{guard.column}_at", np.full(len(value), NEVER))
    if len(at) != len(value):
        value = at = np.empty(0)
    bound = float(np.max(value, initial=0.0)) if np.isfinite(value).all() else float("nan")
    triggered = ~((value <= limit) & (at >= NEVER))  # a nan triggers the guard too
    first = None
    if triggered.any():
        first = float(np.min(at[triggered]))
        first = first if first < NEVER else float(table["v_tau"][np.argmax(triggered)])
    contacts = folder / (UNWAVED_CONTACTS if problem.wave is None else CONTACTS)
    if not (guard.per_contact(scene) and contacts.is_file()):
        smallest = float(np.min(table.get("v_overlap", np.empty(0)), initial=np.inf))
        near = guard is OPEN and bound == 1 and smallest < nearly_open(problem.rest, every)
        return Measured(bound, first, bound, smallest if near else None)
    looks = judged_contacts(contacts, problem, Case(scene, problem.on).friction)
    if guard is SLIP:
        ratios = [(step, look.slip) for step, look in looks] if first is not None else []
        worst = max((ratio for _, ratio in ratios), default=bound if first is None else 0.0)
        return Measured(
            worst, next((step * scene.time.step for step, ratio in ratios if not ratio <= limit), None), bound
        )
    least = nearly_open(problem.rest, every)
    nearly = next((step * scene.time.step for step, look in looks if look.overlap < least), None)
    known = [tau for tau in (first, nearly) if tau is not None]
    return Measured(max(bound, float(nearly is not None)), min(known, default=None), bound)


class Look(NamedTuple):
    """Contacts at one check: the largest ratio of shear to sliding force, and the smallest overlap, in Δ0."""

    slip: float
    overlap: float


def judged_contacts(path: Path, problem: Problem, friction: float) -> Iterator[tuple[int, Look]]:
    """Yield the step and the contacts of each check, every contact judged by its own radii and materials.

        slip F_t / (μ (F + (F + F0) (δ/Δ0)^{3/2})),    in the JKR law F_t / (μ (f_N(δ) + 2F))

    With dashpots, Hertz contacts in LAMMPS slide at μ times the normal force including its dashpot. The ratio is
    infinite if a contact without adhesion has just opened, or if its dashpot pulls.
    """
    sphere, units, crystal = problem.scene.sphere, problem.units, problem.rest.atoms
    radius = crystal.arrays["radius"] * sphere.radius
    how = Reading.of(problem)
    for step, _, contacts in read_snapshots(path):
        *others, distance, shear = (contacts[:, :-1] if how.whole else contacts).T
        # Contacts of equal spheres are all alike; only contacts of unequal spheres are written with their spheres
        i, j = (end.astype(int) - 1 for end in others) if others else np.zeros((2, len(shear)), dtype=int)
        law = law_between(crystal, problem.rest.materials, i, j)
        overlap = np.maximum(radius[i] + radius[j] - distance / units.number(1.0, length=1), law.pull_off_overlap)
        force = contacts[:, -1] if how.whole else units.number(law.sliding_force(overlap), mass=1, length=1, time=-2)
        sliding = friction * np.maximum(force, 0.0)
        ratio = np.divide(shear, sliding, out=np.full(len(shear), np.inf), where=sliding > 0)
        least = float(np.min(overlap, initial=np.inf)) / sphere.static_overlap
        yield step, Look(float(np.max(ratio, initial=0.0)), least)
