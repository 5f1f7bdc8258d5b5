"""Effects: when a scene calls for one, what the deck then holds, that LAMMPS takes every combination; the guards."""

import re
from dataclasses import fields, replace
from itertools import product
from math import cos, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.norms import relative_error, slope
from granular_analysis.theory.choice import trajectory, wave_of
from granular_lmp import Record, Scene, build, cli, run
from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.mode import Mode
from granular_lmp.crystal.modes import decay_rate
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.effects.between_looks import hidden
from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import Chosen
from granular_lmp.effects.selection import EFFECTS, select, warnings, with_all
from granular_lmp.errors import EffectError, LammpsError, SceneError
from granular_lmp.problem import prepare
from granular_lmp.rest.held import largest_step
from granular_lmp.rest.linear import mode_of
from granular_lmp.rest.looks import LOOKS, fastest, look_interval
from granular_lmp.rest.resolution import farthest_rounding, gathered_rounding
from granular_lmp.runs.record import read_status
from tests.conftest import PAPER, latin, members
from tests.instance import silent_lammps
from tests.manual import Measure, Mutant, verifies

CELL = PAPER.with_values(
    {"packing.rows": 16, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "time.duration": 40.0}
)
STRIP = PAPER.with_values({"packing.rows": "auto"})
STATIC_FORCE = PAPER.sphere.pull_off_force
COMPRESSED = {"sphere.work_of_adhesion": 0.0, "packing.contact_force": STATIC_FORCE}
SPRING = PAPER.sphere.mass / PAPER.sphere.time_scale  # m/t0, N s/m


def chosen(scene: Scene) -> dict[str, Chosen]:
    return {effect.name: effect for effect in select(scene)}


def same(one: Record, other: Record) -> float:
    """Largest difference of p, q, φ, in D0."""
    return max(float(np.abs(getattr(one, name) - getattr(other, name)).max()) for name in ("p", "q", "phi"))


def test_a_difference_is_seen(tmp_path: Path) -> None:
    assert same(run(CELL, tmp_path / "a"), run(CELL.with_values({"wave.amplitude": 0.21}), tmp_path / "b")) > 1e-4


# --- when a scene calls for an effect ---


def test_a_longitudinal_wave_turns_no_sphere_but_shears_its_contacts() -> None:
    effects = chosen(PAPER.with_values({"wave.mode": "L"}))
    assert not effects["rotation"].on
    assert effects["rotation"].number == 0
    assert not effects["tracking"].on
    assert effects["shear"].on
    assert effects["shear"].number == pytest.approx(np.sin(0.401), rel=1e-3)


@pytest.mark.parametrize(
    "changes",
    [
        {"wave.mode": "L", "wave.direction": "x", "packing.columns": 6},
        {"wave.mode": "L", "wave.direction": "x", "packing.columns": 6, "packing.ends": "fixed", "packing.rows": 13},
        {"wave.wavenumber": np.pi},
    ],
    ids=["L along rows", "L along held rows", "TR of the zone boundary"],
)
def test_rows_that_differ_turn_spheres_of_a_wave_that_turns_none(changes: dict[str, Any], tmp_path: Path) -> None:
    rows = {} if "packing.ends" in changes else {"inclusion": [{"rows": [3, 4], "density": 2500.0}]}
    scene = CELL.with_values({**changes, **rows, "time.duration": 4.0, "time.allow_echo": True})
    assert "turn their neighbours" in chosen(scene)["rotation"].finding
    assert all(guard["quiet"] for guard in run(scene, tmp_path / "run").info["guards"].values())


def test_a_transverse_wave_needs_rotation_by_its_share_of_the_energy() -> None:
    # Ĩf²/(Q² + Ĩf²) with the numbers of the derivation
    q, f = 0.973101202335, 0.230378058881
    effect = chosen(PAPER)["rotation"]
    assert effect.on
    assert effect.number == pytest.approx(0.4 * f**2 / (q**2 + 0.4 * f**2), rel=1e-3)


def test_sliding_is_on_from_the_friction_that_the_wave_reaches() -> None:
    reached = chosen(PAPER)["sliding"].number * 5 * PAPER.wave.amplitude  # the friction at which it is 1
    assert not chosen(PAPER.with_values({"effects.friction": reached * 1.01}))["sliding"].on
    assert chosen(PAPER.with_values({"effects.friction": reached * 0.99}))["sliding"].on


