"""Find pairs of waves that resonate, or the numbers of a scene that optimise a resonance, a gap or a whole run.

    granular-analysis design HERTZ [--second HERTZ] [--direction DEG ...] [--opening DEG ...] [spheres]
    granular-analysis design SCENE --vary KEY LOW HIGH [--vary ...] [--best growth|frequency|gap|passing] [--least]

For a frequency, the table lists the phase-matched pairs of waves, and the compression that each pair needs
(`granular_analysis.theory.partners`).

For a scene, a file or the name of a shipped one, the command finds the values of one or more keys that maximise

* growth: the growth rate of a second harmonic at its resonance along the direction of the scene;
* gap: the width of the gap above the branch ``--branch``, relative to its middle;
* passing: the share of the scene's wave that passes its rows of other densities;

or, for frequency, that place a resonance at ``--at`` hertz. ``--least`` minimises growth, gap or passing. Keys are
densities (``sphere.density``, ``inclusion.1.density``) and, except for passing, those in
`granular_analysis.theory.scenes.VARIED`. The result has exact derivatives (`granular_analysis.theory.variation`). ``-o
FILE`` writes the scene with the values found, and with the wave number nearest to the resonance that fits its rows.
"""

import argparse
import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.stepping import NetworkEngine
from granular_analysis.plotting import in_one_line, scene_of, write_scene
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.objectives import (
    POINTS,
    Found,
    Gap,
    Growth,
    Least,
    Objective,
    Passing,
    Tuned,
    best,
    candidates,
    grid,
    independent,
)
from granular_analysis.theory.partners import LARGEST, SILICA, design, table
from granular_analysis.theory.partners import Resonance as Resonance
from granular_analysis.theory.partners import compressed as compressed
from granular_analysis.theory.rows import Rows, heavy_rows
from granular_analysis.theory.scenes import CRYSTAL_KEYS, MOTION, VARIED, Setting
from granular_analysis.theory.variation import Resonance as Resonant
from granular_analysis.theory.variation import Spot, Value
from granular_lmp.cli.arguments import changes_argument, positive
from granular_lmp.runs.record import STATUS, Scene

Floats = NDArray[np.float64]

UNITS = {  # units of the properties of a sphere
    "radius": "m", "youngs_modulus": "Pa", "poisson_ratio": "NU", "work_of_adhesion": "J/m2", "density": "kg/m3"
}  # fmt: skip
OBJECTIVES = "second-harmonic, largest:MONITOR, motion:MONITOR or motion:MONITOR/OTHER"
GOALS = ("growth", "frequency", "gap", "passing")
# Keys that are refused for passing, whose rows must be one layer with equal contacts, in the plane
BEYOND_ROWS = {key for key in CRYSTAL_KEYS if key.startswith(("contact.", "substrate."))} | {
    f"packing.{name}" for name in ("space", "layers", "depth", "orientation")
}


