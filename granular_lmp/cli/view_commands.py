"""Commands that look at what is there: view, export."""

import argparse

from granular_lmp.cli.arguments import Commands, Options, add, positive
from granular_lmp.cli.output import remark, say


def add_to(commands: "Commands[argparse.ArgumentParser]") -> None:
    """Add these commands to the parser."""
    view = add(commands, "view", _view, "draw a run, with its spheres if it holds snapshots of them, or a sweep")
    view.add_argument("folder", metavar="DIR", help="a run folder or a sweep folder; with --at-rest also a scene")
    view.add_argument(
        "-o", "--output", metavar="FILE", required=True, help="PNG, PDF or SVG; of a run also a movie, GIF or MP4"
    )
    view.add_argument("--tau", type=float, help="of a run: which snapshot (default: the last)")
    view.add_argument("--colour", help="of a run: rotation, energy, p or q (default: rotation, where spheres turn)")
    view.add_argument("--magnify", type=float, metavar="X", help="of a run: displacements and angles X times as large")
    view.add_argument(
        "--rows", type=positive, metavar="N", help="of a run: rows to draw around the centre (default: 25)"
    )
    view.add_argument(
        "--fronts",
        action="store_true",
        help="of a run with bursts: where their L, TR and RT waves are by the group velocities of the crystal",
    )
    view.add_argument(
        "--side",
        metavar="SIDE",
        help="of a run in space: seen from the top, or from the end of an axis: top, x or y (default: x)",
    )
    view.add_argument(
        "--at-rest",
        action="store_true",
        help="of a scene whose spheres differ: the crystal at rest, with the forces of its contacts",
    )
    view.add_argument("--monitor", metavar="NAME", help="of a run: what this monitor recorded, over time")
    view.add_argument("--column", help="of a sweep: a column of sweep.csv (default: largest_p, of impacts far_speed)")

    export = add(commands, "export", _export, "write a run for other programs: SI units, xarray, OVITO, ASE, HDF5")
    export.add_argument("folder", metavar="DIR", help="a run folder")
    export.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        required=True,
        help=".csv: trajectory in SI units; .nc: netCDF with units, for xarray; "
        ".xyz: extended XYZ of the snapshots; .h5md: the snapshots as HDF5",
    )
    export.add_argument("--monitor", metavar="NAME", help="what this monitor recorded, as .csv in SI units")


def _view(options: Options) -> int:
    from granular_lmp.plot.view import view

    names = ("tau", "colour", "magnify", "rows", "fronts", "side", "column", "monitor", "at_rest")
    wanted = {name: getattr(options, name) for name in names}
    for note in view(options.folder, options.output, **wanted):
        remark(f"note: {note}")
    say(options.output)
    return 0


def _export(options: Options) -> int:
    from granular_lmp.runs.export import export
    from granular_lmp.runs.record import Record

    export(Record.load(options.folder), options.output, options.monitor)
    say(options.output)
    return 0
