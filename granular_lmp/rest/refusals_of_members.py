"""Refusals of strikers, states, sources and monitors, by themselves and together with the crystal."""

from collections.abc import Iterator
from dataclasses import replace
from math import inf

from granular_lmp.crystal.lattices import HELD as HELD_FACE
from granular_lmp.rest.derived import Derived
from granular_lmp.rest.refusal import ALL, AT_REST, Refusal, joining
from granular_lmp.scene import samples
from granular_lmp.scene.places import counting_trouble, place_troubles
from granular_lmp.scene.schema import AUTO, NameRule, shown
from granular_lmp.scene.signals import SIGNALS
from granular_lmp.scene.sources import LARGEST_ANGLE, LOWEST, TORQUES, Source
from granular_lmp.scene.strikers import striker_troubles
from granular_lmp.scene.without_wave import WAVE

LINES: list[Refusal] = []
line = joining(LINES, of=AT_REST)


@line("physics", of=(WAVE,))
def touching_beside_a_wave(scene: Derived) -> str:
    if not scene.start.touching:
        return ""
    return "start.touching = true: must be false beside [wave], whose crystal is at rest"


@line("physics", of=ALL)
def places_of_strikers(scene: Derived) -> str:
    """Check that strikers and states have places in a packing of declared size."""
    at, packing = scene.start.at(), scene.packing
    for trouble in striker_troubles(scene.striker, scene.shape, scene.space):
        return trouble
    for trouble in (each for state in at for each in place_troubles((), state.spheres, scene.shape, None)):
        return f"start.state: {trouble}"
    counted = packing.rows, packing.columns
    return counting_trouble(scene.striker, *counted, "[[striker]]") or counting_trouble(at, *counted, "[start]")


@line("physics")
def strike_beside_quiet_ends(scene: Derived) -> str:
    if not scene.struck or scene.absorb.rows == 0:
        return ""
    return (
        f"absorb.rows = {scene.absorb.rows!r}: must be 0 beside [[striker]] or [start]: no number of rows absorbs the "
        "long waves of a strike"
    )


@line("physics")
def too_strong_a_strike(scene: Derived) -> str:
    strongest = scene.sphere.radius / scene.sphere.static_overlap / 10
    if not scene.struck or scene.strike <= strongest:
        return ""
    return (
        f"striker or start: would stretch contacts by up to {scene.strike:.3g} Delta0; must be at most "
        f"{strongest:.3g}, a tenth of the radius"
    )


@line("physics", of=(WAVE,))
def nothing_shakes_a_crystal_at_rest(scene: Derived) -> str:
    """Refuse a crystal that nothing shakes or strikes, and a phase or an envelope without a wave."""
    wave, envelope, sources = scene.require_wave(), scene.envelope, scene.drives
    if scene.form.waves:
        return ""
    needed = {
        "source": (len(sources), bool(sources) or scene.struck, "at least one table [[source]], or a strike,"),
        "wave.phase": (wave.phase, wave.phase == 0, "0 (sources have their own phases)"),
        "envelope.length": (envelope.length, envelope.length == 0, "0"),
        "envelope.width": (envelope.width, envelope.width == 0, "0"),
    }
    for key, (value, right, allowed) in needed.items():
        if not right:
            return f'{key} = {shown(value)}: must be {allowed} with wave.form = "{wave.form}"'
    return ""


@line("physics")
def sources_by_themselves(scene: Derived) -> str:
    sources, packing, duration = scene.drives, scene.packing, scene.time.duration
    if trouble := counting_trouble(sources, packing.rows, packing.columns, "[[source]]"):
        return trouble
    for number, each in enumerate(sources, 1):
        if trouble := next(_troubles(each, scene), ""):
            return f"source {number}: {trouble}"
        if scene.wave is None and each.needs_frequency:
            return f"source {number}: frequency: missing; without [wave] it must be given, or hertz"
        if each.sampled and samples.end(each.sampled) + each.delay < duration * (1 - samples.UNEVEN):
            return (
                f"source {number}: signal: ends at tau = {each.sampled[-1][0] + each.delay:g} with "
                f"{each.sampled[-1][1]:g}: must return to 0, or last to time.duration = {duration!r}"
            )
    if (count := sum(len(each.sampled) for each in sources)) > samples.MOST:
        return f"source: {count} samples: must be at most {samples.MOST} in all signals together"
    return ""


