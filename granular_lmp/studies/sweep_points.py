"""The points of a sweep: lists of values, their outer product, and the scene and the name of each run."""

import re
from collections.abc import Iterable, Mapping
from fractions import Fraction
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from granular_lmp.errors import SceneError
from granular_lmp.scene.files import assignment
from granular_lmp.scene.schema import cut, shown
from granular_lmp.studies.identity import names_of
from granular_lmp.studies.runnable import Runnable, decided

_AT_COMMAS = re.compile(r",(?![^\[]*\])")  # commas between values, not those inside a pair
MOST_RUNS = 100_000  # each run has a folder; file systems and the table are fast up to this number


def axis(text: str) -> tuple[str, list[Any]]:
    """Return ``("wave.amplitude", [0.02, 0.2])`` for ``"wave.amplitude=0.02,0.2"``.

    The values are TOML scalars or pairs with commas between them. ``a:b:n`` stands for n values from a to b, both
    included, each the double nearest to the exact a + k(b − a)/(n − 1); they are whole numbers if all are whole.

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


def points(
    scene: Runnable, over: Mapping[str, list[Any]], runs: Path | None = None
) -> list[tuple[dict[str, Any], str, Runnable]]:
    """Return every point of the outer product of `over` with the name of its run and its scene.

    The last key runs fastest. `runs` is the folder of the runs, where that is there already.

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
    made: list[tuple[dict[str, Any], str, Runnable]] = []
    for values in product(*over.values()):
        point = dict(zip(over, values, strict=True))
        try:
            one = scene.with_values(point)
            name = _name(one, runs)
        except SceneError as error:
            said = ", ".join(f"{key} = {shown(value)}" for key, value in point.items())
            raise SceneError(f"{error} (in the sweep at {said})") from error
        made.append((point, name, one))
    return made


def scene_hash(scene: Runnable) -> str:
    """Return the name of a scene's run, in which every "auto" is decided (`granular_lmp.studies.identity`)."""
    return names_of(decided(scene))[0]


def _name(scene: Runnable, runs: Path | None) -> str:
    """Return the name of a scene's run; in a folder `runs` that of an earlier release, where the run has that one."""
    names = names_of(whole := decided(scene))
    if scene.packing.columns == 1:  # release 0.1.0 ran one column where the scene says so
        names += names_of(whole.with_values({"packing.columns": 1}))
    return next((name for name in names if runs and (runs / name).exists()), names[0])
