"""Random small scenes of every kind that `time.tolerance` takes: what `tests.hard.ladder_study` judges.

Scenes are small and short, so that a reference of 192 steps to a sample takes a tenth of a second.
"""

from collections.abc import Callable, Mapping
from math import pi
from typing import Any

import numpy as np

from granular_lmp import ImpactScene, Scene

Random = np.random.Generator
Changes = dict[str, Any]


def _cell(rng: Random, rows: tuple[int, int] = (4, 13)) -> Changes:
    """A periodic cell that holds a whole number of waves."""
    count = 2 * int(rng.integers(*rows))
    return {"packing.rows": count, "wave.wavenumber": 2 * pi * int(rng.integers(1, count // 2)) / count}


def _strip(rng: Random) -> Changes:
    return {"packing.rows": 2 * int(rng.integers(4, 9)) + 1, "packing.ends": "fixed", "time.allow_echo": True}


def _source(rng: Random, row: int) -> dict[str, Any]:
    signal = str(rng.choice(["tone", "burst", "ricker", "step"]))
    ramp = {"ramp": float(rng.uniform(2, 10))} if signal in ("tone", "step") else {}
    pitch = {"frequency": float(rng.uniform(0.2, 0.62))} if signal != "step" else {}
    cycles = {"cycles": 3.0} if signal == "burst" else {}
    force = str(rng.choice(["x", "y", "torque"]))
    return {"rows": [row, row], "force": force, "signal": signal} | ramp | pitch | cycles


def _sourced(rng: Random) -> Changes:
    strip = _strip(rng)
    return strip | {"wave.form": "none", "source": [_source(rng, int(strip["packing.rows"]) // 2 - 2)]}


def _quiet(rng: Random) -> Changes:
    rows, ends = 2 * int(rng.integers(12, 17)) + 1, {"packing.ends": "fixed", "absorb.rows": int(rng.integers(4, 9))}
    return ends | {
        "packing.rows": rows,
        "absorb.reflection": float(rng.uniform(0.1, 0.5)),
        "wave.form": "none",
        "wave.wavenumber": float(rng.uniform(0.8, 2.2)),
        "source": [{"rows": [rows // 2 - 2] * 2, "force": str(rng.choice(["x", "y"])), "ramp": 6.0}],
    }


# Rows of a cell and waves in it, next to the antiresonance of TR
ANTIRESONANCES: tuple[Changes, ...] = tuple(
    {"wave.mode": "TR", "packing.rows": rows, "wave.wavenumber": 2 * pi * waves / rows, "sphere.poisson_ratio": 0.17}
    for rows, waves in ((62, 21), (56, 19), (44, 15), (18, 6), (24, 8), (38, 13))
)

FAMILIES: dict[str, Callable[[Random], Changes]] = {
    "running": _cell,
    "standing": lambda rng: _cell(rng) | {"wave.form": "standing"},
    "antiresonant": lambda rng: dict(ANTIRESONANCES[int(rng.integers(len(ANTIRESONANCES)))]),
    "oblique": lambda rng: {
        "packing.rows": 8, "packing.columns": 8, "wave.direction": float(rng.uniform(0, 90)),
        "wave.wavenumber": float(rng.uniform(0.5, 2.8)), "time.duration": 12.0,
    },
    "driven": lambda rng: _strip(rng) | {"wave.form": "driven", "envelope.ramp": float(rng.uniform(2, 10))},
    "packet": lambda rng: {
        "packing.rows": "auto", "packing.ends": "fixed", "envelope.length": float(rng.uniform(3, 5)),
        "wave.wavenumber": float(rng.uniform(1.4, 2.8)), "time.duration": 12.0,
    },
    "lattices": lambda rng: _cell(rng) | (
        {"packing.lattice": "square"} if rng.uniform() < 0.5
        else {"packing.lattice": "chain", "packing.columns": 1, "wave.mode": "L"}
    ),
    "jkr": lambda rng: _cell(rng) | {"sphere.adhesion_law": "jkr"},
    "source": _sourced,
    "quiet ends": _quiet,
    "imperfect": lambda rng: {
        "packing.rows": 8, "packing.columns": 8, "wave.wavenumber": 2 * pi * int(rng.integers(1, 4)) / 8,
        "disorder.radius": float(10 ** rng.uniform(-5.5, -4.2)), "disorder.density": float(rng.uniform(0, 0.2)),
        "disorder.seed": int(rng.integers(1, 1000)), "wave.amplitude": float(rng.uniform(0.005, 0.1)),
        "time.duration": 12.0,
    },
    "damped": lambda rng: _cell(rng) | {
        "effects.viscosity": float(10 ** rng.uniform(-9, -6.8)), "effects.damping": True,
    },
    "incremental": lambda rng: _cell(rng) | {"effects.shear_law": "incremental"},
    "rolling": lambda rng: _cell(rng) | {
        "wave.mode": str(rng.choice(["TR", "RT"])), "effects.rolling": True,
        "effects.rolling_stiffness": float(rng.uniform(5, 100)),
        "effects.rolling_viscosity": float(10 ** rng.uniform(-9, -7)),
        "effects.rolling_friction": 1.0,
    },
    "sliding": lambda rng: _cell(rng) | {
        "wave.mode": str(rng.choice(["TR", "RT"])), "effects.friction": float(rng.uniform(0.02, 0.2)),
        "effects.sliding": True, "wave.amplitude": 0.2, "time.duration": 12.0,
    },
    "opening": lambda rng: _cell(rng) | {
        "effects.contact_opening": True, "wave.amplitude": float(rng.uniform(0.7, 2.0)), "time.duration": 10.0,
        "wave.mode": "L",
    },
}  # fmt: skip


def wave_scene(family: str, seed: int) -> Scene:
    """Return a random scene of a family, without a time step of its own."""
    rng = np.random.default_rng([*FAMILIES].index(family) + 1000 * seed)
    common: Changes = {
        "packing.columns": 3,
        "packing.ends": "periodic",
        "sphere.poisson_ratio": float(rng.uniform(-0.3, 0.45)),
        "wave.mode": str(rng.choice(["L", "TR", "RT"])),
        "wave.wavenumber": float(rng.uniform(0.3, 2.9)),
        "wave.amplitude": float(10 ** rng.uniform(-1.5, -0.6)),
        "wave.phase": float(rng.uniform(0, 2 * pi)),
        "time.duration": float(rng.choice([15.0, 30.0, 45.0])),
        "time.sample": float(rng.choice([0.5, 1.0, 1.5])),
    }
    own = FAMILIES[family](rng)
    if own.get("wave.form") in ("driven", "none"):
        common |= {"wave.phase": 0.0, "time.duration": 24.0}
    if own.get("wave.form") == "none":
        common["wave.amplitude"] = float(10 ** rng.uniform(-2, -1))
    return Scene.load("tr_periodic").with_values(common | own)


def _chain(rng: Random, **more: Any) -> Changes:
    return {
        "packing.rows": int(rng.integers(6, 16)), "packing.last": str(rng.choice(["free", "wall", "held"])),
        "time.duration": 20.0, "time.sample": 1.0,
    } | more  # fmt: skip


def _sheet(rng: Random, **more: Any) -> Changes:
    size = int(rng.integers(5, 8))
    return {
        "packing.rows": size, "packing.columns": size, "striker.1.spheres": [[0, size // 2]],
        "time.duration": 6.0, "time.sample": 0.5,
    } | more  # fmt: skip


def _mixed(rng: Random) -> Changes:
    return {"disorder.density": float(rng.uniform(0, 0.3)), "disorder.seed": int(rng.integers(1, 1000))}


def _loose(rng: Random) -> Changes:
    return _chain(rng) | _mixed(rng) | {"disorder.radius": float(rng.uniform(0, 0.05))}


def _pressed(rng: Random) -> Changes:
    return _chain(rng) | {"packing.contact_force": float(10 ** rng.uniform(0, 2.3))}


def _damped(rng: Random) -> Changes:
    return _chain(rng) | _mixed(rng) | {"effects.restitution": float(rng.uniform(0.4, 0.95))}


def _rough(rng: Random) -> Changes:
    friction, law = float(rng.uniform(0.05, 0.5)), str(rng.choice(["secant", "incremental"]))
    return _sheet(rng) | _mixed(rng) | {"effects.friction": friction, "effects.shear_law": law}


# Scene that each family departs from, and what it changes
IMPACTS: Mapping[str, tuple[str, Callable[[Random], Changes]]] = {
    "chain": ("solitary_chain", _loose),
    "pressed chain": ("compressed_chain", _pressed),
    "damped chain": ("solitary_chain", _damped),
    "sheet": ("point_impact", lambda rng: _sheet(rng) | _mixed(rng)),
    "rough sheet": ("point_impact", _rough),
}


def impact_scene(family: str, seed: int) -> ImpactScene:
    """Return a random impact of a family."""
    name, own = IMPACTS[family]
    rng = np.random.default_rng([*IMPACTS].index(family) + 1000 * seed + 77)
    return ImpactScene.load(name).with_values(own(rng))
