"""What third order does to one wave of any crystal: its frequency shifts, and a third harmonic runs with it.

Third order is what the cubic part of the law does to the wave, and the quadratic part to the wave with what it has made
to second order, u₂ = ½Re X₂e^{2iα} + ½Re X₀. With the forces C and N of `analysis.theory.bonds.Bonds.cubic` and
`quadratic`, for z = U e^{iα} these are

    G₁ = ¾C(z, z, z*) + ½N(X₂, z*) + N(X₀, z),      G₃ = ¼C(z, z, z) + ½N(X₂, z)

The first runs with the wave and changes its frequency by δω = −U†G₁/(2ω U†MU), which grows as the square of its
amplitude; the second forces the third harmonic. Along y δω is σ of `analysis.theory.frequency_shift`.

The geometry's own cubic terms, of relative order δ/R, are left out; so is memory, and the incremental law is refused.
When it breaks: next to a resonance of the second harmonic, where X₂ has no bound.
"""

import numpy as np
from numpy.typing import NDArray

from analysis.theory.bonds import Strain
from analysis.theory.crystal import Crystal
from analysis.theory.second_order import Mixed, Wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def frequency_shift(crystal: Crystal, wave: Wave) -> Floats:
    """Return δω (...) of waves with their amplitudes; it is that times the square of an amplitude.

    Raises ValueError for the incremental law, and where slip winds up.
    """
    doubled, static = _second(crystal, wave)
    bonds = crystal.bonds
    one = bonds.strain(wave.shape, wave.wavevector)
    back = bonds.strain(wave.reversed.shape, wave.reversed.wavevector)
    ends = 0.75 * bonds.cubic(one, one, back)
    ends = ends + bonds.quadratic(_strain(crystal, doubled), back, (doubled.frequency, -wave.frequency)).running
    ends = ends + 2 * bonds.quadratic(_strain(crystal, static), one, (static.frequency, wave.frequency)).running
    force = bonds.gather(ends, wave.wavevector, len(crystal))
    # The dual of the wave itself: its shape, over its energy
    mass = crystal.mass * (np.arange(6)[None] == np.array(crystal.freedoms)[:, None]).any(axis=0)
    share = np.sum(wave.shape.conj() * force, axis=(-2, -1)) / np.sum(mass * np.abs(wave.shape) ** 2, axis=(-2, -1))
    return np.asarray(-np.real(share) / (2 * wave.frequency))


def third_harmonic(crystal: Crystal, wave: Wave) -> Complexes:
    """Return the force G₃ (..., B, 6) on the third harmonic of waves with their amplitudes, e^{3iα}.

    Raises ValueError for the incremental law.
    """
    doubled, _ = _second(crystal, wave)
    bonds = crystal.bonds
    one = bonds.strain(wave.shape, wave.wavevector)
    ends = 0.25 * bonds.cubic(one, one, one)
    ends = ends + bonds.quadratic(_strain(crystal, doubled), one, (doubled.frequency, wave.frequency)).running
    return bonds.gather(ends, 3 * wave.wavevector, len(crystal))


def _second(crystal: Crystal, wave: Wave) -> tuple[Wave, Wave]:
    """Return the second harmonic and the static field of waves, as waves."""
    if crystal.bonds.shear_law != "secant":
        raise ValueError(f"law = {crystal.bonds.shear_law!r} is not in the cubic forces; allowed: 'secant'")
    twice, still = Mixed(crystal, wave, wave), Mixed(crystal, wave, wave.reversed)
    return (
        Wave(twice.wavevector, twice.frequency, 0.5 * twice.forced()),
        Wave(still.wavevector, still.frequency, 0.5 * still.static()),
    )


def _strain(crystal: Crystal, wave: Wave) -> Strain:
    return crystal.bonds.strain(wave.shape, wave.wavevector)
