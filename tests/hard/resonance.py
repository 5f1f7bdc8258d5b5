"""Long times at the resonance, where small errors grow, and the antiresonance, where there is hardly a signal."""

from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.integrate import solve_ivp

from granular_analysis.measure.norms import relative_error
from granular_analysis.second_harmonic import mode
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from granular_lmp import Record, Scene, run
from granular_lmp.accuracy.estimates import richardson
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import Floats, running
from tests.hard.ledger import keep
from tests.hard.waves import ETA, NU, RATIOS, amplitude, exact, phases, scene

LOOK = 5.0  # τ between two looks at the amplitudes, a tenth of the time in which they change


def at_the_resonance(cycles: int, rows: int, step: float, duration: float, stride: int = 1, edits: Edits = ()) -> Cases:
    """TR and L amplitudes against the exact lattice, and the energy ledger."""
    wave = scene("TR", cycles, rows, 0.2, step, duration)
    transverse, longitudinal = mode("TR", wave.wavenumber, RATIOS), mode("L", 2 * wave.wavenumber, RATIOS)
    states = []
    with running(wave, edits) as cell:
        states.append(cell.rows())
        books = keep(cell, duration, round(LOOK / (stride * step)), stride, lambda: states.append(cell.rows()))
    reference = exact(wave, books.tau, rtol=1e-7)  # an error of 5e-6 beside 2 % of 0.1
    where = f"ξ = {wave.wavenumber:.4f}, a = 0.2, τ ≤ {duration:g}"
    cases = []
    for name, order, each in (("TR", 1, transverse), ("L", 2, longitudinal)):
        truth = amplitude(reference, lattice.torus_phases(31), order, each)
        error = np.abs(amplitude(np.array(states), phases(wave), order, each) - truth)
        cases.append(
            Case(
                f"{name} amplitude, {where}",
                "the exchange of energy between TR and L is a phase of the slow detuning, which the time step shifts",
                float(error.max() / truth.max()),
                "required. Verlet shifts 2Ω − w̃ by (2Ω³ − w̃³)Δτ²/24 = −0.031Δτ², by the end "
                f"{0.031 * step**2 * duration:.1g} rad of phase; how far the amplitude follows is not known",
                most=0.02,
            )
        )
    cases.append(
        Case(
            f"energy less the works, {where}",
            "the secant law has no potential: a third of the energy goes, and comes back",
            float(np.abs(books.gap).max()),
            "the ledger closes to second order in the step; required",
            most=1e-4,
        )
    )
    return cases


def blow_up(cycles: int, rows: int, size: float, step: float, end: float, edits: Edits = ()) -> Cases:
    """When the first contact opens: the exact solution of the secant law grows without bound, and so must LAMMPS.

    Where it does: in the exact lattice with LAMMPS's geometry, a = 0.2, at ξ = 1.4746, τ = 2302; not at 1.4756 before
    2600, nor at 1.4784 before 3000. In a run folder the guard `open_contacts` says so.
    """
    wave = scene("TR", cycles, rows, size, step, end)
    expected = opening_time(wave)
    look = max(round(0.002 * expected / step), 1)  # a tenth of the bound
    found = inf
    with running(wave, edits) as cell:
        for steps in range(look, wave.time.steps + 1, look):
            cell.advance(look)
            if len(cell.contacts().overlap) < 3 * cell.spheres:
                found = steps * wave.time.step
                break
    return [
        Case(
            f"τ at which a contact opens, ξ = {wave.wavenumber:.4f}, a = {size:g} (exact lattice: {expected:.4g})",
            "the exact solution opens it: no integrator can prevent it, and none may hide it",
            found,
            "required: 2 % of the time, as of the amplitudes",
            least=0.98 * expected,
            most=1.02 * expected,
        )
    ]


def opening_time(wave: Scene) -> float:
    """τ at which the first contact of the exact lattice opens, in LAMMPS's geometry (`energy` has the paper's).

    Raises
    ------
    IndexError
        When none does within the duration.
    """
    contact = Contact(NU, overlap_ratio=ETA)
    neighbours = lattice.torus_neighbours(wave.wavenumber, 31)
    start = lattice.initial_state(
        mode("TR", wave.wavenumber, RATIOS), wave.wave.amplitude, lattice.torus_phases(31), contact, neighbours
    )

    def closed(_: float, y: Floats) -> float:
        return float(1 - np.max(lattice.touching(y.reshape(start.shape), contact, neighbours).stretch))

    closed.terminal = True
    solution = solve_ivp(
        lambda _, y: lattice.rhs(y.reshape(start.shape), contact, neighbours).ravel(),
        (0.0, wave.time.duration),
        start.ravel(),
        method="DOP853",
        rtol=1e-6,  # moves the time by 1e-6 of it, beside bounds of 2 %
        atol=1e-7,
        max_step=lattice.longest_step(contact),
        events=closed,
    )
    return float(solution.t_events[0][0])


def _pair(duration: float) -> Record:
    """Return a Richardson pair at the antiresonance."""
    coarse = scene("TR", 40, 118, 0.2, 0.05, duration)
    halved = coarse.with_values({"time.timestep": coarse.time.step / 2})
    with TemporaryDirectory() as folder:
        return richardson(*(run(each, Path(folder) / str(i)) for i, each in enumerate((coarse, halved))))


def at_the_antiresonance(overlap_ratio: float = ETA, duration: float = 120.0) -> Cases:
    """p of 3e-5 D0 beside q of 1 D0, a Richardson pair against the exact lattice."""
    record = _pair(duration)
    wave = Wave.of_mode("TR", record.scene.wavenumber, 0.2, Contact(NU, overlap_ratio=overlap_ratio))
    p, _, _ = lattice.torus(wave, record.tau)
    size = float(np.abs(p).max())
    return [
        Case(
            f"p, ξ = {record.scene.wavenumber:.4f}, {size:.1g} D0 at most, relative L2",
            "p is of order a⁴, and the contact geometry, of relative order Δ0/2R, moves it by a fifth",
            relative_error(record.p, p),
            "required; Δτ⁴ is left of the step, 1e-16·y·√steps of rounding",
            most=0.01,
        ),
    ]
