"""The effect of the time step: the exact lattice stepped with velocity Verlet, as LAMMPS steps it, without LAMMPS.

LAMMPS (fix nve/sphere, pair_style granular) makes of x'' = F(x, t), where the slip t of a contact is a state too,

    v += ½h F(x, t);   x += h v;   t += h ṫ(x, v);   v += ½h F(x, t)

and so does `stepped`, on the phase torus and with LAMMPS's contact geometry. It is LAMMPS to the rounding of the
positions: 1e-10 of q, 1e-7 of p at a = 0.2. Only the rate of the slip is not centred: it takes the directions of the
contacts at the end of the step, which leaves an error of first order in h in p, of the order of h Δ0/R.

The leading error is of phase. A wave of frequency Ω runs (Ωh)²/24 too fast, and a pair (h, h/2) leaves the square of
the finer run's phase error and the next order of its frequency; over a run, in the L2 norm,

    single run   e = (Ωh)²Ωτ/(24√3)              pair   E² = (2.68 e₂²)² + (0.113 (Ωh)² e₂)²,  e₂ = e/4

The second harmonic is one oscillator, so it needs no lattice to be stepped (`stepped_second_harmonic`).
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.second_harmonic import refuse_oblique
from analysis.theory.contact import Contact
from analysis.theory.lattice import accelerations, integrate, longest_step, on_torus, rhs, touching
from analysis.theory.neighbours import Neighbours, at_ends, torus_neighbours, torus_shifts
from analysis.theory.wave import Wave

Floats = NDArray[np.float64]

SAMPLE, RECORDS = 0.5, 240
TAU = SAMPLE * np.arange(RECORDS + 1)


@dataclass(frozen=True)
class _Contacts(Contact):
    """The contacts of several waves, alike but for κ, for states (waves, 9, K)."""

    kappas: tuple[float, ...] = ()

    @cached_property
    def kappa(self) -> Floats:  # type: ignore[override]  # κ of each wave
        return np.array(self.kappas)[:, None, None]


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
    places, speeds, slip = state[:, :3], state[:, 3:6], state[:, 6:]
    record = np.empty((records + 1, len(waves), 3))
    record[0] = places[..., 0]
    with np.errstate(over="ignore", invalid="ignore"):
        acceleration = accelerations(state, touching(state, contact, neighbours), contact, neighbours)
        for index in range(1, records + 1):
            for _ in range(per_sample):
                speeds += step / 2 * acceleration
                places += step * speeds
                now = touching(state, contact, neighbours)  # the slip is no part of it
                if contact.has_history:  # which without shear it has not
                    slip += step * now.shear_rate(contact)
                acceleration = accelerations(state, now, contact, neighbours)
                speeds += step / 2 * acceleration
            record[index] = places[..., 0]
    return np.moveaxis(record, 1, 0) / _amplitudes(waves)


def stepped_second_harmonic(wave: Wave, tau: Floats, step: float) -> Floats:
    """p of the second harmonic in D0 at τ, (T,), as steps of `step` make it; `second_harmonic` for the step → 0.

        p_{n+1} − 2p_n + p_{n−1} = h²[Re(F f_n²) − w̃² p_n],   f = e^{i phase}(cos Ω_hτ − ir sin Ω_hτ)

    with sin(Ω_h h/2) = Ωh/2 and the force F on the free waves. The start has the velocity of the exact wave,
    r = Ωh/sin(Ω_h h) times that of one of Ω_h that runs one way; what it leaves in the contacts pushes steadily. The
    incremental law adds up its force with the stiffness at the end of each step, half a step late: its shear's part of
    F then has a share of Ωh/2 in quadrature, less what that is at the start. By the secant law F is larger by just
    that.

    Parameters
    ----------
    wave : along y, in contacts without dashpots.
    tau : times, multiples of the step.
    step : h in τ.
    """
    refuse_oblique(wave.mode)
    frequency, free = wave.mode.frequency, wave.free_frequency
    force, left = _forces(wave)
    angle = 2 * np.arcsin(frequency * step / 2)
    turns = angle * np.arange(round(tau[-1] / step) + 1)
    started = np.cos(turns) - 1j * frequency * step / np.sin(angle) * np.sin(turns)
    drive = np.real(force * started**2)
    if wave.contact.incremental:
        secant, _ = _forces(replace(wave, contact=replace(wave.contact, law="secant")))
        late = (secant - force) * frequency * step / 2
        drive += np.imag(late * (np.exp(-2j * turns) - 1))
    drive[0] /= 2
    turn = 2 * np.arcsin(free * step / 2)
    p = _leapfrog(drive, turn) * step**2
    slower = turn / (free * step) * tau
    return p[np.rint(tau / step).astype(int)] + left.real * slower**2 / 2 * np.sinc(free * slower / (2 * np.pi)) ** 2


def _leapfrog(drive: Floats, turn: float) -> Floats:
    """Return x_n of x_{n+1} − 2 x_n cos θ + x_{n−1} = drive_n, x_0 = x_{−1} = 0: Σ_m drive_m sin((n−m)θ)/sin θ."""
    wheel = np.exp(1j * turn * np.arange(len(drive)))
    return np.asarray((wheel * np.cumsum(drive / wheel)).imag / np.sin(turn))


def _forces(wave: Wave) -> tuple[complex, complex]:
    """Return the forces in D0 and t0 on the free waves of the second harmonic that run with 2ϑ, and that stay."""
    running, left, _ = wave.doubled.shares
    direction = wave.framed(wave.doubled.targets.shapes)[wave.longitudinal, 0]
    scale = 0.5 * wave.amplitude * np.exp(2j * wave.phase) * direction
    return complex(scale * running[wave.longitudinal]), complex(scale * left[wave.longitudinal])


def _amplitudes(waves: Sequence[Wave]) -> Floats:
    """Return D0/Δ0 of each wave, (waves, 1, 1)."""
    return np.array([wave.amplitude for wave in waves])[:, None, None]


def _side_by_side(waves: Sequence[Wave], points: int) -> tuple[Floats, Contact, Neighbours]:
    """Return the states (waves, 9, K) of waves on tori, with what `rhs` needs of them.

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
    contact = _Contacts(**asdict(waves[0].contact), kappas=tuple(wave.contact.kappa for wave in waves))
    state = np.stack([on_torus(wave, points)[0] for wave in waves])
    wavenumbers = [wave.mode.wavenumber for wave in waves]
    if len(waves) == 1:
        return state, contact, torus_neighbours(wavenumbers[0], points)
    return state, contact, at_ends(np.stack([torus_shifts(each, points) for each in wavenumbers]))


