"""Arguments that several commands share, and the scene that they name."""

import argparse
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Protocol

from granular_lmp.cli.output import progress_of_rest, remark

if TYPE_CHECKING:
    from granular_lmp.rest.scene import Scene

Options = argparse.Namespace


class Commands(Protocol):
    """The return value of ``add_subparsers``, for which argparse has no public name."""

    choices: Any

    def add_parser(self, name: str, *, help: str, description: str) -> argparse.ArgumentParser:
        """Add a command."""
        ...


def add(commands: Commands, name: str, command: Callable[[Options], int], text: str) -> argparse.ArgumentParser:
    """Add a command and return its parser; `text` is its line in the list of commands."""
    parser = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
    parser.set_defaults(command=command)
    return parser


def scene_arguments(parser: argparse.ArgumentParser) -> None:
    """Add SCENE and the options that change it; `scene_of` reads them."""
    parser.add_argument("scene", metavar="SCENE", help="TOML file, folder with scene.toml, or name of a shipped scene")
    changes_argument(parser, "wave.wavenumber=1.2")
    parser.add_argument(
        "--all-effects",
        action="store_true",
        help="switch on every effect for which the scene has numbers, for a comparison",
    )


def changes_argument(parser: argparse._ActionsContainer, example: str) -> None:
    """Add ``--set``; `changes_of` reads it."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="changes",
        help=f"change one value of the scene, for instance {example}; may be given more than once",
    )


def folder_arguments(parser: argparse.ArgumentParser, text: str) -> None:
    """Add ``-o`` and ``--force``."""
    parser.add_argument("-o", "--output", metavar="DIR", help=text)
    parser.add_argument("--force", action="store_true", help="replace the files of an earlier run in that folder")


def kernel_argument(parser: argparse.ArgumentParser) -> None:
    """Add ``--kernel`` and ``--no-kernel``; None is neither."""
    parser.add_argument(
        "--kernel",
        action=argparse.BooleanOptionalAction,
        help="whether to compute contacts faster with the compiled kernel (build-kernel); default: wherever it "
        "supports them",
    )


def variables_argument(parser: argparse.ArgumentParser) -> None:
    """Add ``--var``, whose pairs are in ``variables``."""
    parser.add_argument(
        "--var",
        action="append",
        default=[],
        type=_variable,
        metavar="NAME=VALUE",
        dest="variables",
        help="value of a variable of the deck, as in 'lmp -var NAME VALUE'; may be given more than once",
    )


def _variable(text: str) -> tuple[str, str]:
    name, equal, value = text.partition("=")
    if not (name and equal and value):
        raise argparse.ArgumentTypeError(f"{text!r} must be NAME=VALUE")
    return name, value


def json_argument(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    parser.add_argument("--json", action="store_true", help="print JSON, for another program")


def positive(text: str) -> int:
    """Read a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number of at least 1")
    return int(text)


def changes_of(options: Options) -> dict[str, Any]:
    """Return the changes by ``--set``, as dotted key → value."""
    from granular_lmp.rest.scene import assignment

    return dict(assignment(change) for change in options.changes)


def scene_of(options: Options, swept: Mapping[str, Any] | None = None) -> "Scene":
    """Return the scene of the command line, and print notes on changes that made it fit.

    `swept` holds the values of the first point of a sweep, for a scene that is refused with its own values.
    """
    from granular_lmp.errors import GranularError

    changes = changes_of(options)
    try:
        return _said_scene(options, changes)
    except GranularError as own:
        if not swept:
            raise
        try:
            return _said_scene(options, {**changes, **swept})
        except GranularError as error:  # an error in the file names the file
            raise (error if any(key in str(error) for key in swept) else own) from own


def _said_scene(options: Options, changes: dict[str, Any]) -> "Scene":
    from granular_lmp.effects.selection import with_all
    from granular_lmp.rest.scene import Scene

    scene = Scene.load(options.scene, changes)
    if options.all_effects:
        scene = with_all(scene).with_values(changes)  # check again with the settings of single effects
    _say_notes_on(scene)
    return scene


def _say_notes_on(scene: "Scene") -> None:
    """Print notes on changes that made a scene fit, and warnings on effects that it lacks.

    Notes that follow from the scene alone come before the relaxation of its crystal, which may take long.
    """
    from granular_lmp.effects.selection import remarks, select, warnings
    from granular_lmp.rest.at_rest import crystal_of, remarks_on_wait

    for sentence in (*scene.remarks(), *remarks(scene), *remarks_on_wait(scene)):
        remark(f"note: {sentence}")
    crystal = crystal_of(scene, progress_of_rest)
    lines = [
        *(f"note: {each}" for each in crystal.remarks()),
        *(f"warning: {each}" for each in warnings(select(scene))),
    ]
    if sys.stderr.isatty():
        remark("\r\033[K", end="")  # wipe the line of the progress
    for line in lines:
        remark(line)


def wave_scene_of(options: Options) -> "Scene":
    """Return the scene of the command line, as `scene_of` does; raise SceneError if it has no wave."""
    scene = scene_of(options)
    scene.require_wave("which kick and scatter do not support")
    return scene
