"""Which physics a deck carries for a scene, with the number that says why.

Every deck carries adhesion, shear and rotation. Two effects should stay silent, and the numbers here say whether they
will: contacts should not slide (the friction coefficient is set so that the paper's no-slip contact holds) and, for the
perturbation theory to mean anything, should not open.
"""

from dataclasses import dataclass

import ase

from granular_lmp.modes import Mode, largest_stretch
from granular_lmp.scene import Scene
from granular_lmp.sphere import INERTIA_RATIO

# μ = 5a keeps F_t under 0.6 of the sliding force for every mode. Much larger is wrong too: LAMMPS skips turning the
# shear history with the contact while its normal part is below 1e-10 of the sliding force, which then freezes it.
FRICTION_PER_AMPLITUDE = 5.0


@dataclass(frozen=True)
class Effect:
    """One effect: is it in the deck, the number behind that, and the sentence that explains the number."""

    name: str
    on: bool
    number: float
    reason: str


def effects(scene: Scene, packing: ase.Atoms, mode: Mode) -> list[Effect]:
    """The effects of the scene's deck, in the order in which a contact meets them."""
    sphere, amplitude = scene.sphere, scene.wave.amplitude
    normal, shear = largest_stretch(packing, sphere, mode)
    overlap = 1 - amplitude * normal
    # F_t/(μ F_crit) at the equilibrium overlap: g1 δS D0/(μ 2F), with k1 Δ0 = 3F/2 and LAMMPS's F_crit = F_N + 2F.
    sliding = 0.75 * sphere.stiffness_ratio * shear / FRICTION_PER_AMPLITUDE
    translation = mode.ux**2 + mode.uy**2
    spin = INERTIA_RATIO * mode.f**2
    share = spin / (translation + spin)
    return [
        Effect("adhesion", True, sphere.pull_off_force, "N of DMT adhesion hold the lattice together"),
        Effect("shear", True, shear, f"D0 of shear displacement at the most sheared contact of a {mode.name} wave"),
        Effect("rotation", True, share, f"of the kinetic energy of the {mode.name} mode is rotation"),
        Effect("sliding", False, sliding, "of the sliding force is the largest expected shear (friction 5 D0/Delta0)"),
        Effect(
            "contact_opening",
            overlap <= 0,
            overlap,
            "of the static overlap is left at the most stretched contact"
            if overlap > 0
            else "contacts open: the wave pulls them beyond the static overlap, and no closed form holds",
        ),
        Effect(
            "walls",
            scene.packing.ends == "fixed",
            scene.echo_time,
            "tau is when the held rows are heard at the centre"
            if scene.packing.ends == "fixed"
            else "a periodic cell: the infinite lattice",
        ),
    ]
