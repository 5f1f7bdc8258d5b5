"""Shared parts of the scripts: colours, options, and writing of figures and text files."""

import argparse
import csv
import io
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from granular_lmp.cli.arguments import changes_of
from granular_lmp.runs.record import GranularError, Scene

if TYPE_CHECKING:  # slow to import, and some scripts do not draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SILICA = 0.17  # Poisson's ratio of the paper's spheres
COLOURS = {"L": "black", "TR": "C0", "RT": "C3"}


def page(height: float) -> "Figure":
    """Return a figure of a height in inches that is as wide as a page, 6.3 inches.

    The commands draw with ``granular_lmp/plot/matplotlibrc``, in which all text has at least 8 points.
    """
    from matplotlib.figure import Figure

    return Figure(figsize=(6.3, height), layout="constrained")


def parser(doc: str | None, default: str) -> argparse.ArgumentParser:
    """Return a parser described by the first line of a script's docstring, with the option -o and its default."""
    result = argparse.ArgumentParser(description=(doc or "").partition("\n")[0])
    result.add_argument("-o", "--output", default=default, metavar="FILE", help=f"PNG, PDF or SVG (default: {default})")
    return result


def scene_of(source: str, options: argparse.Namespace) -> Scene:
    """Return the scene from a file or the shipped scene of a name, with the changes by ``--set``."""
    return Scene.load(source, changes_of(options))


@contextmanager
def in_one_line(what: str = "") -> Iterator[None]:
    """Turn errors from bad input into SystemExit with one line, which starts with `what` for a plain ValueError."""
    try:
        yield
    except GranularError as error:
        raise SystemExit(error.in_options()) from error
    except ValueError as error:
        raise SystemExit(f"{what}: {error}" if what else str(error)) from error


def save(figure: "Figure", path: str | Path) -> None:
    """Write the figure in the format of the file ending, and make its folder.

    Raises SystemExit with one line if matplotlib does not know the ending, if the file cannot be written, or if
    settings of matplotlib need a missing program, such as LaTeX for ``text.usetex``.
    """
    path = Path(path)
    known = figure.canvas.get_supported_filetypes()
    if path.suffix[1:].lower() not in known:
        raise SystemExit(f"{path}: must end in one of {', '.join(sorted(known))}")
    with _whole(path) as draft:
        try:
            figure.savefig(draft, dpi=200)
        except RuntimeError as error:
            raise SystemExit(f"{path}: cannot be drawn: {' '.join(str(error).split())}") from error


def letter(panels: Iterable["Axes"]) -> None:
    """Write (a), (b), (c) and so on at the upper left of the panels, in order."""
    for each, axes in zip("abcdefgh", panels, strict=False):
        axes.set_title(f"({each})", loc="left")


def legend_above(axes: "Axes", columns: int = 1) -> None:
    """Put the legend of a panel between the panel and its title at the left, where it covers no data."""
    legend = axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.0)
    lines = -(-len(legend.get_texts()) // columns)
    axes.set_title(axes.get_title("left"), loc="left", pad=10 + 12 * lines)


def write(path: Path, text: str) -> None:
    """Write a text file, and make its folder; raise SystemExit with one line if it cannot be written."""
    with _whole(path) as draft:
        draft.write_text(text, encoding="utf-8")


def write_scene(path: Path, scene: Scene) -> None:
    """Write a scene file and, beside it, the table of its spheres, as `write` does."""
    for name, pieces in scene.beside.items():
        write(path.with_name(name), "".join(pieces))
    write(path, scene.to_toml())


def write_csv(path: Path, head: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table as CSV, every number with all its digits, as `write` does."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    write(path, text.getvalue())


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """Yield the path of a draft that later becomes the file; a device or pipe is written directly."""
    there = path.exists() and not path.is_file()
    draft = path if there else path.with_name(f"{path.name}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        draft.replace(path)
    except OSError as error:
        if not there:
            with suppress(OSError):  # for instance on a read-only disk
                draft.unlink()
        raise SystemExit(f"{path}: cannot be written: {error.strerror or error}") from error
