"""The effect of the time step: the exact lattice stepped with velocity Verlet, as LAMMPS steps it, without LAMMPS.

LAMMPS (fix nve/sphere, pair_style granular) makes of x'' = F(x, t), where the slip t of a contact is a state too,

    v += ½h F(x, t);   x += h v;   t += h ṫ(x, v);   v += ½h F(x, t)

and so does `stepped`, on the phase torus and with LAMMPS's contact geometry. It is LAMMPS to the rounding of the
positions: 1e-10 of q, 1e-7 of p at a = 0.2. Only the rate of the slip is not centred: it takes the directions of the
contacts at the end of the step, which leaves an error of first order in h in p, of the order of h Δ0/R.

The leading error is of phase. A wave of frequency Ω runs (Ωh)²/24 too fast, and a pair (h, h/2) leaves the square of
the finer run's phase error and the next order of its frequency; over a run, in the L2 norm,

    single run   e = (Ωh)²Ωτ/(24√3)              pair   E² = (2.68 e₂²)² + (0.113 (Ωh)² e₂)²,  e₂ = e/4
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.second_harmonic import refuse_oblique
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.lattice import accelerations, initial_state, torus_trajectory, touching
from granular_analysis.theory.lattice_loop import torus_slope
from granular_analysis.theory.neighbours import Neighbours, torus_neighbours, torus_phases
from granular_analysis.theory.wave import Wave

Floats = NDArray[np.float64]

SAMPLE, RECORDS = 0.5, 240
TAU = SAMPLE * np.arange(RECORDS + 1)


def stepped(waves: Sequence[Wave], per_sample: int, *, records: int = RECORDS, points: int = 25) -> Floats:
    """p, q, φ in D0 of the row n = 0 of each wave, (waves, records + 1, 3), with `per_sample` steps to a sample.

    Parameters
    ----------
    waves : along y and of phase 0, in contacts with η > 0.
    per_sample : steps to a sample of `SAMPLE` τ.
    records : their number after the first.
    points : K of the torus, odd; see `granular_analysis.theory.lattice.torus_trajectory`.

    Raises ValueError for other waves and contacts. Not finite beyond the stability limit of the step.
    """
    if paper := [wave for wave in waves if not wave.contact.overlap_ratio]:
        raise ValueError(f"overlap_ratio = {paper[0].contact.overlap_ratio} must be above 0: LAMMPS steps the slip")
    return np.stack([_stepped(wave, per_sample, SAMPLE / per_sample, records, points) for wave in waves])


def on_torus(wave: Wave, points: int) -> tuple[Floats, Neighbours]:
    """Return the state of a wave at τ=0 on the phase torus of K points, and its neighbours there."""
    neighbours = torus_neighbours(wave.mode.wavenumber, points, wave.mode.direction)
    return initial_state(wave.mode, wave.amplitude, torus_phases(points), wave.contact, neighbours), neighbours


def _stepped(wave: Wave, per_sample: int, step: float, records: int, points: int) -> Floats:
    """Return p, q, φ (records + 1, 3) of one wave of `stepped`."""
    _refuse(wave)
    state, neighbours = on_torus(wave, points)
    slope = torus_slope(state, wave.contact, neighbours)
    record = np.empty((records + 1, 3))
    record[0] = state[:3, 0]
    with np.errstate(over="ignore", invalid="ignore"):
        for index in range(1, records + 1):
            if slope is None:
                verlet(state, wave.contact, neighbours, step, per_sample)
            else:
                slope.stepped(state, step, per_sample)
            record[index] = state[:3, 0]
    return record / wave.amplitude


def verlet(state: Floats, contact: Contact, neighbours: Neighbours, step: float, count: int) -> None:
    """Make steps in a state (6 or 9, K): the equations at the top of this module."""
    places, speeds, slip = state[:3], state[3:6], state[6:]
    acceleration = accelerations(state, touching(state, contact, neighbours), contact, neighbours)
    for _ in range(count):
        speeds += step / 2 * acceleration
        places += step * speeds
        now = touching(state, contact, neighbours)  # the slip is no part of it
        if contact.has_history:  # which without shear it has not
            slip += step * now.shear_rate(contact)
        acceleration = accelerations(state, now, contact, neighbours)
        speeds += step / 2 * acceleration


def _refuse(wave: Wave) -> None:
    """Raise ValueError for a wave whose row n = 0 is no point of its torus."""
    refuse_oblique(wave.mode)
    if wave.phase:
        raise ValueError(f"phase = {wave.phase} must be 0 of a wave that is stepped")


def limit(waves: Sequence[Wave], tau: ArrayLike = TAU) -> Floats:
    """p, q, φ in D0 of the row n = 0 of each wave, (waves, T, 3), for the step → 0: the exact lattice to about 5e-9.

    The waves run along y with phase 0. Raises ValueError for others.
    """
    for wave in waves:
        _refuse(wave)
    return np.stack([torus_trajectory(wave, tau, points=25, rtol=1e-10)[..., 0] for wave in waves])


def extrapolated(coarse: Floats, fine: Floats) -> Floats:
    """(4·fine − coarse)/3 of two runs, the second with half the step."""
    return (4 * fine - coarse) / 3


def phase_error(frequency: float, step: ArrayLike, duration: float) -> tuple[Floats, Floats]:
    """Leading error of a wave over a run of that duration: of single runs with the steps, of pairs (step, step/2)."""
    turned = (frequency * np.asarray(step, dtype=float)) ** 2
    single = turned / 24 * frequency * duration / np.sqrt(3)
    return single, np.hypot(6 / np.sqrt(5) * (single / 4) ** 2, 9 / 80 * turned * single / 4)
