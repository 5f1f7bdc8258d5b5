"""Choice of a theory of p(τ), q(τ), φ(τ) for a wave: the table of the theories, and the rule of `best`.

Every theory is a function of a `Wave` and of times. The theories differ in their terms beyond the linear wave:

| name | beyond the linear wave | fails |
|---|---|---|
| second-order | second harmonic, the paper's order | by phase drift, σa²τ; at resonance and antiresonance |
| frequency-shift | also the drift of the fundamental | in p, as second-order |
| three-mode | also all exchange of energy with 2ξ and 3ξ | in p at the antiresonance |
| hierarchy | all waves to order a⁶, every law | at long times, once any correction is large |
| exact-lattice | everything: the lattice itself is integrated | when contacts open |

A scene may include physics beyond the paper's (`granular_analysis.theory.contact`).
`granular_analysis.theory.catalogue` lists the parts of it that each theory includes; a theory refuses all others. The
three waves of three-mode lack corrections of relative order η, the overlap ratio. All theories here require a running
plane wave in a perfect lattice whose contacts stick and stay closed; for any other run,
`granular_analysis.measure.reference` integrates the network of the spheres.

`best` takes the hierarchy if its last orders show that it has converged. Otherwise it takes three-mode, which is valid
for long times near the resonance. It takes the exact lattice if three-mode excludes a trait of the run, and at the
antiresonance.
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


# Effects whose values `contact_of` or `others_of` reads, beyond on and off
_SAID = frozenset({"shear", "rotation", "damping", "sliding", "contact_opening"})


def switched(record: Record) -> dict[str, bool]:
    """Return whether each effect is on, by name.

    Without ``run.json`` the result has only the effects that the scene switches on or off; callers apply the default
    of an effect that is "auto".
    """
    on = {name: value for name, value in vars(record.scene.effects).items() if isinstance(value, bool)}
    return on | {name: effect["on"] for name, effect in record.info.get("effects", {}).items()}


def contact_of(record: Record) -> Contact:
    """Return the contact of a run, from its scene and the effects in ``run.json``.

    Raises ValueError for a contact that no theory here describes.
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
    """Return the traits of a run beyond its contact and its direction, including keys that no theory knows."""
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
    """Return all traits of a run, in the words of `granular_analysis.theory.catalogue`.

    An unknown shear law or an impossible contact is a trait too, which no theory includes.
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
    """Return the wave with which a run started, in LAMMPS's contact geometry.

    Raises TheoryError for a run with a trait that no theory knows.
    """
    unknown = traits_of(record) - catalogue.KNOWN
    if unknown:
        raise TheoryError(f"no theory here holds {', '.join(sorted(unknown))}")
    scene, contact = record.scene, contact_of(record)
    declared = scene.require_wave()
    name = declared.mode
    # Outside the plane and in cells of several spheres the mode is only a label: no plane-wave theory includes it
    other = catalogue.said("wave.mode", name) in catalogue.BRANCHES | catalogue.IN_SPACE
    named = "L" if other else one_of(MODES, name, "wave.mode")
    linear = replace(mode(named, scene.wavenumber, direction_of(record), contact), name=name)
    return Wave(linear, declared.amplitude, contact, declared.phase, others_of(record))


def traits(wave: Wave) -> frozenset[str]:
    """Return all traits of a wave: of its contact, its direction, and its run."""
    return wave.others | catalogue.contact_traits(wave.contact, along_y=wave.mode.along_y)


def second_order(wave: Wave, tau: Floats) -> Trajectory:
    """Return p, q, φ to second order: by the paper's closed form if it includes the wave, otherwise by the crystal."""
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
    """Return the names of the theories that include all traits of a wave."""
    return [name for name in THEORIES if not catalogue.missing(name, traits(wave))]


def beyond(wave: Wave) -> list[str]:
    """Return the missing traits of the plane-wave theory that lacks the fewest; empty if one includes all."""
    return min((catalogue.missing(name, traits(wave)) for name in THEORIES), key=len)


