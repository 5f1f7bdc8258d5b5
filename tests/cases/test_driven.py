"""The driven row: amplitudes against the row equations and against an integrated strip, and what its script does."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks import paper_rows
from cases.driven import case as driven_figure
from cases.driven import waves as driven
from cases.rows import amplitudes_at, rows_of
from granular_analysis import second_harmonic as sh
from granular_analysis.measure.norms import relative_error
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact, Law
from granular_analysis.theory.wave import Wave, resonance
from granular_lmp.scene.sections import Envelope
from tests.conftest import PAPER, members
from tests.stand_in import AMPLITUDE, refused_in_one_line, run_of_rows

NU = 0.17
SILICA = sh.ratios(NU)
PAPER_CONTACT, HEAVY = Contact(NU), Contact(NU, inertia=5.0)  # from ξ = 1.3 on two of its TR waves have one frequency
WAVES = [("L", 0.802), ("L", 2.0), ("TR", 0.802), ("TR", 1.475), ("TR", 2.127), ("RT", 0.802), ("RT", 2.0)]
ROWS = np.arange(40)

# ---------------------------------------------------------------- the row equations


def contact_of(ratios: sh.Ratios) -> Contact:
    """The contact of constants in closed form."""
    eta = ratios.overlap_ratio
    poisson = 2 * (1 - ratios.kappa) / (2 - ratios.kappa)
    return Contact(poisson, overlap_ratio=eta, inertia=ratios.inertia * (1 - eta))


def sent(name: sh.ModeName, xi: float, amplitude: float = 0.2, contact: Contact = PAPER_CONTACT) -> Wave:
    return Wave.of_mode(name, xi, amplitude, contact)


def along(waves: driven.RowWaves, n: np.ndarray) -> np.ndarray:
    return waves.shapes @ np.exp(1j * np.multiply.outer(waves.wavenumbers, n))


@pytest.mark.parametrize(("name", "xi"), WAVES)
@pytest.mark.parametrize("ratios", [SILICA, sh.ratios(NU, 5.0), sh.ratios(-0.9), sh.ratios(NU, overlap_ratio=0.01)])
def test_fundamental_obeys_the_linear_row_equations(name: sh.ModeName, xi: float, ratios: sh.Ratios) -> None:
    mode = sh.mode(name, xi, ratios)
    wave = Wave(mode, 0.2, contact_of(ratios))
    if driven.linear_waves(wave).velocities[0] < 1e-3:
        pytest.skip("next to a maximum of the branch")
    p, q, phi = along(driven.linear_waves(wave), np.arange(0, 12))
    (dp, dq), sigma = (np.diff(x) for x in (p, q)), phi[1:] + phi[:-1]
    square, mu1, mu2 = mode.frequency**2, ratios.mu1, ratios.mu2
    shear = np.sqrt(3) * (dq[1:] + dq[:-1]) - 2 * (sigma[1:] + sigma[:-1]) - 4 * phi[1:-1]
    residuals = [
        square * p[1:-1] + np.diff(dp) / 4,
        square * q[1:-1] + mu1 / 4 * np.diff(dq) - np.sqrt(3) * mu2 / 2 * np.diff(sigma),
        ratios.inertia * square * phi[1:-1] + mu2 / 2 * shear,
    ]
    assert np.max(np.abs(residuals)) < 1e-12  # rounding, worst where the second wave decays as e^{-5n}


@pytest.mark.parametrize(("name", "xi"), WAVES)
@pytest.mark.parametrize("ratios", [SILICA, sh.ratios(NU, 5.0), sh.ratios(NU, overlap_ratio=0.01)])
def test_second_harmonic_obeys_the_quadratic_row_equation(name: sh.ModeName, xi: float, ratios: sh.Ratios) -> None:
    mode, eps = sh.mode(name, xi, ratios), sh.nonlinearity(ratios, 0.2)
    (p, q, phi), second = driven.driven_amplitudes(Wave(mode, 0.2, contact_of(ratios)), ROWS)
    dp, dq, sigma = np.diff(p), np.diff(q), phi[1:] + phi[:-1]
    # Real fields: (Re z)² holds ½ Re z² at 2Ω.
    bond = ratios.longitudinal * dp**2 - ratios.alpha * dq**2 + 2 / np.sqrt(3) * ratios.beta * sigma * dq
    force = np.diff(second) / 4 + eps / 16 * bond
    residual = 4 * mode.frequency**2 * second[1:-1] + np.diff(force)
    assert np.max(np.abs(residual)) < 1e-13 * max(1, np.max(np.abs(second)) / 0.01)  # rounding


@pytest.mark.parametrize(("name", "xi"), WAVES)
def test_row_0_moves_as_it_is_driven(name: sh.ModeName, xi: float) -> None:
    fundamental, second = driven.driven_amplitudes(replace(sent(name, xi), phase=0.7), [0])
    expected = np.array([1, 0, 0] if name == "L" else [0, 1, 0]) * np.exp(0.7j)
    assert fundamental[:, 0] == pytest.approx(expected, rel=0, abs=1e-14)
    assert second[0] == 0
    assert driven.static(sent(name, xi), [0])[0] == 0


@pytest.mark.parametrize("inertia", [0.4, 5.0])
@pytest.mark.parametrize("name", ["TR", "RT", "L"])
def test_waves_carry_energy_away_from_the_row(name: sh.ModeName, inertia: float) -> None:
    ratios, contact = sh.ratios(NU, inertia), Contact(NU, inertia=inertia)
    for xi in np.linspace(0.2, 3.0, 15):
        waves, h = driven.linear_waves(sent(name, xi, contact=contact)), 1e-5
        above, below = sh.dispersion([xi + h, xi - h], name, ratios)
        velocity = (above - below) / (2 * h)
        # −ξ where the branch falls; h² and rounding/h of the difference, 1e-10.
        assert waves.wavenumbers[0] == pytest.approx(np.copysign(xi, velocity), abs=1e-12)
        assert waves.velocities[0] == pytest.approx(abs(velocity), abs=1e-8)
        assert np.all((waves.velocities > 0) | (waves.wavenumbers.imag > 0))


def test_rotational_waves_run_backward_and_heavy_spheres_have_two_waves() -> None:
    assert driven.linear_waves(sent("RT", 2.0)).wavenumbers[0].real == pytest.approx(-2.0)
    assert np.all(driven.linear_waves(sent("TR", 1.5, contact=HEAVY)).velocities > 0)
    assert driven.linear_waves(sent("TR", 1.5)).velocities[1] == 0


@pytest.mark.parametrize("contact", [PAPER_CONTACT, Contact(0.3, rotation=False)])
def test_on_resonance_the_second_harmonic_grows_by_the_same_in_every_row(contact: Contact) -> None:
    xi, n = resonance(contact), np.arange(400)
    assert xi is not None
    second = driven.driven_amplitudes(sent("TR", xi, contact=contact), n)[1]
    steps = np.diff(second * np.exp(-2j * xi * n))[10:]  # past the wave that decays
    # Rounding of ξ over v = 0.05 rows per τ of the free wave is a mismatch of 1e-14, times 400 rows.
    assert np.max(np.abs(steps / np.mean(steps) - 1)) < 1e-10
    near = driven.driven_amplitudes(sent("TR", xi + 1e-7, contact=contact), n)[1]
    # 1e-7 · 400 rows over v.
    assert relative_error(np.abs(near), np.abs(second)) < 1e-3


@pytest.mark.parametrize(("name", "xi"), [("L", 0.802), ("TR", 0.802)])
def test_second_harmonic_comes_back_after_the_beat_length(name: sh.ModeName, xi: float) -> None:
    second = np.abs(driven.driven_amplitudes(sent(name, xi), np.arange(300))[1])
    inside = second[1:-1]
    minima = np.flatnonzero((inside < second[:-2]) & (inside < second[2:])) + 1
    minima = minima[minima > 3]
    # Over 5 and more beats, each place known to a row.
    spacing = (minima[-1] - minima[0]) / (len(minima) - 1)
    assert spacing == pytest.approx(driven.beat_length(sent(name, xi)), abs=1 / (len(minima) - 1))


def test_far_from_the_row_nothing_overflows() -> None:
    for name, xi in WAVES:
        fundamental, second = driven.driven_amplitudes(sent(name, xi), [100_000])
        assert np.isfinite(fundamental).all()
        assert np.isfinite(second).all()


# ---------------------------------------------------------------- the integrated strip

RAMP, REACH, PERIODS, SAMPLES = 80.0, 12, 5, 20


def strip(
    mode: sh.Mode, amplitude: float, tau: np.ndarray, rows: int, contact: Contact, ramp: float = RAMP
) -> np.ndarray:
    """p, q, φ (T, 3, rows) in D0 of the exact lattice, row 0 moved by force, the last row held."""
    neighbours, component = paper_rows.ring_neighbours(), 0 if mode.name == "L" else 1
    start = lattice.with_shear(np.zeros((6, rows)), contact, neighbours)  # on a ring the two ends only touch each other

    def rate(time: float, flat: np.ndarray) -> np.ndarray:
        state = flat.reshape(start.shape).copy()
        s = min(time / ramp, 1.0)
        rise, rising = s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2 / ramp
        cos, sin = np.cos(mode.frequency * time), np.sin(mode.frequency * time)
        state[:6, 0] = state[:6, -1] = 0
        state[component, 0] = amplitude * rise * cos
        state[component + 3, 0] = amplitude * (rising * cos - rise * mode.frequency * sin)
        result = lattice.rhs(state, contact, neighbours)
        result[:6, 0] = result[:6, -1] = 0
        return result.ravel()

    # Against 1e-8 this changes the errors of theory by 7 % or less, and the power of a by 0.1
    options = {"method": "DOP853", "t_eval": tau, "rtol": 1e-6, "atol": 1e-6 * amplitude}
    solution = solve_ivp(rate, (0, tau[-1]), start.ravel(), **options)
    return solution.y.T.reshape(-1, *start.shape)[:, :3] / amplitude


@cache
def fitted(
    mode: sh.Mode, slowest: float, amplitude: float, contact: Contact, ramp: float = RAMP, wait: float = 20.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fundamental (3, REACH), p at 2Ω and mean p of rows 1 to REACH of an integrated strip."""
    period = 2 * np.pi / mode.frequency
    begin = ramp + REACH / slowest + wait
    count = max(PERIODS, int(np.ceil(60 / period)))
    tau = begin + period * np.arange(count * SAMPLES) / SAMPLES
    rows = int(tau[-1] / 4 + REACH / 2) + 20  # no echo: half a row per τ, there and back
    signals = strip(mode, amplitude, tau, rows, contact, ramp)[:, :, 1 : REACH + 1]
    fits = [amplitudes_at(tau, signals[:, i], mode.frequency * np.arange(1, 4)) for i in range(3)]
    return np.array([fit[1][0] for fit in fits]), fits[0][1][1], fits[0][0]


