"""Stiffnesses by pair of kinds and with a spread: contacts, modes, decks and runs have them, computed ones too."""

from typing import Any

import numpy as np
import pytest

from granular_analysis.measure import stiffnesses as of_analysis
from granular_analysis.theory.scenes import Setting
from granular_lmp import Scene, prepare
from granular_lmp.crystal import stiffnesses
from granular_lmp.crystal.contacts import FACTORS
from granular_lmp.lammps.laws import of_pair

BASE = Scene.load("tr_periodic").with_values(
    {"packing.rows": 36, "packing.columns": 6, "wave.wavenumber": np.pi / 3, "wave.amplitude": 0.02}
    | {"time.duration": 20.0, "time.timestep": 0.05, "output.particles": 1.0}
)
LAYERS = {"inclusion": [{"rows": [0, 35], "every": 2, "density": 2500.0}]}
PAIRS = [{"of": [1, 0], "normal_stiffness": 700.0}, {"of": [1, 1], "shear_stiffness": 300.0}]
K, G = BASE.sphere.normal_stiffness, BASE.sphere.shear_stiffness
LAYER = Scene.load("monolayer_rocking").with_values(
    {"packing.columns": 6, "time.duration": 20.0, "time.timestep": 0.05}
)


def test_contacts_of_a_pair_have_its_stiffnesses_and_all_keep_their_overlap() -> None:
    problem = prepare(BASE.with_values(LAYERS | {"pair": PAIRS}))
    contacts, row = problem.rest.contacts, problem.rest.atoms.arrays["row"]
    odd = (row % 2 == 1).astype(int)
    kinds = 2 - odd[contacts.i] - odd[contacts.j]  # how many of the two are of the inclusion, on even rows
    expected = np.array([[K, G], [700.0, G], [K, 300.0]])[kinds]
    found = np.stack([contacts.normal_stiffness, contacts.shear_stiffness], axis=1)
    np.testing.assert_allclose(found, expected, rtol=1e-10)  # positions hold 12 digits of an overlap
    np.testing.assert_allclose(contacts.overlap, BASE.sphere.static_overlap, rtol=1e-10)


