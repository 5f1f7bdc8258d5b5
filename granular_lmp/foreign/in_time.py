"""Checks of the time step of a deck against vibrations, collisions and dashpots, and of its list of neighbours."""

from collections.abc import Iterator
from math import pi

import numpy as np

from granular_lmp.foreign.finding import Check, Finding
from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.reading import Reading
from granular_lmp.foreign.vibrations import contacts_of, fastest, fastest_decay, first_collision

STEPS = 25  # fewest in the fastest period and in a collision; the errors are then 3e-3 and 3e-4
_LONGEST = 2 * pi / STEPS  # rad, the phase of the fastest vibration in one step
# By velocity Verlet, the relative error of the speed after a collision of n ≥ 3 steps is at most _LOSS/n^(5/2)
_LOSS, _FEWEST = 1.1, 3.0
_LAG = 0.01  # relative error of a decay that is accepted
_SKINS = {"lj": 0.3, "real": 2.0, "metal": 2.0, "si": 1e-3, "cgs": 0.1, "electron": 2.0, "micro": 0.1, "nano": 0.1}


def _timestep(reading: Reading) -> Command | None:
    assert reading.fastest is not None
    before = reading.commands[: reading.commands.index(reading.fastest.command)]
    return next((each for each in reversed(before) if each.name == "timestep"), None)


def _too_long(reading: Reading) -> Iterator[Finding]:
    frequency = fastest(reading)
    if not frequency or reading.fastest is None:
        return
    step = reading.fastest.timestep
    phase = frequency * step
    if phase > _LONGEST:
        error = min(1.0, phase * phase / 24)
        said = "the spheres fly apart" if phase > 2 else f"its frequency is {error:.1%} too high"
        yield Finding(
            _timestep(reading),
            f"the step {step:.4g} is 1/{2 * pi / phase:.3g} of the period {2 * pi / frequency:.4g} of the fastest "
            f"vibration of these contacts: {said}",
            error,
            f"timestep {_LONGEST / frequency:.3g}",
        )


def _collision(reading: Reading) -> Iterator[Finding]:
    collision = first_collision(reading)
    if collision is None or reading.fastest is None:
        return
    speed, duration = collision
    step = reading.fastest.timestep
    if step * STEPS > duration:
        error = _LOSS * (step / duration) ** 2.5 if step * _FEWEST < duration else 1.0
        yield Finding(
            _timestep(reading),
            f"a collision at the speed {speed:.3g} of the fastest sphere lasts {duration:.3g}, which is "
            f"{duration / step:.3g} steps: speeds after it are up to {error:.2g} off",
            error,
            f"timestep {duration / STEPS:.3g}",
        )


def _late_damping(reading: Reading) -> Iterator[Finding]:
    rate = fastest_decay(reading)
    if not rate or reading.fastest is None:
        return
    error = rate * reading.fastest.timestep / 2
    if error > _LAG:
        contacts = contacts_of(reading)
        assert contacts is not None
        law = next(law for law, which in reading.law_of(contacts.pairs) if contacts.dashpot[which].any())
        yield Finding(
            law.command,
            f"in a step of {reading.fastest.timestep:.4g} the dashpots lag so far that the fastest decay is "
            f"{error:.1%} too fast, and the vibration {error / 2:.1%}",
            error,
            f"timestep {2 * _LAG / rate:.3g}",
        )


def _rare_lists(reading: Reading) -> Iterator[Finding]:
    spheres, start = reading.spheres, reading.start
    if spheres is None or start is None:
        return
    settings: dict[str, str] = {}
    last = None
    for command in reading.named("neigh_modify"):
        words = dict(zip(command.words[1:], command.words[2:], strict=False))
        settings |= {key: words[key] for key in ("every", "delay", "check") if key in words}
        last = command if words.keys() & {"every", "delay"} else last
    wait = max(int(settings.get("every", 1)), int(settings.get("delay", 0)))
    speed = float(np.linalg.norm(spheres.velocity, axis=1).max())
    way, skin = speed * start.timestep * min(wait, start.steps or 0), skin_of(reading)
    if last is not None and 2 * way > skin:
        yield Finding(
            last,
            f"in the {wait} steps between two lists of neighbours the fastest sphere goes {way:.3g}, and two that meet "
            f"{2 * way:.3g}; the skin is {skin:.3g}, and a contact may begin with an overlap of {2 * way - skin:.3g}",
            None,
            "neigh_modify every 1 delay 0 check yes",
        )


def _thick_skin(reading: Reading) -> Iterator[Finding]:
    spheres = reading.spheres
    if spheres is None or not spheres.radius.any():
        return
    diameter, skin = 2 * float(spheres.radius.max()), skin_of(reading)
    if skin > diameter:
        lines = reading.named("neighbor")
        default = "" if lines else f", the default of units {reading.units},"
        yield Finding(
            (lines or reading.named("pair_style") or reading.commands)[-1],
            f"the skin {skin:.3g}{default} is {skin / diameter:.3g} diameters: the list holds about "
            f"{(1 + skin / diameter) ** reading.dimension:.3g} times the neighbours that can touch",
            None,
            f"neighbor {diameter / 20:.3g} bin",
        )


def skin_of(reading: Reading) -> float:
    """Return the skin: neighbours are listed up to this distance beyond contact."""
    lines = reading.named("neighbor")
    return float(lines[-1].words[1]) if lines else _SKINS[reading.units]


CHECKS = (
    Check(
        "time-step",
        "Velocity Verlet runs a vibration of frequency ω too fast by (ωh)²/24, and is unstable above ωh = 2.",
        _too_long,
    ),
    Check(
        "collision-time",
        "A contact that lasts few steps opens in the middle of a step, and the speed after it depends on chance.",
        _collision,
    ),
    Check(
        "first-order-damping",
        "LAMMPS computes dashpots with velocities of half a step ago, so that damping is of first order in the step.",
        _late_damping,
    ),
    Check(
        "rare-neighbour-lists",
        "A contact that is not yet in the list has no force, and begins later with an overlap and no shear history.",
        _rare_lists,
    ),
    Check(
        "thick-skin",
        "LAMMPS looks at each pair of the list in each step; the default skin is meant for spheres of another size.",
        _thick_skin,
    ),
)