def errors(wave: Wave, still: Wave | None = None, **setting: float) -> np.ndarray:
    """Return the errors of the driven component, of p at 2Ω, and of the mean of p, expected as in the wave `still`."""
    mode, amplitude, contact = wave.mode, wave.amplitude, wave.contact
    fundamental, second, mean = fitted(mode, driven.slowest(wave), amplitude, contact, **setting)
    n, component = np.arange(1, REACH + 1), 0 if mode.name == "L" else 1
    first, expected = driven.driven_amplitudes(wave, n)
    pairs = [(first[component], fundamental[component]), (expected, second), (driven.static(still or wave, n), mean)]
    if mode.name != "L":
        pairs.append((first[2], fundamental[2]))
    return np.array([np.linalg.norm(theory - run) / np.linalg.norm(run) for theory, run in pairs])


STRIPS = [
    ("TR", 0.802, 0.0, "secant"),
    ("TR", 2.127, 0.0, "secant"),
    ("TR", 0.802, 0.01, "secant"),
    ("RT", 2.0, 0.0, "secant"),
    ("L", 0.802, 0.01, "secant"),
    ("L", 1.3, 0.0, "secant"),
]
MORE = [each for each in STRIPS if each[:3] not in (("TR", 0.802, 0.0), ("L", 0.802, 0.01))]


