"""Third dimension of a scene: its lattice with orientation and layers, and its walls."""

from dataclasses import replace

from granular_lmp.crystal.lattice import LATTICES, Lattice, orientations_of
from granular_lmp.crystal.lattices import FREE, PERIODIC
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.stiffnesses import measured_factors
from granular_lmp.crystal.walls import Wall
from granular_lmp.errors import SceneError
from granular_lmp.scene.bodies import Substrate
from granular_lmp.scene.schema import AUTO, shown
from granular_lmp.scene.sections import Effects, Packing


def lattice_of(packing: Packing, substrate: Substrate | None) -> Lattice:
    """Return the lattice of a packing; a film has all its layers in one cell.

    Raises
    ------
    SceneError
        If orientation, layers or faces along z do not fit the lattice.
    """
    known = orientations_of(packing.lattice)
    if not known:
        return _of_one_layer(packing)
    if packing.orientation not in (*known, AUTO):
        raise SceneError(
            f'packing.orientation = "{packing.orientation}": must be one of {", ".join(known)} with packing.lattice = '
            f'"{packing.lattice}"',
            because="physics",
        )
    if substrate and packing.depth == PERIODIC:
        raise SceneError(
            'packing.depth = "periodic": must be "free" or "auto" on a [substrate], which ends the crystal',
            because="physics",
        )
    lattice = LATTICES[f"{packing.lattice} {known[0] if packing.orientation == AUTO else packing.orientation}"]
    if substrate or packing.depth == FREE:
        return lattice.layered(1 if packing.layers == AUTO else int(packing.layers))
    layers = lattice.fewest_layers if packing.layers == AUTO else int(packing.layers)
    if layers < lattice.fewest_layers or layers % lattice.layer_period:
        raise SceneError(
            f"packing.layers = {layers}: must be a multiple of {lattice.layer_period}, at least "
            f'{lattice.fewest_layers}, in a crystal that is periodic along z; packing.depth = "free" allows any number',
            because="physics",
        )
    return lattice


def _of_one_layer(packing: Packing) -> Lattice:
    others = {"layers": (1, AUTO), "depth": (FREE, AUTO), "orientation": (AUTO,)}
    for key, allowed in others.items():
        if (value := getattr(packing, key)) not in allowed:
            raise SceneError(
                f'packing.{key} = {shown(value)}: must be left out with packing.lattice = "{packing.lattice}", which '
                "has one layer; cubic, fcc and hcp have layers",
                because="physics",
            )
    return LATTICES[packing.lattice]


def space_of(packing: Packing, lattice: Lattice, substrate: Substrate | None) -> int:
    """Return the dimensions in which spheres move, 2 or 3.

    Raises
    ------
    SceneError
        If a scene in the plane has something outside the plane.
    """
    out_of_plane = "[substrate]" if substrate else f'packing.lattice = "{packing.lattice}"' if lattice.solid else ""
    if packing.space == 2 and out_of_plane:
        raise SceneError(
            f"packing.space = 2: must be 3 or left out with {out_of_plane}, which leaves the plane", because="physics"
        )
    return int(packing.space) if packing.space != AUTO else 3 if out_of_plane else 2


def remarks_on_space(lattice: Lattice, substrate: Substrate | None, space: int) -> list[str]:
    """Return a note on a layer that nothing holds along z."""
    if space == 2 or lattice.solid or substrate:
        return []
    return ["nothing holds the layer along z: motions out of its plane have frequency 0 if they only turn contacts"]


def wall_of(material: Sphere, substrate: Substrate | None, effects: Effects) -> Wall | None:
    """Return the walls of a scene; None without a substrate.

    Raises
    ------
    SceneError
        If nothing holds the spheres on it.
    """
    if substrate is None:
        return None
    if trouble := substrate_trouble(material, substrate, effects):
        raise SceneError(trouble, because="physics")
    half_space = replace(
        material,
        youngs_modulus=substrate.youngs_modulus,
        poisson_ratio=substrate.poisson_ratio,
        work_of_adhesion=substrate.work_of_adhesion,
    )
    wall = Wall(material, half_space, sides=substrate.sides)
    return replace(wall, factors=measured_factors(substrate, wall.law(material.radius), load=0.0))


def substrate_trouble(material: Sphere, substrate: Substrate | None, effects: Effects) -> str:
    """Return the error if nothing holds the spheres on a substrate; "" if they adhere or there is no substrate."""
    if substrate is None or material.work_of_adhesion and effects.adhesion is not False:
        return ""
    return (
        f"substrate.work_of_adhesion = {substrate.work_of_adhesion!r}: needs sphere.work_of_adhesion above 0 and "
        "effects.adhesion not false, as only adhesion holds spheres on the substrate"
    )
