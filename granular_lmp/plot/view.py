"""Pictures of a folder: the crystal (`granular_lmp.plot.crystal`) or trajectory of a run, or the curve of a sweep."""

from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.crystal.lattices import CHAIN
from granular_lmp.errors import RunFolderError, ViewError
from granular_lmp.lammps.outputs import SWEEP, whole
from granular_lmp.plot.at_rest import at_rest_figure
from granular_lmp.plot.crystal import run_figure, run_movie
from granular_lmp.plot.monitors import monitor_figure
from granular_lmp.plot.motion import chain_figure
from granular_lmp.plot.movie import MOVIES
from granular_lmp.plot.page import page
from granular_lmp.plot.signals import PAGE, Picture, in_words, save
from granular_lmp.plot.unnamed import contacts_figure, draw_unnamed
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.record import Record
from granular_lmp.runs.snapshots import Snapshots
from granular_lmp.runs.unnamed import Unnamed, is_unnamed
from granular_lmp.scene.document import note
from granular_lmp.studies.sweep import Sweep
from granular_lmp.studies.sweep_rows import ASKED

_LABELS = {
    "second_harmonic": r"second harmonic ($D_0$)",
    "largest_p": r"largest $|p|$",
    "largest_q": r"largest $|q|$",
    "largest_phi": r"largest $|\varphi|$",
    "wavenumber_used": r"wave number used (rad per row)",
    "direction_used": "direction used (degrees from x)",
    "frequency": r"frequency $\Omega$ (rad per $t_0$)",
    "seconds": "seconds",
    "far_speed": "largest speed of the far sphere / speed of the striker",
    "far_tau": "arrival at the far sphere ($t_0$)",
    "kinetic_kept": "final / initial kinetic energy",
    "energy_kept": "final / initial energy",
    "largest_overlap": "largest overlap / diameter",
}


def view(
    folder: str | Path,
    path: str | Path,
    *,
    tau: float | None = None,
    colour: str | None = None,
    magnify: float | None = None,
    rows: int | None = None,
    fronts: bool = False,
    side: str | None = None,
    column: str | None = None,
    monitor: str | None = None,
    at_rest: bool = False,
    fps: float | None = None,
    size: tuple[int, int] | None = None,
) -> list[str]:
    """Draw a run as a picture, a movie or a page, a sweep as a picture, or the crystal of a scene at rest.

    Without a wave, the picture shows a chain over time, and other crystals at `tau`. The same holds for unnamed
    crystals, in which `tau` is a time in seconds (in units lj, in the unit of time).

    Parameters
    ----------
    folder : path
        Run folder or sweep folder; with `at_rest` anything that `Scene.load` reads.
    path : path
        File whose suffix sets the format; ".html" is an interactive page with a choice of time, colours and side.
    tau, colour, magnify, rows, fronts, side
        Options for a run, as in `run_figure`.
    column : str, optional
        Option for a sweep, as in `sweep_figure`.
    monitor : str, optional
        Name of a monitor of a run, whose signals are drawn as in `monitor_figure`; "contacts" for an unnamed crystal.
    at_rest : bool
        True for the crystal at rest, as in `at_rest_figure`.
    fps : float, optional
        Frames per second of a movie, by default 10.
    size : (int, int), optional
        Width and height in pixels. Letters grow with the width.

    Returns
    -------
    list of str
        A warning for each part that is missing from the picture.

    Raises
    ------
    RunFolderError
        If the folder is neither a run nor a sweep, or the file cannot be written.
    ViewError
        If the run does not have the requested data, an option does not fit the picture, or a program is missing on
        this machine.
    """
    folder, path = Path(folder), Path(path)
    of_a_run: dict[str, Any] = {"tau": tau, "colour": colour, "magnify": magnify, "rows": rows}
    of_a_run |= {"fronts": fronts or None, "side": side, "monitor": monitor, "fps": fps}
    if at_rest:
        _refuse(folder, "a crystal at rest", of_a_run | {"column": column})
        _refuse_movie(path, "a crystal at rest is drawn as a picture")
        save(at_rest_figure(Scene.load(folder)), path, size)
        return []
    if is_unnamed(folder):
        unfit = {name: of_a_run[name] for name in ("rows", "fronts")}
        _refuse(folder, "an unnamed crystal", unfit | {"column": column})
        if monitor is not None:
            _refuse(folder, "the picture of contacts", of_a_run | {"monitor": None})
            save(contacts_figure(Unnamed.load(folder), monitor), path, size)
            return []
        draw_unnamed(Unnamed.load(folder), path, tau=tau, colour=colour, magnify=magnify, side=side, fps=fps, size=size)
        return []
    if (folder / SWEEP).is_file():
        _refuse(folder, "the picture of a sweep", of_a_run)
        _refuse_movie(path, "a sweep is drawn as a curve in a picture")
        swept = Sweep.load(folder)
        save(sweep_figure(swept, column), path, size)
        return swept.notes
    record = Record.load(folder, unfinished=True)
    if not len(record.tau):
        raise ViewError(f"{folder}: has no record yet; there is nothing to draw")
    status, message = record.info.get("status"), record.info.get("message")
    lacks = [f"{folder}: not a finished run (status '{status}': {message})"] * (status != "finished")
    if monitor is None:
        return lacks + _draw_spheres(record, folder, path, of_a_run, column, size)
    _refuse(folder, "the picture of a monitor", of_a_run | {"monitor": None, "column": column})
    _refuse_movie(path, "a monitor is drawn over time in a picture")
    save(monitor_figure(record.monitor(monitor)), path, size)
    return lacks


