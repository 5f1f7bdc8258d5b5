"""Impacts on chains that are pressed together, in LAMMPS through their scenes, against theories of their own code."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cases.solitary import case as figure
from cases.solitary.chain import compressed
from cases.solitary.chain_motion import integrate, peak
from cases.solitary.travelling import long_wave_speed, solitary_wave, sound
from granular_lmp import ImpactRecord, ImpactScene, run_impact
from granular_lmp.crystal.scale import collision_time
from granular_lmp.errors import SceneError
from granular_lmp.problem import prepare

Floats = NDArray[np.float64]
Runs = Callable[..., ImpactRecord]
CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.last": "free", "packing.rows": 20})
WEAK, STRONG = 100.0, 1e4  # N: 0.31 and 31 of the force of the impact


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Runs of a scene with values changed, each in a folder of its own."""

    def make(scene: ImpactScene, changes: dict[str, Any]) -> ImpactRecord:
        return run_impact(scene.with_values(changes), tmp_path_factory.mktemp("impact") / "run")

    return make


def test_nothing_moves_in_a_compressed_chain_before_the_wave_is_there(run: Runs) -> None:
    changes = {"packing.rows": 60, "packing.contact_force": WEAK, "packing.last": "wall"}
    record = run(CHAIN, changes | {"time.sample": 20.0, "time.duration": 20.0})
    # The front is at sphere 25; a chain that is not balanced to the last bit would tremble by 1e-12
    assert not record.velocity[-1, 50:-1].any()
    assert record.velocity[-1, 10, 1] != 0


@pytest.mark.parametrize("rest", [1e-3, 0.1, 1.0, 30.0])
def test_the_shortest_collision_is_never_too_long(rest: float) -> None:
    force = rest**1.5 * CHAIN.scale.mass * CHAIN.scale.velocity / CHAIN.scale.time
    problem = prepare(CHAIN.with_values({"packing.contact_force": force}))
    pair = compressed([1.0, 1.0], [0.0, 1.0, 0.0], rest**1.5)
    times = np.linspace(0.1, 1.0, 500) * collision_time(0.5)
    us, _ = integrate(pair, np.zeros(2), np.array([0.5, -0.5]), times)
    true = times[np.argmax(us[:, 0] < us[:, 1])] if rest > 1e-2 else collision_time(0.5)
    assert 0.82 * true < problem.rest.shortest_collision < 1.01 * true


def test_rounding_that_would_move_a_chain_is_refused() -> None:
    stiff = {"inclusion": [{"rows": [8, 11], "radius": 0.05, "youngs_modulus": 1e13, "density": 1e5}]}
    changes = {"packing.contact_force": 1e4, "time.timestep": 1e-4}
    with pytest.raises(SceneError, match=r"packing.contact_force = 10000.0: rounding of the places leaves a force of"):
        prepare(ImpactScene.from_dict(CHAIN.with_values(changes | {"striker.1.velocity": 1e-7}).to_dict() | stiff))
    assert prepare(ImpactScene.from_dict(CHAIN.with_values(changes).to_dict() | stiff)).rest.residual_force < 1e-8


def test_a_chain_that_is_pressed_too_deep_is_refused() -> None:
    soft = {"inclusion": [{"rows": [8, 8], "youngs_modulus": 1e9}]}
    with pytest.raises(SceneError, match=r"packing.contact_force = 10000.0: two spheres overlap by 0\.26"):
        prepare(ImpactScene.from_dict(CHAIN.with_values({"packing.contact_force": 1e4}).to_dict() | soft))


# --- from the solitary wave to sound ----------------------------------------------------------------------------------


def front(run: Runs, force: float, rows: int, velocity: float = 1.0) -> tuple[float, float, float]:
    """Speed of the front in that of sound, and its height in the overlap at rest at two places 40 spheres apart."""
    found = []
    unit = CHAIN.with_values({"packing.contact_force": force, "striker.1.velocity": velocity})
    rest = prepare(unit).rest.rest_overlap[0]
    fast = max(sound(1.0, 1.0, rest), 0.84)
    spots = [[at, 0] for at in (rows - 61, rows - 60, rows - 21, rows - 20)]
    shared = {"packing.rows": rows, "output.spheres": spots, "time.sample": 0.06}
    for step in (0.06, 0.03):
        record = run(unit, shared | {"time.timestep": step, "time.duration": 0.06 * round(17 * rows / fast)})
        u = record.displacement[..., 1]
        (one, first), (other, second) = (peak(record.tau, u[:, at] - u[:, at + 1]) for at in (0, 2))
        found.append(np.array([40 / (second - first) / sound(1.0, 1.0, rest), one / rest, other / rest]))
    speed, one, other = (4 * found[1] - found[0]) / 3
    return float(speed), float(one), float(other)


