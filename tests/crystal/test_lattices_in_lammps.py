"""Scenes of the square lattice and the chain in LAMMPS: beside the linear wave, the network, and each other.

Bounds are errors of the step or of the amplitude, far above last digits, but in the tests that are marked.
"""

from collections.abc import Callable
from dataclasses import replace
from math import pi, tan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.snapshot import read_network
from granular_analysis.theory.choice import TheoryError, beyond, wave_of
from granular_analysis.theory.network import Material
from granular_analysis.theory.network_motion import integrate
from granular_analysis.tools.compare import compare
from granular_lmp import Record, Scene, build, run
from granular_lmp.accuracy.second_harmonic import second_harmonic
from granular_lmp.crystal.modes import restored
from granular_lmp.errors import EffectError
from granular_lmp.problem import prepare
from granular_lmp.rest.linear import mode_of, unit_contacts
from tests.crystal.test_lattices import scene_of

Run = Callable[..., tuple[Record, Path]]
WAVES = [("chain", "L"), ("chain", "RT"), ("square", "L"), ("square", "TR"), ("square", "RT")]


@pytest.fixture
def record_of(tmp_path: Path) -> Run:
    """Return a function that runs a scene in a folder of its own."""

    def make(scene: Scene) -> tuple[Record, Path]:
        folder = tmp_path / f"run{len(list(tmp_path.iterdir()))}"
        return run(scene, folder), folder

    return make


def signals(record: Record) -> np.ndarray:
    """Return p, q and φ, (3, T); φ is 0 where spheres do not turn."""
    return np.nan_to_num(np.array([record.p, record.q, record.phi]))


def extrapolated(scene: Scene, record_of: Run) -> np.ndarray:
    """Return the signals without the error of second order in the step."""
    coarse, fine = (record_of(scene.with_values({"time.timestep": step}))[0] for step in (0.05, 0.025))
    return (4 * signals(fine) - signals(coarse)) / 3


def off_linear(scene: Scene, record_of: Run) -> float:
    """Return the distance of a run from the linear wave, over that wave."""
    mode, tau = mode_of(scene), scene.time.sample * np.arange(scene.time.samples + 1)
    angle = mode.frequency * tau
    linear = np.array([mode.p * np.cos(angle), mode.q * np.cos(angle), mode.f * np.sin(angle)])
    return float(np.linalg.norm(extrapolated(scene, record_of) - linear) / np.linalg.norm(linear))


@pytest.mark.parametrize("lattice", ["chain", "square"])
def test_a_longitudinal_wave_in_lammps_is_linear_to_first_order_in_its_amplitude(lattice: str, record_of: Run) -> None:
    large, small = (off_linear(scene_of(lattice, "L", wave__amplitude=a), record_of) for a in (0.02, 0.01))
    assert small < 1e-3
    # The second harmonic is of order a; terms of order a² are a few hundredths of it
    assert np.log2(large / small) == pytest.approx(1, abs=0.05)


def test_the_second_harmonic_of_a_chain_has_its_closed_form(record_of: Run) -> None:
    scene = scene_of("chain", "L", wave__amplitude=0.01, time__duration=60.0)
    found = second_harmonic(record_of(scene)[0])
    assert found is not None
    # (a/8) cot(ξ/2) to lowest order; the next is of relative order a, 1e-3 here
    assert found.amplitude == pytest.approx(0.01 / 8 / tan(pi / 8), rel=3e-3)


@pytest.mark.parametrize(("lattice", "mode"), [wave for wave in WAVES if wave[1] != "L"])
def test_a_transverse_wave_in_lammps_is_linear_to_the_geometry_of_its_contacts(
    lattice: str, mode: str, record_of: Run
) -> None:
    # No contact is stretched to first order, so that no spring changes. What is left is the slope of a contact, 1e-6 to
    # second order in it, and what the two steps leave, 4e-7 for the fastest wave (Ω = 1.5)
    assert off_linear(scene_of(lattice, mode, wave__amplitude=0.2), record_of) < 5e-6
    assert off_linear(scene_of(lattice, "L", wave__amplitude=0.2), record_of) > 1e-3


@pytest.mark.parametrize(("lattice", "mode"), WAVES)
def test_a_run_moves_as_the_network_to_the_error_of_its_step(lattice: str, mode: str, record_of: Run) -> None:
    scene = scene_of(lattice, mode, wave__amplitude=0.2, output__particles=5.0)
    scene = scene.with_values({f"effects.{name}": True for name in ("shear", "rotation", "tracking")})
    _, folder = record_of(scene)
    network, state = read_network(folder / "dump.particles", [Material(73e3, 0.17, 63.0)], density=0.0022)  # units nano
    assert np.isinf(network.cell[0]) == (lattice == "chain")
    times = scene.sphere.time_scale * 1e9 * scene.time.sample * np.arange(scene.time.samples + 1)
    centre = scene.shape.centre_row * scene.shape.columns + scene.shape.columns // 2
    size = scene.displacement_amplitude * 1e9

    def witness(density: float) -> np.ndarray:
        crystal = replace(network, density=np.full_like(network.density, density))
        motion = integrate(crystal, state, times[1:], rtol=1e-10).motion[:, :, centre]
        return np.array([motion[:, 1], -motion[:, 0], motion[:, 2] * 500.0]) / size

    ours = extrapolated(scene, record_of)[:, 1:]
    # The phase error e = Ωτ(Ωh)²/24 of the coarse run is at most 1.7e-3, and the pair leaves e²/8 = 4e-7 of it
    assert np.abs(ours - witness(0.0022)).max() < 1e-6
    assert np.abs(ours - witness(0.0022 * 1.001)).max() > 1e-5