@pytest.mark.parametrize(("name", "xi", "eta", "law"), members(STRIPS, *MORE))
def test_errors_against_an_integrated_strip_fall_as_the_square_of_the_amplitude(
    name: sh.ModeName, xi: float, eta: float, law: Law
) -> None:
    contact = Contact(NU, law=law, overlap_ratio=eta)
    large, small = (errors(sent(name, xi, amplitude, contact)) for amplitude in (0.16, 0.08))
    # The next order, a² of these (20 % of contacts' overlap at a = 0.16), and the floor of switching on, 1e-5.
    assert np.log2(large / small) == pytest.approx(2, abs=0.2)
    assert np.all(small < 3e-2)  # the mean at 2.127, where αdq² and βσdq nearly cancel


def test_the_incremental_law_has_the_same_steady_state_but_for_the_mean() -> None:
    wave = sent("TR", 0.802, 0.04, Contact(NU, law="incremental", overlap_ratio=0.01))
    q, second, mean, phi = errors(wave, still=sent("TR", 0.802, 0.04, Contact(NU, overlap_ratio=0.01)))
    assert max(q, second, phi) < 1e-3  # a² = 1.6e-3 of order 0.1
    assert mean > 0.1  # the mean of the secant law is not that of the incremental one, for which it is refused
    with pytest.raises(ValueError, match="no steady mean displacement"):
        driven.static(wave, [1])


