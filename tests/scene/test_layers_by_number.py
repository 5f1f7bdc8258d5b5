"""Rows of other densities that repeat: waves by the numbers of their branches, in LAMMPS and beside the theory."""

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory.scenes import Setting
from granular_analysis.tools.compare import compare
from granular_lmp import Scene, run
from granular_lmp.cli import main
from granular_lmp.crystal.chain_bands import edges
from granular_lmp.crystal.quiet_ends import frequency_in_run
from granular_lmp.effects.case import Case
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import chain_cell
from granular_lmp.rest.linear import mode_of

Table = dict[str, Any]
HEAVY = 4400.0  # kg/m3, twice silica


def every(step: int, last: int = 23, **changes: Any) -> Table:
    return {"inclusion": [{"rows": [0, last], "every": step, "density": HEAVY} | changes]}


LAYERS = Scene.load("tr_periodic").with_values(
    {
        "packing.rows": 24,
        "packing.columns": "auto",
        "wave.mode": 4,
        "wave.wavenumber": pi / 3,
        "wave.amplitude": 0.02,
        "time.duration": 30.0,
        "time.timestep": 0.0125,
        "time.allow_echo": True,
    }
    | every(2)
)


def layers(**changes: Any) -> Scene:
    return LAYERS.with_values({key.replace("__", "."): value for key, value in changes.items()})


def drift(signal: np.ndarray, tau: np.ndarray, rate: float) -> tuple[float, float]:
    """Return by how much the frequency of a signal lies above a rate, and how fast its amplitude grows, per τ."""
    waves = np.column_stack([np.cos(rate * tau), np.sin(rate * tau)])
    c, s, later_c, later_s = np.linalg.lstsq(np.hstack([waves, tau[:, None] * waves]), signal, rcond=None)[0]
    change = complex(later_c, -later_s) / complex(c, -s)  # (c − is) e^{iΩτ} of the real signal
    return change.imag, change.real


@pytest.mark.parametrize(
    "scene",
    [
        layers(),
        pytest.param(layers(wave__mode=6), marks=pytest.mark.more),
        layers(wave__mode=2, wave__form="standing"),
        pytest.param(
            layers(wave__mode=3, wave__direction=30.0, wave__wavenumber=1.0, packing__columns=24),
            marks=pytest.mark.more,
        ),
        layers(packing__lattice="square", wave__mode=4, **every(3)),
        layers(packing__ends="fixed", packing__rows=81, time__duration=10.0, **every(2, 80)),
        layers(packing__ends="fixed", packing__rows=83, time__duration=10.0, **every(2, 82)),
    ],
    ids=lambda scene: f"{scene.lattice.name} {scene.wave.mode} {scene.wave.form} {scene.shape.ends} {scene.shape.rows}",
)
def test_an_optical_branch_in_lammps_is_that_of_second_order(scene: Scene, tmp_path: Path) -> None:
    record = run(scene, tmp_path / "run")
    found = compare(record)
    assert found.theory == "crystal-second-order"
    heard = [error for error in found.error.values() if error is not None]
    assert heard
    assert max(heard) < 1e-3  # third order leaves a² = 4e-4 of a wave, and the step its phase
    (p, q, _), _ = Setting(scene.with_values({"wave.mode": 1})).signals(record.tau)
    assert np.hypot(record.p - p, record.q - q).max() > 5e-2 * np.hypot(p, q).max()  # another branch is far off


@pytest.mark.parametrize("number", [3, 4, 6])
def test_the_frequency_in_lammps_is_that_of_the_branch(number: int, tmp_path: Path) -> None:
    scene = layers(wave__mode=number, wave__amplitude=0.001, time__duration=60.0)
    record, own = run(scene, tmp_path / "run"), mode_of(scene).frequency
    assert float(Setting(scene).mode().frequency) * scene.sphere.time_scale == pytest.approx(own, rel=1e-10)
    rate, tau = frequency_in_run(own, scene.time.step), record.tau
    _, second = Setting(scene).signals(tau)
    wave = record.p - second[0] if number == 4 else record.q - second[1]
    shift, _ = drift(wave, tau, rate)
    assert abs(shift) < 1e-6 * own


def test_a_packet_of_an_optical_branch_is_that_of_the_network(tmp_path: Path) -> None:
    scene = layers(envelope__length=6.0, packing__rows=96, output__particles=3.0, **every(2, 95))
    found = compare(run(scene, tmp_path / "run"))
    assert found.theory == "network"
    assert found.error["p"] is not None
    assert found.error["p"] < 1e-3


def test_dashpots_damp_a_branch_as_its_decay_rate_says(tmp_path: Path) -> None:
    scene = layers(wave__amplitude=0.002, effects__damping=True, effects__viscosity=2e-9)
    record, case = run(scene, tmp_path / "run"), Case(prepare(scene).scene)
    _, share = drift(record.p, record.tau, mode_of(scene).frequency)
    assert case.decay_rate * 30 > 0.01
    assert share == pytest.approx(-case.decay_rate, rel=0.05)  # a straight line for e^{−Γτ}, half of Γτ


def test_branches_of_a_chain_end_where_its_bands_do() -> None:
    chain = layers(packing__lattice="chain", packing__columns=1)
    edge = chain.with_values({"wave.wavenumber": pi / 2})
    along_y = [mode_of(edge.with_values({"wave.mode": n})) for n in (3, 4, 5, 6)]
    found = [mode.frequency for mode in along_y if mode.uy > 0.9]
    cell = chain_cell(chain)
    assert cell is not None
    (_, acoustic), (optical, _) = edges(*cell)
    assert found == pytest.approx([acoustic, optical], rel=1e-9)


@pytest.mark.parametrize("name", ["L", "TR", "RT"])
def test_named_waves_are_those_of_the_lattice_without_layers(name: str) -> None:
    scene = layers(wave__mode=name)
    assert mode_of(scene) == mode_of(scene.with_values({"inclusion": []}))
    assert scene.wave_lattice is scene.lattice


def test_numbers_in_a_honeycomb_are_those_without_layers() -> None:
    scene = layers(packing__lattice="honeycomb", packing__columns=4, wave__mode=3)
    assert mode_of(scene) == mode_of(scene.with_values({"inclusion": []}))


def test_a_frequency_finds_the_wave_number_of_a_branch() -> None:
    hertz = mode_of(LAYERS).frequency / LAYERS.sphere.time_scale / (2 * pi)
    tables = LAYERS.to_dict()
    tables["wave"] = {key: value for key, value in tables["wave"].items() if key != "wavenumber"} | {"frequency": hertz}
    assert Scene.from_dict(tables).wavenumber == pytest.approx(pi / 3, rel=1e-9)


def test_the_command_modes_lists_the_branches_of_layers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "layers.toml"
    path.write_text(LAYERS.to_toml())
    main(["modes", str(path)])
    said = capsys.readouterr().out
    assert [line.split()[0] for line in said.splitlines()[-6:]] == list("123456")
    assert f"{mode_of(LAYERS).frequency:.12f}" in said
    assert "left out" not in said
