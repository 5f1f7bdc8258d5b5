"""Where two waves are phase-matched: the command that designs a resonance, and the map of partners."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cases.mixing import case as mixing_map
from cases.mixing.case import partners
from granular_analysis import second_harmonic
from granular_analysis.theory import lattice
from granular_analysis.theory.bloch import BONDS, in_plane, pair_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.neighbours import shifted
from granular_analysis.theory.wave import Wave, generated
from granular_analysis.tools.design import SILICA, Resonance, compressed, design, main
from tests.conftest import members
from tests.polarisations import modes
from tests.theory.test_mixing import relative

HERTZ = 1.6e8  # 0.6 % above the resonance of the paper in its own crystal
STEEL = replace(SILICA, radius=1e-2, youngs_modulus=2e11, poisson_ratio=0.3, density=7800.0, work_of_adhesion=0.0)


@cache
def found(frequency: float, second: float | None = None, direction: float = 90.0) -> list[Resonance]:
    return design(SILICA, frequency, second, [direction], [0.0, 60.0])


def wavenumbers(each: Resonance) -> list[float]:
    return [float(np.linalg.norm(k) * np.sqrt(0.75)) for k in (each.pair.first.wavevector, each.pair.second.wavevector)]


# ---- the design


def test_the_paper_s_resonance_needs_no_compression_at_its_own_frequency() -> None:
    ratios = second_harmonic.ratios(SILICA.poisson_ratio, overlap_ratio=SILICA.overlap_ratio)
    xi = second_harmonic.resonance(ratios)
    frequency = second_harmonic.mode("TR", xi, ratios).frequency / (2 * np.pi * SILICA.time_scale)
    # A millionth more, so that rounding asks for no pull; the force then is 6e-6 of the adhesion, as Ω ~ F^(1/6)
    (each,) = design(SILICA, 1.000001 * frequency, directions=[90.0], openings=[0.0])
    assert each.names == "TR + TR -> L"
    assert wavenumbers(each) == pytest.approx([xi, xi], rel=1e-8)  # η changes by 4e-6 of 2.5e-4
    assert each.sphere.contact_force == pytest.approx(6e-6 * SILICA.pull_off_force, rel=1e-3)


@pytest.mark.parametrize("second", members([None, 2.4e8], 2.4e8))
def test_a_design_is_phase_matched_in_the_crystal_that_it_asks_for(second: float | None) -> None:
    resonances = found(HERTZ, second)
    assert len(resonances) > 2
    for each in resonances:
        contact = Contact.of(replace(SILICA, contact_force=each.sphere.contact_force))
        waves = (each.pair.first, each.pair.second)
        for wave, branch, hertz in zip(waves, each.branches, (HERTZ, second or HERTZ), strict=True):
            omega = modes(wave.wavevector, contact)[0][branch]
            assert omega == pytest.approx(2 * np.pi * hertz * each.sphere.time_scale, rel=1e-8)  # `CLOSE` and rounding
        third = modes(each.pair.wavevector, contact)[0][each.target]
        assert third == pytest.approx(2 * np.pi * each.generated_frequency * each.sphere.time_scale, rel=1e-8)
        assert each.rate > 1e-4


def test_the_fastest_comes_first_and_none_comes_twice() -> None:
    resonances = found(HERTZ)
    periods = [each.periods(0.1) for each in resonances]
    assert periods == sorted(periods)
    assert periods[0] == pytest.approx(2 * resonances[0].periods(0.2))
    assert not any(one.mirrors(other) for i, one in enumerate(resonances) for other in resonances[:i])


def test_directions_that_the_lattice_cannot_tell_apart_have_the_same_resonances() -> None:
    upright, turned = found(HERTZ), found(HERTZ, None, 30.0)
    assert len(upright) == len(turned) > 1
    assert all(one.mirrors(other) for one, other in zip(upright, turned, strict=True))
    assert not upright[0].mirrors(upright[1])


def test_without_adhesion_the_force_is_as_the_sixth_power_of_the_frequency() -> None:
    low, high = (design(STEEL, hertz, directions=[90.0], openings=[0.0])[0] for hertz in (500.0, 1000.0))
    # Ω ~ 1/t0 ~ F^(1/6), beside corrections of the order of η, 1e-6 here
    assert high.sphere.contact_force / low.sphere.contact_force == pytest.approx(64.0, rel=1e-3)


def test_the_force_for_a_unit_of_time_gives_that_unit() -> None:
    for factor in (0.5, 0.9, 1.0):
        sphere = compressed(SILICA, factor * SILICA.time_scale)
        assert sphere.time_scale == pytest.approx(factor * SILICA.time_scale, rel=1e-12)  # rounding
        assert sphere.contact_force > -1e-12 * SILICA.pull_off_force


def test_equal_frequencies_make_no_difference_and_unequal_ones_do() -> None:
    assert {each.sign for each in found(HERTZ)} == {1}
    assert {each.sign for each in design(SILICA, 2e8, 3e8, [17.0], [0.0])} == {1, -1}


PAGE = Path(__file__).parents[2] / "docs" / "mixing.md"


def numbers(text: str) -> list[list[float | str]]:
    """Return the lines of a table, below its head, as words and numbers."""
    return [[_number(word) for word in line.split()] for line in text.splitlines()[1:]]


def _number(word: str) -> float | str:
    try:
        return float(word)
    except ValueError:
        return word


def agree(shown: list[list[float | str]], printed: list[list[float | str]]) -> bool:
    """Return whether two tables have the same words and numbers, within one unit of the third digit."""
    if [len(line) for line in shown] != [len(line) for line in printed]:
        return False
    cells = [(a, b) for one, other in zip(shown, printed, strict=True) for a, b in zip(one, other, strict=True)]
    return all(a == b or a == pytest.approx(b, rel=5e-3) for a, b in cells)


def test_the_table_of_the_page_is_what_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    block = re.search(r"\$ granular-analysis design ([^\n]*)\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert block
    assert main(block[1].split()) == 0
    shown = numbers(block[2])
    assert agree(shown, numbers(capsys.readouterr().out))
    assert not agree(shown, [[cell if cell != 42.6 else 43.6 for cell in line] for line in shown])
    assert not agree(shown, shown[1:])


def test_a_single_wave_grows_as_the_exchange_with_its_second_harmonic_says() -> None:
    (each,) = (one for one in found(HERTZ) if np.allclose(one.pair.first.wavevector, one.pair.second.wavevector))
    contact = Contact.of(each.sphere)
    xi, omega = wavenumbers(each)[0], each.pair.first.frequency
    # B' = F/(2w̃) A², w̃ = 2Ω; and the forced wave is F/(w̃² − 4Ω²), which is not taken at the resonance itself
    near = Wave.of_mode("TR", xi + 1e-5, 1.0, contact)
    force = generated("TR", xi + 1e-5, contact) * (near.free_frequency**2 - 4 * near.mode.frequency**2)
    assert each.rate == pytest.approx(abs(float(force)) / (4 * float(omega)), rel=1e-4)  # the drive at ξ + 1e-5
    assert Wave.of_mode("TR", xi, 1.0, contact).mode.frequency == pytest.approx(float(omega), rel=1e-9)


POINTS = 5  # points of each phase: harmonics to the second, and what is odd in both waves aliases at order a⁶


def exact_lattice(each: Resonance, tau: NDArray[np.float64], amplitude: float) -> NDArray[np.complex128]:
    """Return the (u, v, φ) at k1 + k2 (T, 3), in Δ0 per a², of the exact lattice in which two waves start.

    A field that starts as a function of the two phases k1·r and k2·r stays one, so that the neighbour at d is a shift
    of both: the infinite lattice without boundaries, for any two wave vectors.
    """
    phases = 2 * np.pi * np.arange(POINTS) / POINTS
    contact, waves = Contact.of(each.sphere), [wave.wavevector[:2] for wave in (each.pair.first, each.pair.second)]
    shifts = []
    for bond in BONDS:
        by_one, by_other = (lattice.periodic_kernel(phases[:, None] - phases + k @ bond, POINTS) for k in waves)
        shifts.append(np.kron(by_one, by_other))
    neighbours = shifted(
        0.0,
        lambda values: np.stack([values @ shift.T for shift in shifts], axis=-2),
        lambda values: np.sum([values[..., bond, :] @ shift for bond, shift in enumerate(shifts)], axis=0),
    )
    one, other = (angle.ravel() for angle in np.meshgrid(phases, phases, indexing="ij"))
    start = np.zeros((6, POINTS**2))
    for k, branch, angle in zip(waves, each.branches, (one, other), strict=True):
        frequencies, shapes = modes(k, contact)
        field = np.exp(1j * angle) * shapes[branch][:, None]
        start += amplitude * np.concatenate([field.real, (-1j * frequencies[branch] * field).real])
    start = lattice.with_shear(start, contact, neighbours)
    states = lattice.motion(start, contact, neighbours, tau, 1e-9, amplitude)[:, :3]
    return np.asarray(2 * np.mean(states * np.exp(-1j * (one + other)), axis=-1) / amplitude**2)


def test_what_is_designed_grows_in_the_exact_lattice() -> None:
    tau = np.array([0.0, 50.0, 150.0])
    several = [one for one in found(HERTZ) if not np.allclose(one.pair.first.wavevector, one.pair.second.wavevector)]
    assert len(several) == 2  # a wave with itself is left out: its harmonics would fall together
    for each in several:
        seen = exact_lattice(each, tau, 0.005)
        # Fourth order: a few times a² = 2.5e-5
        assert relative(seen, in_plane(each.pair.signal(tau))) < 1e-3
        contact = Contact.of(each.sphere)
        shape = modes(each.pair.wavevector, contact)[1][each.target]
        weights = shape.conj() * [1.0, 1.0, contact.inertia / (1 - contact.overlap_ratio)]
        share = np.abs(seen @ weights / (weights @ shape))
        # The part at −Ω beats with it: rate/Ω, with Ω of order one, over 100 τ
        assert share[2] - share[1] == pytest.approx(100.0 * each.rate, rel=0.05)


def test_a_frequency_that_no_sphere_bears_has_no_resonance(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["1e12", "--direction", "90", "--opening", "0"]) == 1
    assert "no pair is phase-matched with eta below 0.099" in capsys.readouterr().out


# ---- the map


def test_the_paper_s_resonance_is_on_the_map() -> None:
    k = np.array([0.0, 2 * 1.476255486117 / np.sqrt(3)])  # ξ_res of silica
    lines = [line for target, line, _ in partners((k, 0), 0, 1, Contact(0.17), points=60) if target == 1]
    # The spacing of the grid is 0.14; a line is good to its square
    assert min(np.linalg.norm(line - k, axis=-1).min() for line in lines) < 0.07
    assert not [line for _, line, _ in partners((k, 0), 0, -1, Contact(0.17), points=60)]


def test_the_widest_line_of_the_figure_is_that_of_the_page() -> None:
    first = (np.array([0.0, 2 * 0.802 / np.sqrt(3)]), 0)
    rates = [rate.max() for _, _, rate in partners(first, 2, -1, Contact(0.17), points=60)]
    assert max(rates) == pytest.approx(0.045, abs=5e-4)


@pytest.mark.parametrize(
    ("branch", "sign"), [(2, -1), *(pytest.param(*each, marks=pytest.mark.more) for each in ((0, 1), (1, 1), (1, -1)))]
)
def test_the_lines_of_the_map_are_phase_matched(branch: int, sign: int) -> None:
    first, contact = (np.array([0.55, 0.9]), 0), Contact(0.17)
    found = list(partners(first, branch, sign, contact, points=120))
    assert found
    for target, line, rates in found:
        gaps = pair_of(first, (line, branch), sign, contact).detunings[:, target]
        assert np.quantile(np.abs(gaps), 0.9) < 2e-3  # the square of the spacing, times a curvature of 1/4
        assert np.isfinite(rates).all()


@pytest.mark.usefixtures("drawn_once")
def test_the_map_is_drawn_for_any_wave(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mixing_map, "POINTS", 20)
    target = tmp_path / "mixing.png"
    mixing_map.main(["-o", str(target), "--mode", "L", "--direction", "17", "--poisson-ratio", "-0.5"])
    assert target.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--poisson-ratio", "0.7"], r"poisson_ratio = 0\.7 is outside \[-1, 0\.5\]"),
        (["--wavenumber", "0"], r"wavenumber is 0\.0; allowed: above 0"),
        (["--mode", "T"], "name is 'T'; allowed: L, TR, RT"),
    ],
)
def test_the_map_refuses_what_is_no_wave(arguments: list[str], said: str) -> None:
    with pytest.raises(SystemExit, match=said):
        mixing_map.main(arguments)
