"""Picture of the crystal of a scene at rest: spheres, contact forces, missing contacts and empty places."""

import ase
import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import CenteredNorm
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import packed
from granular_lmp.crystal.search import overlapping
from granular_lmp.errors import ViewError
from granular_lmp.plot.signals import PAGE, Picture, in_words
from granular_lmp.rest.at_rest import CrystalAtRest
from granular_lmp.rest.face import Rest
from granular_lmp.rest.kinds import rest_of
from granular_lmp.rest.scene import Scene

MOST_DRAWN = 20_000  # spheres; with more, a contact would be below a pixel


def at_rest_figure(scene: Scene) -> Picture:
    """Return a picture of the crystal of a scene at rest.

    Colours of the spheres show the deviation of their diameter from the mean, in overlaps Δ0, or the deviation of their
    density if all radii are equal. Lines are contacts between spheres, coloured by their force f_N over k1 Δ0, which is
    positive where they press. Dotted lines join neighbours in the lattice that do not touch, and crosses are empty
    places. In units of an impact, Δ0 is replaced by ℓ and k1 Δ0 by m ℓ/t0².

    Raises
    ------
    ViewError
        If the scene is a perfect lattice, in which all spheres and contacts are equal, or has more than `MOST_DRAWN`
        spheres.
    """
    if scene.perfect:
        raise ViewError(f"{scene.name}: all spheres and contacts are equal; there is nothing to draw at rest")
    rest = rest_of(scene)
    crystal = rest.crystal
    if len(crystal.atoms) > MOST_DRAWN:
        raise ViewError(f"{scene.name}: has {len(crystal.atoms)} spheres; at most {MOST_DRAWN} can be drawn at rest")
    figure = Picture(figsize=(PAGE, 4.7), layout="constrained")
    axes = figure.subplots()
    position, radius = crystal.atoms.positions[:, :2], crystal.atoms.arrays["radius"]
    values, label = _values(rest)
    discs = EllipseCollection(
        2 * radius, 2 * radius, 0 * radius, units="xy", offsets=position, offset_transform=axes.transData,
        cmap="RdBu_r", norm=CenteredNorm(halfrange=float(np.abs(values).max()) or 1.0), linewidths=0,
    )  # fmt: skip
    discs.set_array(values)
    axes.add_collection(discs, autolim=False)
    contacts, scale, sphere = crystal.contacts, scene.scale, scene.sphere
    close = rest.closed & ~contacts.on_wall
    pairs = contacts.i[close], contacts.j[close]
    force = contacts.contact_force[close] / scale.force(scale.length, sphere.normal_stiffness)
    lines = LineCollection(
        _segments(position, pairs[0], contacts.vector[close, :2] / sphere.radius),
        cmap="PiYG",
        norm=CenteredNorm(halfrange=float(np.abs(force).max(initial=0.0)) or 1.0),
        linewidths=1.5,
    )
    lines.set_array(force)
    axes.add_collection(lines, autolim=False)
    i, vector = _missing(crystal, pairs)
    axes.add_collection(
        LineCollection(_segments(position, i, vector), colors="black", linestyles="dotted", linewidths=1), autolim=False
    )
    empty = _empty_places(rest)
    axes.plot(*empty.T, "x", color="black", markersize=5)
    low, high = position.min(axis=0) - 1.5, position.max(axis=0) + 1.5
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x/R", ylabel="y/R")
    figure.colorbar(discs, ax=axes, label=label, fraction=0.05)
    unit = r"m\ell/t_0^2" if scale.of_impact else r"k_1\Delta_0"
    figure.colorbar(lines, ax=axes, label=f"contact force (${unit}$)", fraction=0.05)
    lost = f", {len(i)} missing (dotted)" if len(i) else ""
    each = (2 * len(force) + contacts.on_wall.sum()) / len(position)
    axes.set_title(
        f"{in_words(scene.name)}: {scene.imperfections}\n{len(position)} spheres, {each:.3f} contacts per sphere{lost}",
        fontsize="medium",
    )
    return figure


def _values(rest: Rest) -> tuple[NDArray[np.float64], str]:
    """Return the values (N,) that the colours of the spheres show, and their label."""
    radius, density, sphere = rest.atoms.arrays["radius"], rest.atoms.arrays["density"], rest.scene.sphere
    if np.ptp(radius) or not np.ptp(density):
        overlap = rest.scale.length / sphere.radius
        return (radius - 1) / overlap, f"deviation of the diameter (${rest.scale.symbol}$)"
    return density / sphere.density - 1, "relative deviation of the density"


def _segments(
    position: NDArray[np.float64], i: NDArray[np.int64], vector: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return a line (2, 2) from the centre of each first sphere along its vector; across a face it leaves the cell."""
    return list(np.stack([position[i], position[i] + vector], axis=1))


def _missing(
    crystal: CrystalAtRest, pairs: tuple[NDArray[np.int64], NDArray[np.int64]]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the neighbours in the lattice that do not touch: the first sphere of each pair, and the vectors.

    pairs : first and second spheres of the pairs that touch.
    """
    equal = crystal.atoms.copy()
    # Neighbours in the lattice are nearer than 2.5 radii, second neighbours farther than 3
    equal.arrays["radius"] = np.full(len(equal), 1.25)
    i, j, vector = overlapping(equal)
    apart = ~np.isin(_names(equal, i, j), _names(equal, *pairs))
    return i[apart], vector[apart, :2]


def _names(crystal: ase.Atoms, i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a number for each pair, independent of the order of its two spheres."""
    return np.minimum(i, j) * len(crystal) + np.maximum(i, j)


def _empty_places(rest: Rest) -> NDArray[np.float64]:
    """Return the lattice places without a sphere, (M, 2), in radii, scaled to the cell at rest."""
    scene, atoms = rest.scene, rest.atoms
    lattice, there = packed(scene.sphere, scene.shape), np.zeros((scene.shape.rows, scene.shape.columns), dtype=bool)
    there[atoms.arrays["row"], atoms.arrays["column"]] = True
    scale = atoms.cell.lengths()[:2] / lattice.cell.lengths()[:2]
    return lattice.positions[~there.ravel(), :2] * scale
