"""Reflection and transmission along y at rows that differ from the lattice: every mode, exact in the linear lattice.

Rows n = 0 … N−1 (`granular_analysis.theory.rows`) have C spheres each. The motion X_n = (u, v, φ) of all spheres of a
row, φ = Rθ, in proportion to e^{−iΩt}, satisfies

    K_{n,n−1} X_{n−1} + (K_{nn} − Ω² M_n) X_n + K_{n,n+1} X_{n+1} = 0,    K_{n+1,n} = K_{n,n+1}ᵀ

The first two rows belong to a perfect lattice that continues in front, the last two to a perfect lattice behind. In
each lattice, with the wave number k_x = 2πm/W across the width W of a row, the solutions are X_n = s λⁿ with

    [K₋ + λ(K₀ − Ω²M) + λ²K₊] s = 0,    J = −Im(λ s†K₊s)

J is the energy flux towards +n, up to the factor Ω/2. Waves that leave towards +n have |λ| < 1, or |λ| = 1 and J > 0;
their number equals the number of freedoms. Elimination from the last row backward gives X_{n+1} = T_n X_n; the equation
of the first row then relates the leaving waves to the incident wave. There is no approximation: the leaving waves
include the evanescent ones.

**Results** are shares of the incident flux. Waves of diffraction order m = 0 have the names L, TR and RT of the perfect
lattice; the others are called "order +1" and so on. A plane of equal rows does not scatter into m ≠ 0.

**A heavy row.** L waves of the perfect lattice are waves of a chain, so one row of mass 1 + ε transmits the share
T = 1/(1 + ε² tan²(ξ/2)).

When it breaks: at the edge of a band, where incident waves stand (refused), and where two waves have the same λ.
Dashpots are left out. Not in the paper.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from granular_analysis.theory.rows import Rows, plane_wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating]
NAMES = ("L", "TR", "RT")
_FINITE = 1e-30  # least 1/|λ|; it replaces 0 for a wave that is confined to one row
_RUNS = 1e-6  # largest ||λ| − 1| of a running wave; rounding leaves 1e-8 next to the edge of a band
_LEAST_FLUX = 1e-6  # least flux of a running wave, as a share of the stiffness; a wave with less stands


@dataclass(frozen=True)
class Scattering:
    """Shares of the incident energy flux in each wave that runs at this frequency.

    Attributes
    ----------
    wavenumber : of the incident wave, rad per row; negative if its crests run against its energy.
    transmitted, reflected : share of the flux by name of the wave.
    """

    wavenumber: float
    transmitted: dict[str, float]
    reflected: dict[str, float]

    @property
    def balance(self) -> float:
        """Sum of all shares, which is 1 up to rounding."""
        return sum(self.transmitted.values()) + sum(self.reflected.values())


def scattering(rows: Rows, frequency: float, name: str) -> Scattering:
    """Return the transmitted and reflected shares of a wave that arrives from in front of the rows.

    Parameters
    ----------
    rows : Rows
        Use `rows.reversed` for a wave that arrives from behind.
    frequency : Ω, in the unit of the rows: rad/t0 for `heavy_rows`.
    name : "L", "TR" or "RT".

    Raises
    ------
    ValueError
        For an unknown name, and for a frequency that is not positive, at which no or more than one such wave runs in
        front, or that is at the edge of a band.
    """
    still, front, behind, incident = _incoming(rows, frequency, name)
    steps = []  # X_{n+1} = T_n X_n, from the last row backward
    for number in range(len(rows.ahead) - 1, -1, -1):
        steps.append(-np.linalg.solve(still[number + 1], rows.ahead[number].T))
        still[number] = still[number] + rows.ahead[number] @ steps[-1]
    first = np.linalg.solve(still[0], front.pull @ incident.here - incident.push)
    last = first
    for step in reversed(steps):
        last = step @ last
    return Scattering(
        incident.wavenumber,
        behind.shares(last, incident.flux),
        front.shares(first - incident.here, incident.flux),
    )


def changes_by_mass(rows: Rows, frequency: float, name: str) -> Floats:
    """Return the derivatives (N,) of the transmitted share by the logarithm of the mass of each row.

    Arguments and errors are those of `scattering`. The lattices in front and behind stay unchanged: the derivatives by
    the first and last rows, which also belong to these lattices, are for a change of that single row.
    """
    still, front, behind, incident = _incoming(rows, frequency, name)
    ends = np.cumsum([0, *map(len, rows.mass)])
    whole = np.zeros((ends[-1], ends[-1]), dtype=complex)
    for n, block in enumerate(still):
        whole[ends[n] : ends[n + 1], ends[n] : ends[n + 1]] = block
    for n, onward in enumerate(rows.ahead):
        whole[ends[n] : ends[n + 1], ends[n + 1] : ends[n + 2]] = onward
        whole[ends[n + 1] : ends[n + 2], ends[n] : ends[n + 1]] = onward.T
    source = np.zeros(ends[-1], dtype=complex)
    source[: ends[1]] = front.pull @ incident.here - incident.push
    motion = np.linalg.solve(whole, source)
    result = np.zeros(len(rows.mass))
    for _, flux, amplitude in behind.leaving:
        outgoing = np.zeros(ends[-1], dtype=complex)
        outgoing[ends[-2] :] = amplitude
        pushed = np.linalg.solve(whole.T, outgoing) * frequency**2 * np.concatenate(rows.mass) * motion
        here = (amplitude @ motion[ends[-2] :]).conj()
        result += 2 * flux / incident.flux * np.real(here * np.add.reduceat(pushed, ends[:-1]))
    return result


def _incoming(rows: Rows, frequency: float, name: str) -> tuple[list[Complexes], "_Side", "_Side", "Running"]:
    """Return the diagonal blocks of the rows, the lattices in front and behind, and the incident wave."""
    if name not in NAMES:
        raise ValueError(f"name = {name!r}: must be one of {', '.join(NAMES)}")
    if not 0 < frequency < np.inf:
        raise ValueError(f"frequency = {frequency!r}: must be positive and finite")
    front, behind = _Side.of(rows, frequency), _Side.of(rows.reversed, frequency)
    named = [wave for wave in front.coming if wave.name == name]
    if len(named) != 1:
        there = ", ".join(wave.name for wave in front.coming) or "none"
        raise ValueError(f"frequency = {frequency:.6g}: must have one wave {name} in front; there are: {there}")
    still: list[Complexes] = [
        stiffness - np.diag(frequency**2 * mass) + 0j for stiffness, mass in zip(rows.on_site, rows.mass, strict=True)
    ]
    still[0] = still[0] + front.pull
    still[-1] = still[-1] + behind.pull
    return still, front, behind, named[0]


def running(rows: Rows, frequency: float) -> dict[str, "Running"]:
    """Return those of the waves L, TR and RT that run to the rows from in front at a frequency, by name.

    The waves that leave behind the rows are the mirror images of `running(rows.reversed, frequency)`.
    """
    return {wave.name: wave for wave in _Side.of(rows, frequency).coming if wave.name in NAMES}


@dataclass(frozen=True, eq=False)
class Running:
    """Wave that runs to row 0 from rows n < 0.

    Attributes
    ----------
    name : name of the wave.
    wavenumber : rad per row; negative if its crests run against its energy.
    flux : J.
    here : (3C,) X₀.
    push : (3C,) K₋X₋₁.
    """

    name: str
    wavenumber: float
    flux: float
    here: Complexes
    push: Complexes


@dataclass(frozen=True, eq=False)
class _Side:
    """Perfect lattice in front of row 0, at one frequency.

    Attributes
    ----------
    coming : waves that run to row 0.
    pull : (3C, 3C) K₋T, where X₋₁ = T X₀ in leaving waves.
    leaving : name and flux of each leaving wave, and the row vector that gives its amplitude from X₀.
    """

    coming: tuple[Running, ...]
    pull: Complexes
    leaving: tuple[tuple[str, float, Complexes], ...]

    @classmethod
    def of(cls, rows: Rows, frequency: float) -> "_Side":
        places, mass = rows.places[0], rows.mass[0][:3]
        coming, leaving, pull = [], [], np.zeros(rows.on_site[0].shape, dtype=complex)
        for order in range(-((len(places) - 1) // 2), len(places) // 2 + 1):
            here, next_one = (plane_wave(each, order) for each in rows.places[:2])
            on_site = here.conj().T @ rows.on_site[0] @ here
            ahead = here.conj().T @ rows.ahead[0] @ next_one
            factor, shape, flux = lattice_waves(mass, on_site, ahead, frequency)
            names = [_name(mass, on_site, ahead, frequency, order, *wave) for wave in zip(factor, shape.T, strict=True)]
            for each in np.flatnonzero(flux[:3]):
                push = here @ (ahead.conj().T @ shape[:, each] / factor[each])
                angle = float(np.angle(factor[each]))
                coming.append(Running(names[each], angle, float(flux[each]), here @ shape[:, each], push))
            amplitudes = np.linalg.inv(shape[:, 3:])
            pull += here @ ahead.conj().T @ (shape[:, 3:] / factor[3:]) @ amplitudes @ here.conj().T
            for each in np.flatnonzero(flux[3:]):
                leaving.append((names[3 + each], float(-flux[3 + each]), amplitudes[each] @ here.conj().T))
        return cls(tuple(coming), pull, tuple(leaving))

    def shares(self, motion: Complexes, incident: float) -> dict[str, float]:
        """Return the flux of each leaving wave over the incident flux, from the motion of row 0 in leaving waves."""
        found: dict[str, float] = {}
        for name, flux, amplitude in self.leaving:
            found[name] = found.get(name, 0.0) + flux * float(np.abs(amplitude @ motion) ** 2) / incident
        return dict(sorted(found.items()))


def lattice_waves(
    mass: Floats, on_site: Complexes, ahead: Complexes, frequency: float
) -> tuple[Complexes, Complexes, Floats]:
    """Return λ (2F,), s (F, 2F) and J (2F,) of the waves in a lattice of F freedoms, waves leaving to +n first.

    Raises ValueError at the edge of a band.
    """
    count = len(mass)
    still, one, none = on_site - np.diag(frequency**2 * mass), np.eye(count), np.zeros((count, count))
    pencil = np.block([[none, one], [-ahead.conj().T, -still]]), np.block([[one, none], [none, ahead]])
    (above, below), vectors = eig(*pencil, homogeneous_eigvals=True)
    # λ is 0 or ∞ for a freedom on which no contact between rows acts, as in a chain
    factor = above / np.where(np.abs(below) > _FINITE * np.abs(above), below, _FINITE * np.abs(above))
    grows = np.abs(factor) > 1
    shape = np.where(grows, vectors[count:], vectors[:count])
    shape /= np.linalg.norm(shape, axis=0)
    runs = np.abs(np.abs(factor) - 1) < _RUNS
    flux = np.where(runs, -np.imag(np.sum(shape.conj() * (ahead @ shape), axis=0) * np.where(runs, factor, 0)), 0.0)
    onward = np.where(runs, flux > 0, ~grows)
    if np.any(runs & (np.abs(flux) < _LEAST_FLUX * np.abs(ahead).max())) or np.count_nonzero(onward) != count:
        raise ValueError(f"frequency = {frequency:.6g} is at the edge of a band, where a wave carries no energy")
    order = np.argsort(~onward, kind="stable")
    return factor[order], shape[:, order], flux[order]


def _name(
    mass: Floats, on_site: Complexes, ahead: Complexes, frequency: float, order: int, factor: complex, shape: Complexes
) -> str:
    """Return the name of a wave: L moves along y; TR is the lower and RT the upper of the others."""
    if order:
        return f"order {order:+d}"
    if abs(shape[1]) ** 2 > 0.5:
        return "L"
    phase = factor / abs(factor)
    matrix = on_site + ahead * phase + ahead.conj().T / phase
    across = np.ix_([0, 2], [0, 2])
    root = np.sqrt(mass[[0, 2]])
    frequencies = np.sqrt(np.abs(np.linalg.eigvalsh(matrix[across] / (root[:, None] * root))))
    return NAMES[1 + int(np.argmin(np.abs(frequencies - frequency)))]
