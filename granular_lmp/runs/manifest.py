"""The contents of ``run.json``: the description of a run before its start, and its outcome."""

import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp import __version__
from granular_lmp.crystal.lattices import HEXAGONAL, centre
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.guard_results import measured
from granular_lmp.lammps.guards import ELSEWHERE, GUARDS, fastest, look_interval
from granular_lmp.lammps.outputs import LOG, LOOP_SECTIONS
from granular_lmp.problem import Problem
from granular_lmp.runs.agreement import Signals, scene_digest
from granular_lmp.runs.formats import FORMAT
from granular_lmp.runs.record import Record
from granular_lmp.scene.at_rest import CrystalAtRest


def description(deck: Deck, edits: list[str], launcher: str, ranks: int) -> dict[str, Any]:
    """Return the entries of ``run.json`` that are known before the run; `edits` are those of the deck."""
    problem, scene, sphere, time_ = deck.problem, deck.scene, deck.scene.sphere, deck.scene.time
    return {
        "format": FORMAT,
        "name": scene.name,
        "scene_sha256": scene_digest(scene.to_toml()),
        "versions": {"granular_lmp": __version__, "python": platform.python_version(), "numpy": np.__version__},
        "launcher": launcher,
        "ranks": ranks,
        "particles": len(deck.packing),
        "steps": time_.steps,
        "timestep_used": time_.step,
        "wavenumber_used": scene.wavenumber,
        "direction_used": scene.direction,
        "frequency": problem.mode.frequency,
        "amplitude": scene.wave.amplitude,
        **crystal_at_rest(problem.at_rest),
        **({"epsilon": sphere.nonlinearity(scene.wave.amplitude)} if scene.lattice == HEXAGONAL else {}),
        "Delta0_m": scene.scale.length,
        "t0_s": scene.scale.time,
        "overlap_ratio": sphere.overlap_ratio,
        "looks": {"every_tau": look_interval(problem) * time_.step, "fastest": fastest(scene)},
        "effects": effects_of(problem),
        "remarks": problem.warnings(),
        **({"edited": edits} if edits else {}),
    }


def crystal_at_rest(crystal: CrystalAtRest) -> dict[str, Any]:
    """Return the way of a crystal that is not perfect to rest, and what it led to; nothing for a perfect lattice."""
    rest = crystal.equilibrium
    if rest is None:
        return {}
    overlaps = crystal.contacts.overlap / crystal.materials[0].static_overlap
    found = rest.summary() | {"smallest_overlap": float(overlaps.min()), "largest_overlap": float(overlaps.max())}
    return {"crystal": found, "centre": centre(crystal.atoms) + 1}


def effects_of(problem: Problem) -> dict[str, dict[str, Any]]:
    """Return for each effect whether it is on and called for, the number and the reason, and its guard."""
    return {
        effect.name: {
            "on": effect.on,
            "called_for": effect.called_for,
            "number": _finite(effect.number),
            "reason": effect.reason,
            "guard": effect.guard,
        }
        for effect in problem.effects
    }


def wall_seconds(before: Mapping[str, Any], phases: Mapping[str, float]) -> dict[str, Any]:
    """Return ``wall_seconds`` of ``run.json`` from the phases of a run, or of a part that continues one in `before`."""
    earlier = before.get("phases", {})
    both = {name: earlier.get(name, 0.0) + phases.get(name, 0.0) for name in [*earlier, *phases]}
    total = before.get("total", 0.0) + sum(phases.values())
    loop = sum(both[name] for name in LOOP_SECTIONS) if set(LOOP_SECTIONS) <= set(both) else None
    return {"total": total, "loop": loop, "other": None if loop is None else total - loop, "phases": both}


def outcome(problem: Problem, folder: Path, record: Record, table: Signals, before: dict[str, Any]) -> dict[str, Any]:
    """Return the entries of ``run.json`` after the run from its record and its thermo table."""
    return {
        "samples": len(record.tau),
        "smallest_overlap": _finite(np.min(table.get("v_overlap", np.empty(0)), initial=np.inf)),  # Δ0, while touching
        # Extremes over all spheres, also those that cannot affect the record
        "elsewhere": {
            name.removeprefix("v_"): _finite((np.nanmin if "overlap" in name else np.nanmax)(table[name]))
            for name in ELSEWHERE
            if len(table.get(name, ()))
        },
        "guards": {
            effect["guard"]: _outcome_of(effect["guard"], name, effect, table, problem, folder)
            for name, effect in before["effects"].items()
            if effect["guard"]
        },
        "versions": before["versions"] | {"lammps": _lammps_version(folder)},
    }


def _outcome_of(
    guard: str,
    name: str,
    effect: dict[str, Any],
    table: dict[str, NDArray[np.float64]],
    problem: Problem,
    folder: Path,
) -> dict[str, Any]:
    """Return the result of one guard.

    It judges only an effect that is off and that the scene does not call for. While the effect is on, a value above the
    limit is expected and the guard counts as quiet.
    """
    found = measured(guard, table, problem, folder)
    return {
        "effect": name,
        "value": _finite(found.value),
        "bound": _finite(found.bound),
        "limit": GUARDS[guard].limit_in(problem.scene),
        "quiet": found.passed_at is None or effect["on"],
        "passed_at": found.passed_at,
        "judges": not effect["on"] and not effect["called_for"],
        "meaning": GUARDS[guard].meaning,
        "cure": GUARDS[guard].cure,
    }


def triggered(info: dict[str, Any]) -> list[str]:
    """Return a sentence for each guard that triggered although the scene does not call for its effect."""
    return [
        f"{guard['effect']} triggered its guard at tau = {guard['passed_at']:.6g}: {name} = {_shown(guard['value'])}, "
        f"above {guard['limit']:.3g}: {guard['meaning']}; {guard['cure']}"
        for name, guard in info["guards"].items()
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
