"""Write snapshots of all spheres into one HDF5 file, in the layout of H5MD 1.1, which h5py and MDAnalysis read.

H5MD (P. de Buyl, P. H. Colberg & F. Höfling, Comput. Phys. Commun. 185, 1546 (2014), https://nongnu.org/h5md) defines
the places of positions, velocities, box and units. The file holds binary doubles, 80 bytes per sphere and snapshot,
where the text dump has about 180. It is written one snapshot at a time, so at most two are in memory.

    particles/trajectory    box/edges, position, velocity              elements of H5MD: (T, N, 3), nm and nm/ns
                            displacement (T, N, 2), rotation, spin     ours: nm, rad, rad/ns about z; (T, N, 3) in space
                            id, species (1 moves, 2 is held), radius   the same at all times
    parameters              attributes: scene (TOML), status, D0_m, Delta0_m, t0_s, R_m, origin_m

Each element holds ``value``, ``step`` and ``time`` (ns). A rotation that was not tracked is nan. Without a wave,
D0_m and Delta0_m are both ℓ, the unit of the record. H5MD puts a corner of the box at the origin: a position is that of
the deck minus ``origin_m``. MDAnalysis keeps positions in single precision, which loses displacements below 1e-7 of the
crystal; the displacements in the file have all digits.
"""

from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.rest.scene import Scene
from granular_lmp.runs.components import in_space
from granular_lmp.runs.record import Record, optional_package
from granular_lmp.runs.scales import length_of
from granular_lmp.version import __version__

NANO = 1e-9  # m in a nm, s in a ns: MDAnalysis supports no larger unit
TYPES = {"moving": 1, "held": 2}  # as in the data file of the deck


def write_h5md(record: Record, path: Path) -> None:
    """Write the snapshots of a run as H5MD, and replace an existing file.

    Parameters
    ----------
    record : Record
    path : Path
        Path of the file, with any ending.

    Raises
    ------
    RunFolderError
        If the run has no snapshots.
    PackageMissingError
        If h5py is not installed.
    """
    snapshots, h5py = record.snapshots(), optional_package("h5py")
    scene, crystal = snapshots.scene, snapshots.crystal
    radius, time = scene.sphere.radius / NANO, scene.scale.time / NANO
    unit = length_of(scene) / NANO
    corner = crystal.get_celldisp().ravel()
    place = (crystal.positions - corner) * radius
    frames, count = len(snapshots), len(place)
    with h5py.File(path, "w") as file:
        _describe(file, scene, str(record.info.get("status", "")), corner * scene.sphere.radius)
        group = file.create_group("particles/trajectory")
        group["id"] = snapshots.spheres + 1
        group["species"] = np.where(snapshots.held, TYPES["held"], TYPES["moving"])
        group["species"].attrs.update(TYPES)
        group["radius"] = crystal.arrays["radius"] * radius
        group["radius"].attrs["unit"] = "nm"
        group["step"] = [each.step for each in snapshots.index]
        group["time"] = snapshots.tau * time
        group["time"].attrs["unit"] = "ns"
        box = group.create_group("box")
        boundary = ["periodic" if each else "none" for each in crystal.pbc]
        box.attrs.update({"dimension": 3, "boundary": boundary})

        def element(name: str, said: str, *shape: int) -> Any:
            """Return the values of a new time-dependent element, a chunk per snapshot; all share step and time."""
            made = group.create_group(name)
            made["step"], made["time"] = group["step"], group["time"]
            values = made.create_dataset("value", (frames, *shape), dtype=np.float64, chunks=(1, *shape))
            values.attrs["unit"] = said
            return values

        element("box/edges", "nm", 3)[:] = np.diag(crystal.cell.array) * radius
        position, velocity = element("position", "nm", count, 3), element("velocity", "nm ns-1", count, 3)
        displacement, turns = element("displacement", "nm", count, scene.space), (3,) if scene.space == 3 else ()
        rotation, spin = element("rotation", "rad", count, *turns), element("spin", "rad ns-1", count, *turns)
        for number in range(frames):
            spheres = snapshots[number]
            displacement[number] = spheres.displacement * unit
            position[number] = place + in_space(spheres.displacement * unit)
            velocity[number] = in_space(spheres.velocity * unit / time)
            rotation[number] = spheres.rotation * unit / radius
            spin[number] = spheres.spin * unit / radius / time


def _describe(file: Any, scene: Scene, status: str, origin: np.ndarray) -> None:
    """Write what the file is, and its run."""
    file.create_group("h5md").attrs["version"] = [1, 1]
    file.create_group("h5md/author").attrs["name"] = "granular-lmp"
    file.create_group("h5md/creator").attrs.update({"name": "granular-lmp", "version": __version__})
    file.create_group("h5md/modules/units").attrs["version"] = [1, 0]
    file.create_group("parameters").attrs.update(
        {
            "scene": scene.to_toml(),
            "status": status,
            "D0_m": length_of(scene),
            "Delta0_m": scene.scale.length,
            "t0_s": scene.scale.time,
            "R_m": scene.sphere.radius,
            "origin_m": origin,
        }
    )
