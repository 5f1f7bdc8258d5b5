"""The network against LAMMPS: crystals in the plane, layers on a wall and fcc, with heavy and unequal spheres.

The decks are written by hand (`tests.by_commands`). LAMMPS turns the slip in first order in the step, which is little,
and `mindlin/force` adds to the shear force in first order: three steps are extrapolated to none.
"""

from collections.abc import Callable
from dataclasses import replace
from math import sqrt
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory.network import Material, Network, Wall
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import start
from tests.by_commands import STYLES, Floats, moved, padded
from tests.conftest import members

SILICA = Material(73e3, 0.17, 63.0)
RADIUS, DENSITY = 500.0, 0.0022
OVERLAP, TIME = 0.2498514361612, 0.4981191748424  # Δ0 and t0 of the paper's spheres
SPACING = 2 * RADIUS - OVERLAP
AMPLITUDE = 0.2  # of the random displacements, in Δ0
SIZE = AMPLITUDE * OVERLAP
VISCOSITY = 0.3 * 4 / 3 * np.pi * RADIUS**3 * DENSITY / TIME  # 0.3 m/t0, in ag/ns: waves decay in some t0
HEIGHT = 2 ** (1 / 3) * OVERLAP - RADIUS  # of the plane under a layer at z = 0, at rest on its own material
Moving = tuple[Floats, Floats, Floats, Floats]  # displacements, velocities, rotations and spins


def hexagonal(rows: int, columns: int) -> tuple[Floats, Floats, tuple[float, float]]:
    """Return x and y (N,) of a hexagonal crystal, and its periods."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    x, y = column + 0.25 + row % 2 / 2, (row + 0.25) * sqrt(3) / 2
    return SPACING * x, SPACING * y, (columns * SPACING, rows * SPACING * sqrt(3) / 2)


def imperfect(**changes: Any) -> Network:
    """Return a periodic crystal of 48 sites, one empty, one of a heavy sphere, with radii unequal by up to 1e-4."""
    x, y, cell = hexagonal(6, 8)
    radius = RADIUS * (1 + 1e-4 * np.random.default_rng(4).uniform(-1, 1, len(x)))
    density = np.where(np.arange(len(x)) == 12, 4 * DENSITY, DENSITY)
    there = np.arange(len(x)) != 29
    place = np.stack([x, y], axis=1)
    return replace(Network(place[there], radius[there], density[there], (SILICA,), cell=cell), **changes)


def unequal(places: Floats, **changes: Any) -> Network:
    """Return spheres with radii unequal by up to 5e-5, one of them four times as heavy."""
    radius = RADIUS * (1 + 5e-5 * np.random.default_rng(4).uniform(-1, 1, len(places)))
    density = np.where(np.arange(len(places)) == 5, 4 * DENSITY, DENSITY)
    return Network(places, radius, density, (SILICA,), **changes)


def layer(**changes: Any) -> Network:
    """Return a hexagonal layer of 24 spheres on a half-space of silica."""
    x, y, cell = hexagonal(6, 4)
    floor = Wall((0.0, 0.0, HEIGHT), (0.0, 0.0, -1.0), SILICA)
    return unequal(np.stack([x, y, 0 * x], axis=1), cell=(*cell, np.inf), walls=(floor,), **changes)


def fcc(**changes: Any) -> Network:
    """Return two by two by two cubes of fcc."""
    edge = SPACING * sqrt(2)
    shifts = np.stack(np.meshgrid(*[[0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    basis = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]]) + 0.25
    return unequal(edge * (shifts + basis).reshape(-1, 3), cell=(2 * edge,) * 3, **changes)


def disturbed(network: Network) -> Moving:
    """Return random displacements, velocities, rotations and spins (N, 3), of the order of Δ0/10."""
    count, dimension = network.position.shape
    rng, turns = np.random.default_rng(5), (2,) if dimension == 2 else (0, 1, 2)

    def drawn(*axes: int) -> Floats:
        return padded(SIZE * rng.uniform(-0.5, 0.5, (count, len(axes))), *axes)

    way, rate = drawn(*range(dimension)), drawn(*range(dimension)) / TIME
    return way, rate, drawn(*turns) / RADIUS, drawn(*turns) / RADIUS / TIME


def fields(network: Network, model: str, moving: Moving, every: float, steps: int, samples: int) -> Floats:
    """Return displacements and rotations (samples, N, 6), free of errors of first and second order in the step."""
    way, rate, rotation, spin = moving
    coarse, middle, fine = (
        moved(network, model, (way, rotation), (rate, spin), every / steps / n, n * steps, samples)[1:]
        for n in (1, 2, 4)
    )
    return (8 * fine - 6 * middle + coarse) / 3


def apart(network: Network, moving: Moving, found: Floats, every: float = TIME, **options: float) -> float:
    """Return the largest difference of a displacement or of Rθ from the network."""
    dimension = network.position.shape[1]
    plane, turns = slice(dimension), slice(2, None) if dimension == 2 else slice(None)
    way, rate = (each[:, plane] for each in moving[:2])
    rotation, spin = (each[:, 2] if dimension == 2 else each for each in moving[2:])
    state = start(network, way, rate, rotation, spin)
    run = integrate(network, state, every * np.arange(1, len(found) + 1), **{"rtol": 1e-9} | options)
    ways = np.abs(run.displacement - found[:, :, plane]).max()
    turned = np.abs(run.rotation - found[:, :, 3:][:, :, turns]) * network.radius[:, None]
    return float(max(ways, turned.max()))


def model(network: Network, friction: float) -> str:
    """Return LAMMPS's model of the contacts of a network, with a friction."""
    work = network.materials[0].work_of_adhesion / 2
    normal, damping = f"{network.adhesion} 73e3 {network.viscosity!r} 0.17 {work!r}", "velocity"
    if network.restitution is not None:
        normal, damping = f"hertz/material 73e3 {network.restitution!r} 0.17", "coeff_restitution"
    # LAMMPS takes the modulus of a wall's contact for that of two alike: one of the sphere's own is half as stiff
    return f"* * {normal} tangential {STYLES[network.law]} NULL 1.0 {friction!r} damping {damping}"


