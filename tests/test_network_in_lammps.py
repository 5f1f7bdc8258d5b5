"""The network against LAMMPS: a small crystal with a heavy sphere, a vacancy and unequal radii; and LAMMPS's mixing.

The decks here are written by hand, so that nothing of `granular_lmp` but the place of LAMMPS is shared. They are in
LAMMPS's units nano (ag, nm, ns, MPa, mJ/m²), which are consistent: the network takes the same numbers.
"""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from analysis.network import Material, Network, forces, start
from analysis.network_motion import integrate
from granular_lmp.lammps.installation import lammps_module

SILICA = Material(73e3, 0.17, 63.0)
RADIUS, DENSITY = 500.0, 0.0022
OVERLAP, TIME = 0.2498514361612, 0.4981191748424  # Δ0 and t0 of the paper's spheres
AMPLITUDE = 0.2  # amplitude of the random displacements, in Δ0
COLUMNS, ROWS = 8, 6
SAMPLES = 5  # one per τ
STYLES = {"secant": "mindlin", "incremental": "mindlin/force"}


def imperfect(law):
    """48 sites of a periodic hexagonal lattice: one empty, one of a heavy sphere, radii unequal by up to 1e-4."""
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
    """Displacements, velocities, rotations and spins of random spheres, of the order of Δ0/10."""
    rng, count, size = np.random.default_rng(5), len(network.position), AMPLITUDE * OVERLAP
    way, velocity = size * rng.uniform(-0.5, 0.5, (count, 2)), size / TIME * rng.uniform(-0.5, 0.5, (count, 2))
    return way, velocity, size / RADIUS * rng.uniform(-0.5, 0.5, count), np.zeros(count)


def lammps(network, style, friction, steps, folder):
    """Displacement x, y and rotation (SAMPLES, 3, N) every τ, from `disturbed`, with so many steps in τ."""
    way, velocity, rotation, spin = disturbed(network)
    step = TIME / steps
    count, (width, height) = len(network.position), network.cell
    atoms = "".join(
        f"{i + 1} 1 {x:.17g} {y:.17g} 0 {2 * r:.17g} {d:.17g} 0 1 0 0\n"
        for i, ((x, y), r, d) in enumerate(zip(network.position, network.radius, network.density, strict=True))
    )
    data = folder / "data.network"
    data.write_text(
        f"network\n\n{count} atoms\n1 atom types\n\n0 {width:.17g} xlo xhi\n0 {height:.17g} ylo yhi\n"
        f"-500 500 zlo zhi\n\nAtoms # hybrid\n\n{atoms}"
    )
    lmp = lammps_module().lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    try:
        lmp.commands_string(f"""
            units nano
            dimension 2
            boundary p p p
            atom_style hybrid sphere dipole
            atom_modify map array sort 0 0.0
            comm_modify vel yes
            read_data {data}
            mass * 1.0
            neighbor 50.0 bin
            pair_style granular
            pair_coeff * * dmt 73e3 0.0 0.17 31.5 &
                tangential {style} NULL 0.0 {friction!r} damping velocity
            compute moved all displace/atom
            fix plane all enforce2d
            thermo_style custom step
            timestep {1e6 * step!r}
            fix move all nve/noforce
        """)
        order = lmp.numpy.extract_atom("id")[:count] - 1

        def put(rates, turning):
            lmp.numpy.extract_atom("v")[:count, :2] = rates[order]
            lmp.numpy.extract_atom("omega")[:count, 2] = turning[order]

        put(way / (1e6 * step), rotation / (1e6 * step))
        lmp.commands_string(f"run 1 post no\nunfix move\nreset_timestep 0\ntimestep {step!r}")
        put(velocity, spin)
        directions = lmp.numpy.extract_atom("mu")
        directions[:count, 0], directions[:count, 1] = np.cos(rotation[order]), np.sin(rotation[order])
        lmp.command("fix move all nve/sphere update dipole")
        fields = np.empty((SAMPLES, 3, count))
        for sample in fields:
            lmp.command(f"run {steps} post no")
            ids = lmp.numpy.extract_atom("id")[:count] - 1
            sample[:2, ids] = lmp.numpy.extract_compute("moved", 1, 2)[:count, :2].T
            mu = lmp.numpy.extract_atom("mu")[:count]
            sample[2, ids] = np.arctan2(mu[:, 1], mu[:, 0])
    finally:
        lmp.close()
    return fields


def without_step(network, friction, folder):
    """The fields of LAMMPS extrapolated from three steps to none.

    Its error is of second order in the step, and of first order where it turns the slip, which is little, and where
    `mindlin/force` adds to the shear force by the stiffness of the step's end.
    """
    coarse, middle, fine = (lammps(network, STYLES[network.law], friction, n, folder) for n in (200, 400, 800))
    first, second = 2 * middle - coarse, 2 * fine - middle
    return (4 * second - first) / 3