@pytest.mark.rounding
def test_the_width_of_a_square_sheet_and_the_repeats_of_a_cell_change_nothing(record_of: Run) -> None:
    nine = {"packing.rows": 9, "wave.wavenumber": 2 * pi / 9}
    plain = signals(record_of(scene_of("square", "TR").with_values(nine))[0])
    for other in ({"packing.columns": 5}, {"packing.rows": 18}):
        again = signals(record_of(scene_of("square", "TR").with_values(nine | other))[0])
        np.testing.assert_allclose(again, plain, rtol=0, atol=1e-9)  # D0; positions of 2e4 nm carry 4e-12/D0 = 1e-10


def test_a_chain_has_free_space_beside_it(record_of: Run) -> None:
    deck = build(scene_of("chain", "RT"))
    assert "boundary     f p p" in deck.input_text
    assert np.ptp(deck.data.box[0]) == 4 * 500.0  # nm: images, if there were any, would not touch
    assert "epsilon" not in record_of(scene_of("chain", "RT"))[0].info  # the paper's lattice alone has one


def test_no_theory_of_the_hexagonal_lattice_is_compared_with_another(record_of: Run) -> None:
    record, _ = record_of(scene_of("chain", "L"))
    assert beyond(wave_of(record)) == ["packing.lattice = 'chain'"]
    with pytest.raises(TheoryError, match=r"leaves out packing\.lattice = 'chain'; that hold it: network"):
        compare(record, "exact-lattice")


@pytest.mark.parametrize(("name", "mode", "place"), [("square", "TR", [3, 1]), ("chain", "L", [3, 0])])
def test_a_crystal_of_another_lattice_that_is_not_perfect_is_compared_with_its_network(
    name: str, mode: str, place: list[int], record_of: Run
) -> None:
    heavy = {"inclusion": [{"spheres": [place], "density": 20000.0}], "time.duration": 4.0}
    heavy |= {"packing.columns": 4 if name == "square" else 1}
    record, _ = record_of(scene_of(name, mode).with_values(heavy | {"output.particles": 0.5}))
    found = compare(record)
    assert found.theory == "network"
    # The step h leaves (Omega h)^2/24 of a phase Omega tau, at most 4.2e-4 D0 for Omega = 1, h = .05 and tau = 4;
    # another mass is seen as percents
    assert found.signals is not None
    ours, theirs = (record.p, record.q), found.signals[:2]
    assert np.abs(np.subtract(ours, theirs)).max() < 4.2e-4
    other, _ = record_of(scene_of(name, mode).with_values({"time.duration": 4.0}))
    assert np.abs(other.p - record.p).max() + np.abs(other.q - record.q).max() > 1e-2


# --- a chain that is pressed together --------------------------------------------------------------------------------

ADHESIVE = scene_of("chain", "L", packing__columns=1, output__particles=1.0)
PRESSED = ADHESIVE.with_values(
    {"sphere.work_of_adhesion": 0.0, "packing.contact_force": ADHESIVE.sphere.pull_off_force}
)


@pytest.mark.rounding
def test_a_chain_is_the_same_pressed_together_or_held_together_by_adhesion(tmp_path: Path) -> None:
    assert PRESSED.sphere.static_overlap == pytest.approx(ADHESIVE.sphere.static_overlap, rel=1e-15)
    one, other = (run(scene, tmp_path / name) for name, scene in (("adhesive", ADHESIVE), ("pressed", PRESSED)))
    # Forces differ by a constant, which cancels; positions of 2 µm are rounded to 4e-13 nm of D0 = 0.05 nm
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=1e-9)
    assert np.abs(one.p).max() > 0.5
    assert other.info["guards"]["largest_sideways"]["value"] == 0.0


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({}, marks=pytest.mark.more),
        {"disorder.radius": 1e-5},
        {"inclusion": [{"rows": [2, 3], "density": 4000.0}]},
        {"striker": [{"spheres": [[1, 0]], "velocity": 0.05}]},
    ],
    ids=["perfect", "radii", "densities", "struck"],
)
def test_the_network_judges_a_chain_that_is_pressed_together(changes: dict[str, Any], tmp_path: Path) -> None:
    found = compare(run(PRESSED.with_values({"time.tolerance": 1e-4} | changes), tmp_path / "run"), theory="network")
    assert found.error["p"] < 1e-4  # the tolerance


def test_a_sphere_that_leaves_the_line_of_a_chain_fails_the_run(tmp_path: Path) -> None:
    deck = build(PRESSED)
    wave = deck.data.wave.copy()
    wave[3, 0] = 1e-4  # sideways
    with pytest.raises(EffectError, match=r"width triggered its guard at tau = 0: largest_sideways = .*buckles"):
        run(replace(deck, data=replace(deck.data, wave=wave)), tmp_path / "run")
    assert restored(unit_contacts(PRESSED)) == ("L",)
    assert restored(unit_contacts(ADHESIVE)) == ("L", "RT")
    shaken = PRESSED.with_values({"wave.form": "none", "source": [{"spheres": [[3, 0]], "motion": "y"}]})
    assert "largest_sideways" in prepare(shaken).judged
