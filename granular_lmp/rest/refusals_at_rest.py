"""Refusals of spheres at rest under load, with or without a wave."""

import sys
from collections.abc import Iterator, Sequence

from granular_lmp.crystal.disorder import Inclusion
from granular_lmp.crystal.lattices import (
    CHAIN,
    ENDS_OF_Y,
    FREE,
    HEXAGONAL,
    QUIET,
    WALL,
    Shape,
    unit_lattice,
)
from granular_lmp.crystal.lattices import (
    HELD as HELD_FACE,
)
from granular_lmp.crystal.modes import bears_compression
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.sphere_table import STIFFNESSES
from granular_lmp.crystal.stiffnesses import Pair
from granular_lmp.crystal.walls import BOTH
from granular_lmp.rest import words
from granular_lmp.rest.derived import Derived
from granular_lmp.rest.refusal import ALL, AT_REST, Refusal, joining
from granular_lmp.rest.space import substrate_trouble
from granular_lmp.scene.bodies import Contact
from granular_lmp.scene.forms import DRIVEN, STILL
from granular_lmp.scene.schema import AUTO, either, shown
from granular_lmp.scene.without_wave import HELD

EPSILON = sys.float_info.epsilon
FEWEST_ROUNDINGS = 100.0  # D0 in roundings of a position; with fewer the record would be noise or zero without warning
FEWEST_BETWEEN_SIDES = 3  # columns: a centre column, and one on each side
LINES: list[Refusal] = []
line = joining(LINES, of=AT_REST)


@line("physics")
def pressed_film(scene: Derived) -> str:
    packing, substrate = scene.packing, scene.substrate
    on_both_sides = substrate is not None and substrate.sides == BOTH
    if scene.space == 2 or not packing.contact_force or not (on_both_sides or scene.lattice.film):
        return ""
    return f"packing.contact_force = {packing.contact_force!r}: must be 0 in a film, on whose faces nothing presses"


@line("physics")
def substrate_without_adhesion(scene: Derived) -> str:
    return substrate_trouble(scene.material, scene.substrate, scene.effects)


@line("not built")
def asked_of_space(scene: Derived) -> str:
    """Check the demands on a crystal in space."""
    packing, effects, absorb = scene.packing, scene.effects, scene.absorb
    substrate, lattice = scene.substrate, scene.lattice
    if scene.space == 2:
        return ""
    if effects.rolling_stiffness or effects.rolling is True or effects.twisting is True:
        return (
            "effects.rolling and effects.twisting: must be off where packing.space is 3; the modes of a crystal in "
            "space do not include them"
        )
    if absorb.rows and (substrate is not None or lattice.film):
        return (
            f"absorb.rows = {shown(absorb.rows)}: must be 0 on a [substrate] and in a film, where the reflection of "
            "quiet ends is not known"
        )
    if packing.relax_friction:
        return (
            f"packing.relax_friction = {packing.relax_friction!r}: must be 0 where packing.space is 3; relaxation with "
            "friction is only for spheres in the plane"
        )
    return ""


@line("not built")
def asked_of_walls(scene: Derived) -> str:
    """Check that a crystal at rest with rigid planes at its faces has nothing that the planes do not support."""
    packing, effects = scene.packing, scene.effects
    if not scene.rigid:
        return ""
    troubles = {
        "[contact]": scene.contact != Contact(),
        "effects.rolling and effects.twisting": effects.rolling_stiffness
        or effects.rolling is True
        or effects.twisting is True,
        "packing.relax_friction": packing.relax_friction,
    }
    if found := next((what for what, there in troubles.items() if there), ""):
        face = next(name for name in (*ENDS_OF_Y, "sides") if getattr(packing, name) == WALL)
        return f'packing.{face} = "wall": must be "held" or "free" in a crystal at rest with {found}'
    return ""


@line("physics")
def pairs_of_kinds(scene: Derived) -> str:
    """Check that pairs name kinds of spheres that exist."""
    return next(_troubles(scene.inclusion, scene.pair), "")


