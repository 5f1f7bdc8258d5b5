"""Material and size of the spheres, and the constants of the contact between two of them.

Two equal elastic spheres in contact have a DMT normal force and a Mindlin shear force,

    f_N(δ) = A δ₊^{3/2} − F,   F = 2π w Rc            (paper, eq. springN; Derjaguin, Muller & Toporov 1975)
    f_S(ξ, δ) = B ξ δ₊^{1/2}                           (paper, eq. springS; Mindlin 1949)

with the overlap δ, the shear displacement ξ, A = (4/3) E* √Rc and B = 8 G* √Rc. In a compressed lattice there is also a
force F0 between spheres at rest, so the overlap at rest is Δ0 = ((F + F0)/A)^{2/3}. Without adhesion, F = 0, this is
the Hertz contact of macroscopic granular crystals. The JKR law, whose adhesion acts beyond overlap 0, can replace the
DMT law (`granular_lmp.crystal.adhesion_laws`). All values are in SI units.
"""

from dataclasses import replace
from math import log, pi, sqrt

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, AdhesionLaw
from granular_lmp.frozen import cached_property, dataclass

__all__ = ["Sphere"]

INERTIA_RATIO = 2 / 5  # Ĩ = I/(mR²) of a solid sphere, fixed in LAMMPS's sphere styles too
# Range of the equilibrium distance of surfaces, m, and ranges of Tabor's parameter where each law is right
# (`Sphere.tabor_parameter`)
SURFACE_DISTANCES = 4e-10, 1.6e-10
DMT_BELOW, JKR_ABOVE = 0.1, 5.0


