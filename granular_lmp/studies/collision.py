"""A collision of two equal spheres, or of a sphere with a rigid plane: its declaration and its LAMMPS deck.

A collision tests one contact. The contact law is written by the same function as in the wave decks
(`granular_lmp.lammps.contact`). The bodies touch at t = 0 with overlap 0; the normal of the first sphere at the contact
is +x, its tangent +y, and spins are about z. `granular_lmp.studies.collide` runs it.

By the law "jkr" the contact snaps in at overlap 0, where it pulls with (8/9) F at once, and holds until the pull is the
largest, F, at `Collision.pull_off_distance` beyond overlap 0.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, gamma, pi, sqrt
from pathlib import Path
from typing import Any, Self

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, AdhesionLaw
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import SceneError
from granular_lmp.lammps import contact
from granular_lmp.scene.document import Document
from granular_lmp.scene.files import first_file
from granular_lmp.scene.scene import LARGEST_OVERLAP_RATIO
from granular_lmp.scene.schema import choice, count, number
from granular_lmp.scene.sections import SPHERE_RULES
from granular_lmp.scene.shipped import SHIPPED
from granular_lmp.units import units_for

COLLISION_DUMP = "dump.collision"
COLLISION_COLUMNS = ("id", "x", "y", "vx", "vy", "omegaz", "fx", "fy")  # columns of the dump
RECORDS = 500  # fewest records in a contact time
SKIN = 0.1  # radii; the neighbour list holds pairs that are as far apart, and a contact must end within
LONGEST_PATH = 100.0  # radii; LAMMPS cuts the box into bins of a radius, 8e6 of them for this one
_SHIPPED_COLLISIONS = SHIPPED / "collisions"
# ∫₀¹ dx/√(1 − x^{5/2}) = √π Γ(7/5)/Γ(9/10): half of a Hertz contact time, in units of depth over speed
_HALF_CONTACT = sqrt(pi) * gamma(7 / 5) / gamma(9 / 10)
# Work of adhesion from first touch to the overlap at rest Δ0, over F Δ0
_WORK = {"dmt": 3 / 5, "hertz": 0.0, "jkr": 6 / 5 * (1 - (2 / 3) ** (4 / 3))}


@dataclass(frozen=True)
class Contact:
    """Contact law with the arguments of `granular_lmp.lammps.contact.model`."""

    normal: str = choice("with adhesion, without, with adhesion beyond contact", contact.NORMAL_LAWS, default="dmt")
    shear: str = choice("what the shear force follows", contact.TANGENTIAL_LAWS, default="secant")
    friction: float = number("", "mu", 0.0, 1e4, default=0.0)
    restitution: float = number("", "e of an impact along the normal", 0.01, 1.0, default=1.0)
    shear_damping: float = number("", "of shear over that of normal motion", 0.0, 100.0, default=0.0)


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
        If the values contradict each other: a restitution below 1 with adhesion, the law "jkr" without adhesion, a
        spin of the plane, adhesion that reaches beyond the neighbour list, an impact so fast that the overlap is no
        longer small.
    """

    sections = {"sphere": Sphere, "contact": Contact, "collision": Impact}
    rules = {"sphere": SPHERE_RULES}
    named = "the deck"

    sphere: Sphere
    contact: Contact
    collision: Impact

    def __post_init__(self) -> None:
        if self.contact.normal != "hertz" and self.contact.restitution < 1:
            raise SceneError(
                f"contact.restitution = {self.contact.restitution!r}: must be 1 with contact.normal = "
                f'"{self.contact.normal}"; LAMMPS has no law of restitution with adhesion, take "hertz"'
            )
        if self.contact.normal == "jkr" and not self.sphere.work_of_adhesion:
            raise SceneError(
                f"sphere.work_of_adhesion = {self.sphere.work_of_adhesion!r}: must be above 0 with contact.normal = "
                '"jkr"; without adhesion take "hertz"'
            )
        if self.collision.partner == "plane" and self.collision.partner_spin:
            raise SceneError(
                f"collision.partner_spin = {self.collision.partner_spin!r}: must be 0, the plane is at rest"
            )

        reach = self.pull_off_distance / self.sphere.radius
        if reach > SKIN:
            raise SceneError(
                f"sphere.work_of_adhesion = {self.sphere.work_of_adhesion!r}: the contact would hold until {reach:.3g} "
                f"radii beyond overlap 0; at most {SKIN} is allowed, where the neighbour list of LAMMPS ends"
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
                f"collision.tangential_velocity = {self.collision.tangential_velocity!r}: the sphere would go "
                f"{path:.3g} radii in collision.duration; at most {LONGEST_PATH:g} are allowed"
            )

    # --- reading and writing ---

    @classmethod
    def load(cls, source: str | Path) -> Self:
        """Collision from a TOML file, or the name of one in ``lammps_inputs/collisions``."""
        found = first_file(source, (Path(source), _SHIPPED_COLLISIONS / f"{source}.toml"))
        if found is None:
            shipped = sorted(path.stem for path in _SHIPPED_COLLISIONS.glob("*.toml"))
            raise SceneError(f"{source}: no such collision; shipped: {', '.join(shipped) or 'none'}")
        return cls.read(found)

    @classmethod
    def completed(cls, tables: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the tables with a contact, and spheres without adhesion, where they are not declared."""
        given = {"contact": {}, **tables}
        if isinstance(given.get("sphere"), Mapping):
            given["sphere"] = {"work_of_adhesion": 0.0, **given["sphere"]}  # spheres that meet need not be adhesive
        return given

    # --- derived values ---

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
    def law(self) -> AdhesionLaw:
        """Law of the contact; a rigid plane doubles E* and G* of two spheres."""
        sphere, bodies = self.sphere, 2 if self.on_plane else 1
        adhesion = 0.0 if self.contact.normal == "hertz" else sphere.work_of_adhesion
        kind = ADHESION_LAWS["dmt" if self.contact.normal == "hertz" else self.contact.normal]
        return kind.between(
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
        """Overlap Δ0 without an outer force, m."""
        return float(self.law.overlap_under(0.0))

    @property
    def pull_off_distance(self) -> float:
        """Distance beyond overlap 0 at which the contact ends in LAMMPS, m.

        By the law "jkr" it is 2^{−4/3} Δ0 = (3π² w² Rc/64 E*²)^{1/3}, where the pull is F and a constant load would
        part the bodies. The published loss of a collision takes the contact to 6^{−4/3} 9 Δ0, twice as far, where it
        ends if the distance is prescribed (`analysis.theory.jkr`).
        """
        return -float(self.law.pull_off_overlap)

    @property
    def elastic_overlap(self) -> float:
        """Hertz's largest overlap δ_m = (5 m* v²/4A)^{2/5}, m (Timoshenko & Goodier, § 140)."""
        return (5 * self.effective_mass * self._speed**2 / (4 * self.normal_coefficient)) ** (2 / 5)

    @property
    def elastic_contact_time(self) -> float:
        """Hertz's contact time 2.943 δ_m/v, s."""
        return 2 * _HALF_CONTACT * self.elastic_overlap / self._speed

    @property
    def _speed(self) -> float:
        """Speed v, m/s, at the overlap at rest: m* (v² − v_closing²)/2 is the work of adhesion up to there."""
        work = _WORK[self.contact.normal] * self.pull_off_force * self.static_overlap
        return sqrt(self.closing_speed**2 + 2 * work / self.effective_mass)


# --- the deck --------------------------------------------------------------------------------------------------------


def deck_text(collision: Collision) -> str:
    """Return the LAMMPS input of a collision, which runs with plain ``lmp``."""
    sphere, law, impact = collision.sphere, collision.contact, collision.collision
    units = units_for(sphere.radius)
    radius = units.number(sphere.radius, length=1)
    every = max(impact.steps // RECORDS, 1)
    step = units.number(collision.elastic_contact_time / impact.steps, time=1)
    records = ceil(impact.duration * impact.steps / every)
    speed = units.number(impact.normal_velocity, length=1, time=-1)
    along = units.number(impact.tangential_velocity, length=1, time=-1)
    room = 4 * radius + (abs(along) + speed) * step * every * records
    bodies = [(1, -radius, speed, along, units.number(impact.spin, time=-1))]
    if not collision.on_plane:
        bodies.append((2, radius, -speed, 0.0, units.number(impact.partner_spin, time=-1)))

    def commands(touching: Sphere) -> str:
        return contact.model(
            touching,
            units,
            normal=law.normal,
            shear=law.shear,
            friction=law.friction,
            restitution=law.restitution if law.restitution < 1 else None,
            shear_damping=law.shear_damping,
        )

    plane = contact.wall(commands(contact.rigid(sphere)), "xplane NULL 0.0") + "\n" if collision.on_plane else ""
    placed = "\n".join(f"create_atoms 1 single {x!r} 0.0 0.0" for _, x, *_ in bodies)
    moving = "\n".join(
        f"set          atom {tag} vx {vx!r} vy {vy!r} omega 0.0 0.0 {spin!r}" for tag, _, vx, vy, spin in bodies
    )
    return f"""\
# {collision.name}: a sphere meets a{" rigid plane" if collision.on_plane else "n equal sphere"} at x = 0
# --- units {units.style}: {units.names}
units        {units.style}
boundary     f f f
atom_style   sphere
atom_modify  map array
comm_modify  vel yes
region       box block {-room!r} {room!r} {-room!r} {room!r} {-room!r} {room!r}
create_box   1 box
{placed}
set          group all diameter {2 * radius!r} density {units.number(sphere.density, mass=1, length=-3)!r}
{moving}
neighbor     {SKIN * radius!r} bin
timestep     {step!r}

# --- contact
{contact.pair(commands(sphere))}
{plane}
# --- motion, and a record of every body with all digits
fix          move all nve/sphere
dump         all all custom {every} {COLLISION_DUMP} {" ".join(COLLISION_COLUMNS)}
dump_modify  all sort id format float %.17g
thermo_style custom step
thermo       {every * records}
run          {every * records}
"""