@line("physics")
def stiffnesses_that_buckle(scene: Derived) -> str:
    """Check that contacts of other stiffness do not make a lattice buckle."""
    packing, lattice, disorder, pairs = scene.packing, scene.lattice, scene.disorder, scene.pair
    stays = lattice == CHAIN and packing.relax == "fixed"
    factors = packing.table.differing(**dict.fromkeys(STIFFNESSES, 1.0))
    if (pairs or disorder.stiffness or factors) and packing.contact_force and (lattice.collapses or stays):
        other = [f"packing.table: {name} = {value!r}" for name, value in factors.items()]
        key = "[[pair]]" if pairs else [*other, f"disorder.stiffness = {disorder.stiffness!r}"][0]
        return (
            f"packing.contact_force = {packing.contact_force!r}: must be 0 with {key} and packing.lattice = "
            f'"{lattice.name}", which would buckle as contacts that differ come to rest'
        )
    return ""


def _troubles(inclusions: Sequence[Inclusion], pairs: Sequence[Pair]) -> Iterator[str]:
    """Yield the errors of each single pair."""
    for number, each in enumerate(pairs, 1):
        name, kinds = f"pair {number}", sorted(each.of)
        if len(kinds) != 2 or kinds[1] > len(inclusions) or not kinds[1]:
            most = f"at most {len(inclusions)}, the number of tables [[inclusion]], not both 0"
            yield f"{name}: of = {list(each.of)}: must be two kinds of spheres, {most}; [contact] is for 0 and 0"
        elif any(kind and inclusions[kind - 1].vacancy for kind in kinds):
            yield f"{name}: of = {list(each.of)}: must not name vacancies"
        elif kinds in [sorted(other.of) for other in pairs[: number - 1]]:
            yield f"{name}: of = {list(each.of)}: is declared twice"
        if each.normal_stiffness is None and each.shear_stiffness is None:
            yield f"{name}: normal_stiffness, shear_stiffness: missing; give one of the two, or both"


@line("physics", of=ALL)
def ends_of_a_periodic_cell(scene: Derived) -> str:
    packing, unset = scene.packing, FREE if scene.wave is None else AUTO
    for name in ENDS_OF_Y:
        if scene.shape.along_y and getattr(packing, name) != unset:
            return (
                f'packing.{name} = "{getattr(packing, name)}": must be "{unset}" with packing.ends = "{packing.ends}", '
                "whose rows have no end"
            )
    return ""


@line("physics")
def faces(scene: Derived) -> str:
    """Refuse a load on a free face, and sides without a distance."""
    packing, shape = scene.packing, scene.shape
    if packing.contact_force and shape.free:
        return (
            f"packing.contact_force = {packing.contact_force!r}: must be 0 with free faces ({', '.join(shape.free)}), "
            "on which nothing presses; adhesion holds such a crystal together"
        )
    if packing.sides in (HELD_FACE, WALL) and not shape.lattice.sheet:
        return f'packing.sides = "{packing.sides}": must be "free" or left out in a chain, which has no other spheres'
    if "sides" not in shape.faces:
        return ""
    if packing.columns == AUTO or shape.columns < FEWEST_BETWEEN_SIDES:
        return (
            f"packing.columns = {shown(packing.columns)}: must be a number, at least {FEWEST_BETWEEN_SIDES}, with "
            f'packing.sides = "{shape.sides}"; the width of the sheet is part of the answer'
        )
    return ""


@line("physics", of=ALL)
def rows_and_columns(scene: Derived) -> str:
    """Check that rows and columns fit the lattice, and that no sphere touches two images of another one."""
    shape, or_auto = scene.shape, "" if scene.wave is None else ', or "auto"'
    lattice, rows, columns = shape.lattice, shape.rows, shape.columns
    if columns > 1 and not lattice.sheet:
        allowed = "1" if scene.wave is None else '1 or "auto"'
        default = (
            f', the default lattice without [wave]; for a sheet set packing.lattice = "{HEXAGONAL.name}"'
            if scene.wave is None
            else ""
        )
        return f'packing.columns = {columns}: must be {allowed} with packing.lattice = "{lattice.name}"{default}'
    if shape.along_x and columns < lattice.fewest_columns:
        return (
            f"packing.columns = {columns}: must be at least {lattice.fewest_columns} between periodic sides{or_auto} "
            "(with 2 columns a sphere touches two images of the same neighbour, which share one shear history in "
            "LAMMPS)"
        )
    if columns % lattice.column_period and (scene.holding.whole_cells or shape.along_x):
        return (
            f"packing.columns = {columns}: must be a multiple of {lattice.column_period}, the spheres of a cell, with "
            f'packing.lattice = "{lattice.name}"'
        )
    if shape.along_y and rows % lattice.row_period:
        multiple = "even" if lattice.row_period == 2 else f"a multiple of {lattice.row_period}"
        return f"packing.rows = {rows}: must be {multiple} in a periodic cell, where rows alternate"
    if shape.along_y and lattice.sheet and rows < lattice.fewest_rows:
        return (
            f"packing.rows = {rows}: must be at least {lattice.fewest_rows} in a periodic cell, where a sphere would "
            "touch two images of the same neighbour"
        )
    return ""


