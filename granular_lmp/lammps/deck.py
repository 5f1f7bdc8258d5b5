"""LAMMPS deck of a scene: ``in.NAME`` and ``data.NAME``.

The deck is complete: it runs with plain ``lmp -in in.NAME`` in its folder. Values that can change without a new lattice
are index variables, which ``-var`` overrides. The text is a list of blocks (`BLOCKS`), each a function of the problem
in the module of its subject.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import ase

from granular_lmp.card import HasCard
from granular_lmp.effects import openings
from granular_lmp.frozen import dataclass
from granular_lmp.lammps import (
    ends,
    guards,
    laws,
    monitors,
    motion,
    recording,
    replicated,
    sources,
    spheres,
    start,
    strikes,
    variables,
)
from granular_lmp.lammps.blocks import Block, text_of
from granular_lmp.lammps.datafile import DataFile, differences
from granular_lmp.lammps.edits import differing_lines, places, with_lines
from granular_lmp.lammps.outputs import SCENE, write_deck
from granular_lmp.problem import Problem
from granular_lmp.rest.holding import AT_REST, LOOSE
from granular_lmp.rest.scene import Scene

__all__ = ["Deck"]

# in order
BLOCKS_AT_REST = (
    Block(variables.heading, again=variables.continues),
    Block(variables.variables),
    Block(variables.units),
    Block(spheres.spheres, again=spheres.restarted),
    Block(laws.contacts),
    Block(openings.begin, again=False),
    Block(start.preload, again=start.reference),
    Block(start.begin, again=start.kept_field),
    Block(strikes.strikers, again=False),
    Block(sources.driven_row),
    Block(sources.sources),
    Block(ends.loads),
    Block(motion.motion),
    Block(guards.guards, again=guards.guards),
    Block(recording.record, again=recording.record),
    Block(monitors.monitors, again=monitors.monitors),
    Block(recording.run, again=recording.run),
)
# for spheres that meet, which nothing holds at rest
BLOCKS_OF_MEETING = (
    Block(variables.heading, again=variables.continues),
    Block(variables.variables),
    Block(spheres.spheres_of_meeting, again=spheres.restarted_of_meeting),
    Block(laws.contacts_of_meeting),
    Block(start.preload_of_meeting, again=start.reference_of_meeting),
    Block(start.begin, again=start.kept_field),
    Block(strikes.strikers, again=False),
    Block(ends.loads),
    Block(motion.motion_of_meeting),
    Block(guards.guards_of_meeting, again=guards.guards_of_meeting),
    Block(recording.record, again=recording.record),
    Block(monitors.monitors, again=monitors.monitors),
    Block(recording.run_of_meeting, again=recording.run_of_meeting),
)
BLOCKS = {AT_REST: BLOCKS_AT_REST, LOOSE: BLOCKS_OF_MEETING}


@dataclass(frozen=True, repr=False)
class Deck(HasCard):
    """LAMMPS deck, with the problem that it was made from.

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
    To change the deck, use ``dataclasses.replace(deck, input_text=...)``, or ``data=...``; `granular_lmp.run` accepts
    it.

    Examples
    --------
    >>> deck = build(Scene.load("tr_periodic"))
    >>> deck.write("decks/periodic")
    >>> sorted(path.name for path in Path("decks/periodic").iterdir())
    ['data.tr_periodic', 'in.tr_periodic', 'scene.toml']
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
        return self.problem.rest.atoms

    @property
    def input_name(self) -> str:
        """File name of the input, ``in.NAME``."""
        return f"in.{self.scene.name}"

    @property
    def data_name(self) -> str:
        """File name of the data, ``data.NAME``."""
        return f"data.{self.scene.name}"

    def files(self) -> dict[str, Iterable[str]]:
        """Return name → text, in pieces, of the three files of a deck folder and of a table of spheres, if any."""
        title = variables.data_title(self.problem)
        return {
            SCENE: [self.declared.to_toml()],
            **self.declared.beside,
            self.input_name: [self.input_text],
            self.data_name: self.data.pieces(title),
        }

    def edited(self, *, before: Mapping[str, str] | None = None, after: Mapping[str, str] | None = None) -> "Deck":
        """Return the deck with additional lines before or after named blocks; `places` lists the names.

        The ``run.json`` of its run lists the lines that differ, and the run cannot be resumed.

        Raises
        ------
        DeckError
            If the deck has no such place; the text lists its places.
        """
        return replace(self, input_text=with_lines(self.input_text, before or {}, after or {}))

    @property
    def places(self) -> list[str]:
        """Names of the blocks of ``in.NAME``, in order, for `edited`."""
        return list(places(self.input_text))

    def edits(self) -> list[str]:
        """Return the lines of ``in.NAME`` that differ from the deck of this package, "+ ..." or "- ..."."""
        return differing_lines(written_text(self.problem), self.input_text)

    def all_edits(self) -> list[str]:
        """Return `edits`, and the first value that differs in each column of ``data.NAME``, as in ``run.json``."""
        data = differences(data_of(self.problem), self.data)
        return self.edits() + [f"{line[:2]}{self.data_name}: {line[2:]}" for line in data]

    def __repr__(self) -> str:
        edited = ", edited" if self.edits() else ""
        return f"<Deck {self.scene.name}: {self.scene.label}, {len(self.packing)} spheres{edited}>"

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


def deck_of(problem: Problem) -> Deck:
    """Return the deck of a problem; no file is written.

    A wave starts as a Bloch mode of the simulated lattice, so no other mode is excited to first order in the amplitude.
    LAMMPS makes large sheets from their first rows (`granular_lmp.lammps.replicated`).

    Raises
    ------
    SceneError
        If the scene has a tolerance and no time step; `granular_lmp.accuracy.ladder.build` chooses one.
    """
    return Deck(problem, written_text(problem), data_of(problem))


def data_of(problem: Problem) -> DataFile:
    """Return ``data.NAME`` of a problem as this package writes it."""
    return replicated.first_rows(problem) if replicated.suits(problem) else spheres.data_of(problem)


def written_text(problem: Problem) -> str:
    """Return ``in.NAME`` of a problem as this package writes it."""
    return text_of(block.lines(problem) for block in _blocks(problem))


def resume_text(problem: Problem, checkpoint: str) -> str:
    """Return the input that continues a run from a checkpoint, with the same bytes as an uninterrupted run.

    The input repeats pair coefficients, ``comm_modify`` and ``compute displace/atom``: a restart file of LAMMPS lacks
    the former two, and LAMMPS finds the reference positions by the name of the compute.
    https://docs.lammps.org/Howto_restart.html
    """
    return text_of(block.continued(problem, checkpoint) for block in _blocks(problem))


def _blocks(problem: Problem) -> tuple[Block, ...]:
    return BLOCKS[problem.scene.holding]
