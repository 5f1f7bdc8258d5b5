"""The error budget: what separates a run from the infinite lattice, the paper's theory from both, and by how much.

All are relative L2 errors over the run, estimated before it from the scene (`granular_lmp.accuracy.step_law` has those of the
time step, the walls and rounding). Two are no errors of the run but of a theory that is compared with it:

- geometry: the paper takes spheres as points of contact, Δ0/R → 0. In LAMMPS η = Δ0/2R makes the inertia Ĩ/(1−η), so
  that Ω falls by ½ηΩ Ĩf²/(Q²+Ĩf²), and changes α and β, hence p;
- perturbation order: second order leaves out the frequency shift σa², or near the resonance what the fundamental gives
  away, gh a²τ²/2, and the p of fourth order:

    σ = −{(ε̂Y/8)[γDq²−(5/√3)βDqSg+2βSg²] + (3C/64)Dq²[Dq²/12+κT²]}/(2Ω(Q²+Ĩf²))        TR, RT
    σ = (Ωε̂²/4)c² − 6χΩ³,  χ = 3(1+κ)/(128(κ+3))                                        L
    Dq = 2sQ, Sg = 2cf, T = (√3/2)Dq − Sg, Y = −ε̂ sin ξ G/(w̃²−4Ω²), C = 1/(2(κ+3)), ε̂ = ε/a

Orders of magnitude, right to a factor of three where a² ≪ 1 and contacts stay closed; no bounds.
"""

from dataclasses import asdict, dataclass, replace
from math import ceil, cos, hypot, sin, sqrt
from typing import Any

import numpy as np

from granular_lmp.accuracy.step_law import (
    Waves,
    rounding,
    second_harmonic_drive,
    signals,
    step_errors,
    step_for,
    walls,
    waves,
)
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.scene.scene import Scene

Errors = dict[str, float]


@dataclass(frozen=True)
class Source:
    """One source of error.

    Attributes
    ----------
    name : str
    of : "run" or "theory"
        Of the run against the infinite lattice, or of the paper's second-order theory against the run.
    p, q, phi : float or None
        Relative L2 errors; None where symmetry makes the signal zero.
    to_halve : str
        What it would take to halve it.
    dominates : tuple of str
        The signals of which it is the largest error.
    """

    name: str
    of: str
    p: float | None
    q: float | None
    phi: float | None
    to_halve: str
    dominates: tuple[str, ...] = ()


def error_budget(scene: Scene, estimate: dict[str, float] | None = None) -> list[Source]:
    """The sources of error of a scene.

    Parameters
    ----------
    scene : Scene
    estimate : dict, optional
        Relative errors of the p, q, φ of an extrapolated record, which take the place of those of a single run.

    Returns
    -------
    list of Source
        Empty for waves whose errors have no law here: other than running plane waves along y.
    """
    if not scene.plane_along_y:
        return []
    w = waves(scene)
    stepped, remedy = _time_step(scene, estimate)
    nothing = dict.fromkeys(stepped, 0.0)
    held = scene.shape.ends == "fixed"
    distance = scene.shape.centre_row
    more = 2 * ceil(0.35 * distance ** (1 / 3))  # Ai falls by half in 0.35 of its width, d^{1/3} rows
    table: list[tuple[str, str, Errors, str]] = [
        ("time step", "run", stepped, remedy),
        (
            "walls",
            "run",
            dict.fromkeys(stepped, walls(scene)),
            f"packing.rows = {scene.shape.rows + more}" if held else "nothing to halve: a periodic cell",
        ),
        ("sampling", "run", nothing, "nothing to halve: records are exact at their times"),
        (
            "rounding",
            "run",
            rounding(scene),
            "wave.amplitude x 2 (p of TR, RT: x 1.41), or half the packing.rows",
        ),
        ("geometry", "theory", _geometry(scene, w), "sphere.radius x 2.83, or a theory with overlap_ratio"),
        ("perturbation order", "theory", _order(scene, w), "wave.amplitude x 0.71, or a theory of higher order"),
    ]
    # An angle that is not tracked has no estimate
    largest = {name: max(errors.get(name, 0.0) for _, _, errors, _ in table) for name in stepped}
    return [
        Source(
            name=label,
            of=of,
            p=errors.get("p"),
            q=errors.get("q"),
            phi=errors.get("phi"),
            to_halve=to_halve,
            dominates=tuple(name for name in largest if errors.get(name) == largest[name]),
        )
        for label, of, errors, to_halve in table
    ]


