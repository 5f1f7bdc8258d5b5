"""Spheres in space with the laws of LAMMPS's contacts, integrated in time: a witness for tests, of a few dozen spheres.

Places, radii and the list of contacts come from a cell, in which everything is periodic; contacts stay closed, stick,
and follow f = A δ^{3/2} − F, k = B δ^{1/2}, with the true normal and the arm R − δ/2 (R for a wall). The slip is a
vector that is carried along with its normal: dξ/dt = P(n)(ẇ − Φ̇ × n) − (ξ·ṅ) n.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from granular_analysis.theory.network import Material, mixed


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
        """(T, N, 6) of u and Rθ, from (N, 6) each, loaded along the tangents of the displaced spheres."""
        i, j, R = self.first, self.second, self.radius
        wall, count = j < 0, len(R)
        size_j = np.where(wall, np.inf, R[j])
        zero = np.zeros(len(i), dtype=int)
        A, B, F, _ = mixed([self.material], (zero, zero), (R[i], size_j))
        mass = 4 / 3 * np.pi * R**3 * self.density
        at_rest = np.linalg.norm(self.way, axis=1)

        def ends(field):
            there = np.where(wall[:, None], 0.0, field[j])
            return there[:, :3] - field[i, :3], there[:, 3:] + field[i, 3:]

        def geometry(field):
            apart, turned = ends(field)
            way = self.way + apart
            way = np.where(wall[:, None], self.way * (1 + np.sum(apart * self.way, axis=1) / at_rest**2)[:, None], way)
            length = np.linalg.norm(way, axis=1)
            normal = way / length[:, None]
            overlap = R[i] + np.where(wall, 0.0, R[j]) - length
            return apart, turned, normal, length, overlap

        def across(vector, normal):
            return vector - np.sum(vector * normal, axis=1)[:, None] * normal

        def rate(_, state):
            field, moving = state[: 12 * count].reshape(2, count, 6)
            slip = state[12 * count :].reshape(-1, 3)
            _, _, n, length, overlap = geometry(field)
            w, turning = ends(moving)
            root = np.sqrt(overlap)
            force = -(A * overlap * root - F)[:, None] * n + (B * root)[:, None] * slip
            twist = np.cross(n, (B * root)[:, None] * slip)
            arm_i, arm_j = (np.where(wall, 1.0, 1 - overlap / (2 * size)) for size in (R[i], size_j))
            total = np.zeros((count, 6))
            np.add.at(total, i, np.concatenate([force, arm_i[:, None] * twist], axis=1))
            pairs = ~wall
            np.add.at(total, j[pairs], np.concatenate([-force, arm_j[:, None] * twist], axis=1)[pairs])
            turned_normal = np.where(wall[:, None], 0.0, across(w, n) / length[:, None])
            slipping = across(w - np.cross(turning, n), n) - np.sum(slip * turned_normal, axis=1)[:, None] * n
            change = np.concatenate([moving, total / mass[:, None] / np.repeat([1.0, 0.4], 3)])
            return np.concatenate([change.ravel(), slipping.ravel()])

        apart, turned, normal, _, _ = geometry(displacement)
        start = across(apart - np.cross(turned, normal), normal)
        state = np.concatenate([displacement.ravel(), velocity.ravel(), start.ravel()])
        size = np.abs(displacement).max()
        speed = np.abs(velocity).max()
        tolerance = 1e-11 * np.concatenate(
            [np.full(6 * count, size), np.full(6 * count, speed), np.full(start.size, size)]
        )
        found = solve_ivp(rate, (0, times[-1]), state, "DOP853", t_eval=times, rtol=1e-11, atol=tolerance)
        return found.y[: 6 * count].T.reshape(-1, count, 6)
