"""The LAMMPS deck of a scene: ``in.NAME`` and ``data.NAME``.

The deck is complete: it runs with plain ``lmp -in in.NAME`` in its folder. Values that can change without a new lattice
are index variables, which ``-var`` overrides. The blocks of the deck stand below as they are written, with ``<slots>``
for the numbers of the scene and for the lines of its effects; a line whose slots stay empty is left out.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

import granular_lmp
from granular_lmp.crystal.contacts import equivalent
from granular_lmp.crystal.lattices import centre
from granular_lmp.effects import selection
from granular_lmp.effects.effect import Case
from granular_lmp.lammps import contact, guards, sources
from granular_lmp.lammps.checkpoints import minutes_between, steps_between
from granular_lmp.lammps.datafile import DataFile
from granular_lmp.lammps.edits import blocks, differing_lines, with_lines
from granular_lmp.lammps.outputs import CHECKPOINTS, DUMP, LOG, SCENE, SNAPSHOTS, STATUS, writable, write_files
from granular_lmp.lammps.units import Units, units_for
from granular_lmp.problem import Problem
from granular_lmp.scene.absorption import quiet_end_of, quiet_side
from granular_lmp.scene.initial_fields import initial_fields
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import AUTO


@dataclass(frozen=True, repr=False)
class Deck:
    """A LAMMPS deck and the problem that it was made from.

    Attributes
    ----------
    problem : Problem
        Prepared scene.
    input_text : str
        Contents of ``in.NAME``.
    data : DataFile
        Contents of ``data.NAME``.

    Notes
    -----
    To change the text use ``dataclasses.replace(deck, input_text=...)``; `granular_lmp.run` takes the edited deck.
    """

    problem: Problem
    input_text: str
    data: DataFile

    @property
    def declared(self) -> Scene:
        """Scene as declared."""
        return self.problem.declared

    @property
    def scene(self) -> Scene:
        """Scene with every "auto" decided."""
        return self.problem.scene

    @property
    def packing(self) -> ase.Atoms:
        """Spheres at rest."""
        return self.problem.crystal

    @property
    def input_name(self) -> str:
        """File name of the input, ``in.NAME``."""
        return f"in.{self.scene.name}"

    @property
    def data_name(self) -> str:
        """File name of the data, ``data.NAME``."""
        return f"data.{self.scene.name}"

    def files(self) -> dict[str, Iterable[str]]:
        """Return name → text, in pieces, of the three files of a deck folder."""
        title = f"{_title(self.scene)}; units {units_for(self.scene.sphere.radius).style}"
        return {
            SCENE: [self.declared.to_toml()],
            self.input_name: [self.input_text],
            self.data_name: self.data.pieces(title),
        }

    def edited(self, *, before: Mapping[str, str] | None = None, after: Mapping[str, str] | None = None) -> "Deck":
        """Return the deck with lines of your own before or after the blocks that are named; see `places`.

        A run of it says in ``run.json`` which lines differ, and is not resumed.

        Raises
        ------
        DeckError
            For a place that the deck does not have; the text lists those that it has.
        """
        return replace(self, input_text=with_lines(self.input_text, before or {}, after or {}))

    @property
    def places(self) -> list[str]:
        """The names of the blocks of ``in.NAME``, in their order: what `edited` takes."""
        return list(blocks(self.input_text))

    def edits(self) -> list[str]:
        """Return the lines of ``in.NAME`` that differ from those that this package writes, "+ ..." or "- ..."."""
        return differing_lines(written_text(self.problem), self.input_text)

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return str(granular_lmp.html(self))

    def __repr__(self) -> str:
        edited = ", edited" if self.edits() else ""
        shape = self.scene.shape
        return f"<Deck {self.scene.name}: {self.scene.wave_label}, {shape.spheres} spheres{edited}>"

    def write(self, folder: str | Path, *, force: bool = False) -> None:
        """Write the three files into `folder`, which is created.

        Parameters
        ----------
        folder : path
            Deck folder.
        force : bool
            Write into an existing folder.

        Raises
        ------
        RunFolderError
            If the folder exists (without `force`) or cannot be written.
        """
        folder = Path(folder)
        with writable(folder):
            folder.mkdir(parents=True, exist_ok=force)
            (folder / STATUS).unlink(missing_ok=True)  # the status of an earlier run of another deck
        write_files(folder, self.files())


def deck_of(problem: Problem) -> Deck:
    """Return the deck of a problem; no file is written.

    The wave starts as a Bloch mode of the lattice that LAMMPS simulates, so that no other mode is excited at first
    order in the amplitude.

    Raises
    ------
    SceneError
        If the scene has a tolerance and no time step; `granular_lmp.accuracy.ladder.build` chooses one.
    """
    return Deck(problem, written_text(problem), _data(problem, units_for(problem.scene.sphere.radius)))


def written_text(problem: Problem) -> str:
    """Return ``in.NAME`` of a problem as this package writes it."""
    return _text(_blocks(problem.scene), _values(problem, units_for(problem.scene.sphere.radius)))


def _title(scene: Scene) -> str:
    shape = scene.shape
    differing = f"; not perfect: {scene.imperfections}" if scene.imperfections else ""
    return f"{scene.name}: {scene.wave_words}, {shape.words}, {shape.ends} ends{differing}"


def _data(problem: Problem, units: Units) -> DataFile:
    scene, packing = problem.scene, problem.crystal
    to_deck = units.number(scene.sphere.radius, length=1)
    low = packing.get_celldisp().ravel() * to_deck
    size = packing.cell.lengths() * to_deck
    fields = initial_fields(scene, packing, problem.mode)
    moving = problem.physics.coordinates
    densities = packing.arrays.get("density", np.full(len(packing), scene.sphere.density))
    return DataFile(
        box=np.column_stack([low, low + size]),
        kind=types(packing),
        position=packing.positions * to_deck,
        diameter=2 * packing.arrays["radius"] * to_deck,
        density=units.number(densities, mass=1, length=-3),
        # 13 decimals of D0 are finer than a double resolves a position, and turn rounding into 0. The last decimal
        # depends on the processor's cosine
        wave=np.hstack([fields.displacement[:, moving], fields.velocity[:, moving]]).round(13) + 0.0,  # no minus zeros
        directed=scene.effects.tracking is True,
    )


def types(packing: ase.Atoms) -> NDArray[np.int64]:
    """Return the LAMMPS types of spheres: 2m + 1 for the free ones of material m, 2m + 2 for those that are held."""
    material = packing.arrays.get("material", np.zeros(len(packing), dtype=int))
    return 2 * material + np.where(packing.arrays["fixed"], 2, 1)


# --- the blocks of in.NAME -------------------------------------------------------------------------------------------

_HEADING = """\
# <title>
# Runs as it is in this folder:  lmp -in in.<name>
# With other values:             lmp -in in.<name> -var amplitude 0.1 -var timestep 0.025
<invalid>"""

_VARIABLES = """\
# --- variables: these, and no others, may be overridden with -var NAME VALUE
variable amplitude index <amplitude>  # D0/Delta0
variable timestep  index <timestep>  # tau; rounded down to fit a whole number of steps into a sample
variable sample    index <sample>  # tau between records
variable duration  index <duration>  # tau
<ramp>
<friction>
variable data      index data.<name>
variable dump      index <dump>
<particles_variables>
variable checkpoint index <checkpoint_steps>  # steps between checkpoints, here for one core
if "<refused>" then "print 'ERROR: this deck is of one wave in one lattice: <names> is no variable of it'" "quit 1"
print "<said>"

