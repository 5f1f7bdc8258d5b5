"""The quiet ends of a scene: which waves reach them, and the layer that absorbs these.

Sources make waves of every mode, at their frequencies; a burst those of its main lobe too. Those along y are absorbed
to the reflection that is wanted. Oblique ones are absorbed as well, but nobody has said to what.
"""

from functools import lru_cache
from math import pi

from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import Mode, Physics, bloch_mode, restored
from granular_lmp.crystal.quiet_ends import QuietEnd, quiet_end
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import SceneError
from granular_lmp.scene.frequency import wavenumbers_at
from granular_lmp.scene.linear import mode_of, physics_of
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import AUTO

DEVIATIONS = 2.5  # standard deviations of a packet's spectrum: 1e-3 of its energy lies beyond, and is reflected more
_LEAST = 0.05  # rad per row: longer waves than that are a hundred rows long


def waves_at_ends(scene: Scene) -> list[Mode]:
    """Return the waves along y that reach the ends: the wave, the edges of a packet's spectrum, and free L at 2Ω.

    Of sources they are all modes of each frequency, and of the edges of a burst's spectrum.

    Raises
    ------
    SceneError
        If no wave along y has the frequency of a source.
    """
    if scene.source:
        return _waves_of_sources(scene)
    mode, sphere, physics = mode_of(scene), scene.sphere, physics_of(scene)
    wavenumbers = {scene.wavenumber}
    if scene.envelope.length:
        width = DEVIATIONS / scene.envelope.length
        wavenumbers |= {max(scene.wavenumber - width, _LEAST), min(scene.wavenumber + width, pi - _LEAST)}
    lattice = unit_lattice(sphere)
    found = [bloch_mode(lattice, sphere, WaveVector.of(xi), mode.name, physics) for xi in sorted(wavenumbers)]
    try:
        hertz = 2 * mode.frequency / sphere.time_scale / (2 * pi)
        doubled = wavenumbers_at(hertz, sphere, physics, "L", 90.0)
    except SceneError:  # above the band no L wave runs at 2Ω
        return found
    return [*found, bloch_mode(lattice, sphere, WaveVector.of(doubled[0]), "L", physics)]


def _waves_of_sources(scene: Scene) -> list[Mode]:
    sphere, physics, usual = scene.sphere, physics_of(scene), mode_of(scene).frequency
    found: dict[tuple[str, float], Mode] = {}
    for number, source in enumerate(scene.source, 1):
        frequency = source.pulsation(sphere, usual)
        waves = [wave for share in source.band for wave in _waves_at(share * frequency, sphere, physics)]
        if not waves:
            raise SceneError(
                f"source {number}: frequency = {frequency:.6g} rad per t0: is that of no wave along y, so that nothing "
                "reaches the quiet ends; must be in a band, or absorb.rows = 0"
            )
        found |= {(wave.name, wave.wavenumber): wave for wave in waves}
    return list(found.values())


def _waves_at(frequency: float, sphere: Sphere, physics: Physics) -> list[Mode]:
    """Return the waves along y of a frequency in rad/t0, none below those of a hundred rows."""
    lattice, found = unit_lattice(sphere), []
    for name in restored(lattice, physics):
        try:
            numbers = wavenumbers_at(frequency / sphere.time_scale / (2 * pi), sphere, physics, name, 90.0)
        except SceneError:  # outside the band of the mode
            continue
        found += [bloch_mode(lattice, sphere, WaveVector.of(max(xi, _LEAST)), name, physics) for xi in numbers]
    return found


def quiet_side(scene: Scene) -> str:
    """Return the ends that absorb as LAMMPS writes the distance to them, "abs(y)", or "y" or "-y" for one of them.

    An end that is the source of waves does not absorb.
    """
    if scene.wave.form == "driven":
        return "y"
    last = scene.shape.rows - 1
    low, high = (any(each.is_in_row(end) for each in scene.source) for end in (0, last))
    if low and high:
        raise SceneError(f"absorb.rows = {scene.absorb.rows!r}: must be 0 where sources move both ends")
    return "y" if low else "-y" if high else "abs(y)"


def quiet_end_of(scene: Scene) -> QuietEnd | None:
    """Return the layer at each quiet end of a scene; None without one.

    Raises
    ------
    SceneError
        If the declared rows reflect more than is wanted, or do not fit between the centre and the end.
    """
    absorb, shape = scene.absorb, scene.shape
    if absorb.rows == 0:
        return None
    wanted = absorb.reflection
    try:
        end = _chosen(scene, None if absorb.rows == AUTO else int(absorb.rows))
        if end.reflection > wanted:
            enough = _chosen(scene, None)
            raise SceneError(
                f"absorb.rows = {absorb.rows!r}: reflect {end.reflection:.2g} of the wave, and absorb.reflection = "
                f'{wanted!r} is wanted; must be at least {enough.rows}, or "auto"'
            )
    except ValueError as error:
        raise SceneError(f"absorb.{error}") from error
    side = quiet_side(scene)
    room = (shape.centre_row if side == "abs(y)" else shape.rows) - 3
    if end.rows > room:
        raise SceneError(
            f"absorb.rows = {end.rows}: leave no room in packing.rows = {shape.rows}, which holds {room} at most; must "
            "be fewer, for a larger absorb.reflection, or packing.rows more"
        )
    first, last = 0 if side == "y" else end.rows + 1, shape.rows - 1 - (0 if side == "-y" else end.rows + 1)
    for number, each in enumerate(scene.source, 1):
        if not first <= each.rows_of()[0] <= each.rows_of()[-1] <= last:
            raise SceneError(
                f"source {number}: {each.places}: must be between the quiet ends, in rows {first} to {last}"
            )
    return end


def _chosen(scene: Scene, rows: int | None) -> QuietEnd:
    waves = tuple(waves_at_ends(scene))
    return _layer(scene.sphere, waves, scene.absorb.reflection, rows, physics_of(scene))


@lru_cache(maxsize=32)
def _layer(sphere: Sphere, waves: tuple[Mode, ...], wanted: float, rows: int | None, physics: Physics) -> QuietEnd:
    return quiet_end(unit_lattice(sphere), sphere, waves, wanted, rows, physics)
