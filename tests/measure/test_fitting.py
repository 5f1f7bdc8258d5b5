"""Keys of scenes from measured points: recovered from the theory, from an impact, and refused where none holds."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cases.layer.monolayer import Layer
from granular_analysis.measure.arrivals import crest
from granular_analysis.measure.fitting import Fit
from granular_analysis.measure.points import Point
from granular_analysis.second_harmonic import mode, ratios, second_harmonic
from granular_analysis.tools.fit import main
from granular_lmp import Scene, run
from granular_lmp.errors import SceneError
from tests.conftest import members
from tests.manual import Measure, Mutant, verifies
from tests.measure.known_keys import judged, setups

SCENE = Scene.load("tr_periodic")
E, NU = "sphere.youngs_modulus", "sphere.poisson_ratio"


STIFF = SCENE.with_values({"contact.normal_stiffness": 500.0, "contact.shear_stiffness": 400.0})


def point(value: float, error: float | None = None, **place: object) -> Point:
    return Point("frequency", value, error, 2, **place)


def closed_form(scene: Scene) -> list[Point]:
    """Return frequencies of L and TR by the paper's closed form, which the fit does not use."""
    sphere = scene.sphere
    constants = ratios(sphere.poisson_ratio, overlap_ratio=sphere.static_overlap / (2 * sphere.radius))
    scale = 1 / (2 * np.pi * sphere.time_scale)
    return [
        point(mode(name, xi, constants).frequency * scale, branch=name, wavenumber=xi)
        for xi in (0.7, 1.4, 2.1)
        for name in ("L", "TR")
    ]


@verifies(
    "Fit of modulus and Poisson's ratio to six frequencies, relative",
    reference="analytic: the paper's closed form, which the fit does not use",
    tolerance=1e-06,
    reason="frequencies are met to rounding; far below any measurement",
    mutant=Mutant(
        "analysis/granular_analysis/measure/fitting.py",
        "axis=1)[:, 0] / (2 * np.pi)",
        "axis=1)[:, 0] / (2.0002 * np.pi)",
    ),
)
def test_keys_are_found_again_from_the_closed_form(measured: Measure) -> None:
    truth = SCENE.with_values({E: 6.5e10, NU: 0.25})
    found = Fit(SCENE, closed_form(truth), (E, NU)).answer()
    measured(found.values[0] / 6.5e10 - 1)
    measured(found.values[1] / 0.25 - 1)
    assert found.error is not None
    assert found.error < 1e-6 * closed_form(truth)[0].value


def test_a_wrong_name_of_a_branch_is_seen_in_the_residuals() -> None:
    points = closed_form(SCENE)
    swapped = [
        point(each.value, each.value / 100, branch={"L": "TR", "TR": "L"}[each.branch], wavenumber=each.wavenumber)
        for each in points
    ]
    right = [point(each.value, each.value / 100, branch=each.branch, wavenumber=each.wavenumber) for each in points]
    assert Fit(SCENE, right, (E,)).answer().chi_squared < 1e-6
    assert Fit(SCENE, swapped, (E,)).answer().chi_squared > 100


def test_an_empty_branch_is_the_nearest() -> None:
    points = [point(each.value, wavenumber=each.wavenumber) for each in closed_form(SCENE)]
    fit = Fit(SCENE.with_values({E: 1.02 * SCENE.sphere.youngs_modulus}), points, (E,))
    assert fit.answer().values == pytest.approx([SCENE.sphere.youngs_modulus], rel=1e-6)
    assert fit.branches(fit.answer().values) == ["2", "1"] * 3  # L above TR


SETUPS = {each.name: each for each in setups()}


@cache
def departures(name: str, sets: int) -> np.ndarray:
    """Return how far noisy sets of a set-up are off."""
    return SETUPS[name].departures(0.01, sets)


SETS = {f"{count} of a {name}": (name, count) for name in SETUPS for count in (20, 100)}


