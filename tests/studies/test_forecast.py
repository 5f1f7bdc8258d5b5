"""`granular-lmp check`: the size it says is that of the run, its seconds and bytes are made as they are said."""

import json
import subprocess
import sys
from math import pi
from pathlib import Path

import pytest

from granular_lmp import ImpactScene, run
from granular_lmp.cli import main
from granular_lmp.errors import LammpsMissingError
from granular_lmp.problem import prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.shipped import SHIPPED
from granular_lmp.studies import forecast
from granular_lmp.studies.forecast import forecast as forecast_of

WAVE = Scene.load("tr_periodic").with_values({"packing.rows": 8, "wave.wavenumber": pi / 4, "time.duration": 2.0})
CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.rows": 10, "time.duration": 5.0})
SHEET = ImpactScene.load("point_impact")
LARGE = {"packing.rows": 150, "packing.columns": 150}
# The peak of this process alone: ru_maxrss would hold that of the one that started it, too
STATUS = Path("/proc/self/status")
PEAK = f"""
import re, sys
from granular_lmp import ImpactScene, run_impact
run_impact(ImpactScene.load(sys.argv[1]), sys.argv[2])
print(1024 * int(re.search(r"VmHWM:\\s+(\\d+) kB", open("{STATUS}").read())[1]))
"""


