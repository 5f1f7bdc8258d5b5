"""Simulate waves in crystals of spheres with LAMMPS.

A `Scene` declares a simulation, `build` returns its LAMMPS `Deck`, and `run` runs the deck and returns the `Record` of
the centre sphere::

    from granular_lmp import Scene, load, resume, run, sweep
    record = run(Scene.load("tr_nonresonant"), "runs/tr_nonresonant")
    record.p                                   # v/D0 of the centre sphere at the times record.tau
    record = load("runs/tr_nonresonant")       # reads it again; resume() continues a run that was stopped
    table = sweep(record.scene, {"wave.amplitude": [0.1, 0.2]}, "sweeps/amplitude")

A scene without a wave has sources or strikers; `ImpactScene` is an earlier name for `Scene`.

The sub-packages in the direction of the data are `crystal`, `scene`, `effects`, `lammps`, `runs`, `accuracy`, `studies`
and `plot`. Each imports only from those before it. `plot.notebook` draws the notebook card of a scene, a deck, a record
or a sweep; this module registers it in `card`.
"""

from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from granular_lmp.card import PAINTERS
from granular_lmp.version import __version__ as __version__

if TYPE_CHECKING:
    from granular_lmp.accuracy.ladder import build as build
    from granular_lmp.accuracy.tolerance import resume as resume
    from granular_lmp.accuracy.tolerance import run as run
    from granular_lmp.accuracy.tolerance import run_impact as run_impact
    from granular_lmp.lammps.deck import Deck as Deck
    from granular_lmp.plot.notebook import html as html
    from granular_lmp.problem import prepare as prepare
    from granular_lmp.progress import ProgressBar as ProgressBar
    from granular_lmp.rest.scene import Scene as Scene
    from granular_lmp.runs.export import export as export
    from granular_lmp.runs.front import front as front
    from granular_lmp.runs.record import Record as Record
    from granular_lmp.runs.record import load as load
    from granular_lmp.studies.sweep import Sweep as Sweep
    from granular_lmp.studies.sweep import sweep as sweep

    ImpactRecord, ImpactScene = Record, Scene

# Loaded on first use: ASE and LAMMPS would otherwise slow down every `granular-lmp --help`.
_HOMES = {
    "Scene": "rest.scene",
    "Deck": "lammps.deck",
    "build": "accuracy.ladder",
    "run": "accuracy.tolerance",
    "resume": "accuracy.tolerance",
    "load": "runs.record",
    "sweep": "studies.sweep",
    "Sweep": "studies.sweep",
    "ProgressBar": "progress",
    "export": "runs.export",
    "front": "runs.front",
    "Record": "runs.record",
    "html": "plot.notebook",
    "trajectory_figure": "plot.signals",
    "prepare": "problem",
    "run_impact": "accuracy.tolerance",
}
_ALIASES = {"ImpactRecord": "Record", "ImpactScene": "Scene"}  # names of release 0.1
__all__ = [
    *("Deck", "ImpactRecord", "ImpactScene", "ProgressBar", "Record", "Scene", "Sweep"),
    *("build", "export", "front", "html", "load", "prepare", "resume", "run", "run_impact", "sweep"),
]


def __dir__() -> list[str]:
    return [*__all__, "__version__"]  # names for completion, although they are loaded on first use


def __getattr__(name: str) -> Any:
    name = _ALIASES.get(name, name)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def _painted(name: str, *things: Any) -> Any:
    return __getattr__(name)(*things)


PAINTERS.update({name: partial(_painted, name) for name in ("html", "trajectory_figure")})
