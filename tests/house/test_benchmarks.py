"""The benchmarks measure what they say: errors that can be wrong, ratios within rounds, contestants may be absent."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as bench
from benchmarks import contact_list, naive
from benchmarks.plan import Plan, planned
from benchmarks.problem import Contestant, Solution, Start, base_scene, errors, exact
from benchmarks.timing import interleave, ratio


def test_the_start_of_a_peer_is_the_wave() -> None:
    start, scene = Start.of(base_scene()), base_scene()
    d0 = scene.displacement_amplitude
    p, q = exact(scene)
    # Rounding of SI numbers; Q = 0.9731 moves along −x, and nothing along y.
    np.testing.assert_allclose(start.displacement[start.centre, :2] / d0, [-q[0], p[0]], rtol=1e-9, atol=1e-12)
    assert not start.displacement[start.held].any()


@pytest.mark.parametrize("name", ["rows-0.0001", "exact-0.0001", "list-0.05", "ours-0.05"])
def test_contestants_are_within_one_percent(name: str, tmp_path: Path) -> None:
    if why := bench.CONTESTANTS[name].missing():
        pytest.skip(why)
    solution = bench.CONTESTANTS[name].solve(tmp_path)
    assert max(errors(base_scene(), solution.p, solution.q)) < 0.01  # what the benchmark asks of p


@pytest.mark.skipif(bool(contact_list.missing()), reason=contact_list.missing())
def test_the_contacts_in_c_are_of_second_order_and_a_pair_of_fourth(tmp_path: Path) -> None:
    def error(name: str) -> float:
        solution = bench.CONTESTANTS[name].solve(tmp_path)
        return errors(base_scene(), solution.p, solution.q)[0]

    # The next order of the step is a hundredth of the error of single steps, and a tenth of that of pairs (measured)
    assert error("list-0.1") / error("list-0.05") == pytest.approx(4, rel=0.05)
    assert error("list-pair-0.25") / error("list-pair-0.125") == pytest.approx(16, rel=0.2)


def test_a_ratio_is_between_runs_of_equal_error_only() -> None:
    p, q = exact(base_scene())

    def rounds(name: str, error: float) -> bench.Rounds:
        return bench.Rounds(bench.CONTESTANTS[name], [1.0], [1.0], [Solution((1 + error) * p, q, 1.0, 1, 1)])

    done = {"ours-0.1": rounds("ours-0.1", 6e-3), "ours-0.05": rounds("ours-0.05", 1.6e-3)}
    assert bench.reference(2e-3, done) == "ours-0.05"
    assert bench.reference(5e-3, done) == "ours-0.1"
    assert bench.reference(3e-3, done) is None
    assert "| – | – |" in bench.report(done | {"rows-0.0001": rounds("rows-0.0001", 3e-3)})


def test_processor_time_has_the_programs_that_a_contestant_starts(tmp_path: Path) -> None:
    def start(folder: Path) -> Solution:
        busy = "import time\nwhile time.process_time() < 0.2: pass"
        subprocess.run([sys.executable, "-S", "-c", busy], check=True)
        return Solution(np.zeros(1), np.zeros(1), 0.0, 1, 1)

    seconds, _ = bench.timed(start)(tmp_path)
    assert seconds >= 0.2  # what the program waits for of its own clock


def test_a_wrong_signal_has_a_large_error() -> None:
    p, q = exact(base_scene())
    assert errors(base_scene(), 1.02 * p, q) == pytest.approx((0.02, 0.0), rel=1e-9)
    assert errors(base_scene(), p, np.roll(q, 1))[1] > 0.1


def test_another_shear_law_is_not_the_reference() -> None:
    # p of the incremental law is 1.9 times as large at ξ = 0.802 (docs/contact-laws.md)
    assert errors(base_scene(), *exact(base_scene(), "incremental"))[0] > 0.8


def test_ratios_are_taken_within_rounds() -> None:
    # the machine was ten times slower in the second round
    assert ratio([2.0, 20.0, 2.0], [1.0, 10.0, 1.0]) == 2.0
    with pytest.raises(ValueError, match="zip"):
        ratio([2.0], [1.0, 1.0])


def test_jobs_take_turns_in_folders_of_their_own() -> None:
    seen: list[tuple[str, Path]] = []
    interleave({name: lambda folder, name=name: seen.append((name, folder)) for name in "ab"}, 2)
    assert [name for name, _ in seen] == ["a", "b", "a", "b"]
    assert len({folder for _, folder in seen}) == 4
    assert not any(folder.exists() for _, folder in seen)


def test_a_contestant_that_is_not_installed_is_skipped_and_said_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(folder: Path) -> Solution:
        raise AssertionError("ran although missing")

    monkeypatch.setitem(bench.CONTESTANTS, "yade", Contestant("yade", "YADE", refuse, lambda: "no program yade"))
    assert bench.main(["--only", "yade"]) == 0
    assert "- yade: skipped, no program yade" in capsys.readouterr().out


def test_every_time_in_the_table_has_its_error(
    drawn_once: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ["ours-0.2", "rows-0.0001"]
    assert bench.main(["--only", *names, "--repeats", "1", "-o", str(tmp_path / "bench.svg")]) == 0
    assert (tmp_path / "bench.svg").stat().st_size > 0
    lines = [line.split("|")[1:-1] for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert [line[0].strip() for line in lines[1:]] == ["---", *(bench.CONTESTANTS[name].title for name in names)]
    for line in lines[2:]:
        assert all(0 < float(cell) < 0.02 for cell in line[3:5])  # of p with the step 0.2


def test_the_naive_deck_reads_its_own_sphere_only(tmp_path: Path) -> None:
    snapshot = "ITEM: TIMESTEP\n12\nITEM: NUMBER OF ATOMS\n2\nITEM: ATOMS id type x y\n1 1 5 6\n12 1 7000 8000\n"
    (tmp_path / "dump").write_text(2 * snapshot)
    np.testing.assert_allclose(naive._positions(tmp_path / "dump", 12, (2, 3)), 2 * [[7e-6, 8e-6]], rtol=1e-15)


ROOT = Path(__file__).parents[2]


def measured(head: str) -> list[dict[str, float]]:
    """Return medians by column of the rows, without the kernel, of the table of RESULTS.md whose head begins so."""
    rest = (ROOT / "benchmarks/RESULTS.md").read_text("utf-8").partition(f"| {head} |")[2]
    title, _, *lines = rest.splitlines()
    names = [*head.split(" | "), *title.strip("| ").split(" | ")]
    rows = [line.strip("| ").split(" | ") for line in lines[: lines.index("")]]
    numbers = [{name: cell.split()[0] for name, cell in zip(names, row, strict=True)} for row in rows]
    without = [row for row in numbers if "kernel" not in row.values()]
    return [{name: float(cell) for name, cell in row.items() if cell != "granular"} for row in without]


def test_the_plan_of_the_page_is_that_of_the_model() -> None:
    *_, build, read, loop, node, _, files = planned().splitlines()[-1].strip("| ").split(" | ")
    assert (build, read, loop, node, files) == ("1500", "650", "651", "110", "17, 16, 48")
    page = " ".join((ROOT / "docs/how-long.md").read_text("utf-8").split())
    for told in ("1500 s to build, 650 s to read", "650 s on 1024 ranks", "17 GB of data, 16 GB a snapshot and 48 GB"):
        assert told in page


def test_the_model_of_the_plan_meets_the_measured_rows() -> None:
    for row in measured("spheres | ranks"):
        plan, alone = Plan(row["spheres"], int(row["ranks"])), Plan(row["spheres"])
        assert 0.5 < plan.loop / (plan.spheres * plan.steps / row["M particle-steps/s"] / 1e6) < 2
        assert plan.loop / alone.loop == pytest.approx(row["÷ 1 rank"], rel=0.1)
        assert plan.rank == pytest.approx(1e6 * row["peak MB a rank"], rel=0.15)
        if plan.spheres > 1e5:  # LAMMPS starts in 0.2 s
            assert 0.5 < plan.read / row["set-up, s"] < 2
    for row in measured("spheres | set-up, s"):
        plan = Plan(row["spheres"])
        if plan.spheres > 3e4:  # Python and its modules take 0.1 s and 50 MB
            assert 0.5 < plan.build / row["set-up, s"] < 2
            assert plan.builder == pytest.approx(1e6 * row["peak MB"], rel=0.15)
            assert plan.files[0] == pytest.approx(1e6 * row["files, MB"], rel=0.05)
