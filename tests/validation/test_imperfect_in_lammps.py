"""Contacts that open and form in a run: the same ones as in the network of its first snapshot, at the same records."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_state import contacts, search, start
from granular_lmp import Scene, run
from tests.beside_network import fields_of, network_fields

SHEET = Scene.load("tr_periodic").with_values(
    {"packing.columns": 12, "time.duration": 15.0, "time.sample": 1.0, "output.particles": 1.0}
)
STRONG = {
    "disorder.radius": 3 * SHEET.sphere.overlap_ratio,
    "disorder.seed": 2,
    "wave.amplitude": 1.0,
    "time.duration": 8.0,
    "effects.contact_opening": True,
    "effects.friction": 5.0,  # none slides
}


def touching(network: Network, displacement: np.ndarray) -> np.ndarray:
    """Return which pairs of spheres that were near at rest touch when displaced by (N, 2), in units of the network."""
    pairs = search(network, np.zeros((2, len(displacement))))
    motion = np.zeros((6, len(displacement)))
    motion[:2] = displacement.T
    return contacts(network, motion, pairs, np.zeros((1, len(pairs.first)))).overlap > 0


@pytest.mark.rounding
def test_the_same_contacts_open_and_form_in_lammps_and_in_the_network(tmp_path: Path) -> None:
    step = 0.00625
    record = run(SHEET.with_values(STRONG | {"time.timestep": step}), tmp_path / "run")
    first = first_snapshot(record)
    ours, theirs = network_fields(first, record.tau), fields_of(record)
    rest, found, expected = (
        np.array([touching(first.network, fields[:, :2] * first.length) for fields in each])
        for each in (0 * theirs[:1], theirs, ours)
    )
    opened, formed = ((rest > found).sum(axis=1), (rest < found).sum(axis=1))
    assert opened[-1] > opened[0]
    assert formed[-1] > formed[0] == 0
    assert np.array_equal(found, expected)  # none opens or forms within a step of a record
    # The adhesive force F appears or goes a step late at most, which gives a sphere F Δt/m more speed: in Δ0 and t0
    # (2/3) Δτ/(2(κ+3)). Within t0 the neighbours share it, so that it moves no sphere farther than in one t0.
    events = np.abs(np.diff(found.astype(int), axis=0)).sum()
    kick = step * (2 / 3) / (2 * (SHEET.sphere.stiffness_ratio + 3)) / record.scene.wave.amplitude
    off = np.abs(theirs - ours).max()
    assert off < events * kick
    # The wave of a tenth of the amplitude, in which fewer contacts open and none forms, is another one
    assert not np.array_equal(found[1:], expected[:-1])
    motion = first.state.motion / 10
    weak = replace(first, state=start(first.network, motion[:2].T, motion[3:5].T, motion[2], motion[5]))
    assert np.abs(10 * network_fields(weak, record.tau) - theirs).max() > 10 * events * kick
