"""Fronts in chains of heavy and light spheres: resonances, antiresonances, and LAMMPS beside them."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cases.dimers import case as dimers
from cases.dimers.front import antiresonance, decay, dimer, rattle, rattle_of, resonance, struck
from granular_lmp import ImpactRecord, ImpactScene, run_impact
from tests.conftest import members
from tests.manual import Measure, Mutant, verifies

SCENE = ImpactScene.load("dimer_chain")
HEAVY = SCENE.sphere.density
Runs = Callable[[float, float], ImpactRecord]


@verifies(
    "Resonance of a chain of heavy and light spheres, ratio of masses",
    reference="other step: a third of it (resonances published by Jayaprakash, Starosvetsky, Vakakis 2011)",
    tolerance=1e-05,
    reason="the step shifts it by 3e-6",
    mutant=Mutant(
        "analysis/cases/dimers/front.py", "np.tile([1.0, ratio], cells)", "np.tile([1.0, 1.0002 * ratio], cells)"
    ),
)
def test_light_spheres_come_to_rest_at_the_resonances(measured: Measure) -> None:
    found = resonance(0.3427, 0.343)
    # Measured with a third of the step, and in the cell 60; the step shifts it by 3e-6
    measured(found - 0.342846)
    assert abs(rattle(found)) < 1e-4 < abs(rattle(found + 1e-3))
    # The decay touches zero there: it goes with the square of r
    assert abs(decay(found)) < 1e-6 < decay(found + 0.005)


@pytest.mark.parametrize("ratio", members([0.154752, 0.090128, 0.061504], 0.090128, 0.061504))
def test_light_spheres_turn_at_each_resonance(ratio: float) -> None:
    # The step shifts these by up to 1.5e-5
    assert rattle(ratio * (1 - 3e-4)) > 0 > rattle(ratio * (1 + 3e-4))


def test_between_two_resonances_the_front_decays_most() -> None:
    ratio, most = antiresonance(0.237, 0.243)
    # λ is flat: an error of 1e-7 in it, of steps, moves the ratio by 3e-4
    assert ratio == pytest.approx(0.2399, abs=1e-3)
    assert most == pytest.approx(2.7566e-3, rel=1e-3)
    assert decay(0.20) < most > decay(0.28)


def test_equal_spheres_are_no_dimer() -> None:
    # The foot of the pulse behind the solitary wave decays as cells go by, and with it the height settles, 1e-6 a cell
    assert abs(decay(1.0)) < 5e-6
    assert decay(0.9) > 5e-4


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Runs of the shipped scene by the ratio of masses and the time step, recorded where the front is watched."""

    @cache
    def make(ratio: float, step: float) -> ImpactRecord:
        changes = {"inclusion.1.density": ratio * HEAVY, "time.timestep": step, "time.sample": 0.15}
        changes |= {"time.duration": 100.05, "output.rows": [30, 76]}
        return run_impact(SCENE.with_values(changes), tmp_path_factory.mktemp("dimer") / "run")

    return make


@pytest.mark.parametrize("ratio", members([0.2399, 0.342846], 0.342846))
def test_lammps_moves_the_dimer_as_the_theory_does(run: Runs, ratio: float) -> None:
    (found, lost, left), (_, finer, nearer) = (dimers.measured(run(ratio, step)) for step in (0.05, 0.025))
    lost, left = (4 * finer - lost) / 3, (4 * nearer - left) / 3
    assert found == pytest.approx(ratio, rel=1e-12)
    # A contact that opens near a crest is not smooth: samples of 0.15 give the height to 7e-5, λ over 20 cells to 4e-6
    assert lost == pytest.approx(decay(ratio), abs=5e-6)
    # Such events leave a share of the pair's difference, 6e-4, too
    assert left == pytest.approx(rattle(ratio), abs=1e-4)
    assert abs(rattle(ratio) - rattle(ratio + 0.005)) > 1e-3


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_has_a_line_for_each_run(
    run: Runs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dimers, "RATIOS", np.array([0.2399]))
    monkeypatch.setattr(dimers, "RESONANCES", ())
    monkeypatch.setattr(dimers, "ANTIRESONANCES", ())
    record = run(0.2399, 0.05)
    assert dimers.main([str(record.folder), "-o", str(tmp_path / "dimers.png")]) == 0
    assert (tmp_path / "dimers.png").stat().st_size > 10_000
    assert re.search(r"^ +0\.23990 +2\.7\d+e-03 +2\.757e-03", capsys.readouterr().out, re.MULTILINE)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"striker.1.rows": [1, 1]}, "must be a chain of heavy and light spheres in turn"),
        ({"inclusion.1.density": 3e4}, "must be a chain of heavy and light spheres in turn"),
        ({"inclusion.1.youngs_modulus": 7e10, "disorder.density": 0.1}, "must be a chain of heavy and light spheres"),
        ({"time.sample": 0.3}, "time.sample = 0.3: must be at most 0.15"),
        ({"output.rows": [0, 9]}, "output.rows: must hold the rows 30 to 76"),
        ({}, "no pulse above 0.0001 has passed"),
    ],
)
def test_a_run_that_is_no_such_chain_is_refused(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    scene = SCENE.with_values({"time.duration": 3.0, "time.sample": 0.15} | changes)
    with pytest.raises(ValueError, match=re.escape(message)):
        dimers.measured(run_impact(scene, tmp_path / "run"))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: dimer(0.02, 5), "ratio must be from 0.03 to 1, not 0.02"),
        (lambda: decay(1.2), "ratio must be from 0.03 to 1, not 1.2"),
        (lambda: resonance(0.3, 0.31), "no resonance from 0.3 to 0.31: light spheres have"),
        (lambda: antiresonance(0.18, 0.1804), "no antiresonance from 0.18 to 0.1804: the front decays most at an end"),
    ],
)
def test_what_has_no_answer_is_refused(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        call()


def test_a_light_sphere_is_not_taken_for_a_heavy_one() -> None:
    velocity = struck(0.3)
    assert rattle_of(np.roll(velocity, 1, axis=1)) != pytest.approx(rattle_of(velocity), abs=1e-2)
