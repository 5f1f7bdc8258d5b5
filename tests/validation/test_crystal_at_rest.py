"""The crystal at rest is at rest in LAMMPS: w gives γ, γ and E give Δ0, and at Δ0 no contact pushes or pulls.

In a periodic crystal symmetry balances the forces on a sphere whatever its contacts do. So the force of each contact is
read, and the force on the first row of a strip, which has neighbours on one side only. Between compressed contacts both
are those of the outer pressure.
"""

import re
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp import Scene, build
from granular_lmp.units import units_for
from tests.conftest import PAPER
from tests.instance import silent_lammps

ROWS, COLUMNS = 9, 4
SCENE = PAPER.with_values({"packing.rows": ROWS, "packing.columns": COLUMNS, "time.allow_echo": True})
SPHERES: list[dict[str, Any]] = [
    {},
    {"sphere.radius": 4e-6, "sphere.youngs_modulus": 3e9, "sphere.poisson_ratio": 0.35, "sphere.density": 1050.0},
    {"sphere.radius": 2e-4, "sphere.work_of_adhesion": 0.4},
]


@dataclass(frozen=True)
class Forces:
    """Forces of the crystal in units of the adhesive force F = 2πwRc.

    contacts holds the repulsion of each contact, first_row that on each sphere of the first row, away from the others.
    """

    contacts: np.ndarray
    first_row: np.ndarray


def forces(scene: Scene, folder: Path, gamma: float = 1.0) -> Forces:
    """Evaluate the forces of a scene's deck before anything moves, with γ of its contact model times a factor."""
    deck, units = build(scene), units_for(scene.sphere.radius)
    deck.write(folder)
    until_contacts, preload, _ = deck.input_text.partition("# --- preload")
    assert preload
    (found,) = re.finditer(r"^pair_coeff +\* \* dmt (?:\S+ ){3}(\S+) &$", until_contacts, re.MULTILINE)
    start, end = found.span(1)
    with silent_lammps() as lammps:
        lammps.command(f'variable data index "{folder / deck.data_name}"')
        lammps.commands_string(f"{until_contacts[:start]}{gamma * float(found[1])!r}{until_contacts[end:]}")
        lammps.commands_string("""
            compute contact all pair/local dist force
            thermo_style custom step
            fix move all nve/noforce
            run 0 post no
            """)
        distance, repulsion = lammps.numpy.extract_compute("contact", 2, 2).T.copy()
        order = np.argsort(lammps.numpy.extract_atom("id")[: ROWS * COLUMNS])
        outward = -lammps.numpy.extract_atom("f")[order[:COLUMNS], 1]
    touching = distance < 2 * units.number(scene.sphere.radius, length=1)
    unit = units.number(scene.sphere.pull_off_force, mass=1, length=1, time=-2)
    return Forces(repulsion[touching] / unit, outward / unit)


def pushes(made: Forces, force: float, scene: Scene) -> bool:
    """Return whether each contact pushes with a force, and the first row feels two contacts at 30° to its normal.

    Positions are rounded to 1e-16 of the strip, and a contact makes 1.5 F of each Δ0; twenty times that is allowed.
    """
    allowed = 20 * 1.5 * np.finfo(float).eps * ROWS / scene.sphere.overlap_ratio
    assert allowed < 1e-7
    contacts, first_row = made.contacts - force, made.first_row - sqrt(3) * force
    return bool(np.all(np.abs(contacts) < allowed) and np.all(np.abs(first_row) < 2 * allowed))


@pytest.mark.parametrize("factor", [1.0, 2.0, 0.5, 1 + 1e-6])
@pytest.mark.parametrize("sphere", SPHERES, ids=["silica", "polystyrene", "large"])
def test_no_contact_pushes_and_with_another_gamma_each_is_out_of_balance_by_as_much(
    sphere: dict[str, Any], factor: float, tmp_path: Path
) -> None:
    scene = SCENE.with_values(sphere)
    made = forces(scene, tmp_path / "run", gamma=factor)
    assert (len(made.contacts), len(made.first_row)) == (3 * ROWS * COLUMNS - 2 * COLUMNS, COLUMNS)
    assert pushes(made, 0.0, scene) == (factor == 1)
    assert pushes(made, 1 - factor, scene)


def test_compressed_contacts_push_with_the_declared_force(tmp_path: Path) -> None:
    half = {"packing.contact_force": 0.5 * PAPER.sphere.pull_off_force}
    scene = SCENE.with_values(half)
    made = forces(scene, tmp_path / "run")
    assert pushes(made, 0.5, scene)
    assert not pushes(made, 0.0, scene)
