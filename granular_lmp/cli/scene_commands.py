"""Commands on a scene before its run: init, list, schema, check, build, effects, combine."""

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING

from granular_lmp.cli.arguments import (
    Commands,
    Options,
    add,
    folder_arguments,
    json_argument,
    scene_arguments,
    scene_of,
)
from granular_lmp.cli.output import say, say_json

if TYPE_CHECKING:
    from granular_lmp.problem import Problem
    from granular_lmp.rest.scene import Scene
    from granular_lmp.studies.forecast import Forecast

WORTH_RANKS = 10_000  # fewest spheres for which several ranks were measured


def add_to(commands: Commands) -> None:
    """Add these commands to the parser."""
    init = add(commands, "init", _init, "write a commented scene to begin with, or copy all shipped scenes")
    what = init.add_mutually_exclusive_group(required=True)
    what.add_argument("file", metavar="FILE", nargs="?", help="scene file to write, for instance mine.toml")
    what.add_argument("--all", metavar="DIR", help="copy all shipped scenes and their decks into a new folder")
    init.add_argument(
        "--from",
        metavar="SCENE",
        default="tr_resonant",
        dest="source",
        help="for FILE: scene to begin with, see granular-lmp list (default: %(default)s)",
    )

    add(commands, "list", _list, "list the shipped scenes and collisions, one per line")
    schema = add(commands, "schema", _schema, "print the JSON Schema of a scene file, for editors")
    schema.add_argument(
        "kind", nargs="?", choices=("wave", "impact"), default="wave", help="kind of scene (default: wave)"
    )

    check = add(commands, "check", _check, "report the steps, time, memory and settings of a run, without running it")
    scene_arguments(check)
    json_argument(check)

    build = add(commands, "build", _build, "write the LAMMPS deck of a scene")
    scene_arguments(build)
    folder_arguments(build, "folder for the deck (default: decks/NAME)")

    effects = add(commands, "effects", _effects, "report which effects the deck of a scene includes, and why")
    scene_arguments(effects)
    json_argument(effects)

    combine = add(
        commands, "combine", _combine, "report whether two features of a scene can be combined, and if not, why"
    )
    told = "name, for instance jkr (a wrong name prints all); key, if no other feature has it; or KEY=VALUE"
    combine.add_argument("features", nargs=2, metavar="FEATURE", help=told)


def _init(options: Options) -> int:
    from granular_lmp.rest.scene import Scene
    from granular_lmp.scene.shipped import copy_shipped
    from granular_lmp.scene.starter import write_starter

    if options.all is not None:
        say(f"{options.all}: {', '.join(copy_shipped(options.all))}")
        return 0
    write_starter(options.file, Scene.load(options.source))
    say(f"{options.file}: as {options.source}; next: granular-lmp check {options.file}")
    return 0


def _list(_: Options) -> int:
    from granular_lmp.scene.shipped import shipped

    groups = {
        "granular-lmp run NAME": "*/scene.toml",
        "granular-lmp run NAME, an impact": "impacts/*/scene.toml",
        "granular-lmp collide NAME": "collisions/*.toml",
    }
    for command, pattern in groups.items():
        say(f"{command}:")
        for name, description in shipped(pattern).items():
            say(f"  {name:17} {description}")
    return 0


def _schema(options: Options) -> int:
    from granular_lmp.scene.json_schema import json_schema

    whole = json_schema()
    head = {key: whole[key] for key in ("$schema", "title")}
    say_json(head | whole["else" if options.kind == "impact" else "then"])
    return 0


def _check(options: Options) -> int:
    from granular_lmp.accuracy.ladder import build
    from granular_lmp.studies.forecast import forecast

    problem = build(scene_of(options)).problem
    found = forecast(problem)
    if options.json:
        say_json(_as_json(problem, found))
        return 0
    say(f"{problem.scene.name}: {problem.scene.words}")
    for name, text in _lines(problem, found):
        say(f"{name:10}{text}")
    return 0