INCREMENTAL, DASHPOTS, JKR = {"law": "incremental"}, {"viscosity": VISCOSITY}, {"adhesion": "jkr"}
LOSSY = {"restitution": 0.6, "materials": (replace(SILICA, work_of_adhesion=0.0),)}  # the cell presses the spheres
Packing = tuple[Callable[..., Network], dict[str, Any]]
PACKINGS: list[Packing] = [
    *((imperfect, each) for each in ({}, INCREMENTAL, DASHPOTS, DASHPOTS | INCREMENTAL, LOSSY)),
    *((packing, each) for packing in (layer, fcc) for each in ({}, INCREMENTAL, DASHPOTS, JKR)),
]


@pytest.mark.parametrize(("packing", "changes"), members(PACKINGS, *PACKINGS[-3:]))
def test_a_packing_moves_as_in_lammps(packing: Callable[..., Network], changes: dict[str, Any]) -> None:
    network = packing(**changes)
    moving, damped = disturbed(network), network.viscosity or network.restitution
    # No contact slides, and LAMMPS turns its slips. Forces of dashpots are larger
    friction = (25 if damped else 5) * AMPLITUDE
    found = fields(network, model(network, friction), moving, TIME, 200 if packing is imperfect else 100, 3)
    # The error of LAMMPS that is left is 3e-8, of third order; positions of 1e4 nm carry 1e-12/D0 = 4e-11 a step
    assert apart(network, moving, found) < 1e-6 * SIZE
    light = replace(network, density=np.full_like(network.density, DENSITY))
    assert apart(light, moving, found, rtol=1e-6) > 1e-2 * SIZE
    for name in ("viscosity", "restitution"):
        if getattr(network, name):
            other = replace(network, **{name: 1.01 * getattr(network, name)})
            assert apart(other, moving, found, rtol=1e-6) > 1e-3 * SIZE


