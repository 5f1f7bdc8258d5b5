"""Contact laws as LAMMPS commands: the only place that writes the arguments of ``pair_coeff`` and ``fix wall/gran``.

Two equal spheres at an overlap δ and a shear displacement ξ push each other with

    f_N = A δ^{3/2} − F,   f_S = −B ξ δ^{1/2},   |f_S| ≤ μ (f_N + 2F),   F = 2π w Rc

(`granular_lmp.crystal.sphere`). The torque of f_S on each sphere has the lever arm R − δ/2. Without adhesion F = 0.
LAMMPS 22Jul2025 differs from these equations as follows; tests measure each difference:

* ``coeff_restitution`` yields the requested restitution e to the error of the step. ``tsuji`` does not (0.616 for a
  requested 0.5) and is not offered here. LAMMPS refuses both with an adhesive law.
* The sliding limit of Hertz contacts is μ times the normal force *with* its damping part, that of DMT contacts without.
* A contact by "jkr" begins at overlap 0 and ends at the largest pull, not at the largest distance as the kernel can.
* A wall has the material of the spheres, E* = E/(2(1−ν²)), G* likewise; Rc and the lever arm are R.

https://docs.lammps.org/pair_granular.html, https://docs.lammps.org/fix_wall_gran.html
"""

from collections.abc import Mapping
from dataclasses import replace
from math import pi, sqrt

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, HERTZ, NORMAL_LAWS, AdhesionLaw
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.units import AnyUnits

# The laws differ in the effect of the overlap on the shear force (docs/choosing-a-shear-law.md). "rescaled" is
# "secant" with a shear displacement that shrinks with the contact radius on unloading.
_MINDLIN = {"secant": "mindlin", "incremental": "mindlin/force", "rescaled": "mindlin_rescale"}
TANGENTIAL_LAWS = (*_MINDLIN, "none")


def model(
    sphere: Sphere,
    units: AnyUnits,
    *,
    normal: str = "dmt",
    shear: str = "secant",
    friction: float | str = 0.0,
    damping: float = 0.0,
    restitution: float | None = None,
    shear_damping: float = 0.0,
    shear_modulus: float | None = None,
    late_parting: bool = False,
    **submodels: str,
) -> str:
    """Return the contact model of two equal spheres, as `pair` and `wall` take it.

    Parameters
    ----------
    sphere : Sphere
        Material and radius.
    units : AnyUnits
        Unit style of the deck.
    normal : "dmt", "hertz" or "jkr"
        Normal law with the work of adhesion w, without it, or with adhesion that acts beyond contact too.
    shear : "secant", "incremental", "rescaled" or "none"
        Shear law.
    friction : float or str
        Coulomb coefficient μ, or a LAMMPS variable such as ``${friction}``.
    damping : float
        Coefficient η, kg/s, of the normal force −η v_n: ``damping velocity``.
    restitution : float, optional
        Coefficient e in (0, 1], instead of `damping`: ``damping coeff_restitution``.
    shear_damping : float
        Ratio of the damping coefficients of shear and normal motion.
    shear_modulus : float, optional
        Effective shear modulus G*, Pa, in place of that of the sphere's material and factors.
    late_parting : bool
        Contacts end at the largest distance, by a law of the kernel (`AdhesionLaw.late`).
    submodels : str
        Words of other parts of the model by their names, such as "rolling" and "twisting".

    Returns
    -------
    str
        Arguments of ``pair_coeff`` behind the types, over several lines.

    Raises
    ------
    ValueError
        If a law is unknown, or a restitution is combined with adhesion, which LAMMPS refuses.

    Notes
    -----
    *Good values*: see the page Contact laws for `shear`. The law breaks down when the overlap is no longer small
    (`granular_lmp.crystal.scale.LARGEST_OVERLAP_RATIO`).

    https://docs.lammps.org/pair_granular.html
    """
    if normal not in NORMAL_LAWS or shear not in TANGENTIAL_LAWS:
        raise ValueError(f"normal = {normal!r}, shear = {shear!r}: must be one of {NORMAL_LAWS} and {TANGENTIAL_LAWS}")
    if restitution is not None and (normal != HERTZ or damping):
        raise ValueError(f"restitution = {restitution!r}: needs normal = 'hertz' and no other damping")
    pressing, shearing = sphere.factors
    if shear_modulus is None and shearing != pressing:  # else LAMMPS has G* from E and ν
        shear_modulus = shearing * sphere.effective_shear_modulus
    number = sphere.poisson_ratio
    modulus = units.number(pressing * sphere.youngs_modulus, mass=1, length=-1, time=-2)
    loss = units.number(damping, mass=1, time=-1) if restitution is None else restitution
    force = f"hertz/material {modulus!r} {loss!r} {number!r}"
    if normal != HERTZ:
        half_adhesion = units.number(pressing * sphere.work_of_adhesion / 2, mass=1, time=-2)  # LAMMPS's γ
        name = ADHESION_LAWS[normal].late if late_parting else normal
        force = f"{name} {modulus!r} {loss!r} {number!r} {half_adhesion!r}"
    stiffness = "NULL" if shear_modulus is None else repr(units.number(8 * shear_modulus, mass=1, length=-1, time=-2))
    slip = f"{_MINDLIN.get(shear)} {stiffness} {shear_damping!r} {friction}"
    slip = "linear_nohistory 0.0 0.0" if shear == "none" else slip
    loss_law = "velocity" if restitution is None else "coeff_restitution"
    words = {"rolling": "none", "twisting": "none"} | submodels if submodels else {}
    more = "".join(f" {name} {text}" for name, text in words.items())
    return f"{force} &\n             tangential {slip}{more} damping {loss_law}"


