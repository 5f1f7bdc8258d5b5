"""The benchmarks measure what they say: errors that can be wrong, ratios within rounds, contestants may be absent."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as bench
from benchmarks import naive, ours, rows
from benchmarks.problem import Contestant, Solution, Start, base_scene, errors, exact
from benchmarks.timing import interleave, ratio


def test_the_start_of_a_peer_is_the_wave() -> None:
    start, scene = Start.of(base_scene()), base_scene()
    d0 = scene.displacement_amplitude
    p, q = exact(scene)
    # Rounding of SI numbers; Q = 0.9731 moves along −x, and nothing along y.
    np.testing.assert_allclose(start.displacement[start.centre, :2] / d0, [-q[0], p[0]], rtol=1e-9, atol=1e-12)
    assert not start.displacement[start.held].any()


def test_rows_are_within_one_percent(tmp_path: Path) -> None:
    solution = rows.solve(tmp_path)
    assert max(errors(base_scene(), solution.p, solution.q)) < 0.01  # what the benchmark asks of p


def test_a_wrong_signal_has_a_large_error() -> None:
    p, q = exact(base_scene())
    assert errors(base_scene(), 1.02 * p, q) == pytest.approx((0.02, 0.0), rel=1e-9)
    assert errors(base_scene(), p, np.roll(q, 1))[1] > 0.1


def test_another_shear_law_is_not_the_reference() -> None:
    # p of the incremental law is 1.9 times as large at ξ = 0.802 (docs/choosing-a-shear-law.md)
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


def test_every_time_in_the_table_has_its_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench.main(["--only", "ours", "rows", "--repeats", "1"]) == 0
    lines = [line.split("|")[1:-1] for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert [line[0].strip() for line in lines[1:]] == ["---", ours.CONTESTANT.title, rows.CONTESTANT.title]
    for line in lines[2:]:
        assert all(0 < float(cell) < 0.01 for cell in line[7:9])


def test_the_naive_deck_reads_its_own_sphere_only(tmp_path: Path) -> None:
    snapshot = "ITEM: TIMESTEP\n12\nITEM: NUMBER OF ATOMS\n2\nITEM: ATOMS id type x y\n1 1 5 6\n12 1 7000 8000\n"
    (tmp_path / "dump").write_text(2 * snapshot)
    np.testing.assert_allclose(naive._positions(tmp_path / "dump", 12, (2, 3)), 2 * [[7e-6, 8e-6]], rtol=1e-15)
