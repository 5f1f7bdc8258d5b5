"""The LAMMPS deck of a scene: ``in.NAME`` and ``data.NAME``.

The deck is complete: it runs with plain ``lmp -in in.NAME`` in its folder. Values that can change without a new lattice
are index variables, which ``-var`` overrides. Its text is that of `granular_lmp.lammps.blocks`, filled with the numbers
of a problem and the lines of its effects.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.card import HasCard
from granular_lmp.crystal.contacts import equivalent
from granular_lmp.crystal.lattices import centre
from granular_lmp.effects import selection
from granular_lmp.effects.effect import Case
from granular_lmp.lammps import blocks, contact, guards, monitors, openings, replicated, sources, strikes
from granular_lmp.lammps.binary_dump import CONTINUED
from granular_lmp.lammps.checkpoints import minutes_between, steps_between
from granular_lmp.lammps.datafile import DataFile
from granular_lmp.lammps.edits import differing_lines, places, with_lines
from granular_lmp.lammps.outputs import CHECKPOINTS, DUMP, LOG, SCENE, SNAPSHOTS, write_deck
from granular_lmp.problem import Problem
from granular_lmp.scene.absorption import quiet_end_of, quiet_side
from granular_lmp.scene.initial_fields import initial_fields
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import AUTO
from granular_lmp.units import Units, units_for


@dataclass(frozen=True, repr=False)
class Deck(HasCard):
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
        return list(places(self.input_text))

    def edits(self) -> list[str]:
        """Return the lines of ``in.NAME`` that differ from those that this package writes, "+ ..." or "- ..."."""
        return differing_lines(written_text(self.problem), self.input_text)

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
        write_deck(folder, self.files(), force=force)


def deck_of(problem: Problem, *, all_spheres: bool = False) -> Deck:
    """Return the deck of a problem; no file is written.

    The wave starts as a Bloch mode of the lattice that LAMMPS simulates, so that no other mode is excited at first
    order in the amplitude.

    Parameters
    ----------
    problem : Problem
    all_spheres : bool
        Write every sphere and its part of the wave into the data file, also of a large sheet that LAMMPS could make
        from its first rows (`granular_lmp.lammps.replicated`).

    Raises
    ------
    SceneError
        If the scene has a tolerance and no time step; `granular_lmp.accuracy.ladder.build` chooses one.
    """
    units = units_for(problem.scene.sphere.radius)
    if all_spheres or not replicated.suits(problem.scene):
        return Deck(problem, _text(problem, units, blocks.READ), _data(problem, units))
    return Deck(problem, written_text(problem), replicated.first_rows(problem, units))


def written_text(problem: Problem) -> str:
    """Return ``in.NAME`` of a problem as this package writes it."""
    units = units_for(problem.scene.sphere.radius)
    made = replicated.suits(problem.scene)
    return _text(problem, units, replicated.slots(problem, units) if made else blocks.READ)


def _text(problem: Problem, units: Units, spheres: dict[str, str]) -> str:
    """Return ``in.NAME``; `spheres` are the slots whose lines read the spheres and their wave, or make them."""
    return blocks.filled_text(blocks.written(problem.scene), _values(problem, units) | spheres)


def _title(scene: Scene) -> str:
    shape = scene.shape
    differing = f"; not perfect: {scene.imperfections}" if scene.imperfections else ""
    return f"{scene.name}: {scene.wave_words}, {shape.words}, {shape.cut}{differing}"


def _data(problem: Problem, units: Units) -> DataFile:
    scene, packing = problem.scene, problem.crystal
    to_deck = units.number(scene.sphere.radius, length=1)
    low = packing.get_celldisp().ravel() * to_deck
    size = packing.cell.lengths() * to_deck
    fields = initial_fields(scene, packing, problem.mode)
    for source in problem.sources:
        if source.source.motion:
            fields.displacement[source.spheres] = fields.velocity[source.spheres] = 0.0
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
        wave=np.hstack(
            [
                *(part[:, moving].round(13) + 0.0 for part in (fields.displacement, fields.velocity)),  # no minus zeros
                strikes.state_columns(problem, units),
            ]
        ),
        directed=scene.effects.tracking is True,
    )


def types(packing: ase.Atoms) -> NDArray[np.int64]:
    """Return the LAMMPS types of spheres: 2m + 1 for the free ones of material m, 2m + 2 for those that are held."""
    material = packing.arrays.get("material", np.zeros(len(packing), dtype=int))
    return 2 * material + np.where(packing.arrays["fixed"], 2, 1)


def checkpoint_steps(scene: Scene, ranks: int = 1) -> int:
    """Return the steps between two checkpoints of a scene."""
    return steps_between(scene.output.checkpoint, scene.shape.spheres, guards.line_interval(scene), ranks)


def resume_text(deck: Deck, checkpoint: str) -> str:
    """Return the input that continues a run of `deck` from a checkpoint, to the same bytes as an uninterrupted run.

    A restart file of LAMMPS holds neither pair coefficients nor ``comm_modify``, and LAMMPS finds the reference
    positions of ``compute displace/atom`` by its name, so the input repeats these commands.
    https://docs.lammps.org/Howto_restart.html
    """
    values = _values(deck.problem, units_for(deck.scene.sphere.radius))
    return blocks.filled_text(
        blocks.resumed(deck.scene),
        values | {"from": checkpoint, "log": LOG, "append": " append yes", "continued": CONTINUED},
    )


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
        "field": blocks.FIELD,
        "ramp": blocks.RAMP if scene.wave.form == "driven" else "",
        "sources": sources.lines(problem, units),
        "strikers": strikes.lines(problem, units),
        "monitors": monitors.lines(problem),
        "invalid": guards.header(problem.judged, scene),
        "at_rest": "\n".join(openings.at_rest_lines(scene)),
        "begin": openings.begin_block(scene),
        "guards": "\n".join(guards.lines(problem.guards, scene, problem.left_out)),
        "append": "",
        "continued": "",
        "refused": "$(" + " || ".join(f"is_defined(variable,{name})" for name in blocks.NO_VARIABLES) + ")",
        "names": " or ".join(blocks.NO_VARIABLES),
        "said": blocks.variables_line(scene, selection.lines(problem.on)),
        "dump": DUMP,
        "snapshots": SNAPSHOTS,
        "seen": "all" if all_seen or scene.monitor else "centre",
        "checkpoint": f"{minutes_between(scene.output.checkpoint, scene.shape.spheres):.3g}",
        "checkpoint_steps": str(checkpoint_steps(scene)),
        "checkpoints": " ".join(CHECKPOINTS),
        "along_x": _boundary(scene.shape.along_x, "sides" in scene.shape.free),
        "along_y": _boundary(scene.shape.along_y, {"first", "last"} & {*scene.shape.free}),
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
        "Delta0": units.number(scene.scale.length, length=1),
        "R": units.number(sphere.radius, length=1),
        "t0": units.number(scene.scale.time, time=1),
        "skin": units.number(sphere.radius / 10, length=1),
    }
    optional = blocks.PARTICLES if all_seen else dict.fromkeys(blocks.PARTICLES, "")
    numbers = {name: repr(value) for name, value in measured.items()}
    numbers |= _quiet_values(problem, units)
    begun = strikes.slots(problem)
    return (
        blocks.UNCALLED
        | selection.lines(problem.on)
        | plain
        | begun
        | optional
        | numbers
        | _contact_values(problem, units)
    )


def _boundary(periodic: bool, free: object) -> str:
    """Return the word for the faces of the box along an axis: the box follows spheres at a free face, which may fly."""
    return "p" if periodic else "m" if free else "f"


def _quiet_values(problem: Problem, units: Units) -> dict[str, str]:
    """Return the numbers of the rows that absorb."""
    scene, end = problem.scene, quiet_end_of(problem.scene)
    if end is None:
        return {}
    row = scene.lattice.row_distance(scene.sphere.lattice_constant)
    inside = (scene.shape.rows - 1 - scene.shape.centre_row - end.rows - 1) * row  # to the last row without damping
    return {
        "quiet_rows": str(end.rows),
        "quiet_reflection": f"{end.reflection:.1e}",
        "quiet_side": quiet_side(scene),
        "quiet_from": repr(units.number(inside, length=1)),
        "quiet_row": repr(units.number(row, length=1)),
        "quiet_strength": repr(end.strength),
        "quiet_power": repr(end.power),
    } | (blocks.QUIET_TURN if problem.on["rotation"] else {})


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
        "largest_amplitude": f"(v_amplitude+{case.struck_amplitude!r})" if scene.struck else "v_amplitude",
        "friction_limit": "v_friction" if friction == AUTO else repr(friction),
        "adhesive_force": repr(units.number(weakest, mass=1, length=1, time=-2)),
        "hold": repr(case.hold),
        "nearly_open": f"{guards.nearly_open(scene):.4f}",
        "or_nearly": "" if guards.OPEN.per_contact(scene) else f"+({guards.nearly_open(scene):.4f}>v_overlap_looks)",
        "dashpot": repr(units.number(case.strongest_dashpot, mass=1, time=-1)),
        "pressed": repr(sphere.holding_force / sphere.pull_off_force if sphere.pull_off_force else 0.0),
        "unpressed_overlap": repr(sphere.unpressed_overlap / sphere.static_overlap),
        "holding_force": repr(units.number(sphere.holding_force, mass=1, length=1, time=-2)),
        "shear_stiffness": repr(units.number(sphere.shear_stiffness, mass=1, time=-2)),
        "centre_row": f"{centre_row[0]}:{centre_row[-1]}",
    }
