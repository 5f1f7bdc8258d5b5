"""Error over time in a crystal that is not perfect: what is measured, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from cases.witness import case as witness
from granular_analysis.theory.errors import TheoryError
from granular_lmp import Record, Scene, run

SCENE = Scene.load("tr_periodic").with_values(
    {
        "packing.rows": 12,
        "packing.columns": 8,
        "wave.wavenumber": np.pi / 3,
        "wave.amplitude": 0.02,
        "disorder.radius": 5e-5,
        "time.duration": 6.0,
        "time.sample": 2.0,
        "output.particles": 2.0,
    }
)


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    folder = tmp_path_factory.mktemp("witness")
    return [run(SCENE.with_values({"time.timestep": step}), folder / str(step)) for step in (0.2, 0.1, 0.05)]


def test_errors_fall_by_the_orders_of_the_methods(records: list[Record]) -> None:
    found = {kind: [p for p in witness.measure(records) if p.kind == kind] for kind in (witness.LAMMPS, witness.PAIR)}
    fine, middle, coarse = (point.error for point in found[witness.LAMMPS])
    # Second and fourth order; the next order adds a share of a step squared, 4 % at 0.2
    assert coarse / middle == pytest.approx(4, rel=0.05)
    assert middle / fine == pytest.approx(4, rel=0.02)
    better, worse = (point.error for point in found[witness.PAIR])
    assert worse / better == pytest.approx(16, rel=0.3)
    assert better < fine / 100


def test_a_looser_tolerance_is_worse(records: list[Record]) -> None:
    errors = [point.error for point in witness.measure(records[:1]) if point.kind == witness.NETWORK]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 1e3 * errors[-1]


def test_runs_of_other_crystals_are_refused(records: list[Record], tmp_path: Path) -> None:
    other = run(SCENE.with_values({"disorder.seed": 2}), tmp_path / "other")
    with pytest.raises(TheoryError, match=r"the runs differ in more than time\.timestep"):
        witness.measure([records[0], other])


def test_a_distance_is_the_root_mean_square_of_all_spheres() -> None:
    field = np.zeros((2, 3, 2))
    field[1, 2] = [3.0, 4.0]
    assert witness.distance(field, np.zeros_like(field)) == pytest.approx(5 / np.sqrt(6))


def test_a_folder_that_is_no_sweep_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="is no sweep; granular-lmp sweep SCENE"):
        witness.main([str(tmp_path)])