@dataclass(frozen=True, eq=False)
class Question:
    """A question about a scene: which keys vary, and the quantity to optimise.

    Attributes
    ----------
    scene : scene with all other values.
    keys, bounds : the P varied keys, and the lower and upper bound of each.
    goal : one of `GOALS`.
    at : frequency that a resonance must have, Hz.
    branch : branch below the gap, from 1.
    points : number of values of each key on the grid from which the search starts.
    least : True to minimise the goal.

    Raises ValueError for unknown keys or wrong bounds, and for options that the goal does not allow.
    """

    scene: Scene
    keys: tuple[str, ...]
    bounds: tuple[tuple[float, float], ...]
    goal: str = "growth"
    at: float = 0.0
    branch: int = 1
    points: int = POINTS
    least: bool = False

    def __post_init__(self) -> None:
        known = [*VARIED, *(f"inclusion.{n}.density" for n in range(1, len(self.scene.inclusion) + 1))]
        for key, (low, high) in zip(self.keys, self.bounds, strict=True):
            if key not in known:
                raise ValueError(f"--vary {key}: must be one of {', '.join(known)}")
            if not -np.inf < low < high < np.inf:
                raise ValueError(f"--vary {key} {low:g} {high:g}: must be two finite numbers, the lower one first")
            for end in () if key == "wave.direction" else (low, high):
                self.scene.with_values({key: end})  # refuses values that the scene does not allow
        if self.goal == "frequency" and self.least:
            raise ValueError("--least: cannot be combined with --best frequency, which is a value to reach")
        if self.goal == "frequency" and not 0 < self.at < np.inf:
            raise ValueError(f"--at {self.at:g}: must be the frequency of the wave, above 0 Hz")
        if self.goal == "gap" and not 0 < self.branch < (count := len(self.place(self._low).crystal.mass) * 3):
            raise ValueError(f"--branch {self.branch}: must be from 1 to {count - 1}; the crystal has {count} branches")

    @property
    def _low(self) -> Floats:
        return np.array([low for low, _ in self.bounds])

    def place(self, values: NDArray[Any]) -> Spot:
        """Return the crystal with its units of wave number and amplitude, for values (P,) that may be complex."""
        return Setting(self.scene, dict(zip(self.keys, values, strict=True))).spot()

    def answer(self) -> "Answer":
        """Return the best values.

        Raises ValueError if the goal has no value anywhere between the bounds.
        """
        if self.goal == "gap":
            return self._best(Gap(self.place, self.branch - 1))
        if self.goal == "passing":
            return self._best(self.passing())
        found = candidates(self.place, self.bounds, self.points)
        if self.goal == "growth":
            chosen = (min if self.least else max)(found, key=lambda each: each.growth)
            return self._best(chosen.resonant, [chosen.values], chosen.resonant)
        wanted = 2 * np.pi * self.at
        near = min(found, key=lambda each: abs(each.frequency - wanted))
        return self._best(Tuned(near.resonant, wanted), [near.values], near.resonant)

    def _best(
        self, objective: Objective, starts: list[Floats] | None = None, resonant: Growth | None = None
    ) -> "Answer":
        asked = Least(objective) if self.least else objective
        found = best(asked, self.bounds, starts or grid(self.bounds, self.points))
        there = None if resonant is None else resonant.at(found.values)
        flat = independent(objective, self.bounds, found.values)
        return Answer(self, found, objective(found.values), flat, there)

    def passing(self) -> Passing:
        """Return the objective "passing": the share of the scene's wave that passes its rows of other densities.

        Raises ValueError for a key that is not a density, and for a wave or crystal that `heavy_rows` leaves out: rows
        with other radii or stiffnesses, measured stiffnesses, the third dimension, and spheres that do not turn.
        """
        scene, setting = self.scene, Setting(self.scene)
        setting.refuse(CRYSTAL_KEYS - MOTION - BEYOND_ROWS)
        if scene.packing.lattice != "hexagonal" or scene.direction != 90 or not scene.inclusion:
            raise ValueError("passing needs a wave along y and [[inclusion]] of rows in a hexagonal crystal")
        if other := [key for key in self.keys if not key.endswith(".density")]:
            raise ValueError(f"passing cannot vary {', '.join(other)}; vary densities")
        owners = np.zeros(scene.shape.rows, dtype=int)
        for number, each in enumerate(scene.inclusion, 1):
            differs = sorted(name for name, value in vars(each).items() if value != getattr(type(each)(), name))
            if {*differs} - {"every"} != {"rows", "density"}:
                raise ValueError(f"passing: inclusion {number} must have rows and density, not {', '.join(differs)}")
            first, last = each.rows
            owners[first : last + 1 : each.every] = number
        owners = np.trim_zeros(owners)
        turns = {name: getattr(scene.effects, name) is not False for name in ("shear", "rotation")}
        contact = Contact.of(scene.sphere, **turns)
        names = ["sphere.density", *(f"inclusion.{n}.density" for n in range(1, len(scene.inclusion) + 1))]
        given = dict(zip(names, [scene.sphere.density, *(each.density for each in scene.inclusion)], strict=True))

        def rows(values: Floats) -> tuple[Rows, Floats]:
            now = given | dict(zip(self.keys, values, strict=True))
            masses = np.array([now[name] for name in names])[owners] / now["sphere.density"]
            # Masses are relative to the mass of the host's spheres
            own = [owners == names.index(key) if names.index(key) else -(owners > 0).astype(float) for key in self.keys]
            changes = [np.pad(mine / value, 2) for mine, value in zip(own, values, strict=True)]
            return heavy_rows(contact, masses.tolist()), np.array(changes)

        rows(np.array(self.bounds)[:, 0])  # raises for rows that are left out, which the search would skip silently
        return Passing(rows, float(setting.mode().frequency) * scene.sphere.time_scale, scene.require_wave().mode)


