"""Fits of traces: exact slopes beside differences of whole runs and of LAMMPS's, intervals, and what is refused."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure.fitting import Fit
from granular_analysis.measure.points import Point
from granular_analysis.measure.traced_runs import TracedRuns
from granular_analysis.tools.fit import main
from granular_lmp import Scene, run

pytest.importorskip("jax", reason="slopes of traces need JAX")

E, NU, W, ETA = "sphere.youngs_modulus", "sphere.poisson_ratio", "sphere.work_of_adhesion", "effects.viscosity"
# All spheres of the first row are struck aslant, so that all branches along y are there
SHEET = Scene.from_dict(
    {
        "name": "sheet",
        "sphere": {"radius": 5e-7, "youngs_modulus": 7.3e10, "poisson_ratio": 0.17, "work_of_adhesion": 0.063}
        | {"density": 2200.0},
        "packing": {"lattice": "hexagonal", "rows": 6, "columns": 4, "sides": "periodic"},
        "effects": {"viscosity": 1e-7},
        "time": {"duration": 12.0, "timestep": 0.1},
        "striker": [{"spheres": [[0, n] for n in range(4)], "velocity": 0.01, "direction": 45.0}],
    }
)
T0 = SHEET.scale.time
TIMES = np.linspace(0.33, 11.8, 36) * T0  # between steps
KINDS = ("displacement_x", "velocity_y")


def points(kinds: tuple[str, ...] = KINDS, rows: tuple[int, ...] = (2, 5)) -> list[Point]:
    return [Point(kind, 0.0, 1.0, 2, time=time, row=row, column=1) for kind in kinds for row in rows for time in TIMES]


@cache
def exact(kinds: tuple[str, ...], keys: tuple[str, ...], values: tuple[float, ...]) -> np.ndarray:
    return Fit(SHEET, points(kinds), keys).predicted(np.array(values))


def noisy(
    noise: float, seed: int, keys: tuple[str, ...], values: tuple[float, ...], kinds: tuple[str, ...] = KINDS
) -> list[Point]:
    """Return traces with Gaussian noise, a share of the largest value of their kind."""
    asked, right = points(kinds), exact(kinds, keys, values)
    names, draw = np.array([each.kind for each in asked]), np.random.default_rng(seed)
    error = noise * np.array([np.abs(right[names == each]).max() for each in names])
    found = right + error * draw.normal(size=len(right))
    return [replace(each, value=x, error=s) for each, x, s in zip(asked, found, error, strict=True)]


def by_differences(fit: Fit, values: np.ndarray, share: float) -> np.ndarray:
    """Return slopes by differences of whole runs of fourth order."""
    found = []
    for change in np.diag(share * values):
        ends = [fit.predicted(values + far * change) for far in (-2, -1, 1, 2)]
        found.append(np.tensordot([1 / 12, -2 / 3, 2 / 3, -1 / 12], ends, 1) / change.sum())
    return np.array(found).T


def off(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return the largest departure of the slopes by each key, over the largest slope."""
    return np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)


def test_slopes_are_those_of_differences_of_whole_runs() -> None:
    keys = (E, W, ETA)
    fit = Fit(SHEET, points(), keys)
    start = np.array([each.start for each in fit.parameters])
    found, expected = fit.slopes(start), by_differences(fit, start, 1e-3)
    assert not fit.remarks
    # Truncation at fourth order and rounding of overlaps, which are 5e-4 of radii, leave 1e-7
    assert np.all(off(found, expected) < 2e-6)
    assert np.all(off(1.001 * found, expected) > 1e-4)


def test_slopes_next_to_a_bound_are_those_of_one_side() -> None:
    """Poisson's ratio is at most 1/2."""
    fit = Fit(SHEET.with_values({NU: 0.4999}), points(), (E, NU, ETA))
    start = np.array([each.start for each in fit.parameters])
    found = fit.slopes(start)[:, [1]]
    assert not fit.remarks
    one, two, three = (fit.predicted(start - np.array([0.0, far, 0.0])) for far in (0.0, 1e-3, 2e-3))
    # This difference is of second order, 1e-6 of the slope
    assert np.all(off(found, (3 * one - 4 * two + three)[:, None] / 2e-3) < 1e-4)


