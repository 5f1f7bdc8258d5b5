"""Notebook cards of a scene, a record, a sweep and a deck, and the interactive page of snapshots."""

from base64 import b64encode
from collections.abc import Mapping
from functools import singledispatch
from html import escape
from typing import Any

from matplotlib.figure import Figure

from granular_lmp.crystal.lattices import CHAIN
from granular_lmp.errors import ViewError
from granular_lmp.lammps.deck import Deck
from granular_lmp.plot.crystal import run_figure
from granular_lmp.plot.motion import chain_figure
from granular_lmp.plot.page import page
from granular_lmp.plot.signals import dispersion_figure, png
from granular_lmp.plot.view import sweep_figure
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.record import Record
from granular_lmp.runs.snapshots import Snapshots
from granular_lmp.studies.sweep import Sweep

_DPI = 55  # for pictures of 350 pixels and 10 to 20 kB, because a notebook stores them in its file
_ROWS = 6  # largest number of runs on the card of a sweep


@singledispatch
def html(thing: Any) -> str:
    """Return the HTML by which a notebook shows an object.

    Raises
    ------
    TypeError
        For an object without a card.
    """
    raise TypeError(f"{type(thing).__name__}: there is no notebook card for this type")


@html.register
def _(scene: Scene) -> str:
    scale = scene.scale
    units = f"t0 = {scale.time:.4g} s, {scale.name} = {scale.length:.4g} m"
    return _card(repr(scene), {"units": units}, None if scene.wave is None else dispersion_figure(scene))


@html.register
def _(record: Record) -> str:
    info = record.info
    facts = {
        "status": f"{info.get('status', 'not run')} {info.get('message', '')}".strip(),
        "guards": ", ".join(name for name, guard in info.get("guards", {}).items() if not guard["quiet"]) or "quiet",
        "folder": str(record.folder or "none"),
    }
    return _card(repr(record), facts, _picture(record))


def _picture(record: Record) -> Figure | None:
    """Return the signals of a wave, otherwise a chain over time or the last snapshot; None for an empty record."""
    if record.scene.wave is not None:
        return record.plot()
    if not len(record.tau):
        return None
    if record.scene.lattice == CHAIN:
        return chain_figure(record)
    return None if record.folder is None else run_figure(record, record.snapshots())


@html.register
def _(sweep: Sweep) -> str:
    columns = [*sweep.over, "status", *sweep.main_columns]
    lines = [[_short(row[column]) for column in columns] for row in sweep.rows[:_ROWS]]
    more = f"<p>and {len(sweep.rows) - _ROWS} more</p>" if len(sweep.rows) > _ROWS else ""
    try:
        picture: Figure | None = sweep_figure(sweep)
    except ViewError:  # no run is finished, or the swept key holds pairs
        picture = None
    return _card(repr(sweep), {}, picture, _table(columns, lines) + more)


@html.register
def _(deck: Deck) -> str:
    problem = deck.problem
    facts = {
        "effects": ", ".join(name for name, on in problem.on.items() if on),
        "guards": ", ".join(problem.guards) or "none",
        "places": ", ".join(deck.places),
        "edited": "\n".join(deck.edits()) or "no",
    }
    text = f"<details><summary>{escape(deck.input_name)}</summary><pre>{escape(deck.input_text)}</pre></details>"
    picture = dispersion_figure(deck.scene) if deck.scene.holding.has_modes else None
    return _card(repr(deck), facts, picture, text)


@html.register
def _(snapshots: Snapshots) -> str:
    frame = 'style="width: 100%; height: 620px; border: 0"'
    return f'<iframe {frame} title="{escape(repr(snapshots))}" srcdoc="{escape(page(snapshots))}"></iframe>'


def _card(title: str, facts: Mapping[str, str], picture: Figure | None, more: str = "") -> str:
    table = _table([], [[name, fact] for name, fact in facts.items()])
    image = "" if picture is None else b64encode(png(picture, _DPI)).decode()
    shown = image and f'<img src="data:image/png;base64,{image}">'
    return f"<div><b>{escape(title)}</b>{table}{shown}{more}</div>"


def _table(head: list[str], lines: list[list[str]]) -> str:
    rows = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in line) + "</tr>" for line in lines)
    titles = "<tr>" + "".join(f"<th>{escape(name)}</th>" for name in head) + "</tr>" if head else ""
    return f"<table>{titles}{rows}</table>" if rows else ""


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)
