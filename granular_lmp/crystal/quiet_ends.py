"""Quiet ends: layers of rows that absorb a wave, and their reflection in the linear lattice.

Rows n = 1 … L in front of a held row lose velocity and spin at the rate

    γ_n t0/m = c_n = c (n/L)^p

which grows from nearly 0, so the wave enters without an echo. All modes decay with the rate c_n/2 in row n, because
spin is damped like velocity. A viscous layer is used because a perfectly matched layer would amplify waves whose crests
run against their energy, such as RT.

**The step.** At the end of a step h, between the two halves of the kick, v becomes v (1 − c_n h/2)/(1 + c_n h/2). This
is a drag on the mean velocity over two steps,

    M (X₊ − 2X + X₋)/h² + c_n M (X₊ − X₋)/2h = −K X

of second order in h, and stable whenever the lattice without drag is stable, |Ω| h < 2. It needs no force, so positions
and velocities suffice to set up a run. A wave with the frequency Ω in the lattice has the frequency (2/h) asin(Ωh/2) in
the run, and the drag of row n in the run is −iΩc_n √(1 − (Ωh/2)²).

**Reflection.** In a wave along y all spheres of a row move alike. With X_n = (u, v, φ) of row n and time e^{−iΩτ},

    K₋ X_{n−1} + (K₀ − ΩM(Ω + i c_n √(1 − (Ωh/2)²))) X_n + K₊ X_{n+1} = 0,    X_{L+1} = 0

where K₀ + K₊e^{iξ} + K₋e^{−iξ} is the Bloch matrix. Elimination from the held row backward gives X_{n+1} = T_n X_n. In
front of the layer, the incident mode and the waves that leave the layer solve the quadratic eigenproblem of the perfect
lattice. The reflection is the square root of the returning energy flux, in all modes, over the incident flux. It is
exact for small amplitudes.
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
# Relative imaginary part of the frequency: it distinguishes leaving from incoming waves, and changes r by as much
_LEAVING = 1e-7


@dataclass(frozen=True)
class QuietEnd:
    """Layer of damped rows in front of a held row.

    Attributes
    ----------
    rows : int
        Thickness L.
    strength : float
        Largest damping rate c, in 1/t0.
    power : float
        Exponent p of the profile.
    reflection : float
        Largest |r| over the waves and at the time step for which the layer was designed.
    """

    rows: int
    strength: float
    power: float
    reflection: float

    def rates(self) -> NDArray[np.float64]:
        """Damping rates c_n of rows 1 … L, from the inside to the held row, in 1/t0."""
        return self.strength * (np.arange(1, self.rows + 1) / self.rows) ** self.power


def frequency_in_run(frequency: float, step: float) -> float:
    """Return the frequency of a lattice wave in velocity Verlet with the step h, (2/h) asin(Ωh/2)."""
    return 2 / step * asin(frequency * step / 2) if step else frequency


def frequency_in_lattice(frequency: float, step: float) -> float:
    """Return the frequency (2/h) sin(Ωh/2) of the lattice wave whose frequency in a run with the step h is Ω."""
    return 2 / step * sin(frequency * step / 2) if step else frequency


def reflection(
    lattice: Contacts, sphere: Sphere, mode: Mode, end: QuietEnd, physics: Physics = FULL, step: float = 0.0
) -> float:
    """Return |r| of a layer for a mode along y: the square root of the reflected over the incident energy flux.

    Parameters
    ----------
    lattice, sphere : Contacts, Sphere
        Contacts of a lattice with one sphere per cell, and its sphere.
    mode : Mode
        Incident wave, along y; its crests may run away from the layer, as in RT.
    end : QuietEnd
        The layer.
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
    beyond: Complexes = np.zeros_like(line.on_site)  # T of the row before the held row, for each layer
    for rate in rates.T[::-1, :, None, None]:
        beyond = -np.linalg.solve(line.on_site - (frequency + 1j * rate) * inertia + line.ahead @ beyond, line.behind)
    still = line.on_site - frequency * inertia
    # Waves s λⁿ of the perfect lattice that leave to −n: they grow with n
    factor, shape = waves(line, still)
    leave = np.argsort(-np.abs(factor))[: len(still)]
    shape, step = shape[:, leave], factor[leave]
    # Row 0 is the last undamped row; X₋₁ and X₀ are sums of the incident and the leaving waves
    incident = mode.shape()[0, physics.coordinates]
    incident = incident / np.sqrt(np.sum(line.mass * np.abs(incident) ** 2))
    before = incident * np.exp(-1j * mode.vector.per_row)
    if flux(line, before, incident) > 0:  # the energy runs away from the layer: take the time-reversed wave, −ξ
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
        Largest allowed |r|. Good values: 1e-2 to 1e-4; half the reflection takes a few more rows.
    rows : int, optional
        Given thickness, for which the best strength and power are returned.

    Returns
    -------
    QuietEnd
        Its `reflection` may exceed `wanted` if the rows are given.

    Raises
    ------
    ValueError
        If `MOST_ROWS` are not enough, for example for waves near the edge of a band, which hardly propagate.
    """
    line = line_of(lattice, sphere, physics)
    if rows is not None:
        return _best(line, modes, rows, physics)
    most = 4
    while (end := _best(line, modes, most, physics)).reflection > wanted:
        most *= 2
        if most > MOST_ROWS:
            raise ValueError(
                f"reflection = {wanted!r}: needs more than {MOST_ROWS} rows for these waves; allow a larger reflection"
            )
    fewest = most // 2
    while most - fewest > max(1, most // 20):  # to within 5 % of the rows
        middle = (most + fewest) // 2
        tried = _best(line, modes, middle, physics)
        most, fewest, end = (middle, fewest, tried) if tried.reflection <= wanted else (most, middle, end)
    return end


def _best(line: Line, modes: Sequence[Mode], rows: int, physics: Physics) -> QuietEnd:
    """Return the layer of a given thickness whose largest reflection over the modes is least."""
    tried = [QuietEnd(rows, strength, power, 0.0) for power in POWERS for strength in _strengths()]
    rates = np.array([end.rates() for end in tried])
    worst = np.max([_reflections(line, mode, rates, physics) for mode in modes], axis=0)
    least = int(np.argmin(worst))
    return replace(tried[least], reflection=float(worst[least]))


def _strengths() -> Iterator[float]:
    """Yield strengths over the range in which layers absorb, in steps of 20 %."""
    for step in range(24):
        yield 0.05 * 1.2**step
