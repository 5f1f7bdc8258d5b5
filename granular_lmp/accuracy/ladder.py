"""First time step for a tolerance, from the frequencies of the wave.

Linear theory suffices for the first step: the error of velocity Verlet (`granular_lmp.accuracy.verlet`) is that of the
phase. Linear theory gives the frequency Ω of the wave and that of the free L wave of wave vector 2k, which is part of
the second harmonic; the error of the driven part, at 2Ω, is that of a wave of frequency 2^{1/3} Ω. The runs give an
estimate of the error and the next steps (`granular_lmp.accuracy.extrapolation`). A ladder that starts too coarse costs
one more run, at most half as long as the others; the tolerance is met either way.
"""

from granular_lmp.accuracy import collisions
from granular_lmp.accuracy.verlet import pair_error
from granular_lmp.crystal.modes import bloch_mode, highest_frequency
from granular_lmp.errors import SceneError
from granular_lmp.lammps.deck import Deck, deck_of
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.at_rest import swiftness
from granular_lmp.rest.linear import physics_of, unit_contacts
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.clock import RUNGS as RUNGS

__all__ = ["build"]

# E of the first two runs over the tolerance; a factor 4 larger or smaller costs more in 94 scenes (tests/hard)
COARSE = 16.0
MOST_STEPS = 10**9


def deciding_frequency(problem: Problem) -> float:
    """Return the highest frequency in the wave and its second harmonic by linear theory, in rad/t0."""
    scene, usual = problem.scene, problem.rest.frequency
    lattice, physics = unit_contacts(scene), physics_of(scene)
    if scene.wave_lattice.cell_size > 1 or scene.space == 3:  # the second harmonic may be of any branch
        free = highest_frequency(lattice, scene.sphere, physics) * swiftness(scene)
    else:
        free = bloch_mode(lattice, scene.sphere, scene.vector.doubled, "L", physics).frequency
    own = [each.top(scene.sphere, usual) for each in scene.drives]
    return max(2 ** (1 / 3) * max([usual, *own]), free)


def _count_of_wave(problem: Problem, tolerance: float) -> int:
    """Return the steps per sample of the first run of the ladder that should meet a tolerance in a wave."""
    time = problem.scene.time
    frequency, sample, duration = deciding_frequency(problem), time.sample, time.duration

    def enough(per_sample: int) -> bool:
        return pair_error(frequency, sample / (2 * per_sample), duration) <= COARSE * tolerance

    fewest = int(sample / min(rule.first for rule in problem.rest.step_rules())) + 1
    low, high = fewest - 1, fewest
    while not enough(high):
        low, high = high, 2 * high
        _refuse_many(problem, tolerance, high)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def build(scene: Scene) -> Deck:
    """Return the deck of a scene; no file is written.

    With a tolerance it is the deck of the finest planned run.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Deck
        `Deck.write` writes it into a folder, where plain ``lmp -in in.NAME`` runs it.

    Raises
    ------
    SceneError
        If effects contradict each other, or the time step is beyond the stability limit (`granular_lmp.problem`).

    Examples
    --------
    >>> deck = build(Scene.load("tr_periodic"))
    >>> deck
    <Deck tr_periodic: TR xi=0.785398 a=0.2, 48 spheres>
    """
    return deck_of(planned(prepare(scene)))


def plan(problem: Problem) -> tuple[int, ...]:
    """Return the steps per sample of each planned run of a problem as declared, from the first.

    Raises
    ------
    SceneError
        If the runs take more than 1e9 steps.
    """

    def first(tolerance: float) -> int:
        of_wave = problem.wave is not None
        count = _count_of_wave(problem, tolerance) if of_wave else collisions.first_count(problem, tolerance)
        _refuse_many(problem, tolerance, count)
        return count

    return problem.declared.time.clock.counts(first)


def planned(problem: Problem) -> Problem:
    """Return the problem of the last planned run, with its time step: the problem itself if there is no other."""
    counts = plan(problem)
    if len(counts) == 1:
        return problem
    return problem.stepped(problem.scene.time.sample / counts[-1])


def planned_steps(problem: Problem) -> int:
    """Return the number of time steps of a problem as declared, of its run or of all planned runs together."""
    return sum(plan(problem)) * problem.scene.time.samples


def sphere_steps(problem: Problem) -> float:
    """Return spheres times steps of all planned runs of a problem; the time is proportional to this."""
    return float(problem.scene.shape.spheres * planned_steps(problem))


def _refuse_many(problem: Problem, tolerance: float, first: int) -> None:
    """Raise SceneError if the planned runs take too many steps; `first` is steps per sample of the first run."""
    if first * ((1 << RUNGS) - 1) * problem.scene.time.samples > MOST_STEPS:
        raise SceneError(f"time.tolerance = {tolerance!r}: would take more than {MOST_STEPS} steps in this scene")
