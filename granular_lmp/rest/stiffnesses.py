"""Measured stiffnesses of a scene, of all contacts or by pair of kinds, and their spread."""

from collections.abc import Iterator, Sequence

from granular_lmp.crystal.disorder import Disorder, Inclusion
from granular_lmp.crystal.lattice import CHAIN, Lattice
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.stiffnesses import Pair
from granular_lmp.errors import SceneError
from granular_lmp.scene.bodies import Contact
from granular_lmp.scene.sections import Packing

_ROUNDS = 60  # each round reduces the error of a scale by a third at least


def measured(sphere: Sphere, contact: Contact) -> Sphere:
    """Return the sphere whose contact at rest has the measured stiffnesses: moduli and work of adhesion scaled.

    The moduli and the work of adhesion are scaled, which scales the forces at every overlap; a load has another overlap
    then. E and ν are those of no material where no material has such a ratio of stiffnesses (`Sphere.with_moduli`).
    """
    if contact == Contact() or not sphere.static_overlap:  # the check of the sphere says what presses no contact
        return sphere
    normal = sphere.normal_stiffness if contact.normal_stiffness is None else contact.normal_stiffness
    found = sphere
    for _ in range(_ROUNDS):
        law = found.contact_law
        given = float(sphere.contact_law.shear_stiffness(found.static_overlap))  # under a load the overlap changes
        shear = given if contact.shear_stiffness is None else contact.shear_stiffness
        kappa, scale = shear / normal / float(law.excess(found.static_overlap)), normal / found.normal_stiffness
        modulus = found.effective_modulus * scale
        found = found.with_moduli(modulus, kappa * modulus / 4, found.work_of_adhesion * scale)
        if abs(scale - 1) < 1e-15:
            break
    return found


def check_stiffnesses(
    packing: Packing,
    lattice: Lattice,
    disorder: Disorder,
    inclusions: Sequence[Inclusion],
    pairs: Sequence[Pair],
) -> None:
    """Check that pairs are of kinds that are there, and that contacts of other stiffness leave spheres at rest.

    Raises
    ------
    SceneError
        If a pair is of no two kinds or declared twice, or a load presses contacts that differ where spheres could not
        come to rest.
    """
    if trouble := next(_troubles(inclusions, pairs), ""):
        raise SceneError(trouble)
    stays = lattice == CHAIN and packing.relax == "fixed"
    if (pairs or disorder.stiffness) and packing.contact_force and (lattice.collapses or stays):
        key = "[[pair]]" if pairs else f"disorder.stiffness = {disorder.stiffness!r}"
        raise SceneError(
            f"packing.contact_force = {packing.contact_force!r}: must be 0 with {key} and packing.lattice = "
            f'"{lattice.name}", which would buckle as contacts that differ come to rest'
        )


def _troubles(inclusions: Sequence[Inclusion], pairs: Sequence[Pair]) -> Iterator[str]:
    """Yield what is wrong with each pair by itself."""
    for number, each in enumerate(pairs, 1):
        name, kinds = f"pair {number}", sorted(each.of)
        if len(kinds) != 2 or kinds[1] > len(inclusions) or not kinds[1]:
            most = f"at most {len(inclusions)}, the number of tables [[inclusion]], not both 0"
            yield f"{name}: of = {list(each.of)}: must be two kinds of spheres, {most}; [contact] has those of 0 and 0"
        elif any(kind and inclusions[kind - 1].vacancy for kind in kinds):
            yield f"{name}: of = {list(each.of)}: must not be of vacancies"
        elif kinds in [sorted(other.of) for other in pairs[: number - 1]]:
            yield f"{name}: of = {list(each.of)}: is declared twice"
        if each.normal_stiffness is None and each.shear_stiffness is None:
            yield f"{name}: normal_stiffness, shear_stiffness: missing; give one of the two, or both"
