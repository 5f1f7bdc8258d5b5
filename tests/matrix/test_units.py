"""Scenes are the same physics in any units of mass, length and time: their decks, their runs, and what judges them."""

from pathlib import Path

import numpy as np
import pytest

from granular_analysis.tools.compare import Comparison, compare
from granular_lmp import Scene, build, run
from granular_lmp.cli.entry import main
from granular_lmp.studies.features import KINDS
from tests.conftest import members
from tests.matrix.compared import SHORT
from tests.matrix.outcomes import alone
from tests.matrix.units import departures, sizes

SCENES = {
    f"{kind.name}, {name}": kind.scene.with_values({**kind.features[name], **(SHORT if kind.scene.wave else {})})
    for kind in KINDS
    for name in alone(kind)
}
SCENES |= {
    name: Scene.load(name).with_values({"time.duration": 10.0})
    for name in ("compressed_chain", "fcc_transverse", "monolayer_rocking", "multilayer", "steel_compressed")
}
LINES = 1e-9  # share of a number: spheres come to rest to 1e-11 of their places
# Shares of the largest signal, and of an error. Positions have 16 digits, and D0 or l is 1e-7 of the farthest and more;
# where contacts open the network errs by up to 1e5 of its tolerance, 1e-9, in other steps by another part of it
SIGNALS, ERRORS, FLOOR = 1e-6, 1e-2, 1e-6
REFUSED = {"waves, rolling"}  # by every theory
RUN = ("impacts, chain", "compressed_chain", "waves, radii", "monolayer_rocking")


def texts(scene: Scene) -> dict[str, str]:
    """Return the files of a deck; a table of spheres, whose name depends on its values, as "spheres.csv"."""
    table = scene.packing.table or "spheres.csv"
    named = {name: "".join(pieces).replace(table, "spheres.csv") for name, pieces in build(scene).files().items()}
    return {name.replace(table, "spheres.csv"): text for name, text in named.items()}


@pytest.mark.parametrize("name", members(SCENES, *list(SCENES)[1::2]))
def test_a_deck_is_the_same_in_any_units(name: str) -> None:
    small, large = map(texts, sizes(SCENES[name]))
    assert not [each for file, text in small.items() for each in departures(text, large[file], LINES)]


@pytest.mark.parametrize("name", ["fcc_transverse", "hcp_c_axis"])  # which have branches of one frequency
def test_modes_are_listed_in_the_same_order_in_any_units(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listed = []
    for scene in (Scene.load(name), *sizes(Scene.load(name))):
        (tmp_path / "scene.toml").write_text(scene.to_toml(), encoding="utf-8")
        assert main(["modes", str(tmp_path / "scene.toml")]) == 0
        listed.append([line.split()[:2] for line in capsys.readouterr().out.splitlines()[2:]])
    assert listed[1:] == [listed[0]] * 2


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("D0 = 2.5e-10 m", "D0 = 0.25 m", True),
        ("units nano: ag, nm, ns, MPa, mJ/m2", "units si: kg, m, s, Pa, J/m2", True),
        ("D0 = 2.5e-10 m", "D0 = 0.250000001 m", False),
        ("overlap 0", "overlap 1e-300", False),
        ("of 12 spheres", "of 12 rows", False),
    ],
)
def test_lines_depart_by_numbers_or_words(one: str, other: str, same: bool) -> None:
    assert ([*departures(one, other, LINES / 10)] == []) == same


@pytest.mark.parametrize("name", members([name for name in SCENES if name not in REFUSED], *(SCENES.keys() - RUN)))
def test_a_run_and_its_comparison_are_the_same_in_any_units(name: str, tmp_path: Path) -> None:
    small, large = (compare(run(each, tmp_path / f"{n}")) for n, each in enumerate(sizes(SCENES[name])))
    largest = max(np.nanmax(np.abs(values), initial=0.0) for values in small.record.signals.values())
    for signal, values in small.record.signals.items():
        np.testing.assert_allclose(large.record.signals[signal], values, rtol=0, atol=SIGNALS * max(largest, FLOOR))
    assert judged(large) == pytest.approx(judged(small), rel=ERRORS, abs=FLOOR)
    assert (large.theory, starred(large)) == (small.theory, starred(small))


def judged(found: Comparison) -> dict[str, float]:
    """Return all numbers of a comparison and of the guards of its run."""
    guards = {name: guard["value"] for name, guard in found.record.info["guards"].items()}
    lines = {f"{line.name}, {signal}": getattr(line, signal) for line in found.budget for signal in ("p", "q", "phi")}
    every = found.error | found.lattice_error | lines | guards | {"predicted": found.predicted, "SH": found.measured}
    return {name: float(value) for name, value in every.items() if value is not None}


def starred(found: Comparison) -> list[tuple[str, ...]]:
    """Return which signals each source of error dominates."""
    return [line.dominates for line in found.budget]
