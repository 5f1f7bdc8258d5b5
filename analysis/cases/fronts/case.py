"""Front of an impact on a hexagonal sheet: height and speed over distance, in four directions.

    granular-analysis fronts RUN [RUN ...] [-o FILE]

RUN is a run folder of an impact by one sphere on the edge of a sheet. It must record all spheres, or those in the
directions 0, 30, 60 and 90 degrees from the edge. The table has the decay β in height ∝ distance^−β, and the speed V
over height^{1/5} at the near and at the far end. Fits start at ten diameters, and end with the record or where an echo
of the far end or of the nearer side arrives.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cases.fronts.front import Front, front
from cases.runner import script
from cases.strikes import recorded, require
from granular_analysis.measure.strikes import Sites
from granular_analysis.plotting import letter, page
from granular_lmp.runs.record import Record

DIRECTIONS = (0, 30, 60, 90)  # degrees from the edge
NEAREST, FARTHEST = 10.0, 0.6  # range of a fit: from this many diameters to this share of the rows, before an echo
ASIDE = 0.85  # share of the way to the nearer side up to which no echo reaches the crest of a front, 3 diameters long
FEWEST = 4  # fewest spheres of a fit
CHAIN = 0.907470  # V/v^{1/5} of the solitary wave of a chain (cases.solitary.travelling)
_STYLES = {0: "o", 30: "s", 60: "^", 90: "D"}


def fronts(record: Record) -> dict[int, Front]:
    """Return the front in each direction, with distances in diameters.

    Raises ValueError unless exactly one sphere strikes, and each direction has at least `FEWEST` recorded spheres to
    fit.
    """
    require(record, "effects.friction", "effects.restitution", "disorder", "inclusion")
    sites, scene = Sites.of(record.scene), record.scene
    strikers = np.concatenate([sites.chosen(each) for each in scene.striker])
    if len(strikers) != 1:
        raise ValueError(f"{record.scene.name}: {len(strikers)} spheres strike; must be one")
    centres = sites.place
    places = (centres[recorded(scene)] - centres[strikers[0]]) / 2
    room = np.abs(np.array([centres[:, 0].min(), centres[:, 0].max()]) - centres[strikers[0], 0]).min() / 2
    found = {}
    for degrees in DIRECTIONS:
        whole = front(record.tau, record.velocity, places, degrees)
        farthest = min(FARTHEST * record.scene.shape.rows, ASIDE * room / np.cos(np.radians(degrees)))
        part = whole.between(NEAREST, farthest)
        if len(part.distance) < FEWEST:
            raise ValueError(
                f"{record.scene.name}: {len(part.distance)} recorded spheres at {degrees} degrees that the front has "
                f"passed; must be at least {FEWEST} beyond {NEAREST:g} diameters: use a larger sheet or a longer run"
            )
        found[degrees] = part
    return found


def draw(runs: dict[str, dict[int, Front]]) -> Figure:
    """Return the figure: height and scaled speed over distance; a colour for each run, a mark for each direction."""
    figure = page(3.6)
    heights, speeds = figure.subplots(1, 2)
    for number, (name, each) in enumerate(runs.items()):
        for degrees, found in each.items():
            style = {"marker": _STYLES[degrees], "color": f"C{number}", "markersize": 3, "linewidth": 0.6}
            heights.loglog(found.distance, found.height, label=f"{name}, {degrees}°", **style)
            speeds.plot((found.distance[1:] + found.distance[:-1]) / 2, found.scaled_speed, **style)
    heights.set(xlabel="distance (diameters)", ylabel="first crest of the speed\n(speed of the striker)")
    speeds.axhline(CHAIN, color="grey", linewidth=0.8, linestyle="--")
    speeds.set(xlabel="distance (diameters)", ylabel=r"speed / height$^{1/5}$; dashed: a chain", ylim=(0.85, 1.0))
    letter((heights, speeds))
    labels = [*zip(*heights.get_legend_handles_labels(), strict=True)]
    by_direction = [each for degrees in _STYLES for each in labels if each[1].endswith(f" {degrees}°")]
    figure.legend(*zip(*by_direction, strict=True), loc="outside lower center", ncols=len(_STYLES))
    return figure


def table(runs: dict[str, dict[int, Front]]) -> str:
    """Return a line for each run and direction: decay, scaled speed at both ends, distance and height of the last."""
    lines = [f"{'run':16}{'degrees':>8}{'decay':>8}{'V/h^1/5':>9}{'there':>8}{'to':>7}{'height':>9}"]
    for name, each in runs.items():
        for degrees, found in each.items():
            near, far = found.scaled_speed[[0, -1]]
            last = f"{found.distance[-1]:7.1f}{found.height[-1]:9.4f}"
            lines.append(f"{name:16}{degrees:8d}{found.decay:8.3f}{near:9.4f}{far:8.4f}{last}")
    return "\n".join(lines)


def measure(records: Sequence[Record]) -> dict[str, dict[int, Front]]:
    """Return the fronts of the runs by name."""
    return {Path(record.folder or "").name: fronts(record) for record in records}


main = script(__name__, measure, table, draw, ("runs", "impacts on a sheet"))
