"""When a scene calls for an effect, and what would be lost without it: one function each, a number and a sentence.

The rules judge the linear wave at its amplitude: exact for symmetries (an L wave along y turns no sphere), a prediction
for sliding and opening. What they miss, the guards see (`granular_lmp.effects.guards`). The table that names the rules is in
`granular_lmp.effects.table`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import exp, hypot, inf
from typing import NamedTuple

import numpy as np

from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import Mode, Physics, contact_stretches, decay_rate, mode_of, row_stretches
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import AUTO
from granular_lmp.scene.shape import FEWEST_COLUMNS

# μ = 5a (adhesion) to 10a (compression) keeps F_t under 0.6 of the sliding force for every mode. Much larger is wrong
# too: LAMMPS skips turning the shear history with the contact while its normal part is below 1e-10 of the sliding
# force, which then freezes it.
FRICTION_PER_AMPLITUDE = 10.0
NOTHING = 1e-12  # of a number of order 1 that a symmetry makes zero


class Finding(NamedTuple):
    """What a rule says: is the effect called for, the number behind it, the sentence that goes on from the number."""

    called_for: bool
    number: float
    reason: str


@dataclass(frozen=True)
class Case:
    """A scene with the effects that have been decided so far."""

    scene: Scene
    on: Mapping[str, bool] = field(default_factory=dict)

    @cached_property
    def mode(self) -> Mode:
        """The mode of the lattice with these effects; those that are not decided yet are on."""
        shear = self.on.get("shear", True)
        return self.mode_with(Physics(shear, self.on.get("rotation", shear)))

    def mode_with(self, physics: Physics) -> Mode:
        """The mode of the scene's wave in a lattice with other physics."""
        return mode_of(self.scene, physics)

    @cached_property
    def stretches(self) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes of the normal and the shear displacement of the contacts, in Δ0.

        Of a driven row also those to the next row, as if that stood still: more than the waves that it sends out do.
        """
        lattice, sphere = unit_lattice(self.scene.sphere), self.scene.sphere
        parts = [contact_stretches(lattice, sphere, self.mode)]
        if self.scene.wave.form == "driven":
            along = self.mode.name == "L"
            parts.append(row_stretches(lattice, 0.0 if along else 1.0, 1.0 if along else 0.0))
        normal, shear = (np.concatenate(each) * self.scene.wave.amplitude for each in zip(*parts, strict=True))
        return normal, shear

    @property
    def no_slip_friction(self) -> float:
        """Friction coefficient per amplitude a at which nothing slides: 10/(1 + s), s the share of adhesion.

        The sliding force at rest is μ(AΔ0^{3/2} + F), and 1 + s that over the force that holds the contact. Dashpots
        push along with the springs: as much more friction as `shear_stiffness` is above κ.
        """
        return (
            FRICTION_PER_AMPLITUDE
            / (1 + self.adhesive_share)
            * self.shear_stiffness
            / self.scene.sphere.stiffness_ratio
        )

    @property
    def shear_stiffness(self) -> float:
        """|κ + 2(κ+3) i c Ω|, spring and dashpot c of a sheared contact, in k1 (k1 t0²/m = 1/(2(κ+3)))."""
        kappa = self.scene.sphere.stiffness_ratio
        dashpot = self.viscosity if self.on.get("damping", True) else 0.0
        return hypot(kappa, 2 * (kappa + 3) * dashpot * self.mode.frequency)

    @property
    def adhesive_share(self) -> float:
        """s = F/(F + F0): how much of the force that holds the contacts at rest is adhesion."""
        return self.scene.sphere.pull_off_force / self.scene.sphere.holding_force

    @property
    def friction(self) -> float:
        """The scene's friction coefficient, or that at which nothing slides."""
        given = self.scene.effects.friction
        return self.no_slip_friction * self.scene.wave.amplitude if given == AUTO else float(given)

    @property
    def viscosity(self) -> float:
        """Dashpot of a contact at rest, in m/t0."""
        effects, sphere = self.scene.effects, self.scene.sphere
        dashpot = effects.viscosity or sphere.restitution_viscosity(effects.restitution)
        return dashpot * sphere.time_scale / sphere.mass

    def largest_slip(self) -> float:
        """Largest shear force of the wave over the sliding force μ(Aδ^{3/2} + F) of the contact that touches least.

        With δ = Δ0(1−x) and F_t = g1 t √(1−x), in units of the force that holds a contact at rest, (2/3) k1 Δ0:

            max 1.5 κ |t| (1−x)^{1/2} / (μ [(1 − max x)^{3/2} + s])

        This is what the guard measures, and never less than the truth. Infinite where contacts without adhesion open.
        """
        cosine = np.cos(np.linspace(0, np.pi, 181))[:, None]
        normal, shear = self.stretches
        overlap = np.maximum(1 - normal * cosine, 0.0)
        force = 1.5 * self.shear_stiffness * float(np.max(np.abs(shear * cosine) * np.sqrt(overlap)))
        limit = self.friction * (float(np.min(overlap)) ** 1.5 + self.adhesive_share)
        return force / limit if limit > 0 else inf


# --- the rules -------------------------------------------------------------------------------------------------------


def adhesion(case: Case) -> Finding:
    material, sphere = case.scene.material, case.scene.sphere
    if material.work_of_adhesion == 0:
        return Finding(False, 0.0, "J/m2 of work of adhesion: Hertz contacts that compression holds")
    holding = material.pull_off_force + sphere.contact_force
    return Finding(True, material.pull_off_force / holding, "of the force that holds the contacts at rest is adhesion")


def shear(case: Case) -> Finding:
    _, shear = contact_stretches(unit_lattice(case.scene.sphere), case.scene.sphere, case.mode)
    largest = float(np.max(np.abs(shear)))
    return Finding(
        largest > NOTHING, largest, f"D0 is the shear displacement of the contact sheared most by {_wave(case)}"
    )


