"""The LAMMPS deck of an impact, ``in.NAME`` and ``data.NAME``, which runs with plain ``lmp -in in.NAME``.

Its units are the radius R and the mass m of a sphere, and t0 of the impact (``units lj``): spheres that touch then have
exact positions (`granular_lmp.impact.lattice`).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import equivalent
from granular_lmp.crystal.lattices import PERIODIC
from granular_lmp.impact.problem import ImpactProblem
from granular_lmp.lammps import contact
from granular_lmp.lammps.checkpoints import minutes_between, steps_between
from granular_lmp.lammps.datafile import DataFile, id_ranges
from granular_lmp.lammps.outputs import CHECKPOINTS, LOG, SCENE, SNAPSHOTS, write_deck
from granular_lmp.lammps.spheres import types
from granular_lmp.scene.validation import LARGEST_OVERLAP_RATIO
from granular_lmp.step_rules import LONGEST_STEP

Floats = NDArray[np.float64]
SKIN = 0.2  # radii
LOOKS_IN_COLLISION = 20  # looks of the guards in the shortest collision
GUARD_COLUMNS = ("v_tau", "v_overlap", "v_omega_dt")  # The thermo table has them behind the step
_DISPLACEMENTS = ("# --- displacements count from the places at rest", "compute      u all displace/atom", "")
_PLACES = ["id", "type", "x", "y", "z", "radius", "mass", "Displacement.X", "Displacement.Y", "vx", "vy", "vz"]


def dump_columns(problem: ImpactProblem) -> list[str]:
    """Return the names of the columns of the dump, as OVITO knows them."""
    return [*_PLACES, *(["omegaz"] if problem.on["rotation"] else [])]


@dataclass(frozen=True)
class ImpactDeck:
    """The deck of an impact and the problem that it was made from."""

    problem: ImpactProblem
    input_text: str
    data: DataFile

    @property
    def input_name(self) -> str:
        """File name of the input."""
        return f"in.{self.problem.scene.name}"

    def files(self) -> dict[str, Iterable[str]]:
        """Return name → text, in pieces, of the three files of a deck folder."""
        scene = self.problem.scene
        return {
            SCENE: [scene.to_toml()],
            self.input_name: [self.input_text],
            f"data.{scene.name}": self.data.pieces(f"{scene.name}: {scene.words}; lengths in radii, masses in m"),
        }

    def write(self, folder: str | Path, *, force: bool = False) -> None:
        """Write the three files into `folder`, which is created.

        Raises
        ------
        RunFolderError
            If the folder exists (without `force`) or cannot be written.
        """
        write_deck(folder, self.files(), force=force)


def deck_of(problem: ImpactProblem) -> ImpactDeck:
    """Return the deck of an impact; no file is written."""
    return ImpactDeck(problem, _text(problem), _data(problem))


def look_steps(problem: ImpactProblem) -> int:
    """Return the steps between two looks of the guards, a whole number of them in a sample."""
    time = problem.scene.time
    most = min(max(int(problem.shortest_collision / LOOKS_IN_COLLISION / time.step), 1), time.steps_per_sample)
    return next(steps for steps in range(most, 0, -1) if time.steps_per_sample % steps == 0)


def _data(problem: ImpactProblem) -> DataFile:
    crystal = problem.crystal
    low, size = crystal.get_celldisp().ravel(), crystal.cell.lengths()
    high = low + size
    # A chain of unequal spheres is longer or shorter than its cell
    low[1] = min(low[1], crystal.positions[:, 1].min() - 1)
    high[1] = max(high[1], crystal.positions[:, 1].max() + 1)
    radius = crystal.arrays["radius"]
    return DataFile(
        box=np.column_stack([low, high]),
        kind=types(crystal),
        position=crystal.positions,
        diameter=2 * radius,
        density=problem.mass / (4 / 3 * np.pi * radius**3),
        wave=_started(problem),
        directed=False,
    )


def checkpoint_steps(problem: ImpactProblem, ranks: int = 1) -> int:
    """Return the steps between two checkpoints."""
    declared = problem.scene.output.checkpoint
    return steps_between(declared, len(problem.crystal), look_steps(problem), ranks)


def resume_text(problem: ImpactProblem, checkpoint: str) -> str:
    """Return the input that continues a run from a checkpoint, to the same bytes as an uninterrupted run.

    At each checkpoint the deck sets its run up anew, as its continuation does: forces that depend on velocities are
    then computed from the same ones in both. A restart file of LAMMPS holds the spheres, the shear of their contacts
    with each other and with walls, and the box; it holds no pair coefficients, no ``comm_modify`` and no fixes.
    """
    scene = problem.scene
    lines = [
        f"# {scene.name}: {scene.words}: continues from {checkpoint}",
        f"log {LOG} append",
        "",
        *_variables(problem),
        "",
        "comm_modify  vel yes",
        f"read_restart {checkpoint}",
        f"neighbor     {SKIN} bin",
        "timestep     $(v_step:%.17g)",
        "",
        *_laws(problem),
        "",
        *_DISPLACEMENTS,
        *_loads(problem),
        *_motion(problem),
        "dump_modify  record append yes",
        "",
        f'run          ${{steps}} upto every ${{checkpoint}} "change_box all boundary {_boundary(problem)}"',
    ]
    return "\n".join(lines) + "\n"


def _text(problem: ImpactProblem) -> str:
    scene, scale, fields = problem.scene, problem.scene.scale, _fields(problem)
    lines = [
        f"# {scene.name}: {scene.words}",
        f"# Runs as it is in this folder:  lmp -in in.{scene.name}",
        f"# With other values:             lmp -in in.{scene.name} -var timestep 0.01",
        "# The run is invalid if, in the thermo table,",
        f"#   v_overlap, the largest overlap over the smallest diameter, is above {LARGEST_OVERLAP_RATIO}: too deep",
        f"#   v_omega_dt, the step times the frequency of the stiffest contact, is above {LONGEST_STEP}: too long",
        "",
        *_variables(problem),
        "",
        f"# --- units: the radius R = {scene.sphere.radius!r} m, the mass m = {scale.mass!r} kg and "
        f"t0 = {scale.time!r} s",
        f"#     v = {scale.velocity!r} m/s and l = {scale.length!r} m are the units of velocities and overlaps below",
        "units        lj",
        "dimension    2",
        f"boundary     {_boundary(problem)}  # m: the box follows spheres that fly away",
        "atom_style   sphere",
        "atom_modify  map array",
        "comm_modify  vel yes",
        *([f"fix          start all property/atom {' '.join(fields)}"] if fields else []),
        f"read_data    ${{data}}{' fix start NULL wave' if fields else ''}",
        f"group        mobile type {' '.join(str(2 * m + 1) for m in range(len(problem.materials)))}",
        f"neighbor     {SKIN} bin",
        "timestep     $(v_step:%.17g)",
        "",
        *_laws(problem),
        "",
        *_DISPLACEMENTS,
        *_start(fields),
        *_strikers(problem),
        *_loads(problem),
        *_motion(problem),
        "",
        "# --- at a checkpoint the run is set up anew, and its box too, as in a continuation",
        f'run          ${{steps}} every ${{checkpoint}} "change_box all boundary {_boundary(problem)}"',
    ]
    return "\n".join(lines) + "\n"


def _boundary(problem: ImpactProblem) -> str:
    return f"{'p' if problem.scene.packing.sides == PERIODIC else 'm'} m p"


def _variables(problem: ImpactProblem) -> list[str]:
    time = problem.scene.time
    return [
        "# --- variables: these, and no others, may be overridden with -var NAME VALUE",
        f"variable timestep index {time.timestep!r}  # t0; rounded down to fit a whole number of steps into a sample",
        f"variable sample   index {time.sample!r}  # t0 between records",
        f"variable duration index {time.duration!r}  # t0",
        f"variable data     index data.{problem.scene.name}",
        f"variable dump     index {SNAPSHOTS}",
        f"variable checkpoint index {checkpoint_steps(problem)}  # steps between checkpoints, here for one core",
        "variable marked   index unmarked  # a group without spheres, by which a checkpoint tells of which scene it is",
        "variable every    equal ceil(v_sample/v_timestep-1e-9)",
        "variable step     equal v_sample/v_every",
        "variable steps    equal v_every*floor(v_duration/v_sample+1e-9)",
        "variable tau      equal step*v_step",
    ]


def _laws(problem: ImpactProblem) -> list[str]:
    """Return the lines of the contact law, between spheres and with walls."""
    effects, units, materials = problem.scene.effects, problem.units, problem.materials
    law: dict[str, Any] = {
        "normal": "hertz",
        "shear": effects.shear_law if effects.friction else "none",
        "friction": effects.friction,
        "restitution": effects.restitution if effects.restitution < 1 else None,
        "shear_damping": 1.0 if effects.friction and effects.restitution < 1 else 0.0,
    }
    pairs = contact.pairs(
        {
            (m, n): contact.model(equivalent(materials[m], materials[n]), units, **law)
            for m, n in combinations_with_replacement(range(len(materials)), 2)
        }
    )
    walls = [
        _wall(name, place, contact.model(contact.rigid(each), units, **law), m)
        for name, place in problem.planes.items()
        for m, each in enumerate(materials)
    ]
    if walls:
        walls = [f"group        material{m + 1} type {2 * m + 1} {2 * m + 2}" for m in range(len(materials))] + walls
    title = "# --- contacts: normal law with E, damping and nu; tangential law with friction"
    return [title, pairs, *walls]


def _motion(problem: ImpactProblem) -> list[str]:
    """Return the lines of the motion, the guards, the record and the checkpoints."""
    frozen: list[str] = []
    if problem.on["damping"] and problem.crystal.arrays["fixed"].any():
        frozen = [
            "# dashpots then take the mass of a held sphere as infinite; with its own mass too much would come back",
            "group        held subtract all mobile",
            "fix          held held freeze",
        ]
    spins = problem.on["rotation"]
    everyone = len(problem.recorded) == len(problem.crystal)
    return [
        "# --- motion of the spheres that are not held",
        "fix          plane all enforce2d",
        f"fix          move mobile {'nve/sphere' if spins else 'nve'}",
        *frozen,
        "",
        "# --- guards: the largest force of a contact; its overlap and frequency are at most those of the softest and",
        "#     the stiffest pair of spheres",
        *_guards(problem),
        "",
        f"# --- record, all digits; a checkpoint about every {_minutes(problem):.3g} minutes",
        "group        ${marked} empty",
        f"restart      ${{checkpoint}} {' '.join(CHECKPOINTS)}",
        f"group        recorded id {id_ranges(problem.recorded)}",
        f"dump         record {'all' if everyone else 'recorded'} custom ${{every}} ${{dump}} id type x y z radius "
        f"mass c_u[1] c_u[2] vx vy vz{' omegaz' if spins else ''}",
        "dump_modify  record sort id format float %.17g colname c_u[1] Displacement.X colname c_u[2] Displacement.Y",
    ]


def _minutes(problem: ImpactProblem) -> float:
    return minutes_between(problem.scene.output.checkpoint, len(problem.crystal))


def _fields(problem: ImpactProblem) -> tuple[str, ...]:
    """Return the names of the state of each sphere in the section ``wave`` of the data file; () where there is none."""
    if not problem.scene.start.moves:
        return ()
    return ("d_ux", "d_uy", "d_vx", "d_vy", *(["d_spin"] if problem.on["rotation"] else []))


def _started(problem: ImpactProblem) -> Floats:
    """Return the section ``wave``: displacements, velocities and spin at the beginning, in the units of the deck."""
    units, names = problem.units, _fields(problem)
    length, velocity = units.number(1.0, length=1), units.number(1.0, length=1, time=-1)
    factors = np.array([length, length, velocity, velocity, units.number(1.0, time=-1)])
    return np.asarray(problem.state * factors)[:, : len(names)]


def _start(fields: tuple[str, ...]) -> list[str]:
    """Return the lines that displace and move the spheres of a state."""
    if not fields:
        return []
    return [
        "# --- state at the beginning: displacements from rest and velocities, the section wave of the data file",
        *(f"variable     {name[2:]} atom {name}" for name in fields),
        "displace_atoms all move v_ux v_uy 0.0 units box",
        "velocity     all set v_vx v_vy 0.0 units box",
        *(["set          group all omega 0.0 0.0 v_spin"] if "d_spin" in fields else []),
        "",
    ]


def _strikers(problem: ImpactProblem) -> list[str]:
    """Return the lines that give each striker its velocity: one group after the other, as LAMMPS has 32 at most."""
    lines = ["# --- strikers"] if problem.strikers else []
    for striker, spheres in zip(problem.scene.striker, problem.strikers, strict=True):
        vx, vy = (problem.units.number(v, length=1, time=-1) for v in striker.components)
        lines += [
            f"group        striker id {id_ranges(spheres)}",
            f"velocity     striker set {vx!r} {vy!r} 0.0 units box",
            "group        striker delete",
        ]
    return [*lines, *([""] if lines else [])]


def _loads(problem: ImpactProblem) -> list[str]:
    """Return the lines of the constant forces on free ends of a chain that is pressed together."""
    scale, radius = problem.scene.scale, problem.scene.sphere.radius
    lines = ["# --- constant forces on free ends, which press the chain together"] if problem.loads else []
    for number, (sphere, force) in enumerate(problem.loads.items(), 1):
        lines += [
            f"group        end{number} id {sphere + 1}",
            f"fix          load{number} end{number} addforce 0.0 {force * scale.length / radius!r} 0.0",
        ]
    return [*lines, *([""] if lines else [])]


def _wall(name: str, place: float, model: str, material: int) -> str:
    faces = f"{place!r} NULL" if name.endswith("lo") else f"NULL {place!r}"
    return (
        f"fix          {name}{material + 1} material{material + 1} wall/gran granular {model} &\n"
        f"             {name[0]}plane {faces}"
    )


def _guards(problem: ImpactProblem) -> list[str]:
    """Return the lines that measure the deepest overlap and the stiffest contact.

    The largest force of a contact F makes no overlap above (F/A)^{2/3} of the softest pair of spheres, and no contact
    is stiffer than one of the stiffest pair, or with a wall, at that overlap.
    """
    softest, walls = float(problem.coefficients.min(initial=1.0)), problem.planes
    smallest = float(problem.crystal.arrays["radius"].min())
    length = problem.units.number(problem.scene.scale.length, length=1)  # ℓ, and m ℓ/t0² too
    lines = [
        "compute      contact all pair/local force",
        "compute      largest all reduce max c_contact inputs local",
        f"variable     depth equal ((c_largest>0)*c_largest/{softest * length!r})^(2/3)  # of spheres, in l",
    ]
    for name, place in walls.items():
        beyond = f"{place!r}-{name[0]}+radius" if name.endswith("lo") else f"{name[0]}+radius-({place!r})"
        lines += [
            f"variable     beyond_{name} atom ({beyond})/{length!r}",
            f"compute      in_{name} all reduce max v_beyond_{name}",
        ]
    depth = "v_depth"
    for name in walls:
        depth = f"ternary(c_in_{name}>{depth},c_in_{name},{depth})"
    return [
        *lines,
        f"variable     deepest equal {depth}",
        f"variable     overlap equal v_deepest*{length / (2 * smallest)!r}  # in diameters of the smallest sphere",
        f"variable     omega_dt equal v_step*sqrt({problem.square_rate!r}*sqrt(v_deepest))",
        "thermo_style custom step v_tau v_overlap v_omega_dt",
        "thermo_modify flush yes",
        f"thermo       {look_steps(problem)}",
    ]
