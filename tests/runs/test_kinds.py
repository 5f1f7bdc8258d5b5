"""Claims about monitors that hold for each kind that is declared (`granular_lmp.scene.monitor_kinds`)."""

import numpy as np
import pytest

from granular_lmp import Record, Scene, run
from granular_lmp.accuracy.recorded import Recorded
from granular_lmp.plot.monitors import monitor_figure
from granular_lmp.runs.export import si_columns_of_monitor
from granular_lmp.scene.monitor_kinds import KINDS, quantity_of


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    """A run with a monitor of each kind."""
    monitors = [{"name": name, "rows": [3, 5], "what": name} for name in KINDS]
    scene = Scene.load("tr_periodic").with_values({"monitor": monitors, "time.duration": 4.0})
    return run(scene, tmp_path_factory.mktemp("kinds") / "run")


@pytest.mark.parametrize("kind", KINDS)
def test_columns_exports_and_plots_have_the_quantities_of_the_kind(kind: str, record: Record) -> None:
    monitor, known = record.monitor(kind), KINDS[kind].quantities
    names = dict(zip(monitor.columns(), si_columns_of_monitor(monitor), strict=True))
    units = {said: quantity.unit.si for name, said in names.items() if (quantity := quantity_of(name, known))}
    assert units
    assert all(said.removesuffix("_s").endswith(f"_{unit}") for said, unit in units.items())
    labels = [each.get_ylabel().partition(" (")[0] for each in monitor_figure(monitor).axes]
    assert {*labels} <= {quantity.symbol for quantity in known.values() if quantity.symbol}


@pytest.mark.parametrize("kind", KINDS)
def test_si_columns_are_the_dimensionless_ones_in_one_unit(kind: str, record: Record) -> None:
    """What a column is in SI units differs from it by one factor, which is positive."""
    monitor = record.monitor(kind)
    for own, si in zip(monitor.columns().values(), si_columns_of_monitor(monitor).values(), strict=True):
        if own.dtype.kind == "f" and own.any():
            factor = si[own != 0] / own[own != 0]
            assert np.ptp(factor) <= 1e-12 * factor[0]  # rounding of a product


@pytest.mark.parametrize("kind", [name for name, each in KINDS.items() if each.of == "row"])
def test_what_is_recorded_of_rows_counts_for_a_tolerance(kind: str, record: Record) -> None:
    recorded = Recorded()
    recorded.add(record)
    assert {f"{kind}.{name}" for name in KINDS[kind].quantities} <= recorded.signals[0].keys()
