"""Contact laws as LAMMPS commands: the one place that writes what follows ``pair_coeff * *`` and ``fix wall/gran``.

Two equal spheres at an overlap δ and a shear displacement ξ push each other with

    f_N = A δ^{3/2} − F,   f_S = −B ξ δ^{1/2},   |f_S| ≤ μ (f_N + 2F),   F = 2π w Rc

(`granular_lmp.crystal.sphere`), the torque of f_S on each having the lever arm R − δ/2. Without adhesion F = 0. What
LAMMPS 22Jul2025 does beyond that, measured in ``tests/validation/test_contact_law.py``:

* The restitution e of ``coeff_restitution`` is obtained, to the error of the step. That of ``tsuji`` is not (asked for
  0.5, obtained 0.616): it is not offered here. Neither goes with an adhesive law; LAMMPS refuses both.
* The sliding limit of Hertz contacts is μ times the normal force *with* its damping part, of DMT contacts without it.
* A wall is taken to be of the spheres' material, E* = E/(2(1−ν²)), G* likewise; Rc is R and the lever arm R.

https://docs.lammps.org/pair_granular.html, https://docs.lammps.org/fix_wall_gran.html
"""

from dataclasses import replace

from granular_lmp.crystal.sphere import Sphere
from granular_lmp.lammps.units import Units

NORMAL_LAWS = ("dmt", "hertz")
# What a change of the overlap does to the shear force: see docs/choosing-a-shear-law.md. "rescaled" is secant, and on
# unloading lets the shear displacement shrink with the contact radius.
_MINDLIN = {"secant": "mindlin", "incremental": "mindlin/force", "rescaled": "mindlin_rescale"}
TANGENTIAL_LAWS = (*_MINDLIN, "none")


def model(
    sphere: Sphere,
    units: Units,
    *,
    normal: str = "dmt",
    shear: str = "secant",
    friction: float | str = 0.0,
    damping: float = 0.0,
    restitution: float | None = None,
    shear_damping: float = 0.0,
    rolling: tuple[float, float, float] | None = None,
    twisting: bool = False,
) -> str:
    """The contact model of two equal spheres, as `pair` and `rigid_plane` take it.

    Parameters
    ----------
    sphere : Sphere
    units : Units
        The unit style of the deck.
    normal : "dmt" or "hertz"
        With adhesion w, or without (w is not used).
    shear : "secant", "incremental", "rescaled" or "none"
    friction : float or str
        μ, or a LAMMPS variable such as ``${friction}``.
    damping : float
        η, kg/s: the normal force −η v_n of ``damping velocity``.
    restitution : float, optional
        e in (0, 1], instead of `damping`: ``damping coeff_restitution``.
    shear_damping : float
        Damping coefficient of the shear over that of the normal motion.
    rolling : (float, float, float), optional
        Stiffness, N/m, dashpot, N s/m, and friction of ``rolling sds``; free rolling without it.
    twisting : bool
        Resistance to twisting, ``twisting marshall``, with the stiffness and the friction of the shear force.

    Raises
    ------
    ValueError
        For another law, or a restitution with adhesion, which LAMMPS refuses.
    """
    if normal not in NORMAL_LAWS or shear not in TANGENTIAL_LAWS:
        raise ValueError(f"normal = {normal!r}, shear = {shear!r}: must be one of {NORMAL_LAWS} and {TANGENTIAL_LAWS}")
    if restitution is not None and (normal == "dmt" or damping):
        raise ValueError(f"restitution = {restitution!r}: needs normal = 'hertz' and no other damping")
    modulus = units.number(sphere.youngs_modulus, mass=1, length=-1, time=-2)
    loss = units.number(damping, mass=1, time=-1) if restitution is None else restitution
    force = f"hertz/material {modulus!r} {loss!r} {sphere.poisson_ratio!r}"
    if normal == "dmt":
        half_adhesion = units.number(sphere.work_of_adhesion / 2, mass=1, time=-2)  # LAMMPS's γ
        force = f"dmt {modulus!r} {loss!r} {sphere.poisson_ratio!r} {half_adhesion!r}"
    slip = "linear_nohistory 0.0 0.0" if shear == "none" else f"{_MINDLIN[shear]} NULL {shear_damping!r} {friction}"
    loss_law = "velocity" if restitution is None else "coeff_restitution"
    rolls = "none" if rolling is None else _rolling(units, *rolling)
    turns = f" rolling {rolls} twisting {'marshall' if twisting else 'none'}" if rolling or twisting else ""
    return f"{force} &\n             tangential {slip}{turns} damping {loss_law}"


def _rolling(units: Units, stiffness: float, viscosity: float, friction: float) -> str:
    spring, dashpot = units.number(stiffness, mass=1, time=-2), units.number(viscosity, mass=1, time=-1)
    return f"sds {spring!r} {dashpot!r} {friction!r}"


def pair(contact: str) -> str:
    """The commands that let all spheres touch through a `model`."""
    return f"pair_style   granular\npair_coeff   * * {contact}"


def rigid(sphere: Sphere) -> Sphere:
    """The sphere whose `model` is that of `sphere` on a rigid body.

    Against a rigid body 1/E* and 1/G* have one term instead of two equal ones, so both moduli are doubled: so is E.
    """
    return replace(sphere, youngs_modulus=2 * sphere.youngs_modulus)


def wall(contact: str, place: str) -> str:
    """The command that lets all spheres touch a wall, ``xplane NULL 0.0`` say; rigid by the `model` of `rigid`."""
    return f"fix          wall all wall/gran granular {contact} &\n             {place}"
