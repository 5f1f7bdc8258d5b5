"""Snap-in and pull-off in collisions, compared with the law of Johnson, Kendall and Roberts.

    granular-analysis pull_off RUN [RUN ...] [-o FILE]

RUN is a folder of `granular-lmp collide` with contact.normal = "jkr" or "dmt"; all have the same sphere and partner.
Left: force over overlap in the slowest collision after which the bodies separate, for each law. Right: restitution over
velocity. The script prints the largest deviation of a recorded force from the curve, and of e² from 1 − v_s²/v².
"""

import csv
import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from cases.pull_off.jkr import PARTS, TOUCH, Contact, Parting
from cases.runner import script
from granular_analysis.plotting import COLOURS, letter, page

Floats = NDArray[np.float64]
POINTS = 60  # approximate number of records drawn of a loop
STYLES = {"jkr": COLOURS["TR"], "dmt": COLOURS["RT"]}


@dataclass(frozen=True, eq=False)
class Collision:
    """A collision, read from its folder; SI units.

    Attributes
    ----------
    tables : tables of its scene.
    overlap, force : (T,) records; a repulsive force is positive.
    restitution : 0 if the bodies stick.
    """

    tables: dict[str, Any]
    overlap: Floats
    force: Floats
    restitution: float

    @classmethod
    def read(cls, folder: Path) -> "Collision":
        """Return the collision in a folder; raise ValueError if a file is missing or does not belong to a collision."""
        try:
            declared = folder / "collision.toml"
            declared = declared if declared.is_file() else folder / "scene.toml"  # the file of earlier releases
            tables = tomllib.loads(declared.read_text("utf-8"))
            with (folder / "collision.csv").open(encoding="utf-8", newline="") as stream:
                rows = [(float(row["overlap_m"]), float(row["normal_force_N"])) for row in csv.DictReader(stream)]
            numbers = json.loads((folder / "collision.json").read_text("utf-8"))
            law, restitution = tables["contact"]["normal"], float(numbers["restitution"]["value"])
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{folder}: is not a folder of `granular-lmp collide` ({error!r})") from error
        if law not in STYLES:
            raise ValueError(f"{folder}: contact.normal = {law!r}: must be one of {', '.join(STYLES)}")
        overlap, force = np.array(rows).T
        return cls(tables, overlap, force, restitution)

    @property
    def law(self) -> str:
        """Return the normal law."""
        return str(self.tables["contact"]["normal"])

    @property
    def on_plane(self) -> bool:
        """Return whether the partner is the rigid plane."""
        return bool(self.tables["collision"]["partner"] == "plane")

    @cached_property
    def contact(self) -> Contact:
        """Return the JKR contact."""
        sphere, bodies = self.tables["sphere"], 1 if self.on_plane else 2
        modulus = sphere["youngs_modulus"] / (1 - sphere["poisson_ratio"] ** 2)
        return Contact(sphere["radius"] / bodies, modulus / bodies, sphere["work_of_adhesion"])

    @property
    def mass(self) -> float:
        """Return the reduced mass."""
        sphere = self.tables["sphere"]
        return float(4 / 3 * pi * sphere["radius"] ** 3 * sphere["density"] / (1 if self.on_plane else 2))

    @property
    def speed(self) -> float:
        """Return the relative velocity before the collision."""
        return float(self.tables["collision"]["normal_velocity"] * (1 if self.on_plane else 2))

    def curve(self, overlap: Floats) -> Floats:
        """Return the force of the law at overlaps of a closed contact."""
        contact = self.contact
        if self.law == "jkr":
            return contact.force(contact.contact_radius(overlap))
        hertz = 4 / 3 * contact.modulus * np.sqrt(contact.radius) * overlap**1.5
        return np.asarray(hertz - 2 * pi * contact.work * contact.radius)

    @property
    def off_the_curve(self) -> float:
        """Return the largest deviation of a recorded force from the curve, over the pull-off force of JKR."""
        held = self.force != 0
        errors = np.abs(self.force[held] - self.curve(self.overlap[held]))
        return float(np.max(errors) / self.contact.pull_off_force)


def read(folders: Sequence[str]) -> list[Collision]:
    """Return the collisions by velocity; raise ValueError for different spheres or partners, or without "jkr"."""
    found = [Collision.read(Path(folder)) for folder in folders]
    for folder, each in zip(folders, found, strict=True):
        if (each.tables["sphere"], each.on_plane) != (found[0].tables["sphere"], found[0].on_plane):
            raise ValueError(f"{folder}: has another sphere or partner than the others")
    if not any(each.law == "jkr" for each in found):
        raise ValueError(f'{", ".join(folders)}: none has contact.normal = "jkr"')
    return sorted(found, key=lambda each: each.speed)


