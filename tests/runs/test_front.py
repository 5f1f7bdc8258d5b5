"""The front of a strike or a source: when it arrives, how fast it is, and how far off both may be."""

from pathlib import Path

import numpy as np
import pytest

from cases.fronts.case import CHAIN as CHAIN_SPEED
from cases.fronts.front import front as front_of_theory
from granular_lmp import Record, Scene, front, run
from granular_lmp.cli import main
from granular_lmp.errors import ReadoutError
from granular_lmp.problem import prepare

CHAIN = Scene.load("solitary_chain").with_values({"packing.rows": 40, "time.duration": 60.0})


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(CHAIN, tmp_path_factory.mktemp("chain") / "run")


def pulses(arrival: np.ndarray, apart: float = 0.5) -> Record:
    """Record of the chain whose spheres behind the first have a crest of height 1 at these times, τ."""
    tau = np.arange(0.0, arrival.max() + 6.0, apart)
    velocity = np.zeros((len(tau), 40, 2))
    velocity[:, 1:, 1] = np.exp(-(((tau[:, None] - arrival) / 2.0) ** 2))
    velocity[0, 0, 1] = 1.0
    return Record(tau, {"velocity": velocity, "displacement": np.cumsum(velocity, axis=0) * apart}, CHAIN)


def test_arrivals_and_speed_of_known_pulses_lie_within_their_errors() -> None:
    sent = 3.0 + 1.37 * np.arange(39)
    record = pulses(sent)
    found, scale = front(record), record.scale
    assert found.row.tolist() == list(range(1, 40))
    assert np.all(np.abs(found.arrival - sent * scale.time) <= found.error)
    assert found.error.max() < 0.1 * scale.time  # a fifth of the time between two samples
    # A parabola leaves out x⁴/2 of exp(−x²), and samples are x = 1/4 apart
    assert found.height == pytest.approx(np.full(39, scale.velocity), rel=0.25**4 / 2)
    speed, error = found.speed
    true = 2 * CHAIN.sphere.radius / (1.37 * scale.time)
    assert abs(speed - true) <= error < 2e-3 * true
    assert abs(speed - 1.01 * true) > error


def test_of_a_front_that_slows_down_the_error_says_so() -> None:
    record = pulses(3.0 + 1.2 * np.arange(39) + 0.01 * np.arange(39) ** 2)
    speed, error = front(record).speed
    assert 0.05 < error / speed < 0.2  # from 1.2 to 2 t0 a sphere
    near = front(record).between(0.0, 10 * 2 * CHAIN.sphere.radius)
    assert len(near.row) == 10
    assert near.speed[0] > speed + error


def test_the_front_of_a_struck_chain_is_the_solitary_wave(chain: Record) -> None:
    found, scale = front(chain), chain.scale
    behind = found.between(*(2 * CHAIN.sphere.radius * np.array([15.0, 36.0])))
    height = behind.height.mean() / scale.velocity
    ours = behind.speed[0] * scale.time / (2 * CHAIN.sphere.radius)
    assert ours == pytest.approx(CHAIN_SPEED * height**0.2, rel=1e-3)
    assert ours != pytest.approx(CHAIN_SPEED * 1.1**0.2 * height**0.2, rel=1e-3)
    places = chain.rest - chain.rest[0]
    theirs = front_of_theory(chain.tau, chain.velocity, places / 2, 90.0)
    assert found.arrival == pytest.approx(theirs.time * scale.time, rel=1e-9)


def test_a_front_runs_along_the_asked_direction_and_part_of_the_velocity(chain: Record) -> None:
    assert front(chain, of="along").speed == pytest.approx(front(chain).speed)
    later = front(chain, origin=(10, 0))
    assert later.row[0] == 11
    assert later.speed[0] == pytest.approx(front(chain).speed[0], rel=1e-2)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"direction": 0.0}, "none of the 0 recorded spheres at 0 degrees has a crest"),
        ({"of": "alnog"}, "of = 'alnog': did you mean 'along'?"),
        ({"of": "across"}, "none of the 39 recorded spheres at 90 degrees has a crest"),
        ({"origin": (40, 0)}, r"origin: sphere \[40, 0\]: must be \[row, column\]"),
    ],
)
def test_a_front_that_is_not_there_is_refused(chain: Record, how: dict[str, object], message: str) -> None:
    with pytest.raises(ReadoutError, match=message):
        front(chain, **how)


def test_what_starts_no_front_or_records_one_sphere_is_refused(chain: Record) -> None:
    wave = Record.empty(prepare(Scene.load("tr_periodic")))
    with pytest.raises(ReadoutError, match=r"its trajectory has one sphere.*use a \[\[monitor\]\]"):
        front(wave)
    with pytest.raises(ReadoutError, match="arrived at 1 spheres"):
        _ = front(chain).between(0.0, 2.5 * CHAIN.sphere.radius).speed


def test_the_command_says_speed_and_arrival_and_writes_a_table(
    chain: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "front.csv"
    assert main(["front", str(chain.folder), "--between", "0.1:0.3", "-o", str(table)]) == 0
    said = capsys.readouterr().out
    speed, error = front(chain).between(0.1, 0.3).speed
    assert f"speed {speed:.6g} m/s, error {error:.1e} m/s" in said
    head, *rows = table.read_text().splitlines()
    assert head == "row,column,distance_m,arrival_s,error_s,height_m_s"
    assert len(rows) == 21
