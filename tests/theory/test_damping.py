"""The effect of dashpots in the contacts on a wave: closed form against the exact lattice, and LAMMPS's restitution."""

import numpy as np
import pytest

from benchmarks import paper_rows
from granular_analysis import second_harmonic as sh
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact, restitution_viscosity
from granular_analysis.theory.hierarchy import hierarchy_orders
from granular_analysis.theory.wave import Wave, decay_rate
from tests.conftest import members
from tests.manual import Mutant, verifies

NU = 0.17
SILICA = sh.ratios(NU)
TAU = np.linspace(0, 20, 41)
PLAIN, COMPRESSED = {}, {"overlap_ratio": 0.05, "prestress": 1.0}
WAVES = [
    *((name, xi, effects) for name in ("L", "TR", "RT") for xi in (0.802, 2.6) for effects in (PLAIN, COMPRESSED)),
    *((name, 0.802, {effect: False}) for name in ("L", "TR") for effect in ("rotation", "shear")),
]


def shrinking(mode, viscosity, **effects):
    """Rate at which the first order of a damped wave shrinks, from its projection on the mode over 20 τ.

    The start is not quite the damped mode: a wave of relative size Γ/Ω runs backward and ripples at 2Ω.
    """
    first = hierarchy_orders(mode, Contact(NU, viscosity=viscosity, **effects), TAU, order=2, rtol=1e-11)[0]
    harmonic = 2 * np.mean(first * np.exp(-1j * lattice.torus_phases(first.shape[-1])), axis=-1)
    on_mode = harmonic @ [mode.p, mode.q, -1j * mode.f * Contact(NU, **effects).masses[2]]
    ripple = 2 * mode.frequency * TAU
    columns = np.stack([TAU, np.ones_like(TAU), np.cos(ripple), np.sin(ripple)], axis=-1)
    return -np.linalg.lstsq(columns, np.log(np.abs(on_mode)))[0][0]


@pytest.mark.parametrize(("name", "xi", "effects"), WAVES)
@verifies(
    "Decay of L, TR and RT by dashpots, also compressed, without rotation or shear",
    reference="other integrator: the exact lattice to first order, projected on the mode",
    tolerance=0.001,
    reason="of the order Γ = 1e-3, and of the integration, 5e-11 over Γ ≥ 5e-6",
    mutant=Mutant(
        "analysis/granular_analysis/theory/wave.py",
        "wave.contact.shear * np.sum(np.abs(strain.slip) ** 2)",
        "0.99 * wave.contact.shear * np.sum(np.abs(strain.slip) ** 2)",
    ),
)
def test_waves_decay_at_the_rate_of_the_closed_form(name, xi, effects, measured):
    wave = Wave.of_mode(name, xi, 1.0, Contact(NU, **effects))
    # Relative error of order Γ, at most 1.3e-3 here, and of the integration, 1e-9/20 over Γ ≥ 5e-6.
    measured(shrinking(wave.mode, 2e-4, **effects) / decay_rate(wave, 2e-4) - 1)


def test_a_wrong_decay_rate_is_seen():
    mode = sh.mode("TR", 0.802, SILICA)
    right = decay_rate(Wave(mode, 1.0, Contact(NU)), 2e-4)
    assert abs(shrinking(mode, 2.02e-4) / right - 1) > 5e-3  # one percent of viscosity
    assert (
        abs(shrinking(mode, 2e-4) / decay_rate(Wave.of_mode("TR", 0.802, 1.0, Contact(NU, shear=False)), 2e-4) - 1)
        > 0.1
    )


def test_the_decay_is_proportional_to_the_viscosity():
    mode = sh.mode("TR", 0.802, SILICA)
    rates = [shrinking(mode, c) for c in (1e-3, 2e-3, 4e-3)]
    assert np.diff(np.log2(rates)) == pytest.approx(1, abs=2e-3)  # the next power of c
    assert rates[0] == pytest.approx(decay_rate(Wave(mode, 1.0, Contact(NU)), 1e-3), rel=2e-3)


def test_long_waves_decay_as_four_times_viscosity_times_frequency_squared():
    mode = sh.mode("L", 0.3, SILICA)
    assert decay_rate(Wave(mode, 1.0, Contact(NU)), 0.01) == pytest.approx(0.04 * mode.frequency**2, rel=1e-13)


def six_dashpots(moving, contact, between_rows=1.0):
    """Force and torque on the middle of three rows by dashpots in its six contacts, in m Δ0/t0², directions at rest.

    between_rows is how much of their dashpot at rest the four contacts with the other rows have.
    """
    p, q, phi = moving
    total = np.zeros(3)
    for degrees, row in ((60, 2), (0, 1), (-60, 0), (240, 0), (180, 1), (120, 2)):
        n = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        t = np.array([-n[1], n[0]])
        d = np.array([-(q[row] - q[1]), p[row] - p[1]])
        slip = t @ d - phi[row] - phi[1]
        viscosity = contact.dashpot * (1.0 if row == 1 else between_rows)
        total[:2] += viscosity * ((n @ d) * n + slip * t)
        total[2] += viscosity * slip
    return total


