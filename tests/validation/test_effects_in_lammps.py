"""LAMMPS held by compression, damped, or without shear, against the exact lattice with the same physics."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from granular_analysis import second_harmonic as sh
from granular_analysis.measure.norms import relative_error
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from granular_lmp.crystal.sphere import Sphere
from tests.conftest import run_text
from tests.manual import Measure, Mutant, verifies

DECK = Path(__file__).parents[2] / "lammps_inputs/in.plane_wave"
DMT = "dmt ${young} 0.0 ${poisson} $(v_adhesion/2:%.17g)"
MINDLIN = "tangential mindlin NULL 0.0 $(5*v_amp:%.17g) damping velocity"
# Hertz contacts slide four times as soon as those of DMT, whose sliding force counts adhesion twice.
DAMPED = MINDLIN.replace("NULL 0.0 $(5", "NULL 1.0 $(20")
VISCOSITY, RESTITUTION = 0.01, 0.95
AMPLITUDE, PHASE, XI = 0.1, 0.3, 0.802

HERTZ = "hertz/material ${young} 0.0 ${poisson}"
DASHPOT = f"$({VISCOSITY}*v_m/v_t0:%.17g)"

# Lines that are replaced in the deck, the work of adhesion in mJ/m² that sets the static overlap (in the Hertz lattices
# the fixed rows press it in), and the same in the lattice. 6300 makes η 5e-3.
CASES = {
    "viscous": ({DMT: DMT.replace("0.0", DASHPOT), MINDLIN: DAMPED}, 63.0, {"viscosity": VISCOSITY}),
    "compressed": ({DMT: HERTZ, MINDLIN: DAMPED.replace("NULL 1.0", "NULL 0.0")}, 6300.0, {"prestress": 1.0}),
    "restitution": (
        {DMT: HERTZ.replace("0.0", str(RESTITUTION)), MINDLIN: DAMPED.replace("velocity", "coeff_restitution")},
        6300.0,
        {"prestress": 1.0, "restitution": RESTITUTION},
    ),
    "without shear": (
        {DMT: DMT.replace("0.0", DASHPOT), MINDLIN: "tangential linear_nohistory 0.0 0.0 damping velocity"},
        63.0,
        {"shear": False, "viscosity": VISCOSITY},
    ),
    "without rotation": (
        {"equal v_f0/v_norm": "equal 0.0", "nve/sphere update dipole": "nve"},
        63.0,
        {"rotation": False},
    ),
}
Lammps = Callable[[str, float], tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def lammps(tmp_path_factory: pytest.TempPathFactory) -> Lammps:
    """τ and p, q, φ (3, T) of in.plane_wave with the laws of a case and a time step."""
    folder = tmp_path_factory.mktemp("lammps")

    @cache
    def run(case: str, step: float) -> tuple[np.ndarray, np.ndarray]:
        replacements, adhesion, _ = CASES[case]
        text = DECK.read_text()
        for old, new in replacements.items():
            assert text.count(old) == 1
            text = text.replace(old, new)
        # The walls of 51 rows are heard after τ = 30
        values = {"xi": XI, "timestep": step, "phase": PHASE, "amp": AMPLITUDE, "adhesion": adhesion}
        values |= {"duration": 30, "rows": 51}
        # As -var sets them, before the deck's own
        given = "".join(f"variable {name} index {value}\n" for name, value in values.items())
        run_text(given + text, folder / "run")
        tau, *displacements = np.loadtxt(folder / "run/trajectory.csv", delimiter=",", skiprows=1).T
        return tau, np.stack(displacements)

    return run


def extrapolated(lammps: Lammps, case: str) -> tuple[np.ndarray, np.ndarray]:
    """Free of errors of first and second order in the time step: damping forces lag behind by half a step."""
    (tau, coarse), (_, middle), (_, fine) = (lammps(case, step) for step in (0.1, 0.05, 0.025))
    return tau, (coarse - 6 * middle + 8 * fine) / 3


def of_lattice(case: str, tau: np.ndarray, **changes: float | bool) -> np.ndarray:
    """The same by the exact lattice; the deck starts every case with the mode of adhesive spheres, but for the spin."""
    _, adhesion, effects = CASES[case]
    eta = Sphere(5e-7, 73e9, 0.17, adhesion * 1e-3, 2200.0).overlap_ratio
    mode = sh.mode("TR", XI, sh.ratios(0.17, overlap_ratio=eta))
    effects = {**effects, **changes}
    if case == "without rotation":
        mode = replace(mode, f=0.0)
    # The mode of other contacts is no `Wave` of these: the state that it starts is integrated itself
    contact, phases = Contact(0.17, overlap_ratio=eta, **effects), lattice.torus_phases(21)
    neighbours = lattice.torus_neighbours(XI, 21)
    start = lattice.initial_state(mode, AMPLITUDE, phases, contact, neighbours)
    states = lattice.motion(start, contact, neighbours, tau, 1e-9, AMPLITUDE)[:, :3]
    return (states @ lattice.periodic_kernel(PHASE - phases, 21)).T / AMPLITUDE


@pytest.mark.parametrize("case", CASES)
@verifies(
    "Hertz, incremental law, dashpots, no shear, no rotation in LAMMPS: p, extrapolated in the step",
    reference="other integrator: the exact lattice with the same physics",
    tolerance=2e-05,
    reason="the rest is of third order in the time step, 1e-5 at most",
    mutant=Mutant(
        "analysis/granular_analysis/theory/loops.c", "resists = t->dashpot *", "resists = 1.01 * t->dashpot *"
    ),
)
def test_lammps_meets_the_lattice_with_the_same_physics(case: str, lammps: Lammps, measured: Measure) -> None:
    tau, run = extrapolated(lammps, case)
    exact = of_lattice(case, tau)
    # The rest is of third order in the time step: measured 4e-6, 1e-7, 1e-7 at most.
    measured(relative_error(run[0], exact[0]))
    assert relative_error(run[1], exact[1]) < 3e-7
    if case == "without rotation":
        assert np.all(run[2] == 0)
    else:
        assert relative_error(run[2], exact[2]) < 3e-7


@pytest.mark.parametrize(
    ("case", "wrong"),
    [
        ("viscous", {"viscosity": 1.01 * VISCOSITY}),
        ("compressed", {"prestress": 0.99}),
        ("restitution", {"restitution": RESTITUTION + 0.0005}),
        ("without shear", {"viscosity": 1.01 * VISCOSITY}),
        ("without rotation", {"rotation": True}),
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