def test_contacts_open_where_the_wave_pulls_harder_than_the_static_overlap() -> None:
    largest = 1 - chosen(PAPER)["contact_opening"].number
    limit = PAPER.wave.amplitude / largest
    assert not chosen(PAPER.with_values({"wave.amplitude": 0.99 * limit}))["contact_opening"].on
    assert chosen(PAPER.with_values({"wave.amplitude": 1.01 * limit}))["contact_opening"].on


def test_without_work_of_adhesion_there_is_none() -> None:
    assert chosen(PAPER)["adhesion"].number == 1
    assert not chosen(PAPER.with_values(COMPRESSED))["adhesion"].on
    both = PAPER.with_values({"packing.contact_force": STATIC_FORCE})
    assert chosen(both)["adhesion"].number == 0.5


def test_damping_is_on_when_it_is_given() -> None:
    assert not chosen(PAPER)["damping"].on
    assert chosen(PAPER.with_values({"effects.viscosity": 0.01 * SPRING}))["damping"].on
    assert chosen(PAPER.with_values(COMPRESSED | {"effects.restitution": 0.9}))["damping"].on


def test_what_is_forced_off_though_called_for_is_a_warning_with_a_number() -> None:
    (warning,) = warnings(select(PAPER.with_values({"effects.shear_law": "incremental", "effects.rotation": False})))
    assert "effects.rotation is off, but rotation has 0.02193 of the kinetic energy" in warning
    assert "37.56% off" in warning
    assert warnings(select(PAPER)) == []
    assert warnings(select(PAPER.with_values({"wave.mode": "L", "effects.rotation": False}))) == []


def test_a_resolved_scene_says_all_and_resolves_to_itself() -> None:
    scene = CELL.with_values({"packing.rows": "auto", "packing.ends": "auto", "packing.columns": "auto"})
    problem = prepare(scene)
    resolved, effects = problem.scene, problem.effects
    assert (resolved.packing.rows, resolved.packing.columns, resolved.packing.ends) == (8, 3, "periodic")
    switched = [effect for effect in effects if effect.switch == f"effects.{effect.name}"]
    assert len(switched) == len(fields(resolved.effects)) - 9  # less the law, the parting and the coefficients
    assert [getattr(resolved.effects, effect.name) for effect in switched] == [effect.on for effect in switched]
    assert (prepare(resolved).scene, prepare(resolved).effects) == (resolved, effects)
    assert build(resolved).input_text == build(scene).input_text


IMPOSSIBLE = [
    ({"effects.rotation": True, "effects.shear": False}, "effects.rotation = true: needs effects.shear, which is off"),
    ({"effects.tracking": True, "effects.rotation": False}, "effects.tracking = true: needs effects.rotation"),
    ({"effects.sliding": True}, "effects.sliding = true: needs effects.friction"),
    ({"effects.damping": True}, "effects.damping = true: needs effects.viscosity"),
    ({"effects.restitution": 0.9}, r"effects.restitution = 0.9: LAMMPS has it only for contacts without adhesion"),
    (
        {"effects.viscosity": 1e-9, "effects.restitution": 0.9},
        "effects.viscosity = 1e-09 and effects.restitution = 0.9",
    ),
    ({"effects.adhesion": False}, r"packing.contact_force = 0.0: must be above 0"),
    ({"sphere.work_of_adhesion": 0.0}, r"packing.contact_force = 0.0: must be above 0"),
    (COMPRESSED | {"effects.adhesion": True}, "effects.adhesion = true: needs sphere.work_of_adhesion above 0"),
    ({"wave.mode": "RT", "effects.rotation": False}, "wave.mode = 'RT': needs effects.rotation, which is off"),
    ({"time.timestep": 1.08, "time.sample": 1.08}, r"time.timestep = 1.08: .*stability.* below 2/Omega_max = 1.07"),
    ({"effects.walls": True}, "effects.walls: unknown key"),
    ({"effects.shear": "yes"}, "effects.shear = 'yes': must be true, false, or \"auto\""),
]


