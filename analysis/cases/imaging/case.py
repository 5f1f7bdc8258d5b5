"""Images of a sheet with three flaws from records at its rim: resolution and errors.

    granular-analysis imaging RUN RUN [-o FILE]

The runs are LAMMPS's of `flaws.toml`, one with the assumed stiffnesses and one with a spread of 1 % that the images do
not know. Noise is added to the records. Images start from `sheet.toml`, which has no flaws and another time step.
Contacts farther than `FAR` from all flaws count as sound.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.runner import script
from granular_analysis.measure.imaging import Shot, Sought
from granular_analysis.measure.traces import Traces, rms
from granular_analysis.plotting import letter, page
from granular_analysis.theory.imaging import Image, widths
from granular_analysis.tools.image import draw_map
from granular_lmp.runs.record import Record, Scene

Floats = NDArray[np.float64]
HERE = Path(__file__).parent
FAR = 2.5  # spheres from a flaw beyond which contacts are sound
ALARM = 0.1  # difference from 1 of a sound contact that counts as a false alarm
SEEN = 0.1  # a contact is resolved if the image of a change of it alone has this share in its own place
# Index of the run, number of monitors, noise and penalty of each image
TRIALS = (
    (0, 24, 0.01, "tikhonov"),
    (0, 24, 0.05, "tikhonov"),
    (0, 8, 0.01, "tikhonov"),
    (0, 8, 0.05, "tikhonov"),
    (1, 24, 0.01, "tikhonov"),
    (0, 24, 0.01, "tv"),
)


@dataclass(frozen=True, eq=False)
class Found:
    """An image, with the true factor of each contact (P,), and whether the contact is near a flaw."""

    name: str
    sought: Sought
    image: Image
    truth: Floats
    near: NDArray[np.bool_]

    @property
    def title(self) -> str:
        """Return the title of its panel."""
        monitors, noise, penalty, *spread = self.name.split(", ")
        words = [f"{monitors}, {noise}", *(["variation"] if penalty == "tv" else []), *spread]
        return ", ".join(words)

    def line(self) -> str:
        """Return its line of the table: means over patch, line and hole; false alarms; resolution; χ²."""
        values, truth = self.image.values, self.truth
        resolved, _ = self.image.resolution()
        seen = np.diag(resolved) > SEEN
        width = widths(resolved, len(values) / len(self.sought.first.network.position), 2)[seen]
        elsewhere = values[~self.near] - 1
        flaws = [values[truth == each].mean() for each in np.unique(truth[truth != 1])[[1, 2, 0]]]
        return (
            f"{self.name:24}" + "".join(f"{each:8.3f}" for each in flaws) + f"{elsewhere.std():10.3f}"
            f"{np.count_nonzero(np.abs(elsewhere) > ALARM):8d}{np.mean(seen):9.2f}"
            f"{np.median(width) if len(width) else np.nan:8.2f}{self.image.chi_squared:8.3f}"
        )


def flaws(sought: Sought, scene: Scene) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the true factors of the contacts, 0 at the missing sphere, and whether each contact is near a flaw."""
    row, column = sought.sites
    place = sought.first.network.position / (2 * sought.first.radius)
    patch, line, hole = scene.inclusion
    at = place[np.flatnonzero((row == patch.disc[0]) & (column == patch.disc[1]))[0]]
    kind = np.zeros(len(row), dtype=int)
    kind[np.linalg.norm(place - at, axis=1) <= patch.disc[2]] = 1
    for number, each in ((2, line), (3, hole)):
        kind[np.isin(row * len(row) + column, [r * len(row) + c for r, c in each.spheres])] = number
    both = kind[sought.ends]
    whole = sought.shots[0].scene.sphere.normal_stiffness
    truth = np.ones(len(both))
    for number, pair in ((1, scene.pair[0]), (2, scene.pair[1])):
        truth[(both == number).all(axis=1)] = (pair.normal_stiffness or whole) / whole
    truth[(both == 3).any(axis=1)] = 0.0
    middle = sought.places / (2 * sought.first.radius * sought.first.scales.metre)
    differ = middle[truth != 1]
    apart = np.linalg.norm(middle[:, None] - differ, axis=2).min(axis=1)
    return truth, apart < FAR


def imaged(record: Record, monitors: int, noise: float, penalty: str) -> Found:
    """Return the image from some of the monitors, with noise."""
    traces = Traces.of_run(record)
    every = len(traces.row) // monitors
    motion = {name: each[:, ::every] for name, each in traces.motion.items()}
    places = {name: getattr(traces, name)[::every] for name in ("row", "column", "layer")}
    traces = replace(traces, motion=motion, **places)
    rng, size = np.random.default_rng(1), noise * rms(traces.motion)
    noisy = {name: each + size * rng.normal(size=each.shape) for name, each in traces.motion.items()}
    shot = Shot.of(replace(traces, motion=noisy), Scene.load(HERE / "sheet.toml"), noise)
    sought = Sought([shot], "contact.normal_stiffness")
    spread = ", 1 % spread" if record.scene.disorder.stiffness else ""
    name = f"{monitors}, {noise:.0%}, {penalty}{spread}"
    return Found(name, sought, sought.image(penalty), *flaws(sought, record.scene))


def measure(records: Sequence[Record]) -> list[Found]:
    """Return the images of `TRIALS`."""
    return [imaged(records[which], monitors, noise, penalty) for which, monitors, noise, penalty in TRIALS]


def table(found: Sequence[Found]) -> str:
    """Return a line for each image."""
    head = f"{'monitors, noise, penalty':24}{'patch':>8}{'line':>8}{'hole':>8}{'elsewhere':>10}"
    return "\n".join([f"{head}{'alarms':>8}{'seen':>9}{'width':>8}{'chi2':>8}", *(each.line() for each in found)])


def draw(found: Sequence[Found]) -> Figure:
    """Return the figure: true factors and images on one colour scale, and the widths of images of single contacts."""
    figure = page(6.6)
    panels = figure.subplots(3, 3).ravel()
    panels[-1].set_axis_off()
    shown = [("the sheet", found[0].truth), *((each.title, each.image.values) for each in found)]
    for axes, (name, values), each in zip(panels, shown, [found[0], *found], strict=False):
        drawn = draw_map(axes, each.sought, values)
        drawn.set_clim(0.8, 1.2)
        axes.set(xticks=[], yticks=[], xlabel="", ylabel="")
        axes.set_title(name)
    width = panels[-2]
    for each in found[:4]:
        resolved, _ = each.image.resolution()
        own = np.diag(resolved) > SEEN
        spheres = widths(resolved, len(own) / len(each.sought.first.network.position), 2)[own]
        width.hist(spheres, bins=np.linspace(0, 8, 33), histtype="step", label=each.title)
    width.set(xlabel="width of an image (spheres)", ylabel="contacts", box_aspect=1)
    width.legend(handlelength=1)
    figure.colorbar(drawn, ax=panels[-1], label="factor of the\nnormal stiffness", fraction=0.15, extend="both")
    letter(panels[:-1])
    return figure


main = script(__name__, measure, table, draw, ("runs", "runs of flaws.toml, without and with a spread"))
