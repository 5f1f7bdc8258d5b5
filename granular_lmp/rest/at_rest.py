"""Crystal of a scene: its spheres at their places in the lattice, and at rest.

In a perfect lattice these are the same. Otherwise `granular_lmp.crystal.disorder` makes the spheres, and
`granular_lmp.crystal.equilibrium` brings them to rest.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.adhesion_laws import AdhesionLaw, chosen
from granular_lmp.crystal.contacts import Contacts, find_contacts, law_between
from granular_lmp.crystal.disorder import AVALANCHES, WHOLE, Disorder, Inclusion, imperfect
from granular_lmp.crystal.lattices import CHAIN, HELD, PERIODIC, WALL, Shape, centre, packed
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.sphere_table import SITE, STIFFNESSES, SphereTable
from granular_lmp.crystal.stiffnesses import Pair
from granular_lmp.crystal.walls import Face, Wall
from granular_lmp.errors import CrystalError
from granular_lmp.frozen import dataclass
from granular_lmp.rest.linear import unit_contacts
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.monitors import Monitor

if TYPE_CHECKING:
    from granular_lmp.crystal.equilibrium import Equilibrium
    from granular_lmp.crystal.let_go import Progress


@dataclass(frozen=True, eq=False)
class CrystalAtRest:
    """Spheres of a scene at rest.

    Attributes
    ----------
    atoms : ase.Atoms
        Positions and radii in radii R of the declared sphere, with the arrays of `granular_lmp.crystal.lattices` and
        of `granular_lmp.crystal.disorder`. Masses are in units of the mass of the declared sphere. Spheres have no
        chemical element; their tags are indices of `materials`.
    materials : tuple of Sphere
        Materials by index of the array ``material``; the sphere of the lattice first.
    contacts : Contacts
        Contacts of all spheres; in a perfect lattice, of one sphere.
    equilibrium : Equilibrium, optional
        Record of the relaxation; None for a perfect lattice.
    of_one : bool
        True if the contacts are those of one sphere, which stands for all.
    """

    atoms: ase.Atoms
    materials: tuple[Sphere, ...]
    contacts: Contacts
    equilibrium: "Equilibrium | None" = None
    of_one: bool = False

    def __post_init__(self) -> None:
        arrays, density = self.atoms.arrays, self.materials[0].density
        self.atoms.set_tags(arrays.get("material", 0))
        self.atoms.set_masses(arrays["radius"] ** 3 * arrays.get("density", density) / density)

    def remarks(self) -> list[str]:
        """Return notes on spheres that are left out, touch no other at rest, or were pushed off their wall."""
        if self.equilibrium is None:
            return []
        isolated, rattlers = self.equilibrium.lattice.info["isolated"], self.equilibrium.rattlers
        lifted = self.equilibrium.lifted
        said = {
            f"{isolated} spheres are left out, because vacancies leave them without a neighbour": isolated,
            f"{rattlers} spheres touch no other at rest, and do not move until they are hit": rattlers,
            f"{lifted} spheres do not touch their wall, from which relaxation pushed them away": lifted,
        }
        return [words for words, count in said.items() if count]


Floats = NDArray[np.float64]
_MOST_KEPT = 2
_BALANCED = 1e-6  # share of the load; rounding of the normals is far smaller
# Seconds for 1e4 spheres in the plane with s = 1, fitted for s from 0.2 to 4 and up to 1e5 spheres; and a long time
_OF_WHOLE, _WORTH_A_WORD = 2.2, 20.0
_KEPT: dict[tuple[Any, ...], CrystalAtRest] = {}


def crystal_of(scene: Scene, progress: "Progress | None" = None) -> CrystalAtRest:
    """Return the crystal of a scene at rest; `granular_lmp.crystal.equilibrium.relax` describes `progress`.

    The last two crystals are cached, so a scene whose time or wave changes is not relaxed again.

    Raises
    ------
    CrystalError
        If imperfections do not fit into the lattice, or the spheres do not come to rest.
    """
    held = scene.held_at_rest
    if scene.perfect and held:
        return CrystalAtRest(packed(scene.sphere, scene.shape), (scene.sphere,), contacts_of(scene), of_one=True)
    packing, walls = scene.packing, (scene.wall, scene.rigid)
    imperfections = scene.disorder, scene.inclusion, scene.pair, packing.table
    way = (packing.relax, packing.relax_friction, packing.relax_by) if held else (scene.material, packing)
    key = scene.sphere, scene.shape, scene.space, *imperfections, *walls, *way
    if key not in _KEPT:
        _KEPT[key] = _relaxed(scene, progress) if held else _touching(scene)
        while len(_KEPT) > _MOST_KEPT:
            del _KEPT[next(iter(_KEPT))]
    return _KEPT[key]


def remarks_on_wait(scene: Scene) -> list[str]:
    """Return a sentence that names the faster method if a crystal in the plane relaxes slowly, else nothing."""
    if scene.scale.of_impact or scene.space == 3 or scene.packing.relax_by != WHOLE:
        return []
    count, spread = scene.shape.spheres, scene.disorder.radius / scene.sphere.overlap_ratio
    seconds = round(_OF_WHOLE * spread**1.3 * (count / 1e4) ** 1.7, -1)
    if seconds < _WORTH_A_WORD:
        return []
    return [
        f"{count} spheres with disorder.radius = {scene.disorder.radius!r} take about {seconds:.0f} s to relax; "
        f'packing.relax_by = "{AVALANCHES}" is three to five times as fast, and ends with other contacts, but as many'
    ]


def law_at_rest(scene: Scene) -> AdhesionLaw:
    """Return the laws of all contacts at rest, also with walls: one in a perfect lattice, else one for each."""
    contacts, laws = contacts_of(scene), [scene.sphere.contact_law]
    which = np.zeros(len(contacts), dtype=int)
    if not scene.perfect:
        rest = crystal_of(scene)
        laws = [law_between(rest.atoms, rest.materials, contacts.i, contacts.j)]
    for number, (wall, outward) in enumerate(_walls(scene), 1):
        of_one = wall.law(contacts.radius[contacts.i])
        laws.append(of_one if scene.perfect else wall.law_of(rest.atoms, rest.materials, contacts.i))
        which[contacts.on_wall & (contacts.normals @ outward > 0.5)] = number
    return chosen(which, laws) if len(laws) > 1 else laws[0]


def _faces(scene: Scene) -> list[Face]:
    """Return the walls at the faces of a scene; each overlaps its outermost spheres until it balances their push.

    Raises
    ------
    CrystalError
        If the load pushes spheres out of the lattice where no wall holds them.
    """
    walls = list(_walls(scene))
    if not walls:
        return []
    lattice, sphere = packed(scene.sphere, scene.shape), scene.sphere
    push, faces = _push(find_contacts(lattice, [sphere], sphere.contact_force)), list[Face]()
    for wall, outward in walls:
        outermost = Face(wall, outward, 0.0).touches(lattice)
        load = float((push[outermost] @ outward).max())
        faces.append(Face(wall, outward, float(wall.law(sphere.radius).overlap_under(load))))
        push[outermost] -= load * outward
    if scene.rigid:
        _require_balance(sphere, push[~lattice.arrays["fixed"]])
    return faces


def _walls(scene: Scene) -> Iterator[tuple[Wall, Floats]]:
    """Yield the walls of a crystal at rest, each with its outward unit vector."""
    x, y, z = np.eye(3)
    if scene.wall:
        yield from ((scene.wall, height * z) for height in scene.wall.heights)
    if scene.rigid:
        ways = {"first": (-y,), "last": (y,), "sides": (-x, x)}
        faces = (name for name, face in scene.shape.faces.items() if face == WALL)
        yield from ((scene.rigid, way) for name in faces for way in ways[name])


def _push(contacts: Contacts) -> Floats:
    """Return the force on each sphere from its contacts with other spheres at rest, N, (N, 3)."""
    force = contacts.contact_force[:, None] * contacts.normals
    total = np.zeros((len(contacts.mass), 3))
    np.subtract.at(total, contacts.i, force)
    np.add.at(total, contacts.j, force)
    return total


def _require_balance(sphere: Sphere, force: Floats) -> None:
    """Raise CrystalError if, beside rigid planes, contacts at rest leave a force on a sphere that is not held."""
    load = sphere.contact_force
    if load and np.abs(force).max(initial=0.0) > _BALANCED * load:
        raise CrystalError(
            f"packing.contact_force = {load!r}: must be 0 with these walls, which do not touch all spheres that the "
            "load pushes out of the crystal"
        )


def _touching(scene: Scene) -> CrystalAtRest:
    """Return spheres that just touch, have gaps, or are pressed together in a chain."""
    from granular_lmp.crystal.touching import contacts_of_neighbours, touching  # kept out of start-up

    packing, shape = scene.packing, scene.shape
    crystal, materials = touching(
        scene.material,
        scene.lattice,
        shape.rows,
        shape.columns,
        held=(packing.first == HELD, packing.last == HELD),
        periodic=(packing.sides == PERIODIC, shape.along_y),
        force=packing.contact_force,
        disorder=scene.disorder,
        inclusions=scene.inclusion,
        table=packing.table,
    )
    contacts = contacts_of_neighbours(crystal, materials, pressed=packing.contact_force > 0)
    return CrystalAtRest(crystal, materials, contacts)


def contacts_of(scene: Scene) -> Contacts:
    """Return the contacts of the crystal of a scene at rest; in a perfect lattice, of one sphere."""
    return unit_contacts(scene) if scene.perfect else crystal_of(scene).contacts


def chain_cell(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return masses and stiffnesses of the cell of a chain at rest with unequal spheres, for `edges`.

    Units are the mass of the sphere of the lattice and its t0. Returns None for a sheet, for a perfect chain, and for a
    chain whose spheres do not repeat in any order.
    """
    if scene.lattice != CHAIN or scene.perfect:
        return None
    from granular_lmp.crystal.chain_bands import cell_of  # kept out of start-up

    contacts, sphere = contacts_of(scene), scene.sphere
    along = np.argsort(np.minimum(contacts.i, contacts.j), kind="stable")
    beside = (np.abs(contacts.i - contacts.j) == 1) & ~contacts.on_wall  # without the contact across a periodic face
    within = along[beside[along]]
    mass = contacts.mass / sphere.mass
    stiffness = contacts.normal_stiffness[within] * sphere.time_scale**2 / sphere.mass
    count = cell_of(mass, stiffness) if len(stiffness) == len(mass) - 1 else 0
    return (mass[:count], stiffness[:count]) if count else None