@pytest.mark.parametrize(("changes", "message"), IMPOSSIBLE)
def test_what_does_not_go_together_is_refused_with_its_reason(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        build(PAPER.with_values(changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("changes", [{"effects.shear": False}, {"effects.tracking": False}], ids=str)
def test_the_command_line_takes_every_choice(
    changes: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [f"{key}={str(value).lower()}" for key, value in changes.items()] + ["time.tolerance=1e-2"]
    sets = [part for word in words for part in ("--set", word)]
    assert cli.main(["effects", "tr_periodic", *sets]) == 0
    assert cli.main(["run", "tr_periodic", *sets, "-o", str(tmp_path / "run")]) == 0
    assert "warning" in capsys.readouterr().err


def test_without_rotation_a_larger_step_is_stable() -> None:
    longitudinal = PAPER.with_values({"wave.mode": "L", "time.timestep": 1.2, "time.sample": 1.2})
    build(longitudinal)
    with pytest.raises(SceneError, match="stability"):
        build(with_all(longitudinal))


# --- the deck holds what the scene calls for ---


def test_each_effect_has_lines_of_its_own_and_no_other_changes() -> None:
    text = build(PAPER).input_text
    for change, gone, come in [
        ({"effects.tracking": False}, "dipole", "nve/sphere\n"),
        ({"effects.rotation": False}, "omega", "fix          move mobile nve\n"),
        ({"effects.shear": False, "effects.rotation": False}, "mindlin", "tangential linear_nohistory 0.0 0.0"),
        (COMPRESSED, "dmt", "hertz/material 73000.0 0.0 0.17 &"),
        ({"effects.shear_law": "incremental"}, "mindlin NULL", "mindlin/force NULL 0.0"),
        ({"effects.friction": 0.05}, "v_amplitude:%.17g)  # no sliding", "variable friction index 0.05"),
        ({"packing.ends": "periodic", "packing.rows": 16}, "boundary     p f p", "boundary     p p p"),
        ({"packing.columns": 4}, "v_spread", "301:"),
    ]:
        other = build(PAPER.with_values(change)).input_text
        assert gone in text, change
        assert gone not in other, change
        assert come in other or change == {"packing.columns": 4}, change


def test_no_slot_stays_open() -> None:
    for scene in (PAPER, PAPER.with_values({"wave.mode": "L"}), CELL.with_values(COMPRESSED)):
        text = build(scene).input_text
        assert "<" not in text
        assert "\n\n\n" not in text


def test_what_is_off_is_guarded_and_openings_and_slip_are_measured_anyway() -> None:
    for scene in (PAPER, PAPER.with_values({"wave.mode": "L"}), PAPER.with_values({"wave.amplitude": 3.0})):
        deck = build(scene)
        for effect, row in zip(deck.problem.effects, EFFECTS, strict=True):
            for guard in row.guards[:1]:
                assert (effect.guard == guard.title) == (not effect.on or row.always)
                assert (guard.column in deck.input_text) == (not effect.on or row.always)
    assert "v_slip" not in build(PAPER.with_values({"effects.shear": False})).input_text  # there is no shear force


@pytest.mark.parametrize("step", [0.0125, 0.05, 0.5])
@pytest.mark.parametrize("mode", ["L", "TR", "RT"])
def test_guards_look_eight_times_in_the_fastest_period_or_at_every_step(mode: str, step: float) -> None:
    problem = build(PAPER.with_values({"time.timestep": step, "time.sample": 0.5, "wave.mode": mode})).problem
    scene, steps = problem.scene, look_interval(problem.scene)
    assert steps == 1 or steps * step * LOOKS <= 2 * pi / fastest(scene)
    assert fastest(scene) >= max(2 * problem.wave.mode.frequency, 1)
    assert hidden(problem.rest) <= 1 - cos(pi / LOOKS) + 1e-12


# --- every combination ---

SWITCHES = ("adhesion", "shear", "rotation", "tracking", "sliding", "damping", "contact_opening")
EXTRAS = [
    {"packing.ends": ends, "effects.shear_law": law, "wave.mode": mode, **damping}
    for ends in ("fixed", "periodic")
    for law in ("secant", "incremental")
    for mode in ("L", "TR", "RT")
    for damping in ({"effects.viscosity": 0.01 * SPRING}, {"effects.restitution": 0.9})
]


def accepted(scene: Scene, folder: Path) -> None:
    """Let LAMMPS take the deck and one step of it; raises what LAMMPS raises."""
    deck = build(scene)
    deck.write(folder, force=True)
    with silent_lammps() as instance:
        text = deck.input_text.replace("${data}", str(folder / deck.data_name)).replace("${dump}", str(folder / "dump"))
        instance.commands_string(text)


@pytest.mark.slow
@pytest.mark.parametrize("first", members([0, 13], 13))
def test_every_combination_of_effects_is_accepted_by_lammps_or_refused_with_a_reason(
    first: int, tmp_path: Path
) -> None:
    # 128 combinations of on and off, each with one of the 24 of ends, law, mode and damping, in turn
    base = PAPER.with_values(
        {"packing.rows": 8, "packing.contact_force": STATIC_FORCE, "time.duration": 0.05, "time.sample": 0.05}
        | {"packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "effects.friction": 0.3, "time.allow_echo": True}
    )
    taken, refused = 0, set()
    for number, values in enumerate(product((True, False), repeat=len(SWITCHES))):
        forced = {f"effects.{name}": value for name, value in zip(SWITCHES, values, strict=True)}
        extra = EXTRAS[(5 * number + first) % 24]
        rows = {"packing.rows": 7 if extra["packing.ends"] == "fixed" else 8}
        try:
            scene = base.with_values(forced | extra | rows)
            accepted(scene, tmp_path)
            taken += 1
        except SceneError as error:
            refused.add(str(error))
    assert taken >= 40
    assert len(refused) >= 4
    assert not [
        reason for reason in refused if "needs" not in reason and "only for contacts without adhesion" not in reason
    ]


# --- what is left out makes no difference, where the scene does not call for it ---


# Positions are rounded at every step and the two runs round differently: measured 6e-11 D0 in the cell, where they are
# small, and 6e-10 D0 in the strip
@pytest.mark.parametrize(
    ("scene", "bound"), [(CELL, 1e-10), pytest.param(STRIP, 1e-9, marks=pytest.mark.more)], ids=["cell", "strip"]
)
def test_a_longitudinal_wave_is_the_same_with_every_effect_on(scene: Scene, bound: float, tmp_path: Path) -> None:
    scene = scene.with_values({"wave.mode": "L"})
    auto, everything = run(scene, tmp_path / "auto"), run(with_all(scene), tmp_path / "all")
    assert same(auto, everything) < bound
    assert auto.info["effects"]["rotation"]["on"] is False
    assert everything.info["effects"]["rotation"]["on"] is True


@pytest.mark.parametrize(("xi", "rows"), members([(0.802, 94), (1.475, 98), (2.127, 130)], (1.475, 98), (2.127, 130)))
def test_the_fewest_quiet_rows_and_a_periodic_cell_give_the_same_as_201(xi: float, rows: int, tmp_path: Path) -> None:
    declared = PAPER.with_values({"wave.wavenumber": xi, "time.timestep": 0.1})
    cell = declared.with_values({"packing.rows": "auto", "packing.ends": "periodic"})
    assert cell.shape.rows == rows
    assert abs(cell.wavenumber - xi) <= 1e-3
    strip = declared.with_values({"wave.wavenumber": cell.wavenumber})
    many, few = (run(strip.with_values({"packing.rows": rows}), tmp_path / str(rows)) for rows in (201, "auto"))
    assert few.scene.packing.rows == 151
    # The echo time promises 1e-6 of the wave
    assert same(few, many) < 1e-6
    assert same(run(cell, tmp_path / "cell"), many) < 1e-6


# --- guards ---


def test_contacts_that_open_where_none_should_fail_the_run_and_the_results_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The rules are made to believe that nothing opens: what they cannot foresee, as a resonance, looks the same
    blind = [
        replace(row, called_for=lambda case: Finding(False, 1.0, "left"))
        for row in EFFECTS
        if row.name == "contact_opening"
    ]
    table = [*(row for row in EFFECTS if row.name != "contact_opening"), *blind]
    monkeypatch.setattr("granular_lmp.effects.selection.EFFECTS", table)
    strong = CELL.with_values({"wave.amplitude": 3.0, "time.sample": 0.5})
    with pytest.raises(EffectError, match=r"contact_opening triggered .* at tau = .*: open_contacts = \d") as caught:
        run(strong, tmp_path / "run")
    assert caught.value.exit_status == 1
    info = read_status(tmp_path / "run")
    assert info["status"] == "failed"
    assert "contact_opening triggered its guard" in info["message"]
    guard = info["guards"]["open_contacts"]
    assert not guard["quiet"]
    assert guard["value"] > 0
    assert 0 <= guard["passed_at"] <= 40
    assert len(Record.load(tmp_path / "run", unfinished=True).tau) == 81


def test_a_wave_that_turns_spheres_is_reported_when_rotation_is_left_out(tmp_path: Path) -> None:
    # A deck of an L wave given the fields of a TR wave: the guard must see the torque
    scene = CELL.with_values({"wave.mode": "L"})
    real = build(scene)
    other = build(CELL.with_values({"effects.rotation": False}))
    with pytest.raises(EffectError, match="rotation triggered its guard at tau = 0: largest_torque"):
        run(replace(real, data=other.data), tmp_path / "run")


def test_a_row_that_is_torn_apart_is_reported(tmp_path: Path) -> None:
    deck = build(CELL)
    wave = deck.data.wave.copy()
    wave[22, 0] += 1e-4  # one sphere of the centre row
    torn = replace(deck.data, wave=wave)
    with pytest.raises(EffectError, match="width triggered its guard at tau = 0: row_spread = "):
        run(replace(deck, data=torn), tmp_path / "run")


def test_rounding_alone_breaks_no_symmetry_however_many_steps(tmp_path: Path) -> None:
    # 24000 steps of a wave of 1e-5: torques are 100 roundings of a position, and the spread of a row 70
    changes = {"packing.rows": 16, "wave.wavenumber": 2 * np.pi * 2 / 16, "wave.amplitude": 1e-5, "wave.mode": "L"}
    times = {"time.duration": 1500.0, "time.sample": 1500.0, "time.timestep": 1 / 16}
    record = run(CELL.with_values(changes | times), tmp_path / "run")
    law, rounding = gathered_rounding(record.scene), farthest_rounding(record.scene)
    for name in ("largest_torque", "row_spread"):
        guard = record.info["guards"][name]
        # 1.4 and 1.0 of the law here; another processor rounds otherwise, by a factor and not by a power
        assert 0.2 < guard["value"] / law < 5
        assert guard["value"] > 25 * rounding
        assert guard["quiet"]
    finer = record.scene.with_values({"time.timestep": 1 / 64})
    assert 2 < gathered_rounding(finer) / law < 4  # between the root and the number of steps


def blind(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Let the rules of some effects foresee nothing."""
    rows = [
        replace(row, called_for=lambda case: Finding(False, 0.0, "")) if row.name in names else row for row in EFFECTS
    ]
    monkeypatch.setattr("granular_lmp.effects.selection.EFFECTS", tuple(rows))


def test_sliding_below_the_scene_s_friction_fails_the_run_and_the_message_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = CELL.with_values({"effects.friction": 0.5})
    assert not chosen(scene)["sliding"].on
    assert run(scene, tmp_path / "quiet").info["guards"]["largest_slip"]["quiet"]
    blind(monkeypatch, "sliding")
    with pytest.raises(
        EffectError, match="sliding triggered its guard at tau = .*: largest_slip.*effects.sliding = tr"
    ):
        run(scene.with_values({"effects.friction": 0.05}), tmp_path / "loud")


def slip_without_friction(scene: Scene, folder: Path, monkeypatch: pytest.MonkeyPatch) -> float:
    """Largest shear force over sliding force of one contact, of a friction of 1: LAMMPS's, contact by contact."""
    low = chosen(scene.with_values({"effects.friction": 1.0}))["sliding"].number / 2
    blind(monkeypatch, "sliding")
    with pytest.raises(EffectError):
        run(scene.with_values({"effects.friction": low, "effects.sliding": False}), folder)
    monkeypatch.undo()
    return float(read_status(folder)["guards"]["largest_slip"]["value"]) * low


def test_an_effect_forced_off_is_reported_and_does_not_fail_the_run(tmp_path: Path) -> None:
    record = run(CELL.with_values({"effects.rotation": False}), tmp_path / "run")
    guard = record.info["guards"]["largest_torque"]
    assert not guard["judges"]
    assert not guard["quiet"]
    assert any("effects.rotation is off" in remark for remark in record.info["remarks"])
    assert (record.phi == 0).all()


@pytest.mark.parametrize(
    ("mode", "amplitude"),
    members([*product(["L", "TR", "RT"], [1e-4, 0.3]), ("TR", 1e-2)], ("L", 1e-4), ("RT", 1e-4), ("TR", 1e-2)),
)
def test_guards_stay_silent_at_any_amplitude(mode: str, amplitude: float, tmp_path: Path) -> None:
    # Rounding is a larger part of a smaller wave
    short = STRIP.with_values({"wave.mode": mode, "wave.amplitude": amplitude, "time.duration": 60.0})
    record = run(short, tmp_path / "run")
    assert all(guard["quiet"] for guard in record.info["guards"].values())


@pytest.mark.parametrize("mode", members(["TR", "RT", "L"], "RT"))
def test_the_friction_keeps_every_mode_from_sliding(mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fixed = PAPER.with_values({"wave.mode": mode, "packing.rows": 61, "time.duration": 38, "time.timestep": 0.1})
    assert run(fixed, tmp_path / "fixed").info["guards"]["largest_slip"]["value"] < 0.6
    # The linear wave predicts the ratio of each contact to order a = 0.2
    cell = fixed.with_values({"packing.ends": "periodic", "packing.rows": 16})
    measured = slip_without_friction(cell, tmp_path / "cell", monkeypatch)
    assert measured == pytest.approx(Case(cell).largest_slip() * Case(cell).friction, rel=0.2)


@verifies(
    "Guard of sliding: the ratio that a run reaches over that of the rule, less 1",
    reference="analytic: the ratio of shear and sliding force of each contact of the linear wave",
    tolerance=0.2,
    reason="the rule takes the linear wave, from which a run departs by the order of a = 0.9",
    mutant=Mutant("granular_lmp/effects/case.py", "np.abs(shear * push)", "np.abs(1.5 * shear * push)"),
)
def test_the_rule_and_the_guard_agree_when_contacts_begin_to_slide(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measured: Measure
) -> None:
    # At a = 0.9 the rule and the guard used to differ by a quarter, and a run that the rule let pass failed
    near = CELL.with_values({"wave.amplitude": 0.9, "effects.friction": 1.0})
    friction = chosen(near)["sliding"].number  # at which it is 1
    for factor, on in ((0.97, True), (1.03, False)):
        scene = near.with_values({"effects.friction": factor * friction})
        assert chosen(scene)["sliding"].on is on
    measured(slip_without_friction(near, tmp_path / "run", monkeypatch) / friction - 1)


def test_strong_dashpots_do_not_make_contacts_slide(tmp_path: Path) -> None:
    record = run(CELL.with_values({"effects.viscosity": 0.5 * SPRING}), tmp_path / "run")
    assert record.info["guards"]["largest_slip"]["value"] < 0.6


def test_hertz_contacts_that_open_need_a_friction() -> None:
    opening = CELL.with_values(COMPRESSED | {"wave.amplitude": 3.0})
    with pytest.raises(SceneError, match="give a number in .*: in a wave this strong, contacts slide"):
        build(opening)
    assert chosen(opening.with_values({"effects.friction": 0.3}))["sliding"].on


def test_dashpots_shorten_the_stable_step(tmp_path: Path) -> None:
    # z² − (2 − h²Ω² − hcλ)z + (1 − hcλ) = 0 leaves the unit circle at h²Ω² + 2hcλ = 4; λ is taken at its largest
    scene = CELL.with_values({"effects.viscosity": 0.5 * SPRING})
    limit = largest_step(prepare(scene).scene)
    assert limit < 0.5 * largest_step(prepare(CELL).scene)
    with pytest.raises(SceneError, match="stability"):
        build(scene.with_values({"time.sample": limit, "time.timestep": limit}))
    step = 0.95 * limit
    record = run(
        scene.with_values({"time.sample": step, "time.timestep": step, "time.duration": 40.0}), tmp_path / "run"
    )
    assert np.abs(record.q).max() <= 1


def test_a_sphere_that_is_lost_is_a_failed_run_and_no_traceback(tmp_path: Path) -> None:
    deck = build(PAPER.with_values({"packing.rows": 21, "time.duration": 4.0}))
    wild = deck.input_text.replace("velocity     all set v_vx v_vy NULL", "velocity     all set v_vx 1e9 NULL")
    assert wild != deck.input_text
    with pytest.raises(LammpsError):
        run(replace(deck, input_text=wild), tmp_path / "run")
    assert read_status(tmp_path / "run")["status"] == "failed"


@pytest.mark.parametrize("changes", [{"effects.shear_law": "incremental"}, {"effects.viscosity": 1e-8}])
def test_a_tolerance_holds_where_an_effect_makes_the_error_one_of_first_order(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    scene = CELL.with_values(changes | {"time.tolerance": 1e-3})
    record = run(scene, tmp_path / "run")
    assert len(record.info["refinements"]) >= 1  # two runs cannot tell
    exact = trajectory("exact-lattice", wave_of(record), record.tau)
    for name, values in zip(("p", "q", "phi"), exact, strict=True):
        assert relative_error(getattr(record, name), values) < 1e-3


# --- each effect in LAMMPS is what the rules say of it ---


def test_the_angle_is_nan_where_it_is_not_tracked_and_the_rest_is_the_same(tmp_path: Path) -> None:
    tracked = run(CELL, tmp_path / "tracked")
    blind = run(CELL.with_values({"effects.tracking": False}), tmp_path / "blind")
    assert np.isnan(blind.phi).all()
    np.testing.assert_array_equal(blind.p, tracked.p)
    np.testing.assert_array_equal(blind.q, tracked.q)
    again = Record.load(tmp_path / "blind")
    assert np.isnan(again.phi).all()


@pytest.mark.parametrize(
    ("changes", "mode"),
    latin(
        [
            COMPRESSED,
            {"effects.rotation": False},
            COMPRESSED | {"effects.rotation": False},
            {"effects.shear": False},
            {"packing.contact_force": STATIC_FORCE},
        ],
        ["TR", "L"],
    ),
)
def test_small_waves_of_a_lattice_with_other_effects_are_its_modes(
    mode: str, changes: dict[str, Any], tmp_path: Path
) -> None:
    # A wave that is no mode of the lattice would beat with others. At a = 1e-3 the nonlinear part is 1e-6 in q and φ,
    # 1e-3 in p of L; Verlet runs a mode at sin(Ω'Δτ/2) = ΩΔτ/2 and leaves (ΩΔτ)²/8 = 4e-6 in its shape.
    scene = CELL.with_values({"wave.mode": mode, "wave.amplitude": 1e-3, "time.timestep": 0.02} | changes)
    record = run(scene, tmp_path / "run")
    wave, step = build(scene).problem.wave.mode, scene.time.step
    angle = 2 / step * np.arcsin(wave.frequency * step / 2) * record.tau
    for name, expected, tolerance in (
        ("q", -wave.ux * np.cos(angle), 5e-6),
        ("phi", wave.f * np.sin(angle), 5e-6),
        ("p", wave.uy * np.cos(angle), 2e-3),
    ):
        assert np.abs(getattr(record, name) - expected).max() < tolerance, name


def test_a_wrong_prestress_would_be_seen() -> None:
    # What the test above rests on: without the prestress the phase would be off by 40 τ times this
    pressed = CELL.with_values(COMPRESSED)
    plain = build(CELL).problem.wave.mode.frequency
    assert abs(build(pressed).problem.wave.mode.frequency - plain) * 40 > 3e-4


@pytest.mark.parametrize(("mode", "kind"), latin(["L", "TR", "RT"], ["viscosity", "restitution"]))
def test_damping_makes_a_small_wave_decay_at_the_rate_of_theory(mode: str, kind: str, tmp_path: Path) -> None:
    changes = {
        "viscosity": {"effects.viscosity": 0.01 * SPRING},
        "restitution": COMPRESSED | {"effects.restitution": 0.97},
    }
    scene = CELL.with_values({"wave.mode": mode, "wave.amplitude": 1e-3} | changes[kind])
    record = run(scene, tmp_path / "run")
    wave, rate = build(scene).problem.wave.mode, chosen(scene)["damping"].number
    signal = record.p if mode == "L" else record.q
    amplitude = wave.uy if mode == "L" else -wave.ux
    expected = amplitude * np.exp(-rate * record.tau) * np.cos(wave.frequency * record.tau)
    assert rate * 40 > 0.02  # there is a decay to be seen
    # Weak damping: the frequency falls by Γ²/2Ω and the start is not the damped mode, both of relative order Γ/Ω
    assert relative_error(signal, expected) < 2 * rate / wave.frequency + 1e-3
    assert relative_error(signal, amplitude * np.cos(wave.frequency * record.tau)) > 0.4 * (1 - np.exp(-rate * 40))


def test_the_preload_is_slow_enough_for_strong_dashpots(tmp_path: Path) -> None:
    # In one time step the springs would be loaded at D0/Δτ, and the dashpots push every contact past friction: the
    # error of q was 0.4 then. What is left is LAMMPS's error of the step, of first order with dashpots.
    changes = {"wave.wavenumber": 3 * np.pi / 4, "wave.amplitude": 0.02, "effects.viscosity": 0.04 * SPRING}
    record = run(CELL.with_values(changes), tmp_path / "run")
    wave = wave_of(record)
    _, q, _ = trajectory("exact-lattice", wave, record.tau)
    assert relative_error(record.q, q) < 0.02


def test_friction_takes_from_a_wave_what_slides(tmp_path: Path) -> None:
    free = run(CELL, tmp_path / "free")
    sliding = run(CELL.with_values({"effects.friction": 0.03}), tmp_path / "sliding")
    assert sliding.info["effects"]["sliding"]["on"]
    assert sliding.info["guards"]["largest_slip"]["value"] > 1
    assert sliding.info["guards"]["largest_slip"]["quiet"]  # it is on: no news
    late = free.tau > 30
    assert np.abs(sliding.q[late]).max() < 0.9 * np.abs(free.q[late]).max()


def test_the_incremental_law_is_another(tmp_path: Path) -> None:
    secant, incremental = (
        run(CELL.with_values({"effects.shear_law": law}), tmp_path / law) for law in ("secant", "incremental")
    )
    assert relative_error(incremental.q, secant.q) < 0.02
    assert relative_error(incremental.p, secant.p) > 0.5


def test_compression_in_place_of_adhesion_differs_by_the_prestress_alone(tmp_path: Path) -> None:
    # The increments of the force are the same; the prestress χ = (2/3)Δ0/ℓ is of first order in Δ0/R. Thinner overlaps
    # (a smaller force at the same amplitude in Δ0) must bring the two together with slope 1.
    ratios, differences = [], []
    for factor in (0.3, 1.0, 3.0):
        adhesive = CELL.with_values({"sphere.work_of_adhesion": PAPER.sphere.work_of_adhesion * factor})
        pressed = adhesive.with_values(
            {"sphere.work_of_adhesion": 0.0, "packing.contact_force": adhesive.sphere.pull_off_force}
        )
        one, other = (run(scene, tmp_path / f"{i}{factor}") for i, scene in enumerate((adhesive, pressed)))
        ratios.append(adhesive.sphere.overlap_ratio)
        differences.append(relative_error(other.q, one.q))
    assert slope(ratios, differences) == pytest.approx(1, abs=0.1)
    assert differences[1] < 0.01


def test_a_crystal_of_large_steel_spheres_is_simulated(tmp_path: Path) -> None:
    steel = {
        "radius": 4.76e-3,
        "youngs_modulus": 208e9,
        "poisson_ratio": 0.3,
        "density": 7850.0,
        "work_of_adhesion": 0.0,
    }
    changes: dict[str, Any] = {f"sphere.{key}": value for key, value in steel.items()} | {"packing.contact_force": 1.0}
    record = run(CELL.with_values(changes), tmp_path / "run")
    # Hertz: F0 = (4/3)E*√Rc Δ0^{3/2}
    sphere = Sphere(**steel)
    assert record.scene.sphere.static_overlap == pytest.approx((1 / sphere.normal_coefficient) ** (2 / 3), rel=1e-12)
    assert all(guard["quiet"] for guard in record.info["guards"].values())
    assert np.abs(record.q).max() == pytest.approx(np.abs(record.q[0]), rel=0.05)


def test_decay_rates_agree_between_the_rule_and_the_mode() -> None:
    scene = CELL.with_values({"effects.viscosity": 0.02 * SPRING})
    rate = decay_rate(unit_lattice(scene.sphere), scene.sphere, build(scene).problem.wave.mode, 0.02)
    assert chosen(scene)["damping"].number == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("mode", ["TR", "RT", "L"])
def test_the_rules_know_the_contacts_of_a_driven_row(mode: str) -> None:
    # Between a row that is moved by D0 and the next at rest: cos 60° D0 or sin 60° D0, more than in an RT wave
    scene = Scene.load("tr_driven").with_values({"wave.mode": mode, "wave.wavenumber": 0.3, "wave.amplitude": 0.1})
    normal, shear = Case(scene).stretches
    assert np.abs(normal).max() >= 0.1 * (0.5 if mode != "L" else sqrt(0.75)) * (1 - 1e-9)
    assert np.abs(shear).max() >= 0.1 * (sqrt(0.75) if mode != "L" else 0.5) * (1 - 1e-9)


def test_the_mode_of_a_wave_is_asked_for_once_for_each_lattice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Effects share what they solve; the problem asks once more, for the lattice with the effects that are on."""
    asked: list[object] = []

    def counted(scene: Scene, *physics: object) -> Mode:
        asked.append(physics)
        return mode_of(scene, *physics)

    monkeypatch.setattr("granular_lmp.effects.case.mode_of", counted)
    monkeypatch.setattr("granular_lmp.rest.linear.mode_of", counted)
    prepare(Scene.load("tr_nonresonant"))
    assert len(asked) == len({*asked}) <= 6


@pytest.mark.parametrize("name", ["tr_damped", "quiet_ends", "solitary_chain", "monolayer_rocking"])
def test_the_reason_of_an_effect_is_a_sentence_with_its_number(name: str) -> None:
    for effect in prepare(Scene.load(name)).effects:
        assert not re.search(r"\{|\binf\b|^[\d.e-]+ (?!pairs|rows|columns|N |of the amplitude)", effect.finding)
        assert "{}" not in effect.reason or f"{effect.number:.4g}" in effect.finding


def test_the_reason_of_quiet_ends_names_waves_that_it_leaves_out() -> None:
    """Of a source of one sphere, which sends waves out in all directions."""
    scene = Scene.load("point_source").with_values(
        {"absorb.rows": 10, "absorb.reflection": 0.1, "source.1.cycles": 4.0}
    )
    (found,) = (each.finding for each in prepare(scene).effects if "oblique" in each.finding)
    assert found.endswith(" rows at an end for waves along y; oblique waves are not included")
