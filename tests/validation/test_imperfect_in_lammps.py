"""Runs of imperfect crystals against the network of their first snapshot: what scene, deck and record make of them.

LAMMPS's error of second order in the time step is extrapolated away. What is left at the steps 0.05 and 0.025 is of
fourth order, and the rounding of positions, 1e-12 of 1e4 nm, which is 1e-10 of D0 at these amplitudes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.norms import relative_error
from granular_analysis.measure.reference import SLIDING_STEP
from granular_analysis.measure.snapshot import FirstSnapshot, first_snapshot
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import contacts, search, start
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
from tests.conftest import members

SHEET = Scene.load("tr_periodic").with_values(
    {
        "packing.columns": 12,
        "wave.amplitude": 0.05,
        "time.duration": 15.0,
        "time.sample": 1.0,
        "output.particles": 1.0,
    }
)
OVERLAP_RATIO = SHEET.sphere.overlap_ratio
STEPS = (0.05, 0.025)
# Of D0. The time step leaves at most 1e-7, and the network's own error is less
FIELDS = 1e-6
# Relative, of the recorded signals. The time step leaves 4e-6 of p at the interface, which is only 1e-3 D0 there, and
# less than 1e-6 elsewhere
SIGNALS = 1e-5
STEEL = {"density": 7850.0, "youngs_modulus": 210e9, "poisson_ratio": 0.3, "work_of_adhesion": 0.1}
Changes = dict[str, Any]
Fields = np.ndarray


def fields_of(record: Record) -> Fields:
    """Return displacement x, y and Rθ of all spheres at every record, (T, N, 3), in D0."""
    displacement, rotation = record.snapshots().stacks("displacement", "rotation")
    return np.concatenate([displacement, rotation[:, :, None]], axis=2)


@dataclass(frozen=True, eq=False)
class Pair:
    """A run extrapolated to no time step: its record and its fields."""

    record: Record
    fields: Fields


def extrapolated(scene: Scene, folder: Any, steps: tuple[float, float] = STEPS) -> Pair:
    """Return two runs of a scene extrapolated; the record keeps the folder of the finer one."""
    coarse, fine = (run(scene.with_values({"time.timestep": step}), folder / str(step)) for step in steps)
    signals = {name: (4 * getattr(fine, name) - getattr(coarse, name)) / 3 for name in ("p", "q", "phi")}
    return Pair(fine.with_signals(**signals), (4 * fields_of(fine) - fields_of(coarse)) / 3)


def network_fields(first: FirstSnapshot, tau: np.ndarray, longest: float = np.inf) -> Fields:
    """Return the fields of a network at times, as `fields_of` does."""
    run = integrate(first.network, first.state, tau * first.time, longest_step=longest * first.time)
    unit = np.array([1.0, 1.0, first.radius]) / first.length
    return np.moveaxis(run.motion[:, :3], 1, 2) * unit


def distance(pair: Pair, fields: Fields, recorded: int) -> tuple[float, float]:
    """Return the largest difference of a field, in D0, and of p and q of the recorded sphere, relative."""
    x, y = fields[:, recorded, 0], fields[:, recorded, 1]
    signals = max(relative_error(pair.record.p, y), relative_error(pair.record.q, -x))
    return float(np.abs(pair.fields - fields).max()), signals


def agree(pair: Pair, first: FirstSnapshot) -> bool:
    fields, signals = distance(pair, network_fields(first, pair.record.tau), first.recorded)
    return fields < FIELDS and signals < SIGNALS


def changed(first: FirstSnapshot, **changes: Any) -> FirstSnapshot:
    """Return a first snapshot whose network is another one, in the same motion."""
    network: Network = replace(first.network, **changes)
    motion = first.state.motion
    return replace(first, network=network, state=start(network, motion[:2].T, motion[3:5].T, motion[2], motion[5]))


# --- wrong networks, which must not agree ---

Wrong = Callable[[Pair, FirstSnapshot, Any], FirstSnapshot]


def of_another_seed(pair: Pair, first: FirstSnapshot, folder: Any) -> FirstSnapshot:
    other = pair.record.scene.with_values({"disorder.seed": 2, "time.duration": 1.0})
    return first_snapshot(run(other, folder / "other"))


def with_a_lighter_impurity(pair: Pair, first: FirstSnapshot, folder: Any) -> FirstSnapshot:
    density = first.network.density
    return changed(first, density=np.where(density == density.max(), 0.99 * density, density))


def with_materials_swapped(pair: Pair, first: FirstSnapshot, folder: Any) -> FirstSnapshot:
    return changed(first, materials=first.network.materials[::-1])


def with_the_mixing_of_lammps(pair: Pair, first: FirstSnapshot, folder: Any) -> FirstSnapshot:
    return changed(first, shear_mixing="lammps")


CASES: dict[str, tuple[Changes, list[Wrong]]] = {
    "vacancies": ({"disorder.vacancies": 0.02}, [of_another_seed]),
    "impurity": ({"inclusion": [{"spheres": [[8, 7]], "density": 22000.0}]}, [with_a_lighter_impurity]),
    "interface": (
        {"inclusion": [{"rows": [8, 11]} | STEEL]},
        [with_materials_swapped, with_the_mixing_of_lammps],
    ),
    "s = 0.1": ({"disorder.radius": 0.1 * OVERLAP_RATIO}, [of_another_seed]),
    "s = 0.3": ({"disorder.radius": 0.3 * OVERLAP_RATIO}, [of_another_seed]),
}


@pytest.mark.parametrize("case", members(CASES, "vacancies", "impurity", "s = 0.1"))
def test_an_imperfect_crystal_moves_as_its_network_and_as_no_other(case: str, tmp_path: Any) -> None:
    changes, wrongs = CASES[case]
    pair = extrapolated(SHEET.with_values(changes), tmp_path)
    first = first_snapshot(pair.record)
    assert agree(pair, first)
    result = compare.compare(pair.record)
    assert result.theory == "network"
    assert all(error is not None and error < SIGNALS for error in result.error.values())
    for wrong in wrongs:
        assert not agree(pair, wrong(pair, first, tmp_path))


# --- contacts that open, form and slide ---

STRONG = {
    "disorder.radius": 3 * OVERLAP_RATIO,
    "disorder.seed": 2,
    "wave.amplitude": 1.0,
    "time.duration": 8.0,
    "effects.contact_opening": True,
    "effects.friction": 5.0,  # none slides
}


def touching(network: Network, displacement: np.ndarray) -> np.ndarray:
    """Return which pairs of spheres that were near at rest touch when displaced by (N, 2), in units of the network."""
    pairs = search(network, np.zeros((2, len(displacement))))
    motion = np.zeros((6, len(displacement)))
    motion[:2] = displacement.T
    return contacts(network, motion, pairs, np.zeros((1, len(pairs.first)))).overlap > 0


@pytest.mark.rounding
def test_the_same_contacts_open_and_form_in_lammps_and_in_the_network(tmp_path: Any) -> None:
    step = 0.00625
    record = run(SHEET.with_values(STRONG | {"time.timestep": step}), tmp_path / "run")
    first = first_snapshot(record)
    ours, theirs = network_fields(first, record.tau), fields_of(record)
    rest, found, expected = (
        np.array([touching(first.network, fields[:, :2] * first.length) for fields in each])
        for each in (0 * theirs[:1], theirs, ours)
    )
    opened, formed = ((rest > found).sum(axis=1), (rest < found).sum(axis=1))
    assert opened[-1] > opened[0]
    assert formed[-1] > formed[0] == 0
    assert np.array_equal(found, expected)  # none opens or forms within a step of a record
    # The adhesive force F appears or goes a step late at most, which gives a sphere F Δt/m more speed: in Δ0 and t0
    # (2/3) Δτ/(2(κ+3)). Within t0 the neighbours share it, so that it moves no sphere farther than in one t0.
    events = np.abs(np.diff(found.astype(int), axis=0)).sum()
    kick = step * (2 / 3) / (2 * (SHEET.sphere.stiffness_ratio + 3)) / record.scene.wave.amplitude
    off = np.abs(theirs - ours).max()
    assert off < events * kick
    # The wave of a tenth of the amplitude, in which fewer contacts open and none forms, is another one
    assert not np.array_equal(found[1:], expected[:-1])
    motion = first.state.motion / 10
    weak = replace(first, state=start(first.network, motion[:2].T, motion[3:5].T, motion[2], motion[5]))
    assert np.abs(10 * network_fields(weak, record.tau) - theirs).max() > 10 * events * kick


def test_contacts_slide_in_a_run_as_in_its_network(tmp_path: Any) -> None:
    sliding = {"disorder.vacancies": 0.02, "wave.amplitude": 0.2, "effects.sliding": True, "effects.friction": 0.03}
    scene = SHEET.with_values(sliding | {"packing.columns": 6, "time.duration": 1.5})
    pair = extrapolated(scene, tmp_path, (0.0125, 0.00625))
    first = first_snapshot(pair.record)
    assert first.network.friction == 0.03

    def off(network: FirstSnapshot, longest: float = SLIDING_STEP) -> float:
        return distance(pair, network_fields(network, pair.record.tau, longest), first.recorded)[0]

    # Where a contact begins to slide both are of second order in the step, and leave some 3e-6
    assert off(first) < 1e-5
    assert off(changed(first, friction=0.0303), 2 * SLIDING_STEP) > 1e-4