@dataclass(frozen=True)
class Sphere:
    """Solid elastic sphere, and its contact at rest with an equal sphere.

    Parameters
    ----------
    radius : float
        Radius R, m.
    youngs_modulus : float
        Young's modulus E, Pa.
    poisson_ratio : float
        Poisson's ratio ν in (−1, 0.5]; at −1 the effective moduli are infinite.
    work_of_adhesion : float
        Work of adhesion w, J/m²; 0 for the Hertz contact. LAMMPS's ``dmt`` model takes γ = w/2.
    density : float
        Density ρ, kg/m³.
    contact_force : float
        External force F0 on each contact at rest, N.
    adhesion_law : "dmt" or "jkr"
        Law of the contact; "jkr" needs w > 0.
    factors : (float, float)
        Factors of the normal and the shear force at every overlap, if stiffnesses were measured
        (`granular_lmp.crystal.stiffnesses`). The moduli remain those of the material.

    Notes
    -----
    The model is rigid spheres joined by contact springs. It is valid if contacts are small (Δ0 ≪ R) and waves much
    slower than sound in the material. `granular_lmp.rest.scene` checks the ranges.

    Examples
    --------
    >>> silica = Sphere(5e-7, 7.3e10, 0.17, work_of_adhesion=0.063, density=2200.0)
    >>> print(f"{silica.static_overlap:.3e} m, {silica.normal_stiffness:.1f} N/m, {silica.time_scale:.3e} s")
    2.499e-10 m, 594.1 N/m, 4.981e-10 s
    """

    radius: float
    youngs_modulus: float
    poisson_ratio: float
    work_of_adhesion: float
    density: float
    contact_force: float = 0.0
    adhesion_law: str = "dmt"
    factors: tuple[float, float] = (1.0, 1.0)

    @cached_property
    def contact_law(self) -> AdhesionLaw:
        """Law of the contact with an equal sphere.

        Raises
        ------
        ValueError
            If the law is unknown, or is JKR without adhesion.
        """
        if self.adhesion_law not in ADHESION_LAWS:
            raise ValueError(f"adhesion_law = {self.adhesion_law!r}: must be one of {', '.join(ADHESION_LAWS)}")
        kind = ADHESION_LAWS[self.adhesion_law]
        if kind.beyond and not self.work_of_adhesion > 0:
            raise ValueError(
                f"work_of_adhesion = {self.work_of_adhesion!r}: must be above 0 with adhesion_law = "
                f"{self.adhesion_law!r}; take 'dmt', which is Hertz's law without adhesion"
            )
        law = kind.between(
            self.effective_modulus, self.effective_shear_modulus, self.effective_radius, self.work_of_adhesion
        )
        return law.times(*self.factors)

    @property
    def unloaded(self) -> "Sphere":
        """Sphere without adhesion and external force, whose contacts at rest just touch."""
        return replace(self, work_of_adhesion=0.0, contact_force=0.0, adhesion_law="dmt")

    @property
    def mass(self) -> float:
        """Mass m = (4/3) π R³ ρ, kg."""
        return 4 / 3 * pi * self.radius**3 * self.density

    @property
    def effective_radius(self) -> float:
        """Effective radius Rc = R/2, m."""
        return self.radius / 2

    @property
    def effective_modulus(self) -> float:
        """Effective modulus E* = E/(2(1−ν²)), Pa."""
        return self.youngs_modulus / (2 * (1 - self.poisson_ratio**2))

    @property
    def effective_shear_modulus(self) -> float:
        """Effective shear modulus G* = G/(2(2−ν)) with G = E/(2(1+ν)), Pa."""
        return self.youngs_modulus / (4 * (1 + self.poisson_ratio) * (2 - self.poisson_ratio))

    @property
    def pull_off_force(self) -> float:
        """Pull-off force F between two spheres, N: 2π w Rc, or (3/2)π w Rc by the JKR law."""
        return float(self.contact_law.pull_off_force)

    @property
    def pull_off_distance(self) -> float:
        """Distance of the surfaces at which a pulled contact opens, m: 0 by the DMT law."""
        return abs(float(self.contact_law.pull_off_overlap))

    @property
    def normal_coefficient(self) -> float:
        """Coefficient A = (4/3) E* √Rc of the Hertz law, N/m^{3/2}."""
        return float(self.contact_law.normal_coefficient)

    @property
    def shear_coefficient(self) -> float:
        """Coefficient B = 8 G* √Rc of the Mindlin law, N/m^{3/2}."""
        return float(self.contact_law.shear_coefficient)

    @property
    def holding_force(self) -> float:
        """Force F + F0 of pull-off and compression that must be overcome to open a contact at rest, N."""
        return self.pull_off_force + self.contact_force

    @cached_property
    def static_overlap(self) -> float:
        """Overlap at rest Δ0, m: ((F + F0)/A)^{2/3} by the DMT law."""
        return float(self.contact_law.overlap_under(self.contact_force))

    @property
    def unpressed_overlap(self) -> float:
        """Overlap of a contact without external force, m; 0 without adhesion."""
        return float(self.contact_law.overlap_under(0.0))

    @property
    def normal_stiffness(self) -> float:
        """Normal stiffness k1 of a contact at rest, N/m: (3/2) A √Δ0 by the DMT law."""
        return float(self.contact_law.normal_stiffness(self.static_overlap))

    @property
    def shear_stiffness(self) -> float:
        """Shear stiffness g1 of a contact at rest, N/m: B √Δ0 by the DMT law."""
        return float(self.contact_law.shear_stiffness(self.static_overlap))

    @property
    def stiffness_ratio(self) -> float:
        """Ratio κ = g1/k1, which with the overlap ratio determines the dimensionless linear dynamics.

        It is 2(1−ν)/(2−ν) by the DMT law, and 5/3 times this by the JKR law without external force; measured
        stiffnesses may have any ratio.
        """
        normal, shear = self.factors
        mindlin = 2 * (1 - self.poisson_ratio) / (2 - self.poisson_ratio) * (shear / normal)
        return float(mindlin * self.contact_law.excess(self.static_overlap))

    @property
    def overlap_ratio(self) -> float:
        """Ratio η = Δ0/(2R), by which the contact geometry in LAMMPS differs from that of the paper, η → 0."""
        return self.static_overlap / (2 * self.radius)

    @property
    def time_scale(self) -> float:
        """Unit of time t0 = √(m/(2(g1+3k1))), s, of τ (the paper misprints it as √(2m/(g1+3k1))).

        In this time a long L wave travels half a row of the hexagonal lattice. Scenes of other lattices use the same
        unit.
        """
        return sqrt(self.mass / (2 * (self.shear_stiffness + 3 * self.normal_stiffness)))

    @property
    def prestress(self) -> float:
        """Loss of transverse stiffness by compression over k1, χ = F0/(k1(2R−Δ0)); 0 without external force.

        A compressed contact continues to push after a small rotation, like a strut that buckles. Adhesion balances the
        repulsion along the same line and has no such effect.
        """
        return self.contact_force / (self.normal_stiffness * self.lattice_constant)

    @property
    def lattice_constant(self) -> float:
        """Distance a = 2R − Δ0 between the centres of touching spheres at rest, m."""
        return 2 * self.radius - self.static_overlap

    def nonlinearity(self, amplitude: float) -> float:
        """Return ε = √3 D0 (g2+3k2)/(g1+3k1) = −√3 a (κm + 3n)/(κ+3) for a = D0/Δ0.

        k2 = −n k1/Δ0 and g2 = −m g1/Δ0 with n = ¼, m = ½ by the DMT law. The paper misprints √3 as 3/2.
        """
        normal, shear = self.contact_law.softening(self.static_overlap)
        kappa = self.stiffness_ratio
        return float(-sqrt(3) * amplitude * (4 * shear * kappa + 12 * normal) / (4 * (kappa + 3)))

    def tabor_parameter(self, range_of_forces: float) -> float:
        """Return Tabor's parameter μ = (Rc w²/(E*² z³))^{1/3}, which determines the suitable adhesion law.

        It is the elastic deformation by adhesion over the range z of the surface forces: the DMT law is right below
        about 0.1, the JKR law above 5, and the Maugis law in between (Tabor, J. Colloid Interface Sci. 58, 2 (1977);
        Johnson & Greenwood, J. Colloid Interface Sci. 192, 326 (1997)).

        Parameters
        ----------
        range_of_forces : float
            Equilibrium distance z of the surfaces, m. Good values: `SURFACE_DISTANCES`.
        """
        length = (self.effective_radius * (self.work_of_adhesion / self.effective_modulus) ** 2) ** (1 / 3)
        return length / range_of_forces

    @property
    def nearer_law(self) -> str:
        """Name of the adhesion law that Tabor's parameter suggests; between the two ranges, the nearer law."""
        lowest, highest = (self.tabor_parameter(each) for each in SURFACE_DISTANCES)
        return "dmt" if lowest * highest < DMT_BELOW * JKR_ABOVE else "jkr"

    @property
    def law_words(self) -> str:
        """Sentence on the suitable adhesion law, with the key to set if another is in use."""
        lowest, highest = (self.tabor_parameter(each) for each in SURFACE_DISTANCES)
        two = [f"{float(f'{each:.2g}'):g}" for each in (lowest, highest)]  # 1500, not 1.5e+03
        holds = highest < DMT_BELOW or lowest > JKR_ABOVE
        used = self.nearer_law == self.adhesion_law
        return (
            f"Tabor's parameter is {' to '.join(two)} (DMT holds below {DMT_BELOW:g}, JKR above {JKR_ABOVE:g}): "
            f"{self.nearer_law.upper()} {'holds' if holds else 'is nearer'}"
            + (", and is in use" if used else f'; set sphere.adhesion_law = "{self.nearer_law}"')
        )

    def restitution_viscosity(self, restitution: float) -> float:
        """Return the dashpot of a contact at rest, N s/m, for a coefficient of restitution e of the Hertz contact.

            c = √5 |ln e| / √(π² + ln² e) · √(m_eff A) Δ0^{1/4},    m_eff = m/2

        Spheres then leave every head-on collision with e times their speed (Antypov & Elliott, EPL 94, 50004 (2011)).
        The law is ``damping coeff_restitution`` in LAMMPS.
        """
        share = -log(restitution) / sqrt(pi**2 + log(restitution) ** 2)
        return sqrt(5) * share * sqrt(self.mass / 2 * self.normal_coefficient) * self.static_overlap**0.25
