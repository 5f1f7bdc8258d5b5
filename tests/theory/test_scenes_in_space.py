"""Crystals of scenes in space: theory and package, which share no code, have the same modes and the same names."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory.branches import named_branch, names_of
from granular_analysis.theory.scenes import Setting
from granular_analysis.tools import resonances as script
from granular_lmp import Scene
from granular_lmp.crystal.modes import named_in_space
from granular_lmp.rest.linear import mode_of, physics_of, wave_contacts

SHEET = {"packing.rows": 8, "packing.columns": 3}
SUBSTRATE = {"youngs_modulus": 50e9, "poisson_ratio": 0.3, "work_of_adhesion": 0.05}
ON = {f"substrate.{name}": value for name, value in SUBSTRATE.items()}
MEASURED = {"normal_stiffness": 900.0, "shear_stiffness": 600.0}
FILM = {"packing.lattice": "fcc", "packing.orientation": "[110]"}
SCENES: dict[str, dict[str, Any]] = {
    "hexagonal layer": ON | {"wave.mode": "S1"},
    "hexagonal layer of measured stiffnesses": ON
    | {f"substrate.{name}": value for name, value in MEASURED.items()}
    | {"contact.normal_stiffness": 500.0, "contact.shear_stiffness": 300.0, "wave.mode": "H2"},
    "hexagonal layer, JKR": ON | {"sphere.adhesion_law": "jkr", "wave.mode": "S2"},
    "square layer": ON | {"packing.lattice": "square", "wave.mode": "3"},
    "layer that nothing holds": {"packing.space": 3, "wave.mode": "TR"},
    "fcc [001]": {"packing.lattice": "fcc", "wave.mode": "TR"},
    "fcc [111]": {"packing.lattice": "fcc", "packing.orientation": "[111]", "packing.rows": 6, "wave.mode": "TR"},
    "hcp": {"packing.lattice": "hcp", "wave.mode": "3"},
    "cubic": {"packing.lattice": "cubic", "wave.mode": "L"},
    "film on a substrate": ON | FILM | {"packing.layers": 3, "wave.mode": "S2"},
    "close-packed film": ON | FILM | {"packing.orientation": "[11-2]", "packing.layers": 4, "wave.mode": "5"},
    "film of hcp": ON
    | {"packing.lattice": "hcp", "packing.orientation": "[1-100]", "packing.layers": 3, "wave.mode": "4"},
    "film between two": ON | FILM | {"packing.layers": 2, "substrate.sides": "both", "wave.mode": "S1"},
    "free film": FILM | {"packing.layers": 2, "packing.depth": "free", "wave.mode": "3"},
}


def scene(name: str, **values: Any) -> Scene:
    return Scene.load("tr_periodic").with_values(SHEET | SCENES[name] | values)


@pytest.mark.parametrize("name", SCENES)
def test_the_wave_of_a_scene_in_space_is_that_of_the_package(name: str) -> None:
    declared = scene(name)
    theirs, ours = mode_of(declared), Setting(declared).mode()
    # Rounding of an overlap that is a thousandth of the places
    assert theirs.frequency / declared.sphere.time_scale == pytest.approx(float(ours.frequency), rel=1e-11)
    np.testing.assert_allclose(theirs.shape(), ours.shape, atol=1e-10)


@pytest.mark.parametrize("name", SCENES)
def test_the_names_of_all_branches_are_those_of_the_package(name: str) -> None:
    declared = scene(name)
    theirs = named_in_space(wave_contacts(declared), declared.sphere, declared.vector, physics_of(declared))
    setting = Setting(declared)
    crystal, k = setting.crystal(), setting.wavevector()
    ours = {each: number for each, number in names_of(crystal, k).items() if not each.isdigit()}
    assert ours.keys() == theirs.keys()
    found = crystal.modes(k).frequencies * declared.sphere.time_scale
    # Rounding of the frequency of a sheet that slides freely is the root of that of the highest
    assert {each: pytest.approx(theirs[each][0], rel=1e-10, abs=1e-6) for each in theirs} == {
        each: found[number] for each, number in ours.items()
    }


def test_other_constants_of_a_substrate_are_seen() -> None:
    declared = scene("hexagonal layer")
    for key, factor in (("youngs_modulus", 1.1), ("poisson_ratio", 0.5), ("work_of_adhesion", 1.1)):
        other = declared.with_values({f"substrate.{key}": factor * SUBSTRATE[key]})
        assert abs(Setting(other).mode().frequency / Setting(declared).mode().frequency - 1) > 1e-3


def test_branches_have_the_names_of_their_symmetry_and_numbers() -> None:
    layer, solid = (Setting(scene(name)) for name in ("hexagonal layer", "fcc [001]"))
    names = names_of(layer.crystal(), layer.wavevector())
    assert [name for name in names if name.isdigit()] == list("123456")
    assert {name for name in names if not name.isdigit()} == {"S1", "S2", "S3", "H1", "H2", "H3"}
    assert named_branch(layer.crystal(), layer.wavevector(), "2") == 1
    assert set(names_of(solid.crystal(), solid.wavevector())) >= {"L", "TR", "RT", "S1", "H3", "6"}
    beside = np.array([0.3, 0.5]) * layer.unit
    assert list(names_of(layer.crystal(), beside)) == list("123456")
    with pytest.raises(ValueError, match="mode = 'S4' is not a branch of this crystal; allowed: S1, S2, S3, H1"):
        named_branch(layer.crystal(), layer.wavevector(), "S4")


def test_the_measured_stiffnesses_are_those_of_the_crystal_at_rest() -> None:
    crystal = Setting(scene("hexagonal layer of measured stiffnesses")).crystal()
    law, wall = crystal.bonds.law, crystal.bonds.second < 0
    np.testing.assert_allclose(law.stiffness, np.where(wall, 900.0, 500.0))
    np.testing.assert_allclose(law.shear, np.where(wall, 600.0, 300.0))
    # The law is scaled: overlaps at rest, and f″ over f′, are what they were
    plain = Setting(scene("hexagonal layer")).crystal().bonds.law
    np.testing.assert_allclose(law.reach, plain.reach)
    np.testing.assert_allclose(law.curvature / law.stiffness, plain.curvature / plain.stiffness)


def test_computed_stiffnesses_as_measured_ones_change_nothing() -> None:
    declared = scene("hexagonal layer")
    law, wall = Setting(declared).crystal().bonds.law, -1
    given = {"contact.normal_stiffness": law.stiffness[0], "contact.shear_stiffness": law.shear[0]}
    given |= {"substrate.normal_stiffness": law.stiffness[wall], "substrate.shear_stiffness": law.shear[wall]}
    same = Setting(declared.with_values({name: float(value) for name, value in given.items()})).mode()
    assert float(same.frequency) == pytest.approx(float(Setting(declared).mode().frequency), rel=1e-12)


@pytest.mark.usefixtures("unrendered")
def test_the_command_names_branches_and_tells_of_creep(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = tmp_path / "layer.toml", tmp_path / "fcc.toml"
    for file, name in zip(files, ("hexagonal layer", "fcc [001]"), strict=True):
        file.write_text(scene(name).to_toml())
        script.main([str(file), "-o", str(tmp_path / "figure.png")])
    said = capsys.readouterr().out
    assert "S1 -> S2" in said
    assert "slip accumulates, and spheres creep by" in said
    (line,) = (line for line in said.splitlines() if "TR -> L" in line)
    assert line.split()[:2] == ["resonance", "1.541596"]