@pytest.mark.parametrize("which", members(SETS, *SETS.keys() - {"20 of a sheet"}))
def test_intervals_of_noisy_sets_hold_the_truth(which: str) -> None:
    name, sets = SETS[which]
    coverage, bias = judged(departures(name, sets))
    assert np.all(coverage >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / sets))  # by chance in 0.3 % of trials
    assert np.all(np.abs(bias) < 4 * 0.51 / np.sqrt(sets))  # four deviations of the mean, 0.51 each


def test_residuals_say_that_a_law_is_wrong() -> None:
    """A JKR contact resists slip by 5/3 more: turning spheres are then faster than DMT allows, all others slower."""
    sheet = setups()[0]
    other = replace(sheet, scene=sheet.scene.with_values({"sphere.adhesion_law": "jkr"}))
    points = [replace(each, error=0.01 * each.value) for each in other.exact]
    answer = Fit(sheet.scene, points, (E,)).answer()
    assert answer.chi_squared > 50
    upper = np.array([each.branch == "3" for each in points])
    assert np.all(answer.residuals[upper] < -8)
    assert np.mean(answer.residuals[~upper] > 0) > 0.6
    # Measured stiffnesses may have any ratio: the fit finds those of the JKR contact, whose κ is above 4/3
    free = Fit(STIFF, points, ("contact.normal_stiffness", "contact.shear_stiffness")).answer()
    jkr = other.scene.sphere
    assert free.values == pytest.approx([jkr.normal_stiffness, jkr.shear_stiffness], rel=1e-3)
    assert free.values[1] > 4 / 3 * free.values[0]


def test_intervals_that_are_too_narrow_would_be_seen() -> None:
    coverage, _ = judged(departures("sheet", 20) * 4)
    assert np.any(coverage < 0.8)


def test_modulus_and_adhesion_are_not_told_apart_by_frequencies() -> None:
    points = [
        point(each.value, each.value / 100, branch=each.branch, wavenumber=each.wavenumber)
        for each in closed_form(SCENE)
    ]
    found = Fit(SCENE, points, (E, "sphere.work_of_adhesion", NU)).answer()
    assert found.blind == ((E, "sphere.work_of_adhesion"),)
    assert np.isfinite(found.intervals[2]).all()


def test_keys_that_make_one_stiffness_leave_poissons_ratio_its_interval() -> None:
    # Without errors the scatter makes the intervals, by Student's quantile: five keys of six points once left one
    # degree of freedom, and an interval nine times too wide
    points = [
        point(each.value * (1 + 0.01 * (-1) ** n), branch=each.branch, wavenumber=each.wavenumber)
        for n, each in enumerate(closed_form(SCENE))
    ]
    alike = ("sphere.work_of_adhesion", "sphere.density", "sphere.radius")
    two, five = (Fit(SCENE, points, keys).answer() for keys in ((E, NU), (E, NU, *alike)))
    assert two.freedom == five.freedom == 4
    # ν enters the model beside the stiffness, but for the overlap ratio, of 5e-4
    np.testing.assert_allclose(five.intervals[1], two.intervals[1], rtol=1e-3)


@pytest.mark.more
def test_the_speed_of_a_front_tells_the_modulus_of_a_struck_chain() -> None:
    """At a given velocity of the striker the speed of the front goes as E^{2/5}, by the scaling of Hertz's law."""
    chain = Scene.load("solitary_chain")
    exact = [Point("speed", 600.0, 1.0, 2, row=10, to_row=20)]
    speed = float(Fit(chain, exact, (E,)).predicted(np.array([2e11]))[0])
    points = [Point("speed", speed * factor, speed / 100, 2, row=10, to_row=20) for factor in (1.0, 1.0)]
    start = chain.with_values({E: 1.5e11})
    assert Fit(start, points, (E,)).answer().values[0] == pytest.approx(2e11, rel=1e-4)  # parabola of a crest
    faster = Fit(chain, exact, (E,)).predicted(np.array([4e11]))[0]
    assert faster / speed == pytest.approx(2**0.4, rel=1e-3)


SHEET = Scene.load("point_impact").with_values(
    {"packing.rows": 8, "packing.columns": 7, "striker.1.spheres": [[0, 3]], "time.duration": 12.0}
    | {"time.sample": 0.05, "time.timestep": 0.02}
)


