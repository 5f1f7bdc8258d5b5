"""A tolerance is met, at next to the least cost, and refused where nothing can meet it.

The grid runs on `analysis.timestep.stepped`, which is LAMMPS without LAMMPS, as a test here checks; the
runs of LAMMPS after it go the whole way.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis import timestep
from analysis.norms import relative_error
from analysis.timestep import Wave, extrapolated, limit, stepped
from granular_lmp import Record, Scene, cli, run
from granular_lmp.accuracy.step_law import floor, rounding, sizes, step_errors, step_for, with_step
from granular_lmp.accuracy.tolerance import estimate, refine, resume
from granular_lmp.effects.table import largest_step, resolve
from granular_lmp.errors import RunFolderError, RunInterrupted, SceneError, ToleranceError
from granular_lmp.runs.record import read_status
from tests.conftest import PAPER

NAMES = ("p", "q", "phi")
TOLERANCES = (1e-2, 1e-3, 1e-4)
WAVENUMBERS = (0.3, 0.802, 1.475, 2.127, 2.8)
AMPLITUDES = (0.2, 0.02, 0.3, 0.1)
# Modes × ξ with every second ν, the amplitudes in turn. ξ = 2.127 at ν = 0.17 is the antiresonance
GRID: list[Wave] = [
    (name, xi, AMPLITUDES[(i + j + k) // 2 % 4], nu)  # type: ignore[misc]  # the names are those of modes
    for i, name in enumerate(("TR", "RT", "L"))
    for j, xi in enumerate(WAVENUMBERS)
    for k, nu in enumerate((-0.5, 0.0, 0.17, 0.45))
    if (i + j + k) % 2
]
# Of 0.5 τ each. RT takes the smallest steps, and most of the time as it is
RECORDS = {wave: 240 if wave[0] != "RT" and index % 4 == 0 else 120 for index, wave in enumerate(GRID)}


def scene_of(wave: Wave, tolerance: float) -> Scene:
    """The scene of a wave of the grid; E is such that the overlap is the paper's for every ν."""
    name, xi, amplitude, nu = wave
    return PAPER.with_values(
        {
            "wave.mode": name,
            "wave.wavenumber": xi,
            "wave.amplitude": amplitude,
            "sphere.poisson_ratio": nu,
            "sphere.youngs_modulus": 73e9 * (1 - nu**2) / (1 - 0.17**2),
            "time.duration": timestep.SAMPLE * RECORDS[wave],
            "time.tolerance": tolerance,
        }
    )


class Stepped:
    """Trajectories of waves by steps per sample, computed side by side and kept."""

    def __init__(self) -> None:
        self.kept: dict[tuple[Wave, int], np.ndarray] = {}
        self.limits: dict[Wave, np.ndarray] = {}

    def prepare(self, wanted: Iterable[tuple[Wave, int]]) -> None:
        missing = sorted(set(wanted) - set(self.kept))
        for count in sorted({count for _, count in missing}):
            waves = [wave for wave, other in missing if other == count]
            records = max(RECORDS[wave] for wave in waves)
            for wave, record in zip(waves, stepped(waves, count, records=records, points=17), strict=True):
                self.kept[wave, count] = record[: RECORDS[wave] + 1]

    def single(self, wave: Wave, count: int) -> np.ndarray:
        self.prepare([(wave, count)])
        return self.kept[wave, count]

    def error(self, wave: Wave, record: np.ndarray) -> float:
        """The largest of the errors of p, q, φ."""
        if wave not in self.limits:
            # With rtol = 1e-9 the steps are at the edge of stability where L is small, and rounding of φ grows to 4e-7
            self.limits[wave] = limit(wave, timestep.TAU[: len(record)], rtol=1e-10)
        return max(timestep.errors(record, self.limits[wave]))

    def record(self, scene: Scene, wave: Wave) -> Record:
        """As if LAMMPS had run the scene."""
        p, q, phi = self.single(wave, scene.time.steps_per_sample).T
        info = {
            "steps": scene.time.steps,
            "samples": len(p),
            "wall_seconds": dict.fromkeys(("total", "loop", "other"), 0.0),
        }
        return Record(timestep.SAMPLE * np.arange(len(p)), p, q, phi, scene, info)


