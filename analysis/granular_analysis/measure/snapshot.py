"""First snapshot of a LAMMPS run as a network, so that the witness starts where the run started.

The dump is text, for step 0, with the columns of `dump.particles` of a scene: id, type, x, y, radius, mass if spheres
differ, the displacement from rest, vx, vy, omegaz and the angle v_theta. A displacement along z means spheres in space,
with z, vz, all spins, and the quaternion Orientation. Numbers stay in the units of the dump. Materials must be given in
these units: for `nano` (ag, nm, ns), E in MPa and w in mJ/m²; for `micro` (pg, µm, µs), kPa and mJ/m²; for `si`, SI.
`first_snapshot` takes everything from a record.

Later snapshots are refused, because no dump has the slip of contacts that they would need.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.outside import Scales, outside
from granular_analysis.measure.stiffnesses import CLASSES, kinds_of, levels_of
from granular_analysis.measure.strikes import scale_of_strike
from granular_analysis.second_harmonic import ALONG_Y
from granular_analysis.theory.bloch import frame
from granular_analysis.theory.choice import switched
from granular_analysis.theory.errors import TheoryError, one_of
from granular_analysis.theory.network import LAWS, Material, Network
from granular_analysis.theory.network_laws import ADHESIONS
from granular_analysis.theory.network_motion import Trajectory
from granular_analysis.theory.network_state import State, loaded, settled, start
from granular_lmp.runs.record import Record, Scene

__all__ = ["first_snapshot"]

Floats = NDArray[np.float64]

_TURNS = {2: ["v_theta"], 3: [f"Orientation.{part}" for part in "WXYZ"]}  # by dimension
_SPINS = {2: ["omegaz"], 3: ["omegax", "omegay", "omegaz"]}
_TITLES = {0: "TIMESTEP", 2: "NUMBER", 4: "BOX", 8: "ATOMS"}  # by line
SNAPSHOTS = "dump.particles"
_PRELOAD = 1e6  # steps of the preload in a deck
CENTRE = "dump.centre"  # beside the snapshots; it names the recorded sphere
# Largest radius (m) of the spheres of a LAMMPS unit style, and the style's units of mass, length and time in SI
UNITS = ((1e-5, (1e-21, 1e-9, 1e-9)), (1e-3, (1e-15, 1e-6, 1e-6)), (np.inf, (1.0, 1.0, 1.0)))


class Spheres(NamedTuple):
    """N spheres at the start of a run, in the units of its deck.

    Attributes
    ----------
    types : (N,) types in LAMMPS: 2m + 1 for free and 2m + 2 for held spheres of material m, counted from 0.
    place : (N, d) places at rest.
    radius, density : (N,).
    displacement, velocity : (N, d).
    rotation, spin : (N, 1), in space (N, 3); as for `granular_analysis.theory.network_state.start`.
    cell : (d,) periods, inf along axes without one.
    """

    types: NDArray[np.intp]
    place: Floats
    radius: Floats
    density: Floats
    displacement: Floats
    velocity: Floats
    rotation: Floats
    spin: Floats
    cell: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class FirstSnapshot:
    """A run at its start, in the units of its deck.

    Attributes
    ----------
    network, state : the spheres at rest, and the state from which they start.
    recorded : index of the sphere whose motion is the record of a wave; −1 in a run without a wave.
    scales : units of the record, see `granular_analysis.measure.outside.Scales`.
    direction : direction of the wave vector, degrees from a close-packed row.
    """

    network: Network
    state: State
    recorded: int
    scales: Scales
    direction: float

    @property
    def time(self) -> float:
        """Return t0."""
        return self.scales.time

    @property
    def length(self) -> float:
        """Return D0, or ℓ without a wave."""
        return self.scales.length

    @property
    def radius(self) -> float:
        """Return R of the declared sphere."""
        return self.scales.radius

    def signals(self, run: Trajectory) -> tuple[Floats, ...]:
        """Return the motion of the first sphere of a trajectory in D0, (T,) each: p, q, φ; in space ux, uy, uz, Rθ."""
        ways, turns = run.displacement[:, 0].T / self.length, run.rotation[:, 0].T * self.radius / self.length
        if len(ways) == 2:
            ways = frame(self.direction) @ ways
        return (*ways, *turns)

    def fields(self, run: Trajectory) -> tuple[Floats, Floats, Floats]:
        """Return displacements in ℓ, velocities in ℓ/t0, (T, n, d), and Rω in ℓ/t0, (T, n) or in space (T, n, 3)."""
        speed = self.length / self.time
        spin = run.spin * self.radius / speed
        return run.displacement / self.length, run.velocity / speed, spin[..., 0] if spin.shape[-1] == 1 else spin


def first_snapshot(record: Record) -> FirstSnapshot:
    """Return the network of a run, with the contact law, the friction and the materials of its scene.

    Raises RunFolderError for a run without snapshots (``output.particles``) and OSError for a folder without `CENTRE`.
    Raises TheoryError if the first snapshot is not of step 0, lacks a sphere or a column (as without
    ``effects.tracking``), or is not a dump, and as `network_of` does.
    """
    scene, path = record.scene, _snapshots(record)
    scales = scales_of(record)
    density = scene.sphere.density / (scales.kilogram / scales.metre**3) if "mass" not in _columns(path) else None
    turned = scene.wave is not None and scene.wave.form != "none"
    spheres = _read(path, density, rotation=switched(record).get("rotation", True), turned=turned)
    recorded = -1
    if scene.wave is not None:
        with _opened(_centre_of(path.parent)) as stream:
            _head(stream)
            recorded = int(stream.readline().partition(" ")[0]) - 1
    return network_of(record, spheres, recorded)


def network_of(record: Record, spheres: Spheres, recorded: int) -> FirstSnapshot:
    """Return the network of the spheres with which a run begins.

    Friction is infinite unless contacts may slide (``effects.sliding``); a deck without sliding has a coefficient so
    large that nothing slides.

    Raises TheoryError for a declared material that no sphere has, for unknown actions from outside
    (`granular_analysis.measure.outside`), and for contacts that resist rolling or twisting.
    """
    scene, on, declared = record.scene, switched(record), record.scene.effects
    if lacks := [f"effects.{name}" for name in ("rolling", "twisting") if on.get(name, False)]:
        raise TheoryError(f"the network leaves out {', '.join(lacks)}")
    scales = scales_of(record)
    damped = on.get("damping", True)
    network, state = _placed(
        spheres,
        _materials(record, scales),
        law=one_of(LAWS, declared.shear_law, "law"),
        friction=float(declared.friction) if on.get("sliding", False) else np.inf,
        shear=on.get("shear", True),
        rotation=on.get("rotation", True),
        viscosity=getattr(declared, "viscosity", 0.0) / (scales.kilogram / scales.second) if damped else 0.0,
        restitution=declared.restitution if damped and declared.restitution < 1 else None,
        adhesion=one_of(ADHESIONS, scene.material.adhesion_law, "adhesion"),
    )
    _refuse_replaced(record, network)
    network = replace(network, **outside(record, network, scales))
    direction = ALONG_Y if scene.wave is None else scene.direction
    state = loaded(network, state.motion, _preloading(scene) / scales.time)
    if not scene.held_at_rest:  # contacts of spheres that just touch begin where they overlap
        state = settled(network, replace(state, begun=np.zeros_like(state.begun)), stepped=True)
    return FirstSnapshot(network, state, recorded, scales, direction)


def _preloading(scene: Scene) -> float:
    """Return 1 over the duration of the preload, in 1/t0; 0 for an extrapolation to short steps."""
    return 0.0 if scene.time.tolerance is not None else 1 / (_PRELOAD * scene.time.step)


def scales_of(record: Record) -> Scales:
    """Return the units of a record and of its deck.

    The deck of spheres that just touch has the units m, R and t0; other decks have LAMMPS units by radius (`UNITS`).
    """
    scene, sphere = record.scene, record.scene.sphere
    if not scene.held_at_rest:
        length, time = scale_of_strike(scene)
        kilogram, metre, second = sphere.density * 4 / 3 * np.pi * sphere.radius**3, sphere.radius, time
        stiffness = 0.0
    else:
        length, time = scene.displacement_amplitude, sphere.time_scale
        _, (kilogram, metre, second) = next(unit for unit in UNITS if sphere.radius < unit[0])
        stiffness = sphere.normal_stiffness / (kilogram / second**2)
    return Scales(length / metre, time / second, stiffness, sphere.radius / metre, kilogram, metre, second)


def _snapshots(record: Record) -> Path:
    """Return the path of the dump of all spheres of a run.

    Raises TheoryError for a run without a wave that recorded only some of its spheres, and RunFolderError for a wave
    without snapshots.
    """
    if record.scene.wave is not None:
        return record.snapshots().path
    path = Path(record.folder or ".") / SNAPSHOTS
    if record.scene.output.rows or record.scene.output.spheres:
        raise TheoryError("output.rows and output.spheres: remove them, as the network starts from all spheres")
    return path


@contextmanager
def _opened(path: Path) -> Iterator[TextIO]:
    """Open a dump; raise TheoryError if the file is not text, or has a word in place of a number."""
    with path.open(encoding="utf-8") as stream:
        try:
            yield stream
        except TheoryError:
            raise
        except (ValueError, IndexError) as error:
            raise TheoryError(f"{path}: is no text dump of LAMMPS: {error}") from error


def _columns(path: Path) -> list[str]:
    with _opened(path) as stream:
        return _head(stream)[8][2:]


def _centre_of(folder: Path) -> Path:
    """Return the dump of the recorded sphere; of a run with a tolerance, whose dumps share the sphere, the first."""
    steps = sorted(folder.glob(f"*_per_sample/{CENTRE}"))
    return steps[0] if steps else folder / CENTRE


def _materials(record: Record, scales: Scales) -> list[Material]:
    """Return the materials of a run in units of its deck, each repeated for all classes of stiffness."""
    return [scales.material(kind) for kind in kinds_of(record.scene) for _ in range(_classes(record))]


def _classes(record: Record) -> int:
    return len(levels_of(record.scene)) * (CLASSES if record.scene.disorder.stiffness else 1)


def _refuse_replaced(record: Record, network: Network) -> None:
    """Raise TheoryError if a declared material has no sphere: the deck omits it without saying which one."""
    declared, last = len(kinds_of(record.scene)), 0 if network.kind is None else int(network.kind.max())
    there = 1 + last // _classes(record)
    if there < declared:
        raise TheoryError(
            f"inclusion: the scene declares {declared} materials, the lattice's included, and spheres have {there}; "
            "remove inclusions whose spheres are all replaced by later ones"
        )


def _read(path: Path, density: float | None, *, rotation: bool, turned: bool) -> Spheres:
    """Return the spheres of a dump, in the order of their numbers.

    Parameters
    ----------
    path : the dump.
    density : density of all spheres, for a dump without the column mass; otherwise None.
    rotation : whether spheres turn, so that the dump must have their spins.
    turned : whether spheres are rotated at the start, so that the dump must have their angles too.

    Raises TheoryError for a file that is not a dump of step 0, lacks a column or is cut off.
    """
    with _opened(path) as stream:
        head = _head(stream)
        if head[1] != ["0"]:
            raise TheoryError(
                f"{path}: begins at step {head[1][0]}, must be 0, because dumps do not hold the slip of contacts"
            )
        names, count = head[8][2:], int(head[3][0])
        axes = "xyz"[: 3 if "Displacement.Z" in names else 2]
        places, ways = [*axes], [f"Displacement.{axis.upper()}" for axis in axes]
        rates, spins, turns = [f"v{axis}" for axis in axes], _SPINS[len(axes)], _TURNS[len(axes)]
        # Columns that the dump needs only if spheres turn
        turning = (spins + turns if turned else spins) if rotation else []
        needed = ["id", "type", *places, "radius", *ways, *rates, *turning]
        missing = [name for name in needed if name not in names]
        if missing:
            raise TheoryError(f"{path}: has no column {', '.join(missing)}")
        rows = [stream.readline().split() for _ in range(count)]
        if any(len(row) != len(names) for row in rows):
            raise TheoryError(f"{path}: its first snapshot is cut off")
        numbers, cell = np.array(rows, dtype=float).T, _cell(head, len(axes))
    table = dict.fromkeys(spins + turns, np.zeros(count)) | dict(zip(names, numbers, strict=True))
    order = np.argsort(table["id"])

    def columns(named: Sequence[str]) -> Floats:
        return np.stack([table[name][order] for name in named], axis=1)

    radius, displacement = table["radius"][order], columns(ways)
    return Spheres(
        table["type"][order].astype(np.intp),
        columns(places) - displacement,
        radius,
        np.full(count, density) if density is not None else table["mass"][order] / (4 / 3 * np.pi * radius**3),
        displacement,
        columns(rates),
        _rotation(columns(turns)),
        columns(spins),
        cell,
    )


def _placed(spheres: Spheres, materials: Sequence[Material], **laws: Any) -> tuple[Network, State]:
    """Return the network of spheres with these materials and laws, and the state from which they start.

    Raises TheoryError for a type without a material.
    """
    last = spheres.types.max()
    if last > 2 * len(materials):
        raise TheoryError(
            f"a sphere has type {last}, which means material {(last + 1) // 2}; materials has {len(materials)}"
        )
    kind, held = (spheres.types - 1) // 2, spheres.types % 2 == 0
    network = Network(
        spheres.place, spheres.radius, spheres.density, tuple(materials), kind, held, spheres.cell, **laws
    )
    turns, spins = (each[:, 0] if each.shape[1] == 1 else each for each in (spheres.rotation, spheres.spin))
    return network, start(network, spheres.displacement, spheres.velocity, turns, spins)


def _rotation(columns: Floats) -> Floats:
    """Return angles (N, 1) unchanged, and for quaternions (N, 4) twice their vector over their scalar, (N, 3)."""
    if columns.shape[1] == 1:
        return columns
    scalar = columns[:, :1]
    return np.divide(2 * columns[:, 1:], scalar, out=np.zeros_like(columns[:, 1:]), where=scalar != 0)


def _head(stream: TextIO) -> list[list[str]]:
    """Return the words of the nine lines before the spheres."""
    head = [stream.readline().split() for _ in range(9)]
    if [head[number][:2] for number in _TITLES] != [["ITEM:", title] for title in _TITLES.values()]:
        raise TheoryError(f"{stream.name}: is no text dump of LAMMPS")
    return head


def _cell(head: list[list[str]], dimension: int) -> tuple[float, ...]:
    """Return the period along each axis from the nine lines before the spheres; inf along an axis without one."""
    edges = zip(head[4][3:], head[5:8], strict=True)
    periods = [float(high) - float(low) if edge == "pp" else np.inf for edge, (low, high) in edges]
    return tuple(periods[:dimension])
