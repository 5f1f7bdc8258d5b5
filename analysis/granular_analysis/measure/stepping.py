"""The network as the engine of a run: LAMMPS's own steps without LAMMPS, in NumPy or by JAX.

`granular_lmp.runs.engine` says what an engine gives. The spheres are those of the deck as they begin; the laws of their
contacts, the walls, the drives and the steps are those of this package.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.snapshot import FirstSnapshot, Spheres, network_of
from granular_analysis.theory import network_verlet
from granular_analysis.theory.catalogue import NETWORK, missing
from granular_analysis.theory.choice import others_of
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network_state import Pairs, State, search
from granular_analysis.theory.network_tangents import combined
from granular_analysis.theory.network_verlet import Carried
from granular_lmp.compiled import place
from granular_lmp.runs.engine import Look, SceneError, Setting
from granular_lmp.runs.record import Record, Scene

__all__ = ["NetworkEngine"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
ON_DEVICE = "granular_analysis.theory.network_traced"
# Bytes. Measured, the most that a process held by JAX on a CPU: 370 MB, and a sphere of a perfect sheet 3.5 kB, of an
# imperfect one 4.1 kB, of fcc 10.5 kB. Without a wave also the record, while it is read
_PROCESS, _SPHERE, _READ = 4e8, {2: 4500.0, 3: 11000.0}, 130.0
# Seconds. Measured, of NumPy for a step and for each sphere in it, in the plane and in space; JAX takes 1 until its
# loop is read from its cache, and 2.3 until it is compiled. A ladder of steps takes about a dozen to a sample
_STEP, _COMPILED, _LADDER = {2: (1.7e-4, 3.2e-7), 3: (3.5e-4, 1.6e-6)}, 2.0, 12


@dataclass(frozen=True)
class NetworkEngine:
    """The network on a device.

    Attributes
    ----------
    device : as ``run.json`` names it.
    traced : whether JAX takes the steps.
    room : bytes of the card, inf without one.
    at_once : runs at once on this machine, which must all find memory; a process that is handed the engine counts one.
    """

    device: str
    traced: bool
    room: float = np.inf
    at_once: int = 1

    def __reduce__(self) -> tuple[type["NetworkEngine"], tuple[str, bool, float]]:
        """Return what another process makes the engine of."""
        return NetworkEngine, (self.device, self.traced, self.room)

    @classmethod
    def on(cls, name: str) -> "NetworkEngine":
        """Return the engine on "cpu", with JAX if it is there, on "numpy", without it in any case, or on "gpu".

        Raises TheoryError for "gpu" without JAX, or without a card that it knows.
        """
        if name == "numpy" or find_spec("jax") is None:
            if name == "gpu":
                raise TheoryError("--device gpu: needs JAX: pip install 'granular-lmp[jax]' 'jax[cuda12]'")
            return cls("cpu, NumPy", traced=False)
        import jax  # an extra, and slow to import

        try:
            (first, *_) = jax.devices(name)
        except RuntimeError as error:
            raise TheoryError(f"--device {name}: JAX finds none: {str(error).splitlines()[0]}") from error
        jax.config.update("jax_default_device", first)
        if jax.config.values["jax_compilation_cache_dir"] is None:  # a loop takes seconds to compile
            jax.config.update(
                "jax_compilation_cache_dir", str(place("granular-analysis", "jax", "", [version("jax").encode()]))
            )
            jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
        if name == "cpu":
            return cls("cpu, JAX", traced=True)
        room = (first.memory_stats() or {}).get("bytes_limit", np.inf)
        return cls(f"{name} {first.device_kind}, JAX", traced=True, room=room)

    @property
    def versions(self) -> Mapping[str, str]:
        """Return the versions of what takes the steps."""
        return {"jax": version("jax")} if self.traced else {}

    def refuse_larger(self, scene: Scene) -> None:
        """Raise TheoryError for runs that need more memory than this machine has free, or than the card has."""
        spheres, records = scene.shape.spheres, scene.time.samples + 1 if scene.wave is None else 0
        of_device = _PROCESS + _SPHERE[scene.space] * spheres
        of_host = self.at_once * (of_device + _READ * spheres * records)
        each, fewer = (f" in each of {self.at_once} runs at once", ", or workers") if self.at_once > 1 else ("", "")
        for needed, there, where in ((of_host, _free(), "are free"), (of_device, self.room, f"has {self.device}")):
            if needed > there:
                raise TheoryError(
                    f"{spheres} spheres{each} need {needed / 1e9:.2g} GB of memory, and {there / 1e9:.2g} GB {where}: "
                    f"take fewer rows or columns{fewer}"
                )

    def begin(self, setting: Setting) -> "Motion":
        """Return the motion of a run; raises SceneError for what the network or the memory does not hold.

        A process that was handed the engine of another prepares its own device.
        """
        record = Record(np.empty(0), {}, setting.scene, dict(setting.info))
        begun, size = setting.spheres, np.linalg.norm(setting.spheres.rotation, axis=1, keepdims=True)
        turn = begun.rotation
        if turn.shape[1] == 3:
            turn = turn * np.divide(2 * np.tan(size / 2), size, out=np.ones_like(size), where=size > 0)
        spheres = Spheres(
            begun.types,
            begun.place,
            begun.radius,
            begun.density,
            begun.displacement,
            begun.velocity,
            turn,
            begun.spin,
            begun.cell,
        )
        try:
            self.refuse_larger(setting.scene)
            if self.traced and (here := NetworkEngine.on(kind_of(self.device)).device) != self.device:
                raise TheoryError(f"device: the engine is of {self.device}, and this process has {here}")
            if lacks := missing(NETWORK, others_of(record)):
                raise TheoryError(f"the network leaves out {', '.join(lacks)}")
            return Motion(network_of(record, spheres, setting.recorded), setting, self.traced)
        except TheoryError as error:
            raise SceneError(str(error), because="not built") from error


def kind_of(device: str) -> str:
    """Return what `NetworkEngine.on` takes for a device as ``run.json`` names it."""
    return "numpy" if device.endswith("NumPy") else device.split(",")[0].split()[0]


def sooner(name: str, scene: Scene) -> str:
    """Return "numpy" in place of "cpu" for a scene whose steps NumPy takes before JAX has compiled them."""
    of_step, of_sphere = _STEP[scene.space]
    steps = scene.time.samples * _LADDER if scene.time.tolerance is not None else scene.time.steps
    seconds = steps * (of_step + of_sphere * scene.shape.spheres)
    return "numpy" if name == "cpu" and seconds < _COMPILED else name


def _free() -> float:
    """Return the bytes of memory that are free, inf where the system does not say it."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, ValueError, StopIteration):
        return np.inf


