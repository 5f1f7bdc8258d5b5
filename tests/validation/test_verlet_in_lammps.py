"""LAMMPS's own scheme in the network: the motion of every sphere of a run of LAMMPS, to rounding.

LAMMPS keeps positions, so that each step rounds a displacement to the last digit of the largest place, and a record
errs as such roundings add up at random. The network keeps displacements.
"""

from dataclasses import replace
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.network_verlet import march
from granular_lmp import Record, Scene, run
from granular_lmp.studies.collide import scene_of
from tests.conftest import members
from tests.hard.ladder_scenes import FAMILIES, IMPACTS, impact_scene, wave_scene
from tests.validation.test_pull_off import SNAP, sticking_speed

INPUTS = Path(__file__).parents[2] / "lammps_inputs"
SHIPPED = sorted(path.parent.name for path in INPUTS.glob("**/scene.toml"))
HELD = [family for family in FAMILIES if family != "rolling"]  # the network has no rolling
ROUNDINGS = 4.0  # the largest error of 76 runs is 1.5 √steps roundings
LONGEST = 24.0  # τ


def difference(scene: Scene, folder: Path, heavier: float = 0.0) -> tuple[float, float]:
    """Return the largest error of displacements, velocities and R × spin of all spheres, in D0 and t0, and its bound.

    Spheres are `heavier` by a share.
    """
    changes: dict[str, Any] = {"time.duration": min(LONGEST, scene.time.duration)}
    changes |= {"time.timestep": 0.05} if scene.time.tolerance is not None else {}
    changes |= {"output.particles": scene.time.sample} if scene.wave else {}
    scene = scene.with_values(changes)
    record = run(scene if scene.wave else scene.replace(output=None), folder / "run")
    first, time, snapshots = first_snapshot(record), record.scene.time, record.snapshots()
    network, every = first.network, ceil(time.sample / time.timestep - 1e-9)
    count = (len(snapshots) - 1) * every
    network = replace(network, density=network.density * (1 + heavier))
    motions = np.array([*march(network, first.state, time.sample / every * first.time, count, every)])
    free = network.mobility[0] > 0  # the velocity of a sphere that is moved is the slope of its signal
    place, _, velocity, spin = (
        np.moveaxis(part, 1, 2) / first.length
        for half in np.split(motions, 2, axis=1)
        for part in np.split(half, [network.dimension], axis=1)
    )
    expected = snapshots.stacks("displacement", "velocity", "spin")
    errors = (
        place - expected[0],
        (velocity * first.time - expected[1])[:, free],
        (spin * first.radius * first.time - expected[2].reshape(spin.shape))[:, free],
    )
    rounding = np.spacing(np.abs(network.position).max()) / first.length
    size = max(1.0, np.abs(expected[0]).max())
    return max(np.abs(each).max() for each in errors), 1e-9 * size + ROUNDINGS * sqrt(count) * rounding


# Waves with contacts that open or slide, dashpots or quiet ends are among the random families below
OFTEN = ["two_tones", "multilayer", "struck_sheet"]


@pytest.mark.parametrize("name", members(SHIPPED, *(name for name in SHIPPED if name not in OFTEN)))
def test_a_shipped_scene_moves_as_in_lammps(name: str, tmp_path: Path) -> None:
    error, bound = difference(Scene.load(name), tmp_path)
    assert error < bound


@pytest.mark.parametrize("seed", members([1, 2], 2))
@pytest.mark.parametrize("family", HELD)
def test_a_random_wave_moves_as_in_lammps(family: str, seed: int, tmp_path: Path) -> None:
    error, bound = difference(wave_scene(family, seed), tmp_path)
    assert error < bound


@pytest.mark.parametrize("seed", members([1, 2], 2))
@pytest.mark.parametrize("family", IMPACTS)
def test_a_random_impact_moves_as_in_lammps(family: str, seed: int, tmp_path: Path) -> None:
    error, bound = difference(impact_scene(family, seed), tmp_path)
    assert error < bound


# Unequal spheres whose contacts open and form; contacts by JKR, stretched at rest, that part at the pull-off and slide
UNEQUAL = {"packing.columns": 12, "time.duration": 8.0, "disorder.seed": 2, "effects.contact_opening": True}
PARTED = {
    "dmt": UNEQUAL | {"disorder.radius": 7.5e-4, "wave.amplitude": 1.0, "effects.friction": 5.0},
    "jkr": UNEQUAL
    | {"sphere.adhesion_law": "jkr", "disorder.radius": 1.5e-4, "wave.mode": "L", "wave.amplitude": 1.1}
    | {"effects.sliding": True, "effects.friction": 0.5, "time.duration": 1.5},
}


@pytest.mark.parametrize("law", PARTED)
def test_unequal_spheres_that_part_move_as_in_lammps(law: str, tmp_path: Path) -> None:
    error, bound = difference(Scene.load("tr_periodic").with_values(PARTED[law]), tmp_path)
    assert error < bound
    assert Record.load(tmp_path / "run").info["guards"]["open_contacts"]["value"] > 1


# Contacts that slide while they are loaded, and contacts that just touch and slide before they have a slip
SLIDES = {
    "loaded": ("tr_periodic", {"effects.friction": 0.02, "effects.viscosity": 2e-8, "time.duration": 2.0}),
    "touching": (
        "point_impact",
        {"packing.rows": 11, "packing.columns": 9, "striker.1.spheres": [[0, 4]], "time.duration": 3.0}
        | {"effects.restitution": 0.9, "effects.friction": 0.2},
    ),
}


@pytest.mark.parametrize("kind", SLIDES)
def test_damped_contacts_that_slide_at_once_move_as_in_lammps(kind: str, tmp_path: Path) -> None:
    name, changes = SLIDES[kind]
    error, bound = difference(Scene.load(name).with_values(changes), tmp_path)
    assert error < bound


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_jkr_contact_that_sticks_or_parts_by_a_thousandth_of_the_speed_moves_as_in_lammps(
    share: float, tmp_path: Path
) -> None:
    speed = share * sticking_speed(SNAP) / 2
    scene = scene_of(SNAP.with_values({"collision.normal_velocity": speed, "collision.steps": 1000}))
    error, bound = difference(scene, tmp_path)
    assert error < bound
    # DMT's law would be off by 4 D0, and contacts that pull before they touch by 2e-3 D0


def test_a_mass_that_is_wrong_by_a_millionth_is_seen(tmp_path: Path) -> None:
    error, bound = difference(Scene.load("tr_periodic"), tmp_path, heavier=1e-6)
    assert error > 100 * bound
