"""Two rows that are shaken at two frequencies, and what their waves make at the sum and the difference.

    granular-analysis tones RUN [-o FILE]

Between the rows two waves run towards each other. At Ω1 ± Ω2 the field there is the forced wave of
`granular_analysis.theory.bloch.pair_of`, at k1 ± k2, and two free waves that come from where the pair ends:

    X(n) = X_forced e^{ikn} + A e^{iξn} + B e^{−iξn},    Ω_L(ξ) = Ω1 ± Ω2

The script fits the frequencies Ω1, Ω2, 2Ω1, 2Ω2, Ω1 ± Ω2, with a Hann window, to the rows between the two over the last
third of a run, and then the three waves over the rows. The theory takes the amplitudes of the two waves from the run,
and nothing else. The table says |X_forced| of both and the relative error with phase; the figure shows the spectrum of
the centre sphere, and both fields over the rows.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from cases.rows import FORMS, amplitudes_at, rows_of, waves
from cases.runner import script
from granular_analysis.theory.bloch import in_plane, pair_of, real_modes, wavevector_of
from granular_analysis.theory.catalogue import AT_REST
from granular_analysis.theory.choice import contact_of, traits_of
from granular_analysis.theory.contact import Contact
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

HELD = FORMS["driven"] | {"source", AT_REST}  # traits of a run that the theory holds
PART = 1 / 3  # share of a run that is fitted, its end
NEAR = 6  # rows beside a source, in which waves decay that it makes beside the one
FEWEST_ROWS = 12
PER_PERIOD = 4  # fewest snapshots in a period of Ω1 + Ω2


@dataclass(frozen=True)
class Line:
    """The field of p at the sum or the difference: frequency, wave numbers per row, and amplitudes in D0, with phase.

    `run` and `theory` are those of the forced wave, `ahead` and `back` those of the free ones in the run; `rows` the
    whole field of the run in the rows n of the fit.
    """

    name: str
    frequency: float
    forced: float
    free: float
    run: complex
    theory: complex
    ahead: complex
    back: complex
    rows: Complexes

    @property
    def error(self) -> float:
        """Relative error of the run, with phase."""
        return abs(self.run / self.theory - 1)

    def field(self, n: ArrayLike) -> Complexes:
        """Return the field over rows, the forced wave by theory."""
        waves = np.exp(1j * np.multiply.outer(n, [self.forced, self.free, -self.free]))
        return np.asarray(waves @ [self.theory, self.ahead, self.back])


@dataclass(frozen=True)
class Tones:
    """A run, the two frequencies, the rows of the fit counted from the centre, and the lines."""

    record: Record
    frequencies: tuple[float, float]
    n: NDArray[np.int64]
    lines: tuple[Line, ...]


def wavenumber(frequency: float, contact: Contact, *, longitudinal: bool) -> float:
    """Return ξ of the L or the lowest other wave along y with a frequency in rad/t0.

    Raises
    ------
    ValueError
        If there is none.
    """

    def above(xi: float) -> float:
        frequencies, shapes = real_modes(wavevector_of(xi, 90.0), contact)
        along = np.abs(shapes[:, 1]) > 0.5
        return float(frequencies[along == longitudinal][0]) - frequency

    if above(1e-6) > 0 or above(np.pi) < 0:
        raise ValueError(
            f"no wave {'L' if longitudinal else 'TR'} along y has the frequency {frequency:.6g} rad per t0"
        )
    return float(brentq(above, 1e-6, np.pi, xtol=1e-13))


def compare(record: Record) -> Tones:
    """Fit a run and set theory beside it.

    Raises
    ------
    ValueError
        If the run is not one of two rows that are shaken along x at two frequencies, or is too short or too coarse.
    """
    scene = record.scene
    if left_out := sorted(traits_of(record) - HELD):
        raise ValueError(f"the theory leaves out {', '.join(left_out)}, which this run has")
    low, high = _sources(record)
    n = np.arange(low.rows[1] + NEAR, high.rows[0] - NEAR + 1)
    if len(n) < FEWEST_ROWS:
        raise ValueError(f"{len(n)} rows lie {NEAR} from both sources or more; must be at least {FEWEST_ROWS}")
    rows, first, second = rows_of(record), float(low.frequency), float(high.frequency)
    late = rows.tau > (1 - PART) * rows.tau[-1]
    if np.diff(rows.tau).max() > 2 * np.pi / (first + second) / PER_PERIOD:
        raise ValueError(f"snapshots every tau = {np.diff(rows.tau).max():.4g}: must be {PER_PERIOD} in a period")
    seen = {first, second, 2 * first, 2 * second, first + second, abs(first - second)}
    resolved = 4 * np.pi / np.ptp(rows.tau[late])  # Hann's main lobe to its zero
    if np.diff(sorted({0.0, *seen})).min() < resolved:
        raise ValueError(
            f"the lines {sorted(seen)} rad per t0 must lie {resolved:.3g} apart in the last third of the run"
        )
    p, q = (
        dict(zip(sorted(seen), amplitudes_at(rows.tau[late], each[late][:, n], sorted(seen))[1], strict=True))
        for each in (rows.p, rows.q)
    )
    contact, step, place = contact_of(record), record.snapshots().step, n - scene.shape.centre_row
    # Velocity Verlet moves a wave of the lattice's Ω at the frequency 2/h·asin(Ωh/2)
    xi = [wavenumber(w * np.sinc(w * step / (2 * np.pi)), contact, longitudinal=False) for w in (first, second)]
    both = [(wavevector_of(xi[0], 90.0), 0), (wavevector_of(xi[1], -90.0), 0)]
    sent = []
    for frequency, each, ahead, (k, _) in zip((first, second), xi, (1, -1), both, strict=True):
        shape = real_modes(k, contact)[1][0]
        sent.append(-waves(q[frequency], place, [ahead * each, -ahead * each])[0][0] / shape[0])
    lines = []
    signs: tuple[tuple[str, Literal[1, -1]], ...] = ("sum", 1), ("difference", -1)
    for name, sign in signs:
        at = first + sign * second
        made = in_plane(pair_of(both[0], both[1], sign, contact).forced())[1]
        product = sent[0] * (sent[1] if sign > 0 else sent[1].conjugate())
        theory, forced = complex(made * product * scene.amplitude), xi[0] - sign * xi[1]
        frequency = abs(at)
        if at < 0:  # the same field with a positive frequency
            theory, forced = theory.conjugate(), -forced
        free = wavenumber(frequency * np.sinc(frequency * step / (2 * np.pi)), contact, longitudinal=True)
        run, ahead, back = waves(p[frequency], place, [forced, free, -free])[0].tolist()
        lines.append(Line(name, frequency, forced, free, run, theory, ahead, back, p[frequency]))
    return Tones(record, (first, second), place, tuple(lines))


def _sources(record: Record) -> tuple[Any, Any]:
    """Return the two sources of a run, the lower row first, after checking that they are what the module compares."""
    sources = sorted(record.scene.source, key=lambda each: tuple(each.rows))
    right = len(sources) == 2 and all(
        each.rows and each.rows[0] == each.rows[1] and each.signal == "tone" and each.frequency is not None
        for each in sources
    )
    if not right or any("x" not in (each.motion, each.force) for each in sources):
        raise ValueError('sources must be two, each of one row, with signal = "tone", a frequency, and force = "x"')
    return sources[0], sources[1]


def draw(found: Tones) -> Figure:
    """Spectrum of the centre sphere; |p| at the two lines over the rows, run over theory."""
    figure = Figure(figsize=(9.5, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    record = found.record
    late = record.tau > (1 - PART) * record.tau[-1]
    tau, window = record.tau[late], np.hanning(late.sum())
    omega = 2 * np.pi * np.fft.rfftfreq(len(tau), tau[1] - tau[0])
    for name, colour in (("q", "tab:orange"), ("p", "tab:blue")):
        signal = getattr(record, name)[late]
        share = 2 * np.abs(np.fft.rfft((signal - signal.mean()) * window)) / window.sum()
        left.semilogy(omega, share, color=colour, linewidth=1.0, label=f"${name}$")
    left.set(
        xlim=(0, 1.6 * sum(found.frequencies)),
        ylim=(1e-8, 10),
        xlabel=r"$\Omega$ (rad per $t_0$)",
        ylabel=r"centre sphere ($D_0$)",
    )
    for line, colour in zip(found.lines, ("tab:purple", "tab:red"), strict=True):
        left.axvline(line.frequency, color=colour, linestyle=":", linewidth=0.9)
        label = rf"{line.name}, $\Omega$ = {line.frequency:.3g}"
        right.plot(found.n, np.abs(line.rows), ".", color=colour, markersize=4, label=label)
        fine = np.linspace(found.n[0], found.n[-1], 400)
        right.plot(fine, np.abs(line.field(fine)), color=colour, linewidth=0.9)
        right.axhline(abs(line.theory), color=colour, linestyle="--", linewidth=0.9)
    right.set(xlabel="rows from the centre", ylabel=r"$|p|$ ($D_0$)", ylim=(0, None))
    right.set_ylim(0, 1.25 * right.get_ylim()[1])  # room for the legend
    for axes in (left, right):
        axes.legend(fontsize="small")
    right.set_title("dots: run; dashed: forced wave by theory; line: with free ones", fontsize="small")
    return figure


def table(found: Tones) -> str:
    """Return |X_forced| of run and theory and the relative error with phase, a line each."""
    lines = [f"{'':12}{'Omega':>10}{'k':>10}{'run, D0':>12}{'theory':>12}{'error':>9}"]
    for line in found.lines:
        numbers = f"{line.frequency:10.5g}{line.forced:10.5f}{abs(line.run):12.4e}{abs(line.theory):12.4e}"
        lines.append(f"{line.name:12}{numbers}{line.error:9.1e}")
    return "\n".join(lines)


main = script(__name__, compare, table, draw, ("run", "of two shaken rows, with snapshots"), figure="two_tones.png")
