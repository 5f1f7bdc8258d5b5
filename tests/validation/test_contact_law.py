"""The force between two spheres, one step from a state that is known exactly, against the formulas of DMT and Mindlin.

The shear comes from equal spins during one step without forces: it loads the contact and leaves the overlap alone.
Positions are multiples of 2^-14 of the deck's unit of length, so that LAMMPS's overlap is exact.
"""

import re
from dataclasses import dataclass
from math import log, pi, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from granular_lmp import Scene, build
from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.lammps import contact
from granular_lmp.units import MICRO, NANO, SI, Units, units_for
from tests.instance import silent_lammps
from tests.manual import Measure, Mutant, off, verifies

Floats = NDArray[np.float64]
PAPER = Scene.load("tr_resonant")
SILICA = PAPER.sphere
FRICTION = 10.0
# Ten or so roundings of 1e-16 on either side, and up to 2e-13 where sqrt in LAMMPS rounds the distance
EXACT = 1e-12


@dataclass(frozen=True)
class Contact:
    """Repulsion of the first sphere, force on it across the contact, and the torques on all; in deck units."""

    normal: float
    shear: float
    torques: Floats

    @property
    def torque(self) -> float:
        """Return the torque on the first sphere."""
        return float(self.torques[0])


@dataclass(frozen=True)
class Formulas:
    """A, B and F in the units of a deck."""

    A: float
    B: float
    F: float

    @classmethod
    def of(cls, sphere: Sphere, units: Units) -> "Formulas":
        root_metre = sqrt(units.number(1.0, length=1))  # A and B are in Pa √m
        return cls(
            A=units.number(sphere.normal_coefficient, mass=1, length=-1, time=-2) * root_metre,
            B=units.number(sphere.shear_coefficient, mass=1, length=-1, time=-2) * root_metre,
            F=units.number(sphere.pull_off_force, mass=1, length=1, time=-2),
        )


def touch(
    commands: str,
    sphere: Sphere,
    overlap: float,
    *moves: tuple[float, float],
    slide: bool = False,
    other: Sphere | None = None,
) -> Contact:
    """The contact after some moves without force, each of a shear and a change of the overlap, all in deck units.

    With `slide`, the shear of the moves comes from a translation across and not from spins. The second body is another
    sphere, by default an equal one; a wall if the commands have one.
    """
    units, plane = units_for(sphere.radius), "wall/gran" in commands
    radii = [units.number(each.radius, length=1) for each in (sphere, *([] if plane else [other or sphere]))]
    radius, kinds, size = radii[0], 1 if other is None else 2, 9 * radii[0]
    first = -(sum(radii) - overlap)
    bodies = [
        f"""create_atoms {min(number, kinds)} single {first if number == 1 else 0.0!r} 0 0
            set atom {number} diameter {2 * each!r} density {units.number(own.density, mass=1, length=-3)!r}"""
        for number, (each, own) in enumerate(zip(radii, (sphere, other or sphere), strict=False), 1)
    ]
    with silent_lammps() as lammps:
        lammps.commands_string(f"""
            units {units.style}
            boundary f f f
            atom_style sphere
            atom_modify map array
            comm_modify vel yes
            region box block {-size!r} {size!r} {-size!r} {size!r} {-radius!r} {radius!r}
            create_box {kinds} box
            {chr(10).join(bodies)}
            neighbor {radius / 10!r} bin
            timestep 1.0
            variable friction index {FRICTION!r}
            fix move all nve/noforce
            thermo_style custom step
            """)
        lammps.commands_string(commands)
        for shear, deeper in moves:
            for number, each in enumerate(radii, 1):
                spin = 0.0 if slide else shear / each / len(radii)
                lammps.command(f"set atom {number} omega 0 0 {spin!r}")
            lammps.commands_string(f"""
                set atom 1 vx {deeper!r} vy {shear if slide else 0.0!r}
                run 1 post no
                """)
        force, place = (lammps.numpy.extract_atom(name)[0].copy() for name in ("f", "x"))
        torques = lammps.numpy.extract_atom("torque")[: len(radii), 2].copy()
    along = np.array([1.0, 0.0]) if plane else -place[:2] / np.hypot(*place[:2])
    return Contact(-force[:2] @ along, along[0] * force[1] - along[1] * force[0], torques)