@dataclass(frozen=True, eq=False)
class Answer:
    """The best values of a question.

    Attributes
    ----------
    question : the question.
    found : the best values, and the best point of the grid.
    goal : value of the goal at the best values, with its derivatives.
    flat : (P,) True for a key on which the goal does not depend at all.
    resonance : resonance at the best values; None for "gap" and "passing".
    """

    question: Question
    found: Found
    goal: Value
    flat: list[bool]
    resonance: Resonant | None

    @property
    def scene(self) -> Scene:
        """Return the scene with the best values and, for a resonance, its wave number."""
        values = dict(zip(self.question.keys, map(float, self.found.values), strict=True))
        tuned = {"wave.wavenumber": self.resonance.wavenumber.value} if self.resonance else {}
        return self.question.scene.with_values(values | tuned)

    def text(self) -> str:
        """Return the answer as text, a line for each key and one for the goal."""
        asked = self.question
        lines = [f"{'key':26}{'best':>12}{'from':>12}{'to':>12}  d {asked.goal} / d ln"]
        for key, value, (low, high), slope, flat in zip(
            asked.keys, self.found.values, asked.bounds, self.goal.gradient, self.flat, strict=True
        ):
            said = f"0: {asked.goal} does not depend on it" if flat else f"{slope * value:.2g}"
            lines.append(f"{key:26}{value:12.6g}{low:12.6g}{high:12.6g}  {said}")
        of_grid = -self.found.of_grid if asked.least else self.found.of_grid
        last = f"{asked.goal} is {self.goal.value:.6g}; {of_grid:.6g} at the best point of the grid"
        if self.resonance is not None:
            at = self.resonance
            x, omega, growth = at.wavenumber.value, at.frequency.value, at.growth.value
            last = (
                f"the second harmonic gains {growth:.5g} D0 a period per a, at the resonance xi = {x:.6f}, "
                f"{omega / 2 / np.pi:.6g} Hz"
            )
        return "\n".join([*lines, last])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status, 1 if nothing resonates."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    searched = any(word.partition("=")[0] == "--maximize" for word in words)
    command = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    command.add_argument(
        "what", metavar="HERTZ_OR_SCENE", help="frequency of the first wave; or a scene, a file or a shipped one"
    )
    pairs = command.add_argument_group("two waves")
    pairs.add_argument(
        "--second", type=float, metavar="HERTZ", help="frequency of the second wave (default: same as the first)"
    )
    pairs.add_argument(
        "--direction", type=float, nargs="+", default=[90.0, 0.0], metavar="DEG",
        help="directions of the first wave, from a close-packed row (default: 90 0)",
    )  # fmt: skip
    pairs.add_argument(
        "--opening", type=float, nargs="+", default=[0.0, 60.0, 90.0, 120.0, 180.0], metavar="DEG",
        help="angles from the first wave to the second (default: 0 60 90 120 180)",
    )  # fmt: skip
    pairs.add_argument(
        "--amplitude", type=float, default=0.1, metavar="A", help="amplitude of both waves, D0/Delta0 (default: 0.1)"
    )
    for name, unit_of in UNITS.items():
        default = getattr(SILICA, name)
        pairs.add_argument(
            f"--{name.replace('_', '-')}", type=float, default=default, metavar=unit_of, help=f"default: {default:g}"
        )
    scene = command.add_argument_group("a scene")
    scene.add_argument(
        "--vary",
        nargs=1 if searched else 3,
        action="append",
        metavar="KEY" if searched else ("KEY", "LOW", "HIGH"),
        help="key of the scene to vary, with its bounds; with --maximize the word density",
    )
    scene.add_argument(
        "--best",
        choices=GOALS,
        default="growth",
        help="quantity to maximise; frequency: to reach --at (default: growth)",
    )
    scene.add_argument("--least", action="store_true", help="minimise instead of maximise")
    scene.add_argument("--at", type=float, default=0.0, metavar="HERTZ", help="frequency of the wave that resonates")
    scene.add_argument(
        "--branch", type=int, default=1, metavar="N", help="branch below the gap, from 1 for the lowest (default: 1)"
    )
    scene.add_argument(
        "--points", type=int, default=POINTS, metavar="N", help=f"values of each key on the grid (default: {POINTS})"
    )
    scene.add_argument("-o", "--output", metavar="FILE", help="write the scene with the best values")
    changes_argument(scene, "sphere.poisson_ratio=0.3")
    runs = _options_of_runs(command)
    chosen = command.parse_args(words)
    if searched:
        _refuse(command, chosen, pairs, "two frequencies, not for whole runs")
        _refuse(command, chosen, scene, "a goal of second order, not for --maximize", {"vary", "output", "changes"})
        return _of_runs(command, chosen)
    _refuse(command, chosen, runs, "a search in whole runs, with --maximize")
    try:
        frequency = float(chosen.what)
    except ValueError:
        _refuse(command, chosen, pairs, "two frequencies, not for a scene")
        for name, goal in (("at", "frequency"), ("branch", "gap")):
            if getattr(chosen, name) != scene.get_default(name) and chosen.best != goal:
                command.error(f"--{name} is for --best {goal}, not for {chosen.best}")
        return _of_scene(command, chosen)
    _refuse(command, chosen, scene, "a scene, not for a frequency")
    return _of_frequency(command, chosen, frequency)


