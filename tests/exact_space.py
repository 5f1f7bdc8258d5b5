"""Spheres in space with the laws of LAMMPS's contacts, integrated in time: a witness for tests, of a few dozen spheres.

Places, radii and the list of contacts come from a cell, in which everything is periodic; contacts stay closed, stick,
and follow f = A δ^{3/2} − F, k = B δ^{1/2}, with the true normal and the arm R − δ/2 (R for a wall). The slip is a
vector that is carried along with its normal: dξ/dt = P(n)(ẇ − Φ̇ × n) − (ξ·ṅ) n.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from granular_analysis.theory.network import Material, mixed


def crossed(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the cross products (..., 3); NumPy's takes four times as long."""
    return one[..., [1, 2, 0]] * other[..., [2, 0, 1]] - one[..., [2, 0, 1]] * other[..., [1, 2, 0]]


@dataclass(frozen=True, eq=False)
class Packing:
    """Spheres of one material: contacts (C,) by sphere, -1 for a wall, with the way (C, 3) between centres at rest.

    The way of a wall's contact is from the centre to the wall.
    """

    first: np.ndarray
    second: np.ndarray
    way: np.ndarray
    radius: np.ndarray
    density: float
    material: Material

    def motion(self, displacement: np.ndarray, velocity: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(T, M, N, 6) of u and Rθ in M motions, which share their steps, from (M, N, 6) each.

        Contacts begin loaded along the tangents of the displaced spheres.
        """
        i, j, R = self.first, self.second, self.radius
        wall, count = j < 0, len(R)
        size_j = np.where(wall, np.inf, R[j])
        zero = np.zeros(len(i), dtype=int)
        A, B, F, _ = mixed([self.material], (zero, zero), (R[i], size_j))
        inertia = (4 / 3 * np.pi * R**3 * self.density)[:, None] * np.repeat([1.0, 0.4], 3)
        # Which spheres the force and the twist at both ends of a contact act on
        acts = np.concatenate([np.eye(count)[i], np.where(wall[:, None], 0.0, np.eye(count)[j])]).T
        bend_i, bend_j = (np.where(wall, 0.0, 1 / (2 * size))[:, None] for size in (R[i], size_j))
        reach, pair = R[i] + np.where(wall, 0.0, R[j]), ~wall[:, None]
        at_rest = np.linalg.norm(self.way, axis=-1)

        def ends(field):
            here, there = field[..., i, :], field[..., j, :] * pair
            return (there - here)[..., :3], (there + here)[..., 3:]

        def geometry(field):
            apart, turned = ends(field)
            nearer = 1 + np.sum(apart * self.way, axis=-1, keepdims=True) / at_rest[:, None] ** 2
            way = np.where(pair, self.way + apart, self.way * nearer)
            length = np.sqrt(np.sum(way**2, axis=-1, keepdims=True))
            return apart, turned, way / length, length, reach[:, None] - length

        def across(vector, normal):
            return vector - np.sum(vector * normal, axis=-1, keepdims=True) * normal

        def rate(_, state):
            field, moving = state[: 2 * displacement.size].reshape(2, *displacement.shape)
            slip = state[2 * displacement.size :].reshape(-1, len(i), 3)
            _, _, n, length, overlap = geometry(field)
            w, turning = ends(moving)
            root = np.sqrt(overlap)
            pull = B[:, None] * root * slip
            force = pull - (A[:, None] * overlap * root - F[:, None]) * n
            twist = crossed(n, pull)
            at_i = np.concatenate([force, (1 - overlap * bend_i) * twist], axis=-1)
            at_j = np.concatenate([-force, (1 - overlap * bend_j) * twist], axis=-1)
            turned_normal = np.where(pair, across(w, n) / length, 0.0)
            slipping = across(w - crossed(turning, n), n) - np.sum(slip * turned_normal, axis=-1, keepdims=True) * n
            pushed = acts @ np.concatenate([at_i, at_j], axis=-2) / inertia
            return np.concatenate([moving.ravel(), pushed.ravel(), slipping.ravel()])

        apart, turned, normal, _, _ = geometry(displacement)
        start = across(apart - crossed(turned, normal), normal)
        size, speed = (np.abs(each).max(axis=(1, 2), keepdims=True) for each in (displacement, velocity))
        state, scale = (
            np.concatenate([each.ravel() for each in three])
            for three in (
                (displacement, velocity, start),
                (0 * displacement + size, 0 * velocity + speed, 0 * start + size),
            )
        )
        found = solve_ivp(rate, (0, times[-1]), state, "DOP853", t_eval=times, rtol=1e-11, atol=1e-11 * scale)
        return found.y[: displacement.size].T.reshape(-1, *displacement.shape)
