"""Scattering in LAMMPS: what is measured beside the linear lattice, and what is refused."""

import csv
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.stepping import NetworkEngine
from granular_analysis.tools import scatter as beside_theory
from granular_lmp import Scene, run
from granular_lmp.cli import main
from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import bloch_mode
from granular_lmp.crystal.row_waves import lattice_at, line_of, row_waves
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import CrystalError, RunFolderError, RunInterrupted, SceneError
from granular_lmp.plot.scattering import scattering_figure
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.studies.running_waves import amplitudes, burst_spectrum, tone_amplitude
from granular_lmp.studies.scatter import Row, Scatter, scatter
from tests.conftest import PAPER

BURST = {"rows": [28, 28], "force": "y", "signal": "burst", "cycles": 6.0}
SCENE = PAPER.with_values(
    {"name": "heavy", "packing.rows": 91, "packing.columns": 3, "wave.form": "none", "wave.mode": "L"}
    | {"wave.wavenumber": 1.0, "wave.amplitude": 1e-3, "absorb.rows": 18, "absorb.reflection": 2e-3}
    # Six snapshots in the shortest period of the source are needed: one in 1.64
    | {"time.duration": 230.0, "time.timestep": 0.34, "time.sample": 1.6}
    | {"source": [BURST], "inclusion": [{"rows": [45, 45], "density": 6600.0}]}
)
SPHERE, LATTICE = SCENE.sphere, unit_lattice(SCENE.sphere)


# --- waves in rows ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "wavenumber"), [("L", 0.8), ("TR", 1.5), ("RT", 1.0)])
def test_waves_that_run_are_those_of_bloch(name: str, wavenumber: float) -> None:
    mode = bloch_mode(LATTICE, SPHERE, WaveVector.of(wavenumber), name)
    waves = row_waves(line_of(LATTICE, SPHERE), mode.frequency)
    up, down = waves.factor[waves.running(onward=True)[name]], waves.factor[waves.running(onward=False)[name]]
    assert up == pytest.approx(np.exp((-1j if name == "RT" else 1j) * wavenumber), abs=1e-9)  # rounding
    assert down == pytest.approx(np.conj(up), abs=1e-9)


def test_no_wave_is_told_apart_at_the_edge_of_a_band() -> None:
    edge = bloch_mode(LATTICE, SPHERE, WaveVector.of(np.pi), "L").frequency
    with pytest.raises(CrystalError, match="is at the edge of a band"):
        row_waves(line_of(LATTICE, SPHERE), edge)


def test_the_lattice_of_a_sphere_far_from_inclusions_is_that_without_them() -> None:
    contacts = crystal_of(SCENE).contacts
    found = lattice_at(contacts, 3 * 20)
    assert len(found) == 3
    for name in ("normal_stiffness", "shear_stiffness", "mass", "radius"):
        # Overlaps of 2.5e-4 radii from positions of up to 1e2 radii
        assert getattr(found, name) == pytest.approx(getattr(LATTICE, name)[0], rel=1e-7)
    assert lattice_at(contacts, 3 * 45).mass == pytest.approx(LATTICE.mass * 3, rel=1e-12)


def test_amplitudes_of_waves_in_rows_are_found_again() -> None:
    waves = row_waves(line_of(LATTICE, SPHERE), 0.5)
    random = np.random.default_rng(2)
    coefficient = random.normal(size=6) + 1j * random.normal(size=6)
    number = np.arange(12)[:, None] - np.array([0, 0, 0, 11, 11, 11])
    field = (waves.shape[None] * (coefficient * waves.factor**number)[:, None, :]).sum(axis=2)
    found = amplitudes(waves, field)
    for way, got in ((True, found.up), (False, found.down)):
        for name, k in waves.running(onward=way).items():
            assert got[name] == pytest.approx(coefficient[k], abs=1e-9)  # rounding
    assert found.residual < 1e-9
    assert amplitudes(waves, field + 0.1 * random.normal(size=field.shape)).residual > 1e-3


TAU = np.arange(0.0, 301.0)


