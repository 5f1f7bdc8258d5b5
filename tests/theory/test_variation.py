"""Derivatives of what second order gives are exact, and the numbers that are best by them are best."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from granular_analysis import cli
from granular_analysis.theory.bloch import mode
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.network import Material
from granular_analysis.theory.objectives import Gap, Growth, Passing, Tuned, best, candidates
from granular_analysis.theory.phase_matching import matches
from granular_analysis.theory.rows import Rows, heavy_rows
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.transfer import scattering
from granular_analysis.theory.variation import Place, Spot, Value, Varied, resonance
from granular_analysis.tools.design import Question
from granular_lmp import Scene
from tests.conftest import members

Floats = NDArray[np.float64]
LAYERED = Scene.load("tr_periodic").with_values(
    {"packing.rows": 24, "packing.columns": 3, "inclusion": [{"rows": [0, 23], "every": 2, "density": 4400.0}]}
)
# Of a number, by which differences are taken: they leave out 1e-10 of a third logarithmic derivative, and round, where
# a resonance is found to 1e-13, to 1e-8
SHARE = 3e-5


def agree(function: Callable[[Floats], Value | tuple[Value, ...]], values: Floats, worst: float = 1e-6) -> None:
    """Assert that gradients are those of central differences, to a share of the largest logarithmic derivative."""

    def parts(numbers: Floats) -> list[Value]:
        found = function(numbers)
        return [found] if isinstance(found, Value) else list(found)

    there = parts(values)
    for number, value in enumerate(values):
        step = SHARE * abs(value) * np.eye(len(values))[number]
        for found, below, above in zip(there, parts(values - step), parts(values + step), strict=True):
            difference = (above.value - below.value) / (2 * SHARE * abs(value))
            exact = found.gradient[number]
            assert difference == pytest.approx(exact, abs=worst * max(abs(exact), abs(found.value / value)))


def layers(*keys: str, scene: Scene = LAYERED) -> Place:
    def place(values: NDArray[Any]) -> Spot:
        return Setting(scene, dict(zip(keys, values, strict=True))).spot()

    return place


def checkerboard(values: NDArray[Any]) -> Spot:
    """Two kinds of spheres in a square crystal, of which only unlike ones touch: radii, density, angle."""
    radius, other, density, turn = values
    silica = Material(73e3, 0.17, 63.0)
    effective = 1 / (1 / radius + 1 / other)
    overlap = (2 * np.pi * 63.0 * effective / (2 / 3 * 73e3 / (1 - 0.17**2) * np.sqrt(effective))) ** (2 / 3)
    a = radius + other - overlap
    crystal = Crystal.of(
        a * np.array([[1, 1], [1, -1]]),
        a * np.array([[0, 0], [1, 0]]),
        np.array([radius, other]),
        np.array([2.2e-3 + 0 * density, density]),
        [silica],
    )
    return Spot(crystal, np.array([np.cos(turn), np.sin(turn), 0 * turn]) / a, overlap)


KEYS = ("inclusion.1.density", "packing.contact_force", "sphere.poisson_ratio", "sphere.radius", "wave.direction")
VALUES = np.array([4400.0, 2e-7, 0.17, 5e-7, 80.0])


@pytest.mark.parametrize("law", members(["secant", "incremental"], "incremental"))
def test_derivatives_of_a_resonance_are_those_of_differences(law: str) -> None:
    place = layers(*KEYS, scene=LAYERED.with_values({"effects.shear_law": law}))
    at = resonance(place, VALUES, 1, 3, 0.96).wavenumber.value

    def parts(values: Floats) -> tuple[Value, ...]:
        found = resonance(place, values, 1, 3, at)
        return found.wavenumber, found.frequency, found.growth

    agree(parts, VALUES)


@pytest.mark.parametrize(
    ("key", "value"),
    members([("sphere.poisson_ratio", 0.17), ("packing.contact_force", 2e-7)], ("packing.contact_force", 2e-7)),
)
def test_a_number_that_leaves_the_masses_alone_may_be_varied_alone(key: str, value: float) -> None:
    soft = LAYERED.with_values({"sphere.youngs_modulus": 1e8})  # overlaps, and with them arms of torques, count
    agree(Growth(layers(key, scene=soft), 1, 3, 0.963), np.array([value]))  # the fastest of its resonances


def test_derivatives_by_the_radii_of_a_basis_are_those_of_differences() -> None:
    values = np.array([500.0, 440.0, 4e-3, 0.3])
    agree(Growth(checkerboard, 2, 5, 2.108), values)  # the fastest of its resonances
    gaps = [Gap(checkerboard, branch) for branch in range(5)]
    agree(max(gaps, key=lambda each: each(values).value), values)


def test_a_wrong_derivative_is_told() -> None:
    place = layers("inclusion.1.density")

    def wrong(values: Floats) -> Value:
        value, gradient = resonance(place, values, 1, 3, 0.96).growth
        return Value(value, gradient * (1 + 1e-4))

    with pytest.raises(AssertionError):
        agree(wrong, np.array([4400.0]))


def test_a_spot_has_the_growth_that_the_search_over_wave_numbers_finds() -> None:
    place, values = layers("inclusion.1.density"), np.array([4400.0])
    spot = place(values)
    for each in matches(spot.crystal, spot.unit):
        if each.rate > 0:
            at = resonance(place, values, each.branch, each.target, each.wavenumber / float(np.linalg.norm(spot.unit)))
            growth = each.rate * 2 * np.pi / each.frequency * float(spot.length)
            assert at.growth.value == pytest.approx(growth, rel=1e-10)
            assert at.frequency.value == pytest.approx(each.frequency, rel=1e-12)


def test_branches_that_mix_are_refused() -> None:
    modes = Varied(layers("inclusion.1.density"), np.array([4400.0]), 0.5).here
    same = replace(modes, frequencies=np.array([1.0, 1.0, 2.0, 3.0, 4.0, 5.0]))
    mixing = replace(same, changes=np.ones((2, 6, 6), dtype=complex))
    mixing.shape_changes(2)
    for change in (mixing.shape_changes, mixing.dual_changes):
        with pytest.raises(
            ValueError, match="branch 0 has the same frequency as another branch here, and mixes with it"
        ):
            change(0)
    apart = np.ones((6, 6))
    apart[0, 1] = apart[1, 0] = 0.0
    replace(same, changes=np.stack([apart, apart]).astype(complex)).shape_changes(0)


def test_the_share_that_passes_rows_has_the_derivatives_of_differences() -> None:
    def rows(values: Floats) -> tuple[Rows, Floats]:
        changes = np.zeros((2, 8))
        changes[0, [2, 5]], changes[1, 4] = 1 / values[0], 1 / values[1]
        return heavy_rows(Contact(0.17), [values[0], 1.0, values[1], values[0]]), changes

    for name, frequency in (("TR", 0.3), ("L", 0.5)):
        passing = Passing(rows, frequency, name)
        agree(passing, np.array([3.0, 0.6]))
        share = sum(scattering(rows(np.array([3.0, 0.6]))[0], frequency, name).transmitted.values())
        assert passing(np.array([3.0, 0.6])).value == pytest.approx(share, rel=1e-12)


# --- what is best -----------------------------------------------------------------------------------------------------


def test_the_best_density_of_layers_is_that_of_a_scan() -> None:
    place, bounds = layers("inclusion.1.density"), [(3000.0, 9000.0)]
    fast = Growth(place, 1, 3, 1.1)  # the fastest of its resonances
    found = best(fast, bounds, [np.array([6000.0])])
    scanned = {rho: fast(np.array([rho])).value for rho in (5200.0, 5293.0, 5400.0)}
    assert max(scanned, key=lambda rho: scanned[rho]) == 5293.0
    assert found.values[0] == pytest.approx(5293.4, abs=1.0)
    assert found.value >= max(scanned.values())
    assert found.value > 5 * 0.0316  # of the uniform crystal


def test_a_resonance_is_put_at_a_frequency() -> None:
    place = layers("inclusion.1.density")
    fast = Growth(place, 1, 3, 0.963)  # the fastest of its resonances
    found = best(Tuned(fast, 2 * np.pi * 1.2e8), [(3000.0, 9000.0)], [np.array([4400.0])])
    assert fast.at(found.values).frequency.value == pytest.approx(2 * np.pi * 1.2e8, rel=1e-6)


def test_an_objective_without_a_value_is_refused() -> None:
    with pytest.raises(ValueError, match="the objective has no value between the bounds"):
        best(Growth(layers("inclusion.1.density"), 1, 3, 0.1), [(3000.0, 4000.0)])
    uniform = layers("sphere.density", scene=LAYERED.with_values({"inclusion": [], "wave.mode": "L"}))
    assert {each.resonant.target for each in candidates(uniform, [(2000.0, 2200.0)], points=2)} == {1}


# --- the command ------------------------------------------------------------------------------------------------------


def test_the_command_finds_the_density_and_writes_the_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "layers.toml").write_text(LAYERED.to_toml())
    asked = ["design", str(tmp_path / "layers.toml"), "--vary", "inclusion.1.density", "4000", "7000", "--points", "2"]
    assert cli.main([*asked, "-o", str(tmp_path / "best.toml")]) == 0
    assert "at the resonance xi = 1.1112" in capsys.readouterr().out
    scene = Scene.load(tmp_path / "best.toml")
    assert scene.inclusion[0].density == pytest.approx(5293.4, abs=1.0)
    assert scene.wavenumber == pytest.approx(2 * np.pi * 4 / 24)  # next to 1.1113
    assert cli.main([*asked, "--best", "gap", "--branch", "2"]) == 0
    assert "gap is 0." in capsys.readouterr().out


def test_the_command_tells_what_passes_rows() -> None:
    rows = [{"rows": [30, 30], "density": 4400.0}, {"rows": [32, 33], "density": 3000.0}]
    scene = Scene.load("tr_periodic").with_values({"packing.rows": 64, "inclusion": rows})
    keys, bounds = ("inclusion.1.density", "inclusion.2.density"), ((2500.0, 6000.0), (2300.0, 5000.0))
    passing = Question(scene, keys, bounds, "passing").passing()
    values = np.array([4400.0, 3000.0])
    agree(passing, values)
    linear = scattering(
        heavy_rows(Contact(0.17, overlap_ratio=scene.sphere.overlap_ratio), values[[0]] / 2200), 0.3, "TR"
    )
    assert linear.balance == pytest.approx(1.0)
    masses = [2.0, 1.0, 3000 / 2200, 3000 / 2200]
    omega = passing.frequency
    whole = scattering(heavy_rows(Contact(0.17, overlap_ratio=scene.sphere.overlap_ratio), masses), omega, "TR")
    assert passing(values).value == pytest.approx(sum(whole.transmitted.values()), rel=1e-12)
    with_host = Question(scene, ("sphere.density", *keys), ((2000.0, 2400.0), *bounds), "passing").passing()
    agree(with_host, np.array([2200.0, *values]))
    assert with_host(np.array([2200.0, *values])).value == passing(values).value


def test_what_passes_rows_knows_their_adhesion() -> None:
    rows = [{"rows": [30, 30], "density": 4400.0}]
    scene = Scene.load("tr_periodic").with_values({"packing.rows": 64, "inclusion": rows, "sphere.adhesion_law": "jkr"})
    passing = Question(scene, ("inclusion.1.density",), ((2500.0, 6000.0),), "passing").passing()
    contact = Contact(0.17, overlap_ratio=scene.sphere.overlap_ratio, adhesion_law="jkr")
    whole = scattering(heavy_rows(contact, [2.0]), passing.frequency, "TR")
    assert passing(np.array([4400.0])).value == pytest.approx(sum(whole.transmitted.values()), rel=1e-12)
    assert passing.frequency == pytest.approx(mode("TR", scene.wavenumber, 90.0, contact).frequency, rel=1e-9)


def test_the_least_share_passes_where_rows_are_heaviest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [{"rows": [30, 30], "density": 4400.0}]
    scene = Scene.load("tr_periodic").with_values({"packing.rows": 64, "inclusion": rows})
    (tmp_path / "rows.toml").write_text(scene.to_toml())
    asked = ["design", str(tmp_path / "rows.toml"), "--vary", "inclusion.1.density", "2500", "6000", "--points", "2"]
    said = []
    for least in ([], ["--least"]):
        assert cli.main([*asked, "--best", "passing", *least]) == 0
        said.append(capsys.readouterr().out)
    assert re.search(r"density +2500 ", said[0])
    assert re.search(r"density +6000 ", said[1])
    assert re.search(r"passing is 0\.\d+; 0\.\d+ at the best", said[1])


def test_a_number_on_which_nothing_depends_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["design", "tr_periodic", "--points", "2", "--vary"]
    assert cli.main([*asked, "sphere.density", "2000", "3000"]) == 0
    assert "0: growth does not depend on it" in capsys.readouterr().out
    assert cli.main([*asked, "sphere.poisson_ratio", "0.1", "0.3"]) == 0
    assert "depend" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"contact.normal_stiffness": 600.0}, "leaves out contact.normal_stiffness = 600.0"),
        ({"packing.space": 3}, "leaves out packing.space = 3"),
        ({"effects.rotation": False}, "contact: must have shear and rotation"),
        ({"inclusion": [{"rows": [30, 30], "density": 4400.0, "radius": 4e-7}]}, "not density, radius, rows"),
    ],
)
def test_passing_refuses_what_its_rows_do_not_hold(changes: dict[str, Any], said: str) -> None:
    rows = [{"rows": [30, 30], "density": 4400.0}]
    scene = Scene.load("tr_periodic").with_values({"packing.rows": 64, "inclusion": rows} | changes)
    with pytest.raises(ValueError, match=said):
        Question(scene, ("inclusion.1.density",), ((2500.0, 6000.0),), "passing").passing()


def test_the_jkr_law_keeps_its_overlap() -> None:
    jkr = LAYERED.with_values({"sphere.adhesion_law": "jkr"})
    with pytest.raises(ValueError, match=r"sphere\.radius: must not vary with adhesion_law = 'jkr'; take 'dmt'"):
        layers("sphere.radius", scene=jkr)(np.array([5e-7]))
    place, values = layers("inclusion.1.density", scene=jkr), np.array([4400.0])
    agree(Growth(place, 1, 3, 0.963), values)  # the fastest of its resonances
