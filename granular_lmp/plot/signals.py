"""Figures of signals and of the dispersion relation, drawn without pyplot."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from math import pi
from pathlib import Path
from typing import TypedDict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_lmp.accuracy.rounding import moving
from granular_lmp.crystal.modes import branches
from granular_lmp.errors import RunFolderError, ViewError, one_line
from granular_lmp.lammps.outputs import whole
from granular_lmp.rest import words
from granular_lmp.rest.linear import mode_of, physics_of, wave_contacts
from granular_lmp.rest.scene import Scene


class LineStyle(TypedDict):
    """Colour and dashes of a line."""

    color: str
    linestyle: str


# Dashes distinguish the modes if printed without colour
BRANCH_STYLES: dict[str, LineStyle] = {
    "L": {"color": "black", "linestyle": "-"},
    "TR": {"color": "C0", "linestyle": "--"},
    "RT": {"color": "C3", "linestyle": "-."},
}

ROTATION_LABEL = {"phi": r"$\varphi = R\theta/D_0$"}
ALONG_Y = {"p": r"$p = v/D_0$", "q": r"$q = -u/D_0$"} | ROTATION_LABEL
OBLIQUE = {"p": r"$p$, along $k$ ($D_0$)", "q": r"$q$, across $k$ ($D_0$)"} | ROTATION_LABEL

SPACE = {f"u{axis}": rf"$u_{axis}$ ($D_0$)" for axis in "xyz"} | {f"phi{axis}": rf"$\varphi_{axis}$" for axis in "xyz"}


FEWEST_PIXELS, MOST_PIXELS = 100, 4000
DPI = 200  # dots per inch of a file
PAGE = 6.3  # inches (16 cm), the width of all figures; in `matplotlibrc` all text has at least 8 points


class Picture(Figure):
    """Figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        return png(self, dpi=100)


def png(figure: Figure, dpi: int) -> bytes:
    """Return the figure as the contents of a PNG file."""
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=dpi)
    return stream.getvalue()


def signals_to_draw(signals: Mapping[str, NDArray[np.float64]]) -> list[str]:
    """Return the names of the signals to draw: all that are not zero by symmetry, or p if all are zero.

    In space these are the displacements and angles along the axes, which include p, q and φ.
    """
    worth = {*moving(signals)} & SPACE.keys() or {*moving(signals)} or {"p"}
    return [name for name in signals if name in worth]


def draw_signals(
    panels: Sequence[Axes],
    tau: NDArray[np.float64],
    signals: Mapping[str, NDArray[np.float64]],
    names: Sequence[str],
    scene: Scene,
) -> None:
    """Draw one signal over τ in each panel."""
    labels = SPACE | (ALONG_Y if scene.along == "y" else OBLIQUE)
    for panel, name in zip(panels, names, strict=True):
        panel.plot(tau, signals[name], color="black", linewidth=0.9)
        panel.axhline(0, color="0.8", linewidth=0.6, zorder=0)
        panel.set(ylabel=labels[name])
        panel.margins(x=0)
    panels[-1].set(xlabel=r"$\tau$ ($t_0$)")


def in_words(name: str) -> str:
    """Return the name of a scene for a title, with spaces in place of underscores."""
    return name.replace("_", " ")


def title(scene: Scene) -> str:
    """Return a title: the name of the scene with its wave (mode, kind, used ξ and direction, D0) or other motion."""
    wave, name = scene.wave, in_words(scene.name)
    if wave is None or not wave.known.waves:
        unit = "" if wave is None else rf", $D_0$ = {wave.amplitude:g} $\Delta_0$"
        cause = words.moved(scene.striker, scene.start, scene.source).removeprefix("which ")
        return f"{name}: {cause}{unit}"
    shaken = words.shaken(scene.source, scene.striker, scene.start, wave)
    kind = "" if scene.envelope.kind == "wave" else f" {scene.envelope.kind}"
    along = "" if scene.along == "y" else f" along {scene.along}"
    return (
        rf"{name}: {shaken}{wave.words}{kind or ' wave'}, $\xi$ = {scene.wavenumber:.4g} rad per row{along}, "
        rf"$D_0$ = {wave.amplitude:g} $\Delta_0$"
    )


def trajectory_figure(tau: NDArray[np.float64], signals: Mapping[str, NDArray[np.float64]], scene: Scene) -> Picture:
    """Return a figure of the signals of the centre sphere over τ, without signals that are zero by symmetry."""
    names = signals_to_draw(signals)
    figure = Picture(figsize=(PAGE, 0.9 + 1.2 * len(names)), layout="constrained")
    panels = list(figure.subplots(len(names), squeeze=False, sharex=True)[:, 0])
    draw_signals(panels, tau, signals, names, scene)
    panels[0].set_title(title(scene), fontsize="medium")
    return figure


