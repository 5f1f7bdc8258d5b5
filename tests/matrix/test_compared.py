"""Pairs of features beside the network: some of them here, all of them in the table of the page."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.matrix import compared
from tests.matrix.compared import PAGE, Outcome, outcome, pairs, scene_of

# Chosen for what they exercise: each law, lattice, form, source, face and damping that a network has a member for
CHEAP = [
    ("driven row", "state"),
    ("radii", "jkr"),
    ("vacancies", "viscosity"),
    ("another sphere", "restitution"),
    ("torque", "packet"),
    ("moved row", "beam"),
    ("square", "quiet"),
    ("oblique", "held sides"),
    ("chain", "restitution"),
    ("incremental", "free sides"),
    ("finite sheet", "chirp"),
    ("no shear", "striker"),
]


# In tests/validation JKR with unequal radii and a torque stand in test_beside_network, a beam in
# test_waves_against_theory
MORE = ("radii", "jkr"), ("moved row", "beam"), ("torque", "packet")


@pytest.mark.parametrize(
    "pair",
    [pytest.param(pair, id=" with ".join(pair), marks=[pytest.mark.more] * (pair in MORE)) for pair in CHEAP],
)
def test_a_pair_of_features_moves_as_its_network(pair: tuple[str, str], tmp_path: Path) -> None:
    assert pair in set(pairs())
    found = outcome(scene_of(*pair), tmp_path)
    assert not found.refused
    assert found.holds, found


def test_a_pair_beside_another_network_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = compared.first_snapshot

    def heavier(record):
        found = first(record)
        return replace(found, network=replace(found.network, density=1.01 * found.network.density))

    monkeypatch.setattr(compared, "first_snapshot", heavier)
    assert not outcome(scene_of("no shear", "striker"), tmp_path).holds


def test_the_page_has_each_pair_and_none_beyond_its_bound() -> None:
    text = PAGE.read_text("utf-8")
    rows = re.findall(r"^\| ([^|]+) with ([^|]+) \| (\S+) \| (\S+) \|$", text, re.MULTILINE)
    judged = {(one, other): Outcome(float(departure), float(bound)) for one, other, departure, bound in rows}
    assert all(each.holds for each in judged.values())
    refused = {
        tuple(each.split(" with ")) for each in re.findall(r"[\w ]+ with [\w ]+", text.partition("refused as")[2])
    }
    assert {tuple(part.strip() for part in pair) for pair in refused} | {*judged} == {*pairs()}
