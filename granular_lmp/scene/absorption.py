"""The quiet ends of a scene: which waves reach them, and the layer that absorbs these."""

from functools import lru_cache
from math import pi

from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import Mode, Physics, bloch_mode
from granular_lmp.crystal.quiet_ends import QuietEnd, quiet_end
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import SceneError
from granular_lmp.scene.frequency import wavenumbers_at
from granular_lmp.scene.linear import mode_of, physics_of
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import AUTO

DEVIATIONS = 2.5  # of the spectrum of a packet: 1e-3 of its energy lies beyond, and is reflected more
_LEAST = 0.05  # rad per row: longer waves than that are a hundred rows long


def waves_at_ends(scene: Scene) -> list[Mode]:
    """Return the waves along y that reach the ends: the wave, the edges of a packet's spectrum, and free L at 2Ω."""
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
    room = (shape.rows if scene.wave.form == "driven" else shape.centre_row) - 3
    if end.rows > room:
        raise SceneError(
            f"absorb.rows = {end.rows}: leave no room in packing.rows = {shape.rows}, which holds {room} at most; must "
            "be fewer, for a larger absorb.reflection, or packing.rows more"
        )
    return end


def _chosen(scene: Scene, rows: int | None) -> QuietEnd:
    waves = tuple(waves_at_ends(scene))
    return _layer(scene.sphere, waves, scene.absorb.reflection, rows, physics_of(scene))


@lru_cache(maxsize=32)
def _layer(sphere: Sphere, waves: tuple[Mode, ...], wanted: float, rows: int | None, physics: Physics) -> QuietEnd:
    return quiet_end(unit_lattice(sphere), sphere, waves, wanted, rows, physics)
