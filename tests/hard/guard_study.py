"""How often a guard is wrong: random scenes beside the state of every contact at every step.

Each scene runs as its deck says, with one line more that dumps displacements and angles of all spheres at every step.
From those, contacts are found and judged here in numpy, without LAMMPS's computes: overlap from the distance, shear
force from B ξ δ^{1/2} with the shear displacement ξ = t·(u_j − u_i) − R (θ_i + θ_j), dashpots from velocities.
The rules are made to believe that nothing opens and nothing slides, so that guards judge every scene.

    python -m tests.hard.guard_study --write docs/guards.csv
"""

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from math import inf, pi
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from granular_lmp import Scene, build, run
from granular_lmp.crystal.wavevector import ROW_SPACING
from granular_lmp.effects import selection as effects
from granular_lmp.effects.between_looks import nearly_open
from granular_lmp.effects.case import Case, Finding
from granular_lmp.errors import EffectError
from granular_lmp.lammps.binary_dump import binary_snapshots
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.guards import GUARDS
from granular_lmp.rest.shape import FASTEST_ROWS_PER_TAU, quiet_rows
from granular_lmp.runs.record import read_status
from granular_lmp.units import units_for
from tests.pages import write_table

Floats = NDArray[np.float64]
RUN = "run ${steps}"
SNAPSHOTS = "steps.bin"  # the name makes LAMMPS write it as binary
FAMILIES = ("running", "standing", "walled", "driven", "packet", "beam", "pulse", "imperfect", "damped")
STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7850.0}
NEAR = 0.01  # radii: the largest gap between spheres that may meet


# --- random scenes ---------------------------------------------------------------------------------------------------


def random_scene(family: str, seed: int) -> Scene:
    """Return a scene whose wave about opens contacts, with a friction at which they about slide."""
    rng = np.random.default_rng([FAMILIES.index(family), seed])
    wavenumber = float(rng.uniform(0.8, pi - 0.1))
    cell = {"packing.rows": 2 * int(rng.integers(4, 13)), "packing.ends": "periodic"}
    sheet = {"packing.columns": 36, "packing.ends": "periodic", "envelope.width": float(rng.uniform(3, 4))}
    strip = {"packing.rows": "auto", "packing.ends": "fixed"}
    crystal = {"packing.rows": 12, "packing.columns": 12, "packing.ends": "periodic", "time.duration": 12.0}
    length = {"envelope.length": max(3.0, 4.1 / wavenumber)}
    shape: dict[str, dict[str, Any]] = {
        "running": cell,
        "standing": cell | {"wave.form": "standing"},
        "walled": strip,
        "driven": strip | {"wave.form": "driven", "envelope.ramp": float(rng.uniform(2, 10))},
        "packet": strip | length,
        "beam": sheet | {"packing.rows": 16, "time.duration": 12.0},
        "pulse": sheet | length | {"packing.rows": 36, "time.duration": 12.0, "envelope.offset": 2.0},
        "imperfect": crystal,
        "damped": crystal,
    }
    if family in ("imperfect", "damped"):
        shape[family] |= {
            "disorder.radius": float(rng.uniform(0, 1e-4)),
            "disorder.density": float(rng.uniform(0, 0.2)),
            "disorder.vacancies": _whole_spheres(float(rng.uniform(0, 0.05)), 143),
            "disorder.seed": int(rng.integers(1, 1000)),
            "inclusion": [{"share": 0.1} | STEEL] if rng.uniform() < 0.3 else [],
        }
    if family == "damped":
        shape[family] |= _dashpots(rng)
    changes: dict[str, Any] = {
        "packing.columns": 3,
        "sphere.poisson_ratio": float(rng.uniform(0.0, 0.45)),
        "wave.mode": str(rng.choice(["L", "TR", "RT"])),
        "wave.wavenumber": wavenumber,
        "wave.phase": 0.0 if family == "driven" else float(rng.uniform(0, 2 * pi)),
        "wave.amplitude": 0.1,
        "time.duration": 20.0,
        "time.sample": 0.5,
        "time.timestep": 0.05,
        "effects.sliding": False,
        "effects.friction": 1.0,
    }
    scene = Scene.load("tr_periodic").with_values(changes | shape[family])
    # An RT wave at the zone's edge only turns the spheres and stretches no contact: its amplitude is 3
    swing = max(float(np.max(np.abs(Case(scene).stretches[0]) / Case(scene).overlaps)), 1e-9)
    # The rules take the row behind a driven one to stand still, which it does not: its contacts move about half as much
    # Disorder scatters the wave, and the weakest contact of a crystal is pulled by more than the wave
    more = {"driven": 2.0, "imperfect": 0.6, "damped": 0.6}.get(family, 1.0)
    scene = scene.with_values({"wave.amplitude": min(0.1 * more * float(rng.uniform(0.6, 1.3)) / swing, 3.0)})
    slip = Case(scene).largest_slip() / more
    friction = slip * float(rng.uniform(0.6, 1.4)) if 0 < slip < inf else 1.0
    return scene.with_values({"effects.friction": float(np.clip(friction, 0.01, 100.0))})


