"""Tables of a scene file: frozen records whose fields carry their allowed range (`granular_lmp.scene.schema`).

Times are in units of t0 (τ), wave numbers in rad per row, and amplitudes in units of the static overlap Δ0. In a scene
without ``[wave]``, t0 is that of the impact (`granular_lmp.crystal.scale`) and some keys have another default
(`granular_lmp.scene.without_wave`). `granular_lmp.rest.refusals` checks combinations of values.
"""

import re
from collections.abc import Mapping
from dataclasses import field
from math import floor, hypot, pi, sqrt
from typing import Any

from granular_lmp.crystal.disorder import BOXES, WAYS, WHOLE
from granular_lmp.crystal.lattices import (
    FREE,
    HELD,
    HEXAGONAL,
    LATTICE_NAMES,
    ORIENTATIONS,
    PERIODIC,
    QUIET,
    WALL,
    Lattice,
)
from granular_lmp.crystal.mode import Physics
from granular_lmp.crystal.modes import MODES
from granular_lmp.crystal.sphere_table import NO_TABLE, SphereTable
from granular_lmp.crystal.wavevector import DIRECTIONS, WaveVector
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.clock import Ladder, Step
from granular_lmp.scene.forms import FORMS, MEANING, Form
from granular_lmp.scene.places import LAYERS_RULE, AtPlaces, Rows, Spheres, rows_rule, spheres_rule
from granular_lmp.scene.records import GivenValues
from granular_lmp.scene.schema import AUTO, Auto, Rule, choice, count, flag, number, shown, switch
from granular_lmp.scene.sphere_table import TABLE_RULE

ENDS = ("fixed", "periodic", AUTO)
FACES = (HELD, FREE, WALL, QUIET, AUTO)
SHEAR_LAWS = ("secant", "incremental")
RESCALED = (
    "rescaled"  # "secant" with a shear displacement that shrinks together with the contact; no theory here covers it
)
_OR_AUTO: dict[str, Any] = {"words": (AUTO,), "default": AUTO}
LARGEST_WAVENUMBER = sqrt(2) * pi  # the corner of the Brillouin zone of the square lattice
_BRANCH = "[SH]?[1-9][0-9]{0,3}"
NARROWEST = 3.0  # rows: a narrower envelope mixes the wave with all others


@dataclass(frozen=True)
class Packing(GivenValues):
    """Packing of a lattice: rows along y, columns along x, and the kind of each face.

    With a wave, sheets are periodic along x unless `sides` says otherwise; if the `ends` are fixed, the first and the
    last row are held unless `first` and `last` say otherwise. Without a wave all faces are free unless declared
    otherwise. Nothing touches a `free` face, so only adhesion holds together a crystal that has one.

    A ``quiet`` end is a held row behind rows that absorb waves (``[absorb]``, with "auto" as the default number of
    rows). With ``absorb.rows`` alone both ends are quiet.

    A ``wall`` is a rigid plane (``fix wall/gran``) that touches the row; if spheres are unequal, it touches the
    outermost sphere. Its contact law is that of the spheres on a rigid body: A is 2√2 times the value for two spheres.
    At rest the wall adheres as the spheres do, and carries the force of the row. Walls and held spheres support the
    `contact_force` that presses the chain of an impact together; at a free end a constant force pushes the last sphere.
    """

    lattice: str = choice("chain: a single line of spheres along y", LATTICE_NAMES, default=HEXAGONAL.name)
    rows: int | Auto = count("along y", 1, 10_000_000, **_OR_AUTO)
    columns: int | Auto = count("along x: at least 3; 1 in a chain", 1, 1_000_000, **_OR_AUTO)
    ends: str = choice("first and last row held, or a periodic cell", ENDS, default="fixed")
    first: str = choice("first row, with fixed ends; auto: held", FACES, default=AUTO)
    last: str = choice("last row, with fixed ends; auto: held", FACES, default=AUTO)
    sides: str = choice("first and last column of a sheet", (PERIODIC, HELD, FREE, WALL), default=PERIODIC)
    contact_force: float = number("N", "presses the contacts at rest together from outside", 0, 1e12, default=0.0)
    relax: str = choice(
        "for unequal spheres: the cell relaxes to the contact force, or keeps its size", BOXES, default="box"
    )
    relax_friction: float = number("", "of unequal spheres during relaxation; 0: none", 0, 1e4, default=0.0)
    relax_by: str = choice(
        "how unequal spheres relax; avalanches: faster in large crystals, ends with other contacts",
        WAYS,
        default=WHOLE,
    )
    space: int | Auto = count(
        "dimensions in which spheres move; auto: 3 on a substrate and in a lattice in space, else 2", 2, 3, **_OR_AUTO
    )
    layers: int | Auto = count(
        "along z; auto: 1, or the fewest that a crystal periodic along z can have", 1, 100_000, **_OR_AUTO
    )
    depth: str = choice(
        "faces along z of a lattice in space; auto: free on a substrate, else periodic",
        (PERIODIC, FREE, AUTO),
        default=AUTO,
    )
    orientation: str = choice(
        "crystal direction along y of a lattice in space; auto: [001] of cubic and fcc, c of hcp",
        (*ORIENTATIONS, AUTO),
        default=AUTO,
    )
    table: SphereTable = field(default=NO_TABLE, metadata={"rule": TABLE_RULE})


