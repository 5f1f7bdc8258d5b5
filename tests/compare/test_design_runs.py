"""Densities by gradients of whole runs: the search, the command, and LAMMPS's runs of what was designed."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure.stepping import NetworkEngine
from granular_analysis.theory.errors import TheoryError
from granular_analysis.tools.design import main
from granular_analysis.tools.kept import begun
from granular_lmp import Record, Scene, run
from granular_lmp.runs.folder import locked
from tests.conftest import members

design = pytest.importorskip("granular_analysis.theory.network_design", reason="needs JAX")
designs = pytest.importorskip("granular_analysis.measure.designs", reason="needs JAX")

ROWS = np.arange(24) // 3
TEN = list(range(4, 24, 2))
SCENE = """
name = "doubled"

[sphere]
radius = 5e-7
youngs_modulus = 7.3e10
poisson_ratio = 0.17
work_of_adhesion = 0.063
density = 2200.0

[packing]
rows = 8
columns = 3
ends = "periodic"

[wave]
mode = "TR"
wavenumber = 0.785398163397448
amplitude = 0.2

[[monitor]]
name = "low"
rows = [0, 0]

[[monitor]]
name = "high"
spheres = [[7, 0], [7, 1]]

[output]
particles = 0.5

[time]
duration = 20.0
timestep = 0.25
"""


@cache
def scene() -> Scene:
    """Return a wave in 8 rows of 3 spheres, all of which it records at each sample."""
    return Scene.loads(SCENE)


@cache
def searched(**changes: object) -> "design.Design":
    """Return a search for the second harmonic, where the command has it too, so that all is compiled once."""
    NetworkEngine.on("jax")
    subject = designs.Subject.of(scene())
    goal, spheres = designs.goal_of(subject, "second-harmonic")
    return design.Design(subject.run(spheres), goal, np.arange(24), 0.5, 2.0, **changes)


def test_a_search_ends_higher_than_it_began_and_within_its_bounds() -> None:
    for one in (searched(), searched(same_mass=True)):
        begin = one.begin(1)
        best = design.improved(one, begin, 8)
        assert best.value > 1.2 * one.value(begin)
        assert best.value == pytest.approx(one.value(best.densities), rel=1e-12)
        assert np.all((best.densities >= 0.5) & (best.densities <= 2.0))
        assert np.ptp(best.densities) > 0.2
        assert (abs(best.densities.mean() - 1) < 1e-12) == one.same_mass


def test_a_search_that_was_stopped_continues_to_the_same_bits() -> None:
    one, kept = searched(), []
    whole = design.improved(one, one.begin(1), 6, noted=kept.append)
    more: list[object] = []
    again = design.improved(one, one.begin(1), 6, kept[:3], more.append)
    assert np.array_equal(again.densities, whole.densities)
    assert [each.value for each in more] == [each.value for each in kept[3:]]
    mirrored = [each._replace(slope=-each.slope) for each in kept[:3]]
    other = design.improved(one, one.begin(1), 6, mirrored[:1])
    assert not np.array_equal(other.densities, whole.densities)
    with pytest.raises(TheoryError, match="kept evaluation 2 has other densities than this search"):
        design.improved(one, one.begin(1), 6, mirrored)


def test_the_slope_of_a_group_is_the_sum_of_those_of_its_spheres_and_of_a_robust_design_the_mean_over_seeds() -> None:
    one = searched()
    rows = replace(one, group=ROWS)
    densities = rows.begin(2)
    value, slope = one.evaluated(densities[ROWS])
    of_rows, slope_of_rows = rows.evaluated(densities)
    assert of_rows == value
    assert slope_of_rows == pytest.approx(np.bincount(ROWS, slope), rel=1e-12)

    robust = replace(rows, spread=0.01, seeds=2)
    crystals = [own for own, _ in robust.crystals(densities)]
    assert [np.std(own / densities[ROWS]) for own in crystals] == pytest.approx([0.01, 0.01], rel=0.5)
    values, slopes = zip(*map(one.evaluated, crystals), strict=True)
    by = [np.bincount(ROWS, each * own / densities[ROWS]) for each, own in zip(slopes, crystals, strict=True)]
    found, slope = robust.evaluated(densities)
    assert found == pytest.approx(np.mean(values), rel=1e-12)
    assert found != pytest.approx(value, rel=1e-6)
    assert slope == pytest.approx(np.mean(by, axis=0), rel=1e-12)


def test_densities_of_the_same_mass_have_the_slope_of_their_numbers() -> None:
    sizes, rng = np.array([4.0, 2.0, 1.0, 1.0]), np.random.default_rng(1)
    scaling = design.SameMass(0.5, 2.0, sizes)
    numbers, slope, way = rng.normal(size=(3, 4))
    assert sizes @ scaling.of(numbers) == pytest.approx(sizes.sum(), rel=1e-12)
    ends = [slope @ scaling.of(numbers + step * way) for step in (1e-5, -1e-5)]
    assert scaling.back(numbers, slope) @ way == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-8)
    assert scaling.of(scaling.to(np.array([0.9, 1.2, 0.8, 1.2]))) == pytest.approx([0.9, 1.2, 0.8, 1.2], rel=1e-12)


@dataclass
class Steep:
    """A search whose objective is the first density, in runs in which a contact opens beyond a limit."""

    limit: float
    scaling = design.Bounded(0.5, 2.0, np.ones(2))

    def evaluated(self, densities: np.ndarray) -> tuple[float, np.ndarray]:
        if densities[0] > self.limit:
            raise TheoryError("3 contacts opened, first pair 7; the gradient is one-sided there")
        return float(densities[0]), np.array([1.0, 0.0])


def test_a_search_steps_back_from_runs_in_which_contacts_open_and_says_so() -> None:
    best = design.improved(Steep(1.3), np.ones(2), 40)
    assert 1.25 < best.value <= 1.3
    assert best.refused > 0
    assert best.why == "3 contacts opened, first pair 7"
    free = design.improved(Steep(3.0), np.ones(2), 40)
    assert (free.value, free.refused, free.why) == (2.0, 0, "")
    with pytest.raises(TheoryError, match="at the start 3 contacts opened, first pair 7: take a smaller wave"):
        design.improved(Steep(0.9), np.ones(2), 40)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"low": 2.0}, "within 2 2: must be two numbers above 0, the lower one first"),
        ({"spread": 0.01}, "robust 0.01 with 1 seeds: must be"),
        ({"seeds": 3}, "robust 0 with 3 seeds: must be"),
    ],
)
def test_a_search_that_makes_no_sense_is_refused(changes: dict[str, object], said: str) -> None:
    with pytest.raises(TheoryError, match=said):
        replace(searched(), **changes)
    with pytest.raises(TheoryError, match="within 1.1 2: keeping the mass needs one bound below 1 and one above"):
        _ = replace(searched(), low=1.1, same_mass=True).scaling


def in_lammps(given: Scene, folder: Path) -> list[Record]:
    """Return two runs of LAMMPS, the second from the opposite start."""
    changed = given, given.with_values({"wave.phase": given.require_wave().phase + np.pi})
    return [run(each, folder / str(number)) for number, each in enumerate(changed)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder in which the command has searched with three evaluations."""
    there = tmp_path_factory.mktemp("design")
    (there / "doubled.toml").write_text(SCENE, encoding="utf-8")
    assert main(asked(there, 3)) == 0
    return there


