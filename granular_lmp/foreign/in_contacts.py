"""Checks of the contact laws of a deck, and of the state in which its contacts begin."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granular_lmp.crystal.adhesion_laws import Jkr
from granular_lmp.foreign.finding import Check, Finding
from granular_lmp.foreign.in_space import through_flat_axis
from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.laws import Law, law_of_wall
from granular_lmp.foreign.reading import Reading
from granular_lmp.foreign.stages import Pairs, Spheres
from granular_lmp.foreign.vibrations import contacts_of, effective_radius

_BALANCE = 0.01  # a sphere is not at rest if the net force on it exceeds this share of the pull-off force
_SAME = 0.01  # relative difference of two moduli that is accepted
_FREEZING = 1e3  # coefficient of friction
_SPEED = 1e-12  # times the largest speed; slower spheres rest
_TOUCHING = 1e-6  # times the radius; spheres with a wider gap fly
_DEEP = 0.1  # overlap over the radius


def _untouched(reading: Reading) -> bool:
    """Return whether no run and no minimization came before the start."""
    return bool(reading.stages) and reading.start is reading.stages[0]


def _adhesive_start(reading: Reading) -> Iterator[Finding]:
    spheres, pairs = reading.spheres, reading.pairs
    if spheres is None or pairs is None or not _untouched(reading) or _displacing(reading):
        return
    for law, which in reading.law_of(pairs):
        elastic = law.elastic(effective_radius(spheres, pairs)[which])
        if not law.adhesive or elastic is None:
            continue
        rest, overlaps = elastic.overlap_under(0.0), pairs.overlap[which]
        near = overlaps > -rest
        share = _imbalance(reading) / float(elastic.pull_off_force.max())
        if not isinstance(elastic, Jkr) and near.any() and not (overlaps > 0).any():
            share = 1.0  # spheres that just touch pull with the whole force as soon as they move
        if share > _BALANCE and near.any():
            yield Finding(
                law.command,
                f"at the start a sphere is pulled by {share:.2g} of the pull-off force: overlaps are "
                f"{overlaps[near].min():.4g} to {overlaps[near].max():.4g}, and contacts that nothing presses rest at "
                f"{rest.max():.4g}",
                share,
                f"put the spheres at distances of R1 + R2 - {rest.max():.6g}, or relax them before the run",
            )


def _imbalance(reading: Reading) -> float:
    """Return the largest force on a sphere that moves, without the force of dashpots."""
    spheres, contacts = reading.spheres, contacts_of(reading)
    assert spheres is not None
    force = spheres.force.copy()
    if contacts is not None:
        pairs = contacts.pairs
        axis = pairs.vector / np.linalg.norm(pairs.vector, axis=1, keepdims=True)
        approach = ((spheres.velocity[pairs.i] - spheres.velocity[pairs.j]) * axis).sum(axis=1)
        push = -(contacts.dashpot * approach)[:, None] * axis
        np.subtract.at(force, pairs.i, push)
        np.add.at(force, pairs.j, push)
    return float(np.linalg.norm(force[spheres.moves][:, : reading.dimension], axis=1).max(initial=0.0))


def _unloaded_shear(reading: Reading) -> Iterator[Finding]:
    contacts, displacing = contacts_of(reading), _displacing(reading)
    if contacts is None or not _untouched(reading) or not displacing or not contacts.shear.any():
        return
    ratio = float((contacts.shear / contacts.normal).max())
    yield Finding(
        displacing[-1],
        f"spheres are displaced and no run loads their shear springs, which are {ratio:.3g} times as stiff as the "
        "normal ones: this part of the restoring force is missing",
        None,
        "put the spheres at rest, give them the velocity displacement/step, do one step with fix nve/noforce, "
        "then set the true velocities",
    )


def _displacing(reading: Reading) -> list[Command]:
    return [
        command
        for command in reading.commands
        if command.name == "displace_atoms" or (command.name == "set" and {"x", "y", "z"} & set(command.words[3::2]))
    ]


def _secant(reading: Reading) -> Iterator[Finding]:
    spheres = reading.spheres
    if spheres is None:
        return
    speed = np.linalg.norm(spheres.velocity, axis=1)
    flying = spheres.moves & _alone(reading, spheres) & (speed > _SPEED * speed.max())
    for law in _laws_of(reading, flying):
        if law.tangential == "mindlin" and law.friction > 0:
            yield Finding(
                law.command,
                f"{int(flying.sum())} spheres fly towards contacts with 'tangential mindlin', whose shear stiffness "
                "follows the overlap down without rescaling the slip",
                None,
                str(law.command).replace("tangential mindlin ", "tangential mindlin_rescale "),
            )


def _alone(reading: Reading, spheres: Spheres) -> NDArray[np.bool_]:
    """Return which spheres touch no other."""
    low, high = np.array(reading.low), np.array(reading.high)
    sides = np.where(reading.periodic, high - low, 0.0)
    place = np.where(reading.periodic, (spheres.position - low) % np.where(sides, sides, 1.0), spheres.position)
    tree = cKDTree(place, boxsize=sides)
    distance, nearest = tree.query(place, k=2)
    other = np.minimum(nearest[:, 1], len(spheres.radius) - 1)
    return np.asarray(distance[:, 1] > (1 + _TOUCHING) * (spheres.radius + spheres.radius[other]))


def _laws_of(reading: Reading, which: NDArray[np.bool_]) -> list[Law]:
    """Return the laws between equal types of some spheres, each line once."""
    assert reading.spheres is not None
    types = np.unique(reading.spheres.type[which])
    found = [reading.laws[int(t), int(t)] for t in types if (int(t), int(t)) in reading.laws]
    return list({str(law.command): law for law in found}.values())


def _mixed_shear(reading: Reading) -> Iterator[Finding]:
    if reading.spheres is None:
        return
    there = set(reading.spheres.type.tolist())
    for (one, other), law in reading.laws.items():
        error = abs(law.shear_share - 1)
        if law.mixed and law.has_history and error > _SAME and {one, other} <= there:
            modulus, shear = law.effective()
            yield Finding(
                law.command,
                f"there is no pair_coeff {one} {other}, and LAMMPS mixes a shear stiffness that is "
                f"{law.shear_share:.3g} times that of contact mechanics between types {one} and {other}",
                error,
                f"pair_coeff {one} {other} {law.normal} {2 * modulus * (1 - law.poisson**2):.6g} {law.damping:g} "
                f"{law.poisson:.6g}{f' {law.gamma:.6g}' if law.adhesive else ''} tangential {law.tangential} "
                f"{8 * shear:.6g} {law.shear_damping:g} {law.friction:g} damping {law.damping_law}",
            )


def _wall(reading: Reading) -> Iterator[Finding]:
    for command in () if reading.start is None else reading.start.fixes:
        wall, _ = law_of_wall(command)
        of_spheres = next((law for law in reading.laws.values() if not law.mixed), None)
        if wall is None or of_spheres is None or not wall.young or not of_spheres.young:
            continue
        taken, own = wall.effective()[0], 2 * of_spheres.effective()[0]  # E* of LAMMPS; E* of a sphere on a rigid body
        material = 2 * taken  # E/(1 − ν²) of the wall alone
        right = material * own / (material + own)
        if abs(taken / right - 1) > _SAME and abs(taken / own - 1) > _SAME:
            yield Finding(
                command,
                f"the wall has E = {wall.young:g}, the spheres {of_spheres.young:g}; LAMMPS makes the contact "
                f"{taken / right:.3g} times as stiff as the two materials are",
                abs(taken / right - 1),
                f"E = {2 * right * (1 - wall.poisson**2):.6g} in this line; "
                f"a rigid wall has E = {2 * own * (1 - wall.poisson**2):.6g}",
            )


def _jkr_gap(reading: Reading) -> Iterator[Finding]:
    spheres, pairs = reading.spheres, reading.pairs
    if spheres is None or pairs is None or reading.start is None or not _untouched(reading):
        return
    for law, which in reading.law_of(pairs):
        elastic = law.elastic(effective_radius(spheres, pairs)[which])
        if not isinstance(elastic, Jkr) or not law.adhesive:
            continue
        overlap = pairs.overlap[which]
        apart = (overlap <= 0) & (overlap > elastic.pull_off_overlap)
        if apart.any():
            missing = float((-elastic.push(overlap)[apart] / elastic.of(apart).pull_off_force).max())
            yield Finding(
                law.command,
                f"{int(apart.sum())} pairs start across a gap of up to {-overlap[apart].min():.3g}, in which a JKR "
                f"contact that was closed pulls by {missing:.2g} of the pull-off force; here they have no force",
                missing,
                "start with overlaps above 0, and pull the spheres apart in the run",
            )


def _frozen_shear(reading: Reading) -> Iterator[Finding]:
    contacts = contacts_of(reading)
    if contacts is None:
        return
    for law, _ in reading.law_of(contacts.pairs):
        if law.has_history and law.friction > _FREEZING:
            yield Finding(
                law.command,
                f"the friction is {law.friction:g}; in a wave of a fifth of the overlap the second harmonic is 1e-3 "
                "off from a friction of 1e4, and 1e-4 at 10",
                1e-3,
                "a friction of 5 times the amplitude in overlaps, at which contacts of a wave do not slide",
            )
            return


def _deep(reading: Reading) -> Iterator[Finding]:
    contacts, spheres = contacts_of(reading), reading.spheres
    if contacts is None or spheres is None:
        return
    ratio = contacts.pairs.overlap / (2 * effective_radius(spheres, contacts.pairs))
    law = reading.law_of(contacts.pairs)[0][0]
    if ratio.max() > _DEEP:
        yield Finding(
            law.command,
            f"an overlap at the start is {ratio.max():.2g} of the radius",
            float(ratio.max()),
            "smaller overlaps, or a stiffer material",
        )


def _images(reading: Reading) -> Iterator[Finding]:
    contacts, spheres = contacts_of(reading), reading.spheres
    if contacts is None or spheres is None or not contacts.shear.any():
        return
    twice = _of_one_pair(contacts.pairs.of(~through_flat_axis(reading)), spheres)
    if twice:
        lines = reading.named("create_box", "read_data", "read_restart")
        yield Finding(
            lines[-1] if lines else None,
            f"{twice} contacts are between two spheres, or a sphere and itself, that touch through a periodic face too",
            None,
            "a cell of at least three spheres along each periodic axis (four rows, an even number, in a hexagonal one)",
        )


def _of_one_pair(pairs: Pairs, spheres: Spheres) -> int:
    ends = np.sort(np.stack((pairs.i, pairs.j)), axis=0)
    number = ends[0] * len(spheres.id) + ends[1]
    _, counts = np.unique(number[ends[0] != ends[1]], return_counts=True)
    return int(counts[counts > 1].sum() + np.sum(ends[0] == ends[1]))


CHECKS = (
    Check(
        "adhesive-start",
        "Contacts that are not at rest start a wave of their own.",
        _adhesive_start,
    ),
    Check(
        "unloaded-shear",
        "LAMMPS starts each contact without slip, so that a displaced lattice has no shear forces.",
        _unloaded_shear,
    ),
    Check(
        "secant-shear",
        "On unloading, the secant law returns more energy than was stored: after oblique impacts the surface speed of "
        "spheres is wrong by up to 3 % of the speed of impact at a friction of 0.5, and by 6 % at 1.",
        _secant,
    ),
    Check(
        "mixed-shear-modulus",
        "With the stiffness NULL, LAMMPS computes G* as if the mixed modulus E* were Young's modulus of both spheres.",
        _mixed_shear,
    ),
    Check(
        "wall-modulus",
        "LAMMPS gives contacts with a wall E* = E/(2(1-nu^2)) of its own line, as if the spheres had its material.",
        _wall,
    ),
    Check(
        "jkr-gap",
        "LAMMPS begins a JKR contact only at an overlap of 0, even if the spheres touched before.",
        _jkr_gap,
    ),
    Check(
        "frozen-shear",
        "LAMMPS does not turn the slip with its contact while the change is below 1e-10 of the sliding force.",
        _frozen_shear,
    ),
    Check(
        "deep-overlap",
        "The laws of Hertz and Mindlin hold for contacts that are small beside the spheres.",
        _deep,
    ),
    Check(
        "periodic-images",
        "LAMMPS stores the slip of a contact by the number of the partner, and mixes up two contacts with one partner.",
        _images,
    ),
)