@dataclass(frozen=True)
class ModeRule(Rule):
    """Rule for a mode: L, TR, RT, the number of a branch, or S or H with a number."""

    @property
    def allowed(self) -> str:
        """Allowed values in words."""
        return f"{super().allowed}, the number of a branch, or S or H with a number"

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a name."""
        number = {"type": "integer", "minimum": 1, "maximum": 9999}
        return {"anyOf": [{"enum": list(self.words)}, {"type": "string", "pattern": f"^{_BRANCH}$"}, number]}

    def value(self, value: Any, key: str) -> str:
        """Return the value as a name; raise SceneError if it is not one."""
        name = str(value) if type(value) is int else value
        if not (isinstance(name, str) and (name in self.words or re.fullmatch(_BRANCH, name))):
            raise SceneError(f"{key} = {shown(value)}: must be {self.allowed}")
        return name


@dataclass(frozen=True)
class Wave:
    """Wave cos(k·r − Ωτ + phase) in one Bloch mode, r = 0 at the centre sphere, with amplitude D0/Δ0.

    A "running" wave fills the crystal at τ = 0 and runs along k. A "standing" wave is half of this wave plus half of
    its time reversal: the spheres start from rest, displaced by the same field. For a "driven" wave all is at rest at τ
    = 0; then the first row is moved by D0 cos(Ωτ − phase) at the frequency Ω of the mode, along y for L and along x for
    TR and RT. With "none" all is at rest and `granular_lmp.scene.sources` shake the crystal; D0 is their unit, and Ω of
    the mode their default frequency.

    If the `frequency` is declared, `wavenumber` follows from it (`granular_lmp.rest.frequency`).
    """

    mode: str = field(
        metadata={"rule": ModeRule(str, "", "longitudinal, transverse-rotational, rotational-transverse", words=MODES)}
    )
    wavenumber: float = number("rad per row", "xi", 1e-9, LARGEST_WAVENUMBER)
    amplitude: float = number("D0/Delta0", "displacement over static overlap", 0, 100, open_low=True)
    phase: float = number("rad", "at the centre sphere, or at the driven row", -2 * pi, 2 * pi, default=0.0)
    form: str = choice(MEANING, tuple(FORMS), default="running")
    frequency: float | None = number("Hz", "in place of wavenumber", 1e-6, 1e15, default=None)
    direction: float | str = number(
        "degrees", "from x towards y; or x, y", -180, 180, open_low=True, words=tuple(DIRECTIONS), default="y"
    )

    @property
    def words(self) -> str:
        """Mode and form in words: "TR", "TR standing"."""
        return f"{self.mode} {self.known.words}".rstrip()

    @property
    def known(self) -> Form:
        """Properties of the form of the wave."""
        return FORMS[self.form]

    @property
    def degrees(self) -> float:
        """Direction in degrees from x towards y."""
        return DIRECTIONS[self.direction] if isinstance(self.direction, str) else self.direction

    def vector(self, lattice: Lattice) -> WaveVector:
        """Return the wave vector as declared, in a lattice."""
        return lattice.vector(self.wavenumber, self.degrees)


def _size(meaning: str) -> Any:
    return number("rows", meaning, NARROWEST, 1e5, or_zero=True, default=0.0)


@dataclass(frozen=True)
class Envelope:
    """Gaussian envelope exp(−s²/2 length² − t²/2 width²) of the wave; s along k and t across it, in row spacings.

    With a length the wave is a packet, with a width a beam, and with both a pulse; 0 means no envelope. A driven row
    has only a width; its motion is switched on during the `ramp` by r(s) = s³(10 − 15s + 6s²), s = τ/ramp.
    """

    length: float = _size("standard deviation along the wave; 0: none")
    width: float = _size("standard deviation across the wave; 0: none")
    offset: float = number(
        "rows", "from the middle of the envelope to the centre sphere, along the wave", -1e5, 1e5, default=0.0
    )
    ramp: float = number("tau", "in which a driven row is switched on", 1, 1e5, default=20.0)

    @property
    def finite(self) -> bool:
        """True if the wave is limited in any direction."""
        return self.length > 0 or self.width > 0

    @property
    def kind(self) -> str:
        """Name of a wave with this envelope: "packet", "beam", "pulse", or "wave"."""
        kinds = {(True, False): "packet", (False, True): "beam", (True, True): "pulse"}
        return kinds.get((self.length > 0, self.width > 0), "wave")

    def spread(self, vector: WaveVector) -> tuple[float, float]:
        """Return the standard deviation along y in rows and along x in columns for a wave vector."""
        x, y = vector.unit
        rows, columns = hypot(self.length * y, self.width * x), hypot(self.length * x, self.width * y)
        return rows, columns * vector.row_spacing


FINEST = 1e-9  # τ, for a step and between records: 1e7 τ are 1e16 steps, and LAMMPS counts to 9e18


class Sampled:
    """Duration in samples and sample in time steps; a scene with a `tolerance` has no step until one is chosen."""

    duration: float
    timestep: float
    tolerance: float | None
    sample: float

    @property
    def clock(self) -> Step | Ladder:
        """Clock of one step, or of a ladder of steps; only this property tells them apart."""
        return Step(self.timestep, self.sample) if self.tolerance is None else Ladder(self.tolerance)

    @property
    def steps_per_sample(self) -> int:
        """Number of steps between two records; the step is rounded down to fit.

        Raises
        ------
        SceneError
            If the scene has a tolerance; ``scene.with_values({"time.timestep": step})`` has a step.
        """
        return self.clock.per_sample

    @property
    def step(self) -> float:
        """Time step of the run, in units of time: ``sample / steps_per_sample``, at most ``timestep``."""
        return self.sample / self.steps_per_sample

    @property
    def samples(self) -> int:
        """Number of records after the one at τ = 0."""
        return floor(self.duration / self.sample + 1e-9)

    @property
    def steps(self) -> int:
        """Number of time steps of the whole run."""
        return self.samples * self.steps_per_sample


# Either of the two keys replaces the other
STEP_OR_TOLERANCE = {"time.tolerance": ("time.timestep",), "time.timestep": ("time.tolerance",)}


def refuse_step_beside_tolerance(tables: Mapping[str, Any]) -> None:
    """Raise SceneError if tables of a scene hold both a time step and a tolerance."""
    time = tables.get("time")
    if isinstance(time, Mapping) and {"timestep", "tolerance"} <= set(time):
        raise SceneError(
            f"time.tolerance = {shown(time['tolerance'])}: excludes time.timestep = {shown(time['timestep'])}; "
            "give one of the two"
        )


@dataclass(frozen=True)
class Time(GivenValues, Sampled):
    """Duration and sampling of the run in τ, and either its time step or the required accuracy.

    With a `tolerance` the scene has no step until `granular_lmp.accuracy.tolerance` chooses one.

    Good values for an impact: a step of 0.03 is T/80, with the collision time T = 2.439 t0 of two spheres. After 12
    collision times the error of the velocities is then 1.4e-4 (root mean square; 6e-4 at the worst place). It falls
    with the square of the step, but only with the step itself if there is damping, or friction with the law
    "incremental" (the case "impact").
    """

    duration: float = number("tau", "of the run", 1e-3, 1e8)
    timestep: float = number("tau", "at most", FINEST, 2, default=0.05)
    tolerance: float | None = number(
        "",
        "in place of timestep: relative L2 error of p, q and phi; of velocities, relative to the fastest striker",
        1e-9,
        0.1,
        default=None,
    )
    sample: float = number("tau", "between records", FINEST, 1e8, default=0.5)
    allow_echo: bool = flag("true: run on after the echo of the walls reaches the centre", default=False)


LOAD, DISTANCE = "load", "distance"  # where an adhering contact opens, beyond an overlap of 0


@dataclass(frozen=True)
class Effects(GivenValues):
    """Effects in the deck, each true, false or "auto", and coefficients for some of them.

    `granular_lmp.effects` decides each "auto" and gives the reason. Walls and the width of the packing are effects too;
    ``packing.ends`` and ``packing.columns`` switch them.
    """

    adhesion: bool | Auto = switch("adhesion of the spheres; without it the Hertz contact")
    shear: bool | Auto = switch("Mindlin shear force")
    rotation: bool | Auto = switch("spheres turn")
    tracking: bool | Auto = switch("record the angle")
    sliding: bool | Auto = switch("contacts slide at the Coulomb limit of friction")
    damping: bool | Auto = switch("contacts dissipate by viscosity or restitution")
    contact_opening: bool | Auto = switch("contacts part and meet again")
    rolling: bool | Auto = switch("contacts resist rolling")
    twisting: bool | Auto = switch("contacts resist twisting")
    shear_law: str = choice("law of the shear force", (*SHEAR_LAWS, RESCALED), default="secant")
    friction: float | Auto = number("", "coefficient; auto: none slides", 0, 1e4, words=(AUTO,), default=AUTO)
    viscosity: float = number("N s/m", "dashpot of a contact", 0, 1e12, default=0.0)
    rolling_stiffness: float = number("N/m", "of a contact against rolling", 0, 1e12, default=0.0)
    rolling_viscosity: float = number("N s/m", "dashpot of a contact against rolling", 0, 1e12, default=0.0)
    rolling_friction: float = number("", "largest rolling over normal force", 0, 1e4, default=0.0)
    restitution: float = number("", "of a Hertz contact; 1: no loss", 0, 1, open_low=True, default=1.0)
    parting: str = choice("where a JKR contact ends: at the largest pull, or distance", (LOAD, DISTANCE), default=LOAD)
    shear_damping: float = number("", "dashpot of shear over dashpot of normal motion", 0, 100, default=1.0)

    @property
    def physics(self) -> Physics:
        """Degrees of freedom of the lattice; any that is still "auto" counts as present."""
        shear = self.shear is not False
        rotation = shear and self.rotation is not False  # nothing else turns a sphere
        return Physics(shear, rotation, self.rolling_stiffness if rotation and self.rolling is not False else 0.0)


@dataclass(frozen=True)
class Absorb:
    """Quiet ends: rows before the held rows that absorb incoming waves."""

    rows: int | Auto = count("rows that absorb at each end; 0: none", 0, 10_000, words=(AUTO,), default=0)
    reflection: float = number("", "share of the amplitude that may come back", 1e-5, 0.5, default=1e-3)


@dataclass(frozen=True)
class Output(GivenValues, AtPlaces):
    """Output of a run beside the record of the centre sphere; without ``[wave]``, the recorded spheres.

    Without ``[wave]`` they are recorded at each sample; all are recorded if none are declared. Other scenes have
    monitors.
    """

    rows: Rows = field(default=(), metadata={"rule": rows_rule("first and last recorded row")})
    spheres: Spheres = field(default=(), metadata={"rule": spheres_rule("[row, column] of each recorded sphere")})
    layers: Rows = field(default=(), metadata={"rule": LAYERS_RULE})
    forces: bool = flag("true: record the force on each recorded sphere too", default=False)
    particles: float = number("tau", "between snapshots of all spheres; 0: none", 0, 1e7, default=0.0)
    checkpoint: float | Auto = number(
        "minutes",
        "between two checkpoints; auto: at most 1 % of the run time",
        0,
        1e5,
        open_low=True,
        words=(AUTO,),
        default=AUTO,
    )

    @property
    def everyone(self) -> bool:
        """True if all spheres are recorded."""
        return not self.rows and not self.spheres
