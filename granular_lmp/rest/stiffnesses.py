"""Checks of stiffnesses by pair of kinds, and of their spread."""

from collections.abc import Iterator, Sequence

from granular_lmp.crystal.disorder import Disorder, Inclusion
from granular_lmp.crystal.lattice import CHAIN, Lattice
from granular_lmp.crystal.stiffnesses import Pair
from granular_lmp.errors import SceneError
from granular_lmp.scene.sections import Packing


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
