"""Record as tables for other programs: columns of equal length, SI units, CSV, pandas, xarray.

The centre sphere has a line for each time: tau, p, q, phi. Recorded spheres have a line for each time and sphere, time
by time: tau, row, column, u, v, the rates u_t and v_t, and phi_t = R ω if spheres turn. The names are those of monitors
and snapshots. In space there are also w, phix, phiy, phiz and, with several layers, layer. With ``output.forces``, fx
and fy follow, and fz in space.
"""

import csv
from importlib import import_module
from pathlib import Path
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import PackageMissingError, RunFolderError, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.outputs import STATUS, csv_text, replace_text
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.components import MOTION
from granular_lmp.runs.scales import force_of, length_of
from granular_lmp.scene.monitor_kinds import QUANTITIES

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


@dataclass(frozen=True)
class Many:
    """Values of many spheres, contacts or rows over time.

    Attributes
    ----------
    scene : Scene
        Scene that determines the units.
    tau : (T,) array
    kind : str
        "sphere", "contact" or "row".
    which : dict of str to (N,) array
        Labels of the spheres, contacts or rows.
    values : dict of str to (T, N) array
    """

    scene: Scene
    tau: NDArray[np.float64]
    kind: str
    which: Columns
    values: Columns

    def columns(self) -> Columns:
        """Return columns of equal length, time by time."""
        times, count = len(self.tau), len(next(iter(self.which.values())))
        which = {name: np.tile(numbers, times) for name, numbers in self.which.items()}
        return {"tau": np.repeat(self.tau, count)} | which | {name: each.ravel() for name, each in self.values.items()}

    def to_pandas(self) -> Any:
        """Return `columns` as a ``pandas.DataFrame``."""
        return optional_package("pandas").DataFrame(self.columns())

    def to_xarray(self) -> Any:
        """Return an ``xarray.Dataset`` of the values over tau and `kind`, with units, as for a record."""
        variables = {name: (("tau", self.kind), each, self._said(name)) for name, each in self.values.items()}
        which = {name: (self.kind, each) for name, each in self.which.items()}
        return _dataset(self.scene, variables, self.tau, which, {"force_N": force_of(self.scene)})

    def _said(self, name: str) -> dict[str, str]:
        rate = name.endswith("_t")
        quantity, scale = QUANTITIES[name.partition("_")[0]], self.scene.scale
        unit = quantity.unit.words(_length(self.scene), scale.name, of_impact=scale.of_impact)
        unit, meaning = unit + " rad" * (quantity.unit.si == "rad"), quantity.meaning
        axis = f" along {name[-1]}" if name[-2:] in ("_x", "_y", "_z") else ""
        return _attributes(
            self.scene, f"{unit}/t0" if rate else unit, f"rate of {meaning}" if rate else f"{meaning}{axis}"
        )


class HasTables:
    """Record of many spheres, contacts or rows that can be converted into a table."""

    def to_pandas(self) -> Any:
        """Return a ``pandas.DataFrame`` with a line for each time and sphere, contact or row.

        Raises
        ------
        PackageMissingError
            If pandas is not installed.
        """
        return self._many.to_pandas()

    def to_xarray(self) -> Any:
        """Return an ``xarray.Dataset`` of the values over tau and "sphere", "contact" or "row", with units.

        Its attributes hold the scales for SI units, and the ``scene`` as TOML.

        Raises
        ------
        PackageMissingError
            If xarray is not installed.
        """
        return self._many.to_xarray()

    @property
    def _many(self) -> Many:
        raise NotImplementedError


def columns(record: Any) -> Columns:
    """Return columns of one length by name, dimensionless."""
    if "displacement" not in record.signals:
        return {"tau": record.tau} | dict(record.signals)
    found = {"tau": np.repeat(record.tau, len(record.spheres))}
    places = places_of(record.problem.rest.atoms, record.spheres)
    found |= {name: np.tile(numbers, len(record.tau)) for name, numbers in places.items()}
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


def places_of(crystal: ase.Atoms, spheres: NDArray[np.int64], end: str = "") -> Columns:
    """Return row, column and, in a crystal of layers, layer of spheres; all −1 for the index −1.

    `end` is appended to the names.
    """
    names = (name for name in ("row", "column", "layer") if name in crystal.arrays)
    return {f"{name}{end}": np.where(spheres < 0, -1, crystal.arrays[name][spheres]) for name in names}


