"""The network against LAMMPS: a small crystal with a heavy sphere, a vacancy and unequal radii; and LAMMPS's mixing.

The decks here are written by hand, so that nothing of `granular_lmp` but the place of LAMMPS is shared. They are in
LAMMPS's units nano (ag, nm, ns, MPa, mJ/m²), which are consistent: the network takes the same numbers.
"""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import forces, start
from tests.conftest import members
from tests.instance import silent_lammps

SILICA = Material(73e3, 0.17, 63.0)
RADIUS, DENSITY = 500.0, 0.0022
OVERLAP, TIME = 0.2498514361612, 0.4981191748424  # Δ0 and t0 of the paper's spheres
AMPLITUDE = 0.2  # amplitude of the random displacements, in Δ0
COLUMNS, ROWS = 8, 6
SAMPLES = 5
TIMES = TIME * np.arange(1, SAMPLES + 1)
SLID = 1  # samples of crystals whose contacts slide: many do from the start
STYLES = {"secant": "mindlin", "incremental": "mindlin/force"}


def imperfect(law):
    """Return a periodic crystal of 48 sites, one empty, one of a heavy sphere, with radii unequal by up to 1e-4."""
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    spacing = 2 * RADIUS - OVERLAP
    places = spacing * np.stack([column + 0.25 + row % 2 / 2, (row + 0.25) * sqrt(3) / 2], axis=1)
    rng = np.random.default_rng(4)
    radius = RADIUS * (1 + 1e-4 * rng.uniform(-1, 1, len(row)))
    density = np.full(len(row), DENSITY)
    density[12] *= 4
    there = np.arange(len(row)) != 29
    cell = (COLUMNS * spacing, ROWS * spacing * sqrt(3) / 2)
    return Network(places[there], radius[there], density[there], (SILICA,), cell=cell, law=law)


def disturbed(network):
    """Return random displacements, velocities, rotations and no spins, of the order of Δ0/10."""
    rng, count, size = np.random.default_rng(5), len(network.position), AMPLITUDE * OVERLAP
    way, velocity = size * rng.uniform(-0.5, 0.5, (count, 2)), size / TIME * rng.uniform(-0.5, 0.5, (count, 2))
    return way, velocity, size / RADIUS * rng.uniform(-0.5, 0.5, count), np.zeros(count)


def lammps(network, model, moving, every, steps, samples):
    """Return displacement x, y and rotation (samples, 3, N) at multiples of `every`, in so many steps each."""
    (way, velocity, rotation, spin), step, count = moving, every / steps, len(network.position)
    width, height = (5000.0 if np.isinf(period) else period for period in network.cell)
    edges = ["f" if np.isinf(period) else "p" for period in network.cell]
    spheres = zip(network.position, network.radius, network.density, network.kinds, strict=True)
    commands = "\n".join(
        f"create_atoms {kind + 1} single {x:.17g} {y:.17g} 0\n"
        f"set atom {i + 1} diameter {2 * radius:.17g} density {density:.17g} dipole 1 0 0"
        for i, ((x, y), radius, density, kind) in enumerate(spheres)
    )
    with silent_lammps() as lmp:
        lmp.commands_string(f"""
            units nano
            dimension 2
            boundary {edges[0]} {edges[1]} p
            atom_style hybrid sphere dipole
            atom_modify map array sort 0 0.0
            comm_modify vel yes
            region box block 0 {width:.17g} 0 {height:.17g} -800 800
            create_box {len(network.materials)} box
            {commands}
            mass * 1.0
            neighbor 50.0 bin
            pair_style granular
            {model}
            compute moved all displace/atom
            fix plane all enforce2d
            thermo_style custom step
            timestep {1e10 * step!r}
            fix move all nve/noforce
        """)

        def put(rates, turning):
            order = lmp.numpy.extract_atom("id")[:count] - 1
            lmp.numpy.extract_atom("v")[:count, :2] = rates[order]
            lmp.numpy.extract_atom("omega")[:count, 2] = turning[order]
            lmp.numpy.extract_atom("mu")[:count, :2] = np.stack([np.cos(rotation), np.sin(rotation)], axis=1)[order]

        put(way / (1e10 * step), rotation / (1e10 * step))
        lmp.commands_string(f"run 1 post no\nunfix move\nreset_timestep 0\ntimestep {step!r}")
        put(velocity, spin)
        lmp.command("fix move all nve/sphere update dipole")
        fields = np.empty((samples, 3, count))
        for sample in fields:
            lmp.command(f"run {steps} post no")
            ids = lmp.numpy.extract_atom("id")[:count] - 1
            sample[:2, ids] = lmp.numpy.extract_compute("moved", 1, 2)[:count, :2].T
            mu = lmp.numpy.extract_atom("mu")[:count]
            sample[2, ids] = np.arctan2(mu[:, 1], mu[:, 0])
    return fields