def test_a_tone_is_read_off_and_one_that_still_grows_is_refused() -> None:
    motion = np.real((0.3 + 0.4j) * np.exp(-0.5j * TAU))[:, None, None] * np.ones((1, 2, 3)) + 0.1
    assert tone_amplitude(TAU, motion, 0.5) == pytest.approx(np.full((2, 3), 0.3 + 0.4j), abs=1e-9)  # rounding
    with pytest.raises(SceneError, match=r"time\.duration = 300: the tone is not steady"):
        tone_amplitude(TAU, motion * TAU[:, None, None], 0.5)
    with pytest.raises(SceneError, match=r"time\.duration = 50: must be at least 188\.5, 15 periods"):
        tone_amplitude(TAU[:51], motion[:51], 0.5)


def test_a_burst_that_has_not_passed_is_refused() -> None:
    burst = np.cos(0.5 * TAU) * np.exp(-(((TAU - 100) / 20) ** 2))
    spectrum = burst_spectrum(TAU, burst[:, None, None] * np.ones((1, 2, 3)), np.array([0.5]))
    exact = np.sqrt(np.pi) * 20 / 2 * (1 + np.exp(-((0.5 * 20) ** 2)) * np.exp(1j * 100))
    assert spectrum == pytest.approx(np.full((1, 2, 3), exact), abs=1e-9)  # trapezoids of a Gaussian are exact
    with pytest.raises(SceneError, match=r"time\.duration = 130: the burst has not passed"):
        burst_spectrum(TAU[:131], burst[:131, None, None] * np.ones((1, 2, 3)), np.array([0.5]))


# --- in LAMMPS -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Scatter:
    return scatter(SCENE, tmp_path_factory.mktemp("scatter") / "heavy", tones=1)


@pytest.fixture
def few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """Curves of theory have few points between those that are measured, which take most of a comparison."""
    monkeypatch.setattr(beside_theory, "DENSE", 5)


def test_shares_are_those_of_the_linear_lattice(found: Scatter, few_points: None) -> None:
    comparison = beside_theory.compare(found.folder)
    lines = [line for line in comparison.lines if line.mode == "L"]
    assert {line.signal for line in lines} == {"burst", "tone"}
    # The time step, (ΩΔτ)²/24 of a frequency, and quiet ends that send back 1e-3 of an amplitude: 2e-3 of a share
    assert comparison.deviation < 5e-3
    assert 0.1 < lines[0].theory[0] < 0.9
    for line in lines:
        assert abs(line.transmission[0] - line.theory[0]) < 3 * line.transmission[1] + 1e-3
    assert comparison.between_signals is not None
    assert comparison.between_signals < 5e-3  # as above
    assert "tone" in beside_theory.table([comparison])
    assert beside_theory.draw([comparison]).axes


@pytest.mark.more
def test_the_network_scatters_as_lammps(found: Scatter, tmp_path: Path) -> None:
    ours = scatter(SCENE, tmp_path / "network", engine=NetworkEngine.on("cpu"))
    theirs = [row for row in found.rows if row.signal == "burst"]
    for one, other in zip(ours.rows, theirs, strict=True):
        # The 1e-9 D0 by which records agree, over an amplitude of 1e-3
        assert (one.transmission, one.reflection) == pytest.approx((other.transmission, other.reflection), abs=1e-6)


def test_energy_is_neither_lost_nor_gained(found: Scatter) -> None:
    assert max(abs(total - 1) for total in found.balance().values()) < 2e-3  # quiet ends, as above


def test_another_density_in_theory_is_seen(found: Scatter, few_points: None, monkeypatch: pytest.MonkeyPatch) -> None:
    right = beside_theory.rows_at_rest

    def wrong(record: Any) -> Any:
        rows, unit = right(record)
        heavier = tuple(1.05 * mass if mass[0] > 1.5 * rows.mass[0][0] else mass for mass in rows.mass)
        return type(rows)(rows.places, heavier, rows.on_site, rows.ahead), unit

    monkeypatch.setattr(beside_theory, "rows_at_rest", wrong)
    assert beside_theory.compare(found.folder).deviation > 1e-2


def test_the_table_is_written_and_drawn(found: Scatter) -> None:
    with (found.folder / "scatter.csv").open(encoding="utf-8", newline="") as stream:
        lines = list(csv.DictReader(stream))
    assert [float(line["transmission"]) for line in lines] == [row.transmission for row in found.rows]
    assert found.modes == ["L"]
    assert "the sums of all shares differ from 1 by" in found.text()
    assert scattering_figure(found).axes


