"""Run a scene without LAMMPS: the network of its spheres takes the same steps as LAMMPS would.

    granular-analysis network SCENE [-o RUN] [--device cpu|jax|gpu] [--step TAU | --tolerance SHARE]
    granular-analysis network SCENE --over KEY=VALUES [--workers N] [-o SWEEP]
    granular-analysis network --resume RUN

The run folder is like that of ``granular-lmp run``, with the same record up to rounding; ``granular-lmp view``,
``export`` and ``front`` and ``granular-analysis compare`` read it. Compiled loops take the steps on one core, or NumPy
if there is no C compiler; JAX (``granular-lmp[jax]``) takes them on all cores or on a GPU. ``run.json`` names the
``device``.
"""

import argparse
from dataclasses import replace

from granular_analysis.measure.stepping import NetworkEngine, kind_of
from granular_analysis.theory.errors import TheoryError
from granular_lmp.accuracy.tolerance import resume, run
from granular_lmp.cli.arguments import changes_argument, changes_of, folder_arguments
from granular_lmp.cli.output import interruptible
from granular_lmp.cli.run_commands import say_how_it_went
from granular_lmp.cli.study_commands import sweep_arguments, sweep_of
from granular_lmp.runs.record import Scene, read_status


def main(argv: list[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scene", nargs="?", metavar="SCENE", help="TOML file, folder with scene.toml, or shipped scene")
    changes_argument(parser, "wave.wavenumber=1.2")
    folder_arguments(parser, "run folder (default: runs/NAME), with --over a sweep folder (default: sweeps/NAME)")
    parser.add_argument(
        "--device",
        choices=["cpu", "jax", "gpu"],
        default="cpu",
        help="device for the steps: one core, all cores with JAX, or a GPU with JAX",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--step", type=float, metavar="TAU", help="time step, time.timestep of the scene")
    how.add_argument("--tolerance", type=float, metavar="SHARE", help="error at which a ladder of steps ends")
    sweep_arguments(parser, "granular-analysis network ...")
    parser.add_argument("--resume", metavar="RUN", help="continue a stopped run on the same device")
    parser.set_defaults(all_effects=False)
    options = parser.parse_args(argv)
    if (options.scene is None) == (options.resume is None):
        parser.error("give a SCENE, or --resume RUN")
    if options.over and options.resume is not None:
        parser.error("--over: the command that began a sweep continues it; --resume is for a run")
    if options.device == "gpu" and options.workers not in (1, "mpi"):
        parser.error("--device gpu: takes one worker, as JAX reserves most of the memory of a GPU")
    try:
        if options.resume is not None:
            engine = NetworkEngine.on(kind_of(str(read_status(options.resume).get("device", options.device))))
            with interruptible() as progress:
                record = resume(options.resume, progress=progress, engine=engine)
            return say_how_it_went(options.resume, record)
        given = {"time.timestep": options.step, "time.tolerance": options.tolerance}
        options.changes += [f"{key}={value!r}" for key, value in given.items() if value is not None]
        if options.over:
            at_once = 1 if options.workers == "mpi" else options.workers  # ranks may be on many machines
            return sweep_of(options, engine=replace(NetworkEngine.on(options.device), at_once=at_once))
        scene = Scene.load(options.scene, changes_of(options))
        engine = NetworkEngine.on(options.device)
        engine.refuse_larger(scene)
        folder = options.output or f"runs/{scene.name}"
        with interruptible() as progress:
            record = run(scene, folder, force=options.force, progress=progress, engine=engine)
    except TheoryError as error:
        raise SystemExit(str(error)) from error
    return say_how_it_went(folder, record)
