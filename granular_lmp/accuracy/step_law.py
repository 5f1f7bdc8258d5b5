"""What the time step does to a wave, before it is run: second-order theory of the lattice as velocity Verlet steps it.

With step h the positions obey δ²x/h² = F(x) exactly, so that theory holds with every frequency replaced,

    ω → ω_h = (2/h) arcsin(ωh/2),        fundamental  U = cos Ω_hτ − i sin Ω_hτ / cos(Ω_hh/2)

(a wave runs (ωh)²/24 too fast) and the second harmonic driven by U² summed over the steps instead of integrated:

    Z(τ) = Σ'' h U² sin(w_h(τ−s)) h/sin(w_hh),        w̃ = |sin ξ| = Ω_L(2ξ)

    q = Q Re U,  φ = Re(if U),  p = (ε/2) Re(iG e^{2iϑ} Z)    TR, RT;        p = Re U + (ε/2) Re(iG e^{2iϑ} Z)    L

    G = sin ξ Q[α s²Q − (β/√3) sin ξ f]    TR, RT;        G = −sin ξ s²    L;        s = sin(ξ/2)

h → 0 gives the continuous lattice, and two steps give the error of a Richardson pair. Against the lattice stepped in
full this is right to a few percent where a² ≪ 1 (docs/accuracy.md). One error is of first order: LAMMPS turns the slip
of a contact with the contact's direction at the end of the step, which leaves ½h (t·v)(n·v)/ℓ in the rate of the slip;
it is of the order of h Δ0/R, survives the extrapolation, and counts where p is small, near the antiresonance.

It is the law of a running plane wave along y (`Scene.plane_along_y`). Of other waves only the phase of the fundamental
is known; it chooses the first step, and the runs have to tell the error (`granular_lmp.accuracy.tolerance`).

Breaks when contacts open, for long times near the resonance, and where p is of fourth order (antiresonance), whose
waves are faster: `granular_lmp.accuracy.tolerance` finds that out from the runs.
"""

from dataclasses import dataclass
from math import ceil, cos, hypot, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.rounding import farthest_rounding, grain, noise_floor, position_rounding
from granular_lmp.crystal.modes import Mode, mode_of
from granular_lmp.effects.table import largest_step
from granular_lmp.errors import SceneError
from granular_lmp.scene.scene import Scene

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

# Size of the p of fourth order, in units of G/sin ξ and a²s²: 0.008 and 0.010 at the antiresonance of ν = 0.17 for
# a = 0.2 and 0.3, against the lattice. It matters only where the second order nearly vanishes.
FOURTH_ORDER = 0.009
# What third order adds to the error of an extrapolated pair, over a²: at most 1.8 at a = 0.3 and 0.5 at a = 0.2, in
# p, q, φ together, over 180 waves.
THIRD_ORDER = 20.0
# Largest relative error by the turned slip at third order, over η a² τ sin⁵(ξ/2) Δτ: 1.2 for L at ξ = 2.36, a = 0.2 to
# 0.4, and 1.1 for q of TR at ξ = π, against the lattice at τ = 120; less for all else that was tried.
TURNING = 1.5
_LARGEST_AMPLITUDE = 0.5  # to which that is taken; beyond it contacts open, and the runs have to tell
# The part of the tolerance that the chosen step may use. The error goes as the fourth power: 0.8 costs 6 %.
SHARE = 0.8
# Before the echo the walls are below this (`Scene.echo_time`).
WALLS = 1e-6
MOST_STEPS = 10**9
_TIMES = 1000  # the errors are taken over this many of the scene's records at most
_SILENT = 1e-9  # below this an amplitude, or sin ξ, is zero by symmetry


@dataclass(frozen=True)
class StepError:
    """Relative L2 errors over the run, of one signal: of a run with the step, of one with half of it, of the pair."""

    plain: float
    halved: float
    extrapolated: float


