"""What guards ask of the adhesion laws, as formulas and words of LAMMPS, by law.

A JKR contact holds beyond an overlap of 0. LAMMPS's ``contact/atom`` and the cutoff ``radius`` of its local computes do
not know it there; with the cutoff ``type`` they list every pair up to the largest pull-off distance, with forces and
components ``p`` of 0 where LAMMPS has no contact.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Formulas:
    """Formulas of one law; ``<name>`` stands for a number of the scene.

    Attributes
    ----------
    above_pull_off : str
        f_N + F of two equal spheres of the overlap {x}, in Δ0, or a lower bound of it.
    overlap : str
        Overlap, in Δ0, of two spheres of the lattice whose f_N + F is the share {u} of what it is at rest.
    cutoff : str
        Cutoff with which local computes list all contacts.
    mark : str
        Further columns of such a compute, which tell contacts from other pairs; "" where it lists contacts alone.
    """

    above_pull_off: str
    overlap: str
    cutoff: str
    mark: str


_Y = "(0.5+0.5*sqrt({u}*<pressed>))"  # y of granular_lmp.crystal.adhesion_laws
FORMULAS = {
    "dmt": Formulas("<holding_force>*{x}^1.5", "{u}^(2/3)", "radius", ""),
    # A contact holds to <hold> Δ0 beyond its end. The parabola touches zero where f_N + F does and is below it for all
    # overlaps up to that at rest (tests/test_adhesion_laws.py)
    "jkr": Formulas(
        "<holding_force>*(({x}+<hold>)/(1+<hold>))^2", f"<unpressed_overlap>*{_Y}^(1/3)*(3*{_Y}-2)", "type", " p10 p11"
    ),
}
