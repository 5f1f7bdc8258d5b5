"""Settings of a run that cost time, for a work–precision study: time steps and tolerances.

Each setting is one run, with a few changed keys of the scene.
"""

from typing import Any

from granular_lmp.accuracy.ladder import build, sphere_steps
from granular_lmp.accuracy.rounding import check_floor
from granular_lmp.errors import GranularError
from granular_lmp.frozen import dataclass
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.linear import plane_along_y
from granular_lmp.rest.scene import Scene
from granular_lmp.studies.identity import names_of

HALVINGS = 5  # a single run halves the longest stable step at most five times
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


@dataclass(frozen=True)
class Setting:
    """Setting of a study.

    Attributes
    ----------
    varied : str
        Name of its group.
    name : str
        Name in the group.
    run : Scene
    options : str
        Options of ``granular-lmp run`` that give this setting of the declared scene.
    folder : str
        Name of its run (`granular_lmp.studies.identity`).
    work : float
        Spheres times steps of all its runs; the time is proportional to this.
    """

    varied: str
    name: str
    run: Scene
    options: str
    folder: str
    work: float


def base(scene: Scene) -> Scene:
    """Return the scene that every setting changes: with a step instead of a tolerance, and the ξ of its cell.

    A scene with a wave has no snapshots of all spheres, because no error is measured in them.

    Raises
    ------
    SceneError
        If the scene cannot be run.
    """
    built = build(scene)
    if scene.wave is None:
        return built.problem.scene
    own = {"wave.wavenumber": scene.wavenumber} if plane_along_y(scene) else {}
    return scene.with_values({"time.timestep": built.scene.time.timestep}).with_values(own | {"output.particles": 0.0})


def settings(problem: Problem) -> tuple[list[Setting], dict[str, str]]:
    """Return the settings for a problem whose scene is from `base`, and excluded settings with reasons.

    Runs to a tolerance use the fewest spheres. Their number may change only for a plane wave along y in an infinite
    perfect crystal; a periodic cell keeps its rows, which fix the wavenumber.
    """
    scene = problem.scene
    fewest = {"packing.columns": "auto"} | ({} if scene.shape.along_y else {"packing.rows": "auto"})
    size: dict[str, Any] = fewest if plane_along_y(scene) else {}
    wanted = {("time step", f"{step:.4g}"): {"time.timestep": step} for step in steps(problem)}
    wanted |= {("tolerance", f"{each:.0e}"): size | {"time.tolerance": each} for each in TOLERANCES}
    made, refused = list[Setting](), dict[str, str]()
    for (varied, name), changes in wanted.items():
        try:
            made.append(_setting(problem, varied, name, changes))
        except GranularError as error:
            refused[f"{varied}: {name}"] = str(error)
    return made, refused


def references(problem: Problem) -> list[Setting]:
    """Return the three runs, with finer steps than all settings, from which the reference is extrapolated."""
    finer = [steps(problem)[-1] / 2**k for k in (1, 2, 3)]
    return [_setting(problem, "reference", f"{step:.3g}", {"time.timestep": step}) for step in finer]


def steps(problem: Problem) -> list[float]:
    """Return the longest allowed step that fits a sample, and repeated halves of it, τ."""
    sample, rules = problem.scene.time.sample, problem.rest.step_rules()
    longest = sample / (int(sample / min(rule.longest for rule in rules)) + 1)
    return [longest / 2**k for k in range(HALVINGS + 1)]


def _setting(problem: Problem, varied: str, name: str, changes: dict[str, Any]) -> Setting:
    """Return a setting; raise every SceneError of its run."""
    run = prepare(problem.declared.with_values(changes))
    if run.wave is not None:
        check_floor(run)
    options = " ".join(f"--set {key}={value}" for key, value in changes.items())
    return Setting(varied, name, run.declared, options, names_of(run.scene)[0], sphere_steps(run))
