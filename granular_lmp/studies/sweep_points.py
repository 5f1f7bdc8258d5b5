"""Points of a sweep: lists of values, their outer product, and for each point its request, its run and the folder."""

import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from fractions import Fraction
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from granular_lmp.accuracy.ladder import planned, sphere_steps
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.files import assignment
from granular_lmp.scene.schema import cut, shown
from granular_lmp.studies.identity import names_of

_AT_COMMAS = re.compile(r",(?![^\[]*\])")  # commas between values, not those inside a pair
_WAVE_VECTOR = ("wavenumber", "frequency", "direction")  # keys that together determine the wave
MOST_RUNS = 100_000  # each run has a folder; file systems and the table are fast up to this number


def axis(text: str) -> tuple[str, list[Any]]:
    """Return ``("wave.amplitude", [0.02, 0.2])`` for ``"wave.amplitude=0.02,0.2"``.

    The values are TOML scalars or pairs with commas between them. ``a:b:n`` means n values from a to b, both included:
    the doubles nearest to a + k(b − a)/(n − 1), or whole numbers if all are whole.

    Raises
    ------
    SceneError
        If the text has another form.
    """
    key, equals, values = text.partition("=")
    if not equals or not key.strip() or not all(value.strip() for value in _AT_COMMAS.split(values)):
        raise SceneError(
            f"{shown(text)}: must be KEY=VALUES, for instance wave.wavenumber=0.1:3.1:61 or wave.mode=TR,RT"
        )
    return key.strip(), [value for item in _AT_COMMAS.split(values) for value in _item(item, text)]


def axes(texts: Iterable[str]) -> dict[str, list[Any]]:
    """Return key → values for several texts, each as for `axis`; a repeated key raises SceneError."""
    over: dict[str, list[Any]] = {}
    for text in texts:
        key, values = axis(text)
        if key in over:
            raise SceneError(f"{cut(key)}: is swept over twice; put all its values together, with commas")
        over[key] = values
    return over


def _item(item: str, text: str) -> list[Any]:
    if ":" not in item:
        return [assignment(f"key={item}")[1]]
    try:
        first, last, count = item.split(":")
        start, end = (Fraction(repr(float(number))) for number in (first, last))  # 0.05 is 1/20, not its double
        steps = int(count) - 1
    except (ValueError, OverflowError) as error:
        raise SceneError(f"{shown(text)}: {shown(item)} must be FIRST:LAST:COUNT, three numbers") from error
    if not 1 <= steps < MOST_RUNS:
        raise SceneError(f"{shown(text)}: {shown(item)} must have a COUNT from 2 to {MOST_RUNS}")
    values = [start + (end - start) * k / steps for k in range(steps + 1)]
    whole = all(value.denominator == 1 for value in values)
    return [int(value) if whole else float(value) for value in values]


@dataclass(frozen=True)
class GridPoint:
    """Point of a sweep.

    Attributes
    ----------
    asked, ran : dict
        Its values by dotted key, as requested and as they run: with "auto" decided, a wave that fits its cell, and a
        time step that fits its sample.
    run : str
        Name of its run; points with the same motion share one run.
    scene : Scene
        Requested scene.
    of_run : Scene
        Scene of the run; it may be another one for points that share a run.
    work : float
        Spheres times steps of the run; the time is proportional to this.
    """

    asked: dict[str, Any]
    ran: dict[str, Any]
    run: str
    scene: Scene
    of_run: Scene
    work: float


def points(
    scene: Scene,
    over: Mapping[str, list[Any]],
    runs: Path | None = None,
    refuse: Callable[[Problem], None] | None = None,
) -> list[GridPoint]:
    """Return every point of the outer product of `over`, the last key running fastest.

    `runs` is the folder of runs, if it exists: points that share a run use an existing one. `refuse` raises SceneError
    for the problem of a point, with its time step, that cannot run.

    Raises
    ------
    SceneError
        If a key or a value is not allowed; the message names the point.
    """
    empty = [key for key, values in over.items() if not values]
    if not over or empty:
        raise SceneError(f"{empty[0] if empty else 'sweep'}: there is no value to sweep over")
    for key in ("name", "description"):
        if key in over:
            raise SceneError(f"{key} = {shown(over[key][0])}: cannot be swept over; it does not change the run")
    count = prod(map(len, over.values()))
    if count > MOST_RUNS:
        raise SceneError(f"{' x '.join(over)}: {count} runs; at most {MOST_RUNS} are allowed")
    made: list[GridPoint] = []
    motions: dict[str, list[GridPoint]] = {}
    for values in product(*over.values()):
        asked = dict(zip(over, values, strict=True))
        try:
            one = scene.with_values(asked)
            problem = prepare(one)
            work = sphere_steps(problem)  # raises if a tolerance takes too many
            if refuse is not None:
                refuse(planned(problem))
        except SceneError as error:
            said = ", ".join(f"{key} = {shown(value)}" for key, value in asked.items())
            raise SceneError(f"{error} (in the sweep at {said})", because=error.because) from error
        made.append(GridPoint(asked, _ran(problem, asked), _name(problem, runs), one, one, work))
        motions.setdefault(_motion(problem), []).append(made[-1])
    of_run = {id(point): _chosen(same, runs) for same in motions.values() for point in same}
    chosen = [of_run[id(point)] for point in made]
    return [
        replace(point, ran=of.ran, run=of.run, of_run=of.scene, work=of.work)
        for point, of in zip(made, chosen, strict=True)
    ]


def _chosen(same: list[GridPoint], runs: Path | None) -> GridPoint:
    """Return the point whose run all points with the same motion share: one with an existing run, else the first."""
    return next((point for point in same if runs and (runs / point.run).exists()), same[0])


def _ran(problem: Problem, asked: dict[str, Any]) -> dict[str, Any]:
    """Return the values that run, with every "auto" decided, for the requested ones."""
    scene = problem.scene

    def of(key: str, value: Any) -> Any:
        said = scene.value(key)
        return scene.used.get(key, value if said is None or said == value else said)  # 2 is kept as 2, not 2.0

    return {key: of(key, value) for key, value in asked.items()}


def _motion(problem: Problem) -> str:
    """Return everything in a scene that determines its motion; values that a cell or sample makes equal agree."""
    scene = problem.scene
    values = scene.to_dict()
    if scene.wave is not None:
        named = {key: value for key, value in values["wave"].items() if key not in _WAVE_VECTOR}
        values["wave"] = named | {"vector": scene.vector.components}
    values["time"] |= scene.time.clock.as_run
    return json.dumps(values | {"name": None, "description": None}, sort_keys=True)


def scene_hash(scene: Scene) -> str:
    """Return the name of the run of a scene with every "auto" decided (`granular_lmp.studies.identity`)."""
    return names_of(prepare(scene).scene)[0]


def _name(problem: Problem, runs: Path | None) -> str:
    """Return the name of the run of a problem, or the name of an earlier release if `runs` has the run so."""
    names = names_of(problem.scene)
    if problem.declared.packing.columns == 1:  # release 0.1.0 ran one column if the scene said so
        names += names_of(problem.scene.with_values({"packing.columns": 1}))
    return next((name for name in names if runs and (runs / name).exists()), names[0])
