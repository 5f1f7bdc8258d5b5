"""Contact laws as LAMMPS commands: only this module writes the arguments of ``pair_coeff`` and ``fix wall/gran``.

Between two equal spheres at an overlap δ and a shear displacement ξ act the forces

    f_N = A δ^{3/2} − F,   f_S = −B ξ δ^{1/2},   |f_S| ≤ μ (f_N + 2F),   F = 2π w Rc

(`granular_lmp.crystal.sphere`). The torque of f_S on each sphere has the lever arm R − δ/2. Without adhesion F = 0.
LAMMPS 22Jul2025 differs from these equations as follows; tests measure each difference:

* ``coeff_restitution`` gives the requested restitution e up to the error of the time step. ``tsuji`` does not (0.616
  for a requested 0.5) and is not offered here. LAMMPS refuses both with an adhesive law.
* The sliding limit of Hertz contacts is μ times the normal force *with* its damping part; for DMT contacts it is
  without.
* A "jkr" contact begins at overlap 0 and ends at the largest pull; only the kernel can end it at the largest distance.
* A wall has the material of the spheres, so E* = E/(2(1−ν²)), and G* in the same way; Rc and the lever arm are R.

https://docs.lammps.org/pair_granular.html, https://docs.lammps.org/fix_wall_gran.html
"""

from collections.abc import Mapping
from dataclasses import replace
from math import pi, sqrt

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, HERTZ, NORMAL_LAWS, AdhesionLaw
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.units import AnyUnits

# The laws differ in how the overlap changes the shear force (page Contact laws). "rescaled" is "secant" with
# a shear displacement that shrinks with the contact radius during unloading.
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
    """Return the contact model of two equal spheres, for `pair` and `wall`.

    Parameters
    ----------
    sphere : Sphere
        Material and radius.
    units : AnyUnits
        Unit style of the deck.
    normal : "dmt", "hertz" or "jkr"
        Normal law: with the work of adhesion w, without adhesion, or with adhesion that also acts beyond overlap 0.
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
        Effective shear modulus G*, Pa; it replaces that of the material and factors of the sphere.
    late_parting : bool
        True if contacts end at the largest distance, by a law of the kernel (`AdhesionLaw.late`).
    submodels : str
        Words for other parts of the model, by their names, such as "rolling" and "twisting".

    Returns
    -------
    str
        Arguments of ``pair_coeff`` after the types, in several lines.

    Raises
    ------
    ValueError
        If a law is unknown, or a restitution is combined with adhesion, which LAMMPS refuses.

    Notes
    -----
    *Good values*: see the page Contact laws for `shear`. The law fails when the overlap is not small
    (`granular_lmp.crystal.scale.LARGEST_OVERLAP_RATIO`).

    https://docs.lammps.org/pair_granular.html
    """
    if normal not in NORMAL_LAWS or shear not in TANGENTIAL_LAWS:
        raise ValueError(f"normal = {normal!r}, shear = {shear!r}: must be one of {NORMAL_LAWS} and {TANGENTIAL_LAWS}")
    if restitution is not None and (normal != HERTZ or damping):
        raise ValueError(f"restitution = {restitution!r}: needs normal = 'hertz' and no other damping")
    pressing, shearing = sphere.factors
    if shear_modulus is None and shearing != pressing:  # otherwise LAMMPS computes G* from E and ν
        shear_modulus = shearing * sphere.effective_shear_modulus
    number = sphere.poisson_ratio
    modulus = units.number(pressing * sphere.youngs_modulus, mass=1, length=-1, time=-2)
    loss = units.number(damping, mass=1, time=-1) if restitution is None else restitution
    force = f"hertz/material {modulus!r} {loss!r} {number!r}"
    if normal != HERTZ:
        half_adhesion = units.number(pressing * sphere.work_of_adhesion / 2, mass=1, time=-2)  # γ in LAMMPS
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
    """Return the commands that set one `model` for all contacts between spheres."""
    return f"pair_style   granular\npair_coeff   * * {contact}"


def pairs(contacts: Mapping[tuple[int, int], str]) -> str:
    """Return the commands that set a `model` for the contacts of each two materials m ≤ n, counted from 0.

    The free spheres of material m have the type 2m + 1, the held ones 2m + 2. Every pair of materials is written out,
    because mixing in LAMMPS would give another shear modulus (`granular_lmp.crystal.contacts`).
    """
    if len(contacts) == 1:
        return pair(contacts[0, 0])
    types = {m: f"{2 * m + 1}*{2 * m + 2}" for _, m in contacts}
    lines = (f"pair_coeff   {types[m]} {types[n]} {contact}" for (m, n), contact in contacts.items())
    return "\n".join(["pair_style   granular", *lines])


def rigid(sphere: Sphere) -> Sphere:
    """Return the sphere whose `model` is that of `sphere` on a rigid body.

    On a rigid body 1/E* and 1/G* have one term instead of two equal terms. Doubling E doubles both moduli.
    """
    return replace(sphere, youngs_modulus=2 * sphere.youngs_modulus)


def of_law(law: AdhesionLaw, effective_radius: float, sphere: Sphere) -> tuple[Sphere, float]:
    """Return a sphere whose `model` has the normal force of a law, and the ``shear_modulus`` for its shear force.

    Some sphere has the E* and w of any two bodies, and any measured stiffness, but perhaps not the G*.

    Parameters
    ----------
    law : AdhesionLaw
        Law of one contact, with A = (4/3) E* √Rc, B = 8 G* √Rc and the pull-off force F.
    effective_radius : float
        Rc, m: R/2 for two equal spheres, R for a sphere on a plane.
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
