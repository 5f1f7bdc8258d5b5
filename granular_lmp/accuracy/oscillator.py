"""Second harmonic as one oscillator, exact and as stepped by velocity Verlet.

At the wave number 2ξ the lattice is an oscillator of frequency w, at rest at τ = 0 and driven by the square of a wave
of frequency Ω:

    S'' + w²S = Im f²,    f = e^{−i phase}(cos Ωτ + i sin Ωτ),    S(0) = S'(0) = 0

With steps of h a wave has the frequency Ω_h, (2/h) sin(Ω_h h/2) = Ω, and the oscillator w_h. A wave that starts with
the exact velocity includes a part that runs back, f = e^{−i phase}(cos Ω_hτ + ir sin Ω_hτ) with r = Ωh/sin(Ω_h h), and
S_{n+1} − 2S_n + S_{n−1} = h²(Im f_n² − w²S_n).

The incremental shear law has another error. LAMMPS sums the force with the stiffness k at the end of a step, half a
step late: Σ k_{n+1} Δs = ∫ k ds + (h/2) ∫ k̇ ṡ dτ. In a contact with the stretch N cos ψ and the shear T cos ψ, ψ = ϑ −
Ωτ, the last term is

    (h/2) k'NT Ω² ∫ sin²ψ dτ = (Ωh/8) k'NT (sin 2ψ − sin 2ϑ) + a force that grows alike in all contacts and moves none

compared with a second-order force of ¼ k'NT cos 2ψ: the shear part of the drive has a relative error Ωh/2, in
quadrature.
"""

from math import asin, cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.modes import bloch_mode, contact_stretches
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.rest.linear import mode_of, physics_of, unit_contacts
from granular_lmp.rest.scene import Scene

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Oscillator:
    """Oscillator driven by a wave.

    Attributes
    ----------
    wave, free : float
        Ω and w, in rad/t0.
    phase : float
        Phase of the wave, rad.
    step : float
        Time step h in τ; 0 for continuous time.
    """

    wave: float
    free: float
    phase: float
    step: float = 0.0

    @cached_property
    def stepped(self) -> tuple[float, float]:
        """Ω_h and w_h of the module."""
        half = self.step / 2
        return (asin(self.wave * half) / half, asin(self.free * half) / half) if half else (self.wave, self.free)

    @property
    def detuning(self) -> float:
        """w² − 4Ω² for continuous time: the drive over the amplitude of the forced wave."""
        return (self.free - 2 * self.wave) * (self.free + 2 * self.wave)

    def response(self, tau: Floats) -> Floats:
        """Return S at the times τ, (T,); regular at w = 2Ω."""
        own = self.stepped[0]
        start = self.wave * self.step / sin(own * self.step) if self.step else 1.0
        along, against, still = ((1 + start) / 2) ** 2, ((1 - start) / 2) ** 2, (1 - start**2) / 2
        forward = self._to(2 * own, tau)
        return (self._turned * (along * forward + against * forward.conj() + still * self._to(0.0, tau))).imag

    def shapes(self, tau: Floats) -> Floats:
        """Return the functions that make up p, (T, 1), or (T, 2) for a wave that starts with a phase.

        They are `response`, and the response to a static force that a start with sheared contacts leaves; by symmetry
        it is 0 at phase 0.
        """
        return np.column_stack([self.response(tau), *([self._to(0.0, tau).real] if self.phase else [])])

    def quadrature(self, tau: Floats) -> Floats:
        """Return the response to cos 2(Ωτ − phase) − cos 2phase at the times, (T,), τ."""
        return (self._turned * (self._to(2 * self.stepped[0], tau) - self._to(0.0, tau))).real

    @property
    def _turned(self) -> complex:
        return complex(np.exp(-2j * self.phase))

    def _to(self, drive: float, tau: Floats) -> Complex:
        """Return the response to e^{iντ} for ν ≥ 0, regular at ν = w_h; `drive` is ν.

        It is [e^{iντ} − cos w_hτ − i (sin νh/sin w_h h) sin w_hτ]/(w² − (4/h²) sin²(νh/2)), with d = w_h − ν taken out
        of numerator and denominator.
        """
        h, free = self.step, self.stepped[1]
        total, apart = free + drive, free - drive
        beat = tau * np.exp(0.5j * total * tau) * _sinc(apart * tau / 2) / _sinc(apart * h / 4)
        own = cos(total * h / 2) * cos(apart * h / 4) * np.sin(free * tau) / (free * _sinc(free * h))
        return 1j * (own - beat) / (cos(total * h / 4) * (self.free + drive * _sinc(drive * h / 2)))


def _sinc(angle: Any) -> Any:
    """Return sin(x)/x of a number or of each of (T,)."""
    if isinstance(angle, float):  # a call of NumPy takes ten times as long
        return sin(angle) / angle if angle else 1.0
    return np.sinc(angle / np.pi)


def oscillator_of(scene: Scene, step: float = 0.0) -> Oscillator:
    """Return the second harmonic of a running plane wave along y in a scene, with a step (τ) or none."""
    free = bloch_mode(unit_contacts(scene), scene.sphere, scene.vector.doubled, "L", physics_of(scene))
    return Oscillator(mode_of(scene).frequency, free.frequency, scene.require_wave().phase, step)


def late_shear(scene: Scene, oscillator: Oscillator, tau: Floats) -> Floats:
    """Return the change of p by shear forces that are half a step late, (T,), in D0."""
    sphere, lattice, mode = scene.sphere, unit_contacts(scene), mode_of(scene)
    if not physics_of(scene).shear:
        return np.zeros_like(tau)
    advance = lattice.vector[:, 1] / sphere.lattice_constant * mode.vector.components[1]
    stretched, sheared = contact_stretches(lattice, sphere, mode)
    sideways = 2 * np.sin(advance / 2) * (lattice.tangents[:, 0, :2] @ np.array([mode.ux, mode.uy]))
    late = sideways * scene.displacement_amplitude / lattice.length
    if scene.effects.shear_law == "incremental":
        _, softening = sphere.contact_law.softening(sphere.static_overlap)
        late = late + softening * scene.amplitude * sheared
    # On a sphere act the contact ahead and that behind, χ/2 away in phase: sin(2ψ + χ) − sin(2ψ − χ)
    force = sphere.shear_stiffness * late * stretched * 2 * np.sin(advance)
    drive = float(force @ lattice.tangents[:, 0, 1]) * sphere.time_scale**2 / sphere.mass
    return mode.frequency * oscillator.step / 8 * drive * oscillator.quadrature(tau)