def _draw_spheres(
    record: Record, folder: Path, path: Path, options: dict[str, Any], column: str | None, size: tuple[int, int] | None
) -> list[str]:
    """Draw the spheres of a run as a chain over time, picture, movie or page; return warnings of missing parts."""
    movie, as_page = path.suffix.lower() in MOVIES, path.suffix.lower() == ".html"
    chain = record.scene.wave is None and record.scene.lattice == CHAIN and not as_page
    what = "the picture of a chain, which shows all times" if chain else f"a {'movie' if movie else 'picture'} of a run"
    unfit = "tau" if movie else "fps"
    _refuse(folder, what, {"column": column, unfit: options[unfit]})
    if chain:
        _refuse(folder, what, options)
        _refuse_movie(path, "a chain is drawn over time in a picture")
        save(chain_figure(record), path, size)
        return []
    try:
        snapshots = Snapshots.load(folder)
    except RunFolderError as missing:
        if movie or as_page or any(value is not None for value in options.values()):
            raise ViewError(str(missing)) from missing
        save(record.plot(), path, size)
        return [f"{missing}; p, q and phi of the centre sphere are drawn instead"]
    if as_page:
        _refuse(folder, "a page, in which the reader chooses it", options | {"size": size})
        with whole(path) as draft:
            draft.write_text(page(snapshots), encoding="utf-8")
        return []
    drawn = {key: options[key] for key in ("colour", "magnify", "rows", "side")} | {"fronts": bool(options["fronts"])}
    if movie:
        run_movie(record, snapshots, path, **drawn, fps=options["fps"], size=size)
    else:
        save(run_figure(record, snapshots, tau=options["tau"], **drawn), path, size)
    return []


def _refuse_movie(path: Path, instead: str) -> None:
    if path.suffix.lower() in MOVIES:
        raise ViewError(f"{path}: {instead}, not as a movie")


def _refuse(folder: Path, what: str, options: dict[str, Any]) -> None:
    unfit = [name for name, value in options.items() if value is not None]
    if unfit:
        raise ViewError(f"--{unfit[0]}: cannot be used for {what} ({folder})")


def _why_not(sweep: Sweep, column: str) -> str | None:
    """Return the reason why the monitor of a column has no read-outs, from the first finished run; None without one."""
    for row in sweep.having("finished")[:1]:
        return sweep.record(row).info.get("monitors", {}).get(column.partition(".")[0], {}).get("why")
    return None


