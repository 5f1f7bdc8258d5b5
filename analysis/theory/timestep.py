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
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.second_harmonic import refuse_oblique
from analysis.theory.contact import Contact
from analysis.theory.lattice import accelerations, integrate, longest_step, on_torus, rhs, touching
from analysis.theory.neighbours import Neighbours, torus_neighbours
from analysis.theory.wave import Wave

Floats = NDArray[np.float64]

SAMPLE, RECORDS = 0.5, 240
TAU = SAMPLE * np.arange(RECORDS + 1)


@dataclass(frozen=True)
class _Contacts(Contact):
    """The contacts of several waves, alike but for κ, each of which holds for as many points of the last axis."""

    kappas: tuple[float, ...] = ()
    points: int = 1

    @cached_property
    def kappa(self) -> Floats:  # type: ignore[override]  # κ of each point
        return np.repeat(self.kappas, self.points)


def stepped(
    waves: Sequence[Wave], per_sample: int, *, sample: float = SAMPLE, records: int = RECORDS, points: int = 25
) -> Floats:
    """p, q, φ in D0 of the row n = 0 of each wave, (waves, records + 1, 3), with `per_sample` steps to a sample.

    Parameters
    ----------
    waves : along y and of phase 0, in contacts with η > 0 and without restitution, which differ in ν at most; they are
        stepped side by side.
    per_sample : steps to a sample.
    sample, records : τ between records, and their number after the first.
    points : K of the torus, odd; see `analysis.theory.lattice.torus_trajectory`.

    Raises ValueError for other waves and contacts. Not finite beyond the stability limit of the step.
    """
    if paper := [wave for wave in waves if not wave.contact.overlap_ratio]:
        raise ValueError(f"overlap_ratio = {paper[0].contact.overlap_ratio} must be above 0: LAMMPS steps the slip")
    state, contact, neighbours = _side_by_side(waves, points)
    step = sample / per_sample
    record = np.empty((records + 1, 3, len(waves)))
    record[0] = state[:3, ::points]
    with np.errstate(over="ignore", invalid="ignore"):
        acceleration = accelerations(state, touching(state, contact, neighbours), contact, neighbours)
        for index in range(1, records + 1):
            for _ in range(per_sample):
                state[3:6] += step / 2 * acceleration
                state[:3] += step * state[3:6]
                now = touching(state, contact, neighbours)  # the slip is no part of it
                if contact.has_history:  # which without shear it has not
                    state[6:] += step * now.shear_rate(contact)
                acceleration = accelerations(state, now, contact, neighbours)
                state[3:6] += step / 2 * acceleration
            record[index] = state[:3, ::points]
    return np.transpose(record / [wave.amplitude for wave in waves], (2, 0, 1))


def _side_by_side(waves: Sequence[Wave], points: int) -> tuple[Floats, Contact, Neighbours]:
    """Return the states of waves on tori that lie one after the other in the last axis, with what `rhs` needs of them.

    Raises ValueError unless they run along y with phase 0, in contacts without restitution that differ in ν at most.
    """
    for wave in waves:
        refuse_oblique(wave.mode)
        if wave.phase:
            raise ValueError(f"phase = {wave.phase} must be 0 of waves that are integrated side by side")
        if wave.contact.restitution is not None:
            raise ValueError(
                f"restitution = {wave.contact.restitution} must be None of waves side by side: its dashpot depends on ν"
            )
    alike = {replace(wave.contact, poisson_ratio=0.0) for wave in waves}
    if len(alike) != 1:
        raise ValueError(f"{len(alike)} kinds of contact: waves that are integrated side by side may differ in ν only")
    contact = _Contacts(**asdict(waves[0].contact), kappas=tuple(wave.contact.kappa for wave in waves), points=points)
    state = np.concatenate([on_torus(wave, points)[0] for wave in waves], axis=-1)
    return state, contact, _neighbours([wave.mode.wavenumber for wave in waves], points)


def _neighbours(wavenumbers: Sequence[float], points: int) -> Neighbours:
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


def limit(waves: Sequence[Wave], tau: ArrayLike = TAU, rtol: float = 1e-10) -> Floats:
    """p, q, φ in D0 of the row n = 0 of each wave, (waves, T, 3), for the step → 0: the exact lattice to about 50 rtol.

    The waves run along y with phase 0, in contacts without restitution that differ in ν at most. They are integrated
    side by side, with the steps that the fastest needs. Raises ValueError for others.
    """
    points = 25
    state, contact, neighbours = _side_by_side(waves, points)
    amplitudes = np.array([wave.amplitude for wave in waves])
    # The error is a mean over all numbers: one wave's is larger by the root of their number at most
    share, longest = rtol / np.sqrt(len(waves)), min(longest_step(wave.contact) for wave in waves)
    states = integrate(lambda y: rhs(y, contact, neighbours), state, tau, share, amplitudes.min(), longest)
    return np.moveaxis(states[:, :3, ::points] / amplitudes, 2, 0)


def extrapolated(coarse: Floats, fine: Floats) -> Floats:
    """(4·fine − coarse)/3 of two runs, the second with half the step."""
    return (4 * fine - coarse) / 3


def phase_error(frequency: float, step: ArrayLike, duration: float) -> tuple[Floats, Floats]:
    """Leading error of a wave over a run of that duration: of single runs with the steps, of pairs (step, step/2)."""
    turned = (frequency * np.asarray(step, dtype=float)) ** 2
    single = turned / 24 * frequency * duration / np.sqrt(3)
    return single, np.hypot(6 / np.sqrt(5) * (single / 4) ** 2, 9 / 80 * turned * single / 4)
