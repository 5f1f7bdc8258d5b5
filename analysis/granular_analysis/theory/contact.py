"""Contact of the crystal, from which every theory here derives its constants.

The contact of the paper is a Hertz–Mindlin contact, with κ = g1/k1 = 2(1−ν)/(2−ν). `Contact` describes departures from
it: `granular_analysis.theory.bloch.hexagonal` makes the crystal, `granular_analysis.theory.lattice` supports all of it,
and `granular_analysis.second_harmonic` only the contact of the paper (`Contact.closed`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray

from granular_analysis.second_harmonic import SOLID_SPHERE, Ratios, of_stiffness, ratios
from granular_analysis.theory.adhesion import Adhesion, AtRest
from granular_analysis.theory.errors import TheoryError

__all__ = ["Contact", "ratios_of"]

Law = Literal["secant", "incremental", "potential"]
LAWS: tuple[Law, ...] = get_args(Law)


@dataclass(frozen=True)
class Contact:
    """Hertz–Mindlin contact between equal spheres, and the lattice that it makes.

    Attributes
    ----------
    poisson_ratio : ν of the spheres, in [−1, 0.5].
    law : law of the shear force: "secant" (the paper; LAMMPS mindlin), "incremental" (LAMMPS mindlin/force) or
        "potential" (conservative); see `granular_analysis.theory.bonds`.
    overlap_ratio : η = Δ0/2R in [0, 0.1]; 0 is the geometry of the paper, 2.5e-4 that of its silica spheres in LAMMPS.
    prestress : F0/(F0 + F) in [0, 1] with the pull-off force F, the adhesive force in the DMT law: 0 if adhesion holds
        the lattice, 1 if compression does.
    shear : whether contacts resist shear.
    rotation : whether the spheres turn; without shear they never turn.
    viscosity : c ≥ 0 of a dashpot in every closed contact, in m/t0 (LAMMPS damping velocity).
    restitution : coefficient in (0, 1] that replaces viscosity (LAMMPS damping coeff_restitution); None: not used.
    inertia : Ĩ = I/(mR²) > 0 of the sphere, without the factor 1/(1−η).
    stiffness_ratio : κ > 0 of measured stiffnesses, without the factor of JKR (`AtRest.excess`); None: from ν.
    adhesion_law : "dmt", or "jkr", whose contacts adhere down to a negative overlap
        (`granular_analysis.theory.adhesion`).

    Raises
    ------
    ValueError
        For a value outside these ranges, and for impossible combinations: "potential" with η > 0 or with "jkr", "jkr"
        without adhesion, restitution with viscosity or with adhesion (LAMMPS refuses the latter too).
    """

    poisson_ratio: float
    law: Law = "secant"
    overlap_ratio: float = 0.0
    prestress: float = 0.0
    shear: bool = True
    rotation: bool = True
    viscosity: float = 0.0
    restitution: float | None = None
    inertia: float = SOLID_SPHERE
    adhesion_law: Adhesion = "dmt"
    stiffness_ratio: float | None = None

    def __post_init__(self) -> None:
        if self.adhesion_law not in get_args(Adhesion):
            raise TheoryError(f"adhesion_law = {self.adhesion_law!r}: must be one of {', '.join(get_args(Adhesion))}")
        if self.adhesion_law == "jkr" and not 0.0 <= self.prestress < 1.0:
            raise TheoryError(f"adhesion_law = 'jkr' needs prestress in [0, 1), not {self.prestress}: JKR has adhesion")
        if self.adhesion_law == "jkr" and self.law == "potential":
            raise TheoryError("law = 'potential' needs adhesion_law = 'dmt', not 'jkr': it is derived from DMT")
        if not 0.0 <= self.prestress <= 1.0:
            raise TheoryError(f"prestress = {self.prestress} is outside [0, 1]")
        _ = self._ratios  # checks ranges
        if self.law not in LAWS:
            raise TheoryError(f"law = {self.law!r}: must be one of {', '.join(LAWS)}")
        if self.law == "potential" and self.overlap_ratio > 0:
            raise TheoryError(f"law = 'potential' needs overlap_ratio = 0, not {self.overlap_ratio}; slip has history")
        if not 0.0 <= self.viscosity < np.inf:
            raise TheoryError(f"viscosity = {self.viscosity} must be finite and not negative")
        if self.restitution is None:
            return
        said = f"restitution = {self.restitution}"
        if self.viscosity:
            raise TheoryError(f"{said} and viscosity = {self.viscosity}: a contact has one dashpot")
        if self.prestress != 1:
            raise TheoryError(f"{said} needs prestress = 1, not {self.prestress}: its law has no adhesion")
        restitution_viscosity(self.restitution, self.kappa)  # checks its range

    @classmethod
    def of(cls, sphere: Any, **others: Any) -> Self:
        """Return the contact of spheres under their compressive force, in the geometry of LAMMPS.

        Parameters
        ----------
        sphere : `granular_lmp.crystal.sphere.Sphere`, or an object with the same ν, overlap ratio, forces, adhesion law
            and factors of measured stiffnesses
        others : further attributes of the contact, such as `law` or `shear`
        """
        number, (normal, shear) = sphere.poisson_ratio, sphere.factors
        return cls(
            number,
            stiffness_ratio=None if shear == normal else 2 * (1 - number) / (2 - number) * shear / normal,
            overlap_ratio=sphere.overlap_ratio,
            prestress=sphere.contact_force / sphere.holding_force,
            adhesion_law=sphere.adhesion_law,
            **others,
        )

    @cached_property
    def kappa(self) -> float:
        """κ = g1/k1 of the spheres, which sets the units even if the contact has no shear force."""
        return self._ratios.kappa * self.adhesion.excess

    @property
    def _ratios(self) -> Ratios:
        """Constants of the closed form, ignoring the `departures` of the contact from the paper's."""
        if self.stiffness_ratio is None:
            return ratios(self.poisson_ratio, self.inertia, self.overlap_ratio)
        return of_stiffness(self.stiffness_ratio, self.inertia, self.overlap_ratio)

    @cached_property
    def adhesion(self) -> AtRest:
        """Normal force and contact radius as functions of the overlap."""
        return AtRest(self.adhesion_law, self.prestress)

    @cached_property
    def shear_stiffness(self) -> float:
        """Shear stiffness of a contact at rest in k1: κ, or 0 without shear."""
        return self.kappa if self.shear else 0.0

    @property
    def turns(self) -> bool:
        """True if the spheres turn."""
        return self.shear and self.rotation

    @property
    def masses(self) -> NDArray[np.float64]:
        """Masses (1, 1, Ĩ/(1−η)) of a sphere for (u, v, φ), which take torques with the arm R."""
        return np.array([1.0, 1.0, self.inertia / (1.0 - self.overlap_ratio)])

    @property
    def softening(self) -> float:
        """χ = F0/(k1(2R−Δ0)): the transverse stiffness lost by compression, in k1."""
        return self.overlap_ratio / (1.0 - self.overlap_ratio) * self.adhesion.load / 1.5

    @cached_property
    def mobility(self) -> NDArray[np.float64]:
        """p'', q'', φ'' by unit forces, (3, 1): C, C, C/Ĩ with C = 1/(2(κ+3)); the last is 0 without rotation."""
        return np.array([[1.0], [1.0], [1 / self.inertia if self.rotation else 0.0]]) / (2 * (self.kappa + 3))

    @cached_property
    def incremental(self) -> bool:
        """True if the state of the contact is the shear force; False if it is the slip."""
        return self.law == "incremental"

    @cached_property
    def has_history(self) -> bool:
        """True if the shear of a contact is a separate state rather than a function of the displacements."""
        return self.shear and (self.incremental or self.overlap_ratio > 0)

    @cached_property
    def dashpot(self) -> float:
        """Viscosity at rest, in m/t0: as declared, or from the restitution coefficient."""
        return self.viscosity if self.restitution is None else restitution_viscosity(self.restitution, self.kappa)

    def refuse_dashpots(self) -> None:
        """Raise ValueError for a contact with a dashpot, in a theory whose waves do not decay."""
        if self.dashpot:
            raise TheoryError(f"dashpot of the contact is {self.dashpot:g}; allowed: 0, as waves here do not decay")

    @property
    def departures(self) -> tuple[str, ...]:
        """Return the attributes that the paper's closed form excludes, as "name = value"; dashpots are not listed."""
        paper = {"law": "secant", "prestress": 0.0, "shear": True, "rotation": True, "adhesion_law": "dmt"}
        return tuple(
            f"{name} = {getattr(self, name)!r}" for name, value in paper.items() if getattr(self, name) != value
        )

    @cached_property
    def closed(self) -> Ratios:
        """Constants of `granular_analysis.second_harmonic`; ValueError for a contact that it does not include."""
        if self.departures:
            raise TheoryError(f"the closed form does not include {', '.join(self.departures)}")
        return self._ratios


