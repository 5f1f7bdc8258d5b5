"""The time step changes the second harmonic: its amplitude as it is measured, and p in the error budget."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure.norms import relative_error
from granular_analysis.measure.signals import measured_amplitude, predicted_amplitude
from granular_analysis.theory.choice import trajectory, wave_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.timestep import stepped_second_harmonic
from granular_analysis.theory.wave import Wave
from granular_analysis.theory.wave import second_harmonic as by_theory
from granular_lmp import Record, Scene, run
from granular_lmp.accuracy.budget import error_budget
from granular_lmp.accuracy.oscillator import Oscillator
from granular_lmp.accuracy.second_harmonic import second_harmonic
from granular_lmp.problem import prepare
from tests.conftest import PAPER
from tests.stepped import limit, stepped

TAU = np.arange(0.0, 40.5, 0.5)
STEP = 0.1
# Mode, ξ; at a = 0.01 what theory leaves out, of relative order a², is below all that a step of 0.1 makes
WAVES = [("TR", 0.802), ("TR", 1.4), ("TR", 2.5), ("RT", 1.5), ("L", 0.802)]
LAWS = ("secant", "incremental")
each_wave = pytest.mark.parametrize(("mode", "xi"), WAVES)
each_law = pytest.mark.parametrize("law", LAWS)


def wave_of_name(mode: str, xi: float, law: str) -> Wave:
    contact = Contact(0.17, law=law, overlap_ratio=PAPER.sphere.overlap_ratio)
    return Wave.of_mode(mode, xi, 0.01, contact)


def scene_of(mode: str, xi: float, law: str) -> Scene:
    wave = {"wave.mode": mode, "wave.wavenumber": xi, "wave.amplitude": 0.01, "effects.shear_law": law}
    return PAPER.with_values({**wave, "time.duration": 40.0, "time.sample": 0.5, "time.timestep": STEP})


@cache
def motions(law: str) -> dict[tuple[str, float], tuple[np.ndarray, np.ndarray]]:
    """Return p, q, φ of each wave, stepped and without a step, (T, 3) each."""
    waves = [wave_of_name(*each, law) for each in WAVES]
    both = stepped(waves, round(0.5 / STEP), records=len(TAU) - 1), limit(waves, TAU)
    return dict(zip(WAVES, zip(*both, strict=True), strict=True))


def records(mode: str, xi: float, law: str) -> tuple[Record, Record]:
    """Return a run with the step as LAMMPS makes it, and as if its scene had no error of the step."""
    made = [Record.of_centre(TAU, *motion.T, scene_of(mode, xi, law)) for motion in motions(law)[mode, xi]]
    return made[0], made[1]


# --- one oscillator --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wave", "free", "phase", "step"),
    [(0.28, 0.72, 0.3, 0.1), (1.788, 0.72, 0.0, 0.1), (0.4974, 0.9948, 0.7, 0.05), (0.5, 0.2, 0.4, 0.25)],
    ids=["TR", "RT", "resonant", "coarse"],
)
def test_the_oscillator_is_what_velocity_verlet_makes_of_it(
    wave: float, free: float, phase: float, step: float
) -> None:
    tau = step * np.arange(600)
    state, rate = np.zeros((2, 600), dtype=complex), np.array([1j * wave, 0]) * np.exp(-1j * phase)
    state[0, 0] = np.exp(-1j * phase)

    def forces(now: np.ndarray) -> np.ndarray:
        return np.array([-(wave**2) * now[0], (now[0] ** 2).imag - free**2 * now[1]])

    for n in range(599):
        rate += step / 2 * forces(state[:, n])
        state[:, n + 1] = state[:, n] + step * rate
        rate += step / 2 * forces(state[:, n + 1])
    found = Oscillator(wave, free, phase, step)
    # Rounding of 600 steps
    np.testing.assert_allclose(found.response(tau), state[1].real, atol=1e-11 * np.abs(state[1]).max())
    exact = Oscillator(wave, free, phase).response(tau)
    assert relative_error(found.response(tau), exact) > 1e-3
    fine = Oscillator(wave, free, phase, step / 1000).response(tau)
    assert relative_error(fine, exact) < 1e-6


@each_law
@each_wave
def test_the_second_harmonic_of_a_stepped_lattice_is_that_of_theory(mode: str, xi: float, law: str) -> None:
    wave = wave_of_name(mode, xi, law)
    found = stepped_second_harmonic(wave, TAU, STEP)
    exact = by_theory(wave, TAU)[0]
    assert relative_error(stepped_second_harmonic(wave, TAU, 1e-4), exact) < 1e-3
    if mode != "L":
        p, without = (motion[:, 0] for motion in motions(law)[mode, xi])
        assert relative_error(p - without, found - exact) < 0.1


# --- measured ± error ------------------------------------------------------------------------------------------------


@each_law
@each_wave
def test_what_is_measured_is_within_twice_its_error_of_what_is_predicted(mode: str, xi: float, law: str) -> None:
    record, without = records(mode, xi, law)
    wave = wave_of_name(mode, xi, law)
    predicted = predicted_amplitude(wave)
    own, theirs = second_harmonic(record), measured_amplitude(record, wave)
    assert own is not None
    assert predicted is not None
    assert theirs[0] is not None
    for amplitude, error in ((own.amplitude, own.error), theirs):
        off = abs(amplitude - predicted)
        assert off < 2 * error
        assert error < 5 * off
    # A record without an error of the step is measured as predicted, so that the step is what the error is of
    assert abs(measured_amplitude(without, wave)[0] - predicted) < 0.5 * abs(theirs[0] - predicted)


def test_the_error_of_a_run_to_a_tolerance_is_the_share_that_its_estimate_says() -> None:
    _, record = records("TR", 0.802, "secant")
    told = replace(
        record, scene=record.scene.with_values({"time.tolerance": 0.1}), info={"error_estimate": {"p": 3e-2}}
    )
    wave = wave_of_name("TR", 0.802, "secant")
    for info, share in ((told.info, 3e-2), ({}, 0.1), ({"error_estimate": {"p": None}}, 0.1)):
        run_to = replace(told, info=info)
        own, theirs = second_harmonic(run_to), measured_amplitude(run_to, wave)
        assert own is not None
        assert own.error == pytest.approx(share * own.amplitude, rel=0.01)
        assert theirs[1] == pytest.approx(share * theirs[0], rel=0.01)


# --- in the budget ---------------------------------------------------------------------------------------------------


@each_law
@each_wave
def test_the_budget_says_the_error_of_p(mode: str, xi: float, law: str) -> None:
    record, without = records(mode, xi, law)
    line = error_budget(record.problem, record.signals)[0]
    # Of L it is the phase error of the linear wave, whose start errs too; of the others what is of order a² is left
    assert line["p"] == pytest.approx(relative_error(record.p, without.p), rel=0.1)
    aim = float(line["to_halve"].split()[-1])
    finer = prepare(record.scene.with_values({"time.sample": 0.5, "time.timestep": aim}))
    halved = error_budget(finer, without.signals)[0]
    assert max(halved[name] or 0.0 for name in "pq") <= 0.55 * max(line[name] or 0.0 for name in "pq")


def test_near_an_antiresonance_the_error_of_p_is_that_of_the_slip_or_not_known() -> None:
    contact = Contact(0.17, overlap_ratio=PAPER.sphere.overlap_ratio)
    for amplitude, known in ((0.02, True), (0.2, False)):
        wave = Wave.of_mode("TR", 2.127, amplitude, contact)
        scene = scene_of("TR", 2.127, "secant").with_values({"wave.amplitude": amplitude})
        p = {"p": stepped([wave], 5, records=80)[0, :, 0], "q": np.cos(TAU)}
        said, without = error_budget(prepare(scene), p)[0]["p"], limit([wave], TAU)[0, :, 0]
        assert (said is not None) == known
        if said is not None:  # 2.5 times of it is the slip that turns late
            assert said == pytest.approx(relative_error(p["p"], without), rel=0.1)


@pytest.mark.parametrize("mode", ["TR", "RT"])
def test_lammps_errs_so_at_any_phase(mode: str, tmp_path: Path) -> None:
    cell = {"packing.rows": 12, "packing.ends": "periodic", "wave.wavenumber": np.pi / 2, "wave.amplitude": 0.02}
    wave = {"wave.mode": mode, "wave.phase": 2.0, "effects.shear_law": "incremental"}
    record = run(PAPER.with_values({**cell, **wave, "time.duration": 30.0, "time.timestep": 0.1}), tmp_path / "run")
    line, exact = record.info["error_budget"][0], trajectory("exact-lattice", wave_of(record), record.tau)
    assert line["order"] == 1
    # Twice: the record has the error too, from which the size of its second harmonic is read
    assert 0.5 < line["p"] / relative_error(record.p, exact[0]) < 2
    found, predicted = second_harmonic(record), predicted_amplitude(wave_of(record))
    assert found is not None
    assert abs(found.amplitude - predicted) < 2 * found.error < 0.1 * predicted
