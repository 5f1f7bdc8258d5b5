"""Commands about this machine: doctor, build-kernel, completion."""

from granular_lmp.cli.arguments import Commands, Options, add, json_argument
from granular_lmp.cli.completion import SHELLS, script
from granular_lmp.cli.output import say, say_json


def add_to(commands: Commands) -> None:
    """Add these commands to the parser."""
    text = "report LAMMPS, its packages, MPI and cores, and run a short self-test"
    json_argument(add(commands, "doctor", _doctor, text))

    add(
        commands,
        "build-kernel",
        _build_kernel,
        "compile the kernel, which later runs use to compute contacts faster; needs a compiler",
    )

    text = (
        'print a script that completes commands, options and scenes in a shell: eval "$(granular-lmp completion bash)"'
    )
    completion = add(commands, "completion", _completion, text)
    completion.add_argument("shell", choices=SHELLS, help="name of the shell")
    completion.set_defaults(parsers=commands.choices)


def _doctor(options: Options) -> int:
    from dataclasses import asdict

    from granular_lmp.doctor import examine, report

    if not options.json:
        return report(say)
    found = examine()
    say_json(asdict(found))
    return found.exit_status


def _build_kernel(_: Options) -> int:
    from granular_lmp.lammps.kernel.library import build

    say(f"{build()}: runs use it wherever it supports their contacts")
    return 0


def _completion(options: Options) -> int:
    from granular_lmp.scene.shipped import shipped

    scenes, collisions, impacts = map(shipped, ("*/scene.toml", "collisions/*.toml", "impacts/*/scene.toml"))
    names = dict.fromkeys(options.parsers, scenes) | {"collide": collisions}
    names |= dict.fromkeys(("run", "build", "check", "effects"), scenes | impacts | collisions)
    say(script(options.shell, options.parser, names))
    return 0
