"""LAMMPS held by compression, damped, or without shear, against the exact lattice with the same physics."""

import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from analysis import lattice
from analysis import second_harmonic as sh
from analysis.norms import relative_error
from granular_lmp.locate import lmp_command
from granular_lmp.sphere import Sphere

DECK = Path(__file__).parents[1] / "lammps_inputs/in.plane_wave"
DMT = "dmt ${young} 0.0 ${poisson} $(v_adhesion/2:%.17g)"
MINDLIN = "tangential mindlin NULL 0.0 $(5*v_amp:%.17g) damping velocity"
# Hertz contacts slide four times as soon as those of DMT, whose sliding force counts adhesion twice.
DAMPED = MINDLIN.replace("NULL 0.0 $(5", "NULL 1.0 $(20")
VISCOSITY, RESTITUTION = 0.01, 0.95
AMPLITUDE, PHASE, XI = 0.1, 0.3, 0.802

# What replaces the normal and the tangential law of the deck, the work of adhesion in mJ/m² that sets the static
# overlap (in the Hertz lattices the fixed rows press it in), and what that is in the lattice. 6300 makes η 5e-3.
CASES = {
    "viscous": (DMT.replace("0.0", f"$({VISCOSITY}*v_m/v_t0:%.17g)"), DAMPED, 63.0, {"viscosity": VISCOSITY}),
    "compressed": (
        "hertz/material ${young} 0.0 ${poisson}",
        DAMPED.replace("NULL 1.0", "NULL 0.0"),
        6300.0,
        {"prestress": 1.0},
    ),
    "restitution": (
        f"hertz/material ${{young}} {RESTITUTION} ${{poisson}}",
        DAMPED.replace("velocity", "coeff_restitution"),
        6300.0,
        {"prestress": 1.0, "restitution": RESTITUTION},
    ),
    "without shear": (
        DMT.replace("0.0", f"$({VISCOSITY}*v_m/v_t0:%.17g)"),
        "tangential linear_nohistory 0.0 0.0 damping velocity",
        63.0,
        {"shear": False, "viscosity": VISCOSITY},
    ),
}
Lammps = Callable[[str, float], tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def lammps(tmp_path_factory: pytest.TempPathFactory) -> Lammps:
    """τ and p, q, φ (3, T) of in.plane_wave with the laws of a case and a time step."""
    folder = tmp_path_factory.mktemp("lammps")

    @cache
    def run(case: str, step: float) -> tuple[np.ndarray, np.ndarray]:
        normal, tangential, adhesion, _ = CASES[case]
        text = DECK.read_text()
        assert text.count(DMT) == text.count(MINDLIN) == 1
        (folder / "in.wave").write_text(text.replace(DMT, normal).replace(MINDLIN, tangential))
        command = [*lmp_command(1), "-in", "in.wave", "-log", "none", "-screen", "none"]
        values = {"xi": XI, "timestep": step, "phase": PHASE, "amp": AMPLITUDE, "adhesion": adhesion, "duration": 60}
        for name, value in values.items():
            command += ["-var", name, str(value)]
        subprocess.run(command, cwd=folder, check=True, timeout=60)
        tau, *displacements = np.loadtxt(folder / "trajectory.csv", delimiter=",", skiprows=1).T
        return tau, np.stack(displacements)

    return run


def extrapolated(lammps: Lammps, case: str) -> tuple[np.ndarray, np.ndarray]:
    """Free of errors of first and second order in the time step: damping forces lag behind by half a step."""
    (tau, coarse), (_, middle), (_, fine) = (lammps(case, step) for step in (0.1, 0.05, 0.025))
    return tau, (coarse - 6 * middle + 8 * fine) / 3


def of_lattice(case: str, tau: np.ndarray, **changes: float | bool) -> np.ndarray:
    """The same by the exact lattice; the deck starts every case with the mode of adhesive spheres with shear."""
    eta = Sphere(5e-7, 73e9, 0.17, CASES[case][2] * 1e-3, 2200.0).overlap_ratio
    mode = sh.mode("TR", XI, sh.ratios(0.17, overlap_ratio=eta))
    effects = {**CASES[case][3], **changes}
    return np.stack(
        lattice.torus(mode, AMPLITUDE, tau, 0.17, phase=PHASE, overlap_ratio=eta, points=21, rtol=1e-9, **effects)
    )


@pytest.mark.parametrize("case", CASES)
def test_lammps_meets_the_lattice_with_the_same_physics(case: str, lammps: Lammps) -> None:
    tau, run = extrapolated(lammps, case)
    exact = of_lattice(case, tau)
    # Third order in the time step; p is a tenth of q and as far off.
    assert relative_error(run[0], exact[0]) < 2e-4
    assert relative_error(run[1], exact[1]) < 2e-5
    assert relative_error(run[2], exact[2]) < 2e-5


@pytest.mark.parametrize(
    ("case", "wrong"),
    [
        ("viscous", {"viscosity": 1.01 * VISCOSITY}),
        ("compressed", {"prestress": 0.99}),
        ("restitution", {"restitution": RESTITUTION + 0.0005}),
        ("without shear", {"viscosity": 1.01 * VISCOSITY}),
    ],
)
def test_physics_one_percent_off_is_seen(case: str, wrong: dict[str, float], lammps: Lammps) -> None:
    tau, run = extrapolated(lammps, case)
    assert relative_error(run[1], of_lattice(case, tau, **wrong)[1]) > 1e-4


def test_with_damping_the_error_of_the_time_step_is_of_first_order(lammps: Lammps) -> None:
    slopes = {}
    for case in ("viscous", "compressed"):
        tau, limit = extrapolated(lammps, case)
        errors = [relative_error(lammps(case, step)[1][1], limit[1]) for step in (0.05, 0.025)]
        slopes[case] = np.log2(errors[0] / errors[1])
    assert slopes["compressed"] == pytest.approx(2, abs=0.05)
    assert slopes["viscous"] < 1.5
