"""The network beside LAMMPS: the ratio is between equal errors, and the table holds both."""

import re
from pathlib import Path

import pytest

from benchmarks import network
from benchmarks.network import LAMMPS, NETWORK, PAIR, Point
from granular_lmp import run
from granular_lmp.lammps.outputs import read_log

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
    # The machine was ten times slower in the second round
    rounds = [network.Outcome(k * 1.5, k * 0.5, 3e-5, Point(NETWORK, 1e-5, k * 0.3, 1e-5)) for k in (1.0, 10.0)]
    assert network.line(network.sized(64), rounds)[-2:] == ["0.2, 0.2", "0.6, 0.6"]


def test_the_processor_time_of_a_loop_is_its_share_without_output(tmp_path: Path) -> None:
    log = tmp_path / "log.lammps"
    run(network.sized(64).with_values({"time.timestep": 0.1}), tmp_path / "run")
    text = (tmp_path / "run" / "log.lammps").read_text()
    log.write_text(re.sub(r"[\d.]+% CPU use", "50.0% CPU use", text))
    found = read_log(log)
    whole = found.loop - found.sections["loop.output"]
    assert network.processor_seconds(log) == pytest.approx(whole / 2)
    log.write_text(re.sub(r"[\d.]+% CPU use", "0.0% CPU use", text))  # shorter than a tick of that clock
    assert network.processor_seconds(log) == pytest.approx(whole)


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
    assert float(cells[5]) <= float(cells[3]) < 1e-6  # a pair of steps is of fourth order
