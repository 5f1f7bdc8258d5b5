"""The settings of a run that cost time, in groups, for a work–precision study.

A group is a row of `KNOBS`: a name, and a function from the scene to its settings. A setting consists of one run, or of
several whose records are extrapolated. All other values are those of the scene, and many settings share its run.
"""

import hashlib
from collections.abc import Callable, Mapping
from typing import Any

from granular_lmp.accuracy.ladder import build, finest_step, sphere_steps, with_step
from granular_lmp.accuracy.rounding import check_floor, linear_signals
from granular_lmp.effects.selection import warnings, with_all
from granular_lmp.errors import GranularError, LaunchError, SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.problem import prepare
from granular_lmp.runs.options import core_count
from granular_lmp.scene.linear import starts_along_y
from granular_lmp.scene.scene import Scene
from granular_lmp.studies.output_variants import OUTPUTS
from granular_lmp.studies.sweep_points import scene_hash

REFERENCE = "reference"
EFFECTS = "effects"
HALVINGS = 5  # a single run halves the longest stable step at most five times
COLUMN_COUNTS = (3, 4, 8, 20, 100)
RANKS = (1, 2)
SHEET_WIDTH = 100  # columns: half as wide as the paper's 201 rows are long
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


@dataclass(frozen=True)
class Run:
    """One run of LAMMPS, or with a tolerance its runs: a scene, a name in `OUTPUTS`, and the number of MPI ranks."""

    scene: Scene
    output: str = "probe"
    ranks: int = 1

    @cached_property
    def name(self) -> str:
        """Name of the run: 16 hexadecimal digits of a hash of scene, output and ranks."""
        words = f"{scene_hash(self.scene)} {self.output} {self.ranks}"
        return hashlib.sha256(words.encode()).hexdigest()[:16]

    @cached_property
    def work(self) -> float:
        """Spheres times steps, with the equivalent of the time for the output."""
        output = OUTPUTS[self.output].work * (self.scene.time.samples + 1)
        return sphere_steps(self.scene) + self.scene.shape.spheres * output


@dataclass(frozen=True)
class Point:
    """One setting: a run, or several, each with half the step of the one before, of which the last two count."""

    knob: str
    setting: str
    runs: tuple[Run, ...]

    def __str__(self) -> str:
        return f"{self.knob}: {self.setting}"

    def options(self, scene: Scene) -> str | None:
        """Return the options of ``granular-lmp run`` that give this setting of a scene from `base`.

        None if it is not one run of the same physics: a pair is what ``time.tolerance`` does by itself, another output
        changes what is written, and an effect changes the model.
        """
        run, *others = self.runs
        if others or run.output != "probe" or self.knob == EFFECTS:
            return None
        there, values = _flat(scene), _flat(run.scene)
        step = {key: values[key] for key in ("time.timestep", "time.tolerance") if key in values}
        changed = {key: value for key, value in values.items() if value != there.get(key)} | step
        said = [f"--set {key}={value}" for key, value in changed.items()]
        return " ".join(said + [f"--np {run.ranks}"] * (run.ranks > 1))


def _flat(scene: Scene) -> dict[str, Any]:
    tables = {name: table for name, table in scene.to_dict().items() if isinstance(table, dict)}
    return {f"{name}.{key}": value for name, table in tables.items() for key, value in table.items()}


def base(scene: Scene) -> Scene:
    """Return the scene that every setting changes: with a step instead of a tolerance, and the snapped ξ.

    Of a wave it has no snapshots of all spheres, because the output is one of the settings.

    Raises
    ------
    SceneError
        If the scene cannot be run, or its wave is not a running plane wave along y.
    """
    prepare(scene)
    if scene.wave is None:
        return build(scene).problem.scene
    if not starts_along_y(scene):
        raise SceneError(
            f"wave: {scene.words}: must be a running plane wave along y; rows and columns of others are no knobs"
        )
    if scene.time.tolerance is not None:
        scene = with_step(scene, finest_step(scene))
    return scene.with_values({"wave.wavenumber": scene.wavenumber, "output.particles": 0.0})


