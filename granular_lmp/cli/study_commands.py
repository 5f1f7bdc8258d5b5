"""Commands for many runs, or runs of another kind: sweep, scatter, cost, kick, collide."""

import argparse
from math import inf
from typing import Any

from granular_lmp.cli.arguments import (
    Commands,
    Options,
    add,
    changes_argument,
    changes_of,
    folder_arguments,
    kernel_argument,
    positive,
    scene_arguments,
    scene_of,
    wave_scene_of,
)
from granular_lmp.cli.output import interruptible, remark, say


def add_to(commands: Commands) -> None:
    """Add these commands to the parser."""
    sweep = add(
        commands,
        "sweep",
        _sweep,
        "run a scene with every combination of some values; the same command continues a stopped sweep",
    )
    scene_arguments(sweep)
    sweep_arguments(sweep, "-m granular_lmp sweep ...", required=True)
    folder_arguments(sweep, "sweep folder (default: sweeps/NAME)")
    kernel_argument(sweep)

    scatter = add(
        commands,
        "scatter",
        _scatter,
        "run a scene with and without its inclusions, to find the transmitted and reflected waves",
    )
    scene_arguments(scatter)
    folder_arguments(scatter, "study folder (default: scatter/NAME)")
    scatter.add_argument(
        "--tones", type=positive, default=0, metavar="N", help="frequencies of a burst that also run as tones"
    )

    kernel_argument(scatter)

    cost = add(commands, "cost", _cost, "measure the error and the time of each setting of a run")
    scene_arguments(cost)
    cost.add_argument("-o", "--output", metavar="DIR", help="study folder (default: costs/NAME)")
    cost.add_argument("--repeats", type=positive, metavar="N", help="rounds (default: 5)")
    cost.add_argument(
        "--budget",
        type=_seconds,
        metavar="SECONDS",
        help="start no run after this time; the same command continues, with a new budget",
    )
    cost.add_argument(
        "--accuracy",
        type=_accuracy,
        metavar="ERROR",
        help="print the fastest setting with this relative error, for instance 0.01, and its options",
    )

    kernel_argument(cost)

    collide = add(
        commands, "collide", _collide, "let two spheres, or a sphere and a plane, collide, to test one contact"
    )
    collide.add_argument("scene", metavar="SCENE", help="TOML file, or the name of a collision of `granular-lmp list`")
    changes_argument(collide, "collision.spin=100")
    folder_arguments(collide, "run folder (default: runs/NAME)")
    kernel_argument(collide)


def sweep_arguments(parser: argparse.ArgumentParser, program: str, *, required: bool = False) -> None:
    """Add ``--over`` and ``--workers``; `sweep_of` reads them. `program` is the command that MPI ranks start."""
    parser.add_argument(
        "--over",
        action="append",
        required=required,
        metavar="KEY=VALUES",
        help="values of one key, wave.wavenumber=0.1:3.1:61 (first, last, number), wave.mode=TR,RT or, for an "
        "impact, striker.1.velocity=0.1,1; may be given more than once: every combination is run",
    )
    parser.add_argument(
        "--workers",
        type=_workers,
        default=1,
        metavar="N",
        help="processes, each with one run at a time (default: 1); or mpi: the ranks of "
        f"mpiexec -n RANKS python -m mpi4py.futures {program}",
    )


def _workers(text: str) -> int | str:
    return text if text == "mpi" else positive(text)


def _seconds(text: str) -> float:
    return _above_zero(text, "a number of seconds")


def _accuracy(text: str) -> float:
    return _above_zero(text, "a relative error")


def _above_zero(text: str, what: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not number > 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be {what} above 0")
    return number


def _sweep(options: Options) -> int:
    return sweep_of(options, kernel=options.kernel)


def sweep_of(options: Options, **how: Any) -> int:
    """Run the sweep of the command line with LAMMPS or an engine, report on it, and return the exit status."""
    from granular_lmp.studies.executors import Workers, mpi_workers
    from granular_lmp.studies.sweep import sweep
    from granular_lmp.studies.sweep_points import axes

    over = axes(options.over)
    scene = scene_of(options, {key: values[0] for key, values in over.items()})
    folder = options.output or f"sweeps/{scene.name}"

    with interruptible() as bar, mpi_workers() if options.workers == "mpi" else Workers(options.workers) as workers:
        more = {"executor": workers, "force": options.force, "progress": bar, **how}
        done = sweep(scene, over, folder, **more)
    for row in {row["run"]: row for row in reversed(done.having("failed"))}.values():
        point = ", ".join(f"{key} = {row[key]!r}" for key in done.over)
        remark(f"failed: {point}: {row['message']} ({folder}/{row['run']})")
    finished = len(done.having("finished"))
    say(f"{folder}: {finished} of {len(done.rows)} runs finished; {folder}/sweep.csv")
    return 0 if finished == len(done.rows) else 1


def _scatter(options: Options) -> int:
    from granular_lmp.plot.scattering import scattering_figure
    from granular_lmp.plot.signals import save
    from granular_lmp.studies.scatter import scatter

    scene = wave_scene_of(options)
    folder = options.output or f"scatter/{scene.name}"
    with interruptible() as bar:
        found = scatter(scene, folder, tones=options.tones, force=options.force, progress=bar, kernel=options.kernel)
    say(found.text())
    save(scattering_figure(found), found.folder / "scatter.png")
    say(f"{folder}: scatter.csv, scatter.png")
    return 0


def _cost(options: Options) -> int:
    from granular_lmp.studies.cost import measure, plan
    from granular_lmp.studies.cost_table import failed, recommended, text

    scene = scene_of(options)
    folder = options.output or f"costs/{scene.name}"
    planned = plan(scene, folder, repeats=options.repeats or 5, kernel=options.kernel)
    say(f"{scene.name}: {len(planned.settings)} settings, {len(planned.todo())} runs")
    for setting, reason in planned.left_out.items():
        remark(f"left out: {setting}: {reason}")

    with interruptible() as bar:
        result = measure(planned, budget=options.budget or inf, progress=bar)
    say(text(result))
    say(f"{folder}: cost.json, cost.csv")
    if options.accuracy:
        say(recommended(result, options.accuracy))
    return int(any(map(failed, result["points"])))


def _collide(options: Options) -> int:
    from granular_lmp.scene.collision import Collision
    from granular_lmp.studies.collide import run, write_numbers

    collision = Collision.load(options.scene, changes_of(options))
    with interruptible():
        folder = options.output or f"runs/{collision.name}"
        result = run(collision, folder, force=options.force, kernel=options.kernel)
        errors = result.errors()
    write_numbers(result, errors)
    if result.sticks:
        say("the bodies stick together")
    if collision.law.late and collision.contact.parting == "load":
        remark(
            "note: LAMMPS ends the contact at the largest pull and loses half of the energy that JKR theory loses; "
            'contact.parting = "distance" with the kernel loses all of it'
        )
    say(f"{'after the collision':24}{'':>18}{'change with the step':>22}")
    for name, value in result.numbers().items():
        say(f"{name:24}{value:18.10g}{errors[name]:22.1e}")
    return 0