def deck_commands(scene: Scene) -> str:
    """The contact commands of a wave deck, cut out of its text."""
    found = re.search(r"^pair_style .*\n(pair_coeff .*&\n.*|pair_coeff .*)$", build(scene).input_text, re.MULTILINE)
    assert found is not None
    return found[0]


def same(value: float, formula: float) -> bool:
    return abs(value - formula) <= EXACT * abs(formula)


SILICA_AT = Formulas.of(SILICA, NANO)
OVERLAPS = [2.0**-8, 0.125, 0.25, 0.375, 2.0, 64.0]  # nm; the overlap at rest is 0.24985
SHEARS = [2.0**-10, 2.0**-5, 0.5]


def model(**options: object) -> str:
    return contact.pair(contact.model(SILICA, NANO, **{"friction": FRICTION} | options))


# ---------------------------------------------------------------- the commands


def test_the_wave_decks_write_the_commands_of_the_contact_module() -> None:
    assert deck_commands(PAPER) == contact.pair(contact.model(SILICA, NANO, friction="${friction}"))


@pytest.mark.parametrize("options", [{"normal": "mdr"}, {"shear": "cundall"}])
def test_a_law_that_is_not_there_is_refused(options: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="must be one of"):
        model(**options)


@pytest.mark.parametrize("normal", ["dmt", "jkr"])
def test_restitution_with_adhesion_is_refused_as_lammps_refuses_it(normal: str) -> None:
    with pytest.raises(ValueError, match="needs normal = 'hertz'"):
        model(normal=normal, restitution=0.5)
    for law in ("coeff_restitution", "tsuji"):
        text = model(normal=normal).replace("damping velocity", f"damping {law}")
        with pytest.raises(Exception, match=f"Cannot use {law} model with a cohesive normal model, {normal}"):
            touch(text, SILICA, 0.25, (0.0, 0.0))


# ---------------------------------------------------------------- elastic forces


@pytest.mark.parametrize("overlap", OVERLAPS)
@verifies(
    "Normal force of two spheres in the deck, DMT, at six overlaps",
    reference="analytic: A δ^{3/2} − 2πwRc (Derjaguin, Muller, Toporov 1975)",
    tolerance=1e-12,
    reason="some ten roundings on either side, and up to 2e-13 where LAMMPS takes the root of a distance",
    mutant=Mutant(
        "granular_lmp/lammps/contact.py",
        "units.number(pressing * sphere.work_of_adhesion / 2, mass=1, time=-2)",
        "units.number(pressing * sphere.work_of_adhesion, mass=1, time=-2)",
    ),
)
def test_normal_force_of_the_deck_is_dmt(overlap: float, measured: Measure) -> None:
    there = touch(deck_commands(PAPER), SILICA, overlap, (0.0, 0.0))
    repulsion = SILICA_AT.A * overlap**1.5
    # Near the overlap at rest the two terms cancel: the error is measured by their size
    measured(off(there.normal, repulsion - SILICA_AT.F, size=repulsion + SILICA_AT.F))
    assert there.shear == there.torque == 0


@pytest.mark.parametrize("overlap", OVERLAPS)
@pytest.mark.parametrize("shear", SHEARS)
@verifies(
    "Shear force and torque of two spheres in the deck, no-slip Mindlin and sliding",
    reference="analytic: 8 G* √(Rc δ) ξ, at most μ (P + 2F); arm R − δ/2 (Mindlin 1949)",
    tolerance=1e-12,
    reason="some ten roundings on either side, and up to 2e-13 where LAMMPS takes the root of a distance",
    mutant=Mutant(
        "granular_lmp/lammps/contact.py",
        "{loss!r} {number!r} {half_adhesion!r}",
        "{loss!r} {0.99 * number!r} {half_adhesion!r}",
    ),
)
def test_shear_force_and_torque_of_the_deck_are_mindlin(overlap: float, shear: float, measured: Measure) -> None:
    there = touch(deck_commands(PAPER), SILICA, overlap, (shear, 0.0))
    force = min(SILICA_AT.B * sqrt(overlap) * shear, FRICTION * (SILICA_AT.A * overlap**1.5 + SILICA_AT.F))
    measured(off(there.shear, -force))
    measured(off(there.torque, -force * (500.0 - overlap / 2)))