def test_a_pair_under_a_load_has_its_stiffness_where_the_force_is_the_load() -> None:
    """Hertz: k = (3/2)(cA)^{2/3} F0^{1/3}, so that a stiffness that is larger by s has the factor s^{3/2}."""
    pressed = BASE.with_values({"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7})
    pair = stiffnesses.Pair((0, 1), normal_stiffness=2 * pressed.sphere.normal_stiffness)
    factor, shear = stiffnesses.measured_factors(pair, pressed.sphere.contact_law, 1e-7)
    assert factor == pytest.approx(2**1.5, rel=1e-12)
    assert shear == 1.0


@pytest.mark.parametrize("work", [0.0, 0.05], ids=["Hertz", "DMT"])
@pytest.mark.parametrize("load", [1e-8, 1e-7])
def test_contacts_with_measured_factors_have_both_stiffnesses_at_rest(work: float, load: float) -> None:
    pressed = BASE.with_values({"sphere.work_of_adhesion": work, "packing.contact_force": load}).sphere
    wanted = 2 * pressed.normal_stiffness, 3 * pressed.shear_stiffness
    pair = stiffnesses.Pair((0, 1), *wanted)
    law = pressed.contact_law.times(*stiffnesses.measured_factors(pair, pressed.contact_law, load))
    overlap = law.overlap_under(load)
    found = float(law.normal_stiffness(overlap)), float(law.shear_stiffness(overlap))
    assert found == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("kinds", [LAYERS, {"inclusion": [{"rows": [0, 35], "every": 2, "youngs_modulus": 9e10}]}])
def test_computed_stiffnesses_change_no_force(kinds: dict[str, Any]) -> None:
    plain = prepare(BASE.with_values(kinds))
    contacts, material = plain.rest.contacts, plain.rest.atoms.arrays["row"] % 2
    mixed = material[contacts.i] != material[contacts.j]
    given = {
        f"{name}_stiffness": float(getattr(contacts, f"{name}_stiffness")[mixed][0]) for name in ("normal", "shear")
    }
    problem = prepare(BASE.with_values(kinds | {"pair": [{"of": [0, 1], **given}]}))
    assert problem.rest.atoms.info[FACTORS] == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(problem.rest.contacts.normal_stiffness, contacts.normal_stiffness, rtol=1e-12)
    np.testing.assert_allclose(problem.rest.contacts.shear_stiffness, contacts.shear_stiffness, rtol=1e-12)


def test_a_factor_of_1_leaves_the_words_of_the_deck() -> None:
    plain = prepare(BASE.with_values(LAYERS))
    named = prepare(BASE.with_values(LAYERS | {"pair": [{"of": [1, 1], "shear_stiffness": 100.0}]}))
    assert of_pair(named, 0, 1, {}) == of_pair(plain, 0, 0, {})
    assert of_pair(named, 1, 1, {}) != of_pair(plain, 0, 0, {})


def test_the_curvature_is_given_by_adhesion_over_modulus_where_stiffnesses_are_measured() -> None:
    """k₂ = −k/4Δ0: four times w/E, which is 2^{4/3} of Δ0, leaves k, and takes the curvature down by as much."""
    measured = {"contact.normal_stiffness": 700.0, "contact.shear_stiffness": 500.0}
    one, other = (BASE.with_values(measured | {"sphere.work_of_adhesion": w}).sphere for w in (0.063, 0.252))
    assert other.normal_stiffness == pytest.approx(one.normal_stiffness, rel=1e-12)
    assert other.shear_stiffness == pytest.approx(one.shear_stiffness, rel=1e-12)
    assert other.static_overlap / one.static_overlap == pytest.approx(2 ** (4 / 3), rel=1e-12)


def test_modes_of_layers_in_turn_have_the_stiffnesses_of_their_pairs() -> None:
    scene = BASE.with_values(LAYERS | {"pair": PAIRS, "wave.mode": "3"})
    hertz = prepare(scene).wave.mode.frequency / scene.sphere.time_scale
    assert hertz == pytest.approx(Setting(scene).mode().frequency, rel=1e-9)
    plain = BASE.with_values(LAYERS | {"wave.mode": "3"})
    assert abs(hertz * scene.sphere.time_scale / prepare(plain).wave.mode.frequency - 1) > 0.01
    computed = [{"of": [0, 1], "normal_stiffness": K}, {"of": [1, 1], "shear_stiffness": G}]
    same = prepare(plain.with_values({"pair": computed}))
    assert same.wave.mode.frequency == pytest.approx(prepare(plain).wave.mode.frequency, rel=1e-12)


def test_a_spread_has_its_deviation_and_the_mean_stays() -> None:
    own = stiffnesses.deviates()
    assert len(own) == stiffnesses.CLASSES
    assert np.mean(own) == pytest.approx(0.0, abs=1e-15)
    assert np.var(own) == pytest.approx(1.0, abs=1e-12)
    contacts = prepare(BASE.with_values({"disorder.stiffness": 0.1})).rest.contacts
    ratio = contacts.normal_stiffness / K
    assert np.mean(ratio) == pytest.approx(1.0, abs=1e-12)  # each sphere has six contacts
    assert np.std(ratio) == pytest.approx(0.1, rel=0.05)  # neighbours of 216 spheres are drawn at random
    np.testing.assert_allclose(contacts.shear_stiffness / G, ratio, rtol=1e-12)
    np.testing.assert_allclose(contacts.overlap, BASE.sphere.static_overlap, rtol=1e-10)


def test_contacts_with_a_substrate_are_spread_too() -> None:
    contacts = prepare(LAYER.with_values({"disorder.stiffness": 0.1})).rest.contacts
    found = contacts.normal_stiffness[contacts.on_wall]
    expected = prepare(LAYER).rest.contacts.normal_stiffness[-1] * (1 + 0.1 * stiffnesses.deviates())
    np.testing.assert_allclose(np.unique(found.round(9)), np.sort(expected), rtol=1e-10)


def test_the_network_knows_factors_from_its_own_formulas() -> None:
    factors = np.array([[[1.0, 1.0], [1.2, 0.5]], [[1.2, 0.5], [1.0, 2.0]]])
    walls = np.concatenate([factors, np.ones((2, 1, 2))], axis=1)
    np.testing.assert_allclose(of_analysis.deviates(), stiffnesses.deviates(), atol=1e-14)
    np.testing.assert_allclose(of_analysis.spread(factors, 0.2), stiffnesses.spread(walls, 0.2)[:, :-1], rtol=1e-13)


def test_a_measured_normal_stiffness_leaves_the_shear_force_also_under_a_load() -> None:
    pressed = BASE.with_values({"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7})
    measured = pressed.with_values({"contact.normal_stiffness": 700.0}).sphere
    assert measured.normal_stiffness == pytest.approx(700.0, rel=1e-12)
    deeper = np.sqrt(measured.static_overlap / pressed.sphere.static_overlap)
    assert measured.shear_stiffness == pytest.approx(deeper * pressed.sphere.shear_stiffness, rel=1e-12)
