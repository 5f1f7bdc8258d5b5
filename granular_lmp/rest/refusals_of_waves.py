"""Refusals of scenes with ``[wave]``: the wave, its room and its time."""

from math import ceil, pi

from granular_lmp.crystal.lattices import HELD
from granular_lmp.rest.derived import Derived
from granular_lmp.rest.refusal import Refusal, joining
from granular_lmp.rest.refusals_at_rest import EPSILON, FEWEST_ROUNDINGS, smallest_motion
from granular_lmp.rest.shape import LARGEST_CELL, SNAP
from granular_lmp.scene.forms import DRIVEN
from granular_lmp.scene.schema import AUTO, either, shown
from granular_lmp.scene.sections import Envelope
from granular_lmp.scene.without_wave import WAVE

FEWEST_DEVIATIONS = 6.0  # standard deviations of the envelope that must fit into a packing
FEWEST_RADIANS = 4.0  # phase of the wave over a standard deviation of a packet: 3e-5 of the packet then runs backward
LINES: list[Refusal] = []
line = joining(LINES, of=(WAVE,))


@line("physics")
def along_a_chain(scene: Derived) -> str:
    """Check that direction and envelope of a wave fit the lattice."""
    lattice = scene.wave_lattice  # raises if rows do not repeat
    wave, envelope = scene.require_wave(), scene.envelope
    if not lattice.sheet and wave.degrees != 90:
        return f'wave.direction = {wave.direction!r}: must be "y" with packing.lattice = "{lattice.name}"'
    if envelope.width and not lattice.sheet:
        return f'envelope.width = {envelope.width!r}: must be 0 with packing.lattice = "{lattice.name}"'
    return ""


@line("not built")
def driven_row_along_y(scene: Derived) -> str:
    """Refuse a driven row with an oblique or finite wave."""
    wave, length = scene.require_wave(), scene.envelope.length
    if not scene.form.driven or wave.degrees == 90 and not length:
        return ""
    key, value, allowed = "wave.direction", wave.direction, '"y"'
    if wave.degrees == 90:
        key, value, allowed = "envelope.length", length, "0"
    return f'{key} = {shown(value)}: must be {allowed} with wave.form = "{scene.form.name}"'


@line("physics")
def driven_row_at_an_end(scene: Derived) -> str:
    """Refuse a driven row other than the held first row."""
    packing, shape = scene.packing, scene.shape
    if not scene.form.driven or not shape.along_y and shape.first == HELD:
        return ""
    key, allowed = ("ends", '"fixed" or "auto"') if shape.along_y else ("first", '"held" or "auto"')
    return f'packing.{key} = {shown(getattr(packing, key))}: must be {allowed} with wave.form = "{scene.form.name}"'


@line("physics")
def wave_vector_and_envelope(scene: Derived) -> str:
    """Check that the wave vector is in the Brillouin zone, and that direction, form, envelope and ends agree."""
    wave, envelope, shape = scene.require_wave(), scene.envelope, scene.shape
    edge = shape.lattice.zone_edge(wave.degrees)
    if wave.wavenumber > edge * (1 + 8 * EPSILON):
        return (
            f"wave.wavenumber = {wave.wavenumber!r}: must be a number in [1e-9, {edge:.6g}], rad per row; the "
            f"Brillouin zone ends there in wave.direction = {wave.direction!r}"
        )
    if not scene.form.driven and envelope.ramp != Envelope.ramp:
        return f"envelope.ramp = {envelope.ramp!r}: is for wave.form = {either(DRIVEN)} only"
    axis = scene.declared_vector.axis
    if axis is None and (envelope.length > 0) != (envelope.width > 0):
        return (
            f"envelope.length = {envelope.length!r} and envelope.width = {envelope.width!r}: must be both 0 or "
            f"both above 0 in wave.direction = {wave.direction!r}, along which no finite wave fits a periodic cell"
        )
    if envelope.offset and not envelope.length:
        return f"envelope.offset = {envelope.offset!r}: needs envelope.length above 0, rows"
    if 0 < envelope.length < FEWEST_RADIANS / wave.wavenumber:
        return (
            f"envelope.length = {envelope.length!r}: must be 0 or at least {FEWEST_RADIANS:g}/xi = "
            f"{FEWEST_RADIANS / wave.wavenumber:.4g} rows; a shorter packet runs backward too"
        )
    return ""


