"""Which theory for which wave: one table of what this folder can say about p(τ), q(τ), φ(τ), and a rule that picks.

Every theory is a function of a `Wave` and of times; they differ in what they leave out:

| name | what it holds beyond the linear wave | fails |
|---|---|---|
| second-order | the second harmonic: the paper's order | as the phase drifts, σa²τ; at resonance and antiresonance |
| frequency-shift | and the drift of the fundamental | p is still the paper's |
| three-mode | and all exchange of energy with 2ξ and 3ξ | p at the antiresonance |
| hierarchy | all waves to order a⁶, every law | once any correction has grown large: long times |
| exact-lattice | everything: the lattice itself, integrated, not a formula | when contacts open |

A scene may call for other physics than the paper's (`Physics`). What each theory holds of it stands in
`analysis.theory.catalogue`, and nothing else is held. With compression, frequency shift and three waves lack
corrections of relative order η, as they do without. Contacts that slide or open are in none, and what is no running
plane wave is compared by other scripts (`catalogue.script_for`).

`best` takes the hierarchy where its own last orders say that it has converged, and at the antiresonance, where nothing
else gives p; else three-mode, which holds for long times near the resonance, or the exact lattice where three-mode
leaves out what the scene has.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from analysis.second_harmonic import Mode, ModeName, Ratios, mode, second_order
from analysis.theory import catalogue, directions
from analysis.theory.frequency_shift import shifted_second_order
from analysis.theory.hierarchy import hierarchy, hierarchy_orders
from analysis.theory.lattice import Effects, Law, torus
from analysis.theory.laws import shear_law_ratios
from analysis.theory.resonance import three_mode
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Trajectory = tuple[Floats, Floats, Floats]


class TheoryError(ValueError):
    """A theory asked for that there is not, or that leaves out what the run has."""


ALONG_Y = 90.0  # degrees
# Effects that have a field of their own in `Physics`
_FIELDS = frozenset({"shear", "rotation", "damping", "sliding", "contact_opening"})


@dataclass(frozen=True)
class Physics:
    """The physics of a run, in the words of `lattice.contact`, whether contacts were let slide or open, and what waves.

    prestress is F0/(F0 + adhesive force); viscosity is in m/t0; direction is that of k, degrees from a close-packed row
    (90: the paper's y); form is that of the scene, and finite says whether the wave has an envelope. others are the
    names of all traits that have no field here.
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
    finite: bool = False
    others: frozenset[str] = frozenset()

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
    def traits(self) -> frozenset[str]:
        """All that a theory must hold, in the words of `analysis.theory.catalogue`."""
        present = {
            "effects.shear" if self.shear else catalogue.NO_SHEAR: True,
            "effects.rotation" if self.rotation else catalogue.NO_ROTATION: True,
            catalogue.said("effects.shear_law", self.law): self.shear,
            catalogue.COMPRESSED: self.prestress > 0,
            catalogue.DAMPING: self.viscosity > 0 or self.restitution is not None,
            catalogue.SLIDING: self.sliding,
            catalogue.OPENING: self.opening,
            catalogue.said("wave.form", self.form): True,
            catalogue.ENVELOPE: self.finite,
            catalogue.OBLIQUE: self.direction != ALONG_Y,
        }
        return self.others.union(name for name, there in present.items() if there)


def physics_of(record: Record) -> Physics:
    """The physics of a run: the one place that knows where scene and ``run.json`` say it.

    A record without ``run.json`` has the effects that its scene switches, and those that are "auto" at their usual.
    """
    scene, sphere, declared = record.scene, record.scene.sphere, record.scene.effects
    effects, guards = record.info.get("effects", {}), record.info.get("guards", {})
    on = {name: value for name, value in vars(declared).items() if isinstance(value, bool)}
    on |= {name: effect["on"] for name, effect in effects.items()}
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
        opening=effects.get("contact_opening", {}).get("called_for", False)
        or guards.get("open_contacts", {}).get("passed_at") is not None,
        direction=scene.direction,
        form=scene.wave.form,
        finite=scene.envelope.finite,
        others=_others(scene, on),
    )


def _others(scene: Any, on: Mapping[str, bool]) -> frozenset[str]:
    """Return the traits that have no field in `Physics`: mode, ends, effects that are on, and keys that none knows."""
    unknown = {
        key
        for key, value in scene.departures().items()
        if key not in {"name", *catalogue.KEYS} and not (key.startswith("effects.") and value is False)
    }
    return frozenset(
        {catalogue.said("wave.mode", scene.wave.mode), catalogue.said("packing.ends", scene.shape.ends)}
        | {f"effects.{name}" for name, there in on.items() if there and name not in _FIELDS}
        | unknown
    )


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
        """The wave that a run started with, in LAMMPS's contact geometry.

        Raises TheoryError for a run with anything that no theory knows.
        """
        wave, physics = record.scene.wave, physics_of(record)
        unknown = physics.traits - catalogue.KNOWN
        if unknown:
            raise TheoryError(f"no theory here holds {', '.join(sorted(unknown))}")
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


def holding(physics: Physics) -> list[str]:
    """Names of the theories that hold all of the physics."""
    return [name for name in THEORIES if not catalogue.missing(name, physics.traits)]


def beyond(physics: Physics) -> list[str]:
    """Return what keeps the physics from the theory that lacks least of it; nothing if one holds it all."""
    return min((catalogue.missing(name, physics.traits) for name in THEORIES), key=len)


def trajectory(name: str, wave: Wave, tau: Floats) -> Trajectory:
    """p, q, φ of a theory; TheoryError if there is none of that name or it leaves out what the wave's contacts do."""
    if name not in THEORIES:
        raise TheoryError(f"theory = {name!r} is not one of {', '.join(THEORIES)}")
    missing = catalogue.missing(name, wave.physics.traits)
    if missing:
        allowed = ", ".join(holding(wave.physics)) or "none"
        raise TheoryError(f"theory = {name!r} leaves out {', '.join(missing)}; that hold it: {allowed}")
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
        raise TheoryError(f"no theory here holds {', '.join(beyond(wave.physics))}")
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