def refuse_less(name: str, traits: frozenset[str]) -> None:
    """Raise TheoryError if the named reference leaves out any of the traits; the message lists references with all."""
    if missing := catalogue.missing(name, traits):
        allowed = [each for each in catalogue.REFERENCES if not catalogue.missing(each, traits)]
        raise TheoryError(
            f"theory = {name!r} leaves out {', '.join(missing)}; theories that hold it: {', '.join(allowed) or 'none'}"
        )


def trajectory(name: str, wave: Wave, tau: Floats) -> Trajectory:
    """Return p, q, φ of one of `THEORIES`; TheoryError if the theory leaves out a trait of the wave."""
    refuse_less(name, traits(wave))
    return _computed(name, wave, tuple(np.asarray(tau, dtype=float).tolist()))


@lru_cache(maxsize=8)  # a table and its figure ask for the same two or three theories of each run
def _computed(name: str, wave: Wave, times: tuple[float, ...]) -> Trajectory:
    p, q, phi = (np.asarray(values) for values in THEORIES[name](wave, np.array(times)))
    for values in (p, q, phi):
        values.flags.writeable = False  # the cache returns the same arrays again
    return p, q, phi


# Share of the largest component below which a component is rounding of a zero by symmetry. From a = 1e-7 on, p of a
# shear wave lies above it.
SILENT = 1e-9
# Largest share of any component that the two last orders of the hierarchy may have; the error is smaller still
CONVERGED = 0.02
LONGEST = 400.0  # τ up to which `best` tries the hierarchy, whose orders grow with time
PERIODS = 4  # periods in which free and forced waves beat while phases have hardly drifted


def best(wave: Wave, tau: Floats) -> str:
    """Return the name of the best theory for the wave at the times, by the module's rule.

    Raises TheoryError if no theory includes all traits of the wave.
    """
    allowed = holding(wave)
    if not allowed:
        raise TheoryError(f"no theory of a plane wave holds {', '.join(beyond(wave))}")
    cancels = drive_cancels(wave)
    share = last_orders(wave, tau) if tau[-1] <= LONGEST else np.inf
    # Where p begins at fourth order, the next orders are smaller than the last by this share again: the error is its
    # square
    if share ** (2 if cancels else 1) < CONVERGED:
        return "hierarchy"
    return "three-mode" if "three-mode" in allowed and not cancels else "exact-lattice"


def last_orders(wave: Wave, tau: Floats) -> float:
    """Return the share of the two last orders of the hierarchy in p, q or φ over all rows: the largest of the three.

    A component below `SILENT` of the largest is left out: it is zero by symmetry and consists of rounding.
    """
    few = np.linspace(tau[0], tau[-1], 61)
    orders = hierarchy_orders(wave.mode, wave.contact, few, rtol=1e-6)
    terms = orders * (wave.amplitude ** np.arange(len(orders)))[:, None, None, None]  # as (order, T, component, K)
    tail, total = (np.sqrt(np.sum(part.sum(axis=0) ** 2, axis=(0, 2))) for part in (terms[-2:], terms))
    moves = total > SILENT * np.max(total)
    return float(np.max(tail[moves] / total[moves]))


def drive_cancels(wave: Wave) -> bool:
    """Return True if the fourth order of p exceeds the second for a wave along y, as at the antiresonance.

    There translation and rotation drive the second harmonic with opposite signs. In other directions the second
    harmonic has three components, which do not vanish together.
    """
    return wave.mode.along_y and wave.amplitude > second_order_until(wave.mode, wave.contact)


@lru_cache(maxsize=64)
def second_order_until(mode: Mode, contact: Contact) -> float:
    """Return the amplitude D0/Δ0 at which the second and fourth orders of p are equal over the first periods.

    At later times the drift of phases increases the fourth order, but it does not change the size of the second
    harmonic.
    """
    early = np.linspace(0, PERIODS * 2 * np.pi / mode.frequency, 61)
    orders = hierarchy_orders(mode, contact, early, order=4, rtol=1e-6)
    second, fourth = (float(np.linalg.norm(orders[power - 1][:, 0])) for power in (2, 4))
    return float(np.sqrt(second / fourth)) if fourth else np.inf
