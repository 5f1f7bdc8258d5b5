"""Cheaper settings of the base case give the same wave, and an edit of a deck without effect is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import faster
from benchmarks.faster import Outcome, Variant, single_column, solve, swap, unguarded, variants, with_command, without
from benchmarks.problem import base_scene
from granular_lmp.rest.shape import quiet_rows

SHORT = {"time.duration": 20.0}
VARIANTS = variants()


def short(name: str, folder: Path) -> Outcome:
    variant = VARIANTS[name]
    return solve(replace(variant, values=variant.values | SHORT), folder)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return short("base", tmp_path_factory.mktemp("base") / "run")


def largest_difference(a: Outcome, b: Outcome) -> float:
    """Return the largest difference of p and q, in D0."""
    return max(float(np.abs(a.p - b.p).max()), float(np.abs(a.q - b.q).max()))


@pytest.mark.parametrize("edit", [swap("no such text", ""), with_command("no such", "x"), without("no such")])
def test_an_edit_that_finds_nothing_is_refused(edit: faster.Edit) -> None:
    with pytest.raises(ValueError, match="once|unpack"):
        edit("run 1\n")


def test_one_column_on_one_list_is_the_strip(base: Outcome, tmp_path: Path) -> None:
    # Rounding of positions of 1e5 nm, 1e-11 nm, in a D0 of 0.05 nm, over 400 steps
    assert largest_difference(short("column", tmp_path / "a"), base) < 1e-7


def test_one_column_on_a_list_made_anew_is_not_the_strip(base: Outcome, tmp_path: Path) -> None:
    column = Variant("the deck without guards, on one column", SHORT, (unguarded,), data=single_column)
    assert largest_difference(solve(column, tmp_path / "a"), base) > 1e-3


def test_half_a_period_in_a_tilted_cell_is_the_periodic_cell(tmp_path: Path) -> None:
    # As above
    assert largest_difference(short("periodic-odd", tmp_path / "a"), short("periodic", tmp_path / "b")) < 1e-7


def test_fewer_rows_than_the_echo_rule_are_heard() -> None:
    rows = quiet_rows(120.0)
    fewer = base_scene().with_values({"packing.rows": rows - 2, "time.allow_echo": True})
    assert fewer.echo_time < base_scene().time.duration <= base_scene().with_values({"packing.rows": rows}).echo_time