@dataclass(frozen=True)
class Outcome:
    """What one case came to; costs in steps a sample."""

    wave: Wave
    tolerance: float
    error: float
    estimate: float
    cost: int
    cheaper: bool  # a setting of less than half the cost meets the tolerance


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> list[Outcome]:
    """Every wave of the grid at every tolerance, through `refine`."""
    runs, found = Stepped(), []
    # At a = 0.02 the antiresonance holds an error of first order that takes steps of 1e-3 τ for 1e-3 and less
    cases = [
        (wave, tolerance) for wave in GRID for tolerance in TOLERANCES
        if not (wave[0] == "TR" and wave[1] == 2.127 and wave[3] == 0.17 and tolerance < 1e-2)
    ]  # fmt: skip
    chosen = {case: round(0.5 / step_for(scene_of(*case))) for case in cases}
    runs.prepare((wave, factor * chosen[wave, tolerance]) for wave, tolerance in cases for factor in (1, 2))
    halves: list[tuple[Wave, float, dict[str, Any], int]] = []
    for wave, tolerance in cases:
        folder = tmp_path_factory.mktemp("case")
        scene = scene_of(wave, tolerance)
        (folder / "scene.toml").write_text(scene.to_toml())
        record = refine(scene, folder, lambda stepping, *_, wave=wave: runs.record(stepping, wave), None, {})
        halves.append((wave, tolerance, record.info, record.info["steps"] // scene.time.samples))
        error = runs.error(wave, np.column_stack([record.p, record.q, record.phi]))
        found.append((error, max(value for value in record.info["error_estimate"].values() if value is not None)))

    def less(cost: int) -> tuple[int, int]:
        """Steps a sample of the dearest pair and single run below half of a cost."""
        return (ceil(cost / 2) - 1) // 3, ceil(cost / 2) - 1

    runs.prepare(
        (wave, count)
        for wave, _, _, cost in halves
        for pair, one in [less(cost)]
        for count in (pair, 2 * pair, one)
        if count
    )
    results = []
    for (wave, tolerance, _, cost), (error, estimated) in zip(halves, found, strict=True):
        pair, one = less(cost)
        cheaper = [runs.single(wave, one)] if one else []
        cheaper += [extrapolated(runs.single(wave, pair), runs.single(wave, 2 * pair))] if pair else []
        enough = any(runs.error(wave, record) <= tolerance for record in cheaper)
        results.append(Outcome(wave, tolerance, error, estimated, cost, enough))
    return results


def test_the_grid_holds_thirty_waves_and_every_value_of_each_axis(outcomes: list[Outcome]) -> None:
    assert len(GRID) == len(set(GRID)) == 30
    assert len(outcomes) == 88
    for axis, size in enumerate((3, 5, 4, 4)):
        assert len({outcome.wave[axis] for outcome in outcomes}) == size


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_every_wave_of_the_grid_meets_its_tolerance(tolerance: float, outcomes: list[Outcome]) -> None:
    missed = [o for o in outcomes if o.tolerance == tolerance and not o.error <= tolerance]
    assert not missed


@pytest.mark.parametrize("tolerance", TOLERANCES)
def test_four_in_five_cost_at_most_twice_the_cheapest(tolerance: float, outcomes: list[Outcome]) -> None:
    dear = [o.cheaper for o in outcomes if o.tolerance == tolerance]
    print(tolerance, len(dear), np.mean(dear), [o for o in outcomes if o.tolerance == tolerance and o.cheaper])
    assert np.mean(dear) <= 0.2


def test_the_estimate_is_no_less_than_the_error(outcomes: list[Outcome]) -> None:
    # Third order reaches φ of long TR waves first, where it is far below the tolerance: those are left out. The lowest
    # ratio measured over 178 cases of 60 waves is 0.87
    judged = [o.estimate / o.error for o in outcomes if o.error > 0.03 * o.tolerance]
    assert len(judged) > 60
    assert min(judged) > 0.8


# --- LAMMPS itself ---------------------------------------------------------------------------------------------------


def periodic(name: str, rows: int, waves: int, amplitude: float, **more: Any) -> Scene:
    """A wave of which a number fits into a periodic cell, 60 τ."""
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


def wave_of(scene: Scene) -> Wave:
    wave = scene.wave
    return wave.mode, scene.wavenumber, wave.amplitude, scene.sphere.poisson_ratio  # type: ignore[return-value]


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
    record = run(with_step(scene, 0.5 / per_sample), tmp_path / "run")
    options = {"records": scene.time.samples, "overlap_ratio": scene.sphere.overlap_ratio}
    (model,) = stepped([wave_of(scene)], per_sample, **options)  # type: ignore[arg-type]
    (other,) = stepped([wave_of(scene)], per_sample + 1, **options)  # type: ignore[arg-type]
    for name, error in errors_of(record, model).items():
        # Rounding of positions of 1e4 nm, of the p of RT (1e-4 of D0) the most
        assert error < (3e-6 if name == "p" else 1e-8), name
        assert errors_of(record, other)[name] > 1e-4  # another step is seen


@pytest.mark.parametrize(
    ("scene", "tolerance"),
    [
        (periodic("TR", 16, 2, 0.2), 1e-3),
        (periodic("TR", 16, 2, 0.2), 1e-4),
        (periodic("TR", 34, 8, 0.3), 1e-3),  # next to the resonance
        (periodic("RT", 16, 6, 0.3), 1e-3),
        (periodic("L", 16, 4, 0.2, sphere_poisson_ratio=0.45), 1e-4),
        (periodic("L", 8, 3, 0.4), 1e-5),  # what the slip turned in first order does to the wave itself
        (periodic("TR", 8, 4, 0.4), 1e-4),
    ],
    ids=["TR 1e-3", "TR 1e-4", "TR resonant", "RT", "L", "L 1e-5", "TR at pi"],
)
def test_lammps_meets_a_tolerance(scene: Scene, tolerance: float, tmp_path: Path) -> None:
    scene = scene.with_values({"time.tolerance": tolerance})
    record = run(scene, tmp_path / "run")
    estimated = record.info["error_estimate"]
    found = errors_of(record, limit(wave_of(scene), record.tau, scene.sphere.overlap_ratio))
    found = {name: error for name, error in found.items() if estimated[name] is not None}  # the others vanish at π
    assert max(found.values()) <= tolerance
    assert record.info["tolerance"] == tolerance
    for name, error in found.items():
        assert error < 1.1 * estimated[name] or error < 0.03 * tolerance
    again = Record.load(tmp_path / "run")
    assert again.scene == resolve(scene)[0]
    assert again.p.tolist() == record.p.tolist()


def test_a_pair_that_the_law_misjudged_is_refined_and_said_so(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    # At the antiresonance p is of fourth order, and holds waves that the law does not know
    scene = periodic("TR", 62, 21, 0.2, time_tolerance=1e-2)
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    assert cli.main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "run")]) == 0
    said = capsys.readouterr()
    assert "halved" in said.err
    assert "(tolerance 0.01)" in said.out
    record = Record.load(tmp_path / "run")
    assert len(list((tmp_path / "run").glob("*_per_sample"))) == 2 + len(record.info["refinements"])
    exact = limit(wave_of(scene), record.tau, scene.sphere.overlap_ratio)
    assert max(errors_of(record, exact).values()) <= 1e-2


