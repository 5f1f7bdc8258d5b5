"""Read what acts on the spheres of a run from outside: sources, a driven row, walls, loads, quiet ends.

All of it is said by the scene, in τ, D0, k1 D0 and k1 D0 R, but for the drag of quiet ends: its strength is a choice of
the run, which its ``run.json`` holds. Walls stand where the spheres on them are at rest.
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
    """Units of a record in units of its deck: D0 or ℓ, t0, k1, and R of the declared sphere; and kg, m, s in them."""

    length: float
    time: float
    stiffness: float
    radius: float
    kilogram: float
    metre: float
    second: float

    def material(self, declared: Any) -> Material:
        """Return a declared material."""
        E, w = declared.youngs_modulus, declared.work_of_adhesion
        pressure, tension = self.kilogram / (self.metre * self.second**2), self.kilogram / self.second**2
        return Material(E / pressure, declared.poisson_ratio, w / tension)


def outside(record: Record, network: Network, scales: Scales) -> dict[str, Any]:
    """Return the walls, drives, drag and factors of measured stiffnesses of a run, as `Network` takes them.

    Raises TheoryError for a place that is not in the lattice, for quiet ends whose drag the run does not say, and for a
    wall that does not touch what must be at rest on it.
    """
    scene = record.scene
    driven = [] if scene.wave is None or scene.wave.form != "driven" else [_driven_row(scene, network, scales)]
    drives = *driven, *_sources(scene, network, scales), *_loads(scene, network)
    drag = _drag(record, network, scales) if scene.absorb.rows else None
    own = replace(network, factors=_factors(record, network, scales))
    walls = *(_rigid(scene, own) if scene.held_at_rest else _walls(scene, own)), *_substrates(scene, own, scales)
    return {"walls": walls, "drives": drives, "drag": drag, "factors": own.factors}


def sites(scene: Scene, position: Floats) -> tuple[Integers, Integers]:
    """Return the row and the column of each sphere at its place at rest, (N,) each, in the order of their numbers.

    Spheres are numbered row by row, those of a row column by column, with all layers of each. Where some are missing,
    their places say which: relative to a row that is whole.

    Raises TheoryError where spheres are missing in a lattice of another stacking than `granular_analysis.theory.scenes`
    knows, or in all of its rows.
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
        raise TheoryError("vacancies: no row is whole, and the places of spheres are not known")
    first = np.flatnonzero(row == whole[0])[0]
    parity = (row - scene.shape.centre_row) % 2  # every other row is shifted against that of the centre
    along = (x - x[first]) * lattice.row / spacing - lattice.shift * (parity - parity[first])
    return row, np.rint(along).astype(np.intp) % columns


