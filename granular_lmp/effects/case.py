"""Case for the functions of an effect: a scene with the effects that have been decided so far.

It provides the numbers for the rules: stretch and slip of contacts, strengths, friction, dashpots.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from math import exp, hypot, inf
from typing import NamedTuple

import numpy as np

from granular_lmp.crystal.adhesion_laws import AdhesionLaw
from granular_lmp.crystal.blocks import blocks
from granular_lmp.crystal.contacts import FACTORS, Contacts, Floats
from granular_lmp.crystal.mode import Mode, Physics
from granular_lmp.crystal.modes import contact_stretches, decay_rate, highest_frequency, row_stretches
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.rest.at_rest import contacts_of, crystal_of, law_at_rest, swiftness
from granular_lmp.rest.linear import mode_of, physics_of, unit_contacts, viscosity_of, wave_contacts
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.schema import AUTO
from granular_lmp.scene.sources import ROTATION

# μ = 5a (adhesion) to 10a (compression) keeps F_t below 0.6 of the sliding force for every mode. A much larger μ is
# wrong too: LAMMPS does not rotate the shear history with the contact while its normal part is below 1e-10 of the
# sliding force, so the history would freeze.
FRICTION_PER_AMPLITUDE = 10.0
_FEW = (
    300  # number of contacts whose slip is computed at every half degree of phase; with more it is every four degrees
)
NOTHING = 1e-12  # rounding of a number of order 1 that is 0 by symmetry


class Finding(NamedTuple):
    """Result of a rule: whether the scene needs the effect, the number behind it, and a sentence with {} for it."""

    called_for: bool
    number: float
    reason: str


@dataclass(frozen=True)
class Case:
    """Scene with the effects that have been decided so far, and a cache of modes and slips."""

    scene: Scene
    on: Mapping[str, bool] = field(default_factory=dict)
    modes: dict[Physics, Mode] = field(default_factory=dict)
    slips: dict[tuple[object, ...], float] = field(default_factory=dict)

    @cached_property
    def mode(self) -> Mode:
        """Bloch mode of the wave in the lattice with these effects; undecided effects count as on."""
        return self.mode_with(self._own_physics)

    @property
    def _own_physics(self) -> Physics:
        """Degrees of freedom with these effects; undecided ones count as on."""
        shear = self.on.get("shear", True)
        return self.physics(shear, self.on.get("rotation", shear), self.rolling)

    def physics(self, shear: bool = True, rotation: bool = True, rolling: float = 0.0) -> Physics:
        """Return the degrees of freedom with some effects, in as many dimensions as the scene has."""
        return Physics(shear, rotation, rolling, space=self.scene.space == 3)

    @property
    def rolling(self) -> float:
        """Stiffness of the contacts against rolling, N/m; 0 if spheres roll freely."""
        declared = self.scene.effects.rolling is not False
        return self.scene.effects.rolling_stiffness if self.on.get("rolling", declared) else 0.0

    def mode_with(self, physics: Physics) -> Mode:
        """Return the mode of the wave in a lattice with these degrees of freedom; it is solved once."""
        if physics not in self.modes:
            self.modes[physics] = mode_of(self.scene, physics)
        return self.modes[physics]

    @cached_property
    def contacts(self) -> Contacts:
        """Contacts at rest: of one sphere in a perfect lattice, or of all spheres in another crystal."""
        return contacts_of(self.scene)

    @property
    def overlaps(self) -> np.ndarray:
        """Overlaps of the contacts at rest, (C,), in Δ0."""
        return self.contacts.overlap / self.scene.sphere.static_overlap

    @property
    def hold(self) -> float:
        """Distance beyond overlap 0 to which a contact of the lattice holds, in Δ0: 0 by the DMT law."""
        return self.scene.sphere.pull_off_distance / self.scene.sphere.static_overlap

    @property
    def ends(self) -> np.ndarray:
        """Overlaps at which the contacts open, in Δ0: (C,), or one for all; 0 by the DMT law."""
        return np.asarray(self._law.pull_off_overlap / self.scene.sphere.static_overlap)

    @cached_property
    def stretches(self) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes of the normal and the shear displacement of the contacts, (C,) each, in Δ0.

        For a driven row they are at least those of its contacts with a next row at rest. For sources, whose fields are
        not known beforehand, they are those of a row moved along x or y by the largest amplitude, and the slip of a
        sphere turned by this amplitude. Strikers and a state add their own bound (`Scene.strike`).
        """
        scene, amplitude = self.scene, self.scene.amplitude
        normal, shear = self._of_mode
        parts = []
        if self._waves:
            along = "y" if self.mode.along_y else "x"
            parts.append(self._with_rows(normal, shear, along if scene.form.driven else ""))
        if scene.source:
            shaken = self._with_rows(normal, shear, "xy")
            if any(each.motion == ROTATION for each in scene.source):
                shaken[1] = np.maximum(np.abs(shaken[1]), 1.0)
            parts.append([each * self.shaken for each in shaken])
        if len(parts) == 1 and not scene.struck:
            return parts[0][0] * amplitude, parts[0][1] * amplitude
        # A bound for any phases
        still = np.zeros_like(normal)
        bounds = (sum((np.abs(each[k]) for each in parts), still) * amplitude + scene.strike for k in (0, 1))
        return next(bounds), next(bounds)

    @property
    def _of_mode(self) -> tuple[np.ndarray, np.ndarray]:
        """Stretch and slip of the contacts in the mode, (C,) each; 0 without a wave."""
        if self.scene.wave is None:
            return np.zeros(len(self.contacts)), np.zeros(len(self.contacts))
        return contact_stretches(self.contacts, self.scene.sphere, self.mode)

    @property
    def _waves(self) -> bool:
        """True if there is a wave, or if it is only the unit of strikes."""
        return self.scene.wave is not None and (self.scene.form.waves or not self.scene.source)

    def _with_rows(self, normal: np.ndarray, shear: np.ndarray, axes: str) -> list[np.ndarray]:
        """Return stretches that are at least those of the contacts of a row moved by 1 along each of some axes."""
        for axis in axes:
            moved = row_stretches(self.contacts, float(axis == "x"), float(axis == "y"))
            normal, shear = (np.maximum(np.abs(a), np.abs(b)) for a, b in zip((normal, shear), moved, strict=True))
        return [normal, shear]

    @property
    def shaken(self) -> float:
        """Largest amplitude of the sources, in units of the amplitude of the wave; 0 without sources."""
        return max((each.largest for each in self.scene.drives), default=0.0)

    @property
    def strength(self) -> float:
        """Largest amplitude of wave and sources together, in units of the amplitude of the wave."""
        return self.shaken + self._waves

    @property
    def no_slip_friction(self) -> float:
        """Friction coefficient per amplitude a at which no contact slides: 10/h.

        The sliding force is μ times the holding force, which is h = 1 + s times the Hertz force at rest, with the share
        s of adhesion. Dashpots add to the force of the springs, so the friction is larger by the ratio of
        `shear_stiffness` to κ. In an imperfect crystal h is that of the weakest contact: from its adhesion only, which
        remains when it opens, or from its force at rest if nothing adheres. Three things raise the friction: sources,
        by the largest of their amplitudes; walls, by their shear stiffness over their holding force; and measured
        stiffnesses, by 4G*/E* over 4/3, the largest value of a material.
        """
        hold = 1 + self.adhesive_share
        if not self.scene.perfect:
            adhesive = self.contacts.adhesive_force.min()
            weakest = adhesive or self.contacts.contact_force.min()
            hold = float(weakest) / self.scene.sphere.holding_force
        stiffer = self.shear_stiffness / self.scene.sphere.stiffness_ratio
        strength = self.strength or 1.0  # strikes without a wave have the friction of their own amplitude
        sphere = self.scene.sphere
        normal, shear = sphere.factors
        stiffer *= max(1.0, 3 * shear * sphere.effective_shear_modulus / (normal * sphere.effective_modulus))
        stiffer *= self._stiffer_walls * float(self._factors[..., 1].max())
        return FRICTION_PER_AMPLITUDE * strength * stiffer / hold if hold > 0 else inf

    @property
    def _factors(self) -> Floats:
        """Factors of the contacts of materials (`granular_lmp.crystal.stiffnesses`); 1 in a perfect crystal."""
        given = None if self.scene.perfect else crystal_of(self.scene).atoms.info.get(FACTORS)
        return np.ones((1, 2, 2)) if given is None else np.asarray(given)

    @property
    def _stiffer_walls(self) -> float:
        """Largest ratio of shear stiffness at rest to holding force of walls, over that of two spheres; at least 1."""
        on_wall, sphere = self.contacts.on_wall, self.scene.sphere
        holding = (self.contacts.adhesive_force + self.contacts.contact_force)[on_wall]
        there = self.contacts.shear_stiffness[on_wall] / holding * sphere.holding_force / sphere.shear_stiffness
        return float(there.max(initial=1.0))

    @property
    def shear_stiffness(self) -> float:
        """Dynamic shear stiffness |κ + 2(κ+3) i c Ω| of spring and dashpot c, in k1 (k1 t0²/m = 1/(2(κ+3)))."""
        return hypot(self.scene.sphere.stiffness_ratio, self.dashpot)

    @property
    def dashpot(self) -> float:
        """Force amplitude D = 2(κ+3) c Ω of the dashpot c of a sheared contact, per displacement, in k1."""
        viscosity = self.viscosity if self.on.get("damping", True) else 0.0
        return 2 * (self.scene.sphere.stiffness_ratio + 3) * viscosity * self.frequency

    @property
    def frequency(self) -> float:
        """Ω of the wave, rad/t0; without a wave the highest frequency of the crystal."""
        scene = self.scene
        if scene.wave is not None:
            return self.mode.frequency
        return highest_frequency(unit_contacts(scene), scene.sphere, physics_of(scene)) * swiftness(scene)

    @property
    def adhesive_share(self) -> float:
        """Share s = F/(F + F0) of adhesion in the force that holds the contacts at rest."""
        return self.scene.sphere.pull_off_force / self.scene.sphere.holding_force

    @property
    def friction(self) -> float:
        """Friction coefficient of the scene, or the one at which no contact slides if it is "auto"."""
        given = self.scene.effects.friction
        return self.no_slip_friction * self.largest_amplitude if given == AUTO else float(given)

    @property
    def largest_amplitude(self) -> float:
        """Amplitude a of waves, sources and strikes together, to which automatic friction is proportional."""
        return (self.scene.amplitude if self.strength else 0.0) + self.struck_amplitude

    @property
    def struck_amplitude(self) -> float:
        """Amplitude a that stands for strikers and a state where friction is as large as an amplitude needs."""
        return self.scene.strike / (self.strength or 1.0) if self.scene.struck else 0.0

    @property
    def swing(self) -> float:
        """Bound on the change of an overlap from rest, in Δ0: two spheres, each moved by all amplitudes together."""
        return 2 * (self.scene.amplitude * self.strength + (self.scene.strike if self.scene.struck else 0.0))

    @property
    def viscosity(self) -> float:
        """Dashpot of a contact at rest, in m/t0."""
        return viscosity_of(self.scene)

    @property
    def strongest_dashpot(self) -> float:
        """Bound on the dashpot of all contacts, N s/m; with a restitution, for forces up to that at rest.

        η = √5 ζ √(m_eff A) δ^{1/4} = √5 ζ √m_eff A^{1/3} f^{1/6} with the force f of the spring.
        """
        scene, crystal = self.scene, crystal_of(self.scene)
        if scene.effects.restitution == 1:
            return scene.effects.viscosity
        radius = float(crystal.atoms.arrays["radius"].max()) * scene.sphere.radius
        stiffest = max(replace(each, radius=radius).normal_coefficient for each in crystal.materials)
        lattice, own = scene.sphere, self.contacts.mass.max()
        stiffest *= float(self._factors[..., 0].max())
        stronger = np.sqrt(own / lattice.mass) * (stiffest / lattice.normal_coefficient) ** (1 / 3)
        return lattice.restitution_viscosity(scene.effects.restitution) * max(float(stronger), 1.0)

    def largest_slip(self) -> float:
        """Return the largest ratio of shear force to sliding force of one contact at one time.

        With the overlap δ = δ0 − n cos ϑ and a dashpot force t D sin ϑ beside that of the spring it is

            max over contacts and phases ϑ of |t| |g(δ) cos ϑ − D sin ϑ| / (μ [f_N(δ) + 2F])

        with the shear stiffness g = B δ^{1/2} and f_N + 2F = A δ^{3/2} + F in the DMT law.

        It is infinite if contacts without adhesion open, because they slide before they open. It is computed once for
        cases with the same lattice, dashpots and adhesion.
        """
        key = self._own_physics, self.dashpot, self.on.get("adhesion", True)
        if key not in self.slips:
            self.slips[key] = self._largest_slip()
        return self.slips[key]

    def _largest_slip(self) -> float:
        (normal, shear), law, overlaps, most = self.stretches, self._law, self.overlaps, 0.0
        friction = self.friction
        for block in blocks(len(shear)):  # only contacts that may slip more than earlier ones, each kind once
            part = law.of(block), overlaps[block], normal[block], shear[block]
            bound = self._slip_bound(friction, *part)
            hard = np.flatnonzero(bound > most)
            which = hard[_different(bound[hard], [each[hard] for each in (*part[0].arrays, *part[1:])])]
            if len(which):
                most = max(most, self._slip(friction, part[0].of(which), *(each[which] for each in part[1:])))
        return most

    def _slip(self, friction: float, law: AdhesionLaw, overlaps: Floats, normal: Floats, shear: Floats) -> float:
        """Return the largest slip of some contacts, phase by phase."""
        fine = self.scene.perfect and len(overlaps) < _FEW
        phase = np.linspace(0, 2 * np.pi, 721 if fine else 91)[:, None]
        sphere = self.scene.sphere
        overlap = (overlaps - normal * np.cos(phase)) * sphere.static_overlap
        closed = overlap > law.pull_off_overlap
        overlap = np.where(closed, overlap, law.pull_off_overlap)
        push = law.shear_stiffness(overlap) / sphere.normal_stiffness * np.cos(phase) - self.dashpot * np.sin(phase)
        force = np.where(closed, np.abs(shear * push), 0.0)
        limit = law.sliding_force(overlap) / (sphere.normal_stiffness * sphere.static_overlap)
        if not self.on.get(
            "adhesion", True
        ):  # Hertz contacts in LAMMPS slide at μ times the force including the dashpot
            limit = np.maximum(limit + self.dashpot * normal * np.sin(phase), 0.0)
        limit = friction * limit
        if np.any((limit == 0) & (np.abs(shear * np.cos(phase)) > NOTHING)):
            return inf
        return float(np.max(np.divide(force, limit, out=np.zeros_like(force), where=limit > 0)))

    def _slip_bound(self, friction: float, law: AdhesionLaw, overlaps: Floats, normal: Floats, shear: Floats) -> Floats:
        """Return an upper bound on the slip of each contact, with all extremes at the same time."""
        sphere, dashpot = self.scene.sphere, self.dashpot
        widest, least = ((overlaps + way * np.abs(normal)) * sphere.static_overlap for way in (1, -1))
        force = law.shear_stiffness(law.nearest(widest)) / sphere.normal_stiffness + dashpot
        limit = law.sliding_force(law.nearest(least)) / (sphere.normal_stiffness * sphere.static_overlap)
        if not self.on.get("adhesion", True):
            limit = limit - dashpot * np.abs(normal)
        limit = friction * np.maximum(limit, 0.0)
        slip = np.abs(shear) * force * (1 + NOTHING)
        return np.asarray(np.divide(slip, limit, out=np.where(slip > 0, inf, 0.0), where=limit > 0))

    @property
    def _law(self) -> AdhesionLaw:
        """Law of the contacts at rest: one law in a perfect lattice without walls, else one for each contact."""
        return law_at_rest(self.scene)

    @property
    def wave_words(self) -> str:
        """Name of the wave with its article: "a TR wave"."""
        return self.mode.words

    @property
    def every_mode(self) -> str:
        """Clause on sources and strikes, which make waves of every mode; "" if there are none."""
        if self.scene.wave is None or self.scene.source or self.scene.struck:
            return "sources and strikes make waves of every mode"
        return ""

    @property
    def decay_rate(self) -> float:
        """Decay rate of the amplitude of the wave due to the dashpots of the contacts, per τ."""
        return decay_rate(
            wave_contacts(self.scene), self.scene.sphere, self.mode, self.viscosity, shear=self.on.get("shear", True)
        )

    @property
    def amplitude_left(self) -> float:
        """Share of the amplitude of the wave that the dashpots leave at the end of the run."""
        return exp(-self.decay_rate * self.scene.time.duration)

    def frequency_shift(self, physics: Physics) -> str:
        """Return words on the change in the frequency of the wave in a lattice with other degrees of freedom."""
        if self.scene.wave is None:
            return "waves have other frequencies"
        full = self.mode_with(self.physics(rolling=self.rolling)).frequency
        try:
            less = self.mode_with(physics).frequency
        except SceneError:
            return f"there is no {self.mode.words.partition(' ')[2]}"
        return f"the frequency is {less:.4g} per tau instead of {full:.4g}: {abs(less / full - 1):.2%} off"


def _different(value: Floats, columns: Sequence[Floats]) -> np.ndarray:
    """Return the indices of the different rows of some columns (C,)."""
    _, first, like = np.unique(value, return_index=True, return_inverse=True)
    others = np.any([each != each[first][like] for each in columns], axis=0)
    return np.append(first, np.flatnonzero(others))
