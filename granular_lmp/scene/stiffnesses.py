"""Measured stiffnesses of a scene, of all contacts or by pair of kinds, and their spread."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

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

    Young's modulus and the work of adhesion are scaled alike, which scales f_N at every overlap, and leave the shear
    force as it is if its stiffness is not measured. A load has another overlap then. Poisson's ratio,
    κ = g/k = 2(1−ν)/(2−ν), is then a number that need not be that of a material.

    Raises
    ------
    SceneError
        If the ratio of the stiffnesses is that of no Poisson's ratio above −1.
    """
    if contact == Contact() or not sphere.static_overlap:  # the check of the sphere says what presses no contact
        return sphere
    normal = sphere.normal_stiffness if contact.normal_stiffness is None else contact.normal_stiffness
    found = sphere
    for _ in range(_ROUNDS):
        given = float(sphere.contact_law.shear_stiffness(found.static_overlap))  # under a load the overlap changes
        shear = given if contact.shear_stiffness is None else contact.shear_stiffness
        kappa = shear / normal / float(found.contact_law.excess(found.static_overlap))
        if not kappa < 4 / 3:
            below = f"below 4/3 of the normal stiffness, {normal!r} N/m"
            if contact.shear_stiffness is None:
                raise SceneError(
                    f"contact.normal_stiffness = {normal!r}: needs contact.shear_stiffness {below}; "
                    f"left out, it is {shear:.6g} N/m by the moduli"
                )
            raise SceneError(f"contact.shear_stiffness = {shear!r}: must be {below}")
        ratio = (2 - 2 * kappa) / (2 - kappa)
        scale = normal / found.normal_stiffness
        modulus = found.effective_modulus * scale
        found = replace(
            found,
            youngs_modulus=2 * (1 - ratio**2) * modulus,
            poisson_ratio=ratio,
            work_of_adhesion=found.work_of_adhesion * scale,
        )
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