def ratios_of(scene: Any) -> Ratios:
    """Return the constants of the closed form for the crystal of a scene, in the geometry of LAMMPS.

    Raises TheoryError for a scene that the closed form excludes: another lattice, compression (prestress), another law
    of shear or adhesion, spheres that do not turn, and contacts without shear.

    Examples
    --------
    >>> constants = ratios_of(Scene.load("tr_resonant"))
    >>> print(f"{constants.kappa:.4f} {constants.overlap_ratio:.2e}")
    0.9071 2.50e-04
    """
    if scene.packing.lattice != "hexagonal" or scene.space == 3:
        raise TheoryError(
            f"the closed form does not include packing.lattice = {scene.packing.lattice!r} in {scene.space}D"
        )
    chosen = scene.effects
    switched = {"shear": chosen.shear is not False, "rotation": chosen.rotation is not False}
    return Contact.of(scene.sphere, law=chosen.shear_law, **switched).closed


def restitution_viscosity(restitution: float, kappa: float) -> float:
    """Return the viscosity c in m/t0 of a Hertz contact at rest from which spheres rebound with e times their speed.

        c = √5 ζ √(m k1/3) = √5 ζ/√(6(κ+3)) m/t0,   ζ = −ln e/√(π² + ln² e)

    The dashpot √5 ζ (m_eff f_N/δ)^{1/2} ∝ δ^{1/4} is LAMMPS's ``coeff_restitution``; at rest f_N/δ = (2/3)k1.

    Parameters
    ----------
    restitution : e in (0, 1].
    kappa : κ of the spheres, which sets t0.

    Raises ValueError for an e outside (0, 1].

    Source: LAMMPS's `GranSubModDampingCoeffRestitution`, whose product of constants √(3/2)·2√(5/6) is √5; m_eff = m/2.
    """
    if not 0.0 < restitution <= 1.0:
        raise TheoryError(f"restitution = {restitution} is outside (0, 1]")
    loss = -np.log(restitution)
    return float(np.sqrt(5) * loss / np.hypot(np.pi, loss) / np.sqrt(6 * (kappa + 3)))
