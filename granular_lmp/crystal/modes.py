"""Waves of a lattice by name: L, TR and RT, sagittal and shear-horizontal waves, and numbered branches.

In the plane a lattice with one sphere per cell has the waves L, TR and RT. In space it also has them if z = const is a
mirror plane: they are then the three of the six waves that stay in the plane. If the plane of k and z is a mirror
plane, as along the symmetry lines of a layer on a substrate, sagittal waves S1, S2, … move along k and z and turn about
the axis normal to both, and shear-horizontal waves H1, H2, … move along that axis and turn about k and z. Both families
are counted from the lowest frequency. In every crystal branches have numbers. `granular_lmp.crystal.bloch` has the
modes of any crystal.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.bloch import SPARSE, matrix_of, part, roll_rows, solve, stretch_rows
from granular_lmp.crystal.bloch import bloch_modes as bloch_modes
from granular_lmp.crystal.bloch import effective_inertia as effective_inertia
from granular_lmp.crystal.bloch import effective_rolling as effective_rolling
from granular_lmp.crystal.bloch import require_plane as require_plane
from granular_lmp.crystal.blocks import blocks
from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.lanczos import top_bound
from granular_lmp.crystal.lattices import lattice_constant, lattice_of_contacts
from granular_lmp.crystal.mode import FULL, FX, TURNS, UX, UY, F, Mode, Physics, branch_mode
from granular_lmp.crystal.sphere import INERTIA_RATIO, Sphere
from granular_lmp.crystal.wavevector import WaveVector, zone_path
from granular_lmp.errors import SceneError

__all__ = ["bloch_modes"]

Floats = NDArray[np.float64]
MODES = ("L", "TR", "RT")
_MEET = 1e-9  # relative distance of two frequencies below which the shapes of their branches are arbitrary
_STILL = 1e-6  # a frequency below this share of the highest is 0, as the square root of a rounding error
_SOFTEST = 2 / 3 * (1 - 1e-9)  # κ = g/k at ν = ½; only measured stiffnesses have a smaller κ
_FEW = 8  # spheres of the thin film that shows at which wave vectors a thick film has its highest frequency
_BEST, _NEAR = 4, 0.97  # most wave vectors tried in the thick film, and the least share of the highest frequency there
_OF_SPHERES = ("radius", "mass")
_MANY = 48  # number of spheres per cell above which only the lowest branches are found
_LOWEST = 64  # number of these branches
_BELOW = 1e-9  # distance of the shift below 0, in the largest element of the matrix of ω²
_POINTS = 12  # wave vectors along each primitive reciprocal vector in a search for the highest frequency
# A wave along an axis has the mirror symmetry of that axis: L moves only along the axis; TR and RT, sorted by
# frequency, move across it and turn
_SUBSPACE = {
    "y": {"L": ([UY], 0), "TR": ([UX, F], 0), "RT": ([UX, F], 1)},
    "x": {"L": ([UX], 0), "TR": ([UY, F], 0), "RT": ([UY, F], 1)},
}


# --- the named waves of a lattice of one sphere per cell --------------------------------------------------------------


@lru_cache(maxsize=256)  # each mode of a lattice asks for the names
def restored(lattice: Contacts, physics: Physics = FULL) -> tuple[str, ...]:
    """Return the names of the waves along y that have a restoring force; with several spheres per cell, all numbers.

    TR has the frequency 0 and is left out if the contacts have fewer springs than a transverse wave has freedoms: in a
    chain, whose spheres roll on each other freely, and in a square lattice without shear. If such a lattice is
    compressed, motions across y grow, and only L remains.
    """
    if len(lattice.mass) > 1 or physics.space:
        return tuple(map(str, range(1, len(lattice.mass) * len(physics.coordinates) + 1)))
    freedoms = [column for column in (UX, F) if column in physics.coordinates]
    along_y = np.array([0.0, 1 / lattice.length[0]])  # any wave vector except Γ and the edge of the zone
    normal, sideways, turn = stretch_rows(lattice, along_y)
    rows = [normal] + [sideways[0] + turn[0]] * physics.shear + [roll_rows(lattice, along_y)] * (physics.rolling > 0)
    floppy = np.linalg.matrix_rank(np.vstack(rows)[:, freedoms]) < len(freedoms)
    if floppy and lattice.contact_force.any():
        return ("L",)
    return ("L", *(("TR",) if not floppy else ()), *(("RT",) if physics.rotation else ()))


def bears_compression(lattice: Contacts, *, shear: bool = True) -> bool:
    """Return True if a lattice stays straight under compression, False if it buckles.

    It stays straight if a shift of rows along themselves stretches or shears contacts even if spheres turn with the
    shift: the stiffness F0/a that a compressed contact loses is far smaller (χ ≪ κ of `Sphere`). Resistance to rolling
    does not stabilise long waves.
    """
    return "TR" in restored(lattice, Physics(shear, rotation=shear))


@lru_cache(maxsize=256)  # a scene needs its mode many times: effects, guards, deck, accuracy
def bloch_mode(lattice: Contacts, sphere: Sphere, vector: WaveVector, name: str, physics: Physics = FULL) -> Mode:
    """Return the mode L, TR or RT of a lattice at a wave vector; with several spheres per cell, a branch by number.

    L is the mode that moves most along k; TR is the lower and RT the upper of the other two. Along y and along x, where
    the wave has a mirror symmetry, L is purely longitudinal, and TR and RT do not move along k. In other directions all
    three have every component, and modes exchange their names where two frequencies come close.

    At ξ = π along y translation and rotation separate: one of TR and RT is pure u_x, the other pure rotation, with the
    sign that continues ξ < π (f > 0 for TR, f < 0 for RT). Signs are those of `Mode`.

    Raises
    ------
    SceneError
        If the name is unknown, is RT and spheres do not turn, or is not `restored` by the contacts; if the frequency
        of a branch is 0 or equals that of another branch.
    ValueError
        If the contacts are not those of a lattice of the sphere (`granular_lmp.crystal.lattices.unit_lattice`). The
        modes of other crystals have no names; `bloch_modes` returns all of them.
    """
    if physics.space:
        return _in_space(lattice, sphere, vector, name, physics)
    kind = "layered" if np.ptp(lattice.mass) else lattice_of_contacts(lattice, sphere).name
    if name not in (known := MODES if len(lattice.mass) == 1 else restored(lattice, physics)):
        raise SceneError(
            f"wave.mode = {name!r}: must be one of {', '.join(known)} in the {kind} lattice", because="physics"
        )
    if len(lattice.mass) > 1:
        return _branch(lattice, sphere, vector, name, physics)
    if name == "RT" and not physics.rotation:
        raise SceneError(
            f"wave.mode = {name!r}: needs effects.rotation, which is off; without it there are L and TR",
            because="physics",
        )
    if name not in (there := restored(lattice, physics)):
        cure = "effects.rolling_stiffness above 0" if physics.shear else "effects.shear, which is off"
        raise SceneError(
            f"wave.mode = {name!r}: has the frequency 0 in the {kind} lattice, as no contact resists it; must be "
            f"{' or '.join(there)}, or needs {cure}",
            because="physics",
        )
    columns, index = _SUBSPACE[vector.axis][name] if vector.axis else (physics.coordinates, None)
    columns = [column for column in columns if column in physics.coordinates]
    frequencies, shapes = solve(lattice, sphere, _wavevector(sphere, vector), physics, np.array(columns))
    if index is None:
        index = branch_names(shapes, np.array(vector.unit)).index(name)
    shape, same = shapes[index], np.abs(frequencies - frequencies[index]) < _MEET * frequencies[-1]
    if same.sum() > 1 and not vector.axis:  # a square lattice without rotation along its diagonal
        x, y = vector.unit
        shape = (np.eye(6)[[UX, UY]].T @ ([x, y] if name == "L" else [-y, x])) @ shapes[same].T @ shapes[same]
        shape = shape / np.linalg.norm(shape)
    shape = shape * _sign(name, vector, shape) + 0.0  # + 0.0: no minus zero
    return Mode(name, vector, float(frequencies[index]), *shape[[UX, UY, F]].tolist())


def modes_at(lattice: Contacts, sphere: Sphere, vector: WaveVector, physics: Physics = FULL) -> list[Mode]:
    """Return all `restored` modes of a lattice at a wave vector; degenerate modes are arbitrary combinations."""
    if len(lattice.mass) == 1 and not physics.space:
        return [bloch_mode(lattice, sphere, vector, name, physics) for name in restored(lattice, physics)]
    frequencies, shapes = bloch_modes(lattice, sphere, _wavevector(sphere, vector), physics)
    return [
        branch_mode(str(n), vector, *each) for n, each in enumerate(zip(frequencies.tolist(), shapes, strict=True), 1)
    ]


def branches(
    lattice: Contacts, sphere: Sphere, vectors: Sequence[WaveVector], physics: Physics = FULL
) -> dict[str, Floats]:
    """Return the frequencies (K,) of the modes in `modes_at` at wave vectors of one direction, by name.

    In directions other than x and y, where branches exchange their names, they are numbered from the lowest.
    """
    names, axis = restored(lattice, physics), vectors[0].axis
    k = np.array([_wavevector(sphere, each) for each in vectors])
    if len(lattice.mass) > 1 or physics.space:
        return dict(zip(names, bloch_modes(lattice, sphere, k, physics)[0].T, strict=True))
    if axis:
        bases = {name: [each for each in _SUBSPACE[axis][name][0] if each in physics.coordinates] for name in names}
        return {
            name: solve(lattice, sphere, k, physics, np.array(basis))[0][:, _SUBSPACE[axis][name][1]]
            for name, basis in bases.items()
        }
    frequencies, shapes = bloch_modes(lattice, sphere, k, physics)
    there = [[name in names for name in branch_names(each, np.array(vectors[0].unit))] for each in shapes]
    return {str(n): each for n, each in enumerate(frequencies[np.array(there)].reshape(len(k), -1).T, 1)}


def _in_space(lattice: Contacts, sphere: Sphere, vector: WaveVector, name: str, physics: Physics) -> Mode:
    """Return the mode of a crystal in space by a name from its symmetry, or by number."""
    if name in (numbers := restored(lattice, physics)):
        return _branch(lattice, sphere, vector, name, physics)
    names = named_in_space(lattice, sphere, vector, physics)
    if name not in names:
        known = (*names, f"{numbers[0]} to {numbers[-1]}")
        raise SceneError(
            f"wave.mode = {name!r}: must be one of {', '.join(known)} in this crystal and direction", because="physics"
        )
    frequency, shape = names[name]
    if frequency < _STILL * highest_frequency(lattice, sphere, physics):
        raise SceneError(
            f"wave.mode = {name!r}: has the frequency 0 at this wave vector, as no contact resists it",
            because="physics",
        )
    return branch_mode(name, vector, frequency, shape)


@lru_cache(maxsize=128)  # callers ask for the waves of a wave vector one name at a time
def named_in_space(
    lattice: Contacts, sphere: Sphere, vector: WaveVector, physics: Physics
) -> dict[str, tuple[float, NDArray[Any]]]:
    """Return the frequencies and shapes of the waves of a crystal in space whose names come from mirrors, by name."""
    found: dict[str, tuple[float, NDArray[Any]]] = {}
    x, y = vector.unit
    along, across = np.array([x, y, 0.0]), np.array([-y, x, 0.0])
    up, none, axes = np.array([0.0, 0.0, 1.0]), np.zeros(3), np.eye(3)
    sagittal = [(along, none), (up, none), (none, across)]
    horizontal = [(across, none), (none, along), (none, up)]
    plane = [(axes[0], none), (axes[1], none), (none, axes[2])]
    leaving = [(axes[2], none), (none, axes[0]), (none, axes[1])]
    k = _wavevector(sphere, vector)
    for letters, one, other in (("SH", sagittal, horizontal), ("P", plane, leaving)):
        bases = [_spread(each, len(lattice.mass), physics) for each in (one, other)]
        if letters == "P" and len(lattice.mass) > 1 or not part(lattice, sphere, k, physics, *bases):
            continue
        for letter, basis in zip(letters, bases, strict=False):
            frequencies, shapes = _lowest(lattice, sphere, k, physics, basis)
            if letter == "P":
                names = branch_names(shapes, np.array(vector.unit))
            else:
                names = tuple(f"{letter}{number}" for number in range(1, len(frequencies) + 1))
            found |= dict(zip(names, zip(frequencies.tolist(), shapes, strict=True), strict=True))
    return found


def _spread(ways: list[tuple[Floats, Floats]], spheres: int, physics: Physics) -> Any:
    """Return motions (u, f) of single spheres, for each sphere of a cell, as orthonormal columns (6N, F).

    Motions with a rotation are left out if spheres do not turn.
    """
    columns = np.array([np.concatenate(way) for way in ways if physics.rotation or not way[1].any()]).T
    if spheres <= _MANY:
        return np.kron(np.eye(spheres), columns)
    from scipy.sparse import eye_array, kron  # slow to import, and only thick films need it

    return kron(eye_array(spheres), columns, "csr")


def _lowest(
    lattice: Contacts, sphere: Sphere, wavevector: Floats, physics: Physics, basis: Any, least: int = 0
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return frequencies and shapes as `solve` does; in a cell of many spheres only the `_LOWEST` lowest branches.

    Arnoldi's method on the inverse matrix finds them in a time proportional to the number of spheres. Raises SceneError
    if the branch number `least` is beyond these.
    """
    if len(lattice.mass) <= _MANY:
        return solve(lattice, sphere, wavevector, physics, basis)
    if least > _LOWEST:
        raise SceneError(
            f"wave.mode = '{least}': must be at most {_LOWEST} in a crystal of {len(lattice.mass)} spheres per cell, "
            f"or packing.layers fewer: higher branches are found in cells of at most {_MANY} spheres",
            because="physics",
        )
    from scipy.sparse.linalg import eigs

    matrix, inverse_root_mass = matrix_of(lattice, sphere, wavevector, physics)
    within = (basis.conj().T @ matrix @ basis).tocsc()
    start = np.random.default_rng(0).standard_normal(within.shape[0])
    # The shift is just below 0, so that motions of frequency 0 do not make the matrix singular
    squared, vectors = eigs(within, _LOWEST, sigma=-_BELOW * abs(matrix).max(), v0=start)
    order = np.argsort(squared.real)
    shapes = (basis @ vectors[:, order]).T * inverse_root_mass
    shapes /= np.linalg.norm(shapes, axis=-1, keepdims=True)
    return np.sqrt(np.maximum(squared.real[order], 0.0)), shapes


