"""Quiet ends: rows that absorb a wave, with the reflection of a layer from the linear lattice.

Rows n = 1 … L in front of a held row lose velocity and spin at the rate

    γ_n t0/m = c_n = c (n/L)^p

which grows from nothing, so that the wave enters without an echo. All modes decay with the rate c_n/2 in row n, because
spin is damped like velocity. Matched, Bloch modes or not: a perfectly matched layer would amplify waves whose crests
run against their energy, as those of RT do, and a viscous one does not.

**The step.** At the end of a step h, between the two halves of the kick, v becomes v (1 − c_n h/2)/(1 + c_n h/2). This
is a drag on the mean velocity over two steps,

    M (X₊ − 2X + X₋)/h² + c_n M (X₊ − X₋)/2h = −K X

of second order in h, and stable wherever the lattice without drag is, |Ω| h < 2. It needs no force, so that a run is
set up from positions and velocities alone. A wave of the lattice whose frequency is Ω has the frequency
(2/h) asin(Ωh/2) in the run, and there the drag of row n is −iΩc_n √(1 − (Ωh/2)²).

**Reflection.** In a wave along y all spheres of a row move alike. With X_n = (u, v, φ) of row n and time e^{−iΩτ},

    K₋ X_{n−1} + (K₀ − ΩM(Ω + i c_n √(1 − (Ωh/2)²))) X_n + K₊ X_{n+1} = 0,    X_{L+1} = 0

where K₀ + K₊e^{iξ} + K₋e^{−iξ} is the Bloch matrix. From the held row backward X_{n+1} = T_n X_n; in front of the layer
the incident mode and those that leave it solve the quadratic eigenproblem of the perfect lattice. The reflection is the
root of the energy flux that comes back, in all modes, over the incident one: exact for small amplitudes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import asin, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.mode import FULL, Mode, Physics
from granular_lmp.crystal.row_waves import Complexes, Line, flux, line_of, waves
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.frozen import dataclass

POWERS = (2.0, 3.0, 4.0)
MOST_ROWS = 2000
# Imaginary part of the frequency, relative: it tells waves that leave from those that come, and costs that much of r
_LEAVING = 1e-7


@dataclass(frozen=True)
class QuietEnd:
    """A layer of damped rows in front of a held row.

    Attributes
    ----------
    rows : int
        Thickness L.
    strength : float
        Largest damping rate c, in 1/t0.
    power : float
        Exponent p of the profile.
    reflection : float
        Largest |r| over the waves that it was made for, at the time step that it was judged for.
    """

    rows: int
    strength: float
    power: float
    reflection: float

    def rates(self) -> NDArray[np.float64]:
        """Damping rates c_n of rows 1 … L, from the inside to the held row, in 1/t0."""
        return self.strength * (np.arange(1, self.rows + 1) / self.rows) ** self.power


def frequency_in_run(frequency: float, step: float) -> float:
    """Return the frequency that a wave of the lattice has in velocity Verlet with a step, (2/h) asin(Ωh/2)."""
    return 2 / step * asin(frequency * step / 2) if step else frequency


def frequency_in_lattice(frequency: float, step: float) -> float:
    """Return the frequency of the wave of the lattice that has this one in a run, (2/h) sin(Ωh/2)."""
    return 2 / step * sin(frequency * step / 2) if step else frequency


def reflection(
    lattice: Contacts, sphere: Sphere, mode: Mode, end: QuietEnd, physics: Physics = FULL, step: float = 0.0
) -> float:
    """Return |r| of a layer for a mode along y, the root of the reflected over the incident energy flux.

    Parameters
    ----------
    lattice, sphere : Contacts, Sphere
        Contacts of a lattice of one sphere a cell, and its sphere.
    mode : Mode
        Incident wave, along y; its crests may run away from the layer, as those of RT do.
    end : QuietEnd
    physics : Physics
        Degrees of freedom.
    step : float
        Time step of the run in τ; 0 for the lattice itself.

    Raises
    ------
    ValueError
        If the mode does not run along y, or oscillates too fast for the step, Ωh ≥ 2.
    """
    half = mode.frequency * step / 2
    if half >= 1:
        raise ValueError(f"step = {step!r}: must be below {2 / mode.frequency:.6g}, 2/Omega of the wave")
    rates = end.rates()[None] * sqrt(1 - half**2)
    return float(_reflections(line_of(lattice, sphere, physics), mode, rates, physics)[0])


def _reflections(line: Line, mode: Mode, rates: NDArray[np.float64], physics: Physics) -> NDArray[np.float64]:
    """Return |r| of layers of the same rows, (E,), from their damping rates (E, L)."""
    if mode.vector.axis != "y":
        raise ValueError(f"mode along {mode.vector.direction:g} degrees: quiet ends are for waves along y")
    frequency = mode.frequency * (1 + 1j * _LEAVING)
    inertia = frequency * np.diag(line.mass)
    beyond: Complexes = np.zeros_like(line.on_site)  # T of the row before the held one, of each layer
    for rate in rates.T[::-1, :, None, None]:
        beyond = -np.linalg.solve(line.on_site - (frequency + 1j * rate) * inertia + line.ahead @ beyond, line.behind)
    still = line.on_site - frequency * inertia
    # Waves s λⁿ of the perfect lattice that leave to the rows behind: they grow with n
    factor, shape = waves(line, still)
    leave = np.argsort(-np.abs(factor))[: len(still)]
    shape, step = shape[:, leave], factor[leave]
    # Row 0 is the last perfect one; X₋₁ and X₀ are those of the incident and of the leaving waves
    incident = mode.shape()[0, physics.coordinates]
    incident = incident / np.sqrt(np.sum(line.mass * np.abs(incident) ** 2))
    before = incident * np.exp(-1j * mode.vector.per_row)
    if flux(line, before, incident) > 0:  # its energy runs the other way: take the wave of −ξ, the time reversal
        incident, before = incident.conj(), before.conj()
    onward = still + line.ahead @ beyond
    away = line.behind @ (shape / step) + onward @ shape
    amplitude = np.linalg.solve(away, -(line.behind @ before + onward @ incident)[..., None])[..., 0]
    returning = np.abs(flux(line, amplitude @ (shape / step).T, amplitude @ shape.T))
    found: NDArray[np.float64] = np.sqrt(returning / np.abs(flux(line, before, incident)))
    return found


# --- the choice of a layer -------------------------------------------------------------------------------------------


def quiet_end(
    lattice: Contacts,
    sphere: Sphere,
    modes: Sequence[Mode],
    wanted: float,
    rows: int | None = None,
    physics: Physics = FULL,
) -> QuietEnd:
    """Return the layer with the fewest rows that reflects at most a share of the amplitude of each mode.

    Parameters
    ----------
    lattice, sphere, physics
        As for `reflection`.
    modes : sequence of Mode
        Waves along y that reach the layer.
    wanted : float
        Largest |r|. Good values: 1e-2 to 1e-4; half as much takes a few rows more.
    rows : int, optional
        Thickness, if it is given; strength and power are then the best for it.

    Returns
    -------
    QuietEnd
        Its `reflection` may exceed `wanted` if the rows are given.

    Raises
    ------
    ValueError
        If `MOST_ROWS` are not enough, as for waves near the edge of a band, which hardly move.
    """
    line = line_of(lattice, sphere, physics)
    if rows is not None:
        return _best(line, modes, rows, physics)
    most = 4
    while (end := _best(line, modes, most, physics)).reflection > wanted:
        most *= 2
        if most > MOST_ROWS:
            raise ValueError(f"reflection = {wanted!r}: needs more than {MOST_ROWS} rows for these waves; ask for more")
    fewest = most // 2
    while most - fewest > max(1, most // 20):  # to a row in twenty
        middle = (most + fewest) // 2
        tried = _best(line, modes, middle, physics)
        most, fewest, end = (middle, fewest, tried) if tried.reflection <= wanted else (most, middle, end)
    return end


def _best(line: Line, modes: Sequence[Mode], rows: int, physics: Physics) -> QuietEnd:
    """Return the layer of a thickness whose largest reflection is least."""
    tried = [QuietEnd(rows, strength, power, 0.0) for power in POWERS for strength in _strengths()]
    rates = np.array([end.rates() for end in tried])
    worst = np.max([_reflections(line, mode, rates, physics) for mode in modes], axis=0)
    least = int(np.argmin(worst))
    return replace(tried[least], reflection=float(worst[least]))


def _strengths() -> Iterator[float]:
    """Yield strengths over the range in which a layer of some rows absorbs, by steps of a fifth."""
    for step in range(24):
        yield 0.05 * 1.2**step
