"""Which theory for which wave: one table of what this folder can say about p(τ), q(τ), φ(τ), and a rule that picks.

Every theory is a function of a `Wave` and of times; they differ in what they leave out:

| name | what it holds beyond the linear wave | fails |
|---|---|---|
| second-order | the second harmonic: the paper's order | as the phase drifts, σa²τ; at resonance and antiresonance |
| frequency-shift | and the drift of the fundamental | p is still the paper's |
| three-mode | and all exchange of energy with 2ξ and 3ξ | p at the antiresonance |
| hierarchy | all waves to order a⁶, every law | once any correction has grown large: long times |
| exact-lattice | everything: the lattice itself, integrated, not a formula | when contacts open |

A scene may call for other physics than the paper's (`Physics`). All five hold compression in place of adhesion, no
rotation and no shear; what else one leaves out is in `LEAVES_OUT`. With compression, frequency shift and three waves
lack corrections of relative order η, as they do without; they are for waves along y only. Contacts that slide or open
are in none, and what is no running plane wave is compared elsewhere (`FORMS`).

`best` takes the hierarchy where its own last orders say that it has converged, and at the antiresonance, where nothing
else gives p; else three-mode, which holds for long times near the resonance, or the exact lattice where three-mode
leaves out what the scene has.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from analysis import directions
from analysis.frequency_shift import shifted_second_order
from analysis.hierarchy import hierarchy, hierarchy_orders
from analysis.lattice import Effects, Law, torus
from analysis.laws import shear_law_ratios
from analysis.resonance import three_mode
from analysis.second_harmonic import Mode, ModeName, Ratios, mode, second_order
from granular_lmp.record import Record

Floats = NDArray[np.float64]
Trajectory = tuple[Floats, Floats, Floats]


class TheoryError(ValueError):
    """A theory asked for that there is not, or that leaves out what the run has."""


ALONG_Y = 90.0  # degrees
OBLIQUE = "another direction than y"
# What is no running plane wave, in words, and the script that compares it with its theory
FORMS = {
    "standing": ("a standing wave", "analysis.standing"),
    "driven": ("a driven wave", "analysis.driven"),
    "finite": ("a wave with an envelope, or a standing one of another direction,", "analysis.sheets"),
    "between walls": ("a wave with an envelope between held rows", ""),
    "driven beam": ("a beam of a driven row", ""),
}


@dataclass(frozen=True)
class Physics:
    """The physics of a run, in the words of `lattice.contact`, whether contacts were let slide or open, and what waves.

    prestress is F0/(F0 + adhesive force); viscosity is in m/t0; direction is that of k, degrees from a close-packed row
    (90: the paper's y); form is "running" or one of `FORMS`.
    """

    poisson_ratio: float
    overlap_ratio: float
    prestress: float = 0.0
    law: Law = "secant"
    shear: bool = True
    rotation: bool = True
    viscosity: float = 0.0
    restitution: float | None = None
    sliding: bool = False
    opening: bool = False
    direction: float = ALONG_Y
    form: str = "running"

    @property
    def effects(self) -> Effects:
        """The arguments of `lattice.contact` beyond ν."""
        return {
            "law": self.law,
            "overlap_ratio": self.overlap_ratio,
            "prestress": self.prestress,
            "shear": self.shear,
            "rotation": self.rotation,
            "viscosity": self.viscosity,
            "restitution": self.restitution,
        }

    @property
    def springs(self) -> directions.Contacts:
        """The arguments of `springs.springs` beyond ν and Ĩ, for waves of any direction."""
        return {
            "law": "incremental" if self.law == "incremental" else "secant",
            "overlap_ratio": self.overlap_ratio,
            "prestress": self.prestress,
            "shear": self.shear,
            "rotation": self.rotation,
        }

    @property
    def ratios(self) -> Ratios:
        """Constants of the closed forms; they know nothing of damping and sliding."""
        return shear_law_ratios(
            self.poisson_ratio,
            self.law,
            overlap_ratio=self.overlap_ratio,
            prestress=self.prestress,
            shear=self.shear,
            rotation=self.rotation,
        )

    @property
    def beyond_the_paper(self) -> frozenset[str]:
        """What of it not every theory holds, in the words of `LEAVES_OUT`."""
        present = {
            "damping": self.viscosity > 0 or self.restitution is not None,
            "incremental": self.law == "incremental",
            "sliding": self.sliding,
            "opening": self.opening,
            OBLIQUE: self.direction != ALONG_Y,
            **{form: self.form == form for form in FORMS},
        }
        return frozenset(name for name, there in present.items() if there)


def physics_of(record: Record) -> Physics:
    """The physics of a run: the one place that knows where scene and ``run.json`` say it.

    A record without ``run.json`` has what its scene has and every effect at its usual.
    """
    scene, sphere, declared = record.scene, record.scene.sphere, record.scene.effects
    effects = record.info.get("effects", {})
    on = {name: effect["on"] for name, effect in effects.items()}
    damped = on.get("damping", True)
    return Physics(
        poisson_ratio=sphere.poisson_ratio,
        overlap_ratio=sphere.overlap_ratio,
        prestress=sphere.contact_force / sphere.holding_force,
        law=declared.shear_law,  # type: ignore[arg-type]  # checked by the scene
        shear=on.get("shear", True),
        rotation=on.get("rotation", True),
        viscosity=declared.viscosity * sphere.time_scale / sphere.mass if damped else 0.0,
        restitution=declared.restitution if damped and declared.restitution < 1 else None,
        sliding=on.get("sliding", False),
        opening=effects.get("contact_opening", {}).get("called_for", False),
        direction=scene.direction,
        form=_form(scene),
    )


def _form(scene: Any) -> str:
    """The form of a scene's wave, "running" or a key of `FORMS`."""
    declared, finite = scene.wave.form, scene.envelope.finite
    if declared == "driven":
        return "driven beam" if finite else "driven"
    if finite and scene.shape.ends == "fixed":
        return "between walls"
    return "finite" if finite or (declared == "standing" and scene.direction != ALONG_Y) else declared


@dataclass(frozen=True)
class Wave:
    """What a theory needs to know: the mode at τ=0, its amplitude D0/Δ0 and phase, and the physics of the contacts."""

    mode: Mode
    ratios: Ratios
    amplitude: float
    phase: float
    physics: Physics

    @classmethod
    def of(cls, record: Record) -> Self:
        """The wave that a run started with, in LAMMPS's contact geometry."""
        wave, physics = record.scene.wave, physics_of(record)
        constants = physics.ratios
        linear = linear_mode(wave.mode, record.scene.wavenumber, physics)  # type: ignore[arg-type]  # checked by the scene
        return cls(linear, constants, wave.amplitude, wave.phase, physics)


def linear_mode(name: ModeName, wavenumber: float, physics: Physics) -> Mode:
    """The mode of the linear lattice, in the closed form along y."""
    if physics.direction == ALONG_Y:
        return mode(name, wavenumber, physics.ratios)
    return directions.mode(name, wavenumber, physics.direction, physics.poisson_ratio, **physics.springs)


def _closed(formula: Callable[..., Trajectory]) -> Callable[[Wave, Floats], Trajectory]:
    """A formula of mode, ratios, amplitude, tau and phase as a theory."""

    def theory(wave: Wave, tau: Floats) -> Trajectory:
        return formula(wave.mode, wave.ratios, wave.amplitude, tau, phase=wave.phase)

    return theory


def _second_order(wave: Wave, tau: Floats) -> Trajectory:
    """The paper's order, in closed form along y."""
    if wave.physics.direction == ALONG_Y:
        return second_order(wave.mode, wave.ratios, wave.amplitude, tau, phase=wave.phase)
    physics = wave.physics
    return directions.trajectory(
        wave.mode, wave.amplitude, tau, physics.poisson_ratio, phase=wave.phase, **physics.springs
    )


def _integrated(method: Callable[..., Trajectory]) -> Callable[[Wave, Floats], Trajectory]:
    """An integration of mode, amplitude, tau, ν and effects as a theory."""

    def theory(wave: Wave, tau: Floats) -> Trajectory:
        return method(
            wave.mode, wave.amplitude, tau, wave.physics.poisson_ratio,
            phase=wave.phase, rtol=1e-10, **wave.physics.effects,
        )  # fmt: skip

    return theory


THEORIES: dict[str, Callable[[Wave, Floats], Trajectory]] = {
    "second-order": _second_order,
    "frequency-shift": _closed(shifted_second_order),
    "three-mode": _closed(three_mode),
    "hierarchy": _integrated(hierarchy),
    "exact-lattice": _integrated(torus),
}

# A contact that opens keeps its adhesive force in the paper's law, and loses it in LAMMPS.
BEYOND_ALL = frozenset({"sliding", "opening", *FORMS})
# Beside the shear law, cubic springs and dashpots enter the coefficients of the two that describe slow amplitudes.
LEAVES_OUT: dict[str, frozenset[str]] = {
    "second-order": frozenset({"damping", *BEYOND_ALL}),
    "frequency-shift": frozenset({"damping", "incremental", OBLIQUE, *BEYOND_ALL}),
    "three-mode": frozenset({"damping", "incremental", OBLIQUE, *BEYOND_ALL}),
    "hierarchy": BEYOND_ALL,
    "exact-lattice": BEYOND_ALL,
}


def holding(physics: Physics) -> list[str]:
    """Names of the theories that leave out nothing of the physics."""
    return [name for name in THEORIES if not LEAVES_OUT[name] & physics.beyond_the_paper]


def trajectory(name: str, wave: Wave, tau: Floats) -> Trajectory:
    """p, q, φ of a theory; TheoryError if there is none of that name or it leaves out what the wave's contacts do."""
    if name not in THEORIES:
        raise TheoryError(f"theory = {name!r} is not one of {', '.join(THEORIES)}")
    missing = LEAVES_OUT[name] & wave.physics.beyond_the_paper
    if missing:
        allowed = ", ".join(holding(wave.physics)) or "none"
        raise TheoryError(f"theory = {name!r} leaves out {', '.join(sorted(missing))}; that hold it: {allowed}")
    return _computed(name, wave, tuple(np.asarray(tau, dtype=float).tolist()))


@lru_cache(maxsize=8)  # a table and its figure ask for the same two or three of each run
def _computed(name: str, wave: Wave, times: tuple[float, ...]) -> Trajectory:
    p, q, phi = (np.asarray(values) for values in THEORIES[name](wave, np.array(times)))
    for values in (p, q, phi):
        values.flags.writeable = False  # they are handed out again
    return p, q, phi


SILENT = 1e-9  # D0 per D0: rounding of what a symmetry makes zero stays below, p of a shear wave above from a = 1e-7 on
CONVERGED = 0.02  # of any component, in the two last orders of the hierarchy: the error is then smaller still
LONGEST = 400.0  # τ; orders grow with time, and the hierarchy is not tried beyond


def best(wave: Wave, tau: Floats) -> str:
    """Name of the theory that holds best for the wave at the times, by the module's rule.

    Raises TheoryError if none holds its physics.
    """
    allowed = holding(wave.physics)
    if not allowed:
        raise TheoryError(f"no theory here holds {', '.join(sorted(wave.physics.beyond_the_paper))}")
    if drive_cancels(wave) or (tau[-1] <= LONGEST and last_orders(wave, tau) < CONVERGED):
        return "hierarchy"
    return "three-mode" if "three-mode" in allowed else "exact-lattice"


def last_orders(wave: Wave, tau: Floats) -> float:
    """How much the two last orders of the hierarchy add to p, q or φ, whichever is worst: relative, over all rows.

    A component that is silent beside the largest, zero by symmetry, is left out: it is rounding, as are its orders.
    """
    few = np.linspace(tau[0], tau[-1], 61)
    orders = hierarchy_orders(wave.mode, few, wave.physics.poisson_ratio, rtol=1e-6, **wave.physics.effects)
    terms = orders * (wave.amplitude ** np.arange(len(orders)))[:, None, None, None]  # as (order, T, component, K)
    tail, total = (np.sqrt(np.sum(part.sum(axis=0) ** 2, axis=(0, 2))) for part in (terms[-2:], terms))
    moves = total > SILENT * np.max(total)
    return float(np.max(tail[moves] / total[moves]))


def drive_cancels(wave: Wave) -> bool:
    """Whether the second harmonic of a TR wave is below the next order: its antiresonance, at this amplitude.

    The two terms of the drive, αs²Q and (β/√3) sin ξ f, cancel there. What is left of them is to be compared with the
    next order, which is smaller by a². From a = 1 on contacts open, and no order means anything. In other directions
    the second harmonic has three components, which do not vanish together.
    """
    if wave.physics.direction != ALONG_Y:
        return False
    return wave.mode.name == "TR" and wave.amplitude < 1 and cancellation(wave) < wave.amplitude**2


def cancellation(wave: Wave) -> float:
    """|A − B|/(|A| + |B|) of the terms A = αs²Q, B = (β/√3) sin ξ f of the drive of TR; 0 where p vanishes."""
    xi, constants = wave.mode.wavenumber, wave.ratios
    by_translation = constants.alpha * np.sin(xi / 2) ** 2 * wave.mode.q
    by_rotation = constants.beta / np.sqrt(3) * np.sin(xi) * wave.mode.f
    both = abs(by_translation) + abs(by_rotation)
    return float(abs(by_translation - by_rotation) / both) if both else 0.0