def swiftness(scene: Scene) -> float:
    """Return a bound √(max k/k1 · m/min m) ≥ 1 on speeds and frequencies over those of the perfect lattice.

    No wave is faster than in a lattice where all contacts are as stiff as the stiffest and all spheres as light as the
    lightest; contacts with a wall carry no wave. The bound ignores the rotational branch.
    """
    sphere, contacts = scene.sphere, contacts_of(scene)
    stiffest = (
        contacts.normal_stiffness[~contacts.on_wall].max(initial=sphere.normal_stiffness) / sphere.normal_stiffness
    )
    return float(np.sqrt(stiffest * sphere.mass / contacts.mass.min(initial=sphere.mass)))


def echo_at(scene: Scene, monitor: Monitor) -> float:
    """Return the time τ at which the echo of the faces may reach a monitor; infinite if there is no echo."""
    return scene.echo_at(monitor.span, monitor.breadth(scene.shape.columns)) / swiftness(scene)


def places(scene: Scene) -> ase.Atoms:
    """Return the spheres of a scene at their places in the lattice, before they come to rest."""
    return _made(scene)[0]


def table_of(scene: Scene) -> SphereTable:
    """Return the densities and radii of all spheres of a scene, and the factors of stiffness of its table.

    A table has no moduli, adhesion, vacancies, pairs or spread of stiffnesses.
    """
    atoms = places(scene) if scene.held_at_rest else crystal_of(scene).atoms
    count, table = scene.shape.spheres, scene.packing.table
    sites = atoms.arrays["site"]
    factors = {name: table.values(name, count, 1.0)[sites] for name in STIFFNESSES if name in table.columns}
    own = {"density": atoms.arrays["density"], "radius": atoms.arrays["radius"] * scene.sphere.radius}
    return SphereTable.of({SITE: sites, **own, **factors})