def si(record: Any) -> Columns:
    """Return columns of equal length by name, in SI units.

    For the centre sphere: ``t_s``, ``p_m``, ``q_m``, ``theta_rad``. For recorded spheres: ``t_s``, ``row``, ``column``,
    ``ux_m``, ``uy_m``, ``vx_m_s``, ``vy_m_s``, and ``spin_rad_s`` about z if spheres turn; in space also ``uz_m``,
    ``vz_m_s``, ``spinx_rad_s`` and ``spiny_rad_s``.
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


def read_trajectory(path: Path, header: list[str], samples: int | None = None) -> dict[str, NDArray[np.float64]]:
    """Return the columns of a table over tau; `samples` is its number of records, if known.

    Raises
    ------
    RunFolderError
        If the table is missing or malformed, or has another number of records.
    """
    try:
        text = path.read_text(encoding="utf-8")
        if not text.endswith("\n"):
            raise ValueError("its last line is cut off")
        names, *lines = csv.reader(text.splitlines())
        if names != header:
            raise ValueError(f"header {names}, expected {header}")
        columns = np.array(lines, dtype=float).reshape(-1, len(header)).T
        tau = columns[0]
        if not (np.isfinite(tau).all() and (tau >= 0).all() and (np.diff(tau) > 0).all()):
            raise ValueError("tau must be finite, not negative, and ascend")
        if samples not in (None, len(tau)):
            raise ValueError(f"{len(tau)} records, and {STATUS} says {samples}")
    except (OSError, ValueError, csv.Error) as error:
        raise RunFolderError(f"{path}: cannot be read: {one_line(error)}") from error
    return dict(zip(header, columns, strict=True))


def to_pandas(record: Any) -> Any:
    """Return a ``pandas.DataFrame`` of `columns`, with tau as the index for the centre sphere."""
    frame = optional_package("pandas").DataFrame(columns(record))
    return frame if "row" in frame else frame.set_index("tau")


def to_xarray(record: Any) -> Any:
    """Return an ``xarray.Dataset`` of the signals over tau, each with its unit and meaning.

    Its attributes are the scales for SI units, the end of the run, and the scene as TOML. For the centre sphere the
    scales are ``D0_m``, ``t0_s``, ``R_m``. For recorded spheres they are ``l_m`` (spheres that meet) or ``Delta0_m``
    (spheres held at rest), ``t0_s``, ``R_m``, with the coordinates ``row``, ``column`` and, for several layers,
    ``layer``.
    """
    scene, signals = record.scene, record.signals
    variables = {
        name: (("tau", "sphere", "axis")[: values.ndim], values, _attributes(scene, *_SAID[name]))
        for name, values in signals.items()
    }
    which: dict[str, Any] = {}
    if "displacement" in signals:
        which = {name: ("sphere", each) for name, each in places_of(record.problem.rest.atoms, record.spheres).items()}
        which["axis"] = [*"xyz"[: scene.space]]
    return _dataset(scene, variables, record.tau, which, {"status": str(record.info.get("status", ""))})


def _length(scene: Scene) -> str:
    """Return the name of the unit of displacements."""
    return scene.scale.name if scene.wave is None else "D0"


def _attributes(scene: Scene, unit: str, meaning: str) -> dict[str, str]:
    """Return the attributes of a variable."""
    return {"units": unit.format(length=_length(scene)), "long_name": meaning}


def _dataset(
    scene: Scene,
    variables: dict[str, Any],
    tau: NDArray[np.float64],
    which: dict[str, Any],
    attributes: dict[str, Any],
) -> Any:
    """Return an ``xarray.Dataset`` over tau with the scales of a scene, and the scene as TOML."""
    scales = {f"{_length(scene)}_m": length_of(scene), "t0_s": scene.scale.time, "R_m": scene.sphere.radius}
    coordinates = {"tau": ("tau", tau, _attributes(scene, *_SAID["tau"]))} | which
    attributes = scales | {"scene": scene.to_toml()} | attributes
    return optional_package("xarray").Dataset(variables, coordinates, attributes)


def optional_package(name: str) -> Any:
    """Return an optional package.

    Raises
    ------
    PackageMissingError
        If the package is not installed.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise PackageMissingError(f"{name} is not installed; pip install {name}") from error
