"""A record as tables for other programs: columns of one length, SI units, CSV, pandas, xarray.

Of the centre sphere a line for each time: tau, p, q, phi. Of recorded spheres a line for each time and sphere, time by
time: tau, row, column, u, v, their rates u_t and v_t, and where spheres turn phi_t = R ω; the names are those of a
monitor, and in space there are w, and phix, phiy, phiz. With ``output.forces`` fx and fy follow, in space fz.
"""

import csv
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import PackageMissingError, RunFolderError, one_line
from granular_lmp.lammps.outputs import STATUS, csv_text, replace_text
from granular_lmp.runs.components import MOTION
from granular_lmp.runs.scales import length_of

Columns = dict[str, NDArray[Any]]
# Unit and meaning of each signal
_SAID = {
    "tau": ("t0", "time"),
    "p": ("D0", "displacement of the centre sphere along the wave vector"),
    "q": ("D0", "displacement of the centre sphere across the wave vector"),
    "phi": ("D0/R rad", "rotation of the centre sphere, R theta/D0"),
    **{f"u{axis}": ("D0", f"displacement of the centre sphere along {axis}") for axis in "xyz"},
    **{f"phi{axis}": ("D0/R rad", f"rotation of the centre sphere about {axis}, R theta/D0") for axis in "xyz"},
    "displacement": ("{length}", "displacement of the recorded spheres from rest"),
    "velocity": ("{length}/t0", "velocity of the recorded spheres"),
    "spin": ("{length}/t0", "rate of rotation of the recorded spheres, R omega"),
    "force": ("m {length}/t0^2", "force on the recorded spheres"),
}


def columns(record: Any) -> Columns:
    """Return columns of one length by name, dimensionless."""
    if "displacement" not in record.signals:
        return {"tau": record.tau} | dict(record.signals)
    row, column = record.row, record.column
    found = {"tau": np.repeat(record.tau, len(row))}
    found |= {name: np.tile(places, len(record.tau)) for name, places in (("row", row), ("column", column))}
    names, signals = MOTION[record.scene.space], record.signals
    moves, turns = names[: record.scene.space], names[record.scene.space :]
    parts = [(moves, record.displacement), ([f"{name}_t" for name in moves], record.velocity)]
    parts += [([f"{name}_t" for name in turns], record.spin)] if "spin" in signals else []
    parts += [(["fx", "fy", "fz"][: len(moves)], signals["force"])] if "force" in signals else []
    return found | {
        name: values.reshape(*record.velocity.shape[:2], -1)[..., axis].ravel()
        for each, values in parts
        for axis, name in enumerate(each)
    }


def si(record: Any) -> Columns:
    """Return columns of one length by name, in SI units.

    Of the centre sphere ``t_s``, ``p_m``, ``q_m``, ``theta_rad``; of recorded spheres ``t_s``, ``row``, ``column``,
    ``ux_m``, ``uy_m``, ``vx_m_s``, ``vy_m_s``, and where spheres turn ``spin_rad_s``, about z; in space ``uz_m``,
    ``vz_m_s``, ``spinx_rad_s`` and ``spiny_rad_s`` too.
    """
    scale, radius = record.scale, record.scene.sphere.radius
    unit = length_of(record.scene)
    units = {  # by column: name, factor, divisor
        "tau": ("t_s", scale.time, 1.0),
        **{"p": ("p_m", unit, 1.0), "q": ("q_m", unit, 1.0), "phi": ("theta_rad", unit, radius)},
        **{name: (f"u{axis}_m", unit, 1.0) for name, axis in zip("uvw", "xyz", strict=True)},
        **{f"u{axis}": (f"u{axis}_m", unit, 1.0) for axis in "xyz"},
        **{f"phi{axis}": (f"theta{axis}_rad", unit, radius) for axis in "xyz"},
        **{f"{name}_t": (f"v{axis}_m_s", scale.velocity, 1.0) for name, axis in zip("uvw", "xyz", strict=True)},
        **{f"phi{axis}_t": (f"spin{axis.strip('z')}_rad_s", scale.velocity, radius) for axis in ("", "x", "y", "z")},
        **{f"f{axis}": (f"f{axis}_N", scale.mass * scale.velocity / scale.time, 1.0) for axis in "xyz"},
    }
    found: Columns = {}
    for name, values in columns(record).items():
        said, factor, divisor = units.get(name, (name, None, 1.0))
        found[said] = values if factor is None else values * factor / divisor
    return found