@pytest.mark.parametrize(("scene", "tolerance"), [(WAVE, None), (CHAIN, None), (CHAIN, 1e-2)])
def test_check_says_what_a_run_then_is(
    scene: Scene, tolerance: float | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = scene.with_values({"time.tolerance": tolerance} if tolerance else {})
    (tmp_path / "mine.toml").write_text(scene.to_toml())
    assert main(["check", str(tmp_path / "mine.toml"), "--json"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
    said, record = json.loads(capsys.readouterr().out), run(scene, tmp_path / "run")
    assert (said["spheres"], said["records"]) == (scene.shape.spheres, len(record.tau))
    # A ladder that ends after two of the three runs that are planned has 1 + 2 of their 1 + 2 + 4 steps
    assert said["steps"] in (
        {record.info["steps"] * 7 // 3, record.info["steps"]} if tolerance else {record.info["steps"]}
    )
    assert said["runs"] == (3 if tolerance else 1)
    assert said["seconds"] > 0
    assert said["basis"].startswith("a short run of this scene just now, ")
    if not tolerance:
        on = {name for name, effect in record.info["effects"].items() if effect["on"]}
        assert {name for name, there in said["effects"].items() if there} == on
        assert set(said["guards"]) == set(record.info["guards"])
        assert said["warnings"] == record.info.get("remarks", said["warnings"])


@pytest.mark.parametrize(("every", "duration"), [(0.5, 2.0), (1.5, 2.0), (2.0, 2.0)])
def test_the_snapshots_are_those_that_a_run_writes(
    every: float, duration: float, tried: list[Scene], tmp_path: Path
) -> None:
    scene = WAVE.with_values({"output.particles": every, "time.duration": duration})
    assert forecast_of(prepare(scene)).snapshots == len(run(scene, tmp_path / "run").snapshots().tau)


@pytest.mark.parametrize("changes", [{}, {"time.tolerance": 1e-3}, {"disorder.vacancies": 0.3}])
def test_the_seconds_are_in_proportion(changes: dict[str, float], tried: list[Scene]) -> None:
    problem = prepare(SHEET.with_values(changes))
    found = forecast_of(problem)
    assert found.spheres == len(problem.rest.atoms)
    assert found.seconds == pytest.approx(0.5 * found.runs + found.spheres * found.steps / 1e6)


def test_check_says_time_and_memory(tried: list[Scene], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "point_impact", "--set", "time.tolerance=1e-3"]) == 0
    said = capsys.readouterr().out
    assert "in 3 runs, or more if their errors require it;  46 records of 2501 spheres" in said
    assert " s on one rank; a short run of this scene just now, 1e+06 sphere-steps per second" in said
    assert "memory    about " in said
    assert "restart   a checkpoint about every 0.5 minutes" in said


@pytest.mark.parametrize("name", ["tr_periodic", "solitary_chain"])
def test_check_says_why_it_knows_no_time(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(scene: Scene, kernel: bool = False) -> None:
        raise LammpsMissingError("LAMMPS cannot be loaded")

    monkeypatch.setattr(forecast, "speed", missing)
    assert main(["check", name]) == 0
    assert "time      unknown: LAMMPS cannot be loaded" in capsys.readouterr().out


LATE = ["--set", "sphere.adhesion_law=jkr", "--set", "effects.parting=distance"]
ONLY = 'effects.parting = "distance": only the kernel supports it'


def test_check_and_build_say_that_a_scene_needs_the_kernel(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    asked = []

    def speed(scene: Scene, kernel: bool = False) -> tuple[float, float]:
        asked.append(kernel)
        return 1e6, 0.5

    monkeypatch.setattr(forecast, "speed", speed)
    monkeypatch.setattr(forecast.library, "built", lambda: tmp_path)
    assert main(["check", "tr_periodic", *LATE]) == 0
    said = capsys.readouterr().out
    assert f"kernel    needed: {ONLY}" in said
    assert " s on one rank; a short run of this scene just now" in said
    assert asked == [True]
    assert main(["check", "tr_periodic", *LATE, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["needs_kernel"] == ONLY
    assert main(["build", "tr_periodic", *LATE, "-o", str(tmp_path / "deck")]) == 0
    assert f"plain LAMMPS cannot run it: {ONLY}" in capsys.readouterr().out
    assert main(["check", "tr_periodic"]) == 0
    assert "needed" not in capsys.readouterr().out


def test_check_says_what_to_build_for_a_scene_that_needs_the_kernel(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing() -> None:
        raise LammpsMissingError("there is no kernel; build it with: make")

    monkeypatch.setattr(forecast.library, "built", missing)
    assert main(["check", "tr_periodic", *LATE]) == 0
    said = capsys.readouterr().out
    assert "time      unknown: there is no kernel; build it with: make" in said
    assert f"kernel    needed: {ONLY}" in said


@pytest.mark.parametrize("name", sorted(path.name for path in (SHIPPED / "impacts").iterdir() if path.is_dir()))
def test_a_cell_stands_for_a_large_impact(name: str, tried: list[Scene]) -> None:
    scene = ImpactScene.load(name)
    sheet = scene.lattice.sheet
    larger = scene.with_values(LARGE if sheet else {"packing.rows": 20_001})
    found = forecast_of(prepare(larger))
    (small,) = tried
    assert small.wave is None
    assert small.shape.spheres == 10_000
    assert small.scale.velocity == pytest.approx(larger.scale.velocity, rel=1e-12)  # rounding
    assert (small.effects, small.packing.contact_force) == (larger.effects, larger.packing.contact_force)
    assert found.basis.startswith("a short run of a cell of ")


def test_a_long_sample_is_cut_for_the_short_run(tried: list[Scene]) -> None:
    forecast_of(prepare(SHEET.with_values({"time.sample": 40.0, "time.timestep": 5e-4})))
    (short,) = tried
    assert short.time.steps == 100
    assert short.time.step == pytest.approx(5e-4)


def peak(scene: Scene, folder: Path) -> float:
    """Return the most memory, bytes, of a process that runs a scene."""
    folder.mkdir()
    (folder / "mine.toml").write_text(scene.to_toml())
    words = [sys.executable, "-c", PEAK, str(folder / "mine.toml"), str(folder / "run")]
    return float(subprocess.run(words, capture_output=True, text=True, check=True).stdout)


@pytest.mark.skipif(not STATUS.is_file(), reason="the system does not tell the peak memory of a process")
def test_the_memory_is_that_of_a_run(tried: list[Scene], tmp_path: Path) -> None:
    # Few steps, and a record at each of them
    scene = SHEET.with_values({"time.duration": 10.0, "time.sample": 0.1, "time.timestep": 0.1})
    bare = scene.with_values({"output.rows": [0, 0]})
    measured, without = (peak(each, tmp_path / name) for each, name in ((scene, "all"), (bare, "row")))
    said, said_without = (forecast_of(prepare(each)).memory for each in (scene, bare))
    # A factor of two: what interpreter and libraries take differs between machines
    assert 0.5 * said < measured < 2 * said
    # What the record adds differs by the pages that an allocator keeps
    assert 0.5 * (said - said_without) < measured - without < 2 * (said - said_without)


def test_check_says_the_defaults_that_depend_on_a_wave(tried: list[Scene], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "solitary_chain", "--set", "packing.first=wall"]) == 0
    (line,) = (each for each in capsys.readouterr().out.splitlines() if each.startswith("default "))
    assert 'effects.shear_law = "incremental", effects.friction = 0.0: as there is no [wave]' in line
    assert "packing.first" not in line  # it is given
    found = {}
    for name in ("tr_periodic", "solitary_chain"):
        assert main(["check", name, "--json"]) == 0
        found[name] = json.loads(capsys.readouterr().out)["defaults"]["effects.shear_law"]
    assert found == {"tr_periodic": "secant", "solitary_chain": "incremental"}


def test_the_cell_that_stands_for_a_film_has_its_layers_and_no_more_spheres_than_that_of_a_sheet() -> None:
    film = Scene.load("multilayer").with_values({"packing.layers": 40, "packing.rows": 200, "packing.columns": 12})
    cell = forecast._small(prepare(film)).shape
    assert (cell.layers, film.shape.spheres) == (40, 96_000)
    assert cell.spheres <= 10_000
