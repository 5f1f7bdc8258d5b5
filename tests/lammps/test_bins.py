"""No sphere rests on the face of a bin of LAMMPS, from which a stopped run could begin on the other side."""

import re

import numpy as np
import pytest

from granular_lmp import Scene, build
from granular_lmp.crystal.lattices import LATTICES
from tests.conftest import PAPER


def nearest(scene: Scene, size: float) -> float:
    """Return how near a sphere rests to a face between bins of a size, or of LAMMPS's default for 0, in Δ0."""
    deck = build(scene)
    cutoff = deck.data.diameter.max() * 1.05  # two radii and a skin of a tenth
    distances = []
    for low, high, places in zip(*deck.data.box.T, deck.data.position.T, strict=True):
        wide = (high - low) / max(int((high - low) / (size or cutoff / 2)), 1)
        faces = np.arange(low, high, wide)[1:]
        distances += [np.abs(places[:, None] - faces).min()] if len(faces) else []
    return float(min(distances)) / deck.problem.units.number(scene.scale.length, length=1)


@pytest.mark.parametrize("name", [*LATTICES, "hexagonal of 101 rows"])
def test_no_sphere_rests_on_the_face_of_a_bin(name: str) -> None:
    lattice, _, orientation = name.partition(" ")
    values = {
        "packing.lattice": lattice,
        "packing.columns": "auto",
        "packing.rows": 101 if "rows" in name else 24,
        "packing.ends": "fixed" if "rows" in name else "periodic",
        "wave.mode": "L" if lattice in ("hexagonal", "square", "chain") else "6",
    }
    values |= {"packing.orientation": orientation} if lattice in ("cubic", "fcc", "hcp") else {}
    scene = PAPER.with_values(values | {"wave.wavenumber": 0.5, "time.allow_echo": True})
    text = build(scene).input_text
    said = re.search(r"^neigh_modify binsize (\S+)", text, re.MULTILINE)
    size = float(said[1]) if said else 0.0
    assert f"sort 1 {size!r}" in text
    assert nearest(scene, size) > 1


def test_a_middle_row_would_rest_on_one() -> None:
    assert nearest(PAPER.with_values({"packing.rows": 101, "time.allow_echo": True}), 0.0) < 1e-6
