"""Jacobian of the record of weak waves for each contact and sphere, from one more run for each recorded row.

Let waves be so weak that forces are linear in the motion, and let the loads on contacts at rest be negligible. If the
stiffness of contact c changes from k to k(1 + p_c), the displacement recorded at sphere m along an axis changes by

    ∂u_m(t)/∂p_c = −k ∫ ẽ_c(t − s) e_c(s) ds

Here e_c is the stretch of the contact in the run, and ẽ_c is its stretch in another run, in which a unit impulse
strikes sphere m along that axis. The equation is reciprocity, which holds as the contact forces derive from an energy.
For the shear stiffness, the slip replaces the stretch. For the density of sphere i, the momenta do:

    ∂u_m(t)/∂p_i = −∫ [m u̇̃_i·u̇_i + I ω̃_i ω_i] ds

A relative change of the pull of a contact changes both of its stiffnesses by a third as much, since the overlap at rest
grows as the pull to the power 2/3.

Integrals are sums over the samples of a run, by fast Fourier transforms. All columns of the Jacobian together need one
run for each recorded row, while `granular_analysis.theory.network_gradient.derivative` costs four to eight runs for
each column.

When it breaks: the relative error is the ratio of the wave's overlaps to those at rest, plus (ωh)²/12 for samples h
apart. Sliding friction is left out. A search that uses this Jacobian only as curvature, beside the exact gradient, ends
at the exact minimum.

Source: A. Tarantola, Geophysics 49, 1259 (1984).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from granular_analysis.theory.network import Network
from granular_analysis.theory.network_compiled import fastest_march
from granular_analysis.theory.network_factors import Run
from granular_analysis.theory.network_state import Pairs, loaded

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
# The normal and shear stiffness of a contact grow as these powers of each factor
STIFFENS = {"normal_stiffness": (1.0, 0.0), "shear_stiffness": (0.0, 1.0), "adhesion": (1 / 3, 1 / 3)}
FACTORS = (*STIFFENS, "density")
_SMALL = 1e-4  # share of the overlap: step of a difference, and displacement by an impulse between two samples


def kernels(run: Run, name: str, owners: Integers, errors: Floats) -> Iterator[tuple[int, int, Floats]]:
    """Yield a row of the motion, the index of a recorded sphere, and the derivatives (T + 1, P) of its record.

    Parameters
    ----------
    run : Run
    name : one of `FACTORS`.
    owners : (P,) pairs or spheres whose factor varies.
    errors : (T + 1, 2f, n) errors of the record, inf where it is not needed; a row that is inf at all times is left
        out, and so are turns and spins.
    """
    network, state = run.network, run.state
    still = replace(network, drives=(), held=network.mobility[0] == 0)
    weights = _weights(network, state.pairs, name, owners)
    length = next_fast_len(2 * run.samples + 1, real=True)
    there = rfft(_features(run, network, state.motion, name, owners) * weights, length, axis=1)
    apart = run.step * run.every
    small = _SMALL * float(np.abs(state.pairs.overlap).min())
    needed = np.asarray(np.isfinite(errors).any(axis=0))
    for number, sphere in enumerate(run.spheres):
        for axis in range(network.dimension):
            if not needed[[axis, axis + network.freedoms], number].any():
                continue
            motion = np.zeros_like(state.motion)
            if still.mobility[axis, sphere]:
                motion[network.freedoms + axis, sphere] = small / apart
            here = _features(run, still, motion, name, owners)
            here[:, 0] /= 2
            # Scaled to a unit impulse, which gives a sphere the velocity 1/m
            size = apart**2 / small / network.mass[sphere]
            found = -size * irfft((there * rfft(here, length, axis=1)).sum(axis=0), length, axis=0)[: run.samples + 1]
            for row, slopes in ((axis, found), (axis + network.freedoms, np.gradient(found, apart, axis=0))):
                if needed[row, number]:
                    yield row, number, slopes


def _motions(run: Run, network: Network, motion: Floats) -> Floats:
    """Return the motion of all spheres at each sample, (T + 1, 2f, N)."""
    begun = loaded(network, motion)
    return np.array([*fastest_march()(network, begun, run.step, run.samples * run.every, run.every)])


def _features(run: Run, network: Network, motion: Floats, name: str, owners: Integers) -> Floats:
    """Return the factors of the integrand, (K, T + 1, P): stretch and slips of contacts, or velocities and spins."""
    found, d, pairs = _motions(run, network, motion), network.dimension, run.state.pairs
    if name == "density":
        return np.moveaxis(found[:, network.freedoms :, owners], 1, 0)
    first, second = pairs.first[owners], pairs.second[owners]
    normal = pairs.apart[:, owners] / pairs.length[owners]
    way = found[:, :d, second] - found[:, :d, first]
    radii = pairs.radii[:, owners]
    turn = radii[0] * found[:, d : network.freedoms, first] + radii[1] * found[:, d : network.freedoms, second]
    stretch = np.einsum("tdp,dp->tp", way, normal)
    if d == 2:
        slips = way[:, 1] * normal[0] - way[:, 0] * normal[1] - turn[:, 0]
        return np.stack([stretch, slips])
    across = way - stretch[:, None] * normal - np.cross(turn, normal[None], axis=1)
    return np.stack([stretch, *np.moveaxis(across, 1, 0)])


def _weights(network: Network, pairs: Pairs, name: str, owners: Integers) -> Floats:
    """Return the weights of the K products in the integrand, (K, 1, P): stiffnesses, or masses and inertias."""
    if name == "density":
        d, turns = network.dimension, network.freedoms - network.dimension
        inertia = network.inertia if network.rotation else 0 * network.inertia
        return np.stack([network.mass[owners]] * d + [inertia[owners]] * turns)[:, None]
    closed = np.ones(len(pairs.overlap), dtype=bool)
    ends = [pairs.overlap * (1 + sign * _SMALL) for sign in (-1, 1)]
    low, high = (pairs.normal.repulsion(each, pairs.normal.radius(each, closed), closed) for each in ends)
    normal = (high - low) / (ends[1] - ends[0])
    shear = pairs.B * pairs.normal.radius(pairs.overlap, closed)
    powers = STIFFENS[name]
    found = [powers[0] * normal] + [powers[1] * shear] * (1 if network.dimension == 2 else 3)
    return np.stack(found)[:, None, owners]
