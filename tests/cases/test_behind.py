"""The second harmonic behind an interface: its parts are found again, and the forced one is that of the closed form."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.behind import case as behind
from cases.behind.case import Behind, Parts
from cases.rows import waves
from granular_analysis.second_harmonic import mode, ratios
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.rows import heavy_rows, rows_of
from granular_analysis.theory.transfer import running
from granular_lmp import Record, Scene, run
from tests.theory.test_transfer import SILICA, crystal

HARD = {"youngs_modulus": 219e9, "work_of_adhesion": 0.189}  # its spheres overlap as those of silica
TONE = {"rows": [26, 26], "force": "x", "signal": "tone", "ramp": 50.0}
SCENE = Scene.load("tr_burst_scattering").with_values(
    {"name": "behind", "packing.rows": 95, "wave.wavenumber": 0.802, "wave.amplitude": 0.1, "time.timestep": 0.25}
    | {"absorb.reflection": 2e-3, "time.duration": 454.0, "source": [TONE]}
    | {"inclusion": [{"rows": [54, 94], **HARD}]}
)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(SCENE, tmp_path_factory.mktemp("behind") / "run")


def test_the_forced_wave_in_front_is_that_of_the_closed_form(record: Record) -> None:
    found, _, _ = behind.measure(record)
    sphere = SCENE.sphere
    constants = ratios(sphere.poisson_ratio, overlap_ratio=sphere.overlap_ratio)
    wave = mode("TR", 0.802, constants)
    sine, kappa = np.sin(0.802), sphere.stiffness_ratio
    epsilon = -np.sqrt(3) * SCENE.wave.amplitude * (2 * kappa + 3) / (4 * (kappa + 3))
    translation = constants.alpha * np.sin(0.401) ** 2 * wave.q
    drive = sine * wave.q * (translation - constants.beta / np.sqrt(3) * sine * wave.f)
    expected = abs(epsilon / 2 * drive / (sine**2 - 4 * wave.frequency**2)) / wave.q**2
    # The time step, 6e-3 at 0.25; start and quiet ends, 5e-3
    assert abs(found.forced_before) == pytest.approx(expected, rel=0.015)
    assert found.residual < 0.03
    assert found.distance == 27.5


def some_runs(passes: complex, interface: complex) -> list[Behind]:
    before = 0.9 * np.exp(-0.43j * np.arange(12, 33, 4))
    return [
        Behind(float(12 + 4 * k), 1.0j, 0.5j, each, passes * each + interface, 0.5, 1e-3)
        for k, each in enumerate(before)
    ]


def test_what_passes_and_what_is_made_at_the_interface_are_found_again() -> None:
    runs = some_runs(0.7, 0.2 - 0.1j)
    passes, interface, left = behind.split(runs)
    assert passes == pytest.approx(0.7, abs=1e-12)  # rounding
    assert interface == pytest.approx(0.2 - 0.1j, abs=1e-12)
    assert left < 1e-12
    spoiled = [Behind(*(*vars(each).values(),)) for each in runs]
    spoiled[2] = some_runs(0.9, 0.0)[2]
    assert behind.split(spoiled)[2] > 0.02
    parts = Parts(runs, passes, 0.7, interface, left)
    assert "made at the interface: 0.22361" in behind.table(parts)
    assert behind.draw(parts).axes


def test_all_of_a_wave_passes_equal_rows_and_less_a_heavy_one() -> None:
    rows = heavy_rows(Contact(0.17), [1.0])
    assert behind.passage(rows, 0.5) == pytest.approx(1.0, abs=1e-12)  # rounding
    assert behind.passage(heavy_rows(Contact(0.17), [3.0]), 0.5) < 0.9


def test_a_long_wave_passes_an_interface_as_between_two_elastic_media() -> None:
    rows = rows_of(crystal(14, hard=slice(7, None)), 2, 11)
    frequency = 0.01 / SILICA.time_scale
    speeds = [frequency / running(each, frequency)["L"].wavenumber for each in (rows, rows.reversed)]
    # Equal densities: impedances as speeds; corrections of second order in the wave number, 0.02
    assert behind.passage(rows, frequency) == pytest.approx(2 * speeds[0] / sum(speeds), rel=1e-3)


def test_waves_in_a_row_of_places_are_found_again_and_too_few_places_refused() -> None:
    n = np.arange(5) + 0.5
    field = (0.3 - 0.2j) * np.exp(0.8j * n) + 0.1j * np.exp(-1.1j * n)
    found, left = waves(field, n, (0.8, -1.1))
    assert found == pytest.approx(np.array([0.3 - 0.2j, 0.1j]), abs=1e-12)  # rounding
    assert left < 1e-12
    assert waves(field, n, (0.8, -1.2))[1] > 0.01
    with pytest.raises(ValueError, match="2 rows: must be at least 3"):
        waves(field[:2], n[:2], (0.8, -1.1, 0.0))


def test_amplitudes_of_both_harmonics_are_read_off() -> None:
    tau = np.arange(0.0, 500.0)
    first, second = 0.3 - 0.2j, 0.01 + 0.02j
    rate = np.real(-0.3j * first * np.exp(-0.3j * tau) - 0.6j * second * np.exp(-0.6j * tau)) + 0.05
    found = behind.amplitudes(tau, rate[:, None], 0.3)
    assert found[0] == pytest.approx(np.array([first]), abs=1e-9)  # rounding
    assert found[1] == pytest.approx(np.array([second]), abs=1e-9)
    with pytest.raises(ValueError, match=r"tau = 400 at the end: must be at least 418\.879, 20 periods"):
        behind.amplitudes(tau[:401], rate[:401, None], 0.3)
    with pytest.raises(ValueError, match="samples every tau = 3: must be 4 in a period of 2Ω"):
        behind.amplitudes(tau[::3], rate[::3, None], 0.3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"source.1.force": "y"}, "must have a tone of force along x, and wave.mode = TR"),
        ({"inclusion": [{"rows": [54, 60], **HARD}]}, "must have one inclusion, of rows up to the last, 94"),
        ({"source.1.frequency": 0.55}, "TR must run at 0.55 rad per t0, and L at twice that, on both sides"),
        (
            {"source.1.hertz": 0.55 / (2 * np.pi * SCENE.sphere.time_scale)},
            "TR must run at 0.55 rad per t0, and L at twice that, on both sides",
        ),
    ],
)
def test_other_runs_are_refused(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    short = {"time.duration": 1.0, "time.sample": 0.5, "output.particles": 0.5}
    other = run(SCENE.with_values(short | changes), tmp_path / "run")
    with pytest.raises(ValueError, match=message):
        behind.measure(other)


def test_too_few_runs_and_runs_of_two_interfaces_are_refused(record: Record) -> None:
    with pytest.raises(ValueError, match="1 runs: must be at least 4"):
        behind.parts([record])
    farther = replace(record, scene=SCENE.with_values({"inclusion.1.rows": [58, 94]}))
    stiffer = replace(record, scene=SCENE.with_values({"inclusion.1.youngs_modulus": 220e9}))
    with pytest.raises(ValueError, match="2 kinds of runs: runs must differ only in the first row of the interface"):
        behind.parts([farther, farther, farther, stiffer])
