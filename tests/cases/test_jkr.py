"""The law of Johnson, Kendall and Roberts: its limits, its unstable points, and the energy that a collision loses."""

import re
from math import pi, sqrt

import numpy as np
import pytest

from cases.pull_off.jkr import PARTS, TOUCH, Contact, Parting
from tests.manual import Measure, Mutant, off, verifies

CONTACT = Contact(radius=0.7, modulus=1.3, work=0.9)  # in no units: the law has none
RADII = CONTACT.rest_radius * np.array([0.4, 0.7, 1.0, 1.5, 4.0])
ROUNDED = 1e-12  # a few roundings of a few powers, of numbers of order 1


def written_out(a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return force and overlap of the 1971 paper, in dimensions."""
    R, E, w = CONTACT.radius, CONTACT.modulus, CONTACT.work
    return 4 * E * a**3 / (3 * R) - np.sqrt(8 * pi * w * E * a**3), a**2 / R - np.sqrt(2 * pi * w * a / E)


def test_the_law_without_a_parameter_is_that_of_1971() -> None:
    force, overlap = written_out(RADII)
    # At a0 the two terms of the force cancel: errors are measured by their size
    assert CONTACT.force(RADII) == pytest.approx(force, abs=ROUNDED * 4 * CONTACT.pull_off_force * 64)
    assert CONTACT.overlap(RADII) == pytest.approx(overlap, rel=ROUNDED)
    assert CONTACT.overlap(RADII) != pytest.approx(overlap * (1 + 1e-10), rel=ROUNDED)


def test_without_an_outer_force_the_contact_is_at_rest() -> None:
    a0 = CONTACT.rest_radius
    assert float(CONTACT.force(a0)) == pytest.approx(0, abs=ROUNDED * CONTACT.pull_off_force)
    assert float(CONTACT.overlap(a0)) == pytest.approx(a0**2 / (3 * CONTACT.radius), rel=ROUNDED)
    # The energy is least there
    near = CONTACT.energy(a0 * np.array([0.99, 1.0, 1.01]))
    assert near[1] < min(near[0], near[2])


def test_far_from_rest_the_law_is_that_of_hertz() -> None:
    wide = np.array([100.0, 1000.0]) * CONTACT.rest_radius
    hertz = 4 / 3 * CONTACT.modulus * sqrt(CONTACT.radius) * CONTACT.overlap(wide) ** 1.5
    departs = 1 - CONTACT.force(wide) / hertz
    # δ is (2/3) x^{-3/2} below Hertz's, f by x^{-3/2}: they differ by (1/6) x^{-3}, and cancel before
    assert departs == pytest.approx(wide**-3.0 / 6 * CONTACT.rest_radius**3, rel=0.02)


@pytest.mark.parametrize("parting", PARTS)
def test_the_contact_ends_where_it_is_no_longer_stable(parting: Parting) -> None:
    end = CONTACT.rest_radius * PARTS[parting] ** (2 / 3)
    values = {"load": CONTACT.force, "distance": CONTACT.overlap}[parting](end * np.array([0.999, 1.0, 1.001]))
    assert values[1] < min(values[0], values[2])  # the largest pull, the largest distance
    share = {"load": 1.0, "distance": 5 / 9}[parting]
    assert float(CONTACT.force(end)) == pytest.approx(-share * CONTACT.pull_off_force, rel=ROUNDED)
    distance = {"load": 2 ** (-4 / 3), "distance": 9 * 6 ** (-4 / 3)}[parting] * CONTACT.rest_overlap
    assert CONTACT.pull_off_distance(parting) == pytest.approx(distance, rel=ROUNDED)


def test_bodies_that_touch_pull_with_eight_ninths_of_the_pull_off_force() -> None:
    touch = CONTACT.rest_radius * TOUCH ** (2 / 3)
    assert float(CONTACT.overlap(touch)) == pytest.approx(0, abs=ROUNDED * CONTACT.rest_overlap)
    assert float(CONTACT.force(touch)) == pytest.approx(-8 / 9 * CONTACT.pull_off_force, rel=ROUNDED)


@pytest.mark.parametrize("parting", PARTS)
def test_the_loss_is_the_area_between_touching_and_parting(parting: Parting) -> None:
    ends = CONTACT.rest_radius * np.array([PARTS[parting], TOUCH]) ** (2 / 3)
    points, weights = np.polynomial.legendre.leggauss(20)
    a = ends.mean() + points * np.diff(ends) / 2
    step = 1e-5 * CONTACT.rest_radius
    slope = (CONTACT.overlap(a + step) - CONTACT.overlap(a - step)) / (2 * step)  # to 1e-10, by its third derivative
    area = np.sum(weights * CONTACT.force(a) * slope) * np.diff(ends)[0] / 2
    assert CONTACT.loss(parting) == pytest.approx(-area, rel=1e-9)
    unit = (CONTACT.work**5 * CONTACT.radius**4 / CONTACT.modulus**2) ** (1 / 3)
    assert CONTACT.loss(parting) / unit == pytest.approx({"load": 3.5026, "distance": 7.0922}[parting], abs=5e-5)


@verifies(
    "JKR: energy of a contact at five radii",
    reference="analytic: Johnson's sum of Hertz's energy, a flat punch, their cross term and −wπa²",
    tolerance=1e-12,
    reason="a few roundings of a few powers",
    mutant=Mutant(
        "analysis/cases/pull_off/jkr.py",
        "y ** (4 / 3) * (1.2 * y**2 - 2 * y + 0.5)",
        "y ** (4 / 3) * (1.2 * y**2 - 2 * y + 0.499)",
    ),
)
def test_the_energy_is_elastic_energy_less_that_of_the_surfaces(measured: Measure) -> None:
    """Johnson's sum: Hertz's energy, that of a flat punch pulled back to the force, their cross term, and −w π a²."""
    E, R, w = CONTACT.modulus, CONTACT.radius, CONTACT.work
    hertz = 4 * E * RADII**3 / (3 * R)
    pull = np.sqrt(8 * pi * w * E * RADII**3)
    elastic = 8 * E * RADII**5 / (15 * R**2) - pull * 2 * RADII**2 / (3 * R) + pull**2 / (4 * E * RADII)
    assert hertz - pull == pytest.approx(CONTACT.force(RADII), abs=ROUNDED * float(hertz.max()))
    scale = float(np.abs(elastic).max())
    measured(off(CONTACT.energy(RADII), elastic - w * pi * RADII**2, size=scale))


@verifies(
    "JKR: sticking speed of a sphere on a plane, in (w⁵/R⁵ϱ³E*²)^{1/6}",
    reference="published: 1.84, Thornton and Ning 1998",
    tolerance=0.005,
    reason="half a unit of the published digit",
    mutant=Mutant("analysis/cases/pull_off/jkr.py", "return float(end - start)", "return float(end)"),
)
def test_the_sticking_speed_of_a_sphere_on_a_plane_is_the_published_one(measured: Measure) -> None:
    """Thornton & Ning 1998: v_s = 1.84 (w⁵/(R⁵ ϱ³ E*²))^{1/6}."""
    density = 1050.0
    mass = 4 / 3 * pi * density * CONTACT.radius**3
    unit = (CONTACT.work**5 / (CONTACT.radius**5 * density**3 * CONTACT.modulus**2)) ** (1 / 6)
    measured(CONTACT.sticking_speed(mass) / unit - 1.84)
    assert CONTACT.sticking_speed(mass, "load") / CONTACT.sticking_speed(mass) == pytest.approx(0.70276, abs=1e-5)


def test_restitution_is_zero_below_the_sticking_speed_and_one_far_above() -> None:
    mass = 1.1
    speed = CONTACT.sticking_speed(mass)
    e = CONTACT.restitution(speed * np.array([0.5, 1.0, sqrt(2), 1e4]), mass)
    assert e == pytest.approx([0, 0, sqrt(0.5), 1], abs=1e-7)  # √ of a rounding at v_s


def test_the_contact_radius_of_an_overlap_is_on_the_stable_branch() -> None:
    end = -CONTACT.pull_off_distance()
    overlap = np.linspace(0.999 * end, 50 * CONTACT.rest_overlap, 30)
    a = CONTACT.contact_radius(overlap)
    assert CONTACT.overlap(a) == pytest.approx(overlap, abs=1e-12 * float(overlap.max()))
    assert np.all(np.diff(a) > 0)
    # A double root: a rounding of the overlap moves the radius by its square root
    last = CONTACT.rest_radius * PARTS["distance"] ** (2 / 3)
    assert float(CONTACT.contact_radius(end)) == pytest.approx(last, rel=1e-6)


def test_what_has_no_meaning_is_refused_by_name() -> None:
    for wrong, message in (
        (lambda: Contact(1.0, 1.0, 0.0), "radius = 1.0, modulus = 1.0 and work = 0.0 must be positive"),
        (lambda: Contact(1.0, np.inf, 1.0), "modulus = inf and"),
        (lambda: CONTACT.loss("grips"), "parting must be one of load, distance, not 'grips'"),
        (lambda: CONTACT.contact_radius(-9.0), "where the contact ends, not -9.0"),
        (lambda: CONTACT.force(-1.0), "contact_radius must not be negative"),
        (lambda: CONTACT.sticking_speed(0.0), "mass must be positive, not 0.0"),
        (lambda: CONTACT.restitution(0.0, 1.0), "speed must be positive, not 0.0"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            wrong()
