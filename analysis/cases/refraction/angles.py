"""Refraction of a plane solitary wave at an interface in a hexagonal sheet of spheres that just touch.

**The sheet is a chain.** A front along y, across the rows, moves all spheres of a row alike. Each sphere touches two
spheres of the next row at 30° from y, and two of its own row, which it does not press. So the rows act as the spheres
of a chain with

    A_rows = 2 cos(30°)^{5/2} A,   V = (√3/2) · 0.9074701 (A_rows/m)^{2/5} v^{1/5}   in diameters

and with the exact wave of `cases.solitary.travelling`. Fronts in other directions φ have V = C(φ) v^{1/5}, with C up to
3.5 % larger along a row of contacts (`cases.refraction.plane_front`).

**The law of angles.** Beyond a straight interface spheres have the mass M instead of 1. All fronts have the same
trace speed along the interface; with θ the angle between the direction of a front and the normal of the interface,

    sin θ_t / sin θ_i = V_t/V_i = M^{-2/5} (v_t/v_i)^{1/5} C(φ_t)/C(φ_i)
    sin θ_r / sin θ_i = V_r/V_i = (v_r/v_i)^{1/5} C(φ_r)/C(φ_i)

where v is the largest velocity along the front's own direction, and φ_i = 90°, φ_t = 90° + θ_i − θ_t,
φ_r = 270° + θ_i + θ_r from a row of contacts: the front comes across the rows, and the interface is turned by θ_i
against them.

**Quasi-particles.** A wave has the energy of a particle with velocity v and the mass of some spheres. At normal
incidence particles of masses 1 and M collide elastically: v_t = 2/(1 + M) v_i, v_r = (M − 1)/(M + 1) v_i, and the share
4M/(1 + M)² of the energy passes. Heavy spheres in front of light ones, M < 1, follow the wave and send more waves after
it; then there is no v_r. At an angle we assume that the same share passes, into a front that is narrower by
cos θ_t / cos θ_i:

    M v_t² cos θ_t = 4M/(1 + M)² v_i² cos θ_i,   v_r² cos θ_r = (M − 1)²/(M + 1)² v_i² cos θ_i

Published: A. M. Tichler, L. R. Gomez, N. Upadhyaya, X. Campman, V. F. Nesterenko & V. Vitelli, Phys. Rev. Lett. 111,
048001 (2013), arXiv:1303.5890. Its abstract was read: particles of an effective mass that conserve energy and momentum,
and the law of angles below a critical angle. The paper's extension to angles was not read, so the last line above is
our own.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from cases.refraction.plane_front import scaled_speed

ROWS = 2 * 0.75**1.25  # A of a chain of rows
LIGHTEST, HEAVIEST = 0.1, 10.0  # M


@dataclass(frozen=True)
class Refracted:
    """Fronts after an interface.

    Attributes
    ----------
    transmitted, reflected : angles θ_t and θ_r, degrees from the normal; θ_r is nan without a reflected front.
    height, height_back : v_t/v_i and v_r/v_i.
    """

    transmitted: float
    reflected: float
    height: float
    height_back: float


def faster(incidence: float, found: float, *, reflected: bool = False) -> float:
    """Return C(φ)/C(φ_i) for a front at an angle `found` from the normal; both angles in degrees."""
    direction = 270.0 + incidence + found if reflected else 90.0 + incidence - found
    return scaled_speed(direction) / scaled_speed(90.0)


def angle(incidence: float, mass: float, height: float, *, reflected: bool = False) -> float:
    """Return the angle (degrees) of a front in spheres of mass M by the law of angles; nan beyond the critical angle.

    Parameters
    ----------
    incidence : θ_i, degrees.
    mass : M; 1 for a reflected front.
    height : v_t/v_i, or v_r/v_i.
    reflected : True for a reflected front.
    """
    if incidence == 0:
        return 0.0
    alike = np.sin(np.radians(incidence)) * mass**-0.4 * height**0.2

    def beyond(found: float) -> float:
        return float(np.sin(np.radians(found)) - alike * faster(incidence, found, reflected=reflected))

    return float(brentq(beyond, 0.0, 90.0)) if beyond(90.0) > 0 else np.nan


def quasi_particle(mass: float, incidence: float = 0.0) -> Refracted:
    """Return the fronts by the rule of quasi-particles and the law of angles.

    Parameters
    ----------
    mass : M, mass of a sphere beyond the interface over that of a sphere before it, from 0.1 to 10.
    incidence : θ_i, degrees, at least 0 and below 90.

    Raises ValueError for other values, and beyond the critical angle.
    """
    if not LIGHTEST <= mass <= HEAVIEST:
        raise ValueError(f"mass must be from {LIGHTEST} to {HEAVIEST:g}, not {mass:g}")
    if not 0 <= incidence < 90:
        raise ValueError(f"incidence must be at least 0 and below 90 degrees, not {incidence:g}")
    first = _front(mass, incidence, 4 / (1 + mass) ** 2, reflected=False)
    if mass <= 1:
        return Refracted(first[0], np.nan, first[1], 0.0)
    second = _front(1.0, incidence, ((mass - 1) / (mass + 1)) ** 2, reflected=True)
    return Refracted(first[0], second[0], first[1], second[1])


def _front(mass: float, incidence: float, share: float, *, reflected: bool) -> tuple[float, float]:
    """Return θ (degrees) and v/v_i of the front that obeys the law of angles and v² cos θ = share v_i² cos θ_i."""
    start = np.radians(incidence)
    if incidence == 0:
        return 0.0, float(np.sqrt(share))

    def height(theta: float) -> float:
        """Return v/v_i by the law of angles."""
        alike = np.sin(start) * mass**-0.4 * faster(incidence, float(np.degrees(theta)), reflected=reflected)
        return float((np.sin(theta) / alike) ** 5)

    def excess(theta: float) -> float:
        return height(theta) ** 2 * float(np.cos(theta)) - share * float(np.cos(start))

    # The excess rises from θ = 0 and falls towards 90°
    highest = float(minimize_scalar(lambda theta: -excess(theta), bounds=(0.0, np.pi / 2), method="bounded").x)
    if excess(highest) < 0:
        raise ValueError(f"an incidence of {incidence:g} degrees is beyond the critical angle of the mass {mass:g}")
    found = float(brentq(excess, 0.0, highest, xtol=1e-14))
    return float(np.degrees(found)), height(found)
