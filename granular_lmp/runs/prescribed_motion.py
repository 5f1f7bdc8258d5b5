"""Velocities and spins of spheres with a prescribed motion: the driven row, and sources that move.

LAMMPS computes forces with velocities of half a step ago. So a deck gives a moved sphere the velocity [u(τ) − u(τ −
h)]/h, a turned sphere the spin [φ(τ + h) − φ(τ)]/h, and dumps hold these values. They differ by half a step from the
places in the same record, so this module replaces them by the derivatives of the signal, u′(τ) and φ′(τ).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.initial_fields import initial_fields
from granular_lmp.rest.linear import bloch_wave, usual_frequency
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.sources import PlacedSource, Source, placed

Floats = NDArray[np.float64]


class Moved(NamedTuple):
    """Prescribed motion in a record: places of the spheres in it (m,), the source, and its factor (m,) for each."""

    place: NDArray[np.intp]
    by: PlacedSource
    factor: Floats

    def into(self, tau: ArrayLike, velocity: Floats, spin: Floats) -> None:
        """Write the rates at times (...) into velocities (..., N, 2) and spins (..., N), in space (..., N, 3)."""
        rate, turns = self.by.rate(tau)[..., None] * self.factor, bool(self.by.source.turns)
        if turns and spin.ndim < velocity.ndim:
            spin[..., self.place] = rate
        else:
            (spin if turns else velocity)[..., self.place, "xyz".index(self.by.source.axis)] = rate


def moved_spheres(scene: Scene, spheres: NDArray[np.integer]) -> list[Moved]:
    """Return the prescribed motions of recorded spheres, given by ascending indices in the crystal (N,)."""
    motions = [each for each in scene.drives if each.motion]
    driven = scene.form.driven
    if not driven and not motions:
        return []
    atoms = crystal_of(scene).atoms
    every = [(each, np.ones(len(atoms))) for each in placed(motions, atoms, scene.sphere, usual_frequency(scene))]
    if driven:
        wave = bloch_wave(scene)
        axis, first = int(wave.mode.along_y), np.flatnonzero(atoms.arrays["row"] == 0)
        tone = Source(rows=(0, 0), motion="xy"[axis], ramp=scene.envelope.ramp, phase=wave.declared.phase)
        factor = initial_fields(scene, atoms, wave).displacement[:, axis]
        every.append((PlacedSource(tone, first, wave.mode.frequency), factor))
    found = []
    for source, factor in every:
        own = spheres[np.isin(spheres, source.spheres)]
        found.append(Moved(np.searchsorted(spheres, own), source, factor[own]))
    return [each for each in found if len(each.place)]


def at_the_instant(
    moved: Sequence[Moved], tau: ArrayLike, fields: tuple[Floats, Floats, Floats, Floats]
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return displacement, velocity, rotation and spin, with the rates of moved spheres at the recorded times."""
    displacement, velocity, rotation, spin = fields
    for each in moved:
        each.into(tau, velocity, spin)
    return displacement, velocity, rotation, spin
