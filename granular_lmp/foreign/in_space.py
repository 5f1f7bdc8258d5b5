"""Checks of the dimensions of a deck, and of motions that its integrators leave out."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from granular_lmp.foreign.finding import Check, Finding
from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.reading import Reading
from granular_lmp.foreign.vibrations import contacts_of, turning

_FLAT = 1e-9  # times the radius; places of spheres in one plane differ by less
_TURNS = 1e-3  # torque over the largest possible one; above this, no symmetry forbids rotation
_SHEET = 4  # a sheet has at least this many spheres


def _fixes(reading: Reading) -> tuple[Command, ...]:
    return () if reading.start is None else reading.start.fixes


def _free_plane(reading: Reading) -> Iterator[Finding]:
    spheres, contacts = reading.spheres, contacts_of(reading)
    if spheres is None or contacts is None or reading.dimension == 2 or len(spheres.id) < _SHEET:
        return
    if through_flat_axis(reading).any():
        return
    spread = np.ptp(spheres.position, axis=0) / spheres.radius.max()
    for axis in np.flatnonzero(spread < _FLAT):
        others = np.delete(spread, axis)
        letter = "xyz"[axis]
        held = any(
            fix.words[3] == "enforce2d"
            or (fix.words[3] == "wall/gran" and f"{letter}plane" in fix.words)
            or (fix.words[3] in ("setforce", "freeze") and len(fix.words) > 4 + axis and fix.words[4 + axis] != "NULL")
            or fix.words[3].startswith(("spring/self", "wall/"))
            for fix in _fixes(reading)
        )
        if others.min() > 1 and not held:
            pressed = float((contacts.pairs.force * contacts.pairs.vector).sum(axis=1).max()) > 0
            yield Finding(
                next((fix for fix in _fixes(reading) if fix.words[3].startswith("nve")), None),
                f"all {len(spheres.id)} spheres lie in one plane, and nothing holds them along {letter}"
                + ("; the contacts are pressed, and buckle" if pressed else ""),
                None,
                "dimension 2 with fix enforce2d, or a substrate: fix wall/gran",
            )


def _columns(reading: Reading) -> Iterator[Finding]:
    spheres, contacts = reading.spheres, contacts_of(reading)
    if spheres is None or contacts is None or reading.dimension == 2:
        return
    through = int(through_flat_axis(reading).sum())
    if through:
        boxes = reading.named("create_box", "read_data", "read_restart")
        yield Finding(
            boxes[-1] if boxes else None,
            f"{through} spheres of a flat sheet touch their own images through the periodic face above it: this is a "
            "crystal of straight columns, whose spheres rub against their images when they turn",
            None,
            "dimension 2 with fix enforce2d, or a box that is higher than a sphere",
        )


def through_flat_axis(reading: Reading) -> NDArray[np.bool_]:
    """Return which contacts are between a sphere of a flat sheet and its own image above or below the sheet."""
    spheres, contacts = reading.spheres, contacts_of(reading)
    assert spheres is not None
    assert contacts is not None
    flat = np.ptp(spheres.position, axis=0) < _FLAT * spheres.radius.max()
    pairs = contacts.pairs
    along = np.argmax(np.abs(pairs.vector), axis=1)
    return np.asarray((pairs.i == pairs.j) & flat[along] & (len(spheres.id) >= _SHEET))


def _discs(reading: Reading) -> Iterator[Finding]:
    for fix in _fixes(reading):
        if fix.words[3] == "nve/sphere" and "disc" in fix.words[4:]:
            yield Finding(
                fix,
                "'disc' gives bodies with the contacts and the mass of spheres the moment of inertia m R²/2 of a disc: "
                "free rotations are 11 % slower",
                1 - (0.4 / 0.5) ** 0.5,
                str(fix).replace(" disc", ""),
            )


def _without_turning(reading: Reading) -> Iterator[Finding]:
    spheres, contacts = reading.spheres, contacts_of(reading)
    if spheres is None or contacts is None or not contacts.shear.any():
        return
    stiff = spheres.moves & ~spheres.turns
    fix = next((fix for fix in _fixes(reading) if fix.words[3] == "nve"), None)
    if fix is not None and stiff.any() and turning(reading) > _TURNS:
        ratio = float((contacts.shear / contacts.normal).max())
        yield Finding(
            fix,
            f"{int(stiff.sum())} spheres move and do not turn, while contacts have a shear stiffness of {ratio:.3g} "
            "times the normal one",
            None,
            str(fix).replace(" nve", " nve/sphere"),
        )


CHECKS = (
    Check(
        "free-plane",
        "A sheet in space leaves its plane as soon as rounding pushes it, as this costs no energy or releases some.",
        _free_plane,
    ),
    Check(
        "not-two-dimensional",
        "A box in space that is as high as a sphere is periodic in the third dimension, and not flat.",
        _columns,
    ),
    Check(
        "discs",
        "The laws of Hertz and Mindlin are for spheres, whose moment of inertia is 2/5 m R².",
        _discs,
    ),
    Check(
        "no-rotation",
        "Shear forces turn spheres; without rotation transverse waves are different, and too fast.",
        _without_turning,
    ),
)
