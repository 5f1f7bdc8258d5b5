"""A driven row: the waves that it sends into a crystal at rest, with their second harmonic over the distance.

    python -m analysis.figures.driven RUN [-o FILE]

Row 0 of a strip along y is moved by force, all its spheres alike and none of them turning (lengths in D0):

    L:       p_0 = r(τ) cos(Ωτ − phase),  q_0 = φ_0 = 0
    TR, RT:  q_0 = r(τ) cos(Ωτ − phase),  p_0 = φ_0 = 0,        Ω that of the mode at ξ

r rises once, from 0 to 1. Behind the front, in a strip without end, is a steady state: fields Re[X_n e^{−iΩτ}].

**Linear.** X_n = Σ_m X_m e^{iκ_m n} over the waves of frequency Ω that leave the row: group velocity > 0, or Im κ > 0.
L is one, e^{iξn}. Of TR and RT there are two at each frequency, since with x = Ω², C = cos κ the dispersion relation

    [2μ2(2+C) − Ĩx][μ1(1−C)/2 − x] = 3μ2²(1−C²)

is quadratic in C. One is ±ξ: −ξ where Ω falls with ξ, as on all of RT of solid spheres, whose crests run *towards*
the row. The other decays within a row or two (κ = π + 2.2i for TR of solid spheres); with Ĩ ≥ 1.5 it can run too. What
each gets follows from q_0 = 1, φ_0 = 0.

**Second order.** With dX = X_{n+1} − X_n, σ = φ_{n+1} + φ_n of the linear waves, the force of each bond at 2Ω is

    B_ab = (ε/16) [longitudinal dp_a dp_b − α dq_a dq_b + (β/√3)(σ_a dq_b + dq_a σ_b)]     for each pair of waves a, b,

and the wave it forces, K = κ_a + κ_b, starts with a free L wave k2 that cancels it at row 0, whose motion is pure:

    P_n = (1 − e^{−iK}) B_ab [e^{iKn} − e^{ik2 n}]/(speed² sin²(K/2) − 4Ω²),    speed sin(k2/2) = 2Ω

Both beat over 2π/|2κ_1 − k2| rows, and P_n grows as n where K = k2 (TR at the resonance). Above the cutoff, 2Ω > speed,
k2 = π + i·(…) stays at the row and |P_n| soon is constant. The same bonds push steadily too: see `static`.

When it breaks: where |P| or a²n is not small, the latter as the wave number shifts by an amount of order a². Measured
relative errors fall as a² down to a floor from switching on: the ramp also excites waves at the edges of the bands,
which have no group velocity and leave slowly. They are linear: the floor does not depend on a, but in the second
harmonic of L, which they meet in the same component, it rises as 1/a. Where the steady waves themselves are slow it is
high: at TR's resonance k2 runs 0.05 rows per τ, and 8 rows are within 2.5 % of their steady 2Ω only at τ = 1900.

The script fits 1, τ, and the harmonics 1 to 3 of Ω, with a Hann window, to every row over whole periods at the end of a
run of form "driven" with snapshots of all spheres, in rows that the slowest of the waves has reached before, and where
no echo of the far end is heard. It prints median deviations over those rows and draws the amplitudes over the rows.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from analysis.figures.plotting import parser, save, start
from analysis.measure.rows import AIRY, Rows, echo, load_form
from analysis.second_harmonic import Mode, Ratios, mode, nonlinearity
from analysis.theory.choice import physics_of
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

PERIODS = 5  # fewest in the window of the fit: Hann's sidelobes then keep 1, Ω and 2Ω apart
PER_PERIOD = 8  # fewest snapshots: above Nyquist's 6 of the third harmonic
FEWEST_ROWS = 3
PART = 1 / 3  # of the time after the ramp, the window


@dataclass(frozen=True)
class RowWaves:
    """The linear waves that a driven row sends out.

    Attributes
    ----------
    wavenumbers : (m,) complex
        κ, rad per row.
    shapes : (3, m) complex
        p, q, φ of each at row 0, together 1 in the driven component.
    velocities : (m,)
        Group velocity, rows per τ; 0 of a wave that decays.
    """

    wavenumbers: Complexes
    shapes: Complexes
    velocities: Floats

    @property
    def bonds(self) -> tuple[Complexes, Complexes, Complexes]:
        """dp, dq, σ of the bond from row 0 to row 1, for each wave."""
        onward = np.exp(1j * self.wavenumbers)
        p, q, phi = self.shapes
        return (onward - 1) * p, (onward - 1) * q, (onward + 1) * phi


def linear_waves(mode: Mode, ratios: Ratios) -> RowWaves:
    """The one (L; spheres that do not turn) or two waves with which a row answers at the mode's frequency.

    Raises ValueError where the mode has no group velocity, as at ξ = π: nothing leaves the row.
    """
    if mode.name == "L" or not ratios.rotation:
        component, speed = (0, ratios.speed) if mode.name == "L" else (1, np.sqrt(ratios.mu1))
        velocities = np.array([speed * np.cos(mode.wavenumber / 2) / 2])
        waves = RowWaves(np.array([mode.wavenumber + 0j]), np.eye(3, dtype=complex)[:, [component]], velocities)
    else:
        waves = _two_waves(mode, ratios)
    if waves.velocities[0] < 1e-6:
        raise ValueError(f"{mode.name} at wavenumber = {mode.wavenumber} has no group velocity: nothing leaves the row")
    return waves


def _two_waves(mode: Mode, ratios: Ratios) -> RowWaves:
    mu1, mu2, inertia, x = ratios.mu1, ratios.mu2, ratios.inertia, mode.frequency**2
    own = np.cos(mode.wavenumber)
    # The sum of the roots of the quadratic in C
    total = (2 * mu2 * (mu1 / 2 - x) - mu1 / 2 * (4 * mu2 - inertia * x)) / (mu2 * (mu1 - 3 * mu2))
    C = np.array([own, total - own])
    k = np.arccos(C + 0j)
    k = np.where(k.imag < 0, -k, k)
    A, b = mu1 * (1 - C) / 2 - x, 2 * mu2 * (2 + C) - inertia * x
    # dΩ/dκ = sin κ F_C/(2Ω F_x) of F(C, x) = bA − 3μ2²(1−C²)
    slope = (2 * mu2 * A - b * mu1 / 2 + 6 * mu2**2 * C) / (-inertia * A - b)
    velocity = np.where(np.abs(C) < 1, np.sin(k).real * slope / (2 * mode.frequency), 0.0)
    k = np.where(velocity < 0, -k, k)
    c0 = np.sqrt(3) * mu2 * np.sin(k)
    # A Q = c0 f and b f = c0 Q say the same; where one is 0 = 0, the other is not.
    choices = np.array([b + 0j, 1j * c0]), np.array([c0, 1j * A])
    shapes = np.where(*(np.linalg.norm(choices[0], axis=0) > np.linalg.norm(choices[1], axis=0), *choices))
    shares = np.linalg.solve(shapes, [1, 0])
    return RowWaves(k, np.concatenate([np.zeros((1, 2)), shapes * shares]), np.abs(velocity))


def free_wavenumber(frequency: float, ratios: Ratios) -> complex:
    """k of the L wave of a frequency, speed·sin(k/2) = Ω: in (0, π], or π + 2i·arcosh(Ω/speed) above the cutoff."""
    ratio = frequency / ratios.speed
    return complex(2 * np.arcsin(ratio)) if ratio <= 1 else complex(np.pi, 2 * np.arccosh(ratio))


def beat_length(mode: Mode, ratios: Ratios) -> float:
    """Rows over which the second harmonic rises and falls, 2π/|2κ − k2|: inf on resonance, nan above the cutoff."""
    free = free_wavenumber(2 * mode.frequency, ratios)
    if free.imag:
        return float("nan")
    mismatch = abs(2 * linear_waves(mode, ratios).wavenumbers[0].real - free.real)
    return float(2 * np.pi / mismatch) if mismatch else float("inf")


def slowest(mode: Mode, ratios: Ratios) -> float:
    """Group velocity, rows per τ, of the slowest wave that carries the steady state: fundamental, or free L at 2Ω."""
    free = free_wavenumber(2 * mode.frequency, ratios)
    velocities = linear_waves(mode, ratios).velocities
    own = [] if free.imag else [ratios.speed * np.cos(free.real / 2) / 2]
    return float(min([*velocities[velocities > 0], *own]))


def driven_amplitudes(
    mode: Mode, ratios: Ratios, amplitude: float, rows: ArrayLike, phase: float = 0.0
) -> tuple[Complexes, Complexes]:
    """Complex amplitudes over the rows of the fundamental (p, q, φ), Re[X e^{−iΩτ}], and of p at 2Ω, Re[P e^{−2iΩτ}].

    Parameters
    ----------
    mode : of `second_harmonic.mode`, made from the ratios; its frequency is that of the row.
    ratios : constants of the lattice. With the incremental shear law the result holds too (but see `static`), not with
        the potential law, whose drive is no sum of pairs in α and β.
    amplitude : a = D0/Δ0, D0 the amplitude of the row.
    rows : (N,) whole numbers n ≥ 0.
    phase : rad, of the row.

    Returns
    -------
    (3, N) in D0, and (N,) in D0

    Raises
    ------
    ValueError
        For rows that are no such numbers, and what `linear_waves` raises.

    Source: eqp to eqr of the paper with the boundary at row 0; not in the paper.
    """
    n = _counted(rows)
    waves, free = linear_waves(mode, ratios), free_wavenumber(2 * mode.frequency, ratios)
    fundamental = waves.shapes @ np.exp(1j * np.multiply.outer(waves.wavenumbers, n))
    bonds = waves.bonds
    forces = _bond_force(bonds, bonds, ratios, amplitude)
    second = np.zeros(n.shape, dtype=complex)
    for force, forced in zip(forces.ravel(), np.add.outer(waves.wavenumbers, waves.wavenumbers).ravel(), strict=True):
        # speed² sin²(K/2) − 4Ω² is −(speed²/4)(z − z2)(1 − 1/(z z2)), z = e^{iK}, z2 = e^{ik2}
        z = np.exp(1j * forced)
        second += -4 / ratios.speed**2 * force * (z - 1) / (z - np.exp(-1j * free)) * _beat(complex(forced), free, n)
    return fundamental * np.exp(1j * phase), second * np.exp(2j * phase)


def static(mode: Mode, ratios: Ratios, amplitude: float, rows: ArrayLike) -> Floats:
    """Mean displacement p (N,) in D0 that the waves leave in the rows they have reached; it grows with the distance.

        (c² dp + B)_n = B_∞ v/(c + v),    B_n = Σ_ab B_ab e^{i(κ_a − κ_b*)n},  p_0 = 0,  c = speed/2

    Bonds soften when stretched, so the wave pushes the crystal apart. The mean force in the bonds is uniform behind the
    front, but not zero: the front, which moves at v, pushes a long L wave ahead of itself, and that needs a force. B_∞
    is B of the waves that run, each with its own v. Rows as in `driven_amplitudes`. Breaks once the second harmonic has
    grown large anywhere behind the front, as on resonance: that force comes from all the way there.

    Raises ValueError for TR and RT under a shear law with memory: next to the row stretch and slip of a contact are
    not in phase, ∫x dt gains the area of their ellipse in every period, and p creeps with no steady state.
    """
    n = _counted(rows)
    if ratios.memory and mode.name != "L":
        raise ValueError(f"{mode.name} has no steady mean displacement under a shear law with memory")
    waves = linear_waves(mode, ratios)
    dp, dq, sigma = waves.bonds
    forces = _bond_force((dp, dq, sigma), (dp.conj(), dq.conj(), sigma.conj()), ratios, amplitude)
    c = ratios.speed / 2
    uniform = np.sum(np.diag(forces).real * waves.velocities / (c + waves.velocities))
    decay = np.exp(
        1j * np.multiply.outer(np.arange(np.max(n)), np.subtract.outer(waves.wavenumbers, waves.wavenumbers.conj()))
    )
    stretch = (uniform - np.sum(decay * forces, axis=(1, 2)).real) / c**2
    return np.concatenate([[0.0], np.cumsum(stretch)])[n]


def _bond_force(
    one: tuple[Complexes, Complexes, Complexes], other: tuple[Complexes, Complexes, Complexes], ratios: Ratios, a: float
) -> Complexes:
    """B_ab (m, m) of the module from dp, dq, σ of each wave; of real fields Re z, hence ε/16 for the ε/8 of eqp."""
    pair = np.multiply.outer
    longitudinal = ratios.longitudinal * pair(one[0], other[0])
    transverse = -ratios.alpha * pair(one[1], other[1])
    mixed = ratios.beta / np.sqrt(3) * (pair(one[2], other[1]) + pair(one[1], other[2]))
    return np.asarray(nonlinearity(ratios, a) / 16 * (longitudinal + transverse + mixed))


def _beat(one: complex, other: complex, n: NDArray[np.intp]) -> Complexes:
    """(e^{ikn} − e^{ik'n})/(e^{ik} − e^{ik'}) of two wave numbers: n e^{ik(n−1)} where they are equal."""
    # Out of the wave that decays least, so that no exponential overflows
    slow, fast = sorted((one, other), key=lambda k: k.imag)
    mismatch = 1j * (fast - slow)
    growth = np.expm1(mismatch * n) / np.expm1(mismatch) if mismatch else n
    return np.asarray(np.exp(1j * slow * (n - 1)) * growth)


def _counted(rows: ArrayLike) -> NDArray[np.intp]:
    n = np.asarray(rows)
    if n.ndim != 1 or n.size == 0 or not np.issubdtype(n.dtype, np.integer) or np.min(n) < 0:
        raise ValueError(f"rows = {rows!r} must be one-dimensional, whole numbers, not negative")
    return n.astype(np.intp)


def fit(tau: Floats, signals: Floats, frequency: float) -> tuple[Floats, Complexes]:
    """Mean (N,) and amplitudes (3, N) of e^{−imΩτ}, m = 1, 2, 3, of signals (T, N), by least squares, Hann-weighted.

    The window lowers what other frequencies of a wave just switched on leave in the amplitudes.
    """
    angles = frequency * np.multiply.outer(tau, [1, 2, 3])
    columns = np.column_stack([np.ones_like(tau), tau - np.mean(tau), np.cos(angles), np.sin(angles)])
    weights = np.sin(np.pi * (np.arange(len(tau)) + 0.5) / len(tau))[:, None]  # squared, they are Hann's
    factors, *_ = np.linalg.lstsq(columns * weights, signals * weights, rcond=None)
    return factors[0], factors[2:5] + 1j * factors[5:8]


@dataclass(frozen=True)
class Comparison:
    """Amplitudes of a run and of theory over the rows n (N,), by name: components of the fundamental, 2Ω, the mean."""

    linear: Mode
    ratios: Ratios
    amplitude: float
    n: NDArray[np.intp]
    run: dict[str, Complexes]
    theory: dict[str, Complexes]

    def deviations(self) -> dict[str, tuple[float, float]]:
        """Median over the rows of |X − X_theory|/|X_theory|, with phase, and of that of the moduli."""
        return {name: _medians(self.run[name], theory) for name, theory in self.theory.items()}


def _medians(run: Complexes, theory: Complexes) -> tuple[float, float]:
    whole = np.abs(run - theory) / np.abs(theory)
    moduli = np.abs(np.abs(run) / np.abs(theory) - 1)
    return float(np.median(whole)), float(np.median(moduli))


def compare(record: Record, rows: Rows) -> Comparison:
    """Fit a run and set theory beside it, in the rows and over the window of the module.

    Raises ValueError, in one line, for a run that is too short or too coarse in time for that.
    """
    scene, wave = record.scene, record.scene.wave
    constants = physics_of(record).ratios
    linear = mode(wave.mode, scene.wavenumber, constants)  # type: ignore[arg-type]  # checked by the scene
    period = 2 * np.pi / linear.frequency
    first, last = _window(rows.tau, scene.envelope.ramp, period)
    tau, velocity = rows.tau[first:], slowest(linear, constants)
    distance = np.arange(rows.count - 1)
    # Airy's front of the slowest wave, at the pace of that wave; then the echo of the held end, at the fastest
    reached = scene.envelope.ramp + (distance + AIRY * np.cbrt(distance)) / velocity < tau[0]
    n = distance[reached & (echo(2 * (rows.count - 1) - distance) > last) & (distance > 0)]
    if len(n) < FEWEST_ROWS:
        raise ValueError(
            f"too short a run or strip: {len(n)} of {FEWEST_ROWS} rows are reached by the slowest wave ({velocity:.3g} "
            f"rows per tau, ramp {scene.envelope.ramp:g}) at tau = {tau[0]:.4g} and hear no echo until {last:.4g}"
        )
    fundamental, second = driven_amplitudes(linear, constants, wave.amplitude, n, wave.phase)
    means, p = fit(tau, rows.p[first:, n], linear.frequency)
    if linear.name == "L":
        run, theory = {"p": p[0]}, {"p": fundamental[0]}
    else:
        run = {"q": fit(tau, rows.q[first:, n], linear.frequency)[1][0]}
        theory = {"q": fundamental[1]}
        if constants.rotation:
            run["phi"] = fit(tau, rows.phi[first:, n], linear.frequency)[1][0]
            theory["phi"] = fundamental[2]
    run["p at 2Ω"], theory["p at 2Ω"] = p[1], second
    if linear.name == "L" or not constants.memory:
        run["mean p"], theory["mean p"] = means + 0j, static(linear, constants, wave.amplitude, n) + 0j
    return Comparison(linear, constants, wave.amplitude, n, run, theory)


def _window(tau: Floats, ramp: float, period: float) -> tuple[int, float]:
    """First snapshot and last τ of the window: whole periods, the last part of the run."""
    spacing = float(np.max(np.diff(tau))) if len(tau) > 1 else np.inf
    if spacing > period / PER_PERIOD * (1 + 1e-9):
        raise ValueError(f"snapshots every tau = {spacing:.4g} are too far apart: at most {period / PER_PERIOD:.4g}")
    count = max(PERIODS, int(PART * (tau[-1] - ramp) / period))
    begin = tau[-1] - count * period
    if begin <= ramp:
        raise ValueError(
            f"too short a run: tau = {tau[-1]:.4g} is not above {ramp + count * period:.4g}, the ramp ({ramp:g}) and "
            f"{count} periods of {period:.4g}"
        )
    return int(np.searchsorted(tau, begin, side="right")), float(tau[-1])


LINES = {"p": "tab:blue", "q": "tab:blue", "phi": "tab:orange", "p at 2Ω": "tab:blue", "mean p": "tab:orange"}
LABELS = {"phi": r"$\varphi$", "p at 2Ω": r"$p$ at $2\Omega$", "mean p": "mean of $p$", "q": "$q$", "p": "$p$"}


def draw(found: Comparison) -> Figure:
    """Moduli over the rows, run over theory; below, what is left of the complex amplitudes."""
    figure = Figure(figsize=(10, 6), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, height_ratios=[3, 2])
    for name, theory in found.theory.items():
        upper, lower = panels[:, int(name in ("p at 2Ω", "mean p"))]
        all_rows = np.arange(found.n[-1] + 1)
        upper.plot(all_rows, _theory(found, name, all_rows), color=LINES[name], linewidth=1.0)
        upper.plot(found.n, np.abs(found.run[name]), "o", color=LINES[name], markersize=4, label=LABELS[name])
        lower.semilogy(found.n, np.abs(found.run[name] - theory), "o-", color=LINES[name], markersize=3, linewidth=0.5)
    beat = beat_length(found.linear, found.ratios)
    second = "free wave above the cutoff" if np.isnan(beat) else f"beat length {beat:.4g} rows"
    for axes, title in zip(panels[0], ("(a) fundamental", f"(b) second order; {second}"), strict=True):
        axes.set_title(title, fontsize="medium", loc="right")
        axes.set_ylim(0, 1.35 * axes.get_ylim()[1])  # room for the legend
        axes.ticklabel_format(axis="y", scilimits=(-2, 3))
        axes.legend(title="dots: run, lines: theory", fontsize="small", ncols=2, loc="upper left")
    panels[0, 0].set_ylabel(r"amplitude ($D_0$)")
    panels[1, 0].set_ylabel("|run − theory|, with phase ($D_0$)")
    for axes in panels[1]:
        axes.set_xlabel("row $n$")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    numbers = ",  ".join(f"{LABELS[name]} {whole:.1e}" for name, (whole, _) in found.deviations().items())
    figure.suptitle(
        rf"driven {found.linear.name}, $\xi$ = {found.linear.wavenumber:.4g}, $a$ = {found.amplitude:g}; "
        f"median relative deviations: {numbers}",
        fontsize="medium",
    )
    return figure


def _theory(found: Comparison, name: str, rows: NDArray[np.intp]) -> Floats:
    if name == "mean p":
        return np.abs(static(found.linear, found.ratios, found.amplitude, rows))
    fundamental, second = driven_amplitudes(found.linear, found.ratios, found.amplitude, rows)
    return np.abs(second if name == "p at 2Ω" else fundamental[["p", "q", "phi"].index(name)])


def main(argv: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    options = parser(__doc__, "figures/driven.png")
    options.add_argument("run", metavar="RUN", type=Path, help="run folder of a driven row, with snapshots")
    chosen = options.parse_args(argv)
    try:
        found = compare(*load_form(chosen.run, "driven"))
    except ValueError as error:
        raise SystemExit(f"{chosen.run}: {error}") from error
    print(f"rows {found.n[0]} to {found.n[-1]}; median deviation: complex, of the modulus")
    for name, (whole, modulus) in found.deviations().items():
        print(f"{name:10s} {whole:.2e} {modulus:.2e}")
    save(draw(found), chosen.output)
    print(chosen.output)
    return 0


if __name__ == "__main__":
    start(main)
