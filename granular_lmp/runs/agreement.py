"""Agreement of the files of a run folder: ``scene.toml``, ``run.json``, ``trajectory.csv``, ``dump.centre``.

A folder may have been edited, copied together from two runs, or written by another program. Each function compares two
of the files and raises a RunFolderError that names the file, its value and the value of the other file.
"""

import hashlib
import json
from collections.abc import Iterator
from itertools import chain
from math import isclose
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.lammps.outputs import DUMP, SCENE, STATUS
from granular_lmp.runs.formats import expected_effects, is_one_column
from granular_lmp.scene.at_rest import sphere_count
from granular_lmp.scene.scene import Scene

Signals = dict[str, NDArray[np.float64]]
Pair = tuple[str, Any, Any]  # a dotted key of run.json, its value there, and the value that follows from the scene

# Both files come from a dozen operations on the same numbers, whose results differ by 1e-16 between processors
SAME = 1e-12
_CURE = "run it again with force=True"
_NO_SUCH = "no such name"


def scene_digest(text: str) -> str:
    """Return the digest of a ``scene.toml``, or of another file, for ``run.json``: the SHA-256 of its text."""
    return hashlib.sha256(text.encode()).hexdigest()


def refuse_other_scene(folder: Path, info: dict[str, Any]) -> None:
    """Raise RunFolderError unless ``run.json`` holds the digest of the folder's scene."""
    digest = info.get("scene_sha256")
    if digest is None:
        raise RunFolderError(f"{folder / STATUS}: scene_sha256 is missing, so that {SCENE} may be any; {_CURE}")
    try:
        text = (folder / SCENE).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{folder / SCENE}: cannot be read: {one_line(error)}") from error
    if digest != scene_digest(text):
        raise RunFolderError(f"{folder}: {SCENE} was changed since the run began; put it back, or run with force=True")


def refuse_other_physics(folder: Path, info: dict[str, Any], scene: Scene) -> None:
    """Raise RunFolderError if wave, effects or guards in ``run.json`` do not follow from ``scene.toml``.

    Entries may be missing only in a run that is not finished.
    """
    for key in ("effects", "guards"):
        if key not in info and info.get("status") == "finished":
            raise RunFolderError(f"{folder / STATUS}: {key} is missing; {_CURE}")
    at_rest = (_wave, _effects, _guards)
    pairs = _strikes(info, scene) if scene.loose else chain(*(each(info, scene) for each in at_rest))
    for key, found, declared in pairs:
        number = isinstance(declared, float) and isinstance(found, int | float)
        if not (isclose(found, declared, rel_tol=SAME, abs_tol=SAME) if number else found == declared):
            found, declared = json.dumps(found), json.dumps(declared)
            raise RunFolderError(f"{folder / STATUS}: {key} = {found}, but {declared} by {SCENE}; {_CURE}")


def _wave(info: dict[str, Any], scene: Scene) -> Iterator[Pair]:
    finished = info.get("status") == "finished"
    numbers: dict[str, float] = {"particles": scene.shape.rows if is_one_column(scene) else sphere_count(scene)}
    if scene.wave is None:
        numbers |= {"Delta0_m": scene.scale.length, "t0_s": scene.scale.time}
    else:
        numbers |= {
            "wavenumber_used": scene.wavenumber,
            "direction_used": scene.direction,
            "amplitude": scene.wave.amplitude,
        }
    yield from ((key, info.get(key), value) for key, value in numbers.items() if finished or key in info)


def _strikes(info: dict[str, Any], scene: Scene) -> Iterator[Pair]:
    scale = scene.scale
    units = {"velocity_m_s": scale.velocity, "length_m": scale.length, "t0_s": scale.time, "mass_kg": scale.mass}
    yield from ((key, info[key], value) for key, value in units.items() if key in info)


def _effects(info: dict[str, Any], scene: Scene) -> Iterator[Pair]:
    if "effects" not in info:
        return
    effects, expected = info["effects"], expected_effects(info, scene)
    for name in sorted({*effects, *expected}):
        on, guard = expected.get(name, (_NO_SUCH, ""))
        yield f"effects.{name}.on", effects.get(name, {}).get("on"), on
        yield f"effects.{name}.guard", effects.get(name, {}).get("guard"), guard


def _guards(info: dict[str, Any], scene: Scene) -> Iterator[Pair]:
    if not {"effects", "guards"} <= set(info):
        return
    effects, guards = info["effects"], info["guards"]
    expected = {guard: name for name, (_, guard) in expected_effects(info, scene).items() if guard}
    for guard in sorted({*guards, *expected}):
        name = expected.get(guard, _NO_SUCH)
        yield f"guards.{guard}.effect", guards.get(guard, {}).get("effect"), name
        judges = not effects[name]["on"] and not effects[name]["called_for"]
        yield f"guards.{guard}.judges", guards[guard]["judges"], judges
        if judges and info.get("status") == "finished":
            yield f"guards.{guard}.quiet", guards[guard]["quiet"], True


def refuse_other_extrapolation(path: Path, text: str, info: dict[str, Any]) -> None:
    """Raise RunFolderError if ``trajectory.csv`` is not the extrapolation whose digest ``run.json`` holds.

    Only a run with a tolerance of format 1 has that digest; a later one lists all files (`granular_lmp.runs.seal`).
    """
    if info.get("trajectory_sha256") not in (None, scene_digest(text)):
        raise RunFolderError(f"{path}: was changed since its runs ended; put it back, or run with force=True")


def refuse_other_trajectory(path: Path, read: Signals, dumped: Signals, *, whole: bool) -> None:
    """Raise RunFolderError if the columns of ``trajectory.csv`` do not follow from ``dump.centre``.

    Parameters
    ----------
    path : Path
        Path of ``trajectory.csv``.
    read, dumped : dict of str to (T,) arrays
        Columns tau, p, q, phi of both; in space more.
    whole : bool
        True if both must end with the same record; for a stopped run only the common records are compared.

    Raises
    ------
    RunFolderError
        If a number differs by more than `SAME` of the largest, or with `whole` the lengths differ.
    """
    rows, there = len(read["tau"]), len(dumped["tau"])
    if whole and rows != there:
        raise RunFolderError(f"{path}: {rows} records, and {DUMP} holds {there}; {_CURE}")
    few = min(rows, there)
    signals = [name for name in dumped if name != "tau"]
    size = max((_largest(dumped[name]) for name in signals), default=0.0)
    for name, scale in (("tau", _largest(dumped["tau"])), *((name, size) for name in signals)):
        ours, theirs = read[name][:few], dumped[name][:few]
        off = ~(np.isclose(ours, theirs, rtol=0, atol=SAME * scale, equal_nan=True))
        if off.any():
            first = int(np.argmax(off))
            raise RunFolderError(
                f"{path}: {name} = {ours[first]:.10g} at tau = {read['tau'][first]:.6g}, but {theirs[first]:.10g} by "
                f"{DUMP}; {_CURE}"
            )


def _largest(values: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