def dispersion_figure(scene: Scene) -> Figure:
    """Return a figure of Ω(ξ) along the direction of a scene's wave, with the wave marked, and an axis in Hz to GHz.

    Without a wave the direction is y.

    Along y and x the branches have the names of the modes. In other directions branches exchange their names, so all
    branches have the same style, and also in crystals with several spheres per cell.
    """
    lattice, physics = wave_contacts(scene), physics_of(scene)
    vector = scene.lattice.vector(pi / 2) if scene.wave is None else scene.vector
    edge = scene.lattice.zone_edge(vector.direction)
    wavenumbers = np.linspace(0.01, edge, 200)
    figure = Figure(figsize=(PAGE, 4.0), layout="constrained")
    axes = figure.subplots()
    along = [scene.lattice.vector(xi, vector.direction) for xi in wavenumbers]
    for index, (name, branch) in enumerate(branches(lattice, scene.sphere, along, physics).items()):
        style = BRANCH_STYLES.get(name, {"color": "black", "linestyle": "-"})
        label = name if name in BRANCH_STYLES else "_" * (index > 0) + "all branches"
        axes.plot(wavenumbers, branch, label=label, **style)
    if scene.wave is not None:
        wave = mode_of(scene, physics)
        mode = f"branch {wave.name}" if wave.name.isdigit() else wave.name
        axes.plot(wave.wavenumber, wave.frequency, "ko", label=f"{mode}, $\\xi$ = {wave.wavenumber:.4g}")
    axes.set(xlabel=r"wave number $\xi$ (rad per row)", ylabel=r"frequency $\Omega$ (rad per $t_0$)", xlim=(0, edge))
    axes.set_ylim(bottom=0)
    frequency_axis(axes, 2 * np.pi * scene.sphere.time_scale)
    where = "" if vector.axis == "y" else f", along {scene.along}"
    axes.legend(title=in_words(scene.name) + where)
    return figure


def in_si(value: float, unit: str) -> str:
    """Return a value as text with an SI prefix, for example "12.5 µm"."""
    prefixes = {1e9: "G", 1e6: "M", 1e3: "k", 1.0: "", 1e-3: "m", 1e-6: "µ", 1e-9: "n", 1e-12: "p"}
    size = next((size for size in prefixes if abs(value) >= size * (1 - 1e-9)), 1e-12 if value else 1.0)
    return f"{value / size:.3g} {prefixes[size]}{unit}"


def clock(tau: float, scene: Scene) -> str:
    """Return a time for a title, in t0 and in SI units."""
    return rf"$\tau$ = {tau:.4g} ({in_si(tau * scene.scale.time, 's')})"


def frequency_axis(axes: Axes, per_hertz: float) -> None:
    """Add an axis in Hz to GHz at the right of an axis in rad/t0; per_hertz = 2π t0/s is the value of one hertz."""
    size, unit = _unit_of_frequency(axes.get_ylim()[1] / per_hertz)
    right = axes.secondary_yaxis(
        "right",
        functions=(lambda x: np.divide(x, size * per_hertz), lambda x: np.multiply(x, size * per_hertz)),
    )
    right.set_ylabel(f"frequency ({unit})")


def _unit_of_frequency(largest: float) -> tuple[float, str]:
    """Return the largest unit from Hz to GHz in which `largest`, in Hz, is at least 1: its size in Hz and its name."""
    sizes = {1.0: "Hz", 1e3: "kHz", 1e6: "MHz", 1e9: "GHz"}
    size = max((size for size in sizes if size <= largest), default=1.0)
    return size, sizes[size]


def resized(figure: Figure, size: tuple[int, int]) -> float:
    """Change the shape of a figure to a size in pixels, and return the dots per inch that give this size.

    The width in inches stays the same, so letters grow with the picture. Raises ViewError for a size out of range.
    """
    width, height = size
    if not all(FEWEST_PIXELS <= each <= MOST_PIXELS for each in size):
        raise ViewError(f"size = {width}x{height}: must be from {FEWEST_PIXELS} to {MOST_PIXELS} pixels each")
    wide = figure.get_figwidth()
    figure.set_size_inches(wide, wide * height / width)
    return width / wide


def save(figure: Figure, path: str | Path, size: tuple[int, int] | None = None) -> None:
    """Write the figure in the format of the file's suffix, with a size in pixels (`resized`), and make its folder.

    Raises
    ------
    RunFolderError
        If matplotlib does not write this format, or the file cannot be written.
    ViewError
        If the size is out of range, or settings of matplotlib need a missing program, such as LaTeX for
        ``text.usetex``.
    """
    path = Path(path)
    known = figure.canvas.get_supported_filetypes()
    if path.suffix[1:].lower() not in known:
        raise RunFolderError(f"{path}: must end in one of {', '.join(sorted(known))}")
    with whole(path) as draft:
        try:
            figure.savefig(draft, dpi=resized(figure, size) if size else DPI)
        except RuntimeError as error:
            raise ViewError(f"{path}: cannot be drawn: {one_line(error)}") from error
