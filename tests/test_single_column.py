"""One column stands for three: the same wave and the same guards, on one neighbour list, or it is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from granular_lmp import Record, Scene, build, run
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.errors import EffectError, LammpsError, RunFolderError, RunInterrupted, SceneError
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.guards import first_step, look_interval
from granular_lmp.lammps.outputs import CHECKPOINTS, CONTACTS, DUMP, LOG, read_centre, read_log, read_snapshots
from granular_lmp.problem import prepare
from granular_lmp.runs.adopt import adopt
from granular_lmp.runs.record import read_status
from granular_lmp.scene.resolution import farthest_rounding
from granular_lmp.studies.forecast import forecast
from tests.hard.guard_study import blind_rules, random_scene
from tests.test_deck import lmp
from tests.test_guards import STANDING

ONE = {"packing.columns": 1}
STRIP = Scene.load("tr_nonresonant").with_values({"packing.rows": "auto", "time.duration": 30.0})
SCENES = {
    "TR in a strip": STRIP,
    "RT": Scene.load("rt_wave").with_values({"packing.rows": "auto", "time.duration": 10.0}),
    "standing L": STANDING.with_values({"wave.amplitude": 0.5}),
    "square lattice": Scene.load("tr_square").with_values({"time.duration": 10.0}),
    "packet": STRIP.with_values({"envelope.length": 6.0}),
    "a step so long that each is a look": STRIP.with_values({"time.timestep": 0.25}),
}
# The image of a sphere is where its neighbour of three columns is but for rounding, which is made anew at every step of
# at most 600: a random walk of as many roundings of the farthest position, the largest of thousands
ROUNDINGS = 100


def both(scene: Scene, folder: Path) -> tuple[Record, Record]:
    return run(scene.with_values(ONE), folder / "one"), run(scene.with_values({"packing.columns": 3}), folder / "three")


def largest_difference(first: Record, second: Record) -> float:
    """Return the largest difference of p, q and φ, in D0."""
    assert (first.tau == second.tau).all()
    return max(float(abs(first.signals[name] - second.signals[name]).max()) for name in ("p", "q", "phi"))


@pytest.mark.parametrize("name", SCENES)
def test_one_column_is_the_same_wave_under_the_same_guards_as_three(name: str, tmp_path: Path) -> None:
    one, three = both(SCENES[name], tmp_path)
    assert largest_difference(one, three) < ROUNDINGS * farthest_rounding(three.scene)
    assert one.info["smallest_overlap"] == pytest.approx(three.info["smallest_overlap"], abs=1e-7)  # printed to 1e-8
    slip, of_three = (record.info["guards"].get("largest_slip", {"bound": 0.0}) for record in (one, three))
    assert slip["bound"] == pytest.approx(of_three["bound"], rel=1e-6)  # printed to 8 digits
    assert "row_spread" not in one.info["guards"]  # a row of one sphere cannot spread


def test_the_comparison_sees_another_wave(tmp_path: Path) -> None:
    one, three = both(STRIP.with_values({"time.duration": 5.0}), tmp_path)
    other = replace(one, q=one.q * (1 + 1e-6))
    assert largest_difference(other, three) > ROUNDINGS * farthest_rounding(three.scene)


def test_a_contact_that_opens_stops_one_column_at_the_same_time_as_three(tmp_path: Path) -> None:
    passed = []
    for columns in (1, 3):
        folder = tmp_path / str(columns)
        with pytest.raises(EffectError, match=r"open_contacts = \d.*set effects.contact_opening = true"):
            run(STANDING.with_values({"packing.columns": columns}), folder)
        passed.append(read_status(folder)["guards"]["open_contacts"]["passed_at"])
    assert passed[0] == passed[1]  # a look at the same step


def test_a_contact_that_slides_stops_one_column(tmp_path: Path) -> None:
    values = {"wave.form": "running", "wave.amplitude": 0.5, "effects.friction": 0.01}
    scene = STANDING.with_values(values | ONE)
    with blind_rules(), pytest.raises(EffectError, match="sliding triggered its guard at tau = 0:"):
        run(scene, tmp_path / "run")
    # Every look is written out: LAMMPS would not find a variable that is new behind the preload
    looks = [step - first_step(scene) for step, _, _ in read_snapshots(tmp_path / "run" / CONTACTS)]
    assert looks == list(range(0, scene.time.steps + 1, look_interval(scene)))


@pytest.mark.parametrize(("family", "seed"), [("running", 9), ("standing", 3), ("walled", 2)])
def test_guards_find_the_same_at_the_same_time_in_one_column(family: str, seed: int, tmp_path: Path) -> None:
    found = []
    for columns in (1, 3):
        folder = tmp_path / str(columns)
        with blind_rules(), pytest.raises(EffectError, match="triggered its guard"):
            run(random_scene(family, seed).with_values({"packing.columns": columns}), folder)
        guards = read_status(folder)["guards"]
        found.append([guards[name]["passed_at"] for name in ("largest_slip", "open_contacts")])
    assert found[0] == found[1]  # looks at the same steps


# --- the neighbour list ----------------------------------------------------------------------------------------------


def renewed(deck: Deck) -> Deck:
    """Return the deck with a neighbour list that is renewed at every step."""
    text = deck.input_text.replace("\nrun ${steps}", "\nneigh_modify every 1 delay 0 check no\nrun ${steps}")
    assert text != deck.input_text
    return replace(deck, input_text=text)


def test_a_neighbour_list_that_is_renewed_fails_the_run_and_is_wrong(tmp_path: Path) -> None:
    scene = STRIP.with_values({"time.duration": 10.0})
    with pytest.raises(LammpsError, match=r"packing\.columns = 1: the neighbour list was renewed \d+ times"):
        run(renewed(build(scene.with_values(ONE))), tmp_path / "one")
    three = run(scene, tmp_path / "three")
    wrong = Record.from_dump(tmp_path / "one", build(scene.with_values(ONE)).scene)
    # What the refusal is for: the shear of two images is mixed up. A thousand times what rounding may do
    assert largest_difference(wrong, three) > 1000 * ROUNDINGS * farthest_rounding(three.scene)


def test_a_log_without_the_count_of_lists_is_no_proof(tmp_path: Path) -> None:
    deck = build(STRIP.with_values(ONE | {"time.duration": 5.0}))
    silent = replace(deck, input_text=deck.input_text.replace("pre no\n", "pre no post no\n"))
    with pytest.raises(LammpsError, match="renewed None times"):
        run(silent, tmp_path / "run")


def test_the_list_of_a_run_that_is_accepted_was_never_renewed(tmp_path: Path) -> None:
    run(STRIP.with_values(ONE | {"time.duration": 5.0}), tmp_path / "run")
    assert read_log(tmp_path / "run" / LOG).list_builds == 0


# --- runs ------------------------------------------------------------------------------------------------------------


def test_a_run_of_one_column_that_was_stopped_is_not_resumed_and_says_why(tmp_path: Path) -> None:
    def stop(step: int, steps: int) -> None:
        assert 0 <= step <= steps
        if step > 0:
            raise KeyboardInterrupt

    scene = STRIP.with_values(ONE | {"time.duration": 5000.0, "time.allow_echo": True})
    with pytest.raises(RunInterrupted, match="run it again with force=True"):
        run(scene, tmp_path / "run", progress=stop)
    assert not [name for name in CHECKPOINTS if (tmp_path / "run" / name).exists()]
    with pytest.raises(RunFolderError, match=r"packing\.columns = 1: a run of one column cannot be continued"):
        resume(tmp_path / "run")


def test_the_program_and_two_ranks_run_one_column(tmp_path: Path) -> None:
    scene = STRIP.with_values(ONE | {"time.duration": 5.0})
    module, program, ranks = (
        run(scene, tmp_path / name, **options)
        for name, options in {"module": {}, "lmp": {"launcher": "lmp"}, "ranks": {"ranks": 2}}.items()
    )
    assert (module.q == program.q).all()
    assert (module.p == program.p).all()
    assert largest_difference(module, ranks) < ROUNDINGS * farthest_rounding(module.scene)


def test_what_plain_lmp_left_of_one_column_is_adopted(tmp_path: Path) -> None:
    deck = build(STRIP.with_values(ONE | {"time.duration": 5.0}))
    deck.write(tmp_path / "plain")
    lmp(tmp_path / "plain", deck.input_name, "amplitude=0.1")
    adopted = adopt(tmp_path / "plain", tmp_path / "adopted")
    assert adopted.scene.wave.amplitude == 0.1
    same = run(STRIP.with_values(ONE | {"time.duration": 5.0, "wave.amplitude": 0.1}), tmp_path / "run")
    assert largest_difference(adopted, same) < ROUNDINGS * farthest_rounding(same.scene)


def test_no_checkpoint_is_promised_for_one_column() -> None:
    values = {"time.duration": 5.0}
    assert forecast(prepare(STRIP.with_values(ONE | values))).checkpoint is None
    assert forecast(prepare(STRIP.with_values(values))).checkpoint is not None
    assert "restart " not in build(STRIP.with_values(ONE | values)).input_text


def test_steps_begin_where_all_that_is_periodic_is_due(tmp_path: Path) -> None:
    scene = STRIP.with_values(ONE | {"time.duration": 5.0})
    record = run(scene, tmp_path / "run")
    assert read_centre(tmp_path / "run" / DUMP)["step"][0] == first_step(record.scene) > 0
    assert record.tau[0] == 0
    assert first_step(build(STRIP).scene) == 0


# --- what one column does not carry ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"packing.columns": 2}, r"packing\.columns = 2: must be at least 3, or 1"),
        ({"output.particles": 1.0}, "no snapshots"),
        ({"output.checkpoint": 5.0}, r'no checkpoint, output\.checkpoint = "auto"'),
        ({"effects.viscosity": 1e-8}, "no effect damping"),
        ({"effects.friction": 0.3, "effects.sliding": True}, "no effect sliding"),
        ({"effects.contact_opening": True}, "no effect contact_opening"),
        ({"wave.form": "driven"}, 'wave.form = "running" or "standing", not "driven"'),
        ({"disorder.density": 0.1, "packing.rows": 61}, "a perfect crystal"),
        ({"absorb.rows": 40, "packing.rows": 151, "envelope.length": 6.0}, "no effect quiet_ends"),
        ({"packing.ends": "periodic", "wave.direction": 60.0}, "a plane wave along y"),
    ],
)
def test_what_one_column_does_not_carry_is_refused_by_name(values: dict[str, Any], reason: str) -> None:
    with pytest.raises(SceneError, match=reason):
        prepare(STRIP.with_values(ONE | values))


def test_auto_stays_at_three_columns() -> None:
    assert STRIP.with_values({"packing.columns": "auto"}).shape.columns == 3
