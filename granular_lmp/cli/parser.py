"""Parser of the command line, with the commands in the order of their list."""

from collections.abc import Sequence

from granular_lmp.cli import (
    deck_commands,
    machine_commands,
    modes_command,
    run_commands,
    scene_commands,
    study_commands,
    view_commands,
)
from granular_lmp.cli.arguments import Commands
from granular_lmp.cli.completion import Parser
from granular_lmp.version import __version__

# Making the parsers of all commands takes as long as reading and checking a scene
GROUPS = {
    scene_commands: ("init", "list", "schema", "check", "build", "effects", "combine"),
    modes_command: ("modes",),
    run_commands: ("run", "kick", "resume", "adopt", "accept"),
    study_commands: ("sweep", "scatter", "cost", "collide"),
    view_commands: ("view", "front", "export"),
    deck_commands: ("lint",),
    machine_commands: (),  # completion needs all commands
}


def parsers(words: Sequence[str] = ()) -> tuple[Parser, Commands]:
    """Return the parser with all commands, or with the group of the first command on a command line."""
    parser = Parser(
        prog="granular-lmp",
        description="Waves in crystals of spheres: LAMMPS decks with the physics that a scene calls for, runs, and an "
        "independent theory.",
        epilog="Begin with: granular-lmp run tr_resonant -o runs/first. SCENE is a TOML file, a folder that holds "
        "scene.toml, or the name of a scene of `granular-lmp list`.",
    )
    parser.add_argument("--version", action="version", version=f"granular-lmp {__version__}")
    parser.add_argument(
        "--profile", action="store_true", help="before COMMAND: print the time of each phase on standard error"
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for group in [group for group, names in GROUPS.items() if set(words[:1]) & set(names)] or GROUPS:
        group.add_to(commands)
    parser.set_defaults(parser=parser)  # for the command that completes all other commands
    return parser, commands


def help_texts() -> dict[str, str]:
    """Return the help of each command, for the reference page."""
    return {f"granular-lmp {name}": parser.format_help().rstrip() for name, parser in parsers()[1].choices.items()}
