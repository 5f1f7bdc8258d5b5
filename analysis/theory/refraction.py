"""A plane solitary wave in a hexagonal sheet of spheres that just touch, and what an interface makes of it.

**The sheet is a chain.** A front along y, across the rows, moves all spheres of a row alike. Each touches two of the
next row at 30° from y, and two of its own row that it does not press. Rows are therefore the spheres of a chain with

    A_rows = 2 cos(30°)^{5/2} A,   V = (√3/2) · 0.9074701 (A_rows/m)^{2/5} v^{1/5}   in diameters

and the exact wave of `analysis.theory.solitary`. Fronts of other directions have speeds of their own, which differ by
some percent: the sheet is not isotropic for them.

**The law of angles.** Beyond a straight interface spheres have the mass M in place of 1. Fronts keep their trace along
it, so that with the speeds V of an isotropic sheet

    sin θ_t / sin θ_i = V_t/V_i = M^{-2/5} (v_t/v_i)^{1/5},   sin θ_r / sin θ_i = (v_r/v_i)^{1/5}

between the ways of the fronts and the normal of the interface.

**Quasi-particles.** The energy of a wave is that of a particle of some spheres' mass with the velocity v. At normal
incidence the particles 1 and M collide elastically: v_t = 2/(1 + M), v_r = (M − 1)/(M + 1) of v_i, and energy passes by
the share 4M/(1 + M)². Heavy spheres before light ones, M < 1, follow the wave and send others after it; then there is
no v_r. At an angle we let the same share pass, into a front that is narrower by cos θ_t / cos θ_i:

    M v_t² cos θ_t = 4M/(1 + M)² v_i² cos θ_i,   v_r² cos θ_r = (M − 1)²/(M + 1)² v_i² cos θ_i

Published: A. M. Tichler, L. R. Gomez, N. Upadhyaya, X. Campman, V. F. Nesterenko & V. Vitelli, Phys. Rev. Lett. 111,
048001 (2013), arXiv:1303.5890. Its abstract was read: particles of an effective mass that keep energy and momentum, and
the law of angles below a critical one. Its own extension to angles was not, so that the last line above is ours.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from analysis.theory.solitary import solitary_wave

ROWS = 2 * 0.75**1.25  # A of a chain of rows
LIGHTEST, HEAVIEST = 0.1, 10.0  # M
_TIP = float(np.arctan(np.sqrt(10.0)))  # θ where sin^{10} θ cos θ is largest


@dataclass(frozen=True)
class Refracted:
    """Fronts after an interface.

    Attributes
    ----------
    transmitted, reflected : angles θ_t and θ_r, degrees from the normal; θ_r is nan where nothing is reflected.
    height, height_back : v_t/v_i and v_r/v_i.
    """

    transmitted: float
    reflected: float
    height: float
    height_back: float


def front_speed(height: float, mass: float = 1.0) -> float:
    """Return the speed of a plane front along y, diameters per unit of time.

    Parameters
    ----------
    height : largest velocity of a sphere, with A = 1.
    mass : m of a sphere.

    Raises ValueError unless both are positive.
    """
    if not min(height, mass) > 0:
        raise ValueError(f"height and mass must be positive, not {height:g} and {mass:g}")
    wave = solitary_wave(1.0)
    return float(np.sqrt(0.75) * (ROWS / mass) ** 0.4 * height**0.2 * wave.speed / wave.largest_velocity**0.2)


def angle(incidence: float, mass: float, height: float) -> float:
    """Return the angle by the law of angles, degrees, of a front in spheres of mass M; nan beyond the critical angle.

    Parameters
    ----------
    incidence : θ_i, degrees.
    mass : M; 1 for a reflected front.
    height : v_t/v_i, or v_r/v_i.
    """
    sine = np.sin(np.radians(incidence)) * mass**-0.4 * height**0.2
    return float(np.degrees(np.arcsin(sine))) if sine <= 1 else np.nan


def quasi_particle(mass: float, incidence: float = 0.0) -> Refracted:
    """Return the fronts by the rule of quasi-particles and the law of angles.

    Parameters
    ----------
    mass : M of a sphere beyond the interface, over that of one before, from 0.1 to 10.
    incidence : θ_i, degrees, at least 0 and below 90.

    Raises ValueError for other values, and beyond the critical angle.
    """
    if not LIGHTEST <= mass <= HEAVIEST:
        raise ValueError(f"mass must be from {LIGHTEST} to {HEAVIEST:g}, not {mass:g}")
    if not 0 <= incidence < 90:
        raise ValueError(f"incidence must be at least 0 and below 90 degrees, not {incidence:g}")
    first = _front(mass, incidence, 4 / (1 + mass) ** 2)
    if mass <= 1:
        return Refracted(first[0], np.nan, first[1], 0.0)
    second = _front(1.0, incidence, ((mass - 1) / (mass + 1)) ** 2)
    return Refracted(first[0], second[0], first[1], second[1])


def _front(mass: float, incidence: float, share: float) -> tuple[float, float]:
    """Return θ, degrees, and v/v_i of the front with sin θ/sin θ_i = M^{-2/5} v^{1/5}, v² cos θ = share cos θ_i."""
    start = np.radians(incidence)
    if incidence == 0:
        return 0.0, float(np.sqrt(share))
    # With v from the first equation, the second is sin^{10} θ cos θ = this
    target = share * np.cos(start) * np.sin(start) ** 10 * mass**-4.0
    if target > np.sin(_TIP) ** 10 * np.cos(_TIP):
        raise ValueError(f"an incidence of {incidence:g} degrees is beyond the critical angle of the mass {mass:g}")
    found = float(brentq(lambda theta: np.sin(theta) ** 10 * np.cos(theta) - target, 0.0, _TIP, xtol=1e-14))
    return float(np.degrees(found)), float((np.sin(found) / np.sin(start)) ** 5 * mass**2)
