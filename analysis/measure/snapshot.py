"""The first snapshot of a LAMMPS run as a network: what starts the witness where a run started.

The dump is text and of step 0, with the columns of a scene's `dump.particles`: id, type, x, y, radius, the displacement
from rest, vx, vy, omegaz and the angle v_theta. Numbers stay in the units of the dump. It does not hold density and
material, which are to be given in those units: for `nano` (ag, nm, ns), E in MPa, w in mJ/m² and ρ in ag/nm³; for
`micro` (pg, µm, µs), kPa, mJ/m² and pg/µm³; for `si`, SI.

Later snapshots are refused: the slip of the contacts, which they would need, is in no dump.
"""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.network import Law, Material, Network, State, start

Floats = NDArray[np.float64]

_COLUMNS = ("id", "type", "x", "y", "radius", "Displacement.X", "Displacement.Y", "vx", "vy", "omegaz", "v_theta")
HELD_TYPE = 2  # the type of the spheres that a scene holds


def read_network(
    path: str | Path,
    density: ArrayLike,
    material: Material,
    *,
    law: Law = "secant",
    friction: float = np.inf,
) -> tuple[Network, State]:
    """Return the network of the spheres at rest, in the order of their numbers, and the state they start from.

    Parameters
    ----------
    path : the dump.
    density : of the spheres, (N,) in the order of their numbers, or one for all.
    material : of all spheres; `dataclasses.replace` gives the network other kinds.
    law, friction : of the contacts, as of `analysis.theory.network.Network`.

    Raises ValueError for a file that is no dump of step 0, lacks a column or is cut off.
    """
    with Path(path).open(encoding="utf-8") as stream:
        head = [stream.readline().split() for _ in range(9)]
        if [line[:2] for line in head[::2][:3]] != [["ITEM:", "TIMESTEP"], ["ITEM:", "NUMBER"], ["ITEM:", "BOX"]]:
            raise ValueError(f"{path}: is no text dump of LAMMPS")
        if head[1] != ["0"]:
            raise ValueError(
                f"{path}: begins at step {head[1][0]}, must be 0: the slip of later contacts is not dumped"
            )
        names, count = head[8][2:], int(head[3][0])
        missing = [name for name in _COLUMNS if name not in names]
        if missing:
            raise ValueError(f"{path}: has no column {', '.join(missing)}")
        rows = [stream.readline().split() for _ in range(count)]
    if any(len(row) != len(names) for row in rows):
        raise ValueError(f"{path}: its first snapshot is cut off")
    table = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    order = np.argsort(table["id"])
    _, kind, x, y, radius, ux, uy, vx, vy, spin, angle = (table[name][order] for name in _COLUMNS)
    network = Network(
        np.stack([x - ux, y - uy], axis=1),
        radius,
        np.array(np.broadcast_to(np.asarray(density, float), (count,))),
        (material,),
        held=kind == HELD_TYPE,
        cell=_cell(head),
        law=law,
        friction=friction,
    )
    return network, start(network, np.stack([ux, uy], axis=1), np.stack([vx, vy], axis=1), angle, spin)


def _cell(head: list[list[str]]) -> tuple[float, float]:
    """Return the periods in x and y, inf for other edges, from the nine lines before the spheres."""
    edges = zip(head[4][3:5], head[5:7], strict=True)
    x, y = (float(high) - float(low) if edge == "pp" else np.inf for edge, (low, high) in edges)
    return x, y