def sweep_figure(sweep: Sweep, column: str | None = None) -> Picture:
    """Return a figure of a column over the key with most values, with a curve for each combination of the other keys.

    The default column is the first of `Sweep.main_columns`. Error bars show the errors of a read-out of a monitor.
    Unfinished runs leave gaps, and the title states the number of finished runs.

    Raises
    ------
    ViewError
        If the column does not contain numbers, the sweep is over pairs of numbers, or no run is finished.
    """
    column = column or sweep.main_columns[0]
    asked = [f"{key}{ASKED}" for key in sweep.over]
    words = (*sweep.over, *asked, "run", "status", "message", "guards")
    allowed = [name for name in sweep.columns if name not in words]
    if column not in allowed and (why := _why_not(sweep, column)):
        raise ViewError(f"column = {column!r}: {why}")
    if column not in allowed:
        raise ViewError(f"column = {column!r}: must be one of {', '.join(allowed)}")
    finished = len(sweep.having("finished"))
    if not finished:
        raise ViewError(f"{sweep.folder}: none of the {len(sweep.rows)} runs is finished; there is nothing to draw")
    key = max(sweep.over, key=lambda each: len(sweep.over[each]))
    if any(isinstance(value, list | tuple) for value in sweep.over[key]):
        raise ViewError(
            f"{sweep.folder}: the values of {key} are pairs, which cannot form an axis; sweep over wave.direction and "
            "wave.wavenumber"
        )
    read_off = "." in column and f"{column}_error" in allowed
    others = [name for swept, name in zip(sweep.over, sweep.axes, strict=True) if swept != key]
    curves: dict[str, list[dict[str, Any]]] = {}
    for row in sweep.rows:
        name = ", ".join(f"{_in_words(other)} = {row[other]}" for other in others)
        if all(row["run"] != drawn["run"] for drawn in curves.setdefault(name, [])):
            curves[name].append(row)
    figure = Picture(figsize=(PAGE, 3.8), layout="constrained")
    axes = figure.subplots()
    for name, rows in curves.items():
        heights = [row[column] if row["status"] == "finished" else np.nan for row in rows]
        places = [row[key] for row in rows]
        axes.plot(places, heights, "o-", markersize=3, linewidth=1.0, label=name)
        if read_off:
            bars = np.array([row[f"{column}_error"] for row in rows], dtype=float)
            axes.errorbar(places, np.array(heights, dtype=float), bars, fmt="none", ecolor="0.6", capsize=2)
    # The comment of a key after a semicolon is advice for writing scenes
    comment = note(key, sweep.scene).partition("; ")[0]
    unit = comment.partition(", ")[0] if read_off else comment
    said = _read_out(column) if read_off else _LABELS.get(column, column)
    axes.set(
        xlabel=_in_words(key) + (f" ({unit.replace('xi', 'ξ').replace('t0', '$t_0$')})" if unit else ""), ylabel=said
    )
    missing = "" if finished == len(sweep.rows) else f" ({finished} of {len(sweep.rows)} runs)"
    axes.set_title(f"{in_words(sweep.scene.name)}{missing}", fontsize="medium")
    if len(curves) > 1:
        axes.legend()
    return figure


def _read_out(column: str) -> str:
    """Return the axis label of a read-out of a monitor, such as "behind.v2" or "behind.v_static"."""
    monitor, _, name = column.rpartition(".")
    component = name.rstrip("0123456789").removesuffix("_static")
    symbol, order = component.replace("phi", r"\varphi "), name.removeprefix(component)
    said = f"mean of ${symbol}$" if order == "_static" else rf"${symbol}$ at ${order.strip('1')}\Omega$"
    return f"{said}, monitor {monitor.replace('_', ' ')} ($D_0$)"


def _in_words(key: str) -> str:
    """Return a dotted key in words, with its table where the name of the key alone would be ambiguous."""
    table, _, name = key.rpartition(".")
    words = name.replace("wavenumber", "wave number").replace("_", " ")
    return words if table in ("wave", "time", "packing") else f"{words} of {table.replace('.', ' ')}"