class Motion:
    """The network of a run on its way."""

    def __init__(self, first: FirstSnapshot, setting: Setting, traced: bool) -> None:
        self.network, self.state, self.step, self.distances = (
            first.network,
            first.state,
            setting.step,
            setting.distances,
        )
        self.traced, self.steps = traced, steps_of(traced)
        pairs = self.state.pairs
        self.rested = _keys(pairs, len(self.network.position))[pairs.overlap > pairs.normal.end]
        self._found_again(pairs)

    def _found_again(self, pairs: Pairs) -> None:
        """Take other pairs: which of them touched at rest, and how many that did are too far apart to be listed."""
        self.pairs, self.arrays = pairs, self.steps.arrays_of(pairs) if self.traced else pairs
        self.at_rest = np.isin(_keys(pairs, len(self.network.position)), self.rested)
        self.lost = len(self.rested) - int(np.count_nonzero(self.at_rest))

    def moments(self, stops: Iterable[int], kept: Mapping[str, NDArray[Any]] | None) -> Iterator["Moment"]:
        """Yield the spheres after each of some numbers of steps, from the start or from a checkpoint on."""
        begin = None if kept is None else self._read(kept)
        for found in self.steps.moments(self.network, self.state, self.step, stops, begin):
            yield Moment(self, found)

    def _read(self, kept: Mapping[str, NDArray[Any]]) -> network_verlet.Moment:
        pairs = search(self.network, kept["place"])
        state = State(kept["motion"], pairs, np.zeros((self.network.dimension - 1, len(pairs.first))), kept["begun"])
        motion, memory, rates = (tuple(kept[name]) for name in ("motion", "memory", "rates"))
        now = Carried(motion, memory, kept["begun"], rates)
        return network_verlet.Moment(int(kept["number"]), state, now)

    def look(self, found: network_verlet.Moment, reach: float) -> Look:
        """Return what guards see."""
        if found.state.pairs is not self.pairs:
            self._found_again(found.state.pairs)
        seen = self.steps.extremes(self.network, self.arrays, found.now, self.at_rest, self.distances < reach)
        look = Look(*map(float, seen))
        return look._replace(changed=look.changed + self.lost)