@line("physics")
def room_for_the_wave(scene: Derived) -> str:
    """Check that the packing is a lattice, has room for the envelope, and carries the wave vector."""
    packing, wave, envelope = scene.packing, scene.require_wave(), scene.envelope
    shape, vector = scene.shape, scene.vector
    rows, columns, declared = shape.rows, shape.columns, scene.declared_vector
    missed = {
        "rows": abs(vector.per_row - declared.per_row) if packing.rows == AUTO else 0.0,
        "columns": abs(vector.per_column - declared.per_column) if packing.columns == AUTO else 0.0,
    }
    for name, miss in missed.items():
        if miss > SNAP:
            otherwise = ', or packing.ends = "fixed"' if declared.axis == "y" else ""
            return (
                f'packing.{name} = "auto": no periodic cell of at most {LARGEST_CELL} {name} carries '
                f"wave.wavenumber = {wave.wavenumber!r} to {SNAP:g}; use a number{otherwise}"
            )
    if not shape.along_y and rows % 2 == 0:
        return f"packing.rows = {rows}: must be odd between fixed ends, so that there is a centre row"
    spread = [FEWEST_DEVIATIONS * deviation for deviation in envelope.spread(declared)]
    between_walls = not shape.along_y and envelope.offset
    needed = (spread[0] + (2 * abs(envelope.offset) if between_walls else 0.0), spread[1])
    for name, count, least in zip(("rows", "columns"), (rows, columns), needed, strict=True):
        if count < least:
            return (
                f"packing.{name} = {count}: must be at least {ceil(least)}, {FEWEST_DEVIATIONS:g} standard deviations "
                "of the envelope" + (" and twice its offset" if between_walls else "")
            )
    if vector.wavenumber == 0:
        return (
            f"wave.wavenumber = {wave.wavenumber!r}: snaps to 0 in a periodic cell of {rows} rows x {columns} "
            f"columns; the smallest is 2 pi/{rows} = {2 * pi / rows:.6g}, rad per row, along y"
        )
    edge = shape.lattice.zone_edge(vector.direction)
    if vector.wavenumber > edge * (1 + 1e-12):
        return (
            f"packing.rows x packing.columns = {rows} x {columns}: wave.wavenumber = {wave.wavenumber!r} snaps to "
            f"{vector.wavenumber:.6g} at {vector.direction:.6g} degrees, but the Brillouin zone ends at {edge:.6g} "
            "there; must be more rows or columns"
        )
    return ""


@line("physics")
def amplitude_lost_in_rounding(scene: Derived) -> str:
    """Check that the wave is larger than the rounding of positions."""
    amplitude = scene.amplitude
    smallest, length = smallest_motion(scene.sphere, scene.shape)
    if amplitude < smallest:
        return (
            f"wave.amplitude = {amplitude!r}: must be at least {smallest:.3g} with this sphere in {length} "
            f"rows or columns, or D0 is less than {FEWEST_ROUNDINGS:g} roundings of a position"
        )
    return ""


@line("physics")
def time_and_echo(scene: Derived) -> str:
    """Check that snapshots fit into the run, and that it ends before the echo."""
    time, output, shape, echo = scene.time, scene.output, scene.shape, scene.echo_time
    if time.duration > echo and not time.allow_echo:
        return (
            f"time.duration = {time.duration!r}: the echo of the {shape.edge} reaches the centre of {shape.words} at "
            f"tau = {echo:.4g}; must be at most that, or set time.allow_echo = true, or "
            + ('packing.rows = "auto"' if shape.infinite else "more packing.rows and packing.columns")
        )
    snapshot = output.particles / time.sample
    # The deck rounds the spacing of the snapshots up to whole samples with the same slack
    if abs(snapshot - round(snapshot)) > 1e-9 or output.particles > time.duration:
        return (
            f"output.particles = {output.particles!r}: must be 0 or a whole multiple of time.sample = "
            f"{time.sample!r}, at most time.duration = {time.duration!r}"
        )
    return ""
