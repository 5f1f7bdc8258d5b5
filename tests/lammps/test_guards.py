"""Guards are true: nothing is missed, no valid run is stopped, beside the state of every contact at every step."""

from dataclasses import replace
from math import cos, pi
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import Scene, build, run
from granular_lmp.effects.between_looks import hidden
from granular_lmp.effects.case import Case
from granular_lmp.effects.guard import NEVER, watches_part
from granular_lmp.errors import EffectError, RunInterrupted
from granular_lmp.lammps.guard_results import measured
from granular_lmp.lammps.guards import GUARDS
from granular_lmp.lammps.outputs import CONTACTS, LOG, read_log, read_snapshots
from granular_lmp.problem import prepare
from granular_lmp.rest.looks import LOOKS, longest, look_interval
from granular_lmp.runs.record import read_status
from tests.conftest import members
from tests.hard.guard_study import FAMILIES, Comparison, blind_rules, compared, random_scene

# A standing L wave that opens a contact for a twelfth of its period, between what looks every 50 steps see
STANDING = Scene.load("tr_periodic").with_values(
    {
        "sphere.poisson_ratio": 0.3,
        "packing.rows": 16,
        "packing.ends": "periodic",
        "wave.form": "standing",
        "wave.mode": "L",
        "wave.wavenumber": 0.75 * pi,
        "wave.phase": 0.3,
        "wave.amplitude": 0.56,
        "time.duration": 20.0,
        "time.timestep": 0.05,
        "time.sample": 0.5,
    }
)
# A wave whose bulk contacts keep 0.3 of their overlap, while those at the walls open
WALLED = STANDING.with_values(
    {
        "packing.rows": "auto",
        "packing.ends": "fixed",
        "wave.form": "running",
        "wave.wavenumber": 2.519,
        "wave.amplitude": 0.4,
        "time.duration": 60.0,
    }
)

