"""Find the scene that describes the crystal of a foreign deck: its lattice, spheres, contact law, faces and beginning.

A property that a scene cannot have is refused by name. Each scene is tested: LAMMPS reads the deck that the package
builds from it, and `granular_lmp.foreign.likeness` compares this deck with the foreign one, sphere by sphere and
contact by contact.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattice import CHAIN
from granular_lmp.crystal.lattices import FREE, HELD, PERIODIC, WALL
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.sphere_table import SITE, SphereTable
from granular_lmp.errors import GranularError, SceneError
from granular_lmp.foreign.begun import Motion, begins
from granular_lmp.foreign.between import UNDERSTOOD
from granular_lmp.foreign.conversion import Known
from granular_lmp.foreign.indexing import Indexed, index, neighbours
from granular_lmp.foreign.laws import MATERIAL, Law
from granular_lmp.foreign.likeness import Likeness, likeness
from granular_lmp.foreign.outside import Outside
from granular_lmp.foreign.reading import Reading
from granular_lmp.foreign.stages import Spheres, Stage
from granular_lmp.frozen import dataclass
from granular_lmp.rest.scene import Scene
from granular_lmp.units import STYLES, Units

Floats = NDArray[np.float64]

_SHEARED = {"mindlin": "secant", "mindlin/force": "incremental", "mindlin_rescale": "rescaled"}
_TOUCHING = 1e-9  # times the radius; smaller overlaps and gaps are rounding of places
_UNLOADED = 1e-6  # times the pull-off force; a smaller load is rounding of places
_LEAST_STRAIN = 1e-7
_STRAIN = 0.05  # times the static compression; a larger strain of the whole crystal makes its contacts unequal
_ALIKE = 1e-9  # relative difference of equal radii, densities and constants
_EVEN = 1e-6  # times the time between records; smaller differences are rounding by %g
_MOST_WAYS = 4  # this many ways to number a crystal in its lattice are tried as scenes


@dataclass(frozen=True)
class Described:
    """A scene that describes a foreign deck.

    Attributes
    ----------
    scene : Scene
    indexed : Indexed
        Place of each sphere of the deck.
    likeness : Likeness
        Differences of the two decks.
    unsaid : tuple of str
        Sentences on settings of the deck that the scene leaves out because they change nothing.
    """

    scene: Scene
    indexed: Indexed
    likeness: Likeness
    unsaid: tuple[str, ...]


def scene_of(reading: Reading, known: Known, name: str, times: Floats) -> Described:
    """Return the scene of a foreign deck.

    Parameters
    ----------
    reading : Reading
    known : Known
        Known quantities of its dumps.
    name : str
        Name of the scene.
    times : (T,) array
        Times of the records, s.

    Raises
    ------
    SceneError
        If no scene describes the crystal; the message gives the reason.
    """
    spheres, units = _whole(reading, known), STYLES[reading.units]
    law = _one_law(reading, spheres)
    si = _in_si(spheres, units)
    edges = units.si(np.subtract(reading.high, reading.low), length=1)
    radius, apart = _most(si.radius), neighbours(si.position)
    strain = max(_STRAIN * (1 - apart / (2 * radius)), _LEAST_STRAIN)
    troubles = []
    for number, indexed in enumerate(index(si.position, edges, np.array(reading.periodic), strain)):
        if number == _MOST_WAYS:
            break
        try:
            return _described(reading, known, si, law, indexed, name, times)
        except GranularError as error:
            troubles.append(str(error))
    raise SceneError(troubles[0])


def _described(
    reading: Reading, known: Known, spheres: Spheres, law: Law, indexed: Indexed, name: str, times: Floats
) -> Described:
    """Return the scene of spheres, in SI units, whose places in a lattice are known."""
    units, unsaid = STYLES[reading.units], list[str]()
    motion = Motion.of(spheres, indexed)
    if indexed.lattice.sheet is False and law.friction:
        unsaid.append(f"friction {law.friction:g}: nothing is sheared in a chain")
    if reading.dimension == 3 and not indexed.lattice.solid:
        unsaid.append("dimension 3: spheres of the scene move in a plane, from which no force of the deck drives them")
    if len(times) > 1 and np.ptp(np.diff(times)) > _EVEN * np.diff(times).max():
        unsaid.append("snapshots at uneven times: the scene has records as far apart as the nearest two")
    failed: GranularError | None = None
    periodic = (np.abs(indexed.turn) @ np.array(reading.periodic) > 0).tolist()
    for sphere, load, touching in _spheres(spheres, law, indexed, units, periodic=periodic[1]):
        packing = _packing(spheres, indexed, reading, load, _walls(known.outside, indexed))
        _refuse_pushes(known.outside, indexed, packing)
        tables: dict[str, Any] = {"sphere": _given(sphere), "packing": packing}
        tables |= _differing(spheres, indexed, sphere)
        if touching and sphere.work_of_adhesion:
            tables["start"] = {"touching": True}
        effects = partial(_effects, law, spheres, known.outside, units, indexed)
        try:
            for more in begins(tables, motion, effects, _clock(reading, known.outside, times)):
                scene = Scene.from_dict(more, name)
                try:
                    like = likeness(reading, spheres, scene, indexed, known.outside)
                    return Described(scene, indexed, like, tuple(unsaid))
                except GranularError as error:
                    failed = failed or error
        except GranularError as error:
            failed = failed or error
    raise failed or SceneError("nothing moves at the beginning of its first long run, and a scene says what moves")


def _clock(reading: Reading, outside: Outside, times: Floats) -> tuple[float, float, float]:
    """Return, in s, the step, the time between records, and the time from the start of the run to the last record.

    With fewer than two records, the last two are the step and the time of the run.
    """
    start = _start_of(reading)
    step = float(STYLES[reading.units].si(start.timestep, time=1))
    if len(times) < 2:
        return step, step, step * (start.steps or 1)
    begin = min(step * (outside.begin or 0), float(times[0]))
    return step, float(np.diff(times).min()), float(times[-1]) - begin


# --- what is refused before a lattice is sought -----------------------------------------------------------------------


def _start_of(reading: Reading) -> Stage:
    assert reading.start is not None  # `_whole` asks for it
    return reading.start


def _whole(reading: Reading, known: Known) -> Spheres:
    """Return the spheres of a deck; refuse actions on them that no key of a scene describes."""
    start, spheres, outside = reading.start, reading.spheres, known.outside
    recorded = next((each for each in reading.records if each.spheres is known.spheres), None)
    if start is None or spheres is None or reading.pairs is None or recorded is None:
        raise SceneError("the deck has no spheres at the beginning of its first long run")
    if not start.exact or outside.history or recorded.stage is not start:
        raise SceneError("a run or a minimization precedes the recorded run, and is not executed here")
    if reading.units not in STYLES or reading.units == "lj":
        raise SceneError(f"units {reading.units}: a scene is in SI units")
    if any(reading.tilt) and any(reading.periodic):
        raise SceneError("the box is tilted; the box of a scene is not")
    for command in reading.commands:
        if command.name not in UNDERSTOOD or (command.name == "neigh_modify" and "exclude" in command.words):
            raise SceneError(f"'{command}': no key of a scene says what it does")
    for sentence in outside.unfollowed:
        raise SceneError(sentence)
    for said in (*outside.others, *start.resets):
        raise SceneError(f"'{said}': no key of a scene says what it does")
    if outside.motions:
        raise SceneError(f"a fix moves sphere {outside.motions[0].spheres[0]}; describe this by a [[source]]")
    if outside.discs:
        raise SceneError("discs: the spheres of a scene have the moment of inertia of spheres")
    moves = ~np.isin(spheres.id, outside.held)
    if spheres.velocity[~moves].any() or spheres.spin[~moves].any():
        raise SceneError("spheres that no force moves have velocities")
    return replace(spheres, moves=moves, turns=moves & outside.rotation)


def _in_si(spheres: Spheres, units: Units) -> Spheres:
    return replace(
        spheres,
        radius=units.si(spheres.radius, length=1),
        mass=units.si(spheres.mass, mass=1),
        position=units.si(spheres.position, length=1),
        velocity=units.si(spheres.velocity, length=1, time=-1),
        spin=units.si(spheres.spin, time=-1),
        force=units.si(spheres.force, mass=1, length=1, time=-2),
        torque=units.si(spheres.torque, mass=1, length=2, time=-2),
    )


def _one_law(reading: Reading, spheres: Spheres) -> Law:
    """Return the law of all contacts; refuse several laws, and parts that no scene describes."""
    present = set(np.unique(spheres.type).tolist())
    laws = {types: law for types, law in reading.laws.items() if {*types} <= present}
    if not laws:
        raise SceneError("the contact law is none of pair_style granular with hertz/material, dmt or jkr")
    plain = {types: replace(law, command=_start_of(reading).command) for types, law in laws.items()}
    (first, law), *others = plain.items()
    for types, other in others:
        if other != law:
            raise SceneError(
                f"contacts of types {first[0]} {first[1]} and {types[0]} {types[1]} have different laws; a scene "
                "of one material has one law; describe other materials by an [[inclusion]]"
            )
    law = laws[first]
    if law.normal not in MATERIAL or law.unread:
        raise SceneError(f"'{law.command}': no key of a scene says {law.unread or law.normal}")
    if law.mixed and law.shear_share != 1 and law.has_history and law.friction:
        raise SceneError(
            "LAMMPS mixes the shear modulus of two types differently from contact mechanics, which a scene follows"
        )
    if law.damping and law.damping_law not in ("velocity", "coeff_restitution"):
        raise SceneError(f"damping {law.damping_law}: a scene has damping velocity and coeff_restitution")
    if not (law.has_history or law.tangential in ("none", "linear_nohistory")):
        raise SceneError(f"tangential {law.tangential}: no key of a scene says it")
    if law.tangential == "linear_nohistory" and law.shear_damping and law.friction:
        raise SceneError("tangential linear_nohistory: no key of a scene describes its damping")
    if law.has_history and law.tangential not in _SHEARED:
        raise SceneError(f"tangential {law.tangential}: a scene has {', '.join(_SHEARED)}")
    return law


# --- the tables of a scene --------------------------------------------------------------------------------------------


def _most(values: Floats) -> float:
    """Return the value of most spheres; the mean if fewer than half have the same value."""
    _, first, counts = np.unique(np.round(values / values.max(), 9), return_index=True, return_counts=True)
    most = int(np.argmax(counts))
    return float(values[first[most]]) if 2 * counts[most] >= len(values) else float(values.mean())


def _spheres(
    spheres: Spheres, law: Law, indexed: Indexed, units: Units, *, periodic: bool
) -> Iterator[tuple[Sphere, dict[str, Any], bool]]:
    """Yield the sphere of the lattice, the keys of its load at rest, and whether contacts just touch.

    Unequal spheres that only adhesion holds rest in a box of free size; others rest in a box of fixed size.
    """
    sphere = _sphere(spheres, law, indexed, units)
    overlap, unequal = 2 * sphere.radius - indexed.touching, bool(np.ptp(spheres.radius) > _ALIKE * sphere.radius)
    if indexed.lattice == CHAIN and not periodic:  # spheres may differ, and lie side by side
        order = np.argsort(indexed.row)
        along, own = (spheres.position @ indexed.turn.T)[order, 1], spheres.radius[order]
        overlap = float(np.mean(own[1:] + own[:-1] - np.diff(along)))
    if abs(overlap) < _TOUCHING * sphere.radius or (unequal and overlap > 0 and not sphere.work_of_adhesion):
        yield sphere, {}, True
    if abs(overlap) < _TOUCHING * sphere.radius:
        return
    if overlap < 0 and law.normal != "jkr":
        raise SceneError(
            f"neighbours are {-overlap:.3g} m apart, {-overlap / sphere.radius:.2g} of a radius; in a scene they touch"
        )
    force = _rounded(float(sphere.contact_law.force(overlap)), 9)
    if sphere.work_of_adhesion and (unequal or abs(force) < _UNLOADED * sphere.pull_off_force):
        yield sphere, {}, False
    if abs(force) < _UNLOADED * sphere.pull_off_force:
        return
    if force > 0:
        yield sphere, {"contact_force": force} | ({"relax": "fixed"} if unequal else {}), False
    elif not unequal:
        raise SceneError(
            f"neighbours overlap by {overlap:.6g} m, and pull at each other with {-force:.3g} N; in a scene they are "
            f"at rest, {sphere.static_overlap:.6g} m deep, or pressed together"
        )


def _sphere(spheres: Spheres, law: Law, indexed: Indexed, units: Units) -> Sphere:
    """Return the sphere of the lattice, without a load."""
    radius = _most(spheres.radius)
    if indexed.lattice != CHAIN:  # unequal spheres of a sheet lie in places for the largest
        loose = abs(2 * float(spheres.radius.max()) / indexed.touching - 1) < _TOUCHING
        radius = float(spheres.radius.max()) if loose else radius
    density = _rounded(_most(spheres.density))
    if law.normal == "jkr" and not law.gamma:
        raise SceneError("jkr without a surface energy: take hertz/material")
    return Sphere(
        radius,
        _rounded(float(units.si(law.young, mass=1, length=-1, time=-2))),
        law.poisson,
        _rounded(2 * float(units.si(law.gamma, mass=1, time=-2))),
        density,
        adhesion_law="jkr" if law.normal == "jkr" else "dmt",
    )


def _rounded(value: float, digits: int = 13) -> float:
    """Return a number with the digits that are exact after units and places were converted."""
    return float(f"{value:.{digits}g}")


def _given(sphere: Sphere) -> dict[str, Any]:
    table: dict[str, Any] = {"radius": sphere.radius, "youngs_modulus": sphere.youngs_modulus}
    table |= {"poisson_ratio": sphere.poisson_ratio, "density": sphere.density}
    if sphere.work_of_adhesion:
        table["work_of_adhesion"] = sphere.work_of_adhesion
    if sphere.adhesion_law != Sphere.adhesion_law:
        table["adhesion_law"] = sphere.adhesion_law
    return table


def _walls(outside: Outside, indexed: Indexed) -> list[str]:
    """Return the faces of a crystal that have walls; the places and laws of the walls are compared later."""
    names = {(1, -1): "first", (1, 1): "last", (0, -1): "sides", (0, 1): "sides"}
    found = []
    for wall in outside.walls:
        way = indexed.turn[:, wall.axis] * wall.side
        axis = int(np.argmax(np.abs(way)))
        face = names.get((axis, int(way[axis])))
        if face is None:
            raise SceneError("a plane stands beside the layers of the crystal; say it by a [substrate]")
        found.append(face)
    if found.count("sides") == 1:
        raise SceneError("a plane stands at one side of the crystal; a scene has walls at both sides or none")
    return found


def _packing(
    spheres: Spheres, indexed: Indexed, reading: Reading, load: Mapping[str, Any], walls: Sequence[str]
) -> dict[str, Any]:
    """Return the table ``[packing]``: size and faces, which hold just the spheres that no fix moves."""
    lattice, (rows, columns, layers) = indexed.lattice, indexed.shape
    name, _, orientation = lattice.name.partition(" ")
    periodic = np.abs(indexed.turn) @ np.array(reading.periodic) > 0
    table: dict[str, Any] = {"lattice": name, "rows": rows, "columns": columns}
    table |= {"ends": "periodic" if periodic[1] else "fixed"}
    held = ~spheres.moves
    expected = np.zeros(len(held), dtype=bool)
    faces = [] if periodic[1] else [("first", indexed.row == 0), ("last", indexed.row == rows - 1)]
    if lattice.sheet:
        table["sides"] = PERIODIC
        if not periodic[0]:
            faces.append(("sides", (indexed.column == 0) | (indexed.column == columns - 1)))
    for face, there in faces:
        table[face] = HELD if held[there].all() else WALL if face in walls else FREE
        expected |= there & (table[face] == HELD)
    if not np.array_equal(held, expected):
        odd = int(spheres.id[held != expected][0])
        raise SceneError(
            f"sphere {odd} {'is held' if held[held != expected][0] else 'moves'}: a scene holds whole faces, the first "
            "and the last row, and the first and the last column"
        )
    if lattice.solid:
        table |= {"orientation": orientation, "layers": layers, "depth": PERIODIC if periodic[2] else FREE}
    return {**table, **load}


def _refuse_pushes(outside: Outside, indexed: Indexed, packing: Mapping[str, Any]) -> None:
    """Refuse constant forces, except on the free ends of a pressed chain; their size is compared later."""
    numbers, rows = [*outside.pushes], indexed.shape[0]
    if not numbers:
        return
    ends = [face for face in ("first", "last") if packing.get(face) == FREE]
    if indexed.lattice != CHAIN or not packing.get("contact_force") or len(numbers) > len(ends):
        raise SceneError(
            f"a constant force acts on sphere {numbers[0]}; a scene has such forces on the free ends of a chain that "
            f"is pressed together, of {rows} rows here, and no others"
        )


def _differing(spheres: Spheres, indexed: Indexed, sphere: Sphere) -> dict[str, Any]:
    """Return the tables of spheres that differ from the sphere of the lattice, and of empty places."""
    tables: dict[str, Any] = {}
    layers = indexed.shape[2]
    if len(indexed.empty):
        by_layer = [indexed.empty[indexed.empty[:, 2] == layer, :2].tolist() for layer in range(layers)]
        tables["inclusion"] = [
            {"spheres": each, "vacancy": True} | ({"layers": [layer, layer]} if layers > 1 else {})
            for layer, each in enumerate(by_layer)
            if each
        ]
    own = {"density": (spheres.density, sphere.density), "radius": (spheres.radius, sphere.radius)}
    other = {name: np.abs(values / usual - 1) > _ALIKE for name, (values, usual) in own.items()}
    some = np.logical_or.reduce([*other.values()])
    if some.any():
        site = indexed.sites
        order = np.argsort(site[some])
        columns_of = {name: values[some][order] for name, (values, _) in own.items() if other[name].any()}
        tables["table"] = SphereTable.of({SITE: site[some][order].astype(float), **columns_of})
    return tables


def _effects(
    law: Law, spheres: Spheres, outside: Outside, units: Units, indexed: Indexed, *, held: bool
) -> dict[str, Any]:
    """Return the table ``[effects]`` for a law."""
    turns = bool(spheres.turns.any())
    sheared = law.has_history and law.friction > 0
    effects: dict[str, Any] = {}
    if sheared and (held or indexed.lattice.sheet):
        effects["friction"] = law.friction
        effects["shear_law"] = _SHEARED[law.tangential]
        effects["rotation"] = turns
    if held:
        effects["shear"] = sheared
        if not sheared:
            effects.pop("rotation", None)
    if law.damping and law.damping_law == "velocity":
        effects["viscosity"] = float(units.si(law.damping, mass=1, time=-1))
    if law.damping_law == "coeff_restitution":
        effects["restitution"] = law.damping
    if law.damping_law == "coeff_restitution" and len(outside.frozen) < np.count_nonzero(~spheres.moves):
        raise SceneError("held spheres are not frozen (fix freeze), so that dashpots use their mass")
    if (law.damping or law.damping_law == "coeff_restitution") and sheared:
        if held and law.shear_damping != 1:
            raise SceneError(f"tangential damping {law.shear_damping:g}: must be 1 in a crystal that is held at rest")
        if not held:
            effects["shear_damping"] = law.shear_damping
    if held and law.damping:
        effects["damping"] = True
    return effects


def lines(described: Described, path: Any) -> Sequence[str]:
    """Return the lines of output on a scene."""
    scene, indexed, found = described.scene, described.indexed, described.likeness
    axes = [_axis(indexed.turn[axis]) for axis in range(3)]
    said = [f"{path}: {scene.words if scene.wave is None else scene.label}"]
    if axes != ["x", "y", "z"]:
        said.append(f"axes x, y, z of the scene are {', '.join(axes)} of the deck")
    said += found.lines
    if len(indexed.empty):
        said.append(f"vacancies: {len(indexed.empty)}, an [[inclusion]]")
    if scene.packing.table:
        said.append(f"{scene.packing.table}: densities or radii of single spheres")
    return [*said, *(f"not said: {each}" for each in described.unsaid)]


def _axis(row: Floats) -> str:
    axis = int(np.argmax(np.abs(row)))
    return ("-" if row[axis] < 0 else "") + "xyz"[axis]
