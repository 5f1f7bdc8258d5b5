"""Second order of any wave on a periodic sheet: beams, packets, standing and crossing waves.

With y = (u, v, φ), φ = Rθ, in D0 and a = D0/Δ0, from an initial field that is all of first order,

    y = y1 + a y2,    M y1″ = −D y1,    M y2″ = −D y2 + N(y1, y1),    y2 = y2′ = 0 at the start,

    N = Σ_l [n A_N + t A_T + A_M]/(2(κ+3))        (all six contacts)
    A_N = −¼ δN² + h(½ δT² − κ δT δS),    A_T = S₂ + h δT δN,    A_M = S₂ + hκ δN δS
    S₂ = −κ{½ δN δS + h[(δT δN)₀ + ∫₀^τ δT dδN]}

the second-order forces along normal and tangent and the torque of `analysis.theory.bonds`, h = η/(1−η); at h = 0 they
are the paper's springN and springS. The bracket is what the slip has gathered, by its history and not by where it is.
Each wave vector that the sheet holds has three modes there, which to first order oscillate by themselves. N is taken on
the spheres, where it is a product, and what a mode has of it, F, is answered by the mode:

    y2 = S(τ) ∫₀^τ C(s) F(s) ds − C(τ) ∫₀^τ S(s) F(s) ds,    C = cos Ωτ,  S = sin Ωτ/Ω,

with four points of Gauss a step, of order eight. Waves of k and k′ meet in it at k + k′ and k − k′, which is all of
second order: second harmonic, static field, and what crossing or spreading waves make of each other.

With a time step Δτ, of velocity Verlet, a mode has Ω' = (2/Δτ) arcsin(ΩΔτ/2) for Ω, and S = sin Ω'τ/(Ω cos(Ω'Δτ/2)):
exact for y1, with O(Δτ²) of y2 left.

When it breaks: where contacts open, and for long on a resonance.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.second_harmonic import SOLID_SPHERE
from analysis.theory.bloch import BONDS, GAUGE, TANGENTS, real_modes, unit
from analysis.theory.contact import Contact

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(4)  # Gauss's rule on [−1, 1]
# ∫ from −1 to each point of the polynomial that is 1 there and 0 at the others: (to, of)
_POWERS = np.arange(4)
UP_TO = (
    (POINTS[:, None] ** (_POWERS + 1) - (-1.0) ** (_POWERS + 1))
    / (_POWERS + 1)
    @ np.linalg.inv(POINTS[:, None] ** _POWERS)
)
STEP = 0.5  # τ. It leaves 6e-9 of the y2 of noise on all modes, whose frequencies add to 6.
NORMAL, TANGENT = np.concatenate([BONDS, -BONDS]), np.concatenate([TANGENTS, -TANGENTS])  # the six contacts
ROW = np.sqrt(0.75)  # spacing of rows in lattice constants
Bonds = tuple[Floats, Floats, Floats]  # δN, δT, δS of the six contacts of every sphere, (6, N) each
FieldOrWave = TypeVar("FieldOrWave", Floats, Complexes)


@dataclass(frozen=True)
class Sheet:
    """A periodic hexagonal sheet, spheres row by row as in LAMMPS's deck, rows even; lengths in lattice constants.

    overlap_ratio is η = Δ0/2R, 0 in the paper's geometry of contacts.
    """

    rows: int
    columns: int
    poisson_ratio: float
    overlap_ratio: float = 0.0

    def __post_init__(self) -> None:
        if self.rows < 2 or self.rows % 2 or self.columns < 1:
            raise ValueError(f"{self.rows} rows x {self.columns} columns: rows must be even, and there must be columns")

    @property
    def inertia(self) -> float:
        """Ĩ/(1−η) of a solid sphere: LAMMPS's torque has the arm R − Δ0/2."""
        return SOLID_SPHERE / (1 - self.overlap_ratio)

    @property
    def slenderness(self) -> float:
        """h = η/(1−η), Δ0 over the distance of centres."""
        return self.overlap_ratio / (1 - self.overlap_ratio)

    @cached_property
    def _index(self) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.int_]]:
        """Row and column of each sphere, and whether its row is shifted by half a lattice constant, 1 or 0; (R, C)."""
        row, column = np.indices((self.rows, self.columns))
        return row, column, (row - (self.rows - 1) // 2) % 2

    @cached_property
    def rest(self) -> Floats:
        """Positions (N, 2) at rest; no sphere is on the border of the cell."""
        row, column, odd = self._index
        x, y = column - self.columns // 2 + 0.25 + 0.5 * odd, (row - (self.rows - 1) // 2) * ROW
        return np.stack([x, y], axis=-1).reshape(-1, 2)

    @cached_property
    def neighbours(self) -> NDArray[np.intp]:
        """Indices (6, N) of the spheres at the ends of `NORMAL`, seen from each sphere."""
        row, column, odd = self._index
        right = column + odd  # the right one of the two above, and of the two below
        ends = [(row, column + 1), (row + 1, right), (row + 1, right - 1)]
        ends += [(row, column - 1), (row - 1, right - 1), (row - 1, right)]
        return np.array([(r % self.rows * self.columns + c % self.columns).ravel() for r, c in ends])

    @cached_property
    def wavevectors(self) -> Floats:
        """(R, columns//2 + 1, 2): half of those that the sheet holds, −k being the conjugate of k; any zone."""
        y, x = np.indices((self.rows, self.columns // 2 + 1))
        return 2 * np.pi * np.stack([x / self.columns, y / (self.rows * ROW)], axis=-1)

    @cached_property
    def modes(self) -> tuple[Floats, Complexes]:
        """Frequencies (..., 3) and polarisations (..., mode, 3) of all wave vectors."""
        frequencies, shapes = real_modes(self.wavevectors, Contact(self.poisson_ratio, inertia=self.inertia))
        return frequencies, shapes * GAUGE

    @cached_property
    def _projections(self) -> Complexes:
        """U†M/(U†MU) of all modes, as `modes`."""
        shapes, mass = self.modes[1], np.array([1.0, 1.0, self.inertia])
        return shapes.conj() * mass / (np.abs(shapes) ** 2 @ mass)[..., None]

    @cached_property
    def _turn(self) -> Complexes:
        return np.exp(-0.5j * self.wavevectors[0, :, 0] * self._index[2][:, :1])[..., None]

    def shares(self, field: Floats) -> Complexes:
        """Share of each mode U in a field (..., N, 3): U†My/(U†MU), (..., R, columns//2 + 1, mode)."""
        rows = field.reshape(*field.shape[:-2], self.rows, self.columns, 3)
        waves = np.fft.fft(np.fft.rfft(rows, axis=-2) * self._turn, axis=-3)
        return np.einsum("...jc,...c->...j", self._projections, waves)

    def field(self, shares: Complexes) -> Floats:
        """The field (..., N, 3) of these shares of the modes."""
        waves = np.einsum("...j,...jc->...c", shares, self.modes[1])
        rows = np.fft.irfft(np.fft.ifft(waves, axis=-3) * self._turn.conj(), self.columns, axis=-2)
        return rows.reshape(*rows.shape[:-3], self.rows * self.columns, 3)


def elongations(sheet: Sheet, field: Floats) -> Bonds:
    """δN, δT and δS of the six contacts of every sphere, (6, N) each, in a field (N, 3)."""
    x, y, turned = np.ascontiguousarray(field.T)
    dx, dy, turning = x[sheet.neighbours] - x, y[sheet.neighbours] - y, turned[sheet.neighbours] + turned
    stretch, sideways = (each[:, :1] * dx + each[:, 1:] * dy for each in (NORMAL, TANGENT))
    return stretch, sideways, sideways - turning


def quadratic_acceleration(
    sheet: Sheet, bonds: tuple[Floats, Floats, Floats], gathered: Floats | float = 0.0
) -> Floats:
    """M⁻¹N(y, y) of every sphere, (N, 3), from the `elongations` of a field y in any unit, of which it is the square.

    gathered (6, N) is the bracket of S₂, which counts where η > 0.
    """
    kappa, h = Contact(sheet.poisson_ratio).kappa, sheet.slenderness
    stretch, sideways, slide = bonds
    slip = -kappa * (0.5 * stretch * slide + h * gathered)
    normal = -0.25 * stretch**2 + h * sideways * (0.5 * sideways - kappa * slide)
    shear = slip + h * sideways * stretch
    push = normal.T @ NORMAL + shear.T @ TANGENT
    torque = (slip + h * kappa * stretch * slide).sum(axis=0)
    return np.column_stack([push, torque / sheet.inertia]) / (2 * (kappa + 3))


def evolve(
    sheet: Sheet, field: Floats, rate: Floats, tau: ArrayLike, *, timestep: float = 0.0, step: float = STEP
) -> tuple[Floats, Floats]:
    """First and second order y1, y2 at the times tau, of the initial field at the first of them: y = y1 + a y2.

    field and rate (N, 3) are (u, v, Rθ) in D0 and its derivative by τ; tau (T,) ascends. timestep, of velocity Verlet,
    is 0 for exact frequencies; step is the largest of the quadrature. Returns two arrays (T, N, 3), in D0.

    Raises ValueError for other shapes and times, and for a timestep at which Verlet is not stable.
    """
    times, shape = np.asarray(tau, dtype=float), (sheet.rows * sheet.columns, 3)
    if {field.shape, rate.shape} != {shape} or times.ndim != 1 or not len(times) or not (np.diff(times) > 0).all():
        raise ValueError(f"field {field.shape} and rate {rate.shape} must be {shape}, tau {times.shape} must ascend")
    frequencies = sheet.modes[0]
    lag = frequencies * timestep / 2
    if lag.max() >= 1:
        raise ValueError(f"timestep = {timestep}: must be below 2/Omega_max = {2 / frequencies.max():.4g}")
    actual = 2 / timestep * np.arcsin(lag) if timestep else frequencies
    # Ω'/(Ω cos(Ω'Δτ/2)), at rest (Ω = 0) its limit
    gain = np.divide(actual, frequencies, out=np.ones_like(lag), where=frequencies > 0) / np.sqrt(1 - lag**2)

    def swing(time: float) -> tuple[Floats, Floats]:
        return np.cos(actual * time), time * np.sinc(actual * time / np.pi) * gain

    def gathering(time: float, sideways: Floats) -> Floats:
        """δT dδN/dτ of the contacts."""
        rate = gain * np.cos(actual * time) * push - actual * np.sin(actual * time) * start
        return sideways * elongations(sheet, sheet.field(rate))[0]

    start, push = sheet.shares(field), sheet.shares(rate)
    with_cosine, with_sine = 0.0 * start, 0.0 * start
    first, second = [field], [0.0 * field]
    gathered = np.prod(elongations(sheet, field)[:2], axis=0)  # δT δN
    for before, after in pairwise(times - times[0]):
        edges = np.linspace(before, after, int(np.ceil((after - before) / step - 1e-9)) + 1)
        half = (edges[1] - edges[0]) / 2
        for middle in (edges[1:] + edges[:-1]) / 2:
            swings = [swing(middle + point * half) for point in POINTS]
            bonds = [elongations(sheet, sheet.field(cosine * start + sine * push)) for cosine, sine in swings]
            so_far = np.zeros((4, 1, 1))
            if sheet.overlap_ratio:
                sideways = (bond[1] for bond in bonds)
                gained = half * np.array(
                    [gathering(middle + p * half, each) for p, each in zip(POINTS, sideways, strict=True)]
                )
                so_far = gathered + np.tensordot(UP_TO, gained, axes=1)
                gathered = gathered + np.tensordot(WEIGHTS, gained, axes=1)
            for (cosine, sine), each, known, weight in zip(swings, bonds, so_far, WEIGHTS * half, strict=True):
                force = sheet.shares(quadratic_acceleration(sheet, each, known))
                with_cosine += weight * cosine * force
                with_sine += weight * sine * force
        cosine, sine = swing(after)
        first.append(sheet.field(cosine * start + sine * push))
        second.append(sheet.field(sine * with_cosine - cosine * with_sine))
    return np.array(first), np.array(second)


def component(field: Floats, rest: Floats, wavevector: ArrayLike) -> Complexes:
    """Amplitude X of a wave vector in a field: X = (2/N) Σ field e^{−ik·r}, of a real field Re[X e^{ik·r}].

    Shapes (..., N, 3), (N, 2) in lattice constants and (2,) in their inverse give (..., 3). Other waves leak in where
    the sheet does not hold this one. Where −k is k (at k = 0, in the middle of the zone's sides) it is twice as large.
    """
    phases = np.exp(-1j * rest @ np.asarray(wavevector, dtype=float))
    return 2 / len(rest) * np.einsum("...nc,n->...c", field, phases)


def in_frame(field: FieldOrWave, wavevector: ArrayLike) -> FieldOrWave:
    """(…, 3) of u, v, φ as p along k (…, 2), q along ẑ × k, φ; k = 0 counts as along y, as in `bloch.unit`."""
    x, y = np.moveaxis(unit(wavevector), -1, 0)
    u, v, phi = np.moveaxis(field, -1, 0)
    return np.stack([x * u + y * v, x * v - y * u, phi], axis=-1)