def as_json(budget: list[Source]) -> list[dict[str, Any]]:
    """The budget as ``run.json`` holds it."""
    return [asdict(source) | {"dominates": list(source.dominates)} for source in budget]


def _time_step(scene: Scene, estimate: dict[str, float] | None) -> tuple[Errors, str]:
    if estimate is not None:
        return estimate, f"time.tolerance = {max(estimate.values()) / 2:.2g}"
    step = scene.time.step if scene.time.tolerance is None else step_for(scene)
    errors = step_errors(scene, step)
    if scene.time.tolerance is None:
        return {name: error.plain for name, error in errors.items()}, f"time.timestep = {step / sqrt(2):.3g}"
    return {
        name: error.extrapolated for name, error in errors.items()
    }, f"time.tolerance = {scene.time.tolerance / 2!r}"


def _geometry(scene: Scene, w: Waves) -> Errors:
    """What η → 0 changes: the frequency of the fundamental, and the drive of the second harmonic."""
    mode, eta = w.mode, scene.sphere.overlap_ratio
    spin = INERTIA_RATIO * mode.f**2
    frequency = mode.frequency * (1 + eta / 2 * spin / (mode.ux**2 + mode.uy**2 + spin))
    drive = second_harmonic_drive(scene, mode, 0.0)
    paper = replace(w, mode=replace(mode, frequency=frequency), drive=drive, drive_size=w.drive_size + drive - w.drive)
    return _change(w, paper)


def _change(w: Waves, other: Waves) -> Errors:
    exact, changed = signals(w, 0.0), signals(other, 0.0)
    return {
        name: float(np.linalg.norm(changed[name] - values) / np.linalg.norm(values)) for name, values in exact.items()
    }


def _order(scene: Scene, w: Waves) -> Errors:
    """What second order leaves out: the drift of the fundamental, and the fourth order of p."""
    a, tau = scene.wave.amplitude, scene.time.duration
    shift, regular, exchange = _third_order(scene, w)
    # The drift grows as τ, the exchange as τ²; over a run their L2 norms are 1/√3 and 1/√5 of those at its end
    drifting = _change(w, replace(w, mode=replace(w.mode, frequency=w.mode.frequency + shift * a * a)))
    exchanging = abs(regular) * a * a * tau / sqrt(3) + abs(exchange) * (a * tau) ** 2 / (2 * sqrt(5))
    errors = {name: min(drift, exchanging) for name, drift in drifting.items()}
    if "p" in errors and w.mode.name != "L":
        errors["p"] = hypot(errors["p"], sqrt(max(w.drive_size**2 - w.drive**2, 0.0)) / max(abs(w.drive), 1e-300))
    return errors


def _third_order(scene: Scene, w: Waves) -> tuple[float, float, float]:
    """(σ, its part that is regular on resonance, gh): `analysis.frequency_shift` and `.resonance` derive them."""
    mode, kappa, xi = w.mode, scene.sphere.stiffness_ratio, w.mode.wavenumber
    q, f, omega = -mode.ux, mode.f, mode.frequency
    s, c, sine = sin(xi / 2), cos(xi / 2), sin(xi)
    epsilon = scene.sphere.nonlinearity(1.0)
    if mode.name == "L":
        shift = omega * epsilon**2 / 4 * c * c - 6 * 3 * (1 + kappa) / (128 * (kappa + 3)) * omega**3
        return shift, shift, 0.0
    beta, gamma = 2 * kappa / (2 * kappa + 3), (2 * kappa + 1) / (2 * kappa + 3)
    dq, sg = 2 * s * q, 2 * c * f
    slip = sqrt(3) / 2 * dq - sg
    inertia = 2 * omega * (q * q + INERTIA_RATIO * f * f)
    bracket = gamma * dq * dq - 5 / sqrt(3) * beta * dq * sg + 2 * beta * sg * sg
    g = 2 * w.drive / (scene.wave.amplitude * epsilon)  # G
    regular = -3 / (128 * (kappa + 3)) * dq * dq * (dq * dq / 12 + kappa * slip * slip) / inertia
    product = epsilon**2 * sine * g * bracket / inertia
    detuning = w.free**2 - 4 * omega**2
    singular = product / (8 * detuning) if detuning else 0.0
    return singular + regular, regular, product / (16 * w.free)
