"""One contact of the crystal: what every theory here is told of the spheres, and what each derives from it.

The paper's contact is Hertz–Mindlin's, with κ = g1/k1 = 2(1−ν)/(2−ν). `Contact` says how a lattice departs from it, and
is the only description of one: the closed forms take its `Contact.ratios`, `analysis.theory.bloch.hexagonal` makes
the crystal of it, `analysis.theory.lattice` takes all of it.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from analysis.second_harmonic import SOLID_SPHERE, Mode, Ratios, ratios
from analysis.theory.adhesion import LAWS as ADHESION_LAWS
from analysis.theory.adhesion import Adhesion, Dmt, Jkr
from analysis.theory.damping import restitution_viscosity

Law = Literal["secant", "incremental", "potential"]
LAWS: tuple[Law, ...] = get_args(Law)


@dataclass(frozen=True)
class Contact:
    """A Hertz–Mindlin contact between equal spheres, and the lattice that it makes.

    Attributes
    ----------
    poisson_ratio : ν of the spheres, in [−1, 0.5].
    law : of the shear force: "secant" (the paper; LAMMPS mindlin), "incremental" (LAMMPS mindlin/force) or "potential"
        (conservative); see `analysis.theory.laws`.
    overlap_ratio : η = Δ0/2R in [0, 0.1]; 0 is the paper's geometry, 2.5e-4 its silica spheres in LAMMPS.
    prestress : F0/(F0 + F) in [0, 1], F the pull that parts a contact, which is the adhesive force in the DMT law: 0 if
        adhesion holds the lattice, 1 if compression does.
    shear : whether contacts resist shear.
    rotation : whether the spheres turn, which they do only if contacts resist shear.
    viscosity : c ≥ 0 of a dashpot in every closed contact, in m/t0 (LAMMPS damping velocity).
    restitution : coefficient in (0, 1] that sets the dashpot instead (LAMMPS damping coeff_restitution); None: none.
    inertia : Ĩ = I/(mR²) > 0 of the sphere, without the factor of η.
    adhesion_law : "dmt", or "jkr", whose contacts adhere beyond an overlap of 0 (`analysis.theory.adhesion`).

    Raises
    ------
    ValueError
        For a value outside these ranges, and for what does not go together: "potential" with η > 0 or with "jkr",
        "jkr" without adhesion, restitution with viscosity or with adhesion (LAMMPS refuses the latter too).
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

    def __post_init__(self) -> None:
        if self.adhesion_law not in ADHESION_LAWS:
            raise ValueError(f"adhesion_law = {self.adhesion_law!r} is none of {tuple(ADHESION_LAWS)}")
        if self.adhesion_law == "jkr" and not 0.0 <= self.prestress < 1.0:
            raise ValueError(f"adhesion_law = 'jkr' needs prestress in [0, 1), not {self.prestress}: it adheres")
        if self.adhesion_law == "jkr" and self.law == "potential":
            raise ValueError("law = 'potential' needs adhesion_law = 'dmt', not 'jkr': it is derived for that")
        _ = self.secant_ratios  # the closed form's own constants check ν, Ĩ, η and prestress
        if self.law not in LAWS:
            raise ValueError(f"law = {self.law!r} is none of {LAWS}")
        if self.law == "potential" and self.overlap_ratio > 0:
            raise ValueError(f"law = 'potential' needs overlap_ratio = 0, not {self.overlap_ratio}: slip has a history")
        if not 0.0 <= self.viscosity < np.inf:
            raise ValueError(f"viscosity = {self.viscosity} must be finite and not negative")
        if self.restitution is None:
            return
        said = f"restitution = {self.restitution}"
        if self.viscosity:
            raise ValueError(f"{said} and viscosity = {self.viscosity}: a contact has one dashpot")
        if self.prestress != 1:
            raise ValueError(f"{said} needs prestress = 1, not {self.prestress}: it knows no adhesion")
        restitution_viscosity(self.restitution, self.kappa)  # checks its range

    @cached_property
    def kappa(self) -> float:
        """κ = g1/k1 of the spheres, which sets the units; a contact without shear has none of its force."""
        return 2 * (1 - self.poisson_ratio) / (2 - self.poisson_ratio) * self.adhesion.expansion.excess

    @cached_property
    def adhesion(self) -> Dmt | Jkr:
        """Normal force and contact radius by overlap."""
        return ADHESION_LAWS[self.adhesion_law](self.prestress)

    @property
    def shear_stiffness(self) -> float:
        """κ of the contacts at rest; 0 without shear."""
        return self.kappa if self.shear else 0.0

    @property
    def turns(self) -> bool:
        """True if the spheres turn."""
        return self.shear and self.rotation

    @property
    def masses(self) -> NDArray[np.float64]:
        """M of a sphere, (1, 1, Ĩ/(1−η)), for (u, v, φ) with the torques of arms R."""
        return np.array([1.0, 1.0, self.inertia / (1.0 - self.overlap_ratio)])

    @property
    def softening(self) -> float:
        """χ = F0/(k1(2R−Δ0)), the stiffness that compression takes from a sideways shift, in k1."""
        return self.overlap_ratio / (1.0 - self.overlap_ratio) * self.adhesion.load / 1.5

    @cached_property
    def mobility(self) -> NDArray[np.float64]:
        """C, C, C/Ĩ with C = 1/(2(κ+3)), (3, 1): p'', q'', φ'' of unit forces; the last is 0 if spheres do not turn."""
        return np.array([[1.0], [1.0], [1 / self.inertia if self.rotation else 0.0]]) / (2 * (self.kappa + 3))

    @property
    def incremental(self) -> bool:
        """True if the shear force itself is the state, not the slip."""
        return self.law == "incremental"

    @cached_property
    def has_history(self) -> bool:
        """True if the shear of a contact is a state of its own rather than a function of the displacements."""
        return self.shear and (self.incremental or self.overlap_ratio > 0)

    @cached_property
    def dashpot(self) -> float:
        """Viscosity at rest, in m/t0: that declared, or that of the restitution coefficient."""
        return self.viscosity if self.restitution is None else restitution_viscosity(self.restitution, self.kappa)

    @cached_property
    def secant_ratios(self) -> Ratios:
        """Constants of the closed forms under the secant law; the modes of every law are theirs."""
        return ratios(
            self.poisson_ratio,
            self.inertia,
            self.overlap_ratio,
            prestress=self.adhesion.load,
            shear=self.shear,
            rotation=self.rotation,
            law=self.adhesion.expansion,
        )

    @cached_property
    def ratios(self) -> Ratios:
        """Constants with which `analysis.second_harmonic` gives the second harmonic of any mode, without damping.

            secant       α = (2κ−1)/(2κ+3),  β = 2κ/(2κ+3),   L: ε as in the paper
            incremental  α = (κ−1)/(2κ+3),   β = κ/(2κ+3),    L: ε·(κ+3)/(2κ+3)

        for contacts of the DMT law; the incremental law halves m of any (`analysis.second_harmonic.Expansion`).
        γ keeps its value of the paper: no second harmonic depends on it. The modes are the same for any law. What
        geometry, compression and missing shear change is the same for both laws: to second order they differ by
        ½κ(xt − ∫x dt), where stretch x and slip t are linear.

        Raises ValueError for the potential law, whose constants hold for one mode: `ratios_of`.
        """
        if self.law == "potential":
            raise ValueError("law = 'potential' has no ratios for all modes, since it has a term in σ²; use ratios_of")
        if self.law == "secant":
            return self.secant_ratios
        own = self.secant_ratios
        less = 2 * own.law.shear * self.shear_stiffness / own.unit
        return replace(
            own, alpha=own.alpha - less, beta=own.beta - less, longitudinal=own.longitudinal - less, memory=less
        )

    def ratios_of(self, mode: Mode) -> Ratios:
        """Return `ratios` for one mode, under any law.

            potential    α = −(κ+1)/(2κ+3),  β = −4κ/(2κ+3),  L: ε·(3κ+3)/(2κ+3),  and ζσ² beside −αdq² + (2/√3)βσdq in
                         [eqp], ζ = 4κ/(2κ+3). In a mode σ = (Y/X)dq, so that term is in α: α − ζ(Y/X)²

        Raises ValueError for the potential law in another lattice than the paper's: without shear or rotation.
        """
        if self.law != "potential":
            return self.ratios
        departs = {"shear": not self.shear, "rotation": not self.rotation, "prestress": self.prestress > 0}
        if other := [name for name, there in departs.items() if there]:
            raise ValueError(f"law = 'potential' has ratios in the paper's lattice only, not with {', '.join(other)}")
        kappa, unit = self.kappa, 2 * self.kappa + 3
        alpha = -(kappa + 1) / unit
        if mode.name != "L":
            alpha -= 4 * kappa / unit * (mode.f / (mode.q * np.tan(mode.wavenumber / 2))) ** 2
        return replace(self.secant_ratios, alpha=alpha, beta=-4 * kappa / unit, longitudinal=(3 * kappa + 3) / unit)