def _branch(lattice: Contacts, sphere: Sphere, vector: WaveVector, name: str, physics: Physics) -> Mode:
    k, number = _wavevector(sphere, vector), int(name)
    if len(lattice.mass) > _MANY:
        frequencies, shapes = _lowest(lattice, sphere, k, physics, _every(lattice, physics), number)
    else:
        frequencies, shapes = bloch_modes(lattice, sphere, k, physics)
    own, others = frequencies[number - 1], np.delete(frequencies, number - 1)
    where = f"wave.mode = '{number}': has the frequency"
    if own < _STILL * frequencies[-1]:
        raise SceneError(
            f"{where} 0 at this wave vector, as no contact resists it; needs effects.rolling_stiffness",
            because="physics",
        )
    if np.abs(others - own).min() < _MEET * own:
        raise SceneError(
            f"{where} of another branch at this wave vector, so its shape is not unique; take another wave vector",
            because="physics",
        )
    return branch_mode(name, vector, float(own), shapes[number - 1])


def branch_names(shapes: NDArray[Any], along: Floats) -> tuple[str, ...]:
    """Return L, TR or RT for each branch, from shapes in ascending frequency and the unit vector `along` (2,) of k."""
    longitudinal, others = int(np.argmax(np.abs(shapes[:, :2] @ along))), iter(MODES[1:])
    return tuple("L" if branch == longitudinal else next(others) for branch in range(len(shapes)))