@pytest.mark.more  # that waves carry energy away, of two wave numbers too, stays in `make test`
def test_of_two_waves_that_run_the_strip_has_those_that_run_away() -> None:
    wave = sent("RT", 2.15, 0.01, Contact(NU, inertia=1.5))
    run = fitted(wave.mode, driven.slowest(wave), 0.01, wave.contact, wait=800.0)[0][1]
    waves = driven.linear_waves(wave)
    n, (q, phi) = np.arange(1, REACH + 1), waves.shapes[1:]
    # The second wave is the one that comes in: κ and φ/q of the other sign, and shares that again leave φ_0 = 0
    shares = np.linalg.solve([[1, 1], [phi[0] / q[0], -phi[1] / q[1]]], [1, 0])
    incoming = shares @ np.exp(1j * np.multiply.outer(waves.wavenumbers * [1, -1], n))
    # Both are slow, 0.03 rows per τ, so near the edges of their band that switching on is heard for long
    assert relative_error_complex(along(waves, n)[1], run) < 0.03
    assert relative_error_complex(incoming, run) > 0.3


def relative_error_complex(estimate: np.ndarray, reference: np.ndarray) -> float:
    return float(np.linalg.norm(estimate - reference) / np.linalg.norm(reference))


def test_the_floor_is_what_switching_on_leaves() -> None:
    abrupt, soft = (errors(sent("L", 2.0, 0.01), ramp=ramp)[1] for ramp in (40.0, RAMP))
    assert abrupt > 5 * soft
    # Linear waves in p, over a second harmonic of order a: twice as much at half the amplitude.
    assert errors(sent("L", 2.0, 0.005), ramp=40.0)[1] / abrupt == pytest.approx(2, rel=0.2)


def test_one_percent_more_nonlinearity_is_seen() -> None:
    wave = sent("TR", 0.802, 0.02)
    expected = driven.driven_amplitudes(wave, np.arange(1, REACH + 1))[1]
    second = fitted(wave.mode, driven.slowest(wave), 0.02, wave.contact)[1]
    wrong = np.linalg.norm(1.01 * expected - second) / np.linalg.norm(second)
    assert wrong > 0.005 > 50 * errors(wave)[1]


# ---------------------------------------------------------------- fit and script


