"""Lattices integrated in the time steps of LAMMPS, and their limits."""

from typing import Any

import numpy as np
import pytest

from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from tests.stepped import limit, stepped

NU = 0.17


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"direction": 17.0}, r"direction = 17\.0 of the mode is not 90"),
        ({"phase": 0.3}, r"phase = 0\.3 must be 0"),
        ({"contact": Contact(NU)}, r"overlap_ratio = 0\.0 must be above 0"),
    ],
    ids=str,
)
def test_what_cannot_be_stepped_is_refused(changes: dict[str, Any], message: str) -> None:
    options = {"contact": Contact(NU, overlap_ratio=0.01)} | changes
    with pytest.raises(ValueError, match=message):
        stepped([Wave.of_mode("TR", 1.1, 0.2, **options)], 2, records=2)


def test_waves_in_contacts_of_two_kinds_are_stepped_in_one_call() -> None:
    waves = [Wave.of_mode("TR", xi, 0.2, Contact(nu, overlap_ratio=1e-3 * xi)) for xi, nu in ((0.8, NU), (2.1, -0.5))]
    together, apart = stepped(waves, 4, records=40), [stepped([wave], 4, records=40)[0] for wave in waves]
    np.testing.assert_array_equal(together, apart)
    assert np.max(np.abs(together[0] - together[1])) > 0.1


@pytest.mark.parametrize(
    "effects",
    [{"shear": False}, {"rotation": False}, {"viscosity": 0.01}, {"restitution": 0.9, "prestress": 1.0}],
    ids=str,
)
def test_waves_of_any_contact_are_stepped_to_their_limit(effects: dict[str, Any]) -> None:
    wave = Wave.of_mode("L", 0.8, 0.2, Contact(NU, overlap_ratio=1e-3, **effects))
    (coarse,), (fine,) = (stepped([wave], count, records=40) for count in (8, 16))
    (exact,) = limit([wave], 0.5 * np.arange(41))
    errors = [np.max(np.abs(run - exact)[:, 0]) for run in (coarse, fine)]
    # The steps are of second order; dashpots, whose force takes the velocity of mid-step, of first
    assert errors[0] / errors[1] == pytest.approx(2 if effects.keys() & {"viscosity", "restitution"} else 4, rel=0.1)


def test_the_limits_of_waves_side_by_side_are_those_of_each_alone() -> None:
    tau = np.linspace(0, 20, 41)
    # The smallest of them is off by no more of its own size
    kinds = (("RT", 0.8, 0.2, NU), ("TR", 2.1, 0.01, -0.5), ("L", 0.3, 0.1, 0.4))
    waves = [Wave.of_mode(name, xi, a, Contact(nu, overlap_ratio=1e-3)) for name, xi, a, nu in kinds]
    together, apart = limit(waves, tau), [np.stack(lattice.torus(wave, tau), axis=-1) for wave in waves]
    # 50 rtol, as it says, at τ = 120
    np.testing.assert_allclose(together, apart, rtol=0, atol=50 * 1e-10)
    assert np.max(np.abs(together[0] - together[1])) > 0.1
