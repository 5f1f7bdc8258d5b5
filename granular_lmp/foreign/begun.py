"""Describe how a foreign crystal begins in terms of a scene: strikers, a state of single spheres, or a plane wave.

If spheres are displaced from their places, a plane wave is tried. Its wave vector comes from a Fourier transform of the
displacements; its mode, amplitude and phase come from least squares over displacements, velocities and spins.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import product
from math import atan2, degrees, hypot, pi
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import offsets
from granular_lmp.crystal.modes import MODES, restored
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import GranularError, SceneError
from granular_lmp.foreign.indexing import Indexed
from granular_lmp.foreign.likeness import aligned
from granular_lmp.foreign.stages import Spheres
from granular_lmp.frozen import dataclass
from granular_lmp.problem import prepare
from granular_lmp.rest.initial_fields import plane_wave
from granular_lmp.rest.linear import mode_of, physics_of, wave_contacts
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.start import MOST
from granular_lmp.scene.strikers import WORDS
from granular_lmp.scene.without_wave import holds

Floats = NDArray[np.float64]
Tables = dict[str, Any]
Effects = Callable[..., Tables]

_STRIKERS = 8  # more different velocities than these are a state
_SAME = 1e-9  # times the speed of the fastest sphere; velocities that differ by less are equal
_STILL = 1e-6  # times the overlap; smaller displacements are rounding of places
_FITS = 1e-3  # share of the motion; if a plane wave leaves more of it, the motion is no plane wave
_FINE = 16  # a crystal that ends is searched at this many wave numbers in 2π over its length
_ROUNDS, _STEP = 8, 1e-6  # iterations of the search for a wave number, and step of its derivative in rad per row
_ANY_WAVE = {"mode": "L", "wavenumber": 0.5, "amplitude": 0.1}
_LARGE = 4000  # in a larger crystal a wave vector is sought only along y
_WORDS = {value: name for name, value in WORDS.items()}


@dataclass(frozen=True, eq=False)
class Motion:
    """Places, velocities and spins of spheres at the beginning, (N, 3) each, along the axes of a scene and in SI units.

    `held` tells which spheres are held, (N,).
    """

    place: Floats
    velocity: Floats
    spin: Floats
    held: NDArray[np.bool_]
    indexed: Indexed

    @classmethod
    def of(cls, spheres: Spheres, indexed: Indexed) -> "Motion":
        """Return the motion of spheres of a deck, in SI units."""
        place, velocity, spin = (each @ indexed.turn.T for each in (spheres.position, spheres.velocity, spheres.spin))
        return cls(place, velocity, spin, ~spheres.moves, indexed)

    def displaced(self, atoms: ase.Atoms, radius: float) -> Floats:
        """Return displacements from the places at rest, (N, 3), m, in the order of `atoms`, whose places are in R."""
        rest = atoms.positions[np.argsort(np.argsort(self.indexed.sites))] * radius
        return aligned(self.place - rest, atoms, radius, self.indexed, self.held)


def begins(tables: Tables, motion: Motion, effects: Effects, times: Sequence[float]) -> Iterator[Tables]:
    """Yield the tables of scenes that may begin in the same way as a crystal, the simplest first.

    Parameters
    ----------
    tables : dict
        Spheres, packing and inclusions; ``table`` holds that of single spheres.
    motion : Motion
    effects : callable
        Returns the table ``[effects]``; its argument `held` tells whether the crystal is held at rest.
    times : (float, float, float)
        Step, time between records and duration, s.
    """
    tables = {key: value for key, value in tables.items() if key != "table"} | (
        {"packing": {**tables["packing"], "table": tables["table"]}} if "table" in tables else {}
    )
    packing, touching = tables["packing"], bool(tables.get("start"))
    adhesion, force = tables["sphere"].get("work_of_adhesion", 0.0), packing.get("contact_force", 0.0)
    held = holds(adhesion, force, sheet=motion.indexed.lattice.sheet, touching=touching)
    moves = bool(motion.velocity.any() or motion.spin.any())
    if motion.indexed.lattice.solid:
        if moves and (strikers := _strikers(motion)):
            struck = tables | {"effects": effects(held=True), "striker": strikers}
            yield _timed(struck | {"wave": _still(struck)}, times)
    else:
        plain = tables | {"effects": effects(held=held)}
        if moves and (strikers := _strikers(motion)):
            yield _timed(plain | {"striker": strikers}, times)
        elif moves:
            yield _timed(plain | {"start": _state(motion, None, touching=touching)}, times)
    yield from _waves(tables | {"effects": effects(held=True)}, motion, times)
    if not motion.indexed.lattice.solid:
        noise = {"start": {"noise": 1e-3}} if not moves else {"start": _state(motion, None, touching=touching)}
        scene = Scene.from_dict(plain | noise | {"time": {"duration": 1.0}}, "scene")
        away = motion.displaced(prepare(scene).rest.atoms, scene.sphere.radius)
        if np.abs(away).max() > _STILL * (scene.sphere.static_overlap or scene.scale.length):
            yield _timed(plain | {"start": _state(motion, away, touching=touching)}, times)


def _still(tables: Tables) -> Tables:
    """Return a wave of form "none", which only sets the unit of the strikers of a crystal of many layers."""
    for mode in ("L", *map(str, range(1, 7))):
        wave = {**_ANY_WAVE, "mode": mode, "amplitude": 1.0, "form": "none"}
        with suppress(GranularError):
            mode_of(_scene(tables, wave))
            return wave
    raise SceneError("this crystal has no wave of its own that could be its unit of motion")


def _timed(tables: Tables, times: Sequence[float]) -> Tables:
    """Return tables with step, sample and duration in units of the scene; a run may continue after the echo arrives."""
    step, sample, duration = times
    wave = "wave" in tables
    any_time = {"time": {"duration": 1e-3, "sample": 1e-3, "timestep": 1e-3}}
    scene = Scene.from_dict(tables | any_time, "scene")
    unit = scene.scale.time
    time = {"timestep": step / unit, "sample": sample / unit, "duration": max(duration, sample) / unit}
    if wave and time["duration"] > scene.echo_time:
        time["allow_echo"] = True
    return tables | {"time": time}


def _strikers(motion: Motion) -> list[Tables]:
    """Return the strikers of spheres that move without spin; [] if too many velocities differ."""
    if motion.spin.any():
        return []
    speed = np.linalg.norm(motion.velocity, axis=1)
    moving = np.flatnonzero(speed)
    rounded = np.round(motion.velocity[moving] / speed.max() / _SAME)
    kinds, which = np.unique(rounded, axis=0, return_inverse=True)
    if len(kinds) > _STRIKERS:
        return []
    found: list[Tables] = []
    for kind in range(len(kinds)):
        spheres = moving[which.ravel() == kind]
        velocity = motion.velocity[spheres[0]]
        found.append({**_places(motion.indexed, spheres), "velocity": float(np.linalg.norm(velocity))})
        if (direction := _direction(velocity)) != "y":
            found[-1]["direction"] = direction
    return found


def _direction(velocity: Floats) -> str | float:
    x, y, z = (velocity / np.linalg.norm(velocity) + 0.0).tolist()
    return _WORDS.get((x, y, z), degrees(atan2(y, x)))


def _places(indexed: Indexed, spheres: NDArray[np.int64]) -> Tables:
    """Return the keys of spheres: their rows if these are whole, else row and column of each sphere."""
    spheres = spheres[np.argsort(indexed.sites[spheres])]
    row = indexed.row[spheres]
    whole = np.isin(indexed.row, np.arange(row.min(), row.max() + 1)).sum() == len(spheres)
    if whole:
        return {"rows": [int(row.min()), int(row.max())]}
    if indexed.lattice.solid:
        raise SceneError("some spheres of a row move; a scene strikes whole rows of a crystal of many layers")
    return {"spheres": np.stack([row, indexed.column[spheres]], axis=1).tolist()}


def _state(motion: Motion, away: Floats | None, *, touching: bool) -> Tables:
    """Return the table ``[start]`` of all spheres that move, or are displaced."""
    moved = np.zeros_like(motion.place) if away is None else away
    there = (motion.velocity.any(axis=1) | motion.spin.any(axis=1) | moved.any(axis=1)) & ~motion.held
    which = np.flatnonzero(there)
    if len(which) > MOST:
        raise SceneError(f"{len(which)} spheres move at the beginning; a state holds {MOST}, and this is no plane wave")
    across = moved[:, 2], motion.velocity[:, 2], *motion.spin[:, :2].T
    if any(np.abs(each).max() > 0 for each in across[1:]):
        raise SceneError("spheres leave the plane at the beginning")
    columns = (motion.indexed.row, motion.indexed.column, *moved[:, :2].T, *motion.velocity[:, :2].T, motion.spin[:, 2])
    state = [[int(row), int(column), *rest] for row, column, *rest in np.stack(columns, axis=1)[which].tolist()]
    return {"state": state} | ({"touching": True} if touching else {})


# --- plane waves ------------------------------------------------------------------------------------------------------


def _waves(tables: Tables, motion: Motion, times: Sequence[float]) -> Iterator[Tables]:
    """Yield the tables of the plane wave at the beginning of a crystal, if its motion is a plane wave."""
    tables = {key: value for key, value in tables.items() if key != "start"}
    try:
        scene = _scene(tables, _ANY_WAVE)
        rest = prepare(scene).rest.atoms
        away = motion.displaced(rest, scene.sphere.radius)
    except GranularError:
        return
    length, time = scene.scale.length, scene.scale.time
    if np.abs(away).max() <= _STILL * length:
        return
    turns = (scene.sphere.radius * motion.spin) * time / length
    data = np.hstack([away / length, motion.velocity * time / length, turns])[np.argsort(motion.indexed.sites)]
    standing = not motion.velocity.any()
    found = _fits(tables, rest, data, standing=standing)
    left, wave = min(found, key=lambda each: each[0], default=(1.0, {}))
    if left < _FITS:
        yield _timed(tables | {"wave": wave | ({"form": "standing"} if standing else {})}, times)


def _scene(tables: Tables, wave: Mapping[str, Any]) -> Scene:
    time = {"duration": 1e-3, "sample": 1e-3, "timestep": 1e-3}
    return Scene.from_dict(tables | {"wave": dict(wave), "time": time}, "scene")


def _fits(tables: Tables, rest: ase.Atoms, data: Floats, *, standing: bool) -> Iterator[tuple[float, Tables]]:
    """Yield the share of a motion that each wave does not explain, and the wave, for both ways along a wave vector."""
    per_column, per_row = _vector(rest, data)
    any_scene = _scene(tables, _ANY_WAVE)
    names = restored(wave_contacts(any_scene), physics_of(any_scene))
    for sign, name in product((1,) if standing else (1, -1), names if len(names) > len(MODES) else MODES):
        try:
            yield _fitted(tables, rest, data, name, (sign * per_column, sign * per_row), standing=standing)
        except GranularError:  # no such mode at this wave vector
            continue


def _vector(rest: ase.Atoms, data: Floats) -> tuple[float, float]:
    """Return the phase advances per column and per row of the strongest wave in a motion."""
    rows, columns = rest.info["rows"], rest.info["columns"]
    along = data[:, int(np.argmax(np.abs(data[:, :6]).max(axis=0)))]
    (x, y), per_column = offsets(rest), np.zeros(1)
    if rest.pbc[0] and len(rest) <= _LARGE:
        per_column = 2 * pi * np.arange(-(columns // 2), columns // 2 + 1) / columns
    count = rows // 2 if rest.pbc[1] else rows * _FINE // 2
    per_row = pi * np.arange(0 if len(per_column) > 1 else 1, count + 1) / count
    power = np.abs(np.exp(-1j * np.outer(per_row, y)) @ (along[:, None] * np.exp(-1j * np.outer(x, per_column))))
    strongest = np.unravel_index(int(np.argmax(power)), power.shape)
    return float(per_column[strongest[1]]), float(per_row[strongest[0]])


def _fitted(
    tables: Tables, rest: ase.Atoms, data: Floats, name: str, advances: tuple[float, float], *, standing: bool
) -> tuple[float, Tables]:
    """Return the share of a motion that a mode does not explain, and the wave.

    In a crystal that ends along y, no box sets the wave numbers: Gauss–Newton iterations find the nearest one.
    """
    free, (per_column, per_row) = ~rest.arrays["fixed"], advances
    wanted = data[free].ravel()

    def waves(advance: float) -> tuple[Tables, Floats]:
        lattice = _scene(tables, _ANY_WAVE).lattice
        vector = WaveVector(per_column, advance, lattice.row_spacing, lattice.column_spacing)
        declared = {"mode": name, "wavenumber": vector.wavenumber}
        declared |= {} if vector.direction == 90 else {"direction": vector.direction}
        mode, found = mode_of(_scene(tables, {**declared, "amplitude": 0.1})), []
        for phase in (0.0, pi / 2):
            fields = plane_wave(rest, mode, phase)
            moving = np.hstack([fields.displacement[:, :3], fields.velocity * (not standing)])
            found.append(moving[free].ravel())
        return declared, np.stack(found, axis=1)

    for _ in range(0 if rest.pbc[1] else _ROUNDS):
        _, basis = waves(per_row)
        factors = np.linalg.lstsq(basis, wanted, rcond=None)[0]
        slope = (waves(per_row + _STEP)[1] - basis) @ factors / _STEP
        per_row += float(np.linalg.lstsq(np.column_stack([basis, slope]), wanted, rcond=None)[0][2])
    declared, basis = waves(per_row)
    cosine, sine = np.linalg.lstsq(basis, wanted, rcond=None)[0].tolist()
    left = float(np.linalg.norm(wanted - basis @ [cosine, sine]) / np.linalg.norm(wanted))
    phase = atan2(sine, cosine)
    return left, {**declared, "amplitude": hypot(cosine, sine)} | ({"phase": phase} if abs(phase) > _SAME else {})
