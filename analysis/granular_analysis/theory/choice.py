"""Choice of a theory for a wave: one table of what this folder can say about p(τ), q(τ), φ(τ), and a rule that picks.

Every theory is a function of a `Wave` and of times; they differ in what they leave out:

| name | what it holds beyond the linear wave | fails |
|---|---|---|
| second-order | the second harmonic: the paper's order | as the phase drifts, σa²τ; at resonance and antiresonance |
| frequency-shift | and the drift of the fundamental | p is still the paper's |
| three-mode | and all exchange of energy with 2ξ and 3ξ | p at the antiresonance |
| hierarchy | all waves to order a⁶, every law | once any correction has grown large: long times |
| exact-lattice | everything: the lattice itself, integrated, not a formula | when contacts open |

A scene may call for other physics than the paper's (`granular_analysis.theory.contact`). What each theory holds of it
stands in `granular_analysis.theory.catalogue`, and nothing else is held. Three waves lack corrections of relative
order η, the overlap ratio. What is no running plane wave in a perfect lattice whose contacts
stick and stay closed is in none of them; `granular_analysis.measure.reference` then takes the network of the spheres.

`best` takes the hierarchy where its own last orders say that it has converged; else three-mode, which holds for long
times near the resonance, or the exact lattice where three-mode leaves out what the scene has, and at the antiresonance.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from granular_analysis import second_harmonic as closed
from granular_analysis.second_harmonic import ALONG_Y, MODES, Mode
from granular_analysis.theory import catalogue
from granular_analysis.theory.bloch import mode
from granular_analysis.theory.contact import LAWS, Contact
from granular_analysis.theory.errors import TheoryError as TheoryError
from granular_analysis.theory.errors import one_of
from granular_analysis.theory.hierarchy import hierarchy, hierarchy_orders
from granular_analysis.theory.lattice import torus
from granular_analysis.theory.resonance import three_mode
from granular_analysis.theory.wave import Wave, shifted_second_order
from granular_analysis.theory.wave import trajectory as of_the_crystal
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Trajectory = tuple[Floats, Floats, Floats]


# `contact_of` or `others_of` say more of these effects than that they are on
_SAID = frozenset({"shear", "rotation", "damping", "sliding", "contact_opening"})


def switched(record: Record) -> dict[str, bool]:
    """Return which effects are on, by name.

    A record without ``run.json`` has the effects that its scene switches, and those that are "auto" at their usual.
    """
    on = {name: value for name, value in vars(record.scene.effects).items() if isinstance(value, bool)}
    return on | {name: effect["on"] for name, effect in record.info.get("effects", {}).items()}


def contact_of(record: Record) -> Contact:
    """Return the contact of a run: the one place that knows where scene and ``run.json`` say it.

    Raises ValueError for a contact that none of the theories here can be given.
    """
    sphere, declared, on = record.scene.sphere, record.scene.effects, switched(record)
    damped = on.get("damping", True)
    return Contact.of(
        sphere,
        law=declared.shear_law,
        shear=on.get("shear", True),
        rotation=on.get("rotation", True),
        viscosity=declared.viscosity * sphere.time_scale / sphere.mass if damped else 0.0,
        restitution=declared.restitution if damped and declared.restitution < 1 else None,
    )


def direction_of(record: Record) -> float:
    """Return the direction of the wave vector of a run, in degrees from a close-packed row."""
    return record.scene.direction


def others_of(record: Record) -> frozenset[str]:
    """Return the traits of a run that neither its contact nor its direction has, keys that none knows among them."""
    scene, on = record.scene, switched(record)
    effects, guards = record.info.get("effects", {}), record.info.get("guards", {})
    parted = effects.get("contact_opening", {}).get("called_for", False)
    said = {"packing.lattice": scene.packing.lattice} if scene.packing.lattice != "hexagonal" else {}
    if scene.wave is not None:
        said |= {"wave.form": scene.wave.form, "wave.mode": scene.wave.mode, "packing.ends": scene.shape.ends}
    present = {
        catalogue.SLIDING: on.get("sliding", False),
        catalogue.OPENING: parted or guards.get("open_contacts", {}).get("passed_at") is not None,
        catalogue.ENVELOPE: scene.wave is not None and scene.envelope.finite,
    }
    unknown = {
        key
        for key, value in scene.departures().items()
        if key not in {"name", "inclusion", *catalogue.KEYS} and not (key.startswith("effects.") and value is False)
    }
    differing = {
        f"inclusion.{key}"
        for each in scene.inclusion
        for key, value in vars(each).items()
        if value != getattr(type(each)(), key)
    }
    return frozenset(
        {catalogue.said(key, value) for key, value in said.items()}
        | {name for name, there in present.items() if there}
        | {f"effects.{name}" for name, there in on.items() if there and name not in _SAID}
        | unknown
        | differing
    )


def traits_of(record: Record) -> frozenset[str]:
    """Return all that a theory of a run must hold, in the words of `granular_analysis.theory.catalogue`.

    A law that is unknown is a trait too, and so is what else is wrong with a contact: no theory holds it.
    """
    law = record.scene.effects.shear_law
    if law not in LAWS:
        return others_of(record) | {catalogue.said("effects.shear_law", law)}
    try:
        contact = contact_of(record)
    except ValueError as error:
        return others_of(record) | {f"a contact whose {error}"}
    return others_of(record) | catalogue.contact_traits(contact, along_y=direction_of(record) == ALONG_Y)


def wave_of(record: Record) -> Wave:
    """Return the wave that a run started with, in LAMMPS's contact geometry.

    Raises TheoryError for a run with anything that no theory knows.
    """
    unknown = traits_of(record) - catalogue.KNOWN
    if unknown:
        raise TheoryError(f"no theory here holds {', '.join(sorted(unknown))}")
    scene, contact = record.scene, contact_of(record)
    declared = scene.require_wave()
    name = declared.mode
    # A branch of several spheres a cell, which no theory of a plane wave holds, is known by its number alone
    other = catalogue.said("wave.mode", name) in catalogue.BRANCHES | catalogue.IN_SPACE
    named = "L" if other else one_of(MODES, name, "wave.mode")
    linear = replace(mode(named, scene.wavenumber, direction_of(record), contact), name=name)
    return Wave(linear, declared.amplitude, contact, declared.phase, others_of(record))


def traits(wave: Wave) -> frozenset[str]:
    """Return all that a theory of a wave must hold: its contact, its direction, and what else its run has."""
    return wave.others | catalogue.contact_traits(wave.contact, along_y=wave.mode.along_y)


def second_order(wave: Wave, tau: Floats) -> Trajectory:
    """Return p, q, φ of the paper's order, by its closed form where that holds the wave, else by the crystal's."""
    if wave.contact.departures or not wave.mode.along_y:
        return of_the_crystal(wave, tau)
    return closed.second_order(wave.mode, wave.contact.closed, wave.amplitude, tau, phase=wave.phase)


THEORIES: dict[str, Callable[[Wave, Floats], Trajectory]] = {
    "second-order": second_order,
    "frequency-shift": shifted_second_order,
    "three-mode": three_mode,
    "hierarchy": hierarchy,
    "exact-lattice": partial(torus, rtol=1e-10),
}


def holding(wave: Wave) -> list[str]:
    """Return the names of the theories that hold all that a wave has."""
    return [name for name in THEORIES if not catalogue.missing(name, traits(wave))]


def beyond(wave: Wave) -> list[str]:
    """Return what keeps a wave from the theory of plane waves that lacks least of it; nothing if one holds it all."""
    return min((catalogue.missing(name, traits(wave)) for name in THEORIES), key=len)


def refuse_less(name: str, traits: frozenset[str]) -> None:
    """Raise a TheoryError if the reference of a name leaves out any of the traits; it lists those that do not."""
    if missing := catalogue.missing(name, traits):
        allowed = [each for each in catalogue.REFERENCES if not catalogue.missing(each, traits)]
        raise TheoryError(
            f"theory = {name!r} leaves out {', '.join(missing)}; theories that hold it: {', '.join(allowed) or 'none'}"
        )


def trajectory(name: str, wave: Wave, tau: Floats) -> Trajectory:
    """Return p, q, φ of one of `THEORIES`; TheoryError if it leaves out what the wave has."""
    refuse_less(name, traits(wave))
    return _computed(name, wave, tuple(np.asarray(tau, dtype=float).tolist()))


@lru_cache(maxsize=8)  # a table and its figure ask for the same two or three of each run
def _computed(name: str, wave: Wave, times: tuple[float, ...]) -> Trajectory:
    p, q, phi = (np.asarray(values) for values in THEORIES[name](wave, np.array(times)))
    for values in (p, q, phi):
        values.flags.writeable = False  # they are handed out again
    return p, q, phi


SILENT = 1e-9  # D0 per D0: rounding of what a symmetry makes zero stays below, p of a shear wave above from a = 1e-7 on
# The two last orders of the hierarchy may have this share of any component: the error is then smaller still
CONVERGED = 0.02
LONGEST = 400.0  # τ; orders grow with time, and the hierarchy is not tried beyond
PERIODS = 4  # in which free and forced waves beat, and phases have hardly drifted


def best(wave: Wave, tau: Floats) -> str:
    """Name of the theory that holds best for the wave at the times, by the module's rule.

    Raises TheoryError if none holds its physics.
    """
    allowed = holding(wave)
    if not allowed:
        raise TheoryError(f"no theory of a plane wave holds {', '.join(beyond(wave))}")
    cancels = drive_cancels(wave)
    share = last_orders(wave, tau) if tau[-1] <= LONGEST else np.inf
    # Where p begins with the fourth order, what follows the last orders is as much less than they as they are than it
    if share ** (2 if cancels else 1) < CONVERGED:
        return "hierarchy"
    return "three-mode" if "three-mode" in allowed and not cancels else "exact-lattice"


def last_orders(wave: Wave, tau: Floats) -> float:
    """Return the share of the two last orders of the hierarchy in p, q or φ, whichever is worst, over all rows.

    A component that is silent beside the largest, zero by symmetry, is left out: it is rounding, as are its orders.
    """
    few = np.linspace(tau[0], tau[-1], 61)
    orders = hierarchy_orders(wave.mode, wave.contact, few, rtol=1e-6)
    terms = orders * (wave.amplitude ** np.arange(len(orders)))[:, None, None, None]  # as (order, T, component, K)
    tail, total = (np.sqrt(np.sum(part.sum(axis=0) ** 2, axis=(0, 2))) for part in (terms[-2:], terms))
    moves = total > SILENT * np.max(total)
    return float(np.max(tail[moves] / total[moves]))


def drive_cancels(wave: Wave) -> bool:
    """Return True if p of a wave along y is less of second order than of fourth, as at the antiresonance.

    Translation and rotation drive the second harmonic with opposite signs there. In other directions it has three
    components, which do not vanish together.
    """
    return wave.mode.along_y and wave.amplitude > second_order_until(wave.mode, wave.contact)


@lru_cache(maxsize=64)
def second_order_until(mode: Mode, contact: Contact) -> float:
    """Return the amplitude D0/Δ0 at which p is as much of fourth order as of second, over the first periods.

    Later the fourth order grows by the drift of phases, which leaves the second harmonic as large as it is.
    """
    early = np.linspace(0, PERIODS * 2 * np.pi / mode.frequency, 61)
    orders = hierarchy_orders(mode, contact, early, order=4, rtol=1e-6)
    second, fourth = (float(np.linalg.norm(orders[power - 1][:, 0])) for power in (2, 4))
    return float(np.sqrt(second / fourth)) if fourth else np.inf
