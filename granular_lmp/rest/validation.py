"""Checks of combinations of values in a scene, one function per subject.

Each raises a SceneError that names the key, the value and the allowed values.
"""

import sys
from collections.abc import Collection, Mapping, Sequence
from math import ceil, pi
from typing import Any

from granular_lmp.crystal.disorder import Inclusion
from granular_lmp.crystal.lattices import (
    CHAIN,
    ENDS_OF_Y,
    HELD,
    HEXAGONAL,
    QUIET,
    WALL,
    Lattice,
    Shape,
    unit_lattice,
)
from granular_lmp.crystal.modes import bears_compression
from granular_lmp.crystal.scale import LARGEST_OVERLAP_RATIO
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import SceneError
from granular_lmp.rest.shape import LARGEST_CELL, SNAP
from granular_lmp.scene.schema import AUTO, shown
from granular_lmp.scene.sections import DISTANCE, Absorb, Effects, Envelope, Output, Packing, Time, Wave

MOST_SPHERES = 10_000_000
EPSILON = sys.float_info.epsilon
FEWEST_ROUNDINGS = 100.0  # roundings of a position in D0; with fewer the record would be noise or zero without warning
FEWEST_DEVIATIONS = 6.0  # standard deviations of the envelope that a packing must hold
FEWEST_BETWEEN_SIDES = 3  # columns: a centre column, and one on each side
FEWEST_RADIANS = 4.0  # phase of the wave in a standard deviation of a packet: 3e-5 of the packet then run backward


def check_adhesion_law(material: Sphere, effects: Effects, inclusions: Sequence[Inclusion] = ()) -> None:
    """Check that spheres whose adhesion acts beyond contact do adhere, those of inclusions too."""
    if material.adhesion_law == Sphere.adhesion_law:
        if effects.parting == DISTANCE:
            raise SceneError(
                f'effects.parting = "{DISTANCE}": needs sphere.adhesion_law = "jkr"; other contacts end at overlap 0'
            )
        return
    if material.work_of_adhesion == 0 or effects.adhesion is False:
        raise SceneError(
            f'sphere.adhesion_law = "{material.adhesion_law}": needs sphere.work_of_adhesion above 0, J/m2, and '
            f"effects.adhesion not false, and they are {material.work_of_adhesion!r} and {shown(effects.adhesion)}; "
            "without adhesion the contacts are Hertz's"
        )
    for number, each in enumerate(inclusions, 1):
        if each.work_of_adhesion == 0:
            raise SceneError(
                f"inclusion {number}: work_of_adhesion = {each.work_of_adhesion!r}: must be above 0 with "
                f'sphere.adhesion_law = "{material.adhesion_law}", as all contacts of a crystal have one law'
            )


def check_sphere(material: Sphere, sphere: Sphere, effects: Effects, amplitude: float) -> None:
    """Check that something holds the lattice together, and that its static overlap and the wave's D0 are small.

    `material` is the sphere as declared, `sphere` that of the lattice.
    """
    if sphere.holding_force == 0:
        raise SceneError(
            "packing.contact_force = 0.0: must be above 0 where no adhesion holds the spheres together "
            f"(sphere.work_of_adhesion = {material.work_of_adhesion!r}, effects.adhesion = {effects.adhesion!r})"
        )
    if effects.damped_twice:
        raise SceneError(effects.damped_twice)
    if effects.adhesion is True and material.work_of_adhesion == 0:
        raise SceneError("effects.adhesion = true: needs sphere.work_of_adhesion above 0, J/m2")
    if sphere.overlap_ratio > LARGEST_OVERLAP_RATIO:
        raise SceneError(
            f"sphere: the static overlap is {sphere.overlap_ratio:.3g} of the diameter with this radius, "
            f"youngs_modulus, work_of_adhesion and contact_force; at most {LARGEST_OVERLAP_RATIO} is allowed"
        )
    largest = sphere.radius / sphere.static_overlap / 10
    if amplitude > largest:
        raise SceneError(f"wave.amplitude = {amplitude!r}: must be at most {largest:.3g} (D0 = R/10)")


def check_faces(packing: Packing, shape: Shape, unset: str = AUTO) -> None:
    """Check that faces are where the packing ends, that a free one bears no load, and that sides have a distance.

    `unset` is the word for a face that is left open.
    """
    for name in ("first", "last"):
        if shape.along_y and getattr(packing, name) != unset:
            raise SceneError(
                f'packing.{name} = "{getattr(packing, name)}": must be "{unset}" with packing.ends = "{packing.ends}", '
                "whose rows have no end"
            )
    if packing.contact_force and shape.free:
        raise SceneError(
            f"packing.contact_force = {packing.contact_force!r}: must be 0 with free faces ({', '.join(shape.free)}), "
            "on which nothing presses; adhesion holds such a crystal together"
        )
    if packing.sides in (HELD, WALL) and not shape.lattice.sheet:
        raise SceneError(
            f'packing.sides = "{packing.sides}": must be "free" or left out in a chain, which has no other spheres'
        )
    if "sides" not in shape.faces:
        return
    if packing.columns == AUTO or shape.columns < FEWEST_BETWEEN_SIDES:
        raise SceneError(
            f"packing.columns = {shown(packing.columns)}: must be a number, at least {FEWEST_BETWEEN_SIDES}, with "
            f'packing.sides = "{shape.sides}"; the width of the sheet is part of the answer'
        )


