"""Pairs of features beside the network: some of them here, all of them in the table."""

from dataclasses import replace
from pathlib import Path

import pytest

from granular_lmp.studies.combine import BUILDS
from tests.matrix import compared
from tests.matrix.compared import LEFT_OUT, outcome, outcome_of, pairs, scene_of
from tests.matrix.outcomes import Row, committed

# Chosen for what they exercise: each law, lattice, form, source, face and damping that a network has a member for
CHEAP = [
    ("driven row", "state"),
    ("radii", "jkr"),
    ("vacancies", "viscosity"),
    ("another sphere", "restitution"),
    ("restitution", "held sides"),
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


def test_the_table_has_each_pair_and_none_beyond_its_bound() -> None:
    rows = {(pair[2], pair[1]): row for pair, row in committed().items() if row.departure or LEFT_OUT in row.message}
    assert {*rows} == {*pairs()}
    judged = {pair: outcome_of(row) for pair, row in rows.items()}
    assert [pair for pair, each in judged.items() if not each.holds] == []
    assert [pair for pair, each in judged.items() if compared.row(each) != rows[pair]] == []
    assert not outcome_of(Row(BUILDS, departure="2.0e-04", bound="1.0e-04")).holds
