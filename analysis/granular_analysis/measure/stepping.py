"""Network as the engine of a run: LAMMPS's time steps without LAMMPS, in compiled loops, by JAX or in NumPy.

`granular_lmp.runs.engine` defines the interface. The spheres start as in the deck; contact laws, walls, drives and
steps are those of `granular_analysis`.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
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
from granular_analysis.theory.loops import library
from granular_analysis.theory.network_state import Pairs, State, search
from granular_analysis.theory.network_tangents import combined
from granular_analysis.theory.network_verlet import Carried
from granular_lmp.compiled import place
from granular_lmp.runs.engine import Look, SceneError, Setting, setting_of
from granular_lmp.runs.record import Record, Scene

__all__ = ["NetworkEngine"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
STEPS = {  # last word of a device, and the module that takes its steps
    "C": "granular_analysis.theory.network_compiled",
    "JAX": "granular_analysis.theory.network_traced",
    "NumPy": "granular_analysis.theory.network_verlet",
}
# Bytes of a process, of each sphere by dimension, and of each sphere in each record of a run without a wave while it is
# read. Measured maxima with JAX on a CPU: 370 MB, and for each sphere 3.5 kB in a perfect sheet, 5.2 kB in an imperfect
# one, 10.5 kB in fcc
_PROCESS, _SPHERE, _READ = 4e8, {2: 5500.0, 3: 11000.0}, 130.0


@dataclass(frozen=True)
class NetworkEngine:
    """The network on a device.

    Attributes
    ----------
    device : name in ``run.json``; its last word is C, JAX or NumPy, see `STEPS`.
    room : memory of the GPU in bytes; inf without a GPU.
    at_once : number of simultaneous runs on this machine, which share its memory; 1 in a process that receives the
        engine.
    """

    device: str
    room: float = np.inf
    at_once: int = 1

    def __reduce__(self) -> tuple[type["NetworkEngine"], tuple[str, float]]:
        """Return the class and the arguments with which another process makes the engine."""
        return NetworkEngine, (self.device, self.room)

    @classmethod
    def on(cls, name: str) -> "NetworkEngine":
        """Return the engine on "cpu", in compiled loops if there is a compiler, or on "numpy", "jax" or "gpu".

        "jax" uses all cores of this machine. Raises TheoryError for "jax" and "gpu" without JAX, and for "gpu" without
        a GPU that JAX supports.
        """
        if name == "cpu" and library() is not None:
            return cls("cpu, C")
        if name in {"cpu", "numpy"}:
            return cls("cpu, NumPy")
        card = name == "gpu"
        if find_spec("jax") is None:
            more = " 'jax[cuda12]'" if card else ""
            raise TheoryError(f"--device {name}: needs JAX: pip install 'granular-lmp[jax]'{more}")
        import jax  # an extra, and slow to import

        try:
            (first, *_) = jax.devices("cpu" if name == "jax" else name)
        except RuntimeError as error:
            raise TheoryError(f"--device {name}: JAX finds none: {str(error).splitlines()[0]}") from error
        jax.config.update("jax_default_device", first)
        if jax.config.values["jax_compilation_cache_dir"] is None:  # a loop takes seconds to compile
            jax.config.update(
                "jax_compilation_cache_dir", str(place("granular-analysis", "jax", "", [version("jax").encode()]))
            )
            jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
        if not card:
            return cls("cpu, JAX")
        room = (first.memory_stats() or {}).get("bytes_limit", np.inf)
        return cls(f"{name} {first.device_kind}, JAX", room=room)

    @property
    def by(self) -> str:
        """Key of `STEPS`: C, JAX or NumPy."""
        return self.device.split(", ")[-1]

    @property
    def versions(self) -> Mapping[str, str]:
        """Return the versions of the packages that take the steps, for ``run.json``."""
        return {"jax": version("jax")} if self.by == "JAX" else {}

    def refuse_larger(self, scene: Scene) -> None:
        """Raise TheoryError if the runs of a scene need more memory than this machine has free, or than the GPU has."""
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
        """Return the motion of a run; raise SceneError if the network leaves something out or memory is too small.

        A process that received the engine from another process prepares its own device.
        """
        try:
            self.refuse_larger(setting.scene)
            if (here := NetworkEngine.on(kind_of(self.device)).device) != self.device:
                raise TheoryError(f"device: the engine was made for {self.device}, and this process has {here}")
            return Motion(_first(setting), setting, import_module(STEPS[self.by]))
        except TheoryError as error:
            raise SceneError(str(error), because="not built") from error


def first_of(scene: Scene) -> tuple[FirstSnapshot, Setting]:
    """Return the network at the start of a scene's run, and the setting of the run, without running it.

    Raises SceneError for a scene with ``time.tolerance``, which has no time step, and TheoryError for a scene that the
    network leaves out.
    """
    if scene.wave is None:  # the choice of recorded spheres does not change the motion
        scene = replace(scene, output=replace(scene.output, rows=(), spheres=()))
    setting = setting_of(scene)
    return _first(setting), setting


def _first(setting: Setting) -> FirstSnapshot:
    """Return the network of a setting; raise TheoryError for a scene that the network leaves out."""
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
    if lacks := missing(NETWORK, others_of(record)):
        raise TheoryError(f"the network leaves out {', '.join(lacks)}")
    return network_of(record, spheres, setting.recorded)


def kind_of(device: str) -> str:
    """Return the argument of `NetworkEngine.on` for a device as ``run.json`` names it."""
    return {"cpu, NumPy": "numpy", "cpu, JAX": "jax"}.get(device, device.split(",")[0].split()[0])


def _free() -> float:
    """Return the free memory in bytes; inf if the system does not report it."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, ValueError, StopIteration):
        return np.inf