def check_lattice(shape: Shape, packing: Packing, effects: Effects, sphere: Sphere, *, without_wave: bool) -> None:
    """Check that rows and columns are those of the lattice, and that it does not buckle."""
    lattice, columns = shape.lattice, shape.columns
    if columns > 1 and not lattice.sheet:
        allowed = "1" if without_wave else '1 or "auto"'
        default = (
            f', the default lattice without [wave]; for a sheet set packing.lattice = "{HEXAGONAL.name}"'
            if without_wave
            else ""
        )
        raise SceneError(
            f'packing.columns = {columns}: must be {allowed} with packing.lattice = "{lattice.name}"{default}'
        )
    if shape.along_x and columns < lattice.fewest_columns:
        raise SceneError(
            f"packing.columns = {columns}: must be at least {lattice.fewest_columns}, or "
            '"auto" (with 2 columns a sphere touches two images of the same neighbour, which share one shear '
            "history in LAMMPS)"
        )
    if columns % lattice.column_period:
        raise SceneError(
            f"packing.columns = {columns}: must be a multiple of {lattice.column_period}, the spheres of a cell, with "
            f'packing.lattice = "{lattice.name}"'
        )
    if shape.along_y and shape.rows % lattice.row_period:
        multiple = "even" if lattice.row_period == 2 else f"a multiple of {lattice.row_period}"
        raise SceneError(f"packing.rows = {shape.rows}: must be {multiple} in a periodic cell, where rows alternate")
    shear = effects.physics.shear
    straight = lattice == CHAIN and shear  # along its line: `check_straight`
    if packing.contact_force and not straight and not bears_compression(unit_lattice(sphere, lattice), shear=shear):
        raise SceneError(
            f"packing.contact_force = {packing.contact_force!r}: must be 0 in a {lattice.name} lattice"
            f"{'' if shear else ' where effects.shear is off'}, which would buckle: nothing holds it sideways"
        )


def check_line(lattice: Lattice, wave: Wave, envelope: Envelope) -> None:
    """Check that direction and envelope of a wave are those of the lattice."""
    if not lattice.sheet and wave.degrees != 90:
        raise SceneError(f'wave.direction = {wave.direction!r}: must be "y" with packing.lattice = "{lattice.name}"')
    if envelope.width and not lattice.sheet:
        raise SceneError(f'envelope.width = {envelope.width!r}: must be 0 with packing.lattice = "{lattice.name}"')


def check_straight(lattice: Lattice, packing: Packing, across: str) -> None:
    """Check that nothing pushes a compressed chain off its line, along which it moves as if it were held.

    Parameters
    ----------
    lattice, packing : of the scene.
    across : str
        First key of the scene that moves spheres across the line or turns them, with its value; "" if none does.
    """
    if lattice == CHAIN and packing.contact_force and across:
        raise SceneError(
            f"packing.contact_force = {packing.contact_force!r}: must be 0 in a chain with {across}, which would "
            "buckle: nothing holds it sideways; along y it stays on its line"
        )


def check_wave(wave: Wave, envelope: Envelope, packing: Packing, shape: Shape) -> None:
    """Check that the wave vector is in the Brillouin zone, and that direction, form, envelope and ends agree."""
    edge = shape.lattice.zone_edge(wave.degrees)
    if wave.wavenumber > edge * (1 + 8 * EPSILON):
        raise SceneError(
            f"wave.wavenumber = {wave.wavenumber!r}: must be a number in [1e-9, {edge:.6g}], rad per row; the "
            f"Brillouin zone ends there in wave.direction = {wave.direction!r}"
        )
    if wave.form == "driven":
        _check_drive(wave, envelope, packing, shape)
    elif envelope.ramp != Envelope.ramp:
        raise SceneError(f'envelope.ramp = {envelope.ramp!r}: is for wave.form = "driven" only')
    axis = wave.vector(shape.lattice).axis
    if axis is None and (envelope.length > 0) != (envelope.width > 0):
        raise SceneError(
            f"envelope.length = {envelope.length!r} and envelope.width = {envelope.width!r}: must be both 0 or "
            f"both above in wave.direction = {wave.direction!r}, along which nothing fits a periodic cell"
        )
    if envelope.offset and not envelope.length:
        raise SceneError(f"envelope.offset = {envelope.offset!r}: needs envelope.length above 0, rows")
    if 0 < envelope.length < FEWEST_RADIANS / wave.wavenumber:
        raise SceneError(
            f"envelope.length = {envelope.length!r}: must be 0 or at least {FEWEST_RADIANS:g}/xi = "
            f"{FEWEST_RADIANS / wave.wavenumber:.4g} rows; a shorter packet runs backward too"
        )


