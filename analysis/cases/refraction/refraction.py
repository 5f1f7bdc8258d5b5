"""Plane fronts on both sides of a straight interface: directions, speeds and heights, from crests of spheres.

A plane front passes the sphere at r at the time t = t0 + s·r. Least squares on the times of the crests give the
slowness s, and so the direction of the front and its speed 1/|s|. The height of a front is the largest velocity along
its own direction. The sign of the velocity along the normal of the interface separates a reflected front from the
incoming one; this component is lower than the height by the cosine of the angle between front and normal.
"""

from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases.solitary.chain_motion import first_peak, peak

Floats = NDArray[np.float64]
FEWEST = 12  # fewest spheres of a fit
NEAR, FAR = 3.0, 8.0  # range of a fit, diameters from the interface: beyond its ragged edge, before the front changes
BESIDE = 8.0  # range of a fit along the interface, diameters to each side of its middle
PLANE = 0.5  # rms time, t0, by which crests of a plane front may be off a plane; a crest lasts some 3 t0
AROUND = 1.5  # longest time, t0, between the crests of two components of the same front
FOREGOING = 0.05  # share of the fastest striker's velocity below which a crest is scattered by spheres of the edge


class PlaneFront(NamedTuple):
    """A plane front: direction (degrees from x towards y), speed, mean height, and their scatter.

    `spread` is the standard deviation of the heights over their mean, `late` that of the crests' times from the fitted
    plane, in t0.
    """

    direction: float
    speed: float
    height: float
    spread: float
    late: float


class FrontsAtInterface(NamedTuple):
    """Incidence (degrees), and the fronts before and beyond an interface.

    `reflected` is None if no front returns, or if the returning front is not plane: `late` exceeds 0.5 t0.
    """

    incidence: float
    incident: PlaneFront
    transmitted: PlaneFront
    reflected: PlaneFront | None

    @property
    def angles(self) -> tuple[float, float]:
        """Return the angles of the transmitted and the reflected front from the normal, degrees; nan for no front.

        An angle is positive if the front moves along the interface in the same sense as the incident front.
        """
        back = np.nan if self.reflected is None else self.reflected.direction - 270.0 - self.incidence
        return 90.0 + self.incidence - self.transmitted.direction, (back + 180.0) % 360.0 - 180.0


def plane_front(times: Floats, signal: Floats, places: Floats) -> PlaneFront:
    """Return the plane front that passes some spheres.

    Parameters
    ----------
    times : (T,) equally spaced, by half a unit of time or less, as a crest lasts three.
    signal : (T, n) speed or component of the velocity, whose first pulse is the front.
    places : (n, 2).

    Raises ValueError if fewer than 12 spheres have a pulse, or if they lie on one line.
    """
    found = [(time, height, *places[k]) for k, (height, time) in _crests(times, signal).items()]
    if len(found) < FEWEST:
        raise ValueError(f"the front has passed {len(found)} of {len(places)} spheres; must be at least {FEWEST}")
    time, height, x, y = np.array(found).T
    plane = np.column_stack([np.ones_like(x), x - x.mean(), y - y.mean()])
    solution, _, rank, _ = np.linalg.lstsq(plane, time)
    if rank < 3:
        raise ValueError("the spheres of a plane front must not lie on one line")
    _, sx, sy = solution
    return PlaneFront(
        float(np.degrees(np.arctan2(sy, sx))),
        float(1 / np.hypot(sx, sy)),
        float(height.mean()),
        float(height.std() / height.mean()),
        float((time - plane @ solution).std()),
    )


def _crests(times: Floats, signal: Floats) -> dict[int, tuple[float, float]]:
    """Return height and time of the first crest, by the number of the sphere, for spheres with a crest."""
    found = {}
    for number, each in enumerate(signal.T):
        with suppress(ValueError):
            found[number] = first_peak(times, each, FOREGOING)
    return found


def _returning(times: Floats, velocity: Floats, places: Floats, normal: Floats) -> PlaneFront:
    """Return the front that runs against the normal, with the height along its own direction."""
    inward = -velocity @ normal
    found = plane_front(times, inward, places)
    way = np.array([np.cos(np.radians(found.direction)), np.sin(np.radians(found.direction))])
    heights = []
    for number, (_, time) in _crests(times, inward).items():
        own = velocity[:, number] @ way
        top = int(np.argmax(np.where(np.abs(times - time) < AROUND, own, -np.inf)))
        near = slice(max(top - 4, 0), top + 5)
        with suppress(ValueError):  # a crest too near to an end of the record
            heights.append(peak(times[near], own[near])[0])
    return found._replace(height=float(np.mean(heights)), spread=float(np.std(heights) / np.mean(heights)))


def fronts_at_interface(
    times: Floats, velocity: Floats, places: Floats, middle: Floats, incidence: float, heavier: bool
) -> FrontsAtInterface:
    """Return the fronts at a straight interface met by a front along y.

    Parameters
    ----------
    times : (T,).
    velocity : (T, n, 2), in units of the velocity of the fastest striker.
    places : (n, 2), diameters.
    middle : (2,) place on the interface, far from its ends.
    incidence : angle from the rows to the interface, degrees.
    heavier : True if the spheres beyond are heavier, so that a front is reflected.

    Raises ValueError as `plane_front`, if too few spheres near the interface are recorded.
    """
    angle = np.radians(incidence)
    normal, along = np.array([-np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    beyond, aside = (places - middle) @ normal, np.abs((places - middle) @ along)
    before = (aside < BESIDE) & (beyond > -FAR) & (beyond < -NEAR)
    behind = (aside < BESIDE) & (beyond > NEAR) & (beyond < FAR)
    speed = np.linalg.norm(velocity, axis=-1)
    reflected = _returning(times, velocity[:, before], places[before], normal) if heavier else None
    return FrontsAtInterface(
        incidence,
        plane_front(times, speed[:, before], places[before]),
        plane_front(times, speed[:, behind], places[behind]),
        reflected if reflected and reflected.late < PLANE else None,
    )
