"""Gradients of a run where they are hard: at a resonance, where they grow with time, and at the end of a contact."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from granular_analysis import second_harmonic as sh
from granular_analysis.measure.norms import slope
from granular_analysis.theory import bloch
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.network_state import start
from tests.hard.case import Case, Cases
from tests.hard.cell import Floats
from tests.hard.lasting import SPHERE, UNIT, crystal
from tests.hard.stretched import BEGIN, CURVE, END, MASS, PULL, TIME, as_it_is, let_go
from tests.hard.waves import ETA, NU

jnp = pytest.importorskip("jax").numpy
gradients = pytest.importorskip("granular_analysis.theory.network_gradient", reason="needs JAX")
factors = pytest.importorskip("granular_analysis.theory.network_factors", reason="needs JAX")

ROWS, COLUMNS, STEP = 34, 3, 0.1  # step in τ
SECULAR = 0.2  # share of the run from which what grows is all


@cache
def resonant(cycles: int, amplitude: float, duration: float) -> tuple[Any, Any]:
    """Return a run of TR at ξ = 2π·cycles/34, and what reads the complex amplitudes of its second harmonic, in D0."""
    network, row = crystal(ROWS, COLUMNS, shear=True), np.arange(ROWS * COLUMNS) // COLUMNS
    mode = bloch.mode("TR", 2 * np.pi * cycles / ROWS, sh.ALONG_Y, Contact(NU, overlap_ratio=ETA))
    turn = np.exp(1j * mode.wavenumber * (row + 0.25))
    unit = amplitude * SPHERE.static_overlap
    along = np.array([mode.p, mode.q]) @ bloch.frame(sh.ALONG_Y)
    field = unit * turn[:, None] * [*along, 1j * mode.f / SPHERE.radius]
    way, rate = field.real, (-1j * mode.frequency / UNIT * field).real
    state = start(network, way[:, :2], rate[:, :2], way[:, 2], rate[:, 2])
    samples = round(duration)
    run = factors.Run(network, state, STEP * UNIT, samples, round(1 / STEP), np.arange(len(row)))
    return run, lambda found: 2 * jnp.mean(found.motion[:, 1] * turn.conj() ** 2, axis=1) / unit


def grown(run: Any, read: Any, name: str, size: float = 0.0) -> tuple[Floats, Floats]:
    """Return the amplitudes (T,) and their derivative by a factor of all, where it is 1 + `size`."""
    ones = run.neutral("amplitude", "shear_stiffness", "normal_stiffness")
    way = {each: (each == name) * values for each, values in ones.items()}
    there = {each: ones[each] + size * way[each] for each in ones}
    value, change = gradients.derivative(run, read, there, way)
    return np.asarray(value), np.asarray(change)


def rates(ratio: float, cycles: int) -> tuple[float, float]:
    """Return the changes of 2Ω and of w̃ by the logarithm of all shear stiffnesses, in rad per τ."""
    own, step = sh.ratios(ratio, overlap_ratio=ETA), 1e-5
    wavenumber = 2 * np.pi * cycles / ROWS
    found = []
    for factor in (1 + step, 1 - step):
        kappa = own.kappa * factor
        faster = np.sqrt((kappa + 3) / (own.kappa + 3))  # τ of the crystal as it is
        mode = sh.mode("TR", wavenumber, sh.of_stiffness(kappa, overlap_ratio=ETA))
        found.append(faster * np.array([2 * mode.frequency, sh.doubled_frequency(mode)]))
    both = (found[0] - found[1]) / (2 * step)
    return float(both[0]), float(both[1])


def growing(
    amplitude: float,
    duration: float,
    cycles: int = 8,
    ratio: float = NU,
    size: float = 1e-4,
    against: str = "shear_stiffness",
) -> Cases:
    """How the slopes of a second harmonic grow at the resonance, beside theory and central differences."""
    run, read = resonant(cycles, amplitude, duration)
    tau = np.arange(run.samples + 1.0)
    late = tau >= SECULAR * duration
    by_size = grown(run, read, "amplitude")[1]
    value, by_shear = grown(run, read, "shear_stiffness")
    twice, free = rates(ratio, cycles)
    found = np.polyfit(tau[late], (by_shear / np.where(value, value, 1.0))[late].imag, 1)[0]
    more, less = (grown(run, read, against, each)[0][-1] for each in (size, -size))
    error = abs((more - less) / (2 * size) - by_shear[-1]) / abs(by_shear[-1])
    where = f"second harmonic of TR, ξ = {2 * np.pi * cycles / ROWS:.4f}, a = {amplitude:g}, τ ≤ {duration:g}, by JAX"
    grows = [
        Case(
            f"{where}: power of τ with which its slope by the amplitude grows",
            "at the resonance it is the sum of all that was made before",
            slope(tau[late], np.abs(by_size)[late]),
            "1: p ∝ a²τ",
            least=0.98,
            most=1.02,
        ),
        Case(
            f"{where}: growth of its slope by the shear stiffness over p, ×τ, beside theory",
            "the slope grows as τ², by the phases of the drive and of the free wave",
            -found / ((twice + free) / 2),
            "1: d ln p = −i(2Ω' + w̃')τ/2; a change of the start rings beside it, as 1/τ",
            least=0.99,
            most=1.01,
        ),
    ]
    return [
        *(grows if amplitude < 0.1 else []),  # a larger wave gives so much to its harmonic that this ends
        Case(
            f"{where}: its slope by the shear stiffness beside a central difference of {size:g}, at the end",
            f"it is {abs(by_shear[-1] / value[-1]):.0f} of p there",
            float(error),
            "(2Ω' τ × difference)²/6 of phase is left of the difference, twice as much where waves exchange energy",
            most=(2 if amplitude >= 0.1 else 1) * (twice * duration * size) ** 2 / 6 + 1e-9,
        ),
    ]


def adjoint(amplitude: float = 0.2, duration: float = 500.0, share: float = 1.0) -> Cases:
    """Both modes of differentiation of what has grown for long."""
    run, read = resonant(8, amplitude, duration)
    ones = run.neutral("amplitude", "shear_stiffness", "normal_stiffness")
    backward = gradients.gradient(run, lambda found: read(found)[-1].real, ones)[1]
    error = max(
        abs(float(np.sum(backward[name])) / (share * grown(run, read, name)[1][-1].real) - 1)
        for name in ("amplitude", "shear_stiffness")
    )
    return [
        Case(
            f"reverse beside forward mode, second harmonic at the resonance, a = {amplitude:g}, τ ≤ {duration:g}",
            "the way back goes through all that the slope has grown by",
            error,
            "rounding, 1e-16, times the growth of the slope, 3e3, and the root of the steps",
            most=1e-11,
        )
    ]


def parting(steps: int = 400, jump: float = 1.0) -> Cases:
    """Slopes of spheres that turn next to the pull-off of a JKR contact, and of one that parts."""
    shares = np.array([1e-2, 1e-3, 1e-6, -1e-2])
    network, state = let_go(np.full(4, BEGIN * END), END * shares, as_it_is)
    run = factors.Run(network, state, TIME / steps, 2 * steps, 1, np.arange(4, 8))
    ones = run.neutral("amplitude")
    motion, change = map(
        np.asarray,
        gradients.derivative(run, lambda found: found.motion[:, jnp.array([0, 3])], ones, ones, kinks=True),
    )
    speed = state.motion[3, 4:]

    def rate(_: float, y: Floats) -> list[float]:
        return [y[1], -float(-CURVE.force(CURVE.contact_radius(-y[0]))) / MASS]

    def end(lane: int, factor: float) -> float:
        begin = [-BEGIN * END * factor, speed[lane] * factor]
        return float(solve_ivp(rate, (0, 2 * TIME), begin, "DOP853", rtol=1e-12, atol=1e-18).y[0, -1])

    # So small that none opens
    exact = np.array([(end(lane, 1 + 1e-8) - end(lane, 1 - 1e-8)) / 2e-8 for lane in range(3)])
    turned = np.abs(change[-1, 0, :3] / exact - 1).max()
    # v² = v0² + 2U/m, U' the force
    push = float(CURVE.force(CURVE.contact_radius(BEGIN * END)))
    out = float(motion[-1, 1, 3])
    truth = (speed[3] ** 2 + push * BEGIN * END / MASS) / out
    last = np.flatnonzero(motion[:, 0, 3] < -END)[-1]
    missing = jump * PULL / MASS * change[last, 0, 3] / out
    half_kick = PULL * TIME / steps / MASS / 2 / out
    return [
        Case(
            f"slope of three spheres that turn 1e-2 to 1e-6 before a JKR pull-off, {steps} steps to there",
            "next to the kink the slope is that of the side of the run",
            float(turned),
            "second order in the step over the time to the turn",
            most=10.0 / steps**2,
        ),
        Case(
            "slope of the speed of a sphere that parts 1e-2 beyond it, with what the jump of the pull adds, "
            "over the exact one, less 1",
            f"by steps of fixed length the gradient alone has {float(change[-1, 1, 3]) / truth:.2f} of it",
            float(abs((change[-1, 1, 3] + missing) / truth - 1)),
            "(F/m)(dx/da)/v is of the time at which the contact ends; half a kick over the speed, twice",
            most=2 * half_kick,
        ),
    ]