def draw(collisions: Sequence[Collision]) -> Figure:
    """Return the two panels."""
    figure = page(3.5)
    left, right = figure.subplots(1, 2)
    _loop(left, collisions)
    _restitution(right, collisions)
    letter((left, right))
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _loop(axes: Axes, collisions: Sequence[Collision]) -> None:
    contact = collisions[0].contact
    unit, length = contact.pull_off_force, contact.rest_overlap
    most = 1.6 * length
    a = contact.rest_radius * np.linspace(0.0, 1.4, 400)
    holds = a >= contact.rest_radius * PARTS["distance"] ** (2 / 3)
    for part, style in ((holds, "-"), (~holds, ":")):
        axes.plot(
            contact.overlap(a)[part] / length, contact.force(a)[part] / unit, style, color=STYLES["jkr"], zorder=1
        )
    for law, name in (("jkr", "JKR"), ("dmt", "DMT")):
        run = next((each for each in collisions if each.law == law and each.restitution > 0), None)
        if run is None:
            continue
        held = np.flatnonzero((run.force != 0) & (run.overlap < most))
        held = held[:: -max(len(held) // POINTS, 1)]  # includes the last record before the bodies separate
        if law == "dmt":
            line = np.linspace(0, most, 200)
            axes.plot(np.append(0, line) / length, np.append(0, run.curve(line)) / unit, color=STYLES[law], zorder=1)
        axes.plot(
            run.overlap[held] / length,
            run.force[held] / unit,
            ".",
            color=STYLES[law],
            markersize=4,
            label=f"{name}, LAMMPS",
        )
    snap = -float(contact.force(contact.rest_radius * TOUCH ** (2 / 3)))
    axes.annotate("", (0, -snap / unit), (0, 0), arrowprops={"arrowstyle": "->", "color": "black"})
    axes.text(0.04, -0.35, "snap-in")
    ends: dict[Parting, tuple[float, str, float]] = {
        "load": (1.0, "LAMMPS\nlets go", 0.15),
        "distance": (5 / 9, "JKR\nlets go", 0.03),
    }
    for parting, (share, words, aside) in ends.items():
        place = -contact.pull_off_distance(parting) / length
        axes.annotate("", (place, 0), (place, -share), arrowprops={"arrowstyle": "->", "color": "grey"})
        axes.text(place + aside, 0.06, words, ha="center", color="grey")
    axes.axhline(0, color="black", linewidth=0.6)
    axes.set(xlabel=r"overlap / $\delta_0$", ylabel="force / largest pull", xlim=(-1.05, 1.6), ylim=(-1.5, 1.6))


def _restitution(axes: Axes, collisions: Sequence[Collision]) -> None:
    contact, mass = collisions[0].contact, collisions[0].mass
    for law, name, mark in (("jkr", "JKR, LAMMPS", "o"), ("dmt", "DMT, LAMMPS", "s")):
        runs = [each for each in collisions if each.law == law]
        speeds, found = [each.speed for each in runs], [each.restitution for each in runs]
        axes.semilogx(speeds, found, mark, color=STYLES[law], markersize=4, label=name)
    speed = np.geomspace(collisions[0].speed / 1.1, collisions[-1].speed * 1.1, 400)
    axes.semilogx(
        speed, contact.restitution(speed, mass, "load"), color=STYLES["jkr"], label="parts at the largest pull"
    )
    axes.semilogx(speed, contact.restitution(speed, mass), "--", color="grey", label="parts at the largest distance")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set(xlabel="relative velocity, m/s", ylabel="restitution", ylim=(-0.04, 1.06))


def table(collisions: Sequence[Collision]) -> str:
    """Return the deviations of LAMMPS from the curve of forces, and from the restitution with parting "load"."""
    snapping = [each for each in collisions if each.law == "jkr"]
    exact = [float(each.contact.restitution(each.speed, each.mass, "load")) for each in snapping]
    worst = max(abs(each.restitution**2 - e**2) for each, e in zip(snapping, exact, strict=True))
    return (
        f"forces off the curve: {max(each.off_the_curve for each in collisions):.1e} of the largest pull\n"
        f"e² off 1 − v_s²/v²:   {worst:.1e}"
    )


main = script(__name__, read, table, draw, ("folders", "collisions"))
