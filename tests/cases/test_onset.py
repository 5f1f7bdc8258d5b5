"""How the paper's wave ends: the amplitudes at which contacts open and slide, from runs of different amplitude."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.onset import case as figure
from cases.onset.onset import crossing, onset
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.plotting import save
from granular_analysis.theory.network_ledger import energy
from granular_analysis.theory.network_motion import integrate
from granular_lmp import Record, Scene, run
from granular_lmp.studies.sweep import sweep

CELL = Scene.load("tr_periodic").with_values(
    {"time.duration": 10.0, "effects.contact_opening": True, "effects.sliding": False, "effects.friction": 0.3}
)
AMPLITUDES = [0.5, 0.7, 0.9, 1.1, 2.1, 2.3, 2.5, 2.7]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    done = sweep(CELL, {"wave.amplitude": AMPLITUDES}, tmp_path_factory.mktemp("onset") / "sweep")
    assert np.all(np.diff(done.column("smallest_overlap")[:5]) < 0)
    assert np.all(np.diff(done.column("largest_slip")) > 0)
    return [done.record(row) for row in done.rows]


def test_a_crossing_is_read_off_a_parabola() -> None:
    a = np.array([0.1, 0.4, 0.6, 0.8, 1.2])
    left = 1 - a - 0.1 * a**2
    exact = (-1 + np.sqrt(1.4)) / 0.2
    found = crossing(a, left, left <= 0)
    assert found is not None
    # The inverse is no parabola: its third derivative, 12 · 0.1²/(1 + 0.2 a)^5, times the three distances over 6
    assert found[0] == pytest.approx(exact, abs=1e-3)
    assert abs(found[0] - exact) < found[1]
    assert crossing(a, left, np.zeros(5, dtype=bool)) is None


@pytest.mark.parametrize("left", [[np.nan] * 4, [0.9, 0.8, 0.7, np.nan]])
def test_where_no_parabola_is_known_the_interval_is_the_answer(left: list[float]) -> None:
    assert crossing([1, 2, 3, 4], left, [False, False, False, True]) == (3.5, 0.5)


def test_an_event_in_the_first_run_is_refused() -> None:
    with pytest.raises(ValueError, match=r"wave\.amplitude = 1: is beyond the onset already"):
        crossing([1, 2, 3], [-0.1, -0.2, -0.3], [True, True, True])


def test_a_wave_opens_its_contacts_before_the_linear_rule_and_slides_by_it(runs: list[Record]) -> None:
    opening, sliding = onset(runs, "opening"), onset(runs, "sliding")
    assert opening is not None
    assert sliding is not None
    # The wave is strongest at the start, where it is the linear mode: 3e-3 is the parabola between amplitudes 0.2 apart
    assert sliding.amplitude == pytest.approx(sliding.linear, rel=3e-3)
    assert opening.linear == pytest.approx(2.6823, rel=1e-3)  # 1/(largest stretch of an amplitude of 1)
    assert (opening.amplitude, opening.error) == pytest.approx((2.4, 0.1))
    assert opening.amplitude + opening.error < opening.linear


def test_runs_that_cannot_tell_are_refused(runs: list[Record], tmp_path: Path) -> None:
    sliding = CELL.with_values({"effects.sliding": True, "wave.amplitude": 0.3})
    done = sweep(sliding, {"effects.friction": [0.1]}, tmp_path / "sweep")
    with pytest.raises(ValueError, match=r"effects\.sliding = true: must be false"):
        onset([done.record(done.rows[0])], "opening")
    with pytest.raises(ValueError, match="two runs have the same wave.amplitude"):
        onset([runs[0], runs[0]], "opening")
    other = replace(runs[1], scene=runs[1].scene.with_values({"wave.phase": 0.1}))
    with pytest.raises(ValueError, match=r"the runs must differ only in wave\.amplitude"):
        onset([runs[0], other], "opening")


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_shows_map_harmonic_and_friction(runs: list[Record], tmp_path: Path) -> None:
    found = runs, figure.points(runs)
    assert figure.table(found).count("running") == 1
    drawn = figure.draw(found)
    assert len(drawn.axes) == 4
    save(drawn, tmp_path / "onset.png")


@pytest.mark.parametrize("friction", [0.1, 1e3])
def test_beyond_it_lammps_meets_the_network_whose_ledger_closes(friction: float, tmp_path: Path) -> None:
    changes = {"effects.sliding": True, "effects.friction": friction, "wave.amplitude": 2.5, "output.particles": 8.0}
    record = run(CELL.with_values(changes | {"time.duration": 8.0, "time.timestep": 0.0125}), tmp_path / "run")
    assert record.info["guards"]["open_contacts"]["value"] > 0
    first = first_snapshot(record)
    network = integrate(
        first.network,
        first.state,
        record.tau * first.time,
        rtol=1e-8,
        spheres=[first.recorded],
        longest_step=0.05 * first.time,
    )
    p, q, _ = first.signals(network)
    # LAMMPS: contacts that part inside a step, of first order; 3e-4 in p measured after τ = 30
    assert np.abs(p - record.p).max() < 5e-4
    assert np.abs(q - record.q).max() < 5e-4
    resting = replace(first.state, motion=0 * first.state.motion, shear=0 * first.state.shear)
    wave = network.initial_energy - energy(first.network, resting).total
    heat = network.heat[-1] / wave
    assert heat > 0.1 if friction < 1 else abs(heat) < 1e-4  # the second is the error of the ledger: 1e-5 measured
