"""Commands of impacts (`granular_lmp.impact`)."""

from typing import TYPE_CHECKING, Any

from granular_lmp.cli.arguments import Options, changes_of
from granular_lmp.cli.output import interruptible, progress_of_runs, remark, say, say_json
from granular_lmp.errors import LaunchError

if TYPE_CHECKING:
    from granular_lmp.impact.record import ImpactRecord
    from granular_lmp.impact.scene import ImpactScene


def impact_of(options: Options) -> "ImpactScene | None":
    """Return the impact that is asked for; None if it is the scene of a wave, or none at all.

    Raises
    ------
    SceneError
        If every effect is asked for, of which an impact has only those that it declares.
    """
    from granular_lmp.errors import SceneError
    from granular_lmp.impact.scene import ImpactScene, is_impact

    if not is_impact(options.scene):
        return None
    if options.all_effects:
        raise SceneError("--all-effects: is for the scene of a wave; must be left out, and effects.friction declared")
    scene = ImpactScene.load(options.scene)
    return scene.with_values(changes_of(options)) if options.changes else scene


_HEAD = """\
# Run it:                        granular-lmp run {file}
# What it would take:            granular-lmp check {file}
# Change one value:              granular-lmp run {file} --set time.duration=50.0
# Every key, with what is allowed: docs/reference/impact.md, and granular-lmp schema impact for editors
# Tables that may be added:      [start], [disorder], [output], [[striker]], [[inclusion]]

"""


def init(file: str, source: str) -> bool:
    """Write an impact into a new file, under the name of the file; False if `source` is none."""
    from pathlib import Path

    from granular_lmp.impact.scene import ImpactScene, is_impact
    from granular_lmp.scene.starter import starter, write_new

    if not is_impact(source):
        return False
    scene = ImpactScene.load(source).with_values({"name": Path(file).stem, "description": ""})
    write_new(Path(file), starter(scene, file, _HEAD))
    return True


def schema() -> dict[str, Any]:
    """Return the JSON Schema of the file of an impact."""
    from granular_lmp.impact.scene import ImpactScene
    from granular_lmp.scene.json_schema import json_schema

    return json_schema(ImpactScene)


def build(scene: "ImpactScene", options: Options) -> int:
    """Write the deck of an impact."""
    from pathlib import Path

    from granular_lmp.impact.deck import deck_of
    from granular_lmp.impact.problem import prepare
    from granular_lmp.impact.tolerance import planned
    from granular_lmp.runs.folder import clear, locked

    deck = deck_of(planned(prepare(scene)))
    folder = options.output or f"decks/{scene.name}"
    with locked(Path(folder).absolute(), make=True, force=options.force):
        clear(Path(folder).absolute())
        deck.write(folder, force=True)
    say(f"{folder}: {', '.join(deck.files())}")
    return 0


def run(scene: "ImpactScene", options: Options) -> int:
    """Run an impact."""
    from granular_lmp.impact.run import run_impact
    from granular_lmp.runs.options import Options as RunOptions

    folder = options.output or f"runs/{scene.name}"
    with interruptible() as progress:
        launcher = "lmp" if options.lmp else "module"
        record = run_impact(scene, folder, RunOptions(launcher, options.np, options.force, progress, options.kernel))
    return _say_how_it_went(folder, record)


def resume(folder: str) -> int | None:
    """Continue an impact; None if the folder holds another run."""
    from granular_lmp.impact.run import resume_impact
    from granular_lmp.impact.scene import is_impact

    if not is_impact(folder):
        return None
    with interruptible() as progress:
        record = resume_impact(folder, progress=progress)
    return _say_how_it_went(folder, record)


def _say_how_it_went(folder: str, record: "ImpactRecord") -> int:
    info = record.info
    say(
        f"{folder}: {info['particles']} spheres, {info['steps']} steps, {len(record.tau)} records of "
        f"{info['recorded']} spheres in {info['wall_seconds']['total']:.2f} s"
    )
    for sentence in info.get("refinements", []):
        remark(f"note: {sentence}")
    if "tolerance" in info:
        found = ", ".join(f"{name} {value:.1e}" for name, value in info["error_estimate"].items())
        say(f"error over the velocity of the fastest striker, estimated: {found} (tolerance {info['tolerance']:g})")
    return 0


def cost(scene: "ImpactScene", options: Options) -> int:
    """Find out what the step of an impact costs."""
    from granular_lmp.studies.impact_cost import cost_of_impact

    for name in ("repeats", "budget"):
        if getattr(options, name) is not None:
            raise LaunchError(f"--{name}: is for the scene of a wave; must be left out")
    folder = options.output or f"costs/{scene.name}"
    with interruptible() as bar:
        found = cost_of_impact(scene, folder, progress=bar and progress_of_runs)
    say(found.text())
    say(f"{folder}: cost.csv, sweep.csv")
    return 0