@lru_cache(maxsize=1)  # several rules ask for the same result
def contact_stretches(contacts: Contacts, sphere: Sphere, mode: Mode) -> tuple[Floats, Floats]:
    """Return the amplitudes of δN and δS of contacts in a wave of the perfect lattice, (C,) each, in units of D0.

    All amplitudes are in phase; with several spheres per cell they are moduli. For an imperfect crystal they assume
    that imperfections do not change the wave.
    """
    normal, shear = (np.empty(len(contacts)) for _ in range(2))
    of_part = _moduli if mode.cell else _in_phase
    for block, some in zip(blocks(len(contacts)), contacts.parts(), strict=True):
        normal[block], shear[block] = of_part(some, sphere, mode)
    for each in (normal, shear):
        each.setflags(write=False)  # because callers share the cached arrays
    return normal, shear


def _in_phase(contacts: Contacts, sphere: Sphere, mode: Mode) -> tuple[Floats, Floats]:
    """Return δN and δS of the contacts in a mode of one sphere per cell."""
    half_phase = contacts.vector[:, :2] @ _wavevector(sphere, mode.vector) / sphere.radius / 2
    moved, shape = 2 * np.sin(half_phase), np.array([mode.ux, mode.uy])
    normal = moved * (contacts.normals[:, :2] @ shape)
    shear = moved * (contacts.tangents[:, 0, :2] @ shape) - 2 * np.cos(half_phase) * mode.f
    return normal, shear