def rotation(case: Case) -> Finding:
    spin = INERTIA_RATIO * case.mode.f**2
    share = spin / (case.mode.ux**2 + case.mode.uy**2 + spin)
    said = f"of the kinetic energy of {_wave(case)} is rotation"
    if case.scene.envelope.width > 0:
        return Finding(True, share, said + ", but at the sides of a beam spheres turn")
    if case.scene.wave.mode == "RT":  # at K along x it does not turn them, but without rotation there is no such branch
        return Finding(True, share, said)
    if share <= NOTHING and case.mode.name == "TR" and case.scene.shape.ends == "fixed":  # at ξ = π
        return Finding(True, share, said + ", but the held rows turn their neighbours")
    return Finding(share > NOTHING, share, said)


def tracking(case: Case) -> Finding:
    angle = case.scene.wave.amplitude * case.mode.f * case.scene.sphere.static_overlap / case.scene.sphere.radius
    return Finding(case.on["rotation"], abs(angle), "rad is the largest angle of a sphere")


def sliding(case: Case) -> Finding:
    ratio = case.largest_slip()
    if case.scene.effects.friction == AUTO:
        return Finding(False, ratio, f"of the sliding force is the largest shear force (friction {case.friction:.3g})")
    return Finding(ratio >= 1, ratio, f"of the sliding force is the largest shear force (friction {case.friction:g})")


def damping(case: Case) -> Finding:
    if case.viscosity == 0:
        return Finding(False, 0.0, "N s/m of viscosity, and no restitution below 1")
    rate = _decay(case)
    left = exp(-rate * case.scene.time.duration)
    if case.scene.wave.form == "driven":
        return Finding(True, rate, "per tau is the decay rate of the wave on its way from the driven row")
    return Finding(True, rate, f"per tau is the decay rate of the wave, of which {left:.3g} is left at the end")


def contact_opening(case: Case) -> Finding:
    smallest = 1 - float(np.max(np.abs(case.stretches[0])))
    if smallest > 0:
        return Finding(False, smallest, "of the static overlap is left at the contact that is pulled most")
    return Finding(True, -smallest, "of the static overlap is how far the contact that is pulled most opens")


def walls(case: Case) -> Finding:
    if case.scene.shape.ends == "periodic":
        return Finding(False, float(case.scene.shape.rows), "rows in a periodic cell are the infinite lattice")
    return Finding(True, case.scene.echo_time, "tau is when the held rows are heard at the centre")


def width(case: Case) -> Finding:
    columns = float(case.scene.shape.columns)
    if case.scene.uniform_rows:
        return Finding(False, columns, f"columns; {FEWEST_COLUMNS} stand for any number where all of a row move alike")
    return Finding(True, columns, "columns; the spheres of a row do not move alike in this wave")


def _wave(case: Case) -> str:
    return f"{'an' if case.mode.name in ('L', 'RT') else 'a'} {case.mode.name} wave"


def _decay(case: Case) -> float:
    shear = case.on.get("shear", True)
    return decay_rate(unit_lattice(case.scene.sphere), case.scene.sphere, case.mode, case.viscosity, shear=shear)


# --- what is lost ----------------------------------------------------------------------------------------------------


def without_adhesion(case: Case) -> str:
    material, sphere = case.scene.material, case.scene.sphere
    force = material.pull_off_force + sphere.contact_force
    left = (sphere.contact_force / force) ** (2 / 3) if force else 0.0
    return f"the static overlap falls to {left:.3g} of its value"


def without_shear(case: Case) -> str:
    return _frequency_shift(case, Physics(shear=False, rotation=False))


def without_rotation(case: Case) -> str:
    if case.scene.envelope.width > 0:
        return "the sides of a beam, where spheres turn, are wrong"
    return _frequency_shift(case, Physics(shear=case.on.get("shear", True), rotation=False))


def _frequency_shift(case: Case, physics: Physics) -> str:
    if case.scene.wave.mode == "RT":
        return "there is no RT wave"
    full, less = case.mode_with(Physics()).frequency, case.mode_with(physics).frequency
    return f"the frequency is {less:.4g} per tau instead of {full:.4g}: {abs(less / full - 1):.2%} off"


def without_sliding(case: Case) -> str:
    return f"shear forces grow to {case.largest_slip():.3g} of what friction bears"


def without_damping(case: Case) -> str:
    return f"nothing decays, where {exp(-_decay(case) * case.scene.time.duration):.3g} of the wave should be left"


# --- what cannot be --------------------------------------------------------------------------------------------------


def no_friction(case: Case) -> str:
    """Why contacts cannot be let slide, or be kept from it; "" if they can."""
    if case.scene.effects.friction != AUTO:
        return ""
    if case.on["sliding"]:
        return "effects.sliding = true: needs effects.friction, the Coulomb coefficient, a number in (0, 1e4]"
    if case.on["shear"] and case.largest_slip() >= 1:
        return (
            'effects.friction = "auto": must be a number in (0, 1e4], as in so strong a wave contacts that open slide '
            "before"
        )
    return ""


def no_dashpot(case: Case) -> str:
    """Why contacts cannot be damped; "" if they can."""
    effects = case.scene.effects
    if not case.on["damping"]:
        return ""
    if case.viscosity == 0:
        return "effects.damping = true: needs effects.viscosity above 0 or effects.restitution below 1"
    if effects.restitution < 1 and case.on["adhesion"]:
        return (
            f"effects.restitution = {effects.restitution!r}: LAMMPS has it for contacts without adhesion only; "
            "use effects.viscosity, or effects.adhesion = false with packing.contact_force"
        )
    return ""
