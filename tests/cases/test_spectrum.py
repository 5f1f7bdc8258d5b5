"""The measured spectrum of the second harmonic: what is put in is found, a wrong amplitude and a shift are seen."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.pairs import by_wave
from cases.spectrum import case as spectrum_figure
from cases.spectrum import points as spectrum
from granular_analysis import second_harmonic as closed
from granular_analysis.measure.runs import sweep
from granular_analysis.theory.choice import wave_of
from granular_analysis.theory.wave import Wave
from granular_lmp import Record, Scene, run
from tests.conftest import members
from tests.stand_in import leave_folder, leave_sweep

ZONE = Scene.load("tr_periodic").with_values({"packing.rows": 128, "wave.amplitude": 0.02})
TAU = np.arange(0.0, 120.1, 0.5)
# 2πk/128 on both sides of the resonance (k = 30.08) and of the antiresonance (43.38)
ROWS = {"resonance": range(26, 35), "antiresonance": range(39, 48)}


def of_theory(mode: str, k: int, poisson_ratio: float | None = None, rows: int = 128) -> Record:
    """A record of second-order theory; of spheres with another Poisson ratio than the scene says, if one is given."""
    scene = ZONE.with_values({"packing.rows": rows, "wave.mode": mode, "wave.wavenumber": 2 * np.pi * k / rows})
    empty = Record.of_centre(TAU, TAU, TAU, TAU, scene)
    ratios = wave_of(empty).contact.closed if poisson_ratio is None else other(poisson_ratio)
    wave = closed.mode(mode, scene.wavenumber, ratios)
    p, q, phi = closed.second_order(wave, ratios, scene.wave.amplitude, TAU)
    return empty.with_signals(p=p, q=q, phi=phi)


def other(poisson_ratio: float) -> closed.Ratios:
    return closed.ratios(poisson_ratio, overlap_ratio=ZONE.sphere.overlap_ratio)


def noisy(record: Record, size: float, random: np.random.Generator) -> Record:
    p, q = (record.signals[name] + random.normal(0, size, len(TAU)) for name in ("p", "q"))
    return record.with_signals(p=p, q=q)


def located(name: str, records: Iterable[Record]) -> tuple[float, float]:
    if name == "resonance":
        return spectrum.locate_resonance(records)
    return spectrum.locate_antiresonance(map(spectrum.point, records))


@pytest.fixture
def one_theory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noisy records of one scene share its wave, and all that theory makes of it."""
    waves: dict[int, Wave] = {}

    def shared(record: Record) -> Wave:
        key = id(record.scene)
        if key not in waves:
            waves[key] = wave_of(record)
        return waves[key]

    monkeypatch.setattr(spectrum, "wave_of", shared)


each_location = pytest.mark.parametrize("name", ROWS)


# ---------------------------------------------------------------- amplitudes


@pytest.mark.parametrize("mode", ["TR", "RT", "L"])
@pytest.mark.parametrize("k", [4, 17, 30, 43, 60])
def test_the_amplitude_put_in_is_found(mode: str, k: int) -> None:
    point = spectrum.point(of_theory(mode, k))
    assert point.value == pytest.approx(
        point.predicted, rel=1e-8
    )  # rounding, 1e-16, times the condition of the fit, 1e6 at worst


@pytest.mark.parametrize("mode", ["TR", "RT", "L"])
def test_one_percent_more_second_harmonic_is_one_percent_and_another_sign_is_seen(mode: str) -> None:
    record = of_theory(mode, 17)
    wave = wave_of(record)
    more = 0.01 * closed.second_harmonic(wave.mode, wave.contact.closed, wave.amplitude, TAU)
    assert spectrum.point(record.with_signals(p=record.p + more)).deviation == pytest.approx(0.01, rel=1e-6)
    if not wave.mode.p:
        assert spectrum.point(record.with_signals(p=-record.p)).deviation == pytest.approx(-2, rel=1e-6)


def test_free_waves_of_any_size_are_not_the_generated_wave() -> None:
    record = of_theory("TR", 17)
    free = 0.1 * np.cos(spectrum.linear(wave_of(record)).free * TAU + 1.0)  # 500 times the generated wave
    assert abs(spectrum.point(record.with_signals(p=record.p + free)).deviation) < 1e-8


def test_a_fundamental_that_drifts_is_no_second_harmonic() -> None:
    record = of_theory("L", 43)
    frequency, shift = wave_of(record).mode.frequency, 8e-6  # σa², 0.02 · 4e-4
    drifting = record.p + np.cos((frequency + shift) * TAU) - np.cos(frequency * TAU)
    # Half the square of the phase is 5e-7, 3e-4 of the second harmonic, and 1e-7 at 2Ω; without a drift it is 9e-4
    assert abs(spectrum.point(record.with_signals(p=drifting)).deviation) < 1e-5


