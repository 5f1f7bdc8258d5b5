"""Sweeps of scenes without a wave: the table says what arrived at the far sphere, when, and what energy is kept."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp import ImpactRecord, ImpactScene, html, run_impact
from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError, SceneError
from granular_lmp.plot.view import sweep_figure, view
from granular_lmp.problem import prepare
from granular_lmp.studies.far_sphere import arrival, far_sphere, read_outs
from granular_lmp.studies.sweep import Sweep, sweep

CHAIN = ImpactScene.load("solitary_chain").with_values(
    {"packing.rows": 12, "packing.last": "free", "time.duration": 24.0, "time.sample": 0.25}
)
SHEET = ImpactScene.load("point_impact").with_values(
    {"packing.rows": 8, "packing.columns": 9, "striker.1.spheres": [[0, 4]], "time.duration": 6.0}
)
SPEEDS = {"striker.1.velocity": [0.1, 1.0, 10.0]}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    """A chain struck at three speeds."""
    return sweep(CHAIN, SPEEDS, tmp_path_factory.mktemp("sweep") / "speeds")


def test_one_motion_at_any_velocity_has_one_line(swept: Sweep) -> None:
    # One motion in units of the impact, but for roundings of positions, 1e-12 of the overlap at 0.1 m/s
    for name in ("far_speed", "far_tau", "kinetic_kept", "energy_kept"):
        assert swept.column(name) == pytest.approx(np.full(3, swept.column(name)[1]), rel=1e-8)
    # The law of t0, v^(-1/5)
    assert swept.column("t0_s")[0] / swept.column("t0_s")[1] == pytest.approx(10**0.2, rel=1e-12)
    assert [row["far_row"] for row in swept.rows] == [11, 11, 11]


def test_the_last_sphere_of_a_free_chain_flies_off_with_the_energy_of_the_wave(swept: Sweep) -> None:
    row, record = swept.rows[1], swept.record(swept.rows[1])
    assert isinstance(record, ImpactRecord)
    assert row["far_speed"] == np.linalg.norm(record.velocity[:, 11], axis=1).max()
    assert row["kinetic_kept"] == pytest.approx(record.kinetic_energy[-1].sum() / 0.5)
    # Steps of 0.03 t0 leave 1e-4 of the energy; without the energy of contacts percents of it would be missing
    assert row["energy_kept"] == pytest.approx(1, abs=5e-4)
    middle = read_outs({}, _until(record, 7.0))
    assert middle["energy_kept"] == pytest.approx(1, abs=5e-4)
    assert middle["kinetic_kept"] < 0.9


def _until(record: ImpactRecord, tau: float) -> ImpactRecord:
    kept = record.tau <= tau
    return replace(record, tau=record.tau[kept], signals={name: all_[kept] for name, all_ in record.signals.items()})


def test_arrival_is_between_two_samples() -> None:
    tau = np.array([0.0, 1.0, 2.0, 3.0])
    assert arrival(tau, np.array([0.0, 0.2, 0.6, 0.4])) == pytest.approx(1.25)  # a quarter of the way from 0.2 to 0.6
    assert arrival(tau, np.array([1.0, 0.2, 0.6, 0.4])) == 0.0
    assert arrival(tau, np.zeros(4)) is None


def test_nothing_is_said_of_a_sphere_that_the_wave_has_not_passed(swept: Sweep) -> None:
    record = swept.record(swept.rows[1])
    assert isinstance(record, ImpactRecord)
    early = read_outs({}, _until(record, 12.0))
    assert (early["far_row"], early["far_speed"], early["far_tau"]) == (11, None, None)


def test_a_small_rise_at_the_end_does_not_hide_the_crest_that_has_passed(swept: Sweep) -> None:
    record = swept.record(swept.rows[1])
    assert isinstance(record, ImpactRecord)
    record.velocity[:, 11] = 0.0
    record.velocity[[-6, -5, -4, -2, -1], 11, 1] = 0.1, 0.2, 0.1, 0.001, 0.002  # the last rise is 1 % of the crest
    row = read_outs({}, record)
    assert row["far_speed"] == 0.2
    assert row["far_tau"] == record.tau[-6]


def test_the_far_sphere_is_the_farthest_that_is_recorded_and_free(tmp_path: Path) -> None:
    record = run_impact(SHEET, tmp_path / "sheet")
    arrays = record.problem.rest.atoms.arrays
    # Both upper corners are as far; the first in a row counts, whatever the rounding of their distances
    place = far_sphere(record)
    assert place is not None
    assert (arrays["row"][place], arrays["column"][place]) == (7, 0)
    three = {"packing.last": "held", "output.spheres": [[7, 0], [3, 4], [1, 3]]}
    held = run_impact(SHEET.with_values(three), tmp_path / "b")
    place = far_sphere(held)
    assert place is not None
    assert held.problem.rest.atoms.arrays["row"][held.problem.rest.recorded[place]] == 3
    row = read_outs(held.info, held)
    assert row["far_row"] == 3
    assert row["energy_kept"] is None  # not all spheres are recorded
    struck = run_impact(SHEET.with_values({"output.spheres": [[0, 4]]}), tmp_path / "d")
    assert far_sphere(struck) is None  # it has no way to go
    none = run_impact(SHEET.with_values({"packing.last": "held", "output.rows": [7, 7]}), tmp_path / "c")
    assert far_sphere(none) is None
    assert read_outs(none.info, none)["far_speed"] is None


@pytest.mark.parametrize(
    ("scene", "over"),
    [
        (SHEET, {"disorder.seed": [1, 2], "disorder.density": [0.1]}),
        (SHEET, {"effects.friction": [0.0, 0.3]}),
        (CHAIN, {"packing.rows": [12, 14]}),
        (
            ImpactScene.from_dict(CHAIN.to_dict() | {"inclusion": [{"rows": [5, 5], "density": 7800.0}]}),
            {"inclusion.1.density": [3900.0, 15600.0], "inclusion.1.radius": [4e-3]},
        ),
    ],
    ids=["seed", "friction", "rows", "inclusion"],
)
def test_any_key_can_be_swept(scene: ImpactScene, over: dict[str, Any], tmp_path: Path) -> None:
    done = sweep(scene, over, tmp_path / "sweep")
    assert [row["status"] for row in done.rows] == ["finished"] * len(done.rows)
    assert len({row["kinetic_kept"] for row in done.rows}) == len(done.rows)


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({"striker.1.speed": [1.0]}, "striker.1.speed: unknown key"),
        ({"striker.2.velocity": [1.0]}, "striker.2.velocity: the scene has 1 [[striker]], counted from 1"),
        ({"striker.1.velocity": [1.0, -1.0]}, "striker.1.velocity = -1.0: must be"),
        ({"time.timestep": [0.03, 0.9]}, "leaves the shortest collision of two neighbours"),
        ({"wave.wavenumber": [1.0]}, "wave"),
        ({"time.tolerance": [1e-2, 1e-9], "time.duration": [1e6]}, "would take more than 1000000000 steps"),
    ],
)
def test_what_does_not_fit_is_one_error_before_anything_is_written(
    over: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError) as caught:
        sweep(CHAIN, over, tmp_path / "sweep")
    assert message in str(caught.value)
    assert not (tmp_path / "sweep").exists()


def test_a_guard_that_triggers_fails_its_run_alone(tmp_path: Path) -> None:
    # At 118 m/s two spheres overlap by 0.0497 of the diameter, and a row of four strikers makes it more
    scene = ImpactScene.from_dict(
        CHAIN.with_values({"packing.rows": 6, "packing.last": "wall"}).to_dict()
        | {"striker": [{"rows": [0, 3], "velocity": 1.0}]}
    )
    done = sweep(scene, {"striker.1.velocity": [1.0, 118.0]}, tmp_path / "sweep")
    assert [row["status"] for row in done.rows] == ["finished", "failed"]
    assert "largest_overlap = " in done.rows[1]["message"]
    assert done.rows[1]["guards"] == "largest_overlap"
    assert done.rows[1]["largest_overlap"] > 0.05 > done.rows[0]["largest_overlap"]


def test_the_command_sweeps_and_view_draws(
    drawn_once: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(tmp_path / "sweep")
    (tmp_path / "mine.toml").write_text(CHAIN.to_toml())
    words = ["sweep", str(tmp_path / "mine.toml"), "--over", "striker.1.velocity=1:2:2", "--set", "packing.rows=11"]
    assert main([*words, "-o", folder]) == 0
    assert capsys.readouterr().out == f"{folder}: 2 of 2 runs finished; {folder}/sweep.csv\n"
    assert main([*words, "-o", folder, "--all-effects"]) == 2
    assert "--all-effects: is for the scene of a wave" in capsys.readouterr().err
    assert view(folder, tmp_path / "curve.png", column="far_tau") == []
    assert (tmp_path / "curve.png").stat().st_size > 5000
    assert main(["resume", folder]) == 2
    assert "holds a sweep; repeat its sweep command" in capsys.readouterr().err


def test_a_picture_and_a_card_have_the_columns_of_impacts(swept: Sweep) -> None:
    (axes,) = sweep_figure(swept).axes
    assert axes.get_ylabel() == "largest speed of the far sphere / speed of the striker"
    assert axes.get_xlabel().startswith("velocity of striker 1 (m/s")
    assert "far_tau" in html(swept)


def test_the_far_sphere_is_far_across_periodic_sides(tmp_path: Path) -> None:
    ring = SHEET.with_values({"packing.sides": "periodic", "packing.lattice": "square", "striker.1.spheres": [[0, 0]]})
    record = run_impact(ring.with_values({"output.rows": [0, 0]}), tmp_path / "ring")
    assert far_sphere(record) == 4  # the last of nine columns in a ring touches the first
    assert read_outs({}, record)["far_column"] == 4


def test_energies_are_over_all_that_is_given(tmp_path: Path) -> None:
    state = [[3, 0, 0, 0, 0, 0.9, 0]]
    scene = ImpactScene.from_dict(CHAIN.to_dict() | {"start": {"state": state}})
    whole = run_impact(scene, tmp_path / "whole")
    # 1 m/s and 0.9 m/s of two equal spheres
    assert whole.problem.rest.given_energy == pytest.approx((1 + 0.81) / 2, rel=1e-12)
    assert whole.kinetic_energy[0].sum() == pytest.approx(whole.problem.rest.given_energy, rel=1e-12)
    part = run_impact(scene.with_values({"output.rows": [0, 11], "packing.last": "wall"}), tmp_path / "part")
    few = run_impact(scene.with_values({"output.rows": [8, 11], "packing.last": "wall"}), tmp_path / "few")
    share = part.kinetic_energy[-1, 8:].sum() / 0.905
    assert read_outs({}, few)["kinetic_kept"] == pytest.approx(share, rel=1e-12)
    assert read_outs({}, few)["energy_kept"] is None


def test_the_energy_of_a_state_counts_its_spins() -> None:
    rough = SHEET.with_values({"effects.friction": 0.2})
    spin = 2.0 / rough.sphere.radius
    scene = ImpactScene.from_dict(rough.to_dict() | {"start": {"state": [[3, 3, 0, 0, 0, 1.0, spin]]}})
    given = prepare(scene).rest.given_energy * scene.scale.velocity**2  # in m (m/s)²
    assert given == pytest.approx((1 + 1 + 0.4 * 4) / 2, rel=1e-12)  # the striker at 1 m/s, and I = 0.4 m R²


@pytest.mark.parametrize(
    ("rows", "state"),
    [
        ([0, 11], [[11, 0, 0, 1e-6, 0, 0, 0]]),  # the last sphere is drawn away from a chain that nothing presses
        ([8, 11], [[5, 0, 0, 1e-6, 0, 0, 0]]),  # what it presses is not recorded
    ],
)
def test_no_share_is_said_of_an_energy_that_is_none_or_not_known(
    rows: list[int], state: list[list[float]], tmp_path: Path
) -> None:
    scene = ImpactScene.from_dict(CHAIN.to_dict() | {"striker": [], "start": {"state": state}})
    record = run_impact(scene.with_values({"output.rows": rows, "time.duration": 2.0}), tmp_path / "run")
    found = read_outs({}, record)
    assert (found["kinetic_kept"], found["energy_kept"]) == (None, None)


def test_no_energy_is_said_once_spheres_meet_that_were_no_neighbours() -> None:
    problem = prepare(SHEET.with_values({"packing.lattice": "square"}))
    still = np.zeros((2, len(problem.rest.atoms), 2))
    moved = still.copy()
    length = problem.scene.sphere.radius / problem.scene.scale.length  # a radius in l
    sphere = int(
        np.flatnonzero((problem.rest.atoms.arrays["row"] == 7) & (problem.rest.atoms.arrays["column"] == 8))[0]
    )
    moved[1, sphere] = 0.5 * length  # the corner flies off
    velocity = still + 1.0
    free = ImpactRecord(np.arange(2.0), {"displacement": moved, "velocity": velocity}, problem.scene)
    assert free.energy() == pytest.approx(
        len(problem.rest.atoms), rel=1e-12
    )  # kinetic, v² of 2 in the unit of the impact
    moved[1, sphere] = -0.6 * length  # 1.98 radii from the one across, 2.83 at rest
    into = ImpactRecord(np.arange(2.0), {"displacement": moved, "velocity": velocity}, problem.scene)
    with pytest.raises(RunFolderError, match="at tau = 1 spheres touch that were not neighbours at rest"):
        into.energies()
    found = read_outs({}, into)
    assert found["energy_kept"] is None
    assert found["kinetic_kept"] == pytest.approx(
        2 * len(problem.rest.atoms), rel=1e-12
    )  # over the energy of one striker
