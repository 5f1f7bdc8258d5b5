"""Quantities that the colours of spheres can show, and sides from which a crystal is seen."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from numpy.typing import NDArray

from granular_lmp.errors import ViewError
from granular_lmp.frozen import dataclass
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.snapshots import Snapshots, Spheres

DARKEST, LIGHTEST = 1.0, 1e-4  # speeds at the ends of the colour map: the front in a sheet decays over four decades
_MOST_IN_COLOUR = 0.99  # share of the spheres at a moment: the colours of a pushed sphere would hide the front it sends
_SEEN = 0.99  # share of the largest value below which the colour bar shows that values lie beyond its ends
_DARK = 0.6  # place on the colour map above which colours are too dark for a grey line

Floats = NDArray[np.float64]
Scale = Literal["symmetric", "positive", "decades"]


@dataclass(frozen=True)
class Side:
    """Side from which a crystal is seen.

    Attributes
    ----------
    page : (int, int)
        Axes to the right and upward, 0 to 2 for x to z.
    towards : int
        Axis normal to the page, about which visible rotations turn.
    sign : int
        1 if this axis points towards the reader, −1 if it points away.
    """

    page: tuple[int, int]
    towards: int
    sign: int

    def flat(self, vectors: Floats) -> Floats:
        """Return vectors (N, 2 or 3) projected onto the page, (N, 2)."""
        return vectors[:, list(self.page)]

    def turn(self, rotation: Floats) -> Floats:
        """Return rotations (N,) or (N, 3) about the axis of view, positive if counterclockwise on the page."""
        return rotation if rotation.ndim == 1 else self.sign * rotation[:, self.towards]


SIDES = {"top": Side((0, 1), 2, 1), "x": Side((1, 2), 0, 1), "y": Side((0, 2), 1, -1)}


@dataclass(frozen=True)
class Colouring:
    """Colouring of the spheres.

    Attributes
    ----------
    value : callable
        (Spheres, Scene, Side) → number of each sphere, (N,).
    label : str
        Label of the colour bar, in units of a wave; `label_of` converts it to other units.
    colours : str
        Colour map of matplotlib.
    scale : str
        "symmetric" has 0 in the middle of the map, "positive" has 0 at its beginning, and "decades" is logarithmic.
    """

    value: Callable[[Spheres, Scene, Side], Floats]
    label: str
    colours: str = "RdBu_r"
    scale: Scale = "symmetric"

    def dark(self, shade: Floats) -> NDArray[np.bool_]:
        """Return which places on the colour map, 0 to 1, are too dark for a grey line."""
        return np.asarray((np.abs(2 * shade - 1) if self.scale == "symmetric" else shade) > _DARK)


def end_of(sizes: Floats, scale: Scale) -> float:
    """Return the size at the end of the colour map: the largest for decades, else one that 1 % exceed."""
    if scale == "decades":
        return float(sizes.max(initial=0.0))
    return float(np.quantile(sizes, _MOST_IN_COLOUR, method="higher"))  # the largest of up to 100 spheres


def norm_of(end: float, scale: Scale) -> Normalize:
    """Return the norm that maps values to the colour map, with `end` at the end of the map."""
    if scale == "decades":
        return LogNorm(LIGHTEST * end, DARKEST * end, clip=True)
    return Normalize(-end if scale == "symmetric" else 0.0, end)


def beyond(end: float, largest: float, scale: Scale) -> Literal["neither", "both", "max"]:
    """Return which ends of the colour bar point on, because values lie clearly beyond them."""
    if not 0 < end < _SEEN * largest:
        return "neither"
    return "both" if scale == "symmetric" else "max"


def _speed(spheres: Spheres, scene: Scene, side: Side) -> Floats:
    """Return the speeds (N,) in m/s."""
    unit = scene.displacement_amplitude / scene.scale.time
    return np.asarray(np.linalg.norm(spheres.velocity, axis=1) * unit)


def _along(place: int) -> Callable[[Spheres, Scene, Side], Floats]:
    """Return a function for the displacements along an axis, in D0."""
    return lambda spheres, scene, side: np.asarray(spheres.displacement[:, place])


COLOURINGS = {
    "rotation": Colouring(lambda spheres, scene, side: side.turn(spheres.rotation), r"rotation $R\theta/D_0$"),
    "energy": Colouring(
        lambda spheres, scene, side: spheres.energy, r"kinetic energy ($m\,D_0^2/t_0^2$)", "YlOrRd", "positive"
    ),
    "speed": Colouring(_speed, "speed (m/s)", "magma_r", "decades"),
    "displacement": Colouring(
        lambda spheres, scene, side: np.linalg.norm(spheres.displacement, axis=1),
        "displacement ($D_0$)",
        "YlOrRd",
        "positive",
    ),
    "p": Colouring(
        lambda spheres, scene, side: scene.vector.along(*spheres.displacement.T[:2]),
        "displacement along $k$ ($D_0$)",
    ),
    "q": Colouring(
        lambda spheres, scene, side: scene.vector.across(*spheres.displacement.T[:2]),
        "displacement across $k$ ($D_0$)",
    ),
} | {
    axis: Colouring(
        _along(place),
        f"displacement along ${axis}$ ($D_0$)",
    )
    for place, axis in enumerate("xyz")
}


def unit_of(scene: Scene) -> str:
    """Return the symbol of the unit of displacements: D0 with a wave; otherwise Δ0, or ℓ for an impact."""
    return "D_0" if scene.wave is not None else scene.scale.symbol


def label_of(colouring: Colouring, scene: Scene) -> str:
    """Return the label of the colour bar in the units of a scene."""
    return colouring.label.replace("D_0", unit_of(scene))


def side_of(scene: Scene, side: str | None) -> Side:
    """Return a side by name: by default "x" for a wave in space and "top" otherwise; ViewError for an unknown name."""
    space = scene.space == 3
    if side is None:
        return SIDES["x" if space and scene.wave is not None else "top"]
    if side not in SIDES:
        raise ViewError(f"side = {side!r}: must be one of {', '.join(SIDES)}")
    if side != "top" and not space:
        raise ViewError(f"side = {side!r}: spheres that stay in their plane are seen from the top; take 'top'")
    return SIDES[side]


def colouring_of(snapshots: Snapshots, colour: str | None) -> Colouring:
    """Return a colouring by name: by default rotation or, without angles, energy for a wave, and speed without a wave.

    Raises
    ------
    ViewError
        If the name is unknown, or the run does not record the quantity.
    """
    scene = snapshots.scene
    tracked = scene.effects.tracking is True
    if colour is None:
        return COLOURINGS["speed" if scene.wave is None else "rotation" if tracked else "energy"]
    if colour not in COLOURINGS:
        raise ViewError(f"colour = {colour!r}: must be one of {', '.join(COLOURINGS)}")
    if colour == "rotation" and not tracked:
        raise ViewError("colour = 'rotation': the run has no angles (effects.tracking is off); take 'energy'")
    if colour in ("p", "q") and scene.wave is None:
        raise ViewError(f"colour = {colour!r}: needs a wave, and this run has none; take 'x', 'y' or 'displacement'")
    if colour == "z" and scene.space == 2:
        raise ViewError("colour = 'z': spheres stay in their plane; take 'x', 'y' or 'displacement'")
    return COLOURINGS[colour]