def pair(contact: str) -> str:
    """Return the commands that give all contacts between spheres a `model`."""
    return f"pair_style   granular\npair_coeff   * * {contact}"


def pairs(contacts: Mapping[tuple[int, int], str]) -> str:
    """Return the commands that give the contacts between materials m ≤ n, counted from 0, each a `model`.

    The free spheres of material m have the type 2m + 1, the held ones 2m + 2. LAMMPS's own mixing would give another
    shear modulus (`granular_lmp.crystal.contacts`), so every pair of materials is written out.
    """
    if len(contacts) == 1:
        return pair(contacts[0, 0])
    types = {m: f"{2 * m + 1}*{2 * m + 2}" for _, m in contacts}
    lines = (f"pair_coeff   {types[m]} {types[n]} {contact}" for (m, n), contact in contacts.items())
    return "\n".join(["pair_style   granular", *lines])


def rigid(sphere: Sphere) -> Sphere:
    """Return the sphere whose `model` is that of `sphere` on a rigid body.

    On a rigid body 1/E* and 1/G* have one term instead of two equal ones. Both moduli are doubled by doubling E.
    """
    return replace(sphere, youngs_modulus=2 * sphere.youngs_modulus)


def of_law(law: AdhesionLaw, effective_radius: float, sphere: Sphere) -> tuple[Sphere, float]:
    """Return the sphere whose `model` has the normal force of a law, and the ``shear_modulus`` of its shear force.

    E* and w of any two bodies, and stiffnesses as measured, are those of some sphere; G* may be that of none.

    Parameters
    ----------
    law : AdhesionLaw
        Of one contact, with A = (4/3) E* √Rc, B = 8 G* √Rc and the pull-off force F.
    effective_radius : float
        Rc, m: R/2 of two equal spheres, R of a sphere on a plane.
    sphere : Sphere
        Gives radius, density, Poisson's ratio and the name of the law.
    """
    root = sqrt(effective_radius)
    modulus = 3 / 4 * float(law.normal_coefficient) / root
    adhesion = float(law.pull_off_force) / (law.pull * pi * effective_radius)
    alike = replace(
        sphere,
        youngs_modulus=2 * (1 - sphere.poisson_ratio**2) * modulus,
        work_of_adhesion=adhesion,
        contact_force=0.0,
        factors=(1.0, 1.0),
    )
    return alike, float(law.shear_coefficient) / (8 * root)


def wall(contact: str, place: str, *, name: str = "wall", group: str = "all") -> str:
    """Return the command for a wall, such as ``xplane NULL 0.0``, with a contact `model`; see `rigid`."""
    return f"fix          {name} {group} wall/gran granular {contact} &\n             {place}"