def sphere_count(scene: Scene) -> int:
    """Return the number of spheres of a scene without vacancies."""
    return scene.shape.spheres if scene.perfect else len(places(scene))


def _made(scene: Scene) -> tuple[ase.Atoms, tuple[Sphere, ...]]:
    """Return the spheres of a scene at their places in the lattice, and their materials."""
    return _imperfect(scene.sphere, scene.shape, scene.disorder, scene.inclusion, scene.pair, scene.packing.table)


@lru_cache(maxsize=2)  # the number of spheres is needed before they come to rest
def _imperfect(
    sphere: Sphere,
    shape: Shape,
    disorder: Disorder,
    inclusions: tuple[Inclusion, ...],
    pairs: tuple[Pair, ...],
    table: SphereTable,
) -> tuple[ase.Atoms, tuple[Sphere, ...]]:
    lattice = packed(sphere, shape)
    return imperfect(lattice, sphere, disorder, inclusions, pairs, table=table, recorded=centre(lattice))


def _relaxed(scene: Scene, progress: "Progress | None") -> CrystalAtRest:
    # Kept out of start-up: most crystals are perfect
    from granular_lmp.crystal.equilibrium import relax
    from granular_lmp.crystal.potential import box_load

    sphere, shape, packing = scene.sphere, scene.shape, scene.packing
    crystal, materials = _made(scene)
    faces, box = _faces(scene), packing.relax
    pressed = sphere.contact_force and box == "box"
    rest = relax(
        crystal,
        materials,
        box=box,
        load=box_load(packed(sphere, shape), sphere, faces, scene.space) if pressed else None,
        friction=packing.relax_friction,
        by=packing.relax_by,
        faces=faces,
        space=scene.space == 3,
        progress=progress,
    )
    if rest.contacts.on_wall.all():
        raise CrystalError("no two spheres touch at rest: all spheres are too small for their places in the lattice")
    if shape.lattice == CHAIN:
        _require_whole(rest, shape)
    return CrystalAtRest(rest.crystal, materials, rest.contacts, rest)


def _require_whole(rest: "Equilibrium", shape: Shape) -> None:
    """Raise CrystalError if neighbours in a chain do not touch at rest."""
    row = rest.lattice.arrays["row"]
    neighbours = int(np.count_nonzero(np.diff(row) == 1))
    neighbours += shape.along_y and row[0] == 0 and row[-1] == shape.rows - 1
    if (parted := neighbours - int(np.count_nonzero(~rest.contacts.on_wall))) > 0:
        raise CrystalError(
            f"the chain at rest is open at {parted} of {neighbours} contacts, where spheres are too small to reach "
            "their neighbours; let radii differ less"
        )
