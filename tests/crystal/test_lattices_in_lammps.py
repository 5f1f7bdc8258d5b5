"""Scenes of the square lattice and the chain in LAMMPS: beside the linear wave, and each other.

Bounds are errors of the step or of the amplitude, far above last digits, but in the tests that are marked.
"""

from collections.abc import Callable
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.theory.choice import TheoryError, beyond, wave_of
from granular_analysis.tools.compare import compare
from granular_lmp import Record, Scene, build, run
from granular_lmp.crystal.modes import restored
from granular_lmp.errors import EffectError
from granular_lmp.problem import prepare
from granular_lmp.rest.linear import mode_of, unit_contacts
from tests.crystal.test_lattices import scene_of

Run = Callable[..., tuple[Record, Path]]


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


@pytest.mark.parametrize(("lattice", "mode"), [("chain", "RT"), ("square", "TR"), ("square", "RT")])
def test_a_transverse_wave_in_lammps_is_linear_to_the_geometry_of_its_contacts(
    lattice: str, mode: str, record_of: Run
) -> None:
    # No contact is stretched to first order, so that no spring changes. What is left is the slope of a contact, 1e-6 to
    # second order in it, and what the two steps leave, 4e-7 for the fastest wave (Ω = 1.5)
    assert off_linear(scene_of(lattice, mode, wave__amplitude=0.2), record_of) < 5e-6
    assert off_linear(scene_of(lattice, "L", wave__amplitude=0.2), record_of) > 1e-3


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
    with pytest.raises(TheoryError, match=r"leaves out packing\.lattice = 'chain'; theories that hold it: network"):
        compare(record, "exact-lattice")


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