def _moduli(contacts: Contacts, sphere: Sphere, mode: Mode) -> tuple[Floats, Floats]:
    """Return |δN| and |δS| of the contacts of a cell of several spheres; upper bounds for another crystal."""
    if len(contacts.mass) == len(mode.cell):
        normal, sideways, turn = stretch_rows(contacts, _wavevector(sphere, mode.vector) / sphere.radius)
        shape = _freedoms(mode)
        slips = [(sideways[way] + turn[way]) @ shape for way in range(2)]
        return np.abs(normal @ shape), np.hypot(*np.abs(slips))
    moved, turned = mode.shape()[:, :FX], np.abs(mode.shape()[:, FX:]).max()
    normal, *across = (
        np.abs(each @ moved.T).max(axis=1) for each in (contacts.normals, *contacts.tangents.swapaxes(0, 1))
    )
    return 2 * normal, 2 * (np.hypot(*across) + turned)


def contact_rolls(lattice: Contacts, sphere: Sphere, mode: Mode) -> NDArray[np.complex128]:
    """Return the amplitudes of the rolls ρ of the contacts of a cell, (C,), in units of D0."""
    return roll_rows(lattice, _wavevector(sphere, mode.vector) / sphere.radius) @ _freedoms(mode)


def _freedoms(mode: Mode) -> NDArray[np.complex128]:
    """Return (u, f) of each sphere of a cell in turn, (6P,)."""
    return (mode.shape() / TURNS).ravel()