def test_the_command_does_the_same(
    drawn_once: None, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    rows = [Row("burst", 0.5, "TR", "TR", 0.25, 1e-3, 0.75, 2e-3)]
    asked = {}

    def stand_in(scene: Scene, folder: str, **options: Any) -> Scatter:
        asked.update(options)
        Path(folder).mkdir()
        return Scatter(Path(folder), scene, rows)

    monkeypatch.setattr("granular_lmp.studies.scatter.scatter", stand_in)
    path = tmp_path / "heavy.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    assert main(["scatter", str(path), "-o", str(tmp_path / "out"), "--tones", "3"]) == 0
    assert asked["tones"] == 3
    assert "0.25000" in capsys.readouterr().out
    assert (tmp_path / "out" / "scatter.png").is_file()


# --- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inclusion": []}, r"inclusion = \[\]: must be at least one table \[\[inclusion\]\], as nothing scatters"),
        (
            {"wave.form": "running", "absorb.rows": 0, "time.allow_echo": True},
            r'wave\.form = "running": must be "none" for scattering',
        ),
        ({"source": [BURST, BURST | {"rows": [30, 30]}]}, "source = 2: must be one table"),
        ({"disorder.density": 0.1}, r"disorder\.density = 0\.1: must be 0 for scattering"),
        ({"absorb.rows": 0, "time.allow_echo": True}, r"absorb\.rows = 0: must be \"auto\" or a number"),
        (
            {"source": [{"spheres": [[26, 0]], "force": "y", "signal": "burst"}]},
            r"source 1: spheres = \[\[26, 0\]\]: must be rows",
        ),
        ({"source": [BURST | {"rows": [50, 50]}]}, r"must be below the inclusions, whose first row is 45"),
        ({"inclusion": [{"rows": [34, 34], "density": 5e3}]}, r"leave 1 rows in front of the inclusions"),
        ({"inclusion": [{"rows": [45, 64], "density": 5e3}]}, r"packing\.rows = 91: leave \d rows behind them"),
        ({"output.particles": 3.2}, r"output\.particles = 3\.2: must be at most"),
        (
            {"wave.mode": "RT", "source.1.frequency": 0.6, "time.sample": 1.0},
            r'wave\.mode = "RT": no RT wave along y exists at the frequency',
        ),
        ({"time.duration": 100.0}, r"time\.duration = 100\.0: must be at least 1\d\d\.\d, so that the fastest wave"),
        ({"packing.lattice": "square"}, r'packing\.lattice = "square": must be "hexagonal"'),
    ],
)
def test_what_is_no_such_experiment_is_refused_by_name(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=message):
        scatter(SCENE.with_values(changes), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_another_study_in_the_folder_leaves_nothing_of_the_first(found: Scatter, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(found.folder, tmp_path / "again", ignore=shutil.ignore_patterns("dump.*")))
    assert (folder / "tone_1_inclusions").is_dir()
    with pytest.raises(RunFolderError, match=r"holds a study of scattering \(scatter\.csv\); choose another folder"):
        run(PAPER, folder, force=True)

    def stop(step: int, steps: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(RunInterrupted):
        scatter(SCENE.with_values({"time.timestep": 0.4}), folder, force=True, progress=stop)
    # Neither a table of the first study beside runs of the second, nor its tones
    assert sorted(each.name for each in folder.iterdir()) == ["inclusions", "normalisation"]


def test_tones_beside_a_tone_are_refused(tmp_path: Path) -> None:
    tone = SCENE.with_values({"source": [{"rows": [28, 28], "force": "y"}]})
    with pytest.raises(SceneError, match="tones = 2: must be 0 for a source that is a tone itself"):
        scatter(tone, tmp_path / "run", tones=2)


def test_theory_refuses_what_it_does_not_hold(found: Scatter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="not a folder of granular-lmp scatter"):
        beside_theory.compare(tmp_path)
    monkeypatch.setattr(beside_theory, "traits_of", lambda record: {"effects.damping"})
    with pytest.raises(ValueError, match=r"effects\.damping: the linear lattice of rows leaves this out"):
        beside_theory.compare(found.folder)