def test_a_wrong_constant_would_be_seen() -> None:
    there = touch(deck_commands(PAPER), SILICA, 2.0, (2.0**-10, 0.0))
    repulsion, shear = SILICA_AT.A * 2.0**1.5, SILICA_AT.B * sqrt(2.0) * 2.0**-10
    assert same(there.normal, repulsion - SILICA_AT.F)
    assert not same(there.normal, repulsion * (1 + 1e-11) - SILICA_AT.F)
    assert not same(there.shear, -shear * (1 + 1e-11))
    assert not same(there.shear, shear)


def test_pull_off_is_2_pi_w_rc() -> None:
    pull_off = 2 * pi * 0.063 * 0.25e-6 * 1e12  # w of the paper, Rc = R/2; 1 ag nm/ns² = 1e-12 N
    barely = touch(deck_commands(PAPER), SILICA, 2.0**-30, (0.0, 0.0))  # (δ/Δ0)^{3/2} = 2e-13
    assert same(barely.normal, -pull_off)
    for apart in (0.0, -(2.0**-30)):
        assert touch(deck_commands(PAPER), SILICA, apart, (0.0, 0.0)).normal == 0
    pulls = [-touch(deck_commands(PAPER), SILICA, overlap, (0.0, 0.0)).normal for overlap in OVERLAPS]
    assert max(pulls) < pull_off


@pytest.mark.parametrize("shear", SHEARS)
def test_spheres_that_slide_shear_as_spheres_that_turn(shear: float) -> None:
    """The slip of a translation is its part across the normal at the end of the step."""
    there = touch(deck_commands(PAPER), SILICA, 0.25, (shear, 0.0), slide=True)
    apart = 1000.0 - 0.25
    distance = np.hypot(apart, shear)
    overlap = 1000.0 - distance
    assert same(there.shear, -SILICA_AT.B * sqrt(overlap) * shear * apart / distance)


@pytest.mark.parametrize(
    ("units", "sphere"),
    [
        (MICRO, Sphere(64e-6, 2e9, 0.4, 0.05, 1050.0)),
        (SI, Sphere(0.5, 210e9, 0.3, 2.0, 7850.0)),
    ],
)
def test_the_law_holds_in_every_unit_style(units: Units, sphere: Sphere) -> None:
    law, overlap, shear = Formulas.of(sphere, units), units.number(sphere.radius, length=1) / 1024, 2.0**-20
    commands = contact.pair(contact.model(sphere, units, friction=FRICTION))
    there = touch(commands, sphere, overlap, (shear, 0.0))
    assert same(there.normal, law.A * overlap**1.5 - law.F)
    assert same(there.shear, -law.B * sqrt(overlap) * shear)


def test_hertz_is_dmt_without_its_adhesion() -> None:
    there = touch(model(normal="hertz"), SILICA, 0.375, (2.0**-10, 0.0))
    assert same(there.normal, SILICA_AT.A * 0.375**1.5)
    assert same(there.shear, -SILICA_AT.B * sqrt(0.375) * 2.0**-10)


def test_without_a_shear_law_no_force_acts_across() -> None:
    there = touch(model(shear="none"), SILICA, 0.375, (0.5, 0.0))
    assert there.shear == there.torque == 0
    assert same(there.normal, SILICA_AT.A * 0.375**1.5 - SILICA_AT.F)