# --- units <style>: <units>
variable Delta0 equal <Delta0>  # static overlap
variable R      equal <R>  # radius
variable t0     equal <t0>  # one tau
variable D0     equal v_amplitude*v_Delta0
variable every  equal ceil(v_sample/v_timestep-1e-9)
variable step   equal v_sample/v_every*v_t0
variable steps  equal v_every*floor(v_duration/v_sample+1e-9)
variable tau    equal step*v_step/v_t0"""

_FIELD = "fix          wave all property/atom d_ux d_uy<angle_field> d_vx d_vy<spin_field>"

_LATTICE = """\
# --- lattice at rest; the section wave of the data file holds the wave for unit amplitude
units        <style>
dimension    2
boundary     <along_x> <along_y> p
atom_style   <atom_style>
atom_modify  map array
comm_modify  vel yes
<field>
read_data    ${data} fix wave NULL wave
<mass>
group        mobile type <mobile>
neighbor     <skin> bin"""

_CONTACTS = """\
# --- contacts: normal law with E, damping, nu and half the work of adhesion; tangential law with friction
<contact>
<at_rest>"""

_PRELOAD = """\
# --- preload: LAMMPS starts every contact without shear, so the spheres are moved from rest to the wave in one
#     step without forces, which loads the shear springs; a long step, slow enough for negligible forces of dashpots
variable     slow  equal 1e6*v_step
timestep     $(v_slow:%.17g)
compute      u all displace/atom
variable     to_ux atom v_D0*d_ux/v_slow
variable     to_uy atom v_D0*d_uy/v_slow
velocity     all set v_to_ux v_to_uy NULL units box
<preload_spin>
fix          plane all enforce2d
fix          move mobile nve/noforce
thermo_style custom step
run          1 post no
unfix        move
reset_timestep 0
timestep     $(v_step:%.17g)"""

_WAVE = """\
# --- wave: the true velocities
variable     vx atom v_D0*d_vx/v_t0
variable     vy atom v_D0*d_vy/v_t0
velocity     all set v_vx v_vy NULL units box
<start_spin>
<start_angle>"""

_MEASURES = """\
compute      u all displace/atom
fix          plane all enforce2d
timestep     $(v_step:%.17g)"""

_MOTION = """\
# --- motion of the spheres that are not held
fix          move mobile <motion>
<quiet>
<quiet_turn>"""

_GUARDS = """\
# --- guards: proof that the effects this deck leaves out do not occur
<guards>"""

_RECORD = """\
# --- record of the centre sphere, all digits; a checkpoint about every <checkpoint> minutes
restart      ${checkpoint} <checkpoints>
group        centre id <centre>
<read_angle>
dump         centre centre custom ${every} ${dump} id c_u[1] c_u[2]<angle_column> vx vy<spin_column>
dump_modify  centre format float %.17g colname c_u[1] ux colname c_u[2] uy<angle_name>
<particles_dump>"""

_QUIET_TURN = """\
variable     turn_drag atom v_rate*0.4*mass*radius^2
fix          turn_drag quiet viscous/sphere 1.0 scale v_turn_drag"""

_RAMP = "variable ramp      index <switch_on>  # tau in which the first row is switched on"

# Slots of a scene with snapshots of all spheres. The names of the columns are those that OVITO knows; ASE keeps v_theta
_PARTICLES = {
    "particles_variables": "variable particles index <particles>  # tau between snapshots of all spheres\n"
    "variable snapshots index <snapshots>",
    "particles_dump": "variable     apart equal v_every*ceil(v_particles/v_sample-1e-9)\n"
    "dump         particles all custom ${apart} ${snapshots} id type x y z radius<mass_column> c_u[1] c_u[2] vx vy vz"
    "<spin_column><angle_column>\n"
    "dump_modify  particles sort id format float %.17g colname c_u[1] Displacement.X colname c_u[2] Displacement.Y",
    "particles_append": "dump_modify  particles append yes",
}

# Names that somebody would try with -var, and that would be ignored
_NO_VARIABLES = ("xi", "mode", "rows", "columns", "amp")
_SAID = "granular-lmp variables: "

# Contents of the slots that no effect of a scene fills
UNCALLED = dict.fromkeys(
    ("friction", "angle_field", "spin_field", "spin_column", "preload_spin", "start_spin", "mass", "start_angle")
    + ("read_angle", "angle_column", "angle_name", "quiet", "quiet_turn"),
    "",
) | {"motion": "nve", "atom_style": "sphere", "along_y": "p"}

_STARTS = {
    "running": (_PRELOAD, _WAVE),
    "standing": (_PRELOAD, _WAVE),
    "driven": (_MEASURES, sources.DRIVEN_ROW),
    "none": (_MEASURES, "<sources>"),
}


def _variables_line(scene: Scene, lines: Mapping[str, str]) -> str:
    """Return what a deck prints of its variables, so that the log of a run says what -var made of them."""
    optional = {
        "friction": bool(lines.get("friction")),
        "ramp": scene.wave.form == "driven",
        "particles": scene.output.particles > 0,
    }
    names = [
        "amplitude",
        "timestep",
        "sample",
        "duration",
        "dump",
        *(name for name, there in optional.items() if there),
    ]
    return _SAID + " ".join(f"{name}=${{{name}}}" for name in names)


def said_variables(log: str) -> dict[str, str] | None:
    """Return the variables of the run of a log, name → value; None if the log does not say them."""
    lines = [line for line in log.splitlines() if line.startswith(_SAID)]
    return dict(pair.split("=", 1) for pair in lines[-1].removeprefix(_SAID).split()) if lines else None


def _blocks(scene: Scene) -> tuple[str, ...]:
    start = _STARTS[scene.wave.form]
    return (_HEADING, _VARIABLES, _LATTICE, _CONTACTS, *start, _MOTION, _GUARDS, _RECORD, "run ${steps}")


def _resumed(scene: Scene) -> tuple[str, ...]:
    drive = {"driven": ("<field>", sources.DRIVEN_ROW), "none": ("<sources>",)}.get(scene.wave.form, ())
    return (
        "# <title>: continues from <from>\nlog <log> append",
        _VARIABLES,
        "comm_modify  vel yes\nread_restart <from>\nneighbor     <skin> bin",
        _CONTACTS,
        _MEASURES,
        *drive,
        _MOTION,
        _GUARDS,
        _RECORD + "\ndump_modify  centre append yes\n<particles_append>",
        "run ${steps} upto",
    )


def resume_text(deck: Deck, checkpoint: str) -> str:
    """Return the input that continues a run of `deck` from a checkpoint, to the same bytes as an uninterrupted run.

    A restart file of LAMMPS holds neither pair coefficients nor ``comm_modify``, and LAMMPS finds the reference
    positions of ``compute displace/atom`` by its name, so the input repeats these commands.
    https://docs.lammps.org/Howto_restart.html
    """
    values = _values(deck.problem, units_for(deck.scene.sphere.radius))
    return _text(_resumed(deck.scene), values | {"from": checkpoint, "log": LOG, "contacts_append": " append yes"})


def _values(problem: Problem, units: Units) -> dict[str, str]:
    """Return the contents of the slots: the lines of the effects, and the numbers of the scene."""
    scene = problem.scene
    sphere, time = scene.sphere, scene.time
    all_seen = scene.output.particles > 0
    plain = {
        "title": _title(scene),
        "name": scene.name,
        "style": units.style,
        "units": units.names,
        "field": _FIELD,
        "ramp": _RAMP if scene.wave.form == "driven" else "",
        "sources": sources.lines(problem, units),
        "invalid": guards.header(problem.judged, scene),
        "at_rest": "\n".join(guards.AT_REST),
        "guards": "\n".join(guards.lines(problem.guards, scene, problem.judged)),
        "contacts_append": "",
        "refused": "$(" + " || ".join(f"is_defined(variable,{name})" for name in _NO_VARIABLES) + ")",
        "names": " or ".join(_NO_VARIABLES),
        "said": _variables_line(scene, selection.lines(problem.on)),
        "dump": DUMP,
        "snapshots": SNAPSHOTS,
        "seen": "all" if all_seen else "centre",
        "checkpoint": f"{minutes_between(scene):.3g}",
        "checkpoint_steps": str(steps_between(scene)),
        "checkpoints": " ".join(CHECKPOINTS),
        "along_x": "p" if scene.lattice.endless_rows else "f",
        "columns": str(scene.shape.columns),
        "mass_column": "" if scene.perfect else " mass",
        "centre": str(centre(problem.crystal) + 1),
        "mobile": " ".join(str(2 * m + 1) for m in range(len(problem.at_rest.materials))),
    }
    measured = {
        "amplitude": scene.wave.amplitude,
        "phase": scene.wave.phase,
        "frequency": problem.mode.frequency,
        "switch_on": scene.envelope.ramp,
        "timestep": time.timestep,
        "sample": time.sample,
        "particles": scene.output.particles,
        "duration": time.duration,
        "Delta0": units.number(sphere.static_overlap, length=1),
        "R": units.number(sphere.radius, length=1),
        "t0": units.number(sphere.time_scale, time=1),
        "skin": units.number(sphere.radius / 10, length=1),
    }
    optional = _PARTICLES if all_seen else dict.fromkeys(_PARTICLES, "")
    numbers = {name: repr(value) for name, value in measured.items()}
    numbers |= _quiet_values(problem, units)
    return UNCALLED | selection.lines(problem.on) | plain | optional | numbers | _contact_values(problem, units)


def _quiet_values(problem: Problem, units: Units) -> dict[str, str]:
    """Return the numbers of the rows that absorb."""
    scene, end = problem.scene, quiet_end_of(problem.scene)
    if end is None:
        return {}
    row = scene.sphere.lattice_constant * scene.lattice.row_spacing
    inside = (scene.shape.rows - 1 - scene.shape.centre_row - end.rows - 1) * row  # of the last row without damping
    return {
        "quiet_rows": str(end.rows),
        "quiet_reflection": f"{end.reflection:.1e}",
        "quiet_side": quiet_side(scene),
        "quiet_from": repr(units.number(inside, length=1)),
        "quiet_thickness": repr(units.number(end.rows * row, length=1)),
        "quiet_strength": repr(end.strength),
        "quiet_power": repr(end.power),
        "quiet_turn": _QUIET_TURN if problem.on["rotation"] else "",
    }


def _contact_values(problem: Problem, units: Units) -> dict[str, str]:
    """Return the contact law of all effects together, and the reference forces of the guards."""
    scene, sphere, case = problem.scene, problem.scene.sphere, Case(problem.scene, problem.on)
    materials = problem.at_rest.materials
    weakest = sphere.pull_off_force if scene.perfect else float(case.contacts.adhesive_force.min())
    law: dict[str, Any] = {"friction": "${friction}"}
    for effect in selection.EFFECTS:
        law |= effect.law(scene, problem.on[effect.name])
    friction = scene.effects.friction
    centre_row = 1 + np.flatnonzero(problem.crystal.arrays["row"] == scene.shape.centre_row)
    return {
        "contact": contact.pairs(
            {
                (m, n): contact.model(equivalent(materials[m], materials[n]), units, **law)
                for m, n in combinations_with_replacement(range(len(materials)), 2)
            }
        ),
        "friction_given": repr(friction),
        "no_slip_friction": repr(case.no_slip_friction),
        "friction_limit": "v_friction" if friction == AUTO else repr(friction),
        "adhesive_force": repr(units.number(weakest, mass=1, length=1, time=-2)),
        "holding_force": repr(units.number(sphere.holding_force, mass=1, length=1, time=-2)),
        "shear_stiffness": repr(units.number(sphere.shear_stiffness, mass=1, time=-2)),
        "centre_row": f"{centre_row[0]}:{centre_row[-1]}",
    }


def _text(blocks: tuple[str, ...], values: Mapping[str, str]) -> str:
    return "\n\n".join(filled(block, values) for block in blocks) + "\n"


def filled(block: str, values: Mapping[str, str]) -> str:
    """Return a block with its ``<slots>`` replaced by lines, and the slots in these lines by numbers.

    A line that holds only empty slots is left out.
    """
    slot = re.compile(r"<(\w+)>")

    def fill(text: str) -> str:
        return slot.sub(lambda match: values[match[1]], text)

    filled_lines = [(line, fill(fill(line))) for line in block.split("\n")]
    return "\n".join(text for line, text in filled_lines if text.strip() or not line.strip())