@pytest.mark.usefixtures("drawn_once")
def test_the_command_recovers_keys_and_names_those_that_it_cannot_tell_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = {E: 7.0e10, W: 0.063, NU: 0.2}
    names = {"displacement_x": "nm", "velocity_y": "mm/s"}
    lines = ["time_ns,row,column," + ",".join(f"{name}_{unit},error_{unit}" for name, unit in names.items())]
    for each in noisy(0.01, 3, tuple(truth), tuple(truth.values())):
        size = {"displacement_x": 1e9, "velocity_y": 1e3}[each.kind]
        cells = [f"{each.value * size},{each.error * size}" if name == each.kind else "," for name in names]
        lines.append(f"{each.time * 1e9},{each.row},{each.column},{','.join(cells)}")
    lines.insert(1, "-2.5,2,1,900,1,900,1")
    (tmp_path / "traces.csv").write_text("\n".join(lines))
    (tmp_path / "sheet.toml").write_text(SHEET.to_toml())
    words = [str(tmp_path / each) for each in ("traces.csv", "sheet.toml")] + ["--free", *truth]
    assert main([*words, "--json", str(tmp_path / "fit.json"), "-o", str(tmp_path / "fit.png")]) == 0
    printed, answer = capsys.readouterr().out, json.loads((tmp_path / "fit.json").read_text())
    assert "left out: 2 values of traces before the start of the run" in printed
    # The stiffness of a contact goes as E^{2/3} w^{1/3}, and that of all others as no key alone
    assert f"the data cannot distinguish: {E}, {W}" in printed
    assert "slopes of traces are differences" not in printed
    assert [line.split()[3] for line in printed.splitlines() if "velocity_y, " in line] == ["2/1", "5/1"]
    found = {name: each["value"] for name, each in answer["keys"].items()}
    stiffness = (found[E] / truth[E]) ** (2 / 3) * (found[W] / truth[W]) ** (1 / 3)
    assert stiffness == pytest.approx(1, abs=0.02)  # and off by 3 % at the start
    assert answer["keys"][NU]["from"] < truth[NU] < answer["keys"][NU]["to"]
    assert 0.6 < answer["chi_squared_a_degree_of_freedom"] < 1.4  # four deviations of 144 points
    assert answer["keys"][E]["from"] is None


def test_a_step_between_records_is_below_the_error_of_the_step() -> None:
    """Halved steps move a trace by the error of the steps, which is of second order; reading between adds nothing."""
    scenes = [SHEET.with_values({"effects.viscosity": 0.0, "time.timestep": 0.1 / 2**n}) for n in range(3)]
    one, two, three = (TracedRuns(each, points()).predicted(each) for each in scenes)
    ratio = np.linalg.norm(one - two) / np.linalg.norm(two - three)
    assert ratio == pytest.approx(4, rel=0.05)  # second order, with terms of the fourth


def test_slopes_are_those_of_two_runs_of_lammps(tmp_path: Path) -> None:
    keys, share, records = (E, NU, ETA), 1e-3, []
    start = np.array([SHEET.value(each) for each in keys], dtype=float)
    for way in (1, -1):
        scene = SHEET.with_values({E: start[0] * (1 + way * share)})
        own = T0 / scene.scale.time  # one step in seconds, as in a fit
        times = {"time.timestep": 0.1 * own, "time.sample": 0.2 * own, "time.duration": 12.0 * own}
        records.append(run(scene.with_values(times), tmp_path / str(way)))
    samples, spheres = np.arange(24, 60), [2 * 4 + 1, 5 * 4 + 1]
    ends = [each.displacement[np.ix_(samples, spheres)] * each.scene.scale.length for each in records]
    expected = np.transpose((ends[0] - ends[1]) / (2 * share * start[0]), (2, 1, 0)).ravel()
    asked = points(("displacement_x", "displacement_y"))
    asked = [replace(each, time=0.2 * T0 * samples[n % 36]) for n, each in enumerate(asked)]
    found = Fit(SHEET, asked, keys).slopes(start)[:, 0]
    # Central differences err by 4e-5: forces at rest, which cancel, are thirty times those of the wave
    np.testing.assert_allclose(found, expected, atol=2e-4 * np.abs(found).max(), rtol=0)
    assert np.abs(1.01 * found - expected).max() > 2e-3 * np.abs(found).max()


