"""Gratings, driven rows, pulses and beams in LAMMPS against their theories."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.driven import case as driven
from cases.rows import load_form
from cases.sheets import case as sheets
from cases.standing import case as standing
from granular_lmp import Scene, build, run
from tests.conftest import PAPER, members
from tests.manual import Measure, Mutant, verifies

# Just long enough for four rows to be steady over five periods, before the echo of the end
LONG_DRIVEN = Scene.load("tr_driven").with_values(
    {"wave.wavenumber": 1.0, "packing.rows": 49, "time.duration": 144.0, "time.allow_echo": True}
)


@pytest.mark.parametrize(("mode", "bounds"), [("TR", (4e-4, 3e-3)), ("L", (2e-3, 7e-2))])
def test_a_grating_is_that_of_the_closed_form(mode: str, bounds: tuple[float, float], tmp_path: Path) -> None:
    # At a = 0.1. The fundamental drifts as a²τ. The second harmonic of TR is off by a² of itself; that of L, which is
    # what the linear wave leaves of p, holds third order too, a of itself
    scene = Scene.load("tr_grating").with_values({"wave.mode": mode, "time.duration": 60.0, "time.timestep": 0.025})
    record, motion = load_form(run(scene, tmp_path / "run").folder, "standing")
    errors = standing.compare(record, motion).errors()
    assert errors["q" if mode == "TR" else "p"] < bounds[0]
    assert errors["second harmonic"] < bounds[1]


@verifies(
    "Standing wave in LAMMPS: the power of a in what second order leaves, less 2",
    reference="analytic: second order of a grating in closed form",
    tolerance=0.1,
    reason="what the step leaves is 1e-4 of a second harmonic, a twentieth of the smaller error",
    mutant=Mutant(
        "analysis/granular_analysis/theory/bonds.py",
        "tangent = together - (1 - self._gathered) * grown",
        "tangent = together - 0.99 * (1 - self._gathered) * grown",
    ),
)
def test_half_the_amplitude_of_a_grating_is_a_quarter_of_the_error(tmp_path: Path, measured: Measure) -> None:
    scene = Scene.load("tr_grating").with_values({"time.duration": 24.0, "time.timestep": 0.0125})
    errors = []
    for amplitude in (0.2, 0.1):
        done = run(scene.with_values({"wave.amplitude": amplitude}), tmp_path / str(amplitude))
        errors.append(standing.compare(*load_form(done.folder, "standing")).errors()["second harmonic"])
    # 0.1: what the step leaves is 1e-4 of a second harmonic, a twentieth of the smaller error
    measured(np.log2(errors[0] / errors[1]) - 2)


@verifies(
    "Driven row in LAMMPS: the linear wave, q and φ of every steady row",
    reference="analytic: closed form of the wave that a moved row makes",
    tolerance=0.0001,
    reason="what the time step leaves at a = 0.05",
    mutant=Mutant("granular_lmp/lammps/sources.py", '({later}-{sooner})/v_step"', '0.9*({later}-{sooner})/v_step"'),
)
def test_a_driven_row_makes_the_waves_of_the_closed_form(tmp_path: Path, measured: Measure) -> None:
    found = driven.compare(*load_form(run(LONG_DRIVEN, tmp_path / "run").folder, "driven")).deviations()
    # At a = 0.05: the linear wave to what the step leaves, second order to a² of itself times numbers of order 1
    measured(max(found["q"]))
    measured(max(found["phi"]))
    assert max(found["p at 2Ω"]) < 1e-2
    assert max(found["mean p"]) < 1e-2


def test_a_row_that_moves_with_the_velocity_of_now_is_wrong_in_first_order(tmp_path: Path) -> None:
    # The deck takes pains to avoid that contacts of the row lead by half a step
    scene = LONG_DRIVEN.with_values({"time.timestep": 0.1})
    deck = build(scene)
    rise = "(30*v_s[1]^2*(1-v_s[1])^2/v_ramp*cos(v_Omega*v_tau)"
    now = f"{rise}-v_Omega*v_s[1]^3*(10-15*v_s[1]+6*v_s[1]^2)*sin(v_Omega*v_tau))"
    assert "(v_swing-v_was)/v_step" in deck.input_text
    text = deck.input_text.replace("(v_swing-v_was)/v_step", f"v_D0/v_t0*{now}")
    done = run(replace(deck, input_text=text), tmp_path / "run")
    found = driven.compare(*load_form(done.folder, "driven")).deviations()
    # The row's shear forces lead by half a step. Of the phase ½Ωh that is, some goes into the wave, by its impedance
    phase = build(scene).problem.wave.mode.frequency * scene.time.step / 2
    assert 0.3 * phase < max(found["q"]) < 3 * phase
    assert max(found["p at 2Ω"]) > phase


@pytest.mark.parametrize("changes", members([{}, {"wave.mode": "L"}], {"wave.mode": "L"}), ids=["TR", "L"])
def test_a_pulse_is_that_of_second_order_on_a_sheet(changes: dict[str, Any], tmp_path: Path) -> None:
    scene = Scene.load("tr_pulse").with_values(
        {"packing.rows": 36, "packing.columns": 32, "wave.amplitude": 0.02}
        | {"time.duration": 16.0, "output.particles": 8.0}
        | changes
    )
    found = sheets.compare(run(scene, tmp_path / "run"))
    beyond = found.beyond[1:]
    whole = sheets.relative(found.linear[1:] + found.second[1:], found.run[1:])
    # Third order is a² = 4e-4 of the field over τ, measured 2e-5 (TR) and 4e-5 (L) at τ = 40. The parts are off by
    # fourth order, a² times a number that a narrow pulse, whose parts overlap, makes 10
    assert whole < 1e-4
    for multiple, bound in ((0, 5e-3), (2, 1e-2)):
        part, theory = (found.around(each, multiple) for each in (beyond, found.second[1:]))
        assert sheets.relative(theory, part) < bound
    assert sheets.relative(-found.second[1:], beyond) > 1


def test_a_beam_displaces_the_lattice_by_more_than_its_second_harmonic(tmp_path: Path) -> None:
    # Along the wave all of it repeats with the wavelength of eight rows
    beam = {"packing.rows": 8, "packing.columns": 48, "packing.ends": "periodic", "envelope.width": 6.0}
    scene = PAPER.with_values(
        beam | {"wave.wavenumber": np.pi / 4, "wave.amplitude": 0.02, "time.duration": 24.0, "output.particles": 8.0}
    )
    found = sheets.compare(run(scene, tmp_path / "run"))
    static, harmonic = (np.sqrt(np.mean(found.around(found.beyond, multiple) ** 2)) for multiple in (0, 2))
    assert static > 3 * harmonic  # four times, says docs/waves.md
    assert sheets.relative(found.around(found.second, 0)[1:], found.around(found.beyond, 0)[1:]) < 5e-3
