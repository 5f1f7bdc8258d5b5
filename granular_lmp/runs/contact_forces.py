"""Forces of contacts over time, between spheres and with walls, from the record of a monitor."""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class ContactForces:
    """Contacts of the spheres of a monitor over time, with spheres and walls: all that existed at any time.

    Forces are nan at times when a killed run recorded the motion but not the contacts.

    Attributes
    ----------
    i, j : (C,) int arrays
        Indices of the two spheres in the crystal, i < j; j is −1 for a contact with a wall.
    vector : (T, C, 2) array, in space (T, C, 3)
        From the centre of i to that of j, or to the foot point on the wall, in R; nan while they do not touch.
    normal : (T, C) array
        Force along n = vector/|vector| on j, in k1 D0: positive if repulsive; 0 while they do not touch. It includes
        the static force, which is 0 in an adhesive crystal without a load.
    shear : (T, C) array, in space (T, C, 3)
        Force on j along t = ẑ × n, n turned by +90°, in k1 D0; in space the force across n as a vector.
    overlap : (T, C) array
        In Δ0; nan while they do not touch.
    rolling : (T, C) array, in space (T, C, 3)
        Rolling torque on j about z, in k1 D0 R, and its opposite on i; 0 if contacts roll freely. In space a vector.
        Walls do not resist rolling.
    wall : (C,) str array
        Face of the wall, such as "ylo" for the lower end along y, as in the fixes of the deck; "" between two spheres.

    Examples
    --------
    >>> touched = {"monitor": [{"name": "line", "rows": [4, 4], "what": "contacts"}], "time.duration": 4.0}
    >>> contacts = run(Scene.load("tr_periodic").with_values(touched), "runs/touched").monitor("line").contacts
    >>> contacts.normal.shape  # times, and contacts of three spheres
    (9, 15)
    """

    i: Integers
    j: Integers
    vector: Floats
    normal: Floats
    shear: Floats
    overlap: Floats
    rolling: Floats
    wall: NDArray[np.str_]

    @property
    def pairs(self) -> list[tuple[int, int, str]]:
        """Both spheres and the wall of each contact."""
        return list(zip(self.i.tolist(), self.j.tolist(), self.wall.tolist(), strict=True))

    @property
    def force(self) -> Floats:
        """Force on j, (T, C, 2) or in space (T, C, 3), in k1 D0; the force on i is the opposite."""
        direction = self.direction
        if self.shear.ndim == 3:
            return self.normal[..., None] * direction + self.shear
        across = np.stack([-direction[..., 1], direction[..., 0]], axis=-1)
        return self.normal[..., None] * direction + self.shear[..., None] * across

    @property
    def direction(self) -> Floats:
        """Unit vector n from i to j, as `vector`; 0 while they do not touch."""
        return np.nan_to_num(self.vector / np.linalg.norm(self.vector, axis=-1, keepdims=True))

    def torque(self, end: str, arm: Floats) -> Floats:
        """Return the torque on the spheres at one end, "i" or "j", for a lever arm (T, C) of the shear, in k1 D0 R.

        The shear torque has the same sense on both spheres, the rolling torque the opposite.
        """
        roll = self.rolling if end == "j" else -self.rolling
        if self.shear.ndim == 2:
            return roll - arm * self.shear
        return roll - arm[..., None] * np.cross(self.direction, self.shear)
