"""Bands of chains that are pressed together: closed forms, and the command that prints and draws them."""

import json
from pathlib import Path

import numpy as np
import pytest

from cases.solitary.chain import bands, compressed, linear_stiffness, normal_modes
from granular_lmp import ImpactScene, Scene
from granular_lmp.cli import main
from granular_lmp.crystal.chain_bands import cell_of, edges, frequencies, gaps
from granular_lmp.errors import SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import chain_cell

BREATHER = ImpactScene.load("breather")


def test_a_diatomic_chain_has_the_bands_of_the_theory() -> None:
    problem = prepare(BREATHER)
    mass, stiffness = problem.rest.cell
    assert mass == pytest.approx([1.0, 0.1], rel=1e-12)
    expected = bands((1.0, 0.1), float(stiffness[0]))
    found = edges(mass, stiffness)
    # Eigenvalues of a matrix of two rows
    assert found == pytest.approx(np.array([[0.0, expected[0]], expected[1:]]), rel=1e-12)
    assert gaps(found) == [pytest.approx(expected[:2], rel=1e-12)]
    assert found[1, 0] != pytest.approx(bands((1.0, 0.11), float(stiffness[0]))[1], rel=1e-2)
    # The stiffness in SI is that of the theory: K = (3/2) A^{2/3} F0^{1/3}
    ball, scale = BREATHER.sphere, BREATHER.scale
    assert stiffness[0] * scale.mass / scale.time**2 == pytest.approx(
        1.5 * ball.normal_coefficient ** (2 / 3) * 20.0 ** (1 / 3), rel=1e-9
    )


def test_one_sphere_to_a_cell_has_no_gap() -> None:
    phases = np.linspace(0.1, np.pi, 7)
    assert frequencies(np.array([2.0]), np.array([3.0]), phases)[:, 0] == pytest.approx(
        2 * np.sqrt(3 / 2) * np.sin(phases / 2), rel=1e-12
    )
    # Taken as a cell of two, the branch is folded, and the two bands touch
    assert gaps(edges(np.array([2.0, 2.0]), np.array([3.0, 3.0]))) == []


def test_three_kinds_of_contacts_have_the_modes_of_a_long_chain() -> None:
    mass, force = np.array([1.0, 3.0, 0.5]), 0.7
    stiffness = np.array([1.0, 2.0, 0.4])  # A of each contact with the next sphere
    cells = 40
    whole = np.concatenate([[0.0], np.tile(stiffness, cells)])
    whole[-1] = 0.0
    chain = compressed(np.tile(mass, cells), whole, force)
    spring = linear_stiffness(chain)[1:4]
    found = edges(mass, spring)
    modes, _ = normal_modes(chain)
    inside = [np.count_nonzero((low - 1e-9 <= modes) & (modes <= high + 1e-9)) for low, high in found]
    # A free end has at most one mode of its own in each gap
    assert sum(inside) >= 3 * cells - 2 * len(gaps(found))
    for (low, high), count in zip(found, inside, strict=True):
        assert count >= cells - 2
        # Of 40 cells the last phase is π/40 from the edge, where the band is level: (π/40)² of its width
        near = modes[(low - 1e-9 <= modes) & (modes <= high + 1e-9)]
        assert near.max() == pytest.approx(high, abs=0.02 * (high - low))
    assert len(gaps(found)) == 2


def test_the_cell_is_the_least_that_repeats() -> None:
    assert cell_of(np.ones(6), np.ones(5)) == 1
    assert cell_of(np.array([1.0, 2, 1, 2, 1]), np.ones(4)) == 2
    assert cell_of(np.ones(6), np.array([1.0, 2, 1, 2, 1])) == 2
    assert cell_of(np.array([1.0, 2, 2, 1, 2, 2]), np.ones(5)) == 3
    assert cell_of(np.array([1.0, 2, 1, 2, 2]), np.ones(4)) == 0
    assert cell_of(np.array([1.0, 2, 3, 1, 2]), np.ones(4)) == 0  # not there twice


@pytest.mark.usefixtures("drawn_once")
def test_modes_prints_bands_and_gaps_of_an_impact(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["modes", "breather", "--plot", str(tmp_path / "bands.png")]) == 0
    head, _, acoustic, gap, optical, drawn = capsys.readouterr().out.splitlines()
    assert head.startswith("breather: 2 spheres to a cell; sound 644.7")
    assert [line.split()[0] for line in (acoustic, gap, optical)] == ["band", "gap", "band"]
    assert acoustic.split()[2] == gap.split()[1]
    assert drawn.endswith("bands.png")
    assert (tmp_path / "bands.png").stat().st_size > 5000
    assert main(["modes", "breather", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    ((low, high),) = ((each["from_Hz"], each["to_Hz"]) for each in said["gap"])
    assert (low, high) == pytest.approx((5703.13, 18034.9), rel=1e-5)
    assert said["cell"] == 2


def test_chains_without_bands_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["modes", "solitary_chain"]) == 2
    assert "packing.contact_force = 0.0: must be above 0" in capsys.readouterr().err
    assert main(["modes", "compressed_chain", "--set", "disorder.density=0.1"]) == 2
    assert "do not repeat from end to end" in capsys.readouterr().err
    with pytest.raises(SceneError, match="spheres that just touch have no modes"):
        _ = prepare(ImpactScene.load("point_impact")).rest.cell


def test_a_wave_in_a_chain_of_two_kinds_in_turn_has_their_bands(capsys: pytest.CaptureFixture[str]) -> None:
    chain = Scene.load("l_chain")
    heavy = {"rows": [0, chain.shape.rows - 1], "every": 2, "density": 3 * chain.sphere.density}
    values = {"packing.rows": chain.shape.rows, "packing.columns": 1, "packing.ends": chain.shape.ends}
    scene = Scene.from_dict(chain.with_values(values).to_dict() | {"inclusion": [heavy]})
    cell = chain_cell(scene)
    assert cell is not None
    # Adhesion presses every contact as in the chain of equal spheres: stiffness in m/t0² is that of the sphere
    ball = scene.sphere
    own = ball.normal_stiffness * ball.time_scale**2 / ball.mass
    assert edges(*cell)[:, 1] == pytest.approx(np.array(bands((1.0, 3.0), own))[[0, 2]], rel=1e-6)
    assert chain_cell(chain) is None
    once = Scene.from_dict(chain.with_values(values).to_dict() | {"inclusion": [heavy | {"rows": [4, 6]}]})
    assert chain_cell(once) is None


def test_the_modes_of_a_wave_say_that_they_are_of_the_perfect_lattice(capsys: pytest.CaptureFixture[str]) -> None:
    left_out = Scene.load("tr_impurity").imperfections
    assert "inclusion" in left_out
    assert main(["modes", "tr_impurity"]) == 0
    assert (
        f"modes of the perfect lattice, the crystal in which the wave starts; left out: {left_out}"
        in capsys.readouterr().out
    )
    assert main(["modes", "tr_impurity", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["left_out"] == left_out
    assert main(["modes", "tr_periodic"]) == 0
    assert "left out" not in capsys.readouterr().out
