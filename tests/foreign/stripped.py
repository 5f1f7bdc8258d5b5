"""Decks as anybody writes them, of the crystals of scenes: without a word of ours, in other units, along other axes."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.foreign.reading import Reading, read
from granular_lmp.lammps.deck import deck_of
from granular_lmp.problem import prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.units import STYLES

Floats = NDArray[np.float64]
SAME = np.eye(3)
Y_TO_X = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # what a scene has along y lies along x
_SHEAR = {"secant": "mindlin", "incremental": "mindlin/force", "rescaled": "mindlin_rescale"}


def read_own(scene: Scene, folder: Path) -> Reading:
    """Return the deck of a scene as LAMMPS reads it."""
    deck = deck_of(prepare(scene))
    deck.write(folder / "own", force=True)
    return read(folder / "own" / deck.input_name)


def stripped(
    scene: Scene, folder: Path, *, turn: Floats = SAME, units: str = "si", move: Floats | None = None, more: str = ""
) -> Path:
    """Write a foreign deck ``in.plain`` of a scene and return its path.

    Parameters
    ----------
    scene : Scene
    folder : Path
    turn : (3, 3) array
        Rotation from the axes of the scene to those of the deck.
    units : str
        Style of the deck.
    move : (N, 3) array, optional
        Displacements on top, m, along the axes of the scene.
    more : str
        Lines before the dump.
    """
    problem, own, style = prepare(scene), read_own(scene, folder), STYLES[units]
    mine = problem.units
    spheres = own.spheres
    assert spheres is not None
    order = np.argsort(spheres.id)
    to_length, to_rate = mine.number(1.0, length=1), mine.number(1.0, length=1, time=-1)
    place = spheres.position[order] / to_length + (0.0 if move is None else move)
    shift = np.array([0.0131, -0.57, 0.0]) * scene.sphere.radius
    place = style.number((place + shift) @ turn.T, length=1)
    velocity = style.number(spheres.velocity[order] / to_rate @ turn.T, length=1, time=-1)
    spin = style.number(spheres.spin[order] / mine.number(1.0, time=-1) @ turn.T, time=-1)
    diameter = style.number(2 * spheres.radius[order] / to_length, length=1)
    mass = style.number(spheres.mass[order] / mine.number(1.0, mass=1), mass=1)
    flat = scene.space == 2 and turn[2, 2] == 1
    periodic = np.abs(turn) @ np.array(own.periodic) > 0.5
    box = np.array([own.low, own.high]) / to_length + shift
    low, high = np.sort(style.number(box @ turn.T, length=1), axis=0)
    open_faces = ~periodic & ~np.array([False, False, flat])
    low[open_faces] = (place.min(axis=0) - 3 * diameter.max())[open_faces]
    high[open_faces] = (place.max(axis=0) + 3 * diameter.max())[open_faces]
    rows = zip(place.tolist(), diameter.tolist(), (mass / (np.pi / 6 * diameter**3)).tolist(), strict=True)
    lines = [f"{n} 1 {d!r} {rho!r} {x!r} {y!r} {z!r}" for n, ((x, y, z), d, rho) in enumerate(rows, 1)]
    rates = [f"{n} {' '.join(map(repr, each))}" for n, each in enumerate(np.hstack([velocity, spin]).tolist(), 1)]
    faces = [f"{a!r} {b!r} {axis}lo {axis}hi" for axis, a, b in zip("xyz", low.tolist(), high.tolist(), strict=True)]
    head = f"spheres\n\n{len(lines)} atoms\n1 atom types\n\n" + "\n".join(faces)
    (folder / "data.plain").write_text(
        head + "\n\nAtoms # sphere\n\n" + "\n".join(lines) + "\n\nVelocities\n\n" + "\n".join(rates) + "\n"
    )
    held = (np.flatnonzero(~spheres.moves[order]) + 1).tolist()
    loads = [
        f"group end{n} id {sphere + 1}\nfix load{n} end{n} addforce "
        + " ".join(
            repr(float(style.number(each, mass=1, length=1, time=-2)))
            for each in turn @ [0.0, force * scene.scale.mass * scene.scale.length / scene.scale.time**2, 0.0]
        )
        for n, (sphere, force) in enumerate(problem.rest.loads.items())
    ]
    walls = []
    for name, at in problem.rest.planes.items():
        axis, side = "xyz".index(name[0]), 1 if name.endswith("hi") else -1
        way = turn[:, axis] * side
        along = int(np.argmax(np.abs(way)))
        faced = repr(float(way[along] * side * style.number(at * scene.sphere.radius + shift[axis], length=1)))
        faces_of = f"{faced} NULL" if way[along] < 0 else f"NULL {faced}"
        rigid = law(scene.with_values({"sphere.youngs_modulus": 2 * scene.sphere.youngs_modulus}), units)
        walls.append(f"fix {name} all wall/gran granular {rigid} {'xyz'[along]}plane {faces_of}")
    kind = "nve/sphere" if problem.on["rotation"] else "nve"
    step = style.number(float(own.start.timestep) / mine.number(1.0, time=1), time=1) if own.start else 0.0
    text = [
        f"units {units}",
        f"dimension {2 if flat else 3}",
        "boundary " + " ".join("p" if each else "f" for each in [*periodic[:2], periodic[2] or flat]),
        "atom_style sphere",
        "comm_modify vel yes",
        "newton off",
        "read_data data.plain",
        f"neighbor {0.3 * float(diameter[0])!r} bin",
        "pair_style granular",
        f"pair_coeff * * {law(scene, units)}",
        f"group held id {' '.join(map(str, held)) or 0}",
        "group free subtract all held",
        *(["fix plane all enforce2d"] if flat else []),
        *loads,
        *walls,
        *(["fix still held freeze"] if scene.effects.restitution < 1 else []),
        f"fix move free {kind}",
        f"timestep {step!r}",
        *([more] if more else []),
        "dump all all custom 5 dump.plain id type x y z vx vy vz",
        "dump_modify all format float %.17g",
        "run 20",
    ]
    (folder / "in.plain").write_text("\n".join(text) + "\n")
    return folder / "in.plain"


def law(scene: Scene, units: str) -> str:
    """Return the words of the contact law of a scene, as anybody writes them."""
    style, sphere, effects = STYLES[units], scene.sphere, scene.effects
    young = style.number(sphere.youngs_modulus, mass=1, length=-1, time=-2)
    loss, how = style.number(effects.viscosity, mass=1, time=-1), "velocity"
    if effects.restitution < 1:
        loss, how = effects.restitution, "coeff_restitution"
    normal = f"hertz/material {young!r} {loss!r} {sphere.poisson_ratio!r}"
    if sphere.work_of_adhesion:
        half = style.number(sphere.work_of_adhesion / 2, mass=1, time=-2)
        normal = f"{sphere.adhesion_law} {young!r} {loss!r} {sphere.poisson_ratio!r} {half!r}"
    friction = effects.friction
    if friction == "auto" or not friction:
        return f"{normal} tangential linear_nohistory 0.0 0.0 damping {how}"
    return f"{normal} tangential {_SHEAR[effects.shear_law]} NULL {effects.shear_damping} {friction} damping {how}"
