"""What ``run.json`` says of a run: what is known before it, and what came out."""

import platform
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp import __version__
from granular_lmp.accuracy.budget import as_json, error_budget
from granular_lmp.effects.guards import GUARDS
from granular_lmp.effects.table import warnings
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.outputs import LOG, read_log
from granular_lmp.runs.record import Record, scene_digest
from granular_lmp.scene.scene import Scene


def description(deck: Deck, launcher: str, ranks: int) -> dict[str, Any]:
    """What is known before the run."""
    scene, sphere, time_ = deck.scene, deck.scene.sphere, deck.scene.time
    phase_lag = (deck.mode.frequency * time_.step) ** 2 / 24 * deck.mode.frequency * time_.duration
    return {
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
        "frequency": deck.mode.frequency,
        "amplitude": scene.wave.amplitude,
        "epsilon": sphere.nonlinearity(scene.wave.amplitude),
        "Delta0_m": sphere.static_overlap,
        "t0_s": sphere.time_scale,
        "overlap_ratio": sphere.overlap_ratio,
        "effects": {
            effect.name: {
                "on": effect.on,
                "called_for": effect.called_for,
                "number": _finite(effect.number),
                "reason": effect.reason,
                "guard": effect.guard,
            }
            for effect in deck.effects
        },
        # Velocity Verlet runs a mode (Ω Δτ)²/24 too fast; the lag at the end over √3 is its L2 error over the run
        "timestep_error_of_fundamental": phase_lag / 3**0.5,
        "error_budget": as_json(error_budget(scene)),
        "remarks": [*deck.declared.remarks(), *warnings(deck.effects)],
    }


def outcome(folder: Path, record: Record, seconds: float, before: dict[str, Any]) -> dict[str, Any]:
    """What is known after the run, or after a part of it that adds to what `before` says."""
    table, loop = read_log(folder / LOG) if (folder / LOG).exists() else ({}, float("nan"))
    total = seconds + before.get("wall_seconds", {}).get("total", 0.0)
    return {
        "samples": len(record.tau),
        "wall_seconds": {"total": total, "loop": _finite(loop), "other": _finite(total - loop)},
        "smallest_overlap": _finite(np.min(table.get("v_overlap", np.empty(0)), initial=np.inf)),  # Δ0, while touching
        "guards": {
            effect["guard"]: _heard(effect["guard"], name, effect, table, record.scene)
            for name, effect in before["effects"].items()
            if effect["guard"]
        },
        "versions": before["versions"] | {"lammps": _lammps_version(folder)},
    }


def _heard(
    guard: str, name: str, effect: dict[str, Any], table: dict[str, NDArray[np.float64]], scene: Scene
) -> dict[str, Any]:
    """What one guard measured; it judges only an effect that is off and that the scene does not call for.

    Of an effect that is on it is no news, whatever it says.
    """
    measured = np.abs(table.get(GUARDS[guard].columns[0], np.empty(0)))
    loud = GUARDS[guard].woken(table, scene)
    return {
        "effect": name,
        "value": _finite(np.max(measured, initial=0.0)),
        "limit": GUARDS[guard].largest_silent(scene),
        "quiet": loud is None or effect["on"],
        "woke_at": None if loud is None else float(table["Step"][loud] * scene.time.step),
        "woke_with": None if loud is None else _finite(measured[loud]),
        "judges": not effect["on"] and not effect["called_for"],
        "meaning": GUARDS[guard].meaning,
    }


def woken(info: dict[str, Any]) -> list[str]:
    """A sentence for each effect that was left out, rightly by the rules, and was there after all."""
    return [
        f"{guard['effect']} woke at tau = {guard['woke_at']:.6g}: {name} = {_said(guard['woke_with'])} there and "
        f"{_said(guard['value'])} at most, above {guard['limit']:.3g}: {guard['meaning']}"
        for name, guard in info["guards"].items()
        if guard["judges"] and not guard["quiet"]
    ]


def _said(value: float | None) -> str:
    return "not finite" if value is None else f"{value:.4g}"


def _finite(value: float) -> float | None:
    """JSON has no inf and no nan."""
    return float(value) if np.isfinite(value) else None


def _lammps_version(folder: Path) -> str | None:
    try:
        with (folder / LOG).open(encoding="utf-8", errors="replace") as stream:
            return stream.readline().strip().removeprefix("LAMMPS (").removesuffix(")") or None
    except OSError:
        return None
