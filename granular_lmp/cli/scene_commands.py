"""Commands about a scene, before it is run: init, build, effects, modes."""

import argparse
from math import pi

from granular_lmp.cli.arguments import Commands, Options, add, folder_arguments, scene_arguments, scene_of
from granular_lmp.cli.output import say


def add_to(commands: "Commands[argparse.ArgumentParser]") -> None:
    """Add these commands to the parser."""
    init = add(commands, "init", _init, "copy the shipped scenes and their decks, to change them or for plain lmp")
    init.add_argument("-o", "--output", metavar="DIR", default="lammps_inputs", help="folder (default: %(default)s)")

    build = add(commands, "build", _build, "write the LAMMPS deck of a scene")
    scene_arguments(build)
    folder_arguments(build, "folder for the deck (default: decks/NAME)")

    effects = add(commands, "effects", _effects, "say which physics the deck of a scene carries, and why")
    scene_arguments(effects)

    modes = add(commands, "modes", _modes, "frequencies and shapes of the Bloch modes at the scene's wave vector")
    scene_arguments(modes)
    modes.add_argument("--plot", metavar="FILE", help="draw the dispersion in its direction, as PNG, PDF or SVG")


def _init(options: Options) -> int:
    from granular_lmp.scene.shipped import copy_shipped

    say(f"{options.output}: {', '.join(copy_shipped(options.output))}")
    return 0


def _build(options: Options) -> int:
    from pathlib import Path

    from granular_lmp.accuracy.ladder import build
    from granular_lmp.runs.folder import clear, locked

    scene = scene_of(options)
    deck = build(scene)
    folder = options.output or f"decks/{scene.name}"
    with locked(Path(folder).absolute(), make=True, force=options.force):  # not into a run that is at work
        clear(Path(folder).absolute())
        deck.write(folder, force=True)
    say(f"{folder}: {', '.join(deck.files())}")
    return 0


def _effects(options: Options) -> int:
    from granular_lmp.accuracy.ladder import build

    problem = build(scene_of(options)).problem
    scene, shape = problem.scene, problem.scene.shape
    say(
        f"{scene.name}: {shape.rows} rows x {shape.columns} columns = {shape.spheres} spheres, {scene.time.steps} steps"
    )
    say(f"{'effect':17}{'':5}{'guard':16}{'time':9}why")
    for effect in problem.effects:
        state = "on" if effect.on else "off"
        head = f"{effect.name:17}{state:5}{effect.guard or '-':16}{effect.cost:9}"
        say(head + effect.finding)
        if effect.loss != "nothing":
            say(f"{'':{len(head)}}without it: {effect.loss}")
    say("A guard fails the run when an effect that is off, and was not called for, is there after all.")
    return 0


def _modes(options: Options) -> int:
    from granular_lmp.crystal.lattices import unit_lattice
    from granular_lmp.crystal.modes import bloch_mode
    from granular_lmp.scene.linear import physics_of

    scene = scene_of(options)
    lattice, physics = unit_lattice(scene.sphere), physics_of(scene)
    along = "" if scene.along == "y" else f" along {scene.along}"
    say(
        f"xi = {scene.wavenumber!r} rad per row{along}; t0 = {scene.sphere.time_scale:.6g} s; "
        "shapes with p2 + q2 + f2 = 1"
    )
    say(f"{'mode':5}{'Omega (rad/t0)':>18}{'frequency (Hz)':>18}{'p':>12}{'q':>12}{'f':>12}")
    for name in physics.modes:
        mode = bloch_mode(lattice, scene.sphere, scene.vector, name, physics)
        hertz = mode.frequency / scene.sphere.time_scale / (2 * pi)
        say(f"{name:5}{mode.frequency:18.12f}{hertz:18.6g}{mode.p + 0.0:12.8f}{mode.q + 0.0:12.8f}{mode.f:12.8f}")
    if options.plot:
        from granular_lmp.plot.signals import dispersion_figure, save

        save(dispersion_figure(lattice, scene), options.plot)
        say(options.plot)
    return 0
