"""Every pair of features of a scene builds, or is refused with a reason; and what builds today builds tomorrow."""

from pathlib import Path

import pytest

from granular_lmp.cli.entry import main
from granular_lmp.errors import SceneError
from granular_lmp.studies.combine import BUILDS, EXCLUSIVE, NOT_BUILT, PHYSICS, outcome, together
from granular_lmp.studies.features import IMPACTS, KINDS, WAVES, Kind
from tests.matrix.outcomes import TABLE, WORDS, Row, alone, committed, found, gains, losses, rows_of, update, write

# Expensive rows of features that other rows have too
MORE = {"jkr", "beam", "quiet", "rolling", "no rotation", "tolerance", "hertz scale", "state", "free sides"}
MORE |= {"held sides", "chirp", "quiet end", "wall end", "stiffness spread", "motion", "incremental", "restitution"}
MORE |= {"another sphere", "free end", "packet", "finite sheet", "snapshots", "no tracking", "torque", "fixed"}
MORE |= {"densities", "standing"}
ROWS = [
    pytest.param(
        kind, name, id=f"{kind.name}-{name}", marks=[pytest.mark.more] if kind.scene.wave and name in MORE else []
    )
    for kind in KINDS
    for name in kind.features
]
A, B = ("waves", "a", "a"), ("waves", "b", "a")
COMMITTED = committed()


@pytest.mark.parametrize(("kind", "name"), ROWS)
def test_a_feature_goes_with_those_that_it_went_with(kind: Kind, name: str) -> None:
    before = {pair: row for pair, row in COMMITTED.items() if pair[:2] == (kind.name, name)}
    now = rows_of(kind, name)
    assert not [*gains(before, now)], "python -m tests.matrix writes a gain; a loss is a mistake"
    assert before == update(before, now)


def test_the_table_has_each_pair_of_the_lists_in_their_order() -> None:
    pairs = []
    for kind in KINDS:
        names = [*kind.features]
        pairs += [(kind.name, name, other) for n, name in enumerate(names, 1) for other in names[:n]]
    assert [*COMMITTED] == pairs
    assert {row.outcome for row in COMMITTED.values()} == {*WORDS}


def test_the_table_says_why_each_refused_pair_is_refused() -> None:
    kinds = {kind.name: kind for kind in KINDS}
    refused = {pair: row for pair, row in COMMITTED.items() if row.outcome != BUILDS}
    assert refused == {pair: found(kinds[pair[0]], *pair[1:]) for pair in refused}
    assert all(row.message for row in refused.values())
    assert {row.outcome for row in refused.values()} == {PHYSICS, NOT_BUILT, EXCLUSIVE}


def test_there_are_as_many_features_as_when_the_matrix_was_first_made() -> None:
    assert len(WAVES) >= 34
    assert len(IMPACTS) >= 16


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_each_feature_changes_the_scene(kind: Kind) -> None:
    assert not [name for name in alone(kind) if kind.scene.with_values(kind.features[name]) == kind.scene]


# --- the machinery ---------------------------------------------------------------------------------------------------


def test_settings_of_two_features_are_one_scene_unless_they_differ() -> None:
    assert together({"a": 1, "source": [1]}, {"a": 1, "b": 2, "source": [2]}) == {"a": 1, "b": 2, "source": [1, 2]}
    with pytest.raises(SceneError, match="both set a, to 1 and 2"):
        together({"a": 1}, {"a": 2})
    assert outcome(KINDS[0], WAVES["square"], WAVES["chain"]).word == EXCLUSIVE


def test_a_value_that_is_wrong_by_itself_is_an_error() -> None:
    with pytest.raises(SceneError, match="disorder.radius = -1.0"):
        outcome(KINDS[0], {"disorder.radius": -1.0})


def test_the_table_may_only_gain() -> None:
    before = {A: Row(BUILDS), B: Row(PHYSICS, "why")}
    for worse in ({A: Row(NOT_BUILT), B: Row(PHYSICS)}, {A: Row(BUILDS)}):
        with pytest.raises(ValueError, match="the table may only gain"):
            update(before, worse)
    relabelled = {A: Row(BUILDS), B: Row(NOT_BUILT)}  # a reason is changed by hand, with an argument
    assert [*losses(before, relabelled)] == ["waves + b + a: physics before, not built now"]
    better = {A: Row(BUILDS), B: Row(BUILDS), ("waves", "b", "b"): Row(BUILDS)}
    assert update(before, better) == better
    assert [*gains(before, better)] == [
        "waves + b + a: physics before, builds now",
        "waves + b + b: not there before, builds now",
    ]
    measured = {A: Row(BUILDS, departure="1e-8", bound="2e-5")}
    assert update(measured, {A: Row(BUILDS)}) == measured
    assert update(before, {A: Row(BUILDS), B: Row(PHYSICS, "another")})[B].message == "another"


def test_the_table_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    write(COMMITTED, tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_bytes() == TABLE.read_bytes()


# --- the command -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("one", "other", "said"),
    [
        ("radii", "jkr", ["In a scene with [wave] or without [wave], radii and jkr go together."]),
        (
            "chain",
            "held-sides",
            [
                "In a scene with [wave], chain and held sides cannot go together: "
                'packing.sides = "held": must be "free" or left out in a chain, which has no other spheres.'
            ],
        ),
        ("wall end", "rolling", ["In a scene with [wave], wall end and rolling do not go together yet: packing.last"]),
        ("honeycomb", "packing.lattice=square", ["honeycomb and packing.lattice=square exclude each other: both set"]),
        ("square", "disorder.radius", ["with [wave], square and radii cannot", "without [wave], square and radii go"]),
    ],
)
def test_combine_answers_in_a_sentence_for_each_kind_that_differs(
    one: str, other: str, said: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["combine", one, other]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [part in line for part, line in zip(said, lines, strict=True)] == [True] * len(said)


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("honycomb", "feature 'honycomb' is unknown, and is no setting, KEY=VALUE; did you mean 'honeycomb'?"),
        ("disorder.radus", "did you mean 'disorder.radius'?"),
        ("packing.lattice", "packing.lattice: several features set it: chain, square, honeycomb; name one"),
        ("displaced", "feature 'displaced' does not belong to a scene with [wave]; feature 'oblique' does not belong"),
        ("disorder.radius=-1", "disorder.radius = -1.0: must be a number in"),
    ],
)
def test_combine_refuses_a_word_that_it_does_not_know(word: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["combine", "oblique", word]) == 2
    assert said in capsys.readouterr().err
