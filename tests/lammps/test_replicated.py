"""Large perfect sheets, which LAMMPS makes from their first rows, are those of a data file with every sphere."""

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from granular_lmp import Record, Scene, build, run
from granular_lmp.accuracy.tolerance import resume
from granular_lmp.lammps import replicated, start
from granular_lmp.lammps.datafile import read
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.installation import lmp_command
from granular_lmp.problem import prepare
from granular_lmp.runs.folder import locked
from granular_lmp.studies.kick import kicked
from tests.conftest import run_input

GLASS = {"youngs_modulus": 73e9, "poisson_ratio": 0.17, "work_of_adhesion": 0.063}
SHEET = Scene.load("tr_nonresonant").with_values(
    {"packing.rows": 21, "packing.columns": 5, "time.duration": 2.0, "name": "sheet"}
)
WAVES = {
    "between held rows": {},
    "periodic": {"packing.ends": "periodic", "packing.rows": 22},
    "oblique": {"packing.ends": "periodic", "packing.rows": 24, "packing.columns": 12, "wave.direction": 30.0},
    "standing": {"wave.form": "standing", "wave.phase": 0.3},
    "turning spheres": {"wave.mode": "RT"},
    "spheres that do not turn": {"wave.mode": "L"},
    "square": {"packing.lattice": "square"},
    "at rest": {"wave.form": "none", "source": [{"spheres": [[10, 2]], "force": "x", "signal": "burst"}]},
}
_ON_GLASS = {f"substrate.{key}": value for key, value in GLASS.items()}
SPACE = {
    "layer": {**_ON_GLASS, "wave.mode": "S2"},
    "oblique layer": {
        **_ON_GLASS, "wave.mode": "2", "packing.ends": "periodic", "packing.rows": 24, "packing.columns": 12,
        "wave.direction": 30.0,
    },
    "fcc": {"packing.lattice": "fcc"},
    "fcc along [111]": {"packing.lattice": "fcc", "packing.orientation": "[111]", "wave.form": "standing"},
    "cubic": {"packing.lattice": "cubic", "wave.mode": "L"},
}  # fmt: skip
# A cosine on the edge of two thirteenth decimals may be rounded to either: one unit, and the rounding of the difference
SAME_FIELD = 1.01e-13


def deck_of_all(scene: Scene) -> Deck:
    """Return the deck whose data file has every sphere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(replicated, "LARGE", 10**9)
        return build(scene)


def started(scene: Scene, folder: Path, *, all_spheres: bool, ranks: int = 1) -> tuple[NDArray[np.float64], list[str]]:
    """Return the spheres as LAMMPS has them before the preload, sorted by number, and the box."""
    deck = deck_of_all(scene) if all_spheres else build(scene)
    deck.write(folder)
    fields = start.field(deck.problem).split()[4:]
    dump = (
        f"write_dump all custom start id type x y z diameter mass {' '.join(fields)} modify sort id format float %.17g"
    )
    text = deck.input_text[: deck.input_text.index("# --- contacts")]
    (folder / "in.start").write_text(f"{text}\npair_style zero 1100\npair_coeff * *\n{dump}\n")
    if ranks == 1:
        with locked(folder) as lock:
            run_input(folder, "in.start", lock)
    else:
        subprocess.run([*lmp_command(ranks), "-in", "in.start", "-screen", "none"], cwd=folder, check=True)
    lines = (folder / "start").read_text().splitlines()
    return np.array([line.split() for line in lines[9:]], dtype=float), lines[4:8]


@pytest.fixture
def small_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replicated, "LARGE", 1)


@pytest.mark.usefixtures("small_is_large")
@pytest.mark.parametrize("values", [*WAVES.values(), *SPACE.values()], ids=[*WAVES, *SPACE])
def test_lammps_makes_the_spheres_and_the_wave_of_the_data_file(values: dict[str, object], tmp_path: Path) -> None:
    scene = SHEET.with_values(values)
    expected, box = started(scene, tmp_path / "all", all_spheres=True)
    made, made_box = started(scene, tmp_path / "made", all_spheres=False)
    assert made_box == box
    assert np.array_equal(made[:, :7], expected[:, :7])  # numbers, types, places, sizes and masses to the last bit
    assert np.abs(made[:, 7:] - expected[:, 7:]).max() <= SAME_FIELD
    assert np.abs(expected[:, 7:]).max() > 0.1 or scene.wave.form == "none"
    rows = scene.lattice.row_period
    assert len(read(tmp_path / "made" / "data.sheet").kind) == rows * scene.shape.columns * scene.shape.layers


@pytest.mark.usefixtures("small_is_large")
def test_two_ranks_number_the_spheres_as_one_does(tmp_path: Path) -> None:
    one, _ = started(SHEET, tmp_path / "one", all_spheres=False)
    two, _ = started(SHEET, tmp_path / "two", all_spheres=False, ranks=2)
    assert np.array_equal(two, one)


@pytest.mark.usefixtures("small_is_large")
def test_another_wave_is_seen(tmp_path: Path) -> None:
    expected, _ = started(SHEET, tmp_path / "all", all_spheres=True)
    other = SHEET.with_values({"wave.wavenumber": SHEET.wave.wavenumber * (1 + 1e-12)})
    made, _ = started(other, tmp_path / "made", all_spheres=False)
    assert np.abs(made[:, 7:] - expected[:, 7:]).max() > SAME_FIELD


@pytest.mark.usefixtures("small_is_large")
def test_a_run_of_it_is_that_of_the_data_file(tmp_path: Path) -> None:
    made = run(SHEET, tmp_path / "made")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(replicated, "LARGE", 10**9)
        expected = run(SHEET, tmp_path / "all")
    assert "edited" not in made.info
    for name, values in expected.signals.items():
        # Fields that differ by 1e-13 D0 move the sphere by as much, over 2 tau by no more than ten times that
        assert np.abs(made.signals[name] - values).max() < 1e-12
    assert Record.load(tmp_path / "made").info["particles"] == 105


@pytest.mark.usefixtures("small_is_large")
def test_it_is_resumed_to_the_same_record(tmp_path: Path, stop: Callable[..., None]) -> None:
    whole = run(SHEET, tmp_path / "whole")
    stop(SHEET, tmp_path / "stopped")
    record = resume(tmp_path / "stopped")
    for name, values in whole.signals.items():
        # Contacts are summed in another order, which moves wide sheets between held rows by up to 1e-14 D0
        np.testing.assert_array_equal(record.signals[name], values)


def test_small_and_imperfect_crystals_packets_and_driven_rows_keep_every_sphere_in_the_data_file() -> None:
    rows = 2 * replicated.LARGE // 5 + 1
    large, problem = SHEET.with_values({"packing.rows": rows, "time.duration": 1.0}), prepare(SHEET)

    def suits(scene: Scene) -> bool:
        return replicated.suits(replace(problem, rest=replace(problem.rest, scene=scene)))

    assert suits(large)
    assert not suits(SHEET)
    assert not suits(large.with_values({"envelope.length": 20.0}))
    assert not suits(large.with_values({"wave.form": "driven"}))
    assert not suits(large.with_values({"disorder.density": 0.1}))


@pytest.mark.usefixtures("small_is_large")
def test_a_kicked_sheet_has_velocities_of_all_its_spheres() -> None:
    assert len(build(SHEET).data.kind) == 10
    kick = build(kicked(SHEET.with_values({"packing.rows": 22, "packing.ends": "periodic"}), seed=3))
    assert kick.data.wave.shape == (110, 11)  # of the wave that is none, and of the noise
    assert "read_data    ${data} fix wave NULL wave" in kick.input_text
