"""Hints for keys that a scene does not have: they are not supported, or another key declares the same.

The reasons are on the page What is not there.
"""

# What to use → words, in lower case, that a user may try as a key
NOT_SUPPORTED = {
    "use fix gravity in a deck of your own": "gravity g weight",
    "use fix langevin in a deck of your own": "temperature heat thermal",
    "use packing.lattice, or a deck of your own for another lattice": "square chain kagome cubic bcc",
    "use LIGGGHTS, YADE or MercuryDPM for grains that are not spheres": "shape polyhedra ellipsoid clump aspect_ratio",
    "use LIGGGHTS, or sphere.adhesion_law for adhesion of contacts": "liquid capillary humidity cohesion van_der_waals",
    "use effects.viscosity": "adhesive_restitution",
    "use MercuryDPM or YADE for spheres that yield or break": "plasticity yield_stress hardness fracture wear",
    "use a finite-element code, as spheres are rigid but for their contacts": "fem mesh elements",
    "use more MPI ranks, --np": "gpu cuda kokkos",
}
ELSEWHERE = {
    "[[striker]] and [start] give spheres velocities and displacements": "strikers impact projectile state",
    "[disorder] and [[inclusion]] declare spheres that differ or are missing": "vacancy vacancies defect defects "
    "random polydispersity dispersity spread seed impurity impurities interface alloy",
    "[[monitor]] declares what is recorded beside the centre sphere": "monitors flux probe probes detector receiver",
}


def hint(key: str) -> str | None:
    """Return what to use in place of a key that does not exist; None for an unknown word."""
    for hints, form in ((NOT_SUPPORTED, "not supported; {}"), (ELSEWHERE, "unknown key; {}")):
        for where, words in hints.items():
            if key.lower() in words.split():
                return form.format(where)
    return None