@line("physics")
def lattice_that_buckles(scene: Derived) -> str:
    packing, lattice = scene.packing, scene.lattice
    shear = scene.effects.physics.shear
    straight = lattice == CHAIN and shear  # a chain is stable along its line: `chain_that_buckles`
    stays = straight or bears_compression(unit_lattice(scene.sphere, lattice), shear=shear)
    if packing.contact_force and not stays:
        return (
            f"packing.contact_force = {packing.contact_force!r}: must be 0 in a {lattice.name} lattice"
            f"{'' if shear else ' where effects.shear is off'}, which would buckle: nothing holds it sideways"
        )
    return ""


@line("physics")
def chain_that_buckles(scene: Derived) -> str:
    """Check that nothing pushes a compressed chain off its line; along the line it moves as if it were held."""
    lattice, packing, across = scene.lattice, scene.packing, words.across(scene.wave, scene.source, scene.start)
    if lattice == CHAIN and packing.contact_force and across:
        return (
            f"packing.contact_force = {packing.contact_force!r}: must be 0 in a chain with {across}, which would "
            "buckle: nothing holds it sideways; along y it stays on its line"
        )
    return ""


@line("physics")
def imperfections(scene: Derived) -> str:
    """Check that an imperfect crystal has a declared size, and check the adhesion of its inclusions."""
    packing, layered, perfect = scene.packing, scene.layered, scene.perfect
    for number, inclusion in enumerate(scene.inclusion, 1):
        if inclusion.work_of_adhesion and not scene.sphere.work_of_adhesion:
            return (
                f"inclusion {number}: work_of_adhesion = {inclusion.work_of_adhesion!r}: must be left out where the "
                "spheres have none (sphere.work_of_adhesion = 0.0, or effects.adhesion = false), as all contacts are "
                "then Hertz's"
            )
    for name, needed in (("rows", not perfect), ("columns", not layered), ("ends", not perfect)):
        if needed and getattr(packing, name) == AUTO:
            return (
                f'packing.{name} = "auto": must be declared where spheres differ, are missing or touch a wall, as '
                "the size of the crystal is then part of the answer"
            )
    return ""


@line("not built")
def measured_stiffnesses_of_several_materials(scene: Derived) -> str:
    """Check that measured stiffnesses are used with one material only."""
    bodies = (scene.contact, scene.substrate) if scene.substrate else (scene.contact,)
    if not any(each.normal_stiffness or each.shear_stiffness for each in bodies):
        return ""
    for key, value in _unequal(scene).items():
        if not key.endswith("radius"):
            return (
                f"{key} = {value!r}: must be left out beside measured stiffnesses, which belong to the spheres of the "
                "lattice"
            )
    return ""


@line("physics")
def arrangement(scene: Derived) -> str:
    """Check that unequal spheres do not change the arrangement of a lattice as it relaxes.

    Relaxation has no friction. A square or cubic lattice, with straight lines of contacts, then resists no shear, so
    every contact must be at rest already. A chain resists no sideways shift, so it must not be compressed; a layer in
    space resists no push along z.
    """
    packing, lattice, disorder, inclusions = scene.packing, scene.lattice, scene.disorder, scene.inclusion
    for key, value in _unequal(scene).items():
        if scene.space == 3 and not lattice.solid and scene.substrate is None:
            return (
                f"{key} = {value!r}: must be equal for all spheres in a layer that nothing holds along z, as contacts "
                "would push unequal spheres out of it; needs a [substrate], or packing.space = 2"
            )
        if lattice.collapses:
            return (
                f'{key} = {value!r}: must be equal for all spheres with packing.lattice = "{packing.lattice}", which '
                "has no shear stiffness without friction and would collapse as it relaxes"
            )
        if lattice == CHAIN and packing.relax == "fixed":
            return (
                f'packing.relax = "fixed": must be "box" with {key} = {value!r} in a chain, which would buckle in a '
                "fixed box"
            )
    empty = disorder.vacancies > 0 or any(each.vacancy for each in inclusions)
    if lattice.collapses and packing.contact_force and empty:
        return (
            f"packing.contact_force = {packing.contact_force!r}: must be 0 in a {packing.lattice} lattice with "
            "vacancies, as the force would press spheres into them"
        )
    return ""


