"""A wave declared by its frequency: the wave numbers that have it, and what is said of them."""

import re
from itertools import pairwise
from math import pi

import pytest

from granular_lmp import Scene, build
from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import bloch_mode
from granular_lmp.crystal.wavevector import WaveVector, zone_edge
from granular_lmp.errors import SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest.frequency import wavenumbers_at
from granular_lmp.rest.linear import physics_of
from granular_lmp.studies.sweep_points import scene_hash
from tests.conftest import members

PAPER = Scene.load("tr_nonresonant")
OPEN = PAPER.with_values({"packing.rows": "auto", "packing.ends": "periodic", "time.duration": 5.0})


def hertz(scene: Scene, wavenumber: float, degrees: float = 90.0) -> float:
    """Return the frequency of the scene's mode at a wave number."""
    vector = WaveVector.of(wavenumber, degrees)
    mode = bloch_mode(unit_lattice(scene.sphere), scene.sphere, vector, scene.wave.mode, physics_of(scene))
    return mode.frequency / scene.sphere.time_scale / (2 * pi)


@pytest.mark.parametrize("mode", ["L", "TR", "RT"])
@pytest.mark.parametrize("wavenumber", [0.1, 0.802, 2.5])
def test_the_wave_number_of_a_frequency_is_among_those_found(mode: str, wavenumber: float) -> None:
    scene = PAPER.with_values({"wave.mode": mode})
    found = wavenumbers_at(hertz(scene, wavenumber), scene.sphere, physics_of(scene), mode, 90.0)
    # Bisection to the last bits of ξ; Ω(ξ) is flat to 1e-3 at the most here, which costs three digits
    assert min(abs(each - wavenumber) for each in found) < 1e-11
    assert list(found) == sorted(found)


def test_every_wave_number_found_has_the_frequency_also_where_there_are_two() -> None:
    scene = PAPER.with_values({"wave.mode": "L"})  # sin(ξ/2) along y rises; along x L has its top inside the zone
    frequency = hertz(scene, 3.5, 0.0)
    found = wavenumbers_at(frequency, scene.sphere, physics_of(scene), "L", 0.0)
    assert len(found) == 2
    for each in found:
        assert hertz(scene, each, 0.0) == pytest.approx(frequency, rel=1e-12)
    chosen = OPEN.with_values({"wave.mode": "L", "wave.direction": "x", "wave.frequency": frequency})
    assert chosen.wave.wavenumber == found[0]
    assert f"the smallest is taken, {found[1]:.6g} has this frequency too" in chosen.remarks()[0]


def test_a_jump_between_branches_is_no_wave_number() -> None:
    """In oblique directions names pass from branch to branch; every wave number that is found has the frequency."""
    for mode in ("L", "TR", "RT"):
        scene = PAPER.with_values({"wave.mode": mode})
        for share in (0.3, 0.6, 0.9):
            frequency = hertz(scene, share * pi, 10.0)
            found = wavenumbers_at(frequency, scene.sphere, physics_of(scene), mode, 10.0)
            assert min(abs(each - share * pi) for each in found) < 1e-9
            assert [hertz(scene, each, 10.0) for each in found] == pytest.approx([frequency] * len(found), rel=1e-9)


@pytest.mark.parametrize("mode", members(["L", "RT"], "L"))
def test_a_frequency_between_two_branches_of_one_name_is_refused(mode: str) -> None:
    scene, edge = PAPER.with_values({"wave.mode": mode}), zone_edge(45.0)
    branch = [hertz(scene, edge * k / 400, 45.0) for k in range(1, 401)]
    before, after = max(pairwise(branch), key=lambda pair: abs(pair[1] - pair[0]))
    assert abs(after - before) > 10 * abs(branch[200] - branch[199])  # a jump, and no slope
    with pytest.raises(SceneError, match=rf"no {mode} wave at 45 degrees from x has it"):
        wavenumbers_at((before + after) / 2, scene.sphere, physics_of(scene), mode, 45.0)


def test_a_frequency_outside_the_band_names_the_band() -> None:
    top = hertz(PAPER, pi)
    with pytest.raises(SceneError, match=re.escape(f", {top:.6g}] Hz in this lattice")):
        PAPER.with_values({"wave.frequency": 1e9})
    just_inside = PAPER.with_values({"wave.frequency": top * (1 - 1e-9)})
    assert just_inside.wave.wavenumber < pi


@pytest.mark.parametrize("name", ["tr_square", "tr_periodic", "fcc_transverse", "monolayer_rocking"])
def test_a_wave_vector_is_that_of_a_wave_number_and_a_direction_in_every_lattice(name: str) -> None:
    scene = Scene.load(name).with_values({"wave.wavenumber": 0.5, "wave.direction": 60.0, "packing.ends": "periodic"})
    found = scene.with_values({"wave.wavevector": list(scene.declared_vector.components)})
    assert found.wave.wavenumber == pytest.approx(0.5, rel=1e-12)
    assert found.wave.degrees == pytest.approx(60.0, rel=1e-12)
    with pytest.raises(SceneError, match=r"wave\.wavevector = \[3\.0, 6\.0\]: must be in the Brillouin zone"):
        scene.with_values({"wave.wavevector": [3.0, 6.0]})


def test_a_wave_vector_in_a_honeycomb_and_a_chain_is_over_the_distance_of_spheres() -> None:
    comb = {
        "packing.lattice": "honeycomb",
        "packing.ends": "periodic",
        "wave.mode": "2",
        "packing.rows": 24,
        "packing.columns": 4,
    }
    scene = PAPER.with_values(comb | {"wave.wavevector": [0.0, 0.4]})
    # Rows are 3/2 of the distance of two spheres apart
    assert scene.wave.wavenumber == pytest.approx(0.6, rel=1e-12)
    chain = Scene.load("l_chain").with_values({"wave.wavevector": [0.0, 0.4]})
    assert chain.wave.wavenumber == pytest.approx(0.4, rel=1e-12)


@pytest.mark.parametrize("other", ["wavenumber", "wavevector"])
def test_a_frequency_excludes_what_it_stands_for(other: str) -> None:
    tables = PAPER.to_dict()
    tables["wave"] |= {"frequency": 8e7, other: 0.8 if other == "wavenumber" else [0.0, 1.0]}
    if other == "wavevector":
        del tables["wave"]["wavenumber"], tables["wave"]["direction"]
    with pytest.raises(SceneError, match="excludes wave"):
        Scene.from_dict(tables)


def test_a_declared_frequency_stays_declared_and_is_solved_again_for_other_spheres() -> None:
    scene = PAPER.with_values({"wave.frequency": 8e7})
    assert Scene.loads(scene.to_toml()) == scene
    softer = scene.with_values({"sphere.youngs_modulus": 60e9})
    assert softer.wave.frequency == 8e7
    assert softer.wave.wavenumber > scene.wave.wavenumber
    assert scene.with_values({"wave.wavenumber": 0.8}).wave.frequency is None


def test_a_run_is_that_of_the_wave_number() -> None:
    scene = PAPER.with_values({"wave.frequency": 8e7})
    same = PAPER.with_values({"wave.wavenumber": scene.wave.wavenumber})
    assert scene_hash(scene) == scene_hash(same)
    assert prepare(scene).scene == prepare(same).scene
    assert build(scene).input_text == build(same).input_text
