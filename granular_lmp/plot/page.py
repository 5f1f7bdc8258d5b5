"""Interactive page of a run for a browser or a notebook: the reader chooses time, colours, side and magnification.

The page is one self-contained file. It stores motions as 16-bit integers in units of the largest value, with an error
of 2e-5 of that value.
"""

import json
from base64 import b64encode
from html import escape
from importlib.resources import files
from math import ceil
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from granular_lmp.crystal.lattices import lattice_constant
from granular_lmp.errors import ViewError
from granular_lmp.plot.colours import COLOURINGS, SIDES, Floats, side_of, unit_of
from granular_lmp.plot.marks import interfaces, marked
from granular_lmp.plot.signals import title
from granular_lmp.plot.spheres import LARGEST_SHIFT, copies_of, round_below, usual_rows
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.runs.snapshots import Snapshots

MOST_BYTES = 6_000_000  # largest size of the motions in a page; of a longer run it shows every n-th snapshot
_SIGNS = {"source": "★", "striker": "▲", "monitor": "□", "inclusion": "•"}
_MAPS = {"symmetric": "RdBu_r", "positive": "YlOrRd", "decades": "magma_r"}
_LARGEST = 2**15 - 1


def page(snapshots: Snapshots) -> str:
    """Return the page of a run as HTML.

    Raises
    ------
    ViewError
        If the run has no complete snapshot yet.
    """
    text = files("granular_lmp.plot").joinpath("page.html").read_text("utf-8")
    # Without the character "<", a name in the data cannot end the script
    data = json.dumps(_data(snapshots), allow_nan=False).replace("<", "\\u003c")
    plain = title(snapshots.scene).replace("$", "").replace(r"\Delta_0", "Δ₀").replace(r"\xi", "ξ").replace("D_0", "D₀")
    before, after = text.split("DATA")  # before the title is inserted, which may contain this word
    return before.replace("TITLE", escape(plain)) + data + after


def _data(snapshots: Snapshots) -> dict[str, Any]:
    """Return all data of the page, as its script reads them."""
    scene, count = snapshots.scene, len(snapshots)
    if not count:
        raise ViewError(f"{snapshots.path}: has no complete snapshot yet")
    turns = scene.effects.tracking is True
    columns = scene.space + 1 + (1 if scene.space == 2 else 3) * turns
    every = ceil(2 * columns * count * len(snapshots.rest) / MOST_BYTES)
    moments = [snapshots[number] for number in range(0, count, every)]
    moved = np.array([each.displacement for each in moments])
    farthest = float(np.linalg.norm(moved, axis=-1).max())
    radii = scene.displacement_amplitude / scene.sphere.radius
    factor = round_below(LARGEST_SHIFT / (farthest * radii)) if farthest else 1.0
    place = np.full(len(crystal_of(scene).atoms), -1)
    place[snapshots.spheres] = np.arange(len(snapshots.spheres))
    marks = [(kind, place[spheres]) for kind, _, spheres in marked(scene)]
    side = side_of(scene, None)
    speed = COLOURINGS["speed"]
    return {
        "space": scene.space,
        "tau": [each.tau for each in moments],
        "t0": scene.scale.time,
        "unit": {"D_0": "D₀", r"\ell": "ℓ", r"\Delta_0": "Δ₀"}[unit_of(scene)],
        "metre": scene.displacement_amplitude,
        "metre_of_radius": scene.sphere.radius,
        "radii": radii,
        "farthest": farthest,
        "shift": factor * farthest * radii,
        "centre": scene.shape.centre_row,
        "rows": usual_rows(scene),
        "copies": copies_of(scene.shape),
        "width": scene.shape.columns * scene.shape.lattice.column_distance(lattice_constant(scene.sphere)),
        "colour": "rotation" if turns and scene.wave is not None else "speed",
        "side": next(name for name, each in SIDES.items() if each == side),
        "substrate": scene.substrate is not None,
        "rest": np.round(snapshots.rest, 4).tolist(),
        "radius": np.round(snapshots.crystal.arrays["radius"], 5).tolist(),
        "held": snapshots.held.astype(int).tolist(),
        "row": snapshots.crystal.arrays["row"].tolist(),
        "column": snapshots.crystal.arrays["column"].tolist(),
        "marks": [{"kind": kind, "sign": _SIGNS[kind], "spheres": at[at >= 0].tolist()} for kind, at in marks],
        "interfaces": [[x.tolist(), y.tolist()] for x, y in interfaces(scene, snapshots)],
        "maps": {name: [to_hex(each) for each in colormaps[_MAPS[name]](np.linspace(0, 1, 64))] for name in _MAPS},
        "displacement": _packed(moved),
        "rotation": _packed(np.array([each.rotation for each in moments])) if turns else None,
        "speed": _packed(np.array([speed.value(each, scene, side) for each in moments])),
    }


def _packed(values: Floats) -> dict[str, Any]:
    """Return the largest value, and all values in units of it as 16-bit integers in base64."""
    largest = float(np.abs(values).max(initial=0.0))
    whole = np.rint(values * (_LARGEST / largest if largest else 0.0)).astype("<i2")
    return {"largest": largest, "values": b64encode(whole.tobytes()).decode()}