def _check_drive(wave: Wave, envelope: Envelope, packing: Packing, shape: Shape) -> None:
    """Check that a driven wave runs along y between fixed ends and is not a packet."""
    needed = {
        "wave.direction": (wave.direction, wave.degrees == 90, '"y"'),
        "packing.ends": (packing.ends, not shape.along_y, '"fixed" or "auto"'),
        "packing.first": (packing.first, shape.first == HELD, '"held" or "auto"'),
        "envelope.length": (envelope.length, envelope.length == 0, "0"),
    }
    for key, (value, right, allowed) in needed.items():
        if not right:
            raise SceneError(f'{key} = {shown(value)}: must be {allowed} with wave.form = "driven"')


def check_imperfections(
    packing: Packing, sphere: Sphere, inclusions: Sequence[Inclusion], layered: bool, perfect: bool
) -> None:
    """Check that a crystal that is not perfect has a declared size, and the adhesion of its inclusions."""
    for number, inclusion in enumerate(inclusions, 1):
        if inclusion.work_of_adhesion and not sphere.work_of_adhesion:
            raise SceneError(
                f"inclusion {number}: work_of_adhesion = {inclusion.work_of_adhesion!r}: must be left out where the "
                "spheres have none (sphere.work_of_adhesion = 0.0, or effects.adhesion = false), as all contacts are "
                "then Hertz's"
            )
    for name, needed in (("rows", not perfect), ("columns", not layered), ("ends", not perfect)):
        if needed and getattr(packing, name) == AUTO:
            raise SceneError(
                f'packing.{name} = "auto": must be declared where spheres differ, are missing or touch a wall, as '
                "the size of the crystal is then part of the answer"
            )


