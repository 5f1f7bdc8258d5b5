"""The measures of the figures of disorder and of defects, on fields whose answers are known and on tiny crystals."""

import json
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from functools import partial
from io import StringIO
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest

from cases.defects import case as defects
from cases.disorder import case as disorder
from cases.disorder.measures import (
    CUT_VARIANCE,
    Waves,
    attenuation,
    half,
    perfect_strength,
    resonance,
    second_harmonics,
)
from granular_analysis.cli import main as analysis_main
from granular_analysis.measure.disordered import Value, jackknife, strength, whole_strength
from granular_analysis.measure.runs import load
from granular_analysis.plotting import save
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import resonance as resonance_of_equal
from granular_lmp import Record, Scene, run
from granular_lmp.cli import main as granular_lmp_main
from granular_lmp.studies.sweep import sweep

SILICA = Contact(0.17, overlap_ratio=2.5e-4)
TAU = np.linspace(0, 100, 6)
RANDOM = np.random.default_rng(1)


def noise(*shape: int) -> np.ndarray:
    """Return complex noise of variance 1."""
    return (RANDOM.normal(size=shape) + 1j * RANDOM.normal(size=shape)) / np.sqrt(2)


# --- estimates ---


def test_the_coherent_strength_has_no_bias_by_the_noise():
    waves = 0.3 * np.exp(0.2j * TAU) + noise(400, len(TAU))
    # The power of the mean scatters by 2·0.3/√(400·6), a tenth of 0.3² in all
    assert strength(waves) == pytest.approx(0.3, abs=0.03)
    assert whole_strength(waves) == pytest.approx(np.sqrt(1 + 0.09), rel=0.05)  # 1/√2400 of noise
    assert strength(noise(400, len(TAU))) < 0.1  # √(1/400), the strength of nothing


def test_the_jackknife_error_of_a_mean_is_its_standard_error():
    values = noise(50)
    value, error = jackknife(lambda x: x.real.mean(), values)
    assert value == pytest.approx(values.real.mean())
    assert error == pytest.approx(values.real.std(ddof=1) / np.sqrt(50))  # an identity
    assert np.isnan(jackknife(lambda x: x.real.mean(), values[:1])[1])
    with pytest.raises(ValueError, match="no sample"):
        jackknife(lambda x: x.real.mean(), values[:0])


def test_half_the_height_is_found_between_the_points():
    found = half([0.2, 0.4, 0.6], [Value(0.9, 0.01), Value(0.7, 0.02), Value(0.1, 0.02)], 1.0)
    # 0.7 − 3 (s − 0.4) = 0.5, and the errors of both ends in equal parts
    assert found.value == pytest.approx(0.4 + 0.2 / 3)
    assert found.error == pytest.approx(np.hypot(2 / 3, 1 / 3) * 0.02 / 3)
    assert half([0.2, 0.4], [Value(0.9, 0.01), Value(0.1, 0.01)], 1.6).value != pytest.approx(found.value, abs=0.01)
    with pytest.raises(ValueError, match="fall below half"):
        half([0.2], [Value(0.9, 0.01)], 1.0)


def shape_of(shift: float, height: float, width: float) -> dict[float, Waves]:
    """Return waves of three seeds whose strengths are the closed form's, shifted, scaled and stretched."""
    place = resonance_of_equal(SILICA)
    assert place is not None
    found = {}
    for xi in (1.34, 1.43, 1.48, 1.62):
        size = height * perfect_strength(place + (xi - place - shift) / width, SILICA, 0.05, TAU)
        found[xi] = Waves(TAU, np.full((3, len(TAU)), size + 0j), 0.5, SILICA)
    return found


def test_a_resonance_that_is_shifted_lower_and_wider_is_found():
    found = resonance(shape_of(-0.02, 0.6, 1.3), 0.05)
    # The least squares stop at relative changes of 1e-8; nothing else is in the way
    assert [each.value for each in found] == pytest.approx([-0.02, 0.6, 1.3], rel=1e-5)
    assert found.shift.value != pytest.approx(0, abs=0.01)
    with pytest.raises(ValueError, match="3 wave numbers: must be at least four"):
        resonance(dict(list(shape_of(0, 1, 1).items())[:3]), 0.05)


def test_the_decay_put_in_is_found():
    waves = Waves(TAU, np.array([[1.0], [1.1], [0.9]]) * np.exp((-0.004 - 0.302j) * TAU), 0.3, SILICA)
    rate, shift = attenuation(waves, after=10.0)
    assert (rate.value, shift.value) == pytest.approx((0.004, 0.002), rel=1e-9)  # rounding
    assert rate.error < 1e-12
    assert rate.value != pytest.approx(0.0044, rel=0.05)


def test_deviates_that_are_cut_have_that_variance():
    drawn = RANDOM.normal(size=400_000)
    kept = drawn[abs(drawn) < 3]
    assert np.var(kept) == pytest.approx(CUT_VARIANCE, rel=0.01)  # √(2/4e5) = 0.2 % of noise
    assert abs(CUT_VARIANCE - 1) > 0.02  # and is told from 1


