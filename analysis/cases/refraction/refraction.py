"""Plane fronts on both sides of a straight interface: their directions, speeds and heights, from crests of spheres.

A plane front passes the sphere at r at the time t = t0 + s·r. Least squares on the times of the crests give the
slowness s, and with it the direction of the front and its speed 1/|s|. The height of a front is the largest velocity
along its own way. A front that comes back is found by the velocity along the normal of the interface, which tells it
from the incoming one; that component alone is lower by the cosine of the angle between the two.
"""

from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cases.solitary.chain_motion import first_peak, peak

Floats = NDArray[np.float64]
FEWEST = 12  # spheres of a fit
NEAR, FAR = 3.0, 8.0  # diameters from the interface: behind its ragged edge, and before the front has changed
BESIDE = 8.0  # diameters along it, to each side of its middle
PLANE = 0.5  # t0: what has crests farther off a plane is no plane front, whose crest lasts some 3 t0
AROUND = 1.5  # t0 from a crest of one component to that of another
FOREGOING = 0.05  # share of the fastest striker: a lower crest is scattered by single spheres of the edge


class PlaneFront(NamedTuple):
    """A plane front: direction (degrees from x towards y), speed, mean height, and how they vary.

    `spread` is the standard deviation of the heights over their mean, `late` that of the times from the plane, in t0.
    """

    direction: float
    speed: float
    height: float
    spread: float
    late: float


class FrontsAtInterface(NamedTuple):
    """Incidence, degrees, and the fronts before and beyond an interface.

    `reflected` is None where nothing returns, or what returns is no plane front: its crests are more than 0.5 t0 late
    or early in the mean.
    """

    incidence: float
    incident: PlaneFront
    transmitted: PlaneFront
    reflected: PlaneFront | None

    @property
    def angles(self) -> tuple[float, float]:
        """Return the angles of the transmitted and the reflected front from the normal, degrees; nan for None.

        Both fronts go on along the interface as the incident one does, where the angles are positive.
        """
        back = np.nan if self.reflected is None else self.reflected.direction - 270.0 - self.incidence
        return 90.0 + self.incidence - self.transmitted.direction, (back + 180.0) % 360.0 - 180.0


def plane_front(times: Floats, signal: Floats, places: Floats) -> PlaneFront:
    """Return the front that passes some spheres.

    Parameters
    ----------
    times : (T,) evenly spaced; half a unit of time or less, for crests of three.
    signal : (T, n) with a first pulse for each sphere: the speed, or a component of the velocity.
    places : (n, 2).

    Raises ValueError if fewer than 12 spheres have a pulse, or they lie on one line.
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
    """Return height and time of the first crest of each sphere that has one, by its number."""
    found = {}
    for number, each in enumerate(signal.T):
        with suppress(ValueError):
            found[number] = first_peak(times, each, FOREGOING)
    return found


def _returning(times: Floats, velocity: Floats, places: Floats, normal: Floats) -> PlaneFront:
    """Return the front that comes back against the normal, with the height along its own way."""
    inward = -velocity @ normal
    found = plane_front(times, inward, places)
    way = np.array([np.cos(np.radians(found.direction)), np.sin(np.radians(found.direction))])
    heights = []
    for number, (_, time) in _crests(times, inward).items():
        own = velocity[:, number] @ way
        top = int(np.argmax(np.where(np.abs(times - time) < AROUND, own, -np.inf)))
        near = slice(max(top - 4, 0), top + 5)
        with suppress(ValueError):  # too near to an end of the record
            heights.append(peak(times[near], own[near])[0])
    return found._replace(height=float(np.mean(heights)), spread=float(np.std(heights) / np.mean(heights)))


def fronts_at_interface(
    times: Floats, velocity: Floats, places: Floats, middle: Floats, incidence: float, heavier: bool
) -> FrontsAtInterface:
    """Return the fronts at a straight interface that a front along y meets.

    Parameters
    ----------
    times : (T,).
    velocity : (T, n, 2), in that of the fastest striker.
    places : (n, 2), diameters.
    middle : (2,) a place on the interface, far from where it ends.
    incidence : degrees, from the rows to the interface.
    heavier : True if the spheres beyond are heavier, so that a front comes back.

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