def chosen(places: Any, scene: Scene, position: Floats) -> Integers:
    """Return the indices of the spheres of a striker, source or monitor: its rows, or its single spheres, by layers."""
    row, column = sites(scene, position)
    layer = np.arange(len(row)) % (len(row) // len({*zip(row.tolist(), column.tolist(), strict=True)}))
    first, last = places.layers or (0, len(row))
    inside = (first <= layer) & (layer <= last)
    if places.rows:
        return np.flatnonzero((places.rows[0] <= row) & (row <= places.rows[-1]) & inside)
    single = [each in set(places.spheres) for each in zip(row.tolist(), column.tolist(), strict=True)]
    return np.flatnonzero(single & inside)


def _own_frequency(scene: Scene) -> float:
    """Return Ω of the wave of a scene, rad/t0."""
    return float(Setting(scene).mode().frequency * scene.sphere.time_scale)


def _driven_row(scene: Scene, network: Network, scales: Scales) -> Drive:
    """Return the motion of the first row: v = p of a wave that moves spheres along y rather than along x, else u = −q.

    In a beam it is a Gaussian.
    """
    frequency, envelope, moved = _own_frequency(scene), scene.envelope, np.abs(Setting(scene).mode().shape[:, :2])
    along = np.linalg.norm(moved[:, 1]) > np.linalg.norm(moved[:, 0])
    rows, columns = sites(scene, network.position)
    row, share = np.flatnonzero(rows == 0), np.ones(np.count_nonzero(rows == 0))
    if envelope.width:  # about the column of the centre, whose rows have one parity
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
        if measured:  # in SI units, behind a head
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
    """Return the signal of a source over τ, the time in which it changes, and its largest value.

    `second` is t0 in the unit of time of samples: s for those of a measured drive.

    Raises TheoryError for a signal that is not known here.
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
        raise TheoryError(f"source.signal = {source.signal!r}: is not known to the network; {', '.join(known)} are")
    signal, top = known[source.signal]()
    return signal, 1 / (top * frequency), 1.0


def _scaled(signal: Function, size: float, time: float) -> Function:
    return lambda t: size * signal(t / time)


def face(scene: Scene, name: str) -> str:
    """Return what a face of the packing is; what is "auto" is that of its shape."""
    declared = str(getattr(scene.packing, name))
    return str(getattr(scene.shape, name)) if declared == "auto" else declared


def _walls(scene: Scene, network: Network) -> Iterator[Wall]:
    """Yield the rigid planes that the outermost spheres of a side touch, or are pressed on."""
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
    """Yield the half-spaces under and above the spheres of a run.

    Raises TheoryError for unequal spheres between two plates that were not free to move while they came to rest.
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
        every = np.flatnonzero(network.mobility[0] > 0)  # no force is on either plate
        yield from (_where(network, wall, every, 0.0) for wall in (low, high))
        return
    forces = _forces(network)
    yield from (_at_rest(network, forces, wall) for wall in ((low, high) if declared.sides == "both" else (low,)))


def _rigid(scene: Scene, network: Network) -> Iterator[Wall]:
    """Yield the rigid planes at the faces of a crystal at rest, which adhere as its spheres do."""
    law = replace(RIGID, work_of_adhesion=network.materials[0].work_of_adhesion), _varied(scene, network, (1.0, 1.0))
    walls = [Wall(normal, normal, *law) for normal in _sides(scene, network)]
    forces = _forces(network) if walls else network.position
    yield from (_at_rest(network, forces, wall) for wall in walls)


def _forces(network: Network) -> Floats:
    """Return the forces of the spheres on each other at rest, (N, d)."""
    count, dimension = network.position.shape
    pairs, still = search(network, np.zeros((dimension, count))), np.zeros((2 * network.freedoms, count))
    now = contacts(network, still, pairs, np.zeros((dimension - 1, len(pairs.first))), begun=True)
    return np.array(resultants(pairs, now)[:dimension]).T


def _at_rest(network: Network, forces: Floats, wall: Wall) -> Wall:
    """Return a wall where the outermost sphere is at rest on it: its P(δ) balances the force of the other spheres."""
    free, normal = network.mobility[0] > 0, np.array(wall.normal)
    sphere = np.array([np.argmax(np.where(free, network.position @ normal + network.radius, -np.inf))])
    return _where(network, wall, sphere, float((forces[sphere] @ normal)[0]))


def _where(network: Network, wall: Wall, spheres: Integers, pushed: float) -> Wall:
    """Return a wall at the place where spheres, of which all touch it, press it with a force.

    Raises TheoryError if they do at none.
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
            "walls: do not hold all spheres at rest that must touch them, so that their places are not known"
        ) from error
    return wall._replace(point=tuple(place * normal))


def _varied(scene: Scene, network: Network, factors: tuple[float, float]) -> Floats | tuple[float, float]:
    """Return the factors of contacts with a wall, by material where spheres differ in stiffness."""
    own = levels_of(scene)
    if scene.disorder.stiffness:
        own = np.asarray(np.kron(own, 1 + scene.disorder.stiffness * deviates()[:, None]), dtype=np.float64)
    return np.tile(own, (len(network.materials) // len(own), 1)) * factors if len(own) > 1 else factors


def _factors(record: Record, network: Network, scales: Scales) -> Floats | tuple[float, float]:
    """Return the factors of the contacts of spheres, by measured stiffnesses, of pairs of kinds too, and their spread.

    Raises TheoryError for stiffnesses of all contacts beside materials of several moduli.
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
    """Return the measured stiffnesses of a contact in units of the deck."""
    both = declared.normal_stiffness, declared.shear_stiffness
    normal, shear = (None if each is None else each * scales.second**2 / scales.kilogram for each in both)
    return normal, shear


def _pressed(scene: Scene, network: Network, sphere: int, wall: Wall) -> float:
    """Return how deep the load of a chain presses a sphere into a wall, (F0/A)^{2/3}; 0 where nothing does."""
    force = _load(scene, network)
    return float((force / network.on_wall(wall, np.array([sphere]))[0][0]) ** (2 / 3)) if force else 0.0


def _load(scene: Scene, network: Network) -> float:
    """Return the force that presses a chain together, by the overlap of its first two spheres at rest; 0 if none."""
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
    """Return the rate at which velocity and spin of each sphere decay in quiet ends, c (n/L)^p in row n of L.

    As in the deck, rows are counted from the centre to the ends that are quiet, and row L is the one before the last.
    """
    said = record.info.get("quiet_ends")
    if said is None:
        raise TheoryError("absorb.rows: run.json does not say the drag of quiet ends; run the scene again")
    y, last, centre = network.position[:, 1], int(record.scene.packing.rows) - 1, record.scene.shape.centre_row
    row = np.rint((y - y.min()) / (y.max() - y.min()) * last)
    from_centre = {"first": centre - row, "last": row - centre}
    deep = np.max([from_centre[end] for end in said["ends"]], axis=0) - (last - centre - said["rows"] - 1)
    return np.asarray(said["strength"] * (np.maximum(deep, 0.0) / said["rows"]) ** said["power"] / scales.time)