@dataclass(frozen=True)
class Waves:
    """What second order needs to know of a scene.

    Attributes
    ----------
    mode : Mode
    free : float
        w̃, frequency of the free L wave of wave number 2ξ.
    drive : float
        εG/2.
    drive_size : float
        The same with what fourth order adds, which keeps it from zero.
    twist : float
        First-order error of the slip, as a drive over the step: LAMMPS's turned contacts.
    turning : float
        η a² τ sin⁵(ξ/2): what the same error of the slip does to the wave itself goes as this, times the step.
    phase : float
        ϑ of the centre sphere at τ = 0.
    tau : (T,) array
        Times of the record.
    plane : bool
        Is it a running plane wave along y; of others nothing but the fundamental is known.
    """

    mode: Mode
    free: float
    drive: float
    drive_size: float
    twist: float
    turning: float
    phase: float
    tau: Floats
    plane: bool


def waves(scene: Scene) -> Waves:
    """The waves of a scene, in LAMMPS's contact geometry."""
    sphere, a, xi = scene.sphere, scene.wave.amplitude, scene.wavenumber
    mode, plane = mode_of(scene), scene.plane_along_y
    drive = second_harmonic_drive(scene, mode, sphere.overlap_ratio) if plane else 0.0
    kappa, q, sine = sphere.stiffness_ratio, -mode.ux, sin(xi)
    unit = sphere.nonlinearity(a) / 2 * sine * _s2(xi)
    # Force of the slip error: κC h √3/4 η s²Q²Ω sin ξ a, C = 1/(2(κ+3))
    twist = sqrt(3) / 8 * kappa / (kappa + 3) * sphere.overlap_ratio * _s2(xi) * q * q * mode.frequency * sine * a
    every = ceil((scene.time.samples + 1) / _TIMES)
    return Waves(
        mode=mode,
        free=max(abs(sine), _SILENT),
        drive=drive,
        drive_size=hypot(drive, FOURTH_ORDER * a * a * unit),
        twist=twist,
        turning=sphere.overlap_ratio * a * a * scene.time.duration * sin(xi / 2) ** 5,
        phase=scene.wave.phase,
        tau=scene.time.sample * np.arange(0, scene.time.samples + 1, every, dtype=np.float64),
        plane=plane,
    )


def second_harmonic_drive(scene: Scene, mode: Mode, overlap_ratio: float) -> float:
    """εG/2, with the geometry of the contacts at η = Δ0/2R (0: the paper's points of contact)."""
    kappa, xi = scene.sphere.stiffness_ratio, mode.wavenumber
    alpha, beta = (2 * kappa - 1) / (2 * kappa + 3), 2 * kappa / (2 * kappa + 3)
    eta = overlap_ratio / (1 - overlap_ratio)
    half = scene.sphere.nonlinearity(scene.wave.amplitude) / 2
    if mode.name == "L":
        return -half * (1 - 6 * eta * (1 - kappa) / (2 * kappa + 3)) * sin(xi) * _s2(xi)
    alpha += 2 * eta * (1 - 5 * kappa) / (2 * kappa + 3)
    beta *= 1 - 6 * eta
    q = -mode.ux
    return half * sin(xi) * q * (alpha * _s2(xi) * q - beta / sqrt(3) * sin(xi) * mode.f)


def _s2(xi: float) -> float:
    return sin(xi / 2) ** 2


# --- the signals under the step --------------------------------------------------------------------------------------


def stepped(frequency: float, step: float) -> float:
    """ω_h = (2/h) arcsin(ωh/2): the frequency at which velocity Verlet runs a mode; ω itself for step 0."""
    return 2 / step * float(np.arcsin(frequency * step / 2)) if step else frequency


def fundamental(frequency: float, tau: Floats, step: float) -> Complexes:
    """U: the wave e^{−iΩτ} as it is stepped from its exact displacement and velocity."""
    angle = stepped(frequency, step) * tau
    return np.cos(angle) - 1j * np.sin(angle) / cos(stepped(frequency, step) * step / 2)


def response(force: float, free: float, tau: Floats, step: float) -> Complexes:
    """Displacement at rest at τ = 0 under the force e^{iντ}, ν = `force` as stepped, of a mode of frequency `free`."""
    w = stepped(free, step)

    def summed(x: float) -> Complexes:
        """∫ e^{ixs} ds from 0 to τ, by the trapezoidal rule with the step."""
        half = x * step / 2
        ratio = half / np.tan(half) if abs(half) > 1e-12 else 1.0
        return tau * np.exp(0.5j * x * tau) * np.sinc(x * tau / (2 * pi)) * ratio

    weight = sin(w * step) / step if step else w
    return (np.exp(1j * w * tau) * summed(force - w) - np.exp(-1j * w * tau) * summed(force + w)) / (2j * weight)


