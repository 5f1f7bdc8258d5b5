"""The network beside LAMMPS: the ratio is between equal errors, and the table holds both."""

import pytest

from analysis.figures.witness import LAMMPS, NETWORK, PAIR, Point
from benchmarks import network

LOOSE, GOOD, TIGHT = (Point(NETWORK, 10.0**-k, seconds, 10.0**-k) for k, seconds in ((3, 0.1), (5, 0.3), (7, 0.9)))
RUNS = [Point(LAMMPS, 0.05, 1.0, 1e-6), Point(PAIR, 0.05, 1.5, 3e-5)]


def test_the_network_is_the_fastest_that_is_no_less_accurate_than_the_pair() -> None:
    assert network.matched([*RUNS, LOOSE, GOOD, TIGHT]) == (RUNS[1], GOOD)
    faster = Point(NETWORK, 1e-9, 0.2, 1e-9)  # tighter, and by chance less time
    assert network.matched([*RUNS, LOOSE, GOOD, faster]) == (RUNS[1], faster)


def test_a_network_that_is_never_as_accurate_is_refused() -> None:
    with pytest.raises(ValueError, match=r"as accurate as the pair of steps, 3\.0e-05 of D0"):
        network.matched([*RUNS, LOOSE])


def test_ratios_are_within_rounds() -> None:
    slower = [Point(each.kind, each.setting, 10 * each.seconds, each.error) for each in (*RUNS, GOOD)]
    cells = network.line(network.sized(64), [[*RUNS, GOOD], slower])
    assert float(cells[6]) == pytest.approx(0.3 / 1.5)


@pytest.mark.parametrize("spheres", [100, 1_000, 100_000])
def test_a_sheet_has_as_many_spheres_as_asked_for_and_carries_the_wave(spheres: int) -> None:
    scene = network.sized(spheres)
    assert scene.shape.spheres == pytest.approx(spheres, rel=0.05)  # rows are even
    assert scene.imperfections


def test_the_table_has_the_times_and_errors_of_both(capsys: pytest.CaptureFixture[str]) -> None:
    assert network.main(["--spheres", "64", "--repeats", "1"]) == 0
    head, _, row = capsys.readouterr().out.splitlines()[-3:]
    assert "network over LAMMPS" in head
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert len(cells) == len(network.HEAD)
    assert float(cells[4]) <= float(cells[2]) < 1e-6  # a pair of steps is of fourth order
    assert float(cells[6]) > 0
