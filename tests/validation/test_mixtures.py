"""Parts that stand in one scene: strikers, states and sources beside waves, in imperfect crystals, with monitors."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.network_motion import integrate
from granular_analysis.tools.compare import compare
from granular_lmp import Scene, build, run
from granular_lmp.accuracy.ladder import plan
from granular_lmp.effects.between_looks import fastest
from granular_lmp.errors import SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest.held import largest_step
from tests.conftest import PAPER

UNIT = PAPER.scale.length / PAPER.scale.time  # m/s
STRUCK = [{"spheres": [[5, 4]], "velocity": 0.02 * UNIT, "direction": 30.0}]
# A sphere that is displaced, moves and turns, in SI units
MOVED = [[5, 4, 0.01 * PAPER.scale.length, -0.005 * PAPER.scale.length, 0.0, 0.01 * UNIT, 0.01 * UNIT / 5e-7]]
AT_REST = {"form": "none"}


def scene(wave: dict[str, Any] | None = None, **tables: Any) -> Scene:
    """A sheet of 12 x 8 spheres; the wave of the paper at a tenth of its amplitude, unless it is changed."""
    base = PAPER.to_dict()
    base["wave"] |= {"wavenumber": np.pi / 3, "amplitude": 0.02} | (wave or {})
    base["packing"] |= {"rows": 12, "columns": 8, "ends": "periodic"}
    base["time"] = {"duration": 10.0, "timestep": 0.025, "sample": 0.5, "allow_echo": True}
    return Scene.from_dict({**base, "name": "struck", **tables})


PUSH = [{"rows": [3, 3], "force": "x", "amplitude": 0.3, "frequency": 0.6, "ramp": 3.0}]
MOVE = [{"rows": [3, 3], "motion": "y", "amplitude": 0.3, "frequency": 0.6, "ramp": 3.0}]
HELD = {"rows": 41, "columns": 3, "ends": "fixed"}


def test_a_row_that_is_moved_cuts_a_wave_off_as_a_held_one(tmp_path: Path) -> None:
    # Two rows that are moved by next to nothing between two held ones are two held rows
    still = [{**MOVE[0], "rows": rows, "amplitude": 1e-9} for rows in ([4, 4], [36, 36])]
    cut = build(scene(source=still, packing=HELD))
    assert not cut.data.wave[4 * 3 : 5 * 3].any()
    moved = run(cut, tmp_path / "moved")
    held = run(scene(packing={**HELD, "rows": 33}), tmp_path / "held")
    np.testing.assert_allclose(moved.q, held.q, atol=1e-6)


def test_a_packet_and_a_source_have_their_quiet_ends(tmp_path: Path) -> None:
    tall = {"rows": 201, "columns": 3, "ends": "fixed"}
    both = scene(
        {"mode": "L", "wavenumber": 1.2},
        packing=tall,
        envelope={"length": 8.0},
        absorb={"rows": "auto", "reflection": 0.1},
        source=[{**PUSH[0], "rows": [60, 60], "force": "y"}],
    )
    alone = both.with_values({"source": []})
    # The layer is that of the waves of both
    assert prepare(both).scene.absorb.rows >= prepare(alone).scene.absorb.rows
    assert run(both, tmp_path / "both").info["status"] == "finished"


def test_sources_and_waves_are_estimated_together() -> None:
    alone, beside = (prepare(scene(form, source=PUSH)) for form in (AT_REST, {}))
    slip = (
        {each.name: each for each in beside.effects}["sliding"],
        {each.name: each for each in alone.effects}["sliding"],
    )
    # Friction without sliding grows with both: 0.3 of the amplitude without the wave, 1.3 with it
    assert "6.5*v_amplitude" in build(scene(source=PUSH)).input_text
    assert "1.5*v_amplitude" in build(scene(AT_REST, source=PUSH)).input_text
    assert all(0 < each.number < 1 for each in slip)


def test_strikes_do_not_scale_with_the_amplitude_of_the_wave() -> None:
    deck = build(scene(start={"state": MOVED}, striker=[{**STRUCK[0], "spheres": [[2, 2]]}]))
    assert "velocity     striker set" in deck.input_text
    assert "sum yes" in deck.input_text
    assert "variable     to_ux atom (v_D0*d_ux+d_sx)/dt" in deck.input_text
    at = 5 * 8 + 4
    length, velocity = MOVED[0][2] * 1e9, MOVED[0][5] * 1.0  # nm, and m/s is nm/ns
    np.testing.assert_allclose(deck.data.wave[at, 6:9:2], [length, 0.0])
    np.testing.assert_allclose(deck.data.wave[at, 9], velocity)
    assert not deck.data.wave[:at, 6:].any()


def test_friction_and_openings_are_judged_by_what_a_strike_may_do() -> None:
    weak, strong = (prepare(scene(AT_REST, striker=[{**STRUCK[0], "velocity": share * UNIT}])) for share in (0.01, 1.0))
    assert not weak.on["contact_opening"]
    assert strong.on["contact_opening"]  # ½mv² stretches a contact by more than Δ0
    shaken = scene(AT_REST, striker=STRUCK, source=[{**MOVE[0], "frequency": 2.0}])
    assert fastest(shaken) == 4.0
    # Whatever part of an L wave moves none of them, a striker shears and turns spheres
    of_l = prepare(scene({"mode": "L"}, striker=STRUCK))
    assert of_l.on["shear"]
    assert of_l.on["rotation"]


def test_the_step_is_stable_for_contacts_as_stiff_as_a_strike_makes_them() -> None:
    strong = scene(AT_REST, striker=[{**STRUCK[0], "velocity": 10 * UNIT}])
    pressed = (
        1 + strong.strike
    )  # overlap over that at rest; a Hertz contact is stiffer by its root, Omega by the fourth
    limit = largest_step(prepare(scene()).scene) / pressed**0.25
    assert pressed > 3
    prepare(strong.with_values({"time.timestep": 0.99 * limit}))
    with pytest.raises(SceneError, match="less with a strike that stiffens contacts, = "):
        prepare(strong.with_values({"time.timestep": 1.01 * limit, "time.sample": 1.01 * limit}))
    to_tolerance = strong.with_values({"time.tolerance": 0.1, "time.sample": 5.0, "time.duration": 5.0})
    assert to_tolerance.time.sample / plan(prepare(to_tolerance))[0] < limit


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"striker": [{"spheres": [[5, 4]]}]}, "striker 1: velocity: missing; must be a number"),
        ({"striker": [{**STRUCK[0], "spheres": [[12, 0]]}]}, r"striker 1: sphere \[12, 0\]: must be \[row, column\]"),
        ({"striker": STRUCK * 2}, r"striker 2: sphere \[5, 4\]: is in another striker too"),
        ({"striker": [{**STRUCK[0], "velocity": 1e3}]}, "would stretch contacts by up to .* a tenth of the radius"),
        ({"striker": STRUCK, "start": {"state": MOVED}}, r"sphere \[5, 4\]: ux_m = .* must be 0 for a sphere of a"),
        (
            {"striker": STRUCK, "packing": {"rows": "auto", "columns": 8}},
            "packing\\.rows = 'auto': must be a number with",
        ),
        (
            {"wave": {"mode": "TR", "wavenumber": 1.0, "amplitude": 0.02, "form": "driven"}, "packing": HELD}
            | {"source": [{**MOVE[0], "rows": [0, 1]}]},
            r"source 1: rows = \[0, 1\]: must not contain spheres of the first row, which is driven",
        ),
        (
            {
                "striker": [{**STRUCK[0], "spheres": [[30, 1]]}],
                "wave": AT_REST | {"mode": "TR", "wavenumber": 1.475, "amplitude": 0.02},
                "packing": {"rows": 81, "columns": 3, "ends": "fixed"},
                "absorb": {"rows": "auto"},
            },
            r'absorb\.rows = "?.*must be 0 beside \[\[striker\]\]',
        ),
    ],
)
def test_what_cannot_be_struck_is_refused_by_name(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        prepare(scene(**tables))


def test_a_sphere_that_is_moved_from_outside_is_not_struck() -> None:
    moved = [{"spheres": [[5, 4]], "motion": "x"}]
    with pytest.raises(SceneError, match=r"source 1: sphere \[5, 4\]: is also in a striker or the state"):
        prepare(scene(AT_REST, striker=STRUCK, source=moved))


def test_the_echo_of_a_strike_is_that_of_the_nearest_wall() -> None:
    packing = {"rows": 41, "columns": 8, "ends": "fixed"}
    near, far = (
        scene(AT_REST, striker=[{**STRUCK[0], "spheres": [[row, 4]]}], packing=packing).echo_time for row in (5, 20)
    )
    assert near < far
    # Beside a wave that fills the crystal nothing comes earlier than what its walls disturb
    assert scene(striker=STRUCK, packing=packing).echo_time == scene(packing=packing).echo_time


def test_two_spheres_collide_and_a_monitor_sees_the_contact_of_the_network(tmp_path: Path) -> None:
    state = [[0, 0, 0.0, 0.0, 0.3, 1.0, 40.0], [1, 0, 0.0, 0.0, 0.0, -1.0, 0.0]]
    tables = {
        "packing": {"lattice": "square", "rows": 2, "columns": 1},
        "effects": {"friction": 0.3, "shear_law": "secant"},
        "start": {"state": state},
        "monitor": [{"name": "contact", "rows": [0, 1], "what": "contacts"}],
        "time": {"duration": 4.0, "sample": 0.1, "timestep": 0.005},
    }
    sphere = {
        name: getattr(Scene.load("point_impact").sphere, name)
        for name in ("radius", "youngs_modulus", "poisson_ratio", "density")
    }
    record = run(Scene.from_dict({"name": "two_spheres", "sphere": sphere, **tables}), tmp_path / "run")
    judged = compare(record)
    assert judged.theory == "network"
    # The step's error: 1e-4 at twice the step (the case "impact")
    assert all(value is not None and value < 1e-4 for value in judged.error.values()), judged.error
    first = first_snapshot(record)
    motion = integrate(first.network, first.state, record.tau * first.time, longest_step=first.time / 20).motion
    apart = first.network.position[1] + motion[:, :2, 1] - first.network.position[0] - motion[:, :2, 0]
    overlap = (first.network.radius.sum() - np.linalg.norm(apart, axis=1)) / first.length
    seen = record.monitor("contact").contacts.overlap[:, 0]
    touching = ~np.isnan(seen)
    assert 10 < touching.sum() < len(seen)
    # The first and the last moments of a contact are within a step of its beginning and end
    np.testing.assert_allclose(seen[touching], overlap[touching], rtol=0, atol=1e-3)
    assert overlap[~touching].max() < 1e-2
