"""Long times at the resonance, where small errors grow, and the antiresonance, where there is hardly a signal."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from analysis import lattice
from analysis.norms import relative_error
from analysis.second_harmonic import mode
from granular_lmp import run
from granular_lmp.accuracy import halved_step, richardson
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import running
from tests.hard.ledger import keep
from tests.hard.waves import ETA, NU, RATIOS, amplitude, exact, phases, scene

LOOK = 5.0  # τ between two looks at the amplitudes, a tenth of the time in which they change


def at_the_resonance(cycles: int, rows: int, step: float, duration: float, edits: Edits = ()) -> Cases:
    """TR and L amplitudes against the exact lattice, and the energy ledger."""
    wave = scene("TR", cycles, rows, 0.2, step, duration)
    transverse, longitudinal = mode("TR", wave.wavenumber, RATIOS), mode("L", 2 * wave.wavenumber, RATIOS)
    states, books = [], []
    with running(wave, edits) as cell:
        states.append(cell.rows())
        books = keep(cell, duration, round(LOOK / step), look=lambda: states.append(cell.rows()))
    reference = exact(wave, books.tau, rtol=1e-9)
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
                "Verlet shifts 2Ω − w̃ by (2Ω³ − w̃³)Δτ²/24 = −0.031Δτ²: at most 0.023 rad at the end, of a wave of size 1",
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


def blow_up(edits: Edits = ()) -> Cases:
    """When the first contact opens: the exact solution of the secant law grows without bound, and so must LAMMPS."""
    wave = scene("TR", 39, 166, 0.2, 0.0125, 2600)
    tau = np.arange(1500.0, 2600.0)
    neighbours = lattice.torus_neighbours(wave.wavenumber, 31)
    places = exact(wave, tau, rtol=1e-9)[:, :2]
    stretch = [lattice.stretch_and_normal(*(neighbours[0](place) - place), ETA)[0].max() for place in places]
    expected = float(tau[np.argmax(np.array(stretch) >= 1)])
    with running(wave, edits) as cell:
        found = 0.0
        while found < 2600 and (found == 0 or len(cell.contacts().overlap) == 3 * cell.spheres):
            cell.advance(80)
            found += 1.0
    return [
        Case(
            f"first open contact, τ, exact lattice {expected:g}",
            "the model itself blows up: no integrator can prevent it, and none may hide it",
            found,
            "2 % of amplitude at τ = 1500 over its growth 0.003/τ (E grows 1.44 → 26.9 in τ = 1600 … 2100) is 7",
            least=expected - 7,
            most=expected + 7,
        )
    ]


def at_the_antiresonance(overlap_ratio: float = ETA) -> Cases:
    """p of 3e-5 D0 beside q of 1 D0, a Richardson pair against the exact lattice."""
    coarse = scene("TR", 40, 118, 0.2, 0.05, 120)
    with TemporaryDirectory() as folder:
        pair = [run(each, Path(folder) / str(i)) for i, each in enumerate((coarse, halved_step(coarse)))]
    record = richardson(*pair)
    wave = mode("TR", coarse.wavenumber, RATIOS)
    p, _, _ = lattice.torus(wave, 0.2, record.tau, NU, overlap_ratio=overlap_ratio)
    size = float(np.abs(p).max())
    return [
        Case(
            f"p, ξ = {coarse.wavenumber:.4f}, {size:.1g} D0 at most, relative L2",
            "p is of order a⁴, and the contact geometry, of relative order Δ0/2R, moves it by a fifth",
            relative_error(record.p, p),
            "required; Δτ⁴ is left of the step, 1e-16·y·√steps of rounding",
            most=0.01,
        ),
    ]