def driven(frequency: float, free: float, tau: Floats, step: float) -> Complexes:
    """Z: the response to U²."""
    omega = stepped(frequency, step)
    backward = (1 - 1 / cos(omega * step / 2)) / 2  # the part of U that runs backward, O(h²)
    forward = 1 - backward
    parts = {-2 * omega: forward**2, 0.0: 2 * forward * backward, 2 * omega: backward**2}
    return sum(
        (share * response(force, free, tau, step) for force, share in parts.items()), np.zeros(len(tau), complex)
    )


def signals(w: Waves, step: float) -> dict[str, Floats]:
    """p, q, φ of the centre sphere in D0, those that do not vanish by symmetry."""
    wave = np.exp(1j * w.phase) * fundamental(w.mode.frequency, w.tau, step)
    if not w.plane:
        mode = w.mode
        parts = {
            "p": (mode.p, mode.p * wave.real),
            "q": (mode.q, mode.q * wave.real),
            "phi": (mode.f, -mode.f * wave.imag),
        }
        return {name: values for name, (share, values) in parts.items() if abs(share) > _SILENT}
    harmonic = 1j * np.exp(2j * w.phase) * driven(w.mode.frequency, w.free, w.tau, step)
    if w.mode.name == "L":
        return {"p": (wave + w.drive * harmonic).real}
    # At ξ = π nothing is driven, and TR and RT are either displacement or rotation
    parts = {
        "p": (sin(w.mode.wavenumber), w.drive_size * harmonic.real),
        "q": (w.mode.ux, -w.mode.ux * wave.real),
        "phi": (w.mode.f, -w.mode.f * wave.imag),
    }
    return {name: values for name, (share, values) in parts.items() if abs(share) > _SILENT}


def sizes(scene: Scene) -> dict[str, float]:
    """Root mean square of p, q, φ over the run in D0, to second order; without those that vanish by symmetry."""
    return {name: float(np.sqrt(np.mean(values**2))) for name, values in signals(waves(scene), 0.0).items()}


# --- the law and the choice ------------------------------------------------------------------------------------------


def step_errors(scene: Scene, step: float) -> dict[str, StepError]:
    """Errors that a step (in τ) and its half leave in p, q, φ, without those that vanish by symmetry."""
    return _errors(waves(scene), step, _higher_orders(scene))


def _higher_orders(scene: Scene) -> float:
    """Factor by which the error of a pair exceeds that of second order."""
    return 1 + THIRD_ORDER * min(scene.wave.amplitude, _LARGEST_AMPLITUDE) ** 2


def turning_errors(scene: Scene, step: float) -> dict[str, float]:
    """Relative errors of p, q, φ that LAMMPS's turning of the slip leaves in a run with this step: of first order."""
    w = waves(scene)
    return {name: _turning(w, name, values, step) for name, values in signals(w, 0.0).items()}


def _errors(w: Waves, step: float, higher: float) -> dict[str, StepError]:
    exact, coarse, fine = (signals(w, h) for h in (0.0, step, step / 2))
    errors = {}
    for name, values in exact.items():
        size = np.linalg.norm(values)
        turning = _turning(w, name, values, step)
        pair = (4 * fine[name] - coarse[name]) / 3
        errors[name] = StepError(
            plain=float(np.linalg.norm(coarse[name] - values) / size) + turning,
            halved=float(np.linalg.norm(fine[name] - pair) / size),
            extrapolated=higher * float(np.linalg.norm(pair - values) / size) + turning / 3,
        )
    return errors


def _turning(w: Waves, name: str, values: Floats, step: float) -> float:
    """Relative error of one signal by the turned slip: in p of TR and RT by theory, and at most `TURNING` in all."""
    third_order = TURNING * w.turning * step
    if name != "p" or w.mode.name == "L":
        return third_order
    swing = response(-2 * w.mode.frequency, w.free, w.tau, 0.0) - response(0.0, w.free, w.tau, 0.0)
    error = w.twist * (np.exp(2j * w.phase) * swing).real
    return third_order + step * float(np.linalg.norm(error) / np.linalg.norm(values))