# Long enough for the display, which looks ten times a second, to come in between
LONG = periodic("TR", 16, 2, 0.2, time_tolerance=1e-2, time_duration=2500.0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The trajectory of LONG, run without a stop."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    run(LONG, folder)
    return (folder / "trajectory.csv").read_bytes()


@pytest.mark.parametrize(("share", "begun"), [(0.01, 1), (0.5, 2)], ids=["in the first run", "in the second"])
def test_an_interrupted_scene_resumes_to_the_same_bytes(share: float, begun: int, whole: bytes, tmp_path: Path) -> None:
    def stop(step: int, steps: int) -> None:
        if step > share * steps:
            raise KeyboardInterrupt

    with pytest.raises(RunInterrupted):
        run(LONG, tmp_path / "cut", progress=stop)
    assert read_status(tmp_path / "cut")["status"] == "interrupted"
    runs = [read_status(folder)["status"] for folder in (tmp_path / "cut").glob("*_per_sample")]
    assert sorted(runs) == ["finished"] * (begun - 1) + ["interrupted"]
    record = resume(tmp_path / "cut")
    assert record.info["status"] == "finished"
    assert (tmp_path / "cut/trajectory.csv").read_bytes() == whole
    with pytest.raises(RunFolderError, match="nothing to resume"):
        resume(tmp_path / "cut")


def test_a_folder_that_is_there_is_run_again_only_by_force(tmp_path: Path) -> None:
    scene = periodic("TR", 16, 2, 0.2, time_tolerance=1e-3)
    (tmp_path / "run").mkdir()
    (tmp_path / "run/mine").write_text("kept")
    with pytest.raises(RunFolderError, match="is there already"):
        run(scene, tmp_path / "run")
    run(scene.with_values({"time.tolerance": 1e-2}), tmp_path / "run", force=True)
    record = run(scene, tmp_path / "run", force=True)
    steps = [Record.load(folder).scene.time.step for folder in (tmp_path / "run").glob("*_per_sample")]
    assert sorted(steps, reverse=True) == record.info["extrapolated_from"]  # none of the first run is left
    assert (tmp_path / "run/mine").read_text() == "kept"


# --- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"wave.amplitude": 2e-3, "time.tolerance": 5e-4},
            r"time\.tolerance = 0\.0005: .* rounding leaves .* wave\.amplitude",
        ),
        ({"wave.mode": "L", "time.tolerance": 1e-7}, r"time\.tolerance = 1e-07: must be at least 1e-06, which walls"),
        ({"wave.mode": "RT", "time.tolerance": 1e-5, "wave.amplitude": 0.05}, "rounding leaves"),
    ],
)
def test_a_tolerance_below_the_floor_is_refused_before_anything_is_written(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        run(PAPER.with_values(changes), tmp_path / "run")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_the_law_of_rounding_is_lammps_s_within_a_factor_of_three(tmp_path: Path) -> None:
    # 201 rows at a = 0.01, where 2e-5 of p is rounding; against the same steps without LAMMPS
    scene = PAPER.with_values({"wave.amplitude": 0.01, "time.timestep": 0.1, "time.duration": 60.0})
    record = run(scene, tmp_path / "run")
    (model,) = stepped([wave_of(scene)], 5, records=120, overlap_ratio=scene.sphere.overlap_ratio)
    assert 1 / 3 < errors_of(record, model)["p"] / rounding(scene)["p"] < 3


def test_a_periodic_cell_has_no_walls_and_little_rounding() -> None:
    assert floor(periodic("TR", 16, 2, 0.2))["walls"] == 0.0
    assert floor(periodic("TR", 16, 2, 0.2))["rounding"] < floor(PAPER)["rounding"] / 10


def test_timestep_and_tolerance_exclude_each_other() -> None:
    message = r"time\.tolerance = 0\.001: excludes time\.timestep = 0\.05; give one of the two"
    with pytest.raises(SceneError, match=message):
        Scene.loads(PAPER.to_toml().replace("[time]\n", "[time]\ntolerance = 1e-3\n"))
    with pytest.raises(SceneError, match=message):
        PAPER.with_values({"time.tolerance": 1e-3, "time.timestep": 0.05})
    asked = PAPER.with_values({"time.tolerance": 1e-3})
    assert "timestep =" not in asked.to_toml()
    assert Scene.loads(asked.to_toml()) == asked
    assert with_step(asked, 0.05) == PAPER
    with pytest.raises(SceneError, match="no time step until one is chosen"):
        _ = asked.time.step
    with pytest.raises(SceneError, match=r"time\.tolerance = 0\.5: must be a number in"):
        PAPER.with_values({"time.tolerance": 0.5})


# --- the choice and the estimate -------------------------------------------------------------------------------------


@pytest.mark.parametrize("sample", [0.05, 0.5, 3.0])
def test_the_step_fits_the_sample_and_is_the_largest_that_does(sample: float) -> None:
    scene = PAPER.with_values({"time.sample": sample, "time.tolerance": 1e-3})
    step = step_for(scene)
    count = round(sample / step)
    assert step * count == pytest.approx(sample, rel=1e-12)

    def largest(step: float) -> float:
        return max(error.extrapolated for error in step_errors(scene, step).values())

    assert largest(step) <= 1e-3
    if count > 1 and sample / (count - 1) < largest_step(resolve(scene)[0]):
        assert largest(sample / (count - 1)) > 0.8e-3


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"wave.wavenumber": np.pi}, {"q"}),
        ({"wave.wavenumber": np.pi, "wave.mode": "RT"}, {"phi"}),
        ({"wave.wavenumber": np.pi, "wave.mode": "L"}, {"p"}),
        ({"wave.wavenumber": 1e-3, "wave.phase": 1.0}, set(NAMES)),
        ({"wave.amplitude": 50.0}, set(NAMES)),
        ({"time.duration": 0.5}, set(NAMES)),
        ({"time.duration": 1e6, "time.allow_echo": True, "wave.wavenumber": 0.05}, set(NAMES)),
    ],
    ids=lambda value: str(sorted(value) if isinstance(value, set) else value),
)
def test_a_step_is_found_at_the_edges_of_what_a_scene_may_be(changes: dict[str, Any], names: set[str]) -> None:
    scene = PAPER.with_values({"time.tolerance": 1e-2} | changes)
    errors = step_errors(scene, step_for(scene))
    assert set(errors) == names
    assert all(0 <= error.extrapolated <= 1e-2 for error in errors.values())


