"""Crystals by the JKR law that are not perfect: LAMMPS against the network, contacts stretched at rest, and guards.

A contact at rest may be pulled beyond an overlap of 0, where LAMMPS begins none by itself.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.snapshot import FirstSnapshot, first_snapshot
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import present, start
from granular_analysis.tools.compare import compare
from granular_lmp import Record, Scene, build, run
from granular_lmp.crystal.contacts import law_between
from granular_lmp.effects import openings
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.studies.features import WAVES
from tests.manual import Measure, Mutant, verifies

SHEET = Scene.load("tr_periodic").with_values(
    {
        "sphere.adhesion_law": "jkr",
        "packing.rows": 24,
        "packing.columns": 6,
        "wave.wavenumber": np.pi / 3,
        "wave.amplitude": 0.05,
        "time.duration": 3.0,
        "time.timestep": 0.02,
        "output.particles": 3.0,
    }
)
STRETCHED = {"disorder.radius": 1.5e-4}  # s = 0.9: at rest seven contacts are pulled beyond an overlap of 0
CHAIN = {"packing.lattice": "chain", "packing.columns": 1, "wave.mode": "L", "disorder.radius": 3e-5}
# Relative. Verlet advances a phase by (Ωh)²/24 of itself: at the top of the branches, Ω = 2.2, 8e-5 of the 7 rad until
# τ = 3, and 3e-6 of 1 rad at the wave's 0.45. A third of the former is allowed, as that branch has a part of the motion
SIGNALS = 2e-4


def agrees(record: Record) -> bool:
    result = compare(record)
    assert result.theory == "network"
    return all(error is None or error < SIGNALS for error in result.error.values())


# --- contacts that are stretched at rest ---


def of_stretched(scene: Scene) -> np.ndarray:
    """Overlaps at rest, in Δ0."""
    return crystal_of(scene).contacts.overlap / scene.sphere.static_overlap


@pytest.fixture(scope="module")
def stretched(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """A run of the stretched crystal, of all contacts of which a monitor has the forces."""
    monitor = {"monitor": [{"name": "all", "rows": [0, 23], "what": "contacts"}]}
    return run(SHEET.with_values(STRETCHED | monitor), tmp_path_factory.mktemp("stretched") / "run")


def test_contacts_that_are_stretched_at_rest_begin_and_no_other(stretched: Record) -> None:
    scene, record = SHEET.with_values(STRETCHED), stretched
    overlap = of_stretched(scene)
    assert -0.3 < overlap.min() < -0.2
    assert np.count_nonzero(overlap < 0) == 7
    assert agrees(record)
    found = record.monitor("all").contacts
    at_rest = crystal_of(scene)
    key = len(at_rest.atoms)
    assert sorted(found.i * key + found.j) == sorted(at_rest.contacts.i * key + at_rest.contacts.j)
    # Each has the force of its own pair of spheres, also where it is stretched. The overlap is what is left of 1000 nm,
    # rounded to 1e-13 nm
    law = law_between(at_rest.atoms, at_rest.materials, found.i, found.j)
    expected = law.force(found.overlap * scene.sphere.static_overlap)
    force = found.normal * scene.sphere.normal_stiffness * scene.displacement_amplitude
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-9 * scene.sphere.pull_off_force)
    assert (found.overlap < 0).any(axis=0).sum() >= 7
    assert record.info["guards"]["open_contacts"]["value"] == 0


def test_without_a_wider_start_the_crystal_falls_apart_and_the_guard_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = SHEET.with_values(STRETCHED | {"effects.contact_opening": True, "effects.friction": 0.5})
    deck = build(scene)
    assert "set          group all diameter v_wider" in deck.input_text
    assert "diameter" not in build(SHEET.with_values(WAVES["densities"])).input_text  # LAMMPS begins all by itself
    begun, parted = deck.input_text.split("# --- begin", 1)
    without = replace(deck, input_text=begun + parted.split("\n\n", 1)[1])
    record = run(without, tmp_path / "run")
    assert record.info["guards"]["open_contacts"]["value"] >= 6  # one of seven may be pushed together again
    assert not agrees(record)


# --- openings ---


def opened(first: FirstSnapshot, tau: np.ndarray) -> int:
    """The most contacts, along x or along y, by which the network differs from its rest at any of these times."""
    pairs = first.state.pairs
    along = np.abs(pairs.apart) > first.radius / 2
    rest = along[:, pairs.overlap > pairs.normal.end].sum(axis=1)
    most, state, before = 0, first.state, 0.0
    for time in tau[1:]:
        state = integrate(first.network, state, [(time - before) * first.time], rtol=1e-6).final
        assert state.pairs is pairs  # none has moved far
        before = time
        most = max(most, int(np.abs(along[:, present(first.network, state).closed].sum(axis=1) - rest).max()))
    return most


@pytest.mark.parametrize(("amplitude", "some"), [(0.05, False), (0.6, True)])
@verifies(
    "Guard of openings in LAMMPS, unequal spheres by JKR: the most contacts open at once, less",
    reference="other code: the network of the same spheres",
    tolerance=0.0,
    reason="contacts are counted at the looks of the deck",
    mutant=Mutant(
        "granular_lmp/effects/openings.py", "f_along_{axis}[3][2]-{count})", "f_along_{axis}[3][2]-{count + 1})"
    ),
)
def test_the_guard_counts_the_contacts_that_open_in_the_network(
    amplitude: float, some: bool, tmp_path: Path, measured: Measure
) -> None:
    allowed = {"effects.contact_opening": True, "effects.sliding": False, "effects.shear": False}
    wave = {"wave.mode": "L", "wave.amplitude": amplitude, "time.sample": 0.1, "time.timestep": 0.01}
    record = run(SHEET.with_values(STRETCHED | allowed | wave), tmp_path / "run")
    looks = np.arange(0, record.tau[-1], record.info["looks"]["every_tau"])
    expected = opened(first_snapshot(record), looks)
    assert (expected > 1) is some
    measured(record.info["guards"]["open_contacts"]["value"] - expected)


def test_a_run_in_which_contacts_open_fails_if_the_scene_does_not_allow_it(tmp_path: Path) -> None:
    pulled = {"wave.mode": "L", "wave.amplitude": 0.3, "effects.friction": 5.0, "effects.sliding": False}
    with pytest.raises(Exception, match="contact_opening triggered its guard"):
        run(SHEET.with_values(STRETCHED | pulled | {"effects.contact_opening": False}), tmp_path / "run")


def test_spheres_that_have_parted_do_not_touch_before_they_overlap(stretched: Record) -> None:
    first = first_snapshot(stretched)
    pairs, i = first.state.pairs, int(np.argmin(np.where(first.state.begun, first.state.pairs.overlap, np.inf)))
    assert pairs.overlap[i] < 0
    parted = replace(first.state, begun=first.state.begun & (np.arange(len(pairs.overlap)) != i))
    assert present(first.network, first.state).closed[i]
    assert not present(first.network, parted).closed[i]


# --- runs ---


def test_ends_that_are_held_do_not_trigger_the_guards(tmp_path: Path) -> None:
    held = {"packing.ends": "fixed", "packing.rows": 61, "wave.wavenumber": 1.0, "time.duration": 4.0}
    record = run(SHEET.with_values(STRETCHED | held | {"output.particles": 0.0}), tmp_path / "run")
    assert record.info["guards"]["open_contacts"]["value"] == 0
    assert record.info["guards"]["largest_slip"]["value"] < 0.5


@pytest.mark.parametrize(
    ("changes", "near", "axes"),
    [
        (STRETCHED, openings._NEAR, "x"),
        (STRETCHED, 1.6, "xy"),  # if spheres of every second row could meet, which are along y
        (CHAIN, openings._NEAR, "y"),
        ({"disorder.density": 0.1}, openings._NEAR, ""),  # spheres of one size: within the pull-off distance of each
    ],
)
def test_the_deck_counts_along_the_axes_that_the_crystal_needs(
    changes: dict[str, Any], near: float, axes: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(openings, "_NEAR", near)
    scene = SHEET.with_values(changes)
    components = np.abs(crystal_of(scene).contacts.vector[:, :2]).T / scene.sphere.radius
    assert not axes or (components[["xy".index(axis) for axis in axes]] > 0.5).any(axis=0).all()
    text = build(scene).input_text
    for axis, component in zip("xy", components, strict=True):
        counted = f"abs(f_along_{axis}[1][2]+f_along_{axis}[3][2]-{np.count_nonzero(component > 0.5)})"
        assert (counted in text) is (axis in axes)
    assert ("diameter" in text) is openings.begins_wider(prepare(scene))


def test_the_start_state_of_the_network_knows_the_contacts_of_its_rest(stretched: Record) -> None:
    """A wave that starts with spheres apart does not lose the contacts that are within the pull-off distance."""
    first = first_snapshot(stretched)
    motion = first.state.motion
    again = start(first.network, motion[:2].T, motion[3:5].T, motion[2], motion[5])
    assert np.count_nonzero(again.begun) == len(crystal_of(stretched.scene).contacts)
