"""LAMMPS against what was not written with it: the exact lattice, closed forms, and what the deck must not leave out.

The runs are the paper's: a strip with fixed ends that are not heard, a = 0.2, τ ≤ 120, centre sphere.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure.norms import relative_error, slope
from granular_analysis.second_harmonic import mode, ratios, second_order
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.lattice import torus
from granular_analysis.theory.wave import Wave
from granular_lmp import Record, Scene, build, run
from granular_lmp.accuracy.estimates import richardson
from granular_lmp.accuracy.rounding import grain, noise_floor
from tests.conftest import PAPER, members

Errors = dict[str, float]
NU, ETA = PAPER.sphere.poisson_ratio, PAPER.sphere.overlap_ratio


@cache
def at_centre(wave: Wave, samples: int) -> tuple[np.ndarray, ...]:
    """The exact lattice every 0.5 τ."""
    return torus(wave, 0.5 * np.arange(samples))


def lattice(record: Record, overlap_ratio: float) -> tuple[np.ndarray, ...]:
    """The exact lattice for the wave of a run: the paper's equations (0), or with LAMMPS's contact geometry (η)."""
    wave = record.scene.wave
    start = mode(wave.mode, wave.wavenumber, ratios(NU, overlap_ratio=overlap_ratio))
    assert record.scene.time.sample == 0.5
    contact = Contact(NU, overlap_ratio=overlap_ratio)
    return at_centre(Wave(start, wave.amplitude, contact, wave.phase), len(record.tau))


def errors(record: Record, reference: tuple[np.ndarray, ...]) -> Errors:
    names = ("p", "q", "phi")
    return {name: relative_error(getattr(record, name), values) for name, values in zip(names, reference, strict=True)}


@pytest.fixture(scope="session")
def pair(paper_run: Callable[..., Record]) -> Callable[[float], Record]:
    """Richardson pair of steps 0.05 and 0.025 at a wave number."""

    def make(xi: float) -> Record:
        wave = {"wave.wavenumber": xi}
        return richardson(paper_run(wave), paper_run(wave | {"time.timestep": 0.025}))

    return make


# --- against the paper's own equations, integrated without LAMMPS ---


@pytest.mark.parametrize(
    ("xi", "bounds"), [(0.802, (2e-4, 6e-5)), pytest.param(1.475, (2e-3, 3.6e-4), marks=pytest.mark.more)]
)
def test_extrapolated_runs_meet_the_paper_s_equations(
    xi: float, bounds: tuple[float, float], pair: Callable[[float], Record]
) -> None:
    # The geometry of LAMMPS's contacts is left of q, not LAMMPS's error: see the next two tests
    error = errors(pair(xi), lattice(pair(xi), 0.0))
    assert error["p"] < bounds[0]
    assert error["q"] < bounds[1]


def test_what_is_left_of_q_is_the_frequency_shift_of_the_contact_geometry(pair: Callable[[float], Record]) -> None:
    # A shift δΩ turns the phase by δΩ τ: relative L2 error δΩ τ_end/√3. The inertia Ĩ/(1−η) alone gives 5.3e-5.
    plain, shifted = (mode("TR", 0.802, ratios(NU, overlap_ratio=eta)).frequency for eta in (0.0, ETA))
    predicted = abs(shifted - plain) * 120 / np.sqrt(3)
    assert errors(pair(0.802), lattice(pair(0.802), 0.0))["q"] == pytest.approx(predicted, rel=0.1)


@pytest.mark.parametrize(
    ("xi", "bounds"),
    [(0.802, (1e-5, 5e-6)), pytest.param(1.475, (5e-5, 5e-6), marks=pytest.mark.more), (2.127, (5e-3, 5e-6))],
)
def test_extrapolated_runs_meet_the_lattice_with_lammps_s_geometry(
    xi: float, bounds: tuple[float, float], pair: Callable[[float], Record]
) -> None:
    error = errors(pair(xi), lattice(pair(xi), ETA))
    assert error["p"] < bounds[0]
    assert error["q"] < bounds[1]
    assert error["phi"] < bounds[1]


def test_geometry_moves_p_by_a_fifth_at_the_antiresonance(pair: Callable[[float], Record]) -> None:
    assert 0.15 < errors(pair(2.127), lattice(pair(2.127), 0.0))["p"] < 0.3


# --- orders ---


@pytest.mark.parametrize("wave_mode", members(["TR", "L"], "L"))
def test_the_error_falls_as_the_square_of_the_time_step(wave_mode: str, paper_run: Callable[..., Record]) -> None:
    steps = (0.1, 0.05, 0.025)
    changes = {"wave.mode": wave_mode, "time.duration": 40.0}
    runs = [paper_run(changes | {"time.timestep": step}) for step in steps]
    reference = lattice(runs[0], ETA)
    for name, values in zip(("p", "q", "phi"), reference, strict=True):
        if np.any(np.abs(values) > 1e-9):
            measured = slope(steps, [relative_error(getattr(record, name), values) for record in runs])
            assert measured == pytest.approx(2.0, abs=0.1), name


def test_the_closed_form_differs_from_lammps_by_the_square_of_the_amplitude(paper_run: Callable[..., Record]) -> None:
    # τ ≤ 40 and a ≤ 0.1, where the next order is small; a Richardson pair, so that the time step is not what is seen.
    # At ξ = 1.3 the quadratic error is well above the geometric one, which the closed form holds anyway (η > 0).
    amplitudes = (0.1, 0.025)
    constants = ratios(NU, overlap_ratio=ETA)
    found: dict[str, list[float]] = {"p": [], "q": [], "phi": []}
    for amplitude in amplitudes:
        changes = {"wave.amplitude": amplitude, "wave.wavenumber": 1.3, "time.duration": 40.0}
        record = richardson(paper_run(changes), paper_run(changes | {"time.timestep": 0.025}))
        theory = second_order(mode("TR", 1.3, constants), constants, amplitude, record.tau)
        for name, error in errors(record, theory).items():
            found[name].append(error)
    for name, series in found.items():
        assert slope(amplitudes, series) == pytest.approx(2.0, abs=0.1), (name, series)


def test_richardson_refuses_records_that_are_no_pair(paper_run: Callable[..., Record]) -> None:
    coarse = paper_run({"time.duration": 40.0, "time.timestep": 0.1})
    with pytest.raises(ValueError, match="must have the ratio 2"):
        richardson(coarse, coarse)
    with pytest.raises(ValueError, match="different times"):
        richardson(coarse, paper_run())


def test_of_two_runs_whose_error_is_no_series_the_finer_is_the_answer(pair: Callable[[float], Record]) -> None:
    extrapolated = pair(0.802)
    fine = replace(extrapolated, scene=extrapolated.scene.with_values({"time.timestep": 0.025}))
    coarse = replace(extrapolated.with_signals(p=1.1 * fine.p), scene=fine.scene.with_values({"time.timestep": 0.05}))
    answer = richardson(coarse, fine, 0)
    assert all(np.array_equal(answer.signals[name], fine.signals[name]) for name in fine.signals)
    assert answer.info["error_estimate"] == pytest.approx({"p": 0.1, "q": 0.0, "phi": 0.0})


def test_richardson_estimates_the_error_of_the_finer_run(pair: Callable[[float], Record]) -> None:
    fine = pair(0.802).info["error_estimate"]
    assert fine["p"] == pytest.approx(4.1e-4, rel=0.1)  # measured once against the exact lattice


# --- the floor; its size is measured in tests/hard ---


def test_the_noise_floor_rises_as_the_root_of_the_duration_and_as_one_over_the_amplitude(small: Scene) -> None:
    base = noise_floor(small)
    # Both so short that the centre hears the same rows
    assert noise_floor(small.with_values({"time.duration": 0.5})) == pytest.approx(base / 2, rel=1e-12)
    assert noise_floor(small.with_values({"wave.amplitude": 0.02})) == pytest.approx(10 * base, rel=1e-12)


def test_smaller_steps_make_the_grain_coarser_and_the_floor_higher(small: Scene) -> None:
    finer = small.with_values({"time.timestep": small.time.step / 2})
    assert grain(finer) == pytest.approx(2 * grain(small), rel=1e-12)
    assert noise_floor(finer) == pytest.approx(2**0.5 * noise_floor(small), rel=1e-12)


def test_rows_that_the_centre_does_not_hear_add_no_noise(small: Scene) -> None:
    # 2 τ: half a row; the box of the long cell is coarser by 100 at its ends
    assert noise_floor(small.with_values({"packing.rows": 800})) == noise_floor(small)


# --- what a deck must not leave out; each fails loudly when it does ---


def run_altered(folder: Path, *pairs: tuple[str, str]) -> Record:
    """The base case, τ ≤ 40, with pieces of its deck replaced."""
    deck = build(PAPER.with_values({"packing.rows": "auto", "time.duration": 40.0}))
    text = deck.input_text
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return run(replace(deck, input_text=text), folder)


def test_a_start_without_shear_history_is_wrong(tmp_path: Path) -> None:
    # The displaced lattice is read as it is: the spheres move before the contacts exist
    record = run_altered(
        tmp_path / "run",
        ("pair_style   granular\n", "pair_style   zero 1050.0 nocoeff\n"),
        ("pair_coeff   * * dmt 73000.0 0.0 0.17 31.5 &\n", "pair_coeff   * *  # "),
        ("             tangential mindlin NULL 0.0 ${friction} damping velocity", ""),
        (
            "reset_timestep 0",
            "pair_style granular\n"
            "pair_coeff * * dmt 73000.0 0.0 0.17 31.5 tangential mindlin NULL 0.0 ${friction} damping velocity\n"
            "reset_timestep 0",
        ),
    )
    error = errors(record, lattice(record, 0.0))
    assert error["p"] > 0.5
    assert error["q"] > 0.5


def test_rescaling_the_history_is_another_law(tmp_path: Path) -> None:
    record = run_altered(tmp_path / "run", ("tangential mindlin ", "tangential mindlin_rescale "))
    assert errors(record, lattice(record, 0.0))["p"] > 0.3


def test_the_incremental_law_nearly_doubles_p(tmp_path: Path) -> None:
    record = run_altered(tmp_path / "run", ("tangential mindlin ", "tangential mindlin/force "))
    wave = mode("TR", 0.802, ratios(NU))
    p, _, _ = torus(Wave(wave, 0.2, Contact(NU, law="incremental")), record.tau)
    # mindlin/force is of first order in the step, which leaves 3 % at 0.05
    assert relative_error(record.p, p) < 0.05
    assert errors(record, lattice(record, 0.0))["p"] > 0.8


def test_a_far_too_large_friction_freezes_the_history(
    monkeypatch: pytest.MonkeyPatch, paper_run: Callable[..., Record], tmp_path: Path
) -> None:
    plain = paper_run({"time.duration": 40.0})
    frozen = run_altered(tmp_path / "frozen", ("$(5.0*v_amplitude:%.17g)", "1e6"))
    assert relative_error(frozen.p, plain.p) > 5e-4
