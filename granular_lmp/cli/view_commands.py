"""Commands on existing runs: view, front, export."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from granular_lmp.cli.arguments import Commands, Options, add, json_argument, positive
from granular_lmp.cli.output import remark, say, say_json
from granular_lmp.errors import RunFolderError

if TYPE_CHECKING:
    from granular_lmp.runs.monitors import MonitorRecord
    from granular_lmp.runs.record import Record
    from granular_lmp.runs.snapshots import Snapshots


def add_to(commands: Commands) -> None:
    """Add these commands to the parser."""
    view = add(commands, "view", _view, "draw a run, with its spheres if it has snapshots, or a sweep")
    view.add_argument("folder", metavar="DIR", help="run folder or sweep folder; with --at-rest also a scene")
    view.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        required=True,
        help="PNG, PDF or SVG; for a run also a movie (GIF or MP4) or a page (HTML)",
    )
    view.add_argument(
        "--tau", type=float, help="for a run: time of the snapshot in t0 (default: the last); for adopted dumps in s"
    )
    view.add_argument(
        "--colour",
        help="for a run: rotation, energy, speed, displacement (its magnitude), p, q, x, y or z (default: "
        "rotation if spheres turn; speed without a wave)",
    )
    view.add_argument("--magnify", type=float, metavar="X", help="for a run: factor for displacements and angles")
    view.add_argument(
        "--rows",
        type=positive,
        metavar="N",
        help="for a run: rows around the centre (default: 25 for a wave, all for a push or a strike)",
    )
    view.add_argument(
        "--fronts",
        action="store_true",
        help="for a run with bursts: mark the places of their L, TR and RT waves, from group velocities of the crystal",
    )
    view.add_argument(
        "--side",
        metavar="SIDE",
        help="for a run in space: view from the top, or from the end of an axis: top, x or y (default: x for a wave)",
    )
    view.add_argument(
        "--at-rest",
        action="store_true",
        help="for a scene with unequal spheres: draw the crystal at rest, with its contact forces",
    )
    view.add_argument("--fps", type=float, metavar="N", help="for a movie: frames per second (default: 10)")
    view.add_argument(
        "--size", type=_size, metavar="WIDTHxHEIGHT", help="size of the picture in pixels, for instance 1280x720"
    )
    of_monitor = "for a run: draw the record of this monitor over time; for adopted dumps draw their contacts"
    view.add_argument("--monitor", metavar="NAME", help=of_monitor)
    view.add_argument("--column", help="for a sweep: a column of sweep.csv (default: largest_p; far_speed for impacts)")

    front = add(commands, "front", _front, "find arrival times and speed of the front of a strike or a source")
    front.add_argument("folder", metavar="DIR", help="a run folder")
    front.add_argument(
        "--monitor",
        metavar="NAME",
        help="use the record of this monitor (default: the record of the run, or the snapshots)",
    )
    front.add_argument(
        "--origin",
        type=_place,
        metavar="ROW,COLUMN",
        help="sphere where the front starts (default: the struck or pushed sphere); in an unnamed crystal its ID",
    )
    front.add_argument(
        "--direction", type=float, default=90.0, metavar="DEGREES", help="direction, from x towards y (default: 90)"
    )
    front.add_argument(
        "--of",
        choices=("speed", "along", "across"),
        default="speed",
        help="signal with the crest: speed, or velocity along (longitudinal) or across the direction (default: speed)",
    )
    front.add_argument("--between", type=_distances, metavar="NEAR:FAR", help="use only spheres at these distances, m")
    front.add_argument("-o", "--output", metavar="FILE", help=".csv: arrival at each sphere, with its error, in SI")
    json_argument(front)

    export = add(commands, "export", _export, "write a run for other programs, in SI units: xarray, OVITO, ASE, HDF5")
    export.add_argument("folder", metavar="DIR", help="run folder; with --spheres also a scene")
    export.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        required=True,
        help=".csv: trajectory in SI units; .nc: netCDF with units, for xarray; "
        ".xyz: extended XYZ of the snapshots; .h5md: the snapshots as HDF5; crate, or .zip: a Process Run Crate",
    )
    export.add_argument(
        "--monitor",
        metavar="NAME",
        help="write the record of this monitor, as .csv in SI units; or the contacts of adopted dumps",
    )
    export.add_argument(
        "--spheres",
        action="store_true",
        help="write density and radius of each sphere of a scene, as .csv for its packing.table",
    )


def _place(text: str) -> tuple[int, int] | int:
    if text.isdecimal():
        return int(text)
    row, _, column = text.partition(",")
    if not (row.isdecimal() and column.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r} must be ROW,COLUMN, for instance 0,30")
    return int(row), int(column)


def _distances(text: str) -> tuple[float, float]:
    try:
        near, far = map(float, text.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} must be NEAR:FAR in m, for instance 0.01:0.1") from None
    return near, far


def _size(text: str) -> tuple[int, int]:
    """Return width and height of "1280x720"."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r}: must be width and height in pixels, such as 1280x720")
    return int(width), int(height)


def _view(options: Options) -> int:
    from granular_lmp.plot.view import view

    names = ("tau", "colour", "magnify", "rows", "fronts", "side", "column", "monitor", "at_rest", "fps", "size")
    wanted = {name: getattr(options, name) for name in names}
    for note in view(options.folder, options.output, **wanted):
        remark(f"note: {note}")
    say(options.output)
    return 0


def _front(options: Options) -> int:
    from granular_lmp.lammps.outputs import writable
    from granular_lmp.runs.front import front
    from granular_lmp.runs.tables import write_csv
    from granular_lmp.runs.unnamed import Unnamed, load_any

    record = load_any(options.folder)
    motion: Record | MonitorRecord | Snapshots | Unnamed = record
    if isinstance(record, Unnamed):
        if options.monitor is not None:
            raise RunFolderError(f"{options.folder}: an unnamed crystal has no monitors")
    elif options.monitor is not None:
        motion = record.monitor(options.monitor)
    elif record.scene.wave is not None and record.scene.output.particles:
        motion = record.snapshots()
    found = front(motion, origin=options.origin, direction=options.direction, of=options.of)
    if options.between:
        found = found.between(*options.between)
    speed, error = found.speed
    if options.output:
        with writable(Path(options.output)):
            write_csv(found.columns, Path(options.output))
    if options.json:
        columns = {name: values.tolist() for name, values in found.columns.items()}
        say_json({"speed_m_s": speed, "speed_error_m_s": error, **columns})
        return 0
    in_si = not isinstance(record, Unnamed) or record.in_si
    metre, second, velocity = (" m", " s", " m/s") if in_si else ("", "", " in units lj")
    say(f"speed {speed:.6g}{velocity}, error {error:.1e}{velocity}, over {len(found.distance)} spheres")
    for name, n in (("first", 0), ("last", -1)):
        which = ", ".join(f"{each} {values[n]}" for each, values in found.places.items())
        say(
            f"{name:5} {which}: at {found.distance[n]:.6g}{metre}, arrival {found.arrival[n]:.6g}{second}, "
            f"error {found.error[n]:.1e}{second}, height {found.height[n]:.4g}{velocity}"
        )
    return 0


def _export(options: Options) -> int:
    from granular_lmp.runs.export import export, export_spheres
    from granular_lmp.runs.unnamed import load_any

    if options.spheres:
        from granular_lmp.rest.scene import Scene

        export_spheres(Scene.load(options.folder), options.output)
    else:
        export(load_any(options.folder), options.output, options.monitor)
    say(options.output)
    return 0
