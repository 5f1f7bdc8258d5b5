"""What the time step does: the exact lattice stepped with velocity Verlet, as LAMMPS steps it, without LAMMPS.

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
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.second_harmonic import ModeName, mode, ratios
from analysis.theory.lattice import (
    Floats,
    Neighbours,
    contact,
    initial_state,
    rhs,
    torus,
    torus_neighbours,
    torus_phases,
)

Wave = tuple[ModeName, float, float, float]  # mode, ξ, a = D0/Δ0, ν


OVERLAP_RATIO = 2.4985144e-4  # Δ0/2R of the paper's spheres


SAMPLE, RECORDS = 0.5, 240


TAU = SAMPLE * np.arange(RECORDS + 1)


def stepped(
    waves: Sequence[Wave],
    per_sample: int,
    *,
    sample: float = SAMPLE,
    records: int = RECORDS,
    overlap_ratio: float = OVERLAP_RATIO,
    points: int = 25,
) -> NDArray[np.float64]:
    """p, q, φ in D0 of the row n = 0 of each wave, (waves, records + 1, 3), with `per_sample` steps to a sample.

    Parameters
    ----------
    waves : (mode, ξ, a, ν) of each; they are stepped side by side.
    per_sample : steps to a sample.
    sample, records : τ between records, and their number after the first.
    overlap_ratio : η > 0.
    points : K of the torus, odd; see `analysis.theory.lattice.torus_trajectory`.

    Not finite beyond the stability limit of the step.
    """
    states, kappas = [], []
    for name, wavenumber, amplitude, poisson_ratio in waves:
        law = contact(poisson_ratio, overlap_ratio=overlap_ratio)
        start = mode(name, wavenumber, ratios(poisson_ratio, overlap_ratio=overlap_ratio))
        neighbours = torus_neighbours(wavenumber, points)
        states.append(initial_state(start, amplitude, torus_phases(points), law, neighbours))
        kappas.append(np.full(points, law.kappa))
    state = np.concatenate(states, axis=-1)
    laws = replace(law, kappa=np.concatenate(kappas))  # type: ignore[arg-type]  # κ of each point
    side_by_side = _side_by_side([wavenumber for _, wavenumber, _, _ in waves], points)
    step = sample / per_sample

    record = np.empty((records + 1, 3, len(waves)))
    record[0] = state[:3, ::points]
    with np.errstate(over="ignore", invalid="ignore"):
        acceleration = rhs(state, laws, side_by_side)[3:6]
        for index in range(1, records + 1):
            for _ in range(per_sample):
                state[3:6] += step / 2 * acceleration
                state[:3] += step * state[3:6]
                state[6:] += step * rhs(state, laws, side_by_side)[6:]
                acceleration = rhs(state, laws, side_by_side)[3:6]
                state[3:6] += step / 2 * acceleration
            record[index] = state[:3, ::points]
    return np.transpose(record / [amplitude for _, _, amplitude, _ in waves], (2, 0, 1))


def _side_by_side(wavenumbers: Sequence[float], points: int) -> Neighbours:
    """The neighbours of several tori, one after the other in the last axis."""
    waves, tori = len(wavenumbers), [torus_neighbours(xi, points) for xi in wavenumbers]
    forward = np.stack([torus.ahead(np.eye(points)) for torus in tori])  # (waves, 3, K, K)
    back = np.ascontiguousarray(forward.swapaxes(2, 3))

    def ahead(values: Floats) -> Floats:
        apart = values.reshape(-1, 1, waves, points).transpose(2, 1, 0, 3) @ forward  # (waves, 3, C, K)
        return apart.transpose(1, 2, 0, 3).reshape(3, *values.shape)

    def behind(values: Floats) -> Floats:
        apart = values.reshape(3, -1, waves, points).transpose(2, 0, 1, 3) @ back
        return apart.sum(axis=1).swapaxes(0, 1).reshape(values.shape[1:])

    return Neighbours(tori[0].normal, ahead, behind)


def limit(
    wave: Wave, tau: ArrayLike = TAU, overlap_ratio: float = OVERLAP_RATIO, rtol: float = 1e-10
) -> NDArray[np.float64]:
    """p, q, φ in D0 of the row n = 0, (T, 3), for the step → 0: the exact lattice, to about 50 rtol."""
    name, wavenumber, amplitude, poisson_ratio = wave
    start = mode(name, wavenumber, ratios(poisson_ratio, overlap_ratio=overlap_ratio))
    record = torus(start, amplitude, tau, poisson_ratio, overlap_ratio=overlap_ratio, points=25, rtol=rtol)
    return np.stack(record, axis=-1)


def extrapolated(coarse: Floats, fine: Floats) -> Floats:
    """(4·fine − coarse)/3 of two runs, the second with half the step."""
    return (4 * fine - coarse) / 3


def phase_error(frequency: float, step: ArrayLike, duration: float) -> tuple[Floats, Floats]:
    """Leading error of a wave over a run of that duration: of single runs with the steps, of pairs (step, step/2)."""
    turned = (frequency * np.asarray(step, dtype=float)) ** 2
    single = turned / 24 * frequency * duration / np.sqrt(3)
    return single, np.hypot(6 / np.sqrt(5) * (single / 4) ** 2, 9 / 80 * turned * single / 4)
