"""Contents of ``run.json``: the description of a run before its start, and its outcome."""

import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import HEXAGONAL
from granular_lmp.lammps.guard_results import measured, seen_every
from granular_lmp.lammps.guards import GUARDS, line_interval
from granular_lmp.lammps.outputs import LOG, LOOP_SECTIONS, RunLog
from granular_lmp.problem import Problem
from granular_lmp.rest.absorption import quiet_end_of, quiet_side
from granular_lmp.runs.formats import FORMAT
from granular_lmp.runs.seal import scene_digest
from granular_lmp.version import __version__


def description(problem: Problem, edits: list[str], launcher: str, ranks: int) -> dict[str, Any]:
    """Return the entries of ``run.json`` that are known before the run; `edits` are the edits of the deck."""
    scene, time_ = problem.scene, problem.scene.time
    return {
        "format": FORMAT,
        "name": scene.name,
        "scene_sha256": scene_digest(scene.to_toml()),
        "versions": {"granular_lmp": __version__, "python": platform.python_version(), "numpy": np.__version__},
        "launcher": launcher,
        "ranks": ranks,
        "particles": len(problem.rest.atoms),
        "steps": time_.steps,
        "timestep_used": time_.step,
        **_of_start(problem),
        "effects": effects_of(problem),
        "remarks": problem.warnings(),
        **_quiet_ends(problem),
        **({} if problem.looks else {"looks": {}}),
        **({"edited": edits} if edits else {}),
    }


def _quiet_ends(problem: Problem) -> dict[str, Any]:
    """Return the absorbing layer and its ends: row n of its L rows damps by c (n/L)^p."""
    scene = problem.scene
    end = quiet_end_of(scene)
    if end is None:
        return {}
    ends = {"abs(y)": ["first", "last"], "y": ["last"], "-y": ["first"]}[quiet_side(scene)]
    return {"quiet_ends": {"rows": end.rows, "strength": end.strength, "power": end.power, "ends": ends}}


def _of_start(problem: Problem) -> dict[str, Any]:
    """Return the entries on the start of a run and its crystal."""
    if problem.wave is None:
        return {"recorded": len(problem.rest.recorded), **problem.rest.entries}
    return _of_wave(problem)


def _of_wave(problem: Problem) -> dict[str, Any]:
    """Return the wave, the crystal at rest and its units."""
    scene = problem.scene
    epsilon = {"epsilon": scene.sphere.nonlinearity(scene.amplitude)} if scene.lattice == HEXAGONAL else {}
    return {
        "wavenumber_used": scene.wavenumber,
        "direction_used": scene.direction,
        "frequency": problem.rest.frequency,
        "amplitude": scene.amplitude,
        **problem.rest.entries,
        **epsilon,
    }


Signals = dict[str, NDArray[np.float64]]
NEAR = "a contact kept {:.2g} of the static overlap, and may have opened between two looks"


def effects_of(problem: Problem) -> dict[str, dict[str, Any]]:
    """Return for each effect whether it is on and needed, the number and the reason, and its guard."""
    return {
        effect.name: {
            "on": effect.on,
            "called_for": effect.called_for,
            "number": _finite(effect.number),
            "reason": effect.finding,
            "guard": effect.guard,
        }
        for effect in problem.effects
    }


def wall_seconds(before: Mapping[str, Any], phases: Mapping[str, float]) -> dict[str, Any]:
    """Return ``wall_seconds`` of ``run.json`` from the phases of a run, added to those in `before`."""
    earlier = before.get("phases", {})
    both = {name: earlier.get(name, 0.0) + phases.get(name, 0.0) for name in [*earlier, *phases]}
    total = before.get("total", 0.0) + sum(phases.values())
    loop = sum(both[name] for name in LOOP_SECTIONS) if set(LOOP_SECTIONS) <= set(both) else None
    return {"total": total, "loop": loop, "other": None if loop is None else total - loop, "phases": both}


def outcome(folder: Path, problem: Problem, samples: int, table: Signals, before: dict[str, Any]) -> dict[str, Any]:
    """Return the entries of ``run.json`` after the run, from the number of records and the thermo table."""
    return {
        "samples": samples,
        **(_extremes(table) if _has_extremes(problem) else {}),
        "guards": {
            effect["guard"]: _outcome_of(name, effect, table, problem, folder)
            for name, effect in before["effects"].items()
            if effect["guard"]
        },
        "versions": before["versions"] | {"lammps": _lammps_version(folder)},
    }


def _has_extremes(problem: Problem) -> bool:
    """Return whether the table has the smallest overlap in addition to the guards."""
    return problem.looks and "v_overlap" not in (GUARDS[name].column for name in problem.guards)


def _extremes(table: Signals) -> dict[str, Any]:
    """Return the smallest overlap; guards report the largest."""
    smallest = np.min(table.get("v_overlap", np.empty(0)), initial=np.inf)  # Δ0, while touching
    return {"smallest_overlap": _finite(smallest)}


def _outcome_of(
    name: str, effect: dict[str, Any], table: dict[str, NDArray[np.float64]], problem: Problem, folder: Path
) -> dict[str, Any]:
    """Return the result of the guard of one effect.

    It judges only an effect that is off and that the scene does not need. If the effect is on, a value above the limit
    is expected, and the guard counts as quiet.
    """
    guard = GUARDS[effect["guard"]]
    found = measured(guard, table, problem, folder)
    return {
        "effect": name,
        "value": _finite(found.value),
        "bound": _finite(found.bound),
        "limit": guard.limit_in(problem, seen_every(table)),
        "quiet": found.passed_at is None or effect["on"],
        "passed_at": found.passed_at,
        "judges": not effect["on"] and not effect["called_for"],
        "meaning": guard.meaning if found.near is None else NEAR.format(found.near),
        "cure": guard.cure,
    }


def lacking(problem: Problem, log: RunLog, info: Mapping[str, Any]) -> str:
    """Return words for what the log of a finished run lacks; "" if it is complete.

    The deck of an adopted run may have looks at other steps, which its log shows.
    """
    table, last = log.table, problem.scene.time.steps
    every = log.every if "adopted" in info else line_interval(problem)
    missed = sorted({*range(0, last, every), last} - {*map(int, table.get("Step", ()))})
    if absent := [name for name in info["guards"] if GUARDS[name].column not in table]:
        return f"the log lacks the guard {absent[0]}"
    return f"the log lacks step {missed[0]}" if missed else ""


def triggered(info: dict[str, Any]) -> list[str]:
    """Return a sentence for each guard that triggered although the scene does not need its effect."""
    return [
        f"{guard['effect']} triggered its guard at tau = {guard['passed_at']:.6g}: {name} = {_shown(guard['value'])}, "
        f"above {guard['limit']:.3g}: {guard['meaning']}; {guard['cure']}"
        for name, guard in info.get("guards", {}).items()
        if guard["judges"] and not guard["quiet"]
    ]


def _shown(value: float | None) -> str:
    return "not finite" if value is None else f"{value:.4g}"


def _finite(value: float) -> float | None:
    """Return the value, or None for inf and nan, which JSON does not have."""
    return float(value) if np.isfinite(value) else None


def _lammps_version(folder: Path) -> str | None:
    try:
        with (folder / LOG).open(encoding="utf-8", errors="replace") as stream:
            return stream.readline().strip().removeprefix("LAMMPS (").removesuffix(")") or None
    except OSError:
        return None