def test_the_standard_error_is_the_spread_of_noisy_measurements(one_theory: None) -> None:
    record, random = of_theory("TR", 17), np.random.default_rng(1)
    points = [spectrum.point(noisy(record, 1e-5, random)) for _ in range(1000)]
    off = [(point.value - point.predicted) / point.error for point in points]
    # 1000 draws of a unit normal: mean 0 ± 0.032, spread 1 ± 0.022; three of those
    assert abs(np.mean(off)) < 0.1
    assert np.std(off) == pytest.approx(1, abs=0.07)


@pytest.mark.parametrize("detuning", [0.0, 1e-9, 1e-3, 0.5])
def test_the_response_is_that_of_an_oscillator_driven_from_rest(detuning: float) -> None:
    tau = np.linspace(0, 60, 60001)
    own = 0.9
    signal = spectrum.response(tau, spectrum.Frequencies(own / 2 + detuning, own))
    # S = ∫ sin w̃(τ−s) sin 2Ωs ds / w̃, summed by trapezia (both ends are 0): error of order h²τ/12 = 5e-6
    drive = np.sin(2 * (own / 2 + detuning) * tau) * np.sin(own * (tau[-1] - tau)) / own
    assert signal[-1] == pytest.approx(drive.sum() * tau[1], abs=1e-5)
    assert signal[0] == 0


# ---------------------------------------------------------------- locations


@each_location
@pytest.mark.parametrize("poisson_ratio", [None, 0.15, 0.19])
def test_the_location_is_that_of_the_spheres_that_ran(name: str, poisson_ratio: float | None) -> None:
    record = of_theory("TR", 30)
    ratios = wave_of(record).contact.closed if poisson_ratio is None else other(poisson_ratio)
    place, _ = located(name, [of_theory("TR", k, poisson_ratio) for k in ROWS[name]])
    there, here = (getattr(closed, name)(each) for each in (ratios, wave_of(record).contact.closed))
    assert place == pytest.approx(there, abs=3e-4)  # a quartic over 0.4 rad of wave number
    if poisson_ratio is not None:
        assert abs(there - here) > 2e-3  # so the scene's own location would be wrong


@pytest.mark.parametrize("name", members(ROWS, "resonance"))
def test_the_error_of_a_location_is_its_spread(name: str, one_theory: None) -> None:
    # Eight times as close, so that the polynomial is right to less than the noise; 240.6/1024 and 347.0/1024 of 2π
    first = {"resonance": 236, "antiresonance": 342}[name]
    clean = [of_theory("TR", k, rows=1024) for k in range(first, first + 10)]
    random = np.random.default_rng(2)
    found = [located(name, [noisy(record, 2e-6, random) for record in clean]) for _ in range(60)]
    places, errors = np.transpose(found)
    # 60 draws: 9 %; the scatter of 8 points about a quartic makes each error up to √(χ²/3) larger, 1.2 in the mean
    assert 0.65 < np.std(places) / np.mean(errors) < 1.2


def test_a_pole_is_no_crossing() -> None:
    x = np.linspace(1, 2, 21)
    place, _ = spectrum.crossing(x, (x - 1.73) / (x - 1.212), np.full(21, 1e-6))
    assert place == pytest.approx(1.73, abs=1e-4)


