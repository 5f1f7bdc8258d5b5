"""The knobs of a run that cost time, and the settings of each that a work–precision study takes.

A knob is a row of `KNOBS`: a name, and a function from the scene to its settings, each the runs that it takes: one, or
two whose records are extrapolated. All else is as the scene says, so that many settings share one run, the scene's own.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from granular_lmp.accuracy.ladder import finest_step, planned_steps, with_step
from granular_lmp.accuracy.rounding import check_floor, linear_signals
from granular_lmp.effects.selection import warnings, with_all
from granular_lmp.errors import GranularError, LaunchError, SceneError
from granular_lmp.problem import largest_step, prepare
from granular_lmp.runs.launch import core_count
from granular_lmp.scene.scene import Scene
from granular_lmp.studies.output_variants import OUTPUTS
from granular_lmp.studies.sweep_points import scene_hash

REFERENCE = "reference"
HALVINGS = 5  # of the longest stable step, of one run
COLUMN_COUNTS = (3, 4, 8, 20, 100)
RANKS = (1, 2)
SHEET_WIDTH = 100  # columns: half as wide as the paper's 201 rows are long
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


@dataclass(frozen=True)
class Run:
    """One run of LAMMPS, with a tolerance those of `granular_lmp.accuracy.tolerance`: scene, `OUTPUTS`, MPI ranks."""

    scene: Scene
    output: str = "probe"
    ranks: int = 1

    @cached_property
    def name(self) -> str:
        """16 hexadecimal digits, of all that makes the run."""
        words = f"{scene_hash(self.scene)} {self.output} {self.ranks}"
        return hashlib.sha256(words.encode()).hexdigest()[:16]

    @cached_property
    def work(self) -> float:
        """Particle-steps, with those that the time for the output is worth."""
        output = OUTPUTS[self.output].work * (self.scene.time.samples + 1)
        return self.scene.shape.spheres * (planned_steps(self.scene) + output)


@dataclass(frozen=True)
class Point:
    """A setting of a knob: one run, or several, each with half the step of the one before; the last two count."""

    knob: str
    setting: str
    runs: tuple[Run, ...]

    def __str__(self) -> str:
        return f"{self.knob}: {self.setting}"


def base(scene: Scene) -> Scene:
    """The scene that every setting changes: a step in place of a tolerance, and ξ as its periodic cell snaps it.

    It has no snapshots of all spheres: what a run writes down is one of the knobs.

    Raises
    ------
    SceneError
        For a wave that is not a running plane wave along y.
    """
    prepare(scene)
    if not scene.plane_along_y:
        raise SceneError(
            f"wave: {scene.wave_words}: must be a running plane wave along y; rows and columns of others are no knobs"
        )
    if scene.time.tolerance is not None:
        scene = with_step(scene, finest_step(scene))
    return scene.with_values({"wave.wavenumber": scene.wavenumber, "output.particles": 0.0})


def reference(scene: Scene) -> Point:
    """What all others are measured against: three runs of steps finer still than those of the time step's knob.

    The two finer runs are extrapolated; with the two coarser ones they tell how good that is.
    """
    step = _steps(scene)[-1] / 2
    return Point(REFERENCE, f"{step:.3g} + half + quarter", tuple(_stepped(scene, step / 2**k) for k in range(3)))


def points(scene: Scene) -> tuple[list[Point], dict[str, str]]:
    """The settings of all knobs, and those that the scene or the machine cannot have, with the reason.

    Parameters
    ----------
    scene : Scene
        As `base` gives it.
    """
    made, refused = [], {}
    for knob, settings in KNOBS.items():
        for setting, changed in settings(scene).items():
            try:
                runs = changed()
                _ = [run.name for run in runs]  # a scene shows all that is wrong with it when it is resolved
                made.append(Point(knob, setting, runs))
            except GranularError as error:
                refused[f"{knob}: {setting}"] = str(error)
    return made, refused


# --- the settings ----------------------------------------------------------------------------------------------------

Make = Callable[[], tuple[Run, ...]]


def _stepped(scene: Scene, step: float) -> Run:
    return Run(with_step(scene, step))


def _pair(scene: Scene, step: float) -> tuple[str, tuple[Run, ...]]:
    return f"{step:.4g} + {step / 2:.4g}", (_stepped(scene, step), _stepped(scene, step / 2))


def _steps(scene: Scene) -> list[float]:
    """The longest stable step that fits a sample, and its halves."""
    longest = scene.time.sample / (int(scene.time.sample / largest_step(scene)) + 1)
    return [longest / 2**k for k in range(HALVINGS + 1)]


def _changed(scene: Scene, values: Mapping[str, Any], **how: Any) -> Make:
    return lambda: (Run(scene.with_values(values), **how),)


def _strip(scene: Scene) -> dict[str, Any]:
    """The fewest spheres; the rows of a periodic cell decide the wave number, and stay."""
    fewer_rows = {"packing.rows": "auto"} if scene.shape.ends == "fixed" else {}
    return {"packing.columns": "auto", **fewer_rows}


def _time_step(scene: Scene) -> dict[str, Make]:
    return {f"{step:.4g}": lambda step=step: (_stepped(scene, step),) for step in _steps(scene)}  # type: ignore[misc]


def _pairs(scene: Scene) -> dict[str, Make]:
    made = (_pair(scene, step) for step in _steps(scene)[:-1])
    return {setting: lambda runs=runs: runs for setting, runs in made}  # type: ignore[misc]


def _tolerance(scene: Scene) -> dict[str, Make]:
    def make(tolerance: float) -> Make:
        def run() -> tuple[Run, ...]:
            strip = scene.with_values(_strip(scene) | {"time.tolerance": tolerance})
            check_floor(strip, linear_signals(strip))
            return (Run(strip),)

        return run

    return {f"{tolerance:.0e}": make(tolerance) for tolerance in TOLERANCES}


def _columns(scene: Scene) -> dict[str, Make]:
    return {str(columns): _changed(scene, {"packing.columns": columns}) for columns in COLUMN_COUNTS}


def _ends(scene: Scene) -> dict[str, Make]:
    few = {"packing.rows": "auto"}
    return {
        f"{scene.shape.rows} rows, {scene.shape.ends}": _changed(scene, {}),
        "rows auto, fixed": _changed(scene, few | {"packing.ends": "fixed"}),
        "rows auto, periodic": _changed(scene, few | {"packing.ends": "periodic"}),
    }


def _outputs(scene: Scene) -> dict[str, Make]:
    return {name: _changed(scene, {}, output=name) for name in OUTPUTS}


def _effects(scene: Scene) -> dict[str, Make]:
    chosen = prepare(scene).effects
    on = {effect.name: effect.on for effect in chosen}

    def without(name: str) -> Make:
        def run() -> tuple[Run, ...]:
            if not on[name]:
                raise LaunchError(f"effects.{name}: is off already")
            return (Run(scene.with_values({f"effects.{name}": False})),)

        return run

    # Against a scene that forces off what it calls for, it is that one whose error would be taken for a mistake
    every = "all: another model" if warnings(chosen) else "all"
    return {
        "as declared": _changed(scene, {}),
        every: lambda: (Run(with_all(scene)),),
        "no tracking": without("tracking"),
        "no rotation": without("rotation"),
        "incremental law": _changed(scene, {"effects.shear_law": "incremental"}),
    }


def _ranks(scene: Scene) -> dict[str, Make]:
    def make(ranks: int) -> Make:
        def run() -> tuple[Run, ...]:
            if ranks > core_count():
                raise LaunchError(f"ranks = {ranks!r}: must be from 1 to {core_count()}, the cores of this machine")
            return (Run(scene, ranks=ranks),)

        return run

    return {str(ranks): make(ranks) for ranks in RANKS}


def _sheet(scene: Scene) -> dict[str, Make]:
    """The fewest spheres, against a sheet with every effect whose positions LAMMPS dumps unless told otherwise."""
    sheet = {"packing.columns": SHEET_WIDTH}
    return {
        "strip": _changed(scene, _strip(scene)),
        "sheet": lambda: (Run(with_all(scene.with_values(sheet)), "all, text, 6 digits"),),
    }


KNOBS: dict[str, Callable[[Scene], dict[str, Make]]] = {
    "time step": _time_step,
    "Richardson pair": _pairs,
    "tolerance, strip": _tolerance,
    "columns": _columns,
    "ends": _ends,
    "output": _outputs,
    "effects": _effects,
    "ranks": _ranks,
    "strip or sheet": _sheet,
}
# Those whose settings go from little work to much, so that it means something how the error falls
ORDERED = frozenset({"time step", "Richardson pair", "tolerance, strip", "columns"})