def limit(waves: Sequence[Wave], tau: ArrayLike = TAU, rtol: float = 1e-10) -> Floats:
    """p, q, φ in D0 of the row n = 0 of each wave, (waves, T, 3), for the step → 0: the exact lattice to about 50 rtol.

    The waves run along y with phase 0, in contacts without restitution that differ in ν at most. They are integrated
    side by side, with the steps that the fastest needs. Raises ValueError for others.
    """
    state, contact, neighbours = _side_by_side(waves, points=25)
    amplitudes = _amplitudes(waves)
    # The error is a mean over all numbers: one wave's is larger by the root of their number at most
    share, longest = rtol / np.sqrt(len(waves)), min(longest_step(wave.contact) for wave in waves)
    states = integrate(lambda y: rhs(y, contact, neighbours), state, tau, share, amplitudes.min(), longest)
    return np.moveaxis(states[:, :, :3, 0], 1, 0) / amplitudes


def extrapolated(coarse: Floats, fine: Floats) -> Floats:
    """(4·fine − coarse)/3 of two runs, the second with half the step."""
    return (4 * fine - coarse) / 3


def phase_error(frequency: float, step: ArrayLike, duration: float) -> tuple[Floats, Floats]:
    """Leading error of a wave over a run of that duration: of single runs with the steps, of pairs (step, step/2)."""
    turned = (frequency * np.asarray(step, dtype=float)) ** 2
    single = turned / 24 * frequency * duration / np.sqrt(3)
    return single, np.hypot(6 / np.sqrt(5) * (single / 4) ** 2, 9 / 80 * turned * single / 4)