def _troubles(source: Source, scene: Derived) -> Iterator[str]:
    """Yield the errors of a single source."""
    shape, sphere = scene.shape, scene.sphere
    yield from place_troubles(source.rows, source.spheres, shape, source.layers)
    given = [name for name in ("motion", "force") if getattr(source, name)]
    if len(given) != 1:
        yield f"{' and '.join(given) or 'neither'} given: must be either motion or force"
    elif source.leaves_plane and scene.space == 2:
        yield f'{given[0]} = "{getattr(source, given[0])}": leaves the plane of the spheres; needs packing.space = 3'
    if source.frequency is not None and source.hertz is not None:
        yield f"frequency = {source.frequency!r} and hertz = {source.hertz!r}: must be one of the two"
    for key in dict.fromkeys(key for signal in SIGNALS.values() for key in signal.keys):
        if key not in source.known.keys and getattr(source, key) != getattr(Source, key):
            allowed = " or ".join(name for name, signal in SIGNALS.items() if key in signal.keys)
            yield f'{key} = {getattr(source, key)!r}: is for signal = {allowed} only, not "{source.kind}"'
    if source.motion and scene.form.driven and source.is_in_row(0):
        yield f"{source.places}: must not contain spheres of the first row, which is driven"
    if source.force and shape.holds(*source.marks(shape.columns // 2)).any():
        held = " and ".join(name for name, face in shape.faces.items() if face == HELD_FACE)
        yield f"{source.places}: must lie between the faces that are held ({held}), which feel no force"
    largest = sphere.radius / sphere.static_overlap / 10 / scene.amplitude
    if source.motion and source.largest > largest:
        yield f"amplitude = {source.largest!r}: must be at most {largest:.3g}, a motion by R/10"
    largest *= 10 * LARGEST_ANGLE
    if source.force in TORQUES and source.largest > largest:
        yield (
            f"amplitude = {source.largest!r}: must be at most {largest:.3g}: a torque that turns spheres by more than "
            f"about {LARGEST_ANGLE:g} rad decreases with the cosine of their angle"
        )


@line("physics")
def long_waves_before_quiet_ends(scene: Derived) -> str:
    """Check that sources of a scene with quiet ends make no waves that are too long for them."""
    if scene.absorb.rows == 0:
        return ""
    for number, each in enumerate(scene.source, 1):
        endless = min(replace(each, cycles=inf).band, default=0.0)  # the lowest frequency without a window
        if endless <= LOWEST:
            allowed = " or ".join(f'"{name}"' for name, signal in SIGNALS.items() if signal.band(each))
            wrong, must = f'signal = "{each.kind}"', allowed
            if each.band:
                wrong, must = f"sweep = {each.sweep!r}", "above 1/3"
            return (
                f"source {number}: {wrong}: must be {must} with absorb.rows, as no number of rows absorbs the long "
                "waves in its spectrum"
            )
        lowest = min(each.band)
        if lowest < LOWEST:
            fewest = (endless - lowest) * each.cycles / (endless - LOWEST)
            return (
                f"source {number}: cycles = {each.cycles!r}: must be at least {fewest:.4g} with absorb.rows, as no "
                f"number of rows absorbs the longest waves of a shorter {each.kind}"
            )
    return ""


@line("physics", of=ALL)
def monitors_by_themselves(scene: Derived) -> str:
    """Check that names of monitors differ, and that their places are in a packing of declared size."""
    packing, shape = scene.packing, scene.shape
    if not scene.monitor:
        return ""
    if packing.rows == AUTO:
        return f"packing.rows = {packing.rows!r}: must be a number with [[monitor]], which counts rows"
    names: dict[str, int] = {}
    for number, each in enumerate(scene.monitor, 1):
        if not each.name:
            return f"monitor {number}: name: missing key; must be {NameRule(str, '', '').allowed}"
        if each.name.lower() in names:
            return f"monitor {number}: name = {each.name!r}: is that of monitor {names[each.name.lower()]} too"
        names[each.name.lower()] = number  # some file systems ignore case
        if each.spheres and packing.columns == AUTO:
            return f"packing.columns = {packing.columns!r}: must be a number where a monitor has single spheres"
        for trouble in place_troubles(each.rows, each.spheres, shape, each.layers):
            return f"monitor {each.name}: {trouble}"
        if each.known.of == "row" and not each.rows:
            return f'monitor {each.name}: {each.places}: must be rows with what = "{each.what}"'
    return ""