class Motion:
    """Motion of the network of a run, with the steps of a module of `STEPS`."""

    def __init__(self, first: FirstSnapshot, setting: Setting, steps: Any) -> None:
        self.network, self.state, self.step, self.distances = (
            first.network,
            first.state,
            setting.step,
            setting.distances,
        )
        self.steps = steps
        pairs = self.state.pairs
        self.rested = _keys(pairs, len(self.network.position))[pairs.overlap > pairs.normal.end]
        self._found_again(pairs)

    def _found_again(self, pairs: Pairs) -> None:
        """Take a new list of pairs: find those that touched at rest, and count those that are no longer listed."""
        self.pairs, self.arrays = pairs, self.steps.arrays_of(pairs)
        self.at_rest = np.isin(_keys(pairs, len(self.network.position)), self.rested)
        self.lost = len(self.rested) - int(np.count_nonzero(self.at_rest))

    def moments(self, stops: Iterable[int], kept: Mapping[str, NDArray[Any]] | None) -> Iterator["Moment"]:
        """Yield the spheres after each of some ascending numbers of steps, from the start or from a checkpoint."""
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
        """Return the extremes for guards, of the spheres whose distance to the recorded one is below `reach`."""
        if found.state.pairs is not self.pairs:
            self._found_again(found.state.pairs)
        seen = self.steps.extremes(self.network, self.arrays, found.now, self.at_rest, self.distances < reach)
        look = Look(*map(float, seen))
        return look._replace(changed=look.changed + self.lost)


def _keys(pairs: Pairs, spheres: int) -> NDArray[np.intp]:
    """Return a unique number for each pair."""
    return np.asarray(pairs.first * (2 * spheres) + pairs.second)


class Moment:
    """The spheres after a number of steps."""

    def __init__(self, of: Motion, found: network_verlet.Moment) -> None:
        self.of, self.found, self.number = of, found, found.number

    def fields(self, spheres: Integers) -> tuple[Floats, Floats, Floats, Floats]:
        """Return displacement, velocity, rotation and spin of n spheres, (n, d); in the plane rotations are (n, 1).

        For spheres that a drive moves, the velocity is the one that contacts see in this step. For spheres that a
        drive turns, the spin is the one that contacts see in the next step, because LAMMPS sets it at the end of a
        step.
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
        if turn.shape[1] == 3:  # the network holds 2 tan(angle/2) along the axis
            size = np.linalg.norm(turn, axis=1, keepdims=True)
            turn = turn * np.divide(2 * np.arctan(size / 2), size, out=np.ones_like(size), where=size > 0)
        return place, velocity, turn, spin

    def look(self, reach: float) -> Look:
        """Return the extremes for guards, of the spheres whose distance to the recorded one is below `reach`."""
        return self.of.look(self.found, reach)

    def forces(self, spheres: Integers) -> Floats:
        """Return the forces on n spheres that are neither held nor moved, (n, d)."""
        rates = self.of.steps.taken(self.found.now.rates[: self.of.network.dimension], spheres)
        return np.asarray((rates * self.of.network.mass[spheres]).T)

    def contacts(self, spheres: Integers) -> tuple[Integers, Floats]:
        """Return the closed contacts among some spheres, see `granular_lmp.runs.engine.Moment.contacts`."""
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
        """Return all arrays that the next step needs; `place` are the places at which pairs were searched."""
        now = self.found.now
        arrays = {"motion": now.motion, "memory": now.memory, "begun": now.begun, "rates": now.rates}
        return {name: np.array(each) for name, each in arrays.items()} | {"place": self.found.state.pairs.place}
