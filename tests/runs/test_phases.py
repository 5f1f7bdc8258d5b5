"""Where the time of a run goes: phases do not overlap, and what a run says of them adds up."""

import re
import time
from pathlib import Path

import pytest

from granular_lmp import Record, Scene, run
from granular_lmp.cli import main
from granular_lmp.lammps.outputs import LOOP_SECTIONS, read_log
from granular_lmp.runs.phases import collected, phase, split

RUN = ("build", "start", "write", "deck", "read", *LOOP_SECTIONS)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock that stands still; its only entry is what it shows."""
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    return now


def test_a_phase_within_a_phase_takes_its_seconds_from_the_outer_one(clock: list[float]) -> None:
    with collected() as all_, phase("deck"):
        clock[0] += 1
        with collected() as inner, phase("start"):
            clock[0] += 10
        clock[0] += 2
    assert all_ == {"start": 10, "deck": 3}
    assert inner == {"start": 10}


def test_equal_phases_add_up_and_one_that_fails_counts(clock: list[float]) -> None:
    def fails() -> None:
        clock[0] += 1
        raise ValueError("no")

    with collected() as seconds:
        for _ in range(2):
            with pytest.raises(ValueError, match="no"), phase("read"):
                fails()
    assert seconds == {"read": 2}


def test_split_moves_seconds_to_the_parts(clock: list[float]) -> None:
    with collected() as outer, collected() as seconds:
        with phase("deck"):
            clock[0] += 5
        split("deck", {"loop.pair": 3.0, "loop.other": 1.0})
    assert outer == seconds == {"deck": 1, "loop.pair": 3, "loop.other": 1}


def test_outside_a_collection_nothing_is_counted(clock: list[float]) -> None:
    with collected() as seconds:
        pass
    with phase("read"):
        clock[0] += 1
    assert seconds == {}


def small() -> Scene:
    return Scene.load("tr_periodic").with_values({"packing.rows": 20, "time.duration": 2.0})


@pytest.mark.parametrize("launcher", ["module", "lmp"])
def test_the_phases_of_a_run_add_up_to_its_total(launcher: str, tmp_path: Path) -> None:
    started = time.perf_counter()
    record = run(small(), tmp_path / "run", launcher=launcher)
    elapsed = time.perf_counter() - started
    seconds = record.info["wall_seconds"]
    assert set(seconds["phases"]) == set(RUN)
    # Rounding of sums, and LAMMPS prints five digits of a section
    assert sum(seconds["phases"].values()) == pytest.approx(seconds["total"], abs=1e-9)
    assert seconds["loop"] == pytest.approx(read_log(tmp_path / "run" / "log.lammps").loop, abs=1e-9)
    assert seconds["loop"] + seconds["other"] == pytest.approx(seconds["total"], abs=1e-9)
    assert all(spent >= -1e-6 for spent in seconds["phases"].values())
    assert seconds["total"] <= elapsed


def test_a_run_to_a_tolerance_sums_the_phases_of_its_runs(tmp_path: Path) -> None:
    scene = small().with_values({"time.tolerance": 0.01})  # whose finest run is made once
    record = run(scene, tmp_path / "run")
    parts = [Record.load(folder).info["wall_seconds"] for folder in sorted((tmp_path / "run").glob("*_per_sample"))]
    assert len(parts) >= 2
    for name in RUN:
        whole = record.info["wall_seconds"]["phases"][name]
        assert whole == pytest.approx(sum(part["phases"][name] for part in parts), abs=1e-9)  # rounding of sums


def test_the_record_that_a_run_returns_is_the_one_in_its_folder(tmp_path: Path) -> None:
    for values in ({}, {"time.tolerance": 0.1}):
        folder = tmp_path / f"run{len(values)}"
        record = run(small().with_values(values), folder)
        read = Record.load(folder)
        assert record.info == read.info
        assert record.scene == read.scene
        assert record.folder == read.folder
        for name, signal in read.columns.items():
            assert record.columns[name].tolist() == signal.tolist()


def test_profile_says_on_standard_error_where_the_time_went(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "small.toml").write_text(small().to_toml())
    assert main(["--profile", "run", str(tmp_path / "small.toml"), "-o", str(tmp_path / "run")]) == 0
    captured = capsys.readouterr()
    said = {name: float(spent) for name, spent in re.findall(r"^([\w.]+) +(-?[\d.]+) s\b", captured.err, re.MULTILINE)}
    assert set(said) == {"imports", "scene", *RUN, "rest", "total", "processor"}
    phases = sum(spent for name, spent in said.items() if name not in ("total", "processor"))
    assert phases == pytest.approx(said["total"], abs=1e-3)  # fifteen numbers of four decimals
    assert "loop.pair" not in captured.out
