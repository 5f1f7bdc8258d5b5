"""Stiffnesses as measured whose ratio is that of no material: theories need the ratio κ, not Poisson's ratio."""

from pathlib import Path

import numpy as np
import pytest

from granular_analysis import second_harmonic as sh
from granular_analysis.measure.fitting import Fit
from granular_analysis.measure.points import Point
from granular_analysis.theory.contact import Contact, ratios_of
from granular_analysis.theory.phase_matching import matches
from granular_analysis.theory.scenes import Setting
from granular_analysis.tools.compare import compare
from granular_analysis.tools.resonances import rows
from granular_lmp import Scene, run

SOFT = {"contact.normal_stiffness": 500.0, "contact.shear_stiffness": 200.0}  # κ = 0.4, of ν = ¾ if of any
HARD = {"contact.normal_stiffness": 500.0, "contact.shear_stiffness": 300.0}  # κ = 0.6
STIFF = {"contact.normal_stiffness": 500.0, "contact.shear_stiffness": 690.0}  # κ = 1.38; of a material it is below 4/3
TWICE = {"contact.normal_stiffness": 500.0, "contact.shear_stiffness": 1000.0}  # κ = 2, which no ν has
PLANE = Scene.load("tr_nonresonant").with_values(SOFT)
SHORT = {"packing.rows": 24, "packing.columns": 3, "packing.ends": "periodic", "time.duration": 20.0}


@pytest.mark.parametrize("values", [SOFT, HARD, STIFF, TWICE])
def test_resonance_and_antiresonance_are_those_of_the_closed_form(values: dict[str, float]) -> None:
    scene = Scene.load("tr_nonresonant").with_values(values)
    setting, constants = Setting(scene), ratios_of(scene)
    kappa = values["contact.shear_stiffness"] / values["contact.normal_stiffness"]
    assert constants.kappa == pytest.approx(kappa, rel=1e-12)
    found = matches(setting.crystal(), (0, 1))
    (resonance,) = (each.wavenumber / setting.unit for each in found if each.rate > 0)
    assert resonance == pytest.approx(sh.resonance(constants), abs=1e-10)
    silent = [each.wavenumber / setting.unit for each in found if each.kind == "antiresonance" and each.branch == 0]
    # Below κ = ½, where α = 0, the force on L of a TR wave has one sign, and above 3/2, where it vanishes at ξ = 0
    expected = sh.antiresonance(constants)
    assert (expected is None) == (not 0.5 < kappa < 1.5)
    assert silent == pytest.approx([] if expected is None else [expected], abs=1e-9)
    assert [row[2] for row in rows(setting, setting.crystal(), 90.0) if row[6]] == pytest.approx([resonance])


def test_runs_approach_the_exact_lattice_as_the_square_of_the_step(tmp_path: Path) -> None:
    scene, errors = PLANE.with_values(SHORT | {"output.particles": 20.0, "wave.wavenumber": np.pi / 4}), []
    for step in (0.1, 0.05):
        found = compare(run(scene.with_values({"time.timestep": step}), tmp_path / f"{step}"), "exact-lattice")
        errors.append([found.error[name] for name in ("p", "q", "phi")])
    # The order of the step is 2, to what its fourth order leaves
    assert np.log2(np.divide(*errors)) == pytest.approx(np.full(3, 2.0), abs=0.05)
    assert max(errors[1]) < 2e-3
    chosen, network = (compare(found.record, name) for name in (None, "network"))
    assert chosen.theory == "hierarchy"
    assert chosen.error == pytest.approx(found.error, rel=0.05)
    assert network.error == pytest.approx(found.error, rel=1e-3)
    # A lattice of the largest κ of a material is another
    material = Contact(0.5, overlap_ratio=scene.sphere.overlap_ratio)
    assert abs(sh.mode("TR", np.pi / 4, material.closed).frequency - found.wave.mode.frequency) > 0.01


@pytest.mark.parametrize(
    ("name", "rotation", "values", "most"),
    [
        ("fcc_transverse", "phiz", SOFT, 1e-4),
        ("tr_square", "phi", SOFT, 1e-4),
        ("tr_square", "phi", STIFF, 1e-4),
        ("rt_wave", "phi", TWICE, 1e-2),  # its frequency is 2.5, and its shear forces are the largest
    ],
)
def test_other_waves_are_compared_too(
    name: str, rotation: str, values: dict[str, float], most: float, tmp_path: Path
) -> None:
    scene = Scene.load(name).with_values(values | {"time.duration": 10.0, "output.particles": 10.0})
    errors = []
    for step in (0.1, 0.05):
        found = compare(run(scene.with_values({"time.timestep": step}), tmp_path / f"{step}"), "network")
        errors.append(found.error[rotation])  # of the second harmonic the last digits of places are left
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)
    assert errors[1] < most


def test_a_load_that_is_varied_has_the_overlap_of_the_measured_stiffness() -> None:
    pressed = PLANE.with_values({"packing.contact_force": 1e-7})
    varied = Setting(PLANE, {"packing.contact_force": 1e-7})
    assert varied.overlap == pytest.approx(pressed.sphere.static_overlap, rel=1e-12)
    # Without the stiffness the same load presses them nearer by a sixth
    assert varied.overlap != pytest.approx(Setting(Scene.load("tr_nonresonant")).overlap, rel=0.1)
    laws = [each.crystal().bonds.law for each in (varied, Setting(pressed))]
    assert laws[0].push == pytest.approx(laws[1].push, rel=1e-9)


@pytest.mark.parametrize("values", [SOFT, STIFF, TWICE])
def test_stiffnesses_are_found_again_from_frequencies(values: dict[str, float]) -> None:
    scene = Scene.load("tr_nonresonant").with_values(values)
    sphere, constants = scene.sphere, ratios_of(scene)
    points = [
        Point(
            "frequency",
            sh.mode(name, xi, constants).frequency / (2 * np.pi * sphere.time_scale),
            None,
            2,
            branch=name,
            wavenumber=xi,
        )
        for xi in (0.7, 1.4, 2.1)
        for name in ("L", "TR")
    ]
    start = Scene.load("tr_nonresonant").with_values(HARD)
    assert Fit(start, points, tuple(values)).answer().values == pytest.approx([*values.values()], rel=1e-6)


@pytest.mark.parametrize("kappa", [0.0, -0.1, np.inf, np.nan])
def test_constants_need_a_positive_ratio(kappa: float) -> None:
    with pytest.raises(ValueError, match=r"kappa = .* must be positive and finite"):
        sh.of_stiffness(kappa)
    with pytest.raises(ValueError, match="must be positive and finite"):
        Contact(0.17, stiffness_ratio=kappa)
