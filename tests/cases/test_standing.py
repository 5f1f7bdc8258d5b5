"""The standing wave by theory against the integrated lattice, and what its script makes of runs."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from benchmarks import paper_rows
from cases.rows import rows_of
from cases.standing import case as standing_figure
from granular_analysis import second_harmonic as sh
from granular_analysis.measure.norms import relative_error
from granular_analysis.theory import bloch, lattice
from granular_analysis.theory.contact import Contact, Law
from granular_analysis.theory.wave import Wave
from granular_lmp.scene.sections import Envelope
from tests.conftest import PAPER, members
from tests.stand_in import AMPLITUDE, refused_in_one_line, run_of_rows

NU = 0.17
SILICA = sh.ratios(NU)
ETA = 2.498514361612e-10 / 1e-6  # Δ0/2R of the paper's spheres
TAU = np.linspace(0, 40, 81)
RING = 40
WAVES = [("TR", 5), ("TR", 9), ("RT", 5), ("L", 5)]  # k of ξ = 2πk/40


def on_the_ring(k: int) -> float:
    return 2 * np.pi * k / RING


@cache
def let_go(mode: sh.Mode, amplitudes: tuple[float, ...], contact: Contact, phase: float = 0.3) -> np.ndarray:
    """p, q, φ (A, T, 3, rows) in D0 of the exact lattice on a ring, let go at rest with each amplitude."""
    neighbours, theta = paper_rows.ring_neighbours(), mode.wavenumber * np.arange(RING) + phase
    moving = np.zeros((6, RING))
    moving[:3] = mode.p * np.cos(theta), mode.q * np.cos(theta), -mode.f * np.sin(theta)
    sizes = np.array(amplitudes)[:, None, None]
    start = lattice.with_shear(sizes * moving, contact, neighbours)
    states = lattice.motion(start, contact, neighbours, TAU, 1e-11, min(amplitudes))
    return np.moveaxis(states[..., :3, :] / sizes, 1, 0)


def standing(wave: Wave, row: int = 0) -> np.ndarray:
    """p (T,) by theory, in a row."""
    return standing_figure.standing(wave, TAU, row)[0]


def by_theory(wave: Wave) -> np.ndarray:
    p, q, phi = standing_figure.standing(wave, TAU[:, None], np.arange(RING))
    return np.stack([p, q, phi], axis=1)


def errors(name: sh.ModeName, k: int, theory: Contact, amplitudes: tuple[float, ...], contact: Contact) -> Any:
    """The relative errors of what moves of p, q, φ, for each amplitude, of the theory of a contact."""
    moves, mode = [0] if name == "L" else [0, 1, 2], bloch.mode(name, on_the_ring(k), 90.0, contact)
    own = [by_theory(Wave.of_mode(name, on_the_ring(k), a, theory, 0.3)) for a in amplitudes]
    return [
        np.array([relative_error(one[:, i], exact[:, i]) for i in moves])
        for one, exact in zip(own, let_go(mode, amplitudes, contact), strict=True)
    ]


KINDS = [(0.0, "secant"), (ETA, "secant"), (0.01, "secant"), (0.01, "incremental")]
EVERY = [(*wave, *kind) for wave in WAVES for kind in KINDS]
# Each kind of contact with a wave of its own is left to `make test`
LEFT = [(*WAVES[number], *kind) for number, kind in zip((1, 3, 2, 0), KINDS, strict=True)]


@pytest.mark.parametrize(("name", "k", "eta", "law"), members(EVERY, *(each for each in EVERY if each not in LEFT)))
def test_errors_fall_as_the_square_of_the_amplitude(name: sh.ModeName, k: int, eta: float, law: Law) -> None:
    contact = Contact(NU, law=law, overlap_ratio=eta)
    large, small = errors(name, k, contact, (0.04, 0.02), contact)
    # Next order: a² of these; and 1e-5 of p_SH, which is small for RT, is the integration's.
    assert np.log2(large / small) == pytest.approx(2, abs=0.1)
    assert np.all(small < 1e-3)


@pytest.mark.parametrize("wrong", ["geometry", "law"])
def test_a_theory_of_another_contact_is_seen(wrong: str) -> None:
    contact = Contact(NU, law="incremental", overlap_ratio=0.01)
    others = {"geometry": Contact(NU, law="incremental"), "law": Contact(NU, overlap_ratio=0.01)}
    # Ten times the error of the right one, and it does not fall with the amplitude.
    found, without = (errors("TR", 5, theory, (0.02,), contact)[0][0] for theory in (others[wrong], contact))
    assert found > 10 * without


@pytest.mark.parametrize("xi", [0.802, 2.127, sh.resonance(SILICA), np.pi / 2, 3.0])
@pytest.mark.parametrize("name", ["L", "TR", "RT"])
def test_second_harmonic_is_the_formula_written_out(name: sh.ModeName, xi: float) -> None:
    mode, row, phase = sh.mode(name, xi, SILICA), 3, 0.4
    r, s, sine = SILICA, np.sin(xi / 2), np.sin(xi)
    drive = (
        -sine * s**2 if name == "L" else sine * mode.q * (r.alpha * s**2 * mode.q - r.beta / np.sqrt(3) * sine * mode.f)
    )
    theta, w, twice = xi * row + phase, sine, 2 * mode.frequency

    def sinc(x: np.ndarray) -> np.ndarray:
        return np.sinc(x / np.pi)

    Z = TAU**2 * (sinc(w * TAU / 2) ** 2 + sinc((w + twice) * TAU / 2) * sinc((w - twice) * TAU / 2)) / 4
    expected = -sh.nonlinearity(r, 0.2) / 2 * drive * np.sin(2 * theta) * Z
    expected += mode.p * np.cos(theta) * np.cos(mode.frequency * TAU)
    # With sin 2θ it vanishes at nodes and antinodes. Rounding of terms of order 1/w̃, at most 7.
    assert standing(Wave(mode, 0.2, Contact(NU), phase), row) == pytest.approx(expected, rel=0, abs=1e-13)


# ---------------------------------------------------------------- the script


def record(
    p: Callable[..., Any] = lambda values: values, *, form: str = "standing", snapshots: bool = True, **changes: Any
) -> Any:
    """A run of the theory itself, 101 rows of 3 spheres, with p changed."""
    rows, phase = changes.get("rows", 101), changes.get("phase", 0.3)
    xi, name, ends = changes.get("xi", 0.802), changes.get("mode", "TR"), changes.get("ends", "periodic")
    contact = Contact(PAPER.sphere.poisson_ratio, overlap_ratio=PAPER.sphere.overlap_ratio)
    n = np.arange(rows) - (rows - 1) // 2
    values = standing_figure.standing(Wave.of_mode(name, xi, AMPLITUDE, contact, phase), TAU[:, None], n)
    return run_of_rows(
        TAU,
        (p(values[0]), *values[1:]),
        wavenumber=xi,
        ends=ends,
        envelope=Envelope(width=changes.get("width", 0.0)),
        snapshots=snapshots,
        info={"effects": {"sliding": {"on": True}}} if changes.get("sliding") else {},
        form=form,
        mode=name,
        phase=phase,
    )


@pytest.mark.parametrize("mode", ["L", "TR", "RT"])
@pytest.mark.parametrize("ends", ["fixed", "periodic"])
def test_a_run_of_the_theory_has_no_error(mode: str, ends: str) -> None:
    run = record(mode=mode, ends=ends)
    found = standing_figure.compare(run, rows_of(run)).errors()
    assert set(found) == {"p" if mode == "L" else "q", "second harmonic"} | (set() if mode == "L" else {"phi"})
    assert max(found.values()) < 1e-12  # rounding, of a linear wave 1e3 times the second harmonic for L


def test_one_percent_more_second_harmonic_is_one_percent() -> None:
    run = record(lambda p: 1.01 * p)
    # Relative to the run: 0.01/1.01.
    errors = standing_figure.compare(run, rows_of(run)).errors()
    assert errors["second harmonic"] == pytest.approx(0.01 / 1.01, rel=1e-6)


def test_rows_that_the_walls_have_reached_are_left_out() -> None:
    def silenced(p: np.ndarray) -> np.ndarray:
        return np.where(np.abs(np.arange(101) - 50) > 43, 0.0, p)  # less than Airy's front, 7 rows

    held = record(silenced, ends="fixed")
    assert standing_figure.compare(held, rows_of(held)).errors()["second harmonic"] < 1e-12
    free = record(silenced)
    assert standing_figure.compare(free, rows_of(free)).errors()["second harmonic"] > 0.1


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (record(form="running"), "has the form 'running'"),
        (record(snapshots=False), "holds no snapshots"),
        (record(sliding=True), "leaves out effects.sliding"),
        (record(width=5.0), "leaves out an envelope"),
        (record(xi=np.pi / 2, phase=0.0), "no second harmonic at any row"),
        (record(rows=9, ends="fixed"), "echoes reach all rows"),
    ],
)
def test_the_script_refuses_in_one_line(run: Any, message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cases.rows.load", lambda _: run)
    refused_in_one_line(standing_figure.main, message)


@pytest.mark.parametrize("mode", members(["L", "TR"], "L"))
@pytest.mark.usefixtures("drawn_once")
def test_the_script_prints_errors_and_writes_a_figure(
    mode: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cases.rows.load", lambda _: record(mode=mode, ends="fixed"))
    assert standing_figure.main(["run", "-o", str(tmp_path / "figure.png")]) == 0
    assert (tmp_path / "figure.png").stat().st_size > 10_000
    assert "second harmonic" in capsys.readouterr().out
