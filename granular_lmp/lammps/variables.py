"""Head of a deck: its title, the variables that ``-var`` overrides, its units and its clock."""

from granular_lmp.effects import selection
from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.checkpoints import checkpoint_steps
from granular_lmp.lammps.outputs import DUMP, LOG, SNAPSHOTS
from granular_lmp.problem import Problem
from granular_lmp.scene.schema import cut

# Names that a user may try with -var, which would be ignored
NO_VARIABLES = ("xi", "mode", "rows", "columns", "amp")
_SAID = "granular-lmp variables: "


def title(problem: Problem) -> str:
    """Return name, wave or strikers, size and ends of a scene in one line."""
    scene = problem.scene
    if scene.wave is None:
        return f"{scene.name}: {scene.words}"
    shape = scene.shape
    differing = f"; not perfect: {scene.imperfections}" if scene.imperfections else ""
    return f"{scene.name}: {scene.words}, {shape.words}, {shape.cut}{differing}"


def data_title(problem: Problem) -> str:
    """Return the first line of the data file."""
    return f"{title(problem)}; {problem.units.title}"


def heading(problem: Problem) -> list[str]:
    """Return the comment lines on what a deck is and how to run it."""
    scene = problem.scene
    values = "-var amplitude 0.1 -var timestep 0.025" if problem.wave else "-var timestep 0.01"
    return [
        f"# {title(problem)}",
        f"# Run in this folder:  lmp -in in.{scene.name}; with other values:  lmp -in in.{scene.name} {values}",
        *(["# Needs LAMMPS with the packages GRANULAR and BPM"] if scene.space == 3 else []),
    ]


def continues(problem: Problem, checkpoint: str) -> list[str]:
    """Return the head of the input that continues from a checkpoint."""
    return [f"# {title(problem)}: continues from {checkpoint}", f"log {LOG} append"]


def variables(problem: Problem) -> list[str]:
    """Return the variables that may be overridden, and the clock if the unit of time is 1."""
    time, name, wave = problem.scene.time, problem.scene.name, problem.scene.wave
    tau, dump = ("t0", SNAPSHOTS) if wave is None else ("tau", DUMP)
    values = [
        *([("amplitude", wave.amplitude, "D0/Delta0")] if wave else []),
        ("timestep", time.timestep, f"{tau}; rounded down to fit a whole number of steps into a sample"),
        ("sample", time.sample, f"{tau} between records"),
        ("duration", time.duration, tau),
    ]
    files = {"data": f"data.{name}", "dump": dump}
    width = 9 if wave else 8
    return [
        "# --- variables: only these may be overridden, with -var NAME VALUE",
        *(f"variable {key:{width}} index {value!r}  # {words}" for key, value, words in values),
        *(_ramp(problem) if wave else []),
        *selection.lines("variables", problem),
        *(f"variable {key:{width}} index {value}" for key, value in files.items()),
        *(_snapshots(problem) if wave else []),
        f"variable checkpoint index {checkpoint_steps(problem)}  # steps between checkpoints, here for one core",
        *([_refusal(), f'print "{_said(problem)}"'] if wave else []),
        *(clock(problem) if problem.units.own else []),
    ]


def _ramp(problem: Problem) -> list[str]:
    if not problem.scene.form.driven:
        return []
    return [f"variable ramp      index {problem.scene.envelope.ramp!r}  # tau in which the first row is switched on"]


def _snapshots(problem: Problem) -> list[str]:
    if not problem.scene.output.particles:
        return []
    return [
        f"variable particles index {problem.scene.output.particles!r}  # tau between snapshots of all spheres",
        f"variable snapshots index {SNAPSHOTS}",
    ]


def _refusal() -> str:
    """Return the line that ends a run with a variable that the deck does not have."""
    tried = " || ".join(f"is_defined(variable,{name})" for name in NO_VARIABLES)
    names = " or ".join(NO_VARIABLES)
    said = f"ERROR: this deck has no variable {names}; build another deck"
    return f'if "$({tried})" then "print \'{said}\'" "quit 1"'


def _said(problem: Problem) -> str:
    """Return the line that prints the variables, so that the log of a run holds their values after -var."""
    scene = problem.scene
    optional = {
        "friction": bool(selection.lines("variables", problem)),
        "ramp": scene.form.driven,
        "particles": scene.output.particles > 0,
    }
    names = ["amplitude", "timestep", "sample", "duration", "dump", *(name for name in optional if optional[name])]
    return _SAID + " ".join(f"{name}=${{{name}}}" for name in names)


def said_variables(log: str) -> dict[str, str] | None:
    """Return the variables in the log of a run, name → value; None if the log has none.

    Raises
    ------
    RunFolderError
        If a word among them is not NAME=VALUE.
    """
    lines = [line for line in log.splitlines() if line.startswith(_SAID)]
    if not lines:
        return None
    said = {}
    for word in lines[-1].removeprefix(_SAID).split():
        name, equals, value = word.partition("=")
        if not (name and equals and value):
            raise RunFolderError(f"{LOG}: says {cut(word)!r} among its variables: must be NAME=VALUE")
        said[name] = value
    return said


def units(problem: Problem) -> list[str]:
    """Return the lengths and times of the scene in units of the deck, and the clock; [] for a deck with own units."""
    of, scale = problem.units, problem.scene.scale
    if of.own:
        return []
    overlap = "static overlap" if problem.scene.wave else "unit of overlaps and displacements"
    return [
        f"# --- units {of.style}: {of.names}",
        f"variable Delta0 equal {of.number(scale.length, length=1)!r}  # {overlap}",
        f"variable R      equal {of.number(problem.scene.sphere.radius, length=1)!r}  # radius",
        f"variable t0     equal {of.number(scale.time, time=1)!r}  # one tau",
        f"variable D0     equal {'v_amplitude*' if problem.scene.wave else ''}v_Delta0",
        *clock(problem),
    ]


def clock(problem: Problem) -> list[str]:
    """Return the variables of steps and time; t0 is 1 if the deck has the units of the scene."""
    width, step, tau = 6, "$(v_sample/v_every*v_t0:%.17g)", "step*v_step/v_t0"
    if problem.units.own:
        width, step, tau = 8, "v_sample/v_every", "step*v_step"
    return [
        f"variable {'every':{width}} equal ceil(v_sample/v_timestep-1e-9)",
        f"variable {'step':{width}} equal {step}",
        f"variable {'steps':{width}} equal v_every*floor(v_duration/v_sample+1e-9)",
        f"variable {'tau':{width}} equal {tau}",
    ]
