"""Scenes in space: what decides that spheres leave the plane, films, substrates, measured stiffnesses, and refusals."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp.cli import main
from granular_lmp.crystal.mode import PLANE
from granular_lmp.errors import CrystalError
from granular_lmp.problem import prepare
from granular_lmp.rest.held import largest_step
from granular_lmp.rest.initial_fields import initial_fields
from granular_lmp.rest.linear import physics_of
from granular_lmp.rest.scene import Scene

SUBSTRATE = {"youngs_modulus": 73e9, "poisson_ratio": 0.17, "work_of_adhesion": 0.063}
LAYER = Scene.from_dict(
    {
        "sphere": {"radius": 5e-7, **SUBSTRATE, "density": 2200.0},
        "packing": {"rows": 16, "ends": "periodic"},
        "substrate": SUBSTRATE,
        "wave": {"mode": "S1", "wavenumber": np.pi / 4, "amplitude": 0.02},
        "time": {"duration": 10.0},
    }
)
FREE = LAYER.replace(substrate=None, wave={"mode": "L", "wavenumber": np.pi / 4, "amplitude": 0.02})
FILM = {"packing.lattice": "fcc", "packing.orientation": "[110]", "packing.layers": 3}


def test_a_scene_is_in_space_where_something_is_out_of_the_plane() -> None:
    assert FREE.space == 2
    for scene in (LAYER, FREE.with_values({"packing.space": 3}), FREE.with_values({"packing.lattice": "fcc"})):
        assert scene.space == 3
        assert physics_of(scene).space
    assert Scene.loads(LAYER.to_toml()) == LAYER


def test_layers_are_one_on_a_substrate_and_the_fewest_where_the_crystal_is_periodic() -> None:
    assert FREE.with_values({"packing.lattice": "fcc"}).shape.layers == 3
    assert FREE.with_values({"packing.lattice": "hcp", "wave.mode": "S1"}).shape.layers == 4
    assert LAYER.with_values({"packing.lattice": "fcc"}).shape.layers == 1
    film = prepare(LAYER.with_values(FILM))
    assert film.scene.lattice.cell_size == 3
    assert film.rest.atoms.pbc.tolist() == [True, True, False]
    assert set(film.rest.planes) == {"zlo"}
    both = prepare(LAYER.with_values(FILM | {"substrate.sides": "both"}))
    reach = 1 - both.scene.wall.overlap / 5e-7
    assert both.rest.planes["zlo"] == pytest.approx(-reach, abs=1e-12)
    assert both.rest.planes["zhi"] == pytest.approx(both.rest.atoms.positions[:, 2].max() + reach, abs=1e-12)


@pytest.mark.parametrize(("normal", "shear"), [(594.0, 539.0), (700.0, 100.0), (900.0, None), (None, 100.0)])
def test_measured_stiffnesses_are_those_of_the_contacts_and_overlaps_stay(normal: Any, shear: Any) -> None:
    given = {"normal_stiffness": normal, "shear_stiffness": shear}
    scene = FREE.replace(contact={key: value for key, value in given.items() if value})
    assert scene.sphere.normal_stiffness == pytest.approx(normal or FREE.sphere.normal_stiffness, rel=1e-12)
    assert scene.sphere.shear_stiffness == pytest.approx(shear or FREE.sphere.shear_stiffness, rel=1e-12)
    assert scene.sphere.static_overlap == pytest.approx(FREE.sphere.static_overlap, rel=1e-12)
    assert Scene.loads(scene.to_toml()) == scene


def test_measured_stiffnesses_are_met_under_an_outer_force_too() -> None:
    pressed = FREE.with_values({"packing.contact_force": 1e-6, "contact.normal_stiffness": 1200.0})
    assert pressed.sphere.normal_stiffness == pytest.approx(1200.0, rel=1e-12)
    assert float(pressed.sphere.contact_law.force(pressed.sphere.static_overlap)) == pytest.approx(1e-6, rel=1e-9)


def test_fields_in_space_are_the_mode_and_in_the_plane_those_of_the_plane() -> None:
    problem = prepare(LAYER)
    fields = initial_fields(problem.scene, problem.rest.atoms, problem.wave)
    phase = np.exp(1j * np.pi / 4 * (problem.rest.atoms.arrays["row"] - problem.scene.shape.centre_row))
    expected = phase[:, None] * problem.wave.mode.shape()[0]
    np.testing.assert_allclose(fields.displacement, expected.real, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fields.velocity, problem.wave.mode.frequency * expected.imag, rtol=0, atol=1e-12)
    plane, space = (prepare(FREE.with_values({"packing.space": count})) for count in (2, 3))
    flat, solid = (initial_fields(each.scene, each.rest.atoms, each.wave).displacement for each in (plane, space))
    np.testing.assert_allclose(solid, flat, rtol=0, atol=1e-12)
    assert not np.delete(solid, PLANE, axis=1).any()


def test_a_packet_in_space_holds_one_branch() -> None:
    scene = LAYER.with_values({"packing.rows": 96, "envelope.length": 8.0, "wave.mode": "S2"})
    problem = prepare(scene)
    fields = initial_fields(problem.scene, problem.rest.atoms, problem.wave)
    power = np.sum(fields.displacement**2), np.sum(fields.velocity**2)
    assert power[1] / power[0] == pytest.approx(problem.wave.mode.frequency**2, rel=0.1)


def test_a_layer_that_is_pressed_together_is_refused_before_it_runs() -> None:
    with pytest.raises(CrystalError, match="the crystal is not stable"):
        prepare(FREE.with_values({"packing.space": 3, "packing.contact_force": 1e-7}))
    pressed = {"packing.contact_force": 1e-4}
    assert prepare(LAYER.with_values(pressed)).wave.mode.frequency > 0
    soft = {"substrate.normal_stiffness": 30.0, "substrate.shear_stiffness": 20.0}
    with pytest.raises(CrystalError, match="the crystal is not stable"):
        prepare(LAYER.with_values(pressed | soft | {"effects.shear": False, "wave.mode": "S2"}))


def test_spheres_that_are_missing_or_of_another_density_are_at_rest_in_the_lattice() -> None:
    scene = LAYER.with_values({"packing.columns": 6, "disorder.vacancies": 0.1, "disorder.density": 0.05})
    problem = prepare(scene)
    contacts = problem.rest.contacts
    assert len(problem.rest.atoms) < 96
    assert contacts.on_wall.sum() == len(problem.rest.atoms)
    assert np.abs(contacts.contact_force).max() < 1e-6 * scene.sphere.pull_off_force
    assert largest_step(problem.scene) == pytest.approx(largest_step(prepare(LAYER).scene), rel=0.15)


def test_a_layer_that_nothing_holds_is_said() -> None:
    said = FREE.with_values({"packing.space": 3}).remarks()
    assert any(each.startswith("nothing holds the layer along z") for each in said)
    assert not any(each.startswith("nothing holds") for each in (*LAYER.remarks(), *FREE.remarks()))


def said_by(capsys: pytest.CaptureFixture[str], *words: str) -> Any:
    assert main(["modes", *words]) == 0
    return json.loads(capsys.readouterr().out)


def test_modes_says_names_shares_and_group_velocities(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "layer.toml").write_text(LAYER.to_toml())
    modes = said_by(capsys, str(tmp_path / "layer.toml"), "--json")["modes"]
    assert [row["name"] for row in modes.values()] == ["S1", "H1", "S2", "S3", "H2", "H3"]
    for name, row in modes.items():
        shares = [row[each] for each in ("along", "across", "vertical", "rocking", "torsion")]
        assert sum(shares) == pytest.approx(1)
        sagittal = row["name"][0] == "S"
        assert shares[1 if sagittal else 0] == pytest.approx(0, abs=1e-12)
        ahead, behind = (
            prepare(LAYER.with_values({"packing.ends": "fixed", "packing.rows": 41, "wave.mode": name} | k)).wave.mode
            for k in ({"wave.wavenumber": np.pi / 4 + 1e-4}, {"wave.wavenumber": np.pi / 4 - 1e-4})
        )
        per_row = (ahead.frequency - behind.frequency) / 2e-4
        metres = LAYER.lattice.row_distance(LAYER.sphere.lattice_constant) / LAYER.sphere.time_scale
        assert row["group_velocity_m_s"] == pytest.approx([0, per_row * metres], rel=1e-4, abs=1e-2)


@pytest.mark.parametrize(
    ("changes", "corners", "degenerate"),
    [
        ({}, "GMKG", "K"),
        (FILM, "GXMG", "M"),
        ({"packing.lattice": "hcp", "packing.orientation": "[1-100]", "packing.layers": 2}, "GMKG", "K"),
    ],
)
def test_branches_through_the_zone_meet_at_its_corners(
    changes: dict[str, Any], corners: str, degenerate: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "layer.toml").write_text(LAYER.with_values(changes).to_toml())
    table = tmp_path / "path.csv"
    said = said_by(capsys, str(tmp_path / "layer.toml"), "--path", "--json", "--csv", str(table))
    assert "".join(each["name"] for each in said["corners"]) == corners
    assert len(table.read_text().splitlines()) == len(said["table"]) + 1
    at = said["corners"][corners.index(degenerate)]["way"]
    there = np.sort([row["frequency"] for row in said["table"] if row["way"] == at])
    assert np.diff(there).min() < 1e-6  # three-fold and four-fold axes hold pairs


def test_the_density_of_states_of_a_chain_is_the_closed_form(capsys: pytest.CaptureFixture[str]) -> None:
    """Half of the modes are L waves, Ω = Ω₀ sin(ξ/2), (2/π) asin(Ω/Ω₀) of them below Ω; half no contact resists."""
    turned_off = ["--set", "effects.shear=false", "--set", "effects.rotation=false"]
    said = said_by(capsys, "l_chain", *turned_off, "--dos", "--json")["table"]
    hertz, density = np.array([[row["frequency_Hz"], row["density_per_Hz"]] for row in said]).T
    width = hertz[1] - hertz[0]
    edges = hertz + width / 2
    # At the top a chord between wave numbers h = π/15 apart is up to h/4 off, of half of the modes: 1/120.
    # Without chords the frequencies are steps of 1/30, and most bins are empty
    below = 0.5 + np.arcsin(edges / edges[-1]) / np.pi
    np.testing.assert_allclose(np.cumsum(density) * width, below, atol=1 / 120)
    assert (density > 0).all()


def test_the_density_of_states_is_of_all_modes(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "layer.toml").write_text(LAYER.to_toml())
    drawn = tmp_path / "density.png"
    table = said_by(capsys, str(tmp_path / "layer.toml"), "--dos", "12", "--json", "--plot", str(drawn))["table"]
    hertz = np.array([row["frequency_Hz"] for row in table])
    assert sum(row["density_per_Hz"] for row in table) * (hertz[1] - hertz[0]) == pytest.approx(1)
    assert 110e6 < hertz[0] < hertz[-1] < 600e6
    assert drawn.stat().st_size > 1000
