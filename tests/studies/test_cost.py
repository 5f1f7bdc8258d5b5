"""The work-precision study: errors react, budgets drop, nothing is run twice, and Ctrl-C loses nothing."""

import csv
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.norms import relative_error
from granular_analysis.theory.chain import uniform
from granular_analysis.theory.chain_motion import integrate
from granular_analysis.theory.choice import trajectory, wave_of
from granular_lmp import ImpactRecord, ImpactScene, Record, Scene, build, load, run
from granular_lmp.errors import (
    GranularError,
    LammpsError,
    LaunchError,
    RunFolderError,
    RunInterrupted,
    SceneError,
    ToleranceError,
)
from granular_lmp.runs.record import read_status, write_status
from granular_lmp.scene.scene import assignment
from granular_lmp.studies import cost as module
from granular_lmp.studies import cost_settings
from granular_lmp.studies.cost import measure, plan
from granular_lmp.studies.cost_settings import KNOBS, Run, base, points, reference
from granular_lmp.studies.output_variants import OUTPUTS, edited, keep_centre
from granular_lmp.studies.tally import NOT_RUN, errors, failed, recommended, text, to_csv
from tests.cli.test_cli import cli
from tests.conftest import PAPER

ROOT = Path(__file__).parents[2]
FEW = ("time step", "Richardson pair")


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A study of two knobs: runs with three steps, and the reference, on a machine of a known speed."""
    monkeypatch.setattr(module, "speed", lambda scene, kernel: (1e6, 0.0))
    monkeypatch.setattr(cost_settings, "HALVINGS", 2)
    for knob in set(KNOBS) - set(FEW):
        monkeypatch.delitem(KNOBS, knob)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """All knobs of a tiny scene, one round."""
    scene = PAPER.with_values(
        {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "time.duration": 2.0}
    )
    folder = tmp_path_factory.mktemp("cost") / "study"
    return folder, measure(plan(scene, folder, repeats=1))


def rows(result: dict[str, Any], knob: str) -> dict[str, dict[str, Any]]:
    return {row["setting"]: row for row in result["points"] if row["knob"] == knob}


# --- what comes out ---


def test_every_setting_of_every_knob_is_measured(study: tuple[Path, dict[str, Any]]) -> None:
    _, result = study
    assert {row["knob"] for row in result["points"]} == set(KNOBS)
    assert [row["message"] for row in result["points"] if not row["repeats"]] == []
    for row in result["points"]:
        assert 0 < row["seconds_min"] <= row["seconds"] <= row["seconds_max"]
        assert row["particle_steps_per_second"] == pytest.approx(row["particle_steps"] / row["loop_seconds"])


def test_errors_fall_as_the_orders_say(study: tuple[Path, dict[str, Any]]) -> None:
    _, result = study
    slopes = [row["slope"] for row in list(rows(result, "time step").values())[1:]]
    # Velocity Verlet is of second order; the next order shows at the longest step, 0.5: (Ωh)² is then 2 %
    assert slopes == pytest.approx([-2] * len(slopes), abs=0.05)
    first = list(rows(result, "Richardson pair").values())[1]["slope"]
    assert first == pytest.approx(-4, abs=0.2)  # fourth order until the first-order error of LAMMPS shows
    wasted = [row["slope"] for row in list(rows(result, "columns").values())[1:]]
    assert wasted == pytest.approx([0] * len(wasted), abs=1e-3)  # all columns move alike


def test_the_error_of_a_pair_is_that_of_the_extrapolation(study: tuple[Path, dict[str, Any]]) -> None:
    _, result = study
    single, pair = rows(result, "time step"), rows(result, "Richardson pair")["0.25 + 0.125"]
    assert pair["error_q"] < single["0.125"]["error_q"] / 100
    assert pair["particle_steps"] == single["0.25"]["particle_steps"] + single["0.125"]["particle_steps"]


@pytest.mark.usefixtures("few")
def test_a_pair_of_runs_whose_contacts_may_open_is_its_finer_run(tmp_path: Path) -> None:
    cell = {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "time.duration": 1.0}
    scene = PAPER.with_values({**cell, "effects.contact_opening": True})
    result = measure(plan(scene, tmp_path / "study", repeats=1))
    single, pair = rows(result, "time step"), rows(result, "Richardson pair")["0.25 + 0.125"]
    assert pair["error_q"] == single["0.125"]["error_q"] > 0
    # The reference is its finest run, and its error the distance to the one before
    assert 0 < result["reference"]["error_q"] < single["0.125"]["error_q"]


def test_what_is_wrong_has_a_large_error(study: tuple[Path, dict[str, Any]]) -> None:
    _, result = study
    effects, output = rows(result, "effects"), rows(result, "output")
    assert effects["no rotation"]["error_q"] > 0.01  # another wave
    assert effects["incremental law"]["error_p"] > 0.5  # p is 1.9 times as large
    assert effects["no tracking"]["error_phi"] is None
    assert output["all, text, 6 digits"]["error_p"] > 0.1  # six digits of the box are a tenth of D0
    assert output["all, text"]["error_p"] == pytest.approx(output["probe"]["error_p"], rel=1e-3)
    assert output["all, binary"]["error_p"] == pytest.approx(output["probe"]["error_p"], rel=1e-3)


def test_one_percent_is_seen_in_the_component_that_has_it(study: tuple[Path, dict[str, Any]]) -> None:
    best = Record.load(study[0] / "reference")
    for name in ("p", "q", "phi"):
        found = errors(best.with_signals(**{name: 1.01 * getattr(best, name)}), best)
        assert found.pop(f"error_{name}") == pytest.approx(0.01, rel=1e-9)
        assert list(found.values()) == [0, 0]


def test_what_symmetry_makes_zero_has_no_error(small: Scene) -> None:
    wave = small.with_values({"wave.mode": "L"})
    tau = np.arange(3.0)
    best = Record.of_centre(tau, 1 + tau, 1e-9 * tau, 0 * tau, wave)
    assert errors(best.with_signals(q=-best.q), best) == {"error_p": 0.0, "error_q": None, "error_phi": None}


def test_the_reference_knows_its_own_error(study: tuple[Path, dict[str, Any]]) -> None:
    folder, result = study
    best = Record.load(folder / "reference")
    exact = trajectory("exact-lattice", wave_of(best), best.tau)
    # The exact lattice is integrated to 1e-9 or so; rounding of the run is of the size of the error of q here
    truth = relative_error(best.p, exact[0])
    assert truth < 1e-6
    # The distance of two extrapolations is 1 time the error where that is of first order and 15 times where of fourth
    assert truth / 1.5 < result["reference"]["error_p"] < 15 * 1.5 * truth


def test_the_tables_say_the_same(study: tuple[Path, dict[str, Any]]) -> None:
    folder, result = study
    assert json.loads((folder / "cost.json").read_text()) == result
    assert (folder / "cost.csv").read_text() == to_csv(result["points"])


def test_the_fastest_setting_of_an_accuracy_is_recommended(study: tuple[Path, dict[str, Any]]) -> None:
    result = study[1]
    single = [row for row in result["points"] if row["options"] is not None]
    known = {
        row["options"]: max(value for key, value in row.items() if key.startswith("error_") and value is not None)
        for row in single
        if row["repeats"]
    }
    middle = sorted(known.values())[len(known) // 2]
    words, options = recommended(result, middle).splitlines()
    assert words.startswith(f"for an error of at most {middle:g} the fastest is ")
    assert known[options] <= middle
    chosen = min(row["seconds"] for row in single if row["options"] == options)
    met = [row for row in single if known.get(row["options"], np.inf) <= middle]
    assert chosen == min(row["seconds"] for row in met)
    assert recommended(result, 1e-15).startswith("no measured setting has an error of at most 1e-15; the best is ")
    assert not any(
        row["options"]
        for knob in ("Richardson pair", "output")
        for row in rows(result, knob).values()
        if row["setting"] != "probe"
    )


def test_the_options_of_a_setting_give_its_run(small: Scene) -> None:
    there = base(small.with_values({"time.tolerance": 1e-2}))
    copied = [(point, point.options(there)) for point in points(there)[0]]
    for point, options in copied:
        if options is not None:
            changes = dict(
                assignment(each) for each in options.partition(" --np")[0].removeprefix("--set ").split(" --set ")
            )
            assert Run(there.with_values(changes), ranks=point.runs[0].ranks).name == point.runs[0].name
            assert ("--np 2" in options) == (point.runs[0].ranks == 2)
    assert {point.knob for point, options in copied if options is None} == {"Richardson pair", "output", "effects"} | {
        "strip or sheet"
    }


# --- output ---


@pytest.mark.parametrize("name", OUTPUTS)
def test_the_centre_is_found_in_what_was_written(name: str, small: Scene, tmp_path: Path) -> None:
    deck = build(small)
    plain = run(deck, tmp_path / "plain")
    written = run(edited(deck, OUTPUTS[name]), tmp_path / "run")
    kept = keep_centre(deck, written, OUTPUTS[name])
    # Rounding of positions: all digits of 7 µm are 1e-9 nm, 2e-8 D0; six digits 7e-3 nm, 0.14 D0
    tolerance = 2e-8 if OUTPUTS[name].all_digits else 1e-5 if name.startswith("probe") else 0.2
    for component in ("p", "q", "phi"):
        # A sphere that holds another's place would be off by 1
        np.testing.assert_allclose(getattr(kept, component), getattr(plain, component), rtol=0, atol=tolerance)
    loaded = Record.load(tmp_path / "run")
    assert (loaded.q == kept.q).all()
    assert not (tmp_path / "run" / OUTPUTS[name].file).exists()


def test_all_spheres_stay_in_a_run_that_writes_all(tmp_path: Path) -> None:
    deck = build(PAPER.with_values({"packing.rows": "auto", "time.duration": 50.0, "time.timestep": 1 / 6}))
    assert "evaporate" in deck.input_text
    plain = run(deck, tmp_path / "plain")
    kept = keep_centre(deck, run(edited(deck, OUTPUTS["all, binary"]), tmp_path / "run"), OUTPUTS["all, binary"])
    np.testing.assert_allclose(kept.q, plain.q, rtol=0, atol=2e-8)  # rounding of positions, as above


@pytest.mark.parametrize("name", ["all, text", "all, binary"])
def test_the_centre_of_a_crystal_in_space_is_found_with_all_its_freedoms(name: str, tmp_path: Path) -> None:
    scene = Scene.load("monolayer_rocking").with_values({"wave.wavenumber": np.pi / 2, "time.duration": 1.0})
    deck = build(scene.with_values({"packing.rows": 4, "output.particles": 0.0}))
    plain = run(deck, tmp_path / "plain")
    kept = keep_centre(deck, run(edited(deck, OUTPUTS[name]), tmp_path / "run"), OUTPUTS[name])
    assert set(kept.signals) == set(plain.signals)
    for component, values in plain.signals.items():
        np.testing.assert_allclose(kept.signals[component], values, rtol=0, atol=2e-8)


def test_a_deck_that_is_not_ours_is_refused(small: Scene) -> None:
    deck = replace(build(small), input_text="run 1\n")
    with pytest.raises(ValueError, match="not a deck whose output can be changed"):
        edited(deck, OUTPUTS["all, text"])


# --- knobs ---


def test_runs_that_are_the_same_have_one_name(small: Scene) -> None:
    made, refused = points(small)
    assert refused == {}
    shared = {point.knob: point.runs[0].name for point in made if point.setting in ("3", "probe", "as declared", "1")}
    assert len(set(shared.values())) == 1
    assert len({Run(small).name, Run(small, ranks=2).name, Run(small, "all, text").name}) == 3


def test_what_a_scene_cannot_have_is_left_out_with_the_reason(small: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    for knob in set(KNOBS) - {"tolerance, strip"}:
        monkeypatch.delitem(KNOBS, knob)
    long = {"packing.rows": 4_000, "packing.columns": 3, "wave.amplitude": 1e-5, "wave.mode": "L"}
    made, refused = points(small.with_values(long))
    assert "must be at least" in refused["tolerance, strip: 1e-06"]  # rounding
    assert "tolerance, strip: 1e-06" not in map(str, made)


def test_an_effect_that_is_off_is_not_switched_off_again(small: Scene) -> None:
    made, refused = points(small.with_values({"effects.rotation": False}))
    assert refused == {
        "effects: no tracking": "effects.tracking: is off already",
        "effects: no rotation": "effects.rotation: is off already",
    }
    # The scene calls for rotation: what has it is not the wrong one of the two
    settings = [point.setting for point in made if point.knob == "effects"]
    assert settings == ["as declared", "all: another model", "incremental law"]


def test_more_ranks_than_cores_are_left_out(small: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("granular_lmp.studies.cost_settings.core_count", lambda: 1)
    assert points(small)[1] == {"ranks: 2": "ranks = 2: must be from 1 to 1, the cores of this machine"}


def test_the_reference_is_finer_than_every_step_of_the_knob(small: Scene) -> None:
    steps = [run.scene.time.step for run in reference(small).runs]
    finest = min(point.runs[0].scene.time.step for point in points(small)[0] if point.knob == "time step")
    assert steps == [finest / 2**k for k in (1, 2, 3)]


# --- running ---


def counted(monkeypatch: pytest.MonkeyPatch, stop_after: int = 10**9) -> list[str]:
    """Names of the runs that are really done; Ctrl-C comes in the one after `stop_after`."""
    done: list[str] = []
    real = module.run_scene

    def run_one(scene: Scene, folder: Path, **options: Any) -> Record:
        if len(done) == stop_after:
            raise KeyboardInterrupt
        done.append(folder.parent.name)
        return real(scene, folder, **options)

    monkeypatch.setattr(module, "run_scene", run_one)
    return done


def test_rounds_take_turns_and_asked_again_nothing_is_done_twice(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = counted(monkeypatch)
    first = measure(plan(small, tmp_path / "study", repeats=2))
    assert len(done) == 2 * 3 + 3  # three steps, of which the pairs are made; the reference once
    again = plan(small, tmp_path / "study", repeats=2)
    assert (again.todo(), again.seconds) == ([], 0)
    assert measure(again) == first
    assert len(done) == 9
    assert done[3:6] == done[6:]  # rounds take turns
    assert len(set(done[3:6])) == 3
    measure(plan(small, tmp_path / "study", repeats=3))
    assert len(done) == 9 + 3


def test_ctrl_c_keeps_what_was_run_and_the_rest_is_done_next_time(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        done = counted(patch, stop_after=5)
        with pytest.raises(RunInterrupted, match="5 of 9 runs were done and are kept, the same command again"):
            measure(plan(small, tmp_path / "study", repeats=2))
    half = json.loads((tmp_path / "study" / "cost.json").read_text())
    assert sum(row["repeats"] for row in half["points"]) == 2 + 1  # two steps, hence one pair
    after = counted(monkeypatch)
    result = measure(plan(small, tmp_path / "study", repeats=2))
    assert len(after) == 9 - len(done)
    assert {row["repeats"] for row in result["points"]} == {2}


def test_a_run_that_was_cut_off_is_done_from_its_start(few: None, small: Scene, tmp_path: Path) -> None:
    planned = plan(small, tmp_path / "study", repeats=1)
    one, folder = planned.todo()[-1]

    record = run(one.scene, folder)
    write_status(folder, record.info | {"status": "interrupted", "wall_seconds": {"total": 99.0, "loop": 99.0}})
    measure(planned)
    assert read_status(folder)["status"] == "finished"
    assert read_status(folder)["wall_seconds"]["total"] < 99  # nothing of the time before is counted


FailWith = Callable[[GranularError | None], None]


@pytest.fixture
def fail_with(monkeypatch: pytest.MonkeyPatch) -> FailWith:
    """Let the runs with the step 0.25 raise an error; with None they are run again."""
    real = module.run_scene

    def patch(error: GranularError | None) -> None:
        def run_one(scene: Scene, folder: Path, **options: Any) -> Record:
            if error is not None and scene.time.step == 0.25:
                raise error
            return real(scene, folder, **options)

        monkeypatch.setattr(module, "run_scene", run_one)

    return patch


def test_a_run_that_fails_is_said_and_the_others_go_on(
    few: None,
    small: Scene,
    small_toml: Path,
    tmp_path: Path,
    fail_with: FailWith,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fail_with(LammpsError("for the test", "run 1", ""))
    result = measure(plan(small, tmp_path / "study", repeats=1))
    failed = {f"{row['knob']} {row['setting']}": row["message"] for row in result["points"] if not row["repeats"]}
    assert failed.keys() == {
        "time step 0.25",
        "Richardson pair 0.5 + 0.25",
        "Richardson pair 0.25 + 0.125",
    }
    assert set(failed.values()) == {"LAMMPS failed at 'run 1': for the test"}
    status, out, _ = cli(capsys, "cost", str(small_toml), "-o", str(tmp_path / "study"), "--repeats", "1")
    assert (status, out.count("LAMMPS failed at 'run 1'")) == (1, 3)
    fail_with(None)
    again = measure(plan(small, tmp_path / "study", repeats=1))
    assert [row["message"] for row in again["points"] if row["message"]] == []


def test_a_tolerance_that_is_not_met_is_an_answer_and_no_failure(
    few: None, small_toml: Path, tmp_path: Path, fail_with: FailWith, capsys: pytest.CaptureFixture[str]
) -> None:
    fail_with(ToleranceError("time.tolerance = 1e-09: not met"))
    status, out, _ = cli(capsys, "cost", str(small_toml), "-o", str(tmp_path / "study"), "--repeats", "1")
    assert (status, out.count("no step meets it: time.tolerance = 1e-09: not met")) == (0, 3)
    assert failed({"message": "LAMMPS failed"})
    assert not failed({"message": ""})
    assert not failed({"message": NOT_RUN})


# --- budget ---


def priced(small: Scene, folder: Path, monkeypatch: pytest.MonkeyPatch, **options: Any) -> module.Plan:
    """A plan for a machine that does 1e5 particle-steps a second, and takes no time beside: its clock stands still."""
    monkeypatch.setattr(module, "speed", lambda scene, kernel: (1e5, 0.0))
    monkeypatch.setattr(module, "monotonic", lambda: 0.0)
    return plan(small, folder, repeats=1, **options)


def test_the_estimate_is_of_all_runs(few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # 24 spheres, 4 samples: 1 + 2 + 4 steps to a sample, and the reference
    expected = 24 * 4 * 7 / 1e5 + sum(run.work for run in reference(small).runs) / 1e5
    assert priced(small, tmp_path / "study", monkeypatch).seconds == pytest.approx(expected)
    assert not (tmp_path / "study").exists()


def test_a_budget_leaves_out_the_dearest_first_and_says_which(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = priced(small, tmp_path / "study", monkeypatch)
    budget = whole.seconds - 0.003  # the finest run is 0.004 s of it; the pair that needs it goes first
    less = priced(small, tmp_path / "study", monkeypatch, budget=budget)
    assert less.seconds <= budget
    assert list(less.left_out) == ["Richardson pair: 0.25 + 0.125", "time step: 0.125"]
    assert all(reason.endswith("s, beyond the budget") for reason in less.left_out.values())
    assert len(whole.points) - len(less.points) == 2


def test_a_budget_below_the_reference_is_refused(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(LaunchError, match=r"budget = 1e-06: must be at least 1 s, which the reference and one"):
        priced(small, tmp_path / "study", monkeypatch, budget=1e-6)


def test_a_machine_that_got_slower_keeps_to_the_budget(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = priced(small, tmp_path / "study", monkeypatch)
    measure(replace(planned, points=[reference(small)]))
    now = iter(range(0, 10**6))  # every look at the clock is a second later
    monkeypatch.setattr(module, "monotonic", lambda: float(next(now)))
    result = measure(replace(planned, budget=4.0))
    unfinished = [f"{row['knob']}: {row['setting']}" for row in result["points"] if row["message"] == "not run yet"]
    assert 0 < len(unfinished) < len(result["points"])
    assert result["left_out"] == dict.fromkeys(unfinished, "1 of 1 rounds not run, beyond the budget")
    assert json.loads((tmp_path / "study" / "cost.json").read_text())["left_out"] == result["left_out"]
    assert text(result).count("1 of 1 rounds not run, beyond the budget") == len(unfinished)


def test_the_warm_up_is_paid_from_the_budget(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needed = priced(small, tmp_path / "study", monkeypatch).seconds
    clock = [0.0]

    def slow(scene: Scene, kernel: bool) -> tuple[float, float]:
        clock[0] += 100.0
        return 1e5, 0.0

    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module, "speed", slow)
    assert plan(small, tmp_path / "study", repeats=1, budget=100 + needed + 1e-6).left_out == {}
    with pytest.raises(LaunchError, match="must be at least 101 s"):
        plan(small, tmp_path / "study", repeats=1, budget=100.0)


def test_a_run_is_priced_by_its_own_rounds(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = priced(small, tmp_path / "study", monkeypatch)
    clock: list[float] = [0.0]
    done: list[tuple[Run, int]] = []
    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    slow, _ = planned.todo()[-1]

    def run_one(one: Run, folder: Path, kernel: bool) -> None:
        clock[0] += 50.0 if one == slow else 0.0
        done.append((one, int(folder.name)))

    monkeypatch.setattr(module, "_run", run_one)
    # The first round of the slow run ends at 50 s; a second would end at 100 s, although it was priced at 0.03 s
    result = measure(replace(planned, repeats=3, budget=99.0))
    assert [turn for one, turn in done if one == slow] == [1]
    assert sum(turn > 1 for _, turn in done) == 2 * 2  # the others go on
    assert "2 of 3 rounds not run" in result["left_out"][f"time step: {slow.scene.time.step:.4g}"]


def test_a_later_call_knows_what_a_run_took(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = priced(small, tmp_path / "study", monkeypatch)
    one, folder = planned.todo()[-1]
    record = run(one.scene, folder)
    write_status(folder, record.info | {"wall_seconds": record.info["wall_seconds"] | {"total": 7.0}})
    measure(replace(planned, points=[reference(small)]))  # makes the folder that of a study
    again = plan(small, tmp_path / "study", repeats=2)
    assert again.price(one) == 7.0
    assert again.estimate(one) < 0.1


# --- folder and command line ---


def test_a_folder_of_something_else_is_refused(small: Scene, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(RunFolderError, match="is there already; choose another folder"):
        plan(small, tmp_path)
    measure(replace(plan(small, tmp_path / "study", repeats=1), points=[reference(small)]))
    with pytest.raises(RunFolderError, match="holds a study of another scene, small"):
        plan(small.with_values({"wave.amplitude": 0.1}), tmp_path / "study")


@pytest.mark.parametrize("text", ["{", "{}", "[]", '{"scene": 1}'])
def test_a_damaged_table_is_refused_by_its_name(text: str, small: Scene, tmp_path: Path) -> None:
    (tmp_path / "cost.json").write_text(text)
    with pytest.raises(RunFolderError, match=r"cost\.json: cannot be read"):
        plan(small, tmp_path)


def test_the_command_says_how_long_and_what_is_left_out(
    few: None, small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("cost", str(small_toml), "-o", str(tmp_path / "study"), "--repeats", "1")
    status, out, _ = cli(capsys, *words)
    assert status == 0
    assert out.startswith("small: 6 settings, 6 runs, about ")
    assert "Richardson pair   0.5 + 0.25" in out
    header, *lines = out.splitlines()[1:-1]
    column = header.index("rounds") + len("rounds")
    assert {line[:column].split()[-1] for line in lines} == {"1"}
    status, out, err = cli(capsys, "cost", str(small_toml), "-o", str(tmp_path / "other"), "--budget", "1e-9")
    assert (status, out) == (2, "")
    assert "budget = 1e-09: must be at least" in err


@pytest.mark.more
def test_a_study_that_is_stopped_from_outside_goes_on(small_toml: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "granular_lmp", "cost", str(small_toml), "-o", str(tmp_path / "study")]
    with subprocess.Popen([*command, "--repeats", "40"], cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        started = time.monotonic()
        while len(list((tmp_path / "study").glob("runs/*/1/trajectory.csv"))) < 4 and time.monotonic() < started + 30:
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "interrupted" in err
    assert "the same command again does the rest" in err
    assert json.loads((tmp_path / "study" / "cost.json").read_text())["points"]


def test_a_crystal_keeps_its_size_in_every_setting() -> None:
    changes = {"packing.rows": 8, "packing.columns": 6, "packing.ends": "periodic", "disorder.radius": 5e-5}
    scene = base(PAPER.with_values(changes | {"wave.wavenumber": np.pi / 4, "time.duration": 2.0}))
    made, refused = points(scene)
    assert {"columns", "ends", "strip or sheet"} <= set(refused)
    assert {run.scene.shape for point in made for run in point.runs} == {scene.shape}
    assert "tolerance, strip" in {point.knob for point in made}
    with pytest.raises(SceneError, match="must be a running plane wave along y"):
        base(scene.with_values({"wave.form": "standing"}))


# --- a scene without a wave ---

CHAIN = ImpactScene.load("solitary_chain").with_values(
    {"packing.rows": 12, "packing.last": "free", "time.duration": 20.0, "time.sample": 1.0}
)


@pytest.fixture(scope="module")
def struck(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """All knobs of a struck chain, one round."""
    folder = tmp_path_factory.mktemp("cost") / "struck"
    return folder, measure(plan(CHAIN, folder, repeats=1))


def test_the_errors_are_those_against_theory(struck: tuple[Path, dict[str, Any]]) -> None:
    folder, result = struck
    start = np.eye(12)[0]
    _, exact = integrate(uniform(12), 0 * start, start, np.arange(1.0, 21.0), 1e-11)
    left = result["reference"]["error_velocity"]
    assert left < 1e-8
    found, records = rows(result, "time step"), [*map(load, folder.glob("runs/*/1"))]
    stepped = {f"{each.scene.time.step:.4g}": each for each in records if each.scene.time.tolerance is None}
    for step, row in found.items():
        record = stepped[step]
        assert isinstance(record, ImpactRecord)
        true = np.max(np.abs(record.velocity[1:, :, 1] - exact))
        assert row["error_velocity"] == pytest.approx(true, abs=2 * left)
    assert [row["slope"] for row in found.values()][1:] == pytest.approx([-2] * 5, abs=0.1)
    assert all(row["error_spin"] is None for row in found.values())  # nothing turns a sphere of a chain


def test_a_tolerance_is_met_and_pairs_are_better(struck: tuple[Path, dict[str, Any]]) -> None:
    _, result = struck
    for tolerance, row in rows(result, "tolerance, strip").items():
        assert row["error_velocity"] < float(tolerance)
    single = [row["error_velocity"] for row in rows(result, "time step").values()][1:]
    paired = [row["error_velocity"] for row in rows(result, "Richardson pair").values()]
    assert all(pair < one / 5 for pair, one in zip(paired, single, strict=True))


def test_what_a_strike_has_not_is_left_out_by_name(struck: tuple[Path, dict[str, Any]]) -> None:
    folder, result = struck
    missing = {"columns", "ends", "output", "effects", "strip or sheet"}
    assert {row["knob"] for row in result["points"]} == set(KNOBS) - missing
    assert set(result["left_out"]) >= missing
    with (folder / "cost.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [float(line["error_velocity"]) for line in table] == [row["error_velocity"] for row in result["points"]]
    assert "velocity" in text(result).splitlines()[0]
    assert plan(CHAIN, folder, repeats=1).todo() == []  # the same study is done
    best, fine = read_status(folder / "reference")["error_estimate"], result["reference"]["error_velocity"]
    assert best["velocity"] == fine
