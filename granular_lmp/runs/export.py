"""Export a run for other programs: CSV in SI units, netCDF for xarray, snapshots as extended XYZ or HDF5.

The record of a monitor is exported as CSV in SI units, and a whole run folder as a Process Run Crate.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.outputs import whole
from granular_lmp.rest.at_rest import table_of
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.components import in_space
from granular_lmp.runs.crate import write_crate
from granular_lmp.runs.h5md import write_h5md
from granular_lmp.runs.monitors import MonitorRecord
from granular_lmp.runs.record import Record
from granular_lmp.runs.scales import length_of, si_of
from granular_lmp.runs.snapshots import Snapshots
from granular_lmp.runs.tables import write_csv
from granular_lmp.runs.unnamed import Unnamed
from granular_lmp.scene.monitor_kinds import quantity_of

__all__ = ["export", "export_spheres"]

_CONTACTS = "contacts"
Kind = TypeVar("Kind", Record, Unnamed)


def si_columns_of_monitor(monitor: MonitorRecord) -> dict[str, NDArray[np.float64]]:
    """Return `MonitorRecord.columns` in SI units; places remain rows and columns of the packing.

    For motion they are ``t_s``, ``u_m``, ``v_m``, ``theta_rad``, ``u_t_m_s``, ``v_t_m_s``, ``theta_t_rad_s``; for
    contacts ``normal_N``, ``shear_N``, ``overlap_m``, and ``rolling_Nm`` if contacts resist rolling; for flux
    ``flux_W``.
    """
    columns, time = monitor.columns(), monitor.scene.scale.time
    found = {"t_s": columns.pop("tau") * time}
    for name, values in columns.items():
        quantity = quantity_of(name, monitor.monitor.known.quantities)
        if quantity is None:
            found[name] = values
            continue
        said, factor = f"{name.replace('phi', 'theta')}_{quantity.unit.si}", si_of(quantity.unit, monitor.scene)
        rate = name.endswith("_t")
        found[said + "_s" * rate] = values * (factor / time if rate else factor)
    return found


def write_extxyz(particles: Snapshots, path: Path) -> None:
    """Write the snapshots as extended XYZ: positions and radii in R, motion in D0 and t0, the cell of the run.

    The columns beside the positions are ``id``, ``radius``, ``displacement``, ``velocity`` and, if spheres turn,
    ``spin`` and, if tracked, ``rotation`` (Rθ/D0). The comment line of each snapshot holds ``tau``, ``R_m``, ``D0_m``
    (ℓ of a scene without a wave), ``t0_s``.
    """
    scene, rest = particles.scene, particles.rest
    sphere, crystal = scene.sphere, particles.crystal
    unit = length_of(scene)
    lattice = " ".join(repr(float(x)) for x in np.asarray(crystal.cell).ravel())
    origin = " ".join(repr(float(x)) for x in crystal.get_celldisp().ravel())
    periodic = " ".join("T" if each else "F" for each in crystal.pbc)
    scales = f"R_m={sphere.radius!r} D0_m={unit!r} t0_s={scene.scale.time!r}"
    with path.open("w", encoding="utf-8") as stream:
        for each in (particles[k] for k in range(len(particles))):
            columns = {"displacement": each.displacement, "velocity": each.velocity}
            if each.rotation.any() or each.spin.any():  # true for an unknown rotation
                columns |= {} if np.isnan(each.rotation).any() else {"rotation": each.rotation}
                columns["spin"] = each.spin
            kinds = "".join(f":{name}:R:{np.atleast_2d(x.T).shape[0]}" for name, x in columns.items())
            position = in_space(rest + each.displacement * unit / sphere.radius)
            numbers = np.column_stack([crystal.arrays["radius"], *columns.values()]).tolist()
            stream.write(
                f"{len(rest)}\n"
                f'Lattice="{lattice}" Origin="{origin}" pbc="{periodic}" '
                f"Properties=species:S:1:pos:R:3:id:I:1:radius:R:1{kinds} tau={each.tau!r} {scales}\n"
            )
            for number, place, row in zip(particles.spheres.tolist(), position.tolist(), numbers, strict=True):
                stream.write(f"X {' '.join(map(repr, place))} {number + 1} {' '.join(map(repr, row))}\n")


def _write_snapshots(record: Record, path: Path) -> None:
    write_extxyz(record.snapshots(), path)


def write_unnamed_extxyz(crystal: Unnamed, path: Path) -> None:
    """Write the snapshots of an unnamed crystal as extended XYZ, in its units and with its first box."""
    corner, cell, axes = crystal.cell
    lattice, origin = (" ".join(map(repr, each.ravel().tolist())) for each in (cell, corner))
    periodic = " ".join("T" if each else "F" for each in axes)
    kinds = crystal.types.tolist()
    with path.open("w", encoding="utf-8") as stream:
        for moment in (crystal[number] for number in range(len(crystal))):
            columns = {"velocity": moment.velocity, "spin": moment.spin, "force": moment.force}
            there = {name: values for name, values in columns.items() if values is not None}
            names = "".join(f":{name}:R:3" for name in there)
            stream.write(
                f'{len(kinds)}\nLattice="{lattice}" Origin="{origin}" pbc="{periodic}" '
                f"Properties=species:S:1:pos:R:3:id:I:1:type:I:1:radius:R:1{names} time={moment.time!r}\n"
            )
            numbers = np.column_stack([crystal.radius, *there.values()]).tolist()
            for number, kind, place, row in zip(
                crystal.spheres.tolist(), kinds, moment.place.tolist(), numbers, strict=True
            ):
                stream.write(f"X {' '.join(map(repr, place))} {number} {kind} {' '.join(map(repr, row))}\n")


def _write_contacts(crystal: Unnamed, path: Path) -> None:
    write_csv(crystal.contact_columns, path)


UNNAMED_FORMATS: dict[str, Callable[[Unnamed, Path], None]] = {
    ".csv": lambda crystal, path: write_csv(crystal.si, path),
    ".nc": lambda crystal, path: crystal.to_xarray().to_netcdf(path),
    ".xyz": write_unnamed_extxyz,
    ".extxyz": write_unnamed_extxyz,
}
FORMATS: dict[str, Callable[[Record, Path], None]] = {
    ".csv": lambda record, path: write_csv(record.si, path),
    ".nc": Record.to_netcdf,
    ".xyz": _write_snapshots,
    ".extxyz": _write_snapshots,
    ".h5md": write_h5md,
    ".h5": write_h5md,
    "crate": write_crate,
    ".zip": write_crate,
}


def export(record: Record | Unnamed, path: str | Path, monitor: str | None = None) -> None:
    """Write a run in the format of the file ending; make its folder, and replace an existing file.

    A path that ends in ``crate`` or ``.zip`` gets the whole run folder as a Process Run Crate.

    Parameters
    ----------
    record : Record or Unnamed
        An unnamed crystal is written as CSV, netCDF or extended XYZ.
    path : path
    monitor : str, optional
        Write the record of this monitor, as CSV, in place of the trajectory of the centre sphere. For an unnamed
        crystal "contacts" are the overlaps of its spheres.

    Raises
    ------
    RunFolderError
        If the ending is unknown, if the run lacks snapshots or the monitor, or if the file cannot be written.
    PackageMissingError
        If xarray (for netCDF), h5py (for HDF5) or rocrate (for a crate) is not installed.

    Examples
    --------
    >>> scene = Scene.load("tr_periodic").with_values({"time.duration": 4.0})
    >>> export(run(scene, "runs/told"), "told.csv")
    >>> Path("told.csv").read_text().splitlines()[0]
    't_s,p_m,q_m,theta_rad'
    """
    path = Path(path)
    if isinstance(record, Unnamed):
        if monitor not in (None, _CONTACTS):
            raise RunFolderError(f"monitor = {monitor!r}: an unnamed crystal has only {_CONTACTS!r}")
        formats = UNNAMED_FORMATS if monitor is None else {".csv": _write_contacts}
        _write(record, path, formats, " for an unnamed crystal")
    elif monitor is None:
        _write(record, path, FORMATS, "")
    else:
        _write(record, path, {".csv": partial(_write_monitor, name=monitor)}, " for a monitor")


def _write(record: Kind, path: Path, formats: Mapping[str, Callable[[Kind, Path], None]], of: str) -> None:
    write = formats.get("crate" if path.name.endswith("crate") else path.suffix.lower())
    if write is None:
        raise RunFolderError(f"{path}: must end in one of {', '.join(formats)}{of}")
    with whole(path) as draft:
        write(record, draft)


def export_spheres(scene: Scene, path: str | Path) -> None:
    """Write density and radius of each sphere of a scene as CSV for ``packing.table``.

    Raises
    ------
    RunFolderError
        If the ending is not .csv, or the file cannot be written.

    Examples
    --------
    >>> drawn = Scene.load("tr_periodic").with_values({"packing.columns": 6, "disorder.density": 0.1})
    >>> export_spheres(drawn, "spheres.csv")
    >>> Path("spheres.csv").read_text().splitlines()[0]
    'sphere,density_kg/m3,radius_m'
    >>> read = drawn.with_values({"disorder.density": 0.0, "packing.table": "spheres.csv"})
    """
    path = Path(path)
    if path.suffix.lower() != ".csv":
        raise RunFolderError(f"{path}: must end in .csv for the spheres of a scene")
    with whole(path) as draft, draft.open("w", encoding="utf-8") as stream:
        stream.writelines(table_of(scene).pieces())


def _write_monitor(record: Record, path: Path, name: str) -> None:
    write_csv(si_columns_of_monitor(record.monitor(name)), path)