def reference(scene: Scene) -> Point:
    """Return the reference of all settings: three runs with steps finer than those of the time-step settings.

    The two finer runs are extrapolated; the extrapolation of the two coarser ones gives the error of the reference.
    """
    step = _steps(scene)[-1] / 2
    return Point(REFERENCE, f"{step:.3g} + half + quarter", tuple(_stepped(scene, step / 2**k) for k in range(3)))


def points(scene: Scene) -> tuple[list[Point], dict[str, str]]:
    """Return all settings, and those that the scene or the machine excludes with the reason.

    Parameters
    ----------
    scene : Scene
        Scene from `base`.
    """
    made, refused = [], {}
    for knob, settings in KNOBS.items():
        if scene.wave is None:
            if knob not in OF_STRIKES:
                refused[knob] = "is of a scene with a wave"
                continue
        elif knob in OTHER_CRYSTALS and not (scene.perfect and scene.shape.infinite):
            refused[knob] = "is another crystal where spheres differ or are missing, or faces are free"
            continue
        for setting, changed in settings(scene).items():
            try:
                runs = changed()
                _ = [run.name for run in runs]  # the name needs a prepared scene, which raises every SceneError now
                made.append(Point(knob, setting, runs))
            except GranularError as error:
                refused[f"{knob}: {setting}"] = str(error)
    return made, refused


# --- the settings ----------------------------------------------------------------------------------------------------

Make = Callable[[], tuple[Run, ...]]


def _stepped(scene: Scene, step: float) -> Run:
    return Run(scene.with_values({"time.timestep": step}))


def _pair(scene: Scene, step: float) -> tuple[str, tuple[Run, ...]]:
    return f"{step:.4g} + {step / 2:.4g}", (_stepped(scene, step), _stepped(scene, step / 2))


def _steps(scene: Scene) -> list[float]:
    """Return the longest step that the scene allows and that fits a sample, and its halves, τ."""
    rules = prepare(scene).step_rules
    longest = scene.time.sample / (int(scene.time.sample / min(rule.longest for rule in rules)) + 1)
    return [longest / 2**k for k in range(HALVINGS + 1)]


def _changed(scene: Scene, values: Mapping[str, Any], **how: Any) -> Make:
    return lambda: (Run(scene.with_values(values), **how),)


def _strip(scene: Scene) -> dict[str, Any]:
    """Return the changes that give the fewest spheres; a periodic cell keeps its rows, which fix the wave number.

    A crystal that is not perfect, or has sides or a free end, keeps its size.
    """
    if scene.wave is None or not scene.perfect or not scene.shape.infinite:
        return {}
    fewer_rows = {} if scene.shape.along_y else {"packing.rows": "auto"}
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
            if strip.wave is not None:
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
    def make(name: str) -> Make:
        def run() -> tuple[Run, ...]:
            return (Run(scene, name),)

        return run

    return {name: make(name) for name in OUTPUTS}


def _effects(scene: Scene) -> dict[str, Make]:
    chosen = prepare(scene).effects
    on = {effect.name: effect.on for effect in chosen}

    def without(name: str) -> Make:
        def run() -> tuple[Run, ...]:
            if not on[name]:
                raise LaunchError(f"effects.{name}: is off already")
            return (Run(scene.with_values({f"effects.{name}": False})),)

        return run

    # If a scene forces off an effect that it calls for, the difference would be its own error and not that of a setting
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
    """Return the fewest spheres, and a sheet with every effect and LAMMPS's default dump of all positions."""
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
    EFFECTS: _effects,
    "ranks": _ranks,
    "strip or sheet": _sheet,
}
# Groups of a scene without a wave
OF_STRIKES = frozenset({"time step", "Richardson pair", "tolerance, strip", "ranks"})
# Groups that change the size of the packing, which draws other spheres
OTHER_CRYSTALS = frozenset({"columns", "ends", "strip or sheet"})
# Groups whose settings are ordered by work, so that the slope of the error has a meaning
ORDERED = frozenset({"time step", "Richardson pair", "tolerance, strip", "columns"})
