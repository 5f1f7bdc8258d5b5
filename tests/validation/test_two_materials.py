"""The force between spheres of two materials and radii in LAMMPS, against the constants of `find_contacts`.

One step from a state that is known exactly, as in ``tests/validation/test_contact_law.py``; here both spheres spin,
each by its own share of the shear. Positions are multiples of 2^-14 nm.
"""

from math import sqrt

import ase
import numpy as np
import pytest

from granular_lmp.crystal.contacts import Contacts, find_contacts
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.units import NANO
from tests.crystal.test_sphere import SILICA
from tests.manual import Measure, Mutant, verifies
from tests.validation.test_contact_law import Contact, touch

STEEL = Sphere(radius=0.25e-6, youngs_modulus=210e9, poisson_ratio=0.3, work_of_adhesion=0.4, density=7850.0)
OVERLAP = 0.375  # nm
SHEAR = 2.0**-10  # nm
FRICTION = 10.0
# The overlap of `find_contacts` is what is left of 750 nm, and its force what is left of repulsion less adhesion
FROM_POSITIONS = 1e-11
EXACT = 1e-12
NEWTON = NANO.number(1.0, mass=1, length=1, time=-2)


def law(sphere: Sphere, stiffness: str = "NULL") -> str:
    modulus, half_adhesion = (
        NANO.number(sphere.youngs_modulus, mass=1, length=-1, time=-2),
        NANO.number(sphere.work_of_adhesion / 2, mass=1, time=-2),
    )
    return (
        f"dmt {modulus!r} 0.0 {sphere.poisson_ratio!r} {half_adhesion!r} "
        f"tangential mindlin {stiffness} 0.0 {FRICTION!r} damping velocity"
    )


MIXED_BY_LAMMPS = f"pair_coeff 1 1 {law(SILICA)}\npair_coeff 2 2 {law(STEEL)}"


def written_out() -> str:
    """Return the pair coefficients with those of the unlike pair given: ν = 0 makes E of the law 2 E*, NULL 8 G*."""
    one, other = (
        (1 - SILICA.poisson_ratio**2) / SILICA.youngs_modulus,
        (1 - STEEL.poisson_ratio**2) / STEEL.youngs_modulus,
    )
    shear_modulus = 1 / sum(
        2 * (2 - s.poisson_ratio) * (1 + s.poisson_ratio) / s.youngs_modulus for s in (SILICA, STEEL)
    )
    adhesion = sqrt(SILICA.work_of_adhesion * STEEL.work_of_adhesion)
    pair = Sphere(1.0, 2 / (one + other), 0.0, adhesion, 1.0)
    stiffness = NANO.number(8 * shear_modulus, mass=1, length=-1, time=-2)
    return f"{MIXED_BY_LAMMPS}\npair_coeff 1 2 {law(pair, repr(stiffness))}"


def there(coefficients: str, shear: float) -> Contact:
    """Return the contact of a sphere of silica at the left and one of steel at the right that have slipped."""
    return touch(f"pair_style granular\n{coefficients}", SILICA, OVERLAP, (shear, 0.0), other=STEEL)


def ours() -> Contacts:
    crystal = ase.Atoms("X2", positions=[[-(750.0 - OVERLAP) / 500.0, 0, 0], [0, 0, 0]], cell=[9, 9, 9])
    crystal.set_array("radius", np.array([1.0, 0.5]))
    crystal.set_array("material", np.array([0, 1]))
    return find_contacts(crystal, [SILICA, STEEL])


@pytest.mark.parametrize("coefficients", [MIXED_BY_LAMMPS, written_out()], ids=["mixed by LAMMPS", "written out"])
def test_normal_force_of_two_materials_is_that_of_the_contact(coefficients: str) -> None:
    seen, here = there(coefficients, 0.0), ours()
    repulsion = here.contact_force[0] + here.adhesive_force[0]
    assert abs(seen.normal / NEWTON - here.contact_force[0]) < FROM_POSITIONS * repulsion
    assert seen.shear == 0


@verifies(
    "Two materials and radii in contact, shear force",
    reference="analytic: Mindlin's G* of unlike bodies",
    tolerance=1e-11,
    reason="1e-16 of the position, over an overlap of 1e-4 of it, 0.3 of that in the force",
    mutant=Mutant(
        "granular_lmp/crystal/contacts.py",
        "1 / ((2 - nui) / Gi + (2 - nuj) / Gj)",
        "1 / ((2 - nui) / Gi + (2 - nui) / Gj)",
    ),
)
def test_shear_force_and_torques_of_two_materials_written_out_are_those_of_the_contact(measured: Measure) -> None:
    seen, here = there(written_out(), SHEAR), ours()
    expected = -here.shear_stiffness[0] * SHEAR * 1e-9
    measured(seen.shear / NEWTON / expected - 1)
    # The arm of the torque is that of each sphere, R − δ/2
    arms = 500.0 - OVERLAP / 2, 250.0 - OVERLAP / 2
    for torque, arm in zip(seen.torques, arms, strict=True):
        assert abs(torque / (seen.shear * arm) - 1) < EXACT


def test_lammps_itself_mixes_another_shear_modulus() -> None:
    """LAMMPS makes G* from the mixed E* and ν = √(νi νj) as of equal spheres: so unlike pairs are written out."""
    seen, here = there(MIXED_BY_LAMMPS, SHEAR), ours()
    compliance = sum((1 - s.poisson_ratio**2) / s.youngs_modulus for s in (SILICA, STEEL))
    nu = sqrt(SILICA.poisson_ratio * STEEL.poisson_ratio)
    wrong = 1 / compliance / (4 * (1 + nu) * (2 - nu))
    curvature = 1 / SILICA.radius + 1 / STEEL.radius
    stiffness = 8 * wrong * sqrt(OVERLAP * 1e-9 / curvature)
    assert abs(seen.shear / NEWTON / (-stiffness * SHEAR * 1e-9) - 1) < EXACT
    assert abs(stiffness / here.shear_stiffness[0] - 1) > 0.1


def test_a_wrong_constant_would_be_seen() -> None:
    seen, here = there(written_out(), SHEAR), ours()
    assert abs(seen.shear / NEWTON / (-here.shear_stiffness[0] * (1 + 1e-10) * SHEAR * 1e-9) - 1) > FROM_POSITIONS
