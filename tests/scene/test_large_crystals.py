"""Large crystals: what is set up by blocks is what it was in one piece, and needs little memory."""

import tracemalloc
from typing import Any

import numpy as np
import pytest

from granular_lmp import Scene, build
from granular_lmp.crystal import blocks
from granular_lmp.crystal.modes import contact_stretches
from granular_lmp.crystal.search import overlapping
from granular_lmp.crystal.stability import crude_bound, frequency_bound
from granular_lmp.effects.case import Case
from granular_lmp.problem import prepare
from granular_lmp.rest import at_rest, initial_fields
from granular_lmp.rest.held import largest_step
from granular_lmp.rest.linear import physics_of
from tests.conftest import PAPER
from tests.crystal.test_wave import PULSE, fields_of

SHEET = PAPER.with_values(
    {"packing.rows": 21, "packing.columns": 10, "disorder.density": 0.1, "disorder.radius": 1e-4, "time.duration": 2.0}
)
SPACE = SHEET.with_values({"packing.lattice": "fcc", "packing.columns": 4, "wave.mode": "L", "disorder.radius": 0.0})
DAMPED = SHEET.with_values({"effects.damping": True, "effects.viscosity": 1e-9})


def results(scene: Scene) -> list[np.ndarray]:
    at_rest._KEPT.clear()  # what was computed before is known by the contacts
    problem = prepare(scene)
    contacts, case = problem.rest.contacts, Case(problem.scene, problem.on)
    return [
        *overlapping(problem.rest.atoms),
        *contact_stretches(contacts, scene.sphere, problem.wave.mode),
        np.array([case.largest_slip(), frequency_bound(contacts, scene.sphere, physics_of(scene))]),
    ]


@pytest.mark.parametrize("scene", [SHEET, pytest.param(SPACE, marks=pytest.mark.more)], ids=["sheet", "fcc"])
def test_the_size_of_blocks_changes_nothing(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = results(scene)
    monkeypatch.setattr(blocks, "BLOCK", 50)
    for one, other in zip(whole, results(scene), strict=True):
        assert one == pytest.approx(other, rel=1e-12, abs=1e-12)  # sums over contacts in another order


@pytest.mark.parametrize("scene", [SHEET, SPACE, DAMPED], ids=["sheet", "fcc", "damped"])
def test_the_quick_limit_of_the_step_is_a_lower_bound(scene: Scene) -> None:
    problem = prepare(scene)
    physics = physics_of(problem.scene)
    high = [each(problem.rest.contacts, scene.sphere, physics) for each in (frequency_bound, crude_bound)]
    assert high[0] < high[1] < 2 * high[0]
    quick, limit = largest_step(problem.scene, 0.0), largest_step(problem.scene)
    assert quick < limit == largest_step(problem.scene, (quick + limit) / 2)
    assert largest_step(problem.scene, quick) == limit  # a step must be below the limit, not at it
    assert min(rule.longest for rule in problem.rest.step_rules(0.0)) <= quick


def test_a_large_crystal_takes_a_kilobyte_a_sphere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "BLOCK", 2000)  # whose arrays are small beside those of this crystal
    scene = SHEET.with_values({"packing.rows": 201, "packing.columns": 80, "disorder.radius": 0.0})
    tracemalloc.start()
    build(scene)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.25e3 * 201 * 80  # it was 14 kB a sphere


def test_many_wave_vectors_are_summed_as_quickly_as_few() -> None:
    # A narrow pulse in a million spheres is 10⁵ Bloch modes, which took a minute one by one. Counted here, not timed
    calls = []
    solve = initial_fields.bloch_modes

    def counted(*arguments: Any) -> Any:
        calls.append(len(arguments[2]))
        return solve(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(initial_fields, "bloch_modes", counted)
        fields_of(PULSE.with_values({"packing.rows": 200, "packing.columns": 200, "envelope.length": 4.0}))
    assert len(calls) == 1
    assert calls[0] > 3000