def without_step(network, model, moving, every, steps, samples=SAMPLES):
    """Return the fields of LAMMPS, extrapolated from three steps to none, free of errors of first and second order.

    LAMMPS turns the slip in first order, which is little, and `mindlin/force` adds to the shear force in first order.
    """
    coarse, middle, fine = (lammps(network, model, moving, every, n * steps, samples) for n in (1, 2, 4))
    return (8 * fine - 6 * middle + coarse) / 3


def silica(law, friction):
    return f"pair_coeff * * dmt 73e3 0.0 0.17 31.5 tangential {STYLES[law]} NULL 0.0 {friction!r} damping velocity"


def distance(network, run, fields):
    """Return the largest difference of a displacement or of Rθ."""
    scale = np.stack([np.ones_like(network.radius), np.ones_like(network.radius), network.radius])
    return np.max(np.abs(scale * (run.motion[:, :3] - fields)))


@pytest.mark.parametrize("law", STYLES)
def test_an_imperfect_crystal_moves_as_in_lammps(law):
    network, size = imperfect(law), AMPLITUDE * OVERLAP
    # μ = 5a: no contact slides, and LAMMPS turns its slips
    fields = without_step(network, silica(law, 5 * AMPLITUDE), disturbed(network), TIME, 200)
    run = integrate(network, start(network, *disturbed(network)), TIMES, rtol=1e-9)
    # The error of LAMMPS that is left is 1e-8, of third order; positions of 1e4 nm carry 1e-12/D0 = 4e-11 a step.
    assert distance(network, run, fields) < 1e-6 * size
    light = replace(network, density=np.full_like(network.density, DENSITY))
    assert distance(network, integrate(light, start(light, *disturbed(light)), TIMES, rtol=1e-6), fields) > 1e-2 * size


@pytest.mark.parametrize("law", members(STYLES, "incremental"))
def test_contacts_slide_as_in_lammps(law):
    friction, size, sticking = 0.1, AMPLITUDE * OVERLAP, imperfect(law)
    sliding = replace(sticking, friction=friction)
    fields = without_step(sliding, silica(law, friction), disturbed(sliding), TIME, 200, SLID)
    errors = []
    for step in (1 / 40, 1 / 160):
        run = integrate(sliding, start(sliding, *disturbed(sliding)), TIMES[:SLID], rtol=1e-8, longest_step=step * TIME)
        errors.append(distance(sliding, run, fields))
    # Second order in the step: sixteen times less, about which starts and ends of sliding scatter
    assert errors[1] < 5e-6 * size
    assert errors[1] < errors[0] / 5
    stuck = integrate(sticking, start(sticking, *disturbed(sticking)), TIMES[:SLID], rtol=1e-6)
    assert distance(sticking, stuck, fields) > 0.1 * size


# --- dashpots ---------------------------------------------------------------------------------------------------------

VISCOSITY = 0.3 * 4 / 3 * np.pi * RADIUS**3 * DENSITY / TIME  # 0.3 m/t0, in ag/ns: waves decay in some t0
STICKING = 25 * AMPLITUDE  # five times that of springs alone, as the forces of dashpots are larger
DASHPOTS = {
    "viscosity": {"viscosity": VISCOSITY},
    "incremental": {"viscosity": VISCOSITY, "law": "incremental"},
    "restitution": {"restitution": 0.6, "materials": (replace(SILICA, work_of_adhesion=0.0),)},
}


