"""Plane front of an impact at an interface of two hexagonal crystals: angles and heights of the fronts after it.

    granular-analysis refraction RUN [RUN ...] [-o FILE]

RUN is a run folder of the shipped ``refraction``, with any angle of the interface and any density beyond it. Left:
angles of the transmitted (full) and the reflected (open) front over the incidence; lines are the rule of
quasi-particles with the law of angles, `cases.refraction.angles`. Right: heights at normal incidence: in a chain, exact
and by the rule, and in the runs. The table has a line for each run.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cases.refraction.angles import angle, quasi_particle
from cases.refraction.refraction import FrontsAtInterface, fronts_at_interface
from cases.runner import script
from cases.solitary import scattering
from cases.strikes import recorded, require
from granular_analysis.measure.strikes import Sites
from granular_analysis.plotting import legend_above, letter, page
from granular_lmp.runs.record import Record

MASSES = np.geomspace(1 / 8, 8.0, 13)
ANGLES = np.linspace(0.0, 60.0, 121)


def measured(record: Record) -> tuple[float, FrontsAtInterface]:
    """Return the mass of a sphere beyond the interface over that before it, and the fronts.

    Raises ValueError unless the scene is a sheet whose first row strikes, with a half-plane of another density as its
    only inclusion, and if too few spheres near the interface are recorded.
    """
    scene, sites = record.scene, Sites.of(record.scene)
    beyond = scene.inclusion[0] if len(scene.inclusion) == 1 else None
    struck = [sites.chosen(each).tolist() for each in scene.striker]
    if (
        scene.packing.lattice != "hexagonal"
        or beyond is None
        or not beyond.half_plane
        or beyond.density is None
        or beyond.of_material
        or struck != [np.flatnonzero(sites.row == 0).tolist()]
    ):
        raise ValueError(
            f"{scene.name}: must be a hexagonal sheet that its first row strikes, with one inclusion of another "
            "density in a half_plane"
        )
    require(record, "inclusion")
    row, column, incidence = beyond.half_plane
    places, seen = sites.place, recorded(scene)
    corner = places[(sites.row == row) & (sites.column == column)][0]
    # Middle of the sheet, which waves from the ends of the interface have not reached
    across = places[:, 0].mean() - corner[0]
    middle = corner + across * np.array([1.0, np.tan(np.radians(incidence))])
    mass = beyond.density / scene.sphere.density
    fronts = fronts_at_interface(record.tau, record.velocity, places[seen] / 2, middle / 2, incidence, heavier=mass > 1)
    return mass, fronts


def draw(runs: Sequence[tuple[float, FrontsAtInterface]]) -> Figure:
    """Return the figure: angles over incidence, and heights over the mass."""
    figure = page(3.5)
    angles, heights = figure.subplots(1, 2)
    for number, mass in enumerate(sorted({mass for mass, _ in runs})):
        _angles(angles, [each for other, each in runs if other == mass], mass, f"C{number}")
    angles.set(xlabel="incidence (degrees)", ylabel="front from the normal (degrees)")
    chains = [scattering.interface(float(mass)) for mass in MASSES]
    rules = [quasi_particle(float(mass)) for mass in MASSES]
    heavy = MASSES > 1
    for colour, exact, rule, where in (
        ("black", [each.velocity for each in chains], [each.height for each in rules], np.full(len(MASSES), True)),
        ("grey", [each.velocity_back for each in chains], [each.height_back for each in rules], heavy),
    ):
        heights.semilogx(MASSES[where], np.array(exact)[where], color=colour)
        heights.semilogx(MASSES[where], np.array(rule)[where], ":", color=colour)
    for mass, each in runs:
        if each.incidence == 0:
            heights.plot(mass, each.transmitted.height / each.incident.height, "o", color="C3", markersize=4)
            if each.reflected:
                back = each.reflected.height / each.incident.height
                heights.plot(mass, back, "o", color="C3", markerfacecolor="none", markersize=4)
    heights.set_xticks([1 / 8, 1 / 4, 1 / 2, 1, 2, 4, 8], ["1/8", "1/4", "1/2", "1", "2", "4", "8"], minor=False)
    heights.set_xticks([], minor=True)
    heights.set(xlabel="mass beyond / before", ylabel="height / that of the incoming wave")
    letter((angles, heights))
    for axes in (angles, heights):
        axes.grid(alpha=0.3)
    legend_above(angles, 2)
    return figure


def _angles(axes: Axes, runs: Sequence[FrontsAtInterface], mass: float, colour: str) -> None:
    """Draw the angles of the runs with one mass, and the rule up to the critical angle."""
    rule = []
    for incidence in ANGLES:
        try:
            rule.append(quasi_particle(mass, float(incidence)))
        except ValueError:  # beyond the critical angle
            break
    axes.plot(ANGLES[: len(rule)], [each.transmitted for each in rule], color=colour, label=f"mass {mass:g}")
    axes.plot(ANGLES[: len(rule)], [each.reflected for each in rule], "--", color=colour, linewidth=0.8)
    for each in runs:
        through, back = each.angles
        axes.plot(each.incidence, through, "o", color=colour, markersize=4)
        axes.plot(each.incidence, back, "o", color=colour, markerfacecolor="none", markersize=4)


def table(runs: Sequence[tuple[float, FrontsAtInterface]]) -> str:
    """Return a line for each run: measured angles, angles by the law and by the rule, heights."""
    lines = [
        f"{'mass':>6}{'angle':>7}{'beyond':>8}{'law':>7}{'rule':>7}{'v/vi':>8}{'rule':>7}{'back':>8}{'law':>7}{'v/vi':>8}"
    ]
    for mass, each in sorted(runs, key=lambda run: (run[0], run[1].incidence)):
        through, back = each.angles
        height = each.transmitted.height / each.incident.height
        try:
            rule = quasi_particle(mass, each.incidence)
            by_rule, of_height = rule.transmitted, rule.height
        except ValueError:  # beyond the critical angle
            by_rule = of_height = np.nan
        line = f"{mass:6.3g}{each.incidence:7.1f}{through:8.2f}{angle(each.incidence, mass, height):7.2f}{by_rule:7.2f}"
        line += f"{height:8.4f}{of_height:7.4f}"
        if each.reflected:
            height = each.reflected.height / each.incident.height
            line += f"{back:8.2f}{angle(each.incidence, 1.0, height, reflected=True):7.2f}{height:8.4f}"
        lines.append(line)
    return "\n".join(lines)


def measure(records: Sequence[Record]) -> list[tuple[float, FrontsAtInterface]]:
    """Return the mass ratio and the fronts of each run."""
    return [measured(record) for record in records]


main = script(__name__, measure, table, draw, ("runs", "fronts that meet an interface"))
