"""The settings of a run that cost time, in groups, for a work–precision study.

Each setting changes a few keys of the scene. It consists of one run, or of several whose records are extrapolated. All
other values are those of the scene, and many settings share its run.
"""

from typing import Any

from granular_lmp.accuracy.ladder import build
from granular_lmp.accuracy.rounding import check_floor, linear_signals
from granular_lmp.errors import GranularError, SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.problem import prepare
from granular_lmp.rest.linear import starts_along_y
from granular_lmp.rest.scene import Scene

REFERENCE = "reference"
HALVINGS = 5  # a single run halves the longest stable step at most five times
COLUMN_COUNTS = (3, 8, 20, 100)
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)

Changes = dict[str, Any]


@dataclass(frozen=True)
class Setting:
    """One setting.

    Attributes
    ----------
    knob : str
        Name of its group.
    name : str
        Name in the group.
    runs : tuple of Scene
        A run, or several, each with half the step of the one before, of which the last two are extrapolated.
    options : str or None
        Options of ``granular-lmp run`` that give this setting of the declared scene; None if it is not one run.
    """

    knob: str
    name: str
    runs: tuple[Scene, ...]
    options: str | None


def base(scene: Scene) -> Scene:
    """Return the scene that every setting changes: with a step instead of a tolerance, and the snapped ξ.

    A scene with a wave has no snapshots of all spheres, because no error is measured in them.

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
            f"wave: {scene.words}: must be a running plane wave along y; the settings change rows and columns"
        )
    scene = scene.with_values({"time.timestep": build(scene).scene.time.timestep})
    return scene.with_values({"wave.wavenumber": scene.wavenumber, "output.particles": 0.0})


def settings(scene: Scene) -> tuple[list[Setting], dict[str, str]]:
    """Return all settings of a scene from `base`, and the names of those that it excludes with the reason.

    The first is the reference of all others: three runs with steps finer than theirs, of which the two finer ones are
    extrapolated; the extrapolation of the two coarser ones gives the error of the reference.
    """
    step = steps(scene)[-1] / 2
    fine = [_stepped(step / 2**k) for k in range(3)]
    made, refused = [_setting(scene, REFERENCE, f"{step:.3g} + half + quarter", fine)], {}
    for knob, group in groups(scene).items():
        for name, changes in group.items():
            try:
                made.append(_setting(scene, knob, name, changes))
            except GranularError as error:
                refused[f"{knob}: {name}"] = str(error)
    return made, refused


def groups(scene: Scene) -> dict[str, dict[str, list[Changes]]]:
    """Return the groups: name → setting → changes of each of its runs.

    Only an endless perfect crystal may change its size, since another size would draw other spheres in any other.
    """
    single, fewest, sizes = steps(scene), Changes(), dict[str, dict[str, list[Changes]]]()
    if scene.wave is not None and scene.perfect and scene.shape.infinite:
        few = {"packing.rows": "auto"}
        # A periodic cell keeps its rows, which fix the wavenumber
        fewest = {"packing.columns": "auto"} | ({} if scene.shape.along_y else few)
        if scene.lattice.sheet:
            sizes["columns"] = {str(columns): [{"packing.columns": columns}] for columns in COLUMN_COUNTS}
        sizes["ends"] = {
            f"{scene.shape.rows} rows, {scene.shape.ends}": [{}],
            "rows auto, fixed": [few | {"packing.ends": "fixed"}],
            "rows auto, periodic": [few | {"packing.ends": "periodic"}],
        }
    return {
        "time step": {f"{step:.4g}": [_stepped(step)] for step in single},
        "Richardson pair": {f"{h:.4g} + {h / 2:.4g}": [_stepped(h), _stepped(h / 2)] for h in single[:-1]},
        "tolerance, strip": {f"{each:.0e}": [fewest | {"time.tolerance": each}] for each in TOLERANCES},
        **sizes,
    }


def steps(scene: Scene) -> list[float]:
    """Return the longest step that the scene allows and that fits a sample, and its halves, τ."""
    rules = prepare(scene).rest.step_rules()
    longest = scene.time.sample / (int(scene.time.sample / min(rule.longest for rule in rules)) + 1)
    return [longest / 2**k for k in range(HALVINGS + 1)]


def _stepped(step: float) -> Changes:
    return {"time.timestep": step}


def _setting(scene: Scene, knob: str, name: str, changes: list[Changes]) -> Setting:
    """Return a setting; raises every SceneError of its runs."""
    runs = tuple(scene.with_values(each) for each in changes)
    for run in runs:
        if scene.wave is not None:
            check_floor(run, linear_signals(run))
        prepare(run)
    # The step stands for a tolerance that the user may have declared
    own = changes[0] if "time.tolerance" in changes[0] else _stepped(scene.time.step) | changes[0]
    options = " ".join(f"--set {key}={value}" for key, value in own.items())
    return Setting(knob, name, runs, options if len(runs) == 1 else None)