def write_csv(named: Columns, path: Path) -> None:
    """Write columns, each number in the shortest form that reads back to the same double."""
    replace_text(path, csv_text(named, zip(*(values.tolist() for values in named.values()), strict=True)))


def read_trajectory(path: Path, header: list[str], samples: int | None) -> tuple[str, dict[str, NDArray[np.float64]]]:
    """Return the text and the columns of a table over tau; `samples` is the number of its lines, if that is known.

    Raises
    ------
    RunFolderError
        If it is missing or malformed, or has another number of lines.
    """
    try:
        text = path.read_text(encoding="utf-8")
        if not text.endswith("\n"):
            raise ValueError("its last line is cut off")
        lines = list(csv.reader(text.splitlines()))
        if lines[0] != header:
            raise ValueError(f"header {lines[0]}, expected {header}")
        columns = np.array(lines[1:], dtype=float).reshape(-1, len(header)).T
        tau = columns[0]
        if not (np.isfinite(tau).all() and (tau >= 0).all() and (np.diff(tau) > 0).all()):
            raise ValueError("tau must be finite, not negative, and ascend")
        if not len(tau) and samples is not None:
            raise ValueError("it holds no record")
        if samples not in (None, len(tau)):
            raise ValueError(f"{len(tau)} records, and {STATUS} says {samples}")
    except (OSError, ValueError, IndexError, csv.Error) as error:
        raise RunFolderError(f"{path}: cannot be read: {one_line(error)}") from error
    return text, dict(zip(header, columns, strict=True))


def to_pandas(record: Any) -> Any:
    """Return a ``pandas.DataFrame`` of `columns`; of the centre sphere tau is the index."""
    frame = optional_package("pandas").DataFrame(columns(record))
    return frame if "row" in frame else frame.set_index("tau")


def to_xarray(record: Any) -> Any:
    """Return an ``xarray.Dataset`` of the signals over tau, each with its unit and meaning.

    Its attributes are the scales that turn it into SI units, how the run ended, and the scene as TOML: ``D0_m``,
    ``t0_s``, ``R_m`` of the centre sphere; ``l_m`` of loose recorded spheres or ``Delta0_m`` of those at rest under
    load, ``t0_s``, ``R_m``, and the coordinates ``row`` and ``column``.
    """
    scene, signals = record.scene, record.signals
    length = "l" if scene.loose else "Delta0" if scene.wave is None else "D0"
    said = {
        name: {"units": unit.format(length=length), "long_name": meaning} for name, (unit, meaning) in _SAID.items()
    }
    variables = {
        name: (("tau", "sphere", "axis")[: values.ndim], values, said[name]) for name, values in signals.items()
    }
    coordinates: dict[str, Any] = {"tau": ("tau", record.tau, said["tau"])}
    if "displacement" in signals:
        coordinates |= {
            "row": ("sphere", record.row),
            "column": ("sphere", record.column),
            "axis": [*"xyz"[: scene.space]],
        }
    scales = {f"{length}_m": length_of(scene), "t0_s": scene.scale.time, "R_m": scene.sphere.radius}
    origin = {"scene": scene.to_toml(), "status": str(record.info.get("status", ""))}
    return optional_package("xarray").Dataset(variables, coordinates, scales | origin)


def optional_package(name: str) -> Any:
    """Return an optional package.

    Raises
    ------
    PackageMissingError
        If it is not installed.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise PackageMissingError(f"{name} is not installed; pip install {name}") from error