@pytest.mark.parametrize(
    ("y", "said"),
    [
        (np.ones(9), "no change of sign"),
        (1 / (np.arange(9) - 3.3), "no change of sign through zero"),  # a pole and nothing else
        (np.ones(7), "a crossing needs 8"),
    ],
)
def test_nothing_to_locate_is_said(y: np.ndarray, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        spectrum.crossing(np.arange(len(y)), y, np.ones(len(y)))


# ---------------------------------------------------------------- sweeps


def stepped(record: Record, step: float) -> Record:
    return replace(record, scene=record.scene.with_values({"time.timestep": step}))


def test_a_pair_of_steps_is_extrapolated() -> None:
    exact = of_theory("TR", 17)
    error = np.cos(TAU)
    pair = [stepped(exact, h).with_signals(p=exact.p + h**2 * error) for h in (0.025, 0.05)]
    (better,) = spectrum.extrapolated(pair)
    # Rounding of numbers of 5e-2: h² and the error of order one, four times over.
    assert np.max(np.abs(better.p - exact.p)) < 1e-14
    assert spectrum.extrapolated([exact]) == [exact]


@pytest.mark.parametrize("steps", [(0.05, 0.01), (0.05, 0.05), (0.05, 0.025, 0.0125)])
def test_other_runs_of_one_wave_are_refused(steps: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r"TR, xi = 0\.83449"):
        spectrum.extrapolated([stepped(of_theory("TR", 17), step) for step in steps])


@pytest.fixture
def folder(tmp_path: Path) -> Callable[[Iterable[Record]], Path]:
    """Makes the folder of a sweep of records."""

    def make(records: Iterable[Record]) -> Path:
        leave_sweep(list(records), tmp_path / "sweep")
        return tmp_path / "sweep"

    return make


def test_runs_of_an_earlier_sweep_in_the_folder_are_left_out(folder: Callable[..., Path]) -> None:
    swept = folder([of_theory("TR", 18), of_theory("TR", 17)])
    leave_folder(of_theory("L", 19), swept / "runs" / "earlier")
    assert [record.scene.wave.mode for record in sweep(str(swept))] == ["TR", "TR"]
    assert [record.folder for record in sweep(str(swept))] == [swept / "runs" / "1", swept / "runs" / "0"]


def test_a_sweep_with_a_run_that_is_not_finished_and_a_folder_that_holds_none_are_refused(
    folder: Callable[..., Path],
) -> None:
    swept = folder([of_theory("TR", 17), of_theory("TR", 18)])
    table = swept / "sweep.csv"
    table.write_text(table.read_text(encoding="utf-8").replace("finished", "failed", 1), encoding="utf-8")
    with pytest.raises(SystemExit, match="sweep: 1 runs are not finished; the same sweep command again does them"):
        sweep(str(swept))
    with pytest.raises(SystemExit, match="runs: is no sweep; granular-lmp sweep SCENE"):
        sweep(str(swept / "runs"))


@pytest.mark.usefixtures("drawn_once")
def test_a_sweep_has_its_deviation_and_its_locations_in_the_table(
    folder: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    records = [of_theory("TR", k) for k in (*ROWS["resonance"], *ROWS["antiresonance"])]
    large = [record.with_signals(p=1.03 * record.p) for record in records]  # 3 % more, and the locations are the same
    drawn = tmp_path / "figure.png"
    assert spectrum_figure.main([str(folder(large)), "-o", str(drawn)]) == 0
    assert drawn.stat().st_size > 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line.strip()]
    (deviation,) = (float(line[3]) for line in lines if line[0] == "TR")
    assert deviation == pytest.approx(0.03, rel=1e-2)  # two digits are printed
    places = {line[0]: float(line[2]) for line in lines if line[0] in ROWS}
    assert places == pytest.approx({"resonance": 1.47627, "antiresonance": 2.12923}, abs=3e-4)  # as above


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"sphere.poisson_ratio": 0.2},
            r"poisson_ratio = 0\.2, but 0\.17 in .*; all runs must have the same crystal",
        ),
        ({"wave.amplitude": 0.1}, r"wave\.amplitude = 0\.02, 0\.1: must be equal in all runs"),
    ],
)
def test_runs_of_two_crystals_or_amplitudes_are_refused(changes: dict[str, float], said: str) -> None:
    first, other_one = of_theory("TR", 17), of_theory("TR", 18)
    with pytest.raises(ValueError, match=said):
        spectrum_figure.refuse([first, replace(other_one, scene=other_one.scene.with_values(changes))])


def test_runs_that_differ_in_more_than_the_step_are_no_pair() -> None:
    coarse, fine = (stepped(of_theory("TR", 17), step) for step in (0.05, 0.025))
    for changes in ({"wave.amplitude": 0.1}, {"sphere.poisson_ratio": 0.2}, {"wave.phase": 0.4}):
        other_wave = replace(fine, scene=fine.scene.with_values(changes))
        assert len(by_wave([coarse, other_wave])) == 2
    assert [len(runs) for runs in by_wave([coarse, fine])] == [2]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"wave.phase": 0.4}, "wave.phase = 0.4"),
        ({"effects.viscosity": 1e-7, "effects.damping": True}, "the closed form leaves out"),
        ({"wave.form": "standing"}, "leaves out wave.form = 'standing'"),
        ({"wave.direction": 60.0, "packing.columns": 24}, "the wave must run along y"),
    ],
)
def test_runs_that_have_no_such_amplitude_are_refused(changes: dict[str, object], said: str) -> None:
    record = of_theory("TR", 17)
    assert said in str(spectrum.refusal(replace(record, scene=record.scene.with_values(changes))))
    assert spectrum.refusal(record) is None


# ---------------------------------------------------------------- LAMMPS


@pytest.mark.parametrize("mode", members(["TR", "RT", "L"], "RT"))
def test_lammps_makes_the_amplitude_of_theory(mode: str, tmp_path: Path) -> None:
    scene = ZONE.with_values({"packing.rows": 16, "wave.mode": mode, "wave.wavenumber": np.pi / 4})
    pair = [
        run(each, tmp_path / str(each.time.step))
        for each in (scene, scene.with_values({"time.timestep": scene.time.step / 2}))
    ]
    point = spectrum.point(*spectrum.extrapolated(pair))
    # TR 2e-5, RT 9e-4 (the next order of a pair), L 2e-3 (waves of order a³ that are no column of the fit)
    assert abs(point.deviation) < 3e-3
