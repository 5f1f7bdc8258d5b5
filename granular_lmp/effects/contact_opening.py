"""Opening: contacts part and meet again. LAMMPS always allows it, so the deck is the same with and without."""

import numpy as np

from granular_lmp.effects.effect import Case, Effect, Finding
from granular_lmp.effects.guard import BETWEEN, CONTACT, Guard
from granular_lmp.scene.scene import Scene

MISSED = (
    "variable     missed atom f_at_rest-c_touching  # contacts that a sphere had at rest and has not now",
    "compute      missing inside reduce sum v_missed",
)

GUARD = Guard(
    title="open_contacts",
    name="open",
    lines=(
        *CONTACT,
        *MISSED,
        f"variable     open_now equal ceil(c_missing/2)+({BETWEEN:.4f}>v_overlap_now)"
        "  # one that hardly touches may open between looks",
    ),
    limit=0.0,
    meaning="contacts opened, so that no closed form holds and shear forces are lost",
    cure="set effects.contact_opening = true, or take a smaller wave.amplitude",
)


def called_for(case: Case) -> Finding:
    smallest = 1 - float(np.max(np.abs(case.stretches[0])))
    if smallest > 0:
        return Finding(False, smallest, "of the static overlap is left at the contact that is pulled most")
    return Finding(True, -smallest, "of the static overlap is how far the contact that is pulled most opens")


def loss(case: Case) -> str:
    return "the guard reports it; the deck is the same, as LAMMPS parts contacts by itself"


def first_order(scene: Scene) -> bool:
    """Return True: a contact parts inside a step."""
    return True


CONTACT_OPENING = Effect(
    "contact_opening", called_for, cost="1.00", loss=loss, first_order=first_order, guard=GUARD, always=True
)
