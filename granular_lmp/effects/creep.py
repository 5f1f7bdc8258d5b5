"""Creep: slip accumulates and moves a layer in proportion to time, as also in LAMMPS; it limits the length of a run.

It is predicted (`granular_lmp.crystal.creep`) and measured for a running plane wave that fills a perfect crystal in
space whose contacts neither open nor slide. Measured is the mean displacement along x and y of the spheres at one place
of all cells, at the place that creeps most. Along z the mean also has a static shift, which does not grow.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.creep import creep_velocities
from granular_lmp.crystal.lattices import places
from granular_lmp.effects import contact_opening, sliding
from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import Effect
from granular_lmp.effects.guard import Guard, Prepared
from granular_lmp.effects.width import identifiers
from granular_lmp.rest.linear import mode_of, physics_of, wave_contacts
from granular_lmp.rest.scene import Scene

SHARE = 0.01  # Creep above this share of D0 is visible in a run
# Near a resonance the second harmonic may double the creep, so creep is expected from half of this on
_EXPECTED = SHARE / 2
_SILENT = 1e-15  # D0/t0: rounding of a velocity that is 0 by symmetry


def _velocities(scene: Scene) -> NDArray[np.float64]:
    """Return the velocities (P, 2) along x and y of the spheres of a cell, D0/t0."""
    incremental = scene.effects.shear_law == "incremental"
    contacts, mode = wave_contacts(scene), mode_of(scene)
    found = creep_velocities(contacts, scene.sphere, mode, physics_of(scene), incremental=incremental)
    return found[:, :2] * scene.displacement_amplitude


def _fastest(scene: Scene) -> float:
    return float(np.linalg.norm(_velocities(scene), axis=1).max())


@lru_cache(maxsize=8)  # selection, deck and rules call this for every effect
def winds_up(scene: Scene) -> bool:
    """Return whether the creep of a scene can be predicted; contacts that open or slide also move spheres."""
    plane = scene.space == 3 and scene.form.runs and not scene.envelope.finite and not scene.shape.faces
    if not plane or not scene.perfect or scene.source or scene.struck or _fastest(scene) <= _SILENT:
        return False
    return not any(each.called_for(Case(scene)).called_for for each in (contact_opening, sliding))


def expected(scene: Scene) -> bool:
    return winds_up(scene) and _fastest(scene) * scene.time.duration > _EXPECTED


def called_for(case: Case) -> Finding:
    speed = _fastest(case.scene)
    period = speed * 2 * np.pi / case.mode.frequency
    return Finding(
        expected(case.scene),
        speed * case.scene.time.duration,
        f"accumulated slip moves spheres by {{}} D0 in the run, {period:.2g} D0 per period",
    )


def creeping(problem: Prepared) -> NDArray[np.int64]:
    """Return the indices of the spheres that creep most, which are at one place of all cells."""
    speeds = np.linalg.norm(_velocities(problem.scene), axis=1)
    return np.flatnonzero(places(problem.rest.atoms) % len(speeds) == int(np.argmax(speeds)))


def measured(problem: Prepared) -> list[str]:
    """Return the lines that measure the mean displacement along x and y of the spheres that creep most."""
    own, group, lines = creeping(problem), "all", []
    if len(own) < len(problem.rest.atoms):
        group, lines = "creeping", [f"group        creeping id {identifiers(own + 1)}"]
    return [
        *lines,
        f"compute      slow {group} reduce ave c_u[1] c_u[2]",
        "variable     creep equal sqrt(c_slow[1]^2+c_slow[2]^2)/v_D0  # mean displacement, in D0",
    ]


def loss(case: Case) -> str:
    return "the deck does not change, as LAMMPS always accumulates slip"


GUARD = Guard(
    title="largest_creep",
    name="creep",
    lines=measured,
    limit=SHARE,
    meaning="in D0, the mean displacement of the spheres along the layer: accumulated slip moves the layer",
    cure="set a shorter time.duration or a smaller wave.amplitude",
)
CREEP = Effect(
    "creep",
    called_for,
    cost="1.00",
    loss=loss,
    guards=(GUARD,),
    always=True,
    switch="time.duration",
    declared=expected,
    concerns=winds_up,
)