# What is left, of D0: of second order in the longest step, of first where dashpots turn the force of a slip in space
SLIDING = [
    (imperfect, {}, 5e-6),
    (imperfect, INCREMENTAL, 5e-6),
    (imperfect, DASHPOTS, 4e-6),
    (imperfect, DASHPOTS | INCREMENTAL, 4e-6),
    (imperfect, LOSSY, 4e-6),
    (layer, {}, 1e-5),
    (layer, DASHPOTS, 5e-5),
]


@pytest.mark.parametrize(("packing", "changes", "left"), members(SLIDING, *SLIDING[1:4], SLIDING[-1]))
def test_contacts_slide_as_in_lammps(packing: Callable[..., Network], changes: dict[str, Any], left: float) -> None:
    network = packing(friction=0.1, **changes)
    moving = disturbed(network)
    found = fields(network, model(network, 0.1), moving, TIME, 200, 1)  # many contacts slide from the start
    coarse, fine = (apart(network, moving, found, rtol=1e-8, longest_step=TIME / n) for n in (20, 160))
    assert fine < left * SIZE
    assert fine < coarse / 5
    stuck = replace(network, friction=np.inf)
    assert apart(stuck, moving, found, rtol=1e-6) > 0.05 * SIZE


def test_the_arm_of_a_wall_is_the_radius() -> None:
    # One sphere, rocking: with the arm R − δ/2 it would be off by η = 3e-4 of its rotation
    one = layer()
    one = replace(one, position=[[1000.0, 1000.0, 0.0]], radius=[RADIUS], density=[DENSITY])
    moving = tuple(each[:1] for each in disturbed(layer()))
    found = fields(one, model(one, 5 * AMPLITUDE), moving, TIME, 200, 3)
    assert apart(one, moving, found) < 1e-7 * SIZE


def test_a_chain_of_unequal_spheres_of_two_materials_tumbles_as_in_lammps() -> None:
    # Adhesion holds the bent chain together while it turns by 0.4 rad, rolls and vibrates.
    radius, steel = np.array([500.0, 350.0, 700.0]), Material(200e3, 0.3, 100.0)
    joint = np.array([1000 + radius[0] + radius[1] - 0.2, 2000.0])
    elbow = (radius[1] + radius[2] - 0.2) * np.array([np.cos(1.0), np.sin(1.0)])
    network = Network(
        np.stack([[1000.0, 2000.0], joint, joint + elbow]),
        radius,
        np.array([0.0022, 0.0078, 0.0022]),
        (SILICA, steel),
        kind=np.array([0, 1, 0]),
        shear_mixing="lammps",
    )
    turn, every = 0.004, 20.0  # rad/ns, ns
    x, y = (network.position - network.position.mean(axis=0)).T
    vibration = np.array([[0.02, 0], [0, 0.03], [-0.02, 0]])
    rate, spin = turn * np.stack([-y, x], axis=1) + vibration, turn * np.array([[1.0], [0.99], [1.01]])
    moving = np.zeros((3, 3)), padded(rate, 0, 1), np.zeros((3, 3)), padded(spin, 2)
    laws = "\n".join(
        f"{i} {i} dmt {one.youngs_modulus!r} 0.0 {one.poisson_ratio!r} {one.work_of_adhesion / 2!r} "
        "tangential mindlin NULL 0.0 10.0 damping velocity"
        for i, one in ((1, SILICA), (2, steel))
    )
    found = fields(network, laws, moving, every, 1000, 5)
    assert np.max(np.abs(found[-1, :, 5])) > 0.35
    # 1e-8 nm, measured, of ways of 300 nm: errors of third order in a step of 0.02 ns
    assert apart(network, moving, found, every, rtol=1e-12) < 1e-6 * OVERLAP
    assert apart(replace(network, shear_mixing="mindlin"), moving, found, every) > 1e-2 * OVERLAP
