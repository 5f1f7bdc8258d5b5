"""Creep: slip that winds up moves a layer away; it is predicted and measured, and limits how long a run may be."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory.creep import creep_velocity
from granular_analysis.theory.scenes import Setting
from granular_lmp import Scene, run
from granular_lmp.crystal.creep import creep_velocities
from granular_lmp.effects.selection import select
from granular_lmp.errors import EffectError
from granular_lmp.rest.linear import mode_of, physics_of, wave_contacts
from tests.conftest import latin
from tests.manual import ROOT, Measure, Mutant, off, verifies

LAYER = Scene.load("monolayer_rocking").with_values(
    {"packing.rows": 8, "wave.wavenumber": np.pi / 4, "wave.amplitude": 0.2, "output.particles": 0}
)
OBLIQUE = {"packing.columns": 8, "wave.direction": 30.0}
FILM = {"packing.lattice": "fcc", "packing.layers": 3}


def predicted(scene: Scene) -> Any:
    """Return the finding about creep, None where nothing is known of it."""
    return next((each for each in select(scene) if each.name == "creep"), None)


@pytest.mark.parametrize(
    ("values", "mode", "law"),
    latin([{}, {"packing.lattice": "square"}, OBLIQUE, FILM], "123456", ["secant", "incremental"]),
    ids=str,
)
@verifies(
    "Creep of layers and films as slip winds up, six branches, two shear laws",
    reference="other code: the second-order theory",
    tolerance=1e-09,
    reason="rounding: both count spheres of a film in their own order",
    mutant=Mutant(
        "granular_lmp/crystal/creep.py",
        "aside * stretch.conj() + across * twist.conj()",
        "aside * stretch.conj() - across * twist.conj()",
    ),
)
def test_spheres_creep_as_the_theory_of_analysis_has_it(
    values: dict[str, Any], mode: str, law: str, measured: Measure
) -> None:
    scene = LAYER.with_values({**values, "wave.mode": mode, "effects.shear_law": law})
    theirs = Setting(scene)
    size = scene.displacement_amplitude
    there = creep_velocity(theirs.crystal(layers=False), theirs.mode().times(size))
    ours = creep_velocities(
        wave_contacts(scene), scene.sphere, mode_of(scene), physics_of(scene), incremental=law == "incremental"
    )
    expected = there / size**2 * scene.sphere.time_scale
    # Both count the spheres of a film in their own order
    measured(off(np.sort(ours, axis=0), np.sort(expected, axis=0)))
    assert np.abs(expected).max() > 0


# Runs that no formula was fitted to; far from resonances, where the next order adds little
@pytest.mark.parametrize(
    ("values", "mode", "duration"),
    [
        ({}, "H1", 300.0),
        ({"packing.lattice": "square", "wave.amplitude": 0.3}, "H2", 200.0),
        pytest.param(OBLIQUE, "5", 300.0, marks=pytest.mark.more),
    ],
    ids=str,
)
@verifies(
    "Creep of layers in LAMMPS, three waves",
    reference="analytic: the package's prediction for the run",
    tolerance=0.1,
    reason="oscillations that the start launches have a tenth of the creep by then",
    mutant=Mutant(
        "granular_lmp/effects/creep.py",
        "return found[:, :2] * scene.displacement_amplitude",
        "return 1.2 * found[:, :2] * scene.displacement_amplitude",
    ),
)
def test_a_run_creeps_as_its_finding_says(
    tmp_path: Path, values: dict[str, Any], mode: str, duration: float, measured: Measure
) -> None:
    scene = LAYER.with_values({"wave.mode": mode, "time.duration": duration, **values})
    found = run(scene, tmp_path / "run").info["guards"]["largest_creep"]["value"]
    # Oscillations that the start launches have a tenth of the creep by then
    measured(found / predicted(scene).number - 1)


# What docs/effects.md says of creep, in D0: from where it is expected, and the limit of the guard
EXPECTED, LIMIT = (
    float(number)
    for words in (r"by ([\d.]+) \*D\*₀ in the run", r"`largest_creep`: ([\d.]+) \*D\*₀")
    for number in re.findall(words, (ROOT / "docs" / "effects.md").read_text("utf-8"))
)


def test_a_long_run_is_expected_to_creep() -> None:
    rate = predicted(LAYER).number / LAYER.time.duration
    shortest = EXPECTED / rate
    assert not predicted(LAYER.with_values({"time.duration": 0.5 * np.floor(2 * shortest)})).on
    assert predicted(LAYER.with_values({"time.duration": 0.5 * np.ceil(2 * shortest)})).on
    # As time and as the square of the amplitude, over the amplitude that is the unit
    twice = LAYER.with_values({"wave.amplitude": 0.4})
    assert predicted(twice).number == pytest.approx(2 * predicted(LAYER).number)


STRONG = LAYER.with_values({"wave.mode": "S2", "effects.shear_law": "incremental", "time.duration": 30.0})


def test_a_run_that_was_expected_to_creep_says_when_it_did(tmp_path: Path) -> None:
    info = run(STRONG, tmp_path / "run").info
    said, guard = info["effects"]["creep"], info["guards"]["largest_creep"]
    assert said["on"]
    assert guard["limit"] == LIMIT
    assert guard["value"] == pytest.approx(said["number"], rel=0.1)
    assert 0 < guard["passed_at"] < 30
    assert not guard["judges"]


def test_a_run_that_creeps_unexpectedly_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("granular_lmp.effects.creep._EXPECTED", 1.0)
    with pytest.raises(EffectError, match=r"creep triggered its guard at tau = .*moves the layer"):
        run(STRONG, tmp_path / "run")


@pytest.mark.parametrize(
    "values",
    [
        {"wave.form": "standing"},
        {"envelope.length": 6.0, "packing.rows": 64},
        {"disorder.density": 0.1},
        {"wave.amplitude": 3.0},
        {"effects.friction": 0.02},
        {"effects.rotation": False, "effects.tracking": False, "wave.mode": "1"},
    ],
    ids=str,
)
def test_no_creep_is_known_of_other_waves(values: dict[str, Any]) -> None:
    assert predicted(LAYER.with_values(values)) is None


def test_a_bulk_crystal_of_one_sphere_a_cell_does_not_creep() -> None:
    assert predicted(Scene.load("fcc_transverse")) is None
    assert predicted(Scene.load("tr_periodic")) is None