# What is left of a shear of 1/1024 when the overlap goes from 1/4 to another: B ξ times …
@pytest.mark.parametrize(
    ("shear", "after", "factor"),
    [
        ("secant", 0.5, sqrt(0.5)),  # √δ of now
        ("secant", 0.125, sqrt(0.125)),
        ("incremental", 0.5, sqrt(0.25)),  # √δ of then
        ("incremental", 0.125, sqrt(0.25)),
        ("rescaled", 0.5, sqrt(0.5)),  # √δ of now
        ("rescaled", 0.125, 0.125 / sqrt(0.25)),  # and, unloading, the shear in proportion to √δ
    ],
)
@verifies(
    "Secant, incremental and rescaled shear law, loading and unloading",
    reference="analytic: the shear force that each law leaves after a change of the overlap",
    tolerance=1e-12,
    reason="some ten roundings on either side, and up to 2e-13 where LAMMPS takes the root of a distance",
    mutant=Mutant("granular_lmp/lammps/contact.py", '"incremental": "mindlin/force"', '"incremental": "mindlin"'),
)
def test_the_laws_differ_in_what_a_change_of_overlap_does_to_the_shear(
    shear: str, after: float, factor: float, measured: Measure
) -> None:
    there = touch(model(shear=shear), SILICA, 0.25, (2.0**-10, 0.0), (0.0, after - 0.25))
    measured(off(there.shear, -SILICA_AT.B * 2.0**-10 * factor))


# ---------------------------------------------------------------- sliding and damping


@verifies(
    "Coulomb friction of an adhesive contact",
    reference="analytic: μ (P + 2F)",
    tolerance=1e-12,
    reason="some ten roundings on either side, and up to 2e-13 where LAMMPS takes the root of a distance",
    mutant=Mutant("granular_lmp/lammps/contact.py", "{shear_damping!r} {friction}", "{friction} {shear_damping!r}"),
)
def test_dmt_contacts_slide_at_mu_times_the_repulsion_with_adhesion_added(measured: Measure) -> None:
    there = touch(model(friction=0.25), SILICA, 0.375, (64.0, 0.0))
    measured(off(there.shear, -0.25 * (SILICA_AT.A * 0.375**1.5 + SILICA_AT.F)))


@verifies(
    "Linear dashpot, normal",
    reference="analytic: −η v",
    tolerance=1e-12,
    reason="some ten roundings on either side, and up to 2e-13 where LAMMPS takes the root of a distance",
    mutant=Mutant(
        "granular_lmp/lammps/contact.py",
        "units.number(damping, mass=1, time=-1)",
        "units.number(damping, mass=1, time=-2)",
    ),
)
def test_damping_is_a_force_against_the_velocity(measured: Measure) -> None:
    there = touch(model(damping=1e-6), SILICA, 0.25, (0.0, 0.125))
    damping = 1e-6 / 1e-21 * 1e-9 * 0.125  # kg/s in ag/ns, times nm/ns
    measured(off(there.normal, SILICA_AT.A * 0.375**1.5 - SILICA_AT.F + damping))


def test_shear_damping_is_the_ratio_of_shear_to_normal_damping() -> None:
    there = touch(model(damping=1e-6, shear_damping=0.5), SILICA, 0.375, (2.0**-10, 0.0))
    damping = 0.5 * 1e-6 / 1e-21 * 1e-9 * 2.0**-10
    assert same(there.shear, -SILICA_AT.B * sqrt(0.375) * 2.0**-10 - damping)


@pytest.mark.parametrize("e", [0.3, 0.9])
@verifies(
    "Dashpot of a coefficient of restitution",
    reference="analytic: √5 ζ √(m* A) δ^{1/4} v (Tsuji 1992, with the constant that gives e)",
    tolerance=1e-12,
    reason="some ten roundings on either side, and up to 2e-13 where LAMMPS takes the root of a distance",
    mutant=Mutant(
        "granular_lmp/lammps/contact.py",
        '"velocity" if restitution is None else "coeff_restitution"',
        '"velocity" if restitution is None else "tsuji"',
    ),
)
def test_restitution_damps_with_the_exponent_of_hertz(e: float, measured: Measure) -> None:
    """−√5 ln e/√(π² + ln² e) √(m* A) δ^{1/4} v: the law of Tsuji, with the constant that gives e exactly."""
    there = touch(model(normal="hertz", restitution=e), SILICA, 0.25, (0.0, 0.125))
    overlap, mass = 0.375, NANO.number(SILICA.mass, mass=1) / 2
    damping = -sqrt(5) * log(e) / sqrt(pi**2 + log(e) ** 2) * sqrt(mass * SILICA_AT.A) * overlap**0.25 * 0.125
    measured(off(there.normal, SILICA_AT.A * overlap**1.5 + damping))


