"""Witness of an unnamed crystal: its contacts, integrated from the first snapshot, and its difference from the deck.

The witness starts with the places, velocities and spins of the first snapshot, and with contacts without slip. It is
integrated by velocity Verlet with the steps of the deck, and again with a quarter of the step. The deck differs from
the finer witness by

    the step        estimated by the witness with the deck's step
    the digits      estimated by a start with places moved by up to half of the last digit of the dump
    the rest        facts that neither law nor dump contains: slip at the first snapshot, other forces, another law

each as the norm of the differences of all velocities over the norm of the velocities. Lengths, times and masses are
those of the dump in SI units; a dump in units lj keeps its own.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Law, Material, Network, Wall
from granular_analysis.theory.network_compiled import fastest_march
from granular_analysis.theory.network_laws import Adhesion
from granular_analysis.theory.network_outside import Drive, Function
from granular_analysis.theory.network_state import start
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.runs.unnamed import Moment, Unnamed

Floats = NDArray[np.float64]

FINER = 4  # steps of the finer witness in one step of the deck
PARTED = 0.01  # deck and witness part when a sphere differs by this share of the largest speed
_ROUNDING = 1e-9  # relative difference of velocities below which no cause is needed
_EVEN = 1e-4  # relative difference below which time steps are equal, because %g rounds the printed times
EXPLAINED = 3.0  # a difference of more than this times step and digits has another cause
_NORMAL: dict[str, Adhesion] = {"hertz/material": "dmt", "dmt": "dmt", "jkr": "jkr"}
_SHEAR: dict[str, Law] = {"mindlin": "secant", "mindlin/force": "incremental"}
_MATERIAL = ("young", "poisson", "gamma")
_ELASTIC = {"none", "linear_nohistory"}
# Entries of run.json, some of which folders of earlier versions lack
_OF_DECK, _OF_OUTSIDE, _OF_LAW = ("absent", "strangers"), ("unfollowed",), ("line", "unread")


@dataclass(frozen=True)
class Witness:
    """Difference of a deck from its witness, with its likely causes.

    Attributes
    ----------
    steps, timestep : number of steps of the deck, and the time of one.
    error : norm of the differences of all velocities from the finer witness, over the norm of the velocities.
    step, digits : likely size of the same, from the step of the deck and from the digits of the dump.
    largest : largest difference of a velocity, over the largest speed.
    sphere, time : number of the sphere with the largest difference, and its time.
    parted : first time at which a sphere differs by more than `PARTED`, and the number of that sphere; None if none
        does.
    reasons : sentences on facts that the witness cannot know.
    """

    steps: int
    timestep: float
    error: float
    step: float
    digits: float
    largest: float
    sphere: int
    time: float
    parted: tuple[float, int] | None
    reasons: tuple[str, ...]

    @property
    def explained(self) -> bool:
        """True if step and digits are enough to explain the difference."""
        return self.error <= EXPLAINED * (self.step + self.digits) + _ROUNDING

    @property
    def cause(self) -> str:
        """Name of the larger cause; "" if step and digits do not explain the difference, or there is none."""
        if not self.explained or self.error <= _ROUNDING:
            return ""
        return "the step" if self.step > self.digits else "the digits of the dump"


def witness(crystal: Unnamed) -> Witness:
    """Return the difference of the deck of an unnamed crystal from its witness.

    Raises
    ------
    TheoryError
        If the contact law is unknown or not in the network, or snapshots are not equally spaced in steps.
    RunFolderError
        If masses are unknown.
    """
    apart = np.diff(crystal.steps)
    if not len(apart) or np.ptp(apart):
        raise TheoryError("the dump must have at least two snapshots, equally spaced in steps")
    timestep = timestep_of(crystal)
    first = crystal[0]
    network = network_of(crystal)
    axes, free = network.dimension, network.mobility[0] > 0
    spin = np.zeros((len(crystal.spheres), 3)) if first.spin is None else first.spin
    march = fastest_march()

    def run(places: Floats, finer: int) -> Iterator[Floats]:
        """Yield the velocities (N, d) at each snapshot of a witness that starts from these places."""
        from_here = replace(network, position=places)
        state = start(from_here, 0.0, first.velocity[:, :axes], 0.0, spin[:, 2] if axes == 2 else spin)
        every, count = int(apart[0]) * finer, int(apart.sum()) * finer
        for motion in march(from_here, state, timestep / finer, count, every):
            yield motion[network.freedoms : network.freedoms + axes].T * free[:, None]

    resolution = crystal.known["resolution"]
    noise = np.random.default_rng(0).uniform(-0.5, 0.5, network.position.shape) * resolution
    noise[:, np.ptp(network.position, axis=0) == 0] = 0.0
    runs = [run(network.position, FINER), run(network.position, 1)]
    runs += [run(network.position + noise, 1)] if resolution else []
    sums, largest, speeds, spheres = np.zeros(4), np.zeros(len(crystal)), np.zeros(len(crystal)), []
    for number, (fine, coarse, *others) in enumerate(zip(*runs, strict=True)):
        deck = crystal[number].velocity[:, :axes] * free[:, None]
        rounded = others[0] if others else coarse
        off = np.linalg.norm(deck - fine, axis=1)
        sums += [np.sum(each**2) for each in (deck, off, coarse - fine, rounded - coarse)]
        largest[number], speeds[number] = off.max(), np.linalg.norm(deck, axis=1).max()
        spheres.append(int(crystal.spheres[off.argmax()]))
    size, *shares = np.sqrt(sums)
    fastest, farthest = float(speeds.max()) or 1.0, int(largest.argmax())
    late = np.flatnonzero(largest > PARTED * fastest)
    error, step, digits = (float(each / (size or 1.0)) for each in shares)
    return Witness(
        steps=int(apart.sum()),
        timestep=timestep,
        error=error,
        step=step,
        digits=digits,
        largest=float(largest.max()) / fastest,
        sphere=spheres[farthest],
        time=float(crystal.time[farthest]),
        parted=(float(crystal.time[late[0]]), spheres[late[0]]) if len(late) else None,
        reasons=tuple(_reasons(crystal, network, first)),
    )


def timestep_of(crystal: Unnamed) -> float:
    """Return the time of a step, from the times of the snapshots.

    Raises
    ------
    TheoryError
        If the step changes during the run.
    """
    each = np.diff(crystal.time) / np.diff(crystal.steps)
    if np.ptp(each) > _EVEN * each.max():
        raise TheoryError(f"the time step changes from {each.min():.6g} to {each.max():.6g}, which is not built")
    return float((crystal.time[-1] - crystal.time[0]) / (crystal.steps[-1] - crystal.steps[0]))


def network_of(crystal: Unnamed) -> Network:
    """Return the network of an unnamed crystal at its first snapshot.

    Raises
    ------
    TheoryError
        As `witness`.
    """
    laws = {tuple(each["types"]): each for each in crystal.known["laws"]}
    if not laws:
        raise TheoryError("no contact law is known; adopt the dump together with its deck, or with --law")
    _refuse_unsaid(crystal)
    kinds = np.unique(crystal.types)
    own = [laws[kind, kind] for kind in kinds.tolist() if (kind, kind) in laws]
    if len(own) < len(kinds):
        raise TheoryError(f"the law between spheres of equal type is known for {len(own)} of {len(kinds)} types only")
    there = {pair: law for pair, law in laws.items() if {*pair} <= {*kinds.tolist()}}
    _refuse_options(there.values())
    _refuse_others(own, there)
    _refuse_outside(crystal, own[0])
    law = own[0]
    _, cell, periodic = crystal.cell
    if periodic.any() and not np.array_equal(cell, np.diag(np.diag(cell))):
        raise TheoryError("a tilted box is not built")
    outside = crystal.known["outside"]
    still, flat = _seen(crystal)
    axes = 2 if flat and not any(wall["axis"] == 2 for wall in outside["walls"]) else 3
    still |= np.isin(crystal.spheres, outside["held"])
    _refuse_restitution(crystal, law, still)
    sheared = law["tangential"] not in _ELASTIC and law["friction"] != 0  # with friction 0 LAMMPS has no shear force
    return Network(
        crystal.rest[:, :axes],
        crystal.radius,
        crystal.mass / (4 / 3 * np.pi * crystal.radius**3),
        tuple(Material(each["young"], each["poisson"], 2 * each["gamma"]) for each in own),
        np.searchsorted(kinds, crystal.types),
        still,
        tuple(np.where(periodic, np.diag(cell), np.inf)[:axes]),
        law=_SHEAR[law["tangential"]] if sheared else "secant",
        friction=law["friction"] if sheared else np.inf,
        shear=sheared,
        rotation=outside["rotation"],
        inertia_ratio=0.5 if outside["discs"] else INERTIA_RATIO,
        viscosity=law["viscosity"] if law["damping_law"] == "velocity" else 0.0,
        restitution=_restitution(law),
        adhesion=_NORMAL[law["normal"]],
        shear_mixing="lammps" if any(each["mixed"] for each in there.values()) else "mindlin",
        walls=tuple(_wall(each, own, axes) for each in outside["walls"]),
        drives=(*_pushes(crystal, axes), *_motions(crystal, axes)),
    )


def _wall(wall: dict[str, Any], own: list[dict[str, Any]], axes: int) -> Wall:
    """Return a rigid plane with the stiffness that LAMMPS gives to contacts of each type of spheres with a wall.

    LAMMPS uses the material of the wall for the sphere too.
    """
    normal = wall["side"] * np.eye(axes)[wall["axis"]]
    stiff = np.array([[_modulus(each), _shear_modulus(each)] for each in own])  # sphere on a rigid plane
    factors = np.array([_modulus(wall), _shear_modulus(wall)]) / 2 / stiff
    return Wall(tuple(wall["place"] * np.abs(normal)), tuple(normal), factors=factors)


def _modulus(law: dict[str, Any]) -> float:
    return float(law["young"] / (1 - law["poisson"] ** 2))


def _shear_modulus(law: dict[str, Any]) -> float:
    return float(law["young"] / (2 * (2 - law["poisson"]) * (1 + law["poisson"])))


def _pushes(crystal: Unnamed, axes: int) -> tuple[Drive, ...]:
    """Return the constant forces of the deck as drives."""
    rows = np.array(crystal.known["outside"]["pushes"]).reshape(-1, 4)
    there = np.isin(rows[:, 0], crystal.spheres)
    spheres = np.searchsorted(crystal.spheres, rows[there, 0])
    return tuple(
        Drive(spheres, axis, np.ones_like, size=float(np.abs(forces).max()), share=forces)
        for axis, forces in enumerate(rows[there, 1 : 1 + axes].T)
        if forces.any()
    )


def _motions(crystal: Unnamed, axes: int) -> Iterator[Drive]:
    """Yield the prescribed motions of the deck as drives, relative to the places in the first snapshot."""
    for each in crystal.known["outside"]["motions"]:
        spheres = np.flatnonzero(np.isin(crystal.spheres, each["spheres"]))
        pulsation = 2 * np.pi / each["period"]
        begun = (crystal.steps[0] - each["begin"]) * timestep_of(crystal) * pulsation
        for axis, (rate, size) in enumerate(zip(each["velocity"][:axes], each["amplitude"], strict=False)):
            signal, speed = _to_and_fro(rate, size, pulsation, begun)
            yield Drive(spheres, axis, signal, moves=True, longest=1 / pulsation, size=abs(size), rate=speed)


def _to_and_fro(rate: float, size: float, pulsation: float, begun: float) -> tuple[Function, Function]:
    """Return displacement and velocity over time of a uniform motion plus an oscillation that starts at a phase."""
    return (
        lambda time: rate * time + size * (np.sin(pulsation * time + begun) - np.sin(begun)),
        lambda time: rate + size * pulsation * np.cos(pulsation * time + begun),
    )


def _refuse_restitution(crystal: Unnamed, law: dict[str, Any], still: NDArray[np.bool_]) -> None:
    """Raise TheoryError for a restitution with held spheres, unless fix freeze holds them.

    LAMMPS uses the mass of other held spheres in the dashpot.
    """
    loose = crystal.spheres[still & ~np.isin(crystal.spheres, crystal.known["outside"]["frozen"])]
    if _restitution(law) is not None and len(loose):
        raise TheoryError(
            f"damping coeff_restitution with sphere {loose[0]}, which does not move, is not built; "
            "the witness knows fix freeze"
        )


def _restitution(law: dict[str, Any]) -> float | None:
    dissipates = law["damping_law"] == "coeff_restitution" and 0 < law["damping"] < 1
    return law["damping"] if dissipates else None


def _refuse_unsaid(crystal: Unnamed) -> None:
    """Raise TheoryError if a folder of another version lacks an entry by which the witness refuses decks."""
    known, outside = crystal.known, crystal.known["outside"]
    lacking = {*_OF_DECK} - known.keys() | {*_OF_OUTSIDE} - outside.keys()
    for law in (*known["laws"], *outside["walls"]):
        lacking |= {*_OF_LAW} - law.keys()
    if lacking:
        raise TheoryError(
            f"run.json lacks {', '.join(sorted(lacking))}, as another version wrote it; adopt the dump again, with "
            "--force for the same folder"
        )


def _refuse_options(laws: Iterable[dict[str, Any]]) -> None:
    """Raise TheoryError for options of laws that the network does not hold."""
    for law in laws:
        if law["unread"]:
            raise TheoryError(f"{law['line']}: {law['unread']} is not built; the witness knows tangential and damping")
        if law["damping_law"] == "coeff_restitution" and not 0 < law["damping"] <= 1:
            raise TheoryError(
                f"{law['line']}: a restitution of {law['damping']:g} is not built; the witness knows values above 0, "
                "up to 1"
            )


def _not_built(law: dict[str, Any]) -> str:
    """Return what of a law the network does not hold, and what it does; "" if it holds all."""
    if law["normal"] not in _NORMAL:
        return f"the normal law {law['normal']} is not built; the witness knows {', '.join(_NORMAL)}"
    if law["tangential"] not in {*_SHEAR, *_ELASTIC}:
        return f"the tangential law {law['tangential']} is not built; the witness knows {[*_SHEAR]}"
    if law["shear_stiffness"] is not None and law["tangential"] in _SHEAR:
        return "a separate shear stiffness is not built; the witness knows NULL"
    if law["tangential"] == "linear_nohistory" and law["damping"] * law["shear_damping"] * law["friction"]:
        return "a damping of shear without a spring is not built; the witness knows mindlin"
    if law["damping"] and law["damping_law"] not in ("velocity", "coeff_restitution"):
        return f"damping {law['damping_law']} is not built; the witness knows velocity and coeff_restitution"
    if law["damping"] and law["tangential"] in _SHEAR and law["shear_damping"] != 1:
        return "a separate damping of shear is not built; the witness knows 1"
    return ""


def _refuse_others(own: list[dict[str, Any]], laws: dict[tuple[int, ...], dict[str, Any]]) -> None:
    """Raise TheoryError for laws that the network does not hold."""
    for law in laws.values():
        if said := _not_built(law):
            raise TheoryError(f"{law['line']}: {said}")
    for pair, law in laws.items():
        if not law["mixed"] and any(law[name] != laws[one, one][name] for name in _MATERIAL for one in pair):
            raise TheoryError(
                f"{law['line']}: a separate law between types {pair[0]} and {pair[1]} is not built; the witness mixes "
                "their materials"
            )
    same = ("normal", "tangential", "friction", "damping_law", "damping")
    if any(each[name] != own[0][name] for each in laws.values() for name in same):
        raise TheoryError("types that differ in more than their material are not built")


def _refuse_outside(crystal: Unnamed, law: dict[str, Any]) -> None:
    """Raise TheoryError for fixes and walls of the deck that the network does not hold."""
    outside = crystal.known["outside"]
    for sphere in crystal.known["strangers"]:
        raise TheoryError(
            f"sphere {sphere} is in the dump and not in the deck where its run begins; forces on it are not known"
        )
    for sentence in outside["unfollowed"]:
        raise TheoryError(sentence)
    for line in outside["others"]:
        raise TheoryError(
            f"'{line}' is not built; the witness knows constant forces, planes, and fix move wiggle, linear"
        )
    for wall in outside["walls"]:
        for name in ("tangential", "friction", "damping_law", "damping"):
            if wall[name] != law[name]:
                raise TheoryError(f"a wall with {name} = {wall[name]} and spheres with {law[name]} are not built")
        if "jkr" in (wall["normal"], law["normal"]) or wall["gamma"] or wall["shear_stiffness"] is not None:
            raise TheoryError("a wall with JKR, adhesion, or a separate shear stiffness is not built")
        if wall["normal"] not in _NORMAL:
            raise TheoryError(f"a wall with {wall['normal']} is not built; the witness knows {', '.join(_NORMAL)}")
    places = [{wall["side"]: wall["place"] for wall in outside["walls"] if wall["axis"] == axis} for axis in range(3)]
    if any(len(both) == 2 and both[1] - both[-1] < 2 * crystal.radius.max() for both in places):
        raise TheoryError("a sphere that touches two opposite walls is not built; LAMMPS omits one of the contacts")


def _seen(crystal: Unnamed) -> tuple[NDArray[np.bool_], bool]:
    """Return which spheres rest in all snapshots, and whether all stay in a plane normal to z and turn about z only.

    A sphere may rest without being held.
    """
    still, flat = np.ones(len(crystal.spheres), dtype=bool), {*crystal.axes} <= {0, 1}
    for number in range(len(crystal)):
        moment = crystal[number]
        still &= np.all(moment.place == crystal.rest, axis=1) & ~moment.velocity.any(axis=1)
        flat &= not moment.velocity[:, 2].any() and (moment.spin is None or not moment.spin[:, :2].any())
    return still, flat


def _reasons(crystal: Unnamed, network: Network, first: Moment) -> Iterator[str]:
    """Yield sentences on facts of the deck that the witness cannot know."""
    outside, step = crystal.known["outside"], int(crystal.steps[0])
    slips = network.shear and len(crystal.contacts(first).first) > 0
    if slips and (outside["history"] or step > (outside["begin"] or 0)):
        yield f"the first snapshot is at step {step}, and no dump holds the slip of its contacts"
    forgotten = outside["forgotten"]
    if slips and forgotten is not None and step < forgotten < crystal.steps[-1]:
        yield f"the deck loses the slip of its contacts at step {forgotten}, where it continues from a data file"
    unknown = step != outside["begin"] or not outside["unturned"]
    for name, said in (("absent", "of the deck is not in the dump"), ("come_and_go", "comes or goes")):
        if spheres := crystal.known[name]:
            yield f"sphere {spheres[0]} {said}, and the witness has no contacts with such spheres"
    if first.spin is None and unknown and network.shear and network.rotation:
        yield "the dump has no spins (omegax, omegay, omegaz); the witness begins without spin"
    if any("differences" in each for each in crystal.info["remarks"]):
        yield "the dump holds no velocities; they are differences of places"
    resting = np.isin(crystal.spheres, outside["held"]) & first.velocity.any(axis=1)
    for sphere in crystal.spheres[resting & np.all(crystal[len(crystal) - 1].place == first.place, axis=1)][:1]:
        yield f"sphere {sphere} has a velocity and does not move; its contacts slip in the deck, and not in the witness"
    if network.shear and (turning := _turning_held(crystal, network)):
        yield f"sphere {turning}, which is held, turns in the deck and not in the witness"


def _turning_held(crystal: Unnamed, network: Network) -> int:
    """Return the number of a held sphere whose spin changes; 0 if there is none, or the dump has no spins."""
    begun, ended = crystal[0].spin, crystal[len(crystal) - 1].spin
    if begun is None or ended is None or network.held is None:
        return 0
    turning = crystal.spheres[network.held & np.any(begun != ended, axis=1)]
    return int(turning[0]) if len(turning) else 0


def table(crystal: Unnamed, found: Witness) -> str:
    """Return the difference of the deck from its witness, as text."""
    time = "s" if crystal.in_si else "units of time"
    span = ceil(found.steps)
    lines = [
        f"{crystal.name}: {len(crystal.spheres)} spheres, {span} steps of {found.timestep:.6g} {time}, "
        f"witness with {FINER} times as many",
        f"relative error of all velocities {found.error:.1e}; the step explains {found.step:.1e}, "
        f"the digits of the dump up to {found.digits:.1e}",
        f"largest difference: sphere {found.sphere} at {found.time:.6g} {time}, "
        f"{found.largest:.1e} of the largest speed",
    ]
    if found.parted is None:
        lines.append(f"no sphere differs by more than {PARTED:.0%} of the largest speed")
    else:
        when, sphere = found.parted
        lines.append(f"first above {PARTED:.0%} of the largest speed: sphere {sphere} at {when:.6g} {time}")
    if found.cause:
        lines.append(f"{found.cause} explains this" if found.cause == "the step" else f"{found.cause} explain this")
    if not found.explained:
        lines.append("neither step nor digits explain this: the deck has physics that law and dump do not contain")
    return "\n".join([*lines, *(f"note: {each}" for each in found.reasons)])
