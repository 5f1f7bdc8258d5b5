"""Measured surface waves of a layer on an elastic substrate: drawn over the theory, and fitted through it."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure.fitting import Fit
from granular_analysis.measure.points import Point
from granular_analysis.tools import saw
from granular_analysis.tools.fit import main
from granular_lmp import Scene
from tests.measure.known_keys import judged

K_N, K_S = "substrate.normal_stiffness", "substrate.shear_stiffness"
E, RHO = "substrate.youngs_modulus", "substrate.density"
SCENE = Scene.load("monolayer_vertical").with_values({K_N: 900.0, K_S: 800.0, RHO: 2500.0})
# The slowest wave, those around the crossing at 0.23 rad per row, and two that leak
PLACES = [("saw1", xi) for xi in (0.08, 0.14, 0.2, 0.26, 0.32)] + [("saw3", 0.2), ("saw3", 0.26), ("saw2", 0.26)]


@cache
def exact() -> tuple[Point, ...]:
    """Return the waves of the scene at `PLACES`, without their numbers, and those next to it at k = 0."""
    asked = [Point("frequency", 1.0, 1.0, n, branch=name, wavenumber=xi) for n, (name, xi) in enumerate(PLACES, 2)]
    asked += [Point("frequency", f, 1.0, 20, branch="saw") for f in (1.2e8, 1.4e8)]
    hertz = Fit(SCENE, asked, (K_N,)).predicted(np.array([900.0]))
    return tuple(noisy(each, value) for each, value in zip(asked, map(float, hertz), strict=True))


def noisy(point: Point, value: float, error: float = 0.01) -> Point:
    return Point(**vars(point) | {"value": value, "error": error * value, "branch": "saw"})


def table(folder: Path, text: str) -> str:
    (folder / "data.csv").write_text("branch,wavenumber_rad/row,frequency_MHz,error_MHz\n" + text)
    return str(folder / "data.csv")


def test_stiffnesses_modulus_and_density_of_the_substrate_are_found_again() -> None:
    keys = (K_N, K_S, E, RHO)
    truth = np.array([SCENE.value(key) for key in keys])
    start = SCENE.with_values({key: float(value * 1.01) for key, value in zip(keys, truth, strict=True)})
    found = Fit(start, [exact()[n] for n in (1, 3, 4, 5, 7)], keys).answer()  # three of the slowest wave
    np.testing.assert_allclose(found.values, truth, rtol=1e-8)
    assert not found.blind


def test_modulus_and_density_are_not_told_apart_by_speeds_alone() -> None:
    """A slow wave knows the speed of the bare surface wave, √(E/ρ) at a Poisson's ratio."""
    slow = [Point("frequency", 1.0, 1.0, 2, branch="saw1", wavenumber=xi) for xi in (0.001, 0.002, 0.003)]
    light = SCENE.with_values({"sphere.density": 1.0})
    hertz = Fit(light, slow, (E,)).predicted(np.array([7.3e10]))
    found = Fit(light, [noisy(each, float(value)) for each, value in zip(slow, hertz, strict=True)], (E, RHO)).answer()
    assert found.blind == ((E, RHO),)


@pytest.mark.more
def test_intervals_of_twenty_noisy_sets_hold_the_truth() -> None:
    rng, departures = np.random.default_rng(1), []
    chosen = [exact()[n] for n in (2, 3, 5, 6)]  # around the crossing
    for _ in range(20):
        points = [Point(**vars(each) | {"value": each.value * (1 + 0.01 * rng.normal())}) for each in chosen]
        answer = Fit(SCENE, points, (K_N,)).answer()
        (key,), (value,), ((_, high),) = answer.parameters, answer.values, answer.intervals
        departures.append([(key.inner(value) - key.inner(900.0)) / (key.inner(high) - key.inner(value))])
    coverage, bias = judged(np.array(departures))
    assert coverage[0] >= 0.8  # 16 of 20 or fewer happen by chance in 0.3 % of trials
    assert abs(bias[0]) < 0.46  # four deviations of the mean of 20


def test_a_wave_that_is_not_there_is_refused() -> None:
    points = [Point("frequency", 1e8, 1e6, 7, branch="saw9", wavenumber=0.1)] * 2
    with pytest.raises(ValueError, match="line 7: branch = 'saw9': no such wave at this wave number"):
        Fit(SCENE, points, (K_N,)).answer()
    plane = Scene.load("tr_periodic")
    with pytest.raises(ValueError, match=r"\[substrate\]: missing"):
        Fit(plane, [Point("frequency", 1e8, 1e6, 7, branch="saw", wavenumber=0.1)] * 2, ("sphere.density",)).answer()


@pytest.mark.usefixtures("drawn_once")
def test_surface_waves_and_branches_on_a_rigid_substrate_stand_in_one_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rigid = Fit(SCENE, [Point("frequency", 1.0, 1.0, 2, branch="S3")], (K_N,)).predicted(np.array([900.0]))[0]
    surface = exact()[2]
    text = f"S3,,{1e-6 * rigid},1\nsaw1,0.2,{1e-6 * surface.value},1\n"
    data, scene = table(tmp_path, text), tmp_path / "scene.toml"
    scene.write_text(SCENE.to_toml())
    assert main([data, str(scene), "--free", K_N, "-o", str(tmp_path / "fit.png")]) == 0
    said = capsys.readouterr().out
    assert re.search(r"2 frequency, MHz +S3", said)
    assert re.search(r"3 frequency, MHz +saw1", said)
    assert (tmp_path / "fit.png").stat().st_size > 1e4


@pytest.mark.usefixtures("drawn_once")
def test_points_are_drawn_over_the_waves_and_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(saw, "POINTS", 3)
    point, scene = exact()[0], tmp_path / "scene.toml"
    scene.write_text(SCENE.to_toml())
    data = table(tmp_path, f",0.08,{1.02e-6 * point.value},{0.01e-6 * point.value}\n")
    words = [str(scene), "--limit", "0.085", "-o", str(tmp_path / "saw.png")]
    saw.main(words)
    plain = (tmp_path / "saw.png").read_bytes()
    capsys.readouterr()
    saw.main([*words, "--data", data])
    last = capsys.readouterr().out.splitlines()[-1].split()
    assert last[:2] == ["2", "saw"]
    assert float(last[3]) == pytest.approx(1e-6 * point.value, rel=1e-5)
    assert [float(each) for each in last[4:]] == [2.0, 2.0]
    assert (tmp_path / "saw.png").read_bytes() != plain


def test_the_waves_are_not_written_over_the_points(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = table(tmp_path, "saw,0.1,100,1\n")
    with pytest.raises(SystemExit):
        saw.main(["monolayer_vertical", "--data", data, "-o", str(tmp_path / "data.png")])
    assert "the CSV file beside it would replace" in capsys.readouterr().err


@pytest.mark.parametrize(("branch", "says"), [("S2", "line 2: branch = 'S2': must be"), ("saw0", "branch = 'saw0'")])
def test_points_that_are_no_surface_waves_are_refused(tmp_path: Path, branch: str, says: str) -> None:
    with pytest.raises(SystemExit, match=says):
        saw.main(["monolayer_vertical", "--data", table(tmp_path, f"{branch},0.1,100,1\n")])
    with pytest.raises(SystemExit, match="No such file"):
        saw.main(["monolayer_vertical", "--data", str(tmp_path / "none.csv")])