def steps_of(traced: bool) -> Any:
    """Return the module that takes the steps."""
    return import_module(ON_DEVICE) if traced else network_verlet


def _keys(pairs: Pairs, spheres: int) -> NDArray[np.intp]:
    """Return a number for each pair."""
    return np.asarray(pairs.first * (2 * spheres) + pairs.second)


class Moment:
    """The spheres after a number of steps."""

    def __init__(self, of: Motion, found: network_verlet.Moment) -> None:
        self.of, self.found, self.number = of, found, found.number

    def fields(self, spheres: Integers) -> tuple[Floats, Floats, Floats, Floats]:
        """Return displacement, velocity, rotation and spin; of what drives move the velocity that contacts see.

        Of what they turn it is the spin that contacts see in the next step, as LAMMPS sets it at the end of one.
        """
        network, now = self.of.network, self.found.now
        rows = np.array(self.of.steps.taken(now.motion, spheres))
        here, ahead = network_verlet.signals(network, self.of.step, self.number, 2)
        for each, (value, rate), (_, next_rate) in zip(network.drives, here, ahead, strict=True):
            if each.moves:
                pair = value, next_rate if each.component >= network.dimension else rate
                share = np.zeros(len(network.position))
                share[each.spheres] = each.share
                own = np.isin(spheres, each.spheres)
                for row, number in zip((each.component, each.component + network.freedoms), pair, strict=True):
                    rows[row, own] = number * share[spheres[own]]
        place, turn, velocity, spin = (
            part.T for half in np.split(rows, 2) for part in np.split(half, [network.dimension])
        )
        if turn.shape[1] == 3:  # twice the tangent of half the angle, along the axis
            size = np.linalg.norm(turn, axis=1, keepdims=True)
            turn = turn * np.divide(2 * np.arctan(size / 2), size, out=np.ones_like(size), where=size > 0)
        return place, velocity, turn, spin

    def look(self, reach: float) -> Look:
        """Return what guards see."""
        return self.of.look(self.found, reach)

    def forces(self, spheres: Integers) -> Floats:
        """Return the forces on spheres that are free to move, (n, d)."""
        rates = self.of.steps.taken(self.found.now.rates[: self.of.network.dimension], spheres)
        return np.asarray((rates * self.of.network.mass[spheres]).T)

    def contacts(self, spheres: Integers) -> tuple[Integers, Floats]:
        """Return the closed contacts among spheres, as `granular_lmp.runs.engine.Moment`."""
        network, pairs = self.of.network, self.found.state.pairs
        inside = np.zeros(len(network.position) + len(network.walls), dtype=bool)
        inside[spheres] = True
        now = self.found.now
        motion, memory, rates = (tuple(map(np.asarray, each)) for each in (now.motion, now.memory, now.rates))
        now = Carried(motion, memory, np.asarray(now.begun), rates)
        there = network_verlet.seen(network, pairs, now)
        own = there.closed & inside[pairs.first] & inside[pairs.second]
        shear = np.array(combined(there.shear, there.tangents.along))
        distance = pairs.radii.sum(axis=0) - there.overlap
        apart = -np.array(there.normal) * distance
        table = np.vstack([there.repulsion, shear, apart])[:, own]
        return np.stack([pairs.first, pairs.second])[:, own], table.T

    def kept(self) -> Mapping[str, NDArray[Any]]:
        """Return what the next step follows from; pairs are those of the places at which they were searched."""
        now = self.found.now
        arrays = {"motion": now.motion, "memory": now.memory, "begun": now.begun, "rates": now.rates}
        return {name: np.array(each) for name, each in arrays.items()} | {"place": self.found.state.pairs.place}
