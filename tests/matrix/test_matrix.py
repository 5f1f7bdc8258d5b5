"""Every pair of features of a scene builds, or is refused with a reason; and what builds today builds tomorrow."""

import pytest

from granular_lmp.errors import SceneError
from tests.matrix.features import IMPACTS, KINDS, WAVES, Kind, together
from tests.matrix.outcomes import (
    BUILDS,
    EXCLUSIVE,
    MEANING,
    NOT_BUILT,
    PHYSICS,
    gains,
    golden,
    losses,
    outcome,
    row,
    text,
    update,
)
from tests.matrix.outcomes import refused as refused_by
from tests.matrix.page import PAGE, current, refused

# Dear rows of features that other rows have too
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
BEFORE = {"a": ".", "b": "P.", "c": "N.x"}


@pytest.mark.parametrize(("kind", "name"), ROWS)
def test_a_feature_goes_with_those_that_it_went_with(kind: Kind, name: str) -> None:
    before, now = {each: line for each, line in golden(kind.name).items() if each == name}, {name: row(kind, name)}
    names = [*kind.features]
    changed = [
        f"{name} + {other}: {MEANING[old]} before, {MEANING[new]} now"
        for other, old, new in zip(names, before[name], now[name], strict=False)
        if old != new
    ]
    assert not changed, f"a gain is written down by python -m tests.matrix; a loss is a mistake: {changed}"
    assert len(now[name]) == len(before[name]) == names.index(name) + 1


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_the_golden_file_has_the_features_of_the_list_in_its_order(kind: Kind) -> None:
    assert [*golden(kind.name)] == [*kind.features]


def test_there_are_as_many_features_as_when_the_matrix_was_first_made() -> None:
    assert len(WAVES) >= 34
    assert len(IMPACTS) >= 16


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_each_feature_changes_the_scene(kind: Kind) -> None:
    alone = [name for name, line in golden(kind.name).items() if line[-1] == BUILDS]
    assert not [name for name in alone if kind.scene.with_values(kind.features[name]) == kind.scene]


def test_the_page_prints_the_matrix_and_every_refusal() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == current(page), "python -m tests.matrix writes it"
    for kind in KINDS:
        pairs = sum(len(each) for each in refused(kind).values())
        assert pairs == sum(line.count(PHYSICS) + line.count(NOT_BUILT) for line in golden(kind.name).values())


# --- the machinery ---------------------------------------------------------------------------------------------------


def test_settings_of_two_features_are_one_scene_unless_they_differ() -> None:
    assert together({"a": 1, "source": [1]}, {"a": 1, "b": 2, "source": [2]}) == {"a": 1, "b": 2, "source": [1, 2]}
    assert together({"a": 1}, {"a": 2}) is None
    assert outcome(KINDS[0], "square", "chain") == EXCLUSIVE


def test_a_refusal_that_does_not_say_what_it_is_is_an_error() -> None:
    with pytest.raises(LookupError, match="physics or not built: nobody said this"):
        refused_by(SceneError("nobody said this"))


def test_a_golden_file_may_only_gain() -> None:
    for worse in ({"a": "N", "b": "P.", "c": "N.x"}, {"a": ".", "b": "PP", "c": "N.x"}, {"a": ".", "b": "P."}):
        assert [*losses(BEFORE, worse)]
        with pytest.raises(ValueError, match="a golden file may only gain"):
            update(BEFORE, worse)
    relabelled = {"a": ".", "b": "N.", "c": "P.x"}  # a reason is changed by hand, with an argument
    assert [*losses(BEFORE, relabelled)] == [
        "b + a: physics before, not built now",
        "c + a: not built before, physics now",
    ]
    better = {"a": ".", "b": "P.", "c": "..x", "d": "...."}
    assert update(BEFORE, better) == better
    assert [*gains(BEFORE, better)] == ["c: N.x before, ..x now", "d: is new"]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_golden_file_is_read_back_as_it_was_written(kind: Kind) -> None:
    rows = golden(kind.name)
    assert set("".join(rows.values())) <= {BUILDS, PHYSICS, NOT_BUILT, EXCLUSIVE}
    assert text(rows).count("\n") == len(rows) + 1
