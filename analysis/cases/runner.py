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
Option = tuple[type, Any, str]  # type and default of the value, and help
POISSON_RATIO: Mapping[str, Option] = {"poisson_ratio": (float, SILICA, "Poisson's ratio of the spheres")}


def swept(folders: Sequence[str]) -> list[Record]:
    """Return the finished runs of all sweeps, sweep by sweep, each sorted by wave number."""
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
    """Return the command line of a case; it turns an error of bad input into SystemExit with one line.

    Parameters
    ----------
    case : ``__name__`` of its module.
    measure : function of the runs, if the case takes any, and of the options by name.
    table, draw : functions of the result of `measure`. The table is printed first, as a figure may fail.
    takes : key of `READ` that reads the folders of the arguments, and the help on these folders.
    figure : file name of the figure; by default the name of the case.
    options : options by name; "poisson_ratio" becomes ``--poisson-ratio``.
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