# All spheres of a crystal under a load stay, and guards judge the same cone
STAYING = {"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7}


# --- random scenes ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("family", members(FAMILIES, "pulse", "beam", "running"))
def test_a_guard_misses_nothing_and_stops_no_valid_run(family: str, tmp_path: Path) -> None:
    openings, slip = compared(random_scene(family, 0), tmp_path / "run")  # make guards takes 29 of each family
    for comparison in (openings, slip):
        assert not comparison.missed, comparison
        assert not comparison.stopped, comparison
        assert comparison.late <= 2 * pi / LOOKS, comparison  # looks are at most so far apart
    # Between two looks a contact goes on by that share of its swing, which is about its overlap at rest
    assert openings.over < 1 - cos(pi / LOOKS), openings
    assert slip.over > cos(pi / LOOKS) - 1, slip


def test_a_friction_that_is_given_changes_nothing_of_a_run_in_which_nothing_slides(tmp_path: Path) -> None:
    # That of the deck stays as small as the wave: a hundred times as much freezes the shear, 2e-3 of p
    small = {"effects.sliding": False, "wave.amplitude": 1e-3, "time.duration": 5.0}
    one, other = (
        run(Scene.load("tr_periodic").with_values(small | {"effects.friction": friction}), tmp_path / str(friction))
        for friction in ("auto", 0.5)
    )
    assert np.array_equal(one.p, other.p)


def test_the_study_sees_a_guard_that_is_wrong_on_either_side() -> None:
    right = Comparison("open_contacts", happened=True, happened_wide=True, said=True, late=0.0, over=0.0)
    assert not right.missed
    assert not right.stopped
    assert replace(right, said=False).missed
    assert replace(right, happened=False, happened_wide=False).stopped


def test_the_study_sees_a_guard_that_looks_too_rarely(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = STANDING.with_values({"effects.friction": 1.0, "effects.sliding": False, "time.sample": 2.5})
    monkeypatch.setattr("granular_lmp.lammps.guards.longest", lambda scene, usual: 2.51)
    monkeypatch.setattr("granular_lmp.rest.held.look_interval", lambda scene, usual: 50)
    monkeypatch.setattr("granular_lmp.effects.guard.hidden", lambda rest, every: 0.0)
    monkeypatch.setattr("granular_lmp.effects.openings.nearly_open", lambda rest: 0.0)
    openings, _ = compared(scene, tmp_path / "run")
    assert openings.missed or openings.late > 0.5


@pytest.mark.parametrize("name", ["open_contacts", "largest_slip"])
def test_a_limit_that_was_passed_counts_where_the_log_rounds_the_value_to_the_limit(name: str, tmp_path: Path) -> None:
    guard, problem = GUARDS[name], prepare(STANDING.with_values({"effects.friction": 1.0}))
    values = {
        guard.column: np.array([0.0, guard.limit_in(problem, 0.0), 0.0]),
        "v_tau": np.array([0.0, 10.0, 20.0]),
    }
    never = values | {f"{guard.column}_at": np.full(3, NEVER)}
    passed = values | {f"{guard.column}_at": np.array([NEVER, 3.5, NEVER])}
    assert measured(GUARDS[name], never, problem, tmp_path).passed_at is None
    assert measured(GUARDS[name], passed, problem, tmp_path).passed_at == 3.5


# --- when, whom, and what is said ------------------------------------------------------------------------------------


def test_a_standing_wave_that_opens_contacts_for_a_short_time_fails_its_run(tmp_path: Path) -> None:
    with pytest.raises(EffectError, match=r"open_contacts = \d.*set effects.contact_opening = true"):
        run(STANDING, tmp_path / "open")
    # The study finds the first opening at 3.45, and the look before it sees too little left
    assert read_status(tmp_path / "open")["guards"]["open_contacts"]["passed_at"] == pytest.approx(
        3.45, abs=longest(STANDING)
    )
    closed = run(STANDING.with_values({"wave.amplitude": 0.5}), tmp_path / "closed")
    # What the study finds is 0.0895; between two looks a contact swings on by a share of what it has swung
    hides = hidden(prepare(STANDING).rest) * (1 - 0.0895)
    assert 0.0895 - 2e-3 <= closed.info["smallest_overlap"] <= 0.0895 + hides


def test_walls_whose_signal_never_reaches_the_record_do_not_stop_a_run(tmp_path: Path) -> None:
    near, stays = run(WALLED, tmp_path / "near"), run(WALLED.with_values(STAYING), tmp_path / "stays")
    assert near.info["guards"]["open_contacts"]["quiet"]
    assert stays.info["guards"]["open_contacts"]["quiet"]
    assert near.info["smallest_overlap"] == pytest.approx(0.31, abs=0.02)
    far = run(WALLED.with_values({"packing.rows": WALLED.shape.rows + 30}), tmp_path / "far")
    # What the walls do there is not in the record: the echo time promises 1e-6
    assert np.abs(far.p - near.p).max() < 1e-6 + 1e-6 * np.abs(far.p).max()


def test_snapshots_widen_the_record_to_all_spheres_and_so_the_guard(tmp_path: Path) -> None:
    everyone = WALLED.with_values({"output.particles": 1.0, "time.duration": 30.0})
    assert watches_part(WALLED)
    assert not watches_part(everyone)
    with pytest.raises(EffectError, match="contact_opening triggered its guard"):
        run(everyone, tmp_path / "run")


def test_the_cone_of_a_monitor_reaches_across_the_faces_of_a_periodic_cell(tmp_path: Path) -> None:
    packet = {"wave.mode": "TR", "wave.wavenumber": 0.8, "wave.amplitude": 0.2, "wave.form": "running"}
    cell = {"packing.rows": 200, "envelope.length": 8.0, "envelope.offset": 80.0, "time.timestep": 0.1}
    scene = STANDING.with_values(packet | cell)
    # The packet is around row 20, which row 190 is nearer to across the faces than the centre, which sees none of it
    assert run(scene, tmp_path / "centre").info["smallest_overlap"] > 1 - 1e-6
    watched = scene.with_values({"monitor": [{"name": "across", "rows": [190, 190]}]})
    # Contacts at the edge of the cone lose 0.027 of their overlap, and half of it is far above what is at the centre
    assert run(watched, tmp_path / "across").info["smallest_overlap"] < 1 - 0.013


def test_contacts_that_bear_their_shear_do_not_stop_a_run_whose_bound_is_above_one(tmp_path: Path) -> None:
    # An L wave shears the contacts that hardly touch least: the bound takes the hardest sheared of all over them
    scene = STANDING.with_values({"wave.form": "running", "wave.amplitude": 0.5, "effects.friction": 0.5})
    record = run(scene, tmp_path / "run")
    guard = record.info["guards"]["largest_slip"]
    assert guard["bound"] > 1 > guard["value"] > 0
    assert guard["quiet"]
    assert guard["value"] == pytest.approx(Case(scene).largest_slip(), rel=0.25)  # the linear wave, to order a
    assert not (tmp_path / "run" / CONTACTS).exists()


def test_the_rule_takes_the_ratio_of_one_contact_at_one_time() -> None:
    case = Case(STANDING.with_values({"effects.friction": 0.5}))
    kappa, most = STANDING.sphere.stiffness_ratio, 0.0
    for normal, shear in zip(*case.stretches, strict=True):
        for degree in range(360):
            overlap = max(1 - normal * cos(degree * pi / 180), 0.0)
            force = 1.5 * kappa * abs(shear * cos(degree * pi / 180)) * overlap**0.5
            most = max(most, force / (0.5 * (overlap**1.5 + 1)))
    assert case.largest_slip() == pytest.approx(most, rel=1e-4)  # the phases are a degree apart


def test_a_deck_says_which_column_invalidates_its_run() -> None:
    last = build(STANDING).input_text.rpartition("run ${steps}")[2]
    for name in ("v_open", "v_slip", "v_torque", "v_spread"):
        assert f"INVALID: {name} is above " in last


# --- what LAMMPS leaves ----------------------------------------------------------------------------------------------


def test_what_is_no_number_is_not_silent(tmp_path: Path) -> None:
    problem = prepare(STANDING)
    for at in (NEVER, 2.0):
        table = {"v_tau": np.array([0.0, 10.0]), "v_open": np.array([0.0, np.nan]), "v_open_at": np.array([NEVER, at])}
        assert measured(GUARDS["open_contacts"], table, problem, tmp_path).passed_at == (10.0 if at == NEVER else 2.0)


def test_a_dump_of_contacts_that_was_cut_off_is_read_to_its_last_whole_look(tmp_path: Path) -> None:
    look = (
        "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ENTRIES\n2\nITEM: BOX BOUNDS pp pp pp\n0 1\n0 1\n0 1\nITEM: ENTRIES a b\n"
    )
    (tmp_path / "dump").write_text(look.format(3) + "1 2\n3 4\n" + look.format(6) + "1 2\n")
    ((step, names, contacts),) = read_snapshots(tmp_path / "dump")
    assert (step, names) == (3, ["a", "b"])
    assert contacts.tolist() == [[1, 2], [3, 4]]


def test_a_stopped_run_says_what_its_looks_found(tmp_path: Path) -> None:
    longer = {"time.duration": 2000.0, "time.allow_echo": True, "wave.amplitude": 0.01}
    scene = WALLED.with_values(STAYING | longer)

    def stop(step: int, steps: int) -> None:
        if step > 0 and "v_tau" in read_log(tmp_path / "run" / LOG).table:  # not so for the preload
            raise KeyboardInterrupt

    with pytest.raises(RunInterrupted):
        run(scene, tmp_path / "run", progress=stop)
    table = read_log(tmp_path / "run" / LOG).table
    last = {name: values[-1] for name, values in table.items()}
    assert last["v_tau"] == pytest.approx(last["Step"] * scene.time.step)  # printed with all digits, and no rounding
    assert last["Step"] % look_interval(scene) == 0
    # The wave takes hundredths of the overlap
    assert 0.9 < last["v_overlap"] < 1
    assert 0 < last["v_slip"] < 1
    assert last["v_open"] == 0


def test_the_dump_of_contacts_misses_no_look(tmp_path: Path) -> None:
    scene = STANDING.with_values({"wave.form": "running", "wave.amplitude": 0.5, "effects.friction": 0.01})
    with blind_rules(), pytest.raises(EffectError, match="sliding triggered its guard"):
        run(scene, tmp_path / "run")
    looks = [step for step, _, _ in read_snapshots(tmp_path / "run" / CONTACTS)]
    assert looks == list(range(0, scene.time.steps + 1, look_interval(scene)))


def test_every_guard_says_what_to_do() -> None:
    assert all("set " in guard.cure for guard in GUARDS.values())
