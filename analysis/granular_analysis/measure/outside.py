"""Actions from outside on the spheres of a run: sources, a driven row, walls, loads, quiet ends.

The scene declares them in τ, D0, k1 D0 and k1 D0 R. Only the strength of the drag in quiet ends is chosen by the run,
and read from ``run.json``. Walls stand where the spheres on them are at rest.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.stiffnesses import deviates, in_series, kinds_of, levels_of, scaled, spread
from granular_analysis.theory import signals
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.lattices import LATTICES
from granular_analysis.theory.network import RIGID, Material, Network, Wall
from granular_analysis.theory.network_laws import LAWS
from granular_analysis.theory.network_outside import Drive, Function
from granular_analysis.theory.network_state import contacts, resultants, search
from granular_analysis.theory.scenes import Setting
from granular_lmp.runs.record import Record, Scene

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
FREE, WALL, CHAIN = "free", "wall", "chain"


@dataclass(frozen=True)
class Scales:
    """Units of a record in units of its deck, and units of the deck in SI.

    Attributes
    ----------
    length : D0, or ℓ without a wave.
    time : t0.
    stiffness : k1; 0 for spheres that just touch.
    radius : R of the declared sphere.
    kilogram, metre, second : units of mass, length and time of the deck, in kg, m and s.
    """

    length: float
    time: float
    stiffness: float
    radius: float
    kilogram: float
    metre: float
    second: float

    def material(self, declared: Any) -> Material:
        """Return a declared material in units of the deck."""
        E, w = declared.youngs_modulus, declared.work_of_adhesion
        pressure, tension = self.kilogram / (self.metre * self.second**2), self.kilogram / self.second**2
        return Material(E / pressure, declared.poisson_ratio, w / tension)


def outside(record: Record, network: Network, scales: Scales) -> dict[str, Any]:
    """Return the walls, drives, drag and stiffness factors of a run by name, as arguments of `Network`.

    Raises TheoryError for a place outside the lattice, for quiet ends whose drag ``run.json`` lacks, and for a wall
    that does not touch a sphere that must rest on it.
    """
    scene = record.scene
    driven = [] if scene.wave is None or scene.wave.form != "driven" else [_driven_row(scene, network, scales)]
    drives = *driven, *_sources(scene, network, scales), *_loads(scene, network)
    drag = _drag(record, network, scales) if scene.absorb.rows else None
    own = replace(network, factors=_factors(record, network, scales))
    walls = *(_rigid(scene, own) if scene.held_at_rest else _walls(scene, own)), *_substrates(scene, own, scales)
    return {"walls": walls, "drives": drives, "drag": drag, "factors": own.factors}


def sites(scene: Scene, position: Floats) -> tuple[Integers, Integers]:
    """Return the row and the column of each sphere, (N,) each.

    Spheres are numbered row by row, in a row column by column, in a column layer by layer. If spheres are missing, row
    and column follow from `position`, the places at rest (N, d), relative to a complete row.

    Raises TheoryError if spheres are missing in a lattice whose stacking `granular_analysis.theory.scenes` does not
    know, or in every row.
    """
    packing, count = scene.packing, len(position)
    columns = int(packing.columns)
    if not (scene.disorder.vacancies or any(each.vacancy for each in scene.inclusion)):
        layers = count // (int(packing.rows) * columns)
        row, place = np.divmod(np.arange(count), columns * layers)
        return row, place // layers
    known = [name for (name, _), each in LATTICES.items() if len(each.vectors) < 3 and len(each.basis) == 1]
    if packing.lattice not in known:
        raise TheoryError(f"packing.lattice = {packing.lattice!r}: rows with vacancies are known in {known} only")
    lattice, (x, y) = LATTICES[packing.lattice, ""], position.T[:2]
    spacing = (y.max() - y.min()) / (int(packing.rows) - 1)
    row = np.rint((y - y.min()) / spacing).astype(np.intp)
    whole = np.flatnonzero(np.bincount(row) == columns)
    if not len(whole):
        raise TheoryError("vacancies: no row is complete, so the columns of the spheres are unknown")
    first = np.flatnonzero(row == whole[0])[0]
    parity = (row - scene.shape.centre_row) % 2  # every other row is shifted relative to the centre row
    along = (x - x[first]) * lattice.row / spacing - lattice.shift * (parity - parity[first])
    return row, np.rint(along).astype(np.intp) % columns


def chosen(places: Any, scene: Scene, position: Floats) -> Integers:
    """Return the indices of the spheres of a striker, source or monitor: its rows or single spheres, in its layers."""
    row, column = sites(scene, position)
    layer = np.arange(len(row)) % (len(row) // len({*zip(row.tolist(), column.tolist(), strict=True)}))
    first, last = places.layers or (0, len(row))
    inside = (first <= layer) & (layer <= last)
    if places.rows:
        return np.flatnonzero((places.rows[0] <= row) & (row <= places.rows[-1]) & inside)
    single = [each in set(places.spheres) for each in zip(row.tolist(), column.tolist(), strict=True)]
    return np.flatnonzero(single & inside)


def _own_frequency(scene: Scene) -> float:
    """Return Ω of the wave of a scene, rad per t0."""
    return float(Setting(scene).mode().frequency * scene.sphere.time_scale)


def _driven_row(scene: Scene, network: Network, scales: Scales) -> Drive:
    """Return the drive of the first row: along y, v = p, for a wave that moves spheres more along y than along x.

    Otherwise the row moves along x, u = −q. In a beam the amplitude is a Gaussian across it.
    """
    frequency, envelope, moved = _own_frequency(scene), scene.envelope, np.abs(Setting(scene).mode().shape[:, :2])
    along = np.linalg.norm(moved[:, 1]) > np.linalg.norm(moved[:, 0])
    rows, columns = sites(scene, network.position)
    row, share = np.flatnonzero(rows == 0), np.ones(np.count_nonzero(rows == 0))
    if envelope.width:  # centred on the column of the centre, in a row of the same parity as the centre row
        same = (rows % 2 == scene.shape.centre_row % 2) & (columns == scene.shape.columns // 2)
        across, period = network.position[row, 0] - network.position[same, 0][0], network.cell[0]
        across -= period * np.round(across / period) if np.isfinite(period) else 0.0
        share = np.exp(-0.5 * (across * Setting(scene).unit * scales.metre / envelope.width) ** 2)
    return Drive(
        row,
        1 if along else 0,
        _scaled(signals.tone(frequency, envelope.ramp, scene.require_wave().phase), scales.length, scales.time),
        moves=True,
        longest=scales.time / frequency,
        size=scales.length,
        share=share if along else -share,
    )


def _sources(scene: Scene, network: Network, scales: Scales) -> Iterator[Drive]:
    """Yield the drive of each source."""
    for source in scene.source:
        kind, _, axis = str(source.motion or source.force).partition("_")
        turns = {"rotation": 1 / scales.radius, "torque": scales.radius}
        component = "xyz".index(axis or "z") if kind in turns else "xyz".index(kind)
        if kind in turns:
            component = component + 3 if network.dimension == 3 else 2
        unit = scales.length * (1 if source.motion else scales.stiffness) * turns.get(kind, 1.0)
        measured = not isinstance(source.signal, str) and isinstance(source.signal[0][0], str)
        if measured:  # samples in SI units, whose first entry names the columns
            newton = scales.kilogram * scales.metre / scales.second**2
            sizes = {"force": newton, "torque": newton * scales.metre, "motion": scales.metre, "angle": 1.0}
            unit = 1 / sizes[str(source.signal[0][1]).partition("_")[0]]
        signal, changes_in, largest = signal_of(source, scene, scales.time * scales.second if measured else 1.0)
        yield Drive(
            chosen(source, scene, network.position),
            component,
            _scaled(signal, source.amplitude * unit, scales.time),
            moves=bool(source.motion),
            longest=changes_in * scales.time,
            size=source.amplitude * unit * largest,
        )


def signal_of(source: Any, scene: Scene, second: float = 1.0) -> tuple[Function, float, float]:
    """Return the signal of a source as a function of τ, the time in which it changes (in τ), and its largest value.

    `second` is t0 in the unit of time of the samples; for a measured drive, t0 in seconds.

    Raises TheoryError for an unknown signal.
    """
    if not isinstance(source.signal, str):
        pairs = np.array([each for each in source.signal if not isinstance(each[0], str)])
        pairs[:, 0] /= second
        return signals.samples(pairs, source.delay), pairs[1, 0] - pairs[0, 0], float(np.abs(pairs[:, 1]).max())
    if source.signal == "step":
        return signals.step(source.ramp, source.delay), source.ramp / 4, 1.0
    if source.hertz is not None:
        frequency = 2 * np.pi * source.hertz * scene.sphere.time_scale
    else:
        frequency = _own_frequency(scene) if source.frequency is None else source.frequency
    known: dict[str, Callable[[], tuple[Function, float]]] = {
        "tone": lambda: (signals.tone(frequency, source.ramp, source.phase, source.delay), 1.0),
        "burst": lambda: (signals.burst(frequency, source.cycles, source.phase, source.delay), 1.0),
        "ricker": lambda: (signals.ricker(frequency, source.delay), 1.0),
        "chirp": lambda: (
            signals.chirp(frequency, source.sweep, source.cycles, source.phase, source.delay),
            max(1.0, source.sweep),
        ),
    }
    if source.signal not in known:
        raise TheoryError(f"source.signal = {source.signal!r}: the network knows {', '.join(known)}")
    signal, top = known[source.signal]()
    return signal, 1 / (top * frequency), 1.0


def _scaled(signal: Function, size: float, time: float) -> Function:
    return lambda t: size * signal(t / time)


def face(scene: Scene, name: str) -> str:
    """Return the kind of a face of the packing; for "auto" the kind that its shape decides."""
    declared = str(getattr(scene.packing, name))
    return str(getattr(scene.shape, name)) if declared == "auto" else declared


def _walls(scene: Scene, network: Network) -> Iterator[Wall]:
    """Yield the rigid plane of each side on which the outermost spheres rest, touching or pressed by a load."""
    for normal in _sides(scene, network):
        surface = network.position @ np.array(normal) + network.radius
        outermost = int(np.argmax(surface))
        place = surface[outermost] - _pressed(scene, network, outermost, Wall(normal, normal))
        yield Wall(tuple(place * np.array(normal)), normal)


def _sides(scene: Scene, network: Network) -> Iterator[tuple[float, ...]]:
    """Yield the outward normal of each face that is a rigid plane."""
    for axis, low, high in ((1, "first", "last"), (0, "sides", "sides")):
        for name, way in ((low, -1.0), (high, 1.0)):
            if face(scene, name) == WALL:
                yield tuple(way * np.eye(network.dimension)[axis])


def _substrates(scene: Scene, network: Network, scales: Scales) -> Iterator[Wall]:
    """Yield the half-spaces below and above the spheres of a run.

    Raises TheoryError for unequal spheres between two plates, unless the plates moved freely while the spheres came to
    rest (`packing.relax` "box").
    """
    declared = scene.substrate
    if declared is None:
        return
    material = scales.material(declared)
    ends = (network.materials[0], material), (scales.radius, np.inf)
    factors = scaled(*ends, network.adhesion, 0.0, _stiffnesses(declared, scales))
    law = material, _varied(scene, network, factors)
    low, high = (Wall(normal, normal, *law) for normal in ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)))
    if declared.sides == "both" and scene.packing.layers in (1, "auto"):
        unequal = np.ptp(network.radius) > 0 or len({kind[:3] for kind in kinds_of(scene)}) > 1
        if unequal and scene.packing.relax != "box":
            raise TheoryError(f'packing.relax = "{scene.packing.relax}": must be "box" between two plates')
        every = np.flatnonzero(network.mobility[0] > 0)  # no net force acts on either plate
        yield from (_where(network, wall, every, 0.0) for wall in (low, high))
        return
    forces = _forces(network)
    yield from (_at_rest(network, forces, wall) for wall in ((low, high) if declared.sides == "both" else (low,)))


def _rigid(scene: Scene, network: Network) -> Iterator[Wall]:
    """Yield the rigid planes at the faces of a crystal at rest; they adhere like the spheres of the lattice."""
    law = replace(RIGID, work_of_adhesion=network.materials[0].work_of_adhesion), _varied(scene, network, (1.0, 1.0))
    walls = [Wall(normal, normal, *law) for normal in _sides(scene, network)]
    forces = _forces(network) if walls else network.position
    yield from (_at_rest(network, forces, wall) for wall in walls)


def _forces(network: Network) -> Floats:
    """Return the force of the other spheres on each sphere at rest, (N, d)."""
    count, dimension = network.position.shape
    pairs, still = search(network, np.zeros((dimension, count))), np.zeros((2 * network.freedoms, count))
    now = contacts(network, still, pairs, np.zeros((dimension - 1, len(pairs.first))), begun=True)
    return np.array(resultants(pairs, now)[:dimension]).T


def _at_rest(network: Network, forces: Floats, wall: Wall) -> Wall:
    """Return a wall moved to where its P(δ) on the outermost sphere balances the force of the other spheres."""
    free, normal = network.mobility[0] > 0, np.array(wall.normal)
    sphere = np.array([np.argmax(np.where(free, network.position @ normal + network.radius, -np.inf))])
    return _where(network, wall, sphere, float((forces[sphere] @ normal)[0]))


def _where(network: Network, wall: Wall, spheres: Integers, pushed: float) -> Wall:
    """Return a wall moved to where the given spheres all touch it and together press it with the force `pushed`.

    Raises TheoryError if there is no such place.
    """
    from scipy.optimize import brentq  # slow to import, and only walls need it

    normal, closed = np.array(wall.normal), np.ones(len(spheres), dtype=bool)
    surface, longest = network.position[spheres] @ normal + network.radius[spheres], float(network.radius.max())
    A, _, F = network.on_wall(wall, spheres)
    law = LAWS[network.adhesion](A, F)

    def left(place: float) -> float:
        overlap = surface - place
        return float(law.repulsion(overlap, law.radius(overlap, closed), closed).sum()) - pushed

    farthest = float(np.min(surface - law.end))
    try:
        place = brentq(left, farthest - longest, farthest, xtol=1e-15 * longest, rtol=1e-15)
    except ValueError as error:
        raise TheoryError(
            "walls: not every sphere that must touch a wall can rest on it, so the place of the wall is unknown"
        ) from error
    return wall._replace(point=tuple(place * normal))


def _varied(scene: Scene, network: Network, factors: tuple[float, float]) -> Floats | tuple[float, float]:
    """Return the force factors of contacts with a wall: one pair, or one for each material if spheres differ in them.

    Measured stiffnesses, factors from a table, and the spread of stiffness multiply each other.
    """
    own = levels_of(scene)
    if scene.disorder.stiffness:
        own = np.asarray(np.kron(own, 1 + scene.disorder.stiffness * deviates()[:, None]), dtype=np.float64)
    return np.tile(own, (len(network.materials) // len(own), 1)) * factors if len(own) > 1 else factors


def _factors(record: Record, network: Network, scales: Scales) -> Floats | tuple[float, float]:
    """Return the force factors of the contacts between spheres.

    They come from measured stiffnesses ([contact] and [[pair]]), from a table, and from the spread of stiffness.

    Raises TheoryError for [contact] stiffnesses if the spheres have several materials.
    """
    scene = record.scene
    load = scene.packing.contact_force * scales.second**2 / (scales.kilogram * scales.metre)
    kinds = kinds_of(scene)
    whole = _stiffnesses(scene.contact, scales)
    if whole != (None, None) and len({kind[:3] for kind in kinds}) > 1:
        raise TheoryError("contact: the network takes [contact] only where all spheres have one material")
    materials = [scales.material(kind) for kind in kinds]
    radii = [scales.radius if kind.radius is None else kind.radius / scales.metre for kind in kinds]
    both = scaled((materials[0],) * 2, (radii[0],) * 2, network.adhesion, load, whole)
    levels = levels_of(scene)
    if not (scene.pair or scene.disorder.stiffness or len(levels) > 1):
        return both
    found = np.full((len(kinds), len(kinds), 2), both)
    for pair, (m, n) in product(scene.pair, np.ndindex(len(kinds), len(kinds))):
        if sorted(pair.of) == sorted((kinds[m].number, kinds[n].number)):
            own = _stiffnesses(pair, scales)
            single = scaled((materials[m], materials[n]), (radii[m], radii[n]), network.adhesion, load, own)
            found[m, n] = [one if given else other for one, given, other in zip(single, own, both, strict=True)]
    found = in_series(found, levels)
    return spread(found, scene.disorder.stiffness) if scene.disorder.stiffness else found


def _stiffnesses(declared: Any, scales: Scales) -> tuple[float | None, float | None]:
    """Return the declared normal and shear stiffness of a contact in units of the deck; None where not declared."""
    both = declared.normal_stiffness, declared.shear_stiffness
    normal, shear = (None if each is None else each * scales.second**2 / scales.kilogram for each in both)
    return normal, shear


def _pressed(scene: Scene, network: Network, sphere: int, wall: Wall) -> float:
    """Return the overlap (F0/A)^{2/3} of a sphere and a wall under the load of a chain; 0 without a load."""
    force = _load(scene, network)
    return float((force / network.on_wall(wall, np.array([sphere]))[0][0]) ** (2 / 3)) if force else 0.0


def _load(scene: Scene, network: Network) -> float:
    """Return the force that presses a chain together, from the overlap of its first two spheres at rest; 0 if none."""
    if scene.packing.lattice != CHAIN or not scene.packing.contact_force or scene.held_at_rest:
        return 0.0
    one, two = np.argsort(network.position[:, 1])[:2]
    overlap = network.radius[one] + network.radius[two] - (network.position[two, 1] - network.position[one, 1])
    A, *_ = network.coefficients(np.array([one]), np.array([two]))
    return float(A[0] * max(overlap, 0.0) ** 1.5)


def _loads(scene: Scene, network: Network) -> Iterator[Drive]:
    """Yield the constant forces on the free ends of a chain that is pressed together."""
    force, order = _load(scene, network), np.argsort(network.position[:, 1])
    for name, sphere, push in (("first", order[0], force), ("last", order[-1], -force)):
        if push and face(scene, name) == FREE:
            yield Drive(np.array([sphere]), 1, _scaled(np.ones_like, push, 1.0))


def _drag(record: Record, network: Network, scales: Scales) -> Floats:
    """Return the decay rate of velocity and spin of each sphere in quiet ends, (N,): c (n/L)^p in row n of L.

    As in the deck, n grows outwards from the centre towards each quiet end, and row L is the last but one.

    Raises TheoryError if ``run.json`` lacks the drag.
    """
    said = record.info.get("quiet_ends")
    if said is None:
        raise TheoryError("absorb.rows: run.json lacks the drag of the quiet ends; run the scene again")
    y, last, centre = network.position[:, 1], int(record.scene.packing.rows) - 1, record.scene.shape.centre_row
    row = np.rint((y - y.min()) / (y.max() - y.min()) * last)
    from_centre = {"first": centre - row, "last": row - centre}
    deep = np.max([from_centre[end] for end in said["ends"]], axis=0) - (last - centre - said["rows"] - 1)
    return np.asarray(said["strength"] * (np.maximum(deep, 0.0) / said["rows"]) ** said["power"] / scales.time)
