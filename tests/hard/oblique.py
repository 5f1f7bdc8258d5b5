"""Waves that are not along y: at and near the corners and edges of the zone, and what a pulse on a sheet keeps."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from granular_analysis.second_harmonic import ModeName
from granular_analysis.theory import bloch, lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from granular_lmp import Record, Scene, build, run
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import edited
from tests.hard.waves import ETA, NU, PERIODIC, verlet_bound

# (i, j) of (columns, rows): the corner K, next to it, the middle M of an edge that is not along y, next to an edge
CORNERS = {"K": ((2, 0), (3, 4)), "next to K": ((39, 0), (60, 4)), "M": ((2, 1), (4, 4)), "edge": ((16, 7), (30, 40))}


def made(scene: Scene, edits: Edits = ()) -> tuple[Record, float]:
    """A run of a deck, broken or not, with what it says of momentum: the largest change, over Σ|v| at the start."""
    deck = build(scene)
    with TemporaryDirectory() as place:
        record = run(replace(deck, input_text=edited(deck.input_text, edits)), Path(place) / "run")
        if not scene.output.particles:
            return record, 0.0
        velocity = record.snapshots().stack("velocity")
    total = velocity.sum(axis=1)
    return record, float(np.abs(total - total[0]).max() / np.abs(velocity[0]).sum())


def corner(
    place: str, name: ModeName, duration: float, step: float = 0.025, reference: float = NU, edits: Edits = ()
) -> Cases:
    """A mode at a corner or an edge of the zone against the exact lattice, whose ν is `reference`."""
    (i, j), (columns, rows) = CORNERS[place]
    wave = PERIODIC.with_values(
        {
            "packing.columns": columns,
            "packing.rows": rows,
            "wave.mode": name,
            "wave.wavevector": [2 * np.pi * i / columns, 2 * np.pi * j / rows * 2 / np.sqrt(3)],
            "time.timestep": step,
            "time.duration": duration,
        }
    )
    record, _ = made(wave, edits)
    contact = Contact(reference, overlap_ratio=ETA)
    mode = bloch.mode(name, wave.wavenumber, wave.direction, contact)
    truth = lattice.torus(Wave(mode, wave.wave.amplitude, contact), record.tau, rtol=1e-9)  # error: 5e-8, of 1e-4
    found = np.stack([record.p, record.q, record.phi])
    return [
        Case(
            f"{name} at {wave.direction:.4g}°, ξ = {wave.wavenumber:.5g} ({place}), τ ≤ {duration:g}: error in D0",
            "phases that alias on the other side of the zone; branches that meet; 2k in another zone",
            float(np.abs(found - truth).max()),
            "phase (ΩΔτ)²Ωτ/24 and amplitude (ΩΔτ)²/8 of Verlet, half as much again for harmonics; noise of rounding",
            most=verlet_bound(wave, mode.frequency),
        )
    ]


def pulse(duration: float = 200.0, rows: int = 48, columns: int = 42, edits: Edits = ()) -> Cases:
    """A pulse that goes round a periodic sheet keeps the momentum that it has, over 200 τ several times round."""
    scene = Scene.load("tr_pulse").with_values(
        {"packing.rows": rows, "packing.columns": columns, "wave.amplitude": 0.3}
        | {"time.duration": duration, "output.particles": duration / 4}
    )
    _, change = made(scene, edits)
    return [
        Case(
            f"pulse of a = 0.3 on {scene.shape.rows} x {scene.shape.columns} spheres, τ ≤ {duration:g}: change of the "
            "momentum over Σ|v|",
            "copies of spheres across two periodic faces, each with the shear history of its contacts",
            change,
            "action is reaction; 1e-16 of each velocity a step, whose sum of 2016 in 4000 steps wanders by 1e-13",
            most=1e-11,
        )
    ]
