"""Measured stiffnesses of a scene, of all contacts or by pair of kinds, and their spread."""

from granular_lmp.crystal.sphere import Sphere
from granular_lmp.scene.bodies import Contact

_ROUNDS = 60  # each round reduces the error of a scale by a third at least


def measured(sphere: Sphere, contact: Contact) -> Sphere:
    """Return the sphere whose contact at rest has the measured stiffnesses: moduli and work of adhesion scaled.

    The moduli and the work of adhesion are scaled, which scales the forces at every overlap; a load has another overlap
    then. E and ν are those of no material where no material has such a ratio of stiffnesses (`Sphere.with_moduli`).
    """
    if contact == Contact() or not sphere.static_overlap:  # the check of the sphere says what presses no contact
        return sphere
    normal = sphere.normal_stiffness if contact.normal_stiffness is None else contact.normal_stiffness
    found = sphere
    for _ in range(_ROUNDS):
        law = found.contact_law
        given = float(sphere.contact_law.shear_stiffness(found.static_overlap))  # under a load the overlap changes
        shear = given if contact.shear_stiffness is None else contact.shear_stiffness
        kappa, scale = shear / normal / float(law.excess(found.static_overlap)), normal / found.normal_stiffness
        modulus = found.effective_modulus * scale
        found = found.with_moduli(modulus, kappa * modulus / 4, found.work_of_adhesion * scale)
        if abs(scale - 1) < 1e-15:
            break
    return found