def test_arrivals_in_a_sheet_are_those_of_its_run_and_go_as_the_modulus(tmp_path: Path) -> None:
    record = run(SHEET, tmp_path / "sheet")
    asked = [(3, 2), (4, 3), (5, 3)]
    speeds = np.linalg.norm(record.velocity[:, [7 * row + column for row, column in asked]], axis=-1)
    found = [crest(record.tau, speed)[0] * SHEET.scale.time for speed in speeds.T]
    points = [
        Point("arrival", time, 1e-4 * time, 2, row=row, column=column)
        for time, (row, column) in zip(found, asked, strict=True)
    ]
    fit = Fit(SHEET, points, (E,))
    expected = fit.predicted(np.array([2e11]))
    np.testing.assert_allclose(found, expected, rtol=3e-4)  # crests by a parabola, and the time step
    np.testing.assert_allclose(fit.predicted(np.array([4e11])), expected / 2**0.4, rtol=3e-4)


def test_a_speed_in_a_sheet_is_between_two_spheres() -> None:
    one, other = (Point("arrival", 2e-4, 1e-6, 2, row=row) for row in (3, 5))
    speed = Point("speed", 400.0, 1.0, 3, row=3, to_row=5)
    first, second, found = Fit(SHEET, [one, other, speed], (E,)).predicted(np.array([2e11]))
    apart = 2 * 2 * 0.75**0.5 * SHEET.sphere.radius  # rows of one parity lie in line
    assert found == pytest.approx(apart / (second - first), rel=1e-9)


@pytest.mark.parametrize(
    ("changes", "place", "says"),
    [
        ({}, {"row": 8}, "row 8, column 3: must be below 8 and 7"),
        ({}, {"row": 5, "column": 8}, "row 5, column 8"),
        ({"effects.friction": 0.3}, {"row": 3}, r"without effects\.friction"),
        ({"packing.last": "wall"}, {"row": 3}, r"packing\.last = 'wall': must be one of free, held"),
    ],
)
def test_arrivals_that_no_network_here_has_are_refused(
    changes: dict[str, object], place: dict[str, int], says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        Fit(SHEET.with_values(changes), [Point("arrival", 1e-4, 1e-6, 2, **place)], (E,)).answer()


def test_an_amplitude_of_a_second_harmonic_tells_poissons_ratio() -> None:
    scene = SCENE.with_values({"wave.wavenumber": 1.2})
    amplitude = 0.1 * scene.sphere.static_overlap
    times = [4 * scene.sphere.time_scale, 6 * scene.sphere.time_scale]
    asked = [Point("second_harmonic", 1.0, 1.0, 2, amplitude=amplitude, time=t, wavenumber=1.2) for t in times]
    truth = Fit(scene, asked, (NU,)).predicted(np.array([0.2]))
    # Re[C e^{2iφ}] for two phases φ of the wave, by the closed form
    ball = scene.with_values({NU: 0.2}).sphere
    constants = ratios(0.2, overlap_ratio=ball.overlap_ratio)
    closed = [
        second_harmonic(
            mode("TR", 1.2, constants),
            constants,
            amplitude / ball.static_overlap,
            np.divide(times, ball.time_scale),
            phase=phase,
        )
        for phase in (0.0, np.pi / 4)
    ]
    np.testing.assert_allclose(truth, amplitude * np.hypot(*closed), rtol=1e-9)  # rounding
    row, own = scene.sphere.lattice_constant * np.sqrt(3) / 2, np.array([scene.sphere.poisson_ratio])
    metric = [Point(**vars(each) | {"wavenumber": 1.2 / row, "unit": "rad/m"}) for each in asked]
    both = [Fit(scene, each, (NU,)).predicted(own) for each in (metric, asked)]
    np.testing.assert_allclose(*both, rtol=1e-9)  # rounding
    points = [
        Point(**vars(each) | {"value": value, "error": value / 100}) for each, value in zip(asked, truth, strict=True)
    ]
    assert Fit(scene, points, (NU,)).answer().values[0] == pytest.approx(0.2, rel=1e-5)


@pytest.mark.parametrize(
    ("points", "keys", "says"),
    [
        ([point(1e8)], (), "no key is free"),
        ([point(1e8)], (E, E), "named twice"),
        ([point(1e8)], ("sphere.adhesion_law",), "must be a number"),
        ([point(1e8)], ("wave.frequency",), "has no value in the scene"),
        ([point(1e8, 1.0), point(1e8)], (E,), "line 2: has no error, and others have"),
        ([point(1e8, 1.0, branch="XX", wavenumber=1.0)], (E,), "XX"),
        ([Point("arrival", 1e-6, 1e-8, 2, row=3)], (E,), "need a scene with"),
    ],
)
def test_what_no_theory_holds_is_refused(points: list[Point], keys: tuple[str, ...], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        Fit(SCENE, points, keys).answer()


def test_an_unknown_key_is_refused() -> None:
    with pytest.raises(SceneError, match="unknown key; did you mean 'density'"):
        Fit(SCENE, [point(1e8)], ("sphere.densty",)).answer()


@pytest.mark.usefixtures("drawn_once")
def test_the_command_prints_writes_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        f"{each.branch},{each.wavenumber},{each.value / 1e6},1" for each in closed_form(SCENE.with_values({E: 6e10}))
    ]
    data = tmp_path / "data.csv"
    data.write_text("branch,wavenumber_rad/row,frequency_MHz,error_MHz\n" + "\n".join(rows) + "\n")
    scene, figure, plain = (tmp_path / name for name in ("fitted.toml", "fit.png", "fit.json"))
    words = [str(data), "tr_periodic", "--free", E, "-o", str(figure), "--scene", str(scene), "--json", str(plain)]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "sphere.youngs_modulus" in printed
    assert [line.split()[3] for line in printed.splitlines() if "frequency, MHz" in line] == ["L", "TR"] * 3
    assert "chi2 =" in printed
    assert Scene.load(scene).sphere.youngs_modulus == pytest.approx(6e10, rel=1e-6)
    answer = json.loads(plain.read_text())
    assert answer["degrees_of_freedom"] == 5
    assert answer["keys"][E]["from"] < 6e10 < answer["keys"][E]["to"]
    assert figure.stat().st_size > 10_000


def test_a_file_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="No such file"):
        main([str(tmp_path / "none.csv"), "tr_periodic", "--free", E])