def damped(case, friction):
    """Return the imperfect crystal with dashpots, and LAMMPS's model of its contacts; the cell presses Hertz's."""
    network = replace(imperfect("secant"), **DASHPOTS[case], friction=friction)
    normal, damping = f"dmt 73e3 {VISCOSITY!r} 0.17 31.5", "velocity"
    if case == "restitution":
        normal, damping = f"hertz/material 73e3 {network.restitution!r} 0.17", "coeff_restitution"
    tangential = f"tangential {STYLES[network.law]} NULL 1.0 {friction!r}"
    return network, f"pair_coeff * * {normal} {tangential} damping {damping}"


@pytest.mark.parametrize("case", DASHPOTS)
def test_a_damped_crystal_moves_as_in_lammps(case):
    network, model = damped(case, STICKING)
    moving, size = disturbed(network), AMPLITUDE * OVERLAP
    fields = without_step(network, model, moving, TIME, 200)
    sticking = replace(network, friction=np.inf)
    # 3e-8, measured: errors of third order in LAMMPS's step
    assert distance(network, integrate(sticking, start(sticking, *moving), TIMES), fields) < 1e-6 * size
    name = "restitution" if case == "restitution" else "viscosity"
    other = replace(sticking, **{name: 1.01 * getattr(network, name)})
    assert distance(network, integrate(other, start(other, *moving), TIMES, rtol=1e-6), fields) > 1e-3 * size


@pytest.mark.parametrize("case", members(DASHPOTS, "viscosity", "incremental"))
def test_damped_contacts_slide_as_in_lammps(case):
    network, model = damped(case, 0.1)
    moving, size = disturbed(network), AMPLITUDE * OVERLAP
    fields = without_step(network, model, moving, TIME, 200, SLID)
    run = integrate(network, start(network, *moving), TIMES[:SLID], rtol=1e-8, longest_step=TIME / 80)
    # 1.5e-6, measured: of second order in the longest step
    assert distance(network, run, fields) < 4e-6 * size
    sticking = replace(network, friction=np.inf)
    assert distance(network, integrate(sticking, start(sticking, *moving), TIMES[:SLID]), fields) > 0.1 * size


def test_dashpots_without_sense_are_refused():
    crystal = imperfect("secant")
    for wrong in ({"viscosity": -1.0}, {"restitution": 0.0}, {"restitution": 0.5}):  # the last with adhesion
        with pytest.raises(ValueError, match=next(iter(wrong))):
            replace(crystal, **wrong)


def test_a_chain_of_unequal_spheres_of_two_materials_tumbles_as_in_lammps():
    # Adhesion holds the bent chain together while it turns by 0.4 rad, rolls and vibrates.
    radius, steel = np.array([500.0, 350.0, 700.0]), Material(200e3, 0.3, 100.0)
    joint = np.array([1000 + radius[0] + radius[1] - 0.2, 2000.0])
    elbow = (radius[1] + radius[2] - 0.2) * np.array([np.cos(1.0), np.sin(1.0)])
    network = Network(
        np.stack([[1000.0, 2000.0], joint, joint + elbow]),
        radius,
        np.array([0.0022, 0.0078, 0.0022]),
        (SILICA, steel),
        kind=np.array([0, 1, 0]),
        shear_mixing="lammps",
    )
    turn = 0.004  # rad/ns
    x, y = (network.position - network.position.mean(axis=0)).T
    vibration = np.array([[0.02, 0], [0, 0.03], [-0.02, 0]])
    spin = turn * np.array([1, 0.99, 1.01])
    moving = np.zeros((3, 2)), turn * np.stack([-y, x], axis=1) + vibration, np.zeros(3), spin
    every = 20.0
    model = "".join(f"pair_coeff {i} {i} {pair_model(one)}" for i, one in ((1, SILICA), (2, steel)))
    fields = without_step(network, model, moving, every, 1000)
    run = integrate(network, start(network, *moving), every * np.arange(1, SAMPLES + 1), rtol=1e-12)
    assert np.max(np.abs(run.motion[-1, 2])) > 0.35
    # 1e-8 nm, measured, of ways of 300 nm: errors of third order in a step of 0.02 ns
    assert distance(network, run, fields) < 1e-6 * OVERLAP
    mindlin = replace(network, shear_mixing="mindlin")
    other = integrate(mindlin, start(mindlin, *moving), run.times)
    assert distance(network, other, fields) > 1e-2 * OVERLAP


