"""Two shaken rows: what their waves make at the sum and the difference, in LAMMPS, beside theory and symmetry."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.rows import Rows, amplitudes_at, rows_of
from cases.tones import case as tones
from granular_analysis.theory.bloch import in_plane
from granular_analysis.theory.contact import Contact
from granular_lmp import Record, Scene, run

# By τ = 350 the slowest waves, free L at the sum, have run 48 rows after the ramp, and 24 back; the fit begins at 360
SCENE = Scene.load("two_tones").with_values(
    {"time.duration": 540.0, "time.sample": 2.0, "output.particles": 2.0, "time.timestep": 0.2}
    | {"source.1.ramp": 110.0, "source.2.ramp": 110.0}
)
SHORT = SCENE.with_values({"time.duration": 20.0})


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(SCENE, tmp_path_factory.mktemp("tones") / "run")


@pytest.fixture(scope="module")
def rows(record: Record) -> Rows:
    return rows_of(record)


@pytest.fixture(scope="module")
def found(record: Record, rows: Rows) -> tones.Tones:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tones, "rows_of", lambda record: rows)  # read once; the figure reads them by itself
        return tones.compare(record)


def test_sum_and_difference_of_two_sources_are_those_of_theory(found: tones.Tones) -> None:
    assert [line.name for line in found.lines] == ["sum", "difference"]
    for line in found.lines:
        # Fourth order is a² = 2.5e-3 of second, times numbers of order 0.1 here; the step leaves (Ωh)²/24 = 1e-3
        assert line.error < 3e-3


def test_an_amplitude_that_is_one_percent_off_is_seen(
    record: Record, rows: Rows, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tones, "rows_of", lambda record: rows)
    monkeypatch.setattr(tones, "in_plane", lambda field: 1.01 * in_plane(field))
    assert min(line.error for line in tones.compare(record).lines) > 7e-3


def test_a_run_to_a_tolerance_is_read_with_the_step_of_its_snapshots(
    record: Record, found: tones.Tones, monkeypatch: pytest.MonkeyPatch
) -> None:
    snapshots, tables = record.snapshots(), record.scene.to_dict()
    time = {key: value for key, value in tables["time"].items() if key != "timestep"}
    tolerant = replace(record, scene=Scene.from_dict(tables | {"time": time | {"tolerance": 0.1}}))
    monkeypatch.setattr(Record, "snapshots", lambda self: snapshots)
    assert tones.compare(tolerant).lines[0].theory == found.lines[0].theory


def test_two_sources_make_nothing_that_symmetry_forbids(record: Record, found: tones.Tones, tmp_path: Path) -> None:
    # A mirror turns the signs of both sources, and of q and φ: what is even in the signs, as all second order is,
    # vanishes there, and adds up in p
    turned = {"source.1.phase": np.pi, "source.2.phase": np.pi, "output.particles": 0.0}
    other = run(SCENE.with_values(turned), tmp_path / "run")
    p, q, phi = ((getattr(record, name) + getattr(other, name)) / 2 for name in ("p", "q", "phi"))
    assert np.abs(p).max() > 1e-4
    # Rounding of positions, 1e-16 of 1e4 nm, over D0 = 0.0125 nm: 1e-10, grown over 6000 steps
    assert max(np.abs(q).max(), np.abs(phi).max()) < 1e-8
    frequencies = sorted({line.frequency for line in found.lines})
    late = record.tau > 360
    lines = {
        name: amplitudes_at(record.tau[late], each[late][:, None], frequencies)[1]
        for name, each in (("p", p), ("q", q), ("phi", phi))
    }
    for index in range(len(frequencies)):
        for name in ("q", "phi"):
            # That rounding over p, 4e-5; ten pairs of Bloch waves stay below 1e-6 (tests/validation/test_two_tones.py)
            assert abs(lines[name][index, 0]) < 5e-5 * abs(lines["p"][index, 0])


def test_wave_numbers_are_those_of_their_branches() -> None:
    contact = Contact(0.17)
    assert tones.wavenumber(0.5, contact, longitudinal=True) == pytest.approx(2 * np.arcsin(0.5), rel=1e-9)  # bisection
    with pytest.raises(ValueError, match=r"no wave TR along y has the frequency 1\.2 rad per t0"):
        tones.wavenumber(1.2, contact, longitudinal=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"source.1.rows": [26, 27]}, "sources must be two, each of one row"),
        ({"source.1.force": "y"}, "sources must be two, each of one row"),
        ({"source.2.rows": [48, 48]}, "11 rows lie 6 from both sources or more; must be at least 12"),
        ({"source.2.frequency": 0.31}, r"must lie \d+\.\d+ apart in the last third of the run"),
        ({"output.particles": 4.0}, "snapshots every tau = 4: must be 4 in a period"),
        ({"effects.viscosity": 1e-9}, "the theory leaves out effects.damping"),
    ],
)
def test_what_is_no_pair_of_tones_is_refused(changes: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        tones.compare(run(SHORT.with_values(changes), tmp_path / "run"))


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_is_drawn(record: Record, rows: Rows, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rows.count == 101
    assert tones.main([str(record.folder), "-o", str(tmp_path / "tones.png")]) == 0
    assert "difference" in capsys.readouterr().out
    assert (tmp_path / "tones.png").stat().st_size > 10_000
