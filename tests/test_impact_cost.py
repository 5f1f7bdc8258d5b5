"""What the step of an impact costs: errors against finer runs are those against theory, and seconds are there."""

import csv
from pathlib import Path

import numpy as np
import pytest

from analysis.theory.chain import uniform
from analysis.theory.chain_motion import integrate
from granular_lmp import ImpactRecord, ImpactScene
from granular_lmp.cli import main
from granular_lmp.errors import ToleranceError
from granular_lmp.studies import impact_cost
from granular_lmp.studies.impact_cost import ImpactCost, cost_of_impact
from granular_lmp.studies.sweep import Sweep

CHAIN = ImpactScene.load("solitary_chain").with_values(
    {"packing.rows": 12, "packing.last": "free", "time.duration": 20.0, "time.sample": 1.0}
)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[ImpactCost, Path]:
    folder = tmp_path_factory.mktemp("cost") / "study"
    return cost_of_impact(CHAIN.with_values({"time.tolerance": 1e-3}), folder), folder


def test_the_errors_are_those_against_theory(study: tuple[ImpactCost, Path]) -> None:
    cost, folder = study
    start = np.eye(12)[0]
    _, exact = integrate(uniform(12), 0 * start, start, np.arange(1.0, 21.0), 1e-11)
    done = Sweep.load(folder)
    for row, line in zip(cost.rows, done.rows, strict=True):
        record = done.record(line)
        assert isinstance(record, ImpactRecord)
        true = np.max(np.abs(record.velocity[1:, :, 1] - exact))
        # The reference errs by less than it is estimated
        assert row["error"] == pytest.approx(true, abs=cost.reference)
        assert row["timestep"] == record.scene.time.step
    assert cost.order == 2
    errors = [row["error"] for row in cost.rows]
    assert all(5 > longer / shorter > 3 for longer, shorter in zip(errors, errors[1:], strict=False))
    assert errors[-1] > 5 * cost.reference
    assert cost.rows[0]["steps_in_collision"] >= 16
    assert all(row["seconds"] > 0 for row in cost.rows)
    assert all(row["error_extrapolated"] < row["error"] / 5 for row in cost.rows[1:])


def test_the_table_is_kept_and_said(study: tuple[ImpactCost, Path]) -> None:
    cost, folder = study
    with (folder / "cost.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [float(line["error"]) for line in table] == [row["error"] for row in cost.rows]
    assert table[0]["error_extrapolated"] == ""
    lines = cost.text().splitlines()
    assert len(lines) == 8
    assert lines[1].split()[-1] == "-"
    assert "<1.0e+00" in ImpactCost(cost.rows, 2, 1.0).text()  # errors below that of the reference are not known
    assert "the error is of order 2 in the step" in lines[-1]


def test_the_command_measures_and_refuses_what_is_for_waves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(impact_cost, "RUNS", 3)
    (tmp_path / "mine.toml").write_text(CHAIN.with_values({"packing.rows": 5}).to_toml())
    words = ["cost", str(tmp_path / "mine.toml"), "-o", str(tmp_path / "study")]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert said.splitlines()[1].lstrip().startswith("T/")
    assert said.endswith("cost.csv, sweep.csv\n")
    assert main([*words, "--budget", "3"]) == 2
    assert "--budget: is for the scene of a wave" in capsys.readouterr().err


def test_runs_that_fail_or_do_not_converge_have_no_cost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(impact_cost, "RUNS", 3)
    # At 118 m/s two spheres overlap by 0.0497 of the diameter, and a row of four strikers makes it more
    deep = ImpactScene.from_dict(
        CHAIN.with_values({"packing.rows": 6, "packing.last": "wall"}).to_dict()
        | {"striker": [{"rows": [0, 3], "velocity": 118.0}]}
    )
    with pytest.raises(ToleranceError, match=r"time.timestep = 0\.1\d*: .*largest_overlap = "):
        cost_of_impact(deep, tmp_path / "deep")
    monkeypatch.setattr(impact_cost, "shown_order", lambda runs: None)
    with pytest.raises(ToleranceError, match="do not converge with the step, so that no error is known"):
        cost_of_impact(CHAIN, tmp_path / "study")


def test_the_step_of_the_scene_may_be_any(study: tuple[ImpactCost, Path]) -> None:
    cost, folder = study
    # Too long for a run of its own; the study is that of the fixture, which it reads
    again = cost_of_impact(CHAIN.with_values({"time.timestep": 0.9}), folder)
    assert again == cost
