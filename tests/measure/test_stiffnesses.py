"""Factors of measured stiffnesses: the contact at rest then has them, under its load."""

from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.stiffnesses import scaled
from granular_analysis.theory.bonds import dmt, jkr
from granular_analysis.theory.choice import TheoryError
from granular_analysis.theory.network import Material, mixed

SILICA, STEEL = Material(73e9, 0.17, 0.063), Material(200e9, 0.3, 0.1)
RADIUS = 5e-7


@pytest.mark.parametrize("load", [0.0, 1e-7])
@pytest.mark.parametrize("adhesion", ["dmt", "jkr"])
@pytest.mark.parametrize("other", [RADIUS, np.inf])
def test_a_contact_at_rest_has_its_measured_stiffnesses(load: float, adhesion: Any, other: float) -> None:
    normal, shear = 700.0, 300.0
    radii = RADIUS, other
    pressing, shearing = scaled((SILICA, STEEL), radii, adhesion, load, (normal, shear))
    A, B, F, _ = mixed([SILICA, STEEL], (np.array([0]), np.array([1])), (np.array([RADIUS]), np.array([other])))
    overlaps = np.linspace(0.1, 20, 200_001) * ((F[0] + load) / A[0]) ** (2 / 3)
    law = dmt(overlaps, A, B, F) if adhesion == "dmt" else jkr(overlaps[::100], A, B, F)
    overlaps = overlaps if adhesion == "dmt" else overlaps[::100]
    rest = np.interp(load, pressing * law.push, overlaps)
    # Parabolas of a grid, whose steps are 1e-4 and 1e-2 of an overlap
    assert pressing * np.interp(rest, overlaps, law.stiffness) == pytest.approx(normal, rel=1e-4)
    assert shearing * np.interp(rest, overlaps, law.shear) == pytest.approx(shear, rel=1e-4)


def test_what_is_not_measured_is_as_the_moduli_say() -> None:
    assert scaled((SILICA, SILICA), (RADIUS, RADIUS), "dmt", 0.0, (None, None)) == (1.0, 1.0)
    pressing, shearing = scaled((SILICA, SILICA), (RADIUS, RADIUS), "dmt", 0.0, (None, 100.0))
    assert pressing == 1.0
    assert shearing < 1.0
    bare = Material(73e9, 0.17)
    with pytest.raises(TheoryError, match="the contact at rest has neither a load nor adhesion"):
        scaled((bare, bare), (RADIUS, RADIUS), "dmt", 0.0, (500.0, None))