@lru_cache(maxsize=64)  # all runs of a sweep have the same
def highest_frequency(lattice: Contacts, sphere: Sphere, physics: Physics = FULL) -> float:
    """Return the highest frequency of a lattice, rad/t0: velocity Verlet is stable for Δτ < 2/Ω.

    For solid spheres whose contacts do not resist rolling, it is at Γ, where all spheres turn in phase:
    Ω² = 2zκ(1−η)/(Ĩ(κ+3)), with z contacts per sphere: 3, 2 and 1 in the hexagonal lattice, the square lattice and the
    chain. Otherwise it lies on edges of the zone (`Lattice.corners`), in the hexagonal lattice at a place that depends
    on κ; 120 points find it to 1e-4. For other crystals use `granular_lmp.crystal.stability.frequency_bound`.
    """
    if physics.space:
        return _highest_in_space(lattice, sphere, physics)
    kind = lattice_of_contacts(lattice, sphere)
    path = np.zeros((1, 2))
    if not physics.rotation or physics.rolling or sphere.stiffness_ratio < _SOFTEST:
        path = zone_path(kind.corners, 60) / kind.column_distance(lattice_constant(sphere))
    return float(bloch_modes(lattice, sphere, path, physics)[0].max())


def _highest_in_space(crystal: Contacts, sphere: Sphere, physics: Physics) -> float:
    """Return the highest frequency, rad/t0, over a grid of wave vectors in the plane, which includes Γ.

    For a film of many layers the result is an upper bound, at most 1e-3 too high, at the wave vectors of the grid where
    a film of few of its layers has the highest frequencies.
    """
    share = np.pi * np.arange(_POINTS) / _POINTS * 2 * sphere.radius / float(crystal.length.min())
    grid = np.array(list(product(share, repeat=2)))
    thick = len(crystal.mass) > SPARSE
    few = _layers_of(crystal, _FEW) if thick else crystal
    tops = np.concatenate([bloch_modes(few, sphere, k, physics)[0].max(axis=-1) for k in np.split(grid, _POINTS)])
    if not thick:
        return float(tops.max())
    best = np.argsort(-tops, kind="stable")[:_BEST]
    moving = _moving(crystal, physics)
    start = np.random.default_rng(0).standard_normal(len(moving)).astype(complex)
    squares = []
    for k in grid[best[tops[best] > _NEAR * tops[best[0]]]]:
        matrix = matrix_of(crystal, sphere, k, physics)[0][moving][:, moving]
        whole = (matrix + matrix.conj().T) / 2  # true torque arms make the matrix slightly non-Hermitian
        squares.append(top_bound(whole.dot, start, len(start)))
    return float(np.sqrt(max(squares)))


def _every(crystal: Contacts, physics: Physics) -> Any:
    """Return all moving freedoms of a cell as sparse columns, (6N, F)."""
    from scipy.sparse import eye_array  # slow to import, and only thick films need it

    return eye_array(6 * len(crystal.mass), format="csr")[:, _moving(crystal, physics)]


