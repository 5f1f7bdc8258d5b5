"""Parts that stand in one scene, every sphere of it in LAMMPS beside the network, the time step extrapolated away.

A fields' error of second order in the step is extrapolated from two steps. What is left is of fourth order, 1e-7 of the
field at steps of 0.05 and 0.025 where contacts stick, stay closed and have no dashpots.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.snapshot import FirstSnapshot, first_snapshot
from granular_analysis.theory.network_motion import integrate
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
from tests.conftest import PAPER, members

LENGTH, UNIT = PAPER.scale.length, PAPER.scale.velocity
BASE = PAPER.with_values(
    {"packing.rows": 24, "packing.columns": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 3}
    | {"wave.amplitude": 0.02, "time.allow_echo": True, "name": "mixed"}
    | {"time.duration": 12.0, "time.sample": 1.0, "output.particles": 1.0}
)
REST = {"wave.form": "none"}
PULSE = {"rows": [4, 4], "force": "x", "signal": "burst", "cycles": 2.0, "frequency": 0.8, "amplitude": 0.3}
QUIET = REST | {"packing.ends": "fixed", "packing.rows": 25, "wave.mode": "L", "wave.wavenumber": 1.5}
QUIET |= {
    "absorb.rows": 8,
    "absorb.reflection": 0.45,
    "time.duration": 90.0,
    "time.sample": 5.0,
    "output.particles": 5.0,
}
INWARD = PULSE | {"rows": [12, 12], "force": "y", "cycles": 4.0, "frequency": 0.5}  # the top of the band is 0.71
SPREAD = {"disorder.radius": 5e-5, "disorder.density": 0.1, "disorder.vacancies": 0.03}
BURST = {"signal": "burst", "cycles": 4.0, "frequency": 0.9}
MIXTURES: dict[str, dict[str, Any]] = {
    "a striker on a disordered adhesive sheet": REST
    | SPREAD
    | {"striker": [{"spheres": [[12, 4]], "velocity": 0.02 * UNIT, "direction": 30.0}]}
    | {"monitor": [{"name": "line", "rows": [15, 15]}]},
    "a wave and a striker": {"striker": [{"rows": [5, 5], "velocity": 0.01 * UNIT}]},
    "a pulse from a source on a packet": {"wave.wavenumber": 1.9, "envelope.length": 3.0, "source": [PULSE]},
    "quiet ends of a square sheet": QUIET | {"packing.lattice": "square", "packing.columns": 4, "source": [INWARD]},
    "quiet ends of a chain": QUIET | {"packing.lattice": "chain", "packing.columns": 1, "source": [INWARD]},
    "a JKR crystal with a spread of radii": {"sphere.adhesion_law": "jkr", "disorder.radius": 3e-5},
    "a compressed chain": {"packing.lattice": "chain", "packing.columns": 1, "wave.mode": "L"}
    | {"sphere.work_of_adhesion": 0.0, "packing.contact_force": 1e-7},
    "a source at the corner of a finite sheet": REST
    | {"packing.ends": "fixed", "packing.rows": 9, "packing.columns": 7}
    | {"packing.first": "free", "packing.last": "free", "packing.sides": "free"}
    | {"source": [BURST | {"spheres": [[0, 0]], "force": "x"}]},
    "a torque, a motion and a rotation": REST
    | {
        "source": [
            {"spheres": [[6, 2]], "force": "torque"} | BURST,
            {"spheres": [[12, 5]], "motion": "x", "amplitude": 0.4, "signal": "ricker", "frequency": 0.9},
            {"spheres": [[18, 1]], "motion": "rotation", "frequency": 0.7, "ramp": 5.0, "delay": 2.0},
            {"spheres": [[3, 6]], "force": "y", "signal": "step", "ramp": 6.0},
            {"spheres": [[20, 6]], "force": "y", "signal": "chirp", "frequency": 0.6, "sweep": 2.0},
        ]
    },
    "samples in a disordered crystal": REST
    | SPREAD
    | {"source": [{"spheres": [[12, 4]], "force": "y", "delay": 1.0}]}
    | {"source.1.signal": [[n / 4, float(np.exp(-((n / 4 - 4) ** 2)) - np.exp(-16)) if n else 0.0] for n in range(81)]},
}
LEFT = 2e-6  # of the largest displacement: fourth order in the step, measured below 5e-7, and the rounding of places


def fields(record: Record) -> np.ndarray:
    """Return displacement x, y and Rθ of all spheres, (T, N, 3), in D0."""
    displacement, rotation = record.snapshots().stacks("displacement", "rotation")
    return np.concatenate([displacement, rotation[:, :, None]], axis=2)


def moved(first: FirstSnapshot, tau: np.ndarray, rtol: float = 1e-9) -> np.ndarray:
    """Return the fields of a network at times."""
    motion = integrate(first.network, first.state, tau * first.time, rtol=rtol).motion[:, :3]
    return np.moveaxis(motion, 1, 2) * np.array([1.0, 1.0, first.radius]) / first.length


# Quiet ends and a disordered sheet stand in test_strikes_at_rest, unequal spheres by JKR in test_unequal_jkr_in_lammps,
# and a striker beside a packet in test_mixtures
MORE_MIXTURES = "quiet ends of a square sheet", "a JKR crystal with a spread of radii", "quiet ends of a chain"
MORE_MIXTURES += "a wave and a striker", "a striker on a disordered adhesive sheet"


@pytest.mark.parametrize("name", members(MIXTURES, *MORE_MIXTURES))
def test_every_sphere_of_a_mixture_moves_as_in_the_network(name: str, tmp_path: Path) -> None:
    scene = BASE.with_values(MIXTURES[name])
    coarse, fine = (run(scene.with_values({"time.timestep": h}), tmp_path / str(h)) for h in (0.05, 0.025))
    first = first_snapshot(fine)
    expected = moved(first, fine.snapshots().tau)
    found = (4 * fields(fine) - fields(coarse)) / 3
    size = np.abs(expected).max()
    assert np.abs(found - expected).max() < LEFT * size

    def off(**changes: Any) -> float:
        """Return the distance from another network, whose own error is far below what it is compared with."""
        other = replace(first, network=replace(first.network, **changes))
        return float(np.abs(found - moved(other, fine.snapshots().tau, rtol=1e-6)).max() / size)

    # A part that is left out, or one that is heavier by a hundredth, is seen
    assert off(density=1.01 * first.network.density) > 100 * LEFT
    fewer = first.network.drives[:-1]
    if first.network.drives and (fewer or first.state.motion.any()):
        assert off(drives=fewer) > 1e-2
    if first.network.drag is not None:
        assert off(drag=None) > 1e-2


# --- without a wave ---

SHEET = Scene.load("point_impact").with_values(
    {"packing.rows": 7, "packing.columns": 7, "striker.1.spheres": [[0, 3]], "time.duration": 5.0, "time.sample": 0.5}
)
CHAIN = Scene.load("compressed_chain").with_values({"packing.rows": 24, "time.duration": 30.0, "time.sample": 0.5})
WALLS = {"packing.last": "wall", "packing.sides": "wall"}
# Of the largest displacement and velocity. Where contacts open and close, an error of h^{5/2} is left
# (case "impact"); with friction or dashpots the error is of first order in the step, and two thirds of what steps of
# 0.01 and 0.005 differ by are left of it
STRIKES: dict[str, tuple[Scene, dict[str, Any], float]] = {
    "a compressed chain with a wall": (CHAIN, {}, 1e-5),
    "a compressed chain between held spheres": (CHAIN, {"packing.last": "held"}, 1e-5),
    "a sheet between walls": (SHEET, WALLS, 1e-5),
    "a sheet between walls with friction": (SHEET, WALLS | {"effects.friction": 0.3}, 1e-3),
    "the same by the secant law": (SHEET, WALLS | {"effects.friction": 0.3, "effects.shear_law": "secant"}, 1e-4),
    "a restitution in a sheet with a vacancy": (
        SHEET,
        {"effects.restitution": 0.8, "inclusion": [{"spheres": [[4, 3]], "vacancy": True}]},
        1e-3,
    ),
    "gaps and two materials": (
        SHEET,
        {"disorder.radius": 1e-4, "inclusion": [{"rows": [5, 6], "density": 2700.0, "youngs_modulus": 7e10}]},
        1e-5,
    ),
    "a state that moves and turns beside a striker, with friction": (
        SHEET,
        {"effects.friction": 0.3, "effects.shear_law": "secant", "start.state": [[4, 3, 0.0, 0.0, 0.1, 0.2, 40.0]]},
        1e-3,
    ),
    "a displaced state with friction": (
        SHEET,
        {"effects.friction": 0.3, "effects.shear_law": "secant", "start.state": [[4, 3, 1e-6, 2e-6, 0.1, 0.2, 0.0]]},
        1e-3,
    ),
    "a displaced state": (SHEET, {"start.state": [[4, 3, 1e-6, 2e-6, 0.1, 0.2, 0.0]]}, 1e-5),
    "two spheres collide": (CHAIN, {"packing.rows": 2, "packing.last": "free", "packing.contact_force": 0.0}, 1e-4),
}


# Each part of these stands in another strike, or in a mixture; restitution in tests/matrix/test_compared.py
MORE_STRIKES = ("a compressed chain with a wall", "a restitution in a sheet with a vacancy")
MORE_STRIKES += ("a compressed chain between held spheres", "the same by the secant law")
MORE_STRIKES += "a displaced state with friction", "two spheres collide", "a sheet between walls with friction"


@pytest.mark.parametrize("name", members(STRIKES, *MORE_STRIKES))
def test_every_sphere_of_a_strike_moves_as_in_the_network(name: str, tmp_path: Path) -> None:
    base, changes, bound = STRIKES[name]
    scene = base.with_values(changes)
    coarse, fine = (run(scene.with_values({"time.timestep": h}), tmp_path / str(h)) for h in (0.01, 0.005))
    first = first_snapshot(fine)
    slides = np.isfinite(first.network.friction)
    longest, rtol = first.time / 80 if slides else np.inf, 1e-8  # the former leaves 3e-6, of second order
    motion = integrate(first.network, first.state, fine.tau * first.time, rtol=rtol, longest_step=longest)
    for key, expected in zip(("displacement", "velocity", "spin"), first.fields(motion), strict=True):
        found = (4 * getattr(fine, key) - getattr(coarse, key)) / 3
        assert np.abs(found - expected).max() <= bound * max(np.abs(expected).max(), 1e-3), key
    heavier = replace(first.network, density=1.01 * first.network.density)
    other = integrate(heavier, first.state, fine.tau * first.time, rtol=1e-6, longest_step=4 * longest)
    assert np.abs(first.fields(other)[1] - fine.velocity).max() > 2 * bound


def test_two_spheres_collide_and_a_monitor_sees_the_contact_of_the_network(tmp_path: Path) -> None:
    state = [[0, 0, 0.0, 0.0, 0.3, 1.0, 40.0], [1, 0, 0.0, 0.0, 0.0, -1.0, 0.0]]
    tables = {
        "packing": {"lattice": "square", "rows": 2, "columns": 1},
        "effects": {"friction": 0.3, "shear_law": "secant"},
        "start": {"state": state},
        "monitor": [{"name": "contact", "rows": [0, 1], "what": "contacts"}],
        "time": {"duration": 4.0, "sample": 0.1, "timestep": 0.005},
    }
    sphere = {name: getattr(SHEET.sphere, name) for name in ("radius", "youngs_modulus", "poisson_ratio", "density")}
    record = run(Scene.from_dict({"name": "two_spheres", "sphere": sphere, **tables}), tmp_path / "run")
    judged = compare.compare(record)
    assert judged.theory == "network"
    # The step's error: 1e-4 at twice the step (the case "impact")
    assert all(value is not None and value < 1e-4 for value in judged.error.values()), judged.error
    first = first_snapshot(record)
    motion = integrate(first.network, first.state, record.tau * first.time, longest_step=first.time / 20).motion
    apart = first.network.position[1] + motion[:, :2, 1] - first.network.position[0] - motion[:, :2, 0]
    overlap = (first.network.radius.sum() - np.linalg.norm(apart, axis=1)) / first.length
    seen = record.monitor("contact").contacts.overlap[:, 0]
    touching = ~np.isnan(seen)
    assert 10 < touching.sum() < len(seen)
    # The first and the last moments of a contact are within a step of its beginning and end
    np.testing.assert_allclose(seen[touching], overlap[touching], rtol=0, atol=1e-3)
    assert overlap[~touching].max() < 1e-2
