"""Sheets of unequal spheres that are struck: gaps at rest, and LAMMPS beside the network."""

import re
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import start
from granular_lmp import ImpactScene, run_impact
from granular_lmp.errors import SceneError
from granular_lmp.problem import Problem, prepare

SHEET = ImpactScene.load("point_impact")
SMALL = SHEET.with_values({"packing.rows": 7, "packing.columns": 7, "striker.1.spheres": [[0, 3]]})


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


def test_a_sheet_with_gaps_moves_as_the_network_does(tmp_path: Path) -> None:
    # Gaps of 0.6 ℓ in the mean: spheres fly before they collide
    scene = SMALL.with_values({"disorder.radius": 1e-3, "disorder.seed": 3, "time.duration": 6.0, "time.sample": 6.0})
    coarse, fine = (
        run_impact(scene.with_values({"time.timestep": step}), tmp_path / str(step)) for step in (0.04, 0.02)
    )
    ball, scale, crystal = fine.scene.sphere, fine.scale, fine.problem.rest.atoms
    v = np.zeros((len(crystal), 2))
    v[3, 1] = scale.velocity

    def network(radius: np.ndarray, rtol: float = 1e-9) -> np.ndarray:
        spheres = Network(
            crystal.positions[:, :2] * ball.radius,
            radius * ball.radius,
            np.full(len(crystal), ball.density),
            (Material(ball.youngs_modulus, ball.poisson_ratio),),
            friction=0.0,
        )
        motion = integrate(spheres, start(spheres, 0.0, v), [6 * scale.time], rtol=rtol, longest_step=scale.time / 5)
        return np.asarray(motion.velocity[-1] / scale.velocity)

    velocity = (4 * fine.velocity[-1] - coarse.velocity[-1]) / 3
    # Each contact that closes or opens leaves an error of order 5/2: some percent of the pair's difference of 1.3e-4
    assert velocity == pytest.approx(network(crystal.arrays["radius"]), abs=5e-6)
    assert np.max(np.abs(velocity - network(np.ones(len(crystal)), 1e-5))) > 0.1  # as if they touched
    # Gaps store no energy: the striker's is kept to the error of velocity Verlet
    energy = coarse.energy()
    assert energy[1:] == pytest.approx(energy[0], abs=1e-4)


def test_a_sheet_with_gaps_is_at_rest_before_it_is_struck(tmp_path: Path) -> None:
    scene = SHEET.with_values({"disorder.radius": 1e-3, "packing.rows": 21, "time.duration": 5.0, "time.sample": 5.0})
    record = run_impact(scene, tmp_path / "run")
    assert not record.velocity[-1][record.problem.rest.atoms.arrays["row"] > 15].any()


def test_too_loose_a_sheet_is_refused_and_a_loose_one_named() -> None:
    with pytest.raises(SceneError, match=re.escape("disorder.radius = 0.041: must be at most 0.04 in a sheet")):
        SHEET.with_values({"disorder.radius": 0.041})
    assert "with gaps (disorder.radius = 0.01), struck" in SHEET.with_values({"disorder.radius": 0.01}).words