def test_slopes_where_contacts_open_are_differences_and_said_so() -> None:
    hard = SHEET.with_values({"striker.1.velocity": 2.0})
    fit = Fit(hard, points(), (E, NU, ETA))
    start = np.array([each.start for each in fit.parameters])
    found = fit.slopes(start)
    assert "contacts opened" in " ".join(fit.remarks)
    expected = [(fit.predicted(start + h) - fit.predicted(start - h)) / (2 * h.sum()) for h in np.diag(1e-5 * start)]
    np.testing.assert_allclose(found, np.transpose(expected), rtol=1e-6, atol=1e-9 * np.abs(found).max())


@pytest.mark.parametrize(
    ("changes", "place", "says"),
    [
        ({}, {"row": 6}, "row 6, column 1, layer 0: no sphere"),
        ({}, {"column": -1}, "line 2: a trace needs column, from 0 to 3"),
        ({}, {"time": -1e-9}, "line 2: time = -1e-09 s: is before the start of the run"),
        ({}, {"kind": "spin_x"}, "spin_x: spheres in the plane have displacement_x, displacement_y, rotation_z"),
        (
            {"source": [{"rows": [2, 2], "motion": "x", "signal": "tone", "frequency": 1.0, "amplitude": 0.01}]},
            {"row": 2},
            "a source moves the sphere of this trace",
        ),
    ],
)
def test_traces_that_no_run_has_are_refused(changes: dict[str, object], place: dict[str, object], says: str) -> None:
    asked = replace(points(("displacement_x",))[0], **place)
    scene = Scene.from_dict({**SHEET.to_dict(), **changes})
    with pytest.raises(ValueError, match=says):
        Fit(scene, [asked], (E,)).answer()


def test_displacements_along_both_axes_have_one_unknown_error_and_velocities_another() -> None:
    bare = [replace(each, error=None) for each in points(("displacement_x", "displacement_y"))]
    assert Fit(SHEET, bare, (E,)).keys == (E,)
    with pytest.raises(ValueError, match="points of several kinds need their errors"):
        Fit(SHEET, [replace(each, error=None) for each in points()], (E,))


@cache
def departures(sets: int, noise: float) -> np.ndarray:
    """Return the departures of modulus and Poisson's ratio over half the width of their intervals, (sets, 2)."""
    keys, truth = (E, NU), (7.3e10, 0.17)
    found = []
    for seed in range(sets):
        answer = Fit(SHEET, noisy(noise, seed, keys, truth), keys).answer()
        rows = zip(answer.parameters, answer.values, answer.intervals, truth, strict=True)
        found.append(
            [
                (each.inner(value) - each.inner(true)) / (each.inner(high) - each.inner(value))
                for each, value, (_, high), true in rows
            ]
        )
    return np.array(found)


@pytest.mark.more
@pytest.mark.slow
def test_intervals_hold_the_truth_in_95_of_100_sets() -> None:
    found = np.abs(departures(200, 0.002))  # noise at which the model is linear over the intervals
    shares = np.mean(found < 1, axis=0)
    assert ((shares >= 0.92) & (shares <= 0.98)).all()  # two deviations of a share of 200
    assert (np.mean(found < 0.5, axis=0) < 0.8).all()  # intervals of half the width would be seen


@pytest.mark.more
def test_traces_and_frequencies_stand_in_one_table() -> None:
    scene = Scene.load("tr_periodic").with_values({"packing.rows": 8, "time.duration": 10.0})
    time = scene.scale.time
    asked = [
        Point("displacement_x", 1e-11, 1e-12, 2, time=3 * time, row=2, column=1),
        Point("frequency", 1e8, 1e6, 3, branch="L", wavenumber=1.0),
        Point("displacement_y", 1e-11, 1e-12, 4, time=5 * time, row=2, column=1),
    ]
    fit = Fit(scene, asked, (E, NU))
    start = np.array([each.start for each in fit.parameters])
    assert np.all(off(fit.slopes(start), by_differences(fit, start, 1e-3)) < 1e-5)
    assert not fit.remarks
    # The speed of sound goes as √E^{2/3}, and so each frequency
    assert fit.slopes(start)[1, 0] * start[0] / fit.at_start[1] == pytest.approx(1 / 3, rel=1e-3)
