"""Spheres moved in LAMMPS by commands written by hand: nothing of `granular_lmp` is shared but the place of LAMMPS.

The decks are in LAMMPS's units nano (ag, nm, ns, MPa, mJ/m²), which are consistent: the network takes the same numbers.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.network import Network
from tests.instance import silent_lammps

Floats = NDArray[np.float64]
STYLES = {"secant": "mindlin", "incremental": "mindlin/force"}
BEFORE, FAR = 60.0, 2000.0  # nm from the edge of a box to its first sphere: with a period, without


def padded(values: Floats, *axes: int) -> Floats:
    """Return values (N, k) as the columns `axes` of (N, 3), the others 0."""
    whole = np.zeros((len(values), 3))
    whole[:, axes or (0, 1, 2)] = values
    return whole


def moved(
    network: Network,
    models: str,
    start: tuple[Floats, Floats] | Floats,
    rates: tuple[Floats, Floats] | Floats,
    step: float,
    steps: int,
    samples: int,
    more: str = "",
) -> Floats:
    """Return displacements and rotations (samples + 1, N, 6) of spheres in LAMMPS, from the start on.

    Parameters
    ----------
    network : the spheres, the periods of the cell and the planes of the walls.
    models : contact models as words after ``pair_coeff``, a line for each pair of kinds; walls take the last line.
    start, rates : displacements and rotations, velocities and spins, (N, 3) each.
    step, steps : the time step, and how many of them lie between two samples.
    more : commands before the motion.
    """
    count, dimension = network.position.shape
    place = padded(network.position, *range(dimension))
    period = np.array([*network.cell, *[np.inf] * (3 - dimension)])
    ends = np.isinf(period)
    low = place.min(axis=0) - np.where(ends, FAR, BEFORE)
    high = np.where(ends, place.max(axis=0) + FAR, low + period)
    box = " ".join(f"{a:.17g} {b:.17g}" for a, b in zip(low, high, strict=True))
    spheres = "\n".join(
        f"create_atoms {kind + 1} single {' '.join(f'{each:.17g}' for each in at)}\n"
        f"set atom {i + 1} diameter {2 * radius:.17g} density {density:.17g}"
        for i, (at, radius, density, kind) in enumerate(
            zip(place, network.radius, network.density, network.kinds, strict=True)
        )
    )
    lines = models.strip().splitlines()
    walls = "\n".join(
        f"fix wall all wall/gran granular {lines[-1].partition('* * ')[2]} zplane {wall.point[2]:.17g} NULL"
        for wall in network.walls
    )
    with silent_lammps() as lmp:
        lmp.commands_string(f"""
            units nano
            boundary {" ".join("f" if end else "p" for end in ends)}
            atom_style bpm/sphere
            atom_modify map array sort 0 0.0
            comm_modify vel yes
            region box block {box}
            create_box {len(network.materials)} box
            {spheres}
            neighbor 50.0 bin
            pair_style granular
            {chr(10).join(f"pair_coeff {line}" for line in lines)}
            {walls}
            compute moved all displace/atom
            compute turned all property/atom quatw quati quatj quatk
            thermo_style custom step
            timestep {1e10 * step!r}
            fix move all nve/noforce
        """)

        def array(name: str) -> tuple[Any, NDArray[np.intp]]:
            return lmp.numpy.extract_atom(name)[:count], lmp.numpy.extract_atom("id")[:count] - 1

        def put(way: Floats, turn: Floats) -> None:
            for name, values in (("v", way), ("omega", turn)):
                own, order = array(name)
                own[:] = values[order]

        def seen() -> Floats:
            _, order = array("x")
            now = np.empty((count, 6))
            now[order, :3] = lmp.numpy.extract_compute("moved", 1, 2)[:count, :3]
            quaternion = lmp.numpy.extract_compute("turned", 1, 2)[:count]
            now[order, 3:] = 2 * np.arctan(quaternion[:, 1:] / quaternion[:, :1])
            return now

        # One step without forces loads the springs of the displaced spheres, so slowly that no dashpot resists
        way, rotation = start
        put(way / (1e10 * step), rotation / (1e10 * step))
        quaternions, order = array("quat")
        half = np.column_stack([np.ones(count), rotation / 2])[order]
        quaternions[:] = half / np.linalg.norm(half, axis=1)[:, None]
        lmp.commands_string(f"run 1 post no\nunfix move\nreset_timestep 0\ntimestep {step!r}")
        put(*rates)
        lmp.commands_string(f"fix move all nve/bpm/sphere\n{more}\nrun 0 post no")
        fields = [seen()]
        for _ in range(samples):
            lmp.command(f"run {steps} pre no post no")
            fields.append(seen())
    return np.array(fields)