# --- a tiny sweep, end to end ---

TINY = Scene.load("tr_periodic").with_values(
    {
        "packing.rows": 16,
        "packing.columns": 4,
        "wave.amplitude": 0.05,
        "time.duration": 40.0,
        "time.timestep": 0.2,
        "time.sample": 1.0,
        "effects.contact_opening": True,
        "output.particles": 10.0,
    }
)
RESONANT, OTHER = 2 * np.pi * 3 / 16, 2 * np.pi * 5 / 16
SIGNS = {"wave.phase": [0.0, np.pi]}


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Sweeps of every kind that the figure knows."""
    folder = tmp_path_factory.mktemp("disorder")
    waves = {"wave.wavenumber": [RESONANT, OTHER]}
    seeds = {"disorder.seed": [1, 2]}
    sweep(TINY, waves | SIGNS, folder / "perfect")
    sweep(TINY, {"disorder.radius": [5e-5], "wave.wavenumber": [RESONANT]} | seeds | SIGNS, folder / "harmonic")
    still = TINY.with_values({"output.particles": 0.0, "time.duration": 1.0, "wave.amplitude": 0.001})
    sweep(still, seeds | {"disorder.radius": [5e-5, 2e-4]}, folder / "contacts")
    light = TINY.with_values({"wave.amplitude": 0.001, "disorder.density": 0.1})
    sweep(light, seeds | {"wave.mode": ["TR", "L"]}, folder / "density")
    pressed = {"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7, "wave.mode": "L", "disorder.radius": 5e-5}
    sweep(light.with_values({"disorder.density": 0.0} | pressed), seeds, folder / "sound")
    return [str(path) for path in sorted(folder.iterdir())]


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_of_all_kinds_of_sweeps_is_drawn(sweeps, tmp_path, capsys, monkeypatch):
    # Part of the grid of the zone for a line that is only drawn
    monkeypatch.setattr(disorder, "scattered", partial(disorder.scattered, grid=192, width=0.016))
    assert disorder.main([*sweeps, "-o", str(tmp_path / "all.png")]) == 0
    said = capsys.readouterr().out
    assert (tmp_path / "all.png").stat().st_size > 10_000
    for heading in ("contacts per sphere", "attenuation", "sound speed", "second harmonic"):
        assert heading in said
    assert "half height under adhesion, tau <= 40: beyond the spreads that were run" in said


def test_the_table_of_a_sweep_has_the_contacts_of_its_crystals(sweeps):
    rows = (Path(sweeps[0]) / "sweep.csv").read_text("utf-8").splitlines()
    column = rows[0].split(",").index("contacts_per_sphere")
    assert all(4 < float(row.split(",")[column]) <= 6 for row in rows[1:])


def runs_of(folder: str) -> list[Record]:
    return [load(path) for path in sorted((Path(folder) / "runs").iterdir())]


def test_the_second_harmonic_of_the_perfect_crystal_is_that_of_the_closed_form(sweeps):
    found = {key.wavenumber: waves for key, waves in second_harmonics(runs_of(sweeps[3])).items()}
    waves = found[round(RESONANT, 6)]
    theory = perfect_strength(RESONANT, waves.contact, 0.05, waves.tau)
    # The step takes 1 % of Ω² dt²/24 · Ωτ, the fourth order a² = 0.25 % and more near the resonance
    assert strength(waves.amplitudes) == pytest.approx(theory, rel=0.03)
    assert strength(waves.amplitudes) != pytest.approx(1.1 * theory, rel=0.03)


def test_a_run_without_its_other_sign_is_refused(sweeps):
    with pytest.raises(ValueError, match=r"needs two runs, with wave\.phase = 0 and pi"):
        second_harmonics(runs_of(sweeps[3])[:1])


def test_what_the_figures_do_not_know_is_refused_by_name(tmp_path):
    record = run(
        TINY.with_values({"time.duration": 1.0, "output.particles": 1.0, "disorder.vacancies": 0.1}), tmp_path / "run"
    )
    with pytest.raises(ValueError, match=r"the measures of disorder leave out disorder\.vacancies"):
        disorder.read([record])


def in_process(command: list[str], **_: Any) -> CompletedProcess[str]:
    """Do what ``python -m granular_lmp`` does, without its start."""
    error = StringIO()
    with redirect_stdout(StringIO()), redirect_stderr(error):
        status = granular_lmp_main(command[command.index("granular_lmp") + 1 :])
    return CompletedProcess(command, status, "", error.getvalue())


def test_one_command_runs_seeds_and_equal_spheres_and_says_what_is_left(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("granular_analysis.measure.runs.subprocess.run", in_process)
    wave = {"wave.wavenumber": RESONANT, "disorder.radius": 0.02 * TINY.sphere.overlap_ratio, "output.particles": 0.0}
    scene, said = tmp_path / "scene.toml", tmp_path / "said.json"
    scene.write_text(TINY.with_values(wave | {"effects.contact_opening": "auto"}).to_toml())
    words = ["harmonic", str(scene), "--seeds", "2", "-o", str(tmp_path / "runs"), "--json", str(said)]
    assert analysis_main(words) == 0
    found = json.loads(said.read_text())
    assert found["s"] == pytest.approx(0.02)
    theory = perfect_strength(RESONANT, SILICA, 0.05, np.arange(0, 40.1, 2.0))
    assert found["equal_spheres"] == pytest.approx(theory, rel=0.03)  # as above
    # s = 0.1 takes 4 %, and its square counts; two seeds scatter by less than that
    assert found["left"]["share"] == pytest.approx(1, abs=0.01)
    assert 0 < found["left"]["error"] < 0.01
    assert "mean of 2 crystals" in capsys.readouterr().out
    for changes, why in (
        ({"disorder.vacancies": 0.1}, "the mean over seeds leaves out disorder.vacancies"),
        ({"disorder.radius": 0.0}, "disorder.radius or disorder.density above 0"),
    ):
        scene.write_text(TINY.with_values(wave | changes).to_toml())
        with pytest.raises(SystemExit, match=why):
            analysis_main(words)


# --- one defect ---


@pytest.fixture(scope="module")
def defect_runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Record]:
    """Runs of 96 spheres: all equal, one missing, one five times as heavy."""
    folder = tmp_path_factory.mktemp("defects")
    scene = TINY.with_values(
        {
            "packing.rows": 12,
            "packing.columns": 8,
            "wave.amplitude": 0.01,
            "time.duration": 45.0,
            "output.particles": 5.0,
        }
        | {"wave.wavenumber": 2 * np.pi * 2 / 12, "effects.contact_opening": "auto"}
    )
    kinds: dict[str, Any] = {
        "perfect": {},
        "vacancy": {"inclusion": [{"spheres": [[5, 5]], "vacancy": True}]},
        "heavy": {"inclusion": [{"spheres": [[5, 5]], "density": 11000.0}]},
    }
    return {name: run(scene.with_values(changes), folder / name) for name, changes in kinds.items()}


@pytest.fixture(scope="module")
def coarse_zone() -> Iterator[None]:
    """Part of the grid of the zone for a line that is only drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(defects, "impurity_width", partial(defects.impurity_width, grid=192, width=0.016))
        yield


