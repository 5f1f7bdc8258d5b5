"""Attenuation and frequency shift of a wave in a hexagonal sheet of spheres with random densities, to Born's order.

Sphere j has the density ρ(1 + ε_j) with ⟨ε_j⟩ = 0, ⟨ε_j ε_l⟩ = σ²δ_jl; its mass and moment of inertia are M(1 + ε_j).
Springs are those of the perfect sheet. A motion U e^{−iΩt} obeys

    (D − Ω²M) U = Ω² M ε U.

One iteration of this equation, averaged over the disorder, gives the coherent wave a self-energy of second order,

    Ω² = Ω_k² − Σ(Ω_k),    Σ(Ω) = σ²Ω⁴ (1/N) Σ_k'b' |e†M e'|² / (Ω'² − Ω² − i0),    e†M e = 1,

over all modes e' = e(k', b') of the zone. Uncorrelated disorder scatters into all wave vectors alike, so only the
overlap of the polarisations enters. With Ω = Ω_k + shift − iΓ

    shift = −Re Σ/(2Ω),    Γ = Im Σ/(2Ω) = (π/4) σ²Ω² (1/N) Σ_k'b' |e†M e'|² δ(Ω' − Ω).

The energy decays at 2Γ, which is Tamura's rate of isotope scattering (1983), (π/2) g ω² (1/N) Σ |e*·e'|² δ(ω − ω')
with g = σ². There is no shift in first order: mass disorder does not change the speed.

**Long waves.** In two dimensions modes of frequency Ω lie on circles of length ∝ Ω, and the squared overlap of
polarisations is one half on average over angles, for any branches. With the area A = √3/2 of a sphere's cell

    Γ → σ² A Ω³ (1/c_L² + 1/c_T²)/16 ∝ q³,    shift → −σ²Ω³ A (1/c_L² + 1/c_T²) ln(q_D/q)/(8π),

which is Rayleigh scattering, q^{d+1}, in d = 2 (Klemens' ω⁴ in d = 3). `long_wave` returns the first.

**One heavy sphere** with mass and moment of inertia (1 + ε)M is solved to all orders: the T matrix of a defect at one
site is T = Ω²Mε [1 − G Ω²Mε]⁻¹ with G = (1/N) Σ e' e'†/(Ω'² − Ω² − i0), 3 × 3. By the optical theorem the wave loses
the flux through a width (the cross-section in two dimensions)

    W = A Im(e†T e)/(Ω |v_g|),        long waves: W → 2Γ A/|v_g| with the above Γ and σ² → ε².

**Sum over the zone.** δ is a Gaussian of standard deviation `width`, and the principal value is its Hilbert transform,
so the error is of order (width/Ω)². A sum over a grid converges to rounding if neighbouring frequencies differ by no
more than the width. Width and grid are parameters, and tests double them.

Breaks if Γ is not small against Ω, for σ above about 0.3, and near van Hove singularities (flat branches), where higher
orders broaden the modes in the sum. Disorder of radii is left out: it disorders the springs, in first order.

Sources: S. Tamura, Phys. Rev. B 27, 858 (1983), of which the abstract was read; P. G. Klemens, Proc. Phys. Soc. A 68,
1113 (1955), known only from quotations. The derivation above is our own.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import wofz

from granular_analysis.theory.bloch import RECIPROCAL, branch_index, real_modes, wavevector_of
from granular_analysis.theory.contact import Contact

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

CELL = np.sqrt(0.75)  # area of a sphere's cell, in lattice constants squared
GRID = 512  # enough for widths down to 0.006, which is 2π(2/√3)/512 times the largest group speed, 0.43
WIDTH = 0.006
BLOCK = 4096  # wave vectors solved at once; all of a grid of 512 exceed the cache and take three times as long


@dataclass(frozen=True)
class Scattered:
    """Decay and shift of a coherent wave C e^{−Γt − i(Ω + shift)t}, per unit of the variance σ²; rates in 1/t0.

    Attributes
    ----------
    frequency : Ω of the perfect sheet.
    rate : Γ/σ² of the amplitude; the energy decays at twice this rate.
    by_branch : (J,) parts of the rate by the branch scattered into, in ascending frequency; J is 3, or 2 without
        rotation.
    shift : shift of frequency over σ².
    """

    frequency: float
    rate: float
    by_branch: Floats
    shift: float


def scattered(
    name: str,
    wavenumber: float,
    contact: Contact,
    *,
    direction: float = 90.0,
    width: float = WIDTH,
    grid: int = GRID,
) -> Scattered:
    """Return attenuation and shift of one wave for density disorder of unit variance.

    Parameters
    ----------
    name : "L", "TR" or "RT".
    wavenumber : ξ = (√3/2)|k|, rad per row for a wave along y.
    contact : contact of the perfect sheet; dashpots are ignored.
    direction : direction of k, degrees from a close-packed row.
    width : standard deviation of δ, in rad/t0. Good values: a tenth of Ω or less, and no less than 3/grid.
    grid : wave vectors along each side of the zone.

    Raises ValueError for a width that the frequency or the grid does not allow.
    """
    frequency, mode, green = _answer(name, wavenumber, contact, direction, width, grid)
    push = contact.masses * mode
    energy = frequency**4 * (push @ green @ push)
    by_branch = energy.imag / (2 * frequency)
    return Scattered(frequency, float(by_branch.sum()), by_branch, float(-energy.real.sum() / (2 * frequency)))


def impurity_width(
    name: str,
    wavenumber: float,
    mass_ratio: float,
    contact: Contact,
    *,
    direction: float = 90.0,
    width: float = WIDTH,
    grid: int = GRID,
) -> float:
    """Return the scattering width W, in lattice constants, of one sphere of another density.

    Parameters
    ----------
    mass_ratio : mass of the sphere over that of the others, positive.
    name, wavenumber, contact, direction, width, grid : as for `scattered`.

    Raises ValueError for a mass ratio that is not positive, and as `scattered`.
    """
    if not 0 < mass_ratio < np.inf:
        raise ValueError(f"mass_ratio = {mass_ratio!r} must be positive and finite")
    frequency, mode, green = _answer(name, wavenumber, contact, direction, width, grid)
    defect = (mass_ratio - 1) * frequency**2 * np.diag(contact.masses)
    matrix = defect @ np.linalg.inv(np.eye(3) - green.sum(axis=0) @ defect)
    lost = float((mode @ matrix @ mode).imag)
    return float(CELL * lost / (frequency * group_speed(name, wavenumber, contact, direction=direction)))


def _answer(
    name: str, wavenumber: float, contact: Contact, direction: float, width: float, grid: int
) -> tuple[float, Floats, Complexes]:
    """Return Ω and e of a wave, and the parts of G(Ω) at one site by branch, (J, 3, 3)."""
    frequency, mode = _mode(name, wavevector_of(wavenumber, direction), contact)
    _, shapes, norms = _zone(contact, grid)
    weights = (_resolvent(frequency, contact, width, grid) / norms)[..., None] * shapes
    green = np.moveaxis(weights, 0, -1) @ np.swapaxes(shapes, 0, 1) / len(shapes)
    # Products of translation and rotation cancel between k' and −k', as their signs are opposite in the gauge φ = i f
    green[:, :2, 2:] = green[:, 2:, :2] = 0.0
    return frequency, mode, green


def _mode(name: str, k: Floats, contact: Contact) -> tuple[float, Floats]:
    """Return frequency and shape (3,) with e†Me = 1, in the real gauge."""
    branch = int(branch_index(name, k, contact))
    frequencies, shapes = real_modes(k, contact)
    return float(frequencies[branch]), shapes[branch] / np.sqrt(shapes[branch] ** 2 @ contact.masses)


def _resolvent(frequency: float, contact: Contact, width: float, grid: int) -> Complexes:
    """Return 1/(Ω'² − Ω² − i0) of the modes of the zone, (K, J), with 1/(Ω' − Ω − i0) under a Gaussian.

    That is i√(π/2)/width · w((Ω − Ω')/(√2 width)), with Faddeeva's function w.
    """
    if not 3.0 / grid <= width <= frequency / 5.0:
        raise ValueError(
            f"width = {width!r} must be from 3/grid = {3.0 / grid:.3g} to a fifth of the wave's frequency, "
            f"{frequency / 5.0:.3g}: finer grids allow smaller widths"
        )
    others, _, _ = _zone(contact, grid)
    smooth = 1j * np.sqrt(np.pi / 2) / width * wofz((frequency - others) / (np.sqrt(2) * width))
    return np.asarray(smooth / (others + frequency))


@lru_cache(maxsize=2)
def _zone(contact: Contact, grid: int) -> tuple[Floats, Floats, Floats]:
    """Return frequencies (K, J), shapes (K, J, 3) and norms e†Me (K, J) over half the zone; −k gives the same as k.

    The grid is shifted by half a step, to avoid k = 0 and mirror lines.
    """
    steps = (np.indices((grid, grid // 2)).reshape(2, -1).T + 0.5) / grid
    blocks = np.array_split(steps @ RECIPROCAL, -(-len(steps) // BLOCK))
    found = [real_modes(block, contact) for block in blocks]
    frequencies, shapes = (np.concatenate(each) for each in zip(*found, strict=True))
    return frequencies, shapes, shapes**2 @ contact.masses


def long_wave(name: str, wavenumber: float, contact: Contact) -> float:
    """Return Γ/σ² of a long L or TR wave, A Ω³ (1/c_L² + 1/c_T²)/16 with Ω = c q; ξ and units as for `scattered`.

    Raises ValueError for RT, whose frequency stays finite.
    """
    speeds = {"L": sound_speed("L", contact), "TR": sound_speed("TR", contact)}
    if name not in speeds:
        raise ValueError(f"name = {name!r}: must be L or TR; other waves have no long-wave limit of frequency 0")
    frequency = speeds[name] * 2 / np.sqrt(3) * wavenumber
    return float(CELL * frequency**3 * sum(speed**-2 for speed in speeds.values()) / 16)


def group_speed(name: str, wavenumber: float, contact: Contact, *, direction: float = 90.0) -> float:
    """Return |dΩ/dk| along k, in lattice constants per t0; arguments as for `scattered`."""
    k, step = wavevector_of(wavenumber, direction), 1e-4 * wavevector_of(1.0, direction)
    above, below = (_mode(name, each, contact)[0] for each in (k + step, k - step))
    return abs(above - below) / float(2 * np.hypot(*step))


def sound_speed(name: str, contact: Contact) -> float:
    """Return Ω/|k| of a long L or TR wave, in lattice constants per t0, equal for all directions."""
    k = wavevector_of(1e-3, 90.0)  # dispersion lowers the speed by 1e-7 here
    frequencies, _ = real_modes(k, contact)
    return float(frequencies[int(branch_index(name, k, contact))] / np.hypot(*k))
