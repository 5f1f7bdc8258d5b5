"""The front of an impact: how it is measured, and what it does in a hexagonal sheet."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cases.fronts import case as fronts
from cases.fronts.front import front
from granular_analysis.measure.arrivals import crest
from granular_lmp import ImpactRecord, ImpactScene, run_impact

TIMES = np.arange(0.0, 60.0, 0.4)
SCENE = ImpactScene.load("point_impact")


def pulses(decay: float, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocities (T, n, 2) and places (n, 2) of pulses along 30 degrees, with a sphere beside the line."""
    distance = np.linspace(3.0, 30.0, 10)
    height, moment = distance**-decay, distance**delay
    velocity = height * np.exp(-(((TIMES[:, None] - moment) / 2.5) ** 2))
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    places = np.vstack([distance[:, None] * along, [[5.0, 0.0]]])
    return np.concatenate([velocity[..., None] * along, np.ones((len(TIMES), 1, 2))], axis=1), places


def test_a_front_that_decays_by_a_power_is_measured_as_such() -> None:
    found = front(TIMES, *pulses(0.7, 1.1), 30.0)
    assert len(found.distance) == 10
    # Parabolas through samples of 0.4 of a pulse of 2.5 err by 1e-4
    assert found.decay == pytest.approx(0.7, abs=1e-3)
    assert front(TIMES, *pulses(0.75, 1.1), 30.0).decay != pytest.approx(0.7, abs=1e-2)
    # dr/dt = (r/t)/1.1, at the geometric mean of two distances to a second order of 1 % in their ratio
    middle = np.sqrt(found.distance[1:] * found.distance[:-1])
    assert found.scaled_speed == pytest.approx(middle**-0.1 / 1.1 * middle**0.14, rel=2e-2)
    assert found.scaled_speed != pytest.approx(1.05 * middle**-0.1 / 1.1 * middle**0.14, rel=2e-2)
    assert found.between(10.0, 20.0).distance == pytest.approx([12.0, 15.0, 18.0])


def test_the_first_crest_counts_even_if_a_later_one_is_higher() -> None:
    early, late = (np.exp(-(((TIMES - moment) / 2.5) ** 2)) for moment in (20.1, 40.0))
    time, height = crest(TIMES, 0.3 * early + late)
    assert (time, height) == pytest.approx((20.1, 0.3), abs=2e-3)
    assert np.isnan(crest(TIMES, 1e-7 * early)[1])  # below what counts


def test_a_direction_without_spheres_is_refused() -> None:
    with pytest.raises(ValueError, match="no recorded sphere at 77 degrees"):
        front(TIMES, *pulses(0.5, 1.0), 77.0)


# --- in LAMMPS --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> Callable[[float], ImpactRecord]:
    """Runs of the shipped sheet with a friction, recorded in the four directions."""
    done: dict[float, ImpactRecord] = {}

    def make(friction: float) -> ImpactRecord:
        if friction not in done:
            ways = {0: (0, 1.0), 30: (2, 3.0), 60: (1, 0.5), 90: (2, 0.0)}  # rows and columns of a step
            spheres = {(0, 30)}
            for rows, columns in ways.values():
                steps = range(1, 40 // rows if rows else 29)
                # Rows of odd number lie half a column to the left of the first
                places = ((n * rows, 30 + n * columns - (n * rows % 2) / 2) for n in steps)
                spheres |= {(row, round(column)) for row, column in places if column <= 60}
            changes = {"effects.friction": friction, "time.duration": 48.0, "time.sample": 0.4}
            scene = SCENE.with_values(changes | {"output.spheres": sorted(map(list, spheres))})
            done[friction] = run_impact(scene, tmp_path_factory.mktemp("sheet") / "run")
        return done[friction]

    return make


def test_the_front_of_a_point_impact_decays_by_a_power(sheet: Callable[[float], ImpactRecord]) -> None:
    found = fronts.fronts(sheet(0.0))
    for degrees in (30, 60, 90):
        # Energy on a line that grows with the distance: 1/2; so near the striker the power is not quite reached
        assert found[degrees].decay == pytest.approx(0.5, abs=0.12)
    # Half a hexagon: the front is farther, after the same time, at its corner than at the middle of its side
    assert found[60].time[-1] / found[60].distance[-1] < found[30].time[-1] / found[30].distance[-1]


def test_the_speed_of_the_front_goes_with_the_fifth_root_of_its_height(sheet: Callable[[float], ImpactRecord]) -> None:
    found = fronts.fronts(sheet(0.0))
    for degrees in (30, 90):  # across the sides of the front
        scaled = found[degrees].scaled_speed
        assert scaled == pytest.approx(np.mean(scaled), rel=5e-3)
        # Another power would show: the height falls by a third at least, its tenth root by 4 %
        assert found[degrees].height[-1] < 0.67 * found[degrees].height[0]


def test_friction_makes_the_front_decay_faster(sheet: Callable[[float], ImpactRecord]) -> None:
    smooth, rough = (fronts.fronts(sheet(friction)) for friction in (0.0, 0.3))
    for degrees in (30, 60, 90):
        assert rough[degrees].decay > 1.4 * smooth[degrees].decay
        assert rough[degrees].height[-1] < 0.8 * smooth[degrees].height[-1]


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_of_fronts_is_drawn_with_a_table(
    sheet: Callable[[float], ImpactRecord], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = sheet(0.0)
    assert fronts.main([str(record.folder), "-o", str(tmp_path / "fronts.png")]) == 0
    assert (tmp_path / "fronts.png").stat().st_size > 10_000
    assert len(re.findall(r"^run +\d+ ", capsys.readouterr().out, re.MULTILINE)) == len(fronts.DIRECTIONS)


def test_a_sheet_whose_sides_are_near_is_refused(tmp_path: Path) -> None:
    narrow = SCENE.with_values({"packing.columns": 31, "striker.1.spheres": [[0, 15]], "time.duration": 30.0})
    with pytest.raises(ValueError, match="2 recorded spheres at 0 degrees that the front has passed"):
        fronts.fronts(run_impact(narrow, tmp_path / "run"))  # beyond 10 to 15 distances, the last at the side
