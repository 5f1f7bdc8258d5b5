"""Checks of a scene whose spheres come to rest: their lattice, their walls, and measured stiffnesses."""

from granular_lmp.crystal.disorder import Disorder, Inclusion
from granular_lmp.crystal.lattices import CHAIN, ENDS_OF_Y, WALL, Lattice
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import SceneError
from granular_lmp.scene.bodies import Contact, Substrate
from granular_lmp.scene.sections import Effects, Packing


def check_arrangement(
    lattice: Lattice,
    space: int,
    packing: Packing,
    bodies: tuple[Sphere, Contact, Substrate | None],
    disorder: Disorder,
    inclusions: tuple[Inclusion, ...],
) -> None:
    """Check that spheres that differ do not press a lattice out of its arrangement as they come to rest.

    Spheres come to rest without friction. Lines of contacts run through a square and a cubic lattice, which resists no
    shear then, so every contact must be at rest where it is; a chain resists no shift sideways, so it must not be
    compressed, and a layer in space no push along z. Measured stiffnesses are of one material.
    """
    material, contact, substrate = bodies
    measured = [contact.normal_stiffness, contact.shear_stiffness]
    measured += [substrate.normal_stiffness, substrate.shear_stiffness] if substrate else []
    for key, value in _unequal(material, disorder, inclusions).items():
        if space == 3 and not lattice.solid and substrate is None:
            raise SceneError(
                f"{key} = {value!r}: must be that of all spheres in a layer that nothing holds along z, out of which "
                "contacts that push would press them; needs a [substrate], or packing.space = 2"
            )
        if any(measured) and not key.endswith("radius"):
            raise SceneError(
                f"{key} = {value!r}: must be left out beside measured stiffnesses, which are of the spheres of the "
                "lattice"
            )
        if lattice.collapses:
            raise SceneError(
                f'{key} = {value!r}: must be that of all spheres with packing.lattice = "{packing.lattice}", which has '
                "no shear stiffness without friction and would collapse as it comes to rest"
            )
        if lattice == CHAIN and packing.relax == "fixed":
            raise SceneError(
                f'packing.relax = "fixed": must be "box" with {key} = {value!r} in a chain, which would buckle in a '
                "box that stays"
            )
    empty = disorder.vacancies > 0 or any(each.vacancy for each in inclusions)
    if lattice.collapses and packing.contact_force and empty:
        raise SceneError(
            f"packing.contact_force = {packing.contact_force!r}: must be 0 in a {packing.lattice} lattice with "
            "vacancies, into which its spheres would be pressed"
        )


def _unequal(material: Sphere, disorder: Disorder, inclusions: tuple[Inclusion, ...]) -> dict[str, float]:
    """Return by key what makes contacts differ: radii, moduli and adhesion that are not those of the lattice."""
    found = {"disorder.radius": disorder.radius} if disorder.radius else {}
    for number, inclusion in enumerate(inclusions, start=1):
        own = inclusion.of_material | ({} if inclusion.radius is None else {"radius": inclusion.radius})
        found |= {f"inclusion {number}: {key}": value for key, value in own.items() if value != getattr(material, key)}
    return found


def check_walls(packing: Packing, contact: Contact, effects: Effects) -> None:
    """Check that nothing is asked of a crystal at rest whose faces are rigid planes that these do not know."""
    troubles = {
        "[contact]": contact != Contact(),
        "effects.rolling and effects.twisting": effects.rolling_stiffness
        or effects.rolling is True
        or effects.twisting is True,
        "packing.relax_friction": packing.relax_friction,
    }
    if found := next((what for what, there in troubles.items() if there), ""):
        face = next(name for name in (*ENDS_OF_Y, "sides") if getattr(packing, name) == WALL)
        raise SceneError(f'packing.{face} = "wall": must be "held" or "free" in a crystal at rest with {found}')