def test_every_contact_has_two_dashpots():
    rates = np.random.default_rng(2).uniform(-1, 1, (3, 3))
    contact, neighbours = Contact(NU, viscosity=0.3), paper_rows.ring_neighbours()
    state = np.concatenate([np.zeros((3, 3)), rates])
    p, q, phi = lattice.rhs(state, contact, neighbours)[3:, 1]
    force = six_dashpots(rates, contact)
    assert [p, q, phi] == pytest.approx([force[1], -force[0], force[2] / 0.4], rel=0, abs=1e-14)


def test_an_open_contact_does_not_damp():
    contact, still = Contact(NU, viscosity=0.3), Contact(NU)
    neighbours = paper_rows.ring_neighbours()
    state = np.zeros((6, 5))
    state[0] = 10 * np.arange(5)  # rows 0 … 4 far apart; between 4 and 0 they are pressed
    state[3] = [0.0, 0.1, -0.2, 0.3, 0.0]
    damped, free = (lattice.rhs(state, c, neighbours)[3:] for c in (contact, still))
    assert np.array_equal(damped[:2, 1:4], free[:2, 1:4])
    state[0] = 0
    damped, free = (lattice.rhs(state, c, neighbours)[3:] for c in (contact, still))
    assert np.max(np.abs(damped - free)) > 0.1


@pytest.mark.parametrize("law", ["secant", "incremental"])
def test_the_law_of_the_shear_force_changes_nothing_of_the_damping(law):
    mode = sh.mode("TR", 0.802, SILICA)
    assert shrinking(mode, 2e-4, law=law) == pytest.approx(decay_rate(Wave(mode, 1.0, Contact(NU)), 2e-4), rel=1e-3)


# --- restitution ---


@pytest.mark.parametrize("restitution", members([0.95, 0.8, 0.5], 0.8))
@verifies(
    "Dashpot by restitution in theory, speed at parting, e = 0.5, 0.8, 0.95",
    reference="other integrator: one Hertz contact with the dashpot, until the overlap is back at 0",
    tolerance=0.002,
    reason="the grid of times, 1e-3, and the corner at zero overlap",
    mutant=Mutant(
        "analysis/granular_analysis/theory/contact.py",
        "np.sqrt(5) * loss / np.hypot(np.pi, loss) / np.sqrt(6 * (kappa + 3))",
        "np.sqrt(5) * loss / np.hypot(np.pi, loss) / np.sqrt(5.8 * (kappa + 3))",
    ),
)
def test_two_spheres_part_with_the_restitution_coefficient(restitution, measured):
    # One Hertz contact in units of Δ0, t0, m: f_N = C(2/3)(1−x)^{3/2}, and the dashpot of `restitution_viscosity`.
    contact = Contact(NU, restitution=restitution, prestress=1.0)

    def rate(y):  # overlap and its rate, reduced mass ½
        overlap = max(y[0], 0.0)
        repulsion = overlap**1.5 / 1.5 / (2 * (contact.kappa + 3))
        return np.array([y[1], -2 * (repulsion + contact.dashpot * overlap**0.25 * y[1])])

    # Until the overlap is back at zero, where the dashpot of LAMMPS ends too.
    states = lattice.integrate(rate, np.array([1e-12, 1.0]), np.linspace(0, 60, 60001), 1e-10, 1e-3, longest=np.inf)
    parting = np.flatnonzero(states[:, 0] <= 0)[0]
    measured(-states[parting, 1] / restitution - 1)


def test_a_wave_damped_by_restitution_decays_as_by_its_viscosity_at_rest():
    mode = sh.mode("TR", 0.802, SILICA)
    viscosity = restitution_viscosity(0.999, SILICA.kappa)
    damped = [
        hierarchy_orders(mode, Contact(NU, prestress=1.0, **effects), TAU, order=3)
        for effects in ({"restitution": 0.999}, {"viscosity": viscosity})
    ]
    assert np.allclose(damped[0][0], damped[1][0], rtol=0, atol=1e-8)
    assert np.max(np.abs(damped[0][1] - damped[1][1])) > 1e-5  # (1−x)^{1/4} is seen in the second order


@pytest.mark.parametrize("stretch", [0.9, 0.5, -1.0, -15.0])
def test_the_dashpot_of_a_restitution_goes_as_the_fourth_root_of_the_overlap(stretch):
    # Rows 0 … 4 pulled apart or pressed alike, so that their contacts are longer by the stretch; row 2 is looked at
    contact, free = (Contact(NU, prestress=1.0, restitution=e) for e in (0.9, None))
    rates = np.random.default_rng(3).uniform(-1, 1, (3, 5))
    places = np.zeros((3, 5))
    places[0] = np.arange(5) * stretch / (np.sqrt(3) / 2)
    state = np.concatenate([places, rates])
    damped, still = (lattice.rhs(state, each, paper_rows.ring_neighbours())[3:, 2] for each in (contact, free))
    force = six_dashpots(rates[:, 1:4], contact, between_rows=(1 - stretch) ** 0.25)
    wrong = six_dashpots(rates[:, 1:4], contact, between_rows=(1 - stretch) ** 0.5)
    p, q, phi = damped - still
    # Rounding of forces that are at most (2/3) 16^{3/2}/(2(κ+3)) = 5.5, thousandfold
    assert [p, q, phi * 0.4] == pytest.approx([force[1], -force[0], force[2]], rel=0, abs=1e-12)
    assert np.max(np.abs(force - wrong)) > 1e-3
