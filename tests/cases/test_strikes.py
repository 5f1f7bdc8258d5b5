"""Figures of impacts refuse by name what their measurement or the theory beside it does not hold."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cases.dimers import case as dimers
from cases.fronts import case as fronts
from cases.refraction import case as refraction
from cases.solitary import case as solitary
from cases.strikes import require
from granular_lmp import ImpactRecord, ImpactScene
from granular_lmp.problem import prepare

STATE = [[3, 0, 0.0, 0.0, 0.0, 0.5, 0.0]]
CASES: list[tuple[Callable[..., Any], str, dict[str, Any], str]] = [
    (dimers.measured, "dimer_chain", {"start.state": STATE}, "start.state"),
    (dimers.measured, "dimer_chain", {"packing.contact_force": 1.0}, "packing.contact_force"),
    (dimers.measured, "dimer_chain", {"effects.restitution": 0.9}, "effects.restitution"),
    (refraction.measured, "refraction", {"effects.friction": 0.1}, "effects.friction"),
    (refraction.measured, "refraction", {"disorder.radius": 1e-3}, "disorder"),
    (refraction.measured, "refraction", {"start.state": STATE}, "start.state"),
    (fronts.fronts, "point_impact", {"start.state": STATE}, "start.state"),
    (
        solitary.front,
        "solitary_chain",
        {"packing.contact_force": 1.0, "output.spheres": [[9, 0], [10, 0], [19, 0], [20, 0]], "start.state": STATE},
        "start.state",
    ),
]


def empty(name: str, changes: dict[str, Any]) -> ImpactRecord:
    """A record of a shipped impact with some values changed, in which nothing has moved yet."""
    problem = prepare(ImpactScene.load(name).with_values(changes))
    still = np.zeros((1, len(problem.rest.recorded), 2))
    return ImpactRecord(np.zeros(1), {"displacement": still, "velocity": still}, problem.scene)


@pytest.mark.parametrize(("measured", "name", "changes", "named"), CASES)
def test_a_figure_refuses_what_it_does_not_hold(
    measured: Callable[..., Any], name: str, changes: dict[str, Any], named: str
) -> None:
    with pytest.raises(ValueError, match=rf"{name}: {named}: must be left out"):
        measured(empty(name, changes))


def test_what_is_held_is_let_pass() -> None:
    record = empty("dimer_chain", {"effects.restitution": 0.9})
    require(record, "inclusion", "effects.restitution")
    with pytest.raises(ValueError, match="inclusion: must be left out"):
        require(record, "effects.restitution")