def _as_json(problem: "Problem", found: "Forecast") -> dict[str, object]:
    """Return the results of check, for another program."""
    from dataclasses import asdict

    from granular_lmp.rest.remarks import law_words

    scene, scale, rest = problem.scene, problem.scene.scale, problem.rest
    steps = rest.steps_to_collision
    collision = {} if steps is None else {"at_rest": rest.pressed, "steps_per_collision": steps}
    return (
        {"name": scene.name, "description": scene.description}
        | asdict(found)
        | {"recorded": len(problem.rest.recorded)}
        | {"t0_s": scale.time, "length_m": scale.length, "velocity_m_s": scale.velocity}
        | {"law": law_words(scene.material, scene.effects)}
        | collision
        | {"defaults": _defaults(problem.declared)}
        | {"effects": problem.on, "guards": problem.guards, "warnings": problem.warnings()}
        | {"sources": _sources(problem)}
        | {"monitors": [{"name": each.monitor.name, "records": each.words} for each in problem.monitors]}
    )


def _lines(problem: "Problem", found: "Forecast") -> "Iterator[tuple[str, str]]":
    """Yield the lines of check, each after its first word."""
    from granular_lmp.rest.remarks import law_words

    scene, scale = problem.scene, problem.scene.scale
    yield "spheres", f"{found.spheres}"
    under = {"below": "on a substrate", "both": "between two substrates"}
    lies = [under[scene.substrate.sides]] if scene.substrate else []
    if differs := [*lies, *([scene.imperfections] if scene.imperfections else [])]:
        yield "crystal", "; ".join(differs)
    yield from _of_cost(problem, found)
    length = f"{scale.name} = {scale.length:.4g} m, {scale.name}/R = {scale.length / scene.sphere.radius:.3g}"
    yield "scale", f"t0 = {scale.time:.4g} s, {length}"
    yield from _of_rest(problem)
    if law := law_words(scene.material, scene.effects):
        yield "law", law
    yield "duration", f"{scene.time.duration * scale.time:.4g} s"
    if (steps := problem.rest.steps_to_collision) is not None:
        yield "step", f"{steps:.3g} to the shortest collision"
    if scene.wave is None and (taken := _defaults(problem.declared)):
        said = ", ".join(f"{key} = {json.dumps(value)}" for key, value in taken.items())
        yield "default", f"{said}: as there is no [wave]"
    yield "effects", ", ".join(name for name, on in problem.on.items() if on) or "none"
    yield "guards", ", ".join(problem.guards) or "none"
    for each in problem.sources:
        yield "source", f"{each.words}, as much time as {each.cost} spheres"
    for placed in problem.monitors:
        yield "monitor", f"{placed.monitor.name}: {placed.words}, {placed.bytes * found.records / 1e6:.2g} MB"


def _of_cost(problem: "Problem", found: "Forecast") -> "Iterator[tuple[str, str]]":
    """Yield the lines on the cost of a run: steps, time by ranks, checkpoints and memory."""
    runs = f" in {found.runs} runs, or more if their errors require it" if found.runs > 1 else ""
    of = f" of {len(problem.rest.recorded)} spheres" if problem.wave is None else f", {found.snapshots} snapshots"
    yield "steps", f"{found.steps}{runs}; {found.records} records{of}"
    seconds = "" if found.seconds is None else f"about {found.seconds:.2g} s on one rank; "
    yield "time", f"{seconds}{found.basis}"
    if found.needs_kernel:
        yield "kernel", f"needed: {found.needs_kernel}"
    elif found.slower is not None:
        yield "kernel", f"{found.share}; about {found.slower:.2g} s with --no-kernel"
    elif found.without_kernel:
        yield "kernel", f"none: {found.without_kernel}"
    for ranks, how in ((4, ""), (64, ", extrapolated")):
        bounds = found.on(ranks)
        if bounds and found.spheres >= WORTH_RANKS:
            yield f"on {ranks}", f"{bounds[0]:.2g} to {bounds[1]:.2g} s{how}"
    if lost := found.lost_on(2):
        yield "ranks", lost
    yield "restart", f"a checkpoint about every {found.checkpoint:.3g} minutes"
    yield "memory", f"about {found.memory / 1e6:.0f} MB"


