"""Collision of two equal spheres, or of a sphere with a rigid plane: a short declaration of a scene.

A collision tests one contact. The bodies touch at t = 0 with overlap 0; the normal of the first sphere at the contact
is +x, its tangent +y, and spins are about z. The scene that it declares (`Collision.scene_tables`) has one body above
the other: there the normal is +y and the tangent −x. `granular_lmp.studies.collide` reads the results.

With the law "jkr" the contact snaps in at overlap 0, where it pulls with (8/9) F at once. It holds until the pull
reaches its maximum F; with ``contact.parting = "distance"``, until the distance reaches its maximum
(`Collision.pull_off_distance`).
"""

from collections.abc import Mapping
from math import ceil, gamma, pi, sqrt
from pathlib import Path
from typing import Any, Self

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, HERTZ, NORMAL_LAWS, SKIN, AdhesionLaw, Dmt, words_of_laws
from granular_lmp.crystal.lattices import FREE, SQUARE, WALL
from granular_lmp.crystal.scale import LARGEST_OVERLAP_RATIO
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.bodies import SPHERE_RULES
from granular_lmp.scene.document import Document, Layout
from granular_lmp.scene.files import first_file
from granular_lmp.scene.records import declared_keys
from granular_lmp.scene.schema import allowed_names, choice, count, number
from granular_lmp.scene.sections import DISTANCE, LOAD, RESCALED, SHEAR_LAWS
from granular_lmp.scene.shipped import SHIPPED
from granular_lmp.scene.start import Start
from granular_lmp.scene.strikers import scale_of

__all__ = ["Collision"]

TANGENTIAL_LAWS = (*SHEAR_LAWS, RESCALED, "none")
RECORDS = 500  # fewest records in a contact time
LONGEST_PATH = 100.0  # radii; LAMMPS cuts the box into bins of a radius, here 8e6 bins
_SLACK = 1e-12  # makes the step longer by less than the slack of a sample, so that rounding does not make it shorter
_SHIPPED_COLLISIONS = SHIPPED / "collisions"
# ∫₀¹ dx/√(1 − x^{5/2}) = √π Γ(7/5)/Γ(9/10): half of a Hertz contact time, in units of depth over speed
_HALF_CONTACT = sqrt(pi) * gamma(7 / 5) / gamma(9 / 10)


@dataclass(frozen=True)
class Contact:
    """Contact law."""

    normal: str = choice(f"hertz: without adhesion; {words_of_laws()}", NORMAL_LAWS, default="dmt")
    shear: str = choice("law of the shear force", TANGENTIAL_LAWS, default="secant")
    parting: str = choice(
        "where a jkr contact ends: at the largest pull, or distance (needs the kernel)", (LOAD, DISTANCE), default=LOAD
    )
    friction: float = number("", "mu", 0.0, 1e4, default=0.0)
    restitution: float = number("", "e, for an impact along the normal", 0.01, 1.0, default=1.0)
    shear_damping: float = number("", "dashpot of shear over dashpot of normal motion", 0.0, 100.0, default=0.0)


@dataclass(frozen=True)
class Impact:
    """Initial velocities and spins of the bodies."""

    partner: str = choice("an equal sphere, or a rigid plane", ("sphere", "plane"))
    normal_velocity: float = number("m/s", "of each sphere towards the contact", 1e-9, 1e4)
    tangential_velocity: float = number("m/s", "of the first sphere", -1e4, 1e4, default=0.0)
    spin: float = number("rad/s", "of the first sphere", -1e12, 1e12, default=0.0)
    partner_spin: float = number("rad/s", "of the second sphere", -1e12, 1e12, default=0.0)
    duration: float = number("", "elastic contact times", 1.1, 100.0, default=2.0)
    steps: int = count("to an elastic contact time", 100, 10_000_000, default=10_000)