def _dashpots(rng: np.random.Generator) -> dict[str, Any]:
    """Return a viscosity of adhesive contacts, or a restitution of pressed ones, of spheres that may be of one size."""
    same = {"disorder.radius": 0.0, "inclusion": []} if rng.uniform() < 0.3 else {}
    if rng.uniform() < 0.5:
        return same | {"effects.viscosity": float(10 ** rng.uniform(-8, -6.5))}  # to 0.14 m/t0
    pressed = {"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7, "disorder.vacancies": 0.0}
    return same | pressed | {"inclusion": [], "effects.restitution": float(rng.uniform(0.5, 0.98))}


def _whole_spheres(share: float, free: int) -> float:
    """Return a share of the free spheres, or 0 for less than half a sphere, which no crystal takes."""
    return share if share * free > 0.5 else 0.0


@contextmanager
def blind_rules() -> Iterator[None]:
    """Let no rule foresee openings and sliding: what a guard is there for."""
    rows = [
        replace(row, called_for=lambda case: Finding(False, 0.0, "not foreseen"))
        if row.name in ("sliding", "contact_opening")
        else row
        for row in effects.EFFECTS
    ]
    with mock.patch.object(effects, "EFFECTS", tuple(rows)):
        yield


# --- the truth -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """State of the contacts at every step (T,): of those that surely reach the record, and of those that perhaps do."""

    tau: Floats
    overlap: Floats  # the smallest, in Δ0, negative when open, and when two spheres meet that do not touch at rest
    overlap_wide: Floats
    slip: Floats  # the largest ratio of the shear to the sliding force of one contact
    slip_wide: Floats


def truth(deck: Deck, folder: Path) -> Truth:
    """Return what the contacts did, from the positions and angles of all spheres at every step."""
    scene, sphere = deck.scene, deck.scene.sphere
    radius = sphere.radius
    unit = units_for(radius).number(radius, length=1)
    steps, values = _snapshots(folder / SNAPSHOTS)
    shift, angle = values[:, :, :2] / unit, values[:, :, 5]  # in radii, rad
    rest, size = deck.packing.positions[:, :2], deck.packing.arrays["radius"]
    first, second, vector = _near(deck)
    gap = vector + shift[:, second] - shift[:, first]
    distance = np.linalg.norm(gap, axis=-1)
    at_rest = sphere.static_overlap / radius
    radii = size[first] + size[second]
    overlap = (radii - distance) / at_rest
    closed = radii > np.linalg.norm(vector, axis=1)  # at rest
    tangent = np.stack([-gap[..., 1], gap[..., 0]], axis=-1) / distance[..., None]
    # From the tangent of the contact halfway between rest and now: exact to second order in the turn
    tangent += np.column_stack([-vector[:, 1], vector[:, 0]]) / np.linalg.norm(vector, axis=1)[:, None]
    tangent /= np.linalg.norm(tangent, axis=-1)[..., None]
    along = np.sum((gap - vector) * tangent, axis=-1) - (
        size[first] * angle[:, first] + size[second] * angle[:, second]
    )
    touching = np.maximum(overlap, 0.0) * closed
    repulsion, shear_stiffness, adhesion = _laws(deck, first, second)
    shear = shear_stiffness * along * radius * np.sqrt(touching * sphere.static_overlap)
    limit = adhesion + repulsion * (touching * sphere.static_overlap) ** 1.5
    # Dashpots: of the rates at which two spheres part and slip
    rate = values[:, second, 2:4] - values[:, first, 2:4]
    turning = size[first] * values[:, first, 4] + size[second] * values[:, second, 4]
    speed = units_for(radius).number(1.0, length=1, time=-1)
    dashpot = _viscosities(deck, first, second, repulsion, touching * sphere.static_overlap)
    shear = shear + dashpot * (np.sum(rate * tangent, axis=-1) - unit * turning) / speed
    if scene.effects.damping is True and not adhesion.any():  # as LAMMPS has it
        limit = limit - dashpot * np.sum(rate * gap, axis=-1) / distance / speed
    friction = Case(scene, {effect.name: effect.on for effect in deck.problem.effects}).friction
    slip = np.divide(np.abs(shear), friction * limit, out=np.where(shear == 0, 0.0, inf), where=limit > 0)
    # A contact that has been open has lost its shear: from there on only LAMMPS knows it
    slip[np.logical_or.accumulate(overlap <= 0, axis=0)] = 0.0
    overlap = np.where(closed, overlap, -overlap)  # the gap of two spheres that may meet
    tau = steps * scene.time.step
    away = np.maximum(*(np.linalg.norm(rest[end], axis=1) for end in (first, second))) / (
        sphere.lattice_constant / radius * ROW_SPACING
    )
    left = scene.time.duration - tau
    sure, perhaps = FASTEST_ROWS_PER_TAU * left, 3 + (quiet_rows(scene.time.duration) // 2) * left / left[0]
    if scene.shape.ends == "periodic" and not scene.envelope.finite:
        sure = perhaps = np.full(len(tau), inf)
    narrow, wide = (away[None, :] <= reach[:, None] for reach in (sure, perhaps))
    return Truth(
        tau,
        *(np.where(cone, overlap, inf).min(axis=1) for cone in (narrow, wide)),
        *(np.where(cone, slip, 0.0).max(axis=1) for cone in (narrow, wide)),
    )


def _laws(deck: Deck, i: NDArray[np.int64], j: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
    """Return A, B and F of contacts, (C,) each, from the moduli of both spheres by Hertz's and Mindlin's rules."""
    packing, materials = deck.packing, deck.problem.rest.crystal.materials
    kind = packing.arrays.get("material", np.zeros(len(packing), dtype=int))
    names = ("youngs_modulus", "poisson_ratio", "work_of_adhesion")
    young, nu, work = (np.array([getattr(one, name) for one in materials])[kind] for name in names)
    stretch, twist = (1 - nu**2) / young, 2 * (2 - nu) * (1 + nu) / young
    radius = packing.arrays["radius"] * materials[0].radius
    mean = radius[i] * radius[j] / (radius[i] + radius[j])
    root = np.sqrt(mean)
    adhesion = 2 * pi * np.sqrt(work[i] * work[j]) * mean
    return 4 / 3 * root / (stretch[i] + stretch[j]), 8 * root / (twist[i] + twist[j]), adhesion


def _viscosities(deck: Deck, i: NDArray[np.int64], j: NDArray[np.int64], repulsion: Floats, overlap: Floats) -> Floats:
    """Return η of contacts that overlap by (T, C), m, in N s/m: declared, or √5 ζ √(mA) δ^{1/4}."""
    effects, packing, sphere = deck.scene.effects, deck.packing, deck.scene.sphere
    if effects.restitution == 1:
        return np.where(overlap > 0, effects.viscosity, 0.0)
    density = packing.arrays.get("density", np.full(len(packing), sphere.density))
    mass = 4 / 3 * pi * (packing.arrays["radius"] * sphere.radius) ** 3 * density
    loss = -np.log(effects.restitution)
    stiffness = np.sqrt(5 * repulsion * mass[i] * mass[j] / (mass[i] + mass[j]))
    return np.asarray(loss / np.hypot(pi, loss) * stiffness * overlap**0.25)


def _near(deck: Deck) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return the spheres that touch at rest or may meet (C,), (C,), and the vectors between them (C, 2), in radii."""
    position, size = deck.packing.positions[:, :2], deck.packing.cell.lengths()[:2]
    radius = deck.packing.arrays["radius"]
    pairs = []
    for sphere in range(len(position)):
        vector = position[sphere + 1 :] - position[sphere]
        vector -= size * np.round(vector / size) * deck.packing.pbc[:2]
        near = np.flatnonzero(np.linalg.norm(vector, axis=1) < radius[sphere] + radius[sphere + 1 :] + NEAR)
        pairs += [(sphere, sphere + 1 + other, *vector[other]) for other in near]
    table = np.array(pairs)
    return table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:]


def _snapshots(path: Path) -> tuple[Floats, Floats]:
    """Return steps (T,) and ux, uy, vx, vy, spin, angle (T, N, 6) of all spheres; those that left stay as they were."""
    snapshots = list(binary_snapshots(path))
    steps, values = [each.step for each in snapshots], np.empty((len(snapshots), *snapshots[0].table[:, 1:].shape))
    values[0] = snapshots[0].table[:, 1:]
    for number, each in enumerate(snapshots[1:], 1):
        values[number] = values[number - 1]
        values[number, each.table[:, 0].astype(int) - 1] = each.table[:, 1:]
    if values.shape[2] == 5:
        return np.array(steps, dtype=float), np.pad(values, ((0, 0), (0, 0), (0, 1)))
    angle = np.unwrap(np.arctan2(values[..., 6], values[..., 5]), axis=0)
    return np.array(steps, dtype=float), np.concatenate([values[..., :5], angle[..., None]], axis=-1)


# --- guard against truth ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Comparison:
    """Result of one guard for a scene, beside the truth."""

    guard: str
    happened: bool  # to a contact that surely reaches the record
    happened_wide: bool  # to one that perhaps does
    said: bool
    late: float  # tau, of the first time
    over: float  # what was reported over the truth, less 1, of slip; the smallest overlap less the true one
    exactly: bool = True  # happened to a contact that perhaps reaches the record, without a margin

    @property
    def missed(self) -> bool:
        """True if the effect occurred and the guard did not trigger."""
        return self.happened and not self.said

    @property
    def near(self) -> bool:
        """True if the guard stopped a run that only came within the margin."""
        return self.said and self.happened_wide and not self.exactly

    @property
    def stopped(self) -> bool:
        """True if the guard stopped a valid run."""
        return self.said and not self.happened_wide


def compared(scene: Scene, folder: Path) -> tuple[Comparison, Comparison]:
    """Run a scene and return its comparisons: openings, slip."""
    with blind_rules():
        deck = build(scene)
        turned = scene.wave.mode != "L" or "largest_torque" not in deck.input_text
        tracked = deck.scene.effects.tracking is True and turned
        dump = "compute everyone all property/atom mux muy\n" if tracked else ""
        dump += f"dump everyone all custom 1 {SNAPSHOTS} id c_u[1] c_u[2] vx vy omegaz"
        dump += " c_everyone[1] c_everyone[2]" if tracked else ""
        dump += "\ndump_modify everyone sort id\n"
        watched = replace(deck, input_text=deck.input_text.replace(RUN, dump + RUN))
        with suppress(EffectError):  # what the guards said stands in run.json
            run(watched, folder)
    info, real = read_status(folder), truth(deck, folder)
    return _openings(info, real, deck), _slip(info, real, deck)


def _openings(info: dict[str, Any], real: Truth, deck: Deck) -> Comparison:
    guard = info["guards"]["open_contacts"]
    first = _first(real.tau, real.overlap <= 0)
    said = guard["passed_at"]
    return Comparison(
        "open_contacts",
        happened=first is not None,
        # A contact that touches by less than what may hide between two looks counts as open
        happened_wide=bool((real.overlap_wide <= nearly_open(deck.problem.rest)).any()),
        said=said is not None,
        late=said - first if said is not None and first is not None else 0.0,
        over=info["smallest_overlap"] - float(real.overlap.min()) if first is None and "crystal" not in info else 0.0,
        exactly=bool((real.overlap_wide <= 0).any()),
    )


def _slip(info: dict[str, Any], real: Truth, deck: Deck) -> Comparison:
    guard = info["guards"]["largest_slip"]
    # Until a contact opens: from there on its shear is LAMMPS's own
    whole = np.logical_and.accumulate(real.overlap_wide > 0)
    first = _first(real.tau, (real.slip >= 1) & whole)
    said = guard["passed_at"]
    worst = float(np.max(real.slip, where=whole, initial=0.0))
    limit = GUARDS["largest_slip"].limit_in(deck.problem) * (1 - ROUGH)
    return Comparison(
        "largest_slip",
        happened=first is not None,
        happened_wide=bool((real.slip_wide >= limit).any()) or not whole.all(),
        said=said is not None,
        late=said - first if said is not None and first is not None else 0.0,
        over=guard["bound"] / worst - 1 if 0 < worst < inf and whole.all() else 0.0,
        exactly=bool((real.slip_wide >= 1 - ROUGH).any()) or not whole.all(),
    )


# LAMMPS turns the shear history with its contact, this study takes the tangent halfway: Δ0/R = 5e-4 of the shear
ROUGH = 2e-3


def _first(tau: Floats, happened: NDArray[np.bool_]) -> float | None:
    return float(tau[np.argmax(happened)]) if happened.any() else None


def study(count: int) -> dict[str, list[tuple[Comparison, Comparison]]]:
    """Return the comparisons of `count` scenes, by family."""
    found: dict[str, list[tuple[Comparison, Comparison]]] = {family: [] for family in FAMILIES}
    for number in range(count):
        family = FAMILIES[number % len(FAMILIES)]
        with tempfile.TemporaryDirectory() as folder:
            found[family].append(compared(random_scene(family, number), Path(folder) / "run"))
    return found


HEAD = ["wave", "scenes", "open", "missed", "stopped", "in the margin", "late, τ", "overlap too large by, Δ₀", "slid"]
HEAD += ["slip missed", "slip stopped", "slip in the margin", "slip late, τ", "bound over truth"]


def table(found: dict[str, list[tuple[Comparison, Comparison]]]) -> list[list[str]]:
    """The comparisons as a table, a row a family."""
    rows = [HEAD]
    every = [pair for pairs in found.values() for pair in pairs]
    for family, pairs in [*found.items(), ("all", every)]:
        openings, slips = zip(*pairs, strict=True)
        words = [family, str(len(pairs)), *_counts(openings), f"{max(one.over for one in openings):.4f}"]
        words += _counts(slips)
        excess = [1 + slip.over for _, slip in pairs if slip.over]
        words.append(f"{np.median(excess):.2f}, {max(excess):.2f} at most" if excess else "")
        rows.append(words)
    return rows


def _counts(comparisons: Sequence[Comparison]) -> list[str]:
    counts = [sum(getattr(one, key) for one in comparisons) for key in ("happened", "missed", "stopped", "near")]
    return [*map(str, counts), f"{max(one.late for one in comparisons):.2f}"]


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=261)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    write_table(arguments.write, table(study(arguments.count)))


if __name__ == "__main__":
    main()