def test_the_amplitudes_put_in_are_found() -> None:
    tau, frequency = np.arange(0, 60, 0.5), 0.7
    put = np.array([0.3 - 0.1j, 0.02j, 0.001])
    signal = (put * np.exp(-1j * frequency * np.multiply.outer(tau, [1, 2, 3]))).sum(axis=1).real + 0.05 + 0.01 * tau
    mean, found = amplitudes_at(tau, signal[:, None], frequency * np.arange(1, 4))
    assert found[:, 0] == pytest.approx(put, rel=0, abs=1e-14)  # rounding
    assert mean[0] == pytest.approx(0.05 + 0.01 * np.mean(tau), rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [([-1], "not negative"), ([0.5], "whole numbers"), ([], "one-dimensional"), (3, "one-dimensional")],
)
def test_rows_that_are_none_are_refused(arguments: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        driven.driven_amplitudes(sent("TR", 0.802), arguments)


@pytest.mark.parametrize("name", ["L", "TR", "RT"])
def test_a_wave_without_group_velocity_is_refused(name: sh.ModeName) -> None:
    with pytest.raises(ValueError, match="no group velocity"):
        driven.driven_amplitudes(sent(name, np.pi), [1])


def record(
    *, mode: str = "TR", form: str = "driven", more: float = 1.0, end: float = 250.0, every: float = 0.5,
    rows: int = 90, snapshots: bool = True, xi: float = 0.802
) -> Any:  # fmt: skip
    """A run in which the steady state of theory stands from the start, second order times `more`."""
    contact = Contact(PAPER.sphere.poisson_ratio, overlap_ratio=PAPER.sphere.overlap_ratio)
    wave, tau = Wave.of_mode(mode, xi, AMPLITUDE, contact, 0.3), np.arange(0, end, every)
    linear = wave.mode
    (p, q, phi), second = driven.driven_amplitudes(wave, np.arange(rows))
    turn = np.exp(-1j * linear.frequency * tau)[:, None]
    mean = driven.static(wave, np.arange(rows))
    p = (p * turn).real + more * (mean + (second * turn**2).real)
    return run_of_rows(
        tau,
        (p, (q * turn).real, (phi * turn).real),
        wavenumber=xi,
        ends="fixed",
        envelope=Envelope(ramp=40.0),
        snapshots=snapshots,
        form=form,
        mode=mode,
        phase=0.3,
    )


@pytest.mark.parametrize("mode", ["L", "TR", "RT"])
def test_a_run_of_the_theory_has_no_deviation(mode: str) -> None:
    run = record(mode=mode, every=0.3)
    found = driven_figure.compare(run, rows_of(run))
    assert set(found.theory) == {"p at 2Ω", "mean p"} | ({"p"} if mode == "L" else {"q", "phi"})
    assert max(max(pair) for pair in found.deviations().values()) < 1e-9  # rounding of p over its small parts, for RT


def test_one_percent_more_second_order_is_one_percent() -> None:
    run = record(more=1.01)
    found = driven_figure.compare(run, rows_of(run)).deviations()
    assert found["p at 2Ω"] == pytest.approx((0.01, 0.01), rel=1e-6)
    assert found["mean p"] == pytest.approx((0.01, 0.01), rel=1e-6)
    assert max(found["q"]) < 1e-12


def test_rows_before_the_front_or_with_an_echo_are_left_out() -> None:
    contact = Contact(PAPER.sphere.poisson_ratio, overlap_ratio=PAPER.sphere.overlap_ratio)
    long, short = (driven_figure.compare(run, rows_of(run)).n for run in (record(), record(rows=76)))
    assert long[0] == short[0] == 1
    assert long[-1] < (250 * 2 / 3 - 40) * driven.slowest(Wave.of_mode("TR", 0.802, AMPLITUDE, contact))
    assert short[-1] < long[-1]


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (record(form="running"), "has the form 'running'"),
        (record(snapshots=False), "holds no snapshots"),
        (record(end=100.0), "too short a run"),
        (record(end=160.0), "too short a run or strip: 0 of 3 rows"),
        (record(rows=20), "too short a run or strip"),
        (record(every=5.0), "too far apart"),
    ],
)
def test_the_script_refuses_in_one_line(run: Any, message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cases.rows.load", lambda _: run)
    refused_in_one_line(driven_figure.main, message)


@pytest.mark.parametrize("mode", members(["L", "TR"], "L"))
@pytest.mark.usefixtures("drawn_once")
def test_the_script_prints_deviations_and_writes_a_figure(
    mode: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cases.rows.load", lambda _: record(mode=mode))
    assert driven_figure.main(["run", "-o", str(tmp_path / "figure.png")]) == 0
    assert (tmp_path / "figure.png").stat().st_size > 10_000
    assert "p at 2Ω" in capsys.readouterr().out


# --- the mean displacement ---

TURNS = {-0.5: 1.417, 0.0: 1.911, 0.17: 2.128, 0.3: 2.324, 0.5: 2.702}


def far_slope(name: sh.ModeName, xi: float, nu: float) -> float:
    """Mean of p from row to row, far from the source, in D0: > 0 is away from it."""
    near, far = driven.static(sent(name, xi, 0.01, Contact(nu)), np.array([200, 300]))
    return float(far - near) / 100


@pytest.mark.parametrize("nu", members(TURNS, 0.0, 0.3))
def test_the_lattice_is_pushed_or_pulled_as_the_page_says(nu: float) -> None:
    for xi in np.linspace(0.1, 3.0, 9):
        assert far_slope("L", xi, nu) > 0 > far_slope("RT", xi, nu)
        assert (far_slope("TR", xi, nu) > 0) == (xi < TURNS[nu])
    assert sh.antiresonance(sh.ratios(nu)) == pytest.approx(TURNS[nu], abs=6e-4)
    page = (Path(__file__).parents[2] / "docs/studies.md").read_text(encoding="utf-8")
    assert f"{TURNS[nu]:.3f}" in page
