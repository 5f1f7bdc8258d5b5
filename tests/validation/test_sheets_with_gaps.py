"""Sheets of unequal spheres that are struck: gaps at rest; test_beside_network has their motion."""

import re
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import ImpactScene, run_impact
from granular_lmp.errors import SceneError
from granular_lmp.problem import Problem, prepare

SHEET = ImpactScene.load("point_impact")


def gaps(problem: Problem) -> np.ndarray:
    """Gaps of the neighbours, radii."""
    return (problem.rest.contacts.length - problem.rest.contacts.radii) / problem.scene.sphere.radius


@pytest.mark.parametrize("lattice", ["hexagonal", "square"])
def test_unequal_spheres_of_a_sheet_have_gaps_and_overlap_nowhere(lattice: str) -> None:
    scene = SHEET.with_values({"packing.lattice": lattice, "disorder.radius": 0.04, "packing.sides": "periodic"})
    problem, equal = prepare(scene), prepare(scene.with_values({"disorder.radius": 0.0}))
    assert problem.rest.atoms.arrays["radius"].max() <= 1.0
    assert problem.rest.atoms.positions == pytest.approx(equal.rest.atoms.positions, abs=0)
    assert len(gaps(problem)) == len(gaps(equal))  # every neighbour is found, and no second one
    # A contact between rows of the hexagonal lattice may overlap by a rounding of its place
    assert gaps(problem).min() > -1e-13
    assert gaps(problem).max() < 6 * 0.04
    # Two means √(2/π) of |g|, over 5000 gaps of spread 0.85
    assert gaps(problem).mean() == pytest.approx(1.6 * 0.04, rel=0.05)
    # Another spread of the same seed scales the gaps
    half = prepare(scene.with_values({"disorder.radius": 0.02}))
    assert gaps(half) == pytest.approx(gaps(problem) / 2, abs=1e-12)


def test_a_sheet_with_gaps_is_at_rest_before_it_is_struck(tmp_path: Path) -> None:
    scene = SHEET.with_values({"disorder.radius": 1e-3, "packing.rows": 21, "time.duration": 5.0, "time.sample": 5.0})
    record = run_impact(scene, tmp_path / "run")
    energy = record.energy()
    assert energy[1:] == pytest.approx(energy[0], abs=1e-4)  # gaps store none; what is left is of velocity Verlet
    assert not record.velocity[-1][record.problem.rest.atoms.arrays["row"] > 15].any()


def test_too_loose_a_sheet_is_refused_and_a_loose_one_named() -> None:
    with pytest.raises(SceneError, match=re.escape("disorder.radius = 0.041: must be at most 0.04 in a sheet")):
        SHEET.with_values({"disorder.radius": 0.041})
    assert "with gaps (disorder.radius = 0.01), struck" in SHEET.with_values({"disorder.radius": 0.01}).words
