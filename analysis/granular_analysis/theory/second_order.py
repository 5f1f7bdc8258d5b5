"""Second order of one or several waves in any periodic crystal: forced and free waves, and the signal from t = 0.

The contacts of the crystal (`granular_analysis.theory.crystal`) have forces to second order
(`granular_analysis.theory.bonds`). Real waves Re[A U e^{i(k·r − ωt)}] generate a second-order field at every sum and
difference (K, Ω) of two waves, including each wave with itself:

    M X″ = −D(K) X + F e^{−iΩt} + F₀ + F_w ∫₀ᵗ e^{−iΩs} ds,       X = X′ = 0 at t = 0

F is the force that runs with the product of the two waves, and F₀ the static force that the start leaves in the
contacts. F_w is the force that winds up where the waves are out of phase in a contact whose slip has a history. The
solution consists of

* the forced wave X e^{−iΩt}, X = [D(K) − Ω²M]⁻¹F: second harmonic, static, sum and difference fields;
* the free waves of the modes at K, which the start launches because X must vanish at t = 0 (`free_waves`);
* their sum, the signal: mode j of D(K) responds with Z_j(t) = ∫₀ᵗ sin(ω_j(t−s))/ω_j e^{−iΩs} ds, regular on resonance.

**Rigid motions** at K = 0 are driven by no contact and stay 0. **Degenerate branches** need no care in the response,
which is a sum over all modes; for an incident wave, `wave` takes the polarisation.

All quantities are in the units of the crystal. Amplitudes multiply modes whose Σ|U|² is the number of spheres per cell.

When it breaks: if contacts open or slide; once the second order is no longer small, as after a long time on a resonance
or where slip winds up (`Mixed.creep`). Third order is left out, so frequencies do not shift.
`granular_analysis.theory.validity` estimates these limits.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bonds import Quadratic, Strain
from granular_analysis.theory.crystal import Crystal, Modes, padded
from granular_analysis.theory.errors import TheoryError

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_DEGENERATE = 1e-9  # frequencies that differ by less than this share of the highest are degenerate
RIGID = 1e-7  # frequencies below this share of the highest are 0
_STILL = 1e-5  # rad: a phase below this is 0, with an error of 1e-10
_NOTHING = 1e-13  # shares of a start below this are rounding
_IN_PHASE = 1e-12  # a force that winds up is rounding if below this share of the others


class Wave(NamedTuple):
    """Linear waves Re[U e^{i(k·r − ωt)}]: k (..., 3), ω (...), and U (..., B, 6) with its amplitude and phase."""

    wavevector: Floats
    frequency: Floats
    shape: Complexes

    def times(self, amplitude: ArrayLike) -> "Wave":
        """Return the wave multiplied by an amplitude (...), complex for a phase."""
        return self._replace(shape=self.shape * np.asarray(amplitude)[..., None, None])

    @property
    def reversed(self) -> "Wave":
        """Return the same real wave, written with −k and −ω, to form the difference of two waves."""
        return Wave(-self.wavevector, -self.frequency, self.shape.conj())


def together(waves: Sequence[Wave]) -> Wave:
    """Return single waves stacked along a first axis."""
    return Wave(*map(np.stack, zip(*waves, strict=True)))


def branch_of(crystal: Crystal, wavevector: ArrayLike, branch: ArrayLike) -> Wave:
    """Return the wave of a branch at wave vectors (..., 2 or 3); an arbitrary mixture if branches are degenerate.

    Raises ValueError for a branch that does not exist.
    """
    return chosen(crystal.modes(wavevector), wavevector, branch)


def chosen(modes: Modes, wavevector: ArrayLike, branch: ArrayLike) -> Wave:
    """Return the wave of a branch from the modes at wave vectors (..., 2 or 3); see `branch_of`."""
    k = padded(wavevector)
    count, index = modes.frequencies.shape[-1], np.asarray(branch)
    if not set(index.ravel().tolist()) <= set(range(count)):
        raise TheoryError(f"branch is {branch!r}; allowed: {', '.join(map(str, range(count)))} in ascending frequency")
    if not index.ndim:
        return Wave(k, modes.frequencies[..., index], modes.shapes[..., index, :, :])
    index = np.broadcast_to(index, k.shape[:-1])
    frequency = np.take_along_axis(modes.frequencies, index[..., None], axis=-1)[..., 0]
    return Wave(k, frequency, np.take_along_axis(modes.shapes, index[..., None, None, None], axis=-3)[..., 0, :, :])


def wave(crystal: Crystal, wavevector: ArrayLike, branch: ArrayLike, *, along: ArrayLike | None = None) -> Wave:
    """Return the wave of a branch (0, 1, … by frequency) at wave vectors (..., 2 or 3), of amplitude 1.

    Parameters
    ----------
    along : (6,) or (B, 6) polarisation (u, φ): the wave is the part of it that lies in the branches of this frequency

    Raises
    ------
    ValueError
        For a branch that does not exist, for a branch that has the frequency and parity of another if `along` is
        missing, and for an `along` without a share in the branch.
    """
    modes = crystal.modes(wavevector)
    plain = chosen(modes, wavevector, branch)
    same = np.abs(modes.frequencies - plain.frequency[..., None]) < _DEGENERATE * crystal.highest
    if along is None:
        alike = crystal.parity(modes.shapes, padded(wavevector)) == crystal.parity(plain.shape, wavevector)[..., None]
        if np.any((same & alike).sum(axis=-1) > 1):
            raise TheoryError(f"branch {branch!r} has the frequency of another branch: give `along`, the polarisation")
        return plain
    wanted = np.broadcast_to(np.asarray(along, dtype=complex), (len(crystal), 6))
    shares = np.where(same, np.sum(modes.duals * wanted, axis=(-2, -1)), 0.0)
    shape = np.einsum("...j,...jbc->...bc", shares, modes.shapes)
    norm = np.sqrt(np.sum(np.abs(shape) ** 2, axis=(-2, -1)) / len(crystal))
    if not np.all(norm > RIGID * np.linalg.norm(wanted)):
        raise TheoryError(f"along = {along!r} has no share in branch {branch!r}")
    return plain._replace(shape=shape / norm[..., None, None])


def started(crystal: Crystal, wavevector: ArrayLike, displacement: Complexes, velocity: Complexes) -> tuple[Wave, ...]:
    """Return the waves of a field that starts as Re[U e^{ik·r}] with the velocity Re[V e^{ik·r}], (B, 6) each.

    Every branch has one wave that runs along k and one against it, with the amplitudes ½(c ± i ċ/ω), where c and ċ are
    the shares of the branch in U and V. Waves of amplitude 0 are left out.

    Raises ValueError if the start gives a velocity to a rigid motion, which cannot be a wave.
    """
    k = padded(wavevector)
    modes = crystal.modes(k)
    place, rate = (np.sum(modes.duals * each, axis=(-2, -1)) for each in (displacement, velocity))
    least = _NOTHING * max(float(np.abs(place).max()), float(np.abs(rate).max()) / crystal.highest)
    waves = []
    for j, frequency in enumerate(modes.frequencies):
        if frequency < RIGID * crystal.highest:
            if abs(rate[j]) > least * crystal.highest:
                raise TheoryError(f"branch {j} at wave vector {k} has frequency 0, but the start gives it a velocity")
            parts = [(0.0, place[j])]
        else:
            turned = 1j * rate[j] / frequency
            parts = [(frequency, (place[j] + turned) / 2), (-frequency, (place[j] - turned) / 2)]
        waves += [Wave(k, np.asarray(w), share * modes.shapes[j]) for w, share in parts if abs(share) > least]
    return tuple(waves)


@dataclass(frozen=True, eq=False)
class Answer:
    """Steady response of a crystal to forces F e^{i(K·r − Ωt)} on its spheres.

    Attributes
    ----------
    crystal : the crystal.
    targets : modes at K (..., 3).
    frequency : Ω (...), of either sign.
    force : F (..., B, 6).
    """

    crystal: Crystal
    targets: Modes
    frequency: Floats
    force: Complexes

    def share(self, force: Complexes) -> Complexes:
        """Return the share (..., J) of each mode at K in a force (..., B, 6), as an acceleration."""
        return np.sum(self.targets.duals * self.crystal.accelerations(force)[..., None, :, :], axis=(-2, -1))

    def forced(self) -> Complexes:
        """Return X (..., B, 6) of the wave Re X e^{i(K·r − Ωt)}; infinite exactly on resonance."""
        return self.answer(self.share(self.force))

    def answer(self, shares: Complexes) -> Complexes:
        """Return X (..., B, 6) for running shares (..., J); rigid motions, which no contact drives, are left out."""
        natural, forcing = self.targets.frequencies, self.frequency[..., None]
        least = RIGID * self.crystal.highest
        rigid = (natural < least) & (np.abs(forcing) < least)
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = np.where(rigid, 0.0, 1 / ((natural - forcing) * (natural + forcing)))
            return np.einsum("...j,...jbc->...bc", shares * gain, self.targets.shapes)

    def growth_rates(self) -> Floats:
        """Return the rate |dual_j·M⁻¹F|/2ω_j at which mode j at K grows on resonance, (..., J); nan at ω_j = 0."""
        return self.rates(self.share(self.force))

    def rates(self, shares: Complexes) -> Floats:
        """Return the growth rates (..., J) |share|/2ω_j on resonance; nan at ω_j = 0."""
        natural = self.targets.frequencies
        runs = natural > RIGID * self.crystal.highest
        return np.divide(np.abs(shares), 2 * natural, out=np.full(shares.shape, np.nan), where=runs)


@dataclass(frozen=True, eq=False)
class Mixed:
    """Two waves, and the field at the sum of their wave vectors; with the second wave reversed, at the difference.

    Amplitudes X belong to the field Re[X e^{iK·r}] of two different waves, in which each product occurs twice. In a
    wave with itself each product occurs once, so one wave makes ½ of ``Mixed(crystal, wave, wave)``. Waves of shape
    (...) are pairs side by side.
    """

    crystal: Crystal
    first: Wave
    second: Wave

    @cached_property
    def wavevector(self) -> Floats:
        """Return K (..., 3)."""
        return self.first.wavevector + self.second.wavevector

    @cached_property
    def frequency(self) -> Floats:
        """Return Ω (...), of either sign."""
        return np.asarray(self.first.frequency + self.second.frequency)

    @cached_property
    def _running(self) -> Answer:
        return Answer(self.crystal, self.targets, self.frequency, self.forces.running)

    @cached_property
    def targets(self) -> Modes:
        """Return the modes at K."""
        return self.crystal.modes(self.wavevector)

    @cached_property
    def strains(self) -> tuple[Strain, Strain]:
        """Return the deformation of the contacts in both waves."""
        first = self.crystal.bonds.strain(self.first.shape, self.first.wavevector)
        if self.second is self.first:
            return first, first
        return first, self.crystal.bonds.strain(self.second.shape, self.second.wavevector)

    @cached_property
    def _ends(self) -> Quadratic:
        """Return F, F₀ and F_w (..., C, 2, 6) at the ends of the contacts."""
        return self.crystal.bonds.quadratic(*self.strains, (self.first.frequency, self.second.frequency))

    @cached_property
    def forces(self) -> Quadratic:
        """Return F, F₀ and F_w (..., B, 6) on the spheres."""
        ends = np.stack(np.broadcast_arrays(*self._ends))
        return Quadratic(*self.crystal.bonds.gather(ends, self.wavevector, len(self.crystal)))

    @cached_property
    def shares(self) -> Quadratic:
        """Return the shares (..., J) of each mode at K in F, F₀ and F_w, as accelerations."""
        return Quadratic(*self._running.share(np.stack(self.forces)))

    @cached_property
    def winds(self) -> NDArray[np.bool_]:
        """True (...) where contacts accumulate slip in proportion to time, so that no steady field exists."""
        size = sum(np.abs(each).max(axis=(-3, -2, -1)) for each in self._ends[:2])  # forces on a sphere may cancel
        wound = np.abs(self.forces.winding).max(axis=(-2, -1))
        still = np.abs(self.frequency) < RIGID * self.crystal.highest
        return still & (wound > _IN_PHASE * self.crystal.highest * size)

    @property
    def creep(self) -> Complexes:
        """Return the velocity (..., B, 6) at which spheres creep as slip winds up; 0 elsewhere."""
        return self._running.answer(np.where(self.winds[..., None], self.shares.winding, 0.0))

    @cached_property
    def steady(self) -> Complexes:
        """Return the share (..., J) of each mode in all forces e^{−iΩt}, as an acceleration.

        Raises ValueError if slip winds up.
        """
        if np.any(self.winds):
            raise TheoryError("slip winds up: two waves of one frequency are out of phase in a contact; use `signal`")
        running, _, winding = self.shares
        still = np.abs(self.frequency)[..., None] < RIGID * self.crystal.highest
        return running + np.where(still, 0.0, 1j * winding / np.where(still, 1.0, self.frequency[..., None]))

    def forced(self) -> Complexes:
        """Return X (..., B, 6) of the wave Re X e^{i(K·r − Ωt)} that runs with the two, without fields from the start.

        It is infinite exactly on resonance. Raises ValueError if slip winds up.
        """
        return self._running.answer(self.steady)

    def static(self) -> Complexes:
        """Return X (..., B, 6) of the static field at Ω = 0 about which released spheres move: from F and F₀."""
        return self._running.answer(self.shares.running + self.shares.left)

    def free_waves(self) -> tuple[Complexes, Complexes]:
        """Return the amplitudes (..., J) of the modes at K that the start launches: e^{−iω_j t} and e^{+iω_j t}.

        They cancel the forced wave and the static field at t = 0. On resonance they are infinite and only the sum is
        finite.
        """
        natural, forcing = self.targets.frequencies, self.frequency[..., None]
        running, left, winding = self.shares
        wound = np.divide(1j * winding, forcing, out=np.zeros_like(winding), where=forcing != 0)
        moving, still = running + wound, left - wound
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = moving / ((natural - forcing) * (natural + forcing))
            forward, backward = (gain * (1 + sign * forcing / natural) + still / natural**2 for sign in (1, -1))
        return -0.5 * forward, -0.5 * backward

    def signal(self, time: ArrayLike) -> Complexes:
        """Return X(t) (..., B, 6) of the field Re[X e^{iK·r}], in a crystal at rest at K at t = 0.

        time : (...), broadcast against the pairs: pairs (P, 1) at times (T,) give (P, T, B, 6).
        """
        t = np.asarray(time, dtype=float)[..., None]
        natural, forcing = self.targets.frequencies, self.frequency[..., None]
        running, left, winding = self.shares
        answer = running * duhamel(natural, forcing, t) + left * duhamel(natural, 0.0, t)
        if np.any(np.abs(winding) > _IN_PHASE * self.crystal.highest * (np.abs(running) + np.abs(left))):
            answer = answer + winding * wound_up(natural, forcing, t)
        return np.einsum("...j,...jbc->...bc", answer, self.targets.shapes)

    def growth_rates(self) -> Floats:
        """Return the rate |dual_j·M⁻¹F|/2ω_j at which mode j at K grows on resonance, (..., J); nan at ω_j = 0.

        Off resonance the mode beats, with an amplitude of at most 2·rate/|detuning|. Two waves of amplitude a would
        generate a third wave of amplitude a in the time 1/(rate·a); the estimate fails earlier, because the two lose
        that energy. Raises ValueError if slip winds up.
        """
        return self._running.rates(self.steady)

    @property
    def detunings(self) -> Floats:
        """Return |Ω| − ω_j for each mode at K, (..., J); 0 where the two waves are phase-matched with the mode."""
        return np.abs(self.frequency)[..., None] - self.targets.frequencies


def second_order(
    crystal: Crystal, waves: Sequence[Wave], time: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)
) -> tuple[Floats, Floats]:
    """Return the first and second order of all waves together, real fields (..., T, B, 6), in cells at translations.

    Parameters
    ----------
    crystal : the crystal
    waves : single waves with their amplitudes; the crystal starts with their sum, without any second-order field
    time : (T,), in the unit of the crystal
    translation : (..., 2 or 3) lattice vectors of the cells
    """
    t, place = np.asarray(time, dtype=float), crystal.position + padded(translation)[..., None, :]
    first = np.zeros((*place.shape[:-2], len(t), len(crystal), 6))
    second = np.zeros_like(first)
    for each in waves:
        motion = np.multiply.outer(np.exp(-1j * each.frequency * t), each.shape)
        first += np.real(motion * np.exp(1j * place @ each.wavevector)[..., None, :, None])
    for i, j in combinations_with_replacement(range(len(waves)), 2):
        mixed = Mixed(crystal, waves[i], together([waves[j], waves[j].reversed]))
        for wavevector, field in zip(mixed.wavevector, np.moveaxis(mixed.signal(t[:, None]), 1, 0), strict=True):
            moved = field * np.exp(1j * place @ wavevector)[..., None, :, None]
            second += np.real(moved) * (0.5 if i == j else 1.0)
    return first, second


def duhamel(natural: ArrayLike, forcing: ArrayLike, time: ArrayLike) -> Complexes:
    """Return Z = ∫₀ᵗ sin(w(t−s))/w e^{−iωs} ds for w = natural, ω = forcing, regular at ω = ±w and for w → 0.

    Z = [e^{iwt}E(−ω−w) − e^{−iwt}E(w−ω)]/(2iw),    E(x) = ∫₀ᵗ e^{ixs} ds = t e^{ixt/2} sin(xt/2)/(xt/2).
    """
    w, omega, t = np.broadcast_arrays(np.asarray(natural, dtype=float), forcing, np.asarray(time, dtype=float))

    slow = w < 1e-3 * np.abs(omega)  # the formula above divides by w; this one by ω² − w²
    rate = np.where(slow, 1.0, np.where(w > 0, w, 1.0))
    usual = (np.exp(1j * w * t) * _window(-omega - w, t) - np.exp(-1j * w * t) * _window(w - omega, t)) / (2j * rate)
    gap = np.where(slow, w**2 - omega**2, 1.0)
    far = (np.exp(-1j * omega * t) - np.cos(w * t) + 1j * omega * t * np.sinc(w * t / np.pi)) / gap
    still = 0.5 * t**2 * np.sinc(w * t / (2.0 * np.pi)) ** 2
    return np.where(omega == 0.0, still, np.where(slow, far, usual))


def wound_up(natural: ArrayLike, forcing: ArrayLike, time: ArrayLike) -> Complexes:
    """Return ∫₀ᵗ Z(s) ds, the response to a force ∫₀ᵗ e^{−iωs} ds, regular everywhere; Z is that of `duhamel`.

    It is i[Z(ω) − Z(0)]/ω for |ω| > w, and [2E₀ − E₊ − E₋]/2w² otherwise, where E₀ and E± are the integrals of
    e^{−iωs} and of e^{±iw(t−s)} e^{−iωs}; it is t³/6 if ω = w = 0.
    """
    w, omega, t = np.broadcast_arrays(np.asarray(natural, dtype=float), forcing, np.asarray(time, dtype=float))
    fast, still = np.abs(omega) > w, np.maximum(w, np.abs(omega)) * t < _STILL
    runs = fast & ~still
    above = 1j * (duhamel(w, omega, t) - duhamel(w, 0.0, t)) / np.where(runs, omega, 1.0)
    windows = (np.exp(1j * rate * t) * _window(-omega - rate, t) for rate in (0.0, w, -w))
    middle, onward, backward = windows
    below = (2 * middle - onward - backward) / (2 * np.where(still | runs, 1.0, w) ** 2)
    return np.where(still, t**3 / 6, np.where(runs, above, below))


def _window(rate: Floats, time: Floats) -> Complexes:
    """Return ∫₀ᵗ e^{ixs} ds."""
    return np.asarray(time * np.exp(0.5j * rate * time) * np.sinc(rate * time / (2.0 * np.pi)))