def _options_of_runs(command: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options of a search in whole runs."""
    runs = command.add_argument_group("whole runs")
    runs.add_argument("--maximize", metavar="OBJECTIVE", help=f"quantity of a run to maximise: {OBJECTIVES}")
    runs.add_argument(
        "--within",
        nargs=2,
        type=float,
        metavar=("LOW", "HIGH"),
        help="bounds of the densities, over the density in the scene",
    )
    runs.add_argument(
        "--per", default="sphere", metavar="sphere|row|RxC",
        help="one density for each sphere, row, or place of a cell of R rows and C columns (default: sphere)",
    )  # fmt: skip
    runs.add_argument("--same-mass", action="store_true", help="keep the mean density")
    runs.add_argument(
        "--robust", type=float, default=0.0, metavar="SHARE",
        help="maximise the mean over crystals whose densities have random errors of this relative standard deviation",
    )  # fmt: skip
    runs.add_argument("--seeds", type=positive, default=1, metavar="N", help="number of such crystals (default: 1)")
    runs.add_argument("--start", type=int, default=1, metavar="SEED", help="seed of the first densities (default: 1)")
    runs.add_argument(
        "--evaluations",
        type=positive,
        default=100,
        metavar="N",
        help="largest number of runs with gradients (default: 100)",
    )
    runs.add_argument("--device", choices=["jax", "gpu"], default="jax", help="all cores, or a GPU (default: jax)")
    runs.add_argument("--opposite", metavar="RUN", help="the run that starts with the opposite sign, if one is needed")
    return runs


def _of_runs(command: argparse.ArgumentParser, chosen: argparse.Namespace) -> int:
    """Search densities in whole runs, or print the objective of runs."""
    ran = (Path(chosen.what) / STATUS).is_file()
    if ran and (chosen.vary or chosen.within or chosen.output):
        command.error(f"{chosen.what}: is a run, whose objective is printed; give a scene to search its densities")
    if not ran and chosen.opposite:
        command.error("--opposite is for a run")
    if not ran and [name for (name,) in chosen.vary or []] != ["density"]:
        command.error("--maximize: needs --vary density; nothing else can vary in whole runs")
    if not ran and not (chosen.within and chosen.output):
        command.error("--maximize: needs --within LOW HIGH, and -o DIR for the result")
    with in_one_line():
        NetworkEngine.on(chosen.device)  # raises if JAX is missing
    from granular_analysis.tools.design_runs import read, search  # needs JAX

    return read(chosen) if ran else search(chosen)


def _refuse(
    command: argparse.ArgumentParser,
    chosen: argparse.Namespace,
    group: argparse._ArgumentGroup,
    whose: str,
    but: Collection[str] = (),
) -> None:
    """Exit if an option of a group was given, unless its name is in `but`."""
    for action in group._group_actions:
        if action.dest not in but and getattr(chosen, action.dest) != action.default:
            command.error(f"{action.option_strings[0]} is for {whose}")


def _of_frequency(command: argparse.ArgumentParser, chosen: argparse.Namespace, frequency: float) -> int:
    """Print the resonances of two frequencies."""
    if not 0 < chosen.amplitude < 1:
        command.error(f"--amplitude {chosen.amplitude}: must be above 0 and below 1, at which contacts open")
    try:
        sphere = replace(SILICA, **{name: getattr(chosen, name) for name in UNITS})
        found = design(sphere, frequency, chosen.second, chosen.direction, chosen.opening)
    except ValueError as error:
        command.error(str(error))
    print(table(found, chosen.amplitude) if found else f"no pair is phase-matched with eta below {LARGEST:g}")
    return 0 if found else 1


def _of_scene(command: argparse.ArgumentParser, chosen: argparse.Namespace) -> int:
    """Print the best values of a scene, and write the scene with them."""
    if not chosen.vary:
        command.error(f"{chosen.what}: a scene needs --vary KEY LOW HIGH; a frequency is a number")
    if not 2 <= chosen.points <= 50:
        command.error(f"--points {chosen.points}: must be from 2 to 50")
    with in_one_line(chosen.what):
        bounds = tuple((float(low), float(high)) for _, low, high in chosen.vary)
        keys = tuple(key for key, *_ in chosen.vary)
        asked = chosen.best, chosen.at, chosen.branch, chosen.points, chosen.least
        question = Question(scene_of(chosen.what, chosen), keys, bounds, *asked)
        answer = question.answer()
        print(answer.text())
        if chosen.output:
            write_scene(Path(chosen.output), answer.scene)
    return 0