@pytest.fixture(scope="module")
def scatterings(defect_runs: dict[str, Record], coarse_zone: None) -> dict[str, defects.Scattering]:
    return {name: defects.compare(defect_runs["perfect"], defect_runs[name]) for name in ("vacancy", "heavy")}


@pytest.mark.parametrize("name", ["vacancy", "heavy"])
def test_the_scattered_field_is_that_of_the_network(scatterings, name):
    found = scatterings[name]
    # LAMMPS's step, 0.2: (Ω dt)²/24 of each phase, times Ωτ = 15, is 0.2 % for the wave, more for short waves
    assert found.difference < 0.02
    assert found.width == pytest.approx(found.width_of_network, rel=0.02)
    assert (found.theory is None) == (name == "vacancy")


def test_another_mass_than_the_run_has_is_seen(defect_runs, coarse_zone, monkeypatch):
    read = defects.first_snapshot

    def lighter(record):
        first = read(record)
        density = first.network.density
        network = replace(first.network, density=np.minimum(density, 3 * density.min()))
        return replace(first, network=network)

    monkeypatch.setattr(defects, "first_snapshot", lighter)
    assert defects.compare(defect_runs["perfect"], defect_runs["heavy"]).difference > 0.1


@pytest.mark.usefixtures("drawn_once")
def test_the_figure_of_defects_is_drawn(scatterings, tmp_path):
    found = list(scatterings.values())
    save(defects.draw(found), tmp_path / "defects.png")
    assert (tmp_path / "defects.png").stat().st_size > 10_000
    assert "sphere 5 times as heavy" in defects.table(found)


def test_runs_that_differ_in_more_than_a_defect_are_refused(defect_runs, tmp_path):
    perfect, heavy = defect_runs["perfect"], defect_runs["heavy"]
    other = run(perfect.scene.with_values({"time.duration": 5.0}), tmp_path / "other")
    with pytest.raises(ValueError, match=r"differ in time\.duration; they must differ in a defect only"):
        defects.compare(other, heavy)
    with pytest.raises(ValueError, match=r"needs one \[\[inclusion\]\] with one sphere"):
        defects.compare(heavy, perfect)


def test_a_straight_growth_has_its_slope_beside_any_oscillation():
    tau = np.arange(0, 81, 4.0)
    energy = 2.5 * (tau - 5) + 3 * np.cos(0.6 * tau + 1)
    assert defects.width_of(tau, energy, 0.3) == pytest.approx(2.5, rel=1e-9)  # rounding
    with pytest.raises(ValueError, match="5 snapshots from tau = 20 on"):
        defects.width_of(tau[:10], energy[:10], 0.3)
