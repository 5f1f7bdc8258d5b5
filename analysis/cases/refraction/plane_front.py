"""Plane front of an impact in a hexagonal sheet of spheres that just touch, in any direction.

All spheres at the same distance s along the direction n of a plane front move alike. Each sphere has contacts along
e = 0°, 60° and 120° from a row of contacts, with spheres at s ± e·n. If the distances e·n are a, b and b − a times one
spacing, the sheet is a chain of sites with two displacements each, whose springs reach a, b and |b − a| sites far:

    u''_s = Σ_e e [(e·(u_{s−e·n} − u_s))₊^{3/2} − (e·(u_s − u_{s+e·n}))₊^{3/2}],    A = m = 1

After some diameters the front has settled to a wave of constant shape. Its speed is V = C v^{1/5}, in diameters, with
the height v along n. `plane_front` gives, over the angle φ between n and a row of contacts:

    φ      0       6.59    10.89   16.10   19.11   21.05   30
    C      0.9294  0.9266  0.9220  0.9142  0.9093  0.9062  0.8981

By the sixfold symmetry C is a series in cos 6kφ; three terms reproduce all of these values to 3e-4:

    C = 0.9149 + 0.0156 cos 6φ − 0.0011 cos 12φ

Along a row of contacts the front is 3.5 % faster than across the rows (φ = 30°), where the sheet is a chain of rows
(`cases.refraction.angles`).
"""

from typing import NamedTuple

import numpy as np

from cases.solitary.chain_motion import peak

SERIES = (0.9149, 0.0156, -0.0011)  # Coefficients of cos 6kφ, from the table above
_CONTACTS = np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)], [-0.5, np.sqrt(0.75)]])
_STEP = 0.04  # a crest lasts 3 units of time; with half the step the speeds in the table change by less than 1e-4
_EVERY = 5  # steps between two records


class PlaneWave(NamedTuple):
    """A settled front: φ in degrees, C = V/v^{1/5} in diameters, and the standard deviation of v over its mean."""

    degrees: float
    scaled_speed: float
    spread: float


def scaled_speed(degrees: float) -> float:
    """Return C, by the series, of a front whose direction has this angle from a row of contacts."""
    return float(sum(each * np.cos(np.radians(6 * k * degrees)) for k, each in enumerate(SERIES)))


def plane_front(a: int, b: int, length: float = 40.0) -> PlaneWave:
    """Return the front, by integration, in the direction in which contacts at 0° and 60° reach a and b sites far.

    Parameters
    ----------
    a, b : a > 0 and a/2 ≤ b ≤ a: (2, 1) is along a row of contacts, (1, 1) across the rows.
    length : distance that the front runs, diameters; its speed is measured between 50 and 80 % of it.

    Raises ValueError for other numbers.
    """
    if not (a > 0 and a <= 2 * b <= 2 * a):
        raise ValueError(f"places must be a > 0 and b from a/2 to a, not {a} and {b}")
    angle = np.arctan2(2 * b - a, np.sqrt(3) * a)
    way = np.array([np.cos(angle), np.sin(angle)])
    springs = [
        (abs(reach), np.sign(reach) * each) for reach, each in zip((a, b, b - a), _CONTACTS, strict=True) if reach
    ]
    place = np.arange(int(length * a / way[0])) * way[0] / a
    u = np.zeros((len(place), 2))
    v = np.where(place[:, None] < np.sqrt(0.75) - 1e-9, way, 0.0)  # sites before the second row of spheres strike

    def forces() -> np.ndarray:
        total = np.zeros_like(u)
        for reach, along in springs:
            push = np.maximum((u[:-reach] - u[reach:]) @ along, 0.0)[:, None] ** 1.5 * along
            total[:-reach] -= push
            total[reach:] += push
        return total

    force, records = forces(), []
    for step in range(int(length / 0.85 / _STEP)):
        v += _STEP / 2 * force
        u += _STEP * v
        force = forces()
        v += _STEP / 2 * force
        if step % _EVERY == 0:
            records.append(v @ way)
    times, signal = _STEP * _EVERY * np.arange(len(records)), np.array(records)
    there = (place > 0.5 * length) & (place < 0.8 * length)
    height, crest = np.array([peak(times, each) for each in signal[:, there].T]).T
    speed = np.polyfit(crest, place[there], 1)[0]
    return PlaneWave(float(np.degrees(angle)), float(speed / height.mean() ** 0.2), float(height.std() / height.mean()))