def with_quiet_rows(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return tables of a scene whose quiet ends have as many rows as they need, where these are not declared."""
    packing, absorb = tables.get("packing"), tables.get("absorb", {})
    if not isinstance(packing, Mapping) or QUIET not in (packing.get("first"), packing.get("last")):
        return tables
    return {**tables, "absorb": {"rows": AUTO, **absorb}} if isinstance(absorb, Mapping) else tables


def check_absorb(
    absorb: Absorb,
    packing: Packing,
    quiet: Collection[str],
    form: str,
    envelope: Envelope,
    shape: Shape,
) -> None:
    """Check that quiet ends have rows to damp and a wave that reaches them from inside."""
    if absorb.rows and shape.lattice.column_period > 1:
        raise SceneError(
            f'absorb.rows = {absorb.rows!r}: must be 0 with packing.lattice = "{shape.lattice.name}"; quiet ends are '
            "for rows of one sphere a cell"
        )
    if absorb.rows == 0:
        for name in ENDS_OF_Y:
            if getattr(packing, name) == QUIET:
                raise SceneError(f'absorb.rows = 0: must be above 0 or "auto" with packing.{name} = "quiet"')
        return
    if not quiet:
        raise SceneError(
            f'absorb.rows = {absorb.rows!r}: needs packing.first or packing.last = "quiet", as quiet rows are in front '
            "of a held row, and both ends are free or walls"
        )
    if shape.along_y:
        raise SceneError(f'absorb.rows = {absorb.rows!r}: needs packing.ends = "fixed"; a periodic cell has no ends')
    if packing.rows == AUTO:
        raise SceneError(
            'packing.rows = "auto": must be declared with absorb.rows, as no echo says how many are needed: the quiet '
            "ends, and those that the wave is to cross"
        )
    if form not in ("driven", "none") and not envelope.length:
        raise SceneError(
            f"absorb.rows = {absorb.rows!r}: would damp a wave that fills the packing; needs envelope.length above 0 "
            'or wave.form = "driven" or "none"'
        )


def check_packing(packing: Packing, wave: Wave, envelope: Envelope, shape: Shape, vector: WaveVector) -> None:
    """Check that the packing is a lattice, has room for the envelope, and carries the wave vector."""
    rows, columns, declared = shape.rows, shape.columns, wave.vector(shape.lattice)
    missed = {
        "rows": abs(vector.per_row - declared.per_row) if packing.rows == AUTO else 0.0,
        "columns": abs(vector.per_column - declared.per_column) if packing.columns == AUTO else 0.0,
    }
    for name, miss in missed.items():
        if miss > SNAP:
            otherwise = ', or packing.ends = "fixed"' if declared.axis == "y" else ""
            raise SceneError(
                f'packing.{name} = "auto": no periodic cell of at most {LARGEST_CELL} {name} carries '
                f"wave.wavenumber = {wave.wavenumber!r} to {SNAP:g}; must be a number{otherwise}"
            )
    if not shape.along_y and rows % 2 == 0:
        raise SceneError(f"packing.rows = {rows}: must be odd between fixed ends, so that there is a centre row")
    if shape.spheres > MOST_SPHERES:
        key, layers = (" x packing.layers", f" x {shape.layers}") if shape.layers > 1 else ("", "")
        raise SceneError(
            f"packing.rows x packing.columns{key} = {rows} x {columns}{layers}: must be at most {MOST_SPHERES} "
            "spheres (LAMMPS takes 690 MB for each million)"
        )
    spread = [FEWEST_DEVIATIONS * deviation for deviation in envelope.spread(declared)]
    between_walls = not shape.along_y and envelope.offset
    needed = (spread[0] + (2 * abs(envelope.offset) if between_walls else 0.0), spread[1])
    for name, count, least in zip(("rows", "columns"), (rows, columns), needed, strict=True):
        if count < least:
            raise SceneError(
                f"packing.{name} = {count}: must be at least {ceil(least)}, {FEWEST_DEVIATIONS:g} standard deviations "
                "of the envelope" + (" and twice its offset" if between_walls else "")
            )
    if vector.wavenumber == 0:
        raise SceneError(
            f"wave.wavenumber = {wave.wavenumber!r}: snaps to 0 in a periodic cell of {rows} rows x {columns} "
            f"columns; the smallest is 2 pi/{rows} = {2 * pi / rows:.6g}, rad per row, along y"
        )
    edge = shape.lattice.zone_edge(vector.direction)
    if vector.wavenumber > edge * (1 + 1e-12):
        raise SceneError(
            f"packing.rows x packing.columns = {rows} x {columns}: wave.wavenumber = {wave.wavenumber!r} snaps to "
            f"{vector.wavenumber:.6g} at {vector.direction:.6g} degrees, but the Brillouin zone ends at {edge:.6g} "
            "there; must be more rows or columns"
        )


def check_size(sphere: Sphere, shape: Shape, amplitude: float) -> None:
    """Check that the wave is above the rounding of positions."""
    smallest, length = _smallest(sphere, shape)
    if amplitude < smallest:
        raise SceneError(
            f"wave.amplitude = {amplitude!r}: must be at least {smallest:.3g} with this sphere in {length} "
            f"rows or columns, or D0 is less than {FEWEST_ROUNDINGS:g} roundings of a position"
        )


def check_motion(sphere: Sphere, shape: Shape, moved: float) -> None:
    """Check that strikers, states and sources without a wave move spheres by more than positions are rounded."""
    smallest, length = _smallest(sphere, shape)
    if moved < smallest:
        raise SceneError(
            f"striker, start or source: would stretch contacts by {moved:.3g} Delta0; must be at least {smallest:.3g} "
            f"with this sphere in {length} rows or columns, {FEWEST_ROUNDINGS:g} roundings of a position"
        )


def _smallest(sphere: Sphere, shape: Shape) -> tuple[float, int]:
    """Return the smallest motion that positions resolve, Δ0, and the rows or columns of the packing.

    Half the packing is farther from the origin than a quarter of its length.
    """
    length = max(shape.rows, shape.columns)
    return FEWEST_ROUNDINGS * EPSILON * length / 4 * sphere.lattice_constant / sphere.static_overlap, length


def check_time(time: Time, output: Output, shape: Shape, echo: float) -> None:
    """Check that records and snapshots fit into the run, and that it ends before the echo."""
    if time.sample > time.duration:
        raise SceneError(f"time.sample = {time.sample!r}: must be at most time.duration = {time.duration!r}")
    if time.duration > echo and not time.allow_echo:
        raise SceneError(
            f"time.duration = {time.duration!r}: the echo of the {shape.edge} reaches the centre of {shape.words} at "
            f"tau = {echo:.4g}; must be at most that, or set time.allow_echo = true, or "
            + ('packing.rows = "auto"' if shape.infinite else "more packing.rows and packing.columns")
        )
    snapshot = output.particles / time.sample
    # The deck rounds the spacing of the snapshots up to whole samples with the same slack
    if abs(snapshot - round(snapshot)) > 1e-9 or output.particles > time.duration:
        raise SceneError(
            f"output.particles = {output.particles!r}: must be 0 or a whole multiple of time.sample = "
            f"{time.sample!r}, at most time.duration = {time.duration!r}"
        )
