"""What ``run.json`` says of a run: what is known before it, and what came out."""

import platform
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp import __version__
from granular_lmp.budget import as_json, error_budget
from granular_lmp.deck import LOG, Deck
from granular_lmp.record import Record, read_log


def description(deck: Deck, launcher: str, ranks: int) -> dict[str, Any]:
    """What is known before the run."""
    scene, sphere, time_ = deck.scene, deck.scene.sphere, deck.scene.time
    phase_lag = (deck.mode.frequency * time_.step) ** 2 / 24 * deck.mode.frequency * time_.duration
    return {
        "name": scene.name,
        "versions": {"granular_lmp": __version__, "python": platform.python_version(), "numpy": np.__version__},
        "launcher": launcher,
        "ranks": ranks,
        "particles": len(deck.packing),
        "steps": time_.steps,
        "timestep_used": time_.step,
        "wavenumber_used": scene.wavenumber,
        "frequency": deck.mode.frequency,
        "amplitude": scene.wave.amplitude,
        "epsilon": sphere.nonlinearity(scene.wave.amplitude),
        "Delta0_m": sphere.static_overlap,
        "t0_s": sphere.time_scale,
        "overlap_ratio": sphere.overlap_ratio,
        "effects": {e.name: {"on": e.on, "number": _finite(e.number), "reason": e.reason} for e in deck.effects},
        # Velocity Verlet runs a mode (Ω Δτ)²/24 too fast; the lag at the end over √3 is its L2 error over the run
        "timestep_error_of_fundamental": phase_lag / 3**0.5,
        "error_budget": as_json(error_budget(scene)),
        "remarks": scene.remarks(),
    }


def outcome(folder: Path, record: Record, seconds: float, before: dict[str, Any]) -> dict[str, Any]:
    """What is known after the run, or after a part of it that adds to what `before` says.

    A guard that is not quiet says that the run left what the scene, or the theory, assumes.
    """
    table, loop = read_log(folder / LOG) if (folder / LOG).exists() else ({}, float("nan"))
    overlap, opened, slip = (table.get(name, np.empty(0)) for name in ("v_overlap", "v_open", "v_slip"))
    total = seconds + before.get("wall_seconds", {}).get("total", 0.0)
    return {
        "samples": len(record.tau),
        "wall_seconds": {"total": total, "loop": _finite(loop), "other": _finite(total - loop)},
        "smallest_overlap": _finite(np.min(overlap, initial=np.inf)),  # in Δ0, of the contacts that touch
        "guards": {
            "open_contacts": {
                "value": _finite(np.max(opened, initial=0.0)),
                "quiet": bool((opened == 0).all()),
                "meaning": "contacts opened: no closed form holds, and shear forces are lost",
            },
            "largest_slip": {
                "value": _finite(np.max(slip, initial=0.0)),
                "quiet": bool((slip < 1).all()),
                "meaning": "of the sliding force: contacts may have slid, which the paper's model does not",
            },
        },
        "versions": before["versions"] | {"lammps": _lammps_version(folder)},
    }


def _finite(value: float) -> float | None:
    """JSON has no inf and no nan."""
    return float(value) if np.isfinite(value) else None


def _lammps_version(folder: Path) -> str | None:
    try:
        with (folder / LOG).open(encoding="utf-8", errors="replace") as stream:
            return stream.readline().strip().removeprefix("LAMMPS (").removesuffix(")") or None
    except OSError:
        return None