def distance(network, run, fields):
    """Largest difference of a displacement or of Rθ, in D0."""
    scale = np.stack([np.ones_like(network.radius), np.ones_like(network.radius), network.radius])
    return np.max(np.abs(scale * (run.motion[:, :3] - fields))) / (AMPLITUDE * OVERLAP)


@pytest.mark.parametrize("law", STYLES)
def test_an_imperfect_crystal_moves_as_in_lammps(law, tmp_path):
    network, times = imperfect(law), TIME * np.arange(1, SAMPLES + 1)
    # μ = 5a: no contact slides, and LAMMPS turns its slips
    fields = without_step(network, 5 * AMPLITUDE, tmp_path)
    run = integrate(network, start(network, *disturbed(network)), times, rtol=1e-11)
    # 1e-8 is left of LAMMPS's error of third order; positions of 1e4 nm carry 1e-12/D0 = 4e-11 a step.
    assert distance(network, run, fields) < 1e-6
    light = replace(network, density=np.full_like(network.density, DENSITY))
    assert distance(network, integrate(light, start(light, *disturbed(light)), times), fields) > 1e-2


@pytest.mark.parametrize("law", STYLES)
def test_contacts_slide_as_in_lammps(law, tmp_path):
    friction, times = 0.1, TIME * np.arange(1, SAMPLES + 1)
    sticking = imperfect(law)
    sliding = replace(sticking, friction=friction)
    fields = without_step(sliding, friction, tmp_path)
    errors = []
    for step in (1 / 40, 1 / 160):
        run = integrate(sliding, start(sliding, *disturbed(sliding)), times, rtol=1e-9, longest_step=step * TIME)
        errors.append(distance(sliding, run, fields))
    # Second order in the step: sixteen times less, which starts and ends of sliding scatter about
    assert errors[1] < 1e-5
    assert errors[1] < errors[0] / 5
    stuck = integrate(sticking, start(sticking, *disturbed(sticking)), times)
    assert distance(sticking, stuck, fields) > 0.1


# --- mixing of kinds --------------------------------------------------------------------------------------------------


def pair_force(coefficients):
    """Force on the first of two spheres of 1 m and 0.5 m, overlapping by 0.01 m and sheared by spins of 1e-4."""
    lmp = lammps_module().lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    try:
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
    finally:
        lmp.close()


def pair_of(first, second, **changes):
    """The same two spheres, as a network; force on the first."""
    places, radius = np.array([[-1.0, 0], [0.49, 0]]), np.array([1.0, 0.5])
    network = Network(places, radius, np.ones(2), (first, second), kind=np.array([0, 1]), **changes)
    return forces(network, start(network, 0.0, 0.0, rotation=1e-4))[:2, 0]


def model(material, stiffness="NULL"):
    """Coefficients of a pair for `pair_coeff`."""
    return (
        f"dmt {material.youngs_modulus!r} 0.0 {material.poisson_ratio!r} {material.work_of_adhesion / 2!r} "
        f"tangential mindlin {stiffness} 0.0 10.0 damping velocity\n"
    )


SOFT, HARD = Material(1e6, 0.17, 4.0), Material(3e6, 0.4, 16.0)


@pytest.mark.parametrize("second", [HARD, SOFT])
def test_lammps_mixes_types_by_a_shear_modulus_of_its_own(second):
    lammps_force = pair_force(f"pair_coeff 1 1 {model(SOFT)}pair_coeff 2 2 {model(second)}")
    # Rounding of the overlap, 1e-16 of the radius in 0.01 of it
    assert pair_of(SOFT, second, shear_mixing="lammps") == pytest.approx(lammps_force, rel=1e-12)
    mindlin = pair_of(SOFT, second)
    assert mindlin[0] == pytest.approx(lammps_force[0], rel=1e-12)
    assert 1.7 < mindlin[1] / lammps_force[1] < 2.1


def test_a_pair_coeff_of_its_own_gives_a_pair_the_modulus_of_mindlin():
    # Of the pair: E and ν that have its E*, and 8G* in place of NULL
    both = [SOFT, HARD]
    young = 1 / sum((1 - m.poisson_ratio**2) / m.youngs_modulus for m in both)
    shear = 1 / sum(2 * (2 - m.poisson_ratio) * (1 + m.poisson_ratio) / m.youngs_modulus for m in both)
    mixed = Material(2 * young, 0.0, sqrt(SOFT.work_of_adhesion * HARD.work_of_adhesion))
    own = f"pair_coeff 1 1 {model(SOFT)}pair_coeff 2 2 {model(HARD)}pair_coeff 1 2 {model(mixed, repr(8 * shear))}"
    assert pair_of(SOFT, HARD) == pytest.approx(pair_force(own), rel=1e-12)
