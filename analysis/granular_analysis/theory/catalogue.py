"""The catalogue of theories: what each holds, by name. What a theory does not name here it does not hold.

A run has traits: the effects that are on, the form of its wave, its shear law, mode and ends, and every key of its
scene that is not known here and is not at its default (`granular_analysis.theory.choice.traits_of`). A theory holds a
run if it names all of them. A trait in no line of this file, an effect that somebody has added, is refused by all.

To extend a theory, add the trait to its line and a test that compares it with the exact lattice.
"""

from collections.abc import Iterable

from granular_analysis.theory.contact import Contact

OBLIQUE = "another direction than y"
ENVELOPE = "an envelope"
COMPRESSED = "packing.contact_force"
SLIDING = "effects.sliding"
OPENING = "effects.contact_opening"  # a trait of runs whose contacts do part
NO_SHEAR, NO_ROTATION = "effects.shear = false", "effects.rotation = false"
DAMPING = "effects.damping"
NETWORK = "network"
CRYSTAL = "crystal-second-order"
JKR = "sphere.adhesion_law = 'jkr'"


def said(key: str, value: str) -> str:
    """Return the trait of a key of the scene that holds one of some words."""
    return f"{key} = '{value}'"


RUNNING, STANDING, DRIVEN, AT_REST = (said("wave.form", form) for form in ("running", "standing", "driven", "none"))
# In the first snapshot of a run, as all that moves at the beginning
STRUCK = {"striker", "start.state", "start.noise", "start.seed"}
# Beside the hexagonal lattice of the theories; in cells of several spheres the mode is the number of a branch
LATTICES = {said("packing.lattice", name) for name in ("square", "chain", "honeycomb")}
_MATERIAL = ("youngs_modulus", "poisson_ratio", "work_of_adhesion")
MOST_BRANCHES = 600  # a film of 100 layers
BRANCHES = {said("wave.mode", str(number)) for number in range(1, MOST_BRANCHES + 1)}
# In space: lattices, what is declared of the third dimension, and branches that a mirror parts
IN_SPACE = (
    {said("packing.lattice", name) for name in ("cubic", "fcc", "hcp")}
    | {f"packing.{name}" for name in ("space", "layers", "depth", "orientation")}
    | {f"substrate.{name}" for name in (*_MATERIAL, "normal_stiffness", "shear_stiffness", "sides")}
    | {"effects.creep"}
    | {said("wave.mode", f"{family}{number}") for family in "SH" for number in range(1, MOST_BRANCHES + 1)}
)
SECANT, INCREMENTAL = (said("effects.shear_law", law) for law in ("secant", "incremental"))
QUIET = {"absorb.rows", "absorb.reflection", "effects.quiet_ends"}  # rows at the ends that absorb the wave
HELD = {said("packing.ends", "fixed"), "effects.walls"}  # walls whose echo arrives after the run, or a note says so
FACES = {f"packing.{name}" for name in ("first", "last", "sides")}  # A finite sheet has no wave of the infinite lattice

_CONTACTS = frozenset(f"effects.{name}" for name in ("adhesion", "shear", "rotation", "tracking", "width"))
_MODES = {said("wave.mode", mode) for mode in ("L", "TR", "RT")}
_SHEET = _CONTACTS | _MODES | {said("packing.ends", "periodic"), SECANT}
_LATTICE = _SHEET | HELD | {COMPRESSED, NO_SHEAR, NO_ROTATION}
_ALONG_Y = _LATTICE | {RUNNING}
_IMPERFECT = {"packing.table", *(f"disorder.{name}" for name in ("radius", "density", "vacancies", "stiffness"))} | {
    f"inclusion.{name}"
    for name in (
        *("rows", "every", "spheres", "disc", "half_plane", "share", "layers", "vacancy", "radius", "density"),
        *_MATERIAL,
    )
}

# Dashpots are in neither of the two that describe slow amplitudes, and the incremental law is not in three-mode
HOLDS: dict[str, frozenset[str]] = {
    "second-order": _ALONG_Y | {INCREMENTAL, OBLIQUE, JKR},
    "frequency-shift": _ALONG_Y | {INCREMENTAL, OBLIQUE, JKR},
    "three-mode": _ALONG_Y | {JKR},
    "hierarchy": _ALONG_Y | {INCREMENTAL, OBLIQUE, DAMPING, JKR},
    "exact-lattice": _ALONG_Y | {INCREMENTAL, OBLIQUE, DAMPING, JKR},
    # A contact that opens loses its adhesive force, as in LAMMPS; in the lattices and formulas above it keeps it
    NETWORK: _ALONG_Y
    | {JKR, STANDING, AT_REST, DRIVEN, ENVELOPE, INCREMENTAL, OBLIQUE, DAMPING, SLIDING, OPENING, *LATTICES, *BRANCHES}
    | STRUCK
    | QUIET
    | {"source"}
    | FACES
    | IN_SPACE
    | _IMPERFECT
    | {"pair"},
    # Rows of other densities in a pattern that repeats; `granular_analysis.theory.scenes` refuses what is no pattern
    CRYSTAL: _ALONG_Y
    | {STANDING, INCREMENTAL, OBLIQUE, JKR, *LATTICES, *BRANCHES}
    | {f"inclusion.{name}" for name in ("rows", "every", "density")}
    | {"pair"},
}

KNOWN = frozenset().union(*HOLDS.values())
REFERENCES = tuple(HOLDS)  # what a record is compared with

# Keys of a scene whose values theories are given, or that change no motion. Any other is a trait by its mere presence.
KEYS = frozenset({"monitor"}).union(
    f"{section}.{key}"
    for section, keys in {
        "sphere": "radius youngs_modulus poisson_ratio work_of_adhesion density contact_force adhesion_law",
        "contact": "normal_stiffness shear_stiffness",
        "packing": "lattice rows columns ends contact_force relax relax_friction relax_by",
        "wave": "mode wavenumber amplitude phase form direction",
        "envelope": "length width offset ramp",
        "time": "duration timestep tolerance sample allow_echo",
        "effects": "adhesion shear rotation tracking sliding damping contact_opening "
        "rolling twisting shear_law friction viscosity restitution "
        "rolling_stiffness rolling_viscosity rolling_friction",
        "output": "particles checkpoint forces",
        "disorder": "seed",
        "substrate": "density",
    }.items()
    for key in keys.split()
)


def contact_traits(contact: Contact, *, along_y: bool) -> frozenset[str]:
    """Return the traits of a contact, and of the direction of the wave."""
    present = {
        "effects.shear" if contact.shear else NO_SHEAR: True,
        "effects.rotation" if contact.rotation else NO_ROTATION: True,
        said("effects.shear_law", contact.law): contact.shear,
        COMPRESSED: contact.prestress > 0,
        JKR: contact.adhesion_law == "jkr",
        DAMPING: contact.viscosity > 0 or contact.restitution is not None,
        OBLIQUE: not along_y,
    }
    return frozenset(name for name, there in present.items() if there)


def missing(theory: str, traits: Iterable[str]) -> list[str]:
    """Return the traits that a theory does not hold, in alphabetical order."""
    return sorted(set(traits) - HOLDS[theory])