def asked(there: Path, evaluations: int, **options: str) -> list[str]:
    """Return the words of the command."""
    words = {"--vary": "density", "--maximize": "second-harmonic", "--evaluations": str(evaluations)} | options
    given = [word for pair in words.items() for word in pair]
    return [str(there / "doubled.toml"), *given, "--within", "0.5", "2", "-o", str(there / "found")]


def test_lammps_runs_what_was_designed_and_has_its_objective(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The displacements are within 1e-9 of LAMMPS's (docs/gpu.md), and the harmonic is 1e-3 of them."""
    log = np.genfromtxt(folder / "found/log.csv", delimiter=",", names=True)
    assert len(log) == 3
    best = Scene.load(folder / "found")
    assert np.ptp(best.packing.table.columns["density"]) > 200
    records = in_lammps(best, tmp_path)
    assert designs.read_off(records, "second-harmonic") == pytest.approx(log["best"][-1], rel=1e-4)
    assert log["best"][-1] != pytest.approx(log["objective"][0], rel=1e-2)
    assert log["best_over_uniform"][-1] * searched().value(np.ones(24)) == pytest.approx(log["best"][-1], rel=1e-12)
    assert main([str(tmp_path / "0"), "--opposite", str(tmp_path / "1"), "--maximize", "second-harmonic"]) == 0
    assert float(capsys.readouterr().out.split()[-1]) == pytest.approx(log["best"][-1], rel=1e-4)
    with pytest.raises(TheoryError, match="needs 2 runs, not 1"):
        designs.read_off(records[:1], "second-harmonic")
    with pytest.raises(TheoryError, match="the runs must start with opposite signs: wave.phase must differ by pi"):
        designs.read_off([records[0], records[0]], "second-harmonic")
    rare = best.with_values({"output.particles": 2 * best.time.sample, "time.duration": 4 * best.time.sample})
    with pytest.raises(TheoryError, match=r"output.particles = .*: must be time.sample"):
        designs.read_off(in_lammps(rare, tmp_path / "rare"), "second-harmonic")


def test_the_same_command_again_continues_and_any_other_is_refused(folder: Path) -> None:
    before = (folder / "found/evaluations.bin").read_bytes()
    with (folder / "found/evaluations.bin").open("ab") as stream:
        stream.write(b"begun")  # of an evaluation that was stopped
    assert main(asked(folder, 4)) == 0
    after = (folder / "found/evaluations.bin").read_bytes()
    assert after[: len(before)] == before
    assert len(after) == len(before) * 4 // 3
    assert main(asked(folder, 3)) == 0
    assert (folder / "found/evaluations.bin").read_bytes() == after
    log = np.genfromtxt(folder / "found/log.csv", delimiter=",", names=True)
    assert len(log) == 3
    assert log["best"][-1] == pytest.approx(searched().value(densities_of(folder)), rel=1e-9)
    with locked(folder / "found"), pytest.raises(SystemExit, match="found: another run is in progress there"):
        main(asked(folder, 4))
    with pytest.raises(SystemExit, match="found: holds another search"):
        main(asked(folder, 4, **{"--per": "row"}))
    (folder / "found/design.json").unlink()
    with pytest.raises(SystemExit, match=r"found: holds scene\.toml without a search"):
        main(asked(folder, 4))


def densities_of(folder: Path) -> np.ndarray:
    """Return the densities of the designed scene over that of the given one."""
    return Scene.load(folder / "found").packing.table.columns["density"] / scene().sphere.density


def test_a_search_that_kept_nothing_gives_its_folder_to_another(tmp_path: Path) -> None:
    row = np.dtype([("value", "<f8")])
    begun(tmp_path, "asked.json", {"of": 1}, row, ["log.csv"])
    path, rows = begun(tmp_path, "asked.json", {"of": 2}, row, ["log.csv"])
    assert len(rows) == 0
    path.write_bytes(np.ones(1).tobytes())
    with pytest.raises(TheoryError, match="holds another search"):
        begun(tmp_path, "asked.json", {"of": 1}, row, ["log.csv"])
    assert begun(tmp_path, "asked.json", {"of": 2}, row, ["log.csv"])[1]["value"].tolist() == [1.0]


# The square of the step leaves 3e-5 of the slopes of these spheres
@pytest.mark.parametrize("sphere", members(TEN, *TEN[1:]))
def test_two_runs_of_lammps_with_one_density_changed_have_the_slope(sphere: int, tmp_path: Path) -> None:
    one, step = searched(), 2e-3
    densities = one.begin(3)
    ends = []
    for sign in (1, -1):
        changed = densities + sign * step * (np.arange(24) == sphere)
        records = in_lammps(designs.designed(scene(), changed), tmp_path / str(sign))
        ends.append(designs.read_off(records, "second-harmonic"))
    slope = one.evaluated(densities)[1]
    assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(slope[sphere], rel=1e-3)
    assert abs(slope[sphere]) > 0.02 * abs(slope).max()


SAID = [
    ("--vary sphere.density --within 0.5 2 -o no", "--maximize: needs --vary density"),
    ("--vary density -o no", "--maximize: needs --within LOW HIGH, and -o DIR"),
    ("--vary density --within 0.5 2 --best gap -o no", "--best is for a goal of second order"),
    ("--vary density --within 0.5 2 --second 3 -o no", "--second is for two frequencies, not for whole runs"),
    ("--vary density --within 0.5 2 --opposite no -o no", "--opposite is for a run"),
    ("--vary density --within 2 0.5 -o no", "within 2 0.5: must be two numbers above 0"),
    ("--vary density --within 0.5 2 --per 3x2 -o no", "--per 3x2: must be sphere, row, or a cell as 4x2"),
    ("--vary density --within 0.5 2 --set disorder.density=0.01 -o no", "must start from a crystal of equal spheres"),
    ("--vary density --within 0.5 2 --set time.tolerance=1e-3 -o no", "time.tolerance = 0.001: must be a step"),
]


@pytest.mark.parametrize(("words", "said"), SAID)
def test_what_is_no_search_is_refused(words: str, said: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main([str(folder / "doubled.toml"), "--maximize", "second-harmonic", *words.split()])
    assert said in f"{refused.value}{capsys.readouterr().err}"
    assert not Path("no").exists()


def test_cells_repeat_and_monitors_have_their_spheres() -> None:
    subject = designs.Subject.of(scene())
    assert np.array_equal(subject.groups("row"), ROWS)
    assert np.array_equal(subject.groups("2x3")[6:], subject.groups("2x3")[:-6])
    assert np.array_equal(np.unique(subject.groups("2x3")), np.arange(6))
    assert list(subject.monitor("low")) == [0, 1, 2]
    assert list(subject.monitor("high")) == [21, 22]
    with pytest.raises(TheoryError, match="monitor 'other': must be one of low, high"):
        subject.monitor("other")
    for words in ("third-harmonic", "second-harmonic:low", "motion"):
        with pytest.raises(TheoryError, match=f"--maximize {words}: must be one of second-harmonic, largest:MONITOR"):
            designs.goal_of(subject, words)


def of_motion(found: np.ndarray, half: int) -> float:
    """Return the mean squared velocity of two spheres."""
    return float(np.trapezoid((found[:, 3:5] ** 2).sum(axis=1).mean(axis=1), dx=half) / (half * (len(found) - 1)))


@pytest.mark.parametrize("objective", ["largest:high", "motion:high", "motion:low/high"])
def test_objectives_of_monitors_are_what_they_say(objective: str) -> None:
    subject = designs.Subject.of(scene())
    goal, spheres = designs.goal_of(subject, objective)
    rng = np.random.default_rng(1)
    motion = rng.normal(size=(5, 6, 24))
    times = 0.5 * np.arange(5)
    found = goal.of([designs.Motion(times, motion[:, :, spheres], np.zeros((5, 0)))])[0]
    length, time = subject.first.length, subject.first.time
    low, high = (of_motion(motion[:, :, own], 0.5) / (length / time) ** 2 for own in ([0, 1, 2], [21, 22]))
    farthest = np.hypot(*np.moveaxis(motion[:, :2, 21:23], 1, 0)).max() / length
    expected = {"largest:high": farthest, "motion:high": high, "motion:low/high": low / high}
    assert found == pytest.approx(expected[objective], rel=1e-12)


def test_without_jax_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("granular_analysis.measure.stepping.find_spec", lambda _: None)
    with pytest.raises(SystemExit, match=r"needs JAX: pip install 'granular-lmp\[jax\]'"):
        main(
            [*["tr_periodic", "--vary", "density", "--within", "0.5", "2", "-o", "no", "--maximize"], "second-harmonic"]
        )


def test_in_space_monitors_have_layers_and_runs_of_lammps_are_read(tmp_path: Path) -> None:
    monitors = [
        {"name": "top", "rows": [0, 1], "layers": [1, 1]},
        {"name": "one", "spheres": [[1, 2]], "layers": [0, 0]},
    ]
    short = {"time.duration": 2.0, "time.timestep": 0.1, "time.sample": 0.5, "output.particles": 0.5}
    given = Scene.load("fcc_transverse").with_values(short | {"monitor": monitors})
    subject, shape = designs.Subject.of(given), given.shape
    assert shape.layers > 1
    height = subject.first.network.position[:, 2]
    assert set(subject.groups("1x1")) == set(range(shape.layers))
    apart = height[1] - height[0]  # of two layers; rows in turn are half of it higher
    assert np.ptp(height[subject.groups("1x1") == 0]) < 0.6 * apart
    assert len(subject.monitor("top")) == 2 * shape.columns
    assert height[subject.monitor("top")] == pytest.approx(height[1], abs=0.6 * apart)
    assert list(subject.monitor("one")) == [(shape.columns + 2) * shape.layers]

    record = run(given, tmp_path / "run")
    found = designs.read_off([record], "largest:top")
    ways = record.snapshots().stack("displacement")[:, subject.monitor("top")]
    assert found == pytest.approx(np.linalg.norm(ways, axis=2).max(), rel=1e-12)
    rates = record.snapshots().stack("velocity")[:, subject.monitor("one")]
    square = np.trapezoid((rates**2).sum(axis=2)[:, 0], dx=0.5) / 2.0
    assert designs.read_off([record], "motion:one") == pytest.approx(square, rel=1e-12)
