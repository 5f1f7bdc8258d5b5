"""Shared parts of the scripts: their colours, options, start and end, and how a figure or text file is written."""

import argparse
import csv
import io
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, TypeVar

from granular_analysis.theory.contact import Contact
from granular_lmp.cli.arguments import changes_of
from granular_lmp.cli.entry import as_program
from granular_lmp.runs.record import GranularError, Scene

if TYPE_CHECKING:  # slow to import, and not every script draws
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

T = TypeVar("T")

SILICA = 0.17  # Poisson's ratio of the paper's spheres
COLOURS = {"L": "black", "TR": "tab:blue", "RT": "tab:red"}


def parser(
    doc: str | None, default: str, *, run: str | None = None, runs: str | None = None, sweeps: str | None = None
) -> argparse.ArgumentParser:
    """A parser with the first line of the script's docstring and the option -o with its default.

    run, runs, sweeps : what the argument RUN, several of them, or the arguments SWEEP are; None where the script takes
    none.
    """
    result = argparse.ArgumentParser(description=(doc or "").partition("\n")[0])
    if run:
        result.add_argument("run", metavar="RUN", help=run)
    if runs:
        result.add_argument("runs", nargs="+", metavar="RUN", help=runs)
    if sweeps:
        result.add_argument("sweeps", nargs="+", metavar="SWEEP", help=sweeps)
    result.add_argument("-o", "--output", default=default, metavar="FILE", help=f"PNG, PDF or SVG (default: {default})")
    return result


def scene_of(source: str, options: argparse.Namespace) -> Scene:
    """Return a scene, a file or a shipped one, with what ``--set`` changes."""
    return Scene.load(source, changes_of(options))


def start(main: Callable[[], int | None]) -> NoReturn:
    """Run a script as a program, which begins and ends as every command (`granular_lmp.cli.entry`)."""
    sys.exit(as_program("granular-analysis", main))


def spheres(
    command: argparse.ArgumentParser, arguments: Sequence[str] | None, *, geometry: bool = False
) -> tuple[Contact, str]:
    """Return the contact of the spheres that the options describe, and the output file.

    ``--poisson-ratio`` is silica's unless given. With geometry, ``--overlap-ratio`` and ``--prestress`` are options,
    by the names and in the ranges of `granular_analysis.theory.contact.Contact`; without them the lattice is the
    paper's.
    """
    command.add_argument("--poisson-ratio", type=float, default=SILICA, metavar="NU", help=f"default: {SILICA}")
    if geometry:
        command.add_argument(
            "--overlap-ratio",
            type=float,
            default=0.0,
            metavar="ETA",
            help="static overlap over the diameter of a sphere, 0 to 0.1 (default: 0, the paper's points of contact)",
        )
        command.add_argument(
            "--prestress",
            type=float,
            default=0.0,
            metavar="SHARE",
            help="share of compression in the force that holds a contact, 0 to 1; the rest is adhesion "
            "(default: 0); needs --overlap-ratio",
        )
    options = vars(command.parse_args(arguments))
    output = options.pop("output")
    try:
        contact = Contact(**options)
    except ValueError as error:
        command.error(str(error))
    if contact.prestress and not contact.overlap_ratio:
        command.error(
            f"--prestress {contact.prestress:g} needs --overlap-ratio above 0: between points of contact the force at "
            "rest turns nothing, and compression changes no wave"
        )
    return contact, output


def show(
    compare: Callable[[], T], table: Callable[[T], str], draw: Callable[[T], "Figure"], path: str, *, run: str = ""
) -> int:
    """Print the table of a comparison and draw it into a file; bad input is one line and SystemExit.

    run : the folder of the run, if there is one, which the messages of theories do not name.
    """
    try:
        found = compare()
        print(table(found))  # the numbers first: a figure may fail
        figure = draw(found)
    except GranularError as error:  # its message names the folder
        raise SystemExit(error.in_options()) from error
    except ValueError as error:
        raise SystemExit(f"{run}: {error}" if run else str(error)) from error
    save(figure, path)
    return 0


def save(figure: "Figure", path: str | Path) -> None:
    """Write the figure in the format of the file's ending; its folder is made.

    Raises SystemExit with one line for an ending that matplotlib does not write, a file that cannot be written, and
    settings of matplotlib that need a program that is not there, as ``text.usetex`` LaTeX.
    """
    path = Path(path)
    known = figure.canvas.get_supported_filetypes()
    if path.suffix[1:].lower() not in known:
        raise SystemExit(f"{path}: must end in one of {', '.join(sorted(known))}")
    with _whole(path) as draft:
        try:
            figure.savefig(draft, dpi=150)
        except RuntimeError as error:
            raise SystemExit(f"{path}: cannot be drawn: {' '.join(str(error).split())}") from error


def letter(panels: Iterable["Axes"]) -> None:
    """Write (a), (b), (c) and so on at the upper left of the panels, in their order."""
    for each, axes in zip("abcdefgh", panels, strict=False):
        axes.set_title(f"({each})", loc="left", fontsize="medium")


def write(path: Path, text: str) -> None:
    """Write a text file; its folder is made. Raises SystemExit with one line when it cannot be written."""
    with _whole(path) as draft:
        draft.write_text(text, encoding="utf-8")


def write_csv(path: Path, head: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table as CSV, every number with all its digits, as `write` does."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    write(path, text.getvalue())


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """Yield the path of a draft, which becomes the file at the end; what is no file is written as it is."""
    there = path.exists() and not path.is_file()
    draft = path if there else path.with_name(f"{path.name}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        draft.replace(path)
    except OSError as error:
        if not there:
            with suppress(OSError):  # on a disk that is read-only, say
                draft.unlink()
        raise SystemExit(f"{path}: cannot be written: {error.strerror or error}") from error