def test_hertz_contacts_slide_at_mu_times_the_force_with_its_damping() -> None:
    there = touch(model(normal="hertz", friction=0.25, restitution=0.5), SILICA, 0.25, (64.0, 0.125))
    assert there.normal > 1.1 * SILICA_AT.A * 0.375**1.5
    assert same(there.shear, -0.25 * there.normal)


# ---------------------------------------------------------------- the plane


@pytest.mark.parametrize("normal", ["dmt", "hertz"])
@verifies(
    "A sphere on a wall, of its own material or rigid, Hertz and DMT",
    reference="analytic: Rc = R, and no compliance of a rigid body",
    tolerance=1e-12,
    reason="some ten roundings on either side, and up to 2e-13 where LAMMPS takes the root of a distance",
    mutant=Mutant(
        "granular_lmp/lammps/contact.py",
        "youngs_modulus=2 * sphere.youngs_modulus",
        "youngs_modulus=1.9 * sphere.youngs_modulus",
    ),
)
def test_a_rigid_plane_has_twice_the_moduli_and_the_whole_radius(normal: str, measured: Measure) -> None:
    def wall(sphere: Sphere) -> str:
        law = contact.model(sphere, NANO, normal=normal, friction=FRICTION)
        return contact.pair(law) + "\n" + contact.wall(law, "xplane NULL 0.0")

    overlap, shear = 0.375, 2.0**-10
    adhesion = 2 * pi * 0.063 * 0.5e-6 * 1e12 if normal == "dmt" else 0.0
    E, nu = SILICA.youngs_modulus * 1e-6, SILICA.poisson_ratio  # MPa
    for sphere, share in ((SILICA, 0.5), (contact.rigid(SILICA), 1.0)):  # a wall of the same material: half of each
        there = touch(wall(sphere), SILICA, overlap, (shear, 0.0))
        stiff = 4 / 3 * share * E / (1 - nu**2) * sqrt(500.0)
        shear_stiff = 8 * share * E / (2 * (1 + nu) * (2 - nu)) * sqrt(500.0)
        measured(off(there.normal, stiff * overlap**1.5 - adhesion))
        measured(off(there.shear, -shear_stiff * sqrt(overlap) * shear))
        measured(off(there.torque, there.shear * 500.0))


@pytest.mark.parametrize("name", ["dmt", "jkr"])
@pytest.mark.parametrize("stiffer", [0.05, 1.0, 7.0])
@pytest.mark.parametrize("shear_over_normal", [0.3, 2.5])  # no material has the second
def test_a_plane_has_the_law_of_any_two_bodies(name: str, stiffer: float, shear_over_normal: float) -> None:
    modulus, radius, adhesion = stiffer * SILICA.effective_modulus, SILICA.radius, 0.2
    law = ADHESION_LAWS[name].between(modulus, shear_over_normal * modulus, radius, adhesion)
    sphere, shear_modulus = contact.of_law(law, radius, SILICA)
    words = contact.model(sphere, NANO, normal=name, friction=FRICTION, shear_modulus=shear_modulus)
    rest, shear = law.overlap_under(0.0), 2.0**-10
    overlap = round(rest * 1e9 * 2**14) / 2**14 + 0.125  # nm, a multiple of what positions are
    commands = contact.pair(words) + "\n" + contact.wall(words, "xplane NULL 0.0")
    there = touch(commands, SILICA, overlap, (shear, 0.0))
    metres = overlap * 1e-9
    assert there.normal == pytest.approx(law.force(metres) * 1e12, rel=1e-9)  # JKR's equation is solved by LAMMPS
    assert there.shear == pytest.approx(-law.shear_stiffness(metres) * shear * 1e3, rel=1e-9)
    assert same(there.torque, there.shear * 500.0)