@dataclass(frozen=True)
class Collision(Document):
    """One collision: its sphere, contact law and impact.

    Raises
    ------
    SceneError
        If the values contradict each other: a restitution below 1 with adhesion, the law "jkr" without adhesion, a spin
        of the plane, adhesion that reaches beyond the neighbour list, or an impact so fast that the overlap is not
        small.
    """

    layout = Layout(
        sections={"sphere": Sphere, "contact": Contact, "collision": Impact}, rules={"sphere": SPHERE_RULES}
    )

    sphere: Sphere
    contact: Contact
    collision: Impact

    def __post_init__(self) -> None:
        if self.contact.normal != HERTZ and self.contact.restitution < 1:
            raise SceneError(
                f"contact.restitution = {self.contact.restitution!r}: must be 1 with contact.normal = "
                f'"{self.contact.normal}"; LAMMPS has no law of restitution with adhesion; use "hertz"'
            )
        if self._law.beyond and not self.sphere.work_of_adhesion:
            raise SceneError(
                f"sphere.work_of_adhesion = {self.sphere.work_of_adhesion!r}: must be above 0 with contact.normal = "
                f'"{self.contact.normal}"; use "hertz" without adhesion'
            )
        if self.collision.partner == "plane" and self.collision.partner_spin:
            raise SceneError(
                f"collision.partner_spin = {self.collision.partner_spin!r}: must be 0, as the plane is at rest"
            )

        reach = self.pull_off_distance / self.sphere.radius
        if reach > SKIN:
            raise SceneError(
                f"sphere.work_of_adhesion = {self.sphere.work_of_adhesion!r}: the contact would hold until {reach:.3g} "
                f"radii beyond overlap 0; must be at most {SKIN}, where the neighbour list of LAMMPS ends"
            )
        ratio = (self.elastic_overlap + self.static_overlap) / (2 * self.sphere.radius)
        if ratio > LARGEST_OVERLAP_RATIO:
            raise SceneError(
                f"collision.normal_velocity = {self.collision.normal_velocity!r}: the overlap would be {ratio:.3g} "
                f"of the diameter; at most {LARGEST_OVERLAP_RATIO} is allowed"
            )
        speed = abs(self.collision.tangential_velocity) + self.collision.normal_velocity
        path = speed * self.collision.duration * self.elastic_contact_time / self.sphere.radius
        if path > LONGEST_PATH:
            raise SceneError(
                f"collision.tangential_velocity = {self.collision.tangential_velocity!r}: the sphere would travel "
                f"{path:.3g} radii in collision.duration; at most {LONGEST_PATH:g} are allowed"
            )

    # --- reading and writing ---

    @classmethod
    def load(cls, source: str | Path, changes: Mapping[str, Any] | None = None) -> Self:
        """Return a collision from a TOML file, or a shipped one by its name, as for `Scene.load`."""
        found = first_file(source, (Path(source), _SHIPPED_COLLISIONS / f"{source}.toml"))
        if found is None:
            shipped = sorted(path.stem for path in _SHIPPED_COLLISIONS.glob("*.toml"))
            raise SceneError(f"{source}: no such collision; {allowed_names(str(source), shipped, 'shipped')}")
        return cls.read(found, changes)

    @classmethod
    def has(cls, key: str) -> bool:
        """Return whether a collision has a dotted key."""
        keys = {table: declared_keys(kind, cls.layout.rules.get(table)) for table, kind in cls.layout.sections.items()}
        return key in ("name", "description", *(f"{table}.{each.name}" for table in keys for each in keys[table]))

    @classmethod
    def _completed(cls, tables: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the tables with the defaults: a contact, and spheres without adhesion."""
        given = {"contact": {}, **tables}
        if isinstance(given.get("sphere"), Mapping):
            given["sphere"] = {"work_of_adhesion": 0.0, **given["sphere"]}  # spheres that meet need not be adhesive
        return given

    def scene_tables(self) -> dict[str, Any]:
        """Return the scene in which the bodies collide, as `Scene.from_dict` takes it."""
        sphere, law, impact = self.sphere, self.contact, self.collision
        turns = (impact.spin, impact.partner_spin) if self.rubs else (0.0, 0.0)
        state = [(0, 0, 0.0, 0.0, -impact.tangential_velocity, impact.normal_velocity, turns[0])]
        state += [] if self.on_plane else [(1, 0, 0.0, 0.0, 0.0, -impact.normal_velocity, turns[1])]
        declared = {key: getattr(sphere, key) for key in ("radius", "youngs_modulus", "poisson_ratio", "density")}
        if adhesive := law.normal != HERTZ and sphere.work_of_adhesion > 0:
            declared |= {"work_of_adhesion": sphere.work_of_adhesion, "adhesion_law": law.normal}
        every = max(impact.steps // RECORDS, 1)
        unit = scale_of((), Start(state), sphere).time
        step = self.elastic_contact_time / impact.steps / unit
        effects: dict[str, Any] = {"friction": law.friction, "shear_law": law.shear} if self.rubs else {}
        effects |= {"restitution": law.restitution, "shear_damping": law.shear_damping} if law.restitution < 1 else {}
        effects |= {"parting": DISTANCE} if law.parting == DISTANCE else {}
        return {
            "name": self.name,
            "description": self.description,
            "sphere": declared,
            "packing": {
                "lattice": SQUARE.name,
                "rows": len(state),
                "columns": 1,
                "last": WALL if self.on_plane else FREE,
            },
            "effects": effects,
            "start": {"state": state, "touching": adhesive},
            "output": {"forces": True},
            "time": {
                "sample": every * step,
                "duration": ceil(impact.duration * impact.steps / every) * every * step,
                "timestep": step * (1 + _SLACK),
            },
        }

    # --- derived values ---

    @property
    def rubs(self) -> bool:
        """True if shear forces act at the contact and turn the spheres."""
        return self.contact.friction > 0 and self.contact.shear != "none"

    @property
    def on_plane(self) -> bool:
        """True if the partner is the rigid plane."""
        return self.collision.partner == "plane"

    @property
    def effective_mass(self) -> float:
        """Effective mass m*: m against a plane, m/2 between two spheres, kg."""
        return self.sphere.mass * (1.0 if self.on_plane else 0.5)

    @property
    def closing_speed(self) -> float:
        """Relative normal velocity at first touch, m/s."""
        return self.collision.normal_velocity * (1 if self.on_plane else 2)

    @property
    def effective_radius(self) -> float:
        """Effective radius Rc: R on a plane, R/2 between two spheres, m."""
        return self.sphere.radius * (1.0 if self.on_plane else 0.5)

    @property
    def _law(self) -> type[AdhesionLaw]:
        return ADHESION_LAWS.get(self.contact.normal, Dmt)

    @property
    def law(self) -> AdhesionLaw:
        """Law of the contact; a rigid plane doubles the E* and G* of two spheres."""
        sphere, bodies = self.sphere, 2 if self.on_plane else 1
        adhesion = 0.0 if self.contact.normal == HERTZ else sphere.work_of_adhesion
        return self._law.between(
            bodies * sphere.effective_modulus, bodies * sphere.effective_shear_modulus, self.effective_radius, adhesion
        )

    @property
    def normal_coefficient(self) -> float:
        """A = (4/3) E* √Rc, N/m^{3/2}."""
        return float(self.law.normal_coefficient)

    @property
    def pull_off_force(self) -> float:
        """Largest pull F, N: 2π w Rc by the law "dmt", (3/2) π w Rc by "jkr", 0 by "hertz"."""
        return float(self.law.pull_off_force)

    @property
    def static_overlap(self) -> float:
        """Overlap Δ0 without an external force, m."""
        return float(self.law.overlap_under(0.0))

    @property
    def pull_off_distance(self) -> float:
        """Distance beyond overlap 0 at which the contact ends, m.

        With the law "jkr" it is 2^{−4/3} Δ0 = (3π² w² Rc/64 E*²)^{1/3}, where the pull is F and a constant load would
        separate the bodies. If the distance is prescribed, the contact holds twice as far, to 6^{−4/3} 9 Δ0. The
        published loss of a collision assumes this distance, which ``contact.parting = "distance"`` selects
        (`cases.pull_off.jkr`).
        """
        return -float(self.law.pull_off_overlap) * (self.law.later if self.contact.parting == DISTANCE else 1.0)

    @property
    def elastic_overlap(self) -> float:
        """Largest overlap of a Hertz contact, δ_m = (5 m* v²/4A)^{2/5}, m (Timoshenko & Goodier, § 140)."""
        return (5 * self.effective_mass * self._speed**2 / (4 * self.normal_coefficient)) ** (2 / 5)

    @property
    def elastic_contact_time(self) -> float:
        """Contact time of a Hertz contact, 2.943 δ_m/v, s."""
        return 2 * _HALF_CONTACT * self.elastic_overlap / self._speed

    @property
    def _speed(self) -> float:
        """Speed v at the overlap at rest, m/s: m* (v² − v_closing²)/2 is the work of adhesion up to this overlap."""
        work = self.law.closing_work * self.pull_off_force * self.static_overlap
        return sqrt(self.closing_speed**2 + 2 * work / self.effective_mass)