def step_for(scene: Scene) -> float:
    """The coarse step of the Richardson pair that meets ``time.tolerance``, in τ; it fits the sample.

    Raises
    ------
    SceneError
        When the scene has no tolerance, or would take more than 1e9 steps.
    """
    tolerance = scene.time.tolerance
    if tolerance is None:
        raise SceneError("time.tolerance: missing key; the scene has a time.timestep")
    w, higher = waves(scene), _higher_orders(scene)

    def enough(per_sample: int) -> bool:
        found = _errors(w, scene.time.sample / per_sample, higher).values()
        return max(error.extrapolated for error in found) <= SHARE * tolerance

    stable = int(scene.time.sample / largest_step(scene)) + 1
    low, high = stable - 1, stable
    while not enough(high):
        low, high = high, 2 * high
        if 3 * high * scene.time.samples > MOST_STEPS:
            raise SceneError(f"time.tolerance = {tolerance!r}: would take more than {MOST_STEPS} steps in this scene")
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return scene.time.sample / high


def planned_steps(scene: Scene) -> int:
    """Time steps that running a scene takes: those of its one run, or of the two or three that a tolerance takes."""
    if scene.time.tolerance is None:
        return scene.time.steps
    runs = 3 if scene.plane_along_y else 7  # of one, two and four times the steps
    return runs * with_step(scene, step_for(scene)).time.steps


def with_step(scene: Scene, step: float) -> Scene:
    """The scene with a time step in place of its tolerance."""
    return scene.with_values({"time.timestep": step})


def rounding(scene: Scene) -> dict[str, float]:
    """Relative error of p, q, φ that the rounding of the positions leaves: ½ eps L/(size of the signal).

    A first law: L is half the height of the packing for p and its width for q and φ. Measured against the same steps
    without LAMMPS: 0.4 to 1.3 times that for 201 rows, 500 to 5000 steps. It grows with their number, which is not
    in the law.
    """
    far, near = farthest_rounding(scene), position_rounding(scene, scene.shape.columns)
    if not scene.plane_along_y:  # no signal lies along the rows
        near = far = max(far, near)
    return {name: (far if name == "p" else near) / size for name, size in sizes(scene).items()}


def drowned(scene: Scene) -> list[str]:
    """A sentence for each signal that second order predicts to be below what rounding leaves of it.

    For p of TR and RT that is `granular_lmp.accuracy.rounding.noise_floor` or `grain`, whichever is larger. Nothing is predicted
    of waves that are not plane and along y.
    """
    if not scene.plane_along_y:
        return []
    predicted = sizes(scene)
    if scene.wave.mode == "L" or "p" not in predicted or scene.time.tolerance is not None:
        return []  # p of L is the wave itself; a tolerance has its own refusal
    floor = max(noise_floor(scene), grain(scene))
    if predicted["p"] >= floor:
        return []
    return [
        f"wave.amplitude = {scene.wave.amplitude!r}: p is {predicted['p']:.2g} D0 by theory, below the {floor:.2g} D0 "
        "that the rounding of positions leaves; a larger amplitude or fewer packing.rows would lift it"
    ]


def walls(scene: Scene) -> float:
    """What the held rows leave at the centre, relative to the wave: 1e-6 at the echo time, 0 in a periodic cell.

    0 also for a scene that runs on past the echo (``time.allow_echo``): what the walls do is then a part of it.
    """
    return WALLS if scene.shape.ends == "fixed" and scene.time.duration <= scene.echo_time else 0.0


def floor(scene: Scene) -> dict[str, float]:
    """The relative errors that no time step takes away, the largest of p, q and φ: rounding and walls."""
    return {"rounding": max(rounding(scene).values()), "walls": walls(scene)}


def check_floor(scene: Scene) -> None:
    """Refuse a tolerance that no time step can meet.

    Raises
    ------
    SceneError
    """
    remedies = {
        "rounding": "a larger wave.amplitude or fewer packing.rows",
        "walls": 'packing.ends = "periodic"',
    }
    for source, value in floor(scene).items():
        if scene.time.tolerance is not None and scene.time.tolerance < value:
            raise SceneError(
                f"time.tolerance = {scene.time.tolerance!r}: must be at least {value:.2g}, which {source} leaves in "
                f"this scene, or take {remedies[source]}"
            )