def _unequal(scene: Derived) -> dict[str, float]:
    """Return by key the values that make contacts differ: other radii, moduli and adhesion than the lattice has."""
    material, disorder, table = scene.material, scene.disorder, scene.packing.table
    found = {"disorder.radius": disorder.radius} if disorder.radius else {}
    found |= {f"packing.table: {key}": value for key, value in table.differing(radius=material.radius).items()}
    for number, inclusion in enumerate(scene.inclusion, start=1):
        own = inclusion.of_material | ({} if inclusion.radius is None else {"radius": inclusion.radius})
        found |= {f"inclusion {number}: {key}": value for key, value in own.items() if value != getattr(material, key)}
    return found


@line("not built")
def quiet_ends_of_other_lattices(scene: Derived) -> str:
    lattice, rows = scene.shape.lattice, scene.absorb.rows
    if not rows or lattice.column_period == 1:
        return ""
    return (
        f'absorb.rows = {rows!r}: must be 0 with packing.lattice = "{lattice.name}"; quiet ends need a lattice with '
        "one sphere per cell"
    )


@line("not built")
def quiet_ends_of_patterns(scene: Derived) -> str:
    if scene.absorb.rows == 0 or scene.wave_lattice.cell_size == 1:
        return ""
    return (
        f"absorb.rows = {scene.absorb.rows!r}: must be 0 on a [substrate] and in a lattice of several spheres per "
        "cell, where the reflection of quiet ends is not known"
    )


@line("not built")
def quiet_rows_at_free_ends(scene: Derived) -> str:
    if not scene.absorb.rows or scene.quiet:
        return ""
    return (
        f'absorb.rows = {scene.absorb.rows!r}: needs packing.first or packing.last = "quiet", as quiet rows stand '
        "before a held row, and here both ends are free or walls"
    )


@line("physics")
def quiet_ends(scene: Derived) -> str:
    """Check that quiet ends have rows that absorb, and a wave that reaches them from inside."""
    absorb, packing, form = scene.absorb, scene.packing, scene.form
    envelope, shape = scene.envelope, scene.shape
    if absorb.rows == 0:
        for name in ENDS_OF_Y:
            if getattr(packing, name) == QUIET:
                return f'absorb.rows = 0: must be above 0 or "auto" with packing.{name} = "quiet"'
        return ""
    if shape.along_y:
        return f'absorb.rows = {absorb.rows!r}: needs packing.ends = "fixed"; a periodic cell has no ends'
    if packing.rows == AUTO:
        return (
            'packing.rows = "auto": must be a number with absorb.rows: the quiet rows and those that the wave '
            "crosses; no echo determines it"
        )
    if form.fills and not envelope.length:
        return (
            f"absorb.rows = {absorb.rows!r}: would damp a wave that fills the packing; needs envelope.length above 0 "
            f"or wave.form = {either((*DRIVEN, *STILL))}"
        )
    return ""


@line("physics")
def sources_that_move_quiet_ends(scene: Derived) -> str:
    if scene.absorb.rows == 0 or scene.absorbing:
        return ""
    ends = "both ends" if len(scene.quiet) == 2 else f"the {scene.quiet[0]} row, which alone is quiet"
    return f"absorb.rows = {scene.absorb.rows!r}: must be 0 where sources move {ends}"


@line("physics", of=(HELD,))
def motion_lost_in_rounding(scene: Derived) -> str:
    """Check that, without a wave, strikers, states and sources move spheres by more than the rounding of positions."""
    moved = scene._moved
    smallest, length = smallest_motion(scene.sphere, scene.shape)
    if moved < smallest:
        return (
            f"striker, start or source: would stretch contacts by {moved:.3g} Delta0; must be at least {smallest:.3g} "
            f"with this sphere in {length} rows or columns, {FEWEST_ROUNDINGS:g} roundings of a position"
        )
    return ""


def smallest_motion(sphere: Sphere, shape: Shape) -> tuple[float, int]:
    """Return the smallest motion that positions resolve, Δ0, and the rows or columns of the packing.

    Half of the packing is farther from the origin than a quarter of its length.
    """
    length = max(shape.rows, shape.columns)
    return FEWEST_ROUNDINGS * EPSILON * length / 4 * sphere.lattice_constant / sphere.static_overlap, length