@pytest.mark.parametrize(("force", "rows"), [(1.0, 120), pytest.param(60.0, 300, marks=pytest.mark.more)])
def test_a_struck_chain_carries_the_exact_wave_of_its_compression(run: Runs, force: float, rows: int) -> None:
    speed, one, other = front(run, force, rows)
    assert one == pytest.approx(other, rel=1e-6)  # it does not change any more
    unit = CHAIN.with_values({"packing.contact_force": force})
    rest = prepare(unit).rest.rest_overlap[0]
    wave = solitary_wave(speed * sound(1.0, 1.0, rest), rest=rest)
    # Left of the step is its fourth order, 0.06⁴ = 1e-5 times a hundredth
    assert wave.largest_overlap / rest == pytest.approx(one, rel=1e-5)
    kdv, long = 1 + one / 12, float(long_wave_speed(1 + one))
    assert abs(kdv / speed - 1) > 3e-4
    assert abs(long / speed - 1) > 5e-4


def test_a_weak_impact_on_a_compressed_chain_is_sound(run: Runs) -> None:
    # Under 490 times its force an impact makes no solitary wave within 160 spheres. With ω = ck(1 − k²/24) its overlap
    # is Airy's function of (x − ct)/(ct/8)^{1/3}, whose crest at −1.0188 is at x = 120 in the middle of the two places
    speed, one, other = front(run, STRONG, 160, velocity=0.1)
    assert speed == pytest.approx(1 - 1.0188 / 6 * 120 ** (-2 / 3), abs=3e-4)
    # Its height falls as x^{-1/3} but for a share x^{-2/3} = 0.04, a fifth of which is left in the ratio
    assert other / one == pytest.approx((140 / 100) ** (-1 / 3), abs=1e-2)


def test_a_wave_close_to_sound_runs_unchanged(run: Runs) -> None:
    rows, rest = 120, 4.0
    wave = solitary_wave(1.05 * sound(1.0, 1.0, rest), rest=rest)
    u, v = wave.start(rows, crest=40.0)
    unit = CHAIN.scale  # of 1 m/s, A = m = 1
    state = [[row, 0, 0, float(u[row] * unit.length), 0, float(v[row]), 0] for row in range(rows)]
    force = rest**1.5 * unit.mass * unit.velocity / unit.time
    changes = {"packing.rows": rows, "packing.contact_force": force}
    scene = ImpactScene.from_dict(
        {name: table for name, table in CHAIN.with_values(changes).to_dict().items() if name != "striker"}
        | {"start": {"state": state}}
    )
    time = 40 / wave.speed * unit.time / scene.scale.time
    pair = [
        run(scene, {"time.timestep": time / steps, "time.sample": time, "time.duration": time}) for steps in (800, 1600)
    ]
    velocity = (4 * pair[1].velocity[-1, :, 1] - pair[0].velocity[-1, :, 1]) / 3 * scene.scale.velocity
    expected = wave.start(rows, crest=80.0)[1]
    # The fourth order of the step: 1.4e-5 with half as many
    assert velocity == pytest.approx(expected, abs=3e-6 * float(v.max()))
    assert np.max(np.abs(velocity - wave.start(rows, crest=80.1)[1])) > 1e-2 * float(v.max())


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_has_the_points_of_its_runs(run: Runs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spots = [[at, 0] for at in (59, 60, 79, 80)]
    changes = {"packing.rows": 90, "packing.contact_force": 10.0, "output.spheres": spots}
    record = run(CHAIN, changes | {"time.sample": 0.12, "time.duration": 110.0})
    found = figure.front(record)
    rest = float(record.problem.rest.rest_overlap[0])
    wave = solitary_wave(found.speed * sound(1.0, 1.0, rest), rest=rest)
    # The error of one step of 0.03
    assert found.second == pytest.approx(wave.largest_overlap / rest, rel=1e-3)
    assert found.steady
    assert not figure.Front(1.0, 1.01, 1.1).steady
    monkeypatch.setattr(figure, "MASSES", np.array([0.5, 2.0]))  # the lines of the theory take 5 s
    monkeypatch.setattr(figure, "RATIOS", np.array([1.01, 1.5, 3.0]))
    assert figure.main([str(record.folder), "-o", str(tmp_path / "a.png")]) == 0
    assert (tmp_path / "a.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"packing.contact_force": 0.0}, "must be a chain of equal spheres with packing.contact_force above 0"),
        ({"disorder.density": 0.1}, "must be a chain of equal spheres"),
        ({"output.spheres": [[3, 0], [4, 0]]}, "rows [3, 4] are recorded: must be two pairs of neighbours"),
    ],
)
def test_the_figure_refuses_other_runs(run: Runs, changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    spots = {"packing.contact_force": 10.0, "output.spheres": [[3, 0], [4, 0], [8, 0], [9, 0]]}
    record = run(CHAIN, spots | {"time.duration": 1.0} | changes)
    with pytest.raises(SystemExit, match=re.escape(message)):
        figure.main([str(record.folder), "-o", str(tmp_path / "a.png")])
