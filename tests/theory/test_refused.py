"""What theory does not hold it refuses, with the name, the value and what is allowed: a call and its message a line."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import paper_rows
from granular_analysis import second_harmonic as sh
from granular_analysis.theory import bloch, hierarchy, lattice, resonance
from granular_analysis.theory import wave as plane
from granular_analysis.theory.bloch import branch_index, hexagonal, pair_of, wavevector_of
from granular_analysis.theory.cell import Cell
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.estimation import Parameter, estimate
from granular_analysis.theory.integrator import dop853
from granular_analysis.theory.lattices import LATTICES
from granular_analysis.theory.layered import Layered, Slab
from granular_analysis.theory.network import Material, Wall
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import start
from granular_analysis.theory.resonance import three_mode
from granular_analysis.theory.rows import heavy_rows, rows_of
from granular_analysis.theory.second_order import wave
from granular_analysis.theory.surface_wave import Coupled
from granular_analysis.theory.transfer import scattering
from granular_analysis.theory.variation import resonance as resonance_of
from granular_analysis.theory.wave import Wave
from granular_analysis.tools.design import design
from granular_lmp.crystal.contacts import find_contacts
from granular_lmp.crystal.lattices import unit_cell
from tests.polarisations import mean_rotation, second_harmonic_amplitude
from tests.theory import energy, test_transfer
from tests.theory.test_adhesion_laws import DMT, JKR
from tests.theory.test_estimation import LINE, X, line, noisy
from tests.theory.test_network import cluster, crystal, hertz
from tests.theory.test_network_in_space import packing
from tests.theory.test_second_order import DENSITY, FLOOR, SILICA, SUNK, TRIANGULAR, R
from tests.theory.test_surface_wave import APART, GLASS, layer
from tests.theory.test_third_harmonic import third_harmonic_amplitude
from tests.theory.test_variation import layers

NU = 0.17
PAPER, RATIOS, TAU = Contact(NU), sh.ratios(NU), np.linspace(0, 5, 6)
TWICE = heavy_rows(PAPER, [2.0])
ALONG = Wave(sh.mode("L", 1.0, RATIOS), 0.1, PAPER)
DAMPED = Wave.of_mode("TR", 0.802, 0.2, Contact(NU, viscosity=0.1))
OBLIQUE, TURNED = replace(sh.mode("TR", 0.802, RATIOS), direction=30.0), bloch.mode("TR", 1.1, 17.0, PAPER)
FIRST, SECOND = ((1.1, 0.4), 1), (0.2, 0.9)
APART_SPHERES = hertz([[0, 0], [2000, 0]])
BUCKLING = hexagonal(PAPER)
BUCKLING = replace(
    BUCKLING,
    bonds=replace(BUCKLING.bonds, law=BUCKLING.bonds.law._replace(push=np.full(3, 2.0)), curving=np.full(3, 1.0)),
)


def contact(**changes: object) -> Contact:
    return Contact(**{"poisson_ratio": NU} | changes)


def rows_of_network(first: int, last: int, **changes: object) -> object:
    return rows_of(test_transfer.crystal(14, **changes), first, last)


def shift_on_the_resonance() -> object:
    """Return the shift where 2Ω is exactly that of L at 2ξ: C = 0 solves the cubic, ξ = π/2."""
    mode = sh.mode("TR", np.pi / 2, sh.ratios(0.0, inertia=1.0))
    exactly = replace(mode, frequency=np.sin(mode.wavenumber) / 2)
    return plane.shift(Wave(exactly, 0.2, Contact(0.0, inertia=1.0))).total


def triangular(**changes: object) -> Crystal:
    return Crystal.of(TRIANGULAR, np.zeros((1, 3)), R, DENSITY, [SILICA], **changes)


def film_without_wall() -> Coupled:
    vectors = APART * LATTICES["hexagonal", ""].vectors
    return Coupled(Crystal.of(vectors, [[0.0, 0.0, 0.0]], R, DENSITY, [SILICA], true_geometry=False), GLASS)


REFUSED: dict[str, list[tuple[Callable[[], object], str]]] = {
    "contact": [
        (lambda: contact(poisson_ratio=0.51), r"poisson_ratio = 0\.51 is outside \[-1, 0\.5\]"),
        (lambda: contact(inertia=0.0), r"inertia = 0\.0 must be positive and finite"),
        (lambda: contact(overlap_ratio=0.2), r"overlap_ratio = 0\.2 is outside \[0, 0\.1\]"),
        (lambda: contact(prestress=-1.0), r"prestress = -1\.0 is outside \[0, 1\]"),
        (lambda: contact(viscosity=-0.1), "viscosity = -0.1 must be finite and not negative"),
        (lambda: contact(law="mindlin"), "law = 'mindlin': must be one of secant, incremental, potential"),
        (lambda: contact(restitution=1.1, prestress=1.0), r"restitution = 1\.1 is outside"),
        (lambda: contact(restitution=0.9), r"restitution = 0\.9 needs prestress = 1"),
        (lambda: contact(restitution=0.9, prestress=1.0, viscosity=0.1), "a contact has one dashpot"),
        (lambda: contact(law="potential", overlap_ratio=0.01), "law = 'potential' needs overlap_ratio = 0"),
    ],
    "closed form": [
        *((lambda nu=nu: sh.ratios(nu), "outside|positive") for nu in (-1.01, 0.51, np.nan)),
        *((lambda inertia=inertia: sh.ratios(NU, inertia), "outside|positive") for inertia in (0.0, np.inf)),
        *((lambda eta=eta: sh.ratios(NU, overlap_ratio=eta), "outside|positive") for eta in (-1e-9, 0.11)),
        *((lambda xi=xi: sh.mode("L", xi, RATIOS), "wavenumber") for xi in (0.0, -1.0, 3.2, np.nan)),
        (lambda: sh.mode("T", 1.0, RATIOS), "'T'"),
        (lambda: sh.second_harmonic(OBLIQUE, RATIOS, 0.1, TAU), r"direction = 30\.0 of the mode is not 90"),
        (lambda: sh.second_order(OBLIQUE, RATIOS, 0.1, TAU), r"direction = 30\.0 of the mode is not 90"),
        (lambda: sh.generated_amplitude(OBLIQUE, RATIOS), r"direction = 30\.0 of the mode is not 90"),
        (
            lambda: three_mode(Wave.of_mode("TR", 0.802, 0.1, PAPER, direction=30.0), TAU),
            r"direction = 30\.0 of the mode is not 90",
        ),
    ],
    "wave": [
        (lambda: Wave(replace(TURNED, direction=17.1), 0.2, PAPER), "is no wave of this contact"),
        (lambda: Wave(replace(TURNED, frequency=1.0001 * TURNED.frequency), 0.2, PAPER), "is no wave of this contact"),
        (lambda: branch_index("T", (1.0, 0.0), PAPER), "name is 'T'; allowed: L, TR, RT"),
        (lambda: wavevector_of(0.0, 90.0), r"wavenumber is 0\.0; allowed: above 0"),
        (lambda: wavevector_of(1.0, np.nan), "direction is nan"),
        (lambda: mean_rotation((1.0, 0.0), 3, PAPER), "branch is 3; allowed: 0, 1, 2"),
        (lambda: second_harmonic_amplitude((0.0, 0.0), 0, PAPER), "a rigid motion makes no waves"),  # 0/0 at Γ
        (lambda: hierarchy.hierarchy(ALONG, [0.0, 1.0], order=1), "order = 1"),
        (shift_on_the_resonance, "on resonance"),
        (lambda: plane.shift(DAMPED), r"dashpot of the contact is 0\.1; allowed: 0"),
        (lambda: plane.shifted_second_order(DAMPED, TAU), r"dashpot of the contact is 0\.1; allowed: 0"),
        (lambda: resonance.waves(DAMPED), r"dashpot of the contact is 0\.1; allowed: 0"),
        (
            lambda: third_harmonic_amplitude((1.1, 0.4), 0, contact(law="potential")),
            "law = 'potential' is not in the cubic forces; allowed: 'secant', 'incre",
        ),
    ],
    "two waves": [
        (lambda: pair_of(FIRST, (SECOND, 0), 2, PAPER), r"sign is 2; allowed: 1 \(sum\), -1 \(difference\)"),
        (lambda: pair_of(FIRST, (SECOND, 3), 1, PAPER), "branch is 3; allowed: 0, 1, 2"),
        (lambda: pair_of(FIRST, (SECOND, 2), 1, contact(rotation=False)), "branch is 2; allowed: 0, 1 "),
        (lambda: pair_of(FIRST, (SECOND, 0), 1, contact(viscosity=0.1)), r"dashpot of the contact is 0\.1; allowed: 0"),
    ],
    "lattice": [
        *((lambda tau=tau: lattice.torus(ALONG, tau), "tau") for tau in ([1.0, 0.5], [-1.0, 0.0], [], [[0.0, 1.0]])),
        *((lambda points=points: lattice.torus(ALONG, [0.0, 1.0], points=points), "points") for points in (30, 3)),
        (lambda: paper_rows.rows(ALONG, [0.0, 1.0], rows=4), "rows"),
        (
            lambda: paper_rows.rows(Wave(TURNED, 0.2, PAPER), [0.0, 1.0], rows=7),
            r"direction = 17\.0 of the mode is not 90",
        ),
        (lambda: dop853(lambda y: y**2, np.ones(1), np.array([0.0, 2.0]), 1e-8, 1e-8, np.inf), "tau = "),  # ∞ at τ = 1
        (
            lambda: energy.energy(np.zeros((9, 5)), contact(overlap_ratio=1e-3), paper_rows.ring_neighbours()),
            "overlap_ratio",  # turning normals have no ledger
        ),
    ],
    "crystal": [
        (lambda: Crystal.of(np.eye(2) * 3 * R, np.zeros((1, 2)), R, DENSITY, [SILICA]), "no spheres touch each other"),
        (lambda: triangular(walls=[FLOOR._replace(point=(0, 0, 3 * SUNK - R))]), "not at rest"),
        (lambda: wave(hexagonal(PAPER), [0, 1], 3), "allowed: 0, 1, 2"),
        (lambda: BUCKLING.modes([0, 1]), "unstable"),
        (
            lambda: resonance_of(layers("inclusion.1.density"), [4400.0], 1, 3, 0.2),
            "branches 1 and 3 have no resonance near the wave number 0.2",
        ),
    ],
    "surface wave": [
        (film_without_wall, "on one wall below"),
        (lambda: Coupled(layer(exact=True), GLASS), "with equal arms"),
        (
            lambda: Coupled(layer(), Layered((Slab(GLASS, APART),))).guided([[0.0, 1e-3]]),
            "give the frequency below which",
        ),
    ],
    "rows": [
        (lambda: scattering(TWICE, 0.3, "P"), "name = 'P': must be one of L, TR, RT"),
        (lambda: scattering(TWICE, 0.0, "L"), "frequency = 0.0: must be positive"),
        (lambda: scattering(TWICE, 0.3, "RT"), "one wave RT in front; there are: TR, L"),
        (lambda: scattering(TWICE, 1.0, "L"), "edge of a band"),
        (lambda: heavy_rows(PAPER, [0.0]), r"masses = \[0.0\]: must be positive"),
        (lambda: heavy_rows(contact(viscosity=0.1), [2.0]), "dashpot of the contact is"),
        (lambda: heavy_rows(contact(rotation=False), [2.0]), "shear and rotation"),
        (lambda: rows_of_network(0, 11), "first, last = 0, 11: must be rows from 1 to 12"),
        (lambda: rows_of_network(2, 11, density={3: 5000.0}), "row 2: must belong to a perfect lattice"),
        (lambda: rows_of_network(2, 11, density={10: 5000.0}), "row 11: must belong to a perfect lattice"),
    ],
    "network": [
        (lambda: crystal(6, 4, position=np.zeros((24, 4))), "position must be finite"),
        (lambda: crystal(6, 4, radius=np.zeros(24)), "radius must be positive"),
        (lambda: crystal(6, 4, density=np.ones(23)), "density must be positive, finite and of shape .24,."),
        (lambda: crystal(6, 4, kind=np.ones(24, int)), "kind must be from 0 to 0"),
        (lambda: crystal(6, 4, held=np.zeros(3, bool)), "held must be of shape"),
        (lambda: crystal(6, 4, law="potential"), "law = 'potential': must be one of secant, incremental"),
        (lambda: crystal(6, 4, shear_mixing="mean"), "shear_mixing = 'mean': must be one of mindlin, lammps"),
        (lambda: crystal(6, 4, friction=-1.0), "friction = -1.0 must not be negative"),
        (lambda: crystal(6, 4, friction=np.nan), "friction = nan must not be negative"),
        (lambda: crystal(6, 4, viscosity=-1.0), "viscosity = -1.0 must be finite and not negative"),
        *((lambda e=e: crystal(6, 4, restitution=e), "restitution") for e in (0.0, 0.5)),  # 0.5: beside adhesion
        (lambda: crystal(6, 4, cell=(2e-6, np.inf)), "must be two periods, each more than"),
        (lambda: Material(0.0, 0.2), "youngs_modulus"),
        (lambda: Material(1.0, 0.6), "poisson_ratio"),
        (lambda: Material(1.0, 0.2, -1.0), "work_of_adhesion"),
        *(
            (lambda times=times: integrate(*cluster(), times), "times must be one-dimensional")
            for times in ([], [2.0, 1.0], [-1.0, 1.0], [[1.0]])
        ),
        (lambda: integrate(APART_SPHERES, start(APART_SPHERES, 0.0, 0.0), [1.0]), "at rest and no force acts"),
        (lambda: start(APART_SPHERES, np.nan, 0.0), "must be finite"),
        (lambda: packing([[0.0, 0.0, 0.0]], cell=(5e3, 5e3)), "must be three periods"),
        (lambda: packing([[0.0] * 3], walls=(Wall((0.0, 0.0, 0.0), (0.0, 0.0, -2.0)),)), "normal the length 1"),
        (lambda: Cell.of(packing([[0.0] * 3])), "the second order of a cell leaves out spheres in space"),
    ],
    "adhesion law": [
        (lambda: design(JKR, 1e8), "adhesion_law is 'jkr'; allowed: 'dmt'"),
        (lambda: replace(JKR, work_of_adhesion=0.0).static_overlap, r"work_of_adhesion = 0\.0: must be above 0"),
        (lambda: replace(JKR, adhesion_law="maugis").contact_law, "adhesion_law = 'maugis': must be one of dmt, jkr"),
        (
            lambda: find_contacts(unit_cell(JKR), [JKR, DMT]),
            "adhesion_law = dmt, jkr: must be the same for all materials",
        ),
    ],
    "fit": [
        (lambda: estimate(LINE, line, [1.0]), "1 points do not determine 2 keys and their error"),
        (lambda: estimate(LINE, line, [1.0], [0.1]), "1 points do not determine 2 keys "),
        (lambda: estimate(LINE, line, noisy(0.1), -np.ones(len(X))), "positive"),
        (lambda: estimate(LINE, line, noisy(0.1), None, "huber"), "needs the errors"),
        (lambda: Parameter("share", 1.0, 0.0, 1.0), "a fit must start between 0 and 1"),
    ],
}


ROWS = [(f"{subject}: {row[1]}", row) for subject, rows in REFUSED.items() for row in rows]


@pytest.mark.parametrize(("call", "message"), [row for _, row in ROWS], ids=[name for name, _ in ROWS])
def test_what_theory_does_not_hold_it_refuses(call: Callable[[], object], message: str) -> None:
    with pytest.raises((ValueError, RuntimeError), match=message):
        call()
