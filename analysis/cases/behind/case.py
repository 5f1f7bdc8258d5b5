"""Second harmonic behind an interface: the parts generated before the interface, at it, and behind it.

    granular-analysis behind SWEEP [-o FILE]

SWEEP is a sweep of a tone of TR waves over the first row of an inclusion that reaches the upper end: runs with the same
interface at several distances from the source, with snapshots; ``make scattering`` makes one. A TR wave of frequency Ω
drives p at 2Ω. With rows n counted from the interface, and a, b the amplitudes of u at the interface in front and
behind, the field behind is

    p_n(2Ω) = F b² e^{2iξn} + B a² e^{ikn} + (reflection from the end) e^{−ikn},    ξ of TR at Ω, k of L at 2Ω

F is the forced wave, generated everywhere behind the interface. B is the free wave behind, P the free wave in front,
with the wave numbers there. P starts at the source, so its phase at the interface changes with the distance. The wave H
generated at the interface, where the forced waves of both sides meet, has a constant phase:

    B = τ P + H

τ and H are fitted to the runs. τ P was generated before the interface, H at it. The linear lattice
(`granular_analysis.theory.transfer`) gives |τ| independently of the fit.

Breaks if L waves do not propagate at 2Ω on both sides, and if all distances differ by multiples of the beat length
2π/(2ξ − k).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.fields import fields_of
from cases.rows import waves
from cases.runner import script
from granular_analysis.measure.runs import all_but
from granular_analysis.plotting import page
from granular_analysis.theory.rows import Rows
from granular_analysis.theory.transfer import running, scattering
from granular_analysis.tools.scatter import rows_at_rest
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating]
PERIODS = 10  # periods of Ω at the end of a run from which amplitudes are fitted
PER_PERIOD = 4  # fewest samples in a period of 2Ω
NEAR = 3  # rows left out next to source, interface and quiet end, in which near fields decay
FEWEST = 4  # fewest runs


@dataclass(frozen=True)
class Behind:
    """Waves of one run; complex amplitudes in units of u(Ω)² at the interface, in front or behind.

    Attributes
    ----------
    distance : rows from the source to the interface.
    forced_before, forced : forced waves, with 2ξ, in front (over a²) and behind (F, over b²).
    free_before, free : P and B, both over a².
    passed : b²/a².
    residual : relative norm of p at 2Ω behind that the fitted waves leave.
    """

    distance: float
    forced_before: complex
    forced: complex
    free_before: complex
    free: complex
    passed: complex
    residual: float


@dataclass(frozen=True)
class Parts:
    """Parts of the free wave behind, by the place at which they are generated.

    Attributes
    ----------
    runs : waves of each run, by distance.
    passes : τ.
    passes_in_theory : |τ| of the linear lattice.
    interface : H.
    residual : root mean square of B − τP − H, over that of B.
    """

    runs: list[Behind]
    passes: complex
    passes_in_theory: float
    interface: complex
    residual: float


def amplitudes(tau: Floats, rate: Floats, frequency: float) -> tuple[Complexes, Complexes]:
    """Return the displacement amplitudes X, in Re[X e^{−iΩτ}], at Ω and at 2Ω from velocities (T, …).

    The fit takes the last `PERIODS` periods. Raises ValueError for runs of fewer than twice as many periods, and for
    fewer than `PER_PERIOD` samples in a period of 2Ω.
    """
    if np.diff(tau).max(initial=0.0) > np.pi / frequency / PER_PERIOD:
        raise ValueError(f"samples every tau = {np.diff(tau).max():.4g}: must be {PER_PERIOD} in a period of 2Ω")
    length = PERIODS * 2 * np.pi / frequency
    if tau[-1] < 2 * length:
        raise ValueError(f"tau = {tau[-1]:.6g} at the end: must be at least {2 * length:.6g}, {2 * PERIODS} periods")
    late = tau > tau[-1] - length
    angle = frequency * tau[late]
    basis = np.column_stack([np.ones_like(angle), *(f(k * angle) for k in (1, 2) for f in (np.cos, np.sin))])
    found = np.linalg.lstsq(basis, rate[late].reshape(len(angle), -1), rcond=None)[0]
    first, second = ((found[2 * k - 1] + 1j * found[2 * k]) / (-1j * k * frequency) for k in (1, 2))
    return first.reshape(rate.shape[1:]), second.reshape(rate.shape[1:])


def measure(record: Record) -> tuple[Behind, Rows, float]:
    """Return the waves of a run, its rows at rest, and Ω in the unit of the rows.

    Raises ValueError unless the run has a TR tone before one interface, and for a run that theory leaves out.
    """
    scene = record.scene
    rows, unit = rows_at_rest(record)
    (source,) = scene.source
    last = scene.shape.rows - 1
    if source.signal != "tone" or scene.require_wave().mode != "TR" or source.force != "x":
        raise ValueError(f"{record.folder}: must have a tone of force along x, and wave.mode = TR")
    if len(scene.inclusion) != 1 or list(scene.inclusion[0].rows)[1:] != [last]:
        raise ValueError(f"{record.folder}: must have one inclusion, of rows up to the last, {last}")
    frequency = source.pulsation(scene.sphere, float(record.info["frequency"]))
    first, top, quiet = scene.inclusion[0].rows[0], source.rows[1], int(scene.absorb.rows)
    sides = [running(each, f * frequency / unit) for each in (rows, rows.reversed) for f in (1, 2)]
    if any(name not in side for name, side in zip(("TR", "L", "TR", "L"), sides, strict=True)):
        raise ValueError(
            f"{record.folder}: TR must run at {frequency:.6g} rad per t0, and L at twice that, on both sides"
        )
    before, before_twice, after, after_twice = (
        side[name].wavenumber for name, side in zip(("TR", "L", "TR", "L"), sides, strict=True)
    )
    snapshots = record.snapshots()
    shape = (len(snapshots.tau), scene.shape.rows, scene.shape.columns, 3)
    rate = fields_of(snapshots, "velocity", "spin").reshape(shape).mean(axis=2)
    at_once, at_twice = amplitudes(snapshots.tau, rate, frequency)
    front, back = np.arange(top + 1 + NEAR, first - NEAR), np.arange(first + NEAR, last - quiet - NEAR)
    n, m = front - (first - 0.5), back - (first - 0.5)
    (a, _), _ = waves(at_once[front, 0], n, (before, -before))
    (b, _), _ = waves(at_once[back, 0], m, (after, -after))
    # The reflected wave drives p too, by itself and together with the incident one
    ahead, _ = waves(at_twice[front, 1], n, (2 * before, before_twice, -before_twice, -2 * before, 0.0))
    (forced, free, _), left = waves(at_twice[back, 1], m, (2 * after, after_twice, -after_twice))
    distance = first - 0.5 - top
    return (
        Behind(distance, ahead[0] / a**2, forced / b**2, ahead[1] / a**2, free / a**2, b**2 / a**2, left),
        rows,
        frequency / unit,
    )


def parts(records: Sequence[Record]) -> Parts:
    """Return the parts of the free wave behind an interface, from runs with several distances of the source.

    Raises ValueError for fewer than `FEWEST` runs, for runs that differ in more than the distance, and as `measure`.
    """
    if len(records) < FEWEST:
        raise ValueError(f"{len(records)} runs: must be at least {FEWEST}, with the interface in different rows")
    kinds = {repr(all_but(record, "inclusion.rows")) for record in records}
    if len(kinds) > 1:
        raise ValueError(f"{len(kinds)} kinds of runs: runs must differ only in the first row of the interface")
    measured = [measure(record) for record in records]
    found = sorted((each for each, _, _ in measured), key=lambda each: each.distance)
    _, rows, frequency = measured[0]
    passes, interface, residual = split(found)
    return Parts(found, passes, passage(rows, 2 * frequency), interface, residual)


def split(found: Sequence[Behind]) -> tuple[complex, complex, float]:
    """Return τ and H of the free waves of several runs, and the relative norm of B − τP − H."""
    before, behind = (np.array([getattr(each, name) for each in found]) for name in ("free_before", "free"))
    basis = np.column_stack([before, np.ones_like(before)])
    (passes, interface), *_ = np.linalg.lstsq(basis, behind, rcond=None)
    left = np.linalg.norm(basis @ [passes, interface] - behind) / np.linalg.norm(behind)
    return complex(passes), complex(interface), float(left)


def passage(rows: Rows, frequency: float) -> float:
    """Return |v| behind over |v| in front for an L wave that passes the rows, from its transmitted energy."""
    share = scattering(rows, frequency, "L").transmitted["L"]
    front, back = (running(each, frequency)["L"] for each in (rows, rows.reversed))
    carried = [wave.flux / np.abs(wave.here[1]) ** 2 for wave in (front, back)]
    return float(np.sqrt(share * carried[0] / carried[1]))


def table(found: Parts) -> str:
    """Return the amplitudes over a² with a line for each run, and the fitted parts."""
    lines = [f"{'rows to the interface':>21}{'forced behind':>15}{'free behind':>13}{'made before':>13}{'left':>9}"]
    for each in found.runs:
        numbers = (abs(each.forced * each.passed), abs(each.free), abs(found.passes * each.free_before))
        lines.append(f"{each.distance:21.1f}{numbers[0]:15.5f}{numbers[1]:13.5f}{numbers[2]:13.5f}{each.residual:9.1e}")
    return "\n".join(
        [
            *lines,
            f"made at the interface: {abs(found.interface):.5f}; the fit leaves {found.residual:.1e} of the free wave",
            f"the part made before passes with {abs(found.passes):.4f}, in theory with {found.passes_in_theory:.4f}",
        ]
    )


def draw(found: Parts) -> Figure:
    """Draw the moduli over the distance of the source, and the free wave behind in the complex plane."""
    figure = page(3.8)
    left, right = figure.subplots(1, 2)
    at = [each.distance for each in found.runs]
    free = np.array([each.free for each in found.runs])
    before = found.passes * np.array([each.free_before for each in found.runs])
    forced = [abs(each.forced * each.passed) for each in found.runs]
    left.plot(at, np.abs(free), "o", color="black", label="free wave behind")
    left.plot(at, np.abs(before + found.interface), "x", color="C3", label="sum of the two parts")
    left.plot(at, np.abs(before), "^", color="C0", markersize=5, label="part made before the interface")
    left.axhline(abs(found.interface), color="C1", linewidth=1, label="part made at the interface")
    left.plot(at, forced, "s", color="C2", markersize=4, label="forced wave behind, made all along")
    left.set(
        xlabel="rows from the source to the interface", ylabel=r"$p$ at $2\Omega$ over $a^2$ ($1/D_0$)", ylim=(0, None)
    )
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    turn = np.linspace(0, 2 * np.pi, 200)
    circle = found.interface + np.mean(np.abs(before)) * np.exp(1j * turn)
    right.plot(circle.real, circle.imag, color="C0", linewidth=0.8)
    right.plot(free.real, free.imag, "o", color="black")
    right.plot(found.interface.real, found.interface.imag, "+", color="C1", markersize=10)
    right.axhline(0, color="0.8", linewidth=0.6, zorder=0)
    right.axvline(0, color="0.8", linewidth=0.6, zorder=0)
    right.set(aspect="equal", xlabel="Re $B$ ($1/D_0$)", ylabel="Im $B$ ($1/D_0$)")
    for axes in (left, right):
        axes.ticklabel_format(scilimits=(-2, 3))
    right.set_title("free wave behind;\ncross: part made at the interface")
    return figure


main = script(__name__, parts, table, draw, ("sweeps", "sweep over the first row of an inclusion"))
