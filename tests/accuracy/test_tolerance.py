"""A tolerance is met, the estimate is honest, and what nothing can meet is refused.

tests/accuracy/test_tolerance_of_many_waves.py does so for many waves, without LAMMPS.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.norms import relative_error
from granular_analysis.theory import wave as theory
from granular_lmp import Record, Scene, cli, resume, run
from granular_lmp.accuracy import extrapolation
from granular_lmp.accuracy.estimates import FINEST, combined_record, judge
from granular_lmp.accuracy.extrapolation import EVEN, Judgement
from granular_lmp.accuracy.ladder import (
    COARSE,
    RUNGS,
    deciding_frequency,
    pair_error,
    plan,
    planned_steps,
)
from granular_lmp.accuracy.noise import counted, lost, noise_of
from granular_lmp.accuracy.refinement import refine
from granular_lmp.accuracy.rounding import floor, linear_signals, rounding
from granular_lmp.errors import EffectError, RunFolderError, RunInterrupted, SceneError, ToleranceError
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.held import largest_step
from granular_lmp.rest.step_rules import COARSEST
from granular_lmp.runs.record import read_status
from tests.conftest import PAPER
from tests.manual import Measure, Mutant, verifies
from tests.pause import paused
from tests.stepped import limit, stepped
from tests.stepped_waves import NAMES, Stepped, Wave, in_lammps, scene_of

# --- LAMMPS itself ---------------------------------------------------------------------------------------------------


def periodic(name: str, rows: int, waves: int, amplitude: float, **more: Any) -> Scene:
    """A wave of which a whole number fits into a periodic cell, for 60 τ."""
    return PAPER.with_values(
        {
            "packing.rows": rows,
            "packing.ends": "periodic",
            "wave.mode": name,
            "wave.wavenumber": 2 * np.pi * waves / rows,
            "wave.amplitude": amplitude,
            "time.duration": 60.0,
        }
        | {key.replace("_", ".", 1): value for key, value in more.items()}
    )


def described(scene: Scene) -> Wave:
    wave = scene.wave
    return wave.mode, scene.wavenumber, wave.amplitude, scene.sphere.poisson_ratio


def wave_of(scene: Scene) -> theory.Wave:
    return in_lammps(described(scene), scene.sphere.overlap_ratio)


def errors_of(record: Record, reference: np.ndarray) -> dict[str, float]:
    """Relative errors of a record, of p alone for L."""
    names = NAMES[:1] if record.scene.wave.mode == "L" else NAMES
    return {name: relative_error(getattr(record, name), reference[:, NAMES.index(name)]) for name in names}


@pytest.mark.parametrize(
    ("scene", "per_sample"),
    [
        (periodic("TR", 16, 2, 0.2), 3),
        (periodic("RT", 16, 2, 0.2), 8),
        (periodic("L", 26, 9, 0.1, sphere_poisson_ratio=-0.5), 2),
    ],
    ids=["TR", "RT", "L"],
)
def test_the_stepped_lattice_is_lammps(scene: Scene, per_sample: int, tmp_path: Path) -> None:
    record = run(scene.with_values({"time.timestep": 0.5 / per_sample}), tmp_path / "run")
    model, other = (stepped([wave_of(scene)], per_sample + more, records=scene.time.samples)[0] for more in (0, 1))
    for name, error in errors_of(record, model).items():
        # Rounding of positions of 1e4 nm, largest beside the p of RT (1e-4 of D0)
        assert error < (3e-6 if name == "p" else 1e-8), name
        assert errors_of(record, other)[name] > 1e-4  # another step is seen


@pytest.mark.parametrize(
    ("scene", "tolerance"),
    [
        (periodic("TR", 16, 2, 0.2), 1e-3),
        (periodic("TR", 16, 2, 0.2), 1e-4),
        pytest.param(periodic("TR", 34, 8, 0.3), 1e-3, marks=pytest.mark.more),  # next to the resonance
        pytest.param(periodic("RT", 16, 6, 0.3), 1e-3, marks=pytest.mark.more),
        (periodic("L", 16, 4, 0.2, sphere_poisson_ratio=0.45), 1e-4),
        (periodic("L", 8, 3, 0.4), 1e-5),  # what the slip turned in first order does to the wave itself
        (periodic("TR", 8, 4, 0.4), 1e-4),
    ],
    ids=["TR 1e-3", "TR 1e-4", "TR resonant", "RT", "L", "L 1e-5", "TR at pi"],
)
@verifies(
    "Tolerance: seven waves in LAMMPS, the largest error over the tolerance",
    reference="other integrator: the exact lattice in LAMMPS's geometry",
    tolerance=1.0,
    reason="the promise: no signal errs by more than the tolerance",
    mutant=Mutant(
        "granular_lmp/accuracy/extrapolation.py",
        "weights[finest] = weights_of(",
        "weights[finest] = 0.999 * weights_of(",
    ),
)
def test_lammps_meets_a_tolerance(scene: Scene, tolerance: float, tmp_path: Path, measured: Measure) -> None:
    scene = scene.with_values({"time.tolerance": tolerance})
    record = run(scene, tmp_path / "run")
    estimated = record.info["error_estimate"]
    (exact,) = limit([wave_of(scene)], record.tau)
    found = errors_of(record, exact)
    found = {name: error for name, error in found.items() if estimated[name] is not None}  # the others vanish at π
    measured(max(found.values()) / tolerance)
    assert record.info["tolerance"] == tolerance
    for name, error in found.items():
        assert error < 1.1 * estimated[name] or error < 0.03 * tolerance
    again = Record.load(tmp_path / "run")
    assert again.scene == prepare(scene).scene
    assert again.p.tolist() == record.p.tolist()


def test_a_ladder_that_begins_too_coarse_goes_on_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    # At the antiresonance p is of fourth order: it holds waves of higher frequency than linear theory gives
    scene = periodic("TR", 62, 21, 0.2, time_tolerance=1e-3, time_duration=20.0)
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    assert cli.main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "run")]) == 0
    said = capsys.readouterr()
    assert "one run more" in said.err
    assert "(tolerance 0.001)" in said.out
    record = Record.load(tmp_path / "run")
    assert len(list((tmp_path / "run").glob("*_per_sample"))) == RUNGS + len(record.info["refinements"])
    (exact,) = limit([wave_of(scene)], record.tau)
    assert max(errors_of(record, exact).values()) <= 1e-3


def test_the_rounding_of_what_a_mirror_makes_zero_is_no_signal(tmp_path: Path) -> None:
    scene = periodic("L", 200, 26, 1e-5, time_tolerance=5e-2, time_duration=30.0)
    record = run(scene, tmp_path / "run")
    assert np.max(np.abs(record.q)) > 0
    assert record.info["error_estimate"]["q"] is None
    assert record.info["error_budget"][2]["q"] is None


def test_a_folder_that_is_there_is_run_again_only_by_force(tmp_path: Path) -> None:
    scene = periodic("TR", 16, 2, 0.2, time_tolerance=1e-3)
    (tmp_path / "run").mkdir()
    (tmp_path / "run/mine").write_text("kept")
    with pytest.raises(RunFolderError, match="exists already"):
        run(scene, tmp_path / "run")
    run(scene.with_values({"time.tolerance": 1e-2}), tmp_path / "run", force=True)
    record = run(scene, tmp_path / "run", force=True)
    steps = [Record.load(folder).scene.time.step for folder in (tmp_path / "run").glob("*_per_sample")]
    assert sorted(steps, reverse=True)[-3:] == record.info["extrapolated_from"]
    assert max(steps) == scene.time.sample / plan(prepare(scene))[0]  # none of the first run is left
    assert (tmp_path / "run/mine").read_text() == "kept"


# --- looks -----------------------------------------------------------------------------------------------------------


def looking(folder: Path) -> dict[str, bool]:
    """Return for each run of a ladder whether it looked for the effects that it leaves out."""
    infos = {path.name.split("_")[0]: read_status(path) for path in folder.glob("*_per_sample")}
    assert all(bool(info["looks"]) == bool(info["guards"]) for info in infos.values())
    return {count: bool(info["looks"]) for count, info in infos.items()}


def test_a_contact_that_opens_in_a_coarse_run_alone_does_not_fail_a_ladder(tmp_path: Path) -> None:
    scene = periodic("L", 8, 3, 0.525, time_duration=30.0)
    with pytest.raises(EffectError, match="contact_opening"):
        run(scene.with_values({"time.timestep": 0.5}), tmp_path / "coarse")
    record = run(scene.with_values({"time.tolerance": 5e-2}), tmp_path / "run")
    assert looking(tmp_path / "run") == {"1": False, "2": False, "3": True}
    (exact,) = limit([wave_of(scene)], record.tau)
    assert errors_of(record, exact)["p"] < 5e-2


def test_a_contact_that_opens_in_the_finest_run_fails_a_ladder(tmp_path: Path) -> None:
    scene = periodic("L", 8, 4, 0.555, time_duration=30.0, time_tolerance=5e-2)
    with pytest.raises(EffectError, match="contact_opening"):
        run(scene, tmp_path / "run")
    assert read_status(tmp_path / "run")["status"] == "failed"


def test_only_runs_that_may_be_the_finest_look(tmp_path: Path) -> None:
    run(periodic("TR", 16, 2, 0.2, time_tolerance=1e-2), tmp_path / "run")
    assert looking(tmp_path / "run") == {"1": False, "2": False, "3": True}
    coarse, finest = (next((tmp_path / f"run/{count}_per_sample").glob("in.*")).read_text() for count in (1, 3))
    assert "v_overlap" in finest
    assert not {"v_overlap", "INVALID"} & set(re.findall(r"\w+", coarse))
    # Two steps to a sample are enough, and that run is made again
    twice = run(Scene.load("l_chain").with_values({"time.tolerance": 1e-2}), tmp_path / "short")
    assert looking(tmp_path / "short") == {"1": False, "2": True}
    assert twice.info["steps"] == (1 + 2 + 2) * twice.scene.time.samples


def test_a_coarse_run_that_was_stopped_goes_on_without_looks(tmp_path: Path) -> None:
    scene = periodic("TR", 16, 2, 0.2, time_tolerance=5e-2)
    whole = run(scene, tmp_path / "whole")
    with paused(tmp_path / "run/1_per_sample"), pytest.raises(RunInterrupted):
        run(scene, tmp_path / "run")
    assert not any(looking(tmp_path / "run").values())
    assert list((tmp_path / "run").glob("1_per_sample/checkpoint.*"))
    record = resume(tmp_path / "run")
    assert np.max(np.abs(record.p - whole.p)) < 1e-9
    assert looking(tmp_path / "run") == looking(tmp_path / "whole")


# --- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"wave.mode": "L", "wave.amplitude": 1e-8, "time.tolerance": 1e-3},
            r"time\.tolerance = 0\.001: .* the error from rounding .* wave\.amplitude",
        ),
        (
            {"wave.mode": "L", "time.tolerance": 1e-7},
            r"time\.tolerance = 1e-07: must be at least 1e-06, the error from walls",
        ),
    ],
)
def test_a_tolerance_below_the_floor_of_the_linear_wave_is_refused_before_anything_is_written(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        run(PAPER.with_values(changes), tmp_path / "run")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists()


@pytest.mark.more
def test_a_signal_that_rounding_keeps_above_the_tolerance_does_not_count(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    # A burst of a wave so small that 3 % of its second harmonic is rounding, more with shorter steps
    changes = {"time.tolerance": 1e-2, "time.duration": 150.0, "output.particles": 0.0}
    scene = Scene.load("tr_burst_scattering").with_values(changes)
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    assert cli.main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "run")]) == 0
    record = Record.load(tmp_path / "run")
    assert list(record.info["noise"]) == ["p"]
    assert record.info["noise"]["p"] > 1e-2 / 3
    estimated = record.info["error_estimate"]
    assert max(estimated["q"], estimated["phi"]) <= 1e-2
    assert estimated["p"] > 0  # it is estimated all the same
    assert len(list((tmp_path / "run").glob("*_per_sample"))) <= RUNGS
    said = capsys.readouterr().err
    assert "p (" in said
    assert "is not counted; use a larger wave.amplitude or fewer packing.rows" in said
    # The remedy is true: p is in proportion to the amplitude, and rounding to its inverse
    louder = run(scene.with_values({"wave.amplitude": 0.02}), tmp_path / "louder")
    assert louder.info["noise"] == {}
    assert louder.info["error_estimate"]["p"] <= 1e-2


def test_what_rounding_drowns_at_the_step_that_it_needs_is_not_chased(tmp_path: Path) -> None:
    # phix errs by 0.017 after three runs, falls with the first power of the step, and rounding rises as it falls
    wave = {"wave.mode": "H1", "wave.wavenumber": 1.9634954084936207, "wave.amplitude": 0.0567, "wave.phase": 0.0345}
    crystal = {"packing.lattice": "square", "packing.rows": 16, "sphere.poisson_ratio": 0.3}
    scene = Scene.load("monolayer_rocking").with_values(wave | crystal | {"time.tolerance": 1e-3})
    record = run(scene, tmp_path / "run")
    assert len(list((tmp_path / "run").glob("*_per_sample"))) == RUNGS
    assert "phix" in record.info["noise"]
    assert record.info["noise"]["phix"] > 1e-3
    assert max(each for each in record.info["error_estimate"].values() if each is not None) <= 1e-3


def test_a_signal_is_lost_where_noise_alone_would_be_estimated_above_the_tolerance() -> None:
    random = np.random.default_rng(1)
    runs = [{"p": random.standard_normal(10_000)} for _ in range(3)]
    silent = {"p": 0.0}  # no error of first order
    seen = extrapolation.judge(runs, (4, 5, 8), 2, hidden=silent, relative=False).errors["p"] / 100  # root of 10,000
    finest = prepare(PAPER.with_values({"time.timestep": 0.01}))
    signals = {name: size * np.cos(np.arange(200)) for name, size in {"p": 1e-3, "q": 1.0, "phi": 1.0}.items()}
    noise = noise_of(finest, signals)["p"]
    # It is 2.8 of the noise, and 3 are said
    for share, found in ((0.8, {"p": noise}), (1.25, {})):
        asked = prepare(PAPER.with_values({"time.tolerance": share * seen * noise}))
        assert lost(asked, signals, finest) == found


def test_where_rounding_leaves_nothing_the_tolerance_is_refused_after_one_run(tmp_path: Path) -> None:
    # The wave is not at the centre sphere yet
    changes = {"time.tolerance": 1e-2, "time.duration": 10.0, "output.particles": 0.0}
    scene = Scene.load("tr_burst_scattering").with_values(changes)
    with pytest.raises(
        ToleranceError, match="rounding alone makes larger errors in all recorded signals.* wave.amplitude"
    ) as caught:
        run(scene, tmp_path / "run")
    assert "\n" not in str(caught.value)
    assert len(list((tmp_path / "run").glob("*_per_sample"))) == 1
    assert read_status(tmp_path / "run")["status"] == "failed"
    near = {"name": "near", "rows": [42, 42]}
    assert run(scene.with_values({"monitor": [near]}), tmp_path / "near").info["errors_of_monitors"]["near.u"] <= 1e-2


def test_the_law_of_rounding_is_lammps_s_within_a_factor_of_three(tmp_path: Path) -> None:
    # 201 rows at a = 0.01, where 2e-5 of p is rounding; against the same steps without LAMMPS
    scene = PAPER.with_values({"wave.amplitude": 0.01, "time.timestep": 0.1, "time.duration": 60.0})
    record = run(scene, tmp_path / "run")
    (model,) = stepped([wave_of(scene)], 5, records=120)
    assert 1 / 3 < errors_of(record, model)["p"] / rounding(prepare(scene), record.signals)["p"] < 3


def test_a_periodic_cell_has_no_walls_and_little_rounding() -> None:
    cell, paper = prepare(periodic("TR", 16, 2, 0.2)), prepare(PAPER)
    waves = linear_signals(paper) | {"p": np.array([1e-3, -1e-3])}
    assert floor(cell, waves)["walls"] == 0.0
    assert floor(cell, waves)["rounding"] < floor(paper, waves)["rounding"] / 10


def test_timestep_and_tolerance_exclude_each_other() -> None:
    message = r"time\.tolerance = 0\.001: excludes time\.timestep = 0\.05; give one of the two"
    with pytest.raises(SceneError, match=message):
        Scene.loads(PAPER.to_toml(full=True).replace("[time]\n", "[time]\ntolerance = 1e-3\n"))
    with pytest.raises(SceneError, match=message):
        PAPER.with_values({"time.tolerance": 1e-3, "time.timestep": 0.05})
    asked = PAPER.with_values({"time.tolerance": 1e-3})
    assert "timestep =" not in asked.to_toml(full=True)
    assert Scene.loads(asked.to_toml()) == asked
    assert asked.with_values({"time.timestep": 0.05}) == PAPER
    with pytest.raises(SceneError, match="no time step until one is chosen"):
        _ = asked.time.step
    with pytest.raises(SceneError, match=r"time\.tolerance = 0\.5: must be a number in"):
        PAPER.with_values({"time.tolerance": 0.5})


# --- the choice and the estimate -------------------------------------------------------------------------------------


@pytest.mark.parametrize("sample", [0.05, 0.5, 3.0])
def test_the_steps_fit_the_sample_and_are_the_largest_that_do(sample: float) -> None:
    scene = PAPER.with_values({"time.sample": sample, "time.tolerance": 1e-5})
    problem = prepare(scene)
    count, frequency = plan(problem)[0], deciding_frequency(problem)
    assert plan(problem) == (count, 2 * count, 4 * count)
    assert planned_steps(problem) == 7 * count * scene.time.samples

    def expected(count: int) -> float:
        return pair_error(frequency, sample / (2 * count), scene.time.duration) / COARSE

    assert expected(count) <= 1e-5
    if count > 1 and sample / (count - 1) < COARSEST * largest_step(problem.scene):
        assert expected(count - 1) > 1e-5


def test_the_deciding_frequency_is_of_the_drive_or_of_the_free_wave() -> None:
    # TR at 0.802: |sin ξ| of L at 2ξ against 2^{1/3} 0.277; RT: 2^{1/3} 1.788
    rotational = prepare(PAPER.with_values({"wave.mode": "RT"}))
    assert deciding_frequency(prepare(PAPER)) == pytest.approx(np.sin(0.802), rel=1e-3)
    assert deciding_frequency(rotational) == pytest.approx(2 ** (1 / 3) * 1.788, rel=1e-3)


@pytest.mark.parametrize(
    "changes",
    [
        {"wave.wavenumber": np.pi},
        {"wave.wavenumber": np.pi, "wave.mode": "RT"},
        {"wave.wavenumber": np.pi, "wave.mode": "L"},
        {"wave.wavenumber": 1e-3, "wave.phase": 1.0},
        {"time.duration": 0.5},
        {"time.duration": 1e6, "time.allow_echo": True, "wave.wavenumber": 0.05},
        {"effects.rotation": False},
    ],
    ids=lambda value: str(sorted(value) if isinstance(value, set) else value),
)
def test_a_step_is_found_at_the_edges_of_what_a_scene_may_be(changes: dict[str, Any]) -> None:
    problem = prepare(PAPER.with_values({"time.tolerance": 1e-2} | changes))
    assert 0 < problem.scene.time.sample / plan(problem)[0] <= COARSEST * largest_step(problem.scene)


def test_a_step_too_small_is_refused() -> None:
    changes = {"time.duration": 1e7, "time.allow_echo": True, "time.tolerance": 1e-9, "wave.mode": "RT"}
    with pytest.raises(SceneError, match=r"time\.tolerance = 1e-09: would take more than 1000000000 steps"):
        plan(prepare(PAPER.with_values(changes)))


def test_a_deck_of_a_scene_with_a_tolerance_is_the_finest_run(capsys: pytest.CaptureFixture, tmp_path: Path) -> None:
    asked = ["tr_periodic", "--set", "time.tolerance=1e-3"]
    assert cli.main(["build", *asked, "-o", str(tmp_path / "deck")]) == 0
    problem = prepare(Scene.load("tr_periodic").with_values({"time.tolerance": 1e-3}))
    step = problem.scene.time.sample / plan(problem)[-1]
    assert Scene.load(tmp_path / "deck").time.tolerance == 1e-3
    assert f"variable timestep  index {step!r}" in (tmp_path / "deck" / "in.tr_periodic").read_text()
    assert cli.main(["effects", *asked]) == 0


@pytest.fixture(scope="module")
def pair() -> tuple[Scene, Callable[[int], Record]]:
    """A scene whose runs, by steps per sample, err as c h² on top of a wave."""
    scene = periodic("TR", 16, 2, 0.2, time_tolerance=1e-3)
    wave = described(scene)
    runs = Stepped({wave: scene.time.samples})
    return scene, lambda count: runs.record(scene.with_values({"time.timestep": 0.5 / count}), wave)


def judged(runs: list[Record]) -> Judgement:
    """Return what a ladder says of runs."""
    counts = [run.scene.time.steps_per_sample for run in runs]
    return judge(runs[-1].problem, [run.signals for run in runs], counts)


def answer(runs: list[Record]) -> Record:
    return combined_record(runs, judged(runs))


def test_free_waves_that_coarse_steps_do_not_resolve_are_in_the_estimate() -> None:
    # φ of a long TR wave holds RT waves of third order, of which second-order theory knew nothing: too small by 240
    wave: Wave = ("TR", 0.3, 0.3, 0.0)
    runs, scene = Stepped(), scene_of(wave, 1e-3)

    def at(*counts: int) -> list[Record]:
        return [runs.record(scene.with_values({"time.timestep": 0.5 / count}), wave) for count in counts]

    exact = answer(at(16, 32, 64)).phi
    for counts in ((1, 2, 4, 8), (2, 4, 8, 16)):
        found = at(*counts)
        assert judged(found).errors["phi"] > relative_error(answer(found).phi, exact)


def test_one_run_tells_nothing(pair: tuple[Scene, Callable[[int], Record]]) -> None:
    _, at = pair
    assert judged([at(3)]).errors == dict.fromkeys(NAMES, np.inf)


def test_a_signal_that_is_not_finite_is_not_taken_for_a_good_one(
    pair: tuple[Scene, Callable[[int], Record]],
) -> None:
    _, at = pair
    broken = at(6).with_signals(p=np.where(at(6).tau > 1, np.nan, at(6).p))
    assert not judged([at(3), broken]).errors["p"] <= 1.0
    untracked = [at(count).with_signals(phi=np.full_like(at(count).tau, np.nan)) for count in (3, 6)]
    assert set(counted(untracked[-1].problem, dict(untracked[-1].signals))) == {"p", "q"}


def test_effects_decide_the_order_of_the_answer(pair: tuple[Scene, Callable[[int], Record]]) -> None:
    _, at = pair
    runs = [at(count) for count in (3, 6, 12, 24)]

    def powers(**changes: Any) -> tuple[int, ...]:
        named = {key.replace("_", ".", 1): value for key, value in changes.items()}
        errs = 1.0 if named else 0.0
        return judged(
            [
                replace(
                    r.with_signals(q=r.q + errs * r.scene.time.step + errs * r.scene.time.step**2),
                    scene=r.scene.with_values(named),
                )
                for r in runs
            ]
        ).powers

    assert powers() == EVEN
    assert 1 in powers(effects_damping=True, effects_viscosity=1e-8)
    assert powers(effects_contact_opening=True) == powers(effects_sliding=True, effects_friction=0.1) == ()


def test_a_tolerance_that_no_step_meets_is_an_error_that_says_what_was_reached(
    pair: tuple[Scene, Callable[[int], Record]], tmp_path: Path
) -> None:
    scene, at = pair
    noise = np.random.default_rng(1)

    def one(stepping: Problem, *_: Any) -> Record:
        record = at(3)  # whatever the step
        q = record.q + 0.01 * noise.standard_normal(len(record.q))
        return replace(record.with_signals(q=q), scene=stepping.scene)

    (tmp_path / "scene.toml").write_text(scene.to_toml())
    with pytest.raises(ToleranceError, match=r"time\.tolerance = 0\.001: not met with steps down to .* of q") as caught:
        refine(prepare(scene), tmp_path, one, None, {})
    assert "\n" not in str(caught.value)
    assert read_status(tmp_path)["status"] == "failed"
    first = scene.time.sample / plan(prepare(scene))[0]
    assert first / FINEST <= float(str(caught.value).split()[9]) < first / 4
