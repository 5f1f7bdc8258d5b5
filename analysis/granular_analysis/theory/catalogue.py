"""Catalogue of theories: the traits of a run that each theory includes. A theory refuses every trait not listed here.

The traits of a run are its active effects, the form, mode and shear law of its wave, its ends, and every key of its
scene that is unknown here and differs from its default (`granular_analysis.theory.choice.traits_of`). A theory includes
a run if it lists all of its traits. Every theory refuses a trait that this file does not list, such as a newly added
effect.

To extend a theory, add the trait to its line, with a test that compares the theory with the exact lattice.
"""

from collections.abc import Iterable

from granular_analysis.theory.contact import Contact

OBLIQUE = "another direction than y"
ENVELOPE = "an envelope"
COMPRESSED = "packing.contact_force"
SLIDING = "effects.sliding"
OPENING = "effects.contact_opening"  # a trait of runs whose contacts actually open
NO_SHEAR, NO_ROTATION = "effects.shear = false", "effects.rotation = false"
DAMPING = "effects.damping"
NETWORK = "network"
CRYSTAL = "crystal-second-order"
JKR = "sphere.adhesion_law = 'jkr'"


def said(key: str, value: str) -> str:
    """Return the trait of a scene whose key has this value, as "key = 'value'"."""
    return f"{key} = '{value}'"


RUNNING, STANDING, DRIVEN, AT_REST = (said("wave.form", form) for form in ("running", "standing", "driven", "none"))
# Initial motion, which the first snapshot of a run contains
STRUCK = {"striker", "start.state", "start.noise", "start.seed"}
# Planar lattices other than the hexagonal one; with several spheres per cell the mode is the number of a branch
LATTICES = {said("packing.lattice", name) for name in ("square", "chain", "honeycomb")}
_MATERIAL = ("youngs_modulus", "poisson_ratio", "work_of_adhesion")
MOST_BRANCHES = 600  # a film of 100 layers
BRANCHES = {said("wave.mode", str(number)) for number in range(1, MOST_BRANCHES + 1)}
# In space: lattices, keys of the third dimension and of the substrate, and branches that a mirror separates
IN_SPACE = (
    {said("packing.lattice", name) for name in ("cubic", "fcc", "hcp")}
    | {f"packing.{name}" for name in ("space", "layers", "depth", "orientation")}
    | {f"substrate.{name}" for name in (*_MATERIAL, "normal_stiffness", "shear_stiffness", "sides")}
    | {"effects.creep"}
    | {said("wave.mode", f"{family}{number}") for family in "SH" for number in range(1, MOST_BRANCHES + 1)}
)
SECANT, INCREMENTAL = (said("effects.shear_law", law) for law in ("secant", "incremental"))
QUIET = {"absorb.rows", "absorb.reflection", "effects.quiet_ends"}  # rows at the ends that absorb the wave
HELD = {said("packing.ends", "fixed"), "effects.walls"}  # walls whose echo arrives after the run or causes a warning
FACES = {f"packing.{name}" for name in ("first", "last", "sides")}  # a finite sheet has no wave of the infinite lattice

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

# Of the theories of a plane wave, only hierarchy and exact-lattice include dashpots, and three-mode excludes the
# incremental law
HOLDS: dict[str, frozenset[str]] = {
    "second-order": _ALONG_Y | {INCREMENTAL, OBLIQUE, JKR},
    "frequency-shift": _ALONG_Y | {INCREMENTAL, OBLIQUE, JKR},
    "three-mode": _ALONG_Y | {JKR},
    "hierarchy": _ALONG_Y | {INCREMENTAL, OBLIQUE, DAMPING, JKR},
    "exact-lattice": _ALONG_Y | {INCREMENTAL, OBLIQUE, DAMPING, JKR},
    # In the network, as in LAMMPS, an opening contact loses its adhesive force; the lattices and formulas above keep it
    NETWORK: _ALONG_Y
    | {JKR, STANDING, AT_REST, DRIVEN, ENVELOPE, INCREMENTAL, OBLIQUE, DAMPING, SLIDING, OPENING, *LATTICES, *BRANCHES}
    | STRUCK
    | QUIET
    | {"source"}
    | FACES
    | IN_SPACE
    | _IMPERFECT
    | {"pair"},
    # Rows of other densities in a repeating pattern; `granular_analysis.theory.scenes` refuses rows that do not repeat
    CRYSTAL: _ALONG_Y
    | {STANDING, INCREMENTAL, OBLIQUE, JKR, *LATTICES, *BRANCHES}
    | {f"inclusion.{name}" for name in ("rows", "every", "density")}
    | {"pair"},
}

KNOWN = frozenset().union(*HOLDS.values())
REFERENCES = tuple(HOLDS)  # theories with which a record can be compared

# Keys whose values are passed to the theories, or that change no motion. Any other key is a trait by its presence.
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
    """Return the traits of a contact and of the direction of the wave."""
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
    """Return the traits that a theory does not include, in alphabetical order."""
    return sorted(set(traits) - HOLDS[theory])