def test_a_step_too_small_is_refused() -> None:
    changes = {"time.duration": 1e7, "time.allow_echo": True, "time.tolerance": 1e-9, "wave.mode": "RT"}
    with pytest.raises(SceneError, match=r"time\.tolerance = 1e-09: would take more than 1000000000 steps"):
        step_for(PAPER.with_values(changes))


def test_a_deck_of_a_scene_with_a_tolerance_is_the_finer_run(capsys: pytest.CaptureFixture, tmp_path: Path) -> None:
    asked = ["tr_periodic", "--set", "time.tolerance=1e-3"]
    assert cli.main(["build", *asked, "-o", str(tmp_path / "deck")]) == 0
    step = step_for(Scene.load("tr_periodic").with_values({"time.tolerance": 1e-3}))
    assert Scene.load(tmp_path / "deck").time.tolerance == 1e-3
    assert f"variable timestep  index {step / 2!r}" in (tmp_path / "deck" / "in.tr_periodic").read_text()
    assert cli.main(["effects", *asked]) == 0


@pytest.fixture
def pair() -> tuple[Scene, Callable[[int], Record]]:
    """A scene whose runs, by steps per sample, err as c h² on top of a wave."""
    scene = periodic("TR", 16, 2, 0.2, time_tolerance=1e-3)
    runs, wave = Stepped(), wave_of(scene)
    RECORDS.setdefault(wave, scene.time.samples)
    return scene, lambda count: runs.record(with_step(scene, 0.5 / count), wave)