def _moving(crystal: Contacts, physics: Physics) -> NDArray[np.int64]:
    """Return the indices of the moving freedoms of a cell, (F,)."""
    return (6 * np.arange(len(crystal.mass))[:, None] + np.array(physics.coordinates)).ravel()


def _layers_of(crystal: Contacts, count: int) -> Contacts:
    """Return the contacts, with each other and the wall, of the `count` spheres of a film nearest to the first one."""
    from scipy.sparse import coo_array  # slow to import, and only thick films need it
    from scipy.sparse.csgraph import breadth_first_order

    pairs, spheres = ~crystal.on_wall, len(crystal.mass)
    ends = crystal.i[pairs], crystal.j[pairs]
    graph = coo_array((np.ones(len(ends[0])), ends), (spheres, spheres)).tocsr()
    chosen = breadth_first_order(graph, 0, directed=False, return_predecessors=False)[:count]
    place = np.full(spheres + 1, -1)  # the last entry is for walls, whose index is −1
    place[chosen] = np.arange(len(chosen))
    kept = (place[crystal.i] >= 0) & (crystal.on_wall | (place[crystal.j] >= 0))
    own = {each.name: getattr(crystal, each.name)[kept] for each in fields(crystal) if each.name not in _OF_SPHERES}
    of_spheres = {name: getattr(crystal, name)[chosen] for name in _OF_SPHERES}
    return replace(crystal, **own | {"i": place[own["i"]], "j": place[own["j"]]} | of_spheres)


def row_stretches(lattice: Contacts, ux: float, uy: float) -> tuple[Floats, Floats]:
    """Return δN and δS of the contacts, (C,) each, between a row shifted by (ux, uy) and the next one at rest."""
    shift, normal, shear = np.array([ux, uy]), np.empty(len(lattice)), np.empty(len(lattice))
    for block, some in zip(blocks(len(lattice)), lattice.parts(), strict=True):
        normal[block] = some.normals[:, :2] @ shift
        shear[block] = np.linalg.norm(some.tangents[:, :, :2] @ shift, axis=1)
    return normal, shear


def decay_rate(lattice: Contacts, sphere: Sphere, mode: Mode, viscosity: float, *, shear: bool = True) -> float:
    """Return the decay rate Γ of a mode whose contacts are damped, in 1/t0: its amplitude falls as e^{−Γτ}.

        Γ = ½ c Σ_contacts (δN² + δS²) / Σ_spheres (m/m0) (u² + Ĩ f²)

    The formula is the power of the dashpots divided by twice the energy of the mode; it holds for weak damping, Γ ≪ Ω.

    Parameters
    ----------
    lattice, sphere, mode
        As in `contact_stretches`.
    viscosity : float
        Dashpot c of a contact, along its normal and along its tangent, in m/t0.
    shear : bool
        True if contacts have a dashpot along the tangent too.
    """
    normal, tangential = contact_stretches(lattice, sphere, mode)
    squares = np.sum(normal**2) + (np.sum(tangential**2) if shear else 0.0)
    return float(viscosity * squares / (2 * sum(kinetic_parts(lattice, sphere, mode))))


def kinetic_parts(lattice: Contacts, sphere: Sphere, mode: Mode) -> tuple[float, float]:
    """Return Σ (m/m0) u² and Σ (m/m0) Ĩ f² over a cell: the kinetic energies of displacement and of rotation."""
    mass = lattice.mass / sphere.mass if mode.cell else np.ones(1)
    squares = mass @ np.abs(mode.shape()) ** 2
    return float(squares[:FX].sum()), float(INERTIA_RATIO * squares[FX:].sum())


def _wavevector(sphere: Sphere, vector: WaveVector) -> Floats:
    """Return the components of a wave vector in 1/R."""
    return np.array(vector.components) / lattice_constant(sphere)


def _sign(name: str, vector: WaveVector, shape: NDArray[Any]) -> float:
    """Return the sign (+1 or −1) that makes the larger of p and q positive.

    If both vanish, the sign makes f negative, except for TR along y, where f is positive.
    """
    larger = max(vector.along(*shape[:2]), vector.across(*shape[:2]), key=abs)
    if abs(larger) > 1e-9:  # along y q vanishes as sin ξ, so the code below is reached only at ξ = π, to rounding
        return float(np.sign(larger))
    return float(np.sign(shape[F])) * (1 if name == "TR" and vector.axis == "y" else -1)