def _defaults(scene: "Scene") -> dict[str, object]:
    """Return key → default for keys that a scene leaves out and whose default depends on the kind of scene."""
    from granular_lmp.scene.json_schema import keys
    from granular_lmp.scene.without_wave import NOT_HELD, WAVE

    other_kind = keys(WAVE if scene.wave is None else NOT_HELD)
    others = {f"{each.section}.{each.name}": each.default for each in other_kind}
    own = {f"{table}.{each.name}": each.default for table in scene.layout.sections for each in scene.keys_of(table)}
    unused = {f"packing.{end}" for end in ("first", "last") if end not in scene.shape.faces}  # of periodic ends
    return {
        key: default
        for key, default in own.items()
        if default != others.get(key, default) and scene.value(key) == default and key not in unused
    }


def _of_rest(problem: "Problem") -> "Iterator[tuple[str, str]]":
    """Yield the lines on a compressed chain."""
    if rest := problem.rest.pressed:
        force, residual = rest["contact_force_over_impact"], rest["residual_force_over_impact"]
        yield "at rest", f"{force:.3g} of the force of the impact, m v/t0; rounding leaves {residual:.1g} of it"
        yield "sound", f"{rest['sound_m_s']:.4g} m/s"


def _sources(problem: "Problem") -> list[dict[str, object]]:
    return [{"does": each.words, "cost_in_spheres": each.cost} for each in problem.sources]


def _build(options: Options) -> int:
    from pathlib import Path

    from granular_lmp.accuracy.ladder import build
    from granular_lmp.lammps.kernel.library import only_here
    from granular_lmp.runs.folder import clear, locked

    scene = scene_of(options)
    deck = build(scene)
    folder = options.output or f"decks/{scene.name}"
    with locked(Path(folder).absolute(), make=True, force=options.force):  # not into the folder of a run in progress
        clear(Path(folder).absolute())
        deck.write(folder, force=True)
    say(f"{folder}: {', '.join(deck.files())}")
    if alone := only_here(deck.input_text):
        say(f"plain LAMMPS cannot run it: {alone}")
    return 0


def _effects(options: Options) -> int:
    from granular_lmp.accuracy.ladder import planned_steps
    from granular_lmp.problem import prepare
    from granular_lmp.rest.remarks import law_words
    from granular_lmp.runs.manifest import effects_of

    problem = prepare(scene_of(options))
    scene, shape, spheres, steps = problem.scene, problem.scene.shape, len(problem.rest.atoms), planned_steps(problem)
    if options.json:
        own = {
            effect.name: {"cost": effect.cost, "without_it": effect.loss, "key": effect.switch}
            for effect in problem.effects
        }
        effects = {name: said | own[name] for name, said in effects_of(problem).items()}
        size = {"rows": shape.rows, "columns": shape.columns, "spheres": spheres, "steps": steps}
        say_json({"name": scene.name, **size, "effects": effects, "sources": _sources(problem)})
        return 0
    say(f"{scene.name}: {shape.words} = {spheres} spheres, {steps} steps")
    say(f"{'effect':17}{'':5}{'guard':17}{'time':9}why")
    for effect in problem.effects:
        state = "on" if effect.on else "off"
        head = f"{effect.name:17}{state:5}{effect.guard or '-':17}{effect.cost:9}"
        say(head + effect.finding)
        if effect.loss != "nothing":
            say(f"{'':{len(head)}}without it: {effect.loss}")
    for number, each in enumerate(problem.sources, 1):
        say(f"{f'source {number}':17}{'on':5}{'-':17}{f'+{each.cost}':9}{each.words}")
    if problem.sources:
        say("A source takes as much time as this number of spheres.")
    if law := law_words(scene.material, scene.effects):
        say(f"{law}.")
    say("The run fails if an effect that was left out occurs.")
    return 0


def _combine(options: Options) -> int:
    from granular_lmp.studies.combine import answers

    for sentence in answers(*options.features):
        say(sentence)
    return 0