def test_two_runs_that_differ_more_than_the_law_says_have_a_larger_estimate(
    pair: tuple[Scene, Callable[[int], Record]],
) -> None:
    _, at = pair
    coarse, fine = at(3), at(6)
    wrong = replace(fine, p=coarse.p + 1.8 * (fine.p - coarse.p))
    assert estimate([coarse, wrong])["p"] == pytest.approx(1.8**2 * estimate([coarse, fine])["p"], rel=0.3)
    assert estimate([coarse, wrong])["q"] == estimate([coarse, fine])["q"]
    other = replace(fine, p=coarse.p + 3 * (fine.p - coarse.p))
    assert estimate([coarse, other])["p"] > relative_error(other.p, coarse.p)


def test_where_contacts_opened_two_runs_say_nothing(pair: tuple[Scene, Callable[[int], Record]]) -> None:
    _, at = pair
    opened = replace(at(6), scene=at(6).scene.with_values({"effects.contact_opening": True}))
    assert estimate([at(3), opened]) == dict.fromkeys(NAMES, np.inf)


def test_three_runs_tell_an_error_of_first_order_from_one_of_second(
    pair: tuple[Scene, Callable[[int], Record]],
) -> None:
    _, at = pair
    second = [at(count) for count in (3, 6, 12)]
    exact = extrapolated(second[1].q, second[2].q)
    first = [replace(at(count), q=exact + 0.03 / count * np.roll(exact, 7)) for count in (3, 6, 12)]
    truth = relative_error(extrapolated(first[1].q, first[2].q), exact)
    assert estimate(first)["q"] == pytest.approx(truth, rel=0.1)
    assert estimate(second)["q"] < 1e-5


def test_a_tolerance_that_no_step_meets_is_an_error_that_says_what_was_reached(
    pair: tuple[Scene, Callable[[int], Record]], tmp_path: Path
) -> None:
    scene, at = pair
    noise = np.random.default_rng(1)

    def one(stepping: Scene, *_: Any) -> Record:
        record = at(3)  # whatever the step
        return replace(record, scene=stepping, q=record.q + 0.01 * noise.standard_normal(len(record.q)))

    (tmp_path / "scene.toml").write_text(scene.to_toml())
    with pytest.raises(ToleranceError, match=r"time\.tolerance = 0\.001: not met with steps down to .* of q") as caught:
        refine(scene, tmp_path, one, None, {})
    assert "\n" not in str(caught.value)
    assert read_status(tmp_path)["status"] == "failed"


def test_sizes_are_those_of_the_lattice() -> None:
    # Second order against everything: a² = 0.04 of it
    record = limit(("TR", 1.3, 0.2, 0.17), overlap_ratio=PAPER.sphere.overlap_ratio)
    predicted = sizes(PAPER.with_values({"wave.wavenumber": 1.3}))
    for name, values in zip(NAMES, record.T, strict=True):
        assert predicted[name] == pytest.approx(np.sqrt(np.mean(values**2)), rel=0.04)