def check(scene: "ImpactScene", options: Options) -> int:
    """Say what a run would take and do."""
    from granular_lmp.impact.problem import prepare
    from granular_lmp.impact.tolerance import planned
    from granular_lmp.studies.forecast import forecast_of_impact

    declared = prepare(scene)
    problem, found = planned(declared), forecast_of_impact(declared)  # with a tolerance the finest of the planned runs
    scale, time, at_rest = scene.scale, problem.scene.time, problem.at_rest
    said = {
        "name": scene.name,
        "description": scene.description,
        "spheres": len(problem.crystal),
        "recorded": len(problem.recorded),
        "steps": found.steps,
        "records": found.records,
        "runs": found.runs,
        "seconds": found.seconds,
        "basis": found.basis,
        "memory": found.memory,
        "checkpoint": found.checkpoint,
        "t0_s": scale.time,
        "length_m": scale.length,
        "velocity_m_s": scale.velocity,
        "at_rest": at_rest,
        "steps_per_collision": problem.shortest_collision / time.step,
        "effects": problem.on,
        "guards": [each.guard for each in problem.effects if each.guard],
    }
    if options.json:
        say_json(said)
        return 0
    say(f"{scene.name}: {scene.words}")
    say(f"spheres   {said['spheres']}")
    runs = f" in {found.runs} runs, or more if their errors ask for it" if found.runs > 1 else ""
    seconds = "" if found.seconds is None else f"about {found.seconds:.2g} s on one rank; "
    say(f"steps     {found.steps}{runs}; {found.records} records of {said['recorded']} spheres")
    say(f"time      {seconds}{found.basis}")
    say(f"restart   a checkpoint about every {found.checkpoint:.3g} minutes")
    say(f"memory    about {found.memory / 1e6:.0f} MB")
    say(f"scale     t0 = {scale.time:.4g} s, l = {scale.length:.4g} m, l/R = {scale.length / scene.sphere.radius:.3g}")
    if at_rest:
        force, residual = at_rest["contact_force_over_impact"], at_rest["residual_force_over_impact"]
        say(f"at rest   {force:.3g} of the force of the impact, m v/t0; rounding leaves {residual:.1g} of it")
        say(f"sound     {at_rest['sound_m_s']:.4g} m/s")
    say(f"duration  {time.duration * scale.time:.4g} s")
    say(f"step      {problem.shortest_collision / time.step:.3g} to the shortest collision")
    say(f"effects   {', '.join(name for name, on in problem.on.items() if on)}")
    say(f"guards    {', '.join(each.guard for each in problem.effects if each.guard)}")
    return 0


def export(folder: str, path: str, monitor: str | None) -> bool:
    """Write the run of an impact in SI units; False if the folder holds another run.

    Raises
    ------
    RunFolderError
        If a monitor is asked for, the file is no CSV, or cannot be written.
    """
    from granular_lmp.errors import RunFolderError
    from granular_lmp.impact.record import ImpactRecord
    from granular_lmp.impact.scene import is_impact

    if not is_impact(folder):
        return False
    if monitor is not None:
        raise RunFolderError(f"--monitor {monitor}: must be left out for an impact, which has no monitors ({folder})")
    if not path.lower().endswith(".csv"):
        raise RunFolderError(f"{path}: must end in .csv for an impact, whose dump.particles OVITO and ASE read")
    ImpactRecord.load(folder).write_si(path)
    return True


def effects(scene: "ImpactScene", options: Options) -> int:
    """Say which physics the deck carries, and why."""
    from granular_lmp.impact.problem import prepare
    from granular_lmp.impact.tolerance import planned_steps

    problem = prepare(scene)
    steps = planned_steps(problem)
    if options.json:
        found = {
            each.name: {"on": each.on, "reason": each.finding, "guard": each.guard, "key": each.switch}
            for each in problem.effects
        }
        say_json({"name": scene.name, "spheres": len(problem.crystal), "steps": steps, "effects": found})
        return 0
    say(f"{scene.name}: {len(problem.crystal)} spheres, {steps} steps")
    say(f"{'effect':17}{'':5}{'guard':17}why")
    for each in problem.effects:
        say(f"{each.name:17}{'on' if each.on else 'off':5}{each.guard or '-':17}{each.finding}")
    say("A guard fails the run when what it watches goes beyond the model: too deep an overlap, too long a step.")
    return 0


def modes(scene: "ImpactScene", options: Options) -> int:
    """Say in which bands of frequencies waves run along a chain that is pressed together, and where none does."""
    from granular_lmp.cli.bands import as_json, as_text, ranges
    from granular_lmp.impact.problem import prepare

    problem, t0 = prepare(scene), scene.scale.time
    found, count = ranges(problem.cell), len(problem.cell[0])
    if options.json:
        say_json({"cell": count, "t0_s": t0, "sound_m_s": problem.sound} | as_json(found, t0))
    else:
        many = f"{count} sphere{'s' * (count > 1)}"
        say(f"{scene.name}: {many} to a cell; sound {problem.sound:.6g} m/s; t0 = {t0:.6g} s")
        for line in as_text(found, t0):
            say(line)
    if options.plot:
        from granular_lmp.plot.impact import bands_figure
        from granular_lmp.plot.signals import save

        save(bands_figure(problem), options.plot)
        if not options.json:
            say(options.plot)
    return 0
