"""Plane wave in the crystal of the paper, for every theory in this folder: a mode, an amplitude, a contact.

`Wave.doubled` passes the wave to the theory of general crystals (`granular_analysis.theory.second_order`). Results are
in the variables of the paper, for any direction and contact: p along k, q along ẑ × k, φ = Rθ, in units of D0. The
second harmonic is Re[X e^{2iϑ}] plus the free waves that the start launches. It is longitudinal if a mirror plane
contains k; along y, X = (ε/2)P̃1 is imaginary (`granular_analysis.second_harmonic` has the closed form).

When it breaks: if contacts open, or after a long time on a resonance. Dashpots are left out.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.second_harmonic import ALONG_Y, Mode, ModeName
from granular_analysis.theory import bloch, second_order
from granular_analysis.theory.bloch import branch_among, branch_index, frame, hexagonal, in_plane, wavevector_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.crystal import Crystal, padded
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.phase_matching import matches
from granular_analysis.theory.second_order import Mixed
from granular_analysis.theory.third_order import Shift
from granular_analysis.theory.third_order import shift as shift_of

__all__ = ["antiresonance", "generated", "resonance"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
# Largest residual force of a mode, over the norm of the stiffness at the wave vector. Rounding leaves 1e-15; another ν,
# inertia or geometry leaves a residual as large as the difference.
RESIDUAL = 1e-9
COUNT = 64  # wave numbers of the line on which a resonance is sought


@dataclass(frozen=True)
class Wave:
    """A plane wave at τ = 0: u = Re U exp(i(k·r + phase)), moving as the linear mode does.

    Attributes
    ----------
    mode : result of `second_harmonic.mode` or `bloch.mode`; it contains the wave vector.
    amplitude : a = D0/Δ0.
    contact : contact of the lattice.
    phase : rad, at row 0.
    others : further traits of the run that a theory must include, in the words of
        `granular_analysis.theory.catalogue`.

    Raises
    ------
    ValueError
        For a mode that does not belong to the lattice of the contact: for another ν, inertia, geometry or compression,
        or with a rotation if the spheres do not turn. The limit is 1e-9 of the stiffness, so the check is less strict
        for long waves.
    """

    mode: Mode
    amplitude: float
    contact: Contact
    phase: float = 0.0
    others: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        left = residual(self.mode, self.contact)
        if not left < RESIDUAL:
            raise TheoryError(
                f"mode {self.mode.name} at wavenumber = {self.mode.wavenumber} is no wave of this contact: it leaves "
                f"{left:.1e} of the forces, allowed: {RESIDUAL:.0e}; make the mode with the constants of the contact"
            )

    @classmethod
    def of_mode(
        cls,
        name: ModeName,
        wavenumber: float,
        amplitude: float,
        contact: Contact,
        phase: float = 0.0,
        direction: float = ALONG_Y,
    ) -> Self:
        """Return the wave of a named mode at ξ = wavenumber, in rad per row for a wave along y.

        direction is that of k, in degrees from a close-packed row; 90 is y. Raises what `bloch.mode` raises.
        """
        return cls(bloch.mode(name, wavenumber, direction, contact), amplitude, contact, phase)

    @property
    def crystal(self) -> Crystal:
        """Return the crystal of the contact."""
        return hexagonal(self.contact)

    @cached_property
    def linear(self) -> second_order.Wave:
        """Return the wave in the crystal with amplitude 1 and phase 0."""
        mode = self.mode
        shape = np.zeros((1, 6), dtype=complex)
        shape[0, [0, 1, 5]] = [*(np.array([mode.p, mode.q]) @ frame(mode.direction)), 1j * mode.f]
        k = padded(wavevector_of(mode.wavenumber, mode.direction))
        return second_order.Wave(k, np.asarray(mode.frequency), shape)

    @cached_property
    def doubled(self) -> Mixed:
        """Return the product of the wave with itself; the second harmonic in Δ0 is ½a² e^{2i phase} times its field."""
        return Mixed(self.crystal, self.linear, self.linear)

    def framed(self, field: NDArray[Any]) -> NDArray[Any]:
        """Return p, q, φ (..., 3) of a field (..., 1, 6)."""
        u = in_plane(field)
        return np.concatenate([u[..., :2] @ frame(self.mode.direction).T, u[..., 2:]], axis=-1)

    @property
    def longitudinal(self) -> int:
        """Return the longitudinal branch at 2k, which the second harmonic is if a mirror plane contains k."""
        return int(_longitudinal(self.doubled))

    @property
    def free_frequency(self) -> float:
        """Return the frequency w̃ of the longitudinal waves at 2k, rad per τ."""
        return float(self.doubled.targets.frequencies[self.longitudinal])


def residual(mode: Mode, contact: Contact) -> float:
    """Return |D W − Ω² M W|/|D| for a mode W = (u, v, f); 0 for a mode of the contact's lattice.

    If the spheres do not turn, f is added in quadrature.
    """
    crystal = hexagonal(contact)
    shape = np.array([*(np.array([mode.p, mode.q]) @ frame(mode.direction)), 1j * mode.f])[: len(crystal.freedoms)]
    matrix = crystal.stiffness(wavevector_of(mode.wavenumber, mode.direction))
    left = matrix @ shape - mode.frequency**2 * crystal.moving(crystal.mass) * shape
    forces = float(np.linalg.norm(left) / np.linalg.norm(matrix))
    return forces if contact.turns else float(np.hypot(forces, mode.f))


def nonlinearity(contact: Contact, amplitude: float) -> float:
    """Return ε = √3 D0(g2+3k2)/(g1+3k1), negative: contacts soften when pulled. The paper prints 3/2 for √3."""
    law, kappa = contact.adhesion.law(contact.kappa), contact.kappa
    return -np.sqrt(3) * amplitude * float(law.shear_growth + 1.5 * law.curvature) / (kappa + 3)


def decay_rate(wave: Wave, viscosity: float) -> float:
    """Return the decay rate Γ, per τ, of a linear wave ∝ e^{−Γτ} with a dashpot of viscosity c, in m/t0, per contact.

        Γ = ½ c Σ (|x|² + |s|²)/(|u|² + Ĩ|φ|²)

    The sum runs over the three contacts per sphere, with the stretch x and the slip s of
    `granular_analysis.theory.bonds`; s is left out if contacts do not resist shear. To first order in c the wave keeps
    its shape and frequency, and loses energy at the rate 2Γ, as with LAMMPS's ``damping velocity``. For L along y,
    Γ = 4c sin²(ξ/2).

    When it breaks: if Γ is not small against the distance to the other modes; the error is of relative order Γ².
    """
    strain, _ = wave.doubled.strains
    lost = np.sum(np.abs(strain.stretch) ** 2) + wave.contact.shear * np.sum(np.abs(strain.slip) ** 2)
    mass = np.repeat([1.0, wave.contact.masses[2]], 3)
    return float(viscosity / 2 * lost / np.sum(mass * np.abs(wave.linear.shape) ** 2))


def generated(name: str, wavenumbers: ArrayLike, contact: Contact) -> Floats:
    """Return the coefficient A (...) of the generated wave p = −a A sin 2ϑ, in D0, for a named mode along y.

    A = ½ (P̃1/i) ε/a wherever the closed form includes the contact. It is infinite on resonance.

    Parameters
    ----------
    name : "L", "TR" or "RT"
    wavenumbers : ξ (...), rad per row
    contact : any; its dashpots are ignored

    Raises ValueError for another name, and for RT if spheres do not turn.
    """
    one = _named(name, wavenumbers, contact)
    return np.asarray(0.5 * Mixed(hexagonal(contact), one, one).forced()[..., 0, 1].imag)


def second_harmonic(wave: Wave, tau: ArrayLike, row: float = 0) -> tuple[Floats, Floats, Floats]:
    """Return the second order of p, q, φ, in D0, at τ (...) and k·r = ξ·row; it is 0 at τ = 0."""
    turned = np.exp(1j * (wave.phase + wave.mode.wavenumber * row))
    _, field = second_order.second_order(wave.crystal, [wave.linear.times(wave.amplitude * turned)], np.ravel(tau))
    p, q, phi = np.real(wave.framed(field)).reshape(*np.shape(tau), 3).T / wave.amplitude
    return p.T, q.T, phi.T


def trajectory(wave: Wave, tau: ArrayLike, row: float = 0) -> tuple[Floats, Floats, Floats]:
    """Return p, q, φ to second order, in D0, at τ (...) and k·r = ξ·row: the sum of the mode and `second_harmonic`."""
    mode, second = wave.mode, second_harmonic(wave, tau, row)
    theta = mode.wavenumber * row + wave.phase - mode.frequency * np.asarray(tau, dtype=float)
    first = mode.p * np.cos(theta), mode.q * np.cos(theta), -mode.f * np.sin(theta)
    p, q, phi = (one + two for one, two in zip(first, second, strict=True))
    return p, q, phi


def shift(wave: Wave) -> Shift:
    """Return the frequency shift σa² for a = 1, whatever the amplitude and phase of the wave: `Shift.total` is σ.

    Raises ValueError for the potential law and for dashpots.
    """
    wave.contact.refuse_dashpots()
    return shift_of(wave.crystal, wave.linear)


def slow_amplitude(wave: Wave, tau: ArrayLike) -> Complexes:
    """Return the amplitude A(τ) (T,) of the fundamental A e^{iϑ}, A(0) = 1; regular on resonance and at any ξ.

    When it breaks: near the resonance once |ln A| is no longer small (a = 0.2: τ ≳ 120; then take
    `granular_analysis.theory.resonance.three_mode`), and for L at small ξ once the wave steepens.
    """
    return np.asarray(np.exp(-1j * wave.amplitude**2 * shift(wave).phase(tau)))


def shifted_second_order(wave: Wave, tau: ArrayLike, row: float = 0) -> tuple[Floats, Floats, Floats]:
    """Return p, q, φ (T,) in units of D0 to second order, with the fundamental multiplied by `slow_amplitude`.

        q = Re Q A e^{iϑ},   φ = Re i f A e^{iϑ},   p = Re P A e^{iϑ} + p_SH

    p_SH is not shifted. Its generated wave in fact follows A², but its free waves are shifted too, by the fundamental
    in which they run. Shifting only one of them halves the error of p at ξ=0.802 and doubles it at ξ=1.4 (TR, a = 0.2);
    `granular_analysis.theory.resonance.three_mode` shifts both.

    When it breaks: in p as second order does. The error of q and φ is their third harmonic and free waves, of relative
    order a²: at ξ=2.127, a = 0.2, τ ≤ 120 it is 3.4e-4 of q in row 0.
    """
    mode, times = wave.mode, np.asarray(tau, dtype=float)
    phase = mode.wavenumber * row - mode.frequency * times + wave.phase
    moved = slow_amplitude(wave, times) * np.exp(1j * phase)
    p, q, phi = second_harmonic(wave, times, row)
    return mode.p * moved.real + p, mode.q * moved.real + q, -mode.f * moved.imag + phi


def resonance(contact: Contact) -> float | None:
    """Return ξ where the second harmonic of TR along y is a free L wave, 2Ω_TR(ξ) = Ω_L(2ξ); None without such a ξ."""
    return _first("resonance", contact)


def antiresonance(contact: Contact) -> float | None:
    """Return ξ where TR along y generates no second harmonic; None if there is no such ξ."""
    return _first("antiresonance", contact)


@lru_cache(maxsize=16)
def _first(kind: str, contact: Contact) -> float | None:
    """Return ξ of the first match of a kind between TR and L on the line along y; None if there is none."""
    along = wavevector_of(1.0, ALONG_Y)
    for each in matches(hexagonal(contact), along, COUNT):
        k = each.wavenumber * along / np.linalg.norm(along)
        pair = each.branch == branch_index("TR", k, contact) and each.target == branch_index("L", 2 * k, contact)
        if pair and each.kind == kind:
            return float(each.wavenumber / np.linalg.norm(along))
    return None


def _named(name: str, wavenumbers: ArrayLike, contact: Contact) -> second_order.Wave:
    """Return the waves of a named mode along y at ξ (...), with amplitude 1."""
    k = np.multiply.outer(np.asarray(wavenumbers, dtype=float), wavevector_of(1.0, ALONG_Y))
    modes = hexagonal(contact).modes(k)
    return second_order.chosen(modes, k, branch_among(name, in_plane(modes.shapes), k))


def _longitudinal(pair: Mixed) -> NDArray[np.intp]:
    """Return the index (...) of mode L at K for pairs of waves in the paper's crystal."""
    return branch_among("L", in_plane(pair.targets.shapes), pair.wavevector)
