"""Strikers, a state, noise and sources move a layer on its substrate without a wave, as in the network."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.tools.compare import compare
from granular_lmp import Record, Scene, run
from granular_lmp.errors import SceneError
from tests.validation.test_beside_network import LAYERS, STATE, UP, layer


@pytest.fixture(scope="module")
def record_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Record]:
    """Runs of the scenes to a tolerance, each made once."""

    @cache
    def make(name: str) -> Record:
        scene = LAYERS[name].with_values({"time.tolerance": 1e-6})
        return run(scene, tmp_path_factory.mktemp("layer") / "run")

    return make


def test_the_network_is_met_to_the_tolerance_and_another_motion_is_seen(record_of: Callable[[str], Record]) -> None:
    record = record_of("struck from above")
    assert max(compare(record).error.values()) < 1e-6
    signals = record.signals["displacement"].copy()
    signals[..., 2] *= 1 + 1e-4
    assert max(compare(record.with_signals(displacement=signals)).error.values()) > 1e-5


def test_spheres_that_do_not_turn_have_the_spin_0(record_of: Callable[[str], Record]) -> None:
    record = record_of("struck from above")
    still = replace(record, signals={name: values for name, values in record.signals.items() if name != "spin"})
    np.testing.assert_array_equal(still.spin, np.zeros_like(record.spin), strict=True)


def test_an_export_is_a_state_in_space(record_of: Callable[[str], Record], tmp_path: Path) -> None:
    """A file of one time of a run is where another one may begin; here the shear of contacts is 0 at the start."""
    first = record_of("a state in space")
    columns = {name: values[: len(first.spheres)] for name, values in first.si.items()}
    assert {"uz_m", "vz_m_s", "spinx_rad_s", "spiny_rad_s", "spin_rad_s"} <= columns.keys()
    file = tmp_path / "state.csv"
    lines = zip(*(map(repr, values.tolist()) for values in columns.values()), strict=True)
    file.write_text("\n".join([",".join(columns), *map(",".join, lines)]))
    again = run(layer(start={"state": str(file)}, time={"tolerance": 1e-6}), tmp_path / "again")
    np.testing.assert_allclose(again.displacement, first.displacement, atol=1e-9)


def test_the_force_on_a_sphere_has_three_components(tmp_path: Path) -> None:
    record = run(layer(**UP, output={"rows": [4, 4], "forces": True}), tmp_path / "run")
    force = record.signals["force"]
    assert force.shape == record.velocity.shape
    struck = int(np.flatnonzero(record.column == 3)[0])
    # The substrate slows the sphere that leaves it
    assert force[1, struck, 2] < 0 < record.velocity[1, struck, 2]
    assert Record.load(tmp_path / "run").columns["fz"].shape == record.columns["u"].shape


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"substrate": None, **UP}, 'striker 1: direction = "z": leaves the plane; needs a .substrate., or'),
        ({"substrate": None, **STATE}, "uz_m = 2e-12: must be 0 for a sphere in the plane"),
        ({"packing": {"layers": 3}, **UP}, "packing.layers: is only for a lattice in space: must be left out without"),
        ({"packing": {"space": 3}, "substrate": None, **UP}, "packing.space: must be left out without"),
        ({"sphere": {"work_of_adhesion": 0.0}, **UP}, "substrate: holds spheres that adhere to it; needs sphere.work"),
        ({"start": {"state": [[4, 3, 0.0, 0.0, 0.0, 1e-3, 0.0, 1e-9]]}}, "must be .*; in space uz_m, vz_m_s, spinx"),
    ],
    ids=str,
)
def test_what_does_not_go_is_said(tables: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=said):
        run(layer(**tables), tmp_path / "run")


@pytest.mark.parametrize("on", [{"spheres": [[2, 1]], "layers": [2, 2]}, {"rows": [2, 2], "layers": [0, 1]}])
def test_a_source_on_some_layers_moves_a_film_as_its_network(on: dict[str, Any], tmp_path: Path) -> None:
    values = {
        **{"wave.form": "none", "packing.rows": 8, "packing.columns": 3, "packing.layers": 3},
        **{"time.duration": 8.0, "output.particles": 1.0, "time.allow_echo": True},
        "source": [{**on, "force": "z", "signal": "burst", "frequency": 0.8}],
        "monitor": [{"name": "on", "spheres": [[4, 1]], "layers": [1, 2]}],
    }
    record = run(Scene.load("multilayer").with_values(values), tmp_path / "run")
    (placed,), (first, last) = record.problem.sources, on["layers"]
    chosen = record.problem.rest.atoms[placed.spheres]
    assert {*chosen.arrays["layer"].tolist()} == {*range(first, last + 1)}
    assert len(chosen) == (1 if "spheres" in on else 3 * (last - first + 1))
    assert record.monitor("on").spheres.tolist() == [40, 41]
    # The step's error of a motion of the frequency 0.8
    assert max(each for each in compare(record, "network").error.values() if each is not None) < 1e-3


def test_a_single_sphere_of_several_layers_needs_its_layer() -> None:
    film = {"wave.form": "none", "packing.layers": 3, "packing.rows": 8, "packing.columns": 3, "time.allow_echo": True}
    source = {"spheres": [[2, 1]], "force": "z", "signal": "burst"}
    with pytest.raises(SceneError, match=r"spheres = \[\[2, 1\]\]: needs layers, for instance layers = \[2, 2\], in a"):
        Scene.load("multilayer").with_values(film | {"source": [source]})
    with pytest.raises(SceneError, match=r"layers = \[2, 3\]: must be \[first, last\], from 0 to 2"):
        Scene.load("multilayer").with_values(film | {"source": [source | {"layers": [2, 3]}]})
    assert Scene.load("multilayer").with_values(film | {"source": [source | {"layers": [2, 2]}]}).source[0].layers == (
        2,
        2,
    )
