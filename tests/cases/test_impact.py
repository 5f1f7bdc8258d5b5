"""The figures of strongly nonlinear waves: what they measure, and that they are drawn."""

from pathlib import Path

import numpy as np
import pytest

from cases.impact import case as impact
from cases.impact.case import Run, errors, stepped
from cases.solitary import case as solitary
from cases.solitary.chain import uniform
from cases.solitary.chain_motion import SIXTH, VERLET, march
from granular_analysis.plotting import save


@pytest.fixture(autouse=True)
def once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run once what is timed."""
    monkeypatch.setattr(impact, "REPEATS", 1)


def test_an_error_is_that_of_the_worst_velocity() -> None:
    (small,) = errors([stepped(80, SIXTH)])
    assert small < 1e-6
    run = stepped(80, VERLET)
    (error,) = errors([run])
    assert error == pytest.approx(1.4e-4, rel=0.05)
    wrong = run.velocities.copy()
    wrong[3] += 0.5
    assert errors([Run(80, wrong, 0.0)])[0] == pytest.approx(0.5, abs=1e-3)


def test_the_steps_that_the_page_recommends_have_the_errors_it_says() -> None:
    coarse, fine = stepped(40, VERLET), stepped(80, VERLET)
    pair = Run(80, (4 * fine.velocities - coarse.velocities) / 3, 0.0)
    assert errors([fine])[0] < 2e-4
    assert errors([pair])[0] < 1e-5
    assert errors([stepped(20, SIXTH)])[0] < 1e-5


def test_lammps_is_velocity_verlet_to_rounding() -> None:
    velocities, v = np.asarray(impact.lammps(20, 0.1, 100, 20, (0, 20))[1]), np.eye(20)[0]
    _, expected = march(uniform(20), 0 * v, v, 0.1, 100, every=20)
    # Positions of 1e4 overlaps carry 1e-12, over 100 steps
    assert velocities[1:] == pytest.approx(expected, abs=1e-9)
    assert velocities[1:] != pytest.approx(np.roll(expected, 1, axis=0), abs=1e-3)


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_of_an_impact_is_drawn(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, value in {"STEPS": (5, 10), "TOLERANCES": (1e-4,), "MANY": 2000}.items():
        monkeypatch.setattr(impact, name, value)
    assert impact.main(["-o", str(tmp_path / "impact.png")]) == 0
    assert (tmp_path / "impact.png").stat().st_size > 10_000
    said = capsys.readouterr().out
    assert said.count("LAMMPS") == 3
    assert said.count("energy error in 2e+03 steps") == 2


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_of_the_solitary_wave_is_drawn(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(solitary, "RATIOS", np.array([1.1, 5.0]))
    monkeypatch.setattr(solitary, "MASSES", np.array([0.5, 2.0]))
    save(solitary.draw({}), tmp_path / "solitary.png")
    assert (tmp_path / "solitary.png").stat().st_size > 10_000