# --- mixing of kinds --------------------------------------------------------------------------------------------------


def pair_force(coefficients):
    """Return the force on the first of two spheres of 1 m and 0.5 m that overlap by 0.01 m and turned by 1e-4."""
    with silent_lammps() as lmp:
        lmp.commands_string(f"""
            units si
            dimension 2
            boundary p p p
            atom_style sphere
            comm_modify vel yes
            region box block -10 10 -10 10 -1 1
            create_box 2 box
            create_atoms 1 single -1.0 0 0
            create_atoms 2 single 0.49 0 0
            set type 1 diameter 2.0 density 1.0
            set type 2 diameter 1.0 density 3.0
            neighbor 0.1 bin
            timestep 1.0
            pair_style granular
            {coefficients}
            set group all omega 0 0 1e-4
            fix move all nve/noforce
            run 1
        """)
        order = np.argsort(lmp.numpy.extract_atom("id")[:2])
        return lmp.numpy.extract_atom("f")[order[0], :2].copy()


def pair_of(first, second, **changes):
    """Return the same force by the network."""
    places, radius = np.array([[-1.0, 0], [0.49, 0]]), np.array([1.0, 0.5])
    network = Network(places, radius, np.ones(2), (first, second), kind=np.array([0, 1]), **changes)
    return forces(network, start(network, 0.0, 0.0, rotation=1e-4))[:2, 0]


def pair_model(material, stiffness="NULL"):
    """Return the coefficients of a pair for `pair_coeff`."""
    return (
        f"dmt {material.youngs_modulus!r} 0.0 {material.poisson_ratio!r} {material.work_of_adhesion / 2!r} "
        f"tangential mindlin {stiffness} 0.0 10.0 damping velocity\n"
    )


SOFT, HARD = Material(1e6, 0.17, 4.0), Material(3e6, 0.4, 16.0)


@pytest.mark.parametrize("second", [HARD, SOFT])
def test_lammps_mixes_types_by_a_shear_modulus_of_its_own(second):
    lammps_force = pair_force(f"pair_coeff 1 1 {pair_model(SOFT)}pair_coeff 2 2 {pair_model(second)}")
    # Rounding of the overlap, 1e-16 of the radius in 0.01 of it
    assert pair_of(SOFT, second, shear_mixing="lammps") == pytest.approx(lammps_force, rel=1e-12)
    mindlin = pair_of(SOFT, second)
    assert mindlin[0] == pytest.approx(lammps_force[0], rel=1e-12)
    assert 1.7 < mindlin[1] / lammps_force[1] < 2.1


def test_a_pair_coeff_of_its_own_gives_a_pair_the_modulus_of_mindlin():
    # The pair: E and ν that have its E*, and 8G* in place of NULL
    both = [SOFT, HARD]
    young = 1 / sum((1 - m.poisson_ratio**2) / m.youngs_modulus for m in both)
    shear = 1 / sum(2 * (2 - m.poisson_ratio) * (1 + m.poisson_ratio) / m.youngs_modulus for m in both)
    mixed = Material(2 * young, 0.0, sqrt(SOFT.work_of_adhesion * HARD.work_of_adhesion))
    own = f"pair_coeff 1 1 {pair_model(SOFT)}pair_coeff 2 2 {pair_model(HARD)}"
    own += f"pair_coeff 1 2 {pair_model(mixed, repr(8 * shear))}"
    assert pair_of(SOFT, HARD) == pytest.approx(pair_force(own), rel=1e-12)
