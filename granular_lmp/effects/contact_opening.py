"""Opening: contacts open and close again. LAMMPS always allows this, so the deck does not change."""

from math import inf

import numpy as np

from granular_lmp.crystal.search import overlapping
from granular_lmp.effects.case import NOTHING, Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect
from granular_lmp.effects.guard import Guard
from granular_lmp.effects.openings import changed_lines
from granular_lmp.effects.reading import judged_singly
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.scene import Scene

GUARD = Guard(
    title="open_contacts",
    name="open",
    lines=changed_lines,
    limit=0.0,
    meaning="contacts opened or formed, so no closed form is valid and shear forces are lost",
    cure="set effects.contact_opening = true, or use a smaller wave.amplitude or a slower striker",
    of_contacts=True,
    per_contact=judged_singly,
)


def called_for(case: Case) -> Finding:
    pulled = np.abs(case.stretches[0])
    left = float(np.min(case.overlaps - case.ends - pulled))
    if left > 0 and not case.scene.perfect and (meeting := _meeting(case)):
        return Finding(True, float(meeting), "{} pairs of spheres that do not touch at rest are close enough to meet")
    if left > 0:
        stays = "the most strongly pulled contact stays {} of the static overlap away from opening"
        return Finding(False, left, stays + _most(case))
    return Finding(True, -left, "the most strongly pulled contact opens by {} of the static overlap" + _most(case))


def _most(case: Case) -> str:
    """Return words for the amplitude at which the weakest contact of an imperfect crystal opens."""
    if case.scene.perfect or case.scene.wave is None:
        return ""
    pulled = np.abs(case.stretches[0]) / case.scene.wave.amplitude
    opens = np.min((case.overlaps - case.ends) / np.maximum(pulled, NOTHING))
    return f"; the weakest contact opens at wave.amplitude = {opens:.3g}"


def _meeting(case: Case) -> int:
    """Return the number of pairs with a gap at rest, smaller than the largest stretch, that may meet."""
    near, sphere = crystal_of(case.scene).atoms.copy(), case.scene.sphere
    near.arrays["radius"] = near.arrays["radius"] + np.abs(case.stretches[0]).max() * (
        sphere.static_overlap / sphere.radius / 2
    )
    known, (i, j, _) = case.contacts, overlapping(near)
    touching = np.sort((known.i * len(near) + known.j)[~known.on_wall], kind="stable")  # sorted except for walls
    pairs = i * len(near) + j
    place = np.searchsorted(touching, pairs)
    return int((touching.take(place, mode="clip") != pairs).sum())


def of_meeting(case: Case) -> Finding:
    force = case.scene.packing.contact_force
    pressed = "{} N press the contacts together" if force else "no force holds the contacts together"
    return Finding(True, force or inf, pressed)


def loss(case: Case) -> str:
    return "the guard reports it; the deck does not change, as LAMMPS always lets contacts open"


def order(scene: Scene) -> int:
    """Return 0: a contact opens at any phase of a step."""
    return 0


def order_of_meeting(scene: Scene) -> int:
    """Return 1 for contacts that snap in and off at any moment of a step; others open without a force."""
    return 1 if scene.start.touching else 2


CONTACT_OPENING = Effect(
    "contact_opening",
    called_for,
    meeting=AmongMeeting(of_meeting, order=order_of_meeting),
    cost="1.00",
    loss=loss,
    order=order,
    guards=(GUARD,),
    always=True,
    recorded=True,
)
