"""The command line of a case: measure its runs, print the table, draw the figure."""

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from granular_analysis.measure.runs import sweep
from granular_analysis.plotting import SILICA, parser, save
from granular_lmp.runs.record import GranularError, Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")
Option = tuple[type, Any, str]  # of its value: the type, the default, the help
POISSON_RATIO: Mapping[str, Option] = {"poisson_ratio": (float, SILICA, "of the spheres")}


def script(
    case: str,
    measure: Callable[..., T],
    table: Callable[[T], str],
    draw: Callable[[T], "Figure"],
    *,
    figure: str = "",
    runs: str = "",
    one: bool = False,
    options: Mapping[str, Option] | None = None,
) -> Callable[[Sequence[str] | None], int]:
    """Return the command line of a case. Its errors are one line and SystemExit.

    Parameters
    ----------
    case : ``__name__`` of its module.
    measure : of the folders of the runs, if it takes any, and the values of the options by name.
    table, draw : of what was measured. The table is printed first, as a figure may fail.
    figure : file name of the figure; by default that of the case.
    runs : what the arguments RUN are; without it there are none.
    one : whether there is one RUN.
    options : by name, as "poisson_ratio" of ``--poisson-ratio``.
    """

    def main(arguments: Sequence[str] | None = None) -> int:
        command = parser(sys.modules[case].__doc__, f"figures/{figure or case.split('.')[-2] + '.png'}")
        if runs:
            command.add_argument("runs", nargs=1 if one else "+", metavar="RUN", help=runs)
        for name, (kind, default, says) in (options or {}).items():
            flag = f"--{name.replace('_', '-')}"
            command.add_argument(flag, type=kind, default=default, help=f"{says} (default: {default})")
        chosen = vars(command.parse_args(arguments))
        output, folders = chosen.pop("output"), chosen.pop("runs", [])
        try:
            found = measure(folders, **chosen) if runs else measure(**chosen)
            print(table(found))
            drawn = draw(found)
        except GranularError as error:  # its message names the folder
            raise SystemExit(error.in_options()) from error
        except ValueError as error:
            raise SystemExit(f"{folders[0]}: {error}" if len(folders) == 1 else str(error)) from error
        save(drawn, output)
        return 0

    return main


def swept(folders: Sequence[str]) -> list[Record]:
    """Return the finished runs of all sweeps, those of each by wave number."""
    return [record for folder in folders for record in sweep(folder)]
