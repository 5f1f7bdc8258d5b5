"""Dumps in the formats of LAMMPS, written by another engine that runs the steps of a deck.

They equal the dumps that `granular_lmp.lammps.recording` and `granular_lmp.lammps.monitors` request from LAMMPS, so
readers need not know who wrote them.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.lammps.beginning import Beginning
from granular_lmp.lammps.binary_dump import binary_head
from granular_lmp.lammps.recording import sphere_columns, sphere_names
from granular_lmp.problem import Problem

Floats = NDArray[np.float64]
Columns = Mapping[str, NDArray[Any]]


def renamed(problem: Problem, forces: str = "") -> list[str]:
    """Return the names of the columns of spheres in a dump."""
    words = sphere_names(problem).split()
    names = dict(zip(words[1::3], words[2::3], strict=True))
    return [names.get(each, each) for each in (sphere_columns(problem) + forces).split()]


def columns(spheres: NDArray[np.int64], begun: Beginning, fields: Sequence[Floats], force: Floats | None) -> Columns:
    """Return the columns of dumps for n spheres, by name.

    Parameters
    ----------
    spheres : (n,) int array
        Indices of the spheres.
    begun : Beginning
    fields : displacement, velocity, rotation, spin
        (n, d) each; rotation and spin are (n, 1) in the plane, in space rotation vectors.
    force : (n, d) array, optional
    """
    displacement, velocity, rotation, spin = fields
    place, low = begun.place[spheres] + displacement, begun.box[: displacement.shape[1], 0]
    period = np.array(begun.cell)
    periodic = np.isfinite(period)
    place[:, periodic] = low[periodic] + np.mod(place - low, np.where(periodic, period, 1.0))[:, periodic]
    still, radius = np.zeros(len(spheres)), begun.radius[spheres]
    found: dict[str, NDArray[Any]] = {"id": spheres + 1, "type": begun.types[spheres], "radius": radius}
    found |= {"mass": 4 / 3 * np.pi * radius**3 * begun.density[spheres]}
    found |= dict.fromkeys(["z", "vz", "omegax", "omegay"], still)
    for name, values in (("{}", place), ("v{}", velocity), ("u{}", displacement)):
        found |= {name.format(axis): values[:, part] for part, axis in enumerate("xyz"[: place.shape[1]])}
    found |= {f"Displacement.{axis.upper()}": found[f"u{axis}"] for axis in "xyz"[: place.shape[1]]}
    if force is not None:
        found |= {f"f{axis}": force[:, part] for part, axis in enumerate("xyz"[: place.shape[1]])}
    if rotation.shape[1] == 1:
        angle = np.arctan2(np.sin(rotation[:, 0]), np.cos(rotation[:, 0]))
        return found | {"omegaz": spin[:, 0], "v_theta": angle, "theta": angle}
    half = np.linalg.norm(rotation, axis=1) / 2
    turned = (rotation.T / 2 * np.sinc(half / np.pi)).tolist()  # vector part of the quaternion
    quaternion = dict(zip("WXYZ", [np.cos(half), *map(np.array, turned)], strict=True))
    found |= {f"Orientation.{part}": values for part, values in quaternion.items()}
    found |= {f"theta{axis}": 2 * np.arctan2(quaternion[axis.upper()], quaternion["W"]) for axis in "xyz"}
    return found | {f"omega{axis}": spin[:, part] for part, axis in enumerate("xyz")}


def text(step: int, begun: Beginning, names: Sequence[str], table: Sequence[NDArray[Any]], what: str = "ATOMS") -> str:
    """Return a snapshot of a text dump, each number with all digits."""
    faces = " ".join(each * 2 for each in begun.boundary.split())
    head = ["ITEM: TIMESTEP", str(step), f"ITEM: NUMBER OF {what}", str(len(table[0])), f"ITEM: BOX BOUNDS {faces}"]
    head += [f"{low!r} {high!r}" for low, high in begun.box.tolist()]
    head.append(f"ITEM: {what} {' '.join(names)}")
    line = " ".join("%d" if each.dtype.kind == "i" else "%.17g" for each in table)
    rows = zip(*(each.tolist() for each in table), strict=True)
    return "\n".join([*head, *(line % row for row in rows)]) + "\n"


def binary(step: int, begun: Beginning, names: Sequence[str], table: Sequence[NDArray[Any]]) -> bytes:
    """Return a snapshot of a binary dump."""
    numbers = np.stack([each.astype(np.float64) for each in table], axis=1)
    periodic = [0 if face == "p" else 1 for face in begun.boundary.split()]
    return binary_head(step, names, len(numbers), periodic, begun.box) + numbers.tobytes()
