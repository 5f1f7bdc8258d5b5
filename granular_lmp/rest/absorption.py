"""Quiet ends of a scene: which waves reach them, and the layer that absorbs these waves.

Sources make waves of every mode at their frequencies; a burst also at those of its main lobe. The layer absorbs waves
along y down to the wanted reflection. It absorbs oblique waves too, but their reflection is not known.

Rows, strength and power follow from the lattice, so all runs of one scene have the same layer at any time step. The
reported reflection is that of the step of the run, and "auto" takes as many rows as this step needs. With a tolerance
it is that of step zero, to which the runs are extrapolated.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import pi

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.mode import Mode, Physics
from granular_lmp.crystal.modes import bloch_mode, highest_frequency, named_in_space, restored
from granular_lmp.crystal.quiet_ends import (
    MOST_ROWS,
    QuietEnd,
    frequency_in_lattice,
    frequency_in_run,
    quiet_end,
    reflection,
)
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import SceneError
from granular_lmp.rest.frequency import wavenumbers_at
from granular_lmp.rest.linear import mode_of, physics_of, unit_contacts, usual_frequency
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.schema import AUTO

DEVIATIONS = (
    2.5  # standard deviations of a packet's spectrum: the 1e-3 of its energy that lies beyond is reflected more
)
_LEAST = 0.05  # rad per row: waves below this are longer than a hundred rows


def waves_at_ends(scene: Scene, step: float = 0.0) -> list[Mode]:
    """Return the waves along y that reach the ends: the wave, edges of a packet's spectrum, and free L at 2Ω.

    For sources they are all modes at each frequency, and at the edges of the spectrum of a burst. In a run with a
    `step` h (τ) a source at Ω makes the waves that the lattice has at 2 sin(Ωh/2)/h, while a packet keeps its initial
    wave numbers.

    Raises
    ------
    SceneError
        If no wave along y has the frequency of a source.
    """
    if not scene.form.waves:
        return _waves_of_sources(scene, step)
    shaken = _waves_of_sources(scene, step) if scene.source else []
    mode, sphere, physics = mode_of(scene), scene.sphere, physics_of(scene)
    lattice, usual = unit_contacts(scene), frequency_in_run(mode.frequency, step)
    if scene.form.driven:
        usual = mode.frequency
        numbers = _numbers_at(scene, frequency_in_lattice(usual, step), mode.name) if step else ()
        # At the edge of a band no wave may be left, but the row shakes its neighbours nevertheless
        wavenumbers = {min(numbers, key=lambda xi: abs(xi - scene.wavenumber), default=scene.wavenumber)}
    else:
        wavenumbers = {scene.wavenumber}
    if scene.envelope.length:
        width = DEVIATIONS / scene.envelope.length
        wavenumbers |= {max(scene.wavenumber - width, _LEAST), min(scene.wavenumber + width, pi - _LEAST)}
    vector = scene.lattice.vector
    found = [bloch_mode(lattice, sphere, vector(xi), mode.name, physics) for xi in sorted(wavenumbers)]
    doubled = _numbers_at(scene, frequency_in_lattice(2 * usual, step), "L")
    # Above the band no L wave runs at 2Ω
    return [*found, *(bloch_mode(lattice, sphere, vector(xi), "L", physics) for xi in doubled[:1]), *shaken]


def _waves_of_sources(scene: Scene, step: float) -> list[Mode]:
    sphere, usual = scene.sphere, usual_frequency(scene)
    found: dict[tuple[str, float], Mode] = {}
    for number, source in enumerate(scene.drives, 1):
        frequency = source.pulsation(sphere, usual)
        shaken = [frequency_in_lattice(share * frequency, step) for share in source.band]
        waves = [wave for each in shaken for wave in _waves_at(scene, each)]
        if not waves:
            raise SceneError(
                f"source {number}: frequency = {frequency:.6g} rad per t0: no wave along y has it, so nothing reaches "
                "the quiet ends; must be in a band, or absorb.rows = 0",
                because="physics",
            )
        found |= {(wave.name, wave.wavenumber): wave for wave in waves}
    return list(found.values())


def _waves_at(scene: Scene, frequency: float) -> list[Mode]:
    """Return the waves along y at a frequency in rad/t0, without waves longer than a hundred rows."""
    lattice, physics = unit_contacts(scene), physics_of(scene)
    return [
        bloch_mode(lattice, scene.sphere, scene.lattice.vector(max(xi, _LEAST)), name, physics)
        for name in _names(scene)
        for xi in _numbers_at(scene, frequency, name)
    ]


def _names(scene: Scene) -> tuple[str, ...]:
    """Return the names of all waves along y; in space the names by mirror symmetry, as numbered branches meet there."""
    lattice, physics = unit_contacts(scene), physics_of(scene)
    if not physics.space:
        return restored(lattice, physics)
    named = named_in_space(lattice, scene.sphere, scene.lattice.vector(1.0), physics)
    return tuple(name for name in named if name[0] in "SH") or restored(lattice, physics)


def _numbers_at(scene: Scene, frequency: float, name: str) -> tuple[float, ...]:
    """Return the wave numbers along y of a mode at a frequency in rad/t0, none outside its band."""
    sphere, hertz = scene.sphere, frequency / scene.sphere.time_scale / (2 * pi)
    try:
        return wavenumbers_at(hertz, sphere, physics_of(scene), name, 90.0, scene.lattice, scene.wall)
    except SceneError:
        return ()


def quiet_side(scene: Scene) -> str:
    """Return the LAMMPS expression for the distance to the ends that absorb: "abs(y)", or "y" or "-y" for one end."""
    sides = {"last": "y", "first": "-y"}
    return sides[scene.absorbing[0]] if len(scene.absorbing) == 1 else "abs(y)"


def quiet_end_of(scene: Scene) -> QuietEnd | None:
    """Return the layer at each quiet end, with its reflection at the step of the scene; None if no end is quiet.

    Raises
    ------
    SceneError
        If the declared rows reflect too much, or do not fit between the centre and the end.
    """
    absorb, shape = scene.absorb, scene.shape
    if absorb.rows == 0:
        return None
    try:
        if absorb.rows == AUTO:
            end = _enough(scene)
        else:
            end = _layer_of(scene, int(absorb.rows))
            if end.reflection > absorb.reflection:
                raise SceneError(
                    f"absorb.rows = {absorb.rows!r}: reflect {end.reflection:.2g} of the wave, more than "
                    f'absorb.reflection = {absorb.reflection!r}; must be at least {_enough(scene).rows}, or "auto"',
                    because="physics",
                )
            end = _in_run(scene, end)
    except ValueError as error:
        raise SceneError(f"absorb.{error}", because="physics") from error
    side = quiet_side(scene)
    room = (shape.centre_row if side == "abs(y)" else shape.rows) - 3
    if end.rows > room:
        raise SceneError(
            f"absorb.rows = {end.rows}: leave no room in packing.rows = {shape.rows}, which has room for {room}; use "
            "fewer with a larger absorb.reflection, or more packing.rows",
            because="physics",
        )
    first, last = 0 if side == "y" else end.rows + 1, shape.rows - 1 - (0 if side == "-y" else end.rows + 1)
    for number, each in enumerate(scene.source, 1):
        if not first <= each.rows_of()[0] <= each.rows_of()[-1] <= last:
            raise SceneError(
                f"source {number}: {each.places}: must be between the quiet ends, in rows {first} to {last}",
                because="physics",
            )
    return end


def remarks_on_ends(scene: Scene) -> list[str]:
    """Return a sentence if the declared rows reflect too much only because of the time step."""
    end, wanted = quiet_end_of(scene), scene.absorb.reflection
    if end is None or end.reflection <= wanted:
        return []
    return [
        f"absorb.rows = {end.rows}: reflect {end.reflection:.3g} of the wave at time.timestep = "
        f"{scene.time.timestep!r}, more than absorb.reflection = {wanted!r}; use {_enough(scene).rows} rows, or a "
        "shorter step"
    ]


def _enough(scene: Scene) -> QuietEnd:
    """Return the layer with the fewest rows that reflects little enough, in the lattice and in the run."""
    wanted = scene.absorb.reflection
    in_lattice = _layer_of(scene, None)
    while (end := _in_run(scene, in_lattice)).reflection > wanted or in_lattice.reflection > wanted:
        if end.rows >= MOST_ROWS:
            raise ValueError(
                f"reflection = {wanted!r}: needs more than {MOST_ROWS} rows at this step; allow a larger reflection"
            )
        in_lattice = _layer_of(scene, end.rows + 1)
    return end


def _in_run(scene: Scene, end: QuietEnd) -> QuietEnd:
    """Return a layer with its reflection at the step of the scene, or at step zero with a tolerance."""
    sphere, physics = scene.sphere, physics_of(scene)
    step = scene.time.clock.of_answer
    if step * highest_frequency(unit_contacts(scene), sphere, physics) >= 2:  # such a step is refused elsewhere
        return end
    return replace(
        end, reflection=_largest(unit_contacts(scene), sphere, tuple(waves_at_ends(scene, step)), end, physics, step)
    )


def _layer_of(scene: Scene, rows: int | None) -> QuietEnd:
    waves = tuple(waves_at_ends(scene))
    return _layer(unit_contacts(scene), scene.sphere, waves, scene.absorb.reflection, rows, physics_of(scene))


@lru_cache(maxsize=32)
def _layer(
    lattice: Contacts, sphere: Sphere, waves: tuple[Mode, ...], wanted: float, rows: int | None, physics: Physics
) -> QuietEnd:
    return quiet_end(lattice, sphere, waves, wanted, rows, physics)


@lru_cache(maxsize=32)
def _largest(
    lattice: Contacts, sphere: Sphere, waves: Sequence[Mode], end: QuietEnd, physics: Physics, step: float
) -> float:
    return max(reflection(lattice, sphere, wave, end, physics, step) for wave in waves)