# --- units that were mistaken -----------------------------------------------------------------------------------------


def printed(folder: Path, scene: Scene, key: str, text: str, capsys: pytest.CaptureFixture[str]) -> str:
    """Return what the command says of a table, also if it ends in a refusal."""
    (folder / "data.csv").write_text(text, encoding="utf-8")
    (folder / "scene.toml").write_text(scene.to_toml(), encoding="utf-8")
    try:
        assert main([str(folder / "data.csv"), str(folder / "scene.toml"), "--free", key]) == 0
    except SystemExit as end:
        return f"{capsys.readouterr().out}{end}"
    return capsys.readouterr().out


@pytest.mark.parametrize(
    ("units", "says"),
    [
        (("MHz", "MHz"), ()),
        (("kHz", "kHz"), ("times its value at the start; is the column frequency_kHz in MHz?",)),
        (("MHz", "GHz"), ("times the given errors; is the column error_GHz in MHz?", "do not determine")),
        (("MHz", "kHz"), ("times the given errors; is the column error_kHz in MHz?",)),
    ],
)
def test_a_unit_that_was_mistaken_is_said(
    units: tuple[str, str], says: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Points of the closed form, 1 % off by turns, and errors of 1 %
    rows = [
        f"{each.wavenumber},{(1 + 0.01 * (-1) ** n) * each.value / 1e6},{each.value / 1e8}"
        for n, each in enumerate(closed_form(SCENE))
    ]
    head = "wavenumber_rad/row,frequency_{},error_{}\n".format(*units)
    said = printed(tmp_path, SCENE, E, head + "\n".join(rows), capsys)
    assert [each for each in says if each not in said] == []
    assert ("times" in said) == bool(says)


def test_a_key_far_from_its_start_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    soft = closed_form(SCENE.with_values({E: SCENE.sphere.youngs_modulus / 200}))
    rows = [f"{each.branch},{each.wavenumber},{each.value}" for each in soft]
    text = "branch,wavenumber_rad/row,frequency_Hz\n" + "\n".join(rows)
    assert "sphere.youngs_modulus is 0.005 times its start" in printed(tmp_path, SCENE, E, text, capsys)


# --- layers on a substrate -------------------------------------------------------------------------------------------

K_N, K_S, G_S = "substrate.normal_stiffness", "substrate.shear_stiffness", "contact.shear_stiffness"
LAYER = SCENE.with_values(
    {K_N: 2500.0, K_S: 1500.0, "contact.normal_stiffness": 300.0, G_S: 150.0}
    | {"substrate.youngs_modulus": 7.3e10, "substrate.poisson_ratio": 0.17, "substrate.work_of_adhesion": 0.063}
    | {"wave.mode": "S1"}
)


def resonances(**hertz: float) -> list[Point]:
    return [point(value, 0.01 * value, branch=name) for name, value in hertz.items()]


@verifies(
    "Fit of three stiffnesses of a layer to three resonances, relative",
    reference="analytic: the closed form of the layer",
    tolerance=0.002,
    reason="the arm of torques, η, that the closed form leaves out",
    mutant=Mutant(
        "analysis/cases/layer/monolayer.py",
        "lower = 2.5 * neighbours * shear",
        "lower = 2.51 * neighbours * shear",
    ),
)
def test_three_resonances_tell_three_stiffnesses_by_the_closed_form(measured: Measure) -> None:
    sphere = LAYER.sphere
    # Half the neighbours of a sphere in a hexagonal layer, a lattice constant of 1
    bonds = np.array([[1.0, 0.0], [0.5, 0.75**0.5], [-0.5, 0.75**0.5]])
    closed = Layer(bonds, sphere.mass, normal=300.0, shear=200.0, substrate_normal=2600.0, substrate_shear=1800.0)
    vertical, (low, high) = closed.resonances().vertical, closed.resonances().rocking
    points = resonances(**{name: each / (2 * np.pi) for name, each in (("S1", low), ("S2", vertical), ("S3", high))})
    found = Fit(LAYER, points, (K_N, K_S, G_S)).answer()
    measured(np.abs(np.divide(found.values, [2600.0, 1800.0, 200.0]) - 1).max())


def test_the_rocking_pair_knows_nothing_of_the_normal_stiffness_of_the_substrate() -> None:
    found = Fit(LAYER, resonances(S1=1.17e8, S3=4.37e8), (K_N, K_S)).answer()
    assert found.blind == ((K_N,),)


def test_resonances_that_no_layer_has_are_missed_by_the_rocking_pair() -> None:
    found = Fit(LAYER, resonances(S1=1.52e8, S2=2.395e8, S3=5.01e8), (K_N, K_S, G_S)).answer()
    # The pair is nearer than any layer has it: the lower one is found below, and the upper one above
    assert found.residuals[0] < -2 < 2 < found.residuals[2]
    assert abs(found.residuals[1]) < 1e-3


def test_no_layer_has_a_rocking_pair_nearer_than_the_page_says() -> None:
    shears = np.geomspace(1e-3, 1e3, 601)
    bonds = np.array([[1.0, 0.0], [0.5, 0.75**0.5], [-0.5, 0.75**0.5]])
    pairs = [Layer(bonds, 1.0, 1.0, float(each), 1.0, 1.0).resonances().rocking for each in shears]
    # Next to the least ratio its change is of second order in the step of shears, 2.3 %
    assert min(high / low for low, high in pairs) == pytest.approx(np.sqrt(6 + np.sqrt(35)), rel=1e-4)


def test_a_point_far_off_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{each.branch},{each.wavenumber},{each.value / 1e6},1" for each in closed_form(SCENE)]
    data = tmp_path / "data.csv"
    data.write_text("branch,wavenumber_rad/row,frequency_MHz,error_MHz\n" + "\n".join([*rows, "L,1.0,300,1"]) + "\n")
    assert main([str(data), "tr_periodic", "--free", E]) == 0
    assert "line 8 is" in capsys.readouterr().out
