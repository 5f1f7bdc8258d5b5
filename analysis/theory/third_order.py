"""Third order of one wave in any crystal: the shift of its frequency, and the third harmonic that runs with it.

The cubic part of the law acts on the wave, and the quadratic part on the wave and the fields that it has made to second
order, u₂ = ½Re X₂e^{2iα} + ½Re X₀. With the forces C and N of `analysis.theory.bonds.Bonds.cubic` and
`quadratic`, for z = U e^{iα} these are

    G₁ = ¾C(z, z, z*) + ½N(X₂, z*) + N(X₀, z),      G₃ = ¼C(z, z, z) + ½N(X₂, z)

The first runs with the wave and changes its frequency by δω = −U†G₁/(2ω U†MU), which grows as the square of its
amplitude; the second forces the third harmonic. Along y δω is σ of `analysis.theory.frequency_shift`.

The geometry's own cubic terms are left out: along y, 5δ/2R of the third harmonic of TR at ξ = 0.802, 0.1 % in the
paper's silica. So is memory, and every law but the secant one is refused.
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
    return shift_by(crystal, wave, doubled=doubled, static=static, cubic=True)


def shift_by(
    crystal: Crystal, wave: Wave, *, doubled: Wave | None = None, static: Wave | None = None, cubic: bool = False
) -> Floats:
    """Return the part of δω (...) that fields of second order, and the cubic forces if asked for, make.

    Raises ValueError for the incremental law.
    """
    _refuse_incremental(crystal)
    bonds = crystal.bonds
    one, back = (bonds.strain(each.shape, each.wavevector) for each in (wave, wave.reversed))
    ends = 0.75 * cubic * bonds.cubic(one, one, back)
    if doubled:
        ends = ends + bonds.quadratic(_strain(crystal, doubled), back, (doubled.frequency, -wave.frequency)).running
    if static:
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
    _refuse_incremental(crystal)
    twice, still = Mixed(crystal, wave, wave), Mixed(crystal, wave, wave.reversed)
    return (
        Wave(twice.wavevector, twice.frequency, 0.5 * twice.forced()),
        Wave(still.wavevector, still.frequency, 0.5 * still.static()),
    )


def _refuse_incremental(crystal: Crystal) -> None:
    if crystal.bonds.shear_law != "secant":
        raise ValueError(f"law = {crystal.bonds.shear_law!r} is not in the cubic forces; allowed: 'secant'")


def _strain(crystal: Crystal, wave: Wave) -> Strain:
    return crystal.bonds.strain(wave.shape, wave.wavevector)
