"""The command line of a case: measure its runs, print the table, draw the figure."""

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from granular_analysis.measure.runs import load, sweep
from granular_analysis.plotting import SILICA, in_one_line, parser, save
from granular_lmp.runs.record import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")
Option = tuple[type, Any, str]  # of its value: the type, the default, the help
POISSON_RATIO: Mapping[str, Option] = {"poisson_ratio": (float, SILICA, "of the spheres")}


def swept(folders: Sequence[str]) -> list[Record]:
    """Return the finished runs of all sweeps, those of each by wave number."""
    return [record for folder in folders for record in sweep(folder)]


READ: Mapping[str, Callable[[Sequence[str]], Any]] = {
    "folder": lambda folders: folders[0],
    "folders": list,
    "run": lambda folders: load(folders[0]),
    "runs": lambda folders: [load(folder) for folder in folders],
    "sweeps": swept,
}


def script(
    case: str,
    measure: Callable[..., T],
    table: Callable[[T], str],
    draw: Callable[[T], "Figure"],
    takes: tuple[str, str] = ("", ""),
    *,
    figure: str = "",
    options: Mapping[str, Option] | None = None,
) -> Callable[[Sequence[str] | None], int]:
    """Return the command line of a case. Its errors are one line and SystemExit.

    Parameters
    ----------
    case : ``__name__`` of its module.
    measure : of what `takes` says, if there is anything, and the values of the options by name.
    table, draw : of what was measured. The table is printed first, as a figure may fail.
    takes : how the folders of the arguments are read, a word of `READ`, and what they are.
    figure : file name of the figure; by default that of the case.
    options : by name, as "poisson_ratio" of ``--poisson-ratio``.
    """
    kind, folders = takes

    def main(arguments: Sequence[str] | None = None) -> int:
        command = parser(sys.modules[case].__doc__, f"figures/{figure or case.split('.')[-2] + '.png'}")
        if kind:
            command.add_argument("folders", nargs="+" if kind.endswith("s") else 1, metavar="FOLDER", help=folders)
        for name, (value, default, says) in (options or {}).items():
            flag = f"--{name.replace('_', '-')}"
            command.add_argument(flag, type=value, default=default, help=f"{says} (default: {default})")
        chosen = vars(command.parse_args(arguments))
        output, given = chosen.pop("output"), chosen.pop("folders", [])
        with in_one_line(given[0] if len(given) == 1 else ""):
            found = measure(READ[kind](given), **chosen) if kind else measure(**chosen)
            print(table(found))
            drawn = draw(found)
        save(drawn, output)
        return 0

    return main
